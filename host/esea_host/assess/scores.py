"""How good the answers are, with intervals: arrays in, numbers out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from esea_host.assess.patients import Array

Index = npt.NDArray[np.int64]
DRAWS = 1000
BINS = 10


def confusion(truth: Index, said: Index, rows: int, columns: int) -> Array:
    """Counts: truth in rows, what was said in columns."""
    out = np.zeros((rows, columns))
    np.add.at(out, (truth, said), 1)
    return out


def calibration_curve(
    confidence: Array, right: Array, bins: int = BINS
) -> tuple[Array, Array, Array]:
    """Mean confidence, share right and count of each bin of confidence; equal widths."""
    at = np.minimum((confidence * bins).astype(int), bins - 1)
    count = np.bincount(at, minlength=bins).astype(float)
    safe = np.maximum(count, 1)
    return (
        np.bincount(at, confidence, bins) / safe,
        np.bincount(at, right, bins) / safe,
        count,
    )


def calibration_error(confidence: Array, right: Array, bins: int = BINS) -> float:
    """Expected calibration error: mean distance of confidence from share right."""
    c, r, n = calibration_curve(confidence, right, bins)
    return float(np.sum(n * np.abs(c - r)) / max(1.0, n.sum()))


def interval(statistic: Callable[[Index], float], people: int, seed: int = 0) -> list[float]:
    """Middle 95 % over people drawn with replacement: whole people, not steps."""
    rng = np.random.default_rng([seed, people])
    found = [statistic(rng.integers(0, people, people)) for _ in range(DRAWS)]
    return [float(x) for x in np.quantile(found, [0.025, 0.975])]


def share_interval(hits: int, of: int) -> list[float]:
    """Wilson's 95 % interval of a share."""
    if of == 0:
        return [0.0, 1.0]
    z, p = 1.959963984540054, hits / of
    middle = (p + z**2 / (2 * of)) / (1 + z**2 / of)
    half = z / (1 + z**2 / of) * np.sqrt(p * (1 - p) / of + z**2 / (4 * of**2))
    return [float(max(0.0, middle - half)), float(min(1.0, middle + half))]
