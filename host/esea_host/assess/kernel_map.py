"""A category's map as a Gaussian process: its uncertainty grows where nobody has been.

Squared-exponential kernel; written out (SciPy has linear algebra, no Gaussian process).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from esea_host.assess.database import ResponseDataBase
from esea_host.assess.patients import DEG, Array

LENGTH_RAD, LENGTH_rad_s = 20 * DEG, 35 * DEG
WIDE = 1.6  # how much smoother a map of no category is


def smooth_covariance(a: Array, b: Array, *, wide: bool = False) -> Array:
    """Correlation of responses at locations, shapes (n, 2) and (m, 2): 1 at the same one."""
    scale = np.array([LENGTH_RAD, LENGTH_rad_s]) * (WIDE if wide else 1.0)
    d = (a[:, None] - b[None]) / scale
    return np.asarray(np.exp(-0.5 * np.sum(d**2, axis=2)))


def kernel_map(
    data: ResponseDataBase, category: str, where: Array | None = None
) -> tuple[Array, Array]:
    """Mean and standard deviation of a new person's response, at cells or elsewhere.

    where: locations, shape (n, 2); the grid's cells by default.

    The mean's own uncertainty is the process's; the spread over people is added, taken where
    people have been nearest.
    """
    centres = data.grid.centres
    mean, spread, people = data.mean(category), data.spread(category), data.people(category)
    use = np.isfinite(mean) & np.isfinite(spread)
    level = float(np.mean(mean[use]))
    amplitude = max(float(np.std(mean[use])), 0.5)
    at = centres if where is None else where
    noise = spread[use] ** 2 / people[use] + 1e-6
    inner = amplitude**2 * smooth_covariance(centres[use], centres[use]) + np.diag(noise)
    cross = amplitude**2 * smooth_covariance(at, centres[use])
    factor = cho_factor(inner, lower=True)
    found = level + cross @ cho_solve(factor, mean[use] - level)
    variance = amplitude**2 - np.sum(cross * cho_solve(factor, cross.T).T, axis=1)
    closeness = smooth_covariance(at, centres[use])
    nearest = spread[use][np.argmax(closeness, axis=1)]
    return found, np.sqrt(np.maximum(variance, 0) + nearest**2)
