"""From a recorded angle to velocity, acceleration and jerk, without a shift in time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import cheby2, sosfiltfilt, sosfreqz

from esea_host.smoothness.checks import (
    NoAnswerError,
    as_number,
    checked_cutoff,
    checked_rate,
    in_words,
    rows,
)
from esea_host.smoothness.result import Array, Processing

ORDER, ATTENUATION_DB = 6, 30.0  # of one pass; there are two


@dataclass(frozen=True)
class Derivatives:
    """A filtered angle and its derivatives, each of the shape of the input.

    Parameters
    ----------
    position, velocity, acceleration, jerk : ndarray
        The filtered angle in its unit, per s, per s^2 and per s^3.
    fs_Hz, processing : float and Processing
        Sampling rate; how they were made: give it to the metrics.
    """

    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    fs_Hz: float
    processing: Processing

    @property
    def speed(self) -> Array:
        """Absolute value of the velocity."""
        return np.abs(self.velocity)

    def last(self, duration_s: float) -> Derivatives:
        """Only the last so many seconds, without the filter's start.

        Parameters
        ----------
        duration_s : float
            Seconds to keep.
        """
        wanted, there = as_number(duration_s) * self.fs_Hz, self.position.shape[-1]
        if not 0.5 < wanted < there + 0.5:
            raise NoAnswerError(
                "short",
                f"The last {in_words(duration_s)} s of a record of {there / self.fs_Hz:g} s.",
                "Record longer, or take less.",
            )
        signals = self.position, self.velocity, self.acceleration, self.jerk
        angle, rate, change, jerk = (x[..., -round(wanted) :] for x in signals)
        return Derivatives(angle, rate, change, jerk, self.fs_Hz, self.processing)


def derivatives(
    position: ArrayLike, fs_Hz: float, stop_Hz: float = 4.0, *, time_s: ArrayLike | None = None
) -> Derivatives:
    """Filter, differentiate, filter again, and so on up to jerk; no delay at any frequency.

    Parameters
    ----------
    position : array_like
        Angle in any unit, shape (samples,), or a stack, shape (movements, samples).
    fs_Hz : float
        Sampling rate.
    stop_Hz : float
        The stop band starts here: 60 dB less from there on.
    time_s : array_like, optional
        Times of the samples, to find gaps, shape (samples,).

    Notes
    -----
    Chebyshev filter of the second kind, sixth order, forward and backward, on the angle and on each
    derivative; central differences.  The record is extended at its ends by two periods of
    ``stop_Hz``, turned about its end point.  About as long at either end is not to be trusted in
    the higher derivatives: cut it off with :meth:`Derivatives.last`, or record more than is needed.
    """
    fs_Hz = checked_rate(fs_Hz)
    stop_Hz = checked_cutoff(stop_Hz, fs_Hz, "A stop band's edge", below=True)
    found, stacked = rows(position, "The angle", fs_Hz, time_s)
    ends = round(2 * fs_Hz / stop_Hz)
    if found.shape[1] <= ends:
        raise NoAnswerError(
            "short",
            f"{found.shape[1] / fs_Hz:g} s are too short for a stop band from {stop_Hz:g} Hz: more "
            f"than {2 / stop_Hz:g} s.",
            "Record longer.",
        )
    sections, half_Hz = _low_pass(stop_Hz, fs_Hz)
    signals = [sosfiltfilt(sections, found, axis=1, padtype="odd", padlen=ends)]
    for _ in range(3):
        change = np.gradient(signals[-1], 1 / fs_Hz, axis=1)
        signals.append(sosfiltfilt(sections, change, axis=1, padtype="odd", padlen=ends))
    processing = Processing(
        f"Chebyshev II low-pass, order {ORDER}, forward and backward",
        stop_Hz,
        2 * ATTENUATION_DB,
        half_Hz,
        f"ends extended by {ends / fs_Hz:g} s, turned about the end point",
        ("filter", *("central difference", "filter") * 3),
    )
    kept = [x if stacked else x[0] for x in signals]
    return Derivatives(kept[0], kept[1], kept[2], kept[3], fs_Hz, processing)


@cache
def _low_pass(stop_Hz: float, fs_Hz: float) -> tuple[Array, float]:
    sections = cheby2(ORDER, ATTENUATION_DB, stop_Hz, fs=fs_Hz, output="sos")
    frequency, response = sosfreqz(sections, np.linspace(0, stop_Hz, 2001), fs=fs_Hz)
    # Power after both passes is the fourth power of one pass' amplitude.
    through = np.abs(response) ** 4 >= 0.5
    return sections, float(frequency[np.flatnonzero(through)[-1]])
