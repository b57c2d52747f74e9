"""Least squares with intervals for errors that neighbouring samples share.

What a model leaves out errs in the same direction for many samples on end.  The samples are put
into blocks that are longer than that; the spread of the blocks' pulls on the estimate gives its
covariance ("clustered" or sandwich estimate [1]_), and the number of blocks its degrees of freedom.

References
----------
.. [1] A. C. Cameron, D. L. Miller, "A practitioner's guide to cluster-robust inference", Journal of
   Human Resources 50(2), 2015.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.language.ports import Array

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Estimate:
    value: float
    low: float  # ends of the interval that holds the true value with 95 % confidence
    high: float

    @classmethod
    def of(cls, value: float, deviation: float, blocks: int) -> Estimate:
        """From a standard deviation that so many blocks gave."""
        from scipy.stats import t

        half = float(t.ppf(0.5 + 0.5 * CONFIDENCE, max(blocks - 1, 1))) * deviation
        return cls(float(value), float(value - half), float(value + half))

    def times(self, by: float) -> Estimate:
        return Estimate(by * self.value, *sorted((by * self.low, by * self.high)))

    @property
    def half(self) -> float:
        return 0.5 * (self.high - self.low)

    def to_dict(self, unit: str) -> dict[str, Any]:
        """JSON-ready, the unit in every key; none for a plain number."""
        end = "" if unit == "1" else f"_{unit}"
        return {f"value{end}": self.value, f"low{end}": self.low, f"high{end}": self.high}


@dataclass(frozen=True)
class LeastSquares:
    values: Array
    covariance: Array
    residual: Array
    blocks: int

    def estimates(self) -> list[Estimate]:
        deviations = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        pairs = zip(self.values, deviations, strict=True)
        return [Estimate.of(v, d, self.blocks) for v, d in pairs]

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.residual**2)))


def _sandwich(jacobian: Array, residual: Array, blocks: Array) -> tuple[Array, int]:
    bread = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
    pulls = [jacobian[blocks == b].T @ residual[blocks == b] for b in np.unique(blocks)]
    meat = np.stack(pulls).T @ np.stack(pulls)
    n, p, m = *jacobian.shape, len(pulls)
    return bread @ meat @ bread * (m / max(m - 1, 1)) * (n / max(n - p, 1)), m


def fit_linear(terms: Array, wanted: Array, blocks: Array) -> LeastSquares:
    """Coefficients of terms that add up to a target."""
    # By the normal equations, ten times as fast as by singular values; the second pass takes back
    # what they lose.
    bread = np.linalg.pinv(terms.T @ terms, hermitian=True)
    found = bread @ (terms.T @ wanted)
    found = found + bread @ (terms.T @ (wanted - terms @ found))
    left = wanted - terms @ found
    covariance, count = _sandwich(terms, left, blocks)
    return LeastSquares(found, covariance, left, count)


def fit_separable(
    terms: Array,
    wanted: Callable[[Array], Array],
    start: Array,
    low: Array,
    high: Array,
    blocks: Array,
) -> LeastSquares:
    """As :func:`fit_linear`, where the target depends on a few more parameters."""
    from scipy.optimize import least_squares

    inverse = np.linalg.pinv(terms)

    def left(p: Array) -> Array:
        y = wanted(p)
        return np.asarray(y - terms @ (inverse @ y))

    done = least_squares(left, np.clip(start, low, high), bounds=(low, high), x_scale=high - low)
    p = done.x
    y = wanted(p)
    moved = []
    for k, size in enumerate(1e-5 * (high - low)):
        # Towards the middle, so that neither end is passed.
        step = np.zeros(len(p))
        step[k] = size if p[k] < 0.5 * (low[k] + high[k]) else -size
        moved.append((wanted(p + step) - y) / step[k])
    jacobian = np.column_stack([*(-m for m in moved), terms])
    residual = left(p)
    values = np.concatenate([p, inverse @ y])
    covariance, count = _sandwich(jacobian, residual, blocks)
    return LeastSquares(values, covariance, residual, count)
