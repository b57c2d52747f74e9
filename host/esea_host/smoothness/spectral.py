"""Spectral arc length of the speed's magnitude spectrum."""

from __future__ import annotations

import math

import numpy as np
import scipy.fft
from numpy.typing import ArrayLike
from scipy.signal import ZoomFFT

from esea_host.smoothness.checks import (
    NoAnswerError,
    as_number,
    checked_choice,
    checked_cutoff,
    checked_rate,
    not_aliased,
    rows,
)
from esea_host.smoothness.result import Array, Processing, SmoothnessResult, as_value

# Largest frequency that each convention looks at.
CUTOFF_HZ = {"reference": 10.0, "thesis": 4.0}
_BLOCK = 64  # movements at a time: a few megabytes
_MOST_PADDING = 12


def sparc(
    speed: ArrayLike,
    fs_Hz: float,
    convention: str = "reference",
    *,
    cutoff_Hz: float | None = None,
    threshold: float = 0.05,
    padlevel: int = 4,
    time_s: ArrayLike | None = None,
    processing: Processing | None = None,
) -> SmoothnessResult:
    r"""Spectral arc length (SPARC) of a speed profile.

    Parameters
    ----------
    speed : array_like
        Speed, no velocity, in any unit; shape (samples,), or a stack (movements, samples).
    fs_Hz : float
        Sampling rate.
    convention : str
        ``"reference"``: the published package's, negative, larger is smoother, up to 10 Hz,
        normalised by the largest magnitude.  ``"thesis"``: eq. 6.6, positive, smaller is smoother,
        up to 4 Hz, of the absolute value, whose largest magnitude is at 0 Hz.
    cutoff_Hz : float, optional
        Upper end of the band in place of the convention's.
    threshold : float
        The band ends where the normalised magnitude falls below this for good.
    padlevel : int
        Zeros are added up to 2**padlevel times the next power of two.
    time_s, processing : optional
        Times of the samples, to find gaps, shape (samples,); what filtered the signal.

    Notes
    -----
    With the magnitude V normalised to 1 at its maximum, over the bins k of the band,

    .. math:: -\sum_k \sqrt{\left(\frac{\Delta f}{f_c}\right)^2 + (V_{k+1} - V_k)^2}

    Invariant to amplitude, and to duration where the cut-off does not bite.

    References
    ----------
    [1] S. Balasubramanian et al., "On the analysis of movement smoothness", JNER 12:112, 2015.
    """
    fs_Hz = checked_rate(fs_Hz)
    thesis = checked_choice(convention, tuple(CUTOFF_HZ), "convention") == "thesis"
    chosen = CUTOFF_HZ[convention] if cutoff_Hz is None else cutoff_Hz
    cutoff_Hz = checked_cutoff(chosen, fs_Hz, "A cut-off")
    found, stacked = rows(speed, "The speed", fs_Hz, time_s, magnitude=thesis)
    not_aliased(found, "The speed", stacked)
    values = _spectral_arcs(found, fs_Hz, cutoff_Hz, threshold, padlevel)
    return SmoothnessResult(
        "SPARC",
        as_value(values if thesis else -values, stacked),
        "1",
        convention,
        not thesis,
        fs_Hz,
        found.shape[1],
        f"{'' if thesis else '-'}arc length of the normalised magnitude spectrum",
        cutoff_Hz,
        threshold,
        processing=processing,
        settings={
            "padlevel": padlevel,
            "normalised_by": "0 Hz, rectified" if thesis else "the largest magnitude",
        },
    )


def _spectral_arcs(
    found: Array, fs_Hz: float, cutoff_Hz: float, threshold: float, padlevel: int
) -> Array:
    if not 0 < as_number(threshold) < 1:
        raise NoAnswerError("setting", f"A threshold of {threshold}.", "Give one between 0 and 1.")
    if padlevel not in range(_MOST_PADDING + 1):
        raise NoAnswerError("setting", f"A padlevel of {padlevel}.", f"Give 0 to {_MOST_PADDING}.")
    duration_s = found.shape[1] / fs_Hz
    if duration_s * cutoff_Hz < 1:
        raise NoAnswerError(
            "short",
            f"{duration_s:g} s are too short for a band up to {cutoff_Hz:g} Hz: at least "
            f"{1 / cutoff_Hz:g} s.",
            "Record longer.",
        )
    length = 2 ** (math.ceil(math.log2(found.shape[1])) + padlevel)
    frequency = np.arange(length // 2 + 1) * (fs_Hz / length)
    bins = int(np.sum(frequency <= cutoff_Hz))
    blocks = [found[i : i + _BLOCK] for i in range(0, len(found), _BLOCK)]
    return np.concatenate([_arc_lengths(_low_spectrum(b, length, bins), threshold) for b in blocks])


def _low_spectrum(found: Array, length: int, bins: int) -> Array:
    """First bins of the zero-padded magnitude spectrum, over its maximum at any frequency.

    Only these are computed: of a second at 1 kHz with the usual padding 1 % is looked at.
    """
    n = found.shape[1]
    spectrum = ZoomFFT(n, [0.0, (bins - 1) / length], bins, fs=1.0, endpoint=True)
    low = np.abs(spectrum(found))
    top = low.max(axis=1)
    # What never changes sign has its maximum at 0 Hz.
    signed = (found.min(axis=1) < 0) & (found.max(axis=1) > 0)
    # Elsewhere it may lie above the band.  A maximum of the spectrum exceeds the nearest of samples
    # at twice as many frequencies as needed by at most 1/cos(pi/4) (M. Riesz).
    coarse = np.abs(scipy.fft.rfft(found[signed], 2 * n, axis=1))
    beyond = coarse[:, math.floor(2 * n * (bins - 1) / length) :].max(axis=1, initial=0.0)
    above = np.flatnonzero(signed)[beyond * math.sqrt(2) > top[signed]]
    for row in above:
        top[row] = np.abs(scipy.fft.rfft(found[row], length)).max()
    return np.asarray(low / top[:, None])


def _arc_lengths(low: Array, threshold: float) -> Array:
    bins = np.arange(low.shape[1])
    seen = low >= threshold
    if not seen.any(axis=1).all():
        raise NoAnswerError(
            "cutoff",
            f"Below the cut-off no magnitude reaches {threshold:.0%} of the largest.",
            "Raise the cut-off, or give the speed instead of a signed velocity.",
        )
    first = seen.argmax(axis=1)
    last = low.shape[1] - 1 - seen[:, ::-1].argmax(axis=1)
    if (last <= first).any():
        raise NoAnswerError("cutoff", "The band has one frequency only.", "Raise the cut-off.")
    step = np.hypot(1.0 / (last - first)[:, None], np.diff(low, axis=1))
    inside = (bins[:-1] >= first[:, None]) & (bins[:-1] < last[:, None])
    return np.asarray(np.sum(step, axis=1, where=inside))
