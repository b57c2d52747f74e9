"""Set-points within the motor's reach: smoothing, preview, benefit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import quad

from esea_gen.control.sliding_mode.governor import smoothed_setpoint, torque_lead
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.run import run_case
from esea_gen.twin.trajectories import bread, fixed_output, fixed_sinusoid, tuning

H = 1e-3
# As it was: nothing ahead, friction of the measured rate, a lead of 2.
BEFORE = {"lead": {"share": 0.0}, "smc": {"lead": 2.0, "friction_ahead": 0.0, "softening": 0.0}}


def smoothed(drive, theta, governed):
    simulator = smoothed_setpoint(drive).simulator()
    out = []
    for x, share in zip(theta, governed, strict=True):
        plain = {"delta_set_rad": x, "delta_rate_rad_s": 0.1, "delta_acc_rad_s2": 0.2}
        out.append(simulator.step(theta_set_rad=float(x), governed=float(share), **plain))
    return {name: np.array([o[name] for o in out]) for name in out[0]}


def test_governed_it_is_three_lags_of_70_ms_in_all(drive):
    t = H * np.arange(1500)
    theta = 0.1 * np.sin(2 * np.pi * 1.5 * t)
    y = smoothed(drive, theta, np.ones(1500))
    system = signal.TransferFunction([1], np.poly1d([0.07 / 3, 1]) ** 3)
    _, expected, _ = signal.lsim(system, theta, t)
    # One lag in steps of 1 ms is half a step ahead of the continuous one.
    found, late = y["delta_set_rad"][500:], expected[500:]
    assert np.abs(found - late).max() < 3 * 0.5 * H * 0.1 * 2 * np.pi * 1.5 * 1.05
    # Rate and acceleration are those of the same signal.
    assert np.abs(np.gradient(found, H) - y["delta_rate_rad_s"][500:])[2:-2].max() < 0.025
    acc = np.gradient(y["delta_rate_rad_s"], H)
    assert np.abs(acc - y["delta_acc_rad_s2"])[500:-2].max() < 0.25
    assert np.array_equal(y["theta_smooth_rad"], y["delta_set_rad"])


def test_not_governed_it_changes_nothing_and_starts_from_where_it_is(drive):
    theta = np.where(np.arange(400) >= 100, 0.1, -0.05)
    y = smoothed(drive, theta, np.where(np.arange(400) >= 200, 1.0, 0.0))
    assert np.array_equal(y["delta_set_rad"][:200], theta[:200])
    assert np.all(y["delta_rate_rad_s"][:200] == 0.1)
    # Governed from there on, and at rest: no transient.
    assert y["delta_set_rad"][200:] == pytest.approx(0.1, abs=1e-12)
    assert y["delta_rate_rad_s"][200:] == pytest.approx(0.0, abs=2e-4)


def led(drive, steps=1500, **values):
    simulator = torque_lead(drive).simulator()
    given = {
        "tau_set_Nm": 1.0,
        "tau_rate_Nm_s": 4.0,
        "tau_curve_Nm_s2": -20.0,
        "trust": 1.0,
        "settled": 1.0,
        "mode": 1.0,
    }
    for _ in range(steps):
        out = simulator.step(**(given | values))
    return out


def test_the_torque_is_led_as_far_as_the_set_point_is_smoothed(drive):
    expected = 1.0 + quad(lambda x: (4.0 - 20.0 * x) * np.exp(-x), 0, 0.07)[0]
    assert led(drive)["tau_led_Nm"] == pytest.approx(expected, abs=1e-6)
    assert led(drive, trust=0.5)["tau_led_Nm"] == pytest.approx(0.5 + expected / 2, abs=1e-6)


# -- in the loop -----------------------------------------------------------------------------------


def rms(path, tunables=None, seed=0):
    run = run_case(
        Case("x", path, tunables=tunables or {}), Setting("smc", person="uncertain"), seed
    )
    return float(np.sqrt(np.mean((run.plant["tau_e_Nm"] - path.tau_desired_Nm)[path.window] ** 2)))


@pytest.mark.parametrize(
    ("size_Nm", "frequency_Hz", "most", "before"), [(3.0, 1.0, 0.25, 0.6), (4.0, 0.5, 0.12, 0.2)]
)
def test_what_was_called_the_motors_limit_is_followed(size_Nm, frequency_Hz, most, before):
    path = fixed_sinusoid(size_Nm, frequency_Hz)
    assert max(rms(path, seed=s) for s in (0, 1)) < most
    assert rms(path, BEFORE) > before


def test_nothing_else_is_worse():
    assert rms(tuning()) < rms(tuning(), BEFORE)
    # With the damping that a law lacks both have 0.038 Nm.
    assert rms(bread(0.0)) < 1.05 * rms(bread(0.0), BEFORE)


def test_a_step_overshoots_no_more():
    case = Case("step", fixed_output("step", np.where(np.arange(4000) >= 1000, 0.5, 0.0), 1000))
    for seed in (0, 1):
        run = run_case(case, Setting("smc"), seed)
        # 6 % before; with the step smoothed as well it is 90.
        assert run.plant["tau_e_Nm"][1000:].max() < 0.5 * 1.1
