"""A Block with another memory: for comparisons bit by bit, beside its ordinary streams."""

from __future__ import annotations

from itertools import product

import casadi as ca
import numpy as np
import numpy.typing as npt

from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import Stream, single
from esea_gen.verify.streams import at_the_limits, streams
from esea_gen.verify.ties import aimed_stream


def other_memories(
    block: Block, dtype: npt.DTypeLike = np.float32, seed: int = 2, steps: int = 3000
) -> list[Stream]:
    """Other coefficients, and states that only a long past brings."""
    own = block.streams.memories(block, np.dtype(dtype), np.random.default_rng(seed))
    found = own + _full_counters(block, seed)
    found += aimed_stream(block, [*streams(block, steps=1000), *own], dtype)
    if not block.tunables:
        return found
    rng = np.random.default_rng(seed)
    sets = list(product(*((t.low, t.high) for t in block.tunables[:3])))
    changes: dict[int, dict[str, Array]] = {}
    for k, ends in enumerate(rng.permutation(sets)):
        # The first three in every combination of their ends, the rest at random.
        rest = [rng.choice([t.low, t.high, t.default]) for t in block.tunables[3:]]
        prepared = block.prepare.call([ca.DM(v) for v in (*ends, *rest)])
        changes[k * steps // len(sets)] = {
            p.name: single(np.asarray(v, dtype=float).ravel())
            for p, v in zip(block.coefficients, prepared, strict=True)
        }
    base = at_the_limits(block, dtype, seed, steps)
    return [Stream("tunables at their ends", base.inputs, base.injections, changes), *found]


def _full_counters(block: Block, seed: int) -> list[Stream]:
    # One counter at its end and the others at 0, while the Block does what it does.
    names = [f"n_{f.name.lower()}" for q in block.outputs for f in q.flags if f.counted]
    out = []
    for stream in streams(block, seed, 600) if names else ():
        if stream.name in ("corrupt states", "chirp", "random walk"):
            continue
        cases = {}
        for k, step in enumerate(range(10, stream.steps, 30)):
            full = names[k % len(names)]
            cases[step] = {n: np.array(2**32 - 1 if n == full else 0) for n in names}
        both = {
            k: cases.get(k, {}) | stream.injections.get(k, {})
            for k in sorted({*cases, *stream.injections})
        }
        out.append(Stream(f"{stream.name}, counters at their ends", stream.inputs, both))
    return out
