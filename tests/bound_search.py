"""A search for streams whose error comes near its derived bound, or beyond: random, then uphill.

A recipe moves every input of a Block between knots.  Knots lie round a centre, within a reach that
is drawn over decades: a centre at an end with a small reach is a joint that rests there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from esea_gen.emit.step_errors import counts
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.stream import Stream, single

KNOTS = 9


@dataclass(frozen=True)
class Way:
    """How one input moves: knots as shares of the reach round the centre, held or joined."""

    centre: float
    reach: float
    knots: Array
    held: bool


@dataclass(frozen=True)
class Found:
    """The worst stream: largest error as a share of its bound, and what was found wrong at all."""

    ratio: float
    stream: Stream | None
    problems: tuple[str, ...]


def _way(rng: np.random.Generator) -> Way:
    return Way(
        centre=float(rng.choice([0.0, 1.0, 0.5, rng.random()])),
        reach=float(10 ** rng.uniform(-4, 0)),
        knots=rng.choice([-1.0, 0.0, 1.0], KNOTS) * rng.uniform(0.2, 1.0, KNOTS),
        held=bool(rng.random() < 0.4),
    )


def _changed(way: Way, rng: np.random.Generator) -> Way:
    kind = int(rng.integers(4))
    if kind == 0:
        return replace(way, knots=np.clip(way.knots + rng.normal(0, 0.3, KNOTS), -1, 1))
    if kind == 1:
        return replace(way, reach=min(1.0, way.reach * float(10 ** rng.normal(0, 0.5))))
    if kind == 2:
        return replace(way, centre=float(np.clip(way.centre + rng.normal(0, 0.02), 0, 1)))
    return replace(way, held=not way.held)


def _values(way: Way, port: Port, steps: int) -> Array:
    width = port.high - port.low
    knots = port.low + width * np.clip(way.centre + way.reach * way.knots, 0, 1)
    at = np.linspace(0, KNOTS - 1, steps)
    moved = knots[np.minimum(at.astype(int), KNOTS - 1)] if way.held else None
    value = np.interp(at, np.arange(KNOTS), knots) if moved is None else moved
    value = np.clip(single(np.rint(value) + 0.0 if counts(port) else value), port.low, port.high)
    return value if port.size == 1 else np.tile(value[:, None], (1, port.size))


def stream_of(block: Block, ways: list[Way], steps: int) -> Stream:
    """The stream that a recipe makes."""
    inputs = {p.name: _values(w, p, steps) for p, w in zip(block.inputs, ways, strict=True)}
    return Stream("found by search", inputs, rough=True)


def search(
    block: Block,
    judge: Callable[[Stream], Any],
    seed: int,
    tries: int = 12,
    climbs: int = 24,
    steps: int = 400,
) -> Found:
    """The worst of ``tries`` random recipes, then changed ``climbs`` times, uphill only.

    judge: comparison of a stream, with ``errors``, ``limits`` and ``problems``.
    """
    rng = np.random.default_rng(seed)
    worst, ways = Found(-1.0, None, ()), [_way(rng) for _ in block.inputs]
    best = ways
    for k in range(tries + climbs):
        if k < tries:
            ways = [_way(rng) for _ in block.inputs]
        else:
            hit = int(rng.integers(len(best)))
            ways = [_changed(w, rng) if i == hit else w for i, w in enumerate(best)]
        stream = stream_of(block, ways, steps)
        found = judge(stream)
        ratio = max(
            (e / found.limits[n] for n, e in found.errors.items() if found.limits[n] > 0),
            default=0.0,
        )
        if found.problems:
            return Found(ratio, stream, tuple(found.problems))
        if ratio > worst.ratio:
            worst, best = Found(ratio, stream, ()), ways
    return worst
