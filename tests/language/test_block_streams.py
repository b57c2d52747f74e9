"""Streams that a Block brings along: asked for by the comparisons, and needed."""

from __future__ import annotations

import casadi as ca
import numpy as np

from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.stream import OwnStreams, Stream
from esea_gen.verify.coverage import branch_coverage
from esea_gen.verify.memories import other_memories
from esea_gen.verify.streams import streams

PATIENCE = 400  # steps in a row at more than 3/4 before it opens
GENERIC = [
    "random walk",
    "noise over the range",
    "chirp",
    "reversals and plateaus",
    "thresholds",
    "jumps",
    "invalid inputs",
    "corrupt states",
]


def held(block, rng):
    """Held at 1 for longer than the patience, which no random input is."""
    (port,) = block.inputs
    return [Stream("held", {port.name: np.full(2 * PATIENCE, port.high)})]


def stored(block, dtype, rng):
    """A memory given in one format: its type is told."""
    steps = {0: {"count": np.array([3.0]), "mirror": np.array([-3.0])}}
    return [Stream(f"stored, {np.dtype(dtype).name}", {"x": np.zeros(4)}, steps)]


def latch(own):
    """Opens after so many steps in a row; its count is stored twice, so that no chance sets it."""

    def step(c, s, u, guard, label):
        agree = ca.logic_and(s.count <= -s.mirror, s.count >= -s.mirror)
        up = ca.logic_and(agree, u.x > 0.75)
        count = ca.if_else(up, ca.fmin(s.count + 1, PATIENCE), 0)
        opened = ca.logic_and(agree, s.count > PATIENCE - 0.5)
        return {"count": count, "mirror": -count}, {"open": ca.if_else(opened, 1, 0)}

    return Block.define(
        "latch",
        "made up",
        period_s=1e-3,
        state=(
            Port("count", 0, PATIENCE, "steps in a row"),
            Port("mirror", -PATIENCE, 0, "the same, negated"),
        ),
        inputs=(Port("x", -1.0, 1.0, "made up"),),
        outputs=(Port("open", 0, 1, "1 when open"),),
        step=step,
        streams=own,
    )


def test_the_streams_of_a_block_end_with_its_own():
    plain, own = latch(None), latch(OwnStreams(held, stored))
    assert [s.name for s in streams(plain)] == GENERIC
    assert [s.name for s in streams(own)] == [*GENERIC, "held"]
    for a, b in zip(streams(plain), streams(own), strict=False):
        assert a.inputs["x"].tobytes() == b.inputs["x"].tobytes()
    for dtype in (np.float32, np.float64):
        names = [s.name for s in other_memories(own, dtype)]
        assert f"stored, {np.dtype(dtype).name}" in names
    assert not any("stored" in s.name for s in other_memories(plain))


def test_what_only_its_own_stream_brings_about_is_missed_without_it():
    plain, own = latch(None), latch(OwnStreams(held))
    opens = "in the result open: if_else_zero never 'true'"
    missed = [
        any(opens in side for side in branch_coverage(b, streams(b)).uncovered)
        for b in (plain, own)
    ]
    assert missed == [True, False]
