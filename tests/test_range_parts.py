"""Ranges in floating point, operation by operation: both parts of an error, typed or worked out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.ranges import RangeError, RangeValue, analyse
from esea_gen.emit.walker import Kernel, Node

F32, F64, U = FORMATS["f32"], FORMATS["f64"], 2.0**-24
TINY = float(np.finfo(np.float32).smallest_subnormal)


def kernel_of(op: str, *numbers: float, count: int = 1) -> Kernel:
    """One operation of two-element arguments' second elements, then of numbers."""
    given = [Node("input", source=(k, 1)) for k in range(count)]
    constants = [Node("const", value=v) for v in numbers]
    args = tuple(range(count + len(numbers)))
    return Kernel("f", (*given, *constants, Node(op, args)), ((len(args),),))


def value(op: str, *given: RangeValue, numbers=(), fmt=F64) -> RangeValue:
    """What one operation makes; the first element of every argument is another."""
    kernel = kernel_of(op, *numbers, count=len(given))
    other = RangeValue(-77.0, 78.0, 7.0, 0.75)
    return analyse(kernel, fmt, [[other, g] for g in given]).results[0][0]


def parts(v: RangeValue) -> tuple[float, float, float, float]:
    return v.low, v.high, v.a, v.r


RIGHT, LEFT = RangeValue(0.5, 2.0, 0.1, 0.2), RangeValue(-5.0, -3.0, 0.3, 0.1)
FAR, ACROSS = RangeValue(3.0, 5.0, 0.3, 0.1), RangeValue(-1.5, 2.0, 0.1, 0.2)


@pytest.mark.parametrize(
    ("op", "given", "expected"),
    [
        # Of one sign shares stay shares; else 0.1 + 0.2 * 2 and 0.3 + 0.1 * 5 add up.
        ("add", (RIGHT, FAR), (3.5, 7, 0.4, 0.2)),
        ("add", (FAR, RIGHT), (3.5, 7, 0.4, 0.2)),
        ("add", (LEFT, LEFT), (-10, -6, 0.6, 0.1)),
        ("add", (RIGHT, LEFT), (-4.5, -1, 1.3, 0)),
        # A share of all of a sum is kept up to twice what the operands err by.
        ("add", (RangeValue(0, 0.9), RangeValue(0, 1, 0, 0.1)), (0, 1.9, 0, 0.1)),
        ("add", (RangeValue(0, 90), RangeValue(0, 100, 0, 0.1)), (0, 190, 0, 0.1)),
        ("add", (RangeValue(0, 1.1), RangeValue(0, 1, 0, 0.1)), (0, 2.1, 0.1, 0)),
        ("add", (RangeValue(0, 0, 0.1), RangeValue(1.5, 1.5, 0, 0.1)), (1.5, 1.5, 0.1, 0.1)),
        ("sub", (RIGHT, FAR), (-4.5, -1, 1.3, 0)),
        ("sub", (FAR, RIGHT), (1, 4.5, 1.3, 0)),
        ("sub", (RIGHT, LEFT), (3.5, 7, 0.4, 0.2)),
        # (x + e)(y + f) - x y, of the largest x and y: 2 f 1.2 + 5 e 1.1 + e f.
        ("mul", (RIGHT, FAR), (1.5, 10, 0.72 + 0.55 + 0.03, 0.32)),
        ("mul", (FAR, RIGHT), (1.5, 10, 1.3, 0.32)),
        ("mul", (RIGHT, LEFT), (-10, -1.5, 1.3, 0.32)),
        ("mul", (ACROSS, LEFT), (-10, 7.5, 1.3, 0.32)),
        ("mul", (LEFT, LEFT), (9, 25, 1.65 + 1.65 + 0.09, 0.21)),
        ("sq", (RIGHT,), (0.25, 4, 0.24 + 0.24 + 0.01, 0.44)),
        ("sq", (ACROSS,), (0, 4, 0.49, 0.44)),
        ("sq", (LEFT,), (9, 25, 3.39, 0.21)),
        # Divided by no less than 3 (1 - 0.1 - 0.3 / 3).
        ("div", (RIGHT, FAR), (0.1, 2 / 3, 0.1 / 2.4, 0.4 / 0.8)),
        ("div", (ACROSS, LEFT), (-2 / 3, 0.5, 0.1 / 2.4, 0.4 / 0.8)),
        ("inv", (FAR,), (0.2, 1 / 3, 0, 0.2 / 0.8)),
        ("inv", (LEFT,), (-1 / 3, -0.2, 0, 0.2 / 0.8)),
        ("neg", (RIGHT,), (-2, -0.5, 0.1, 0.2)),
        ("twice", (ACROSS,), (-3, 4, 0.2, 0.2)),
        ("fabs", (ACROSS,), (0, 2, 0.1, 0.2)),
        ("fabs", (LEFT,), (3, 5, 0.3, 0.1)),
        ("fabs", (RIGHT,), (0.5, 2, 0.1, 0.2)),
        *(
            (op, (RangeValue(-0.5, 0.25),), (0, top, 0, 0))
            for op, top in (("fabs", 0.5), ("sq", 0.25))
        ),
        ("fabs", (FAR,), (3, 5, 0.3, 0.1)),
        # exp(x + 0.5) - exp(x) as a share; tanh and log by their largest slopes, at x and below.
        ("exp", (RIGHT,), (math.exp(0.5), math.exp(2), 0, math.expm1(0.5))),
        ("tanh", (LEFT,), (math.tanh(-5), math.tanh(-3), 0.8, 0)),
        ("log", (FAR,), (math.log(3), math.log(5), 0.8 / 2.2, 0)),
        ("sqrt", (FAR,), (math.sqrt(3), math.sqrt(5), 0.8 / math.sqrt(3), 0)),
        ("sqrt", (RangeValue(0, 4, 0.25, 0.0),), (0, 2, 0.5, 0)),
        ("sqrt", (RangeValue(0.25, 4, 0.01, 0.0),), (0.5, 2, 0.02, 0)),
        ("sqrt", (RangeValue(0.01, 4, 0.25, 0.0),), (0.1, 2, 0.5, 0)),
    ],
)
def test_both_parts_of_an_error(op, given, expected):
    assert parts(value(op, *given)) == pytest.approx(expected, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize(
    ("x", "c", "a", "r"),
    [
        # The largest argument is 2 (1 + 0.2) + 0.1.
        (RIGHT, 2.5, 2.5 * 2.5**1.5 * 0.1, 1.2**2.5 - 1),
        (RIGHT, 1.0, 0.1, 0.2),
        (RIGHT, 1.5, 1.5 * 2.5**0.5 * 0.1, 1.2**1.5 - 1),
        # The least, 0.5 (1 - 0.2) - 0.1, bounds a root's slope; else the root of the error does.
        (RIGHT, 0.5, 0.5 * 0.3**-0.5 * 0.1, 1 - 0.8**0.5),
        (RangeValue(0.5, 2.0, 0.3, 0.2), 0.25, 0.25 * 0.1**-0.75 * 0.3, 1 - 0.8**0.25),
        (RangeValue(0.5, 2.0, 0.39, 0.2), 0.25, 0.39**0.25, 1 - 0.8**0.25),
        (RangeValue(0.5, 2.0, 0.41, 0.2), 0.25, 0.41**0.25, 1 - 0.8**0.25),
        (RangeValue(0.0, 2.0, 0.1, 0.2), 0.5, 0.1**0.5, 1 - 0.8**0.5),
        # A share of one and more leaves nothing below, and above it may be more than all.
        (RangeValue(0.0, 2.0, 0.1, 1.25), 0.5, 0.1**0.5, 1.0),
        (RangeValue(0.0, 2.0, 0.1, 1.0), 0.5, 0.1**0.5, 1.0),
        (RangeValue(0.0, 2.0, 0.1, 8.0), 0.5, 0.1**0.5, 2.0),
    ],
)
def test_both_parts_of_a_powers_error(x, c, a, r):
    found = value("pow", x, numbers=(c,))
    assert parts(found) == pytest.approx((x.low**c, x.high**c, a, r), rel=1e-12, abs=1e-14)


@pytest.mark.parametrize(
    ("op", "ends"),
    [
        ("add", (-5, 9)),
        ("sub", (-8, 6)),
        ("mul", (-15, 20)),
        ("fmin", (-3, 4)),
        ("fmax", (-2, 5)),
        ("sq", (0, 16)),
        ("twice", (-6, 8)),
        ("neg", (-4, 3)),
        ("fabs", (0, 4)),
        ("sign", (-1, 1)),
    ],
)
def test_ends_of_whole_numbers(op, ends):
    given = [RangeValue(-3.0, 4.0, whole=True), RangeValue(-2.0, 5.0, whole=True)]
    found = value(op, *given[: 2 if op in ("add", "sub", "mul", "fmin", "fmax") else 1], fmt=F32)
    assert (*parts(found), found.whole) == (*ends, 0, 0, True)
    assert (found.computed_low, found.computed_high) == ends


# -- one of two ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "y", "a", "r"),
    [
        # One of the two is the worse in both parts, or in one, the other being alike.
        ((0.1, 0.2), (0.3, 0.4), 0.3, 0.4),
        ((0.1, 0.2), (0.1, 0.4), 0.1, 0.4),
        ((0.1, 0.2), (0.3, 0.2), 0.3, 0.2),
        # Else the larger at the largest that there is: 3, 2 and 4.
        ((0.1, 0.2), (0.15, 0.1), {3: 0.7, 2: 0.5, 4: 0.9}, 0.0),
        ((0.1, 0.2), (0.65, 0.1), {3: 0.95, 2: 0.85, 4: 1.05}, 0.0),
        ((0.1, 0.4), (1.0, 0.1), {3: 1.3, 2: 1.2, 4: 1.7}, 0.0),
    ],
)
def test_one_of_two_errs_by_the_worse(x, y, a, r):
    cases = (
        # Ends of the result of -3 to 1 and -2 to 2; and of -2 to 4 and -1 to 3.
        ((-3.0, 1.0), (-2.0, 2.0), {"fmin": (-3, 1, 3), "fmax": (-2, 2, 2), "select": (-3, 2, 3)}),
        ((-2.0, 4.0), (-1.0, 3.0), {"fmin": (-2, 3, 3), "fmax": (-1, 4, 4), "select": (-2, 4, 4)}),
    )
    for mine, other, by_op in cases:
        first, second = RangeValue(*mine, *x), RangeValue(*other, *y)
        for op, (low, high, size) in by_op.items():
            wanted = (low, high, a[size] if isinstance(a, dict) else a, r)
            open_ = (RangeValue(0, 1),) if op == "select" else ()
            for pair in ((first, second), (second, first)):
                found = value(op, *open_, *pair)
                assert parts(found) == pytest.approx(wanted, rel=1e-12), (op, pair)


def test_a_choice_of_something_or_nothing():
    x = RangeValue(2.0, 3.0, 0.1, 0.2)
    for condition, ends in ((RangeValue(0, 1), (0, 3)), (RangeValue(1, 1), (2, 3))):
        found = value("if_else_zero", condition, x)
        assert parts(found) == (*ends, 0.1, 0.2)
    assert parts(value("if_else_zero", RangeValue(0, 0), x)) == (0, 0, 0, 0)
    # A condition that is one number, though neither 0 nor 1, is none that is known.
    assert parts(value("if_else_zero", RangeValue(0.5, 0.5), x)) == (0, 3, 0.1, 0.2)
    three = [RangeValue(2.0, 3.0, 0.1), RangeValue(5.0, 7.0, 0.2)]
    assert parts(value("select", RangeValue(1, 1), *three)) == (2, 3, 0.1, 0)
    assert parts(value("select", RangeValue(0, 0), *three)) == (5, 7, 0.2, 0)


def test_the_computed_interval_of_one_of_two():
    x = RangeValue(1.0, 4.0, 1.0, 0.0, 0.5, 4.25)
    y = RangeValue(2.0, 3.0, 1.0, 0.0, 1.75, 3.5)
    for op, ends in (("fmin", (0.5, 3.5)), ("fmax", (1.75, 4.25)), ("select", (0.5, 4.25))):
        open_ = (RangeValue(0, 1),) if op == "select" else ()
        for pair in ((x, y), (y, x)):
            found = value(op, *open_, *pair)
            assert (found.computed_low, found.computed_high) == ends


def test_a_sign_that_may_be_none_may_be_wrong():
    # Computed inside its range too, up to zero: -1 and 0 may stand for each other.
    for low, high in ((-1.0, 0.0), (0.0, 1.0)):
        found = value("sign", RangeValue(low, high, 0.5, 0.0, low, high))
        assert (found.low, found.high, found.error, found.whole) == (low, high, 2, False)
    for low, high in ((-1.0, -0.25), (0.25, 1.0)):
        found = value("sign", RangeValue(low, high, 0.5, 0.0, low, high))
        assert (found.low, found.high, found.error, found.whole) == (
            *[math.copysign(1, low)] * 2,
            0,
            True,
        )


# -- what an operation rounds itself ---------------------------------------------------------------


def test_what_has_an_error_is_rounded_with_it():
    # In f32 beside an error of a few units: e (1 + u) + u, where e alone or u alone would show.
    large = RangeValue(1.0, 1.0, 0.5, 0.25)
    exact = RangeValue(1.0, 1.0)
    found = value("mul", large, exact, fmt=F32)
    assert found.a - 0.5 == pytest.approx(0.5 * U, rel=1e-6)
    assert found.r - 0.25 == pytest.approx(1.25 * U, rel=1e-6)
    for op, ulp in (("exp", 0.51), ("tanh", 0.52)):
        small = value(op, RangeValue(1.0, 1.0, 0.5), fmt=F32)
        plain = value(op, RangeValue(1.0, 1.0, 0.5))
        off = 2 * ulp * U
        assert small.r == pytest.approx(plain.r * (1 + off) + off, rel=1e-12)
        assert small.a == pytest.approx(plain.a * (1 + off), rel=1e-12, abs=1e-44)
    # Nothing is smaller than the smallest number there is.
    for op in ("add", "sub", "mul"):
        assert TINY <= value(op, RangeValue(0, 1), exact, fmt=F32).a <= TINY * (1 + 2 * U)


@pytest.mark.parametrize("op", ["exp", "log", "sqrt", "tanh"])
def test_the_platforms_functions_err_by_one_unit_in_the_last_place(op):
    found = value(op, RangeValue(1.5, 1.5))
    assert found.r == pytest.approx(2 * 2.0**-53, rel=1e-9, abs=0)
    # Double precision's smallest number.
    assert 0 < found.a <= 2 * 2.0**-1074


def test_the_platforms_power_errs_by_one_unit_and_has_its_exponent_whole():
    # 0.3 has no 27 bits; from 1e-3 on a power with it would err by the logarithm's share.
    near = value("pow", RangeValue(1e-3, 2.0), numbers=(0.3,))
    assert near.r == pytest.approx(2 * 2.0**-53, rel=1e-9, abs=0)
    bits = abs(round(0.3 * 2**27) / 2**27 - 0.3)
    single = value("pow", RangeValue(1e-3, 2.0), numbers=(0.3,), fmt=F32)
    assert single.r == pytest.approx(2 * 0.51 * U + bits * math.log(1e3), rel=1e-6)
    # Beyond 1 the upper end's logarithm is the larger; from 0 on the least number's.
    for low, high, most in ((0.5, 90.0, 90.0), (0.0, 2.0, 1e45)):
        single = value("pow", RangeValue(low, high), numbers=(0.3,), fmt=F32)
        assert single.r == pytest.approx(2 * 0.51 * U + bits * math.log(most), rel=1e-5)
    assert value("pow", RangeValue(0.0, 0.0), numbers=(0.3,), fmt=F32).r < 2 * 0.52 * U


@pytest.mark.parametrize("number", [0.1, -0.1, 3.0, 2.0**24, 2.0**24 + 1, -(2.0**24), 0.5])
def test_a_number_is_the_nearest_of_the_format(number):
    kernel = Kernel("f", (Node("const", value=number),), ((0,),))
    found = analyse(kernel, F32, []).results[0][0]
    stored = float(np.float32(number))
    assert parts(found) == (number, number, abs(stored - number), 0)
    assert (found.computed_low, found.computed_high) == (stored, stored)
    assert found.whole is (number in (3.0, 2.0**24, -(2.0**24)))


# -- what is decided -------------------------------------------------------------------------------


def truth(op: str, x: RangeValue, y: RangeValue) -> tuple[float, float, bool]:
    found = analyse(kernel_of(op, count=2), F32, [[x, x], [y, y]])
    result = found.results[0][0]
    assert result.whole
    return result.low, result.high, bool(found.assumptions)


def test_what_is_computed_beyond_the_exact_interval_leaves_a_comparison_open():
    # 0 to 1, computed up to 1.5; 2 to 3, computed from 1.75 on; each alone is enough.
    wide, plain = RangeValue(0, 1, 0.5), RangeValue(0, 1)
    for op in ("lt", "le"):
        assert truth(op, wide, RangeValue(1.75, 3)) == (1, 1, False)
        assert truth(op, wide, RangeValue(1.25, 3)) == (0, 1, True)
        assert truth(op, plain, RangeValue(1.75, 3, 0.5)) == (1, 1, False)
        assert truth(op, plain, RangeValue(1.25, 3, 0.5)) == (0, 1, True)
        assert truth(op, RangeValue(1.75, 3), wide) == (0, 0, False)
        assert truth(op, RangeValue(1.25, 3), wide) == (0, 1, True)
        assert truth(op, RangeValue(1.75, 3, 0.5), plain) == (0, 0, False)
        assert truth(op, RangeValue(1.25, 3, 0.5), plain) == (0, 1, True)
    # Touching: a half closes what is a half apart.
    assert truth("le", wide, RangeValue(1.5, 3)) == (1, 1, False)
    assert truth("lt", wide, RangeValue(1.5, 3)) == (0, 1, True)
    assert truth("lt", RangeValue(1.5, 3), wide) == (0, 0, False)
    assert truth("le", RangeValue(1.5, 3), wide) == (0, 1, True)
    # Equal or not is told by no interval.
    for op in ("eq", "ne"):
        assert truth(op, plain, RangeValue(5, 6)) == (0, 1, False)
        assert truth(op, plain, RangeValue(5, 6, 0.5)) == (0, 1, True)
        assert truth(op, wide, RangeValue(5, 6)) == (0, 1, True)


YES, NO, OPEN = RangeValue(1, 1), RangeValue(0, 0), RangeValue(0, 1)


@pytest.mark.parametrize(
    ("x", "y", "both", "either"),
    [
        (YES, YES, (1, 1), (1, 1)),
        (YES, NO, (0, 0), (1, 1)),
        (YES, OPEN, (0, 1), (1, 1)),
        (NO, NO, (0, 0), (0, 0)),
        (NO, OPEN, (0, 0), (0, 1)),
        (OPEN, OPEN, (0, 1), (0, 1)),
    ],
)
def test_logic_of_conditions(x, y, both, either):
    for pair in ((x, y), (y, x)):
        for op, ends in (("and", both), ("or", either)):
            found = value(op, *pair)
            assert (found.low, found.high, found.whole) == (*ends, True)
    inverse = value("not", x)
    assert (inverse.low, inverse.high, inverse.whole) == (1 - x.high, 1 - x.low, True)


def test_only_decisions_that_a_number_needs_are_named():
    # v2 leads to a word, v4 to a word and by a choice to a number; v5 is decided.
    rough = RangeValue(0, 1, 0.1)
    nodes = (
        Node("input"),
        Node("input", source=(0, 1)),
        Node("lt", (0, 1)),
        Node("const", value=9.0),
        Node("le", (1, 0)),
        Node("lt", (0, 3)),
        Node("select", (4, 0, 1)),
        Node("neg", (6,)),
        Node("select", (5, 7, 3)),
    )
    kernel = Kernel("g", nodes, ((2,), (8, 0), (4,)))
    for words, said in (
        ((0, 2), ("g: v4 = le",)),
        ((0,), ("g: v4 = le",)),
        ((2,), ("g: v2 = lt", "g: v4 = le")),
        ((), ("g: v2 = lt", "g: v4 = le")),
        ((0, 1, 2), ()),
    ):
        assert analyse(kernel, F32, [[rough, rough]], words).assumptions == said


def test_a_choice_in_two_halves_is_one_unless_it_is_said_to_be_fused():
    nodes = (
        Node("input"),
        Node("input", source=(0, 1)),
        Node("lt", (0, 1)),
        Node("if_else_zero", (2, 0)),
        Node("not", (2,)),
        Node("if_else_zero", (4, 1)),
        Node("add", (3, 5)),
    )
    given = [[RangeValue(2, 6), RangeValue(5, 7)]]
    for facts, ends in ((None, (2, 7)), ({}, (0, 13)), ({6: (1, 9)}, (1, 9))):
        (found,) = analyse(Kernel("f", nodes, ((6,),)), F32, given, (), facts).results[0]
        assert (found.low, found.high) == ends


def test_a_sum_is_compared_with_zero_by_its_sign():
    exact, rough = RangeValue(-1, 1), RangeValue(-1, 1, 0.1)

    def asked(summed: str, compare: str, number: float, turned: bool, *given: RangeValue) -> bool:
        nodes = (
            Node("input"),
            Node("input", source=(0, 1)),
            Node(summed, (0, 1)),
            Node("const", value=number),
            Node(compare, (3, 2) if turned else (2, 3)),
        )
        return bool(analyse(Kernel("f", nodes, ((4,),)), F32, [list(given)]).assumptions)

    for turned in (False, True):
        for compare in ("lt", "le", "eq", "ne"):
            for summed in ("add", "sub"):
                assert not asked(summed, compare, 0.0, turned, exact, exact)
                assert asked(summed, compare, 0.0, turned, exact, rough)
                assert asked(summed, compare, 0.0, turned, rough, exact)
                assert asked(summed, compare, 0.25, turned, exact, exact)
            assert asked("mul", compare, 0.0, turned, exact, exact)
    # Two sums beside each other, or a sum beside a zero that is computed, tell no sign.
    nodes = (
        Node("input"),
        Node("input", source=(0, 1)),
        Node("add", (0, 1)),
        Node("sub", (0, 1)),
        Node("lt", (2, 3)),
    )
    assert analyse(Kernel("f", nodes, ((4,),)), F32, [[exact, exact]]).assumptions


# -- ends ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("op", "given", "words"),
    [
        ("div", (RIGHT, RangeValue(0.0, 1.0)), r"holds zero: \[0, 1\]"),
        ("div", (RIGHT, RangeValue(-1.0, 0.0)), r"holds zero: \[-1, 0\]"),
        ("div", (RIGHT, RangeValue(2.0, 3.0, 1.0, 0.5)), "whose error is as large as itself"),
        ("log", (RangeValue(0.5, 2.0, 0.5),), "log of a range that reaches zero"),
        ("sqrt", (RangeValue(-0.1, 2.0),), "sqrt of a range that reaches zero"),
        ("add", (RangeValue(0, 1, math.inf), RIGHT), r"f: value v0 \(input\) has no finite range"),
        ("add", (RIGHT, RangeValue(0, math.inf)), r"f: value v1 \(input\) has no finite range"),
        ("neg", (RangeValue(-math.inf, 0),), r"f: value v0 \(input\) has no finite range"),
        ("atan", (RIGHT,), "f: no range rule for 'atan'"),
        ("pow", (RIGHT, FAR), "f: a power with an exponent that is not constant"),
    ],
)
def test_what_has_no_bound(op, given, words):
    with pytest.raises(RangeError, match=words):
        value(op, *given)


def test_hardly_inside_there_is_one():
    assert value("div", RIGHT, RangeValue(2.0, 3.0, 0.98, 0.5)).r == pytest.approx(1.19 / 0.01)
    assert value("log", RangeValue(0.5, 2.0, 0.49)).a == pytest.approx(49.0)
    for c, words in ((0.0, "positive"), (-1.0, "positive")):
        with pytest.raises(RangeError, match=words):
            value("pow", RIGHT, numbers=(c,))
    with pytest.raises(RangeError, match="positive"):
        value("pow", ACROSS, numbers=(2.0,))
    assert value("pow", RangeValue(0.0, 2.0), numbers=(2.0,)).high == 4
