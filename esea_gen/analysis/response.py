"""Recorded signals: checks, regular samples.

Pure analysis: arrays in, frozen results out.  Nothing here knows a plant or a controller, so the
same functions judge the twin and a rig.  Steps are judged in `esea_gen.analysis.step`, frequency
responses are in `esea_gen.analysis.sweeps`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError

Array = npt.NDArray[np.float64]

MIN_SAMPLES = 32


def checked(name: str, values: npt.ArrayLike, like: int | None = None) -> Array:
    """A signal as an array, or an error that names the sample at fault."""
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
    if not (math.isfinite(period_s) and period_s > 0):
        raise UserError(f"period_s: {period_s} s.", "Give a sample period above 0.")
    return period_s


# -- irregular samples ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Resampled:
    time_s: Array
    period_s: float
    signals: tuple[Array, ...]
    dropped_s: float
    widest_s: float


def resample(
    time_s: npt.ArrayLike,
    signals: Sequence[npt.ArrayLike],
    *,
    max_gap_s: float | None = None,
) -> Resampled:
    """Bring irregular samples onto a regular grid of their usual step, without bridging gaps."""
    # Linear interpolation over an interval d multiplies a sine of frequency f by sinc^2(f d):
    # 0.3 dB at f d = 0.1; in a ratio of two signals of one record it cancels.
    time = checked_time(time_s)
    columns = [checked(f"signal {i}", s, len(time)) for i, s in enumerate(signals)]
    steps = np.diff(time)
    period = float(np.median(steps))
    limit = 10 * period if max_gap_s is None else checked_period(max_gap_s)
    edges = np.concatenate([[-1], np.flatnonzero(steps > limit), [len(time) - 1]])
    spans = [time[b] - time[a + 1] for a, b in pairwise(edges)]
    best = int(np.argmax(spans))
    part = slice(int(edges[best]) + 1, int(edges[best + 1]) + 1)
    inside = time[part]
    if inside[-1] - inside[0] < (MIN_SAMPLES - 1) * period:
        raise UserError(
            f"The longest stretch without a gap above {limit:g} s lasts "
            f"{inside[-1] - inside[0]:g} s; {MIN_SAMPLES} samples of {period:g} s are needed.",
            "Raise max_gap_s or repeat the recording.",
        )
    count = math.floor((inside[-1] - inside[0]) / period * (1 + 1e-12)) + 1
    grid = inside[0] + period * np.arange(count)
    out = (np.asarray(np.interp(grid, inside, c[part]), dtype=np.float64) for c in columns)
    widest = float(np.max(np.diff(inside)))
    dropped = float(time[-1] - time[0] - (inside[-1] - inside[0]))
    return Resampled(grid, period, tuple(out), dropped, widest)
