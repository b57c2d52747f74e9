"""The virtual exoskeleton against an independent integrator, closed forms, energy balance."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import esea_gen
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.twin.encoders import ENCODERS, encoder_block, sine_of_turns
from esea_gen.twin.hand_plant import twin_system
from esea_gen.twin.parameters import STEP_S
from esea_gen.twin.people import ideal_plant, random_plant, real_plant
from esea_gen.twin.plant import plant_block, start_state

N = 74.0
H = STEP_S


class Rig:
    """A compiled plant, driven step by step from arrays."""

    def __init__(self, device: Device, cable: bool, step_s: float = H) -> None:
        self.system = twin_system(device, cable, step_s)
        self.step_s = step_s
        self.block = self.system.blocks["plant"]
        self.library = compile_system(self.system, "f64")
        self.names = {t.name for t in self.block.tunables}

    def run(self, u, initial=None, start_rad=0.0, path=None, noise=0.0, **tunables) -> dict:
        runner = self.library.task("move")
        values = {k: v for k, v in tunables.items() if k in self.names}
        assert runner.prepare({"plant": values}) == 0
        vectors, _ = start_state(self.block, start_rad)
        vectors["omega_rad_s"] = [0.0] * len(vectors["theta_rad"])
        for key, value in (initial or {}).items():
            quantity, body, unit = key.split("_", 2)
            vector = vectors[f"{quantity}_{unit}"]
            vector["gml"[-len(vector) :].index(body)] = value
        state = runner.state
        for name, vector in vectors.items():
            state["plant"][name][0, : len(vector)] = vector
        runner.state = state
        u = np.asarray(u, dtype=float)
        t = self.step_s * np.arange(1, len(u) + 1)
        theta, omega, alpha = path(t) if path else (np.full(len(t), start_rad), 0.0, 0.0)
        inputs = {"u_Nm": u, "theta_p_rad": theta, "omega_p_rad_s": omega, "noise": noise}
        out, _ = runner.run({**inputs, "alpha_p_rad_s2": alpha}, trace=False)
        return {k: v.copy() for k, v in out.items()} | {"t": t}


@pytest.fixture(scope="module")
def rigid(drive) -> Rig:
    return Rig(drive, False)


@pytest.fixture(scope="module")
def cabled(drive) -> Rig:
    return Rig(drive, True)


@pytest.fixture(scope="module")
def halved(drive) -> dict[bool, Rig]:
    """Both plants at half the step, by whether the cable is compliant."""
    return {cable: Rig(drive, cable, H / 2) for cable in (True, False)}


def with_elastomer(device: Device, maxwell: bool, **values: float) -> Device:
    e = device.file.elastomer
    update = {k: getattr(e, k).model_copy(update={"value": v}) for k, v in values.items()}
    update |= {} if maxwell else {"maxwell": None}
    return Device(device.file.model_copy(update={"elastomer": e.model_copy(update=update)}), "x")


FREE = {"spring_Nm_rad": 0.0, "damping_Nms_rad": 0.0, "own_damping_Nms_rad": 0.0, "feedforward": 0}
SMOOTH = {"fv_Nms_rad": 0.0, "fc_Nm": 0.0}

# -- an independent integrator --------------------------------------------------------------------

R_RAD = 0.0197 * np.arange(1, 11)
P_NM_RAD = 10.3 * np.exp(-62.5 * R_RAD)


def slopes(t, y, u, turn, p, path):
    """Right side of (5.1) to (5.3), typed from the thesis and the standard plants' description."""
    xg, vg, xm, vm, xl, vl, u_a, _ = y
    torque = torque_of(y, turn)
    drive = N * u_a - p["fv_Nms_rad"] * vg - p["fc_Nm"] * math.tanh(vg / 0.02)
    amplitude = p["gear_disturbance_rms_rad_s2"] * math.sqrt(2 / 6)
    waves = (math.sin(p[f"wave_{i}_1_rad"] * xg + p[f"phase_{i}_rad"]) for i in range(1, 7))
    drive += p["J_kgm2"] * amplitude * sum(waves)
    if "cable_loss" in p:
        gap, half = xg - xm, p["cable_backlash_rad"] / 2
        over = gap - half if gap > half else gap + half if gap < -half else 0.0
        pull = p["cable_stiffness_Nm_rad"] * over + p["cable_damping_Nms_rad"] * (vg - vm)
        pull = pull if pull * over > 0 else 0.0
        lost = p["cable_loss"] * abs(pull) * math.tanh(vm / 0.03)
        am = (pull - lost - 0.02 * vm - torque) / 0.003
        ag = (drive - pull) / p["J_kgm2"]
    else:
        ag = am = (drive - torque) / p["J_kgm2"]
    theta, omega, alpha = (float(x) for x in path(t))
    feed = p["Jh_kgm2"] * alpha + p["own_damping_Nms_rad"] * omega
    person = p["feedforward"] * (feed + p["gravity_Nm"] * math.sin(theta))
    person += p["spring_Nm_rad"] * (theta - xl) + p["damping_Nms_rad"] * (omega - vl)
    person -= p["own_damping_Nms_rad"] * vl + p["gravity_Nm"] * math.sin(xl)
    al = 0.0 if p["clamped"] else (torque + person) / p["Jh_kgm2"]
    return [vg, ag, vm, am, vl, al, (u - u_a) / p["tau_c_s"], maxwell_of(y)]


def torque_of(y, turn) -> float:
    delta = y[2] - y[4]
    stops = np.clip(turn[1] + delta - turn[0], -R_RAD, R_RAD)
    return 239 * delta**3 + 9.39 * delta + y[7] + float(P_NM_RAD @ stops)


def maxwell_of(y) -> float:
    """(3.3) and (3.4)."""
    delta, rate = y[2] - y[4], y[3] - y[5]
    eta = (53.9 * abs(delta) ** 2.77 + 0.0288) / (0.732 * abs(rate) ** 0.77 + 0.0130)
    return 51.6 * (rate - y[7] / eta)


def integrate(p: dict, u_ms: np.ndarray, path) -> np.ndarray:
    """The plant in scipy, millisecond by millisecond; row k is the end of millisecond k.

    Within a millisecond in which the deflection does not turn a stop operator is a closed form of
    it.  In one in which it turns, the deflection moves by less than 1e-5 rad.
    """
    y, turn, rows = np.zeros(8), (0.0, np.zeros(10)), []
    for k, u in enumerate(u_ms):
        span = (k * 1e-3, (k + 1) * 1e-3)
        done = solve_ivp(slopes, span, y, "LSODA", args=(u, turn, p, path), rtol=1e-8, atol=1e-10)
        y = done.y[:, -1]
        rows.append([*y, torque_of(y, turn)])
        delta = y[2] - y[4]
        turn = (delta, np.clip(turn[1] + delta - turn[0], -R_RAD, R_RAD))
    return np.array(rows)


COLUMNS = {"theta_g_rad": 0, "omega_g_rad_s": 1, "theta_m_rad": 2, "omega_m_rad_s": 3}
COLUMNS |= {"theta_l_rad": 4, "omega_l_rad_s": 5, "u_a_Nm": 6, "tau_e_Nm": 8}


def swing(t):
    """A path that starts with neither speed nor acceleration."""
    s = np.sin(np.pi * t)
    return (
        0.6 * s**4,
        2.4 * np.pi * s**3 * np.cos(np.pi * t),
        2.4 * np.pi**2 * (3 * s**2 - 4 * s**4),
    )


def still(t):
    return 0.0 * t, 0.0 * t, 0.0 * t


@pytest.mark.parametrize(
    ("kind", "person", "largest_Nm"),
    [
        ("ideal", "ideal", 5e-5),
        pytest.param("ideal", "none", 5e-5, marks=pytest.mark.ci),
        ("smooth", "uncertain", 1.2e-4),
        pytest.param("smooth", "uncertain-no-feedforward", 1e-4, marks=pytest.mark.ci),
        ("real", "uncertain", 3e-3),
        pytest.param("real", "none", 3e-3, marks=pytest.mark.ci),
    ],
)
def test_against_an_independent_integrator(drive, rigid, cabled, kind, person, largest_Nm):
    variant = {
        "ideal": ideal_plant(drive, person),
        "smooth": real_plant(drive, person, 4).having(cable_backlash_rad=0.0),
        "real": real_plant(drive, person, 4),
    }[kind].having(torque_noise_Nm=0.0)
    rig = rigid if kind == "ideal" else cabled
    p = {t.name: t.default for t in rig.block.tunables} | variant.values
    path = still if person == "none" else swing
    k = np.arange(700)
    u = np.round(0.07 * np.sin(2 * np.pi * 1.3e-3 * k) + 0.02 * np.sin(2 * np.pi * 5e-3 * k), 4)
    every = round(1e-3 / H)
    got = rig.run(np.repeat(u, every), path=path, **variant.values)
    expected = integrate(p, u, path)
    limits = {"tau_e_Nm": largest_Nm, "u_a_Nm": 1e-7}
    for name, column in COLUMNS.items():
        error = np.abs(got[name][every - 1 :: every] - expected[:, column])
        # The light motor-side part turns a small error of torque into one of speed.
        limit = limits.get(name, largest_Nm * (30 if name == "omega_m_rad_s" else 1))
        assert error.max() < limit, name
        if name == "tau_e_Nm":
            # Only the instants of contact are worse than this.
            assert np.sqrt(np.mean(error**2)) < 2e-4
    assert np.ptp(got["tau_e_Nm"]) > 3


# -- closed forms ---------------------------------------------------------------------------------


def test_lag_of_the_motor(rigid):
    got = rigid.run(np.full(500, 0.05), tau_c_s=0.02, clamped=1)
    assert got["u_a_Nm"] == pytest.approx(0.05 * -np.expm1(-got["t"] / 0.02), rel=1e-12)
    # Beyond what the drive follows, its limit stands for the command.
    got = rigid.run(np.full(500, -3.0), tau_c_s=0.02, clamped=1)
    assert got["u_a_Nm"][-1] == pytest.approx(0.221 * np.expm1(-got["t"][-1] / 0.02), rel=1e-12)


def test_linear_spring_swings_as_the_textbook_says(drive):
    linear = with_elastomer(drive, False, k1_Nm_rad=30.0, k3_Nm_rad3=0.0, alpha_Nm_rad=0.0)
    rig = Rig(linear, False)
    got = rig.run(np.zeros(20000), {"omega_m_rad_s": 1.0}, clamped=1, **SMOOTH)
    w = math.sqrt(30 / 0.663)
    # The step's frequency is off by (w h)^2 / 24 of itself.
    limit = 1e-6 + (w * H) ** 2 / 24 * w * got["t"][-1] / w
    assert got["theta_m_rad"] == pytest.approx(np.sin(w * got["t"]) / w, abs=1.2 * limit)
    assert np.all(got["theta_l_rad"] == 0)
    assert np.max(np.abs(got["stored_J"] + got["work_elastomer_J"] - 0.5 * 0.663)) < 1e-6
    # Free, motor and load swing against each other with the reduced inertia.
    got = rig.run(np.zeros(15000), {"omega_m_rad_s": 1.0}, **FREE, **SMOOTH)
    w = math.sqrt(30 * (1 / 0.663 + 1 / 0.22))
    deflection = got["theta_m_rad"] - got["theta_l_rad"]
    assert deflection == pytest.approx(np.sin(w * got["t"]) / w, abs=1e-5)
    momentum = 0.663 * got["omega_m_rad_s"] + 0.22 * got["omega_l_rad_s"]
    assert momentum == pytest.approx(np.full(15000, 0.663), rel=1e-12)


@pytest.mark.parametrize("share", [0.5, 0.9, 1.5])
def test_friction_holds_below_its_limit(rigid, share):
    # A torque below the Coulomb friction leaves a creep, one above it a speed: both closed forms.
    u = share * 0.4688 / N
    light = {"J_kgm2": 0.05, "Jh_kgm2": 0.02, "joint_max_rad": 10.0}
    got = rigid.run(np.full(40000, u), **FREE, **light)

    def balance(v):
        return 0.5551 * v + 0.4688 * math.tanh(v / 0.02) - N * u

    speed = brentq(balance, 0, 5, xtol=1e-14)
    assert got["omega_l_rad_s"][-1] == pytest.approx(speed, rel=1e-9)
    assert (speed < 0.03) == (share < 1)


def test_torque_noise_has_its_effective_value_and_bandwidth(rigid):
    white = np.random.default_rng(5).standard_normal(40000)
    every = round(1e-3 / H)
    values = {"Jh_kgm2": 100.0, "torque_noise_Nm": 0.3, "torque_noise_Hz": 2.0} | FREE
    got = rigid.run(np.zeros(len(white) * every), noise=np.repeat(white, every), **values)
    noise = got["tau_h_Nm"][every - 1 :: every]
    pole, expected = math.exp(-2 * math.pi * 2.0 * 1e-3), 0.0
    for k in range(2000):
        expected = pole * expected + 0.3 * math.sqrt(1 - pole**2) * white[k]
        assert noise[k] == pytest.approx(expected, abs=1e-12)
    # 40 s hold 500 time constants of the square: 6 % is two standard deviations.
    assert np.std(noise[1000:]) == pytest.approx(0.3, rel=0.12)


# -- stops, trips ---------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [1, -1])
def test_joint_stops_hold(rigid, sign):
    target = 5.0 * sign
    got = rigid.run(
        np.zeros(30000), path=lambda t: (target * np.minimum(t / 2, 1) ** 2, 0 * t, 0 * t)
    )
    limit = 3.0 if sign > 0 else -0.6
    # The person's spring against the stop's: 15 (5 - x) = 5000 (x - limit).
    assert got["theta_l_rad"][-1] == pytest.approx((15 * target + 5000 * limit) / 5015, abs=2e-4)
    assert np.max(np.abs(got["theta_l_rad"])) < abs(limit) + 0.1


def test_coupling_stop_holds_the_full_motor_torque(rigid):
    got = rigid.run(np.full(30000, 0.221), clamped=1, trip_torque_Nm=1.0)
    assert 0.34 < got["theta_m_rad"][-1] < 0.341
    assert np.max(got["theta_m_rad"]) < 0.36
    assert got["tau_e_Nm"][-1] == pytest.approx(N * 0.221, rel=0.01)
    assert abs(got["omega_m_rad_s"][-1]) < 1e-3


def test_trip_by_speed_latches_the_motor_off(rigid):
    got = rigid.run(np.full(20000, 0.221), trip_speed_rad_s=2.0, trip_torque_Nm=100.0, **FREE)
    tripped = got["tripped"]
    first = int(np.argmax(tripped > 0))
    assert np.all(tripped[:first] == 0)
    assert np.all(tripped[first:] == 1)
    speed = np.abs(got["omega_g_rad_s"])
    assert speed[first] > 2.0 >= np.max(speed[:first])
    since = got["t"][first:] - got["t"][first]
    assert got["u_a_Nm"][first:] == pytest.approx(
        got["u_a_Nm"][first] * np.exp(-since / 0.03488), rel=1e-9
    )
    assert speed[-1] < 1.0  # the speed is long gone, the trip stays


def test_trip_by_effective_torque(rigid):
    got = rigid.run(np.full(20000, 0.2), clamped=1, trip_torque_Nm=0.12, trip_window_s=0.5)
    lag, window = 0.03488, 0.5

    def heat(t):
        # First-order response to u^2 (1 - exp(-t/lag))^2, term by term.
        terms = ((1.0, math.inf), (-2.0, lag), (1.0, lag / 2))
        total = 0.0
        for factor, tau in terms:
            rate = 1 / tau
            gain = (1 / window) / (1 / window - rate)
            total += factor * gain * (math.exp(-rate * t) - math.exp(-t / window))
        return 0.2**2 * total

    when = brentq(lambda t: heat(t) - 0.12**2, 1e-3, 3)
    first = int(np.argmax(got["tripped"] > 0))
    assert got["tripped"][first] == got["tripped"][-1] == 2
    assert got["t"][first] == pytest.approx(when, abs=2 * H)
    # Not tripped where the threshold is above what is ever reached.
    assert not np.any(rigid.run(np.full(20000, 0.1), clamped=1, trip_torque_Nm=0.12)["tripped"])


# -- energy ---------------------------------------------------------------------------------------


def balance_gap(got: dict) -> np.ndarray:
    """Energy that came in less what went out, in J."""
    into = got["work_motor_J"] + got["work_person_J"] + got["work_disturbance_J"]
    return into - got["work_loss_J"] - got["work_elastomer_J"] - got["stored_J"]


def balance_bound_J(got: dict, halved: dict) -> float:
    """What the step alone can leave of the gap, by a second run at half the step.

    Where jaws meet or friction is steep the step is of first order, so that Richardson's estimate
    of its error is twice what halving changes.  Twice that is allowed: 1.4 times is the most that
    240 random plants came to.  What is counted wrongly does not shrink with the step, and is left.
    """
    return 4 * float(np.max(np.abs(balance_gap(got) - balance_gap(halved)[1::2])))


STOP_RAD, STOP_NM_RAD = 0.34, 20000.0  # plants.toml, coupling
END_NM_RAD, END_NMS_RAD = 5000.0, 20.0  # plants.toml, joint: at -0.6 rad and 3.0 rad


def twist_bound_rad(got: dict, p: dict, cable: bool) -> float:
    """How far the jaws can be driven into the stop, from the speed at which they meet.

    A mass m that meets a spring k at speed v and is pushed by no more than F comes to rest at
    d = F/k + sqrt((F/k)^2 + m v^2 / k).  The rubber and the stop's damper, left out, hold it back.
    The kick-drift step conserves the energy of a spring of k (1 - k h^2 / 4m) in place of k.
    """
    rate = np.abs(got["omega_m_rad_s"] - got["omega_l_rad_s"])
    inside = np.abs(got["theta_m_rad"] - got["theta_l_rad"]) > STOP_RAD
    if not inside.any():
        return STOP_RAD
    met = np.flatnonzero(np.diff(inside.astype(int)) > 0)
    v = max(np.max(rate[met]), np.max(rate[met + 1]))
    if cable:
        m, gap = p["motor_side_inertia_kgm2"], np.abs(got["theta_g_rad"] - got["theta_m_rad"])
        pull = np.abs(got["omega_g_rad_s"] - got["omega_m_rad_s"])
        push = p["cable_stiffness_Nm_rad"] * gap + p["cable_damping_Nms_rad"] * pull
    else:
        m = p["J_kgm2"]
        push = N * np.abs(got["u_a_Nm"]) + m * np.abs(got["d4_rad_s2"])
    if not p["clamped"]:
        # Motion of one against the other: the reduced mass, and no more than both pushes.
        m = 1 / (1 / m + 1 / p["Jh_kgm2"])
        x, w = got["theta_l_rad"], np.abs(got["omega_l_rad_s"])
        end = np.maximum(x - 3.0, 0) + np.maximum(-0.6 - x, 0)
        push = push + np.abs(got["tau_h_Nm"]) + END_NM_RAD * end + END_NMS_RAD * w * (end > 0)
    k = STOP_NM_RAD * (1 - STOP_NM_RAD * H**2 / (4 * m))
    still = np.max(push[np.convolve(inside, np.ones(3), "same") > 0]) / k
    return float(STOP_RAD + still + math.sqrt(still**2 + m * v**2 / k))


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.booleans(), st.floats(0.2, 6.0), st.booleans())
@example(seed=4, cable=False, hertz=2.0, clamped=True)  # meets the stop at 5 rad/s
def test_energy_balance_of_random_plants(drive, cabled, rigid, halved, seed, cable, hertz, clamped):
    values = dict(random_plant(drive, seed).values) | {"clamped": clamped}
    rng = np.random.default_rng(seed)
    t = np.arange(10000) * H
    u = rng.uniform(0.02, 0.221) * np.sin(2 * np.pi * hertz * t + rng.uniform(0, 6))
    noise = np.repeat(rng.standard_normal(2000), 5)
    rig = cabled if cable else rigid
    got = rig.run(u, path=swing, noise=noise, **values)
    finer = halved[cable].run(np.repeat(u, 2), path=swing, noise=np.repeat(noise, 2), **values)
    assert np.max(np.abs(balance_gap(got))) < balance_bound_J(got, finer)
    assert not np.any(got["plant_status"])
    assert np.all(np.diff(got["work_loss_J"]) > -1e-9)
    twist = np.max(np.abs(got["theta_m_rad"] - got["theta_l_rad"]))
    whole = {t.name: t.default for t in rig.block.tunables} | values
    assert twist <= twist_bound_rad(got, whole, cable)
    if clamped:
        assert np.all(got["theta_l_rad"] == 0)
        assert np.all(got["work_person_J"] == 0)


# -- guards ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("cable", [True, False])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_nothing_that_is_not_a_number_passes(drive, cable, bad):
    block = plant_block(drive, cable)
    calm = {p.name: 0.01 for p in block.inputs}
    for port in block.inputs:
        sim = block.simulator()
        out = sim.step(**calm | {port.name: bad})
        assert out["plant_status"] == 1
        assert all(np.all(np.isfinite(v)) for v in [*out.values(), *sim.state.values()])
    for port in block.state:
        for i in range(port.size):
            sim = block.simulator()
            sim.step(**calm)
            value = sim.state[port.name]
            value[i] = bad
            sim.state = {port.name: value}
            out = sim.step(**calm)
            assert out["plant_status"] == 2, port.name
            assert all(np.all(np.isfinite(v)) for v in [*out.values(), *sim.state.values()])


# -- encoders -------------------------------------------------------------------------------------

X = ca.SX.sym("x")


SINE = ca.Function("sine", [X], [sine_of_turns(X)])


@given(st.floats(-100, 100))
def test_sine_of_turns(turns):
    assert float(SINE(turns)) == pytest.approx(math.sin(2 * math.pi * turns), abs=2e-11 + 1e-12)


@pytest.fixture(scope="module")
def encoders(drive):
    return encoder_block(drive)


@settings(max_examples=60)
@given(
    st.lists(st.floats(-6, 6), min_size=3, max_size=3),
    st.sampled_from([4, 8, 11, 12]),
    st.sampled_from([10, 16, 17]),
    st.lists(st.floats(-0.1, 0.1), min_size=9, max_size=9),
)
def test_counts(encoders, angles, bits, motor_bits, errors):
    theta = dict(zip(("motor", "load", "gear"), angles, strict=True))
    tunables = {"joint_encoder_bits": bits, "motor_encoder_bits": motor_bits}
    names = ("offset_rad", "wave_1_rad", "phase_1_rad", "wave_2_rad")
    for side, chunk in (("motor", errors[:4]), ("load", errors[4:8])):
        tunables |= {f"{side}_{n}": 5 * e for n, e in zip(names, chunk, strict=True)}
    tunables["gear_offset_rad"] = errors[8]
    out = encoders.simulator(tunables).step(**{ENCODERS[k]: v for k, v in theta.items()})
    for side, x in theta.items():
        seen = (N if side == "gear" else 1) * x + tunables[f"{side}_offset_rad"]
        if side != "gear":
            a1, p1, a2 = (tunables[f"{side}_{n}"] for n in names[1:])
            seen += a1 * math.sin(x + p1) + a2 * math.sin(2 * x)
        own, full = (motor_bits, 17) if side == "gear" else (bits, 12)
        steps = seen / (2 * math.pi) * 2**own
        if abs(steps - round(steps)) > 1e-5:
            expected = (math.floor(steps) % 2**own) * 2 ** (full - own)
            assert out[f"count_{side}"] == expected
        assert out[f"count_{side}"] == int(out[f"count_{side}"]) < 2**full


# -- numbers and people ---------------------------------------------------------------------------


def test_a_device_without_a_drive_is_refused():
    with pytest.raises(UserError, match=r"section \[actuator\] is missing"):
        twin_system(esea_gen.load_device("elbow"))
