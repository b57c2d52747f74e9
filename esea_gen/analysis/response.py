"""Recorded signals: checks.

Pure analysis: arrays in, frozen results out.  Nothing here knows a plant or a controller, so the
same functions judge the twin and a rig.  Steps are judged in `esea_gen.analysis.step`, frequency
responses are in `esea_gen.analysis.sweeps`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_gen.language.ports import Array

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
