"""The whole-number bound, operation by operation: both parts of an error in two boxes at once."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.emit.fixed.bound import Span, analyse, span
from esea_gen.emit.ranges import RangeError
from esea_gen.emit.walker import Kernel, Node

from .test_fixed_bound import lowered


def at(*boxes: tuple[float, float, float, float], held: bool = False) -> Span:
    """Low, high, a and r, box by box."""
    return Span(*(np.array(v, float) for v in zip(*boxes, strict=True)), held)


def value(op: str, *given: Span, number: float | None = None, **more) -> Span:
    """What one operation makes of second elements; the first ones are others."""
    nodes = [Node("input", source=(k, 1)) for k in range(len(given))]
    if number is not None:
        nodes.append(Node("const", value=number))
    args = tuple(range(len(nodes)))
    kernel = Kernel("f", (*nodes, Node(op, args)), ((len(args),),))
    count = len(given[0].low)
    other = span(-77.0, 78.0, 7.0, count)
    results, _, _ = analyse(lowered(kernel), [[other, g] for g in given], boxes=count, **more)
    return results[0][0]


def carried(low: float, high: float, a: float, r: float) -> tuple[float, float, float, float]:
    """As a share where zero is not inside and the error is at most eight times the share there."""
    least = min(abs(low), abs(high)) if low * high > 0 else 0.0
    if least and a / least <= max(8 * r, 2.0**-30):
        return low, high, 0.0, r + a / least
    return low, high, a, r


def assert_is(found: Span, *boxes: tuple[float, float, float, float], rel: float = 1e-12) -> None:
    for k, wanted in enumerate(boxes):
        parts = [float(v[k]) for v in (found.low, found.high, found.a, found.r)]
        assert parts == pytest.approx(carried(*wanted), rel=rel, abs=1e-14), k


RIGHT, LEFT = (0.5, 2.0, 0.1, 0.2), (-5.0, -3.0, 0.3, 0.1)
FAR, ACROSS = (3.0, 5.0, 0.3, 0.1), (-1.5, 2.0, 0.1, 0.2)


@pytest.mark.parametrize(
    ("op", "x", "y", "expected"),
    [
        # Of one sign shares stay shares; else 0.1 + 0.2 * 2 and 0.3 + 0.1 * 5 add up.
        ("add", RIGHT, FAR, (3.5, 7, 0.4, 0.2)),
        ("add", FAR, RIGHT, (3.5, 7, 0.4, 0.2)),
        ("add", LEFT, LEFT, (-10, -6, 0.6, 0.1)),
        # ... unless the worse share of the whole is more than twice what they add up to.
        ("add", LEFT, (-2.0, -0.5, 0.2, 0.3), (-7, -3.5, 0.5, 0.3)),
        ("add", LEFT, (-1.0, -0.5, 0.0, 0.9), (-6, -3.5, 0.8 + 0.9, 0)),
        ("add", (0.0, 1.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.125), (0, 2, 0, 0.125)),
        # Zero is of either sign; what is beyond it cancels, be it ever so little.
        *(
            ("add", x, y, ((x[0] + y[0]), x[1] + y[1], a, r))
            for x, y, a, r in (
                ((0.0, 5.0, 0.0, 0.2), (0.0, 3.0, 0.0, 0.1), 0.0, 0.2),
                ((-5.0, 0.0, 0.0, 0.2), (-3.0, 0.0, 0.0, 0.1), 0.0, 0.2),
                ((-0.5, 5.0, 0.0, 0.2), (0.0, 3.0, 0.0, 0.1), 1.3, 0.0),
                ((0.0, 5.0, 0.0, 0.2), (-0.5, 3.0, 0.0, 0.1), 1.3, 0.0),
                ((-5.0, 0.0, 0.0, 0.2), (-3.0, 0.5, 0.0, 0.1), 1.3, 0.0),
                ((-5.0, 0.5, 0.0, 0.2), (-3.0, 0.0, 0.0, 0.1), 1.3, 0.0),
            )
        ),
        ("add", RIGHT, LEFT, (-4.5, -1, 1.3, 0)),
        ("add", ACROSS, FAR, (1.5, 7, 1.3, 0)),
        ("add", LEFT, ACROSS, (-6.5, -1, 1.3, 0)),
        ("sub", RIGHT, FAR, (-4.5, -1, 1.3, 0)),
        ("sub", FAR, RIGHT, (1, 4.5, 1.3, 0)),
        ("sub", RIGHT, LEFT, (3.5, 7, 0.4, 0.2)),
        # (x + e)(y + f) - x y, of the largest x and y: 2 f 1.2 + 5 e 1.1 + e f.
        ("mul", RIGHT, FAR, (1.5, 10, 0.72 + 0.55 + 0.03, 0.32)),
        ("mul", FAR, RIGHT, (1.5, 10, 1.3, 0.32)),
        ("mul", RIGHT, LEFT, (-10, -1.5, 1.3, 0.32)),
        ("mul", ACROSS, LEFT, (-10, 7.5, 1.3, 0.32)),
        # Divided by no less than 3 (1 - 0.1 - 0.3 / 3).
        ("div", RIGHT, FAR, (0.1, 2 / 3, 0.1 / 2.4, 0.4 / 0.8)),
        ("div", ACROSS, LEFT, (-2 / 3, 0.5, 0.1 / 2.4, 0.4 / 0.8)),
        ("div", LEFT, (0.5, 2.0, 0.1, 0.2), (-10, -1.5, 0.3 / 0.3, 0.5 / 0.6)),
    ],
)
def test_both_parts_of_an_error_of_two(op, x, y, expected):
    # In the other box something exact.
    plain, beside = (4.0, 6.0, 0.0, 0.0), (1.0, 2.0, 0.0, 0.0)
    ends = {"add": (5, 8), "sub": (2, 5), "mul": (4, 12), "div": (2, 6)}[op]
    assert_is(value(op, at(x, plain), at(y, beside)), expected, (*ends, 0, 0))


@pytest.mark.parametrize(
    ("op", "x", "expected"),
    [
        ("sq", RIGHT, (0.25, 4, 0.24 + 0.24 + 0.01, 0.44)),
        ("sq", ACROSS, (0, 4, 0.49, 0.44)),
        ("sq", LEFT, (9, 25, 1.65 + 1.65 + 0.09, 0.21)),
        ("neg", RIGHT, (-2, -0.5, 0.1, 0.2)),
        ("twice", ACROSS, (-3, 4, 0.2, 0.2)),
        ("fabs", ACROSS, (0, 2, 0.1, 0.2)),
        ("fabs", LEFT, (3, 5, 0.3, 0.1)),
        ("fabs", RIGHT, (0.5, 2, 0.1, 0.2)),
        ("fabs", (-0.5, 0.25, 0.0, 0.0), (0, 0.5, 0, 0)),
        ("sq", (-0.5, 0.25, 0.0, 0.0), (0, 0.25, 0, 0)),
        ("fabs", FAR, (3, 5, 0.3, 0.1)),
        ("exp", RIGHT, (math.exp(0.5), math.exp(2), 0, math.expm1(0.5))),
        ("tanh", LEFT, (math.tanh(-5), math.tanh(-3), 0.8, 0)),
        ("log", FAR, (math.log(3), math.log(5), -math.log(1 - 0.8 / 3), 0)),
        # A root's slope at the least there is left, 3 (1 - 0.1); at zero the root of the error.
        ("sqrt", FAR, (math.sqrt(3), math.sqrt(5), 0.3 / math.sqrt(2.7), 1 - math.sqrt(0.9))),
        ("sqrt", (0.25, 4.0, 0.01, 0.0), (0.5, 2, 0.02, 0)),
        ("sqrt", (0.0, 4.0, 0.25, 0.2), (0, 2, 0.5, 1 - math.sqrt(0.8))),
        ("sqrt", (0.01, 4.0, 0.25, 0.2), (0.1, 2, 0.5, 1 - math.sqrt(0.8))),
        ("sqrt", (-1.0, 4.0, 0.25, 0.0), (0, 2, 0.5, 0)),
        # Half of it and more may be missing, at most all; above there may be more than all.
        ("sqrt", (0.0, 4.0, 0.25, 0.5), (0, 2, 0.5, 1 - math.sqrt(0.5))),
        ("sqrt", (0.0, 4.0, 0.25, 0.75), (0, 2, 0.5, 1)),
        ("sqrt", (0.0, 4.0, 0.25, 8.0), (0, 2, 0.5, 2)),
    ],
)
def test_both_parts_of_an_error_of_one(op, x, expected):
    beside = (1.0, 4.0, 0.0, 0.0)
    ends = {"sq": (1, 16), "neg": (-4, -1), "twice": (2, 8), "fabs": (1, 4), "sqrt": (1, 2)}
    of = ends.get(op) or tuple(getattr(math, op)(v) for v in (1, 4))
    assert_is(value(op, at(x, beside)), expected, (*of, 0, 0))


def test_the_root_of_what_errs_in_both_ways_is_bounded_where_nothing_is_left():
    # 1 may be computed as 1 (1 - 0.2) - 0.8: its root errs by 1.
    found = value("sqrt", at((1.0, 1.0, 0.8, 0.2)))
    assert found.error[0] >= 1
    assert found.error[0] == pytest.approx(math.sqrt(0.8) + 1 - math.sqrt(0.8))
    # What is 4 may be 0.4 in one way, and in two hardly more than nothing.
    for a, r in ((0.0, 0.9), (2.0, 0.4), (0.1, 0.97)):
        for op, number, c in (("sqrt", None, 0.5), ("pow", 0.3, 0.3)):
            found = value(op, at((4.0, 4.0, a, r)), number=number)
            assert found.error[0] >= 4**c - max(4 * (1 - r) - a, 0) ** c


OFF = 2.0**-28
"""Half of the last bit of an exponent."""


@pytest.mark.parametrize(
    ("x", "c", "a", "r"),
    [
        # The largest argument is 2 (1 + 0.2) + 0.1.
        (RIGHT, 2.5, 2.5 * 2.5**1.5 * 0.1, 1.2**2.5 - 1),
        (RIGHT, 1.0, 0.1, 0.2),
        (RIGHT, 1.5, 1.5 * 2.5**0.5 * 0.1, 1.2**1.5 - 1),
        # The least, 0.5 (1 - 0.2) - 0.1, bounds a root's slope; else the root of the error does.
        (RIGHT, 0.5, 0.5 * 0.3**-0.5 * 0.1, 1 - 0.8**0.5),
        ((0.5, 2.0, 0.3, 0.2), 0.25, 0.25 * 0.1**-0.75 * 0.3, 1 - 0.8**0.25),
        ((0.5, 2.0, 0.39, 0.2), 0.25, 0.39**0.25, 1 - 0.8**0.25),
        ((0.5, 2.0, 0.41, 0.2), 0.25, 0.41**0.25, 1 - 0.8**0.25),
        ((0.0, 2.0, 0.1, 0.2), 0.5, 0.1**0.5, 1 - 0.8**0.5),
        ((-1.0, 2.0, 0.1, 0.2), 0.5, 0.1**0.5, 1 - 0.8**0.5),
        ((0.0, 2.0, 0.1, 0.75), 0.5, 0.1**0.5, 1.0),
        # A negative one is steepest at the least.
        (RIGHT, -1.5, 1.5 * 0.3**-2.5 * 0.1, 0.8**-1.5 - 1),
        (FAR, -0.5, 0.5 * 2.4**-1.5 * 0.3, 0.9**-0.5 - 1),
    ],
)
def test_both_parts_of_a_powers_error(x, c, a, r):
    ends = sorted(max(v, 0.0) ** c for v in x[:2])
    found = value("pow", at(x, (1.0, 1.0, 0.0, 0.0)), number=c)
    assert_is(found, (*ends, a, r), (1, 1, 0, 0), rel=1e-6)


@pytest.mark.parametrize(
    ("low", "high", "c", "a", "r"),
    [
        # As a share |ln x| of the end that is further from 1; of a negative exponent always.
        (0.5, 1.0, 0.4, 0.0, math.log(2)),
        (1.0, 3.0, 0.4, 0.0, math.log(3)),
        (0.5, 3.0, 2.7, 0.0, math.log(3)),
        (0.2, 3.0, 2.7, 0.0, math.log(5)),
        (1e-9, 2.0, -1.3, 0.0, 9 * math.log(10)),
        (1e-9, 1e-8, -1.3, 0.0, 9 * math.log(10)),
        # From zero on x^c |ln x|: largest at exp(-1/c), or at the end, within 1 and beyond.
        (0.0, 1.0, 0.4, 1 / (0.4 * math.e), 0.0),
        (0.0, 0.01, 0.4, 0.01**0.4 * math.log(100), 0.0),
        (0.0, 5.0, 0.4, 5**0.4 * math.log(5), 0.0),
        (0.0, 5.0, 2.7, 5**2.7 * math.log(5), 0.0),
        (0.0, 1.2, 2.7, 1.2**2.7 * math.log(1.2), 0.0),
        # A share of the largest where that is at most eight times as much.
        (1e-9, 2.0, 0.4, 1 / (0.4 * math.e), 0.0),
        (1e-2, 1.0, 0.4, 0.0, math.log(100)),
        (1e-3, 1.0, 0.4, 0.0, math.log(1e3)),
        (5e-4, 1.0, 0.4, 1 / (0.4 * math.e), 0.0),
    ],
)
def test_an_exponent_is_half_a_bit_off(low, high, c, a, r):
    found = value("pow", at((low, high, 0.0, 0.0)), number=c)
    assert OFF * a <= float(found.a[0]) <= 1.002 * OFF * a
    assert OFF * r <= float(found.r[0]) <= 1.002 * OFF * r


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
    first = at((-3.0, 1.0, *x), (-2.0, 4.0, *x))
    second = at((-2.0, 2.0, *y), (-1.0, 3.0, *y))
    open_ = at((0, 1, 0, 0), (0, 1, 0, 0))
    for op, ends in (
        ("fmin", ((-3, 1, 3), (-2, 3, 3))),
        ("fmax", ((-2, 2, 2), (-1, 4, 4))),
        ("select", ((-3, 2, 3), (-2, 4, 4))),
    ):
        wanted = [(low, high, a[m] if isinstance(a, dict) else a, r) for low, high, m in ends]
        condition = (open_,) if op == "select" else ()
        for pair in ((first, second), (second, first)):
            assert_is(value(op, *condition, *pair), *wanted)


def test_the_extreme_that_is_sure_errs_by_its_own_error():
    # Apart by exactly both errors, and by a little less: 0.1 + 0.05 * 4 and 0.2.
    y = (-4.0, -1.0, 0.1, 0.05)
    for gap, sure in ((0.5, True), (0.4375, False)):
        for sign in (1, -1):
            x = (-1 + gap, 3.0, 0.0, 0.2 / 3)
            pair = [(p[0], p[1], *p[2:]) if sign > 0 else (-p[1], -p[0], *p[2:]) for p in (x, y)]
            least, most = ("fmin", "fmax") if sign > 0 else ("fmax", "fmin")
            for op, own in ((least, pair[1]), (most, pair[0])):
                size = max(abs(v) for v in own[:2])
                worse = (*own[:2], max(0.2 / 3 * size, 0.1 + 0.05 * size), 0.0)
                for order in (1, -1):
                    found = value(op, *(at(p) for p in pair[::order]))
                    assert_is(found, own if sure else worse)


def test_a_choice_is_decided_box_by_box_in_all_four_parts():
    condition = at((1, 1, 0, 0), (0, 0, 0, 0), (0, 1, 0, 0))
    x = at(*[(-3.0, 1.0, 0.1, 0.2)] * 3)
    y = at(*[(-2.0, 2.0, 0.3, 0.4)] * 3)
    wanted = (-3, 1, 0.1, 0.2), (-2, 2, 0.3, 0.4), (-3, 2, 0.3, 0.4)
    assert_is(value("select", condition, x, y), *wanted)
    wanted = (-3, 1, 0.1, 0.2), (0, 0, 0, 0), (-3, 1, 0.1, 0.2)
    assert_is(value("if_else_zero", condition, x), *wanted)


def test_a_product_with_itself_is_a_square():
    for same, ends in ((True, (0, 4)), (False, (-3, 4))):
        kernel = Kernel("f", (Node("input"), Node("input", source=(1, 0)),
                              Node("mul", (0, 0 if same else 1))), ((2,),))  # fmt: skip
        results, _, _ = analyse(lowered(kernel), [[at(ACROSS)]] * 2)
        assert (results[0][0].low[0], results[0][0].high[0]) == ends


def test_a_sign_that_may_turn_is_off_by_two():
    x = at(
        (0.5, 2, 0.5, 0), (0.75, 2, 0.5, 0), (-2, -0.5, 0.5, 0), (-2, -0.75, 0.5, 0), (-1, 1, 0, 0)
    )
    found = value("sign", x)
    assert found.error.tolist() == [2, 0, 2, 0, 0]
    assert (found.low.tolist(), found.high.tolist()) == ([1, 1, -1, -1, -1], [1, 1, -1, -1, 1])
    assert found.r.tolist() == [0] * 5


def test_a_number_is_above_nothing_and_below_everything_it_is_not():
    # What is neither above nor below zero, in logic: yes, perhaps, no.
    x = at((1, 2, 0, 0), (-2, -1, 0, 0), (0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 0, 0))
    found = value("not", x)
    assert (found.low.tolist(), found.high.tolist()) == ([0, 0, 0, 0, 1], [0, 0, 1, 1, 1])
    yes, no = at(*[(1, 1, 0, 0)] * 5), at(*[(0, 0, 0, 0)] * 5)
    for pair in ((x, yes), (yes, x)):
        found = value("and", *pair)
        assert (found.low.tolist(), found.high.tolist()) == ([1, 1, 0, 0, 0], [1, 1, 1, 1, 0])
    for pair in ((x, no), (no, x)):
        found = value("or", *pair)
        assert (found.low.tolist(), found.high.tolist()) == ([1, 1, 0, 0, 0], [1, 1, 1, 1, 0])
        assert value("and", *pair).high.tolist() == [0] * 5
    assert value("or", x, yes).low.tolist() == [1] * 5


# -- what an analysis is told ----------------------------------------------------------------------


def test_each_operand_has_what_was_stored_of_it_coarser():
    # One of the two alone, then the other, then both.
    kernel = Kernel(
        "f",
        (Node("input"), Node("input", source=(1, 0)), Node("sub", (0, 1))),
        ((2,),),
    )
    given = [at((-1, 1, 0.0625, 0))], [at((-2, 2, 0, 0.0625))]
    for constants, error in (({0: 0.25}, 0.25), ({1: 0.5}, 0.5), ({0: 0.25, 1: 0.5}, 0.75)):
        work = lowered(kernel)
        own = SimpleNamespace(local=0.0, relative=0.0, constants=constants, low=-9.0, high=9.0)
        work.values[2] = own
        results, _, _ = analyse(work, given)
        assert float(results[0][0].error[0]) == error + 0.0625 + 2 * 0.0625


def test_a_comparisons_own_error_and_its_operands_make_an_assumption():
    nodes = (Node("input"), Node("input", source=(1, 0)), Node("lt", (0, 1)))
    kernel = Kernel("f", nodes, ((2,),))
    exact, rough = at((-1, 1, 0, 0)), at((-1, 1, 0.1, 0))
    share = at((-1, 1, 0, 0.1))
    for x, y, local, told in (
        (exact, exact, 0.0, ()),
        (exact, exact, 0.5, ("f: v2 = lt",)),
        (rough, exact, 0.0, ("f: v2 = lt",)),
        (exact, rough, 0.0, ("f: v2 = lt",)),
        (share, exact, 0.0, ("f: v2 = lt",)),
        (exact, share, 0.0, ("f: v2 = lt",)),
        (rough, at((5, 6, 0, 0)), 0.5, ()),
    ):
        work = lowered(kernel, local)
        assert analyse(work, [[x], [y]])[1] == told


def test_a_constant_and_a_part_of_a_word_are_points():
    kernel = Kernel("f", (Node("const", value=2.5), Node("input"), Node("neg", (1,))), ((2,),))
    work = lowered(kernel)
    work.values = [work.values[0], work.values[1], None]
    _, _, values = analyse(work, [[at((1, 2, 0, 0), (3, 4, 0, 0))]], boxes=2)
    assert (values[0].low.tolist(), values[0].high.tolist()) == ([2.5] * 2, [2.5] * 2)
    assert (values[2].low.tolist(), values[2].high.tolist()) == ([0.0] * 2, [0.0] * 2)
    assert values[0].exact
    assert values[2].exact


@pytest.mark.parametrize(
    ("op", "given", "words"),
    [
        ("div", (RIGHT, (0.0, 1.0, 0.0, 0.0)), "division by a range that holds zero"),
        ("div", (RIGHT, (-1.0, 0.0, 0.0, 0.0)), "division by a range that holds zero"),
        ("div", (RIGHT, (2.0, 3.0, 1.0, 0.5)), "whose error is as large as itself"),
        ("log", ((0.5, 2.0, 0.5, 0.0),), "log of a range that reaches zero"),
        ("twice", ((0.0, math.inf, 0.0, 0.1),), r"f: value v1 \(twice\) has no finite error"),
    ],
)
def test_one_box_without_a_bound_is_enough_to_refuse(op, given, words):
    plain = (1.0, 2.0, 0.0, 0.0)
    with pytest.raises(RangeError, match=words):
        value(op, *(at(plain, g) for g in given))
    with pytest.raises(RangeError, match="negative power of a range that reaches zero"):
        value("pow", at(plain, (0.5, 2.0, 0.4, 0.2)), number=-1.5)


def test_hardly_inside_there_is_a_bound():
    assert value("div", at(RIGHT), at((2.0, 3.0, 0.98, 0.5))).r[0] == pytest.approx(
        1.19 / 0.01 + 0.1 / (2 * 0.01) / (0.5 / 3)
    )
    assert value("log", at((0.5, 2.0, 0.49, 0.0))).a[0] == pytest.approx(math.log(50))
    assert value("pow", at((0.5, 2.0, 0.39, 0.2)), number=-1.5).high[0] == pytest.approx(0.5**-1.5)


def test_a_missing_arm_is_no_operand():
    kernel = Kernel("f", (Node("input"), Node("add", (0, -1))), ((1,),))
    with pytest.raises(RangeError, match="a select's missing arm is no operand"):
        analyse(lowered(kernel), [[at((0, 1, 0, 0))]])
