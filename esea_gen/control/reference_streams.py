"""What the reference is tried with: modes held until offsets fade."""

from __future__ import annotations

import numpy as np

from esea_gen.language.block import Block
from esea_gen.language.stream import SPECIAL, OwnStreams, Stream, single


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # Modes held for a while, so that offsets fade; samples that are no number in between.
    steps = 3000
    t = np.arange(steps)
    x = {
        p.name: single(0.5 * (p.low + p.high) + 0.3 * (p.high - p.low) * np.sin(t / (40.0 + 7 * i)))
        for i, p in enumerate(block.inputs)
    }
    x["mode"] = np.array([1.0, 2.0, 0.0, 2.0, 1.0, 0.0])[t // 250 % 6]
    for p in block.inputs:
        hit = rng.random(steps) < 0.002
        x[p.name][hit] = rng.choice(SPECIAL, int(hit.sum()))
    return [Stream("modes held", x)]


STREAMS = OwnStreams(_events)
