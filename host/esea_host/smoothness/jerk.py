"""Dimensionless jerk, and its logarithm, by the reference's convention and the thesis'."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from esea_host.smoothness.checks import (
    NoAnswerError,
    checked_choice,
    checked_rate,
    not_aliased,
    rows,
)
from esea_host.smoothness.result import Processing, SmoothnessResult, as_value

CONVENTIONS = ("reference", "thesis")
_REFERENCE = "T^3/v_peak^2 * integral of (d2v/dt2)^2 dt"
_THESIS = "T^5/v_peak^2 * sum over the samples of jerk^2"


def ldlj(
    speed: ArrayLike,
    fs_Hz: float,
    convention: str = "reference",
    *,
    jerk: ArrayLike | None = None,
    time_s: ArrayLike | None = None,
    processing: Processing | None = None,
) -> SmoothnessResult:
    r"""Log dimensionless jerk (LDLJ-V) of a speed profile.

    Parameters
    ----------
    speed : array_like
        Speed in any unit, shape (samples,), or a stack, shape (movements, samples).
    fs_Hz : float
        Sampling rate.
    convention : str
        ``"reference"``: :math:`-\ln(T^3/v_p^2 \int \ddot v^2 dt)`, larger is smoother.
        ``"thesis"``: eq. 6.5 as its published values have it,
        :math:`\ln(T^5/v_p^2 \sum \ddot v^2)` over the samples, smaller is smoother.
    jerk : array_like, optional
        Jerk in the speed's unit per s^2, of a filter chain; without it second differences of the
        speed.
    time_s, processing : optional
        Times of the samples, to find gaps, shape (samples,); what filtered the signal.

    Notes
    -----
    The reference's is invariant to amplitude and duration.  The thesis' has T^5, which goes with
    the amplitude of the movement, beside the speed's, and no time step: it grows with duration and
    with the sampling rate.  Jerk amplifies noise: filter first, and say how.

    References
    ----------
    [1] S. Balasubramanian, A. Melendez-Calderon, E. Burdet, "A robust and sensitive metric for
        quantifying movement smoothness", IEEE Trans. Biomed. Eng. 59(8), 2012.
    [2] S. Balasubramanian et al., J. NeuroEng. Rehabil. 12:112, 2015.
    """
    return _measured("LDLJ", speed, fs_Hz, convention, jerk, time_s, processing)


def dimensionless_jerk(
    speed: ArrayLike,
    fs_Hz: float,
    convention: str = "reference",
    *,
    jerk: ArrayLike | None = None,
    time_s: ArrayLike | None = None,
    processing: Processing | None = None,
) -> SmoothnessResult:
    """Dimensionless jerk of a speed profile: LDLJ before the logarithm.

    Parameters
    ----------
    speed, fs_Hz, convention, jerk, time_s, processing
        As in :func:`ldlj`; the reference's value is negative, the thesis' positive.
    """
    return _measured("dimensionless jerk", speed, fs_Hz, convention, jerk, time_s, processing)


def _measured(
    metric: str,
    speed: ArrayLike,
    fs_Hz: float,
    convention: str,
    jerk: ArrayLike | None,
    time_s: ArrayLike | None,
    processing: Processing | None,
) -> SmoothnessResult:
    fs_Hz = checked_rate(fs_Hz)
    thesis = checked_choice(convention, CONVENTIONS, "convention") == "thesis"
    found, stacked = rows(speed, "The speed", fs_Hz, time_s)
    not_aliased(found, "The speed", stacked)
    samples = found.shape[1]
    # Of shares of the peak, as the definition has it: squares of the numbers may overflow.
    peak = np.max(np.abs(found), axis=1, keepdims=True)
    if jerk is None:
        change = np.diff(found / peak, 2, axis=1) * fs_Hz**2
    else:
        given, _ = rows(jerk, "The jerk", fs_Hz)
        if given.shape != found.shape:
            raise NoAnswerError(
                "shape",
                f"The jerk has the shape {given.shape}, the speed {found.shape}.",
                "Give both at the same samples.",
            )
        change = given / peak
    total = np.einsum("ij,ij->i", change, change)
    if (total <= (8 * np.finfo(np.float64).eps * fs_Hz**2) ** 2 * samples).any():
        raise NoAnswerError("constant", "The acceleration is constant.", "Its jerk is 0: omit it.")
    duration_s = samples / fs_Hz
    values = duration_s**5 * total if thesis else duration_s**3 * total / fs_Hz
    definition = _THESIS if thesis else _REFERENCE
    if metric == "LDLJ":
        values, definition = np.log(values), f"ln({definition})"
    return SmoothnessResult(
        metric,
        as_value(np.asarray(values if thesis else -values), stacked),
        "1",
        convention,
        not thesis,
        fs_Hz,
        samples,
        definition if thesis else f"-{definition}",
        processing=processing,
        settings={"jerk": "second differences of the speed" if jerk is None else "given"},
    )
