"""No state is clipped in silence: from any memory and input in range, a flag tells."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.control.law_switch import law_switch
from esea_gen.control.limits.redundancy import redundancy
from esea_gen.control.reference import reference
from esea_gen.control.setpoint import setpoint_rates
from esea_gen.control.sliding_mode.controller import sliding_mode
from esea_gen.device import load_device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.walker import Kernel, walk
from esea_gen.language.block import Block
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.filters import tracking_observer
from esea_gen.model.gear_encoder import gear_encoder
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.published_inverse import published_inverse
from esea_gen.observe.disturbance import drive_observer, gear_observer
from esea_gen.observe.extrapolation import parabola
from esea_gen.observe.human import extended_state, lag_observer
from esea_gen.observe.rates import motor_rate
from esea_gen.verify.executor import coefficients_of, evaluate
from tests.own_device import own_device

CASES = 6000
EXTREMES = ("fmin", "fmax")

# What makes a Block, and which flags tell of a clip of its state.
BLOCKS = {
    "velocity": (tracking_observer, {"RATE_CLIPPED"}),
    "sensor": (torque_sensor, {"RATE_TORQUE_CLIPPED"}),
    "motor_rate": (motor_rate, set()),
    "drive_observer": (drive_observer, {"CLIPPED"}),
    "gear_observer": (gear_observer, {"CLIPPED"}),
    "encoder_gear": (gear_encoder, {"RANGE_LEFT"}),
    "redundancy": (redundancy, set()),
    "human_lag": (lag_observer, {"CLIPPED"}),
    "human_eso": (
        extended_state,
        {"ANGLE_CLIPPED", "OMEGA_CLIPPED", "TORQUE_CLIPPED", "TORQUE_RATE_CLIPPED"},
    ),
    "parabola": (parabola, set()),
    "exact inverse": (exact_inverse, {"REQUEST_CLAMPED", "STEP_CLIPPED"}),
    "published inverse": (lambda d: published_inverse(d, "a"), {"REQUEST_CLAMPED", "STEP_CLIPPED"}),
    "setpoint_rates": (setpoint_rates, {"RATE_CLIPPED", "ACCELERATION_CLIPPED"}),
    "reference": (reference, {"CLIPPED"}),
    "sliding_mode": (sliding_mode, {"SATURATED", "INTEGRAL_RESTS"}),
    "law_switch": (lambda d: law_switch(d, ["one", "other"]), {"CLIPPED"}),
}


def unclipped(block):
    """The step's kernel, and the same without the clips through which a next state passes.

    A clip is a minimum or maximum with an end that is no state and no input; it clips a state when
    nothing but other clips and selections stands between.
    """
    kernel = walk(block.step)
    varies = []
    for n in kernel.nodes:
        moves = n.op == "input" and n.source[0] >= len(block.coefficients)
        varies.append(moves or any(varies[a] for a in n.args))
    instead, todo = {}, []
    for _, nodes in zip(block.state, kernel.results, strict=False):
        todo += nodes
    seen = set()
    while todo:
        i = todo.pop()
        if i in seen:
            continue
        seen.add(i)
        n = kernel.nodes[i]
        if n.op in EXTREMES:
            moving = [a for a in n.args if varies[a]]
            if len(moving) == 1:
                instead[i] = moving[0]
            todo += n.args
        elif n.op == "if_else_zero":
            todo.append(n.args[1])
        elif n.op == "add" and all(kernel.nodes[a].op == "if_else_zero" for a in n.args):
            todo += n.args

    def passed(i):
        while i in instead:
            i = instead[i]
        return i

    nodes = [
        type(n)(n.op, tuple(passed(a) for a in n.args), n.value, n.source) for n in kernel.nodes
    ]
    results = tuple(tuple(passed(i) for i in r) for r in kernel.results)
    return kernel, Kernel(kernel.name, tuple(nodes), results), len(instead)


def memories(block, rng):
    """Arguments of many steps: states and inputs in range, often at an end, often small."""
    f64 = FORMATS["f64"]
    arguments = [np.tile(c, (CASES, 1)) for c in coefficients_of(block, f64, {})]
    for p in (*block.state, *block.inputs):
        wide = rng.uniform(p.low, p.high, (CASES, p.size))
        small = 10.0 ** rng.uniform(-6, 0, (CASES, 1)) * wide
        ends = rng.choice([p.low, p.high, 0.5 * (p.low + p.high)], (CASES, p.size))
        kind = rng.integers(3, size=(CASES, 1))
        value = np.where(kind == 0, wide, np.where(kind == 1, small, ends))
        whole = p.unit == "1"  # a mode, or whether something is so
        value = np.clip(np.rint(value) if whole else value, p.low, p.high)
        arguments.append(value.astype(np.float32).astype(np.float64))
    return arguments


@pytest.mark.parametrize("name", BLOCKS)
def test_a_flag_tells_of_every_clip_of_a_state(drive, name):
    make, telling = BLOCKS[name]
    block = make(drive)
    kernel, free, clips = unclipped(block)
    given = memories(block, np.random.default_rng(4))
    f64 = FORMATS["f64"]
    values, without = evaluate(kernel, f64, given), evaluate(free, f64, given)
    flags = [f.name for f in block.status_port.flags]
    assert telling <= {f.name for f in block.status_port.flags if f.counted}
    bits = sum(1 << flags.index(f) for f in telling)
    word = values[kernel.results[len(block.state) + len(block.outputs) - 1][0]].astype(int)
    clipped = np.zeros(CASES, dtype=bool)
    for p, a, b in zip(block.state, kernel.results, free.results, strict=False):
        for i, k in zip(a, b, strict=True):
            far = np.abs(values[i].astype(float) - without[k].astype(float))
            clipped |= far > 1e-9 * max(abs(p.low), abs(p.high))
    silent = clipped & (word & bits == 0)
    assert not silent.any(), (int(silent.sum()), int(clipped.sum()))
    assert (clips > 0) == bool(telling)


# 1.01 times its speed is no float32 number: the next one inside is smaller.
ODD = {
    "actuator": {"gear_ratio": 50.0, "encoder_bits": 12, "omega_max_rad_s": 2.0},
    "safety": {"omega_max_rad_s": 1.7},
}


def last_ends(kernel, i):
    """Numbers at which a value is cut before it is stored, whatever was chosen."""
    n = kernel.nodes[i]
    chosen = n.op == "add" and all(kernel.nodes[a].op == "if_else_zero" for a in n.args)
    if n.op in ("if_else_zero", "select") or chosen:
        return set().union(*(last_ends(kernel, a) for a in n.args[not chosen :]))
    out = set()
    for a in n.args if n.op in EXTREMES else ():
        end = kernel.nodes[a]
        inner = kernel.nodes[end.args[0]] if end.op == "neg" else end
        if inner.op == "const":
            out.add(inner.value if inner is end else -inner.value)
        else:
            out |= last_ends(kernel, a)
    return out


@pytest.mark.filterwarnings("ignore:.*designed for")
@pytest.mark.parametrize("name", ["odd", "elbow_drive", "elbow_mpc", "knee", "wrist"])
def test_no_state_is_clipped_a_hair_beyond_its_range(name):
    device = own_device(**ODD) if name == "odd" else load_device(name)
    seen = 0
    for block in (b for b in device.system.kinds if isinstance(b, Block)):
        kernel = walk(block.step)
        for p, nodes in zip(block.state, kernel.results, strict=False):
            ends = set().union(*(last_ends(kernel, i) for i in nodes))
            for meant in (p.low, p.high):
                near = {x for x in ends if 0 < abs(x - meant) < 1e-3 * abs(meant) or x == meant}
                assert all(p.low <= x <= p.high for x in near), (block.name, p.name, near)
                seen += len(near)
    assert seen >= 8
