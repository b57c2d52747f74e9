"""The deflection that the sensor gets, a second time: what several tests compare with."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter, ss2tf


def filtered(counts: np.ndarray, count: float) -> np.ndarray:
    """The deflection that the sensor gets: the observer as a transfer function, within a count."""
    p, h = np.exp(-2 * np.pi * 15 * 1e-3), 1e-3
    gain = np.array([[1 - p**3], [1.5 * (1 - p) ** 2 * (1 + p) / h], [(1 - p) ** 3 / h**2]])
    ahead = np.array([[1, h, h * h / 2], [0, 1, h], [0, 0, 1]])
    state = ahead - gain @ ahead[:1]
    b, a = ss2tf(state, gain, state[:1], gain[:1])
    estimate = counts[0] + lfilter(b[0], a, counts - counts[0])
    return np.clip(estimate, counts - count, counts + count)
