"""A loaded recording, and the errors of a model on recordings, by data set."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.identify.recording.cycles import Cycle, DataSet
from esea_gen.identify.recording.quality import Finding
from esea_gen.language.ports import Array


@dataclass(frozen=True)
class Recording:
    """A recording in SI units, at its own samples."""

    label: str
    file: str  # file name as the mapping gives it
    digest: str  # first 16 hexadecimal digits of the file's SHA-256
    time_s: Array
    theta_rad: Array
    tau_Nm: Array
    timed: bool  # whether the time was recorded (or a period is published), not assumed
    dropped: int  # samples dropped by the glitch rule
    cycles: tuple[Cycle, ...]
    sets: tuple[DataSet, ...]
    conditions: tuple[str, ...] = ()  # those of the mapping that the file belongs to
    findings: tuple[Finding, ...] = ()  # spoilt samples are in no data set
    temperature_C: float | None = None  # of the rubber; None where no one said it
    simulated: bool = False


def training_sets(recordings: Iterable[Recording]) -> list[tuple[Recording, DataSet]]:
    return [(r, s) for r in recordings for s in r.sets if len(s.training)]


def recording_rows(recordings: Iterable[Recording]) -> list[dict[str, Any]]:
    same = ("label", "file", "dropped", "timed", "temperature_C", "simulated")
    return [
        {k: getattr(r, k) for k in same}
        | {"sha256": r.digest, "samples": len(r.time_s), "duration_s": float(r.time_s[-1])}
        for r in recordings
    ]


@dataclass(frozen=True)
class Misfit:
    rms: float  # root mean square and largest magnitude
    largest: float

    @classmethod
    def of(cls, error: Array) -> Misfit | None:
        """Of an error signal; None for an empty one."""
        if not len(error):
            return None
        return cls(float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()))

    def to_dict(self, unit: str, full_scale: float) -> dict[str, float]:
        """With unit, and in % of full scale."""
        return {
            f"rms_{unit}": self.rms,
            "rms_percent": 100 * self.rms / full_scale,
            f"max_{unit}": self.largest,
            "max_percent": 100 * self.largest / full_scale,
        }


@dataclass(frozen=True)
class Misfits:
    """Errors of all data sets, in order: data set, in training, held out."""

    unit: str  # Nm of a torque, rad of a deflection
    sets: tuple[tuple[DataSet, Misfit | None, Misfit | None], ...]

    @classmethod
    def of(cls, unit: str, errors: Iterable[tuple[Recording, Array]]) -> Misfits:
        """Of recordings, each with the error at its samples."""
        return cls(
            unit,
            tuple(
                (s, Misfit.of(error[s.training]), Misfit.of(error[s.held_out]))
                for r, error in errors
                for s in r.sets
            ),
        )

    def mean_rms(self, held_out: bool) -> float:
        """Mean over data sets of the RMS error, the published figure of merit; NaN without any."""
        found = [b if held_out else a for _, a, b in self.sets]
        sizes = [e.rms for e in found if e is not None]
        return float(np.mean(sizes)) if sizes else math.nan

    def means(self, full_scale: float) -> dict[str, float | None]:
        """:meth:`mean_rms` with unit, and in % of full scale."""
        out: dict[str, float | None] = {}
        for name, held_out in (("training", False), ("held_out", True)):
            rms = self.mean_rms(held_out)
            known = math.isfinite(rms)
            out[f"{name}_{self.unit}"] = rms if known else None
            out[f"{name}_percent"] = 100 * rms / full_scale if known else None
        return out

    def rows(self, full_scale: float) -> list[tuple[DataSet, dict[str, dict[str, float] | None]]]:
        """Each data set with its errors, JSON-ready."""
        return [
            (
                s,
                {
                    "training": a.to_dict(self.unit, full_scale) if a else None,
                    "held_out": b.to_dict(self.unit, full_scale) if b else None,
                },
            )
            for s, a, b in self.sets
        ]
