"""The family of elastomer models: operators by closed forms, energy, slope, and their C."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from esea_gen.device import Device
from esea_gen.emit.fixed.errors import any_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_device, compile_system
from esea_gen.identify.family.fit import members
from esea_gen.identify.family.identification import family_device as device_of
from esea_gen.language.system import System, Task
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.family_inverse import family_inverse
from esea_gen.model.family_sensor import family_sensor, unit_terms
from esea_gen.model.rubber import fitted_of
from esea_gen.verify.fixed import compare_fixed
from esea_gen.verify.streams import streams

LINEAR, CUBIC, BENT = Rise("power", 1), Rise("power", 3), Rise("bend", 0.4)
H = 0.01


def terms_over(terms: list[Term] | tuple[Term, ...], x: np.ndarray, h: float = H) -> np.ndarray:
    """Every term with weight 1 over a path, shape (samples, terms)."""
    y, _ = unit_terms(Member("tried", "tried", tuple(terms)), h).simulator().run({"theta_rad": x})
    return np.asarray(y["terms_Nm"]).reshape(len(x), -1)


def path_of(turns: list[float], each: int) -> np.ndarray:
    """From 0 to every turn in a straight line of so many samples."""
    corners = [0.0, *turns]
    parts = [np.linspace(a, b, each + 1)[1:] for a, b in itertools.pairwise(corners)]
    return np.concatenate([[0.0], *parts])


# Operators, by closed forms and by second derivations.


def test_a_maxwell_branch_on_a_ramp_and_in_relaxation():
    """dz/dt = v - z/T: z = v T (1 - e^(-t/T)) on the ramp; then it decays with T, exactly."""
    time, ramp, hold = 0.7, 50, 300
    x = np.concatenate([np.linspace(0, 0.5, ramp + 1), np.full(hold, 0.5)])
    z = terms_over([Term("maxwell", LINEAR, (time,))], x)[:, 0]
    t = H * np.arange(len(x))
    speed, end = 0.5 / (ramp * H), ramp * H
    top = speed * time * (1 - np.exp(-end / time))
    expected = np.where(
        t <= end, speed * time * (1 - np.exp(-t / time)), top * np.exp(-(t - end) / time)
    )
    assert np.abs(z - expected).max() < 1e-12


def test_a_branch_driven_by_a_rise_is_linear_in_that_rise():
    """Against an integration on a grid 50 times finer, by the trapezoidal rule."""
    x = 1.2 * np.sin(np.arange(400) * H * 2)
    z = terms_over([Term("maxwell", CUBIC, (0.3,))], x, H)[:, 0]
    fine = np.interp(np.arange(399 * 50 + 1) / 50, np.arange(400), x**3)
    h, found = H / 50, [0.0]
    for a, b in itertools.pairwise(fine):
        found.append((found[-1] * (1 - h / 0.6) + b - a) / (1 + h / 0.6))
    assert np.abs(z - np.array(found)[::50]).max() < 1e-6


def test_a_fractional_element_relaxes_by_a_power_of_time():
    """Shares T^-alpha over many decades make the relaxation t^-alpha in the middle of them."""
    times = tuple(10.0 ** np.arange(-4, 6, 0.5))
    x = np.concatenate([[0.0], np.ones(5000)])
    z = terms_over([Term("maxwell", LINEAR, times, 0.25)], x)[:, 0]
    exponent = np.diff(np.log(z[[50, 500, 5000]])) / np.log(10)
    assert np.abs(exponent + 0.25).max() < 0.03


def relays(x: np.ndarray, r: float, count: int = 4001) -> np.ndarray:
    """The play of half width r as Preisach's sum of relays, each up at c + r and down at c - r."""
    c = np.linspace(-2, 2, count)
    up = np.where(c < 0, 1.0, -1.0)
    out = []
    for value in x:
        up = np.where(value >= c + r, 1.0, np.where(value <= c - r, -1.0, up))
        out.append(0.5 * up.sum() * (c[1] - c[0]))
    return np.array(out)


@pytest.mark.parametrize("rise", [LINEAR, CUBIC, BENT])
def test_a_stop_is_what_preisach_relays_leave(rise):
    x = path_of([0.9, -0.4, 0.3, -1.1, 1.0, 0.2], 40)
    q = {LINEAR: x, CUBIC: x**3, BENT: x / (1 + np.abs(x) / 0.4)}[rise]
    stop = terms_over([Term("stop", rise, (0.15,))], x)[:, 0]
    assert np.abs(stop - (q - relays(q, 0.15))).max() < 3e-3


def test_the_loop_of_a_stop_has_the_area_of_its_parallelogram():
    x = path_of([1, -1, 1, -1, 1], 200)
    stop = terms_over([Term("stop", LINEAR, (0.3,))], x)[:, 0]
    last = slice(600, 1001)  # one whole cycle
    assert np.trapezoid(stop[last], x[last]) == pytest.approx(4 * 0.3 * (1 - 0.3), rel=1e-3)


def test_a_slip_forgets_along_its_path():
    """z = L (1 - e^(-s/L)) from rest, then towards -L from where it turned."""
    x, length = path_of([0.8, -0.5], 400), 0.3
    z = terms_over([Term("slip", LINEAR, (length,))], x)[:, 0]
    top = length * (1 - np.exp(-0.8 / length))
    back = -length + (top + length) * np.exp(-(0.8 - x[400:]) / length)
    assert np.abs(z[:401] - length * (1 - np.exp(-x[:401] / length))).max() < 1e-8
    assert np.abs(z[400:] - back).max() < 2e-8


def test_flicker_between_two_counts_does_not_soften():
    """One of 4096 counts to and fro, for a minute, of a largest deflection of 0.2 rad."""
    count = 2 * np.pi / 4096 / 0.2
    x = 0.4 + count * (np.arange(60000) % 2)
    y = terms_over([Term("spring", LINEAR, softening=Softening("path", 8.0))], x, 0.001)[:, 0]
    assert y[-2] == y[0]


# Energy: what no term gives.

EVERY = tuple(dict.fromkeys(t for m in members() for t in m.terms if t.kind != "offset"))
TURN = st.floats(-1.5, 1.5, width=32)


def least_work(x: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least work that had been put in at any time, and the work that went to and fro."""
    steps = 0.5 * (torque[1:] + torque[:-1]) * np.diff(x)[:, None]
    return np.cumsum(steps, axis=0).min(axis=0), np.abs(steps).sum(axis=0)


@pytest.fixture(scope="module")
def every_term():
    """The emitted C of every term of every candidate."""
    block = unit_terms(Member("every", "every", EVERY), H)
    wires = {"theta_rad": ("terms.theta_rad",)}, {"terms_Nm": "terms.terms_Nm"}
    system = System("every", H, {"terms": block}, (Task("run", ("terms",)),), {}, *wires)
    return compile_system(system, "f64").block("terms")


@given(
    turns=st.lists(TURN, min_size=1, max_size=8),
    back=st.booleans(),
    each=st.sampled_from([400, 1500]),
)
@settings(max_examples=30)
def test_no_path_gives_energy(every_term, turns, back, each):
    """From rest, unloaded: at no time has more come out than was put in; closed paths included."""
    x = path_of([*turns, 0.0] if back else turns, each)
    every_term.reset()
    terms = every_term.run({"theta_rad": x}, trace=False)[0]["terms_Nm"].reshape(len(x), -1)
    least, moved = least_work(x, terms)
    # The trapezoidal rule's own error, of the steps that cross a corner.
    assert np.all(least >= -1e-4 * np.maximum(moved, 1e-6)), EVERY[int(np.argmin(least))]


# A fitted member: slope, inverse, safety.


def some_member(rng: np.random.Generator, member: Member) -> FittedMember:
    weights = rng.exponential(1.0, len(member.terms)) * (rng.random(len(member.terms)) < 0.4)
    weights[0] = 0.1  # the linear spring of every candidate
    weights[[i for i, t in enumerate(member.terms) if t == Term("spring", LINEAR)]] = 0.5
    return FittedMember(member, 0.2, tuple(float(w) for w in weights))


@pytest.mark.parametrize("member", members(), ids=lambda m: m.name)
def test_the_torque_rises_with_the_deflection_from_any_memory(member, hdrb_device):
    """With a slope of at least what the springs have: the inverse is unique."""
    rng = np.random.default_rng(7)
    fitted = some_member(rng, member)
    block = family_sensor(hdrb_device, fitted)
    limit = block.inputs[0].high
    least = fitted.least_slope_Nm_rad(limit)
    assert least > 0
    theta = np.linspace(-limit, limit, 121)
    many = block.step.map(len(theta))
    for _ in range(6):
        simulator = block.simulator()
        walk = np.clip(np.cumsum(rng.normal(0, 0.03 * limit, 200)), -limit, limit)
        simulator.run({"theta_rad": walk, "omega_rad_s": 0 * walk})
        memory = [
            np.repeat(np.atleast_1d(s)[:, None], len(theta), 1) for s in simulator.state.values()
        ]
        torque = np.asarray(many(*memory, theta[None, :], 0 * theta[None, :])[len(memory)]).ravel()
        assert np.all(np.diff(torque) >= least * np.diff(theta) * (1 - 1e-9))


def test_a_member_without_a_sure_slope_is_refused(hdrb_device):
    soft = Term("spring", LINEAR, softening=Softening("path", 8.0))
    fitted = FittedMember(Member("soft", "soft", (soft,)), 0.2, (1.0,))
    with pytest.raises(UserError, match="need not rise"):
        device_of(hdrb_device, fitted, "drawn")


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: FittedMember(Member("a", "a", (Term("spring"),)), 0.2, (-1.0,)),
        lambda: FittedMember(Member("a", "a", (Term("spring"),)), 0.2, (1.0, 2.0)),
        lambda: Rise("power", 2),
        lambda: Rise("bend", 0.0),
        lambda: Softening("strain", -1.0),
        lambda: Term("stop", LINEAR, ()),
        lambda: Term("maxwell", LINEAR, (0.0,)),
    ],
)
def test_what_would_not_be_passive_cannot_be_written(wrong):
    with pytest.raises(ValueError, match=r"."):
        wrong()


# Its C.


@pytest.fixture(scope="module")
def hdrb_device(elbow):
    """A device that only measures, for its ranges."""
    return elbow


TIMED = ("fractional, strain", "Maxwell, strain", "stops, sides, offset")


@pytest.mark.parametrize("name", ["slips, worn", "stops, worn", *TIMED])
def test_merged_terms_are_the_weighted_sum(name, hdrb_device):
    """The sensor Block against the Block of unit terms."""
    member = next(m for m in members() if m.name == name)
    fitted = some_member(np.random.default_rng(3), member)
    theta = 0.2 * path_of([0.7, -1.0, 0.3, -0.2, 0.9], 60)
    sensor = family_sensor(hdrb_device, fitted)
    y, _ = sensor.simulator().run({"theta_rad": theta, "omega_rad_s": 0 * theta})
    terms = terms_over(member.terms, theta / 0.2, sensor.period_s)
    assert np.abs(y["tau_Nm"] - terms @ np.array(fitted.weights_Nm)).max() < 1e-11
    parts = y["tau_spring_Nm"] + y["tau_rate_Nm"] + y["tau_hysteresis_Nm"]
    assert np.abs(y["tau_Nm"] - parts).max() < 1e-12


def family_device(base: Device, name: str) -> Device:
    member = next(m for m in members() if m.name == name)
    return device_of(base, some_member(np.random.default_rng(3), member), "drawn")


@pytest.mark.ci
def test_the_whole_number_c_is_its_executor(hdrb_device):
    """One operator of each kind, both softenings."""
    strain, path = Softening("strain", 0.3), Softening("path", 8.0)
    terms = (
        Term("spring", LINEAR),
        Term("spring", BENT, softening=strain),
        Term("slip", CUBIC, (0.3,), softening=path),
        Term("stop", LINEAR, (0.1,)),
        Term("maxwell", LINEAR, (3.0,)),
    )
    fitted = FittedMember(Member("few", "few", terms), 0.2, (1.0, 0.5, 2.0, 0.4, 0.3))
    device = device_of(hdrb_device, fitted, "drawn")
    plan = plan_block(device.sensor)
    runner, bound = compile_device(device, "q31").block("sensor"), any_bound(plan)
    for stream in streams(device.sensor, 5, 150)[:2]:
        assert compare_fixed(device, plan, runner, stream, bound).problems == []


# Its exact inverse.

SWEEP_Nm = 2.0 * np.sin(2 * np.pi * (0.2 * np.arange(4000) / 1000 + (np.arange(4000) / 1000) ** 2))


@pytest.mark.parametrize("name", ["slips, worn", "stops, worn", *TIMED])
def test_the_inverse_gives_the_request_back(name, hdrb_device):
    """The sensor Block at its set-points, on a sweep to 2 Hz that turns back and softens."""
    device = family_device(hdrb_device, name)
    inverse = family_inverse(device, fitted_of(device))
    y, _ = inverse.simulator().run({"tau_Nm": SWEEP_Nm})
    felt, _ = device.sensor.simulator().run(
        {"theta_rad": y["theta_rad"], "omega_rad_s": 0 * SWEEP_Nm}
    )
    limit = next(f.threshold for f in inverse.status_port.flags if f.name == "NOT_CONVERGED")
    assert np.abs(felt["tau_Nm"] - SWEEP_Nm).max() <= limit < 1e-3
    assert np.all(y["status"].astype(int) & 0b1100011 == 0)


@pytest.mark.parametrize("name", ["slips, worn", *TIMED])
def test_the_inverse_finds_the_one_root(name, hdrb_device):
    """Brent's method on the sensor's own torque, from the same memory, jumps included."""
    device = family_device(hdrb_device, name)
    block = family_inverse(device, fitted_of(device), steps=30)
    good = next(f.threshold for f in block.status_port.flags if f.name == "NOT_CONVERGED")
    inverse = block.simulator()
    sensor = device.sensor.simulator()
    limit = device.sensor.inputs[0].high
    step = device.sensor.step
    rng = np.random.default_rng(11)
    inverse.step(tau_Nm=0.0)
    sensor.step(theta_rad=0.0, omega_rad_s=0.0)
    for wanted in rng.uniform(-2, 2, 40):
        memory = list(sensor.state.values())

        def missing(theta: float, memory: list = memory, wanted: float = wanted) -> float:
            return float(step(*memory, theta, 0.0)[len(memory)]) - wanted

        root = brentq(missing, -limit, limit, xtol=1e-13)
        found = float(inverse.step(tau_Nm=wanted)["theta_rad"])
        assert abs(missing(found)) < good
        assert abs(found - root) < good / fitted_of(device).least_slope_Nm_rad(limit)
        sensor.step(theta_rad=found, omega_rad_s=0.0)


def test_a_newton_step_out_of_the_bracket_is_caught(hdrb_device):
    """A spring that is steep at 0 and soft beyond: Newton alone is thrown from end to end."""
    steep = (Term("spring", LINEAR), Term("spring", Rise("bend", 0.02)))
    fitted = FittedMember(Member("steep", "steep", steep), 0.2, (0.05, 150.0))
    runner = family_inverse(hdrb_device, fitted, steps=30).simulator()
    runner.step(tau_Nm=3.0)
    for wanted in (-0.5, 2.9, -2.9, 0.3):
        x = float(runner.step(tau_Nm=wanted)["theta_rad"]) / 0.2
        assert abs(0.05 * x + 150 * x / (1 + abs(x) / 0.02) - wanted) < 1e-4


def test_what_cannot_be_reached_ends_at_the_limit_and_says_so(hdrb_device):
    device = family_device(hdrb_device, "slips, worn")
    inverse = family_inverse(device, fitted_of(device))
    runner = inverse.simulator()
    names = [f.name for f in inverse.status_port.flags]
    for _ in range(20):
        y = runner.step(tau_Nm=100.0)
    assert y["theta_rad"] == device.sensor.inputs[0].high
    assert int(y["status"]) >> names.index("REQUEST_CLAMPED") & 1
    held = runner.step(tau_Nm=np.nan)
    assert held["theta_rad"] == y["theta_rad"]
    assert int(held["status"]) & 1
