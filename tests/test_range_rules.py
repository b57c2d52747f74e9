"""Ranges in floating point: what stays whole, what is computed, and what has no range at all."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.error_bounds import block_bound, step_bound, whole_nodes
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.ranges import RangeError, RangeValue, analyse
from esea_gen.emit.walker import Kernel, Node, fuse_selects, walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Port, clip

F32, U = FORMATS["f32"], 2.0**-24
TOP = 2.0**24  # all whole numbers up to here are float32 numbers
X, Y = ca.SX.sym("x"), ca.SX.sym("y")


def found(expression, *given: RangeValue, **more) -> RangeValue:
    kernel = fuse_selects(walk(ca.Function("f", [X, Y], [expression])))
    given = (*given, *[RangeValue(0, 1)] * (2 - len(given)))
    return analyse(kernel, F32, [[g] for g in given], **more).results[0][0]


def whole(low: float, high: float) -> RangeValue:
    return RangeValue(low, high, whole=True)


@pytest.mark.parametrize(
    ("expression", "x", "y", "stays"),
    [
        (2 * X, (0, TOP / 2), (0, 1), True),
        (2 * X, (0, TOP / 2 + 1), (0, 1), False),
        (2 * X, (-TOP / 2, 0), (0, 1), True),
        (2 * X, (-TOP / 2 - 1, 0), (0, 1), False),
        (X + Y, (0, TOP - 1), (0, 1), True),
        (X + Y, (0, TOP), (0, 1), False),
        (X - Y, (1 - TOP, 0), (0, 1), True),
        (X - Y, (-TOP, 0), (0, 1), False),
        (X * Y, (0, 4096), (-4096, 0), True),
        (X * Y, (0, 4096), (-4097, 0), False),
        (X * X, (-4096, 0), (0, 1), True),
        (X * X, (-4097, 0), (0, 1), False),
        (-X, (-9, 7), (0, 1), True),
        (ca.fabs(X), (-9, 7), (0, 1), True),
        (ca.sign(X), (-9, 7), (0, 1), True),
        (ca.fmin(X, Y), (-9, 7), (0, 1), True),
        (ca.fmax(X, Y), (-9, 7), (0, 1), True),
        (ca.if_else(X > 0, X, Y), (-9, 7), (0, 1), True),
        (ca.if_else(X > 0, Y, 0), (-9, 7), (0, 1), True),
        (ca.if_else(X > 0, Y, 0.5), (-9, 7), (0, 1), False),
        (X > Y, (-9, 7), (0, 1), True),
        (ca.logic_and(X > Y, Y > 0), (-9, 7), (0, 1), True),
        (ca.logic_not(X > Y), (-9, 7), (0, 1), True),
        (X / Y, (-9, 7), (1, 2), False),
        (X + 0.5, (-9, 7), (0, 1), False),
        (X + TOP, (-9, 0), (0, 1), True),
        (X - (TOP + 1), (0, 9), (0, 1), False),
    ],
)
def test_whole_numbers_of_whole_numbers(expression, x, y, stays):
    value = found(expression, whole(*x), whole(*y))
    assert value.whole is stays
    if stays:
        assert value.exact
    # Of numbers that need not be whole nothing is, but what counts yes and no.
    some = found(expression, RangeValue(*x), RangeValue(*y))
    truth = (value.low, value.high) in ((0.0, 1.0), (-1.0, 1.0)) and expression.op() in (
        ca.OP_LT, ca.OP_AND, ca.OP_NOT, ca.OP_SIGN, ca.OP_LE,
    )  # fmt: skip
    assert some.whole is truth


def test_what_is_computed_lies_near_the_exact_value_and_may_be_known_closer():
    x = RangeValue(1.0, 2.0, 0.5, 0.25)
    assert (x.magnitude, x.error) == (2.0, 1.0)
    assert (x.computed_low, x.computed_high) == (0.0, 3.0)
    held = RangeValue(1.0, 2.0, 0.5, 0.0, 0.875, 2.125)
    assert (held.computed_low, held.computed_high) == (0.875, 2.125)
    assert (RangeValue(-3.0, 2.0, 0.0, 0.5).magnitude, held.exact) == (3.0, False)
    turned = found(-X, held)
    assert (turned.low, turned.high) == (-2.0, -1.0)
    assert (turned.computed_low, turned.computed_high) == (-2.125, -0.875)
    other = RangeValue(1.5, 4.0, 0.25, 0.0, 1.375, 4.0)
    least, most = found(ca.fmin(X, Y), held, other), found(ca.fmax(X, Y), held, other)
    assert (least.computed_low, least.computed_high) == (0.875, 2.125)
    assert (most.computed_low, most.computed_high) == (1.375, 4.0)
    either = found(ca.if_else(X < Y, X, Y), held, other)
    assert (either.computed_low, either.computed_high) == (0.875, 4.0)
    # A number is stored as the nearest there is.
    tenth = found(ca.SX(0.1) + 0 * X, RangeValue(0, 1))
    stored = float(np.float32(0.1))
    assert (tenth.computed_low, tenth.computed_high, tenth.error) == (
        stored, stored, abs(stored - 0.1),
    )  # fmt: skip


def test_a_fact_cuts_the_range_and_leaves_the_error():
    kernel = walk(ca.Function("f", [X], [X * 3]))
    (node,) = kernel.results[0]
    for fact, ends in (((0.0, 1.0), (0.0, 1.0)), ((-9.0, 1.0), (-3.0, 1.0)), ((0.0, 9.0), (0, 3))):
        value = analyse(kernel, F32, [[RangeValue(-1, 1)]], facts={node: fact}).results[0][0]
        assert (value.low, value.high) == ends
        assert value.a + 3 * value.r == pytest.approx(3 * U, rel=1e-5)


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        (ca.exp(X), "has no finite range"),
        (X**9.5, "has no finite range"),
        (ca.fabs(X) ** -2.5, "a positive constant"),
        (X**Y, "an exponent that is not constant"),
        (ca.log(X), "log of a range that reaches zero"),
        (ca.sqrt(X - 1), "sqrt of a range that reaches zero"),
        (1 / X, r"division by a range that holds zero: \[0, 1e\+33\]"),
    ],
)
def test_what_has_no_range_is_refused(expression, words):
    with pytest.raises(RangeError, match=words):
        found(expression, RangeValue(0.0, 1e33), RangeValue(0.5, 1.0))
    rough = RangeValue(0.5, 1.0, 0.5)
    with pytest.raises(RangeError, match="whose error is as large as itself"):
        found(1 / X, rough)
    kernel = Kernel("f", (Node("input"), Node("atan", (0,))), ((1,),))
    with pytest.raises(RangeError, match="f: no range rule for 'atan'"):
        analyse(kernel, F32, [[rough]])


def test_an_exponential_beyond_all_numbers_is_refused_and_no_crash():
    block = Block.define(
        "steep",
        "Steep",
        period_s=0.001,
        state=(),
        inputs=(Port("x_rad", -999.0, 999.0, "in"),),
        outputs=(Port("y", -1.0, 1.0, "out"),),
        step=lambda c, s, u, g, label: ({}, {"y": clip(ca.exp(u.x_rad), -1, 1)}),
    )
    for bound in (block_bound, step_bound):
        with pytest.raises(RangeError, match=r"value v\d+ \(exp\) has no finite range"):
            bound(block, F32)
    assert whole_nodes(block, fuse_selects(walk(block.step)), F32) == frozenset()


@pytest.mark.parametrize("sign", [1, -1])
def test_shares_add_up_as_shares_only_where_nothing_cancels(sign):
    share = 2.0**-6

    def parts(x: tuple[float, float], y: tuple[float, float]) -> tuple[float, float]:
        turned = [sorted(sign * v for v in s) for s in (x, y)]
        value = found(X + Y, *(RangeValue(*s, 0.0, share) for s in turned))
        return value.a, value.r

    for x, y in (((0, 5), (0, 3)), ((1, 5), (2, 3))):
        assert parts(x, y) == (pytest.approx(0, abs=1e-40), pytest.approx(share, rel=1e-4))
    # A little beyond zero on one side is enough: then the largest of both count.
    for x, y in (((-0.5, 5), (0, 3)), ((0, 5), (-0.5, 3)), ((-1, 5), (-1, 3))):
        assert parts(x, y) == (pytest.approx(8 * share, rel=1e-4), pytest.approx(U))


@pytest.mark.parametrize(
    ("low", "high", "a", "ends", "error"),
    [
        (0.25, 0.75, 0.0, (1, 1), 0.0),
        (-0.75, -0.25, 0.0, (-1, -1), 0.0),
        (0.0, 0.5, 0.0, (0, 1), 0.0),
        (-0.5, 0.0, 0.0, (-1, 0), 0.0),
        (-0.5, 0.5, 0.0, (-1, 1), 0.0),
        (0.25, 0.75, 0.125, (1, 1), 0.0),  # which no rounding turns
        (0.25, 0.75, 0.375, (1, 1), 2.0),
        (-0.75, -0.25, 0.375, (-1, -1), 2.0),
    ],
)
def test_a_sign_is_wrong_by_two_where_rounding_may_turn_it(low, high, a, ends, error):
    value = found(ca.sign(X), RangeValue(low, high, a))
    assert ((value.low, value.high), value.error) == (ends, error)


def test_a_product_that_underflows_is_off_by_no_more_than_the_smallest_number():
    tiny, small = float(np.finfo(np.float32).smallest_subnormal), 2.0**-75
    for expression, exact in ((X * Y, small * small), (X * X, small * small), (X / 2, tiny / 2)):
        value = found(expression, RangeValue(0, max(small, tiny)), RangeValue(0, small))
        # Off by the whole result, of which the relative part is next to nothing.
        assert value.a + value.r * exact >= exact
        assert tiny / 2 <= value.a <= 1.01 * tiny
