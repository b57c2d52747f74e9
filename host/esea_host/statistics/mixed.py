"""A linear mixed model as a check on the simpler analyses."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from esea_host.statistics.checks import NoStatisticError, StatisticResult, numbers


@dataclass(frozen=True)
class MixedModel(StatisticResult):
    """Value = mean + treatment + period + person, by restricted maximum likelihood.

    Parameters
    ----------
    treatment, treatment_se, treatment_p : float
        First treatment minus second, in the data's unit, its standard error, and a two-sided p of
        the normal distribution: too small where people are few.
    period, period_se, period_p : float
        The same of the second period minus the first.
    between_sd, within_sd : float
        Standard deviation between people and within.
    notes : tuple of str
        Warnings of the fit.
    """

    treatment: float
    treatment_se: float
    treatment_p: float
    period: float
    period_se: float
    period_p: float
    between_sd: float
    within_sd: float
    notes: tuple[str, ...]


def mixed_model(
    values: ArrayLike,
    people: Sequence[str],
    treatment: Sequence[str],
    period: Sequence[int],
    treatments: tuple[str, str],
) -> MixedModel:
    """Fit by statsmodels; people who miss a period count as well.

    Parameters
    ----------
    values, people, treatment, period : sequence
        Of each recording: its value, whose it is, under which treatment, in period 1 or 2.
    treatments : tuple of str
        Both treatments; the effect is the first's minus the second's.
    """
    from statsmodels.regression.mixed_linear_model import MixedLM

    found = numbers(values, "The values", 4)
    if not len(found) == len(people) == len(treatment) == len(period):
        raise NoStatisticError("Columns of different lengths.", "Give one row a recording.")
    first = np.array([x == treatments[0] for x in treatment], dtype=np.float64)
    second = np.array([x == 2 for x in period], dtype=np.float64)
    # Both centred: neither effect depends on how the other is coded.
    columns = np.column_stack([np.ones(len(found)), first - 0.5, second - 0.5])
    scale = float(np.std(found)) or 1.0
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            fit = MixedLM((found - found.mean()) / scale, columns, groups=np.array(people)).fit()
        except (np.linalg.LinAlgError, ValueError) as error:
            raise NoStatisticError(f"The mixed model: {error}.", "Look at the data.") from None
        errors = np.asarray(fit.bse_fe)
    if not np.isfinite(errors[1:]).all():
        raise NoStatisticError("The mixed model has no standard errors.", "More people.")
    notes = tuple(dict.fromkeys(str(w.message).strip() for w in caught))
    return MixedModel(
        float(fit.fe_params[1]) * scale,
        float(errors[1]) * scale,
        float(fit.pvalues[1]),
        float(fit.fe_params[2]) * scale,
        float(errors[2]) * scale,
        float(fit.pvalues[2]),
        float(np.sqrt(np.asarray(fit.cov_re)[0, 0])) * scale,
        float(np.sqrt(fit.scale)) * scale,
        notes,
    )
