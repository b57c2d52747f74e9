"""Whole numbers and their bounds at the edges of each rule: small cases worked out by hand."""

from __future__ import annotations

import math

import casadi as ca
import pytest

from esea_gen.emit.fixed.plan import Planner
from esea_gen.emit.fixed.search import search
from esea_gen.language.block import Block, Solved
from esea_gen.language.ports import Flag, Port, flag_word

# -- the run that a residual is looked at over -----------------------------------------------------


def solved(residual, most: float = 2e-5) -> Block:
    """1.25 y = x, found by a way that leaves 13 bits; of the residual any part is told."""

    def step(c, s, u, g, label):
        y = label("y_rad", 1e5 * u.x_rad - 99999.2 * u.x_rad)
        off = label("residual", residual(u.x_rad, 1.25 * y - u.x_rad))
        return {}, {"y": y, "status": flag_word([ca.fabs(off) > most])}

    return Block.define(
        "solved",
        "Solved",
        period_s=0.001,
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=(
            Port("y", -1.0, 1.0, "solution"),
            Port("status", 0, 1, "word", flags=(Flag("OPEN", "not solved"),)),
        ),
        step=step,
        facts={"y_rad": (-0.8, 0.8)},
        solved={"y_rad": Solved("residual", most, 1.25, 0.0, {})},
    )


@pytest.mark.parametrize(
    ("at", "seen"),
    [
        # 48 steps of sin(0.4 k), which grow from 1e-3 of the port's end: 0.949 of 10^-1.167 at step
        # 44 is the largest, 0.0646, and 0.058 of 10^-2.667 at step 8 the smallest.
        (lambda x: x > 0.0635, True),
        (lambda x: x > 0.0655, False),
        (lambda x: x < 1.27e-4, True),
        (lambda x: x < 1.24e-4, False),
    ],
)
def test_a_residual_is_looked_at_from_small_inputs_to_a_fifteenth_of_the_range(at, seen):
    def only_there(x, off):
        return ca.if_else(at(ca.fabs(x)), off, 0.0)

    assert bool(search(Planner(solved(only_there))).wide) == seen


@pytest.mark.parametrize(("raw", "wide"), [(64, False), (65, True)])
def test_a_residual_may_fill_a_quarter_and_no_more(raw, wide):
    # The way leaves the residual in units of 2^-13 of which it may be 256; what is exact is 0.
    most = 256 * 2.0**-13

    def told(x, off):
        return ca.if_else(off == 0, 0.0, raw * 2.0**-13)

    plan = search(Planner(solved(told, most)))
    assert bool(plan.wide) == wide
    if wide:
        assert {f"{100 * raw / 256:.0f} %" in w for w in plan.why_wide.values()} == {True}
