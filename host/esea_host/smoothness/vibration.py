"""RMS acceleration and vibration dose value."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from esea_host.smoothness.checks import checked_choice, checked_rate, rows
from esea_host.smoothness.result import Array, Processing, SmoothnessResult, as_value

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
    time_s, processing : optional
        Times of the samples, to find gaps, shape (samples,); what filtered the signal.
    """
    fs_Hz = checked_rate(fs_Hz)
    found, stacked = rows(acceleration, "The acceleration", fs_Hz, time_s)
    return SmoothnessResult(
        "RMS acceleration",
        as_value(_root_of_sum(found, 2, found.shape[1]), stacked),
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
    acceleration, fs_Hz, unit, time_s, processing
        As in :func:`rms_acceleration`.
    convention : str
        ``"iso2631"``: :math:`(\int a^4 dt)^{1/4}`, in the given unit times s^0.25.  ``"thesis"``:
        :math:`(\sum a^4)^{1/4}` over the samples, which its published values have, and which grows
        with the sampling rate.

    References
    ----------
    [1] ISO 2631-1:1997, 6.3.2, without its frequency weighting, which is for whole bodies.
    """
    fs_Hz = checked_rate(fs_Hz)
    checked_choice(convention, CONVENTIONS, "convention")
    thesis = convention == "thesis"
    found, stacked = rows(acceleration, "The acceleration", fs_Hz, time_s)
    return SmoothnessResult(
        "VDV",
        as_value(_root_of_sum(found, 4, 1.0 if thesis else fs_Hz), stacked),
        unit if thesis else f"{unit} * s^0.25",
        convention,
        False,
        fs_Hz,
        found.shape[1],
        "(sum over the samples of a^4)^(1/4)" if thesis else "(integral of a^4 dt)^(1/4)",
        processing=processing,
    )


def _root_of_sum(found: Array, power: int, over: float) -> Array:
    # Of shares of the largest: a power of the numbers themselves may overflow.
    top = np.max(np.abs(found), axis=1)
    total = np.sum((found / top[:, None]) ** power, axis=1)
    return np.asarray(top * (total / over) ** (1 / power))
