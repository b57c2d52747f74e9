"""Exact inverse of a family member: slope, bounds that its analysis takes, whole numbers."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.device import Device, parse_device
from esea_gen.emit.fixed.errors import any_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.plan import Planner
from esea_gen.errors import UserError
from esea_gen.hostlib.codec import to_raw
from esea_gen.hostlib.library import block_system, compile_system
from esea_gen.identify.family.identification import family_device
from esea_gen.language.block import Guard, Labels
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.family_inverse import family_inverse
from esea_gen.model.family_sensor import family_step
from esea_gen.model.rubber import fitted_of
from esea_gen.verify.bounds import forward_residual
from esea_gen.verify.fixed import RawExecutor, bounds_of, compare_fixed, raw_stream, states_before
from esea_gen.verify.runs import run_symbolic
from esea_gen.verify.streams import streams
from tests.control.test_predictive_family import BEARING
from tests.model.test_family_device import EVERY, drive

LINEAR = Rise("power", 1)
# Beside one of each: a bend that strain softens, of which the first sample's torque can fall.
MORE = FittedMember(
    Member(
        "more",
        "more",
        (
            *EVERY.member.terms,
            Term("spring", Rise("bend", 0.08), softening=Softening("strain", 0.3)),
            Term("spring", LINEAR, softening=Softening("strain", 0.3)),
            Term("slip", Rise("power", 3, "positive"), (0.3,), softening=Softening("strain", 0.3)),
        ),
    ),
    0.2,
    (*EVERY.weights_Nm[:-2], 0.2, -0.1, 1.2, 2.0, 1.0),
)
MEMBERS = {"every": EVERY, "more": MORE, "bearing": BEARING}


@pytest.fixture(scope="module")
def devices(elbow) -> dict[str, Device]:
    return {n: family_device(elbow, f, "drawn") for n, f in MEMBERS.items()}


class Tried:
    """Torque, slope and next state of a member at a deflection, from memories drawn."""

    def __init__(self, device: Device, factor: float | None = None) -> None:
        self.model = family_step(device, fitted_of(device), "virgin")
        self.ports = self.model.state()
        s = SimpleNamespace(**{p.name: ca.SX.sym(p.name, p.size) for p in self.ports})
        theta = ca.SX.sym("theta")
        guard = Guard(inputs_ok=ca.SX(1), state_ok=ca.SX(1))
        state, sums, slope = self.model.torque_and_slope(s, theta, guard, Labels(), factor)
        given = [*vars(s).values(), theta]
        after = [ca.SX(state[p.name]) for p in self.ports]
        self.given = given
        self.run = ca.Function("tried", given, [sum(sums.values()), slope, *after])

    def memories(self, rng: np.random.Generator, count: int):
        """What a history leaves, and the first sample among them; with two deflections each."""
        reach = self.model.theta_lim
        for k in range(count):
            memory = {p.name: rng.uniform(p.low, p.high, p.size) for p in self.ports}
            memory["primed"] = np.array([float(k % 4 > 0)])
            memory |= {"reached": rng.uniform(0, 1)} if "reached" in memory else {}
            # Neighbours and ends of the range alike.
            here = memory["theta_prev_rad"].item() + rng.choice([0.5, 0.05, 0.005]) * rng.normal()
            if "slip" in memory:
                paths = [e.number for e in self.model.of["slip"]]
                memory["slip"] = np.array(paths) * rng.uniform(-1, 1, len(paths))
            if "play" in memory:  # no further from q than the threshold of the last deflection
                memory["play"] = np.array([
                    float(ca.evalf(self.model.drive(e, memory["theta_prev_rad"].item() / 0.2)))
                    + e.number * rng.uniform(-1, 1)
                    for e in self.model.of["stop"]
                ])  # fmt: skip
            ends = np.clip([here, rng.uniform(-reach, reach)], -reach, reach)
            yield list(memory.values()), *ends

    def worst_slope(self) -> float:
        """How far a slope lies outside the one-sided differences, over the largest one."""
        h, worst, most = 1e-7, 0.0, 0.0
        for memory, theta, _ in self.memories(np.random.default_rng(4), 200):
            below, here, above = (
                float(self.run(*memory, theta + k * h)[0]) for k in (-1, 0, 1)
            )  # fmt: skip
            sides = sorted(((here - below) / h, (above - here) / h))
            slope = float(self.run(*memory, theta)[1])
            worst = max(worst, sides[0] - slope, slope - sides[1])
            most = max(most, slope)
        return worst / most


@pytest.mark.parametrize("name", MEMBERS)
def test_the_slope_is_that_of_the_torque(name, devices):
    """By differences of 1e-7 rad: rounding of the torque leaves 1e-8 of the largest slope."""
    assert Tried(devices[name]).worst_slope() < 1e-6
    assert Tried(devices[name], 0.8).worst_slope() < 1e-6  # a warm rubber


@pytest.mark.parametrize("name", MEMBERS)
def test_nothing_follows_the_set_point_faster_or_slower_than_said(name, devices):
    """Secants from one memory: what the error analysis carries a set-point's error with."""
    device, tried = devices[name], Tried(devices[name])
    solved = family_inverse(device, fitted_of(device)).solved["set_point_rad"]
    first, later = [], []
    for memory, a, b in tried.memories(np.random.default_rng(9), 200):
        one, other = (tried.run(*memory, x) for x in (a, b))
        moved = abs(a - b)
        risen = float((one[0] - other[0]) / (a - b)) if moved > 1e-6 else np.inf
        (later if memory[0] else first).append(risen)
        for p, x, y in zip(tried.ports, one[2:], other[2:], strict=True):
            off = np.abs(np.array(x - y)).max()
            assert off <= solved.follows[p.name] * moved * (1 + 1e-9) + 1e-12, p.name
    assert min(first) >= solved.slope * (1 - 1e-9)
    least = fitted_of(device).least_slope_Nm_rad(tried.model.theta_lim)
    assert min(later) >= least * (1 - 1e-9)


def test_without_a_least_slope_no_error_is_claimed(devices):
    """A first sample whose torque may fall: the inverse is built, its error in q31 refused."""
    terms = (
        Term("spring", LINEAR),
        Term("spring", Rise("bend", 0.08), softening=Softening("strain", 0.3)),
    )
    fitted = FittedMember(Member("c", "c", terms), 0.2, (0.1, 3.0))
    assert fitted.first_slope_Nm_rad(0.35) < 0 < fitted.least_slope_Nm_rad(0.35)
    block = family_inverse(devices["every"], fitted, steps=3)
    assert block.solved == {}
    system = SimpleNamespace(kinds=(block,))
    with pytest.raises(UserError, match="no error of inverse in q31 can be proven") as caught:
        bounds_of(SimpleNamespace(system=system, origin="mine.toml"))
    assert "linear spring" in caught.value.fix


# In whole numbers.


def test_a_step_below_the_last_digit_is_not_refused(devices):
    """A walk over the bearing's whole range, each step from float64's memory.

    Refused, it would be replaced by the bracket's middle, and eight more steps leave 0.3 Nm.
    """
    device = devices["bearing"]
    block = family_inverse(device, fitted_of(device))
    plan = Planner(block).plan()
    stream = next(s for s in streams(block, steps=300) if s.name == "random walk")
    _, states = run_symbolic(block, stream)
    fields = plan.fields["state"]
    held = {f.port.name: to_raw(states[f.port.name], f.fraction) for f in fields}
    before = states_before(plan, stream, held)
    found, _ = RawExecutor(plan).steps(before, raw_stream(plan, stream))
    names = [f.name for f in block.status_port.flags]
    assert not np.any(found["status"] >> names.index("NOT_CONVERGED") & 1)
    assert np.sum(found["status"] >> names.index("REQUEST_CLAMPED") & 1) < 150


@pytest.fixture(scope="module")
def fixed(devices):
    """Block, plan, bound and library of the inverse with one term of each kind.

    Six steps in place of twelve: these streams need five, and the plan is found in half the time.
    """
    device = devices["every"]
    block = family_inverse(device, fitted_of(device), steps=6)
    plan = plan_block(block)
    library = compile_system(block_system(block), "q31")
    return device, block, plan, any_bound(plan), library


@pytest.mark.ci
def test_whole_numbers_stay_within_what_the_residual_allows(fixed):
    """From every memory: bit for bit the executor's, and no further from float64 than derived."""
    device, block, plan, bound, library = fixed
    good = next(f.threshold for f in block.status_port.flags if f.name == "NOT_CONVERGED")
    # The torque rises by 7.5 Nm/rad at least (the linear spring), and by no less at first.
    assert 2 * good / 7.5 < bound.outputs["theta_rad"] < 2.1 * good / 7.5
    assert 2 * good < bound.outputs["tau_model_Nm"] < 2.1 * good
    for stream in streams(block, 5, 120):
        found = compare_fixed(device, plan, library.block("inverse"), stream, bound)
        assert found.problems == [], stream.name
        assert found.turned == 0


@pytest.mark.ci
def test_the_sensor_feels_what_was_asked_for(fixed):
    """The member's own sensor in float64 at the set-points of the whole-number C, jumps too."""
    device, block, _, _, library = fixed
    good = next(f.threshold for f in block.status_port.flags if f.name == "NOT_CONVERGED")
    runner, exact = library.block("inverse"), block.simulator()
    for stream in streams(block, 7, 400):
        if stream.injections:
            continue
        runner.reset()
        found = runner.run(stream.inputs, trace=False)[0]
        said, felt = forward_residual(device, block, stream, found)
        assert max(said, felt) < good, stream.name
    t = np.arange(3000) / 1000
    sweep = 3.5 * np.sin(2 * np.pi * (0.2 + 0.4 * t) * t)
    runner.reset()
    found = runner.run({"tau_Nm": sweep}, trace=False)[0]
    asked, _ = exact.run({"tau_Nm": sweep})
    assert np.abs(found["theta_rad"] - asked["theta_rad"]).max() < 2 * good / 7.5
    assert not np.any(found["status"].astype(int) & 0b1100011)


@pytest.mark.ci
def test_every_block_of_a_drive_with_a_member(elbow):
    """The bearing's rubber on the elbow's drive, each Block of both tasks."""
    device = parse_device(drive(family_device(elbow, BEARING, "drawn")), "bearing_smc.toml")
    library = compile_system(device.system, "q31")
    for block in device.system.kinds:
        plan = plan_block(block)
        bound = any_bound(plan)
        for stream in streams(block, steps=300):
            found = compare_fixed(device, plan, library.block(block.name), stream, bound)
            assert found.passed, (block.name, stream.name, found.problems)
