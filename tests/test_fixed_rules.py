"""What each whole-number operation says of itself: its format, its range, and the error it adds."""

from __future__ import annotations

import operator
from fractions import Fraction

import casadi as ca
import mpmath
import numpy as np
import pytest

from esea_gen.emit.fixed.lowering import lower, rewrite
from esea_gen.emit.fixed.plan import lowered_values
from esea_gen.emit.fixed.values import Source, Target
from esea_gen.emit.walker import fuse_selects, walk

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
WORD = 2**31
# Fraction bits and raw ends.  ``fine`` has more bits than its sum with ``coarse`` can keep.
RANGES = {
    "fine": (30, -WORD, WORD - 1),
    "coarse": (27, -1_000_000_007, 1_999_999_999),
    "above": (28, 200_000_003, 1_800_000_001),  # 0.75 to 6.7
    "below": (28, -1_800_000_001, -200_000_003),
    "deep": (28, -2_100_000_003, -100_000_007),  # -7.8; less the least of above it is beyond 8
    "small": (31, -3_000_017, 2_999_999),
    "short": (20, -3_000_017, 2_999_999),
}
COUNT = 400


class Found:
    """One operation in whole numbers, over random operands and their ends."""

    def __init__(self, expression, x: str, y: str, wide: bool, fact=None) -> None:
        kernel = rewrite(fuse_selects(walk(ca.Function("f", [X, Y], [expression]))))
        self.given = [RANGES[x], RANGES[y]]

        def source(argument: int, _element: int) -> Source:
            fraction, low, high = self.given[argument]
            return Source(f"x{argument}", f"in->x{argument}", fraction, low, high, "x")

        target = [[Target("y", 31, -WORD, WORD - 1, False)]]
        nodes = range(len(kernel.nodes)) if wide else ()
        (node,) = kernel.results[0]
        facts = {node: fact} if fact else {}
        lowered = lower(kernel, source, target, facts=facts, wide=nodes, block="tried")
        rng = np.random.default_rng(5)
        raws = [
            np.array([low, high, high, low, *rng.integers(low, high + 1, COUNT).tolist()], object)
            for _, low, high in self.given
        ]
        raws[1][:4] = [raws[1][0], raws[1][1], raws[1][0], raws[1][1]]
        values = lowered_values(lowered, {f"in->x{k}": r for k, r in enumerate(raws)}, len(raws[0]))
        self.at = [
            [Fraction(int(r)) / 2**f for r in column]
            for column, (f, _, _) in zip(raws, self.given, strict=True)
        ]
        self.value = lowered.values[node]
        self.raw = [int(r) for r in values[node]]
        self.bits = self.value.expr.bits

    def errors(self, exact) -> tuple[list, list]:
        """Exact results, and how far the whole numbers are off."""
        wanted = [exact(a, b) for a, b in zip(*self.at, strict=True)]
        unit = Fraction(2) ** -self.value.fraction
        return wanted, [abs(r * unit - w) for r, w in zip(self.raw, wanted, strict=True)]


def finest(values, most: int) -> int:
    """Most fraction bits with which all values still fit."""
    size, f = max(abs(v) for v in values), 0
    while size * Fraction(2) ** (f + 1) <= most:
        f += 1
    while size * Fraction(2) ** f > most:
        f -= 1
    return f


C = 0.3  # no sum of few powers of two

# Expression, exact, error of the stored constant per unit of it, bits that would lose nothing: a
# constant from 0.25 to 0.5 has 32 of its own.
RATIONAL = [
    (X + Y, lambda a, b: a + b, None, max),
    (X - Y, lambda a, b: a - b, None, max),
    (X + C, lambda a, b: a + Fraction(C), lambda a, b: 1, lambda p, q: p),
    (X * Y, lambda a, b: a * b, None, lambda p, q: p + q),
    (X * C, lambda a, b: a * Fraction(C), lambda a, b: abs(a), lambda p, q: p + 32),
    (X / 3, lambda a, b: a / 3, None, lambda p, q: p + 32),
    (X / Y, lambda a, b: a / b, None, None),
    (1 / Y, lambda a, b: 1 / b, None, None),
    (C / Y, lambda a, b: Fraction(C) / b, lambda a, b: 1 / abs(b), None),
]
PAIRS = [
    ("fine", "above"),
    ("coarse", "below"),
    ("small", "above"),
    ("above", "below"),
    ("short", "above"),
]


# Sums and products of what has no bits left over, or hardly any size.
MORE = [(r, x, y) for r in RATIONAL[:4] for x, y in (("deep", "above"), ("small", "small"))]


@pytest.mark.parametrize("wide", [False, True], ids=["32", "64"])
@pytest.mark.parametrize(
    ("rule", "x", "y"),
    [*((r, *p) for r in RATIONAL for p in PAIRS), *MORE],
    ids=lambda x: str(x[0]) if isinstance(x, tuple) else x,
)
def test_arithmetic_keeps_the_error_it_states_and_is_as_fine_as_fits(rule, x, y, wide):
    expression, exact, of_constant, whole = rule
    divided = expression.is_op(ca.OP_DIV) or expression.is_op(ca.OP_INV)
    found = Found(expression, x, y, wide)
    value = found.value
    wanted, errors = found.errors(exact)
    stored = max(value.constants.values(), default=0.0)
    assert (stored > 0) <= (of_constant is not None)
    bounds = [
        value.local
        + value.relative * abs(float(w))
        + (stored * float(of_constant(a, b)) if of_constant else 0.0)
        for w, a, b in zip(wanted, *found.at, strict=True)
    ]
    assert all(float(e) <= s * (1 + 1e-9) for e, s in zip(errors, bounds, strict=True))
    # Hundreds of operands come near it; a quotient's own share of the error is only a bound.
    loose = 0.1 if divided else 0.5
    assert max(map(float, errors)) >= loose * max(bounds)
    # Its range is that of the exact result, and no finer format would hold that.
    room = 2 * Fraction(2) ** -value.fraction + Fraction(max(bounds))
    assert abs(value.low - min(wanted)) <= room
    assert abs(value.high - max(wanted)) <= room
    best = finest(wanted, 2**61 - 1 if wide else WORD - 1)
    if whole is not None:
        best = min(best, whole(*(f for f, _, _ in found.given)))
    assert best - 1 <= value.fraction <= best
    assert found.bits == (64 if wide else 32)


@pytest.mark.parametrize("power", [31, 60, 61, 62, 70, 80])
def test_a_power_of_two_so_small_that_no_format_has_its_bits_is_a_number_like_any_other(power):
    found = Found(X * 2.0**-power, "fine", "above", False)
    assert found.value.fraction == min(30 + power, 90)
    error = float(max(found.errors(lambda a, b: a / 2**power)[1]))
    # Below the last of 90 bits its own rounding counts, for operands up to 2.
    assert error <= 2 * max(found.value.constants.values(), default=0.0)
    assert (error == 0) == (power <= 60)


@pytest.mark.parametrize("wide", [False, True], ids=["32", "64"])
@pytest.mark.parametrize(("x", "y"), [*PAIRS, ("above", "short"), ("below", "small")])
def test_what_loses_nothing_says_so_and_what_must_be_cut_is_cut_once(x, y, wide):
    # A change of sign or of the binary point keeps every bit.
    for expression, exact in (
        (X * 0.25, lambda a, b: a / 4),
        (X * -0.25, lambda a, b: -a / 4),
        (X * 8, lambda a, b: 8 * a),
        (X / 4, lambda a, b: a / 4),
        (X / -0.5, lambda a, b: -2 * a),
        (2 * X, lambda a, b: 2 * a),
    ):
        found = Found(expression, x, y, wide)
        assert (found.value.local, found.value.relative, dict(found.value.constants)) == (0, 0, {})
        assert max(found.errors(exact)[1]) == 0
    # A magnitude does, but where the word has no room for that of its least number.
    found = Found(ca.fabs(X), x, y, wide)
    _, errors = found.errors(lambda a, b: abs(a))
    lost = x == "fine" and not wide
    assert bool(found.value.local) == lost
    assert float(max(errors)) == found.value.local
    # The lesser, the greater, either: off by half a unit where an operand is finer than the result.
    for expression, exact in (
        (ca.fmin(X, Y), min),
        (ca.fmax(X, Y), max),
        (ca.fmin(X, C), lambda a, b: min(a, Fraction(C))),
        (ca.fmax(X, C), lambda a, b: max(a, Fraction(C))),
        (ca.if_else(X > 0.125, X, Y), lambda a, b: a if a > 0.125 else b),
        (ca.if_else(X > 0.125, X, 0), lambda a, b: a if a > 0.125 else Fraction(0)),
    ):
        found = Found(expression, x, y, wide)
        _, errors = found.errors(exact)
        assert found.value.local == found.value.relative == 0
        bound = max(found.value.constants.values(), default=0.0)
        assert float(max(errors)) <= bound
        assert bound <= 2.0**-found.value.fraction


@pytest.mark.parametrize("wide", [False, True], ids=["32", "64"])
@pytest.mark.parametrize(
    ("expression", "exact", "x", "loose"),
    [
        (ca.sqrt(X), mpmath.sqrt, "above", 0.2),
        (ca.exp(X), mpmath.exp, "above", 0.15),
        (ca.exp(X), mpmath.exp, "below", 0.15),
        (ca.exp(X), mpmath.exp, "short", 0.15),
        (ca.log(X), mpmath.log, "above", 0.1),
        (ca.tanh(X), mpmath.tanh, "coarse", 0.1),
        (X**0.75, lambda v: v ** mpmath.mpf(0.75), "above", 0.1),
        (X**2.25, lambda v: v ** mpmath.mpf(2.25), "above", 0.1),
    ],
)
def test_functions_keep_the_error_they_state(expression, exact, x, loose, wide):
    found = Found(expression + 0 * Y, x, "above", wide)
    value = found.value
    with mpmath.workdps(40):
        wanted, errors = found.errors(lambda a, b: _rational(exact(_real(a))))
    bounds = [value.local + value.relative * abs(float(w)) for w in wanted]
    assert all(float(e) <= s for e, s in zip(errors, bounds, strict=True))
    assert max(map(float, errors)) >= loose * max(bounds)
    unit = Fraction(2) ** -value.fraction
    assert value.low <= min(wanted) + 2 * unit
    assert max(wanted) - 2 * unit <= value.high
    assert float(value.high - value.low) <= 1.01 * float(max(wanted) - min(wanted)) + 2e-6


def _real(x: Fraction) -> mpmath.mpf:
    return mpmath.mpf(x.numerator) / x.denominator


def _rational(x: mpmath.mpf) -> Fraction:
    sign, mantissa, exponent, _ = x._mpf_
    return (-1) ** sign * Fraction(int(mantissa)) * Fraction(2) ** exponent


COMPARISONS = [getattr(operator, name) for name in ("lt", "le", "gt", "ge", "eq", "ne")]
ON, OFF, BEYOND = 0.125, 0.3, 900.0  # a number of every format here; of none; outside of all


@pytest.mark.parametrize("x", ["fine", "coarse", "short", "below"])
def test_comparisons_with_numbers_decide_as_the_exact_values_do(x):
    fraction, low, high = RANGES[x]
    for c in (ON, OFF, -OFF, BEYOND, -BEYOND, float(Fraction(low) / 2**fraction)):
        near = round(Fraction(c) * 2**fraction)
        raws = [v for v in (near - 1, near, near + 1, low, high) if low <= v <= high]
        for compare in COMPARISONS:
            assert decided(compare(X, c), x, "fine", raws, raws) == [
                compare(Fraction(v) / 2**fraction, c) for v in raws
            ], (compare, c)


@pytest.mark.parametrize(("x", "y"), [("coarse", "fine"), ("fine", "coarse"), ("short", "small")])
def test_comparisons_of_two_values_lose_no_bit(x, y):
    f, g = RANGES[x][0], RANGES[y][0]
    tie = Fraction(1, 1024)
    pairs = [(int(tie * 2**f) + i, int(tie * 2**g) + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    for compare in COMPARISONS:
        assert decided(compare(X, Y), x, y, *zip(*pairs, strict=True)) == [
            compare(Fraction(a) / 2**f, Fraction(b) / 2**g) for a, b in pairs
        ]


def decided(expression, x, y, xs, ys) -> list[bool]:
    """Truth of a comparison for these raw numbers."""
    kernel = rewrite(fuse_selects(walk(ca.Function("f", [X, Y], [expression]))))

    def source(argument: int, _element: int) -> Source:
        return Source(f"x{argument}", f"in->x{argument}", *RANGES[(x, y)[argument]], "x")

    target = [[Target("y", 0, -WORD, WORD - 1, False)]]
    lowered = lower(kernel, source, target, block="tried")
    places = {"in->x0": np.array(xs, object), "in->x1": np.array(ys, object)}
    values = lowered_values(lowered, places, len(xs))
    (node,) = kernel.results[0]
    return [bool(v) for v in values[node]]


@pytest.mark.parametrize("wide", [False, True], ids=["32", "64"])
@pytest.mark.parametrize("fact", [(-1.0, 0.7), (-0.3, 1.0)])
def test_a_fact_of_algebra_cuts_the_value_and_makes_its_format_finer(fact, wide):
    low, high = (Fraction(x) for x in fact)
    for expression, exact in (
        (X + Y, lambda a, b: a + b),
        (X * Y, lambda a, b: a * b),
        (X / Y, lambda a, b: a / b),
        (X / 3, lambda a, b: a / 3),
    ):
        known = Found(expression, "coarse", "above", wide, fact)
        plain = Found(expression, "coarse", "above", wide)
        unit = Fraction(2) ** -known.value.fraction
        assert abs(known.value.low - max(low, plain.value.low)) <= unit
        assert abs(known.value.high - min(high, plain.value.high)) <= unit
        assert known.value.fraction >= plain.value.fraction + (not wide)
        wanted, errors = known.errors(exact)
        inside = [e for w, e in zip(wanted, errors, strict=True) if low <= w <= high]
        assert len(inside) > 5
        assert float(max(inside)) <= known.value.local + known.value.relative
        # What exact arithmetic never gives is cut to the nearest that it may.
        for w, r in zip(wanted, known.raw, strict=True):
            if w > high or w < low:
                assert abs(r * unit - (high if w > high else low)) <= unit
