"""Of two zeros that are compared, every format gives the same one under every compiler."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from esea_gen.hostlib.library import block_system, compile_system
from esea_gen.language.stream import Stream
from esea_gen.verify.compare import compare
from esea_gen.verify.executor import exact_trajectory
from esea_gen.verify.runs import CasadiOracle, run_c
from esea_gen.verify.streams import streams
from tests.made_up import made, port
from tests.own_device import own_device

VALUES = (0.0, -0.0, 1.5, -1.5)
# Every pair, in both orders, and each against a constant.
LEFT, RIGHT = (np.array(v) for v in zip(*((x, y) for x in VALUES for y in VALUES), strict=True))


def ties():
    """Minimum and maximum of two inputs, and of each with 0 on either side."""

    def step(c, s, u, guard, label):
        zero = ca.SX(0)
        return {}, {
            "least": ca.fmin(u.x, u.y),
            "most": ca.fmax(u.x, u.y),
            "below": ca.fmin(zero, u.y),
            "above": ca.fmax(u.x, zero),
        }

    outputs = tuple(port(n, -4, 4) for n in ("least", "most", "below", "above"))
    return made(step, (), (port("x", -2, 2), port("y", -2, 2)), outputs, name="ties")


def bits(values):
    return np.asarray(values, dtype=np.float64).tobytes()


@pytest.mark.parametrize("flags", [(), ("-O0",), ("-O3",), ("-Os",)])
def test_f64_takes_the_second_of_two_equal_zeros(flags):
    library = compile_system(block_system(ties()), "f64", flags)
    y, _ = run_c(library.block("ties"), Stream("ties", {"x": LEFT, "y": RIGHT}))
    least = np.array([a if a < b else b for a, b in zip(LEFT, RIGHT, strict=True)])
    assert bits(y["least"]) == bits(least)
    assert bits(y["most"]) == bits([a if a > b else b for a, b in zip(LEFT, RIGHT, strict=True)])
    assert bits(y["below"]) == bits([0.0 if b > 0 else b for b in RIGHT])
    assert bits(y["above"]) == bits([a if a > 0 else 0.0 for a in LEFT])


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_both_peers_agree_on_every_zero(real):
    system = block_system(ties())
    library, block = compile_system(system, real), system.blocks["ties"]
    oracle = CasadiOracle(system) if real == "f64" else None
    stream = Stream("ties", {"x": LEFT, "y": RIGHT})
    expected = exact_trajectory(block, library, stream, oracle)
    assert expected.first_difference(*run_c(library.block("ties"), stream)) == ""


def test_limits_of_another_control_rate_give_casadis_bits():
    device = own_device(timing={"control_rate_Hz": 500.0})
    block = device.system.blocks["limits"]
    system = block_system(block)
    library, oracle = compile_system(system, "f64"), CasadiOracle(system)
    (stream,) = [s for s in streams(block) if s.name == "held back by range of motion and speed"]
    found = compare(device, block, library, stream, {}, oracle)
    assert found.bit_identical
    assert found.passed, found.problems
