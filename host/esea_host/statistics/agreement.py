"""Agreement of two coders of the same comments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from esea_host.statistics.checks import NoStatisticError, StatisticResult


@dataclass(frozen=True)
class Agreement(StatisticResult):
    """Agreement of two coders of n items: the share observed, and Cohen's kappa.

    low, high: 95 % interval of Fleiss, Cohen and Everitt; where they agree on all, which leaves
    that without a width, from Wilson's of the share.  table: counts, the first coder's codes in
    rows.
    """

    n: int
    observed: float
    kappa: float
    low: float
    high: float
    categories: tuple[str, ...]
    table: tuple[tuple[int, ...], ...]


def cohens_kappa(one: Sequence[str], other: Sequence[str]) -> Agreement:
    """Cohen's kappa of both coders' codes, item by item; 1 where they agree on all of several."""
    from statsmodels.stats.inter_rater import cohens_kappa as fitted
    from statsmodels.stats.proportion import proportion_confint

    if len(one) != len(other) or len(one) == 0:
        raise NoStatisticError(
            f"{len(one)} items of one coder, {len(other)} of the other.",
            "Give both codes of each item.",
        )
    names = sorted({str(x) for x in (*one, *other)})
    if len(names) < 2:
        raise NoStatisticError("Both coders use one code only.", "Kappa needs two or more.")
    table = np.zeros((len(names), len(names)), dtype=int)
    np.add.at(table, ([names.index(str(x)) for x in one], [names.index(str(x)) for x in other]), 1)
    # Of full agreement it also forms a z value, 0/0, which is not used.
    with np.errstate(invalid="ignore", divide="ignore"):
        found = fitted(table)
    observed, low = float(np.trace(table) / len(one)), float(found.kappa_low)
    if observed == 1:
        chance = float(table.sum(axis=0) @ table.sum(axis=1)) / len(one) ** 2
        low = (proportion_confint(len(one), len(one), method="wilson")[0] - chance) / (1 - chance)
    return Agreement(
        len(one),
        observed,
        float(found.kappa),
        max(-1.0, low),
        min(1.0, float(found.kappa_upp)),
        tuple(names),
        tuple(tuple(int(v) for v in row) for row in table),
    )
