"""The standardised mean difference of pairs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtr
from scipy.stats import norm, t

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
        raise NoStatisticError("All differences are equal.", "They have no standard deviation.")
    statistic = mean / sd * math.sqrt(n)
    half = float(t.isf(TAIL, n - 1)) * sd / math.sqrt(n)
    return PairedEffect(
        n,
        mean,
        mean - half,
        mean + half,
        sd,
        mean / sd,
        float(2 * t.sf(abs(statistic), n - 1)),
    )


def noncentral_t_sf(value: float, df: int, shift: float) -> float:
    """Probability that (z + shift) / sqrt(chi2 / df) exceeds a value, z standard normal.

    SciPy's noncentral t is not a number for some of these.
    """
    if value < 0:
        return 1 - noncentral_t_sf(-value, df, -shift)
    if value == 0:
        return float(norm.cdf(shift))
    # Beyond 13 the normal density is nothing; around z + shift = value the chi square's part rises.
    rise = value - shift + value / math.sqrt(2 * df) * np.arange(-8, 9)
    edges = np.unique(np.clip([*np.arange(-13, 14), *rise], max(-shift, -13.0), 13.0))
    nodes, weights = np.polynomial.legendre.leggauss(24)
    half = np.diff(edges)[:, None] / 2
    z = edges[:-1, None] + half * (1 + nodes)
    return float(np.sum(half * weights * norm.pdf(z) * chdtr(df, df * ((z + shift) / value) ** 2)))
