"""Two treatments, two periods, two sequences: treatment, period and carry-over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t

from esea_host.statistics.checks import (
    ROUNDING,
    TAIL,
    Array,
    NoStatisticError,
    StatisticResult,
    largest,
    numbers,
)


@dataclass(frozen=True)
class Effect(StatisticResult):
    """An estimate in the data's unit, its interval, and its two-sided p by Student's t."""

    estimate: float
    low: float
    high: float
    se: float
    df: int
    p: float


@dataclass(frozen=True)
class Crossover(StatisticResult):
    """Analysis of a two-period cross-over.

    people: by the treatment that they had first.  treatment: first minus second, free of the period
    effect; period: second minus first, free of the treatment effect.  carry_over: difference of the
    two sequences' sums.  It has little power; to let it decide on the analysis biases that
    (Freeman, 1989), so it decides nothing.
    """

    treatments: tuple[str, str]
    people: dict[str, int]
    treatment: Effect
    period: Effect
    carry_over: Effect


def crossover(
    first_period: ArrayLike,
    second_period: ArrayLike,
    first_treatment: Sequence[str],
    treatments: tuple[str, str],
) -> Crossover:
    """Treatment, period and carry-over effects from each person's values.

    [1] M. Hills, P. Armitage, "The two-period cross-over clinical trial", Br. J. Clin. Pharmacol.
        8, 1979.
    [2] S. Senn, Cross-over Trials in Clinical Research, 2nd ed., ch. 3.
    """
    one, two, forward = _checked(first_period, second_period, first_treatment, treatments)
    change, scale = one - two, largest(one, two)
    # Sign of the second sequence turned: the difference of the sequences is then twice the first
    # period minus the second.
    flipped = np.where(forward, change, -change)
    return Crossover(
        treatments,
        {treatments[0]: int(forward.sum()), treatments[1]: int((~forward).sum())},
        _contrast(change, forward, 0.5, scale),
        _contrast(-flipped, forward, 0.5, scale),
        _contrast(one + two, forward, 1.0, scale),
    )


def _checked(
    first_period: ArrayLike,
    second_period: ArrayLike,
    first_treatment: Sequence[str],
    treatments: tuple[str, str],
) -> tuple[Array, Array, Any]:
    one = numbers(first_period, "The first period")
    two = numbers(second_period, "The second period")
    unknown = sorted({str(x) for x in first_treatment} - set(treatments))
    if unknown or treatments[0] == treatments[1]:
        raise NoStatisticError(
            f"First treatments {', '.join(unknown) or treatments[0]}.",
            f"Give two, here {treatments[0]} and {treatments[1]}.",
        )
    forward = np.array([x == treatments[0] for x in first_treatment])
    if not one.shape == two.shape == forward.shape:
        raise NoStatisticError(
            f"{len(one)} first values, {len(two)} second ones, {len(forward)} sequences.",
            "Give all three of each person, in the same order.",
        )
    if min(forward.sum(), (~forward).sum()) < 2:
        raise NoStatisticError(
            f"{forward.sum()} and {(~forward).sum()} people in the two sequences.",
            "Give at least 2 in each.",
        )
    return one, two, forward


def _contrast(values: Array, forward: Any, factor: float, scale: float) -> Effect:
    # Half, or all, of the difference of the sequences' means, with their common variance.
    unit = float(np.max(np.abs(values))) or 1.0
    a, b = values[forward] / unit, values[~forward] / unit
    df = len(a) + len(b) - 2
    sd = float(np.sqrt((np.sum((a - a.mean()) ** 2) + np.sum((b - b.mean()) ** 2)) / df))
    if sd <= ROUNDING * scale / unit:
        sd = 0.0  # without any spread nothing can be tested
    se = factor * unit * sd * float(np.sqrt(1 / len(a) + 1 / len(b)))
    estimate = factor * unit * float(a.mean() - b.mean())
    half = float(t.isf(TAIL, df)) * se
    p = float(2 * t.sf(abs(estimate) / se, df)) if se > 0 else float("nan")
    return Effect(estimate, estimate - half, estimate + half, se, df, p)
