"""Step responses: first whether one is stable, then how good."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from esea_gen.analysis.response import MIN_SAMPLES, checked_time
from esea_gen.errors import UserError
from esea_gen.language.ports import Array

Verdict = Literal["stable", "growing", "sustained oscillation", "diverged", "no response"]
# An oscillation in the last third of a step's record below this share of the step is noise.
RINGING = 0.02
# A line spectrum holds most of its power near its peak, noise does not.
LINE_SHARE = 0.5
TAIL = 0.2  # share of the record behind the step, at its end, that gives the final level
FAR = 10  # steps: a response that goes so far has diverged


@dataclass(frozen=True)
class StepMetrics:
    """A step response in numbers; levels in the unit of the response."""

    verdict: Verdict
    reason: str
    initial: float | None = None
    final: float | None = None
    rise_s: float | None = None
    settling_2_s: float | None = None  # None: not within the record, its tail excluded
    settling_5_s: float | None = None
    overshoot_percent: float | None = None
    steady_error: float | None = None
    steady_error_percent: float | None = None
    tail_rms: float | None = None  # about its mean: noise, creep or ringing
    oscillation_Hz: float | None = None

    @property
    def stable(self) -> bool:
        return self.verdict == "stable"

    def table(self) -> list[str]:
        rows = (
            ("rise, 10 to 90 %", self.rise_s, "s"),
            ("settling, 2 %", self.settling_2_s, "s"),
            ("settling, 5 %", self.settling_5_s, "s"),
            ("overshoot", self.overshoot_percent, "%"),
            ("steady error", self.steady_error_percent, "% of the step"),
            ("tail RMS", self.tail_rms, ""),
        )
        lines = [f"{self.verdict}: {self.reason}"]
        if not self.stable:
            return lines
        for label, value, unit in rows:
            text = "none within the record" if value is None else f"{value:.4g} {unit}".rstrip()
            lines.append(f"  {label:20}{text}")
        return lines


def _crossing(time: Array, way: Array, level: float) -> float:
    """First time at which ``way`` reaches a level, between samples on a straight line."""
    k = int(np.flatnonzero(way >= level)[0])
    if k == 0:
        return float(time[0])
    return float(
        time[k - 1] + (time[k] - time[k - 1]) * (level - way[k - 1]) / (way[k] - way[k - 1])
    )


def _settling(time: Array, miss: Array, band: float, tail_s: float) -> float | None:
    outside = np.flatnonzero(miss > band)
    if not outside.size:
        return float(time[0])
    k = int(outside[-1])
    if time[k] >= tail_s or k + 1 == len(time):
        return None
    share = (miss[k] - band) / (miss[k] - miss[k + 1])
    return float(time[k] + share * (time[k + 1] - time[k]))


def _ringing(time: Array, values: Array) -> tuple[float, float, float]:
    """RMS without trend, frequency of the spectrum's peak, share of power near that peak."""
    from scipy.signal import detrend

    grid = np.linspace(time[0], time[-1], len(time))
    flat = detrend(np.interp(grid, time, values))
    power = np.abs(np.fft.rfft(flat * np.hanning(len(flat)))) ** 2
    total = float(power.sum())
    if total == 0:
        return 0.0, 0.0, 0.0
    peak = int(np.argmax(power))
    near = float(power[max(peak - 2, 0) : peak + 3].sum())
    return float(np.sqrt(np.mean(flat**2))), peak / float(grid[-1] - grid[0]), near / total


def _diverged(
    time: Array, values: Array, early: Array, initial: float, size: float
) -> StepMetrics | None:
    first = float(early[0]) if early.size else initial
    far = np.flatnonzero(np.abs(values - first) > FAR * size)
    if far.size:
        gone = f"more than {FAR} steps away at {time[far[0]]:.4g} s"
        return StepMetrics("diverged", gone, initial)
    if early.size and np.ptp(early) > size:
        moved = f"moved by {np.ptp(early):.3g} before the step of {size:.3g}"
        return StepMetrics("diverged", moved, initial)
    return None


def _oscillation(
    t: Array, y: Array, step_s: float, size: float
) -> tuple[Verdict, str, float | None] | None:
    """Verdict, reason and frequency of an oscillation that does not die out."""
    thirds = np.linspace(step_s, t[-1], 4)
    middle = (t >= thirds[1]) & (t < thirds[2])
    end = t >= thirds[2]
    if min(np.count_nonzero(middle), np.count_nonzero(end)) >= 8:
        before_rms, _, _ = _ringing(t[middle], y[middle])
        ringing, frequency, share = _ringing(t[end], y[end])
        if ringing > RINGING * size and share > LINE_SHARE and ringing > 0.9 * before_rms:
            grows = ringing > 1.1 * before_rms
            words = f"{ringing:.3g} RMS at {frequency:.3g} Hz in the last third, {before_rms:.3g}"
            verdict: Verdict = "growing" if grows else "sustained oscillation"
            return verdict, f"{words} in the middle third", frequency
    return None


def _way(t: Array, way: Array, step_s: float, tail_s: float) -> dict[str, float | None]:
    # The tail's mean is 1: both levels are reached.
    two, five = (_settling(t, np.abs(way - 1), band, tail_s) for band in (0.02, 0.05))
    return {
        "rise_s": _crossing(t, way, 0.9) - _crossing(t, way, 0.1),
        "settling_2_s": None if two is None else two - step_s,
        "settling_5_s": None if five is None else five - step_s,
        "overshoot_percent": 100 * max(float(np.max(way)) - 1, 0.0),
    }


def _checked_step(
    time_s: npt.ArrayLike, response: npt.ArrayLike, step_s: float, size: float
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    time = checked_time(time_s)
    values = np.asarray(response, dtype=np.float64)
    if values.shape != time.shape:
        raise UserError(
            f"response: shape {values.shape}, time has {time.shape}.", "Pass the same samples."
        )
    if not (math.isfinite(size) and size > 0):
        raise UserError(f"step of {size}.", "Give two different references.")
    late = time >= step_s
    if np.count_nonzero(late) < MIN_SAMPLES or step_s < time[0]:
        raise UserError(
            f"step_s: {step_s:g} s leaves {np.count_nonzero(late)} samples of the record "
            f"({time[0]:g} to {time[-1]:g} s); {MIN_SAMPLES} are needed.",
            "Give the time of the step, and record for longer.",
        )
    return time, values, late


def step_metrics(
    time_s: npt.ArrayLike,
    response: npt.ArrayLike,
    *,
    step_s: float,
    before: float = 0.0,
    after: float = 1.0,
) -> StepMetrics:
    """Judge a step response: first whether it is stable, then how good (docs/response.md)."""
    size = abs(after - before)
    time, values, late = _checked_step(time_s, response, step_s, size)
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        return StepMetrics("diverged", f"not finite from {time[bad[0]]:.4g} s on")
    early = values[~late]
    initial = float(np.mean(early)) if early.size else float(values[0])
    gone = _diverged(time, values, early, initial, size)
    if gone is not None:
        return gone
    t, y = time[late], values[late]
    tail_s = float(t[-1] - TAIL * (t[-1] - step_s))
    last = y[t >= tail_s]
    final = float(np.mean(last))
    rms = float(np.std(last))
    error = after - final
    common = {
        "initial": initial,
        "final": final,
        "steady_error": error,
        "steady_error_percent": 100 * error / (after - before),
        "tail_rms": rms,
    }
    rings = _oscillation(t, y, step_s, size)
    if rings is not None:
        verdict, reason, frequency = rings
        return StepMetrics(verdict, reason, oscillation_Hz=frequency, **common)
    move = final - initial
    if abs(move) < 0.05 * size:
        return StepMetrics("no response", f"the level moved by {move:.3g} of {size:.3g}", **common)
    judged = _way(t, (y - initial) / move, step_s, tail_s)
    return StepMetrics("stable", f"ends at {final:.4g} of {after:.4g}", **judged, **common)
