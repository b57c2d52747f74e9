"""Resample frames at irregular times to a steady rate, with a report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from esea_host.smoothness.checks import LEAST_SAMPLES, NoAnswerError, as_samples, checked_rate
from esea_host.smoothness.result import Array
from esea_host.smoothness.stamps import JITTER

LONGEST_STEPS = 5.0  # usual steps that may be bridged
_MOST = 10.0  # times the mean rate


@dataclass(frozen=True)
class Resampling:
    """A signal at a steady rate, with counts of used and dropped frames."""

    values: Array
    time_s: Array
    fs_Hz: float
    frames: int
    missing: int  # frames without time or value
    merged: int  # that share a time with another; their mean was used
    jitter_s: float
    usual_step_s: float
    longest_step_s: float
    limit_s: float  # longest step that would have been bridged
    interpolated: int  # samples with no frame within 1 % of a period
    bridged: int  # samples inside steps longer than 1.5 usual ones

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        out = {k: v for k, v in vars(self).items() if k not in ("values", "time_s")}
        return out | {"samples": len(self.values)}

    def line(self) -> str:
        """For a terminal."""
        usual, longest, limit = self.usual_step_s, self.longest_step_s, self.limit_s
        return (
            f"resampled by piecewise cubics (PCHIP): {self.frames} frames (jitter "
            f"{1e3 * self.jitter_s:.3g} ms, usual step {1e3 * usual:.4g} ms, longest "
            f"{1e3 * longest:.4g} ms, limit {1e3 * limit:.4g} ms) to {len(self.values)} samples "
            f"at {self.fs_Hz:g} Hz; {self.interpolated} interpolated, {self.bridged} of them in "
            f"longer steps; dropped: {self.missing} frames without a number, {self.merged} with a "
            "repeated time"
        )


def resampled(
    time_s: ArrayLike, values: ArrayLike, fs_Hz: float, stop_Hz: float = 4.0
) -> Resampling:
    """Interpolate a signal at a steady rate, unless frames are missing for too long.

    A step longer than five usual ones or half a period of ``stop_Hz`` is refused, and a rate
    outside nine tenths to ten times the frames' mean rate.
    """
    fs_Hz, stop_Hz = checked_rate(fs_Hz), checked_rate(stop_Hz)
    t, x = as_samples(time_s, "The time"), as_samples(values, "The signal")
    if t.ndim != 1 or t.shape != x.shape:
        raise NoAnswerError(
            "shape", f"{t.shape} times for {x.shape} values.", "Give one time for each value."
        )
    missing, merged, t, x = _frames(t, x)
    step = np.diff(t)
    usual, longest = float(np.median(step)), float(np.max(step))
    limit = min(LONGEST_STEPS * usual, 0.5 / stop_Hz)
    if longest >= limit:
        at = int(np.argmax(step))
        raise NoAnswerError(
            "gap",
            f"A gap of {longest:.4g} s at {t[at]:.6g} s: less than {limit:.4g} s can be bridged "
            f"({LONGEST_STEPS:g} usual steps, half a period of {stop_Hz:g} Hz).",
            "Cut the movement there, or record again.",
        )
    mean_Hz = (len(t) - 1) / float(t[-1] - t[0])
    if not 0.9 * mean_Hz <= fs_Hz <= _MOST * mean_Hz:
        raise NoAnswerError(
            "rate",
            f"A new rate of {fs_Hz:g} Hz: {0.9 * mean_Hz:.4g} to {_MOST * mean_Hz:.4g} Hz.",
            f"The frames come at {mean_Hz:.4g} Hz on average.",
        )
    grid = t[0] + np.arange(int(float(t[-1] - t[0]) * fs_Hz * (1 + 1e-9)) + 1) / fs_Hz
    level = float(np.max(np.abs(x))) or 1.0  # slopes of large numbers overflow
    behind = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    away = np.minimum(np.abs(grid - t[behind - 1]), np.abs(t[behind] - grid)) * fs_Hz > JITTER
    return Resampling(
        np.asarray(PchipInterpolator(t, x / level)(grid)) * level,
        grid,
        fs_Hz,
        len(t),
        missing,
        merged,
        float(np.std(step)),
        usual,
        longest,
        limit,
        int(np.count_nonzero(away)),
        int(np.count_nonzero(away & (step[behind - 1] > 1.5 * usual))),
    )


def _frames(t: Array, x: Array) -> tuple[int, int, Array, Array]:
    # Frames without a number and with a repeated time, counted; times and values of the others.
    there = np.isfinite(t) & np.isfinite(x)
    missing = int(np.count_nonzero(~there))
    frame, t, x = np.flatnonzero(there), t[there], x[there]
    falls = np.flatnonzero(np.diff(t) < 0)
    if len(falls):
        at = falls[0]
        raise NoAnswerError(
            "gap",
            f"Time goes back from {t[at]:.6g} s to {t[at + 1]:.6g} s after sample {frame[at]}.",
            "Cut the movement there.",
        )
    t, first, count = np.unique(t, return_index=True, return_counts=True)
    if len(t) < LEAST_SAMPLES:
        raise NoAnswerError("short", f"{len(t)} frames: at least {LEAST_SAMPLES}.", "Record more.")
    return missing, len(frame) - len(t), t, np.add.reduceat(x, first) / count
