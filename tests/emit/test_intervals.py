"""Intervals of computed values: they contain every value, and are tight."""

from __future__ import annotations

import math

import casadi as ca
import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.walker import walk
from esea_gen.verify.intervals import ANYTHING, Interval, computed_intervals

F32 = FORMATS["f32"]
X, Y, G = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("g")


def interval(expression, fmt=F32, **ends) -> Interval:
    """Of one expression of x, y and g with these ends."""
    free = [s for s in (X, Y, G) if s.name() in ends]
    kernel = walk(ca.Function("f", free, [expression]))
    given = [ends[s.name()] for s in free]
    given = [[g if isinstance(g, Interval) else Interval(*g)] for g in given]
    (out,) = kernel.results[0]
    return computed_intervals(kernel, fmt, given)[out]


def ends(found: Interval) -> tuple[float, float]:
    assert not found.nan
    return found.low, found.high


@pytest.mark.parametrize(
    ("expression", "low", "high"),
    [
        (X + Y, -2 + 3, 5 + 7),
        (X - Y, -2 - 7, 5 - 3),
        (X * Y, -14, 35),
        (X / Y, -2 / 3, 5 / 3),
        (-X, -5, 2),
        (ca.fabs(X), 0, 5),
        (ca.fabs(Y), 3, 7),
        (X**2, 0, 25),
        (Y**2, 9, 49),
        (2 * X, -4, 10),
        (1 / Y, 1 / 7, 1 / 3),
        (ca.fmin(X, Y), -2, 5),
        (ca.fmax(X, Y), 3, 7),
        (ca.sign(X), -1, 1),
        (ca.sign(Y), 1, 1),
        (ca.if_else(X > 0, Y, 0), 0, 7),
        (ca.if_else(X > 6, Y, -1), -1, -1),
        (ca.if_else(X < 6, Y, -1), 3, 7),
        (X < Y, 0, 1),
        (X < 6, 1, 1),
        (X < -2, 0, 0),
        (X <= -2.5, 0, 0),
        (X <= 5, 1, 1),
        (Y < 3, 0, 0),
        (Y <= 3, 0, 1),
        (ca.logic_and(X < 6, Y < 3), 0, 0),
        (ca.logic_and(X < 6, Y < 4), 0, 1),
        (ca.logic_or(X < 6, Y < 4), 1, 1),
        (ca.logic_or(X < -2, Y < 3), 0, 0),
        (ca.logic_not(Y < 3), 1, 1),
        (ca.logic_not(X < 6), 0, 0),
        (X == Y, 0, 1),
        (X == 6, 0, 0),
        (X != 6, 1, 1),
    ],
)
def test_ends_by_hand(expression, low, high):
    assert ends(interval(expression, x=(-2, 5), y=(3, 7))) == pytest.approx((low, high), rel=1e-6)


@pytest.mark.parametrize(
    ("f", "by"),
    [
        (ca.sqrt, math.sqrt),
        (ca.tanh, math.tanh),
        (ca.exp, math.exp),
        (ca.log, math.log),
        (lambda x: x**1.7, lambda x: x**1.7),
    ],
)
def test_rising_functions_have_a_hair_to_spare(f, by):
    low, high = ends(interval(f(Y), y=(0.5, 3.0)))
    exact = sorted((by(0.5), by(3.0)))
    room = [8 * 2.0**-24 * abs(e) for e in exact]
    assert low == pytest.approx(exact[0] - room[0], abs=0.5 * room[0])
    assert high == pytest.approx(exact[1] + room[1], abs=0.5 * room[1])
    assert low < exact[0] < exact[1] < high


def test_of_what_nothing_is_known_is_said_so():
    for expression in (ca.log(X), ca.sqrt(X), 1 / X, Y / X, X**1.7):
        assert interval(expression, x=(-2, 5), y=(3, 7)) == ANYTHING
    assert interval(ca.exp(X), x=(-2, 800)).high == math.inf
    assert interval(X + Y, x=(-2, math.inf), y=(-math.inf, 0)) == ANYTHING
    # NaN passes through sums, is let through by neither comparison, and makes a choice open.
    nan = Interval(1, 2, True)
    assert interval(X + Y, x=nan, y=(3, 7)).nan
    assert ends(interval(X < 3, x=nan)) == (0, 1)
    found = interval(ca.fmin(X, Y), x=nan, y=(3, 7))
    assert (found.low, found.high, found.nan) == (1, 7, True)
    assert ends(interval(ca.sign(X), x=nan)) == (0, 1)
    assert ends(interval(ca.sign(-X), x=nan)) == (-1, 0)


@pytest.mark.parametrize(
    ("gain", "kept"),
    [((0, 0.9), True), ((0, 1), False), ((-0.1, 0.9), False), ((0, 1 - 4 * 2.0**-23), False)],
)
def test_a_step_towards_a_value_goes_no_farther_than_it(gain, kept):
    # x + g (y - x): between x and y where g is from 0 to below 1; else as sums and products say.
    for expression in (X + G * (Y - X), G * (Y - X) + X, X + (Y - X) * G):
        found = ends(interval(expression, x=(-2, 5), y=(-3, 4), g=gain))
        if kept:
            assert found == (-3, 5)
        else:
            assert found[0] < -3 - 1
            assert found[1] > 5 + 1


def test_a_product_that_is_a_square_has_no_sign():
    assert ends(interval((3 * X) * X, x=(-2, 5)))[0] == 0
    assert ends(interval((G * X) * X, x=(-2, 5), g=(0, 2)))[0] == 0
    assert ends(interval((G * X) * X, x=(-2, 5), g=(-1, 2)))[0] < 0
    assert ends(interval((3 * X) * Y, x=(-2, 5), y=(3, 7)))[0] == -42
