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
from esea_gen.studies.outcome import Simulation
from esea_gen.verify.verdict import Comparison, Verification

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Run:
    """One deflection through the device's C, whole task, on the host.

    time_s, theta_rad: samples at the sensing rate, shape (n,).
    outputs: per number format, per output: what the C gave.
    sensor: per number format: the first axis' sensor outputs, under its Block's port names.
    recording: where the deflection comes from.
    """

    label: str
    time_s: Array
    theta_rad: Array
    outputs: dict[str, dict[str, Array]]
    sensor: dict[str, dict[str, Array]]
    recording: Recording | None

    def torque_at(self, real: str, time_s: Array) -> Array:
        """Torque of the C in a number format, at other times (interpolated)."""
        grid = np.asarray(self.time_s, dtype=np.float64)
        return resample(grid, self.sensor[real]["tau_Nm"].astype(np.float64), time_s)


@dataclass(frozen=True)
class Findings:
    """What was found of a device.

    verification: the C against the symbolic Blocks.
    command: makes the page again.
    runs, mapping: without a law: deflections through the C, and what their recordings mean.
    simulations: with a law: closed-loop studies of it, by experiment.
    yardsticks: the same of sliding mode control as published, where it is compared.
    """

    device: Device
    verification: Verification
    bundles: tuple[Bundle, ...]
    board: BoardRun
    command: str
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
