"""Test streams of a Block: common streams and its own.

Random inputs open no latch and make no encoder slip.  A Block that needs inputs related over many
steps defines its own: ``Block.define(..., streams=OwnStreams(events=...))``.  All numbers come from
the Block's own ports, tunables and constants.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.language.ports import Array

SPECIAL = (np.nan, np.inf, -np.inf, 3.4e38, -3.4e38)


@dataclass(frozen=True)
class Stream:
    """An input stream, with states put in from outside at some steps."""

    name: str
    inputs: dict[str, Array]
    # Before the step, {state port: value} overwrites the state.
    injections: dict[int, dict[str, Array]] = field(default_factory=dict)
    # From the step on, {coefficient port: value}; others are as prepared from the defaults.
    coefficients: dict[int, dict[str, Array]] = field(default_factory=dict)
    rough: bool = False  # whether it may break what an error bound assumes

    @property
    def steps(self) -> int:
        return len(next(iter(self.inputs.values())))


def single(values: npt.ArrayLike) -> Array:
    """Round to float32, kept as float64."""
    with np.errstate(over="ignore"):
        return np.asarray(values, dtype=np.float64).astype(np.float32).astype(np.float64)


def coefficient_edges(block: Any, dtype: np.dtype[Any]) -> list[dict[str, float]]:
    """No coefficient changed, then each just inside and just outside its range, and no number."""
    cases: list[dict[str, float]] = [{}]
    for p in block.coefficients:
        low, high = dtype.type(p.low), dtype.type(p.high)
        below, above = (np.nextafter(x, dtype.type(s * np.inf)) for x, s in ((low, -1), (high, 1)))
        cases += [{p.name: float(v)} for v in (low, high, below, above, *SPECIAL)]
    return cases


@dataclass(frozen=True)
class OwnStreams:
    """Test streams of a Block or Program, made by functions that take it as argument."""

    # For every comparison.
    events: Callable[[Any, np.random.Generator], list[Stream]] = lambda _block, _rng: []
    # For comparisons bit by bit in one format: coefficients and states that no ordinary run brings.
    memories: Callable[[Any, np.dtype[Any], np.random.Generator], list[Stream]] = (
        lambda _block, _dtype, _rng: []
    )
