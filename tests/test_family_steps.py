"""A member of the family with every kind of term, typed a second time in NumPy: single steps.

From any memory: next state, torque and its parts, slope, flags; and what the inverse makes of it.
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.language.block import Guard, Labels
from esea_gen.language.ports import threshold
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.family_inverse import family_inverse
from esea_gen.model.family_sensor import family_sensor, family_step, unit_terms
from esea_gen.model.temperature import TemperatureFactor

from .single_steps import COUNT, Steps, word

where, clip = np.where, np.clip
H, SCALE, REACH = 1e-3, 0.2, 0.35 / 0.2
LINEAR, CUBIC, BENT = Rise("power", 1), Rise("power", 3), Rise("bend", 0.4)
FEW, MORE, WORN, FAR = (
    Softening("strain", 0.3),
    Softening("strain", 0.5),
    Softening("path", 3.0),
    Softening("path", 8.0),
)
# Some have an operator in common: springs, both Maxwell terms of two times, the first two stops.
WEIGHTED = (
    (1.0, Term("spring", LINEAR)),
    (2.0, Term("spring", CUBIC)),
    (0.5, Term("spring", BENT, softening=FEW)),
    (0.7, Term("spring", Rise("power", 5, "negative"), softening=FAR)),
    (0.03, Term("maxwell", LINEAR, (0.004, 5.0), 0.5)),
    (0.05, Term("maxwell", CUBIC, (0.004, 5.0), 0.5)),
    (0.8, Term("maxwell", Rise("bend", 0.4, "positive"), (0.02,), softening=FEW)),
    (1.1, Term("stop", LINEAR, (0.1,))),
    (1.3, Term("stop", LINEAR, (0.1,), softening=MORE)),
    (0.45, Term("stop", BENT, (0.05,), softening=WORN)),
    (0.85, Term("slip", CUBIC, (0.3,), softening=FAR)),
    (0.35, Term("slip", LINEAR, (0.05,))),
    (-0.2, Term("offset")),
    (0.0, Term("stop", LINEAR, (0.7,))),
)
WARM = TemperatureFactor(23.0, -0.004, 10.0, 40.0)
FITTED = FittedMember(
    Member("all", "all", tuple(t for _, t in WEIGHTED)), SCALE, tuple(w for w, _ in WEIGHTED), WARM
)
FACTORS = 1 - 0.004 * 17, 1 + 0.004 * 13
SHARES = 0.004**-0.5, 5.0**-0.5


@pytest.fixture(scope="module")
def device():
    return load_device("elbow")


def bend(x):
    return x / (1 + abs(x) / 0.4)


def drives(x):
    """Of the Maxwell branches, the stops and the slips, each as the states are ordered."""
    linear = 0.03 * x + 0.05 * x**3
    return (
        np.array([linear, linear, 0.8 * np.maximum(bend(x), 0)]),
        np.array([x, bend(x)]),
        np.array([x**3, x]),
    )


def relaxed(before, q, q_last):
    """Exact for a drive that is linear in time."""
    ratio = (H / np.array([0.004, 5.0, 0.02]))[:, None]
    left = np.exp(-ratio)
    mean = -np.expm1(-ratio) / ratio
    return left * before + (1 - mean) * q + (mean - left) * q_last


def slipped(before, q, q_last):
    """Dahl's equation along the path, exp(v) cut after the third order."""
    path = np.array([0.3, 0.05])[:, None]
    v = clip((q - q_last) / path, -8, 8)
    grown = 1 + abs(v) + v**2 / 2 + abs(v) ** 3 / 6
    z = before / grown + np.sign(v) * path * (1 - 1 / grown)
    return clip(z, -path, path)  # a memory of more than its path is none


def typed(s, theta, primed, factor):
    """Next state, and the torque of springs, branches and hysteresis."""
    x, last = theta / SCALE, where(primed, s.theta_prev_rad, theta) / SCALE
    (q_m, q_p, q_s), (m_last, _, s_last) = drives(x), drives(last)
    reached = np.maximum(s.reached, where(primed, 0, abs(x)))
    few, more = 1 / (1 + reached / 0.3), 1 / (1 + reached / 0.5)
    worn, far = s.kept
    before = where(primed, s.band, x)
    band = clip(before, x - 0.02, x + 0.02)
    v = np.minimum(abs(band - before) / np.array([3.0, 8.0])[:, None], 1)
    limits = np.array([0.1, 0.05])[:, None]
    state = {
        "reached": np.maximum(reached, abs(x)),
        "band": band,
        "kept": s.kept * (1 - v + v**2 / 2),
        "relaxed_Nm": relaxed(where(primed, s.relaxed_Nm, q_m), q_m, m_last),
        "play": clip(where(primed, s.play, q_p), q_p - limits, q_p + limits),
        "slip": slipped(where(primed, s.slip, 0), q_s, s_last),
    }
    spring = x + 2 * x**3 + 0.5 * few * bend(x) + 0.7 * far * np.minimum(x, 0) ** 5
    left = q_m - state["relaxed_Nm"]
    rate = SHARES[0] * left[0] + SHARES[1] * left[1] + few * left[2]
    stops = q_p - state["play"]
    hysteresis = (1.1 + 1.3 * more) * stops[0] + 0.45 * worn * stops[1]
    hysteresis = hysteresis + 0.85 * far * state["slip"][0] + 0.35 * state["slip"][1]
    parts = {"spring": factor * spring - 0.2, "rate": factor * rate}
    return state, parts | {"hysteresis": factor * hysteresis}


def near_the_last(s, u, rng):
    k = rng.random(COUNT) < 0.6
    u["theta_rad"][k] = clip(s["theta_prev_rad"] + rng.uniform(-0.04, 0.04, COUNT), -0.34, 0.34)[k]


def memory_ends():
    most = 0.03 * REACH + 0.05 * REACH**3
    return {
        "primed": (0, 1, 1),
        "theta_prev_rad": (-0.35, 0.35, 1),
        "reached": (0, 1.01 * REACH, 1),
        "band": (-2 * REACH, 2 * REACH, 1),
        "kept": (0, 1, 2),
        "relaxed_Nm": (
            -1.01 * max(most, 0.8 * bend(REACH)),
            1.01 * max(most, 0.8 * bend(REACH)),
            3,
        ),
        "play": (-2 * REACH, 2 * REACH, 2),
        "slip": (-0.3, 0.3, 2),
    }


@pytest.mark.parametrize("start", ["virgin", "conditioned"])
def test_a_step_of_the_torque(device, start):
    run = Steps(family_sensor(device, FITTED, start), together=near_the_last)
    s, u, t = run.s, run.u, run.t
    np.testing.assert_allclose(run.c.temperature_factor, 1 - 0.004 * (t.temperature_C - 23))
    primed = (s.primed != 0) & run.whole
    state, parts = typed(s, u.theta_rad, primed, run.c.temperature_factor)
    tau = sum(parts.values())
    outside = abs(u.theta_rad) > np.deg2rad(11.5), abs(u.omega_rad_s) > np.deg2rad(61.6)
    run.compare(
        {
            "next_primed": primed | run.ok,
            "next_theta_prev_rad": u.theta_rad,
            **{f"next_{k}": v for k, v in state.items()},
            **{f"y_tau_{k}_Nm": v for k, v in parts.items()},
            "y_tau_Nm": tau,
            "y_status": word(~run.ok, ~run.whole, *outside, abs(tau) > 4.47),
        },
        near=abs(abs(tau) - 4.47) < 1e-5,
    )
    ports = {p.name: p for p in run.block.state}
    assert {n: (p.low, p.high, p.size) for n, p in ports.items()} == {
        n: pytest.approx(ends, rel=1e-6) for n, ends in memory_ends().items()
    }
    softened = {n: ports[n].init for n in ("reached", "kept", "band", "primed")}
    begins = {"virgin": (0, 1), "conditioned": (1, 0)}[start]
    assert softened == {"reached": begins[0], "kept": begins[1], "band": 0, "primed": 0}


def test_ranges_of_the_torque(device):
    block = family_sensor(device, FITTED)
    strain, whole = bend(REACH), REACH**3
    springs = REACH + 2 * whole + 0.5 * strain + 0.7 * REACH**5
    branches = 2 * sum(SHARES) * (0.03 * REACH + 0.05 * whole) + 2 * 0.8 * strain
    hysteresis = (1.1 + 1.3) * 0.1 + 0.45 * 0.05 + 0.85 * 0.3 + 0.35 * 0.05
    most = FACTORS[1] * (springs + branches + hysteresis) + 0.2
    assert FITTED.most_Nm(0.35) == pytest.approx(most)
    for p in block.outputs[:4]:
        assert (p.low, p.high) == pytest.approx((-1.01 * most, 1.01 * most), rel=1e-5)
    assert [(p.low, p.high) for p in block.inputs] == [pytest.approx((-x, x)) for x in (0.35, 25.0)]
    (factor,) = block.coefficients
    ends = FACTORS[0] * (1 - 1e-4), FACTORS[1] * (1 + 1e-4)
    assert (factor.low, factor.high) == pytest.approx(ends, rel=1e-6)
    (warmth,) = block.tunables
    assert (warmth.default, warmth.low, warmth.high) == (23, 10, 40)
    assert "higher softens" in warmth.meaning


def drawn_memory(ports, rng, count):
    s = {p.name: rng.uniform(0.5 * p.low, 0.5 * p.high, (p.size, count)) for p in ports}
    s["primed"] = (rng.random((1, count)) < 0.7).astype(float)
    s["theta_prev_rad"] = rng.uniform(-0.3, 0.3, (1, count))
    s["slip"] *= np.array([[1.0], [0.05 / 0.3]])
    return s


@pytest.mark.parametrize("derived", [False, True])
def test_the_slope_of_the_torque_is_that_of_its_differences(device, derived):
    model = family_step(device, FITTED, "virgin", derived)
    ports, rng, count = model.state(), np.random.default_rng(4), 400
    symbols = {p.name: ca.SX.sym(p.name, p.size) for p in ports}
    theta, factor = ca.SX.sym("theta"), ca.SX.sym("factor")
    guard = Guard(inputs_ok=ca.SX(1), state_ok=ca.SX(1))
    _, sums, slope = model.torque_and_slope(
        SimpleNamespace(**symbols), theta, guard, Labels(), factor
    )
    of = ca.Function("of", [*symbols.values(), theta, factor], [*sums.values(), slope])
    s = drawn_memory(ports, rng, count)
    at, warm = rng.uniform(-0.34, 0.34, count), rng.uniform(*FACTORS, count)
    rows = [*s.values(), at[None, :], warm[None, :]]
    *parts, rises = (np.asarray(r)[0] for r in of.map(count).call(rows))
    memory = SimpleNamespace(**{k: v[0] if len(v) == 1 else v for k, v in s.items()})

    def torque(shift):
        return sum(typed(memory, at + shift, memory.primed != 0, warm)[1].values())

    np.testing.assert_allclose(sum(parts), torque(0), rtol=1e-9, atol=1e-9)
    e = 1e-6
    ahead, behind = (torque(e) - torque(0)) / e, (torque(0) - torque(-e)) / e
    smooth = abs(ahead - behind) < 1e-3 * (1 + abs(ahead))
    assert smooth.mean() > 0.95
    middle = (torque(e) - torque(-e)) / (2 * e)
    np.testing.assert_allclose(rises[smooth], middle[smooth], rtol=2e-4, atol=2e-4)


def test_a_step_of_unit_terms(device):
    """Columns of weight 1, from a path through every turn and both signs."""
    x = np.concatenate([np.linspace(0.1, 1.3, 9), np.linspace(1.2, -0.9, 12), [-0.88, -0.87, 0.4]])
    y, _ = unit_terms(FITTED.member, H).simulator().run({"theta_rad": x})
    found = np.asarray(y["terms_Nm"]).reshape(len(x), -1)
    sensor = family_sensor(device, FITTED)
    z, _ = sensor.simulator().run({"theta_rad": SCALE * x[abs(x) < 1.7], "omega_rad_s": 0 * x})
    np.testing.assert_allclose(found @ np.array(FITTED.weights_Nm), z["tau_Nm"], rtol=1e-9)
    assert found[0, 0] == pytest.approx(0.1)
    assert found[-1, 12] == 1


@pytest.mark.parametrize(("steps", "stays"), [(12, "NOT_CONVERGED"), (2, "")])
def test_a_step_of_the_inverse(device, steps, stays):
    """Torque of the set-point and what is missing of the request; the set-point by bisection."""

    def together(s, u, rng):
        u["tau_Nm"][:] = where(rng.random(COUNT) < 0.8, rng.uniform(-9, 9, COUNT), u["tau_Nm"])
        u["tau_Nm"][::97] = threshold(4.47) * rng.choice([-1, 1], COUNT)[::97]

    run = Steps(family_inverse(device, FITTED, steps=steps), together=together)
    s, u, factor = run.s, run.u, run.c.temperature_factor
    primed = (s.primed != 0) & run.whole
    last = where(primed, s.theta_prev_rad, 0)
    theta = run.found["y_theta_rad"]
    assert np.all(theta[~run.ok] == last[~run.ok])
    state, parts = typed(s, theta, primed, factor)
    torque = sum(parts.values())
    most = 1.01 * FITTED.most_Nm(0.35)
    omega = where(primed, theta - last, 0) / H
    missing = u.tau_Nm - torque
    clamped = (abs(u.tau_Nm) > most) | (abs(theta) >= np.float32(0.35))
    missed = (abs(missing) > 5e-6 * most) & ~clamped
    outside = (
        abs(theta) > np.deg2rad(11.5),
        abs(omega) > np.deg2rad(61.6),
        abs(u.tau_Nm) > threshold(4.47),
    )
    run.compare(
        {
            "next_primed": primed | run.ok,
            "next_theta_prev_rad": theta,
            **{f"next_{k}": v for k, v in state.items()},
            "y_theta_rad": theta,
            "y_omega_mid_rad_s": omega,
            "y_tau_model_Nm": torque,
            "y_residual_Nm": missing,
            "y_status": word(~run.ok, ~run.whole, *outside, run.ok & clamped, run.ok & missed),
        },
        both=stays,
        near=abs(abs(missing) - 5e-6 * most) < 1e-9,
    )
    room = {p.name: p.high for p in (*run.block.inputs, *run.block.outputs)}
    assert room["tau_Nm"] == pytest.approx(10 * most, rel=1e-6)
    assert room["residual_Nm"] == pytest.approx(20 * most, rel=1e-6)
    assert room["omega_mid_rad_s"] == pytest.approx(2 * 0.35 / H, rel=1e-6)
    low, high = np.full(COUNT, -0.7), np.full(COUNT, 0.7)
    wanted = clip(u.tau_Nm, -most, most)
    for _ in range(60):
        middle = (low + high) / 2
        below = sum(typed(s, middle, primed, factor)[1].values()) < wanted
        low, high = where(below, middle, low), where(below, high, middle)
    root = clip(low, -0.35, 0.35)
    close = abs(theta - root) < 2e-5
    assert close[run.ok].mean() > (0.98 if steps == 12 else 0.1)


def test_one_step_of_newton_from_the_last_set_point(device):
    """No flatter than half the springs, no longer than twice the bracket, else to its middle."""

    def together(s, u, rng):
        u["tau_Nm"][:] = rng.choice([-1, 1], COUNT) * 10 ** rng.uniform(-1, 1.5, COUNT)

    run = Steps(family_inverse(device, FITTED, steps=1), together=together)
    s, u, factor = run.s, run.u, run.c.temperature_factor
    primed = (s.primed != 0) & run.whole
    last = where(primed, s.theta_prev_rad, 0)

    def torque(x):
        return sum(typed(s, x, primed, factor)[1].values())

    e = 1e-6
    ahead, behind = (torque(last + e) - torque(last)) / e, (torque(last) - torque(last - e)) / e
    most = 1.01 * FITTED.most_Nm(0.35)
    missing = clip(u.tau_Nm, -most, most) - torque(last)
    # Of the springs, the linear one is the only one that rises everywhere.
    least = 0.5 * FACTORS[0] * 1.0 / SCALE
    slope = np.maximum(np.maximum((ahead + behind) / 2, least), abs(missing) / 2.8)
    low, high = where(missing > 0, last, -0.7), where(missing > 0, 0.7, last)
    newton = last + missing / slope
    inside = (newton >= low) & (newton <= high)
    theta = clip(where(inside, newton, (low + high) / 2), -0.35, 0.35)
    theta = where(run.ok & (abs(missing) > 5e-7 * most), theta, last)
    smooth = abs(ahead - behind) < 1e-3 * (1 + abs(ahead))
    smooth &= (abs(abs(newton) - 0.7) > 1e-3) & (abs(s.slip[1]) < 0.0499)
    assert smooth.mean() > 0.6
    found = run.found["y_theta_rad"]
    np.testing.assert_allclose(found[smooth], theta[smooth], atol=3e-5)
    assert 30 < (run.ok & ~inside & smooth).sum() < COUNT - 300
