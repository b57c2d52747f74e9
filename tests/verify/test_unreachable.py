"""Sides reported as unreachable, against random inputs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.walker import Kernel
from esea_gen.verify.coverage import SIDES
from esea_gen.verify.executor import evaluate
from esea_gen.verify.intervals import Interval, computed_intervals
from esea_gen.verify.unreachable import imply, why_impossible
from tests.kernel_trees import INPUTS, built, trees

F32 = FORMATS["f32"]
ENDS = {"x": (-2.0, 3.0), "y": (-1.0, 1.0), "z": (0.0, 4.0), "n": (0.0, 3.0)}


def sides_taken(op: str, args: list[np.ndarray], value: np.ndarray) -> list[np.ndarray]:
    """As the names of the sides say."""
    x, y = args[0], args[-1]
    p, q = x != 0, y != 0
    return {
        "fmin": lambda: [x < y, y < x],
        "fmax": lambda: [x > y, y > x],
        "fabs": lambda: [x < 0, x > 0],
        "sign": lambda: [x < 0, x > 0],
        "and": lambda: [p & q, ~p & q, p & ~q],
        "or": lambda: [~p & ~q, p & ~q, ~p & q],
        "if_else_zero": lambda: [p, ~p],
        "select": lambda: [p, ~p],
    }.get(op, lambda: [value != 0, value == 0])()


@pytest.mark.ci
@settings(max_examples=25)
@given(st.lists(st.one_of(trees(), trees(truth=True)), min_size=2, max_size=4))
def test_nothing_that_happens_was_called_impossible(made):
    nodes, places = built(*made)
    kernel = Kernel("k", tuple(nodes), tuple((p,) for p in places))
    rng = np.random.default_rng(2)
    columns = [rng.uniform(*ENDS[name], 80) for name in INPUTS]
    for k, name in enumerate(INPUTS):  # ends and equal ones among them
        columns[k][:40] = rng.choice([*ENDS[name], 0.0, 0.5, 1.0], 40)
    values = [v.astype(float) for v in evaluate(kernel, F32, [np.float32(columns).T])]
    intervals = computed_intervals(kernel, F32, [[Interval(*ENDS[n]) for n in INPUTS]])
    ranges = dict(enumerate(intervals))
    for i, node in enumerate(kernel.nodes):
        assert np.all((values[i] >= intervals[i].low) & (values[i] <= intervals[i].high))
        if node.op in SIDES:
            taken = sides_taken(node.op, [values[a] for a in node.args], values[i])
            for side, hit in zip(SIDES[node.op], taken, strict=True):
                if hit.any():
                    assert why_impossible(kernel, ranges, i, side) == ""
        if node.boolean:
            for truth in (True, False):
                rows = values[i] == truth
                for j, value in imply(kernel, i, truth).items():
                    assert np.all(values[j][rows] == np.float32(value)), (i, truth, j)
