"""What passivity is tried with: tunables in memory that are no longer what was prepared."""

from __future__ import annotations

from typing import Any

import numpy as np

from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import SPECIAL, OwnStreams, Stream, single


def _bad_coefficients(block: Block, dtype: np.dtype[Any], rng: np.random.Generator) -> list[Stream]:
    # Each just inside and just outside its range, and no number at all; both at once.
    cases: list[dict[str, float]] = [{}]
    for p in block.coefficients:
        low, high = dtype.type(p.low), dtype.type(p.high)
        below, above = (np.nextafter(x, dtype.type(s * np.inf)) for x, s in ((low, -1), (high, 1)))
        cases += [{p.name: float(v)} for v in (low, high, below, above, *SPECIAL)]
    cases.append({p.name: float("nan") for p in block.coefficients})
    each = 8
    count = each * len(cases)
    inputs = {p.name: single(rng.uniform(0.5 * p.low, 0.5 * p.high, count)) for p in block.inputs}
    inputs["mode"] = np.repeat(np.arange(len(cases)) % 3, each).astype(float)
    for name in ("sensing_ok", "request_ok"):
        inputs[name] = np.ones(count)
    changes: dict[int, dict[str, Array]] = {
        k * each: {name: np.array([v]) for name, v in case.items()} for k, case in enumerate(cases)
    }
    return [Stream("coefficients out of their ranges", inputs, {}, changes)]


STREAMS = OwnStreams(memories=_bad_coefficients)
