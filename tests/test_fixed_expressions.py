"""Whole-number expressions: intervals against every number there is, C against plain arithmetic."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import cffi
import numpy as np
import pytest

from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed import functions
from esea_gen.emit.fixed.expression import OverflowProofError
from esea_gen.hostlib.compiler import compile_sources

from .conftest import require_tool

SIDES = [(-5, 3), (2, 7), (-9, -4), (0, 6), (-3, 0)]


def halves_up(value: int, shift: int) -> int:
    """A number over a power of two, the nearest whole one, a half upwards."""
    return math.floor(Fraction(value, 2**shift) + Fraction(1, 2))


def sides(bits_x: int = 32, bits_y: int = 32):
    """Every pair of the small intervals, as two reads."""
    for (a, b), (c, d) in itertools.product(SIDES, SIDES):
        yield ex.read("a", bits_x, a, b), ex.read("b", bits_y, c, d)


def every(x: ex.Expr, y: ex.Expr) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of numbers of two intervals."""
    pairs = list(itertools.product(range(x.low, x.high + 1), range(y.low, y.high + 1)))
    return tuple(np.array(column, dtype=object) for column in zip(*pairs, strict=True))


def held(e: ex.Expr, x: ex.Expr, y: ex.Expr, exact, room: tuple[int, int] = (0, 0)) -> None:
    """An expression gives what exact arithmetic does; its interval is at most ``room`` wider."""
    a, b = every(x, y)
    found = list(ex.evaluate(e, {"a": a, "b": b}, len(a)))
    assert found == [exact(int(p), int(q)) for p, q in zip(a, b, strict=True)]
    assert min(found) - room[0] <= e.low <= min(found)
    assert max(found) <= e.high <= max(found) + room[1]


@pytest.mark.parametrize("bits", [32, 64])
@pytest.mark.parametrize(
    ("build", "exact"),
    [
        (ex.add, lambda p, q: p + q),
        (ex.sub, lambda p, q: p - q),
        (ex.minimum, min),
        (ex.maximum, max),
        (lambda x, y, bits: ex.cast(ex.neg(x), bits), lambda p, q: -p),
        (lambda x, y, bits: ex.cast(ex.absolute(y), bits), lambda p, q: abs(q)),
        (lambda x, y, bits: ex.scale(x, 5, bits), lambda p, q: 32 * p),
        (lambda x, y, bits: ex.scale(y, 0, bits), lambda p, q: q),
        (lambda x, y, bits: ex.mul(x, y, 0, bits), lambda p, q: p * q),
        (lambda x, y, bits: ex.mul(x, y, 3, bits), lambda p, q: halves_up(p * q, 3)),
        (lambda x, y, bits: ex.cast(ex.clamp(x, -2, 2), bits), lambda p, q: max(-2, min(p, 2))),
    ],
)
def test_an_interval_is_that_of_every_number_there_is(build, exact, bits):
    for x, y in sides():
        e = build(x, y, bits)
        assert e.bits == bits
        # A product's rounding adds before it shifts: its interval may be a unit wider in 64 bits.
        held(e, x, y, exact, (0, 1) if bits == 64 and exact(8, 1) == 1 else (0, 0))


def test_the_square_of_a_number_is_not_below_zero_and_its_rest_is_rounded():
    for x, y in sides():
        held(ex.mul(x, x, 0, 64), x, y, lambda p, q: p * p)
        held(ex.mul(x, x, 2, 32), x, y, lambda p, q: halves_up(p * p, 2))
        for shift in (1, 2, 4):
            held(ex.round_shift(x, shift), x, y, lambda p, q, s=shift: halves_up(p, s), (1, 1))
            wide = ex.cast(x, 64)
            held(ex.round_shift(wide, shift), x, y, lambda p, q, s=shift: halves_up(p, s))
        # A shift beyond the word's own bits goes through 64.
        held(ex.round_shift(x, 40, 32), x, y, lambda p, q: halves_up(p, 40))
        assert ex.round_shift(x, 0) is x
        assert ex.round_shift(x, 31).op == "round"  # of a word of 32 bits
        assert ex.round_shift(x, 32).args[0].bits == 64


@pytest.mark.parametrize("shift", [1, 20, 31, 32, 33, 60, 94])
def test_products_of_64_bits_hold_every_result(shift):
    big = 2**shift // 3
    for ends in ((-big, 2 * big), (big, 3 * big), (-2 * big, -big)):
        low, high = (max(min(v, 2**60), -(2**60)) for v in ends)
        x = ex.read("a", 64, low, high)
        for c, d in SIDES:
            y = ex.read("b", 32, c, d)
            a = np.array([low, high, (low + high) // 2] * (d - c + 1), dtype=object)
            b = np.array([v for v in range(c, d + 1) for _ in range(3)], dtype=object)
            for e in (ex.mul(x, y, shift, 64), ex.mul(y, x, shift, 64)):
                found = list(ex.evaluate(e, {"a": a, "b": b}, len(a)))
                assert found == [halves_up(int(p * q), shift) for p, q in zip(a, b, strict=True)]
                # Wider by the partial products' units: three steps of 2^(32 - shift), or one.
                room = 5 << max(32 - shift, 0)
                assert min(found) - room <= e.low <= min(found)
                assert max(found) <= e.high <= max(found) + room
                if c >= 0 and low >= 0:
                    assert e.low >= 0
                assert e.args[0].bits == 64
                assert e.args[1].bits == 32


@pytest.mark.parametrize("shift", [33, 50, 63, 65, 90, 126])
def test_products_of_twice_64_bits_hold_every_result(shift):
    big = min(2 ** (shift // 2 + 1), 2**61)
    for (low, high), (c, d) in itertools.product([(-big, big), (big // 2, big)], repeat=2):
        x, y = ex.read("a", 64, low, high), ex.read("b", 64, c, d)
        ends = [(p, q) for p in (low, high, 1 + low // 3) for q in (c, d, 1 + d // 3)]
        a, b = (np.array(v, dtype=object) for v in zip(*ends, strict=True))
        e = ex.mul(x, y, shift, 64)
        found = list(ex.evaluate(e, {"a": a, "b": b}, len(a)))
        assert found == [halves_up(int(p * q), shift) for p, q in ends]
        room = 5 << max(64 - shift, 0)
        assert min(found[:8]) - room <= e.low <= min(found)
        assert max(found) <= e.high <= max(found) + room


# -- what is refused, and no sooner ----------------------------------------------------------------

M31, M63 = 2**31, 2**63


def fits(make, *arguments) -> bool:
    try:
        make(*arguments)
    except OverflowProofError:
        return False
    return True


def r(low: int, high: int, bits: int = 32) -> ex.Expr:
    return ex.read("a", bits, low, high)


@pytest.mark.parametrize(
    ("make", "inside", "outside"),
    [
        (ex.literal, (M31 - 1, -M31), (M31, -M31 - 1)),
        (lambda v: ex.literal(v, 64), (M63 - 1, -M63), (M63, -M63 - 1)),
        (lambda v: ex.literal(v, -32), (2**32 - 1, 0), (2**32, -1)),
        (lambda v: ex.literal(v, 1), (0, 1), (2, -1)),
        (lambda v: ex.add(r(0, 9), r(0, v), 32), (M31 - 10,), (M31 - 9,)),
        (lambda v: ex.add(r(-9, 0), r(v, 0), 32), (9 - M31,), (8 - M31,)),
        (lambda v: ex.sub(r(-9, 0), r(0, v), 32), (M31 - 9,), (M31 - 8,)),
        (lambda v: ex.neg(r(v, 0)), (1 - M31,), (-M31,)),
        (lambda v: ex.absolute(r(v, 0)), (1 - M31,), (-M31,)),
        (lambda v: ex.scale(r(0, v), 4, 32), (2**27 - 1,), (2**27,)),
        (lambda v: ex.scale(r(0, 1), v, 32), (1, 30), (31, 40)),
        (lambda v: ex.scale(r(0, 1), v, 64), (1, 62), (63, 70)),
        (lambda v: ex.round_shift(r(0, M63 - 9, 64), v), (4,), (5,)),
        (lambda v: ex.round_shift(r(0, 9, 64), v), (62,), (63, 64)),
        (lambda v: ex.cast(r(0, v, 64), 32), (M31 - 1,), (M31,)),
        (lambda v: ex.mul(r(0, 9), r(0, 9), v, 64), (0, 62), (63, -1)),
        (lambda v: ex.mul(r(0, 9, 64), r(0, 9), v, 64), (1, 94), (0, 95)),
        (lambda v: ex.mul(r(0, 9, 64), r(0, 9, 64), v, 64), (33, 63, 65, 126), (32, 64, 127)),
        (lambda v: ex.mul(r(0, v, 64), r(0, 9, 64), 90, 64), (2**62 - 1,), (2**62,)),
        (lambda v: ex.mul(r(-v, 0, 64), r(0, 9, 64), 90, 64), (2**62 - 1,), (2**62,)),
        # The high word, with its unit, must keep a bit to be rounded by: below 2^62.
        (lambda v: ex.mul(r(0, v, 64), r(-M31, 0), 40, 64), (2**62, M63 - 6), (M63 - 5, M63 - 1)),
        (lambda v: ex.flags(((r(0, 1, 1), v),)), (0, 31), (32,)),
        (lambda v: ex.call("sqrt", (r(0, 9),), 32, 0, v, 0), (M31 - 1,), (M31,)),
    ],
)
def test_what_could_leave_its_type_is_refused_and_nothing_else(make, inside, outside):
    assert [fits(make, v) for v in inside] == [True] * len(inside)
    assert [fits(make, v) for v in outside] == [False] * len(outside)


# -- decisions -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("op", "holds"),
    [
        ("lt", lambda p, q: p < q),
        ("le", lambda p, q: p <= q),
        ("eq", lambda p, q: p == q),
        ("ne", lambda p, q: p != q),
    ],
)
def test_a_comparison_is_a_number_only_where_every_pair_agrees(op, holds):
    intervals = [(0, 0), (1, 1), (0, 3), (3, 5), (-4, 0), (4, 6), (-1, 1)]
    for (a, b), (c, d) in itertools.product(intervals, repeat=2):
        x, y = ex.read("a", 32, a, b), ex.read("b", 64, c, d)
        e = ex.compare(op, x, y)
        left, right = every(x, y)
        truth = [int(holds(p, q)) for p, q in zip(left, right, strict=True)]
        if e.op == "literal":
            assert set(truth) == {e.data[0]}
        else:
            assert [z.bits for z in e.args] == [64, 64]
            assert list(ex.evaluate(e, {"a": left, "b": right}, len(left))) == truth
            assert (e.low, e.high, e.bits) == (0, 1, 1)
        # Nothing that intervals can tell is left open.
        assert (e.op == "literal") == (len(set(truth)) == 1)


def test_logic_leaves_out_what_is_known():
    p, q = (ex.read(n, 1, 0, 1) for n in "ab")
    yes, no = ex.literal(1, 1), ex.literal(0, 1)
    table = {
        ("and", yes, yes): 1,
        ("and", yes, no): 0,
        ("and", no, no): 0,
        ("or", no, no): 0,
        ("or", no, yes): 1,
        ("or", yes, yes): 1,
        ("and", no, p): 0,
        ("and", q, no): 0,
        ("or", yes, p): 1,
        ("or", p, yes): 1,
        ("not", yes): 0,
        ("not", no): 1,
    }
    for (op, *args), value in table.items():
        assert ex.logic(op, *args) == ex.literal(value, 1)
    assert ex.logic("and", yes, p) is ex.logic("and", p, yes) is p
    assert ex.logic("or", no, q) is ex.logic("or", q, no) is q
    a, b = (np.array(v, dtype=object) for v in ((0, 0, 1, 1), (0, 1, 0, 1)))
    for e, bits, truth in (
        (ex.logic("and", p, q), 1, [0, 0, 0, 1]),
        (ex.logic("or", p, q), 1, [0, 1, 1, 1]),
        (ex.logic("not", p), 1, [1, 1, 0, 0]),
        (ex.flags(((p, 0), (q, 3))), -32, [0, 8, 1, 9]),
        (ex.choose(p, ex.literal(-4), ex.literal(9), 32), 32, [9, 9, -4, -4]),
        (ex.choose(p, ex.literal(9), ex.literal(-4), 64), 64, [-4, -4, 9, 9]),
    ):
        assert list(ex.evaluate(e, {"a": a, "b": b}, 4)) == truth
        assert (e.low, e.high, e.bits) == (min(truth), max(truth), bits)
    assert ex.truth(p) is p
    number = ex.read("a", 32, -2, 2)
    values = np.array([-2, -1, 0, 1, 2], dtype=object)
    assert list(ex.evaluate(ex.truth(number), {"a": values}, 5)) == [1, 1, 0, 1, 1]
    sign = ex.Expr("sign", (number,), 32, -1, 1)
    assert list(ex.evaluate(sign, {"a": values}, 5)) == [-1, -1, 0, 1, 1]


def test_an_arm_counts_only_where_it_is_taken_and_a_broken_interval_is_found():
    x = ex.read("a", 32, -9, 9)
    low = ex.Expr("ref", (), 32, -9, 0, (), "a")  # holds only where the condition does
    e = ex.choose(ex.compare("le", x, ex.literal(0)), ex.neg(low), ex.literal(4), 32)
    given = np.array([-9, 0, 1, 9], dtype=object)
    assert list(ex.evaluate(e, {"a": given}, 4)) == [9, 0, 4, 4]
    assert (e.low, e.high) == (0, 9)
    small = ex.add(ex.read("a", 32, -1, 1), ex.literal(0), 32)
    assert list(ex.evaluate(small, {"a": np.array([-1, 1], dtype=object)}, 2)) == [-1, 1]
    for beyond in (-2, 2):
        with pytest.raises(OverflowProofError, match="left its proven interval"):
            ex.evaluate(small, {"a": np.array([0, beyond], dtype=object)}, 2)
    assert ex.names(ex.add(x, ex.neg(ex.read("b", 32, 0, 1)), 32)) == {"a", "b"}


# -- as C ------------------------------------------------------------------------------------------

A, B = ex.read("a", 32, -1000, 1000), ex.read("b", 32, -7, 900)
W, Z = ex.read("w", 64, -(2**40), 2**40), ex.read("z", 64, -(2**35), 2**36)
POSITIVE = ex.maximum(B, ex.literal(1), 32)
LESS, SAME = ex.compare("lt", A, B), ex.compare("eq", A, B)
NOT_MORE, OTHER = ex.compare("le", W, Z), ex.compare("ne", W, Z)
ONE, TOP = 1 << 30, 2**31 - 1


# Expression, its C (empty: only run), and what it is, of a, b, w, z.
AS_C = [
    (ex.sub(A, ex.sub(B, A, 32), 32), "a - (b - a)", lambda a, b, w, z: 2 * a - b),
    (ex.add(A, ex.neg(B), 32), "a + (-b)", lambda a, b, w, z: a - b),
    (ex.neg(ex.add(A, B, 32)), "-(a + b)", lambda a, b, w, z: -a - b),
    (ex.neg(ex.literal(-3)), "-(-3)", lambda a, b, w, z: 3),
    (ex.absolute(ex.sub(A, B, 32)), "esea_q31_abs(a - b)", lambda a, b, w, z: abs(a - b)),
    (ex.absolute(W), "esea_q63_abs(w)", lambda a, b, w, z: abs(w)),
    (ex.add(W, A, 64), "w + ((int64_t)a)", lambda a, b, w, z: w + a),
    (ex.sub(W, ex.literal(5, 64), 64), "w - INT64_C(5)", lambda a, b, w, z: w - 5),
    (ex.sub(ex.literal(-(2**31)), ex.literal(0), 32), "INT32_MIN - 0", lambda *_: -(2**31)),
    (
        ex.add(ex.literal(-(2**63), 64), ex.literal(2**63 - 1, 64), 64),
        "INT64_MIN + INT64_C(9223372036854775807)",
        lambda *_: -1,
    ),
    (ex.scale(A, 4, 32), "a * 16", lambda a, b, w, z: 16 * a),
    (ex.scale(W, 3, 64), "w * INT64_C(8)", lambda a, b, w, z: 8 * w),
    (ex.scale(A, 20, 64), "((int64_t)a) * INT64_C(1048576)", lambda a, b, w, z: a * 2**20),
    (ex.round_shift(A, 3), "esea_q31_round(a, 3)", lambda a, b, w, z: halves_up(a, 3)),
    (ex.round_shift(W, 9, 64), "esea_q63_round(w, 9)", lambda a, b, w, z: halves_up(w, 9)),
    (
        ex.round_shift(W, 15, 32),
        "(int32_t)esea_q63_round(w, 15)",
        lambda a, b, w, z: halves_up(w, 15),
    ),
    (ex.mul(A, B, 5, 32), "esea_q31_mul(a, b, 5)", lambda a, b, w, z: halves_up(a * b, 5)),
    (ex.mul(A, B, 0, 64), "esea_q31_wide(a, b)", lambda a, b, w, z: a * b),
    (
        ex.mul(A, B, 7, 64),
        "esea_q63_round(esea_q31_wide(a, b), 7)",
        lambda a, b, w, z: halves_up(a * b, 7),
    ),
    (ex.mul(B, W, 9, 64), "esea_q63_mul_q31(w, b, 9)", lambda a, b, w, z: halves_up(w * b, 9)),
    (ex.mul(W, Z, 40, 64), "esea_q63_mul(w, z, 40)", lambda a, b, w, z: halves_up(w * z, 40)),
    (ex.minimum(A, B, 32), "esea_q31_min(a, b)", lambda a, b, w, z: min(a, b)),
    (ex.maximum(W, A, 64), "esea_q63_max(w, (int64_t)a)", lambda a, b, w, z: max(w, a)),
    (
        ex.clamp(W, -7, 2**33),
        "esea_q63_max(esea_q63_min(w, INT64_C(8589934592)), INT64_C(-7))",
        lambda a, b, w, z: max(-7, min(w, 2**33)),
    ),
    (LESS, "a < b", lambda a, b, w, z: a < b),
    (SAME, "a == b", lambda a, b, w, z: a == b),
    (NOT_MORE, "w <= z", lambda a, b, w, z: w <= z),
    (OTHER, "w != z", lambda a, b, w, z: w != z),
    (ex.logic("not", SAME), "!(a == b)", lambda a, b, w, z: a != b),
    (
        ex.logic("and", ex.logic("and", LESS, NOT_MORE), OTHER),
        "(a < b) && (w <= z) && (w != z)",
        lambda a, b, w, z: a < b and w < z,
    ),
    (
        ex.logic("or", SAME, ex.logic("and", LESS, NOT_MORE)),
        "(a == b) || ((a < b) && (w <= z))",
        lambda a, b, w, z: a == b or (a < b and w <= z),
    ),
    (
        ex.logic("or", ex.logic("or", SAME, LESS), ex.logic("not", OTHER)),
        "(a == b) || (a < b) || (!(w != z))",
        lambda a, b, w, z: a <= b or w == z,
    ),
    (ex.choose(LESS, A, B, 32), "(a < b) ? a : b", lambda a, b, w, z: min(a, b)),
    (
        ex.add(ex.choose(LESS, A, ex.literal(0), 32), B, 32),
        "((a < b) ? a : 0) + b",
        lambda a, b, w, z: (a if a < b else 0) + b,
    ),
    (ex.cast(LESS, 32), "(a < b) ? 1 : 0", lambda a, b, w, z: int(a < b)),
    (ex.cast(SAME, 64), "(a == b) ? INT64_C(1) : INT64_C(0)", lambda a, b, w, z: int(a == b)),
    (ex.literal(1, 1), "true", lambda *_: 1),
    (ex.literal(0, 1), "false", lambda *_: 0),
    (ex.literal(7, -32), "7u", lambda *_: 7),
    (
        ex.flags(((LESS, 0), (SAME, 4))),
        "esea_bit(a < b, 0u) | esea_bit(a == b, 4u)",
        lambda a, b, w, z: (a < b) + 16 * (a == b),
    ),
    (
        ex.Expr("sign", (A,), 32, -1, 1),
        "(a > 0) ? 1 : ((a < 0) ? -1 : 0)",
        lambda a, b, w, z: (a > 0) - (a < 0),
    ),
    (
        ex.call("divide", (W, ex.cast(POSITIVE, 64)), 64, -(2**41), 2**41, 1, -(2**41), 2**41),
        "esea_q63_divide(w, (int64_t)esea_q31_max(b, 1), 1, INT64_C(-2199023255552), "
        "INT64_C(2199023255552))",
        lambda a, b, w, z: functions.divide(w, max(b, 1), 1, -(2**41), 2**41),
    ),
    (
        ex.call("pow", (POSITIVE,), 32, 0, TOP, 9, 3 << 26, 20, TOP),
        "esea_q31_pow(esea_q31_max(b, 1), 9, INT32_C(201326592), 20, 2147483647)",
        lambda a, b, w, z: functions.power(max(b, 1), 9, 3 << 26, 20, TOP),
    ),
    (
        ex.call("pow", (POSITIVE,), 64, 0, 2**40, 9, 3 << 26, 20, 2**40),
        "esea_q63_pow(esea_q31_max(b, 1), 9, INT32_C(201326592), 20, INT64_C(1099511627776))",
        lambda a, b, w, z: functions.power(max(b, 1), 9, 3 << 26, 20, 2**40),
    ),
    (
        ex.call("pow", (W,), 32, 0, TOP, 39, 3 << 26, 20, TOP),
        "esea_q63_pow(w, 39, INT32_C(201326592), 20, INT64_C(2147483647))",
        lambda a, b, w, z: functions.power(w, 39, 3 << 26, 20, TOP),
    ),
    (
        ex.call("exp", (A,), 64, 0, 2**40, 8, 20, 2**40),
        "esea_q63_exp(a, 8, 20, INT64_C(1099511627776))",
        lambda a, b, w, z: functions.exponential(a, 8, 20, 2**40),
    ),
    (
        ex.call("log", (POSITIVE,), 64, -(2**62), 2**62, 9, 30),
        "esea_q63_log(esea_q31_max(b, 1), 9, 30)",
        lambda a, b, w, z: functions.logarithm(max(b, 1), 9, 30),
    ),
    (
        ex.call("sqrt", (ex.absolute(W),), 32, 0, TOP, 4),
        "esea_q31_sqrt(esea_q63_abs(w), 4)",
        lambda a, b, w, z: min(math.isqrt(abs(w) << 4), TOP),
    ),
    (
        ex.call("tanh", (A,), 32, -ONE, ONE, 9),
        "esea_q31_tanh(a, 9)",
        lambda a, b, w, z: functions.tangent(a, 9),
    ),
]
GIVEN = [
    (0, 0, 0, 0),
    (-1000, 900, -(2**40), 2**36),
    (1000, -7, 2**40, -(2**35)),
    (5, 5, 2**31 + 1, 2**31 + 1),
    (-4, 899, -(2**38) + 1, 77),
    (12, 13, -8, -8),
    (-3, -3, 3, 2**34),
    (2, -1, 2**20 + 1, -5),
]


def test_the_c_of_an_expression_is_what_is_evaluated_and_what_is_meant():
    require_tool("gcc")
    head = '#include <stdbool.h>\n#include "esea_q31.h"\n'
    takes = "(int32_t a, int32_t b, int64_t w, int64_t z)"
    lines, declared = [head], []
    for k, (e, text, _) in enumerate(AS_C):
        assert ex.bare_text(e) == text
        declared.append(f"int64_t f{k}{takes}; int64_t g{k}{takes};")
        unused = "(void)a; (void)b; (void)w; (void)z;"
        lines.append(f"int64_t f{k}{takes} {{ {unused} return {ex.bare_text(e)}; }}")
        # Bracketed it may stand in front of any operator.
        lines.append(f"int64_t g{k}{takes} {{ {unused} return INT64_C(3) - {ex.c_text(e)}; }}")
    files = {p.name: p.read_text() for p in functions.source_files()}
    ffi = cffi.FFI()
    ffi.cdef(" ".join(declared))
    library = ffi.dlopen(str(compile_sources(files | {"expressions.c": "\n".join(lines)})))
    columns = [np.array(c, dtype=object) for c in zip(*GIVEN, strict=True)]
    places = dict(zip("abwz", columns, strict=True))
    for k, (e, text, exact) in enumerate(AS_C):
        wanted = [int(exact(*row)) for row in GIVEN]
        assert [int(v) for v in ex.evaluate(e, places, len(GIVEN))] == wanted, text
        assert [getattr(library, f"f{k}")(*row) for row in GIVEN] == wanted, text
        if e.bits != -32:
            assert [3 - getattr(library, f"g{k}")(*row) for row in GIVEN] == wanted, text
        assert all(e.low <= v <= e.high for v in wanted)


def test_what_lies_inside_is_not_cut_again():
    x = ex.read("a", 32, -5, 3)
    for low, high, text in (
        (-5, 3, "a"),
        (-6, 4, "a"),
        (-4, 3, "esea_q31_max(a, (-4))"),
        (-5, 2, "esea_q31_min(a, 2)"),
    ):
        assert ex.c_text(ex.clamp(x, low, high)) == text


def test_a_literal_is_scaled_and_cast_at_once():
    assert ex.scale(ex.literal(-3), 4, 32) == ex.literal(-48)
    assert ex.scale(ex.literal(3), 40, 64) == ex.literal(3 << 40, 64)
    assert ex.cast(ex.literal(7), 64) == ex.literal(7, 64)
    with pytest.raises(ex.OverflowProofError):
        ex.scale(ex.literal(1), 31, 32)


@pytest.mark.parametrize(("bits", "most"), [(32, 30), (64, 62)])
def test_a_scale_is_a_number_of_its_type(bits, most):
    """The C multiplies by 2^shift: that, too, must fit, even where the value is 0."""
    nothing = ex.read("x", bits, 0, 0)
    assert ex.scale(nothing, most, bits).data == (most,)
    for shift in (most + 1, most + 2):
        with pytest.raises(ex.OverflowProofError, match=rf"scale by 2\^{shift}"):
            ex.scale(nothing, shift, bits)
