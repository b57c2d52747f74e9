"""Numbers of a participant from the rows of trials: validation, and motor learning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Row = Mapping[str, Any]
# A spectrum of some seconds is coarse: the transform is taken over this many times its length.
PADDED = 16
# Peaks below this share of the largest are corrections, not movements.
LEAST_PEAK = 0.25


def speed(time_s: npt.ArrayLike, x_deg: npt.ArrayLike) -> tuple[Array, float]:
    """Speed at equal steps, deg/s, and the step."""
    t, x = np.asarray(time_s, np.float64), np.asarray(x_deg, np.float64)
    step = float(t[-1] - t[0]) / (len(t) - 1)
    even = t[0] + step * np.arange(len(t))
    return np.asarray(np.gradient(np.interp(even, t, x), step)), step


def dominant(values: Array, step_s: float) -> tuple[float, float]:
    """Frequency of the largest component, Hz, and its amplitude."""
    n = len(values)
    spectrum = 2.0 / n * np.abs(np.fft.rfft(values - np.mean(values), PADDED * n))
    k = int(np.argmax(spectrum))
    return k / (PADDED * n * step_s), float(spectrum[k])


def median_peak(values: Array) -> float:
    """Median of the peaks of the magnitude, one between two changes of sign."""
    edges = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1])) + 1
    peaks = np.array([np.max(np.abs(part)) for part in np.split(values, edges) if len(part)])
    return float(np.median(peaks[peaks >= LEAST_PEAK * np.max(peaks)]))


def tracking(row: Row) -> dict[str, float]:
    healthy, step = speed(row["time_s"], row["target_deg"])
    shown, _ = speed(row["time_s"], row["cursor_deg"])
    h, c = dominant(healthy, step), dominant(shown, step)
    rms = float(np.sqrt(np.mean((healthy - shown) ** 2)))
    return {
        "frequency_h_Hz": h[0],
        "frequency_c_Hz": c[0],
        "amplitude_h_deg_s": h[1],
        "amplitude_c_deg_s": c[1],
        "peak_h_deg_s": median_peak(healthy),
        "peak_c_deg_s": median_peak(shown),
        "rms_error_percent": 100.0 * rms / float(np.max(np.abs(healthy))),
    }


def after_effect_deg(row: Row, pulls_away: bool) -> float:
    """On a standing target, how far beyond it, or away first; negative as published."""
    if pulls_away:
        return float(row["nearest_deg"] - row["distance_deg"])
    return float(min(row["distance_deg"] - row["furthest_deg"], 0.0))


def learning(rows: Sequence[Row]) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    blocks = list(dict.fromkeys(r["block"] for r in rows))
    for axis in ("FE", "RU"):
        counts, errors = [], []
        for block in blocks:
            own = [r for r in rows if r["block"] == block and r["axis"] == axis and not r["catch"]]
            caught = [r["sse_deg2"] for r in own if r["achieved"]]
            counts.append(len(caught))
            if caught:
                errors.append(float(np.median(caught)))
        found[f"achieved_{axis}"] = float(np.median(counts)) if counts else None
        found[f"sse_{axis}_deg2"] = float(np.median(errors)) if errors else None
    catch = [r for r in rows if r["catch"]]
    moving = [r for r in rows if not r["catch"]]
    pulls = bool(moving) and float(np.mean([r["pulled_away"] for r in moving])) > 0.5
    effects = [after_effect_deg(r, pulls) for r in catch]
    found["after_effect_deg"] = float(np.median(effects)) if effects else None
    return found
