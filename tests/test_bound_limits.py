"""A bound for all time at its own edges: sums of a search, idle bounds, matrices that vary."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.error_bounds import (
    block_bound,
    counts,
    fixed_point,
    linear_bound,
    node_errors,
    state_jacobian,
    state_matrix,
    step_bound,
    whole_nodes,
)
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.ranges import RangeError
from esea_gen.emit.walker import fuse_selects, walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, clip, flag_word

F32, F64, U = FORMATS["f32"], FORMATS["f64"], 2.0**-24


def made(step, state=(), inputs=None, outputs=None, **more) -> Block:
    return Block.define(
        "made",
        "made up",
        period_s=1e-3,
        state=state,
        inputs=inputs or (Port("x_rad", -1, 1, "what comes in"),),
        outputs=outputs or (Port("y_rad", -9, 9, "what comes out"),),
        step=step,
        **more,
    )


# -- fixed points ----------------------------------------------------------------------------------


def searched(image, zero):
    return fixed_point(image, lambda errors: errors, zero)


@pytest.mark.parametrize("pole", [0.3, 0.8, 0.95, 0.999, 1 - 1e-5])
def test_the_multiple_that_is_taken_is_the_least_of_sixteenth_powers_of_four(pole):
    # Three steps from zero sum to 1 + p + p^2, of which f is no less than 1 / (1 - p^3) of it;
    # three steps more leave p^3 of that and add the sum again.
    once = 1 + pole + pole**2
    least = 1 / (1 - pole**3)
    j = math.ceil(4 * math.log2(least) * 2)
    (((e,),)) = searched(lambda errors: [[pole * errors[0][0] + 1.0]], [[0.0]])
    assert e == pytest.approx(once + pole**3 * 4 ** (j / 16) * once, rel=1e-9)


@pytest.mark.parametrize(("share", "is_bound"), [(0.99, True), (1.01, False)])
def test_errors_may_sum_up_to_four_to_the_twelfth_of_three_steps(share, is_bound):
    # 1 - p^3 of 4^-12, a little more or less.
    pole = (1 - 4.0**-12 / share) ** (1 / 3)
    found = searched(lambda errors: [[pole * errors[0][0] + 1.0]], [[0.0]])
    assert (found is not None) is is_bound


def test_an_error_that_is_only_held_is_not_multiplied():
    # A value that is kept or replaced errs by the larger; beside it one that sums up.
    def image(errors):
        (held, summed), (last,) = errors
        return [[max(held, 3e-6), 0.9 * summed + 1e-6], [max(last, 2e-6, 0.1 * summed)]]

    (held, summed), (last,) = searched(image, [[0.0, 0.0], [0.0]])
    assert (held, last) == (3e-6, 2e-6)
    assert 1e-5 * (1 - 1e-9) <= summed <= 1e-5 * 4 ** (1 / 16)


def test_an_error_that_stops_but_for_rounding_is_not_multiplied():
    # The first grows by three parts of 10^13 at a time, two times, and is held then.
    def image(errors):
        ((held, summed),) = errors
        more = min(max(held, 1e-6) + 3e-19 * (held > 0), max(held, 1e-6 + 6e-19))
        return [[more, 0.9 * summed + 1e-6]]

    ((held, summed),) = searched(image, [[0.0, 0.0]])
    assert held == pytest.approx(1e-6, rel=1e-11)
    assert 1e-5 * (1 - 1e-9) <= summed <= 1e-5 * 4 ** (1 / 16)


# -- bounds that fill their range ------------------------------------------------------------------


def there_and_back(by: float) -> dict:
    """Two equal coefficients, exact."""
    return {
        "tunables": (Tunable("by", by, by, 2 * by, "how far"),),
        "coefficients": tuple(Port(n, by, 2 * by, "how far") for n in ("up", "down")),
        "prepare": lambda t: {"up": t.by, "down": t.by},
    }


def coarse(most: float, linear: bool) -> Block:
    """s' = s / 2 + an input (or its signed square) that is rounded to parts of 2^20."""

    def step(c, s, u, g, label):
        x = u.x_rad if linear else u.x_rad * ca.fabs(u.x_rad)
        after = 0.5 * s.s_rad + ((x + c.up) - c.down)
        return {"s_rad": after, "calm_rad": 0.25 * u.x_rad}, {"y_rad": s.s_rad}

    state = (Port("s_rad", -most, 2 * most, "memory"), Port("calm_rad", -1, 1, "no memory"))
    return made(step, state, **there_and_back(2.0**20))


def test_a_bound_of_more_than_a_quarter_of_a_states_range_is_none():
    # Half of the error is kept, so that it sums to twice one step's: 2^20 U.
    error = block_bound(coarse(0.5, False), F32).states["s_rad"]
    assert error == pytest.approx(2 * 2.0**20 * U, rel=0.05)
    fits = block_bound(coarse(4 * error / 3 * 1.002, False), F32)
    assert fits.states["s_rad"] == pytest.approx(error, rel=1e-4)
    assert (fits.method, fits.steps) == ("fixed point", math.inf)
    with pytest.raises(RangeError, match="made: not stable"):
        block_bound(coarse(4 * error / 3 * 0.998, False), F32)
    # A linear one is then summed by its matrix.
    assert block_bound(coarse(4 * error / 3 * 1.002, True), F32).method == "fixed point"
    summed = block_bound(coarse(4 * error / 3 * 0.998, True), F32)
    assert (summed.method, summed.steps) == ("linear", math.inf)
    assert summed.states["s_rad"] == pytest.approx(2 * 2.0**20 * U, rel=1e-3)
    assert summed.outputs["y_rad"] == pytest.approx(summed.states["s_rad"], rel=1e-6)
    assert summed.assumptions == (
        "made: no clip of a state acts",
        "made: no invalid input is bridged",
    )


def test_an_error_is_no_larger_than_the_states_range():
    # Rounded to parts of 2^28 where both values lie in -1 to 0.5 anyway.
    def step(c, s, u, g, label):
        return {"s_rad": (u.x_rad + c.up) - c.down}, {"y_rad": s.s_rad}

    state = (Port("s_rad", -1, 0.5, "memory"),)
    bound = step_bound(made(step, state, **there_and_back(2.0**28)), F32)
    assert bound.states == {"s_rad": 1.5}
    assert bound.outputs == {"y_rad": 0.0}


# -- one step --------------------------------------------------------------------------------------


def test_the_errors_of_one_step_by_hand():
    # Three states and three outputs of different sizes; the word is no number.
    def step(c, s, u, g, label):
        a = s.a_rad + u.x_rad
        after = {"a_rad": a, "b_rad": [s.b_rad[1], 8.0 * (s.b_rad[0] + s.a_rad)], "k": s.k + 1}
        return after, {"y_rad": a, "z_rad": [s.b_rad[0], s.b_rad[1] + u.x_rad]}

    state = (
        Port("a_rad", -1, 3, "a"),
        Port("b_rad", -2, 5, "b", 2),
        Port("k", 0, 4, "count"),
    )
    outputs = (Port("y_rad", -9, 9, "y"), Port("z_rad", -9, 9, "z", 2))
    bound = step_bound(made(step, state, outputs=outputs), F32)
    # A sum rounds by U of its largest; eight times as much is left of it, and rounded again.
    assert bound.states == {
        "a_rad": pytest.approx(4 * U, rel=1e-4),
        "b_rad": pytest.approx(2 * 8 * 8 * U, rel=1e-4),
        "k": 0.0,
    }
    assert bound.outputs == {
        "y_rad": pytest.approx(4 * U, rel=1e-4),
        "z_rad": pytest.approx(6 * U, rel=1e-4),
    }


def test_a_range_of_ones_own_replaces_the_ports():
    def step(c, s, u, g, label):
        return {"s_rad": s.s_rad + u.x_rad}, {"y_rad": s.s_rad * u.x_rad}

    block = made(step, (Port("s_rad", -8, 8, "memory"),))
    bound = step_bound(block, F32, {"s_s_rad": (2.0, 3.0), "u_x_rad": (-0.5, 0.25)})
    # Zero stands for an input that is beyond its range.
    assert bound.states["s_rad"] == pytest.approx(3.25 * U, rel=1e-3)
    assert bound.outputs["y_rad"] == pytest.approx(1.5 * U, rel=1e-3)


def test_an_initial_error_of_a_state_goes_through_and_no_further_than_its_range():
    # y is what remains of a state's error where it stands alone, and of its largest product.
    def step(c, s, u, g, label):
        return {"s_rad": 0.5 * s.s_rad + 0.25 * u.x_rad}, {"y_rad": s.s_rad}

    bound = block_bound(made(step, (Port("s_rad", -1, 1, "memory"),)), F32)
    assert bound.outputs["y_rad"] == pytest.approx(bound.states["s_rad"], rel=1e-9)
    assert bound.format == "f32"
    fine = block_bound(made(step, (Port("s_rad", -1, 1, "memory"),)), F64)
    assert (fine.format, fine.states["s_rad"]) == (
        "f64", pytest.approx(bound.states["s_rad"] * 2.0**-29, rel=1e-3),
    )  # fmt: skip


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
        steep = 0.7 * u.x_rad > 0.3
        return {}, {"y_rad": u.x_rad, "flags": flag_word([steep, u.x_rad > 0.25])}

    flags = (Flag("STEEP", "is steep"), Flag("MORE", "is more"))
    outputs = (Port("y_rad", -1, 1, "y"), Port("flags", 0, 3, "word", flags=flags))
    block = made(step, outputs=outputs)
    for bound in (step_bound(block, F32), block_bound(block, F32)):
        assert bound.assumptions == ()
        assert bound.outputs == {"y_rad": 0.0}


# -- what counts -----------------------------------------------------------------------------------


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
    assert counts(Port("n", low, high, "count", init=0)) is whole


def test_counts_that_lead_to_each_other_are_whole_only_together():
    # b is a; a is b: all whole, unless a third that is not comes in by one of them.
    def step(gain):
        def after(c, s, u, g, label):
            return {
                "a": s.b,
                "b": s.a,
                "d": clip(s.b + gain * u.k, 0, 9),
            } | ({"b": s.d} if gain != 1 else {}), {"y_rad": u.x_rad * s.a}

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


@pytest.mark.parametrize(("gain", "whole"), [(2.0**22, True), (2.0**23, False)])
def test_no_fact_makes_a_count_smaller_than_it_may_be(gain, whole):
    # 3 times 2^22 is 3/4 of 2^24; twice as much is beyond what every count can be.
    def step(c, s, u, g, label):
        return {}, {"y_rad": label("large", gain * u.k) * u.x_rad}

    inputs = (Port("k", 0, 3, "count"), Port("x_rad", -1, 1, "in"))
    block = made(step, inputs=inputs, facts={"large": (0.0, 5.0)})
    kernel = fuse_selects(walk(block.step))
    products = [kernel.nodes[i] for i in whole_nodes(block, kernel, F32)]
    assert sum(n.op == "mul" for n in products) == whole


# -- matrices --------------------------------------------------------------------------------------


def chosen(at: int) -> Block:
    """A filter whose pole is another in one mode of four."""

    def step(c, s, u, g, label):
        pole = ca.if_else(u.mode == at, 0.25, 0.5)
        return {"s_rad": pole * s.s_rad + u.x_rad}, {"y_rad": s.s_rad}

    inputs = (Port("mode", -1, 2, "mode"), Port("x_rad", -1, 1, "in"))
    return made(step, (Port("s_rad", -9, 9, "memory"),), inputs)


@pytest.mark.parametrize("at", [-1, 0, 1, 2])
def test_every_value_of_a_mode_is_asked_for_its_matrix(at):
    assert state_matrix(chosen(at)) is None
    # What it cannot be is not.
    for never in (-2, 3):
        assert state_matrix(chosen(never)) == pytest.approx(np.array([[0.5]]))


def bent(by: float) -> Block:
    def step(c, s, u, g, label):
        return {"s_rad": (0.5 + by * u.x_rad) * s.s_rad}, {"y_rad": s.s_rad}

    return made(step, (Port("s_rad", -9, 9, "memory"),))


def test_a_matrix_that_an_input_bends_ever_so_little_varies():
    # Of 0.02 of the input's range, at most 4e-2 times as much of a pole of a half.
    assert state_matrix(bent(1e-9)) is None
    assert state_matrix(bent(1e-14)) is not None
    assert linear_bound(bent(1e-9), [[1e-7]]) is None


def test_a_clip_far_out_does_not_act_on_the_matrix():
    # It is taken within a fiftieth of the ranges: 0.18 of 9 and 0.02 of 1.
    def block(at):
        def step(c, s, u, g, label):
            return {"s_rad": 0.5 * clip(s.s_rad, -at, at)}, {"y_rad": s.s_rad}

        return made(step, (Port("s_rad", -9, 9, "memory"),))

    assert state_matrix(block(0.181)) == pytest.approx(np.array([[0.5]]))
    assert state_matrix(block(0.15)) is None


def test_what_says_that_a_block_has_started_is_no_part_of_the_matrix():
    def step(c, s, u, g, label):
        primed = s.primed > 0
        after = ca.if_else(primed, 0.5 * s.a_rad, u.x_rad)
        return {"primed": 0.25 * s.a_rad + s.primed, "a_rad": after + 0.125 * s.primed}, {
            "y_rad": 0
        }

    state = (Port("primed", 0, 1, "has started"), Port("a_rad", -9, 9, "memory"))
    assert state_matrix(made(step, state)).tolist() == [[0, 0], [0, 0.5]]


def test_the_matrix_is_of_the_states_alone_each_by_its_place():
    def step(c, s, u, g, label):
        a, b = s.a_rad, s.b_rad
        return (
            {"a_rad": 0.5 * a + 2 * b[0] - 3 * b[1] + 7 * u.x_rad, "b_rad": [a / 8, 0.25 * b[0]]},
            {"y_rad": 11 * a},
        )

    block = made(step, (Port("a_rad", -99, 99, "a"), Port("b_rad", -99, 99, "b", 2)))
    wanted = [[0.5, 2, -3], [0.125, 0, 0], [0, 0.25, 0]]
    assert state_matrix(block) == pytest.approx(np.array(wanted))
    jacobian = state_jacobian(block)
    assert (jacobian.name(), jacobian.n_in(), jacobian.size_out(0)) == ("A", 3, (3, 3))
    # Errors sum through its powers, absolute: 40 powers leave 1e-12 of them.
    d = np.array([1e-7, 2e-7, 3e-7])
    powers = [np.abs(np.linalg.matrix_power(np.array(wanted), k)) @ d for k in range(200)]
    (a,), b = linear_bound(block, [[1e-7], [2e-7, 3e-7]])
    total = np.sum(powers, axis=0)
    assert [a, *b] == pytest.approx((total * 1.000001).tolist(), rel=1e-10, abs=0)
