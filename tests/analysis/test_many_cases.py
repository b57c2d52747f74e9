"""Many cases: the bootstrap interval of a percentile covers."""

from __future__ import annotations

import numpy as np

from esea_gen.analysis.monte_carlo import percentiles


def between(row: np.ndarray, percent: float) -> float:
    """A percentile on a straight line between order statistics."""
    row = np.sort(row)
    place = percent / 100 * (len(row) - 1)
    k = min(int(place), len(row) - 2)
    return float(row[k] + (place - k) * (row[k + 1] - row[k]))


def test_the_bootstrap_interval_covers():
    hits = sum(
        p.low[50.0] <= 0 <= p.high[50.0]
        for p in (percentiles("x", np.random.default_rng(s).normal(size=60)) for s in range(100))
    )
    assert 88 <= hits <= 100
