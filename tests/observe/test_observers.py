"""Observers: rates, disturbance of the drive, torque of the person."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_are

import esea_gen
from esea_gen.device import Device, parse_device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.language.stream import single
from esea_gen.language.system import System, Task
from esea_gen.observe.disturbance import bandwidth_limit_1_s, drive_observer
from esea_gen.observe.human import error_matrix, extended_state, lag_observer
from esea_gen.observe.rates import STATE_ROOM, filter_delay_s, load_rate, motor_rate

H = 1e-3
N, J, FV, FC, WIDTH, TAU_C, JH = 74.0, 0.663, 0.5551, 0.4688, 0.05, 0.03488, 0.22
LSB = 2 * math.pi / 4096


def changed(device: Device, **values: float) -> Device:
    text = device.toml()
    for key, value in values.items():
        lines = [
            f'{key} = {{ value = {value}, status = "assumed", source = "a test" }}'
            if line.startswith(f"{key} =")
            else line
            for line in text.splitlines()
        ]
        assert lines != text.splitlines(), key
        text = "\n".join(lines) + "\n"
    return parse_device(text, "changed.toml")


def observers(device: Device) -> System:
    """All observers side by side, each with inputs of its own."""
    made = (
        motor_rate(device),
        load_rate(device),
        drive_observer(device),
        lag_observer(device),
        extended_state(device),
    )
    blocks = {b.name: b for b in made}
    inputs = {f"{n}_{p.name}": (f"{n}.{p.name}",) for n, b in blocks.items() for p in b.inputs}
    outputs = {f"{n}_{p.name}": f"{n}.{p.name}" for n, b in blocks.items() for p in b.outputs}
    return System("watch", H, blocks, (Task("watch", tuple(blocks)),), {}, inputs, outputs)


@pytest.fixture(scope="module")
def libraries(drive):
    return {real: compile_system(observers(drive), real) for real in ("f64", "f32")}


# -- rates ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("cutoff", [15.0, 30.0, 60.0])
def test_rate_is_scipys_butterworth_of_the_difference(drive, cutoff):
    theta = np.clip(1.0 + np.cumsum(np.random.default_rng(3).normal(0, 3e-3, 3000)), -0.9, 3.3)
    b, a = signal.butter(4, cutoff, fs=1000.0)
    expected = signal.lfilter(b, a, np.diff(theta, prepend=theta[0]) / H)
    got, _ = motor_rate(drive).simulator({"cutoff_Hz": cutoff}).run({"theta_rad": theta})
    assert got["omega_rad_s"] == pytest.approx(np.clip(expected, -12, 12), abs=1e-9)


@pytest.mark.parametrize("cutoff", [1.0, 10.0, 60.0, 200.0, 400.0])
def test_filter_states_stay_in_their_room(cutoff):
    # An independent state-space form: sum of the magnitudes of the states' impulse responses.
    g = math.tan(math.pi * cutoff * H)
    steps = int(4000 / cutoff) + 400
    value = np.zeros(steps)
    value[0] = 1.0
    for k in (2 * math.cos(math.pi / 8), 2 * math.cos(3 * math.pi / 8)):
        x, out, total = np.zeros(2), np.zeros(steps), np.zeros(2)
        for i, v in enumerate(value):
            band = (x[0] + g * (v - x[1])) / (1 + g * (g + k))
            out[i] = x[1] + g * band
            x = np.array([2 * band - x[0], 2 * out[i] - x[1]])
            total += np.abs(x)
        assert np.all(total < STATE_ROOM)
        value = out
    assert np.sum(value) == pytest.approx(1.0, abs=1e-4)


def test_delay_of_a_slow_sine(drive):
    t = np.arange(20000) * H
    f = 0.5
    theta = 1 + 0.5 * np.sin(2 * np.pi * f * t)
    got, _ = load_rate(drive).simulator({"cutoff_Hz": 20.0}).run({"theta_rad": theta})
    measured = np.angle(np.mean(got["omega_rad_s"][4000:] * np.exp(-2j * np.pi * f * t[4000:])) * 2)
    delay = -measured / (2 * np.pi * f)
    assert filter_delay_s(10.0) == pytest.approx(0.04159, abs=1e-5)
    assert delay == pytest.approx(filter_delay_s(20.0) + H / 2, rel=2e-3)


def test_large_angles_cost_no_precision(libraries):
    # The same quantised motion at 0 and 12 counts below 3 rad: the same rate, to the f32 of angles.
    count = np.round(np.cumsum(np.random.default_rng(5).normal(0, 1.0, 4000)) * 0.2)
    near, far = (single((count + c) / 1024) for c in (0, 2000))
    run = {}
    for name, theta in (("near", near), ("far", far)):
        libraries["f32"].block("motor_rate").reset()
        run[name], _ = libraries["f32"].block("motor_rate").run({"theta_rad": theta})
    # Counts of 2^-10 rad are exact in float32: so is every difference, and the bits agree.
    assert np.array_equal(run["near"]["omega_rad_s"], run["far"]["omega_rad_s"])
    b, a = signal.butter(4, 30.0, fs=1000.0)
    expected = signal.lfilter(b, a, np.diff(near, prepend=near[0]) / H)
    assert run["far"]["omega_rad_s"] == pytest.approx(expected, abs=2e-5)


def test_gain_at_rest_is_one_in_float32(drive):
    # A slow cut-off, where a direct form would lose its gain.
    library = compile_system(observers(changed(drive, load_velocity_Hz=4.0, human_1_s=0.1)), "f32")
    runner = library.block("load_rate")
    assert runner.prepare({"cutoff_Hz": 2.0}) == 0
    ramp = single(np.arange(2500) / 1024)  # exact in float32: 0.9765625 rad/s
    y, _ = runner.run({"theta_rad": ramp})
    assert y["omega_rad_s"][-1] == pytest.approx(1000 / 1024, rel=1e-5)
    sections = signal.butter(4, 2.0, fs=1000.0, output="sos").astype(np.float32).astype(float)
    assert abs(np.prod(sections[:, :3].sum(axis=1) / sections[:, 3:].sum(axis=1)) - 1) > 1e-4


def test_a_cutoff_beyond_the_rate_is_refused(drive):
    device = changed(
        drive,
        sense_rate_Hz=500.0,
        control_rate_Hz=100.0,
        control_release_s=0.002,
        motor_velocity_Hz=300.0,
    )
    with pytest.raises(UserError, match=r"300 Hz is above 200 Hz"):
        motor_rate(device)
    with pytest.raises(UserError, match="the device has no drive"):
        motor_rate(esea_gen.load_device("elbow"))


# -- disturbance of the drive ---------------------------------------------------------------------


def commands(t: np.ndarray) -> np.ndarray:
    return np.where((t * 2).astype(int) % 2 == 0, 0.06, -0.03)


def torque(t):
    return 1.5 * np.sin(2 * np.pi * 0.7 * t)


def drive_motion(d4: float, seconds: float):
    """The motor side by an independent integrator: rate and motor torque at 1 ms."""
    t = np.arange(int(seconds / H) + 1) * H

    def slope(now, x, u):
        omega, u_a = x
        friction = FV * omega + FC * np.tanh(omega / WIDTH)
        return [(N * u_a - friction - torque(now)) / J + d4, (u - u_a) / TAU_C]

    x, out = np.zeros(2), [np.zeros(2)]
    for k in range(len(t) - 1):
        s = solve_ivp(slope, (t[k], t[k + 1]), x, args=(commands(t[k]),), rtol=1e-8, atol=1e-10)
        x = s.y[:, -1]
        out.append(x)
    return t, np.array(out)


@pytest.fixture(scope="module")
def motion():
    return drive_motion(0.45, 1.6)


@pytest.mark.parametrize("bandwidth", [5.0, 15.0])
def test_drive_disturbance_is_a_first_order_lag(drive, motion, bandwidth):
    t, x = motion
    simulator = drive_observer(drive).simulator({"bandwidth_1_s": bandwidth})
    y, _ = simulator.run({"u_Nm": commands(t), "omega_motor_rad_s": x[:, 0], "tau_Nm": torque(t)})
    assert y["d4_rad_s2"] == pytest.approx(0.45 * (1 - np.exp(-bandwidth * t)), abs=3e-3)
    assert y["u_a_Nm"] == pytest.approx(x[:, 1], abs=1e-7)


def test_momentum_form_of_the_paper(drive, motion):
    # d4 = L (omega - integral(a_model + d4)) written out, small steps: the same estimate.
    t, x = motion
    simulator = drive_observer(drive).simulator()
    y, _ = simulator.run({"u_Nm": commands(t), "omega_motor_rad_s": x[:, 0], "tau_Nm": torque(t)})
    z, u_a, d4, out = x[0, 0], 0.0, 0.0, []
    for k in range(len(t)):
        d4 = 5.0 * (x[k, 0] - z)
        out.append(d4)
        if k + 1 == len(t):
            break
        for i in range(20):
            share = (i + 0.5) / 20
            omega = x[k, 0] + share * (x[k + 1, 0] - x[k, 0])
            u_a += (commands(t[k]) - u_a) * H / 20 / TAU_C
            model = N * u_a - FV * omega - FC * np.tanh(omega / WIDTH) - torque(t[k] + share * H)
            z += H / 20 * (model / J + d4)
    assert y["d4_rad_s2"] == pytest.approx(np.array(out), abs=4e-3)


def test_bandwidth_is_bounded_by_the_velocity_filter(drive):
    limit = bandwidth_limit_1_s(drive, drive.file.joint.motor_velocity_Hz)
    # Small gain with scipy's filter, at the lowest cut-off that may be tuned: a margin of two.
    b, a = signal.butter(4, 2 * np.pi * 15.0, analog=True)
    w = np.logspace(-2, 4, 20000)
    _, f = signal.freqs(b, a, w)
    assert 0.3 < np.max(np.abs(limit / (1j * w + limit) * (1 - f))) <= 0.5
    assert np.max(np.abs(limit / (1j * w) * (1 - f))) == pytest.approx(0.5, rel=1e-3)
    with pytest.raises(UserError, match=r"drive_1_s = 19 1/s is above its limit 18 1/s"):
        drive_observer(changed(drive, drive_1_s=19.0))
    assert drive_observer(changed(drive, drive_1_s=18.0)).tunables[0].high < 18.1
    with pytest.raises(UserError, match="human_1_s"):
        lag_observer(changed(drive, human_1_s=19.0))


# -- torque of the person -------------------------------------------------------------------------


def test_eso_gains_are_steady_kalman_gains(drive):
    # Of a 12-bit encoder's rounding and a random walk of torque and of its rate, and of no other
    # noise: the Riccati equation, solved independently.
    inertia, decay = JH, 0.3
    keep = math.exp(-H / decay)
    a = np.array(
        [
            [1, H, H * H / 2 / inertia, 0],
            [0, 1, H / inertia, 0],
            [0, 0, 1, decay * (1 - keep)],
            [0, 0, 0, keep],
        ]
    )
    c = np.array([[1.0, 0, 0, 0]])
    noise = np.diag([0.0, 0.0, 4.10e-3, 3.646])
    r = LSB**2 / 12
    p = solve_discrete_are(a.T, c.T, noise, np.array([[r]]))
    gains = (p @ c.T / (c @ p @ c.T + r)).ravel()
    assert gains == pytest.approx([0.179, 17.7, 209.0, 3234.0], rel=4e-3)
    assert error_matrix(drive) == pytest.approx(
        (np.eye(4) - np.outer([0.179, 17.7, 209.0, 3234.0], c)) @ a, abs=1e-9
    )


@pytest.mark.parametrize("slope", [0.0, 1.5])
def test_eso_follows_a_constant_and_a_ramp(drive, slope):
    # Exact motion under tau_h = 1 + slope t.  A constant leaves no error; a ramp leaves what the
    # decay of the rate takes away, by the steady state of the error's recursion.
    t = np.arange(1000) * H
    tau_h = 1.0 + slope * t
    omega = (t + slope * t**2 / 2) / JH
    theta = (t**2 / 2 + slope * t**3 / 6) / JH
    inside = (theta < 3.2) & (omega < 11.5)
    y, _ = (
        extended_state(drive)
        .simulator()
        .run({"theta_load_rad": theta[inside], "tau_Nm": 0 * t[inside]})
    )
    m, keep = error_matrix(drive), math.exp(-H / 0.3)
    missed = slope * np.array([H**3 / 6 / JH, H**2 / 2 / JH, H - 0.3 * (1 - keep), 1 - keep])
    correction = np.eye(4)
    correction[:, 0] -= [0.179, 17.7, 209.0, 3234.0]
    steady = np.linalg.solve(np.eye(4) - m, correction @ missed)  # true less estimate
    last = np.array([y[k][-1] for k in ("tau_h_Nm", "tau_h_rate_Nm_s")])
    assert np.array([tau_h[inside][-1], slope]) - last == pytest.approx(steady[2:], abs=2e-4)
    assert y["omega_load_rad_s"][-1] == pytest.approx(omega[inside][-1], abs=1e-4 + 2e-3 * slope)


def test_eso_gains_that_diverge_are_refused(drive):
    with pytest.raises(UserError, match="multiplied by"):
        extended_state(changed(drive, gain_tau_Nm_rad=20900.0))
    with pytest.raises(UserError, match="multiplied by"):
        extended_state(changed(drive, gain_theta=0.0, gain_omega_1_s=0.0))
    # At one end only of what the decay may be set to, 0.06 to 1.5 s.
    with pytest.raises(UserError, match=r"decay of 1\.5 s.*multiplied by 1\.0003"):
        extended_state(changed(drive, gain_rate_Nm_s_rad=15000.0))
    gains = {"gain_theta": 0.0762, "gain_omega_1_s": 30.119, "gain_tau_Nm_rad": 481.5456}
    with pytest.raises(UserError, match=r"decay of 0\.06 s.*multiplied by 1\.0001"):
        extended_state(changed(drive, gain_rate_Nm_s_rad=16000.0, **gains))
