"""Tests of the first day: Wartenberg's pendulum, and the passive range of motion with its loop.

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
from scipy.stats import binned_statistic

from esea_gen.errors import UserError
from esea_host.assess import responses
from esea_host.assess.patients import DEG, Array, body_size

REST_S = 0.5  # the end, over which the leg must be at rest
REST_RAD, REST_rad_s = 3 * DEG, 12 * DEG
LEAST_SWING_RAD = 2 * DEG  # smaller ones do not count
HEALTHY_INDEX = 1.6
MOST_INDEX = 2.2  # 2 without loss, and room for uneven stiffness; above, it was held at the end
# Gravity alone accelerates a leg by 19 rad/s2 (2.3 m tall) or more; simulated legs that fall
# pass both numbers, but for the most rigid ones.
FALLING_rad_s, FALLING_rad_s2, FALLING_OVER_S = 90 * DEG, 9.0, 0.1


@dataclass(frozen=True)
class PendulumResult:
    """Figures of one test; angles in flexion from full extension."""

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
        sure = "" if self.reached_rest else ", uncertain"
        out = [
            f"The leg fell by {self.first_swing_rad / DEG:.0f}° on its first swing and came to "
            f"rest {(self.rest_rad - self.start_rad) / DEG:.0f}° below where it was let go.",
            f"Relaxation index {self.relaxation_index:.2f}{sure} "
            f"(relaxed healthy legs: about {HEALTHY_INDEX} or more).",
            f"{self.swings} swings, fastest {self.peak_rate_rad_s / DEG:.0f}°/s.",
        ]
        if self.damping_ratio is not None and self.frequency_Hz is not None:
            out.append(
                f"Swings die out with a damping ratio of {self.damping_ratio:.2f}, "
                f"{self.frequency_Hz:.2f} swings a second."
            )
        if not self.reached_rest:
            out.append("The leg was still moving or held at the end: its rest is uncertain.")
        return out


def steepest_rad_s2(rate_rad_s: Array, step_s: float) -> float:
    """Greatest mean acceleration over 0.1 s: gravity is at work at once, hands are not."""
    n = max(1, round(FALLING_OVER_S / step_s))
    return float(np.max(rate_rad_s[n:] - rate_rad_s[:-n], initial=0.0)) / (n * step_s)


def pendulum_test(time_s: Array, angle_rad: Array) -> PendulumResult:
    """Figures of a pendulum test; the release may come later than the start."""
    t, x = np.asarray(time_s, dtype=float), np.asarray(angle_rad, dtype=float)
    if len(t) < 50 or np.any(np.diff(t) <= 0) or not np.all(np.isfinite(x)):
        raise UserError(
            "pendulum test: too few samples, gaps, or times that do not rise.",
            "Record at least 50 samples without gaps.",
        )
    h = float(np.median(np.diff(t)))
    if h > responses.SLOWEST_S:
        raise UserError(
            f"pendulum test: a sample every {h:.3g} s, at most {responses.SLOWEST_S:g} s.",
            f"Record at {1 / responses.SLOWEST_S:.0f} Hz or more, with time_s in seconds.",
        )
    even = np.arange(t[0], t[-1], h)
    window = max(5, 2 * round(0.02 / h) + 1)
    smooth = savgol_filter(np.interp(even, t, x), window, 2)
    rate = np.gradient(smooth, h)
    tail = smooth[-max(3, round(REST_S / h)) :]
    rest = float(np.mean(tail))
    reached = (
        float(np.ptp(tail)) < REST_RAD and float(np.abs(rate[-len(tail) :]).max()) < REST_rad_s
    )
    # Let go where it last stood still before it falls: held, it is never this fast.
    fast = rate >= FALLING_rad_s / 2
    still = np.flatnonzero(rate[: np.argmax(fast)] <= 0)
    free = int(still[-1]) if len(still) else 0
    start = float(np.median(smooth[max(0, free - round(0.05 / h)) : free + 1]))
    drop = rest - max(start, float(smooth[0]))
    if drop < 10 * DEG:
        raise UserError(
            f"pendulum test: the leg came to rest {drop / DEG:.1f} deg below its start.",
            "Let it fall from a straight knee (at least 10 deg), and check the angle's sign.",
        )
    extremes = free + _extremes(smooth[free:])
    fastest, steepest = float(np.max(rate)), steepest_rad_s2(rate, h)
    if fastest < FALLING_rad_s or steepest < FALLING_rad_s2:
        raise UserError(
            f"pendulum test: at most {fastest / DEG:.0f} deg/s and {steepest:.1f} rad/s2, the leg "
            "was lowered.",
            f"Let it go: a falling leg exceeds {FALLING_rad_s / DEG:.0f} deg/s and "
            f"{FALLING_rad_s2:g} rad/s2.",
        )
    if not (len(extremes) or reached):
        raise UserError(
            "pendulum test: the recording ends within the first swing.",
            "Record until the leg hangs still.",
        )
    first = (float(smooth[extremes[0]]) if len(extremes) else rest) - start
    damping, frequency = _decay(even[extremes], smooth[extremes] - rest)
    index, swings = first / (rest - start), (len(extremes) + 1) // 2
    free_rest = bool(reached and index < MOST_INDEX)
    return PendulumResult(start, rest, first, index, damping, frequency, swings, fastest, free_rest)


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


SLOW_rad_s = 30 * DEG  # above it a reflex may answer: the test is no passive one


@dataclass(frozen=True)
class MotionRange:
    low_rad: float
    high_rad: float
    fastest_rad_s: float
    cycles: int
    loop_J: float
    loop_error_J: float  # standard deviation, from the error of the torque sensor alone
    stiffness_Nm_rad: float | None
    angle_rad: Array
    bending_Nm: Array
    straightening_Nm: Array

    @property
    def slow(self) -> bool:
        return self.fastest_rad_s <= SLOW_rad_s

    def sentences(self) -> list[str]:
        out = [
            f"The knee moved from {self.low_rad / DEG:.0f}° to {self.high_rad / DEG:.0f}° of "
            f"bending ({(self.high_rad - self.low_rad) / DEG:.0f}° in all), {self.cycles} times "
            "back and forth.",
            f"{self.loop_J:.1f} J are lost in each cycle, ± {2 * self.loop_error_J:.1f} J by the "
            "torque sensor's error.",
        ]
        if self.loop_J < 2 * self.loop_error_J:
            out.append("The loss is below the error; more cycles reduce the error.")
        if self.stiffness_Nm_rad is not None:
            per_degree = f"{self.stiffness_Nm_rad * DEG:.2f} Nm per degree"
            out.append(f"In the middle of its range it resists with {per_degree}.")
        if not self.slow:
            out.append(
                f"Moved at up to {self.fastest_rad_s / DEG:.0f}°/s: too fast for a passive test "
                f"(at most {SLOW_rad_s / DEG:.0f}°/s); reflexes may have answered."
            )
        return out


def motion_range(recording: responses.LegRecording, bins: int = 40) -> MotionRange:
    """Range, stiffness and loop from a recording of slow cycles; leg's weight taken off."""
    p = responses.passage(recording)
    # Torque at its own time again: a passage pairs it with where the leg was 60 ms before.
    late = round(responses.LATENCY_S / float(p.time_s[1] - p.time_s[0]))
    size = body_size(recording.height_m, recording.mass_kg)
    response = size * p.response_Nm[: len(p.time_s) - late]
    time_s, angle, rate = p.time_s[late:], p.angle_rad[late:], p.rate_rad_s[late:]
    low, high = (float(x) for x in np.quantile(angle, [0.002, 0.998]))
    span = high - low
    if span < 5 * DEG:
        raise UserError(
            f"range of motion: the knee moved by {span / DEG:.1f} deg.",
            "Move it by at least 5 deg.",
        )
    turns = _turns(angle, low + 0.15 * span, high - 0.15 * span)
    cycles = max(0, (len(turns) - 1) // 2)
    if cycles < 1:
        raise UserError("range of motion: no whole cycle.", "Bend and straighten at least once.")
    a, b = turns[0], turns[2 * cycles]
    loop = float(np.trapezoid(response[a : b + 1], angle[a : b + 1])) / cycles
    # Work of a stationary error with that correlation time; it can make a lost energy negative.
    path = float(np.trapezoid(rate[a : b + 1] ** 2, time_s[a : b + 1]))
    loop_error = recording.error_Nm * math.sqrt(2 * responses.ERROR_STAYS_S * path) / cycles
    edges = np.linspace(low, high, bins + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    ways = [
        binned_statistic(angle[going], response[going], bins=edges).statistic
        for going in (rate > 0, rate < 0)
    ]
    mean = 0.5 * (ways[0] + ways[1])
    third = np.isfinite(mean) & (np.abs(middle - 0.5 * (low + high)) < span / 6)
    slope = float(np.polyfit(middle[third], mean[third], 1)[0]) if third.sum() > 2 else None
    fastest = float(np.quantile(np.abs(rate), 0.99))
    return MotionRange(
        low, high, fastest, cycles, loop, loop_error, slope, middle, ways[0], ways[1]
    )


def _turns(angle: Array, low: float, high: float) -> list[int]:
    """Where the movement turns: extremes beyond two thresholds, in turns."""
    out: list[int] = []
    side = 0
    best = 0
    for k, x in enumerate(angle):
        now = 1 if x > high else -1 if x < low else 0
        if now and now != side:
            if side:
                out.append(best)
            side, best = now, k
        elif now == side and side * x > side * angle[best]:
            best = k
    if side:
        out.append(best)
    return out
