"""Recorded signals: checks, regular samples, step metrics.

Pure analysis: arrays in, frozen results out.  Nothing here knows a plant or a controller, so the
same functions judge the twin and a rig.  Frequency responses are in `esea_gen.analysis.sweeps`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError

Array = npt.NDArray[np.float64]
Verdict = Literal["stable", "growing", "sustained oscillation", "diverged", "no response"]

MIN_SAMPLES = 32
# An oscillation in the last third of a step's record below this share of the step is noise.
RINGING = 0.02
# A line spectrum holds most of its power near its peak, noise does not.
LINE_SHARE = 0.5


def checked(name: str, values: npt.ArrayLike, like: int | None = None) -> Array:
    """A signal as an array, or an error that names the sample at fault.

    Parameters
    ----------
    name : str
        Its name in messages.
    values : array_like
        Shape (n,).
    like : int, optional
        Wanted number of samples.

    Returns
    -------
    ndarray
        float64, shape (n,).

    Raises
    ------
    UserError
        When it is not one-dimensional, too short, of another length or not finite.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or len(array) < MIN_SAMPLES:
        raise UserError(
            f"{name}: shape {array.shape}, needs one row of at least {MIN_SAMPLES} samples.",
            "Record for longer, or pass one signal at a time.",
        )
    if like is not None and len(array) != like:
        raise UserError(
            f"{name}: {len(array)} samples, the other signals have {like}.",
            "Cut all signals to the same samples.",
        )
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise UserError(
            f"{name}: sample {bad[0]} is {array[bad[0]]} ({bad.size} such samples).",
            "Cut the record before it, or repeat the run.",
        )
    return array


def checked_time(time_s: npt.ArrayLike) -> Array:
    """Sample times, strictly rising.

    Parameters
    ----------
    time_s : array_like
        In s, shape (n,).

    Returns
    -------
    ndarray
        The same.

    Raises
    ------
    UserError
        When they do not rise.
    """
    time = checked("time_s", time_s)
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        k = int(back[0])
        raise UserError(
            f"time_s: sample {k + 1} ({time[k + 1]:g} s) is not after sample {k} ({time[k]:g} s).",
            "Sort the record and drop repeated samples.",
        )
    return time


def checked_period(period_s: float) -> float:
    """A sample period above 0.

    Parameters
    ----------
    period_s : float
        In s.

    Returns
    -------
    float
        The same.

    Raises
    ------
    UserError
        When it is not above 0.
    """
    if not (math.isfinite(period_s) and period_s > 0):
        raise UserError(f"period_s: {period_s} s.", "Give a sample period above 0.")
    return period_s


def plain(value: Any) -> Any:
    """JSON-ready form of a number or array.

    Parameters
    ----------
    value : object
        Number, array, text or None.

    Returns
    -------
    object
        Lists for arrays, None for what is not finite; anything else as it is.
    """
    if isinstance(value, np.ndarray):
        return [plain(v) for v in value.tolist()]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


# -- irregular samples ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Resampled:
    """Signals on a regular grid.

    Parameters
    ----------
    time_s : ndarray
        Grid, shape (m,).
    period_s : float
        Its step.
    signals : tuple of ndarray
        Interpolated signals, shape (m,) each.
    dropped_s : float
        Time that was cut away because of gaps.
    widest_s : float
        Longest interval between samples that was bridged.
    """

    time_s: Array
    period_s: float
    signals: tuple[Array, ...]
    dropped_s: float
    widest_s: float


def resample(
    time_s: npt.ArrayLike,
    signals: Sequence[npt.ArrayLike],
    *,
    period_s: float | None = None,
    max_gap_s: float | None = None,
) -> Resampled:
    """Bring irregular samples onto a regular grid, without bridging gaps.

    Parameters
    ----------
    time_s : array_like
        Sample times in s, rising, shape (n,).
    signals : sequence of array_like
        Signals at these times, shape (n,) each.
    period_s : float, optional
        Step of the grid; the median interval when not given.
    max_gap_s : float, optional
        Intervals longer than this are gaps; ten median intervals when not given.

    Returns
    -------
    Resampled
        The longest stretch without a gap.

    Raises
    ------
    UserError
        On bad signals, or when no stretch is long enough.

    Notes
    -----
    Linear interpolation between samples an interval d apart multiplies a sine of frequency f by
    sinc^2(f d): 0.3 dB at f d = 0.1.  In a ratio of two signals of the same record it cancels.  A
    grid coarser than the samples is reached through a linear-phase low-pass at 0.4 of its rate, so
    that nothing folds down.
    """
    from scipy.signal import fftconvolve, firwin

    time = checked_time(time_s)
    columns = [checked(f"signal {i}", s, len(time)) for i, s in enumerate(signals)]
    steps = np.diff(time)
    typical = float(np.median(steps))
    period = typical if period_s is None else checked_period(period_s)
    limit = 10 * typical if max_gap_s is None else checked_period(max_gap_s)
    edges = np.concatenate([[-1], np.flatnonzero(steps > limit), [len(time) - 1]])
    spans = [time[b] - time[a + 1] for a, b in pairwise(edges)]
    best = int(np.argmax(spans))
    part = slice(int(edges[best]) + 1, int(edges[best + 1]) + 1)
    inside = time[part]
    if inside[-1] - inside[0] < (MIN_SAMPLES - 1) * period:
        raise UserError(
            f"The longest stretch without a gap above {limit:g} s lasts "
            f"{inside[-1] - inside[0]:g} s; {MIN_SAMPLES} samples of {period:g} s are needed.",
            "Raise max_gap_s, lower period_s or repeat the recording.",
        )
    finer = max(1, math.ceil(period / typical - 0.5))
    fine = inside[0] + period / finer * np.arange(
        math.floor((inside[-1] - inside[0]) / period * finer * (1 + 1e-12)) + 1
    )
    out = []
    for column in columns:
        values = np.interp(fine, inside, column[part])
        if finer > 1:
            taps = firwin(20 * finer + 1, 0.8 / finer)
            padded = np.pad(values, len(taps) // 2, mode="reflect", reflect_type="odd")
            values = fftconvolve(padded, taps, "valid")[::finer]
        out.append(np.asarray(values, dtype=np.float64))
    widest = float(np.max(np.diff(inside)))
    dropped = float(time[-1] - time[0] - (inside[-1] - inside[0]))
    return Resampled(fine[::finer], period, tuple(out), dropped, widest)


# -- step -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StepMetrics:
    """A step response in numbers; levels in the unit of the response.

    Parameters
    ----------
    verdict : str
        ``stable``, ``growing``, ``sustained oscillation``, ``diverged`` or ``no response``.
    reason : str
        What the verdict rests on.
    initial, final : float or None
        Level before the step and mean of the record's tail.
    rise_s : float or None
        From 10 to 90 % of the way from initial to final, first crossings.
    settling_2_s, settling_5_s : float or None
        From the step until the response stays within 2 or 5 % of that way round the final level;
        None when it does not within the record, its tail excluded.
    overshoot_percent : float or None
        Highest excess over the final level, in % of that way.
    steady_error, steady_error_percent : float or None
        Reference minus final level, and in % of the reference's step.
    tail_rms : float or None
        RMS of the tail about its mean: noise, creep or ringing.
    oscillation_Hz : float or None
        Frequency of an oscillation in the last third.
    """

    verdict: Verdict
    reason: str
    initial: float | None = None
    final: float | None = None
    rise_s: float | None = None
    settling_2_s: float | None = None
    settling_5_s: float | None = None
    overshoot_percent: float | None = None
    steady_error: float | None = None
    steady_error_percent: float | None = None
    tail_rms: float | None = None
    oscillation_Hz: float | None = None

    @property
    def stable(self) -> bool:
        """Whether the verdict is ``stable``."""
        return self.verdict == "stable"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content: the fields by name."""
        return {k: plain(v) for k, v in vars(self).items()}

    def table(self) -> list[str]:
        """The verdict, and of a stable response one line a figure."""
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


def _crossing(time: Array, way: Array, level: float) -> float | None:
    """First time at which ``way`` reaches a level, between samples on a straight line."""
    above = np.flatnonzero(way >= level)
    if not above.size:
        return None
    k = int(above[0])
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


def step_metrics(
    time_s: npt.ArrayLike,
    response: npt.ArrayLike,
    *,
    step_s: float,
    before: float = 0.0,
    after: float = 1.0,
    tail: float = 0.2,
    limit: float = 10.0,
) -> StepMetrics:
    """Judge a step response: first whether it is stable, then how good.

    Parameters
    ----------
    time_s : array_like
        Sample times in s, rising, regular or not, shape (n,).
    response : array_like
        The response, shape (n,); a value that is not finite counts as diverged.
    step_s : float
        Time of the reference's step.
    before, after : float
        Reference before and after it, in the unit of the response.
    tail : float
        Share of the record after the step whose mean is the final level.
    limit : float
        The response has diverged when it is further than this many steps from its first level.

    Returns
    -------
    StepMetrics
        Figures of an unstable response that mean nothing are None.

    Raises
    ------
    UserError
        On bad times, a step outside the record, or no step in the reference.

    Notes
    -----
    Verdicts, in this order.  Diverged: not finite, beyond ``limit``, or moving by more than the
    whole step before there was one.  Growing or sustained: in the last third after the step, an
    oscillation (half of the power within two bins of the spectrum's peak) of more than 2 % of the
    step whose RMS is above 1.1 or between 0.9 and 1.1 times that in the middle third.  No response:
    the level moved by less than 5 % of the step.  A decay so slow that a third of the record takes
    less than 10 % off it is called sustained: record for longer.
    """
    time = checked_time(time_s)
    values = np.asarray(response, dtype=np.float64)
    if values.shape != time.shape:
        raise UserError(
            f"response: shape {values.shape}, time has {time.shape}.", "Pass the same samples."
        )
    size = abs(after - before)
    if not (math.isfinite(size) and size > 0 and 0 < tail < 0.9 and limit > 1):
        raise UserError(
            f"step: from {before} to {after}, tail {tail}, limit {limit}.",
            "Give two different references, a tail in (0, 0.9) and a limit above 1.",
        )
    late = time >= step_s
    if np.count_nonzero(late) < MIN_SAMPLES or step_s < time[0]:
        raise UserError(
            f"step_s: {step_s:g} s leaves {np.count_nonzero(late)} samples of the record "
            f"({time[0]:g} to {time[-1]:g} s); {MIN_SAMPLES} are needed.",
            "Give the time of the step, and record for longer.",
        )
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        return StepMetrics("diverged", f"not finite from {time[bad[0]]:.4g} s on")
    early = values[~late]
    initial = float(np.mean(early)) if early.size else float(values[0])
    first = float(early[0]) if early.size else initial
    far = np.flatnonzero(np.abs(values - first) > limit * size)
    if far.size:
        return StepMetrics(
            "diverged", f"more than {limit:g} steps away at {time[far[0]]:.4g} s", initial
        )
    if early.size and np.ptp(early) > size:
        return StepMetrics(
            "diverged",
            f"moved by {np.ptp(early):.3g} before the step of {size:.3g}",
            initial,
        )
    t, y = time[late], values[late]
    tail_s = float(t[-1] - tail * (t[-1] - step_s))
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
    thirds = np.linspace(step_s, t[-1], 4)
    middle = (t >= thirds[1]) & (t < thirds[2])
    end = t >= thirds[2]
    if min(np.count_nonzero(middle), np.count_nonzero(end)) >= 8:
        before_rms, _, _ = _ringing(t[middle], y[middle])
        ringing, frequency, share = _ringing(t[end], y[end])
        if ringing > RINGING * size and share > LINE_SHARE and ringing > 0.9 * before_rms:
            grows = ringing > 1.1 * before_rms
            words = f"{ringing:.3g} RMS at {frequency:.3g} Hz in the last third, {before_rms:.3g}"
            return StepMetrics(
                "growing" if grows else "sustained oscillation",
                f"{words} in the middle third",
                oscillation_Hz=frequency,
                **common,
            )
    move = final - initial
    if abs(move) < 0.05 * size:
        return StepMetrics("no response", f"the level moved by {move:.3g} of {size:.3g}", **common)
    way = (y - initial) / move
    low, high = _crossing(t, way, 0.1), _crossing(t, way, 0.9)
    return StepMetrics(
        "stable",
        f"ends at {final:.4g} of {after:.4g}",
        rise_s=None if low is None or high is None else high - low,
        settling_2_s=_after(_settling(t, np.abs(way - 1), 0.02, tail_s), step_s),
        settling_5_s=_after(_settling(t, np.abs(way - 1), 0.05, tail_s), step_s),
        overshoot_percent=100 * max(float(np.max(way)) - 1, 0.0),
        **common,
    )


def _after(moment: float | None, step_s: float) -> float | None:
    return None if moment is None else moment - step_s
