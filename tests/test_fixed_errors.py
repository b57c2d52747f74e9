"""One step's errors of a plan and their bound: boxes, coefficients, solved values, idle bounds."""

from __future__ import annotations

import itertools
import math

import casadi as ca
import pytest

from esea_gen.emit.error_bounds import BEYOND
from esea_gen.emit.fixed.errors import Propagation, any_bound, block_bound, step_bound
from esea_gen.emit.fixed.plan import BlockPlan, Planner
from esea_gen.emit.ranges import RangeError
from esea_gen.language.block import Block, Solved
from esea_gen.language.ports import Flag, Port, Tunable, clip, flag_word


def made(step, *, state=(), inputs=None, outputs=None, **more) -> Block:
    return Block.define(
        "made",
        "made up",
        period_s=0.001,
        state=state,
        inputs=inputs or (Port("x_rad", -1.0, 1.0, "input"),),
        outputs=outputs or (Port("y", -1.0, 1.0, "output"),),
        step=step,
        **more,
    )


def memory(name: str, low: float, high: float, size: int = 1) -> Port:
    return Port(name, low, high, "memory", size, repair="block")


# -- solved values ---------------------------------------------------------------------------------

MOST, SLOPE, JUMP = 1e-9, 1.25, 3e-9
FOLLOWS = {"m": 0.5, "y": 1.0, "off": 2.0, "z": 7.0, "w": 11.0}


def solved(follows=None, jump: float = JUMP) -> Block:
    """y with 1.25 y = x; of it a state, twice the residual, and two outputs."""

    def step(c, s, u, g, label):
        y = label("y_rad", 1e5 * u.x_rad - 99999.2 * u.x_rad)
        off = label("residual", SLOPE * y - u.x_rad)
        between = label("between", y + 1.0)
        out = {"y": y, "off": 2 * off, "z": 0.7 * between, "w": 0.3 * (s.m + y)}
        return {"m": 0.5 * y}, out | {"status": flag_word([ca.fabs(off) > MOST])}

    outputs = (
        Port("y", -1.0, 1.0, "solution"),
        Port("off", -4.0, 4.0, "twice the residual"),
        Port("z", -2.0, 2.0, "beside it"),
        Port("w", -2.0, 2.0, "with the memory"),
        Port("status", 0, 1, "word", flags=(Flag("OPEN", "not solved"),)),
    )
    return made(
        step,
        state=(memory("m", -1.0, 1.0),),
        outputs=outputs,
        facts={"y_rad": (-0.5, 0.8)},
        solved={"y_rad": Solved("residual", MOST, SLOPE, jump, follows or {})},
    )


def own(plan: BlockPlan, node: int) -> float:
    """What the lowering itself says that a node's operation errs by, constants included."""
    v, n = plan.step.values[node], plan.step.kernel.nodes[node]
    numbers = [plan.step.kernel.nodes[a].value for a in n.args]
    # The other operand's constant multiplies at most 0.8, the largest y; a share that of 0.8.
    stored = sum(0.8 * e for e in v.constants.values())
    return v.local + stored + v.relative * 0.8 * max(map(abs, [1.0, *numbers]))


def node_of(plan: BlockPlan, name: str) -> int:
    return next(i for i, (n, _) in plan.labels.items() if n == name)


@pytest.mark.parametrize("jump", [0.0, JUMP, 1e-6])
def test_a_solved_value_errs_by_its_residual_and_what_that_errs_by_over_the_slope(jump):
    plan = Planner(solved(jump=jump)).plan()
    residual = node_of(plan, "residual")
    (product, _x) = plan.step.kernel.nodes[residual].args
    # What the residual rounds by itself is beside what is allowed, 1e-9, of the same size.
    rounded = own(plan, product) + own(plan, residual)
    assert 1e-10 < rounded < 1e-8
    error = (MOST + rounded) / SLOPE + jump
    step = Propagation(plan, {}, {})
    result = step.once([[0.0]])
    (m,), (y,), (off,), (z,), (w,), _ = result.results
    assert y.error == pytest.approx(error, rel=0.02)
    assert m.error == pytest.approx(0.5 * y.error, abs=2.0**-31)
    assert off.error == pytest.approx(2 * (SLOPE * y.error + rounded), rel=0.05)
    assert z.error == pytest.approx(0.7 * y.error, abs=3 * 2.0**-30)
    assert w.error == pytest.approx(0.3 * y.error, abs=3 * 2.0**-30)
    # What the fact says that it is, and what follows by intervals.
    assert (y.low, y.high) == (-0.5, 0.8)
    assert (m.low, m.high) == pytest.approx((-0.25, 0.4))
    assert (z.low, z.high) == pytest.approx((0.35, 1.26))
    assert result.assumptions == ("made: |residual| of y_rad is at most 1e-09",)


def test_what_follows_by_a_slope_errs_by_it_and_by_its_own_rounding():
    plan = Planner(solved(FOLLOWS)).plan()
    nodes = plan.step.kernel.nodes
    step = Propagation(plan, {}, {})
    (m,), (y,), (off,), (z,), (w,), _ = step.once([[0.0]]).results
    assert m.error - 0.5 * y.error == pytest.approx(0, abs=2.0**-31)
    assert z.error - 7 * y.error == pytest.approx(0, abs=3 * 2.0**-30)
    assert w.error - 11 * y.error == pytest.approx(0, abs=3 * 2.0**-30)
    assert off.error == pytest.approx(2 * y.error, abs=3 * 2.0**-28)
    assert (m.low, m.high) == pytest.approx((-0.25, 0.4))
    assert (z.low, z.high) == pytest.approx((0.35, 1.26))
    # A memory that errs comes on top where it goes in, and nowhere else.
    late = step.once([[1e-6]]).results
    for before, after, more in zip((m, y, off, z, w), late[:5], (0, 0, 0, 0, 0.3e-6), strict=True):
        assert after[0].error - before.error == pytest.approx(more, rel=1e-3, abs=1e-18)
    # What stands between errs as if the value were exact, what is given as it is given.
    errors = step.node_errors([[1e-6]])
    assert len(errors) == len(nodes)
    between, value = node_of(plan, "between"), node_of(plan, "y_rad")
    assert errors[between] == pytest.approx(plan.step.values[between].local, rel=0.1, abs=1e-18)
    assert errors[value] == y.error
    ((kept,),) = (
        [errors[i] for i, n in enumerate(nodes) if n.op == "input" and n.source == (0, 0)],
    )
    assert kept == 1e-6
    # What leads to the value alone is not followed, all else is.
    assert not {i for i in step.followed if nodes[i].op == "sub" and i < value}
    assert {value, *(r for rs in plan.step.kernel.results[:5] for r in rs)} <= step.followed
    # Nor is the residual, of which a port is told by its slope: it errs by its own rounding.
    residual = node_of(plan, "residual")
    product = nodes[residual].args[0]
    assert errors[residual] == pytest.approx(own(plan, product) + own(plan, residual), rel=0.1)


def test_a_bound_of_a_solved_value_is_for_all_time():
    bound = block_bound(Planner(solved(FOLLOWS)).plan())
    assert (bound.steps, bound.method, bound.format) == (math.inf, "fixed point", "q31")
    assert bound.states["m"] == pytest.approx(0.5 * bound.outputs["y"], abs=2.0**-31)
    assert bound.outputs["w"] == pytest.approx(
        11 * bound.outputs["y"] + 0.3 * bound.states["m"], abs=3 * 2.0**-30
    )
    assert set(bound.outputs) == {"y", "off", "z", "w"}


# -- boxes -----------------------------------------------------------------------------------------


def cut(**split) -> Block:
    def step(c, s, u, g, label):
        area = label("area", u.x_rad * s.m[1])
        return {"m": [0.5 * s.m[0], 0.25 * u.x_rad]}, {"y": area}

    return made(
        step,
        state=(memory("m", -2.0, 3.0, 2),),
        outputs=(Port("y", -3.0, 3.0, "output"),),
        facts={"area": (-2.5, 1.5)},
        split=split,
    )


def test_a_fact_is_cut_like_a_range_and_meets_every_other_piece():
    plan = Planner(cut(s_m=(1.0,), area=(0.5,))).plan()
    step = Propagation(plan, {}, {})
    # Of -2 to 3 cut at 1, and at the mean of 1 and 3; of -2.5 to 1.5 at a half alone.
    mean = math.sqrt(3)
    ends = [-2, -mean, -1, 1, mean, 3]
    areas = [-2.5, -0.5, 0.5, 1.5]
    pairs = [(box["s_m"], box["area"], box["u_x_rad"]) for box in step.boxes]
    assert pairs == [
        ((pytest.approx(a), pytest.approx(b)), (c, d), (-1.0, 1.0))
        for a, b in itertools.pairwise(ends)
        for c, d in itertools.pairwise(areas)
    ]
    low, high = step.facts[node_of(plan, "area")]
    assert low.tolist() == [-2.5, -0.5, 0.5] * 5
    assert high.tolist() == [-0.5, 0.5, 1.5] * 5
    assert step.count == 15
    (y,) = step.once([[0.0, 0.0]]).results[1]
    assert (y.low, y.high) == (-2.5, 1.5)
    # Without a cut one box, with the fact as it is.
    whole = Propagation(Planner(cut()).plan(), {}, {})
    ((low, high),) = whole.facts.values()
    assert (low.tolist(), high.tolist(), whole.count) == ([-2.5], [1.5], 1)


def test_ranges_with_room_reach_beyond_by_a_share_of_their_width():
    plan = Planner(cut()).plan()
    for room in (0.0, BEYOND, 0.25):
        (box,) = Propagation(plan, {"s_m": (-1.0, 3.0)}, {}, room).boxes
        assert box["s_m"] == (-1 - 4 * room, 3 + 4 * room)
        assert box["u_x_rad"] == (-1 - 2 * room, 1 + 2 * room)
    step = Propagation(plan, {"s_m": (-1.0, 3.0)}, {}, 0.25)
    assert step.limits["s_m"] == (-1.0, 3.0)
    # An error is no larger than the range itself, element by element.
    assert step.zero == [[0.0, 0.0]]
    (errors,) = step.state_errors(step.once([[2.0, 99.0]]))
    assert errors[0] == pytest.approx(1.0, rel=1e-6)
    assert errors[1] < 1e-9
    (errors,) = step.state_errors(step.once([[99.0, 2.0]]))
    assert errors[0] == 4.0


def test_errors_go_to_their_own_element_and_the_worst_box_counts():
    plan = Planner(cut(s_m=(1.0,), u_x_rad=(0.25,))).plan()
    step = Propagation(plan, {}, {})
    first, second = step.once([[0.5, 0.0]]), step.once([[0.0, 0.5]])
    assert [r.error for r in first.results[0]] == pytest.approx([0.25, 0], abs=1e-8)
    assert [r.error for r in second.results[0]] == pytest.approx([0, 0], abs=1e-8)
    # 0.5 times the largest input.
    assert first.results[1][0].error < 1e-8
    assert second.results[1][0].error == pytest.approx(0.5, abs=1e-8)
    assert [(r.low, r.high) for r in first.results[0]] == [
        (pytest.approx(-1), pytest.approx(1.5)),
        (pytest.approx(-0.25), pytest.approx(0.25)),
    ]
    assert step.outputs(second) == {"y": second.results[1][0].error}
    # An input's error: of the area at m = 3, and of what is remembered.
    rough = Propagation(plan, {}, {"x_rad": 1e-3}).once([[0.0, 0.0]])
    assert rough.results[0][1].error == pytest.approx(0.25e-3, rel=1e-4)
    assert rough.results[1][0].error == pytest.approx(3e-3, rel=1e-4)


def test_elements_of_a_vector_are_all_there_and_pass_as_they_are():
    def step(c, s, u, g, label):
        return {"m": [s.m[1], s.m[0]]}, {"y": u.x_rad[2] * 0.5}

    inputs = (Port("x_rad", -1.0, 1.0, "input", 3),)
    plan = Planner(made(step, state=(memory("m", -0.5, 0.25, 2),), inputs=inputs)).plan()
    step_ = Propagation(plan, {}, {"x_rad": 1e-3})
    first, second = step_.once([[1e-3, 2e-3]]).results[0]
    assert [(v.low, v.high, v.error) for v in (first, second)] == [
        (-0.5, 0.25, 2e-3),
        (-0.5, 0.25, 1e-3),
    ]
    assert step_.once([[0.0, 0.0]]).results[1][0].error == pytest.approx(5e-4, rel=1e-4)


# -- coefficients ----------------------------------------------------------------------------------


def test_every_coefficient_errs_by_what_its_own_raw_number_leaves():
    values = {"a": 0.3, "b": -0.7, "zero": 0.0, "d": 41.3}

    def step(c, s, u, g, label):
        return {}, {"y": (c.a + c.b + c.zero) * u.x_rad + c.d / 64}

    ends = {"a": (0.25, 0.5), "b": (-1.0, -0.5), "zero": (-0.5, 0.5), "d": (32.0, 64.0)}
    block = made(
        step,
        tunables=tuple(Tunable(n, v, *ends[n], "tunes") for n, v in values.items()),
        coefficients=tuple(Port(n, *ends[n], "tuned") for n in values),
        prepare=lambda t: {n: 1 * getattr(t, n) for n in values},
    )
    plan = Planner(block).plan()
    step_ = Propagation(plan, {}, {})
    for (span,), (name, value), field in zip(
        step_.coefficients, values.items(), plan.fields["coeffs"], strict=True
    ):
        scale = 2.0**field.fraction
        off = abs(round(value * scale) / scale - value)
        assert (span.low[0], span.high[0]) == (value, value)
        # As a share of what is not zero.
        assert span.a[0] == (off if value == 0 else 0.0)
        assert span.r[0] == pytest.approx(off / abs(value) if value else 0.0, rel=1e-6, abs=0)
        assert off > 0 or value == 0, name


# -- bounds ----------------------------------------------------------------------------------------


def coarse(most: float, linear: bool) -> Block:
    """m' = m / 2 + half of something that is steep, and cut: of 11 bits, or hardly of 10."""

    def step(c, s, u, g, label):
        x = u.x_rad if linear else u.x_rad * ca.fabs(u.x_rad)
        flat = clip(1e6 * x, -1, 1)
        return {"calm": 0.25 * u.x_rad, "m": 0.5 * s.m + 0.5 * flat}, {"y": s.m}

    return made(step, state=(memory("calm", -1.0, 1.0), memory("m", -most, 2 * most)))


def test_a_bound_of_more_than_a_quarter_of_a_states_range_is_none():
    error = block_bound(Planner(coarse(0.01, False)).plan()).states["m"]
    # The gain errs by 2^-11; the product before it by half of 2^-30, a million times.
    assert error == pytest.approx(2.0**-11 + 1e6 * 2.0**-31, rel=0.05)
    edge = 4 * error / 3
    fits = block_bound(Planner(coarse(1.002 * edge, False)).plan())
    assert (fits.method, fits.states["m"]) == ("fixed point", pytest.approx(error, rel=1e-3))
    with pytest.raises(RangeError, match="made: not stable, rounding errors may grow"):
        block_bound(Planner(coarse(0.998 * edge, False)).plan())
    # A linear one is summed by its matrix then.
    error = block_bound(Planner(coarse(0.01, True)).plan()).states["m"]
    edge = 4 * error / 3
    assert block_bound(Planner(coarse(1.002 * edge, True)).plan()).method == "fixed point"
    summed = block_bound(Planner(coarse(0.998 * edge, True)).plan())
    assert (summed.method, summed.steps) == ("linear", math.inf)
    assert summed.assumptions == (
        "made: no clip of a state acts",
        "made: no invalid input is bridged",
    )
    assert summed.outputs["y"] == pytest.approx(summed.states["m"], rel=1e-3)


def integral(most: float) -> Block:
    def step(c, s, u, g, label):
        return {"m": clip(s.m * (1 + 0.125 * u.x_rad), -most, most)}, {"y": 0.3 * s.m}

    return made(step, state=(memory("m", -most, most),))


def test_what_does_not_forget_has_the_bound_of_a_step():
    plan = Planner(integral(0.5)).plan()
    with pytest.raises(RangeError, match="not stable"):
        block_bound(plan)
    one, found = step_bound(plan), any_bound(plan)
    assert found == one
    assert (one.format, one.steps, one.method) == ("q31", 1, "one step")
    # Of one step the product's rounding; no more than the range where that is narrower.
    assert 0 < one.states["m"] < 2.0**-28
    assert one.outputs["y"] < 2.0**-29
    narrow = step_bound(plan, {"s_m": (0.0, 0.0)})
    assert narrow.states["m"] == 0.0
    # What is kept of other plans is kept by its room.
    planner = Planner(integral(0.5))
    assert any_bound(planner.plan(), planner.known) == found
    assert any_bound(planner.plan(), planner.known) == found
    kept = planner.known
    assert min(kept[BEYOND].ends["s_m"][0]) == pytest.approx(-0.5 - BEYOND, rel=1e-12)
    assert min(kept[0.0].ends["s_m"][0]) == -0.5
