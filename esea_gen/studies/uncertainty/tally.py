"""Errors counted by class of torque and rate, and what their distribution comes to."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.identify.worth import RATE_EDGES, TORQUE_EDGES
from esea_gen.language.ports import Array

TORQUES, RATES = len(TORQUE_EDGES) - 1, len(RATE_EDGES) - 1
GROUPS = 10
# Errors are counted in classes 0.9 % wide above a ten thousandth of full scale.
FINEST, HALF_CLASSES, WIDEST = 1e-4, 1000, 2.0


@dataclass(frozen=True)
class Figures:
    """Error of one source in one class of torque and rate, or over several."""

    bias_Nm: float
    sigma_Nm: float
    low_Nm: float
    high_Nm: float
    bias_error_Nm: float
    sigma_error_Nm: float
    interval_error_Nm: float
    samples: int

    @property
    def half_width_Nm(self) -> float:
        return max(abs(self.low_Nm), abs(self.high_Nm))

    def shares(self, full_scale_Nm: float) -> dict[str, float | int]:
        """In Nm and in % of full scale."""
        out: dict[str, float | int] = {}
        for name, value in vars(self).items():
            out[name] = value
            if name.endswith("_Nm"):
                out[name.replace("_Nm", "_percent")] = 100 * value / full_scale_Nm
        return out


class Tally:
    """Errors of one source, counted as the runs come in."""

    def __init__(self, full_scale_Nm: float) -> None:
        self.finest = FINEST * full_scale_Nm
        self.top = math.log1p(WIDEST / FINEST)
        self.sums: list[Array] = []
        self.squares: list[Array] = []
        self.counts: Any = None
        self.classes = np.zeros((GROUPS, TORQUES * RATES, 2 * HALF_CLASSES), dtype=np.int64)

    def add(self, error: Array, cell: Any) -> None:
        cells = TORQUES * RATES
        self.counts = np.bincount(cell, minlength=cells)
        self.sums.append(np.bincount(cell, error, cells).astype(np.float64))
        self.squares.append(np.bincount(cell, error * error, cells).astype(np.float64))
        place = np.sign(error) * np.log1p(np.abs(error) / self.finest) / self.top
        index = np.floor((np.clip(place, -1, 1 - 1e-12) + 1) * HALF_CLASSES).astype(np.int64)
        flat = np.bincount(cell * 2 * HALF_CLASSES + index, minlength=cells * 2 * HALF_CLASSES)
        self.classes[(len(self.sums) - 1) % GROUPS] += flat.reshape(cells, -1)

    def figures(self, chosen: Any, runs: int | None = None) -> Figures | None:
        """Over some of the classes, for the first runs; None where there is no sample."""
        n = int(self.counts[chosen].sum())
        if n == 0:
            return None
        mean = np.array([s[chosen].sum() for s in self.sums[:runs]]) / n
        square = np.array([s[chosen].sum() for s in self.squares[:runs]]) / n
        bias = float(mean.mean())
        sigma = math.sqrt(max(float(square.mean()) - bias * bias, 0.0))
        count = len(mean)
        bias_error = float(mean.std(ddof=1)) / math.sqrt(count) if count > 1 else 0.0
        # Of the variance round the common mean, then of its root.
        around = square - 2 * bias * mean
        spread = float(around.std(ddof=1)) / math.sqrt(count) if count > 1 else 0.0
        sigma_error = spread / (2 * sigma) if sigma > 0 else 0.0
        groups = self.classes[:, chosen].sum(axis=1)
        low, high = self._interval(groups.sum(axis=0))
        used = [self._interval(g) for g in groups if g.any()]
        ends = np.array(used)
        between = ends.std(axis=0, ddof=1) / math.sqrt(len(used)) if len(used) > 1 else np.zeros(2)
        return Figures(bias, sigma, low, high, bias_error, sigma_error, float(np.max(between)), n)

    def _interval(self, classes: Any) -> tuple[float, float]:
        share = np.cumsum(classes) / classes.sum()
        ends = []
        for wanted in (0.025, 0.975):
            middle = (int(np.searchsorted(share, wanted)) + 0.5) / HALF_CLASSES - 1
            ends.append(math.copysign(self.finest * math.expm1(abs(middle) * self.top), middle))
        return ends[0], ends[1]
