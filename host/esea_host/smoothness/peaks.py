"""Counts and ratios of the speed profile itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import find_peaks

from esea_host.smoothness.checks import NoAnswerError, as_number, checked_rate, not_aliased, rows
from esea_host.smoothness.result import Processing, SmoothnessResult, as_value


def submovements(
    speed: ArrayLike,
    fs_Hz: float,
    *,
    threshold: float = 0.05,
    apart_s: float = 0.0,
    time_s: ArrayLike | None = None,
    processing: Processing | None = None,
) -> SmoothnessResult:
    """Number of submovements: prominent peaks of the speed.

    Parameters
    ----------
    speed : array_like
        Speed, shape (samples,), or a stack, shape (movements, samples); of a signed velocity its
        absolute value counts.
    fs_Hz : float
        Sampling rate.
    threshold : float
        A peak counts where it rises above the valleys round it by this share of the largest speed.
    apart_s : float
        Of peaks closer than this only the highest counts.
    time_s, processing : optional
        Times of the samples, to find gaps, shape (samples,); what filtered the signal.

    Returns
    -------
    SmoothnessResult
        One count for each movement; a plateau is one peak, the ends of the record are none.
    """
    fs_Hz = checked_rate(fs_Hz)
    if not (0 < as_number(threshold) < 1 and 0 <= as_number(apart_s) < np.inf):
        raise NoAnswerError(
            "setting",
            f"A threshold of {threshold} and peaks {apart_s} s apart.",
            "Give more than 0 and less than 1; 0 s or more.",
        )
    found, stacked = rows(speed, "The speed", fs_Hz, time_s, magnitude=True)
    not_aliased(found, "The speed", stacked)
    apart = max(1.0, apart_s * fs_Hz)
    highest = found.max(axis=1, keepdims=True)
    # Of equal peaks each would stand out of all that lies between them and the next higher one:
    # a slope of a billionth makes the first the highest.
    sloped = found - 1e-9 * highest * np.linspace(0, 1, found.shape[1])
    counts = [
        len(find_peaks(row, prominence=threshold * top, distance=apart)[0])
        for row, top in zip(sloped, highest[:, 0], strict=True)
    ]
    return SmoothnessResult(
        "submovements",
        as_value(np.array(counts, dtype=np.float64), stacked),
        "1",
        "peaks of the speed by prominence",
        False,
        fs_Hz,
        found.shape[1],
        "number of peaks of the speed",
        threshold=threshold,
        processing=processing,
        settings={"apart_s": apart_s},
    )


def peak_speed_ratio(
    speed: ArrayLike,
    fs_Hz: float,
    *,
    time_s: ArrayLike | None = None,
    processing: Processing | None = None,
) -> SmoothnessResult:
    """Largest speed over mean speed: 1.875 for a minimum-jerk movement, more with stops on the way.

    Parameters
    ----------
    speed, fs_Hz, time_s, processing
        As in :func:`submovements`.

    References
    ----------
    [1] B. Rohrer et al., "Movement smoothness changes during stroke recovery", J. Neurosci. 22(18),
        2002: its speed metric is the inverse of this ratio.
    """
    fs_Hz = checked_rate(fs_Hz)
    found, stacked = rows(speed, "The speed", fs_Hz, time_s, magnitude=True)
    not_aliased(found, "The speed", stacked)
    return SmoothnessResult(
        "peak-speed ratio",
        as_value(found.max(axis=1) / found.mean(axis=1), stacked),
        "1",
        "peak over mean",
        False,
        fs_Hz,
        found.shape[1],
        "largest speed / mean speed",
        processing=processing,
    )
