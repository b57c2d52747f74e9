"""Plan search: 64-bit values of small Blocks, derived by hand."""

from __future__ import annotations

import casadi as ca
import pytest

from esea_gen.emit.fixed.errors import any_bound
from esea_gen.emit.fixed.plan import BlockPlan, Planner
from esea_gen.emit.fixed.search import search
from esea_gen.language.block import Block
from esea_gen.language.ports import Port, clip
from tests import made_up
from tests.made_up import port

AIMED = 5e-5  # of the larger end of an output's range


def made(
    step, *, state=(), most: float = 1.0, finer: float = 1.0, inputs: int = 1, **more
) -> Block:
    ports = tuple(port(n, -1.0, 1.0) for n in ("x_rad", "z_rad")[:inputs])
    return made_up.made(step, state, ports, (port("y", -most, most, finer=finer),), **more)


def before_a_clip(gain: float):
    return lambda c, s, u, g, label: ({}, {"y": clip(label("steep", gain * u.x_rad), -1, 1)})


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


# -- memory ----------------------------------------------------------------------------------------


def memory(step, most: float = 1.0, **more) -> Block:
    return made(step, state=(Port("m", -most, most, "memory", repair="block"),), most=most, **more)


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
        wide = dict.fromkeys(chosen, "")
        made, fresh = one.plan(wide), Planner(block).plan(wide)
        assert made.step.steps == fresh.step.steps
        assert made.step.results == fresh.step.results
        assert made.step.values == fresh.step.values
        assert any_bound(made, one.known) == any_bound(fresh)
