"""Rules of the whole-number bound, each against the worst that can be found: safe, and near it."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.fixed import search
from esea_gen.emit.fixed.bound import Span, analyse, span
from esea_gen.emit.fixed.plan import Planner
from esea_gen.emit.ranges import RangeError
from esea_gen.emit.walker import walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Port, around, clip
from esea_gen.verify.fixed import RawExecutor

X, Y = ca.SX.sym("x"), ca.SX.sym("y")


def lowered(kernel, local: float = 0.0):
    """A kernel whose operations are exact, or add ``local`` each; stored numbers as they are."""
    wide = SimpleNamespace(local=local, relative=0.0, constants={}, low=-1e9, high=1e9)
    return SimpleNamespace(
        kernel=kernel,
        values=[wide] * len(kernel.nodes),
        conversions=[[0.0] * len(r) for r in kernel.results],
    )


def bound(expression, x: Span, y: Span) -> tuple[Span, tuple[str, ...]]:
    kernel = walk(ca.Function("f", [X, Y], [expression]))
    results, assumed, _ = analyse(lowered(kernel), [[x], [y]])
    return results[0][0], assumed


def worst(expression, x: Span, y: Span) -> tuple[float, float, float]:
    """Largest error over exact values and errors at their ends, and the exact value's ends."""
    f = ca.Function("f", [X, Y], [expression])

    def pairs(s: Span) -> tuple[np.ndarray, np.ndarray]:
        exact = np.linspace(s.low[0], s.high[0], 61)
        room = s.a[0] + s.r[0] * np.abs(exact)
        return exact, room

    (xs, x_room), (ys, y_room) = pairs(x), pairs(y)
    grid = [g.ravel()[None, :] for g in np.meshgrid(xs, ys)]
    rooms = [g.ravel()[None, :] for g in np.meshgrid(x_room, y_room)]
    exact = np.asarray(f(*grid), float)
    error = 0.0
    for s, t in itertools.product((-1, 1), repeat=2):
        off = np.asarray(f(grid[0] + s * rooms[0], grid[1] + t * rooms[1]), float)
        error = max(error, float(np.nanmax(np.abs(off - exact))))
    return error, float(exact.min()), float(exact.max())


def with_share(low: float, high: float, share: float) -> Span:
    return Span(np.array([low]), np.array([high]), np.zeros(1), np.array([share]))


SMALL, NEAR, ACROSS = span(0.5, 2.0, 1e-4, 1), span(3.0, 5.0, 2e-4, 1), span(-1.5, 2.0, 1e-4, 1)
AT_ZERO = span(0.0, 2.0, 1e-4, 1)


@pytest.mark.parametrize(
    ("expression", "x", "y", "loose"),
    [
        (X + Y, ACROSS, NEAR, 1.001),
        (X - Y, ACROSS, NEAR, 1.001),
        (-X, ACROSS, NEAR, 1.001),
        (2 * X, ACROSS, NEAR, 1.001),
        (ca.fabs(X), ACROSS, NEAR, 1.001),
        (X * Y, ACROSS, NEAR, 1.01),
        (X * Y, SMALL, NEAR, 1.2),
        (X * X, ACROSS, NEAR, 1.01),
        (X / Y, ACROSS, NEAR, 1.3),
        (X / Y, SMALL, NEAR, 4.0),
        (ca.fmin(X, Y), ACROSS, NEAR, 1.001),
        (ca.fmax(X, Y), ACROSS, NEAR, 1.001),
        (ca.fmin(Y, X), ACROSS, NEAR, 1.001),
        (ca.fmax(Y, X), ACROSS, NEAR, 1.001),
        (ca.fmin(X, Y), ACROSS, ACROSS, 1.001),
        (ca.if_else(Y > 1, X, Y), ACROSS, NEAR, 1.001),
        (ca.if_else(Y < 1, X, Y), ACROSS, NEAR, 1.001),
        (ca.exp(X), ACROSS, NEAR, 1.01),
        (ca.tanh(X), ACROSS, NEAR, 1.01),
        (ca.log(Y), ACROSS, NEAR, 1.01),
        (ca.log(X), SMALL, NEAR, 1.01),
        (ca.sqrt(X), AT_ZERO, NEAR, 1.01),
        (ca.sqrt(X), SMALL, NEAR, 2.1),
        (X**0.4, AT_ZERO, NEAR, 1.01),
        (X**0.4, SMALL, NEAR, 2.5),
        (Y**0.4, ACROSS, NEAR, 1.5),
        (X**2.7, SMALL, NEAR, 6.0),
        (X**2.7, AT_ZERO, NEAR, 1.01),
        (X**-1.3, SMALL, NEAR, 6.0),
        (X + Y, with_share(0.5, 2.0, 1e-3), with_share(3.0, 5.0, 1e-3), 1.01),
        (X * Y, with_share(0.5, 2.0, 1e-3), with_share(3.0, 5.0, 1e-3), 1.01),
        (X / Y, with_share(0.5, 2.0, 1e-3), with_share(3.0, 5.0, 1e-3), 1.01),
        (X**2.7, with_share(0.5, 2.0, 1e-3), NEAR, 1.01),
        (X**0.4, with_share(0.5, 2.0, 1e-3), NEAR, 1.01),
        (X**-1.3, with_share(0.5, 2.0, 1e-3), NEAR, 1.01),
        (ca.sqrt(X), with_share(0.5, 2.0, 1e-3), NEAR, 1.01),
    ],
)
def test_no_error_beyond_the_bound_and_none_much_below(expression, x, y, loose):
    found, assumed = bound(expression, x, y)
    error, low, high = worst(expression, x, y)
    # Of a root at 0 the computed argument may be below it, where the C gives 0.
    assert float(found.error[0]) >= error * (1 - 1e-6), (found, error)
    assert float(found.error[0]) <= loose * error + 1e-7, (found, error)
    # The exact value lies inside, and its ends are reached.
    width = high - low
    assert float(found.low[0]) <= low + 1e-9
    assert float(found.high[0]) >= high - 1e-9
    assert float(found.low[0]) >= low - 0.02 * width
    assert float(found.high[0]) <= high + 0.02 * width
    assert assumed == ()


# Errors so large that the products of errors count: what is left out of a rule shows.
ACROSS_BOTH = Span(*(np.array([v]) for v in (-1.5, 2.0, 0.1, 0.2)))
FAR_BOTH = Span(*(np.array([v]) for v in (3.0, 5.0, 0.3, 0.1)))


@pytest.mark.parametrize(
    ("x", "y"),
    [
        (span(0.5, 2.0, 0.2, 1), span(3.0, 5.0, 0.4, 1)),
        (span(0.5, 2.0, 0.2, 1), span(-5.0, -3.0, 0.4, 1)),
        (span(-1.5, 2.0, 0.2, 1), with_share(3.0, 5.0, 0.2)),
        (with_share(0.5, 2.0, 0.3), with_share(3.0, 5.0, 0.2)),
        (ACROSS_BOTH, FAR_BOTH),
    ],
)
def test_products_of_errors_count(x, y):
    for expression in (X * Y, X / Y, Y * X, X * X, ca.fabs(X)):
        found, _ = bound(expression, x, y)
        error, _, _ = worst(expression, x, y)
        # A quotient's two errors are largest at two places, of which a share takes the worse.
        loose = 3.5 if x.r[0] == y.r[0] == 0 and expression.is_op(ca.OP_DIV) else 1
        assert error * (1 - 1e-6) <= float(found.error[0]) <= loose * error * (1 + 1e-6)


@pytest.mark.parametrize(
    ("low", "high", "loose"),
    [(0.0, 1.0, 1.001), (0.0, 0.5, 1.1), (0.0, 3.0, 1.001), (0.01, 0.5, 9.0), (2.0, 3.0, 1.6)],
)
@pytest.mark.parametrize("c", [0.4, 2.7, -1.3])
def test_an_exponent_that_is_off_turns_a_power_by_its_logarithm(low, high, loose, c):
    if c < 0 and low == 0:
        return
    found, _ = bound(X**c, span(low, high, 0.0, 1), NEAR)
    # By the derivative: x^c |ln x| for each unit of the exponent, 2^-28 off at most.
    x = np.linspace(max(low, 1e-12), high, 200001)
    off = 2.0**-28 * x**c * np.abs(np.log(x))
    model = float(found.a[0]) + float(found.r[0]) * x**c
    assert np.all(off <= model * (1 + 1e-9))
    assert float(found.error[0]) <= loose * off.max() * 1.002


def test_what_no_bound_holds_is_refused():
    for expression in (1 / X, Y / X, ca.log(X), X**-1.3):
        with pytest.raises(RangeError):
            bound(expression, ACROSS, NEAR)
    with pytest.raises(RangeError, match="as large as itself"):
        bound(Y / X, span(1e-4, 1.0, 1e-4, 1), NEAR)


def test_a_decision_that_rounding_may_turn_is_named():
    choice = ca.if_else(X < Y, X, 2 * Y)
    # Apart by less than both errors together it may go either way; beyond them it may not.
    for apart, turned in ((2.9e-4, True), (3.1e-4, False)):
        x = span(0.0, 3.0 - apart, 1e-4, 1)
        found, assumed = bound(choice, x, NEAR)
        assert bool(assumed) == turned
        if not turned:
            assert found.error[0] == pytest.approx(1e-4)
    # One that only a status word uses is none.
    kernel = walk(ca.Function("f", [X, Y], [X, X < Y]))
    results, assumed, _ = analyse(lowered(kernel), [[ACROSS], [ACROSS]], flag_results=(1,))
    assert assumed == ()
    assert results[0][0].error[0] == pytest.approx(1e-4)
    _, assumed, _ = analyse(lowered(kernel), [[ACROSS], [ACROSS]])
    assert len(assumed) == 1


def test_what_each_operation_adds_itself_goes_on_through_the_rest():
    kernel = walk(ca.Function("f", [X, Y], [3.0 * (X + Y)]))
    exact = span(1.0, 2.0, 0.0, 1)
    results, _, _ = analyse(lowered(kernel, 1e-5), [[exact], [exact]])
    assert results[0][0].error[0] == pytest.approx(4e-5, rel=1e-6)
    work = lowered(kernel, 0.0)
    work.conversions = [[7e-5]]
    results, _, _ = analyse(work, [[exact], [exact]])
    assert results[0][0].error[0] == pytest.approx(7e-5)


def test_facts_narrow_and_a_sign_is_sure_away_from_zero():
    kernel = walk(ca.Function("f", [X, Y], [X * Y]))
    (i,) = kernel.results[0]
    facts = {i: (np.array([0.0]), np.array([4.0]))}
    results, _, _ = analyse(lowered(kernel), [[ACROSS], [NEAR]], facts=facts)
    assert (results[0][0].low[0], results[0][0].high[0]) == (0.0, 4.0)
    for low, high, error, off in (
        (0.5, 2, 0.4, 0.0),
        (0.5, 2, 0.6, 2.0),
        (-2, -0.5, 0.4, 0.0),
        (-2, -0.5, 0.6, 2.0),
        (-1, 1, 0.0, 0.0),
    ):
        found, _ = bound(ca.sign(X), span(low, high, error, 1), NEAR)
        assert found.error[0] == off, (low, high, error)


@pytest.mark.parametrize("compared", [True, False])
def test_the_magnitude_of_a_memory_that_fills_its_32_bits(compared):
    # -2 is the raw number -2^31, whose magnitude is none of 32 bits: a comparison takes it in 64
    # and tells every number from the next; elsewhere the last bit is rounded away.
    def step(c, s, u, g, label):
        size = ca.fabs(s.m)
        return {"m": u.x_rad}, {"y": size > 1.5 if compared else size}

    block = Block.define(
        "magnitude",
        "Magnitude of a memory",
        period_s=0.001,
        state=(Port("m", -2.0, 1.9, "memory", repair="block"),),
        inputs=(Port("x_rad", -2.0, 1.9, "input"),),
        outputs=(around("y", 2.0, "y"),),
        step=step,
    )
    plan = Planner(block).plan()
    edge = 3 * 2**29  # 1.5
    raw = [-(2**31), -(2**31) + 1, *(s * (edge + d) for s in (1, -1) for d in (-1, 0, 1)), 0]
    y, _ = RawExecutor(plan).run({"x_rad": np.array(raw, dtype=np.int32)})
    found = (y["y"] * plan.field("out", "y").lsb)[1:]
    size = np.abs(raw[:-1]) * 2.0**-30
    lost = 0.0 if compared else 2.0**-30
    assert np.abs(found - (size > 1.5 if compared else size)).max() == lost
    taken = next(i for i, n in enumerate(plan.step.kernel.nodes) if n.op == "fabs")
    assert plan.step.values[taken].local == lost


@pytest.mark.parametrize("holds", [True, False])
def test_a_condition_that_the_range_decides_leaves_the_arm_alone(holds):
    def block(always):
        def step(c, s, u, g, label):
            arm, other = 0.3 * u.x_rad, 0.9 * u.x_rad * u.x_rad
            condition = u.x_rad <= 5 if holds else u.x_rad > 5
            chosen = ca.if_else(condition, *((arm, other) if holds else (other, arm)))
            return {}, {"y": chosen if always else arm}

        return Block.define(
            "decided",
            "Decided",
            period_s=0.001,
            state=(),
            inputs=(Port("x_rad", -1.0, 1.0, "input"),),
            outputs=(around("y", 1.0, "y"),),
            step=step,
        )

    x = np.array([-(2**30), -7, 0, 3, 2**30], dtype=np.int32)
    found, plain = (RawExecutor(Planner(block(k)).plan()).run({"x_rad": x})[0] for k in (1, 0))
    assert np.array_equal(found["y"], plain["y"])


def test_both_arms_before_a_clip_are_told_to_lose_bits():
    def step(c, s, u, g, label):
        chosen = ca.if_else(u.x_rad > 0.25, 300 * u.x_rad, 400 * u.x_rad * u.x_rad)
        return {}, {"y": clip(label("chosen", chosen), -1, 1)}

    block = Block.define(
        "wide",
        "Wide before its clip",
        period_s=0.001,
        state=(),
        inputs=(Port("x_rad", -1.0, 1.0, "input"),),
        outputs=(around("y", 1.0, "y"),),
        step=step,
    )
    plan = Planner(block).plan()
    nodes = plan.step.kernel.nodes
    told = {i for i, why in search._clipped(plan, True).items() if "before the clip" in why}
    selects = [i for i, n in enumerate(nodes) if n.op in ("select", "if_else_zero") and i in told]
    assert selects
    assert all(a in told for i in selects for a in nodes[i].args[1:] if nodes[a].op == "mul")
    # 300 x and 400 x^2.
    assert sum(nodes[i].op in ("mul", "sq") for i in told) >= 2
