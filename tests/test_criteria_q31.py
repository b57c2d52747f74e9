"""What excuses a q31 decision: the derived error of what it compares, and no more."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.emit.fixed.errors import Propagation, any_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.plan import FieldPlan
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, flag_word
from esea_gen.language.stream import Stream
from esea_gen.verify.fixed import compare_fixed, single_steps, states_before
from esea_gen.verify.runs import run_c

from .test_criteria import EDGE, SHARES, chooser, library


def beside_the_edge(plan, memory: FieldPlan, count: int = 600) -> tuple[np.ndarray, np.ndarray]:
    """Whole units x and z of which 0.7 x + z lies within a unit of x of the edge."""
    x_unit, z_unit = 2.0 ** -plan.fields["in"][0].fraction, 2.0**-memory.fraction
    rng = np.random.default_rng(5)
    z = np.round(rng.uniform(-0.3, 0.9, count) / z_unit) * z_unit
    x = np.round((EDGE - z) / 0.7 / x_unit) * x_unit
    assert np.max(np.abs(0.7 * x + z - EDGE)) < x_unit
    return x, z


@pytest.mark.parametrize(("share", "passes"), SHARES)
def test_a_turned_decision_is_explained_by_its_own_error_alone(elbow, monkeypatch, share, passes):
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


def flagged() -> Block:
    """A sum, and whether it is beyond an edge."""

    def step(c, s, u, guard, label):
        y = 0.7 * u.x_rad + u.z_rad
        return {}, {"y_rad": y, "status": flag_word([y > EDGE])}

    beyond = Flag("BEYOND", "the sum is beyond the edge", False, ("y_rad",), EDGE)
    return Block.define(
        "flagged",
        "made up",
        period_s=1e-3,
        state=(),
        inputs=(Port("x_rad", -1, 1, "one part"), Port("z_rad", -1, 1, "the other part")),
        outputs=(Port("y_rad", -2, 2, "sum"), Port("status", 0, 1, "word", flags=(beyond,))),
        step=step,
    )
