"""A number of smoothness, and everything that it depends on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Processing:
    """How a signal was filtered and differentiated.

    Parameters
    ----------
    filter : str
        Type and order of the filter.
    stop_Hz : float
        Edge of its stop band.
    attenuation_dB : float
        Least attenuation in the stop band, both passes together.
    half_power_Hz : float
        Where both passes together let half of the power by.
    window : str
        What became of the ends of the record.
    steps : tuple of str
        The steps in their order.
    """

    filter: str
    stop_Hz: float
    attenuation_dB: float
    half_power_Hz: float
    window: str
    steps: tuple[str, ...]


@dataclass(frozen=True)
class SmoothnessResult:
    """One metric of one movement, or of several: value, convention, settings.

    Parameters
    ----------
    metric : str
        Which metric.
    value : float or ndarray
        A number for a 1-D signal; for a 2-D stack one for each row, shape (movements,).
    unit : str
        Unit of the value.
    convention : str
        Whose definition.
    larger_is_smoother : bool
        Sign of the metric.
    fs_Hz : float
        Sampling rate.
    samples : int
        Samples of one movement.
    definition : str
        The formula that was evaluated.
    cutoff_Hz : float, optional
        Upper end of the band that the metric looks at; without it there is none.
    threshold : float, optional
        Share of the maximum below which the metric does not look.
    window : str
        Window over the samples.
    processing : Processing, optional
        Filter before the metric; without it the samples were taken as given.
    settings : dict
        What else the metric was told.
    """

    metric: str
    value: Any
    unit: str
    convention: str
    larger_is_smoother: bool
    fs_Hz: float
    samples: int
    definition: str
    cutoff_Hz: float | None = None
    threshold: float | None = None
    window: str = "rectangular"
    processing: Processing | None = None
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def duration_s(self) -> float:
        """Duration that enters the metric: samples over sampling rate."""
        return self.samples / self.fs_Hz

    @property
    def filter(self) -> str:
        """The filter before the metric, in words."""
        p = self.processing
        return "none" if p is None else f"{p.filter}, stop band from {p.stop_Hz:g} Hz"

    @property
    def sign(self) -> str:
        """Which way is smoother, in words."""
        return "larger is smoother" if self.larger_is_smoother else "smaller is smoother"

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        out = {k: v for k, v in vars(self).items() if k != "processing"}
        out["value"] = self.value.tolist() if isinstance(self.value, np.ndarray) else self.value
        out |= {"duration_s": self.duration_s, "filter": self.filter, "sign": self.sign}
        out["processing"] = None if self.processing is None else dict(vars(self.processing))
        return out


def as_value(values: Array, stacked: bool) -> float | Array:
    """One number for one movement."""
    return values if stacked else float(values[0])
