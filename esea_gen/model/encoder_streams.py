"""What an encoder front end is tried with: gaps, slips, turns, and the edge of each decision."""

from __future__ import annotations

from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import SPECIAL, OwnStreams, Stream


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # A joint that moves slower than is believed, with frames missing, jumps that are bridged, a
    # slip that stays, and turns beyond what is counted; back to the start by memory as after init.
    port = next(p for p in block.inputs if p.name == "count")
    word = next(p for p in block.inputs if p.name == "frame_error")
    constant = {c.name: c.value for c in block.constants}
    full, most = round(port.high) + 1, int(constant["step_max_counts"])
    held = int(constant["held_max"])
    parts: list[tuple[Array, Array]] = []
    fresh: list[int] = []
    now = 0.37 * full

    def go(steps: int, rate: float, bad: tuple[int, ...] = (), jump: float = 0.0) -> None:
        nonlocal now
        path = now + jump + rate * np.arange(1, steps + 1)
        frame = np.zeros(steps)
        frame[list(bad)] = rng.integers(1, round(word.high) + 1, len(bad))
        parts.append((np.floor(path) % full, frame))
        now = float(path[-1])

    def length() -> int:
        return sum(len(a) for a, _ in parts)

    def restart() -> None:
        fresh.append(length())

    for rate in (0.9 * most, -0.9 * most, 3.0):
        go(60, rate, bad=(20, 30, 31))
        # As many bad frames as may be bridged, and one more: then it starts again.
        go(20, rate, bad=tuple(range(8, 8 + held)))
        go(30, rate, bad=tuple(range(8, 9 + held)))
    for _ in range(3):  # a jump and back: held, and good again
        go(held - 1, 0.0, jump=4.0 * most)
        go(12, 0.0, jump=-4.0 * most)
    go(12, 0.0, jump=(held + 3.0) * most)  # a slip: it settles, the reference is lost
    restart()
    go(4, 0.0)
    go(3, 0.0, jump=full / 3)  # while settling: the odd frame becomes the reference
    go(12, 1.0)
    for rate in (0.9 * most, -0.9 * most):  # more turns than are counted
        restart()
        go(int(6.0 * full / (0.9 * most)), rate)
        go(5, 0.0, bad=(1, 2))
    start = {p.name: np.full(p.size, p.init) for p in block.state}
    count = np.concatenate([a for a, _ in parts])
    frame = np.concatenate([b for _, b in parts])
    inputs = {"count": count, "frame_error": frame}
    broken = {k: v.copy() for k, v in inputs.items()}
    for p in block.inputs:
        hit = rng.random(len(count)) < 0.04
        broken[p.name][hit] = rng.choice([*SPECIAL, p.high + 1.0], int(hit.sum()))
    again = dict.fromkeys(fresh, start)
    return [
        Stream("motion, gaps and slips", inputs, again),
        Stream("the same, with invalid inputs", broken, again),
    ]


def _edges(block: Block, dtype: np.dtype[Any], _rng: np.random.Generator) -> list[Stream]:
    # Zeros that put a first frame half way between two turns, a hair to either side, and a little
    # less than a percent; whether zeroed, at its threshold; and steps as far as is believed after
    # so many bad frames, and one count farther.
    count, word = block.inputs
    constant = {c.name: c.value for c in block.constants}
    most, held = int(constant["step_max_counts"]), int(constant["held_max"])
    offset, zeroed = block.coefficients
    start = {p.name: np.full(p.size, p.init) for p in block.state}
    full = count.high + 1
    turn = block.step.n_out() + [name for name, _ in block.labels].index("turn_wanted")

    def wanted(zero: float, at: float) -> float:
        # The Block's own formula: the turn that a first frame asks for.
        first = [zero, 0.0, *(p.init for p in block.state), at, 0.0]
        return float(block.labelled_step.call([ca.DM(x) for x in first])[turn])

    frames: list[tuple[dict[str, Array], dict[str, Array], float]] = []
    for at in (0.0, 1.0, np.floor(full / 3), full - 1):
        here, slope = wanted(0.0, at), wanted(1.0, at) - wanted(0.0, at)
        for half in np.arange(-5, 5) + 0.5:
            zero = (half - here) / slope
            if not offset.low < zero < offset.high:
                continue
            tie = dtype.type(zero)
            near = [tie + k * np.spacing(tie) for k in range(-6, 7)]
            near += [dtype.type((half * (1 + s) - here) / slope) for s in (-4e-3, 4e-3)]
            frames += [(start, {offset.name: np.array([float(z)])}, at) for z in near]
    edge = dtype.type(0.5)
    for value in (edge - np.spacing(edge), edge, edge + np.spacing(edge), dtype.type(0.503)):
        frames.append((start, {zeroed.name: np.array([float(value)])}, 0.0))
    for bad in range(held + 1):
        for far in (0, 1):
            for way in (-1, 1):
                step = way * (most * (bad + 1) + far)
                for settled, last in product((2.0, 4.0), (full // 2, 2.0, full - 3.0)):
                    past = {"held": bad, "settled": settled, "count_last": last, "turn": 1.0}
                    state = start | {k: np.array([float(v)]) for k, v in past.items()}
                    frames.append((state, {}, (last + step) % full))
    return [
        Stream(
            "edges of turn, zero and reach",
            {count.name: np.array([f[2] for f in frames]), word.name: np.zeros(len(frames))},
            {k: f[0] for k, f in enumerate(frames)},
            {k: f[1] for k, f in enumerate(frames)},
        )
    ]


STREAMS = OwnStreams(_events, _edges)
