"""Criteria of the checks: each rejects 1.1 times its limit and passes 0.9 times."""

from __future__ import annotations

import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from esea_gen.control.predictive.drive import predictive_controller
from esea_gen.control.predictive.horizon import Horizon
from esea_gen.device import load_device
from esea_gen.emit import render
from esea_gen.emit.fixed.errors import Propagation, any_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.values import FieldPlan
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer, content_hash
from esea_gen.hostlib.library import HostLibrary, block_system
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port
from esea_gen.language.stream import Stream
from esea_gen.verify.bounds import derive_bounds
from esea_gen.verify.compare import compare, compare_program, program_streams, unexplained
from esea_gen.verify.fixed import compare_fixed, single_steps, states_before
from esea_gen.verify.one_step import StepRule
from esea_gen.verify.runs import CasadiOracle, run_c, run_executor
from tests import made_up
from tests.made_up import port
from tests.rendered_program import render_program

SHARES = [(0.9, True), (1.1, False)]
X = np.random.default_rng(7).uniform(-1, 1, 40).astype(np.float32).astype(float)
STREAM = Stream("noise", {"x_rad": X})


def made(kind: str) -> Block:
    """y = 0.7 x, beside a memory that nothing reads (noted) or that adds up (summed)."""

    def step(c, s, u, guard, label):
        kept = 0.3 * u.x_rad if kind == "noted" else s.kept_rad + 0.3 * u.x_rad
        return {"kept_rad": kept}, {"y_rad": 0.7 * u.x_rad}

    return made_up.made(step, (port("kept_rad", -1 if kind == "noted" else -20, 20),), name=kind)


def library(block: Block, real: str, old: str = "", new: str = "") -> HostLibrary:
    """The C of a Block, with one line of its step written otherwise."""
    renderer = Renderer(block_system(block), FORMATS[real], "-", "-", "made up")
    files = renderer.files()
    name = f"esea_{block.name}_alone_{block.name}.c"
    head, step = files[name].split("_step(", 1)
    if old:
        step, count = re.subn(old, new, step)
        assert count == 1, step
    files[name] = f"{head}_step({step}"
    renderer.files = lambda: files  # type: ignore[method-assign]
    return HostLibrary(renderer.system, renderer)


NOTED = r"state->kept_rad = ([^;]+);"


# -- values against their bounds -------------------------------------------------------------------


@pytest.mark.parametrize("real", ["f64", "f32"])
@pytest.mark.parametrize(("share", "passes"), SHARES)
@pytest.mark.parametrize(("group", "name"), [(0, "y_rad"), (1, "kept_rad")])
def test_a_value_beyond_its_bound_is_refused(elbow, real, share, passes, group, name):
    block = made("noted")
    found = library(block, real)
    bounds = derive_bounds(elbow, block) if real == "f32" else {}
    limit = compare(elbow, block, found, STREAM, bounds, None).limits[name]
    assert limit > 0
    # What the C gives, and beside it what is owed: so much of the limit away, in one step alone.
    got = run_c(found.block(block.name), STREAM)
    owed = tuple({k: np.asarray(v, float).copy() for k, v in part.items()} for part in got)
    owed[group][name][17] += share * limit
    result = compare(elbow, block, found, STREAM, bounds, None, expected=owed)
    assert result.passed == passes
    assert [p.split(":")[0] for p in result.problems] == ([] if passes else [name])
    assert result.errors[name] == pytest.approx(share * limit, rel=1e-3)


@pytest.mark.parametrize(("share", "passes"), SHARES)
@pytest.mark.parametrize("name", ["y_rad", "kept_rad"])
def test_what_one_step_adds_beyond_its_bound_is_refused(share, passes, name):
    block = made("summed")
    rule = StepRule(block)
    limit = (rule.bound.states | rule.bound.outputs)[name]
    y, s = run_c(library(block, "f32").block(block.name), STREAM)
    assert rule.compare(STREAM, y, s).problems == []
    # The last step: no later one starts from what is changed.
    exact = {"y_rad": 0.7 * X[-1], "kept_rad": s["kept_rad"][-2].astype(float) + 0.3 * X[-1]}
    told = {k: v.astype(float) for k, v in (y if name == "y_rad" else s).items()}
    told[name][-1] = exact[name] + share * limit
    given = (told, s) if name == "y_rad" else (y, told)
    assert (rule.compare(STREAM, *given).problems == []) == passes


@pytest.mark.parametrize(("share", "passes"), SHARES)
@pytest.mark.parametrize("kind", ["noted", "summed"])
@pytest.mark.parametrize("name", ["y_rad", "kept_rad"])
def test_a_q31_value_beyond_its_bound_is_refused(elbow, kind, share, passes, name):
    block = made(kind)
    plan, found = plan_block(block), library(block, "q31")
    bound = any_bound(plan)
    before = compare_fixed(elbow, plan, found.block(kind), STREAM, bound)
    assert before.passed
    # A bound of which the error is that share.
    limit = before.errors[name] / share
    group = "outputs" if name == "y_rad" else "states"
    other = replace(bound, **{group: getattr(bound, group) | {name: limit}})
    result = compare_fixed(elbow, plan, found.block(kind), STREAM, other)
    assert before.errors[name] > 1e-11
    assert result.passed == passes


# -- memory that no output shows -------------------------------------------------------------------


def test_the_last_bit_of_a_memory_is_compared_with_casadis_own_c(elbow):
    block = made("noted")
    found = library(block, "f64", NOTED, r"state->kept_rad = 1.0000000000000002 * (\1);")
    oracle = CasadiOracle(found.system)
    result = compare(elbow, block, found, STREAM, {}, oracle)
    assert result.bit_identical is False
    assert result.problems == []
    assert compare(elbow, block, library(block, "f64"), STREAM, {}, oracle).bit_identical


def test_a_memory_that_a_restart_changes_is_seen(elbow):
    block = made("noted")
    hidden = r"static double runs; runs += 1e-15; state->kept_rad = (\1) + runs;"
    result = compare(elbow, block, library(block, "f64", NOTED, hidden), STREAM, {}, None)
    assert result.problems == ["kept_rad: stop and restore changes it"]


def test_a_single_bit_of_a_q31_memory_is_seen(elbow):
    block = made("noted")
    plan, bound = plan_block(block), any_bound(plan_block(block))
    found = library(block, "q31", r"(state->kept_\w+) = ([^;]+);", r"\1 = (\2) ^ 1;")
    result = compare_fixed(elbow, plan, found.block("noted"), STREAM, bound)
    assert any("state kept_rad at step 0" in p for p in result.problems)


# -- programs --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small():
    """A predictive controller of two intervals: device, program, stream, executor's run, C."""
    device = load_device("elbow_drive")
    program = predictive_controller(device, horizon=Horizon(2, 0.02, 1, 0.001))
    stream = next(s for s in program_streams(program, steps=8) if not s.injections)
    built = {real: render_program(program, real) for real in ("f64", "f32")}
    libraries = {real: HostLibrary(r.system, r) for real, r in built.items()}
    return device, program, stream, run_executor(program, stream), libraries


def copied(run):
    return tuple({k: np.array(v, float) for k, v in part.items()} for part in run)


@pytest.mark.parametrize(("share", "passes"), SHARES)
def test_a_programs_command_beyond_its_share_is_refused(small, share, passes):
    device, program, stream, _, libraries = small
    owed = copied(run_c(libraries["f32"].block(program.name), stream))
    # 0.1 % of full scale, which is the motor's largest torque.
    owed[0]["u_Nm"][3] += share * 1e-3 * 0.221
    result = compare_program(device, program, libraries["f32"], stream, owed)
    assert result.passed == passes
    assert result.status_differences == 0


def test_every_work_array_of_a_program_is_compared(small):
    device, program, stream, run, libraries = small
    assert compare_program(device, program, libraries["f64"], stream, run).passed
    assert {"plan", "dx", "qp_H"} <= set(run[1])
    for name in run[1]:
        owed = copied(run)
        last = owed[1][name].reshape(stream.steps, -1)
        last[-1, -1] = np.nextafter(last[-1, -1], 9.0)
        found = compare_program(device, program, libraries["f64"], stream, owed)
        assert found.bit_identical is False, name
        assert not found.passed


# -- decisions that rounding turns -----------------------------------------------------------------

EDGE = 0.3


def chooser() -> Block:
    """On which side of an edge 0.7 x + s lies; what follows from it is large."""

    def step(c, s, u, guard, label):
        value = s.kept_rad + 0.7 * u.x_rad
        kept = s.kept_rad + 0.0625 * u.x_rad
        return {"kept_rad": kept}, {"y_rad": ca.if_else(value < EDGE, 0.25, 0.75)}

    return made_up.made(step, (port("kept_rad", -20, 20),), name="chooser")


def turning() -> tuple[float, float, float]:
    """Input and memory whose side float32 and float64 see differently, and how far it is off."""
    single = np.float32
    for x in np.random.default_rng(2).uniform(-1, 1, 1000).astype(single):
        near = single(EDGE - 0.7 * float(x))
        for s in (near, np.nextafter(near, single(-9)), np.nextafter(near, single(9))):
            apart = float(s) + 0.7 * float(x) - EDGE
            if bool(single(s + single(single(0.7) * x)) < single(EDGE)) != (apart < 0):
                return float(x), float(s), abs(apart)
    raise AssertionError("no such numbers")


@pytest.mark.parametrize(("share", "passes"), SHARES)
def test_a_turned_decision_is_explained_by_its_own_error_alone(share, passes):
    block = chooser()
    rule = StepRule(block)
    x, memory, apart = turning()
    stream = Stream("edge", {"x_rad": np.array([0.0, x])}, {1: {"kept_rad": memory}})
    y, s = run_c(library(block, "f32").block("chooser"), stream)
    found = rule.compare(stream, y, s)
    assert (found.turned, found.problems) == (1, [])
    # Derived errors of which the distance from the edge is that share.
    used = [a for i in rule.decisions for a in rule.kernel.nodes[i].args]
    rule.errors = [0.5 * apart / share if i in used else 0.0 for i in range(len(rule.errors))]
    found = rule.compare(stream, y, s)
    assert found.turned == 1
    assert (found.problems == []) == passes


def beside_the_edge(plan, memory: FieldPlan, count: int = 600) -> tuple[np.ndarray, np.ndarray]:
    """Whole units x and z of which 0.7 x + z lies within a unit of x of the edge."""
    x_unit, z_unit = 2.0 ** -plan.fields["in"][0].fraction, 2.0**-memory.fraction
    z = np.round(np.random.default_rng(5).uniform(-0.3, 0.9, count) / z_unit) * z_unit
    x = np.round((EDGE - z) / 0.7 / x_unit) * x_unit
    assert np.max(np.abs(0.7 * x + z - EDGE)) < x_unit
    return x, z


@pytest.mark.parametrize(("share", "passes"), SHARES)
def test_a_turned_q31_decision_is_explained_by_its_error_alone(elbow, monkeypatch, share, passes):
    block = chooser()
    plan = plan_block(block)
    (memory,) = plan.fields["state"]
    x, z = beside_the_edge(plan, memory)
    stream = Stream("edge", {"x_rad": x}, {k: {"kept_rad": v} for k, v in enumerate(z)})
    runner, bound = library(block, "q31").block(block.name), any_bound(plan)
    found = compare_fixed(elbow, plan, runner, stream, bound)
    assert found.passed
    assert found.turned > 3
    _, states = run_c(runner, stream, raw=True)
    turned = single_steps(plan, stream, states_before(plan, stream, states)).turned
    # Derived errors of which the largest distance from the edge is that share.
    apart = np.max(np.abs(0.7 * x + z - EDGE)[turned])
    assert apart > 1e-12
    count = len(plan.step.kernel.nodes)
    monkeypatch.setattr(Propagation, "node_errors", lambda *_: [0.5 * apart / share] * count)
    found = compare_fixed(elbow, plan, runner, stream, bound)
    assert found.turned == turned.sum()
    assert found.passed == passes
    assert all("that rounding does not explain" in p for p in found.problems)


FLAGGED = Port("status", 0, 3, "word", flags=(
    Flag("INVALID", "an input", False), Flag("BEYOND", "too large", False, ("y_rad",), 2.0),
))  # fmt: skip


@pytest.mark.parametrize(("share", "passes"), SHARES)
@pytest.mark.parametrize("sign", [1, -1])
def test_a_flag_that_differs_is_explained_beside_its_threshold_alone(share, passes, sign):
    y = sign * np.array([1.0, 2.0 + 0.01 * share, 2.0 - 0.01 * share, 3.0])
    expected = {"status": np.array([0, 2, 0, 2]), "y_rad": y}
    got = {"status": np.array([0, 0, 2, 2])}
    assert unexplained(FLAGGED, expected, got, {"y_rad": 0.01}) == (0 if passes else 2)
    # A flag that compares nothing computed has no excuse; nor has one far from its threshold.
    assert unexplained(FLAGGED, expected, {"status": np.array([1, 2, 0, 2])}, {"y_rad": 9.0}) == 1
    assert unexplained(FLAGGED, expected, {"status": np.array([2, 2, 0, 0])}, {"y_rad": 0.01}) == 2


# -- the content hash ------------------------------------------------------------------------------


def hashed(device, digest=None, title=None) -> str:
    formats = [FORMATS["f32"]]
    return content_hash(device.system, digest or device.digest, title or device.title, formats)


def test_the_content_hash_sees_the_device_file_and_every_version(elbow, monkeypatch):
    before = hashed(elbow)
    assert hashed(elbow) == before
    # A device file may differ in what no C shows: a source, a person's limit.
    assert hashed(elbow, digest="0" * 64) != before
    known = render.versions()
    assert set(known) == {"esea-gen", "casadi", "jinja2"}
    seen = {before}
    for name in known:
        monkeypatch.setattr(render, "versions", lambda n=name: known | {n: "0.0.1"})
        seen.add(hashed(elbow))
    assert len(seen) == 4
