"""Recordings at a device's sensing rate: what verification, emulator and report run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.recording.reading import load_recordings, resample
from esea_gen.identify.recording.recorded import Recording
from esea_gen.language.ports import Array


@dataclass(frozen=True)
class Replay:
    """A recording resampled to the sensing rate."""

    label: str
    time_s: Array  # shape (steps,); deflection and measured torque
    theta_rad: Array
    tau_Nm: Array
    timed: bool  # whether the time was recorded, not assumed
    held_out: Array  # samples that identification did not see, shape (steps,)
    digest: str  # First 16 hexadecimal digits of the file's SHA-256


def recordings_for(device: Device, mapping: Path, data: Path | None = None) -> list[Replay]:
    """Recordings of a mapping, at a device's sensing rate."""
    source = load_mapping(mapping, data)
    return [_replay(device, source.origin, r) for r in load_recordings(source)]


def _replay(device: Device, origin: str, r: Recording) -> Replay:
    reach = float(np.max(np.abs(r.theta_rad)))
    limit = device.file.limits.theta_rad.value
    if reach > limit:
        raise UserError(
            f"{origin}: {r.label} reaches {reach:.3g} rad, above {device.name}'s "
            f"limits.theta_rad = {limit:g} rad: every sample beyond it would be an invalid input.",
            "Change the mapping's deflection scale, or use a device with a wider limit.",
        )
    grid = np.arange(r.time_s[0], r.time_s[-1], device.period_s)
    # Rounding may put the grid's last step behind the last sample.
    nearest = np.minimum(np.searchsorted(r.time_s, grid), len(r.time_s) - 1)
    unseen = np.zeros(len(r.time_s), dtype=bool)
    for s in r.sets:
        unseen[list(s.held_out)] = True
    return Replay(
        r.label,
        grid - grid[0],
        resample(r.time_s, r.theta_rad, grid),
        resample(r.time_s, r.tau_Nm, grid),
        r.timed,
        unseen[nearest],
        r.digest,
    )


def recorded_deflections(
    device: Device, mapping: Path, data: Path | None = None
) -> dict[str, Array]:
    """Deflections of a mapping's recordings, by label."""
    return {r.label: r.theta_rad for r in recordings_for(device, mapping, data)}
