"""What the generic streams reach: a test input that no longer tries, tries nothing."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from esea_gen.control.limits.block import limits
from esea_gen.control.limits.faults import Fault
from esea_gen.control.limits.streams import STREAMS as OF_LIMITS
from esea_gen.language.block import Block
from esea_gen.language.stream import Stream
from esea_gen.observe.human import extended_state
from esea_gen.verify.streams import (
    streams,
)


def named(found: list[Stream]) -> dict[str, Stream]:
    return {s.name: s for s in found}


def test_the_generic_streams_reach_what_they_say(drive):
    block = extended_state(drive)
    found = named(streams(block, seed=3, steps=2000))
    for p in block.inputs:
        middle, half = 0.5 * (p.low + p.high), 0.5 * (p.high - p.low)

        def reach(name, p=p, middle=middle, half=half):
            x = (found[name].inputs[p.name] - middle) / half
            return float(x.min()), float(x.max())

        # A walk and a chirp through the middle half of the range, noise through all of it.
        assert max(map(abs, reach("random walk"))) <= 0.55 + 1e-6
        assert reach("chirp") == pytest.approx((-0.57, 0.57), abs=1e-3)
        assert reach("noise over the range") == pytest.approx((-1, 1), abs=0.01)
        low, high = reach("reversals and plateaus")
        assert -0.6 <= low < -0.5 < 0.5 < high <= 0.6
        assert reach("jumps") == pytest.approx((-1, 1), abs=1e-6)
        jumps = found["jumps"].inputs[p.name]
        assert set(jumps) == {p.low, p.high, float(np.float32(0.5 * p.high)), 0.0}
        # A walk moves by a hundredth of its reach, noise by a third of the range.
        steps = {n: np.std(np.diff(found[n].inputs[p.name])) / half for n in found}
        assert steps["random walk"] == pytest.approx(0.0055, rel=0.1)
        assert steps["noise over the range"] == pytest.approx(np.sqrt(2 / 3), rel=0.1)
        # Its frequency rises: 2 turns a stream at first, 42 at last.
        chirp = found["chirp"].inputs[p.name] - middle
        turns = np.flatnonzero(np.diff(np.sign(chirp)) != 0)
        assert len(turns) == pytest.approx(2 * 22, abs=2)
        assert np.diff(turns)[-4:].mean() < np.diff(turns)[:3].mean() / 4
        marks = np.float32([p.low, p.high, 0.0])
        inner = [np.nextafter(np.float32(p.low), np.float32(0)), np.float32(1e-45)]
        tried = set(found["thresholds"].inputs[p.name])
        assert {float(m) for m in (*marks, *inner)} <= tried
        zeros = [x for x in found["thresholds"].inputs[p.name] if x == 0]
        assert {bool(np.signbit(x)) for x in zeros} == {True, False}
        assert all(p.low <= x <= p.high for x in tried)
    # Inputs do not rise and fall together, nor does each seed give the same.
    a, b = (found["chirp"].inputs[p.name] for p in block.inputs)
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.95
    others = named(streams(block, seed=4, steps=2000))
    assert not np.array_equal(
        others["random walk"].inputs["tau_Nm"], found["random walk"].inputs["tau_Nm"]
    )
    held = found["reversals and plateaus"].inputs["tau_Nm"]
    still = [np.ptp(held[k : k + 50]) == 0 for k in range(0, 2000, 50)]
    assert still == [(k // 400) % 3 == 2 for k in range(0, 2000, 50)]


def run(block: Block, stream: Stream) -> dict[str, np.ndarray]:
    """Outputs of the Block, with what is put into its memory."""
    simulator = block.simulator()
    rows = []
    for k in range(stream.steps):
        if k in stream.injections:
            simulator.state = stream.injections[k]
        rows.append(simulator.step(**{n: v[k] for n, v in stream.inputs.items()}))
    return {n: np.array([np.ravel(r[n])[0] for r in rows]) for n in rows[0]}


def test_every_fault_of_the_limits_comes_and_is_released(drive):
    block = limits(drive)
    found = named(OF_LIMITS.events(block, np.random.default_rng(1)))
    y = run(block, found["every fault, and its release"])
    fault = y["fault"].astype(int)
    trips = [int(b) for a, b in pairwise(fault) if a == 0 != b]
    # Each cause for one step and for three, from both sides where there are two; stop also by its
    # three invalid values; every other of 16 ports by three; request, mode, rearm, doubt besides.
    assert Counter(trips) == {
        Fault.STOP: 2 * (3 + 3),
        Fault.INPUT_INVALID: 2 * (4 + 16 * 3),
        Fault.SENSING: 2 * 2,
        Fault.CONTROL_STALE: 2 * 1 + 1,
        Fault.DEFLECTION: 2 * 4,
        Fault.TORQUE: 2 * 2,
        Fault.SPEED: 2 * 4,
        Fault.RANGE_OF_MOTION: 2 * 2,
        Fault.CLOCK: 2 * 2,
        Fault.LATE: 2 * 1,
        Fault.COEFFICIENTS: 2 * 2,
        Fault.SWINGS: 2,
        Fault.ROUGH: 2,
        Fault.STUCK_BIT: 2,
    }
    assert fault[-1] == 0
    # Any two at once: the smaller number is kept, so that cause 1 of 14 wins 14 times, and so on.
    y = run(block, found["two causes at once"])
    fault = y["fault"].astype(int)
    trips = [int(b) for a, b in pairwise(fault) if a == 0 != b]
    won = Counter(trips)
    assert [won[f] for f in sorted(won)] == list(range(14, 0, -1))
    assert sorted(won) == [f for f in Fault if f not in (0, 1, 3, 17, 18, 19)]
