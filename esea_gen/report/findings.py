"""What is found of a device: all that the sections of its page draw on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.device import Device
from esea_gen.emit.build import Bundle
from esea_gen.identify import MappingFile, Recording
from esea_gen.identify.recording.reading import resample
from esea_gen.report.board import BoardRun
from esea_gen.studies.simulation import Simulation
from esea_gen.verify.verdict import Comparison, Verification

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Run:
    """One deflection through the device's C, whole task, on the host."""

    label: str
    time_s: Array  # samples at the sensing rate, shape (n,)
    theta_rad: Array
    outputs: dict[str, dict[str, Array]]  # per number format, per output: what the C gave
    sensor: dict[str, dict[str, Array]]
    recording: Recording | None  # where the deflection comes from

    def torque_at(self, real: str, time_s: Array) -> Array:
        """Torque of the C in a number format, at other times (interpolated)."""
        grid = np.asarray(self.time_s, dtype=np.float64)
        return resample(grid, self.sensor[real]["tau_Nm"].astype(np.float64), time_s)


@dataclass(frozen=True)
class Findings:
    """What was found of a device."""

    device: Device
    verification: Verification  # the C against the symbolic Blocks
    bundles: tuple[Bundle, ...]
    board: BoardRun
    command: str  # makes the page again
    runs: tuple[Run, ...] = ()
    mapping: MappingFile | None = None
    simulations: dict[str, Simulation] = field(default_factory=dict)
    yardsticks: dict[str, Simulation] = field(default_factory=dict)

    @property
    def same_specimen(self) -> bool:
        """Whether the recording's torque is this device's own: they bear the same name."""
        return self.mapping is not None and self.mapping.mapping.device.name == self.device.name

    def comparisons(self, block: str, real: str) -> list[Comparison]:
        """Comparisons of a Block in a number format."""
        every = self.verification.comparisons
        return [c for c in every if c.block == block and c.real == real]
