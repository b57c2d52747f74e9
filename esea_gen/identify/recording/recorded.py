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
    """A recording in SI units, at its own samples.

    file: file name as the mapping gives it.
    digest: first 16 hexadecimal digits of the file's SHA-256.
    time_s, theta_rad, tau_Nm: shape (n,).
    timed: whether the time was recorded (or a period is published), not assumed.
    dropped: samples dropped by the glitch rule.
    findings: what is wrong with it; samples that are spoilt are in no data set.
    conditions: those of the mapping that the file belongs to.
    temperature_C: of the rubber; None where no one said it.
    """

    label: str
    file: str
    digest: str
    time_s: Array
    theta_rad: Array
    tau_Nm: Array
    timed: bool
    dropped: int
    cycles: tuple[Cycle, ...]
    sets: tuple[DataSet, ...]
    conditions: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    temperature_C: float | None = None


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
