"""A linear mixed model as a check on the simpler analyses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar
from scipy.stats import t

from esea_host.statistics.checks import (
    ROUNDING,
    Array,
    NoStatisticError,
    StatisticResult,
    largest,
    numbers,
)


@dataclass(frozen=True)
class MixedModel(StatisticResult):
    """Value = mean + treatment + period + person, by restricted maximum likelihood.

    treatment: first minus second; period: second minus first; each with standard error and two-
    sided p by Student's t with df: recordings less people less 2, as R's nlme.
    """

    treatment: float
    treatment_se: float
    treatment_p: float
    period: float
    period_se: float
    period_p: float
    df: int
    between_sd: float
    within_sd: float


def mixed_model(
    values: ArrayLike,
    people: Sequence[str],
    treatment: Sequence[str],
    period: Sequence[int],
    treatments: tuple[str, str],
) -> MixedModel:
    """Fit a random intercept a person; who misses a period counts as well.

    The restricted likelihood, with effects and scale profiled out, is maximised over the one ratio
    of variances that is left.  Refused where people with both periods do not tell treatment and
    period apart.
    """
    found = numbers(values, "The values", 4)
    who = _checked(found, people, treatment, period, treatments)
    scale, centre = largest(found), float(found.mean())
    spread = largest(found - centre) or 1.0
    first = np.array([x == treatments[0] for x in treatment]) - 0.5
    second = np.array([x == 2 for x in period]) - 0.5
    # Value, mean, treatment, period; and what of each a person has in common.
    table = np.column_stack([(found - centre) / spread, np.ones(len(found)), first, second])
    count = np.bincount(who)
    common = np.column_stack([np.bincount(who, c) / count for c in table.T])[who]
    df = len(found) - len(count) - 2
    if df < 1 or np.linalg.matrix_rank((table - common)[:, 2:]) < 2:
        raise NoStatisticError(
            "The mixed model cannot tell treatment and period apart.",
            "Give at least 3 people with both periods, not all in one order.",
        )

    def fitted(ratio: float) -> tuple[float, Array, Array, float]:
        # Whitened by the part of the common share that leaves errors alike and uncorrelated.
        white = table - (1 - 1 / np.sqrt(1 + ratio * count))[who, None] * common
        y, x = white[:, 0], white[:, 1:]
        inverse = np.linalg.inv(x.T @ x)
        effects = inverse @ x.T @ y
        rest = float(np.sum((y - x @ effects) ** 2))
        variance = rest / (len(y) - 3)
        determinants = np.sum(np.log1p(ratio * count)) - np.linalg.slogdet(inverse)[1]
        off = (len(y) - 3) * np.log(max(variance, 1e-300)) + float(determinants)
        return off, effects, variance * inverse, variance

    grid = np.linspace(-12, 50, 125)
    best = int(np.argmin([fitted(np.exp(g))[0] for g in grid]))
    ends = grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)]
    log = minimize_scalar(
        lambda g: fitted(np.exp(g))[0], bounds=ends, method="bounded", options={"xatol": 1e-10}
    ).x
    ratio = min((0.0, float(np.exp(log))), key=lambda r: fitted(r)[0])
    _, effects, covariance, variance = fitted(ratio)
    if best == len(grid) - 1 or spread * np.sqrt(variance) <= ROUNDING * scale:
        raise NoStatisticError("The mixed model has no standard errors.", "Add people.")
    errors = np.sqrt(np.diag(covariance))
    p = 2 * t.sf(np.abs(effects / errors), df)
    effects, errors, within = spread * effects, spread * errors, spread * float(np.sqrt(variance))
    return MixedModel(
        float(effects[1]),
        float(errors[1]),
        float(p[1]),
        float(effects[2]),
        float(errors[2]),
        float(p[2]),
        df,
        float(np.sqrt(ratio)) * within,
        within,
    )


def _checked(
    found: Array,
    people: Sequence[str],
    treatment: Sequence[str],
    period: Sequence[int],
    treatments: tuple[str, str],
) -> Array:
    """Number of each recording's person."""
    if not len(found) == len(people) == len(treatment) == len(period):
        raise NoStatisticError("Columns of different lengths.", "Give one row per recording.")
    unknown = [*sorted(set(treatment) - set(treatments)), *sorted(set(period) - {1, 2})]
    if unknown or treatments[0] == treatments[1]:
        raise NoStatisticError(
            f"Treatment or period {', '.join(map(str, unknown)) or treatments[0]}.",
            f"Give {treatments[0]} and another one; periods are 1 and 2.",
        )
    if len(set(zip(people, period, strict=True))) < len(found):
        raise NoStatisticError("Two recordings of a person in one period.", "Average them first.")
    _, who = np.unique(list(people), return_inverse=True)
    return np.asarray(who)
