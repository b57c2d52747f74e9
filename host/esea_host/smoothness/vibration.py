"""RMS acceleration and vibration dose value."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from esea_host.smoothness.checks import checked_choice, checked_rate, rows
from esea_host.smoothness.result import Processing, SmoothnessResult, as_value

CONVENTIONS = ("iso2631", "thesis")


def rms_acceleration(
    acceleration: ArrayLike,
    fs_Hz: float,
    *,
    unit: str = "deg/s^2",
    time_s: ArrayLike | None = None,
    processing: Processing | None = None,
) -> SmoothnessResult:
    r"""Root mean square of the acceleration, thesis eq. 6.3.

    Parameters
    ----------
    acceleration : array_like
        Shape (samples,), or a stack, shape (movements, samples).
    fs_Hz : float
        Sampling rate.
    unit : str
        Unit of what is given, and of the value.
    time_s : array_like, optional
        Times of the samples, to find gaps, shape (samples,).
    processing : Processing, optional
        What filtered the signal, to stand beside the number.

    Returns
    -------
    SmoothnessResult
        One value for each movement.

    Raises
    ------
    NoAnswerError
        The signal is constant, too short, or has gaps.
    """
    fs_Hz = checked_rate(fs_Hz)
    found, stacked = rows(acceleration, "The acceleration", fs_Hz, time_s)
    return SmoothnessResult(
        "RMS acceleration",
        as_value(np.sqrt(np.mean(found**2, axis=1)), stacked),
        unit,
        "thesis",
        False,
        fs_Hz,
        found.shape[1],
        "sqrt(1/T * integral of a^2 dt)",
        processing=processing,
    )


def vdv(
    acceleration: ArrayLike,
    fs_Hz: float,
    convention: str = "iso2631",
    *,
    unit: str = "deg/s^2",
    time_s: ArrayLike | None = None,
    processing: Processing | None = None,
) -> SmoothnessResult:
    r"""Vibration dose value.

    Parameters
    ----------
    acceleration : array_like
        Shape (samples,), or a stack, shape (movements, samples).
    fs_Hz : float
        Sampling rate.
    convention : str
        ``"iso2631"``: :math:`(\int a^4 dt)^{1/4}`, in the given unit times s^0.25.  ``"thesis"``:
        :math:`(\sum a^4)^{1/4}` over the samples, which its published values have, and which grows
        with the sampling rate.
    unit : str
        Unit of what is given.
    time_s : array_like, optional
        Times of the samples, to find gaps, shape (samples,).
    processing : Processing, optional
        What filtered the signal, to stand beside the number.

    Returns
    -------
    SmoothnessResult
        One value for each movement.

    Raises
    ------
    NoAnswerError
        The signal is constant, too short, or has gaps.

    References
    ----------
    [1] ISO 2631-1:1997, 6.3.2, without its frequency weighting, which is for whole bodies.
    """
    fs_Hz = checked_rate(fs_Hz)
    checked_choice(convention, CONVENTIONS, "convention")
    thesis = convention == "thesis"
    found, stacked = rows(acceleration, "The acceleration", fs_Hz, time_s)
    total = np.sum(found**4, axis=1) / (1.0 if thesis else fs_Hz)
    return SmoothnessResult(
        "VDV",
        as_value(total**0.25, stacked),
        unit if thesis else f"{unit} * s^0.25",
        convention,
        False,
        fs_Hz,
        found.shape[1],
        "(sum over the samples of a^4)^(1/4)" if thesis else "(integral of a^4 dt)^(1/4)",
        processing=processing,
    )
