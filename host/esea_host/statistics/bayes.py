"""Bayes factor of a paired comparison, for evidence of no difference."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from scipy.stats import t

from esea_host.statistics.checks import TAIL, StatisticResult
from esea_host.statistics.paired_t import standardised_difference

PRIOR_WIDTH = math.sqrt(0.5)  # of the Cauchy prior on d_z: the default of R's BayesFactor


@dataclass(frozen=True)
class BayesPaired(StatisticResult):
    """Posterior of the mean difference x - y, normal differences, flat prior on mean and log sd.

    equivalence: half-width of what counts as no difference, 0.2 standard deviations of them.
    bayes_factor_01: how much more likely the data are under no difference than under d_z ~
    Cauchy(0, 0.707); the factor itself may be too small for a number, its logarithm is not.
    """

    mean: float
    low: float
    high: float
    probability_positive: float
    equivalence: float
    probability_equivalent: float
    bayes_factor_01: float
    log_bayes_factor_01: float


def bayes_paired(x: ArrayLike, y: ArrayLike | None = None) -> BayesPaired:
    """Posterior of the mean paired difference, evidence for no difference; x alone: differences.

    [1] J. N. Rouder et al., "Bayesian t tests for accepting and rejecting the null hypothesis",
        Psychon. Bull. Rev. 16, 2009, eq. 1.
    """
    found = standardised_difference(x, y)
    half = 0.2 * found.sd
    log_factor = log_bayes_factor_01(found.dz * math.sqrt(found.n), found.n)
    posterior = t(found.n - 1, loc=found.mean, scale=found.sd / math.sqrt(found.n))
    return BayesPaired(
        found.mean,
        float(posterior.ppf(TAIL)),
        float(posterior.isf(TAIL)),
        float(posterior.sf(0.0)),
        half,
        float(posterior.cdf(half) - posterior.cdf(-half)),
        math.exp(log_factor),
        log_factor,
    )


def log_bayes_factor_01(statistic: float, n: int, width: float = PRIOR_WIDTH) -> float:
    """Log Bayes factor for no difference, of a paired t statistic: Rouder et al. eq. 1, width r."""
    df = n - 1

    def log_density(log_g: float) -> float:
        # Of log g, under the alternative: what the data say, times the inverse chi square of g.
        spread = 1 + n * width**2 * math.exp(log_g)
        data = -n / 2 * math.log1p(statistic**2 / (spread * df)) - math.log(spread) / 2
        return data - (math.log(2 * math.pi) + log_g + math.exp(-log_g)) / 2

    # Below, exp(-1 / g) leaves nothing; above, it falls as 1 / g.
    low, high = -6.0, 2 * math.log(abs(statistic) + 10) + 40
    grid = np.linspace(low, high, 200)
    best = float(grid[np.argmax([log_density(g) for g in grid])])
    peak = minimize_scalar(lambda g: -log_density(g), bounds=(best - 1, best + 1), method="bounded")
    top = float(-peak.fun)
    found, _ = quad(
        lambda g: math.exp(log_density(g) - top), low, high, points=[peak.x], epsabs=0, epsrel=1e-9
    )
    return -n / 2 * math.log1p(statistic**2 / df) - top - math.log(found)
