"""The standardised mean difference of pairs, with its exact interval."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.stats import nct, t

from esea_host.statistics.checks import NoStatisticError, as_dict, differences, share


@dataclass(frozen=True)
class PairedEffect:
    """Mean difference x - y of pairs and its size in standard deviations.

    Parameters
    ----------
    n : int
        Pairs.
    mean : float
        Mean difference, in the data's unit.
    low : float
        Lower end of its interval, by Student's t.
    high : float
        Upper end.
    sd : float
        Standard deviation of the differences.
    dz : float
        mean / sd.
    dz_low : float
        Lower end of its interval, by the noncentral t.
    dz_high : float
        Upper end.
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

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return as_dict(self)


def standardised_difference(
    x: ArrayLike, y: ArrayLike | None = None, confidence: float = 0.95
) -> PairedEffect:
    """Mean paired difference in its unit and in standard deviations (Cohen's d_z).

    Parameters
    ----------
    x : array_like
        One condition, or differences, shape (n,).
    y : array_like, optional
        The other condition of the same people, shape (n,).
    confidence : float
        Of the intervals.

    Returns
    -------
    PairedEffect
        Estimates and intervals.

    Raises
    ------
    NoStatisticError
        Fewer than 2 pairs, missing values, or differences that are all equal.
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
