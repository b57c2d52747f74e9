"""A recording, as it is once it has been read."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

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


def recording_rows(recordings: Iterable[Recording]) -> list[dict[str, Any]]:
    """What a result was made of, JSON-ready."""
    return [
        {
            "label": r.label,
            "file": r.file,
            "sha256": r.digest,
            "samples": len(r.time_s),
            "dropped": r.dropped,
            "timed": r.timed,
            "duration_s": float(r.time_s[-1]),
            "temperature_C": r.temperature_C,
        }
        for r in recordings
    ]
