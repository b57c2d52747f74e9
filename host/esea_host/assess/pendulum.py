"""Wartenberg's pendulum test: the leg falls from a straight knee and swings out.

[Wartenberg1951] R. Wartenberg, "Pendulousness of the legs as a diagnostic test", Neurology
    1:18-24, 1951.
[Bajd1984] T. Bajd, L. Vodovnik, "Pendulum testing of spasticity", J. Biomed. Eng. 6(1):9-16, 1984.
    Relaxation index: first swing over the way from start to rest; 1.6 and above in healthy legs
    (there it is divided by 1.6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks, savgol_filter

from esea_gen.errors import UserError
from esea_host.assess.patients import DEG, Array

REST_S = 0.5  # the end, over which the leg must be at rest
REST_RAD, REST_rad_s = 3 * DEG, 12 * DEG
LEAST_SWING_RAD = 2 * DEG  # smaller ones do not count
HEALTHY_INDEX = 1.6


@dataclass(frozen=True)
class PendulumResult:
    """Figures of one test; angles in flexion from full extension.

    relaxation_index: first swing over start to rest; decay: damping ratio from the logarithmic
    decrement of successive extremes, None with fewer than three.
    """

    start_rad: float
    rest_rad: float
    first_swing_rad: float
    relaxation_index: float
    damping_ratio: float | None
    frequency_Hz: float | None
    swings: int
    peak_rate_rad_s: float
    reached_rest: bool

    def sentences(self) -> list[str]:
        """In words."""
        out = [
            f"The leg fell by {self.first_swing_rad / DEG:.0f}° on its first swing and came to "
            f"rest {(self.rest_rad - self.start_rad) / DEG:.0f}° below where it was let go.",
            f"Relaxation index {self.relaxation_index:.2f} "
            f"(relaxed healthy legs: about {HEALTHY_INDEX} or more).",
            f"{self.swings} swings, fastest {self.peak_rate_rad_s / DEG:.0f}°/s.",
        ]
        if self.damping_ratio is not None and self.frequency_Hz is not None:
            out.append(
                f"Swings die out with a damping ratio of {self.damping_ratio:.2f}, "
                f"{self.frequency_Hz:.2f} swings a second."
            )
        if not self.reached_rest:
            out.append("The leg was still moving at the end: the resting angle is not sure.")
        return out


def pendulum_test(time_s: Array, angle_rad: Array) -> PendulumResult:
    """Figures of a pendulum test from angle over time; the release may come later than the start.

    Raises UserError where the leg does not fall.
    """
    t, x = np.asarray(time_s, dtype=float), np.asarray(angle_rad, dtype=float)
    if len(t) < 50 or np.any(np.diff(t) <= 0) or not np.all(np.isfinite(x)):
        raise UserError(
            "pendulum test: too few samples, gaps, or times that do not rise.",
            "Record at least 50 samples without gaps.",
        )
    h = float(np.median(np.diff(t)))
    even = np.arange(t[0], t[-1], h)
    window = max(5, 2 * round(0.02 / h) + 1)
    smooth = savgol_filter(np.interp(even, t, x), window, 2)
    rate = np.gradient(smooth, h)
    tail = smooth[-max(3, round(REST_S / h)) :]
    rest = float(np.mean(tail))
    reached = (
        float(np.ptp(tail)) < REST_RAD and float(np.abs(rate[-len(tail) :]).max()) < REST_rad_s
    )
    start = float(np.median(smooth[: max(3, round(0.05 / h))]))
    drop = rest - start
    if drop < 10 * DEG:
        raise UserError(
            f"pendulum test: the leg came to rest {drop / DEG:.1f} deg below its start.",
            "Let it fall from a straight knee (at least 10 deg), and check the angle's sign.",
        )
    extremes = _extremes(smooth)
    if not len(extremes):
        first, swings = rest - start, 0
    else:
        first, swings = float(smooth[extremes[0]] - start), (len(extremes) + 1) // 2
    damping, frequency = _decay(even[extremes], smooth[extremes] - rest)
    return PendulumResult(
        start,
        rest,
        first,
        first / drop,
        damping,
        frequency,
        swings,
        float(np.max(rate)),
        bool(reached),
    )


def _extremes(smooth: Array) -> Array:
    high, _ = find_peaks(smooth, prominence=LEAST_SWING_RAD)
    low, _ = find_peaks(-smooth, prominence=LEAST_SWING_RAD)
    if not len(high):
        return np.array([], dtype=int)
    both = np.sort(np.concatenate([high, low[low > high[0]]]))
    return np.asarray(both)


def _decay(time_s: Array, off_rad: Array) -> tuple[float | None, float | None]:
    """Damping ratio and damped frequency of successive half swings."""
    use = np.abs(off_rad) > LEAST_SWING_RAD / 2
    end = int(np.argmin(use)) if not use.all() else len(use)
    if end < 3:
        return None, None
    n = np.arange(end)
    slope = float(np.polyfit(n, np.log(np.abs(off_rad[:end])), 1)[0])
    half_period = float(np.polyfit(n, time_s[:end], 1)[0])
    d = -slope / math.pi  # logarithmic decrement of half a period is pi zeta / sqrt(1 - zeta^2)
    return d / math.sqrt(1 + d**2), 0.5 / half_period
