"""Whole numbers and their bounds at the edges of each rule: small cases worked out by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca
import mpmath
import numpy as np
import pytest

from esea_gen.emit.fixed.bound import Span, analyse
from esea_gen.emit.fixed.errors import block_bound
from esea_gen.emit.fixed.lowering import lower, rewrite
from esea_gen.emit.fixed.plan import Planner, lowered_values, run_lowered
from esea_gen.emit.fixed.search import search
from esea_gen.emit.fixed.values import Source, Target, Value
from esea_gen.emit.walker import Kernel, Node, calls_first, fuse_selects, walk
from esea_gen.language.block import Block, Solved
from esea_gen.language.ports import Flag, Port, flag_word

from .test_fixed_bound import lowered

X, Y = ca.SX.sym("x"), ca.SX.sym("y")

# -- the run that a residual is looked at over -----------------------------------------------------


def solved(residual, most: float = 2e-5) -> Block:
    """1.25 y = x, found by a way that leaves 13 bits; of the residual any part is told."""

    def step(c, s, u, g, label):
        y = label("y_rad", 1e5 * u.x_rad - 99999.2 * u.x_rad)
        off = label("residual", residual(u.x_rad, 1.25 * y - u.x_rad))
        return {}, {"y": y, "status": flag_word([ca.fabs(off) > most])}

    return Block.define(
        "solved",
        "Solved",
        period_s=0.001,
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=(
            Port("y", -1.0, 1.0, "solution"),
            Port("status", 0, 1, "word", flags=(Flag("OPEN", "not solved"),)),
        ),
        step=step,
        facts={"y_rad": (-0.8, 0.8)},
        solved={"y_rad": Solved("residual", most, 1.25, 0.0, {})},
    )


@pytest.mark.parametrize(
    ("at", "seen"),
    [
        # 48 steps of sin(0.4 k), which grow from 1e-3 of the port's end: 0.949 of 10^-1.167 at step
        # 44 is the largest, 0.0646, and 0.058 of 10^-2.667 at step 8 the smallest.
        (lambda x: x > 0.0635, True),
        (lambda x: x > 0.0655, False),
        (lambda x: x < 1.27e-4, True),
        (lambda x: x < 1.24e-4, False),
    ],
)
def test_a_residual_is_looked_at_from_small_inputs_to_a_fifteenth_of_the_range(at, seen):
    def only_there(x, off):
        return ca.if_else(at(ca.fabs(x)), off, 0.0)

    assert bool(search(Planner(solved(only_there))).wide) == seen


@pytest.mark.parametrize(("raw", "wide"), [(64, False), (65, True)])
def test_a_residual_may_fill_a_quarter_and_no_more(raw, wide):
    # Where the way errs at all the residual is told as so many of the 256 units that it may be; far
    # from where it is looked at it is larger, for what cannot be too large is not computed.
    most = 256 * 2.0**-13

    def told(x, off):
        errs = ca.if_else(ca.fabs(off) > 1e-9, raw * 2.0**-13, 0.0)
        return ca.if_else(x > 0.5, 1.0, errs)

    plan = search(Planner(solved(told, most)))
    assert bool(plan.wide) == wide
    if wide:
        assert {f"{100 * raw / 256:.0f} %" in w for w in plan.why_wide.values()} == {True}


def test_a_residual_that_is_told_errs_by_its_own_slope_and_what_follows_by_its():
    # y solves 1.25 y = x; z is 3 y and follows by 3, the residual by 1.25, by no entry.
    most = 1e-3

    def step(c, s, u, g, label):
        y = label("y_rad", 1e5 * u.x_rad - 99999.2 * u.x_rad)
        off = label("residual", 1.25 * y - u.x_rad)
        made = {"y": y, "z": 3 * y, "off": off, "status": flag_word([ca.fabs(off) > most])}
        return {}, made

    block = Block.define(
        "solved",
        "Solved",
        period_s=0.001,
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=(
            Port("y", -1.0, 1.0, "solution"),
            Port("z", -4.0, 4.0, "three of it"),
            Port("off", -2.0, 2.0, "residual"),
            Port("status", 0, 1, "word", flags=(Flag("OPEN", "not solved"),)),
        ),
        step=step,
        facts={"y_rad": (-0.8, 0.8)},
        solved={"y_rad": Solved("residual", most, 1.25, 0.0, {"y": 1.0, "z": 3.0})},
    )
    bound = block_bound(Planner(block).plan())
    error = most / 1.25
    assert bound.outputs["y"] == pytest.approx(error, rel=1e-3)
    assert bound.outputs["z"] == pytest.approx(3 * error, rel=1e-3)
    assert bound.outputs["off"] == pytest.approx(1.25 * error, rel=1e-3)


# -- one operation in whole numbers ----------------------------------------------------------------


def computed(
    expression, *given: tuple[int, int, int], wide: bool = False, to: int = 30
) -> tuple[Value, list[int], list[int]]:
    """What an expression of x and y is lowered to, some raw x over their range, and the results
    beside the least y.

    given: of each its fraction bits and raw ends.
    """
    kernel = rewrite(fuse_selects(walk(ca.Function("f", [X, Y], [expression]))))
    given = (*given, (30, -(2**30), 2**30))

    def source(argument: int, _element: int) -> Source:
        return Source(f"x{argument}", f"in->x{argument}", *given[argument], "x")

    nodes = range(len(kernel.nodes)) if wide else ()
    made = lower(kernel, source, [[Target("y", to)]], wide=nodes, block="tried")
    (node,) = kernel.results[0]
    value = made.values[node]
    assert value is not None
    (_, low, high), count = given[0], 200
    raws = [low + (high - low) * k // (count - 1) for k in range(count)]
    places = {"in->x0": np.array(raws, object), "in->x1": np.full(count, given[1][1], object)}
    return value, raws, [int(v) for v in lowered_values(made, places, count)[node]]


def test_a_division_by_a_number_keeps_all_bits_of_the_product_where_they_fit():
    # A third has 32 bits behind the point, in 31; times raw 1 they are all there are, nothing is
    # cut.  Times raw 2 one is.
    value = computed(X / 3, (28, 0, 1))[0]
    assert (value.fraction, value.local) == (60, 0.0)
    assert 0 < value.relative <= 2.0**-33 * 3
    value = computed(X / 3, (28, 0, 2))[0]
    assert (value.fraction, value.local) == (59, 2.0**-60)


@pytest.mark.parametrize("pick", [ca.fmin, ca.fmax])
def test_a_limit_is_never_passed_by_its_own_rounding(pick):
    # Numbers of no format, cut towards zero whether the nearest would be that one or the other.
    for limit in (0.7, 0.3, -0.7, -0.3):
        for fraction in (3, 4, 5, 6, 7):
            ends = -(2**fraction), 2**fraction
            value, raws, found = computed(pick(X, limit), (fraction, *ends))
            # As fine as what is limited: the limit could fill more bits, and adds none.
            assert value.fraction == fraction
            end = float(value.high if pick is ca.fmin else value.low)
            last = math.trunc(limit * 2**fraction)
            assert end == last / 2**fraction
            one = min if pick is ca.fmin else max
            assert found == [one(v, last) for v in raws]


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize(
    ("expression", "exact", "given"),
    [
        # So small that no format has 31 bits of them: 90 behind the point leave few units, of which
        # a half and no more is lost, at the ends of the range as well.
        (X**2.25, lambda v: v ** mpmath.mpf(2.25), (60, 2**25 + 3, 2**25 + 9_000_003)),
        (X**2.25, lambda v: v ** mpmath.mpf(2.25), (60, 2**24 + 3, 2**24 + 90_003)),
        (X**-1.5, lambda v: v ** mpmath.mpf(-1.5), (-24, 2**29 + 3, 2**29 + 9_000_003)),
        (X**-1.5, lambda v: v ** mpmath.mpf(-1.5), (-26, 2**26 + 3, 2**26 + 900_003)),
        (ca.exp(X), mpmath.exp, (25, -60 * 2**25, -59 * 2**25 + 77)),
        (ca.exp(X), mpmath.exp, (25, -59 * 2**25 + 12345, -58 * 2**25)),
    ],
)
def test_a_result_of_few_units_is_the_nearest_one_up_to_both_ends(expression, exact, given, wide):
    value, raws, found = computed(expression, given, wide=wide, to=45)
    assert value.fraction == 90
    units = []
    with mpmath.workdps(40):
        for v, raw in zip(raws, found, strict=True):
            units.append(exact(mpmath.mpf(v) * mpmath.mpf(2) ** -given[0]) * 2**90)
            assert abs(raw - units[-1]) <= 0.5 + value.relative * float(units[-1]) * 1.01
        assert min(units) > 1
        # What it may be at all is hardly wider, a share of 2^-24 and two units.
        room = 2 + float(max(units)) * 2.0**-24
        assert min(units) - room <= value.expr.low <= min(found)
        assert max(found) <= value.expr.high <= max(units) + room


def test_a_status_word_is_a_whole_number_where_it_is_added_to_one():
    word = flag_word([X > 0, Y > 0, X > Y])
    kernel = rewrite(fuse_selects(walk(ca.Function("f", [X, Y], [word, word + X]))))

    def source(argument: int, _element: int) -> Source:
        return Source(f"x{argument}", f"in->x{argument}", 10, -(2**12), 2**12, "x")

    targets = [[Target("status", 0, word=True)], [Target("y", 8)]]
    made = lower(kernel, source, targets, words=(0,), block="tried")
    given = [(-512, -1024), (512, 1024), (512, 0), (-512, 1024)]
    places = {f"in->x{k}": np.array(v, object) for k, v in enumerate(zip(*given, strict=True))}
    (status,), (y,) = run_lowered(made, places, len(given))
    told = [4, 3, 5, 2]
    assert status.tolist() == told
    assert (y / 2**8).tolist() == [w + x / 1024 for w, (x, _) in zip(told, given, strict=True)]


@pytest.mark.parametrize(
    ("expression", "x_sign", "y_sign"),
    [
        (X - Y, -1, -1),
        (X - Y, 1, 1),
        (Y - X, -1, -1),
        (Y - X, 1, 1),
        (X + Y, -1, 1),
        (X + Y, 1, -1),
    ],
)
def test_a_sum_that_is_smaller_than_its_terms_is_finer_than_they_are(expression, x_sign, y_sign):
    # 2.1 to 2.2 with 29 bits behind the point and 0.8 to 0.9 with 31: what is left, 1.2 to 1.4, has
    # room for 30.
    def ends(low: float, high: float, fraction: int, sign: int) -> tuple[int, int, int]:
        low_raw, high_raw = sorted(sign * round(v * 2**fraction) for v in (low, high))
        return fraction, low_raw, high_raw

    value, raws, found = computed(
        expression, ends(2.1, 2.2, 29, x_sign), ends(0.8, 0.9, 31, y_sign), wide=False
    )
    assert (value.expr.bits, value.fraction, value.local) == (32, 30, 2.0**-31)
    sizes = sorted(abs(float(v)) for v in (value.low, value.high))
    assert sizes == pytest.approx([1.2, 1.4], abs=4 * 2.0**-30)
    (f, g), (least, _) = (29, 31), ends(0.8, 0.9, 31, y_sign)[1:]
    function = ca.Function("f", [X, Y], [expression])
    exact = [float(function(v * 2.0**-f, least * 2.0**-g)) for v in raws]
    assert found == pytest.approx([v * 2**30 for v in exact], abs=0.5001)


def test_what_leads_to_comparisons_alone_is_exact_and_what_does_not_has_32_bits():
    # 2^-30 and 2^-27 as last bits, up to 2 and 15: sums of both have 35 bits.
    z = ca.SX.sym("z")
    f = ca.Function("f", [X, Y, z], [ca.fabs(X + Y) - z < 0.3, (X - Y) - z])
    kernel = rewrite(fuse_selects(walk(f)))

    def source(argument: int, _element: int) -> Source:
        fraction = (30, 27, 27)[argument]
        return Source(f"x{argument}", f"in->x{argument}", fraction, -(2**31) + 1, 2**31 - 1, "x")

    made = lower(kernel, source, [[Target("told", 0)], [Target("y", 25)]], block="tried")
    (compare,), (number,) = kernel.results
    outer = next(a for a in kernel.nodes[compare].args if kernel.nodes[a].op == "sub")
    size = next(a for a in kernel.nodes[outer].args if kernel.nodes[a].op == "fabs")
    (inner,) = kernel.nodes[size].args
    for i in (outer, size, inner):
        assert (made.values[i].expr.bits, made.values[i].fraction) == (64, 30)
        assert made.values[i].local == 0
    first = next(a for a in kernel.nodes[number].args if kernel.nodes[a].op == "sub")
    # Up to 18 and 34: 26 and 25 bits.
    for i, fraction in ((first, 26), (number, 25)):
        assert (made.values[i].expr.bits, made.values[i].fraction) == (32, fraction)
        assert made.values[i].local >= 2.0 ** -(fraction + 1)


# -- errors ----------------------------------------------------------------------------------------


def share(low: float, high: float, a: float, r: float) -> Span:
    return Span(*(np.array([v]) for v in (low, high, a, r)))


@pytest.mark.parametrize("own", [0.0, 0.1, 0.5])
def test_what_an_operation_adds_as_a_share_it_adds_of_the_erring_result(own):
    # Computed as (2 x (1 + r) + 2 a) (1 + own) + local at most.
    kernel = walk(ca.Function("f", [X], [2 * X]))
    work = lowered(kernel, 0.25)
    value = work.values[0]
    work.values = [SimpleNamespace(**vars(value) | {"relative": own})] * len(kernel.nodes)
    results, _, _ = analyse(work, [[share(-1.0, 4.0, 0.125, 0.2)]])
    found = results[0][0]
    assert float(found.a[0]) == pytest.approx(2 * 0.125 * (1 + own) + 0.25)
    assert float(found.r[0]) == pytest.approx((1 + 0.2) * (1 + own) - 1)


@pytest.mark.parametrize("c", [0.4, 2.7])
def test_from_hardly_above_zero_an_exponents_error_is_as_from_zero(c):
    # 2^-28 x^c |ln x|, largest at exp(-1/c); as a share of x^c it would be |ln| of the least x.
    kernel = walk(ca.Function("f", [X], [X**c]))
    results, _, _ = analyse(lowered(kernel), [[share(1e-12, 1.0, 0.0, 0.0)]])
    assert results[0][0].error[0] == pytest.approx(2.0**-28 / (c * math.e), rel=0.002)
    # A share where that is no more than eight times as much: |ln x| of 1/2 beside 1/e.
    results, _, _ = analyse(lowered(kernel), [[share(0.5, 1.0, 0.0, 0.0)]])
    assert float(results[0][0].a[0]) == 0.0
    assert results[0][0].r[0] == pytest.approx(2.0**-28 * math.log(2), rel=0.002)


# -- the order of operations -----------------------------------------------------------------------


def told(kernel: Kernel) -> str:
    return " ".join(n.op if n.op != "input" else f"in{n.source[0]}" for n in kernel.nodes)


def test_what_leads_to_a_long_operation_is_depth_first_however_many_stand_on_its_way():
    # tanh(3 x + exp(y)): one way to one root, whose first operand comes first though exp is long.
    nodes = (
        Node("input", source=(1, 0)),
        Node("exp", (0,)),
        Node("input", source=(0, 0)),
        Node("const", value=3.0),
        Node("mul", (2, 3)),
        Node("add", (4, 1)),
        Node("tanh", (5,)),
    )
    made = calls_first(Kernel("f", nodes, ((6,),)))
    assert told(made) == "in0 const mul in1 exp add tanh"
    assert made.nodes[-2].args == (2, 4)
    assert made.results == ((6,),)


def test_long_operations_then_what_waits_for_none_then_the_rest():
    # Of x y + x, exp(x) and exp(x) - y: x leads to the call, y and what needs no call go between.
    nodes = (
        Node("input", source=(0, 0)),
        Node("input", source=(1, 0)),
        Node("mul", (0, 1)),
        Node("add", (2, 0)),
        Node("exp", (0,)),
        Node("sub", (4, 1)),
        Node("neg", (1,)),
    )
    made = calls_first(Kernel("f", nodes, ((5,), (3, 6))))
    assert told(made) == "in0 exp in1 mul add neg sub"
    assert [n.args for n in made.nodes] == [(), (0,), (), (0, 2), (3, 0), (2,), (1, 2)]
    assert made.results == ((6,), (4, 5))
