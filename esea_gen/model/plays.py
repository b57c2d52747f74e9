"""Play states of the stop operators after a common history, and streams with such states."""

from __future__ import annotations

from typing import Any

import numpy as np

from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import OwnStreams, Stream, single

# They may miss their nesting by this much (float32 rounding) before they count as corrupt.
NESTING_ROOM_RAD = 1e-5

_MOTION = {"v_rad_s", "a_rad_s2", "w1_rad_s", "w2_rad_s"}


def _nested_plays(block: Block, _dtype: np.dtype[Any], rng: np.random.Generator) -> list[Stream]:
    # Play states with a common history lie within a threshold of each other; any other memory is
    # refused by the exact inverse.  From such states, all else anywhere, a few steps on.
    steps, every = 3000, 4
    gap = next(c.value for c in block.constants if c.name == "omega_rad")
    ports = {p.name: p for p in block.state}
    injections: dict[int, dict[str, Array]] = {}
    for k in range(0, steps, every):
        state = {
            p.name: single(
                rng.choice([1.0, 0.98, 0.3, 0.02, 0.0])
                * rng.choice([p.low, p.high, rng.uniform(p.low, p.high)])
                * np.ones(p.size)
            )
            for p in block.state
        }
        state["primed"] = np.array([1.0 if rng.random() < 0.9 else 0.0])
        if rng.random() < 0.6:  # at rest, where the viscosity is large
            state |= {n: np.zeros(p.size) for n, p in ports.items() if n in _MOTION}
        theta = float(state["theta_prev_rad"][0])
        # At a threshold, and a little beyond, which rounding may be the cause of.
        edge = 1.0 + 0.9 * NESTING_ROOM_RAD / gap
        choice = [-edge, edge, -0.99, 0.99, 0.0, float(rng.uniform(-1, 1))]
        moves = rng.choice(choice, ports["play_rad"].size)
        if rng.random() < 0.5:  # all stops to one side
            moves = np.abs(moves) * rng.choice([-1.0, 1.0])
        state["play_rad"] = single(theta + np.cumsum(gap * moves))
        injections[k] = state
    inputs = {}
    for p in block.inputs:
        near = rng.choice([1.0, 0.3, 0.05, 0.001], steps) * rng.uniform(p.low, p.high, steps)
        hit = rng.random(steps)
        value = np.where(hit < 0.15, rng.choice([p.low, p.high], steps), near)
        inputs[p.name] = single(np.where(hit > 0.98, np.nan, value))
    return [Stream("any memory of the model", inputs, injections)]


STREAMS = OwnStreams(memories=_nested_plays)
