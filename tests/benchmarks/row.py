"""One comparison of two programs, and how two are timed in turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.benchmarks.peers import Peer, finite

MEASURE_S = 0.0015  # one measurement; long against the clock, short against what else runs


@dataclass(frozen=True)
class Row:
    """One comparison.

    ratio: peer over ours: how many times less ours takes.
    unit: ``ns``, ``s`` or ``instructions``.
    low, high: range of the middle half of the ratios; not part of the JSON.
    """

    name: str
    ours: float
    peer: float
    ratio: float
    unit: str
    low: float
    high: float

    def to_dict(self) -> dict[str, str | float]:
        """JSON-ready content."""
        return {
            "name": self.name,
            "ours": finite(self.ours),
            "peer": finite(self.peer),
            "ratio": finite(self.ratio),
            "unit": self.unit,
        }

    @classmethod
    def exact(cls, name: str, ours: float, peer: float, unit: str) -> Row:
        """A row of two figures that do not scatter."""
        return cls(name, ours, peer, peer / ours, unit, peer / ours, peer / ours)


def compare(name: str, ours: Peer, peer: Peer, steps: int, pairs: int) -> Row:
    """Time two peers in turns."""
    passes = {}
    for p in (ours, peer):
        p.run(1)
        passes[p.name] = max(1, int(MEASURE_S / max(p.run(1), 1e-9)))
    a, b = np.empty(pairs), np.empty(pairs)
    for k in range(pairs):
        turn = [(a, ours), (b, peer)]
        for store, p in turn if k % 2 == 0 else turn[::-1]:
            store[k] = 1e9 * p.run(passes[p.name]) / (passes[p.name] * steps)
    low, ratio, high = np.quantile(b / a, [0.25, 0.5, 0.75])
    return Row(
        name,
        float(np.median(a)),
        float(np.median(b)),
        float(ratio),
        "ns",
        float(low),
        float(high),
    )
