"""What the search for a plan holds in 64 bits: small Blocks whose need is worked out by hand."""

from __future__ import annotations

import math

import casadi as ca
import pytest

from esea_gen.emit.fixed.errors import Propagation, any_bound, block_bound, step_bound
from esea_gen.emit.fixed.plan import BlockPlan, Planner
from esea_gen.emit.fixed.search import AIM, SIGNIFICANT_BITS, coarse_values, search
from esea_gen.emit.step_errors import BEYOND
from esea_gen.language.block import Block, Solved
from esea_gen.language.ports import Flag, Port, Tunable, clip, flag_word

AIMED = 5e-5  # of the larger end of an output's range


def made(
    step, *, state=(), most: float = 1.0, finer: float = 1.0, inputs: int = 1, **more
) -> Block:
    names = ("x_rad", "z_rad")[:inputs]
    return Block.define(
        "made",
        "made up",
        period_s=0.001,
        state=state,
        inputs=tuple(Port(n, -1.0, 1.0, "input") for n in names),
        outputs=(Port("y", -most, most, "output", finer=finer),),
        step=step,
        **more,
    )


def before_a_clip(gain: float):
    return lambda c, s, u, g, label: ({}, {"y": clip(label("steep", gain * u.x_rad), -1, 1)})


def near_zero(c, s, u, g, label):
    return {}, {"y": clip(1e-5 / label("close", u.x_rad + 1.00001), -1, 1)}


def root(c, s, u, g, label):
    return {}, {"y": clip(ca.fabs(label("product", u.x_rad * u.z_rad)) ** 0.3, -1, 1)}


def told(plan: BlockPlan) -> dict[str, str]:
    """Why a node is wide, by its operation and place."""
    nodes = plan.step.kernel.nodes
    return {f"{nodes[i].op}{i}": why for i, why in plan.why_wide.items()}


def score(plan: BlockPlan) -> float:
    (error,) = any_bound(plan).outputs.values()
    (port,) = plan.block.outputs
    return error * port.finer / (AIMED * port.high)


def test_what_is_aimed_at():
    assert (AIM, SIGNIFICANT_BITS) == (AIMED, 28)


def test_within_the_aim_nothing_is_wide():
    # A gain of 300 leaves 22 bits behind the point: 1.2e-7 of 5e-5.
    plan = search(Planner(made(before_a_clip(300.0))))
    assert plan.wide == frozenset()
    assert score(plan) < 0.1


def test_what_a_clip_cuts_off_is_held_in_64_bits():
    # Any bits of x are -2 to 2: a million leaves 10 bits of the 30 that the clip has.
    planner = Planner(made(before_a_clip(1e6)))
    assert score(planner.plan()) == pytest.approx(2.0**-11 / AIMED, rel=0.05)
    plan = search(planner)
    lost = {op.rstrip("0123456789"): why for op, why in told(plan).items()}
    said = "its range before the clip takes {} bits that the clip gives back"
    # 1 has 30 bits behind the point, -1 has 31.
    assert lost == {k: said.format(n) for k, n in (("mul", 20), ("if_else_zero", 20), ("fmin", 21))}
    assert score(plan) <= 1


def test_a_finer_wish_is_kept():
    # The same gain of 300, wanted a thousand times finer than the aim.
    plan = search(Planner(made(before_a_clip(300.0), finer=1000.0)))
    assert plan.wide
    assert score(plan) <= 1
    # And of an output that may be ten times as large the aim is ten times as wide.
    wide = Planner(made(before_a_clip(1e6), most=10.0))
    assert score(wide.plan()) == pytest.approx(2.0**-11 / (10 * AIMED), rel=0.05)
    assert search(wide).wide == frozenset()


def test_what_is_small_beside_its_range_keeps_its_significant_bits():
    # From 1e-5 to 2: 29 bits behind the point leave 5369 units at the small end, 13 bits.
    planner = Planner(made(near_zero))
    assert score(planner.plan()) > 1
    plan = search(planner)
    assert "would keep 13 significant bits of 31 where it is smallest" in told(plan).values()
    assert score(plan) <= 1


def test_what_leads_to_a_root_is_as_fine_as_can_be():
    # An error e at zero becomes e^0.3: half a unit of 2^-30 is 1.6e-3.
    planner = Planner(made(root, inputs=2))
    assert score(planner.plan()) > (2.0**-33) ** 0.3 / AIMED
    plan = search(planner)
    reasons = set(told(plan).values())
    assert reasons <= {
        "is a root, steep near zero",
        "leads to a root, which magnifies its rounding near zero",
    }
    assert "leads to a root, which magnifies its rounding near zero" in reasons
    assert score(plan) < score(planner.plan()) / 50


@pytest.mark.parametrize(
    "block",
    [made(before_a_clip(1e6)), made(before_a_clip(300.0), finer=1000.0), made(near_zero)],
    ids=["clip", "finer", "small"],
)
def test_nothing_is_wide_that_need_not_be(block):
    planner = Planner(block)
    plan = search(planner)
    ceiling = max(1.0, 1.02 * score(plan))
    for i in plan.wide:
        fewer = {k: w for k, w in plan.why_wide.items() if k != i}
        assert score(planner.plan(fewer, fewer)) > ceiling


def test_what_is_coarser_than_its_port_and_by_how_much():
    # 300 x in 22 bits leads to y of 30 by a sum and a choice.
    def step(c, s, u, g, label):
        large = label("large", 300 * u.x_rad)
        return {}, {"y": label("sum", large - 299.5 * u.x_rad)}

    plan = Planner(made(step)).plan()
    found = coarse_values(plan)
    values, nodes = plan.step.values, plan.step.kernel.nodes
    for i, why in found.items():
        lost = 30 - values[i].fraction
        assert lost > 0
        assert why == f"{lost} bits coarser than the port that it leads to"
    (out,) = plan.step.kernel.results[0]
    assert out in found
    muls = [i for i, n in enumerate(nodes) if n.op == "mul"]
    assert muls
    assert set(muls) <= set(found)
    # What is as fine as its port, what was read, and conditions are not among them.
    assert not any(nodes[i].op in ("input", "const", "le", "and") for i in found)
    fine = Planner(made(lambda c, s, u, g, label: ({}, {"y": 0.3 * u.x_rad}))).plan()
    assert coarse_values(fine) == {}


# -- memory ----------------------------------------------------------------------------------------


def leak(pole: float, gain: float = 1.0):
    def step(c, s, u, g, label):
        new = pole * s.m + (1 - pole) * gain * u.x_rad
        return {"m": new}, {"y": new}

    return step


def memory(step, most: float = 1.0, **more) -> Block:
    return made(step, state=(Port("m", -most, most, "memory", repair="block"),), most=most, **more)


@pytest.mark.parametrize("pole", [0.5, 0.9, 0.99])
def test_a_memorys_bound_is_the_series_of_its_roundings(pole):
    plan = Planner(memory(leak(pole))).plan()
    bound = block_bound(plan)
    one = step_bound(plan)
    assert (bound.steps, bound.method, one.steps, one.method) == (
        math.inf, "fixed point", 1, "one step",
    )  # fmt: skip
    # Products and sum round to 2^-30 or 2^-29 each; both constants are off by 2^-32 at most.
    assert 2.0**-31 <= one.states["m"] <= 4 * 2.0**-30
    series = one.states["m"] / (1 - pole)
    assert 0.5 * series <= bound.states["m"] <= 1.2 * series
    assert bound.outputs["y"] == pytest.approx(bound.states["m"], rel=0.2)


def test_what_does_not_forget_has_the_bound_of_a_step():
    def step(c, s, u, g, label):
        new = clip(s.m + 0.3 * u.x_rad, -1, 1)
        return {"m": new}, {"y": new}

    plan = search(Planner(memory(step)))
    found = any_bound(plan)
    assert (found.steps, found.method) == (1, "one step")
    assert found.outputs["y"] < AIMED


@pytest.mark.parametrize("pole", [0.5, 0.9])
def test_a_memory_of_something_steep_is_wide_where_that_is(pole):
    def step(c, s, u, g, label):
        flat = clip(label("steep", 1e6 * u.x_rad), -1, 1)
        new = pole * s.m + (1 - pole) * flat
        return {"m": new}, {"y": new}

    planner = Planner(memory(step))
    first = block_bound(planner.plan())
    # An error of 2^-11 at every step, times 1 - pole, over 1 - pole.
    assert first.outputs["y"] == pytest.approx(2.0**-11, rel=0.1)
    plan = search(planner)
    assert any_bound(plan).outputs["y"] <= AIMED
    assert {plan.step.kernel.nodes[i].op for i in plan.wide} == {"mul", "if_else_zero", "fmin"}
    for i in plan.wide:
        fewer = {k: w for k, w in plan.why_wide.items() if k != i}
        assert score(planner.plan(fewer, fewer)) > 1.02


@pytest.mark.ci
def test_a_linear_block_is_narrowed_with_its_memory_summed():
    def step(c, s, u, g, label):
        # A rotation by a tenth of a turn: intervals alone never see that it forgets.
        co, si = 0.999 * math.cos(0.6), 0.999 * math.sin(0.6)
        a = label("a", co * s.m[0] - si * s.m[1] + 1e-4 * u.x_rad)
        b = label("b", si * s.m[0] + co * s.m[1])
        return {"m": [a, b]}, {"y": a}

    state = (Port("m", -1.0, 1.0, "memory", 2, repair="block"),)
    planner = Planner(made(step, state=state, finer=40.0))
    first = any_bound(planner.plan())
    assert first.method == "linear"
    plan = search(planner)
    found = any_bound(plan)
    assert found.method == "linear"
    assert found.outputs["y"] <= first.outputs["y"]
    if first.outputs["y"] * 40 > AIMED:
        assert found.outputs["y"] < first.outputs["y"]
    ceiling = max(1.0, 1.02 * score(plan))
    for i in plan.wide:
        fewer = {k: w for k, w in plan.why_wide.items() if k != i}
        assert score(planner.plan(fewer, fewer)) > ceiling


def mixed(c, s, u, g, label):
    steep = label("steep", 1e4 * u.x_rad + s.m)
    curved = ca.fabs(label("product", u.x_rad * s.m)) ** 0.3
    new = clip(ca.if_else(steep > 0.25, 0.5 * s.m + 0.3 * curved, 0.2 * s.m), -1, 1)
    return {"m": new}, {"y": clip(steep, -1, 1) * 0.5 + 0.25 * new}


@pytest.mark.ci
def test_plans_and_bounds_of_one_planner_are_those_of_a_fresh_one():
    # What is kept from plan to plan, and from bound to bound, changes nothing.
    block = memory(mixed)
    one = Planner(block)
    nodes = [
        i for i, n in enumerate(one.kernel.nodes)
        if n.op not in ("input", "const") and not n.boolean
    ]  # fmt: skip
    for chosen in (nodes, nodes[::2], nodes[::3], [], nodes[1::2], nodes[::2]):
        made, fresh = one.plan(chosen), Planner(block).plan(chosen)
        assert made.step.steps == fresh.step.steps
        assert made.step.results == fresh.step.results
        assert made.step.values == fresh.step.values
        assert any_bound(made, one.known) == any_bound(fresh)


# -- boxes -----------------------------------------------------------------------------------------


def square(c, s, u, g, label):
    return {}, {"y": label("area", u.x_rad * u.x_rad) - 0.5}


def test_ranges_are_cut_at_their_cuts_and_between():
    block = made(square, split={"u_x_rad": (0.04, 0.25)})
    found = Propagation(Planner(block).plan(), {}, {})
    edges = sorted({e for box in found.boxes for e in box["u_x_rad"]})
    # Between 0.04, 0.25 and the end at 1: 0.1 and 0.5.
    assert edges == pytest.approx([-1, -0.5, -0.25, -0.1, -0.04, 0.04, 0.1, 0.25, 0.5, 1])
    assert (found.count, len(found.boxes)) == (9, 9)
    near = Propagation(Planner(block).plan(), {"u_x_rad": (0.2, 0.6)}, {})
    edges = sorted({e for box in near.boxes for e in box["u_x_rad"]})
    assert edges == pytest.approx([0.2, 0.25, math.sqrt(0.25 * 0.6), 0.6])
    wide = Propagation(Planner(block).plan(), {}, {}, BEYOND)
    edges = [e for box in wide.boxes for e in box["u_x_rad"]]
    assert (min(edges), max(edges)) == pytest.approx((-1 - 2e-6, 1 + 2e-6), rel=1e-9)


def test_an_inputs_error_goes_through():
    plan = Planner(made(square)).plan()
    exact = block_bound(plan).outputs["y"]
    rough = block_bound(plan, input_errors={"x_rad": 1e-3}).outputs["y"]
    # (x + e)^2 - x^2 is 2 e + e^2 at x = 1.
    assert rough - exact == pytest.approx(2e-3 + 1e-6, rel=1e-3)
    # The square rounds to 2^-30 at most, the difference not or once more.
    assert 2.0**-32 <= exact <= 3 * 2.0**-30
    small = block_bound(plan, {"u_x_rad": (-0.1, 0.1)}, {"x_rad": 1e-3}).outputs["y"]
    assert small == pytest.approx(2e-4 + 1e-6, rel=1e-2)


@pytest.mark.parametrize("gain", [0.75, 0.3])
def test_a_coefficient_errs_by_what_its_raw_number_leaves(gain):
    block = made(
        lambda c, s, u, g, label: ({}, {"y": c.gain * u.x_rad}),
        tunables=(Tunable("gain", gain, 0.25, 1.0, "gain"),),
        coefficients=(Port("gain", 0.25, 1.0, "gain"),),
        prepare=lambda t: {"gain": 1 * t.gain},
    )
    step_ = Propagation(Planner(block).plan(), {}, {})
    ((span,),) = step_.coefficients
    off = abs(round(gain * 2**30) / 2**30 - gain)
    assert (float(span.low[0]), float(span.high[0])) == (gain, gain)
    assert float(span.error[0]) == pytest.approx(off, rel=1e-9, abs=1e-18)
    # At x = 1 all of that, and half a unit of the product.
    assert block_bound(step_.plan).outputs["y"] == pytest.approx(off + 2.0**-31, rel=0.3)


def test_an_input_that_errs_has_passed_its_check_all_the_same():
    # Else what stands for an invalid one, 0, would be among what is possible.
    plan = Planner(made(lambda c, s, u, g, label: ({}, {"y": 0.5 * u.x_rad}))).plan()
    (y,) = Propagation(plan, {"u_x_rad": (0.5, 1.0)}, {"x_rad": 1e-3}).once([]).results[0]
    assert (y.low, y.high) == (0.25, 0.5)
    assert y.error == pytest.approx(5e-4, rel=1e-3)


def test_what_results_can_be_and_err_by():
    def step(c, s, u, g, label):
        return {"m": 0.25 * s.m}, {"y": 0.5 * u.x_rad}

    step_ = Propagation(Planner(memory(step)).plan(), {}, {})
    assert step_.zero == [[0.0]]
    result = step_.once([[0.5]])
    # A quarter of an error of a half; of a shift of the point no more.
    (state,), (out,) = result.results
    assert (state.low, state.high) == pytest.approx((-0.25, 0.25))
    assert state.error == pytest.approx(0.125, rel=1e-6)
    assert (out.low, out.high) == pytest.approx((-0.5, 0.5))
    assert step_.state_errors(result) == [[state.error]]
    assert step_.outputs(result) == {"y": out.error}
    # No more than the range itself: both values lie in it.
    assert step_.state_errors(step_.once([[99.0]])) == [[2.0]]
    nodes = step_.plan.step.kernel.nodes
    assert step_.followed == frozenset(range(len(nodes)))
    errors = step_.node_errors([[0.5]])
    assert len(errors) == len(nodes)
    assert max(errors) == pytest.approx(0.5)


# -- solved values ---------------------------------------------------------------------------------


def solved(most: float, jump: float = 0.0, follows: float = 0.0) -> Block:
    """y with 1.25 y = x, found by a coarse way; z is 3 y."""

    def step(c, s, u, g, label):
        y = label("y_rad", 1e5 * u.x_rad - 99999.2 * u.x_rad)
        off = label("residual", 1.25 * y - u.x_rad)
        return {}, {"y": y, "z": 3 * y, "status": flag_word([ca.fabs(off) > most])}

    followed = {"y": 1.0, "z": follows} if follows else {}
    return Block.define(
        "solved",
        "Solved",
        period_s=0.001,
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=(
            Port("y", -1.0, 1.0, "solution"),
            Port("z", -4.0, 4.0, "three of it"),
            Port("status", 0, 1, "word", flags=(Flag("OPEN", "not solved"),)),
        ),
        step=step,
        facts={"y_rad": (-0.8, 0.8)},
        solved={"y_rad": Solved("residual", most, 1.25, jump, followed)},
    )


@pytest.mark.parametrize(("most", "jump"), [(1e-2, 0.0), (1e-3, 0.0), (1e-3, 0.02)])
def test_a_residual_bounds_a_solved_value_however_it_was_found(most, jump):
    bound = block_bound(Planner(solved(most, jump)).plan())
    error = most / 1.25 + jump
    # The residual is only compared, so that it is kept exact; products round.
    assert bound.outputs["y"] == pytest.approx(error, rel=1e-9)
    assert 3 * error < bound.outputs["z"] < 3 * error + 40 * 2.0**-28
    assert f"solved: |residual| of y_rad is at most {most:g}" in bound.assumptions


def test_what_follows_a_solved_value_errs_by_its_stated_slope():
    # Stated as 7 where intervals would find 3: the statement counts.
    plan = Planner(solved(1e-3, follows=7.0)).plan()
    bound = block_bound(plan)
    (z,) = Propagation(plan, {}, {}).once([]).results[1]
    assert (z.low, z.high) == pytest.approx((-2.4, 2.4))  # of 0.8 to either side
    assert bound.outputs["z"] == pytest.approx(7 * 1e-3 / 1.25, rel=1e-3)
    assert bound.outputs["y"] == pytest.approx(1e-3 / 1.25, rel=1e-3)


def test_the_way_to_a_solved_value_is_wide_where_its_residual_would_be_large():
    # Of 2e5 (any bits of x) 13 are left behind the point: two products and their difference of
    # 2^-14 each, times 1.25, beside what is allowed.
    narrow = search(Planner(solved(1e-2)))
    assert narrow.wide == frozenset()
    planner = Planner(solved(2e-4))
    plan = search(planner)
    nodes = plan.step.kernel.nodes
    step = Propagation(plan, {}, {})
    way = {i for i in range(len(nodes)) if i not in step.followed}
    assert {nodes[i].op for i in plan.wide} >= {"mul", "sub"}
    assert plan.wide == {i for i in way if nodes[i].op not in ("input", "const", "sign")
                         and not nodes[i].boolean}  # fmt: skip
    (why,) = set(plan.why_wide.values())
    share = int(why.removeprefix("leads to a solved value whose residual would fill ")[:-2])
    assert why.endswith(f" {share} %")
    # The worst on the way: at most three halves of 2^-13 times 1.25, and a quarter at least.
    most = 100 * 1.25 * 3 * 2.0**-14 / 2e-4
    assert 25 < share <= most
