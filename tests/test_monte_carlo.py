"""Percentiles: known numbers, any order, covering intervals, failures shown."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.analysis.monte_carlo import percentiles
from esea_gen.errors import UserError


def test_percentiles_of_known_numbers():
    p = percentiles("x", np.arange(101)[::-1])
    assert p.values == {5.0: 5, 25.0: 25, 50.0: 50, 75.0: 75, 95.0: 95}
    assert p.largest == 100
    # A percentile q of n uniform values lies at q +- 1.96 sqrt(q (1 - q) / n).
    for level in (25.0, 50.0, 75.0):
        half = 196 * np.sqrt(level / 100 * (1 - level / 100) / 101)
        assert p.low[level] == pytest.approx(level - half, abs=2)
        assert p.high[level] == pytest.approx(level + half, abs=2)
    with pytest.raises(UserError):
        percentiles("x", [])
    with pytest.raises(UserError):
        percentiles("x", [1.0, np.nan])


@settings(max_examples=15)
@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40), st.randoms(use_true_random=False))
def test_percentiles_do_not_know_an_order(values, random):
    first = percentiles("x", values)
    random.shuffle(values)
    assert percentiles("x", values).to_dict() == first.to_dict()
    points = [*first.values.values(), first.largest]
    assert all(a <= b + 1e-12 for a, b in itertools.pairwise(points))
    for level, value in first.values.items():
        assert first.low[level] <= value + 1e-9
        assert value <= first.high[level] + 1e-9


def test_the_bootstrap_interval_covers():
    hits = sum(
        p.low[50.0] <= 0 <= p.high[50.0]
        for p in (percentiles("x", np.random.default_rng(s).normal(size=60)) for s in range(100))
    )
    assert 88 <= hits <= 100
