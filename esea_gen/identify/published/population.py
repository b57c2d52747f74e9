"""Global search over a box: a seeded population, its best members, least squares from them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.language.ports import Array

Residual = Callable[[Array], Array]


def sobol_points(low: Array, high: Array, count: int, seed: int) -> Array:
    """Points of a Sobol sequence over a box, shape (count, numbers)."""
    sobol = scipy.stats.qmc.Sobol(len(low), seed=seed)
    return np.asarray(scipy.stats.qmc.scale(sobol.random(count), low, high))


def finalists(points: Array, costs: Array, low: Array, high: Array, most: int) -> list[Array]:
    """The best points that are not neighbours of a better one."""
    unit = (points - low) / (high - low)
    chosen: list[int] = []
    for i in np.argsort(costs, kind="stable"):
        if all(np.abs(unit[i] - unit[j]).max() > 0.1 for j in chosen):
            chosen.append(int(i))
        if len(chosen) == most:
            break
    return [points[i] for i in chosen]


def polished(
    residual: Residual, start: Array, low: Array, high: Array, **settings: Any
) -> tuple[float, Array]:
    """Square sum and place of the bounded least-squares minimum next to a start."""
    width = high - low
    inside = np.clip(start, low + 1e-6 * width, high - 1e-6 * width)
    done = scipy.optimize.least_squares(
        residual, inside, bounds=(low, high), x_scale=width, **settings
    )
    return 2 * float(done.cost), np.asarray(done.x, dtype=np.float64)


def runner_up(costs: list[float]) -> float:
    """Cost of the second best over the best's, in ascending order: near 1 when found repeatedly."""
    return costs[1] / costs[0] if len(costs) > 1 and costs[0] > 0 else float("inf")
