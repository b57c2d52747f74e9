"""How well a fit determines its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.identify.published.parameters import at_bound, bounds_of
from esea_gen.identify.published.plant import FittedPlant
from esea_gen.identify.recording.resampling import LeftOut, autocorrelation, resampled
from esea_gen.language.ports import Array
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS


def relative_jacobian(
    run: Callable[[dict[str, float]], Array],
    values: Mapping[str, float],
    keys: Sequence[str],
    share: float,
) -> Array:
    """What a relative change of each parameter does, by central differences."""
    columns = []
    for k in keys:
        step = share * values[k]
        up, down = (run({**values, k: values[k] + s}) for s in (step, -step))
        columns.append((up - down) / (2 * step) * values[k])
    return np.column_stack(columns)


@dataclass(frozen=True)
class Uncertainty:
    """What the Jacobian says at the optimum."""

    sigma: dict[str, float | None]  # inf: no effect; None: fixed or at a bound
    weakest: dict[str, Any]
    correlation_factor: float  # by which neighbouring residuals raise sigma
    resampled: LeftOut | None = None  # None: no parameter is free


def free_keys(values: Mapping[str, float]) -> list[str]:
    """Parameters that a fit can move: neither fixed nor at a bound."""
    keys = (k for k in (*MODEL_KEYS, *RATE_KEYS) if k in values and k != "eps2")
    return [k for k in keys if at_bound(k, values[k]) is None]


def uncertainty(plant: FittedPlant, values: Mapping[str, float]) -> Uncertainty:
    """Standard deviations from blocks left out (:mod:`esea_gen.identify.recording.resampling`)."""
    # The Jacobian says which parameters the torque does not depend on, and in which direction the
    # fit is weakest.
    free = free_keys(values)
    rows = len(plant.measured)
    scale = plant.weight * math.sqrt(rows)  # unit weight on average
    residual = (plant.torque(values) - plant.measured) * scale
    sigma: dict[str, float | None] = {k: None for k in (*MODEL_KEYS, *RATE_KEYS) if k in values}
    rho = autocorrelation(residual)
    factor = math.sqrt((1 + rho) / (1 - rho))
    if not free:
        return Uncertainty(sigma, {}, factor)
    jacobian = relative_jacobian(plant.torque, values, free, 1e-3) * scale[:, None]
    _, singular, v = np.linalg.svd(jacobian, full_matrices=False)
    dead = singular < 1e-9 * singular[0]
    low, high = np.array([bounds_of(k) for k in free]).T / [values[k] for k in free] - 1
    apart = jacobian / scale[:, None], -residual / scale, scale
    found = resampled(*apart, plant.rows, plant.whole, (low, high))
    for i, k in enumerate(free):
        # A direction without effect makes those parameters infinite that take part in it.
        lost = bool(np.any(dead & (np.abs(v[:, i]) > 1e-3)))
        sigma[k] = math.inf if lost else float(found.sigma[i]) * values[k]
    direction = {k: round(float(x), 3) for k, x in zip(free, v[-1], strict=True)}
    weakest = {"direction": direction, "rms_change_Nm": 0.1 * float(singular[-1]) / math.sqrt(rows)}
    return Uncertainty(sigma, weakest, factor, found)
