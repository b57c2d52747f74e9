"""The standardised mean difference of pairs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t

from esea_host.statistics.checks import (
    ROUNDING,
    TAIL,
    NoStatisticError,
    StatisticResult,
    differences,
)


@dataclass(frozen=True)
class PairedEffect(StatisticResult):
    """Mean difference x - y, its interval and two-sided p by Student's t; dz: mean / sd."""

    n: int
    mean: float
    low: float
    high: float
    sd: float
    dz: float
    p: float


def standardised_difference(x: ArrayLike, y: ArrayLike | None = None) -> PairedEffect:
    """Mean paired difference in its unit and in standard deviations; x alone: differences."""
    found, scale = differences(x, y, least=2)
    # Scaled: the square of a tiny unit's value is 0.
    unit = float(np.max(np.abs(found))) or 1.0
    n, mean = len(found), float(np.mean(found))
    sd = unit * float(np.std(found / unit, ddof=1))
    if sd <= ROUNDING * scale:
        raise NoStatisticError("All differences are equal: no standard deviation.", "Check them.")
    statistic = mean / sd * math.sqrt(n)
    half = float(t.isf(TAIL, n - 1)) * sd / math.sqrt(n)
    return PairedEffect(
        n, mean, mean - half, mean + half, sd, mean / sd, float(2 * t.sf(abs(statistic), n - 1))
    )
