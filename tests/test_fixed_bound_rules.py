"""The whole-number bound box by box: decisions, choices, forms of an error, and what is kept."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.fixed.bound import MOST_KNOWN, Known, Span, analyse, numeric_nodes, span
from esea_gen.emit.ranges import RangeError
from esea_gen.emit.walker import Kernel, Node, fuse_selects, walk

from .test_fixed_bound import lowered

X, Y, Z = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("z")


def boxes(*ends: tuple[float, float], a: float = 0.0, r: float = 0.0, held: bool = False) -> Span:
    """One interval a box, all with the same error."""
    low, high = (np.array(e, float) for e in zip(*ends, strict=True))
    n = len(ends)
    return Span(low, high, np.full(n, a), np.full(n, r), held)


def found(expression, *given: Span, own=None, **more):
    """Span of an expression of x, y, z, and what it takes for granted."""
    count = len(given[0].low)
    given = (*given, *[span(0.0, 1.0, 0.0, count)] * (3 - len(given)))
    kernel = fuse_selects(walk(ca.Function("f", [X, Y, Z], [expression])))
    work = lowered(kernel)
    if own:
        work.values = [own.get(n.op, v) for n, v in zip(kernel.nodes, work.values, strict=True)]
    results, assumed, _ = analyse(work, [[g] for g in given], boxes=count, **more)
    return results[0][0], assumed


def ends(s: Span) -> list[tuple[float, float]]:
    return list(zip(s.low.tolist(), s.high.tolist(), strict=True))


YES, NO, OPEN = (1.0, 1.0), (0.0, 0.0), (0.0, 1.0)


@pytest.mark.parametrize(
    ("compare", "truths"),
    [
        (lambda x, y: x < y, [YES, OPEN, OPEN, NO, NO, NO]),
        (lambda x, y: x <= y, [YES, YES, OPEN, OPEN, NO, YES]),
        (lambda x, y: x == y, [NO, OPEN, OPEN, OPEN, NO, OPEN]),
        (lambda x, y: x != y, [YES, OPEN, OPEN, OPEN, YES, OPEN]),
    ],
)
def test_a_comparison_in_every_box(compare, truths):
    # Below, touching, across, touching from above, above, and one point against itself.
    x = boxes((0, 1), (0, 2), (1, 3), (4, 5), (5, 6), (2, 2))
    y = boxes((2, 4), (2, 4), (2, 4), (2, 4), (2, 4), (2, 2))
    value, assumed = found(compare(X, Y), x, y)
    assert ends(value) == truths
    assert assumed == ()  # exact numbers on both sides
    # Each side off by 0.4 and by 0.6: the gap of one is closed by both together.
    for a, closed in ((0.4, False), (0.6, True)):
        rough, assumed = found(compare(X, Y), boxes((0, 1), a=a), boxes((2, 4), a=a))
        assert ends(rough) == [OPEN if closed else truths[0]]
        assert bool(assumed) == closed
        # What has passed its port's check is computed inside its interval, however it errs.
        passed = boxes((0, 1), a=a, held=True), boxes((2, 4), a=a, held=True)
        assert ends(found(compare(X, Y), *passed)[0]) == [truths[0]]
        # A share of the largest: 4 on one side here.
        shared, _ = found(compare(X, Y), boxes((0, 1)), boxes((2, 4), r=a / 2))
        assert ends(shared) == [OPEN if 2 - 4 * a / 2 <= 1 else truths[0]]


def test_what_the_c_cannot_leave_bounds_what_it_computes():
    # -x of 0 to 1, off by 3: beside 2 undecided, but for a proven interval that ends at 1.5.
    class Own:
        local, relative, constants = 0.0, 0.0, {}
        low, high = -1.5, 1.5

    x, y = boxes((-1, 0), a=3.0), boxes((2, 4))
    assert ends(found(-X < Y, x, y)[0]) == [OPEN]
    assert ends(found(-X < Y, x, y, own={"neg": Own})[0]) == [YES]
    assert ends(found(-X > -2, boxes((-1, 0), a=3.0), y, own={"neg": Own})[0]) == [YES]


def test_logic_of_what_is_known_and_what_is_not():
    # Per box: x > 0 and y > 0 sure, open, no.
    x = boxes(*[(1, 2)] * 3, *[(-1, 1)] * 3, *[(-2, -1)] * 3)
    y = boxes(*[(1, 2), (-1, 1), (-2, -1)] * 3)
    both, _ = found(ca.logic_and(X > 0, Y > 0), x, y)
    assert ends(both) == [YES, OPEN, NO, OPEN, OPEN, NO, NO, NO, NO]
    one, _ = found(ca.logic_or(X > 0, Y > 0), x, y)
    assert ends(one) == [YES, YES, YES, YES, OPEN, OPEN, YES, OPEN, NO]
    none, _ = found(ca.logic_not(X > 0), x, y)
    assert ends(none) == [*[NO] * 3, *[OPEN] * 3, *[YES] * 3]
    assert both.exact
    assert one.exact


def test_a_choice_takes_its_arm_where_its_condition_is_decided():
    x = boxes((1, 2), (-1, 1), (-2, -1))
    y, z = boxes(*[(4, 5)] * 3, a=0.25), boxes(*[(-3, -1)] * 3, a=0.5)
    value, assumed = found(ca.if_else(X > 0, Y, Z), x, y, z)
    assert ends(value) == [(4, 5), (-3, 5), (-3, -1)]
    assert value.error.tolist() == pytest.approx([0.25, 0.5, 0.5])
    assert assumed == ()
    value, _ = found(ca.if_else(X > 0, Y, 0), x, y)
    assert ends(value) == [(4, 5), (0, 5), (0, 0)]
    assert value.error.tolist() == pytest.approx([0.25, 0.25, 0.0])


@pytest.mark.parametrize(("share", "error"), [(0.0625, 0.5), (0.25, 1.25)])
def test_an_open_choice_errs_by_its_worse_arm_at_its_largest(share, error):
    # Half, or a share of 5, the largest of both arms.
    flat, rising = boxes((4, 5), a=0.5), boxes((-3, -1), r=share)
    for first, second in ((flat, rising), (rising, flat)):
        value, _ = found(ca.if_else(X > 0, Y, Z), boxes((-1, 1)), first, second)
        assert (ends(value), value.error.tolist()) == ([(-3, 5)], [error])
    # Of the same kind the larger of each.
    worse = boxes((-3, -1), a=0.75, r=share)
    value, _ = found(ca.if_else(X > 0, Y, Z), boxes((-1, 1)), flat, worse)
    assert value.error.tolist() == [0.75 + 5 * share]


@pytest.mark.parametrize("high", [0.9, 1.5, 2.5])
@pytest.mark.parametrize("c", [0.4, 2.7])
def test_an_exponents_own_error_from_zero_on(high, c):
    # x^c |ln x| is largest at exp(-1/c), or at the end beyond 1; times half of 2^-27.
    value, _ = found(X**c, boxes((0.0, high)))
    peak = min(np.exp(-1 / c), high)
    most = max(peak**c * abs(np.log(peak)), high**c * np.log(high))
    assert value.error[0] == pytest.approx(2.0**-28 * most, rel=0.002)


@pytest.mark.parametrize("sign", [1, -1])
def test_where_one_side_wins_for_sure_its_error_alone_counts(sign):
    pick, other = (ca.fmin, ca.fmax) if sign > 0 else (ca.fmax, ca.fmin)
    intervals = [(1, 2)] * 3 + [(6, 7)], [(3, 5), (2.625, 5), (2.5, 5), (3, 5)]
    for mine, yours in ((0.125, 0.5), (0.5, 0.125)):
        x, y = boxes(*intervals[0], a=mine), boxes(*intervals[1], a=yours)
        turned = [Span(-s.high, -s.low, s.a, s.r) for s in (x, y)] if sign < 0 else [x, y]
        value, _ = found(pick(X, Y), *turned)
        # Apart by 1, by both errors, by less; then the other one is the smaller.
        assert value.error.tolist() == pytest.approx([mine, mine, 0.5, yours])
        low = [(1, 2), (1, 2), (1, 2), (3, 5)]
        assert ends(value) == (low if sign > 0 else [(-b, -a) for a, b in low])
        value, _ = found(other(X, Y), *turned)
        assert value.error.tolist() == pytest.approx([yours, yours, 0.5, mine])


def test_an_absolute_error_is_carried_as_a_share_where_it_is_small():
    def parts(**more) -> tuple[float, float]:
        value, _ = found(2 * X, boxes((1.0, 4.0), **more))
        return float(value.a[0]), float(value.r[0])

    tiny, large = 2.0**-32, 2.0**-28
    # Twice the error beside the least value of 2: a share of the error itself, up to 2^-30.
    assert parts(a=tiny) == (0.0, tiny)
    assert parts(a=2.0**-30) == (0.0, 2.0**-30)
    assert parts(a=2.0**-29) == (2.0**-28, 0.0)
    # Or up to eight times the share there is.
    assert parts(a=8 * large, r=large) == (0.0, 9 * large)
    assert parts(a=9 * large, r=large) == (18 * large, large)
    # Round zero there is no share; below it as above.
    value, _ = found(2 * X, boxes((-1.0, 4.0), a=tiny))
    assert (float(value.a[0]), float(value.r[0])) == (2 * tiny, 0.0)
    value, _ = found(2 * X, boxes((-4.0, -1.0), a=tiny))
    assert (float(value.a[0]), float(value.r[0])) == (0.0, tiny)


def test_shares_stay_shares_in_a_sum_that_cancels_nothing():
    share = 2.0**-12
    value, _ = found(X + Y, boxes((1, 8), r=share), boxes((2, 8), r=share))
    assert (float(value.a[0]), float(value.r[0])) == (0.0, share)
    # Of opposite signs the errors of both largest add up.
    value, _ = found(X - Y, boxes((1, 8), r=share), boxes((2, 8), r=share))
    assert (float(value.a[0]), float(value.r[0])) == (16 * share, 0.0)
    # One plus something small of poor accuracy: no share of the whole.
    value, _ = found(X + Y, boxes((0, 1)), boxes((0, 2.0**-6), r=0.5))
    assert (float(value.a[0]), float(value.r[0])) == (2.0**-7, 0.0)


def test_a_sign_is_wrong_by_two_where_it_may_turn():
    x = boxes((0.5, 2), (0.25, 2), (-2, -0.5), (-2, 0.125), a=0.25)
    value, _ = found(ca.sign(X), x)
    assert value.error.tolist() == [0.0, 2.0, 0.0, 2.0]
    assert ends(value) == [(1, 1), (1, 1), (-1, -1), (-1, 1)]


def test_magnitudes_in_every_box():
    value, _ = found(ca.fabs(X), boxes((-3, -1), (-1, 2), (1, 3), (-2, 0), a=0.5))
    assert ends(value) == [(1, 3), (0, 2), (1, 3), (0, 2)]
    assert value.error.tolist() == [0.5] * 4
    square, _ = found(X * X, boxes((-3, -1), (-1, 2), (1, 3), (-2, 0)))
    assert ends(square) == [(1, 9), (0, 4), (1, 9), (0, 4)]


def test_what_is_refused_names_its_value():
    with pytest.raises(RangeError, match="a negative power of a range that reaches zero"):
        found(X**-1.3, boxes((0.0, 1.0)))
    with pytest.raises(RangeError, match="log of a range that reaches zero"):
        found(ca.log(X), boxes((0.5, 1.0), a=0.5))
    with pytest.raises(RangeError, match=r"f: value v\d+ \(twice\) has no finite error"):
        found(2 * X, boxes((0.0, 1.0), a=np.inf))
    kernel = Kernel("f", (Node("input"), Node("atan", (0,))), ((1,),))
    with pytest.raises(RangeError, match="no error rule for 'atan'"):
        analyse(lowered(kernel), [[boxes((0.0, 1.0))]])


# -- what is left out, and what is kept ------------------------------------------------------------


def test_what_leads_to_a_solved_value_or_a_word_alone_is_not_followed():
    kernel = walk(ca.Function("f", [X, Y], [X * Y + 1, X < Y]))
    work = lowered(kernel)
    by_op = {n.op: i for i, n in enumerate(kernel.nodes)}
    every = set(range(len(kernel.nodes)))
    assert numeric_nodes(work, ()) == every
    assert numeric_nodes(work, (1,)) == every - {by_op["lt"]}
    left = numeric_nodes(work, (1,), {by_op["mul"]})
    assert left >= {by_op["add"], by_op["mul"]}
    inputs = {i for i, n in enumerate(kernel.nodes) if n.op == "input"}
    assert not left & inputs
    given = [[boxes((1, 2), a=0.5)], [boxes((3, 4))]]
    known = span(2.0, 6.0, 0.25, 1)
    results, assumed, values = analyse(work, given, (1,), solved={by_op["mul"]: known})
    assert assumed == ()
    assert (ends(results[0][0]), float(results[0][0].error[0])) == ([(3, 7)], 0.25)
    assert values[by_op["mul"]] is known
    assert float(values[next(iter(inputs))].error[0]) in (0.0, 0.5)


def test_a_fact_cuts_the_interval_box_by_box():
    kernel = walk(ca.Function("f", [X], [2 * X]))
    (node,) = kernel.results[0]
    facts = {node: (np.array([1.0, -9.0, 7.0]), np.array([3.0, 9.0, 8.0]))}
    x = boxes((0, 2), (0, 2), (0, 2))
    results, _, _ = analyse(lowered(kernel), [[x]], facts=facts, boxes=3)
    # In the last box no value can be: any will do, of no negative width.
    assert ends(results[0][0])[:2] == [(1, 3), (0, 4)]
    assert results[0][0].low[2] <= results[0][0].high[2]


def test_results_are_made_once_and_the_oldest_is_forgotten():
    known, made = Known(), []

    def ask(key: int):
        def make():
            made.append(key)
            return span(key, key, 0.0, 1), f"{key}"

        return known.result(7, key, make)

    first = ask(0)
    assert ask(0)[0] is first[0]
    assert made == [0]
    for key in range(1, MOST_KNOWN):
        ask(key)
    ask(0)  # asked for again: the last to go
    ask(MOST_KNOWN)  # one too many: 1 goes
    assert made == list(range(MOST_KNOWN + 1))
    ask(0)
    assert made[-1] == MOST_KNOWN
    ask(1)
    assert made[-1] == 1
    assert MOST_KNOWN == 6
    # Equal content is one Span, told by identity; other content is another.
    a, b = span(0.0, 1.0, 0.5, 2), span(0.0, 1.0, 0.5, 2)
    assert known.one(3, a) is a
    assert known.one(3, b) is a
    for other in (
        span(0.0, 1.0, 0.25, 2),
        span(0.0, 2.0, 0.5, 2),
        span(-1.0, 1.0, 0.5, 2),
        Span(a.low, a.high, a.a, a.r + 1),
        Span(a.low, a.high, a.a, a.r, True),
    ):
        assert known.one(3, other) is other


def test_a_span_of_an_interval():
    s = span(-3.0, 2.0, 0.25, 2)
    assert (ends(s), s.magnitude.tolist(), s.error.tolist()) == (
        [(-3, 2)] * 2, [3.0, 3.0], [0.25, 0.25],
    )  # fmt: skip
    assert not s.exact
    assert span(1.0, 2.0, 0.0, 3).exact
    mixed = Span(s.low, s.high, s.a, np.array([0.0, 0.5]))
    assert mixed.error.tolist() == [0.25, 1.75]
