"""The chapter's four metrics of recordings, each in the convention to cite and in the thesis'."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_host import smoothness

Array = npt.NDArray[np.float64]

# The chapter's band for the spectral arc length: nothing is left above the filter.
CUTOFF_HZ = 4.0
# What a reader might have set instead.
STOPS_HZ = (3.5, 4.0, 5.0, 6.0)
CUTOFFS_HZ = (3.0, 4.0, 6.0)
THRESHOLDS = (0.02, 0.05, 0.1)


# Of a filtered angle, each with the convention and settings that it takes.
MEASURES: dict[str, Callable[..., smoothness.SmoothnessResult]] = {
    "RMS acceleration": lambda d, _, **s: smoothness.rms_acceleration(d.acceleration, d.fs_Hz, **s),
    "VDV": lambda d, c, **s: smoothness.vdv(d.acceleration, d.fs_Hz, c, **s),
    # Of the velocity with its sign: the speed has a corner wherever that changes.
    "LDLJ": lambda d, c, **s: smoothness.ldlj(d.velocity, d.fs_Hz, c, jerk=d.jerk, **s),
    "dimensionless jerk": lambda d, c, **s: smoothness.dimensionless_jerk(
        d.velocity, d.fs_Hz, c, jerk=d.jerk, **s
    ),
    "SPARC": lambda d, c, **s: smoothness.sparc(d.speed, d.fs_Hz, c, **s),
    "submovements": lambda d, _, **s: smoothness.submovements(d.speed, d.fs_Hz, **s),
    "peak-speed ratio": lambda d, _, **s: smoothness.peak_speed_ratio(d.speed, d.fs_Hz, **s),
}


@dataclass(frozen=True)
class Metric:
    """A metric of a filtered angle; tuned: settings that it depends on beside the filter."""

    name: str
    convention: str
    tuned: tuple[str, ...] = ()

    def measure(self, d: smoothness.Derivatives, **settings: Any) -> smoothness.SmoothnessResult:
        more = settings | {"processing": d.processing}
        return MEASURES[self.name](d, self.convention, **more)


# The first four are the family that is tested; the others stand beside the published numbers.
_TUNED = ("cutoff_Hz", "threshold")
FAMILY = (
    Metric("RMS acceleration", "thesis"),
    Metric("VDV", "iso2631"),
    Metric("LDLJ", "reference"),
    Metric("SPARC", "reference", _TUNED),
)


class Chains:
    """Angles of a task through the filter, each stop band once."""

    def __init__(self, theta_deg: Array, fs_Hz: float, last_s: float) -> None:
        self.shape = theta_deg.shape[:-1]
        stack = theta_deg.reshape(-1, theta_deg.shape[-1])
        self._of = cache(lambda stop_Hz: smoothness.derivatives(stack, fs_Hz, stop_Hz).last(last_s))

    def result(
        self, metric: Metric, stop_Hz: float, **settings: float
    ) -> smoothness.SmoothnessResult:
        """The metric of every recording in one result."""
        if metric.name == "SPARC":
            settings = {"cutoff_Hz": CUTOFF_HZ} | settings
        return metric.measure(self._of(stop_Hz), **settings)

    def values(self, metric: Metric, stop_Hz: float, **settings: float) -> Array:
        """The metric of every recording, in the shape of the angles."""
        return np.reshape(self.result(metric, stop_Hz, **settings).value, self.shape)


def settings_grid(metric: Metric) -> list[dict[str, float]]:
    """Combinations of filter, cut-off and threshold over which a number is looked at."""
    grid: list[dict[str, float]] = [{"stop_Hz": s} for s in STOPS_HZ]
    for name, values in (("cutoff_Hz", CUTOFFS_HZ), ("threshold", THRESHOLDS)):
        if name in metric.tuned:
            grid = [g | {name: v} for g in grid for v in values]
    return grid
