"""Detectable difference for a number of people, and people needed for a difference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.stats import nct, t

from esea_host.statistics.checks import Array, NoStatisticError, StatisticResult, share
from esea_host.statistics.signed_rank import MOST_EXACT, attainable_p

REPEATS, SEED = 20_000, 1
POWER = 0.8  # desired
_MOST_PEOPLE = 2000
_LARGEST_DZ = 20.0


@dataclass(frozen=True)
class PowerStatement(StatisticResult):
    """Smallest effect that a two-sided signed-rank test of n pairs can detect.

    dz, difference: the smallest mean difference that is found with this power, in standard
    deviations of the differences (infinite where none can be) and in the data's unit (NaN without a
    standard deviation).  powers, needed: by standardised difference the power, and the people
    needed for the desired power.
    """

    n: int
    alpha: float
    power: float
    dz: float
    difference: float
    powers: dict[str, float]
    needed: dict[str, int]

    def sentence(self, unit: str = "") -> str:
        """One sentence for a report; unit: of the difference."""
        if math.isinf(self.dz):
            return (
                f"{self.n} people cannot show any difference at alpha = {self.alpha:.3g}: their "
                f"smallest p is {attainable_p(self.n)[0]:.3g}."
            )
        size = f"{self.dz:.2f} standard deviations of the differences"
        if math.isfinite(self.difference):
            size = f"{self.difference:.3g} {unit}".strip() + f" ({size})"
        return (
            f"With {self.n} people and alpha = {self.alpha:.3g} a difference of {size} would have "
            f"been found with {self.power:.0%} power, a smaller one less often."
        )


def paired_t_power(n: int, dz: float, alpha: float = 0.05) -> float:
    """Power of the two-sided paired t test, exact for normal differences."""
    share(alpha, "An alpha")
    if n < 2 or not math.isfinite(dz):
        raise NoStatisticError(f"{n} pairs, d_z = {dz}.", "Give at least 2 pairs and a number.")
    critical, shift = float(t.isf(alpha / 2, n - 1)), dz * math.sqrt(n)
    return float(np.sum(nct.sf(critical, n - 1, [shift, -shift])))


@cache
def _noise(n: int) -> Array:
    # The same for every effect, so that power rises with the effect in one sample, too.
    return np.random.default_rng([SEED, n]).standard_normal((REPEATS, n))


@cache
def signed_rank_power(n: int, dz: float, alpha: float = 0.05) -> float:
    """Power of the two-sided exact signed-rank test, for normal differences.

    The share of 20000 simulated samples with p < alpha: a standard error of at most 0.0035.  Beyond
    50 pairs that of the t test with 3/pi of the pairs: its asymptotic efficiency.
    """
    share(alpha, "An alpha")
    if not 2 <= n <= _MOST_PEOPLE or not math.isfinite(dz):
        raise NoStatisticError(f"{n} pairs, d_z = {dz}.", f"Give 2 to {_MOST_PEOPLE} pairs.")
    if n > MOST_EXACT:
        return paired_t_power(round(n * 3 / math.pi), dz, alpha)
    most = int(np.sum(attainable_p(n) < alpha)) - 1  # largest smaller rank sum that is significant
    if most < 0:
        return 0.0
    found = _noise(n) + dz
    ranks = np.argsort(np.argsort(np.abs(found), axis=1), axis=1) + 1.0
    plus = np.sum(ranks, axis=1, where=found > 0)
    return float(np.mean(np.minimum(plus, n * (n + 1) / 2 - plus) <= most))


@cache
def detectable_effect(n: int, alpha: float = 0.05) -> float:
    """Smallest d_z that n pairs show with a power of 80 %; infinite where none can be shown."""
    if signed_rank_power(n, _LARGEST_DZ, alpha) < POWER:
        return math.inf
    if alpha >= POWER:
        return 0.0
    return float(
        brentq(lambda d: signed_rank_power(n, d, alpha) - POWER, 0.0, _LARGEST_DZ, xtol=1e-4)
    )


@cache
def participants_needed(dz: float, alpha: float = 0.05) -> int | None:
    """Fewest pairs that show a d_z with a power of 80 %; None where 2000 are not enough."""
    low, high = 2, _MOST_PEOPLE
    if signed_rank_power(high, dz, alpha) < POWER:
        return None
    while low < high:
        middle = (low + high) // 2
        if signed_rank_power(middle, dz, alpha) >= POWER:
            high = middle
        else:
            low = middle + 1
    return low


def power_statement(n: int, sd: float = math.nan, alpha: float = 0.05) -> PowerStatement:
    """Detectable effect of n pairs, independent of their result; sd: of the differences.

    Of a family of m tests the first step of Holm's is alpha / m.  Never of the difference that was
    observed: the power of that says no more than its p.
    """
    if sd <= 0 or math.isinf(sd):
        raise NoStatisticError(f"A standard deviation of {sd:g}.", "Give more than 0, or none.")
    dz = detectable_effect(n, alpha)
    sizes = (0.2, 0.5, 0.8, 1.0, 1.5)
    return PowerStatement(
        n,
        alpha,
        POWER,
        dz,
        dz * sd,
        {f"{d:g}": signed_rank_power(n, d, alpha) for d in sizes},
        {f"{d:g}": m for d in sizes if (m := participants_needed(d, alpha)) is not None},
    )
