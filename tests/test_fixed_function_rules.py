"""Functions in whole numbers: format, range and error of each against a budget by hand."""

from __future__ import annotations

import math
from fractions import Fraction

import casadi as ca
import mpmath
import numpy as np
import pytest

from esea_gen.emit.fixed.lowering import lower, rewrite
from esea_gen.emit.fixed.plan import lowered_values
from esea_gen.emit.fixed.values import LoweringError, Source, Target, Value
from esea_gen.emit.walker import fuse_selects, walk

from .test_fixed_formats import Op, form, made, op

X = ca.SX.sym("x")
ABOVE = (28, 200_000_003, 1_800_000_001)  # fraction bits and raw ends: 0.75 to 6.7
ACROSS = (28, -800_000_001, 900_000_001)  # -2.98 to 3.35
AT_ONE = (30, 2**30, 2**30 + 2**25)  # 1 to 1.031
AT_ZERO = (29, 0, 2**30)
CORE_LOG2, CORE_EXP2 = 2.0**-34.2, 2.0**-30.1  # what the two cores err by, over all arguments


def tried(expression, given, wide: bool | None = False) -> tuple[Value, list[int], list[int]]:
    """The value that an expression is lowered to, raw operands, and raw results.

    wide: in 64 bits; None for all but the result.
    """
    kernel = rewrite(fuse_selects(walk(ca.Function("f", [X], [expression]))))
    source = Source("x", "in->x", *given, "x")
    (node,) = kernel.results[0]
    nodes = set() if wide is False else set(range(len(kernel.nodes)))
    if wide is None:
        nodes.remove(node)
    lowered = lower(kernel, lambda *_: source, [[Target("y", 0)]], wide=nodes, block="tried")
    low, high = given[1:]
    raws = [low + (high - low) * k // 60 for k in range(61)]
    values = lowered_values(lowered, {"in->x": np.array(raws, object)}, len(raws))
    value = lowered.values[node]
    assert value is not None
    return value, raws, [int(v) for v in values[node]]


def half(fraction: int) -> float:
    return 0.5 * 2.0**-fraction


def power(c: float, wide: bool = False):
    """Relative error of x^c: c times that of the logarithm and its cut, and what 2^x adds."""
    base = abs(c) * 2.0**-31 if wide else 0.0  # 64 bits are cut to the 32 of a significand
    return math.expm1(math.log(2) * abs(c) * (CORE_LOG2 + 2.0**-56) + base) + CORE_EXP2


def logarithm(most_log2: float) -> float:
    """The core's error in units of ln 2, of the 32 bits of ln 2 itself, and of the last cut."""
    return math.log(2) * CORE_LOG2 + most_log2 * 2.0**-32 + 2.0**-33


BY_EXP = CORE_EXP2 + 2.0**-33  # the argument in units of ln 2 is cut to 32 bits
E_MOST = math.exp(900_000_001 / 2**28 + 0.25) * (1 + 2.0**-24)
LOG2_MOST = math.log2(1_800_000_001 / 2**28)
LOG2_LEAST = -math.log2(0.3 * 200_000_003 / 2**28)

# Expression, operand, 64 bits, bits of the fraction, absolute error beside half a unit, relative.
RULES = [
    (ca.exp(X), ACROSS, False, 26, 0.0, BY_EXP),
    (ca.exp(X), ACROSS, True, 56, 0.0, BY_EXP),
    # 64 bits are brought to 32, here of 2^-29 each.
    (ca.exp(X + 0.25), ACROSS, True, 55, math.expm1(half(29)) * E_MOST, BY_EXP),
    (ca.exp(-X), ABOVE, False, 32, 0.0, BY_EXP),
    (ca.log(X), ABOVE, False, 30, logarithm(LOG2_MOST), 0.0),
    (ca.log(X), ABOVE, True, 52, logarithm(LOG2_MOST), 0.0),
    (ca.log(X * 0.3), ABOVE, True, 52, logarithm(LOG2_LEAST) + 2.0**-31, 0.0),
    (ca.log(X), AT_ONE, False, 33, logarithm(math.log2(1.03125)), 0.0),
    (X**0.75, ABOVE, False, 28, 0.0, power(0.75)),
    (X**2.25, ABOVE, False, 24, 0.0, power(2.25)),
    (X**-1.5, ABOVE, False, 30, 0.0, power(1.5)),
    (X**0.75, AT_ZERO, False, 30, 0.0, power(0.75)),
    (X**0.75, ABOVE, True, 58, 0.0, power(0.75)),
    ((X * 0.3) ** 0.75, ABOVE, True, 60, 0.0, power(0.75, True)),
    ((X * 0.3) ** 0.75, ABOVE, None, 30, 0.0, power(0.75, True)),
    (ca.log(X * 0.3), ABOVE, None, 30, logarithm(LOG2_LEAST) + 2.0**-31, 0.0),
    (ca.exp(X + 0.25), ACROSS, None, 25, math.expm1(half(29)) * E_MOST, BY_EXP),
]
EXACT = {
    str(ca.exp(X)): mpmath.exp,
    str(ca.exp(X + 0.25)): lambda v: mpmath.exp(v + 0.25),
    str(ca.exp(-X)): lambda v: mpmath.exp(-v),
    str(ca.log(X)): mpmath.log,
    str(ca.log(X * 0.3)): lambda v: mpmath.log(v * mpmath.mpf(0.3)),
    str((X * 0.3) ** 0.75): lambda v: (v * mpmath.mpf(0.3)) ** 0.75,
    **{str(X**c): (lambda v, c=c: v ** mpmath.mpf(c)) for c in (0.75, 2.25, -1.5)},
}


@pytest.mark.parametrize(("expression", "given", "wide", "fraction", "local", "relative"), RULES)
def test_error_format_and_range_of_a_function(expression, given, wide, fraction, local, relative):
    value, raws, found = tried(expression, given, wide)
    assert value.fraction == fraction
    assert value.expr.bits == (64 if wide else 32)
    assert value.relative == pytest.approx(relative, rel=1e-9, abs=0)
    assert value.local == pytest.approx(local + half(fraction), rel=1e-6, abs=0)
    with mpmath.workdps(40):
        f = EXACT[str(expression)]
        exact = [f(mpmath.mpf(v) / 2 ** given[0]) for v in raws]
        # A stored 0.3 is off by what the product before says of itself, and grows along.
        before = 2.0**-31 if "0.3" in str(expression) else 0.0
        for v, raw in zip(exact, found, strict=True):
            error = abs(raw * mpmath.mpf(2) ** -fraction - v)
            assert error <= value.local + (value.relative + before) * abs(v)
        # All that can be computed lies inside, and a unit or two more.
        room = [value.local + value.relative * abs(float(v)) for v in (min(exact), max(exact))]
        slack = [r + abs(float(v)) * 2.0**-22 + 4 * 2.0**-fraction
                 for r, v in zip(room, (min(exact), max(exact)), strict=True)]  # fmt: skip
    if min(exact) >= 0 and "log" not in str(expression):
        assert value.expr.low >= 0
    low, high = float(min(exact)), float(max(exact))
    assert low - slack[0] <= float(value.low) <= low + before
    assert high <= float(value.high) <= high + slack[1]
    if "log" not in str(expression):  # which is cut to its ends, towards the exact value
        assert float(value.high) >= high + room[1]
    assert value.expr.low <= min(found)
    assert max(found) <= value.expr.high


@pytest.mark.parametrize("wide", [False, True])
def test_a_root_and_a_hyperbolic_tangent(wide):
    # Two units for a root, of what is shifted out below it and of itself; 32 bits always.
    value, raws, found = tried(ca.sqrt(X), ABOVE, wide)
    assert (value.fraction, value.local, value.relative) == (29, 2.0**-28, 0.0)
    assert value.expr.bits == 32
    exact = [math.sqrt(v / 2**28) for v in raws]
    assert max(abs(r * 2.0**-29 - e) for r, e in zip(found, exact, strict=True)) <= 2.0**-29
    assert exact[0] - 4 * 2.0**-29 < float(value.low) <= exact[0] - 2 * 2.0**-29
    assert exact[-1] <= float(value.high) <= exact[-1] + 4 * 2.0**-29
    value, raws, found = tried(ca.sqrt(X), AT_ZERO, wide)
    assert (value.fraction, value.expr.low) == (30, 0)
    assert value.expr.high in (round(math.sqrt(2) * 2**30) + d for d in range(4))
    # Steps of 2^-30 for a tangent that errs by four of them; 64 bits are brought to 32 before.
    value, raws, found = tried(ca.tanh(X), ACROSS, wide)
    assert (value.fraction, value.local, value.relative) == (30, 2.0**-28, 0.0)
    assert (value.expr.low, value.expr.high) == (-(2**30), 2**30)
    off = [abs(r * 2.0**-30 - math.tanh(v / 2**28)) for r, v in zip(found, raws, strict=True)]
    assert max(off) <= 2.0**-28
    value, _, _ = tried(ca.tanh(X + 0.25), ACROSS, wide)
    assert value.local == 2.0**-28 + (half(29) if wide else 0.0)


def test_a_wide_argument_of_a_narrow_function_is_rounded_to_its_own_best():
    # x / 3 of -0.99 to 1.12 in 64 bits: 30 bits of 32 behind the point.
    value, raws, found = tried(ca.tanh(X / 3), ACROSS, True)
    assert value.local == 2.0**-28 + half(30)
    off = [abs(r * 2.0**-30 - math.tanh(v / 3 / 2**28)) for r, v in zip(found, raws, strict=True)]
    assert max(off) <= value.local


def refusal(expression, given, wide: bool = False) -> str:
    try:
        tried(expression, given, wide)
    except LoweringError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("expression", "refused", "taken", "words"),
    [
        (X**0.6, (28, -1, 9), (28, 0, 9), "below zero"),
        (X**-0.5, (28, 0, 9), (28, 1, 9), "the base can be zero and the exponent is -0.5"),
        (X**17.5, (31, 1, 9), None, "does not fit Q4.27"),
        # A base of a root that rounding may bring below zero is taken, one that may be there not.
        (ca.sqrt(X), (20, -3, 10**6), (20, -1, 10**6 + 9), "Clip the argument at zero"),
        (ca.log(X), (28, 0, 9), (28, 1, 9), "Add a positive offset to the argument"),
        # 40: e^40 is 2^57.7, and with 32 bits of argument below it no more fits.
        (ca.exp(X), (25, 0, 40 * 2**25 + 1), (25, 0, 40 * 2**25), "Clip the argument to at most"),
        (ca.exp(X), (0, -9, 1), (1, -9, 1), "is too wide"),
        (ca.tanh(X), (1, -9, 9), (2, -9, 9), "is too wide"),
        (ca.exp(X), (63, -9, 9), (62, -9, 9), "So near zero exp(x) is 1 + x"),
        (ca.tanh(X), (63, -9, 9), (62, -9, 9), "So near zero tanh(x) is x"),
    ],
)
def test_what_a_function_cannot_take_is_refused_and_what_it_can_is_not(
    expression, refused, taken, words
):
    said = refusal(expression, refused)
    assert said.startswith("block tried: operation '")
    assert words in said
    assert said.endswith("Or try --real f32.")
    if taken is not None:
        assert refusal(expression, taken) == ""


def test_a_refusal_says_how_large_the_argument_must_be_able_to_be():
    # 2^31 steps of 2^-62, of which a sign takes one bit: 2^-32.
    said = refusal(ca.tanh(X), (63, -9, 5))
    assert f"exceeds {9 * 2.0**-63:.3g}" in said
    assert f"reach {2.0**-32:.3g} for a step of 2^-62" in said
    assert f"reaches {-(2.0**-20):.6g}" in refusal(X**0.6, (20, -1, 9))


def test_constants_of_a_power_that_is_no_number_are_refused():
    y = ca.SX.sym("y")
    kernel = rewrite(fuse_selects(walk(ca.Function("f", [X, y], [ca.exp(X) * X**y]))))
    source = Source("x", "in->x", 28, 1, 2**28, "x")
    with pytest.raises(LoweringError, match="the exponent varies"):
        lower(kernel, lambda *_: source, [[Target("y", 0)]], block="tried")


def test_as_fine_as_the_largest_result_allows():
    # The result of a power over its whole range, the finest format that holds it.
    for c in (0.6, 1.5, 2.5, 3.5):
        value, _, _ = tried(X**c, ABOVE)
        most = Fraction((ABOVE[2] / 2**28) ** c) * (1 + Fraction(1, 2**24))
        assert most * 2**value.fraction < 2**31 <= most * 2 ** (value.fraction + 1)


# -- as C ------------------------------------------------------------------------------------------

ONE_TO_16 = (26, 2**26, 2**30)
SMALL = op("mul", (20, -3, 5), (22, 0, 7), wide=True)  # 64 bits: -21 to 35, in units of 2^-42
UNIT = op("mul", (28, -(2**28), 2**28), (28, -(2**28), 5), wide=True)  # 64 bits: -1 to 1
SQUARES = op("mul", (12, 2**12, 2**14), (13, 2**13, 2**15), wide=True)  # 64 bits: 1 to 16
LN2, ONE_BY_E = mpmath.mpf("0.693147180559945309417"), mpmath.mpf("0.367879441171442321596")
LOG_TOP = int(mpmath.ceil(LN2 * 2**31)) + 2


def cut(text: str, low: int, high: int | None = None, bits: int = 64) -> str:
    """C that cuts to a range, as 32 bits."""
    name, number, cast = {
        32: ("esea_q31", "{}", ""),
        64: ("esea_q63", "INT64_C({})", "(int32_t)"),
    }[bits]
    if high is not None:
        text = f"{name}_min({text}, {number.format(high)})"
    return f"{cast}{name}_max({text}, {number.format(low)})"


# Operation, fraction bits, raw ends, C.
TEXTS = [
    # 1 to 4, a share of 2^-24 more to either side, and a unit.
    (op("pow", ONE_TO_16, 0.5), 28, 2**28 - 17, 2**30 + 65,
     cut(f"esea_q31_pow(x0_q26, 26, INT32_C({2**26}), 28, {2**30 + 65})", 2**28 - 17, None, 32)),
    (op("pow", ONE_TO_16, -0.5), 30, 2**28 - 17, 2**30 + 65,
     cut(f"esea_q31_pow(x0_q26, 26, INT32_C({-2**26}), 30, {2**30 + 65})", 2**28 - 17, None, 32)),
    (op("pow", ONE_TO_16, -0.5, wide=True), 60, 2**58 - 2**34 + 2**10 - 1, 2**60 + 2**36 + 1,
     f"esea_q63_max(esea_q63_pow(x0_q26, 26, INT32_C({-2**26}), 60, "
     f"INT64_C({2**60 + 2**36 + 1})), INT64_C({2**58 - 2**34 + 2**10 - 1}))"),
    (op("pow", (26, 0, 2**30), 0.5), 28, 0, 2**30 + 65,
     f"esea_q31_pow(x0_q26, 26, INT32_C({2**26}), 28, {2**30 + 65})"),
    (op("pow", SQUARES, 0.5), 28, 2**28 - 17, 2**30 + 65,
     cut(f"(int32_t)esea_q63_pow(v2_q25, 25, INT32_C({2**26}), 28, INT64_C({2**30 + 65}))",
         2**28 - 17, None, 32)),
    (op("exp", (28, -(2**28), 0)), 30, int(ONE_BY_E * (2**30 - 2**6)) - 1, 2**30 + 65,
     cut(f"esea_q63_exp(x0_q28, 28, 30, INT64_C({2**30 + 65}))",
         int(ONE_BY_E * (2**30 - 2**6)) - 1)),
    (op("log", (28, 2**27, 2**29)), 31, -LOG_TOP, LOG_TOP,
     cut("esea_q63_log(x0_q28, 28, 31)", -LOG_TOP, LOG_TOP)),
    # From 1 to hardly more: no finer than an eighth would be.
    (op("log", (30, 2**30, 2**30 + 1)), 33, -2, 10,
     cut("esea_q63_log(x0_q30, 30, 33)", -2, 10)),
    (op("log", (30, 2**30 - 1, 2**30)), 33, -11, 2,
     cut("esea_q63_log(x0_q30, 30, 33)", -11, 2)),
    # A share of 2^-40 of 2^30 is less than a unit.
    (op("sqrt", ONE_TO_16), 28, 2**28 - 3, 2**30 + 2,
     cut("esea_q31_sqrt(x0_q26, 30)", 2**28 - 3, 2**30 + 2, 32)),
    (op("tanh", (28, -9, 5)), 30, -(2**30), 2**30, "esea_q31_tanh(x0_q28, 28)"),
    # 64 bits in 32, as they are or rounded.
    (op("tanh", SMALL), 30, -(2**30), 2**30, "esea_q31_tanh((int32_t)v2_q42, 42)"),
    (op("tanh", UNIT), 30, -(2**30), 2**30,
     "esea_q31_tanh((int32_t)esea_q63_round(v2_q56, 26), 30)"),
]  # fmt: skip


@pytest.mark.parametrize(("x", "fraction", "low", "high", "text"), TEXTS, ids=lambda x: None)
def test_the_c_of_a_function_cuts_to_the_range_it_can_have(x: Op, fraction, low, high, text):
    found = made(x)
    assert form(found.value) == (64 if x.wide else 32, fraction, low, high)
    assert found.text == text


def test_the_format_of_a_root_is_one_in_which_its_square_has_62_bits():
    # Of nothing but zeros, 16 places before the point: twice 23 and 16 bits; seven less than 30.
    assert form(made(op("sqrt", (-16, 0, 0)), to=20).value)[:2] == (32, 23)
    with pytest.raises(LoweringError, match="root of more than 62 bits"):
        made(op("sqrt", (-18, 0, 0)), to=20)
