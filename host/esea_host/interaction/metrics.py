"""The chapter's four metrics of recordings, each in the convention to cite and in the thesis'."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from esea_host.smoothness import (
    Derivatives,
    SmoothnessResult,
    derivatives,
    ldlj,
    rms_acceleration,
    sparc,
    vdv,
)

Array = npt.NDArray[np.float64]

# The chapter's band for the spectral arc length: nothing is left above the filter.
CUTOFF_HZ = 4.0
# What a reader might have set instead.
STOPS_HZ = (3.5, 4.0, 5.0, 6.0)
CUTOFFS_HZ = (3.0, 4.0, 6.0)
THRESHOLDS = (0.02, 0.05, 0.1)


@dataclass(frozen=True)
class Metric:
    """A metric of a filtered angle."""

    name: str
    convention: str
    measure: Callable[..., SmoothnessResult]
    tuned: tuple[str, ...] = ()


def _rms(d: Derivatives) -> SmoothnessResult:
    return rms_acceleration(d.acceleration, d.fs_Hz, processing=d.processing)


def _vdv(convention: str) -> Callable[[Derivatives], SmoothnessResult]:
    return lambda d: vdv(d.acceleration, d.fs_Hz, convention, processing=d.processing)


def _ldlj(convention: str) -> Callable[[Derivatives], SmoothnessResult]:
    # Of the velocity with its sign: the speed has a corner wherever that changes.
    return lambda d: ldlj(d.velocity, d.fs_Hz, convention, jerk=d.jerk, processing=d.processing)


def _sparc(convention: str) -> Callable[..., SmoothnessResult]:
    def measure(
        d: Derivatives, cutoff_Hz: float = CUTOFF_HZ, threshold: float = 0.05
    ) -> SmoothnessResult:
        return sparc(
            d.speed,
            d.fs_Hz,
            convention,
            cutoff_Hz=cutoff_Hz,
            threshold=threshold,
            processing=d.processing,
        )

    return measure


# The first four are the family that is tested; the others stand beside the published numbers.
FAMILY = (
    Metric("RMS acceleration", "thesis", _rms),
    Metric("VDV", "iso2631", _vdv("iso2631")),
    Metric("LDLJ", "reference", _ldlj("reference")),
    Metric("SPARC", "reference", _sparc("reference"), ("cutoff_Hz", "threshold")),
)
AS_PUBLISHED = (
    FAMILY[0],
    Metric("VDV", "thesis", _vdv("thesis")),
    Metric("LDLJ", "thesis", _ldlj("thesis")),
    Metric("SPARC", "thesis", _sparc("thesis"), ("cutoff_Hz", "threshold")),
)


def as_published(metric: Metric) -> Metric:
    """The same metric by the thesis' convention."""
    return next(m for m in AS_PUBLISHED if m.name == metric.name)


class Chains:
    """Angles of a task through the filter, each stop band once."""

    def __init__(self, theta_deg: Array, fs_Hz: float, last_s: float) -> None:
        self.shape = theta_deg.shape[:-1]
        stack = theta_deg.reshape(-1, theta_deg.shape[-1])
        self._of = cache(lambda stop_Hz: derivatives(stack, fs_Hz, stop_Hz).last(last_s))

    def result(self, metric: Metric, stop_Hz: float, **settings: float) -> SmoothnessResult:
        """The metric of every recording in one result."""
        return metric.measure(self._of(stop_Hz), **settings)

    def values(self, metric: Metric, stop_Hz: float, **settings: float) -> Array:
        """The metric of every recording, in the shape of the angles."""
        return np.reshape(self.result(metric, stop_Hz, **settings).value, self.shape)


def settings_grid(metric: Metric, stops_Hz: Sequence[float] = STOPS_HZ) -> list[dict[str, float]]:
    """Combinations of filter, cut-off and threshold over which a number is looked at."""
    grid: list[dict[str, float]] = [{"stop_Hz": s} for s in stops_Hz]
    for name, values in (("cutoff_Hz", CUTOFFS_HZ), ("threshold", THRESHOLDS)):
        if name in metric.tuned:
            grid = [g | {name: v} for g in grid for v in values]
    return grid
