"""What a paired comparison lets one believe, where p says only that nothing was shown."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad
from scipy.stats import t

from esea_host.statistics.checks import NoStatisticError, StatisticResult, share
from esea_host.statistics.paired_t import standardised_difference

PRIOR_WIDTH = math.sqrt(0.5)  # of the Cauchy prior on d_z: the default of R's BayesFactor


@dataclass(frozen=True)
class BayesPaired(StatisticResult):
    """Posterior of the mean difference x - y, normal differences, flat prior on mean and log sd.

    Parameters
    ----------
    mean, low, high, probability_positive : float
        Posterior mean and credible interval in the data's unit; that the mean is above 0.
    equivalence, probability_equivalent : float
        Half-width of the range that counts as no difference; that the mean lies within it.
    bayes_factor_01 : float
        How much more likely the data are under no difference than under d_z ~ Cauchy(0, 0.707).
    """

    mean: float
    low: float
    high: float
    probability_positive: float
    equivalence: float
    probability_equivalent: float
    bayes_factor_01: float


def bayes_paired(
    x: ArrayLike,
    y: ArrayLike | None = None,
    *,
    equivalence: float | None = None,
    confidence: float = 0.95,
) -> BayesPaired:
    r"""Posterior of the mean paired difference, and the evidence for none.

    Parameters
    ----------
    x, y : array_like
        Both conditions of the same people, shape (n,); without y, x has the differences.
    equivalence : float, optional
        Half-width of the range that counts as no difference; without it 0.2 standard deviations of
        the differences.
    confidence : float
        Of the credible interval.

    References
    ----------
    [1] J. N. Rouder et al., "Bayesian t tests for accepting and rejecting the null hypothesis",
        Psychon. Bull. Rev. 16, 2009, eq. 1.
    """
    share(confidence, "A confidence")
    found = standardised_difference(x, y, confidence)
    half = 0.2 * found.sd if equivalence is None else equivalence
    if not half >= 0:
        raise NoStatisticError(
            f"An equivalence range of {half}.", "Give its half-width, 0 or more."
        )
    posterior = t(found.n - 1, loc=found.mean, scale=found.sd / math.sqrt(found.n))
    return BayesPaired(
        found.mean,
        float(posterior.ppf((1 - confidence) / 2)),
        float(posterior.isf((1 - confidence) / 2)),
        float(posterior.sf(0.0)),
        half,
        float(posterior.cdf(half) - posterior.cdf(-half)),
        bayes_factor_01(found.dz * math.sqrt(found.n), found.n),
    )


def bayes_factor_01(statistic: float, n: int, width: float = PRIOR_WIDTH) -> float:
    """Evidence for no difference from a paired t statistic, Rouder et al. eq. 1 with width r."""
    df = n - 1
    null = (1 + statistic**2 / df) ** (-n / 2)

    def density(g: float) -> float:
        spread = 1 + n * width**2 * g
        data = (1 + statistic**2 / (spread * df)) ** (-n / 2)
        prior = (2 * math.pi) ** -0.5 * g**-1.5 * math.exp(-0.5 / g)
        return float(spread**-0.5 * data * prior)

    alternative, _ = quad(density, 0, np.inf, epsabs=0, epsrel=1e-9)
    return float(null / alternative)
