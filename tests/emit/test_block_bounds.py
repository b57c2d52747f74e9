"""Bounds of Blocks: for all time, of one step, by a matrix, of solved values."""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import esea_gen
from esea_gen.emit import step_errors
from esea_gen.emit.error_bounds import block_bound, node_errors, step_bound, whole_nodes
from esea_gen.emit.fixed import errors as fixed
from esea_gen.emit.fixed.plan import BlockPlan, Planner
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.spans import RangeError
from esea_gen.emit.walker import fuse_selects, walk
from esea_gen.language.block import Block, Solved
from esea_gen.language.ports import Flag, Port, Tunable, clip, flag_word
from tests.made_up import made, port

F32 = FORMATS["f32"]
U = 2.0**-24
K, X, Y = (ca.SX.sym(n) for n in "kxy")


# -- fixed points ----------------------------------------------------------------------------------


def found(image, zero):
    """Of a map of errors, without a Block behind it."""
    return step_errors.fixed_point(
        SimpleNamespace(images=lambda cases: map(image, cases), zero=zero)
    )


@pytest.mark.parametrize("pole", [0.1, 0.5, 0.9, 0.99, 1 - 1e-6])
def test_errors_that_shrink_by_a_factor_sum_to_the_geometric_series(pole):
    (((e,),)) = found(lambda errors: [[pole * errors[0][0] + 3e-7]], [[0.0]])
    exact = 3e-7 / (1 - pole)
    # A multiple of a power of four, its gap halved four times: a sixteenth of it is left.
    assert exact * (1 - 1e-9) <= e <= exact * 4 ** (1 / 16)
    assert pole * e + 3e-7 <= e * (1 + 1e-12)


def test_errors_that_grow_have_none():
    for pole in (1.0, 1.5, 1 - 1e-12):
        assert found(lambda e, p=pole: [[p * e[0][0] + 1e-7]], [[0.0]]) is None


def test_an_error_that_does_not_accumulate_stays_its_own_size():
    # The second is what one step adds and no more; the third follows the first.
    def image(errors):
        (a, _b), (_c,) = errors
        return [[0.9 * a + 1e-6, 2e-6], [0.5 * (0.9 * a + 1e-6)]]

    (a, b), (c,) = found(image, [[0.0, 0.0], [0.0]])
    assert 1e-5 * (1 - 1e-9) <= a <= 1e-5 * 4 ** (1 / 16)
    assert b == 2e-6
    assert 0.5e-5 * (1 - 1e-9) <= c <= 0.5e-5 * 4 ** (1 / 16)
    assert found(lambda errors: [[2e-6]], [[0.0]]) == [[2e-6]]


# -- floating point --------------------------------------------------------------------------------


def leaky(gain: float) -> Block:
    # With units: ports without one and with whole ends are taken as counting.
    def step(c, s, u, guard, label):
        return {"s_rad": gain * s.s_rad + u.x_rad}, {"y_rad": gain * s.s_rad + u.x_rad}

    return made(step, (port("s_rad", -100, 100),), most=100)


def test_a_filter_that_forgets_has_a_bound_for_all_time():
    bound = block_bound(leaky(0.99), F32)
    # By hand: |s| <= 100; one step errs by at most u (99 + 100) and the constant's u 99; all of
    # that over 1 - 0.99.
    u = 2.0**-24
    assert 0.2 * u * 300 / 0.01 < bound.states["s_rad"] < 1.5 * u * 300 / 0.01


@pytest.mark.parametrize("ranges", [None, {"s_s_rad": (-10, 10)}])
def test_an_integrator_has_none(ranges):
    with pytest.raises(RangeError, match="stable"):
        block_bound(leaky(1.0), F32, ranges)


def test_sensor_bounds():
    device = esea_gen.load_device("elbow")
    bound = block_bound(device.sensor, F32)
    assert bound.assumptions == ()  # no decision of the sensor depends on rounding
    assert bound.outputs["tau_Nm"] < 0.01 * device.tau_full_scale_Nm
    assert bound.outputs["tau_hysteresis_Nm"] < 1e-5  # nothing is summed over time


def test_a_filter_that_switches_is_not_called_linear():
    # Which matrix rules depends on an input: one matrix taken at rest would say nothing.
    def step(c, s, u, guard, label):
        turn = ca.DM([[0.955, -0.296], [0.296, 0.955]])
        x = ca.vertcat(s.x[0], s.x[1])
        return {"x": ca.if_else(u.m > 0, 0.99999 * turn @ x + u.w, 0.5 * turn @ x)}, {"y": s.x[0]}

    inputs = port("m", -1, 1), port("w", -1, 1)
    block = made(step, (port("x", -100, 100, 2),), inputs, (port("y", -100, 100),))
    with pytest.raises(RangeError, match="not stable"):
        block_bound(block, F32)


def test_a_filter_whose_errors_settle_has_a_fixed_point_and_a_rotation_its_matrix():
    def leak(c, s, u, g, label):
        new = 0.75 * s.m_rad + 0.25 * u.x_rad
        return {"m_rad": new}, {"y_rad": new}

    bound = block_bound(made(leak, (Port("m_rad", -1, 1, "memory"),)), F32)
    # Constants are exact: the product is off by U 3/4, that of x by U/4, their sum by U.
    assert bound.states["m_rad"] == pytest.approx(4 * 2 * U, rel=0.1)
    assert bound.outputs["y_rad"] == pytest.approx(bound.states["m_rad"], rel=0.05)
    assert (bound.steps, bound.method, bound.assumptions) == (math.inf, "fixed point", ())

    def rotation(c, s, u, g, label):
        a, b = s.m_rad[0], s.m_rad[1]
        new = [0.75 * a - 0.625 * b + 0.01 * u.x_rad, 0.625 * a + 0.75 * b]
        return {"m_rad": new}, {"y_rad": new[0]}

    turned = block_bound(made(rotation, (Port("m_rad", -1, 1, "memory", 2),)), F32)
    assert turned.method == "linear"
    clips = ("made: no clip of a state acts", "made: no invalid input is bridged")
    assert turned.assumptions == clips
    # Its radius is 0.976; each step adds some U, a series of about 2/pi of 1 / (1 - 0.976).
    one = step_bound(made(rotation, (Port("m_rad", -1, 1, "memory", 2),)), F32).states["m_rad"]
    radius = math.hypot(0.75, 0.625)
    assert one / (1 - radius) < turned.states["m_rad"] < 1.5 * one / (1 - radius)


def test_a_bound_at_the_ends_of_the_range_is_none():
    # Errors of a clipped integral fill the range, which says nothing.
    def step(c, s, u, g, label):
        new = clip(s.m_rad * (1 + 1e-3 * u.x_rad) + u.x_rad, -1, 1)
        return {"m_rad": new}, {"y_rad": new}

    with pytest.raises(RangeError, match="made: not stable, rounding errors may grow"):
        block_bound(made(step, (Port("m_rad", -1, 1, "memory"),)), F32)


@pytest.mark.parametrize(("low", "high"), [(-1, 3), (-5, 2)])
def test_one_steps_errors_hold_a_millionth_of_the_width_beyond_each_range(low, high):
    # A product of exact numbers is off by U of its largest.
    def step(c, s, u, g, label):
        return {"s_rad": s.s_rad / 4}, {"y_rad": s.s_rad * u.x_rad}

    block = made(step, (Port("s_rad", low, high, "memory"),), (Port("x_rad", -0.5, 1, "in"),))
    beyond = max(high + (high - low) * 1e-6, (high - low) * 1e-6 - low)
    wanted = pytest.approx(U * beyond * (1 + 1.5e-6), rel=1e-9, abs=0)
    kernel, errors = node_errors(block, F32)
    (product,) = (e for n, e in zip(kernel.nodes, errors, strict=True) if n.op == "mul")
    assert product == wanted
    assert step_bound(block, F32).outputs["y_rad"] == wanted


def test_what_a_word_alone_decides_is_no_assumption():
    def step(c, s, u, g, label):
        return {}, {"y_rad": u.x_rad, "flags": flag_word([0.7 * u.x_rad > 0.3, u.x_rad > 0.25])}

    flags = (Flag("STEEP", "is steep"), Flag("MORE", "is more"))
    outputs = (Port("y_rad", -1, 1, "y"), Port("flags", 0, 3, "word", flags=flags))
    block = made(step, outputs=outputs)
    for bound in (step_bound(block, F32), block_bound(block, F32)):
        assert bound.assumptions == ()
        assert bound.outputs == {"y_rad": 0.0}


# -- what counts, and what is linear ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("low", "high", "whole"),
    [
        (0, 1.5, False),
        (-1, 0, False),
        (-1, 1, True),
        (1 - 2**24, 0, True),
        (-(2**24), 0, False),
        (-3.5, 2, False),
    ],
)
def test_ends_of_a_count(low, high, whole):
    assert step_errors.counts(Port("n", low, high, "count", init=0)) is whole


def test_counts_that_lead_to_each_other_are_whole_only_together():
    # b is a; a is b: all whole, unless a third that is not comes in by one of them.
    def step(gain):
        def after(c, s, u, g, label):
            return {"a": s.b, "b": s.a, "d": clip(s.b + gain * u.k, 0, 9)} | (
                {"b": s.d} if gain != 1 else {}
            ), {"y_rad": u.x_rad * s.a}

        return after

    state = tuple(Port(n, 0, 9, "count") for n in "abd")
    inputs = (Port("k", 0, 3, "step"), Port("x_rad", -1, 1, "in"))
    for gain, is_whole in ((1, True), (0.5, False)):
        block = made(step(gain), state, inputs)
        kernel = fuse_selects(walk(block.step))
        whole = whole_nodes(block, kernel, F32)
        read = {
            n.source[0]: i in whole for i, n in enumerate(kernel.nodes) if n.op == "input"
        }  # states a, b, d, then k and x
        states = [read[k] for k in range(3) if k in read]
        assert states == [is_whole] * len(states)
        assert (read[3], read[4]) == (True, False)


@pytest.mark.parametrize(
    ("expression", "linear"),
    [
        (0.5 * X + Y, True),
        (K * X - Y / K, True),
        (ca.exp(K) * X, True),
        (ca.fmin(X, 1) + ca.if_else(Y > 0, X, -Y), True),
        (ca.fabs(X), True),
        (X * Y, False),
        (X**2, False),
        (K / X, False),
        (1 / X, False),
        (ca.sqrt(Y), False),
        (ca.tanh(X), False),
        (ca.exp(X), False),
        (ca.log(Y), False),
        (X**0.7, False),
        (ca.sign(X), False),
        (K**2 * X + 1 / K, True),
    ],
)
def test_what_enters_linearly(expression, linear):
    assert step_errors.is_linear(walk(ca.Function("f", [K, X, Y], [expression])), 1) is linear


def pair(primed: bool = False, bend: float = 0.0, mode: bool = False) -> Block:
    """a' = a / 2 + g b + x, b' = 0.9 b, as prepared with g = t / 8."""

    def step(c, s, u, g, label):
        turn = ca.if_else(u.mode > 1, 0.25, 0.5) if mode else 0.5
        after = {
            "a_rad": turn * s.a_rad + c.g * s.b_rad[0] + u.x_rad + bend * s.a_rad * u.x_rad,
            "b_rad": [0.9 * s.b_rad[0], 0.3 * s.b_rad[1]],
        }
        out = s.a_rad
        if primed:
            out = ca.if_else(s.primed > 0, s.a_rad, u.x_rad)
            after = {"a_rad": ca.if_else(s.primed > 0, after["a_rad"], u.x_rad),
                     "b_rad": after["b_rad"], "primed": 1}  # fmt: skip
        return after, {"y_rad": out}

    state = (Port("a_rad", -99, 99, "a"), Port("b_rad", -99, 99, "b", 2))
    inputs = (Port("x_rad", -1, 1, "in"), *((Port("mode", 0, 3, "mode"),) if mode else ()))
    return made(
        step,
        (*state, *((Port("primed", 0, 1, "has started"),) if primed else ())),
        inputs,
        most=99.0,
        tunables=(Tunable("t", 2.0, 1.0, 4.0, "tunes"),),
        coefficients=(Port("g", 0.0, 1.0, "gain"),),
        prepare=lambda t: {"g": t.t / 8},
    )


def test_the_matrix_of_a_linear_block():
    wanted = np.array([[0.5, 0.25, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 0.3]])
    assert step_errors.state_matrix(pair()) == pytest.approx(wanted)
    started = pair(primed=True)
    padded = np.zeros((4, 4))
    padded[:3, :3] = wanted
    assert step_errors.state_matrix(started) == pytest.approx(padded)
    jacobian = step_errors.state_jacobian(pair())
    assert np.asarray(ca.DM(jacobian(0.125, 7, [1, 2], 0)))[0] == pytest.approx([0.5, 0.125, 0])
    # One that an input bends, or that a mode chooses, is none.
    assert step_errors.state_matrix(pair(bend=0.1)) is None
    assert step_errors.state_matrix(pair(mode=True)) is None


def test_the_matrix_is_of_the_states_alone_each_by_its_place():
    def step(c, s, u, g, label):
        a, b = s.a_rad, s.b_rad
        return (
            {"a_rad": 0.5 * a + 2 * b[0] - 3 * b[1] + 7 * u.x_rad, "b_rad": [a / 8, 0.25 * b[0]]},
            {"y_rad": 11 * a},
        )

    block = made(step, (Port("a_rad", -99, 99, "a"), Port("b_rad", -99, 99, "b", 2)))
    wanted = [[0.5, 2, -3], [0.125, 0, 0], [0, 0.25, 0]]
    assert step_errors.state_matrix(block) == pytest.approx(np.array(wanted))
    # Errors sum through its powers, absolute: 40 powers leave 1e-12 of them.
    d = np.array([1e-7, 2e-7, 3e-7])
    powers = [np.abs(np.linalg.matrix_power(np.array(wanted), k)) @ d for k in range(200)]
    (a,), b = step_errors.linear_bound(block, [[1e-7], [2e-7, 3e-7]])
    assert [a, *b] == pytest.approx((np.sum(powers, axis=0) * 1.000001).tolist(), rel=1e-10, abs=0)


# -- fixed point -----------------------------------------------------------------------------------


MOST, SLOPE, JUMP = 1e-9, 1.25, 3e-9


def solved(jump: float) -> Block:
    """y with 1.25 y = x; of it a state, twice the residual, and two outputs."""

    def step(c, s, u, g, label):
        y = label("y_rad", 1e5 * u.x_rad - 99999.2 * u.x_rad)
        off = label("residual", SLOPE * y - u.x_rad)
        out = {"y": y, "off": 2 * off, "z": 0.7 * label("between", y + 1.0), "w": 0.3 * (s.m + y)}
        return {"m": 0.5 * y}, out | {"status": flag_word([ca.fabs(off) > MOST])}

    outputs = (
        Port("y", -1.0, 1.0, "solution"),
        Port("off", -4.0, 4.0, "twice the residual"),
        Port("z", -2.0, 2.0, "beside it"),
        Port("w", -2.0, 2.0, "with the memory"),
        Port("status", 0, 1, "word", flags=(Flag("OPEN", "not solved"),)),
    )
    return made(
        step,
        state=(Port("m", -1.0, 1.0, "memory", repair="block"),),
        outputs=outputs,
        facts={"y_rad": (-0.5, 0.8)},
        solved={"y_rad": Solved("residual", MOST, SLOPE, jump)},
    )


def own(plan: BlockPlan, node: int) -> float:
    """What the lowering itself says that a node's operation errs by, constants included."""
    v, n = plan.step.values[node], plan.step.kernel.nodes[node]
    numbers = [plan.step.kernel.nodes[a].value for a in n.args]
    # The other operand's constant multiplies at most 0.8, the largest y; a share that of 0.8.
    stored = sum(0.8 * e for e in v.constants.values())
    return v.local + stored + v.relative * 0.8 * max(map(abs, [1.0, *numbers]))


def node_of(plan: BlockPlan, name: str) -> int:
    return next(i for i, (n, _) in plan.labels.items() if n == name)


@pytest.mark.parametrize("jump", [0.0, JUMP, 1e-6])
def test_a_solved_value_errs_by_its_residual_and_what_that_errs_by_over_the_slope(jump):
    plan = Planner(solved(jump=jump)).plan()
    residual = node_of(plan, "residual")
    (product, _x) = plan.step.kernel.nodes[residual].args
    # What the residual rounds by itself is beside what is allowed, 1e-9, of the same size.
    rounded = own(plan, product) + own(plan, residual)
    assert 1e-10 < rounded < 1e-8
    error = (MOST + rounded) / SLOPE + jump
    ((m,), (y,), (off,), (z,), (w,), _), assumed = fixed.Propagation(plan).once([[0.0]])
    assert y == pytest.approx(error, rel=0.02)
    assert m == pytest.approx(0.5 * y, abs=2.0**-31)
    assert off == pytest.approx(2 * (SLOPE * y + rounded), rel=0.05)
    assert z == pytest.approx(0.7 * y, abs=3 * 2.0**-30)
    assert w == pytest.approx(0.3 * y, abs=3 * 2.0**-30)
    assert assumed == ("made: |residual| of y_rad is at most 1e-09",)


def test_a_linear_one_is_summed_by_its_matrix_where_its_range_is_small():
    # m' = m / 2 + half of a clipped steep gain: of 11 bits, or hardly of 10.
    def block(most: float, linear: bool) -> Block:
        def step(c, s, u, g, label):
            x = u.x_rad if linear else u.x_rad * ca.fabs(u.x_rad)
            return {"m": 0.5 * s.m + 0.5 * clip(1e6 * x, -1, 1)}, {"y_rad": s.m}

        return made(step, (Port("m", -most, 2 * most, "memory", repair="block"),))

    for linear in (False, True):
        error = fixed.block_bound(Planner(block(0.01, linear)).plan()).states["m"]
        # The gain errs by 2^-11; a product before it by half of 2^-30, a million times.
        before = 0.0 if linear else 1e6 * 2.0**-31
        assert error == pytest.approx(2.0**-11 + before, rel=0.05)
        edge = 4 * error / 3  # a bound of more than a quarter of the range says nothing
        fits = fixed.block_bound(Planner(block(1.002 * edge, linear)).plan())
        assert (fits.method, fits.states["m"]) == ("fixed point", pytest.approx(error, rel=1e-3))
        beyond = Planner(block(0.998 * edge, linear)).plan()
        if linear:
            assert fixed.block_bound(beyond).method == "linear"
        else:
            with pytest.raises(RangeError, match="made: not stable, rounding errors may grow"):
                fixed.block_bound(beyond)


def integral(most: float) -> Block:
    def step(c, s, u, g, label):
        return {"m": clip(s.m * (1 + 0.125 * u.x_rad), -most, most)}, {"y_rad": 0.3 * s.m}

    return made(step, state=(Port("m", -most, most, "memory", repair="block"),))


def test_what_does_not_forget_has_the_bound_of_a_step():
    plan = Planner(integral(0.5)).plan()
    with pytest.raises(RangeError, match="not stable"):
        fixed.block_bound(plan)
    one, found = fixed.step_bound(plan), fixed.any_bound(plan)
    assert found == one
    assert (one.format, one.steps, one.method) == ("q31", 1, "one step")
    # Of one step the product's rounding; no more than the range where that is narrower.
    assert 0 < one.states["m"] < 2.0**-28
    assert one.outputs["y_rad"] < 2.0**-29
