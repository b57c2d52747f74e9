"""Many cases: the bootstrap interval of a percentile covers."""

from __future__ import annotations

import numpy as np

from esea_gen.analysis.monte_carlo import percentiles


def test_the_bootstrap_interval_covers():
    hits = sum(
        p.low[50.0] <= 0 <= p.high[50.0]
        for p in (percentiles("x", np.random.default_rng(s).normal(size=60)) for s in range(100))
    )
    assert 88 <= hits <= 100
