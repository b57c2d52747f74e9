"""The error analysis, operation by operation: its bounds hold, and they are not idle."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, settings
from hypothesis import given as drawn
from hypothesis import strategies as st

from esea_gen.emit.error_bounds import FloatRounding
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.spans import RangeError, Rounding, Span, propagate, span
from esea_gen.emit.walker import walk

F32, F64 = FORMATS["f32"], FORMATS["f64"]
X, Y = ca.SX.sym("x"), ca.SX.sym("y")
U = 2.0**-24


class Exact(Rounding):
    """Operations that round nothing: what is left is what the operands' errors make."""

    exponent_off = 0.0

    def constant(self, value, boxes):
        return span(value, value, 0.0, boxes)

    def exponent_error(self, exponent):
        return self.exponent_off

    def finished(self, i, operands, x):
        return x


def given(low: float, high: float, a: float = 0.0, r: float = 0.0, whole: bool = False) -> Span:
    return Span(np.array([low]), np.array([high]), np.array([a]), np.array([r]), whole=whole)


def result(expression, *spans: Span, fmt=None, **more) -> tuple[Span, tuple[str, ...]]:
    """Span of an expression of x and y, and what it takes for granted."""
    kernel = walk(ca.Function("f", [X, Y][: len(spans)], [expression]))
    rounding = Exact(kernel) if fmt is None else FloatRounding(kernel, fmt)
    values, assumed = propagate(rounding, [[s] for s in spans], **more)
    return values[kernel.results[0][0]], assumed


# -- any expression, in single precision -----------------------------------------------------------


def single(kernel, inputs):
    """Evaluate in numpy float32, operation by operation."""
    f = np.float32
    table = {
        "add": lambda a, b: f(a + b),
        "sub": lambda a, b: f(a - b),
        "mul": lambda a, b: f(a * b),
        "div": lambda a, b: f(a / b),
        "inv": lambda a: f(f(1) / a),
        "neg": lambda a: -a,
        "sq": lambda a: f(a * a),
        "twice": lambda a: f(2) * a,
        "fabs": abs,
        "fmin": min,
        "fmax": max,
    }
    value = []
    for n in kernel.nodes:
        if n.op == "const":
            value.append(f(n.value))
        elif n.op == "input":
            value.append(f(inputs[n.source[1]]))
        else:
            value.append(table[n.op](*(value[a] for a in n.args)))
    return float(value[kernel.results[0][0]])


leaf = st.sampled_from(["x0", "x1", "x2", "c"])


@st.composite
def expressions(draw, depth: int = 4):
    if depth == 0 or draw(st.booleans()):
        return draw(leaf), draw(st.floats(-3, 3, width=32))
    op = draw(st.sampled_from(["add", "sub", "mul", "div", "sq", "abs", "min", "max"]))
    return op, draw(expressions(depth - 1)), draw(expressions(depth - 1))


def build(tree, x):
    if tree[0] in ("x0", "x1", "x2"):
        return x[int(tree[0][1])]
    if tree[0] == "c":
        return ca.SX(tree[1] + 0.1)
    a, b = build(tree[1], x), build(tree[2], x)
    return {
        "add": lambda: a + b,
        "sub": lambda: a - b,
        "mul": lambda: a * b,
        "div": lambda: a / (2 + ca.fabs(b)),
        "sq": lambda: a**2,
        "abs": lambda: ca.fabs(a),
        "min": lambda: ca.fmin(a, b),
        "max": lambda: ca.fmax(a, b),
    }[tree[0]]()


@settings(max_examples=150)
@drawn(
    expressions(), st.lists(st.floats(-2, 2, width=32), min_size=3, max_size=3), st.floats(0.001, 1)
)
def test_the_bound_holds_for_any_expression(tree, centre, width):
    x = ca.SX.sym("x", 3)
    kernel = walk(ca.Function("f", [x], [build(tree, x)]))
    ranges = [[given(c - width, c + width) for c in centre]]
    try:
        values, _ = propagate(FloatRounding(kernel, F32), ranges)
    except RangeError:
        assume(False)
    bound = values[kernel.results[0][0]]
    rng = np.random.default_rng(0)
    exact = ca.Function("f", [x], [build(tree, x)])
    for _ in range(20):
        point = np.float32(rng.uniform([c - width for c in centre], [c + width for c in centre]))
        point = np.clip(point, [c - width for c in centre], [c + width for c in centre])
        if not np.array_equal(point, np.float32(point)):
            continue
        true = float(exact(point.astype(float)))
        # 1e-12: the reference is itself computed in float64.
        slack = 1e-12 * (1 + abs(true))
        assert abs(single(kernel, point) - true) <= bound.error[0] + slack
        assert bound.low[0] - slack <= true <= bound.high[0] + slack


# -- each rule against the worst that there is -----------------------------------------------------

# Errors so large that the products of errors count: what is left out of a rule shows.
BOTH = {
    "right": given(0.5, 2.0, 0.1, 0.2),
    "left": given(-5.0, -3.0, 0.3, 0.1),
    "across": given(-1.5, 2.0, 0.1, 0.2),
    "far": given(3.0, 5.0, 0.3, 0.1),
    "share": given(3.0, 5.0, 0.0, 0.2),
    "flat": given(0.5, 2.0, 0.2, 0.0),
    "root": given(0.0, 2.0, 0.01, 0.0),
    "some": given(3.0, 5.0, 0.1, 0.0),
}


def worst(expression, x: Span, y: Span) -> tuple[np.ndarray, np.ndarray]:
    """Exact values, and how far each may be off by its operands' errors."""
    f = ca.Function("f", [X, Y], [expression])
    sides = [np.linspace(v.low[0], v.high[0], 25) for v in (x, y)]
    at = [g.ravel()[None, :] for g in np.meshgrid(*sides)]
    room = [v.a + v.r * np.abs(g) for v, g in zip((x, y), at, strict=True)]
    exact = np.asarray(f(*at), float)[0]
    off = np.zeros_like(exact)
    for s, t in itertools.product((-1, 0, 1), repeat=2):
        moved = np.asarray(f(at[0] + s * room[0], at[1] + t * room[1]), float)[0]
        off = np.fmax(off, np.abs(moved - exact))
    return exact, off


@pytest.mark.parametrize(
    ("expression", "x", "y", "loose"),
    [
        (X + Y, "right", "far", 1.4),
        (X + Y, "left", "left", 1),
        (X + Y, "share", "share", 1),
        (X + Y, "across", "far", 1),
        (X - Y, "right", "far", 1),
        (X - Y, "share", "left", 1.3),
        *((e, x, y, 1) for e in (X * Y, X / Y) for x in ("right", "left", "across", "share")
          for y in ("far", "left", "share")),
        *((e, x, "far", 1) for e in (-X, 2 * X, X * X, ca.fabs(X)) for x in BOTH),
        (1 / X, "right", "far", 1),
        (1 / X, "left", "far", 1),
        (ca.fmin(X, Y), "right", "far", 1),
        (ca.fmin(X, Y), "left", "far", 1),
        (ca.fmin(X, Y), "share", "share", 1),
        (ca.fmin(X, Y), "across", "left", 1.4),
        (ca.fmax(X, Y), "flat", "flat", 1),
        (ca.fmax(X, Y), "across", "left", 1),
        (ca.fmax(X, Y), "right", "far", 1.4),
        (ca.fmax(X, Y), "left", "far", 1),
        (ca.if_else(Y > 1, X, Y), "right", "far", 1),
        (ca.if_else(Y < 1, X, Y), "right", "far", 1),
        (ca.exp(X), "right", "far", 1),
        (ca.exp(X), "some", "far", 1),
        (ca.tanh(X), "root", "far", 1.001),
        (ca.log(X), "flat", "far", 1.4),
        (ca.log(X), "some", "far", 1.02),
        (ca.sqrt(X), "root", "far", 1),
        (ca.sqrt(X), "some", "far", 2),
        (X**0.4, "root", "far", 1),
        (X**0.4, "some", "far", 1.02),
        (X**0.4, "share", "far", 1),
        (X**2.7, "root", "far", 1.01),
        (X**2.7, "some", "far", 1.02),
        (X**2.7, "share", "far", 1),
        (X**2.7, "right", "far", 1.01),
    ],
)  # fmt: skip
def test_no_error_beyond_a_rules_bound_and_none_much_below(expression, x, y, loose):
    found, assumed = result(expression, BOTH[x], BOTH[y])
    exact, off = worst(expression, BOTH[x], BOTH[y])
    assert assumed == ()
    # Of a root at 0 the computed argument may be below it, where nothing is computed.
    assert np.all(off <= (found.a + found.r * np.abs(exact)) * (1 + 1e-9))
    assert found.error[0] <= loose * np.max(off) * (1 + 1e-9)
    # The ends are those of the exact value, less the step of the grid where it turns.
    assert found.low[0] == pytest.approx(exact.min(), abs=0.07)
    assert found.high[0] == pytest.approx(exact.max(), abs=1e-12)
    assert found.low[0] <= exact.min() + 1e-12


@pytest.mark.parametrize(
    ("low", "high", "c"),
    [
        *((*ends, c) for ends in ((0.0, 0.9), (0.0, 2.5), (1e-3, 2.0)) for c in (0.4, 2.7)),
        *((*ends, -1.3) for ends in ((1e-3, 2.0), (0.5, 1.5))),
    ],
)
def test_an_exponent_that_is_off_turns_a_power_by_its_logarithm(low, high, c, monkeypatch):
    off = 2.0**-20
    monkeypatch.setattr(Exact, "exponent_off", off)
    found, _ = result(X**c, given(low, high))
    x = np.linspace(low, high, 4001)[1:]
    error = np.abs(x ** (c + off) - x**c)
    assert np.all(error <= (found.a + found.r * x**c) * (1 + 1e-5))
    assert found.error[0] <= 10 * error.max()


def test_what_has_no_bound_is_refused():
    for expression, x, y in (
        (1 / X, (-1, 1), (0, 1)),
        (X / Y, (1, 2), (1, 2, 1.0)),
        (ca.log(X), (0.1, 1, 0.1), (0, 1)),
        (X**-1.5, (0.1, 1, 0.1), (0, 1)),
        (X**Y, (0.1, 1), (0, 1)),
        (ca.exp(X), (0, 1e4), (0, 1)),
    ):
        with pytest.raises(RangeError):
            result(expression, given(*x), given(*y))
    for expression in (ca.sqrt(X), X**0.5):  # what the C computes there is no number
        with pytest.raises(RangeError, match="below zero"):
            result(expression, given(-1, 1), fmt=F32)


# -- what is decided -------------------------------------------------------------------------------

OPEN, YES, NO = (0.0, 1.0), (1.0, 1.0), (0.0, 0.0)


@pytest.mark.parametrize(
    ("x", "y", "less", "at_most"),
    [
        ((0, 1), (2, 3), YES, YES),
        ((0, 2), (2, 3), OPEN, YES),
        ((2, 3), (0, 1), NO, NO),
        ((2, 3), (0, 2), NO, OPEN),
        ((0, 3), (2, 4), OPEN, OPEN),
        ((-3, -2), (-2, 5), OPEN, YES),
    ],
)
def test_a_comparison_is_decided_where_all_of_both_intervals_agree(x, y, less, at_most):
    def truth(expression, *spans):
        found, assumed = result(expression, *spans)
        return (found.low[0], found.high[0]), bool(assumed)

    exact = given(*x), given(*y)
    for expression, expected in (
        (X < Y, less),
        (X <= Y, at_most),
        (ca.logic_not(X < Y), (1 - less[1], 1 - less[0])),
        # What another operand alone decides, and what both must.
        (ca.logic_and(X <= Y, X < 9), at_most),
        (ca.logic_and(X <= Y, X > 9), NO),
        (ca.logic_or(X < Y, X > 9), less),
        (ca.logic_or(X < Y, X < 9), YES),
    ):
        assert truth(expression, *exact) == (expected, False), expression
    # Each side off by what closes the gap between them, and by a little less.
    gap = max(y[0] - x[1], x[0] - y[1])
    for share, closed in ((0.49, gap <= 0), (0.51, True)):
        rough = [given(*v, share * max(gap, 0.01)) for v in (x, y)]
        assert truth(X < Y, *rough) == (OPEN if closed else less, closed)


def test_a_decided_choice_is_the_one_that_is_taken_box_by_box():
    low = Span(np.array([0.0, 5.0]), np.array([1.0, 6.0]), np.full(2, 0.25), np.zeros(2))
    high = Span(np.array([2.0, 3.0]), np.array([3.0, 4.0]), np.full(2, 0.125), np.zeros(2))
    found, _ = result(ca.if_else(X < Y, X, Y), low, high, boxes=2)
    assert (found.low.tolist(), found.a.tolist()) == ([0.0, 3.0], [0.25, 0.125])
    found, _ = result(ca.if_else(X > Y, X, 0), low, high, boxes=2)
    assert (found.low.tolist(), found.high.tolist()) == ([0.0, 5.0], [0.0, 6.0])


def test_what_is_computed_never_leaves_a_clip():
    # An error of 0.5 before a clip to 1; behind it nothing is above 1, exact or computed.
    clipped = ca.fmax(ca.fmin(X, 1.0), -1.0)
    found, assumed = result(clipped <= 1.0, given(-3, 3, 0.5), fmt=F32)
    assert (found.low[0], assumed) == (1.0, ())
    found, assumed = result(clipped <= 0.99, given(-3, 3, 0.5), fmt=F32)
    assert (found.low[0], len(assumed)) == (0.0, 1)


def test_a_fact_cuts_the_range_and_leaves_the_error():
    (i,) = walk(ca.Function("f", [X, Y], [X * Y])).results[0]
    fact = {i: (np.array([0.0]), np.array([4.0]))}
    free, _ = result(X * Y, BOTH["across"], BOTH["far"])
    cut, _ = result(X * Y, BOTH["across"], BOTH["far"], facts=fact)
    assert (cut.low[0], cut.high[0], cut.a[0]) == (0.0, 4.0, free.a[0])


# -- the arithmetic of the floating-point formats --------------------------------------------------


def test_what_each_operation_rounds_itself():
    one, tiny = given(1.0, 2.0), float(np.finfo(np.float32).smallest_subnormal)
    for expression in (X + Y, X - Y, X * Y, X / Y, 1 / X, X * X):
        found, _ = result(expression, one, one, fmt=F32)
        # One that may cancel is off by a share of the largest instead of by one of itself.
        size = found.magnitude[0]
        assert found.a[0] + found.r[0] * size == pytest.approx(U * size, abs=2 * tiny, rel=1e-6)
    for expression in (-X, 2 * X, ca.fabs(X), ca.fmin(X, Y), ca.fmax(X, Y)):
        assert result(expression, one, one, fmt=F32)[0].exact
    # The functions: their stated error, in units in the last place of 2 u at most.
    stated = ((ca.exp(X), 0.51), (ca.log(X + 1), 0.51), (ca.sqrt(X), 0.5), (ca.tanh(X), 0.52))
    for expression, ulp in stated:
        found, _ = result(expression, one, one, fmt=F32)
        assert found.r[0] == pytest.approx(2 * ulp * U, rel=1e-6)
        found, _ = result(expression, one, one, fmt=F64)
        assert found.r[0] == pytest.approx(2 * 2.0**-53, rel=1e-6)
    # What the emitted power errs near the smallest number, and where its argument is half as large.
    assert result(X**0.77, given(1e-30, 1e-30), fmt=F32)[0].error >= 2.64e-7 * 1e-30**0.77
    rough, _ = result(X**0.77, given(0.25, 0.25, 0.0, 0.5), fmt=F32)
    assert rough.error >= 0.25**0.77 - 0.125**0.77


def test_the_sign_of_a_sum_of_exact_numbers_is_sure():
    exact, rough = given(-1.0, 1.0), given(-1.0, 1.0, 1e-9)

    def turns(expression, x, y):
        return bool(result(expression, x, y, fmt=F32)[1])

    for expression in (X + Y > 0, X - Y <= 0, X - Y < 0):
        assert not turns(expression, exact, exact)
        assert turns(expression, exact, rough)
        assert turns(expression, rough, exact)
    # Against another number than 0, or of a product, it is not.
    assert turns(X + Y > 0.5, exact, exact)
    assert turns(X * Y > 0, exact, exact)
    # A sign that rounding may turn is wrong by 2.
    for low, high, error, off in ((0.5, 2, 0.4, 0), (0.5, 2, 0.6, 2), (-1, 1, 0, 0)):
        assert result(ca.sign(X), given(low, high, error), fmt=F32)[0].a[0] == off


def test_whole_numbers_are_exact_as_far_as_the_format_holds_them():
    top = 2.0**24
    for expression, x, y, exact in (
        (X + Y, (0, top - 1), (0, 1), True),
        (X + Y, (0, top), (0, 1), False),
        (X - Y, (0, top), (-1, 0), False),
        (X * Y, (0, 4096), (-4096, 4096), True),
        (X * Y, (0, 4096), (-4097, 0), False),
        (X * X, (-4096, 4096), (0, 0), True),
        (X * X, (-4097, 0), (0, 0), False),
        (2 * X + Y, (0, top / 2 - 1), (0, 2), True),
        (ca.fabs(-X) + Y, (1 - top, 0), (0, 1), True),
        (ca.fmin(X, 7.0) + Y, (0, 9), (0, 1), True),
        (ca.fmin(X, 7.5) + Y, (0, 9), (0, 1), False),
        (ca.if_else(X > 3, X, Y) + Y, (0, 9), (0, 1), True),
        (ca.if_else(X > 3, X, 0.5) + Y, (0, 9), (0, 1), False),
        ((X > 3) + Y, (0, 9), (0, 1), True),
    ):
        wholes = [given(*v, whole=True) for v in (x, y)]
        assert result(expression, *wholes, fmt=F32)[0].exact == exact, (expression, x, y)
        # Of any numbers the same sum is rounded.
        assert not result(expression, given(*x), given(*y), fmt=F32)[0].exact
    # A number is off by what single precision leaves of it.
    for c in (0.1, 1 / 3, 16777217.0):
        found, _ = result(X * 0 + c, given(0, 1), fmt=F32)
        assert found.error[0] >= abs(float(np.float32(c)) - c)
