"""Magnitudes, limits, choices and comparisons in whole numbers, each worked out by hand."""

from __future__ import annotations

from fractions import Fraction
from math import ceil, floor

import pytest

from esea_gen.emit.fixed.values import LoweringError

from .test_fixed_formats import A28, B28, HUGE, Op, W, check, form, made, op

# -- magnitudes, the lesser, the greater -----------------------------------------------------------


def test_a_sign_is_a_whole_number():
    text = "(x0_q28 > 0) ? 1 : ((x0_q28 < 0) ? -1 : 0)"
    check(op("sign", A28), (32, 0, -1, 1), text, to=0)


def test_a_magnitude_loses_a_bit_only_for_the_least_number_of_a_word():
    check(op("fabs", (28, 1 - W, 9)), (32, 28, 0, W - 1), "esea_q31_abs(x0_q28)")
    check(op("fabs", (28, -20, -9)), (32, 28, 9, 20), "esea_q31_abs(x0_q28)")
    whole = "esea_q63_abs((int64_t)x0_q28)"
    x = (28, -W, 9)
    check(op("fabs", x), (32, 27, 0, 2**30), f"(int32_t)esea_q63_round({whole}, 1)", 2.0**-28)
    check(op("fabs", x, wide=True), (64, 28, 0, W), whole)
    size = op("fabs", x)
    assert form(made(op("lt", size, A28), to=0).values[size]) == (64, 28, 0, W)


def test_a_magnitude_of_the_least_number_of_64_bits_is_refused():
    total = op("add", (20, -W, 0), (52, 0, 5))  # compared alone: all of 64 bits
    with pytest.raises(LoweringError, match="its argument fills 64 bits"):
        made(op("lt", op("fabs", total), A28), to=0)


COARSE, FINE = (20, 3, 9), (28, -(2**10), 3 * 2**8)  # where one ends the other begins
OVER = (28, -(2**10), 3 * 2**8 + 1)


def test_what_is_never_beyond_the_other_stands_for_both():
    for args in ((FINE, COARSE), (COARSE, FINE)):
        k, m = args.index(FINE), args.index(COARSE)
        check(op("fmin", *args), (32, 28, -(2**10), 3 * 2**8), f"x{k}_q28")
        check(op("fmax", *args), (32, 20, 3, 9), f"x{m}_q20")
    for args in ((OVER, COARSE), (COARSE, OVER)):
        text = {OVER: "x{}_q28", COARSE: "x{}_q20 * 256"}
        first, second = (text[a].format(k) for k, a in enumerate(args))
        low = f"esea_q31_min({first}, {second})"
        check(op("fmin", *args), (32, 28, -(2**10), 3 * 2**8 + 1), low)
        check(op("fmax", *args), (32, 28, 3 * 2**8, 9 * 2**8), low.replace("min", "max"))
    # A number has no format to stand in.
    check(op("fmin", (28, 100, 200), 50 * 2.0**-28), (32, 28, 50, 50), "esea_q31_min(x0_q28, 50)")
    check(op("fmax", 2.0**-20, (28, 1, 9)), (32, 28, 256, 256), "esea_q31_max(256, x0_q28)")


def test_the_lesser_and_the_greater_are_as_fine_as_both_together_leave_room_for():
    # +-4 and -256 to 512: the lesser is from -256 to 4, the greater from -4 to 512.
    x, y = (28, -(2**30), 2**30), (20, -(2**28), 2**29)
    fine, coarse = "(int64_t)x{}_q28", "((int64_t)x{}_q20) * INT64_C(256)"
    for args in ((x, y), (y, x)):
        k, m = args.index(x), args.index(y)
        joined = ", ".join(fine.format(0) if a is x else coarse.format(0) for a in args)
        joined = joined.replace("x0_q28", f"x{k}_q28").replace("x0_q20", f"x{m}_q20")
        text = f"(int32_t)esea_q63_round(esea_q63_min({joined}), 5)"
        check(op("fmin", *args), (32, 23, -W, 2**25), text, constants={k: 2.0**-24}, to=30)
        joined = [f"x{k}_q28", f"x{m}_q20"]
        joined[0] = f"esea_q31_round(x{k}_q28, 7)"
        joined[1] = f"x{m}_q20 * 2"
        ordered = ", ".join(joined if k == 0 else joined[::-1])
        text = f"esea_q31_max({ordered})"
        check(op("fmax", *args), (32, 21, -(2**23), 2**30), text, constants={k: 2.0**-22}, to=30)
    wide = op("fmin", x, y, wide=True)
    text = f"esea_q63_min({fine.format(0)}, {coarse.format(1)})"
    check(wide, (64, 28, -(2**36), 2**30), text, to=30)


def test_a_limit_is_cut_towards_zero_and_off_by_that():
    x = (28, -(2**28), 2**28)
    raw = floor(Fraction(0.3) * 2**28)
    off = float(Fraction(0.3) - Fraction(raw, 2**28))
    for name, c, low, high in (
        ("fmin", 0.3, -(2**28), raw),
        ("fmax", 0.3, raw, 2**28),
        ("fmin", -0.3, -(2**28), -raw),
        ("fmax", -0.3, -raw, 2**28),
    ):
        for k, args in ((1, (x, c)), (0, (c, x))):
            value = made(op(name, *args)).value
            assert form(value) == (32, 28, low, high)
            assert value.constants == {k: off, 1 - k: 0.0}
            assert value.local == 0.0


def test_what_is_chosen_is_no_finer_than_the_port_that_it_goes_to():
    x, y = (28, -(2**10), 3 * 2**10), (26, -(2**8), 2**9)
    for to, wanted in ((24, (32, 24, -64, 128)), (27, (32, 27, -512, 1024))):
        value = made(op("fmin", x, y), to=to).value
        assert form(value)[:2] == wanted[:2]
        assert value.expr.low in (wanted[2], wanted[2] - 1)
        assert value.expr.high in (wanted[3], wanted[3] + 1)
    # 64 bits are there to lose nothing.
    assert form(made(op("fmin", x, y, wide=True), to=24).value) == (64, 28, -1024, 2048)


# -- choices ---------------------------------------------------------------------------------------


def test_a_choice_between_formats():
    # 1/8 to 8 where x is at most 1/4; else +-512.
    x, y = (28, 2**25, W - 1), (20, -(2**29), 2**29)
    condition = op("le", x, 0.25)
    text = "(x0_q28 <= 67108864) ? esea_q31_round(x0_q28, 7) : (x1_q20 * 2)"
    wanted = (32, 21, -(2**30), 2**30)
    check(op("select", condition, x, y), wanted, text, constants={1: 2.0**-22}, to=30)
    text = "(x0_q28 <= 67108864) ? (x1_q20 * 2) : esea_q31_round(x0_q28, 7)"
    check(op("select", condition, y, x), wanted, text, constants={2: 2.0**-22}, to=30)
    # Of x alone it knows that it is at most 1/4: 32 bits behind the point, no more than its 28.
    text = "(x0_q28 <= 67108864) ? x0_q28 : 0"
    check(op("if_else_zero", condition, x), (32, 28, 0, 2**26), text)
    low = "(x0_q28 <= 67108864) ? x0_q28 : 67108864"
    check(op("select", condition, x, 0.25), (32, 28, 2**25, 2**26), low)


def test_numbers_that_are_chosen_have_the_finest_format_of_both():
    condition = op("le", (28, -9, 9), 0.0)
    a, b = floor(Fraction(0.3) * W), floor(Fraction(0.7) * W)
    off = {k: float(Fraction(c) - Fraction(raw, W)) for k, c, raw in ((1, 0.3, a), (2, 0.7, b))}
    text = f"(x0_q28 <= 0) ? {a} : {b}"
    check(op("select", condition, 0.3, 0.7), (32, 31, a, b), text, constants=off)


TOP, LOW = 2**26, -(2**25)  # 1/4 and -1/8 of 28 bits
X28, Y28 = (28, -W, W - 1), (28, -W, W - 1)


def both(*conditions) -> Op:
    first, *rest = conditions
    for c in rest:
        first = op("and", first, c)
    return first


@pytest.mark.parametrize(
    ("condition", "low", "high", "text"),
    [
        (op("le", X28, 0.25), -W, TOP, "x0_q28 <= 67108864"),
        (op("lt", X28, 0.25), -W, TOP - 1, "x0_q28 <= 67108863"),
        (op("le", -0.125, X28), LOW, W - 1, "(-33554432) <= x0_q28"),
        (op("lt", -0.125, X28), LOW + 1, W - 1, "(-33554431) <= x0_q28"),
        (both(op("lt", -0.125, X28), op("le", X28, 0.25)), LOW + 1, TOP,
         "(x0_q28 <= 67108864) && ((-33554431) <= x0_q28)"),
        # Of two limits the narrower.
        (both(op("le", X28, 0.25), op("le", X28, 0.5), op("le", -0.125, X28), op("le", -0.5, X28)),
         LOW, TOP, "(x0_q28 <= 67108864) && ((-33554432) <= x0_q28)"),
        (both(op("le", X28, 0.5), op("le", X28, 0.25), op("le", -0.5, X28), op("le", -0.125, X28)),
         LOW, TOP, "(x0_q28 <= 67108864) && ((-33554432) <= x0_q28)"),
        # What says something of another, too, stays.
        (both(op("le", X28, 0.25), op("le", Y28, 0.5)), -W, TOP,
         "(x0_q28 <= 67108864) && (x0_q28 <= 67108864) && (x1_q28 <= 134217728)"),
        (both(op("le", Y28, 0.5), op("le", X28, 0.25)), -W, TOP,
         "(x1_q28 <= 67108864) && (x0_q28 <= 134217728) && (x1_q28 <= 67108864)"),
        (op("le", X28, Y28), -W, W - 1, "x0_q28 <= x1_q28"),
        (op("eq", X28, 0.25), -W, W - 1, "x0_q28 == 67108864"),
    ],
)  # fmt: skip
def test_a_choice_asks_again_what_it_takes_from_its_condition(condition, low, high, text):
    found = made(op("if_else_zero", condition, X28))
    assert form(found.value) == (32, 28, min(low, 0), high)
    asked, _, arms = found.text.partition(" ? ")
    assert asked == f"({text})"
    assert arms in ("x0_q28 : 0", "x1_q28 : 0")


def test_a_choice_by_what_never_holds_is_its_other_arm():
    # 100 has no place in the format of what is compared.
    for condition in (op("le", X28, -100.0), op("lt", 100.0, X28)):
        assert made(op("select", condition, X28, A28)).text == "x1_q28"
    check(op("select", op("le", X28, 100.0), X28, A28), (32, 28, -W, W - 1), "x0_q28")


@pytest.mark.parametrize(("number", "kept"), [(1.0, 0), (0.0, 1), (-2.5, 0)])
def test_a_choice_that_is_no_choice_is_its_arm(number, kept):
    args = A28, (20, -9, 8)
    found = made(op("select", number, *args))
    fraction, low, high = args[kept]
    assert form(found.value) == (32, fraction, low, high)
    assert found.text == f"x{kept}_q{fraction}"


# -- comparisons -----------------------------------------------------------------------------------


def test_values_are_compared_in_the_finer_format():
    fine, coarse = (30, -9, W - 1), (28, -7, 100)
    for name, sign in (("lt", "<"), ("le", "<="), ("eq", "=="), ("ne", "!=")):
        a, b = "((int64_t)x{}_q30)", "(((int64_t)x{}_q28) * INT64_C(4))"
        check(op(name, fine, coarse), (1, 0, 0, 1), f"{a} {sign} {b}".format(0, 1), to=0)
        check(op(name, coarse, fine), (1, 0, 0, 1), f"{b} {sign} {a}".format(0, 1), to=0)
        check(op(name, A28, B28), (1, 0, 0, 1), f"x0_q28 {sign} x1_q28", to=0)


def test_values_too_far_apart_are_compared_as_fine_as_64_bits_hold():
    # 2^31 units of 2^-20 have room for 32 bits more; half a unit of them is lost.
    fine, coarse = (
        "((int64_t)esea_q31_round(x{}_q60, 8))",
        "(((int64_t)x{}_q20) * INT64_C(4294967296))",
    )
    x, y = (60, -5, W - 1), HUGE
    check(op("lt", x, y), (1, 0, 0, 1), f"{fine} < {coarse}".format(0, 1), 2.0**-53, to=0)
    check(op("lt", y, x), (1, 0, 0, 1), f"{coarse} < {fine}".format(0, 1), 2.0**-53, to=0)


@pytest.mark.parametrize(
    ("name", "number", "text"),
    [
        ("lt", 0.3, f"x0_q28 <= {floor(Fraction(0.3) * 2**28)}"),
        ("lt", 0.25, "x0_q28 <= 67108863"),
        ("le", 0.25, "x0_q28 <= 67108864"),
        ("eq", 0.25, "x0_q28 == 67108864"),
        ("ne", 0.25, "x0_q28 != 67108864"),
        ("eq", 0.3, "false"),
        ("ne", 0.3, "true"),
        ("lt", 9.0, "true"),
        ("lt", -9.0, "false"),
        ("eq", 9.0, "false"),
        ("ne", 9.0, "true"),
    ],
)
def test_a_comparison_with_a_number(name, number, text):
    found = made(op(name, X28, number), to=0)
    assert (found.text, found.value.fraction, found.value.local) == (text, 0, 0.0)
    if name in ("eq", "ne"):
        assert made(op(name, number, X28), to=0).text == text


@pytest.mark.parametrize(
    ("name", "number", "text"),
    [
        ("lt", 0.3, f"{ceil(Fraction(0.3) * 2**28)} <= x0_q28"),
        ("lt", 0.25, "67108865 <= x0_q28"),
        ("le", 0.25, "67108864 <= x0_q28"),
        ("le", -0.25, "(-67108864) <= x0_q28"),
        ("lt", 9.0, "false"),
        ("le", -9.0, "true"),
    ],
)
def test_a_comparison_of_a_number_with_a_value(name, number, text):
    found = made(op(name, number, X28), to=0)
    assert (found.text, found.value.fraction, found.value.local) == (text, 0, 0.0)


ALL30, ALL28, BEYOND = (30, -W, W - 1), (28, -W, W - 1), (28, -9, 9)  # a sum has 33 bits


@pytest.mark.parametrize(
    ("through", "exact"),
    [
        (lambda s: op("neg", s), True),
        (lambda s: op("twice", s), True),
        (lambda s: op("fabs", s), True),
        (lambda s: op("fmin", s, A28), True),
        (lambda s: op("fmax", A28, s), True),
        (lambda s: op("sub", A28, s), True),
        (lambda s: op("add", s, A28), True),
        (lambda s: op("fabs", op("neg", op("sub", s, A28))), True),
        (lambda s: op("mul", s, 0.3), False),
        (lambda s: op("sq", s), False),
        (lambda s: op("div", s, 3.0), False),
        (lambda s: op("tanh", s), False),
        (lambda s: op("select", op("lt", A28, B28), s, A28), False),
        (lambda s: op("fabs", op("mul", s, 0.3)), False),
    ],
)
@pytest.mark.parametrize("name", ["lt", "le", "eq", "ne"])
def test_bits_are_kept_for_a_comparison_through_what_loses_none(name, through, exact):
    total = op("add", ALL30, ALL28)
    value = made(op(name, through(total), BEYOND), to=0).values[total]
    assert (value.expr.bits, value.fraction) == ((64, 30) if exact else (32, 27))
    assert (value.local == 0) == exact
    # What is a result as well, on any way, is a number of 32 bits.
    again = made(op(name, through(total), BEYOND), total, to=20).values[total]
    assert (again.expr.bits, again.fraction) == (32, 27)


def test_a_comparison_is_a_number_where_it_is_counted():
    less = op("lt", A28, B28)
    text = "(((x0_q28 < x1_q28) ? 1 : 0) * 268435456) + x0_q28"
    check(op("add", less, A28), (32, 28, -100, 2**28 + 200), text)
    text = "(x0_q28 < x1_q28) ? 1 : 0"
    assert made(op("mul", less, 0.5)).text == text


@pytest.mark.parametrize(("halves", "raw"), [(5, 3), (-5, -2), (4, 2), (3, 2), (-3, -1), (-6, -3)])
def test_a_number_is_rounded_to_the_nearest_a_half_upwards(halves, raw):
    c = halves * 2.0**-29
    value = made(op("add", A28, c)).value
    assert form(value) == (32, 28, raw - 100, raw + 200)
    assert value.constants == ({1: 2.0**-29} if halves % 2 else {})
    # Where it limits, towards zero.
    inner = int(halves / 2)
    assert made(op("fmin", A28, c)).value.high * 2**28 == inner


def test_a_fact_is_rounded_outwards():
    x = (28, -(2**28), 2**28)
    inside = op("add", x, (28, -(2**28), 2**28 - 1), fact=(-0.3, 0.7))
    tenth = Fraction(0.3) * 2**28, Fraction(0.7) * 2**28
    assert form(made(inside).value) == (32, 28, floor(-tenth[0]), ceil(tenth[1]))
