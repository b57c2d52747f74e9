"""Wilcoxon's signed-rank test, with effect, interval, ties and zeros."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm, rankdata

from esea_host.statistics.checks import (
    TAIL,
    Array,
    NoStatisticError,
    StatisticResult,
    differences,
    levels,
    share,
)

# Up to here all 2^n signs are counted: their number is exact in a double.
MOST_EXACT = 50


@dataclass(frozen=True)
class SignedRank(StatisticResult):
    """Two-sided signed-rank test of n paired differences, with effects.

    zeros: differences of 0, left out before ranking (Wilcoxon); ties: those whose magnitude another
    one shares, up to 1e-12 of the largest value, which get the mean of their ranks.  w_plus,
    w_minus: rank sums.  method: "exact" up to 50 pairs, every assignment of signs to these ranks
    counted; "normal" with ties and continuity corrected.  hodges_lehmann: median of the means of
    all pairs of differences (zeros too), with its interval and what that attains: few people do not
    allow 95 %.  rank_biserial: (w_plus - w_minus) / (w_plus + w_minus), with its score interval.
    """

    n: int
    zeros: int
    zero_method: str
    ties: int
    w_plus: float
    w_minus: float
    p: float
    method: str
    hodges_lehmann: float
    low: float
    high: float
    confidence: float
    rank_biserial: float
    rank_biserial_low: float
    rank_biserial_high: float


def signed_rank(x: ArrayLike, y: ArrayLike | None = None) -> SignedRank:
    """Test whether paired differences x - y are symmetric about 0; x alone: differences.

    [1] M. Hollander, D. A. Wolfe, E. Chicken, Nonparametric Statistical Methods, 3.1 to 3.3.
    [2] D. S. Kerby, "The simple difference formula", Comprehensive Psychology 3, 2014.
    """
    found, scale = differences(x, y, least=1)
    # 1.1 - 1.0 and 2.1 - 2.0 are a tie, though not to the last bit.
    *size, zero = levels(np.append(np.abs(found), 0.0), scale)
    nonzero = np.array(size) != zero
    kept = found[nonzero]
    if len(kept) == 0:
        raise NoStatisticError("All differences are 0.", "There is nothing to rank.")
    sizes = np.array(size)[nonzero]
    ranks = rankdata(sizes)
    plus = float(ranks[kept > 0].sum())
    minus = float(ranks[kept < 0].sum())
    exact = len(kept) <= MOST_EXACT
    p = _exact_p(ranks, plus) if exact else _normal_p(ranks, plus)
    _, counts = np.unique(sizes, return_counts=True)
    estimate, low, high, attained = hodges_lehmann(found)
    biserial = (plus - minus) / (plus + minus)
    return SignedRank(
        len(found),
        len(found) - len(kept),
        "drop",
        int(counts[counts > 1].sum()),
        plus,
        minus,
        p,
        "exact" if exact else "normal",
        estimate,
        low,
        high,
        attained,
        biserial,
        *biserial_interval(biserial, len(kept)),
    )


def null_distribution(ranks: ArrayLike) -> Array:
    """Probabilities of twice the rank sum, 0 to twice the total, all signs equally likely."""
    doubled = np.round(2 * np.asarray(ranks, dtype=np.float64)).astype(int)
    counts = np.zeros(int(doubled.sum()) + 1)
    counts[0] = 1.0
    for rank in doubled:
        counts[rank:] += counts[: len(counts) - rank].copy()
    return np.asarray(counts / 2.0 ** len(doubled))


def _exact_p(ranks: Array, plus: float) -> float:
    null, at = null_distribution(ranks), round(2 * plus)
    return float(min(1.0, 2 * min(null[: at + 1].sum(), null[at:].sum())))


def _normal_p(ranks: Array, plus: float) -> float:
    away = abs(plus - ranks.sum() / 2)
    z = max(0.0, away - 0.5) / math.sqrt(np.sum(ranks**2) / 4)
    return float(2 * norm.sf(z))


def hodges_lehmann(found: Array) -> tuple[float, float, float, float]:
    """Median of the Walsh averages, its interval, and the confidence that this attains."""
    i, j = np.triu_indices(len(found))
    walsh = np.sort((found[i] + found[j]) / 2)
    n, m = len(found), len(walsh)
    if n <= MOST_EXACT:
        below = np.cumsum(null_distribution(np.arange(1, n + 1))[::2])
    else:
        spread = math.sqrt(n * (n + 1) * (2 * n + 1) / 24)
        below = norm.cdf((np.arange(m + 1) + 0.5 - m / 2) / spread)
    # As many averages are cut off at either end as leave at most half of the error there.
    cut = int(np.searchsorted(below, TAIL, side="right"))
    attained = 1 - 2 * below[cut - 1] if cut > 0 else 1 - 2 * below[0]
    cut = max(cut, 1)
    return float(np.median(walsh)), float(walsh[cut - 1]), float(walsh[m - cut]), float(attained)


def biserial_interval(biserial: float, n: int) -> tuple[float, float]:
    """Score interval of a rank-biserial correlation.

    All rho with (biserial - rho)^2 <= z^2 (1 - rho^2) var0, the variance under no difference.  In
    simulation (6 to 40 people; normal, t3 and exponential differences) it covered 94 % or more; the
    usual interval by Fisher's transformation as little as 51 %.
    """
    total = n * (n + 1) / 2
    c = float(norm.isf(TAIL)) ** 2 * (2 * n**3 + 3 * n**2 + n) / 6 / total**2
    half = math.sqrt(max(0.0, c * (1 + c - biserial**2)))
    return max(-1.0, (biserial - half) / (1 + c)), min(1.0, (biserial + half) / (1 + c))


def attainable_p(n: int) -> Array:
    """Two-sided exact p of n pairs by the smaller rank sum, 0 to n (n + 1) / 4, without ties."""
    if not 1 <= n <= MOST_EXACT:
        raise NoStatisticError(f"{n} pairs.", f"Give 1 to {MOST_EXACT}.")
    below = np.cumsum(null_distribution(np.arange(1, n + 1))[::2])
    return np.asarray(np.minimum(1.0, 2 * below[: n * (n + 1) // 4 + 1]))


@dataclass(frozen=True)
class ImpliedEffect(StatisticResult):
    """Effect implied by a printed p of an exact signed-rank test: nearest smaller rank sum.

    rank_biserial: magnitude; as_printed: whether this p rounds to what was printed.
    """

    rank_sum: int
    p: float
    rank_biserial: float
    as_printed: bool


def effect_from_p(p: float, n: int) -> ImpliedEffect:
    """The rank sum, and with it the effect, that a printed p of two significant digits allows."""
    share(p, "A p value")
    known = attainable_p(n)
    at = int(np.argmin(np.abs(known - p)))
    half = 0.5000001 * 10.0 ** (math.floor(math.log10(p)) - 1)
    biserial = 1 - 2 * at / (n * (n + 1) / 2)
    return ImpliedEffect(at, float(known[at]), biserial, bool(abs(known[at] - p) <= half))
