"""The standardised mean difference of pairs, with its exact interval."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.stats import nct, t

from esea_host.statistics.checks import NoStatisticError, StatisticResult, differences, share


@dataclass(frozen=True)
class PairedEffect(StatisticResult):
    """Mean difference x - y of pairs and its size in standard deviations.

    Parameters
    ----------
    n, mean, low, high : float
        Pairs; mean difference in the data's unit, and its interval by Student's t.
    sd, dz, dz_low, dz_high : float
        Standard deviation of the differences; mean / sd, and its interval by the noncentral t.
    p : float
        Two-sided, paired t test.
    """

    n: int
    mean: float
    low: float
    high: float
    sd: float
    dz: float
    dz_low: float
    dz_high: float
    p: float


def standardised_difference(
    x: ArrayLike, y: ArrayLike | None = None, confidence: float = 0.95
) -> PairedEffect:
    """Mean paired difference in its unit and in standard deviations (Cohen's d_z).

    Parameters
    ----------
    x, y : array_like
        Both conditions of the same people, shape (n,); without y, x has the differences.
    confidence : float
        Of the intervals.
    """
    share(confidence, "A confidence")
    found = differences(x, y, least=2)
    n, mean, sd = len(found), float(np.mean(found)), float(np.std(found, ddof=1))
    if sd <= 1e-12 * float(np.max(np.abs(found))):
        raise NoStatisticError("All differences are equal.", "They have no standard deviation.")
    statistic = mean / sd * math.sqrt(n)
    half = float(t.isf((1 - confidence) / 2, n - 1)) * sd / math.sqrt(n)

    def end(tail: float) -> float:
        def off(delta: float) -> float:
            found = float(nct.cdf(statistic, n - 1, delta))
            # Far off, where the noncentral distribution is not a number, it is at its end.
            return (found if math.isfinite(found) else float(delta < statistic)) - tail

        step = math.sqrt(1 + statistic**2 / (2 * (n - 1))) * (1 if tail < 0.5 else -1)
        far = statistic + step
        while off(far) * step > 0:
            far += step
        return float(brentq(off, *sorted((statistic, far)))) / math.sqrt(n)

    tail = (1 - confidence) / 2
    return PairedEffect(
        n,
        mean,
        mean - half,
        mean + half,
        sd,
        mean / sd,
        end(1 - tail),
        end(tail),
        float(2 * t.sf(abs(statistic), n - 1)),
    )
