"""A number of smoothness, and everything that it depends on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Processing:
    """How a signal was filtered and differentiated; stop band and half power: of all passes."""

    filter: str
    stop_Hz: float
    attenuation_dB: float
    half_power_Hz: float
    window: str
    steps: tuple[str, ...]


@dataclass(frozen=True)
class SmoothnessResult:
    """One metric of one movement, or of several: value, convention, settings.

    value: a number for a 1-D signal; for a 2-D stack one for each row.  cutoff_Hz, threshold: upper
    end of the band, and share of the maximum from which on the metric looks.  processing: the
    filter before the metric; None: taken as given.
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
        """Fields and derived values."""
        more = {"duration_s": self.duration_s, "filter": self.filter, "sign": self.sign}
        return vars(self) | more


def as_value(values: Array, stacked: bool) -> float | Array:
    """One number for one movement."""
    return values if stacked else float(values[0])
