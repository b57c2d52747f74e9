"""A second computation of the sensor's deflection, for several tests."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

H = 1e-3
GAIN = 1 - np.exp(-2 * np.pi * 8 * H)


def middle_rate(counts: np.ndarray, bandwidth_Hz: float = 15.0) -> np.ndarray:
    """The observer's rate in the middle of the step: docs/velocity.md's transfer function."""
    p = np.exp(-2 * np.pi * bandwidth_Hz * H)
    b, g = 1.5 * (1 - p) ** 2 * (1 + p), (1 - p) ** 3
    taps = np.convolve([1, -1], [b + g / 2, g / 2 - b]) / H
    return lfilter([0, *taps], np.poly([p, p, p]), counts - counts[0])


def filtered(counts: np.ndarray, count: float, bandwidth_Hz: float = 15.0) -> np.ndarray:
    """Moved on by the rate, corrected by the counts, within a count of them."""
    moves = (H * middle_rate(counts, bandwidth_Hz)).tolist()
    out, last = [], float(counts[0])
    for now, move in zip(counts.tolist(), moves, strict=True):
        ahead = last + move
        last = min(max(ahead + GAIN * (now - ahead), now - count), now + count)
        out.append(last)
    return np.array(out)
