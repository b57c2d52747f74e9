"""The error analysis: its bounds hold, and they are not idle."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import esea_gen
from esea_gen.emit.error_bounds import block_bound
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.ranges import RangeError, RangeValue, analyse
from esea_gen.emit.walker import walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Port

F32 = FORMATS["f32"]


def single(kernel, inputs):
    """Evaluate in numpy float32, operation by operation."""
    f = np.float32
    table = {
        "add": lambda a, b: f(a + b),
        "sub": lambda a, b: f(a - b),
        "mul": lambda a, b: f(a * b),
        "div": lambda a, b: f(a / b),
        "inv": lambda a: f(f(1) / a),
        "neg": lambda a: -a,
        "sq": lambda a: f(a * a),
        "twice": lambda a: f(2) * a,
        "fabs": abs,
        "fmin": min,
        "fmax": max,
    }
    value = []
    for n in kernel.nodes:
        if n.op == "const":
            value.append(f(n.value))
        elif n.op == "input":
            value.append(f(inputs[n.source[1]]))
        else:
            value.append(table[n.op](*(value[a] for a in n.args)))
    return float(value[kernel.results[0][0]])


leaf = st.sampled_from(["x0", "x1", "x2", "c"])


@st.composite
def expressions(draw, depth: int = 4):
    if depth == 0 or draw(st.booleans()):
        return draw(leaf), draw(st.floats(-3, 3, width=32))
    op = draw(st.sampled_from(["add", "sub", "mul", "div", "sq", "abs", "min", "max"]))
    return op, draw(expressions(depth - 1)), draw(expressions(depth - 1))


def build(tree, x):
    if tree[0] in ("x0", "x1", "x2"):
        return x[int(tree[0][1])]
    if tree[0] == "c":
        return ca.SX(tree[1] + 0.1)
    a, b = build(tree[1], x), build(tree[2], x)
    return {
        "add": lambda: a + b,
        "sub": lambda: a - b,
        "mul": lambda: a * b,
        "div": lambda: a / (2 + ca.fabs(b)),
        "sq": lambda: a**2,
        "abs": lambda: ca.fabs(a),
        "min": lambda: ca.fmin(a, b),
        "max": lambda: ca.fmax(a, b),
    }[tree[0]]()


@settings(max_examples=300)
@given(
    expressions(),
    st.lists(st.floats(-2, 2, width=32), min_size=3, max_size=3),
    st.floats(0.001, 1),
)
def test_the_bound_holds_for_any_expression(tree, centre, width):
    x = ca.SX.sym("x", 3)
    kernel = walk(ca.Function("f", [x], [build(tree, x)]))
    ranges = [[RangeValue(c - width, c + width) for c in centre]]
    try:
        bound = analyse(kernel, F32, ranges).results[0][0]
    except RangeError:
        assume(False)
    rng = np.random.default_rng(0)
    exact = ca.Function("f", [x], [build(tree, x)])
    for _ in range(20):
        point = np.float32(rng.uniform([c - width for c in centre], [c + width for c in centre]))
        point = np.clip(point, [c - width for c in centre], [c + width for c in centre])
        if not np.array_equal(point, np.float32(point)):
            continue
        true = float(exact(point.astype(float)))
        # 1e-12: what it is held against is float64 itself.
        slack = 1e-12 * (1 + abs(true))
        assert abs(single(kernel, point) - true) <= bound.error + slack
        assert bound.low - slack <= true <= bound.high + slack


def test_a_division_by_a_range_with_zero_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(RangeError, match="holds zero"):
        analyse(walk(ca.Function("f", [x], [1 / x])), F32, [[RangeValue(-1, 1)]])


def leaky(gain: float) -> Block:
    return Block.define(
        "leak",
        "a one-pole filter",
        period_s=1e-3,
        # With units: ports without one and with whole ends are taken as counting.
        state=(Port("s_rad", -100, 100, "state"),),
        inputs=(Port("x_rad", -1, 1, "input"),),
        outputs=(Port("y_rad", -100, 100, "output"),),
        step=lambda c, s, u, guard, label: (
            {"s_rad": gain * s.s_rad + u.x_rad},
            {"y_rad": gain * s.s_rad + u.x_rad},
        ),
    )


def test_a_filter_that_forgets_has_a_bound_for_all_time():
    bound = block_bound(leaky(0.99), F32)
    # By hand: |s| <= 100; one step errs by at most u (99 + 100) and the constant's u 99; all of
    # that over 1 - 0.99.
    u = 2.0**-24
    assert 0.2 * u * 300 / 0.01 < bound.states["s_rad"] < 1.5 * u * 300 / 0.01


def test_an_integrator_has_none():
    with pytest.raises(RangeError, match="stable"):
        block_bound(leaky(1.0), F32)


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

    block = Block.define(
        "switch",
        "two filters",
        period_s=1e-3,
        state=(Port("x", -100, 100, "state", size=2),),
        inputs=(Port("m", -1, 1, "mode"), Port("w", -1, 1, "input")),
        outputs=(Port("y", -100, 100, "output"),),
        step=step,
    )
    with pytest.raises(RangeError, match="not stable"):
        block_bound(block, F32)


def test_an_integrator_has_none_in_a_narrow_range_either():
    with pytest.raises(RangeError, match="stable"):
        block_bound(leaky(1.0), F32, {"s_s_rad": (-10, 10)})


def test_powers_and_roots():
    x = ca.SX.sym("x")
    power = walk(ca.Function("f", [x], [x**0.77]))
    point = analyse(power, F32, [[RangeValue(1e-30, 1e-30)]]).results[0][0]
    assert point.error >= 2.64e-7 * 1e-30**0.77  # what the emitted power errs there
    rough = analyse(power, F32, [[RangeValue(0.25, 0.25, 0.0, 0.5)]]).results[0][0]
    assert rough.error >= 0.25**0.77 - 0.125**0.77
    root = walk(ca.Function("f", [x], [ca.sqrt(x)]))
    assert analyse(root, F32, [[RangeValue(0.0, 1.0, 1e-8)]]).results[0][0].error >= 1e-4
