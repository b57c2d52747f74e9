"""The error analysis: its bounds hold, and they are not idle."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import esea_gen
from esea_gen.emit.error_bounds import block_bound
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.ranges import RangeError, RangeValue, analyse
from esea_gen.emit.walker import walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Port

F32 = FORMATS["f32"]


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


@settings(max_examples=300)
@given(
    expressions(),
    st.lists(st.floats(-2, 2, width=32), min_size=3, max_size=3),
    st.floats(0.001, 1),
)
def test_the_bound_holds_for_any_expression(tree, centre, width):
    x = ca.SX.sym("x", 3)
    kernel = walk(ca.Function("f", [x], [build(tree, x)]))
    ranges = [[RangeValue(c - width, c + width) for c in centre]]
    try:
        bound = analyse(kernel, F32, ranges).results[0][0]
    except RangeError:
        assume(False)
    rng = np.random.default_rng(0)
    exact = ca.Function("f", [x], [build(tree, x)])
    for _ in range(20):
        point = np.float32(rng.uniform([c - width for c in centre], [c + width for c in centre]))
        point = np.clip(point, [c - width for c in centre], [c + width for c in centre])
        if not np.array_equal(point, np.float32(point)):
            continue
        true = float(exact(point.astype(float)))
        # 1e-12: what it is held against is float64 itself.
        slack = 1e-12 * (1 + abs(true))
        assert abs(single(kernel, point) - true) <= bound.error + slack
        assert bound.low - slack <= true <= bound.high + slack


def test_a_division_by_a_range_with_zero_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(RangeError, match="holds zero"):
        analyse(walk(ca.Function("f", [x], [1 / x])), F32, [[RangeValue(-1, 1)]])


def leaky(gain: float) -> Block:
    return Block.define(
        "leak",
        "a one-pole filter",
        period_s=1e-3,
        # With units: ports without one and with whole ends are taken as counting.
        state=(Port("s_rad", -100, 100, "state"),),
        inputs=(Port("x_rad", -1, 1, "input"),),
        outputs=(Port("y_rad", -100, 100, "output"),),
        step=lambda c, s, u, guard, label: (
            {"s_rad": gain * s.s_rad + u.x_rad},
            {"y_rad": gain * s.s_rad + u.x_rad},
        ),
    )


def test_a_filter_that_forgets_has_a_bound_for_all_time():
    bound = block_bound(leaky(0.99), F32)
    # By hand: |s| <= 100; one step errs by at most u (99 + 100) and the constant's u 99; all of
    # that over 1 - 0.99.
    u = 2.0**-24
    assert 0.2 * u * 300 / 0.01 < bound.states["s_rad"] < 1.5 * u * 300 / 0.01


def test_an_integrator_has_none():
    with pytest.raises(RangeError, match="stable"):
        block_bound(leaky(1.0), F32)


def test_sensor_bounds():
    device = esea_gen.load_device("elbow")
    bound = block_bound(device.sensor, F32)
    assert bound.assumptions == ()  # no decision of the sensor depends on rounding
    assert bound.outputs["tau_Nm"] < 0.01 * device.tau_full_scale_Nm
    assert bound.outputs["tau_hysteresis_Nm"] < 1e-5  # nothing is summed over time


def test_a_filter_that_switches_is_not_called_linear():
    # Which matrix rules depends on an input: one matrix taken at rest would say nothing.
    def step(c, s, u, guard, label):
        turn = ca.DM([[0.955, -0.296], [0.296, 0.955]])
        x = ca.vertcat(s.x[0], s.x[1])
        return {"x": ca.if_else(u.m > 0, 0.99999 * turn @ x + u.w, 0.5 * turn @ x)}, {"y": s.x[0]}

    block = Block.define(
        "chooser",
        "two filters",
        period_s=1e-3,
        state=(Port("x", -100, 100, "state", size=2),),
        inputs=(Port("m", -1, 1, "mode"), Port("w", -1, 1, "input")),
        outputs=(Port("y", -100, 100, "output"),),
        step=step,
    )
    with pytest.raises(RangeError, match="not stable"):
        block_bound(block, F32)


def test_an_integrator_has_none_in_a_narrow_range_either():
    with pytest.raises(RangeError, match="stable"):
        block_bound(leaky(1.0), F32, {"s_s_rad": (-10, 10)})


def test_powers_and_roots():
    x = ca.SX.sym("x")
    power = walk(ca.Function("f", [x], [x**0.77]))
    point = analyse(power, F32, [[RangeValue(1e-30, 1e-30)]]).results[0][0]
    assert point.error >= 2.64e-7 * 1e-30**0.77  # what the emitted power errs there
    rough = analyse(power, F32, [[RangeValue(0.25, 0.25, 0.0, 0.5)]]).results[0][0]
    assert rough.error >= 0.25**0.77 - 0.125**0.77
    root = walk(ca.Function("f", [x], [ca.sqrt(x)]))
    assert analyse(root, F32, [[RangeValue(0.0, 1.0, 1e-8)]]).results[0][0].error >= 1e-4


# -- each rule against the worst that there is -----------------------------------------------------

F64 = FORMATS["f64"]
X, Y = ca.SX.sym("x"), ca.SX.sym("y")
# Errors so large that the products of errors count: what is left out of a rule shows.
BOTH = {
    "right": RangeValue(0.5, 2.0, 0.1, 0.2),
    "left": RangeValue(-5.0, -3.0, 0.3, 0.1),
    "across": RangeValue(-1.5, 2.0, 0.1, 0.2),
    "far": RangeValue(3.0, 5.0, 0.3, 0.1),
    "share": RangeValue(3.0, 5.0, 0.0, 0.2),
    "flat": RangeValue(0.5, 2.0, 0.2, 0.0),
    "root": RangeValue(0.0, 2.0, 0.01, 0.0),
    "some": RangeValue(3.0, 5.0, 0.1, 0.0),
}


def off_by(expression, x: RangeValue, y: RangeValue):
    """The rule's result, the exact values, and how far each may be off by its operands' errors."""
    f = ca.Function("f", [X, Y], [expression])
    sides = [np.linspace(v.low, v.high, 25) for v in (x, y)]
    at = [g.ravel()[None, :] for g in np.meshgrid(*sides)]
    room = [v.a + v.r * np.abs(g) for v, g in zip((x, y), at, strict=True)]
    exact = np.asarray(f(*at), float)[0]
    off = np.zeros_like(exact)
    for s, t in itertools.product((-1, 0, 1), repeat=2):
        moved = np.asarray(f(at[0] + s * room[0], at[1] + t * room[1]), float)[0]
        off = np.fmax(off, np.abs(moved - exact))
    found = analyse(walk(f), F64, [[x], [y]])
    assert found.assumptions == ()
    return found.results[0][0], exact, off


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
    found, exact, off = off_by(expression, BOTH[x], BOTH[y])
    model = found.a + found.r * np.abs(exact)
    # Of a root at 0 the computed argument may be below it, where nothing is computed.
    assert np.all(off <= model * (1 + 1e-9))
    assert found.error <= loose * np.max(off) * (1 + 1e-9)
    # The ends are those of the exact value, less the step of the grid where it turns.
    assert found.low == pytest.approx(exact.min(), abs=0.07)
    assert found.high == pytest.approx(exact.max(), abs=1e-12)
    assert found.low <= exact.min() + 1e-12


def test_what_each_operation_rounds_itself():
    # Operands without an error: half a unit in the last place, and the smallest number there is.
    one = RangeValue(1.0, 2.0)
    u, tiny = 2.0**-24, float(np.finfo(np.float32).smallest_subnormal)
    for expression in (X + Y, X - Y, X * Y, X / Y, 1 / X, X * X):
        found = analyse(walk(ca.Function("f", [X, Y], [expression])), F32, [[one], [one]])
        value = found.results[0][0]
        # One that may cancel is off by a share of the largest instead of by one of itself.
        assert value.a + value.r * value.magnitude == pytest.approx(
            u * value.magnitude, abs=2 * tiny, rel=1e-6
        )
    for expression in (-X, 2 * X, ca.fabs(X), ca.fmin(X, Y), ca.fmax(X, Y)):
        found = analyse(walk(ca.Function("f", [X, Y], [expression])), F32, [[one], [one]])
        assert found.results[0][0].exact
    # The functions: their stated error, in units in the last place of 2 u at most.
    for expression, ulp in (
        (ca.exp(X), 0.51),
        (ca.log(X + 1), 0.51),
        (ca.sqrt(X), 0.5),
        (ca.tanh(X), 0.52),
    ):
        found = analyse(walk(ca.Function("f", [X, Y], [expression])), F32, [[one], [one]])
        assert found.results[0][0].r == pytest.approx(2 * ulp * u, rel=1e-6)
    # An exponent off by 2^-28, half the last of its 27 bits, turns x^c by the logarithm's share.
    for c, off in ((0.75, 0.0), (0.75 + 2.0**-28, 2.0**-28), (2.5 + 2.0**-29, 2.0**-29)):
        wide = RangeValue(1e-3, 2.0)
        found = analyse(walk(ca.Function("f", [X, Y], [X**c])), F32, [[wide], [one]])
        rounding = 2 * 0.51 * u
        expected = rounding + off * np.log(1e3)
        assert found.results[0][0].r == pytest.approx(expected, rel=1e-6)
        assert found.results[0][0].a < 1e-44


# -- what is decided, and what stays whole ---------------------------------------------------------

UNDECIDED = (0.0, 1.0)
YES, NO = (1.0, 1.0), (0.0, 0.0)


def truth(expression, x: RangeValue, y: RangeValue) -> tuple[tuple[float, float], bool]:
    """Range of a truth value, and whether rounding could turn it."""
    found = analyse(walk(ca.Function("f", [X, Y], [expression])), F32, [[x], [y]])
    value = found.results[0][0]
    assert value.exact
    return (value.low, value.high), bool(found.assumptions)


@pytest.mark.parametrize(
    ("x", "y", "less", "at_most"),
    [
        ((0, 1), (2, 3), YES, YES),
        ((0, 2), (2, 3), UNDECIDED, YES),
        ((2, 3), (0, 1), NO, NO),
        ((2, 3), (0, 2), NO, UNDECIDED),
        ((0, 3), (2, 4), UNDECIDED, UNDECIDED),
        ((2, 4), (0, 3), UNDECIDED, UNDECIDED),
        ((-3, -2), (-2, 5), UNDECIDED, YES),
    ],
)
def test_a_comparison_is_decided_where_all_of_both_intervals_agree(x, y, less, at_most):
    exact = RangeValue(*x), RangeValue(*y)
    for expression, expected in (
        (X < Y, less),
        (X <= Y, at_most),
        (Y > X, less),
        (Y >= X, at_most),
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
        rough = [RangeValue(v.low, v.high, share * max(gap, 0.01)) for v in exact]
        found, turned = truth(X < Y, *rough)
        assert (found == UNDECIDED, turned) == (closed, closed)
        one = (rough[0], RangeValue(*y))
        assert truth(X < Y, *one)[1] == (gap <= 0)


def test_a_choice_whose_condition_is_decided_is_the_one_that_is_taken():
    low, high = RangeValue(0.0, 1.0, 0.25), RangeValue(2.0, 3.0, 0.125)
    for expression, taken in (
        (ca.if_else(X < Y, X, Y), low),
        (ca.if_else(X > Y, X, Y), high),
        (ca.if_else(X < Y, X, 0), low),
    ):
        found = analyse(walk(ca.Function("f", [X, Y], [expression])), F32, [[low], [high]])
        value = found.results[0][0]
        assert (value.low, value.high, value.a) == (taken.low, taken.high, taken.a)
    found = analyse(walk(ca.Function("f", [X, Y], [ca.if_else(X > Y, X, 0)])), F32, [[low], [high]])
    assert (found.results[0][0].low, found.results[0][0].high) == (0, 0)


def test_the_sign_of_a_sum_of_exact_numbers_is_sure():
    exact, rough = RangeValue(-1.0, 1.0), RangeValue(-1.0, 1.0, 1e-9)
    for expression in (X + Y > 0, X - Y <= 0, X - Y < 0):
        assert truth(expression, exact, exact) == (UNDECIDED, False)
        assert truth(expression, exact, rough) == (UNDECIDED, True)
        assert truth(expression, rough, exact) == (UNDECIDED, True)
    # Against another number than 0, or of a product, it is not.
    assert truth(X + Y > 0.5, exact, exact) == (UNDECIDED, True)
    assert truth(X * Y > 0, exact, exact) == (UNDECIDED, True)


def test_whole_numbers_are_exact_as_far_as_the_format_holds_them():
    top = 2.0**24
    for expression, x, y, exact in (
        (X + Y, (0, top - 1), (0, 1), True),
        (X + Y, (0, top), (0, 1), False),
        (X + Y, (-top, 0), (-1, 0), False),
        (X - Y, (0, top - 1), (-1, 0), True),
        (X - Y, (0, top), (-1, 0), False),
        (X * Y, (0, 4096), (-4096, 4096), True),
        (X * Y, (0, 4096), (-4097, 0), False),
        (X * Y, (0, 4096), (0, 4097), False),
        (X * X, (-4096, 4096), (0, 0), True),
        (X * X, (-4097, 0), (0, 0), False),
        (2 * X + Y, (0, top / 2 - 1), (0, 2), True),
        (ca.fabs(-X) + Y, (1 - top, 0), (0, 1), True),
        (ca.fmin(X, 7.0) + Y, (0, 9), (0, 1), True),
        (ca.fmin(X, 7.5) + Y, (0, 9), (0, 1), False),
        (ca.fmax(X, 7.0) + Y, (0, 9), (0, 1), True),
        (ca.if_else(X > 3, X, Y) + Y, (0, 9), (0, 1), True),
        (ca.if_else(X > 3, X, 0.5) + Y, (0, 9), (0, 1), False),
        ((X > 3) + Y, (0, 9), (0, 1), True),
    ):
        given = [[RangeValue(*v, whole=True)] for v in (x, y)]
        kernel = walk(ca.Function("f", [X, Y], [expression]))
        assert analyse(kernel, F32, given).results[0][0].exact == exact, (expression, x, y)
        # Of any numbers the same sum is rounded.
        given = [[RangeValue(*v)] for v in (x, y)]
        assert not analyse(kernel, F32, given).results[0][0].exact
    # A number is off by what single precision leaves of it.
    for c in (0.1, 1 / 3, 16777217.0):
        stored = analyse(walk(ca.Function("f", [X, Y], [X * 0 + c])), F32, [[given[0][0]]] * 2)
        assert stored.results[0][0].error >= abs(float(np.float32(c)) - c)
