"""What a bound for all time is made of: fixed points, boxes, linearity, matrices, whole numbers."""

from __future__ import annotations

import itertools
import math

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.error_bounds import (
    block_bound,
    boxes_of,
    counts,
    fixed_point,
    is_linear,
    limits_of,
    linear_assumptions,
    node_errors,
    pieces,
    started_flags,
    state_jacobian,
    state_matrix,
    step_bound,
    whole_nodes,
)
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.ranges import RangeError
from esea_gen.emit.walker import fuse_selects, walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Port, Tunable, clip

F32, U = FORMATS["f32"], 2.0**-24
X, Y, K = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("k")


def made(step, state=(), inputs=None, most: float = 1.0, **more) -> Block:
    return Block.define(
        "made",
        "made up",
        period_s=1e-3,
        state=state,
        inputs=inputs or (Port("x_rad", -1, 1, "what comes in"),),
        outputs=(Port("y_rad", -most, most, "what comes out"),),
        step=step,
        **more,
    )


# -- fixed points ----------------------------------------------------------------------------------


def found(image, zero):
    """Of a map of errors, without a Block behind it."""
    return fixed_point(image, lambda errors: errors, zero)


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


# -- ranges and boxes ------------------------------------------------------------------------------


def test_pieces_of_a_range():
    for limits, cuts, edges in (
        ((-2.0, 3.0), (1.0,), [-2, -1, 1, 3]),
        ((-2.0, 3.0), (2.0, 3.0), [-2, 2, 3]),  # what is no inside point cuts nothing
        ((0.5, 3.0), (1.0, 0.25), [0.5, 1, 3]),
        ((-2.0, 3.0), (), [-2, 3]),
        ((-2.0, 3.0), (0.0, 1.0, 1.0), [-2, -1, 0, 1, 3]),
    ):
        assert pieces(limits, cuts) == list(itertools.pairwise(edges))


def twofold(**more) -> Block:
    def step(c, s, u, g, label):
        return {"m_rad": 0.5 * s.m_rad}, {"y_rad": label("part", u.x_rad * s.m_rad)}

    return made(step, (Port("m_rad", -4.0, 4.0, "memory"),), **more)


def test_a_box_for_every_choice_of_pieces():
    block = twofold(split={"u_x_rad": (0.5,), "s_m_rad": (1.0,)})
    limits = limits_of(block, {})
    assert limits == {"s_m_rad": (-4.0, 4.0), "u_x_rad": (-1.0, 1.0)}
    boxes = boxes_of(block, limits)
    assert len(boxes) == 9
    assert {(b["u_x_rad"], b["s_m_rad"]) for b in boxes} == {
        (x, m)
        for x in ((-1.0, -0.5), (-0.5, 0.5), (0.5, 1.0))
        for m in ((-4.0, -1.0), (-1.0, 1.0), (1.0, 4.0))
    }
    narrow = limits_of(block, {"s_m_rad": (0.0, 2.0)})
    assert narrow == {"s_m_rad": (0.0, 2.0), "u_x_rad": (-1.0, 1.0)}
    with pytest.raises(ValueError, match=r"block made: no state or input \['u_z'\]; there are"):
        limits_of(block, {"u_z": (0, 1)})
    assert boxes_of(twofold(), limits) == [limits]


def test_the_worst_of_all_boxes_counts():
    # x m rounds by half a unit of the largest product, 4; in a narrow range by one of 0.5.
    for ranges, most in ((None, 4.0), ({"s_m_rad": (-0.5, 0.25)}, 0.5)):
        for block in (twofold(), twofold(split={"s_m_rad": (1.0, 2.0), "u_x_rad": (0.5,)})):
            one = step_bound(block, F32, ranges)
            assert one.outputs["y_rad"] == pytest.approx(U * most, rel=1e-5)
            assert (one.steps, one.method, one.format) == (1, "one step", "f32")


# -- what counts -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("port", "whole"),
    [
        (Port("mode", 0, 2, "mode"), True),
        (Port("n", -5, 2**24 - 1, "count"), True),
        (Port("n", 0, 2**24, "count"), False),  # 2^24 + 1 is no float32
        (Port("on", 0, 1, "switch"), False),  # anything between may come
        (Port("share", 0, 2.5, "share"), False),
        (Port("n_rad", 0, 5, "angle"), False),
        (Port("n", 0, 5, "count", init=0.5), False),
        (Port("n", -0.5, 5, "count"), False),
    ],
)
def test_a_port_counts_that_has_whole_ends_and_no_unit(port, whole):
    assert counts(port) is whole


def counting(gain: float, most: int = 99) -> Block:
    def step(c, s, u, g, label):
        n = clip(s.n + gain * u.k, 0, most)
        return {"n": n}, {"y_rad": ca.if_else(n > 7, u.x_rad, 0.0)}

    inputs = (Port("k", 0, 3, "step"), Port("x_rad", -1, 1, "in"))
    return made(step, (Port("n", 0, most, "count"),), inputs)


def test_a_count_stays_whole_where_every_step_makes_it_one():
    bound = step_bound(counting(2.0), F32)
    assert (bound.states["n"], bound.outputs["y_rad"]) == (0.0, 0.0)
    assert bound.assumptions == ("made: k is a whole number",)
    # By halves it does not: the sum is rounded, and the comparison may turn.
    rough = step_bound(counting(0.3), F32)
    assert rough.states["n"] > 0
    assert any(a.startswith("made") and a.endswith("= lt") for a in rough.assumptions)
    assert "made: k is a whole number" in rough.assumptions
    block = counting(2.0)
    kernel = fuse_selects(walk(block.step))
    whole = whole_nodes(block, kernel, F32)
    ops = {kernel.nodes[i].op for i in whole}
    assert {"fmin", "fmax", "add", "twice"} & ops
    (x,) = (i for i, n in enumerate(kernel.nodes) if n.op == "input" and n.source[0] == 2)
    assert x not in whole
    (k,) = (i for i, n in enumerate(kernel.nodes) if n.op == "input" and n.source[0] == 1)
    assert k in whole


def test_no_range_no_whole_numbers():
    block = made(lambda c, s, u, g, label: ({}, {"y_rad": clip(1 / (u.x_rad + 0.5), -1, 1)}))
    assert whole_nodes(block, fuse_selects(walk(block.step)), F32) == frozenset()


def test_errors_of_every_node_by_hand():
    block = made(lambda c, s, u, g, label: ({}, {"y_rad": 0.7 * u.x_rad * u.x_rad}))
    kernel, errors = node_errors(block, F32)
    assert len(errors) == len(kernel.nodes)
    by_op: dict[str, list[float]] = {}
    for n, e in zip(kernel.nodes, errors, strict=True):
        by_op.setdefault(n.op, []).append(e)
    stored = abs(float(np.float32(0.7)) - 0.7)
    # Ranges reach a millionth of their width beyond: 1 + 2e-6.
    assert max(by_op["input"]) == 0
    assert max(by_op["const"]) == pytest.approx(stored)
    low, high = sorted(by_op["mul"])
    assert low == pytest.approx(stored + U * 0.7, rel=1e-4)
    assert high == pytest.approx(stored + 2 * U * 0.7, rel=1e-4)


# -- linear ----------------------------------------------------------------------------------------


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
    kernel = walk(ca.Function("f", [K, X, Y], [expression]))
    assert is_linear(kernel, 1) is linear


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
        99.0,
        tunables=(Tunable("t", 2.0, 1.0, 4.0, "tunes"),),
        coefficients=(Port("g", 0.0, 1.0, "gain"),),
        prepare=lambda t: {"g": t.t / 8},
    )


def test_the_matrix_of_a_linear_block():
    wanted = np.array([[0.5, 0.25, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 0.3]])
    assert state_matrix(pair()) == pytest.approx(wanted)
    started = pair(primed=True)
    assert started_flags(started) == [3]
    assert started_flags(pair()) == []
    padded = np.zeros((4, 4))
    padded[:3, :3] = wanted
    assert state_matrix(started) == pytest.approx(padded)
    jacobian = state_jacobian(pair())
    assert np.asarray(ca.DM(jacobian(0.125, 7, [1, 2], 0)))[0] == pytest.approx([0.5, 0.125, 0])
    # One that an input bends, or that a mode chooses, is none.
    assert state_matrix(pair(bend=0.1)) is None
    assert state_matrix(pair(mode=True)) is None
    assert linear_assumptions(pair()) == (
        "made: no clip of a state acts",
        "made: no invalid input is bridged",
    )


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
    assert turned.assumptions == linear_assumptions(made(rotation, (Port("m_rad", -1, 1, "m", 2),)))
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
