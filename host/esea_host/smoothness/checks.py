"""Rejects inputs without a defined result before anything is computed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import ArrayLike

from esea_host.smoothness.result import Array
from esea_host.smoothness.stamps import rate_behind, unsteady

LEAST_SAMPLES = 10
# Share of the largest spectral magnitude that may be left in the top tenth below half the
# sampling rate.  White noise has 60 % or more; a 2 s reach at 100 Hz with noise of a tenth of its
# peak has 4 %.
ALIASED = 0.2


class NoAnswerError(ValueError):
    """The signal has no smoothness, or not with these settings.

    reason: shape, rate, short, gap, constant, aliased, cutoff or setting.
    """

    def __init__(self, reason: str, what: str, fix: str) -> None:
        super().__init__(f"{what} {fix}")
        self.reason, self.what, self.fix = reason, what, fix


def checked_rate(fs_Hz: float) -> float:
    """A sampling rate, finite and above zero."""
    rate = as_number(fs_Hz)
    if not 0 < rate < math.inf:
        raise NoAnswerError("rate", f"A sampling rate of {fs_Hz} Hz.", "Give it in Hz, above 0.")
    return rate


def as_number(value: Any) -> float:
    """A setting as a number; NaN, which every limit refuses, if it is not a number."""
    plain = isinstance(value, int | float | np.integer | np.floating)
    try:
        return float(value) if plain and not isinstance(value, bool) else math.nan
    except OverflowError:
        return math.nan


def in_words(value: Any) -> str:
    """A setting as text."""
    found = as_number(value)
    return str(value) if math.isnan(found) else f"{found:g}"


def rows(
    signal: ArrayLike,
    name: str,
    fs_Hz: float,
    time_s: ArrayLike | None = None,
    magnitude: bool = False,
) -> tuple[Array, bool]:
    """The signal as rows of movements, and whether it came as a stack of them.

    magnitude: of its absolute value.
    """
    array = as_samples(signal, name)
    if array.ndim not in (1, 2) or array.size == 0:
        raise NoAnswerError(
            "shape",
            f"{name} has the shape {array.shape}.",
            "Give one movement, shape (samples,), or several, shape (movements, samples).",
        )
    stacked = array.ndim == 2
    found = np.atleast_2d(np.abs(array) if magnitude else array)
    if found.shape[1] < LEAST_SAMPLES:
        raise NoAnswerError(
            "short",
            f"{name} has {found.shape[1]} samples, too short: at least {LEAST_SAMPLES}.",
            "Record longer or sample faster.",
        )
    _no_gap(found, name, stacked)
    if time_s is not None:
        _steady(time_s, found.shape[1], fs_Hz)
    level, spread = np.max(np.abs(found), axis=1), np.ptp(found, axis=1)
    still = spread <= 8 * np.finfo(np.float64).eps * level
    if still.any():
        raise NoAnswerError(
            "constant",
            f"{name}{_row(still, stacked)} is constant.",
            "Leave it out: it has no movement.",
        )
    return found, stacked


def as_samples(signal: ArrayLike, name: str) -> Array:
    """Real numbers of any shape; NaN for a masked sample."""
    try:
        # A masked sample is a missing one.
        array: Any = np.ma.asarray(signal)
        if array.dtype.kind in "biuf":
            return np.asarray(array.astype(np.float64).filled(np.nan))
    except (TypeError, ValueError):
        pass
    raise NoAnswerError("shape", f"{name} is not an array of real numbers.", "Give samples.")


def _row(bad: Any, stacked: bool) -> str:
    return f", movement {int(np.argmax(bad))}," if stacked else ""


def _no_gap(found: Array, name: str, stacked: bool) -> None:
    missing = ~np.isfinite(found)
    if missing.any():
        bad = missing.any(axis=1)
        first = int(np.argmax(missing[np.argmax(bad)]))
        raise NoAnswerError(
            "gap",
            f"{name}{_row(bad, stacked)} has a gap: {int(missing.sum())} of {missing.size} samples "
            f"are NaN or infinite, the first is sample {first}.",
            "Cut the movement there, or fill the gap and report it.",
        )


def _steady(time_s: ArrayLike, samples: int, fs_Hz: float) -> None:
    time = as_samples(time_s, "The time")
    if time.shape != (samples,) or not np.isfinite(time).all():
        raise NoAnswerError(
            "shape",
            f"The times have the shape {time.shape} for {samples} samples, or are not finite.",
            "Give one time for each sample.",
        )
    fault = unsteady(time, fs_Hz)
    if fault is not None:
        raise NoAnswerError(
            "gap", fault[1], "Resample to a steady rate and report it, or cut the movement there."
        )


def steady_rate(time_s: ArrayLike) -> float:
    """Sampling rate in Hz of frames with these times, which may be rounded, to six digits.

    Of stamps that are rounded to more than 1 % of a period the roundest rate that they allow.
    """
    time = as_samples(time_s, "The time")
    if time.ndim != 1 or len(time) < 2 or not time[-1] > time[0] or not np.isfinite(time).all():
        raise NoAnswerError(
            "rate",
            f"{time.size} samples whose times do not rise from first to last.",
            "Give the times of a recording, in s.",
        )
    return checked_rate(rate_behind(time))


def not_aliased(found: Array, name: str, stacked: bool) -> None:
    """Reject a signal that has not decayed towards half the sampling rate.

    What was sampled too slowly folds back below it; little is left near half the rate in a movement
    that was sampled fast enough.
    """
    # Without the mean and with a window, else the ends of a record look like high frequencies.
    n = found.shape[1]
    tapered = (found - found.mean(axis=1, keepdims=True)) * np.hanning(n)
    magnitude = np.abs(scipy.fft.rfft(tapered, axis=1))
    share = magnitude[:, int(0.9 * n / 2) :].max(axis=1) / magnitude.max(axis=1)
    bad = share >= ALIASED
    if bad.any():
        raise NoAnswerError(
            "aliased",
            f"{name}{_row(bad, stacked)} is aliased or all noise: just below half the sampling "
            f"rate its spectrum still has {share[np.argmax(bad)]:.0%} of its maximum (less than "
            f"{ALIASED:.0%}).",
            "Sample faster, behind an anti-aliasing filter, or filter the noise first.",
        )


def checked_cutoff(cutoff_Hz: float, fs_Hz: float, what: str, below: bool = False) -> float:
    """A frequency between 0 and half the sampling rate; below: not that rate itself."""
    found = as_number(cutoff_Hz)
    if not 0 < found <= fs_Hz / 2 or (below and found == fs_Hz / 2):
        raise NoAnswerError(
            "cutoff",
            f"{what} of {in_words(cutoff_Hz)} Hz: more than 0 and "
            f"{'below' if below else 'at most'} {fs_Hz / 2:g} Hz, half the sampling "
            "rate (Nyquist).",
            "Sample faster or choose a lower one.",
        )
    return found


def checked_choice(value: str, choices: tuple[str, ...], what: str) -> str:
    """One of the named choices."""
    if value not in choices:
        raise NoAnswerError(
            "setting", f"There is no {what} {value!r}.", f"Choose from {', '.join(choices)}."
        )
    return value
