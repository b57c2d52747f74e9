"""Each operation in whole numbers: width, fraction, raw range, error and C, worked out by hand."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from math import ceil, floor

import pytest

from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed.lowering import lower
from esea_gen.emit.fixed.values import LoweringError, Source, Target, Value
from esea_gen.emit.walker import Kernel, Node

W = 2**31
DIVIDE = 2.0**-30


@dataclass(frozen=True, eq=False)
class Op:
    """An operation of others, of inputs (fraction bits and raw ends), and of numbers."""

    name: str
    args: tuple
    wide: bool = False
    fact: tuple[float, float] | None = None


def op(name: str, *args, wide: bool = False, fact=None) -> Op:
    return Op(name, args, wide, fact)


@dataclass
class Made:
    """What operations were lowered to.

    text: C of the last one; a result that is no step of its own stands as it is used.
    """

    value: Value
    text: str
    values: dict[Op, Value] = field(default_factory=dict)


def made(root: Op, *others: Op, to: int = 31) -> Made:
    nodes: list[Node] = []
    place: dict[object, int] = {}
    given: list[tuple[int, int, int]] = []

    def add(x) -> int:
        key = x if isinstance(x, Op | float) else id(x)
        if key not in place:
            if isinstance(x, Op):
                args = tuple(add(a) for a in x.args)
                nodes.append(Node(x.name, args))
            elif isinstance(x, tuple):
                nodes.append(Node("input", source=(len(given), 0)))
                given.append(x)
            else:
                nodes.append(Node("const", value=x))
            place[key] = len(nodes) - 1
        return place[key]

    def source(argument: int, _element: int) -> Source:
        return Source(f"x{argument}", f"in->x{argument}", *given[argument], f"port{argument}")

    results = tuple((add(x),) for x in (root, *others))
    ops = {x: i for x, i in place.items() if isinstance(x, Op)}
    lowered = lower(
        Kernel("f", tuple(nodes), results),
        source,
        [[Target("y", to)]] * len(results),
        wide={i for x, i in ops.items() if x.wide},
        facts={i: x.fact for x, i in ops.items() if x.fact},
        block="tried",
    )
    values = {x: v for x, i in ops.items() if (v := lowered.values[i]) is not None}
    text = next((s.expr for s in lowered.steps if s.node == ops[root]), values[root].expr)
    return Made(values[root], ex.bare_text(text), values)


def form(v: Value) -> tuple[int, int, int, int]:
    return v.expr.bits, v.fraction, v.expr.low, v.expr.high


def stored(c: float, fraction: int) -> tuple[int, float]:
    """The raw number nearest to a constant, and how far it is off."""
    raw = floor(Fraction(c) * 2**fraction + Fraction(1, 2))
    return raw, float(abs(Fraction(raw, 2**fraction) - Fraction(c)))


def check(x: Op, wanted, text: str, local=0.0, relative=0.0, constants=None, to=31) -> None:
    found = made(x, to=to)
    assert form(found.value) == wanted
    assert found.text == text
    assert (found.value.local, found.value.relative) == (local, relative)
    assert {k: e for k, e in found.value.constants.items() if e} == (constants or {})


# -- sums ------------------------------------------------------------------------------------------

A28, B28 = (28, -100, 200), (28, -7, 50)
ALL30, ALL30_TOO = (30, -W, W - 1), (30, -W, W - 1)
TINY, HUGE = (60, -5, W - 1), (20, -W, W - 1)
THREE_TENTHS, ITS_ERROR = stored(0.3, 28)

SUMS = [
    (op("add", A28, B28), (32, 28, -107, 250), "x0_q28 + x1_q28", 0.0),
    (op("sub", A28, B28), (32, 28, -150, 207), "x0_q28 - x1_q28", 0.0),
    # Up to 4 in units of 2^-29 is all that 32 bits hold; each rounded first could be one more.
    (
        op("add", ALL30, ALL30_TOO),
        (32, 29, -W, W - 1),
        "(int32_t)esea_q63_round(((int64_t)x0_q30) + ((int64_t)x1_q30), 1)",
        2.0**-30,
    ),
    (
        op("sub", (30, -W, 0), (29, 1 - W, 0)),
        (32, 29, -(2**30), W - 1),
        "(int32_t)esea_q63_round(((int64_t)x0_q30) - (((int64_t)x1_q29) * INT64_C(2)), 1)",
        2.0**-30,
    ),
    # 17/8 to 18/8 less 6/8 to 7/8 is 10/8 to 12/8.
    (
        op("sub", (29, 17 * 2**26, 18 * 2**26), (31, 6 * 2**28, 7 * 2**28)),
        (32, 30, 10 * 2**27, 12 * 2**27),
        "(int32_t)esea_q63_round((((int64_t)x0_q29) * INT64_C(4)) - ((int64_t)x1_q31), 1)",
        2.0**-31,
    ),
    (
        op("add", (31, -7 * 2**28, -6 * 2**28), (29, 17 * 2**26, 18 * 2**26)),
        (32, 30, 10 * 2**27, 12 * 2**27),
        "(int32_t)esea_q63_round(((int64_t)x0_q31) + (((int64_t)x1_q29) * INT64_C(4)), 1)",
        2.0**-31,
    ),
    # One operand is finer than the sum, the other, both.
    (
        op("add", (30, -W, 0), (29, 0, W - 9)),
        (32, 29, -(2**30), W - 8),
        "esea_q31_round(x0_q30, 1) + x1_q29",
        2.0**-30,
    ),
    (
        op("add", (29, 0, W - 9), (30, -W, 0)),
        (32, 29, -(2**30), W - 8),
        "x0_q29 + esea_q31_round(x1_q30, 1)",
        2.0**-30,
    ),
    (
        op("add", (31, -W, 2**30), (30, 5 - W, 2**30)),
        (32, 29, 2 - 3 * 2**29, 3 * 2**28 + 2),
        "esea_q31_round(x0_q31, 2) + esea_q31_round(x1_q30, 1)",
        2.0**-29,
    ),
    # 64 bits, but not enough for all: the finer is rounded before.
    (
        op("add", TINY, HUGE, wide=True),
        (64, 49, -(2**60) - 1, 2**60 - 2**29 + 2**20),
        "((int64_t)esea_q31_round(x0_q60, 11)) + (((int64_t)x1_q20) * INT64_C(536870912))",
        2.0**-50,
    ),
    (
        op("add", A28, (30, -9, 2), wide=True),
        (64, 30, -409, 802),
        "(((int64_t)x0_q28) * INT64_C(4)) + ((int64_t)x1_q30)",
        0.0,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("x", "wanted", "text", "local"), SUMS, ids=lambda x: None)
def test_a_sum(x, wanted, text, local):
    check(x, wanted, text, local)


def test_a_sum_with_a_number_is_off_by_what_the_number_is_off():
    one = (28, -(2**28), 2**28)
    low, high = THREE_TENTHS - 2**28, THREE_TENTHS + 2**28
    n = THREE_TENTHS
    check(op("add", one, 0.3), (32, 28, low, high), f"x0_q28 + {n}", constants={1: ITS_ERROR})
    check(op("add", 0.3, one), (32, 28, low, high), f"{n} + x0_q28", constants={0: ITS_ERROR})
    check(op("sub", 0.3, one), (32, 28, low, high), f"{n} - x0_q28", constants={0: ITS_ERROR})
    check(op("sub", one, 0.3), (32, 28, -high, -low), f"x0_q28 - {n}", constants={1: ITS_ERROR})


@pytest.mark.parametrize(
    ("name", "low", "high", "bits"),
    [
        ("add", -(2**30), 2**30 - 1, 32),
        ("add", -(2**30), 2**30, 64),
        ("add", -(2**30) - 1, 2**30 - 1, 64),
        ("sub", -(2**30), 2**30 - 1, 32),
        ("sub", -(2**30), 2**30, 64),
        ("sub", -(2**30) - 1, 2**30 - 1, 64),
    ],
)
def test_a_sum_that_is_only_compared_has_64_bits_where_32_do_not_hold_it(name, low, high, bits):
    total = op(name, (28, low, high), (28, -(2**30), 2**30))
    value = made(op("lt", total, (28, -9, 9)), to=0).values[total]
    assert form(value) == (bits, 28, low - 2**30, high + 2**30)
    assert value.local == 0.0


def test_a_number_in_what_is_only_compared_is_off_too():
    for k, args in enumerate(((0.3, A28), (A28, 0.3))):
        total = op("add", *args)
        value = made(op("lt", total, (28, -9, 9)), to=0).values[total]
        assert form(value) == (32, 28, THREE_TENTHS - 100, THREE_TENTHS + 200)
        assert value.constants == {k: ITS_ERROR}


def test_what_no_64_bits_hold_exactly_is_rounded_though_it_is_only_compared():
    # 2^-60 beside 2^11: with 19 bits behind the point both lose half a unit.
    total = op("add", (60, -5, 9), HUGE)
    value = made(op("lt", total, (28, -9, 9)), to=0).values[total]
    assert form(value) == (32, 19, -(2**30), 2**30)
    assert value.local == 2.0**-19


# -- products --------------------------------------------------------------------------------------

P = op("mul", (20, -3, 5), (22, 0, 7), wide=True)  # 64 bits: -21 to 35, in units of 2^-42
Q = op("mul", (21, -2, 3), (20, 1, 9), wide=True)  # -18 to 27, in units of 2^-41
POINT_3 = stored(0.3, 32)


def test_a_product_of_small_numbers_keeps_every_bit():
    check(
        op("mul", (28, -3, 5), (20, -7, 2)),
        (32, 48, -35, 21),
        "(int32_t)esea_q31_wide(x0_q28, x1_q20)",
    )
    check(P, (64, 42, -21, 35), "esea_q31_wide(x0_q20, x1_q22)")


def test_a_product_is_cut_to_what_its_largest_leaves_room_for():
    # -2 of 2 by -2 of 1: -4 + 2^-29 to 4.
    x, y = (30, -W, W - 1), (30, -W, 2**30)
    text = "esea_q31_mul(x0_q30, x1_q30, 32)"
    check(op("mul", x, y), (32, 28, 1 - 2**30, 2**30), text, 2.0**-29)
    check(op("mul", y, x), (32, 28, 1 - 2**30, 2**30), text, 2.0**-29)
    text = "esea_q31_mul(x0_q30, x0_q30, 32)"
    check(op("sq", y), (32, 28, 0, 2**30), text, 2.0**-29)
    check(op("mul", y, y), (32, 28, 0, 2**30), text, 2.0**-29)
    # In 64 bits all 60 behind the point fit.
    wide = op("mul", x, y, wide=True)
    check(wide, (64, 58, -(2**60) + 2**29, 2**60), wide_round("x0_q30, x1_q30", 2), 2.0**-59)


def wide_round(args: str, shift: int) -> str:
    return f"esea_q63_round(esea_q31_wide({args}), {shift})"


def test_a_product_with_a_number_is_off_by_a_share_of_it():
    raw, error = POINT_3
    x = (28, -(2**28), 2**27)
    high = (raw + 1) // 2
    for k, args, given in ((1, (x, 0.3), f"x0_q28, {raw}"), (0, (0.3, x), f"{raw}, x0_q28")):
        text = f"esea_q31_mul({given}, 28)"
        check(op("mul", *args), (32, 32, -raw, high), text, 2.0**-33, constants={k: error})
    # Of a number whose bits could not be shifted out again fewer are kept: 90 in all.
    raw, error = stored(0.3, 20)
    text = f"(int32_t)esea_q31_wide(x0_q70, {raw})"
    check(op("mul", (70, -9, 5), 0.3), (32, 90, -9 * raw, 5 * raw), text, constants={1: error})


def test_a_power_of_two_moves_the_point_as_far_as_a_sum_could_take_it_up():
    x = (30, -5, 9)
    for power, text, low, high in (
        (2.0**-30, "x0_q30", -5, 9),
        (-(2.0**-30), "-x0_q30", -9, 5),
    ):
        for args in ((x, power), (power, x)):
            check(op("mul", *args), (32, 60, low, high), text)
    check(op("mul", x, 4.0), (32, 28, -5, 9), "x0_q30")
    check(op("twice", x), (32, 29, -5, 9), "x0_q30")
    # 2^-31 would need 61 bits: a product, of a number that 60 bits hold.
    text = f"esea_q31_mul(x0_q30, {2**29}, 2)"
    check(op("mul", x, 2.0**-31), (32, 88, -5 * 2**27, 9 * 2**27), text, 2.0**-89)


def test_the_least_number_of_a_word_is_negated_in_64_bits():
    text = "-((int64_t)x0_q28)"
    check(op("neg", (28, -W, 9)), (64, 28, -9, W), text)
    check(op("neg", (28, 1 - W, 9)), (32, 28, -9, W - 1), "-x0_q28")
    check(op("mul", (28, -W, 9), -2.0), (64, 27, -9, W), text)


def test_products_of_64_bits_leave_out_what_their_parts_cannot_give():
    # One factor of 64 bits: a shift by 1 at least; the high word to a unit.
    z = (10, -2, 3)
    wanted = (64, 51, -3 * W, 4 * W)
    check(op("mul", P, z, wide=True), wanted, "esea_q63_mul_q31(v2_q42, x2_q10, 1)", 2.0**-52)
    found = made(op("mul", z, P, wide=True))
    assert form(found.value) == wanted
    assert found.text == "esea_q63_mul_q31(v3_q42, x0_q10, 1)"
    # As 32 bits the same range fits after three bits more.
    text = "(int32_t)esea_q63_mul_q31(v2_q42, x2_q10, 4)"
    check(op("mul", P, z), (32, 48, -3 * 2**28, 2**30), text, 2.0**-49)
    # Two of them: by 33.
    text = "esea_q63_mul(v2_q42, v5_q41, 33)"
    check(op("mul", P, Q, wide=True), (64, 50, -3 * W, 4 * W), text, 2.0**-51)


def test_a_fact_cuts_a_product_before_it_must_fit_its_word():
    # Up to 64 by itself; from -1 to 0.7 in units of 2^-31.
    x, y = (28, -W, W - 1), (28, -W, W - 1)
    high = ceil(Fraction(0.7) * W)
    text = (
        f"(int32_t)esea_q63_max(esea_q63_min({wide_round('x0_q28, x1_q28', 25)}, "
        f"INT64_C({high})), INT64_C(-2147483648))"
    )
    check(op("mul", x, y, fact=(-1.0, 0.7)), (32, 31, -W, high), text, 2.0**-32)


# -- quotients -------------------------------------------------------------------------------------


def divide(n: str, d: str, k: int, low: int, high: int, bits: int = 32) -> str:
    cast = "(int32_t)" if bits == 32 else ""
    return f"{cast}esea_q63_divide({n}, {d}, {k}, INT64_C({low}), INT64_C({high}))"


N64, D64 = "(int64_t)x0_q28", "(int64_t)x1_q20"


@pytest.mark.parametrize(
    ("n", "d", "least", "most"),
    [
        ((-100, 300), (3, 7), Fraction(-100, 3), 100),
        ((-300, 100), (3, 7), -100, Fraction(100, 3)),
        ((-300, 100), (-7, -3), Fraction(-100, 3), 100),
        ((30, 300), (3, 7), Fraction(30, 7), 100),
        ((-300, -30), (3, 7), -100, Fraction(-30, 7)),
        ((-300, -30), (-7, -3), Fraction(30, 7), 100),
    ],
)
def test_a_quotient_leaves_a_unit_for_its_rounding(n, d, least, most):
    # 100 2^-8 is 0.39: 32 bits behind the point, shifted by what the formats differ.
    low, high = floor(least * 2**24) - 1, ceil(most * 2**24) + 1
    x = op("div", (28, *n), (20, *d))
    check(x, (32, 32, low, high), divide(N64, D64, 24, low, high), 2.0**-33, DIVIDE)
    low, high = floor(least * 2**54) - 1, ceil(most * 2**54) + 1
    x = op("div", (28, *n), (20, *d), wide=True)
    check(x, (64, 62, low, high), divide(N64, D64, 54, low, high, 64), 2.0**-63, DIVIDE)


def test_a_quotient_of_formats_too_far_apart_is_refused():
    # 90 bits of the result and 20 of the divisor, less those of the dividend: -127 and no less.
    def far(power: int) -> Op:
        return op("div", op("div", (28, 100, 300), 2.0**power), (20, 3, 7))

    assert "esea_q63_divide((int64_t)x0_q28, (int64_t)x1_q20, -127, " in made(far(209)).text
    with pytest.raises(LoweringError, match="quotient shifted by -128"):
        made(far(210))


def test_a_fact_leaves_a_quotient_no_more_than_it_says():
    low, high = floor(Fraction(-0.3) * 2**32), ceil(Fraction(0.2) * 2**32)
    x = op("div", (28, -300, 300), (20, 3, 7), fact=(-0.3, 0.2))
    check(x, (32, 32, low, high), divide(N64, D64, 24, low, high), 2.0**-33, DIVIDE)


def test_a_number_is_divided_with_all_its_bits():
    # 1.5 over 3 to 7 times 2^-20: 2^19 at most.
    low, high = floor(Fraction(2**20 * 3, 14) * 2**11) - 1, 2**30 + 1
    text = divide(f"INT64_C({3 * 2**59})", "(int64_t)x0_q20", 11 + 20 - 60, low, high)
    check(op("div", 1.5, (20, 3, 7)), (32, 11, low, high), text, 2.0**-12, DIVIDE)
    # 90 bits behind the point hold 24 of 10^-20.
    raw, error = stored(1e-20, 90)
    found = made(op("div", 1e-20, (20, 3, 7)))
    assert found.text.startswith(f"(int32_t)esea_q63_divide(INT64_C({raw}), (int64_t)x0_q20, ")
    assert found.value.constants == {0: error}
    # 3.5 10^-15 times 2^79 is 2.11 10^9.
    assert found.value.fraction == 79


@pytest.mark.parametrize(("low", "high"), [(0, 5), (-5, 0), (-5, 5), (0, 0)])
def test_a_divisor_that_can_be_zero_is_refused_with_its_range(low, high):
    told = rf"\[{low / 2**20:.6g}, {high / 2**20:.6g}\] holds zero"
    with pytest.raises(LoweringError, match=told):
        made(op("div", A28, (20, low, high)))


def test_a_division_by_a_number_is_a_product_with_its_inverse():
    third = round(Fraction(2**32, 3))
    share = float(abs(Fraction(third, 2**32) * 3 - 1))
    x = (28, -(2**28), 2**27)
    text = f"esea_q31_mul(x0_q28, {third}, 28)"
    check(op("div", x, 3.0), (32, 32, -third, (third + 1) // 2), text, 2.0**-33, share)
    text = f"esea_q31_mul(x0_q28, ({-third}), 28)"
    check(op("div", x, -3.0), (32, 32, -(third // 2), third), text, 2.0**-33, share)
    # Few bits of the inverse, all of the product; the same with a factor of 64 bits.
    third = round(Fraction(2**20, 3))
    share = float(abs(Fraction(third, 2**20) * 3 - 1))
    text = f"(int32_t)esea_q31_wide(x0_q70, {third})"
    check(op("div", (70, -9, 5), 3.0), (32, 90, -9 * third, 5 * third), text, 0.0, share)
    third = round(Fraction(2**32, 3))
    share = float(abs(Fraction(third, 2**32) * 3 - 1))
    text = f"esea_q63_mul_q31(v2_q42, {third}, 1)"
    check(op("div", P, 3.0, wide=True), (64, 73, -9 * W, 15 * W), text, 2.0**-74, share)
    text = f"(int32_t)esea_q63_mul_q31(v2_q42, {third}, 5)"
    check(op("div", P, 3.0), (32, 69, -9 * 2**27, 15 * 2**27), text, 2.0**-70, share)
    check(op("div", x, -0.25), (32, 26, -(2**27), 2**28), "-x0_q28")


@pytest.mark.parametrize(("number", "bits"), [(5, 33), (7, 33), (11, 34), (13, 34), (19, 35)])
def test_an_inverse_is_rounded_to_the_nearest(number, bits):
    # Rests of a unit: 0.4, 0.14, 0.45, 0.77, 0.53.
    raw = round(Fraction(2**bits, number))
    found = made(op("div", (28, -(2**28), 2**28), float(number)))
    assert found.text == f"esea_q31_mul(x0_q28, {raw}, 28)"
    assert found.value.relative == float(abs(Fraction(raw * number, 2**bits) - 1))


def test_a_fact_cuts_a_division_by_a_number_before_it_must_fit():
    # 8 over 0.3 is 26.7; -1 to 0.7 in units of 2^-31.
    inverse = 1 / Fraction(0.3)
    raw = round(inverse * 2**29)
    high = ceil(Fraction(0.7) * W)
    text = (
        f"(int32_t)esea_q63_max(esea_q63_min({wide_round(f'x0_q28, {raw}', 26)}, "
        f"INT64_C({high})), INT64_C(-2147483648))"
    )
    share = float(abs(Fraction(raw, 2**29) / inverse - 1))
    x = op("div", (28, -W, W - 1), 0.3, fact=(-1.0, 0.7))
    found = made(x)
    assert (form(found.value), found.text) == ((32, 31, -W, high), text)
    assert found.value.relative == pytest.approx(share, rel=1e-12)
