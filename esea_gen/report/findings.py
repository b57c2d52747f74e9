"""Results for the sections of a device's report."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.board.emulator import EmulatorResult, run_tasks_in_emulator
from esea_gen.board.firmware import FirmwareImage, build_firmware
from esea_gen.device import Device
from esea_gen.emit.build import Bundle
from esea_gen.errors import UserError
from esea_gen.identify import MappingFile, Recording
from esea_gen.identify.recording.reading import resample
from esea_gen.studies.simulation import Simulation
from esea_gen.targets import firmware_boards
from esea_gen.twin.recorded import record_drive
from esea_gen.verify.streams import deflection_inputs
from esea_gen.verify.verdict import Comparison, Verification

Say = Callable[[str], None]

TICKS = 3000  # of the tuning case, for a device with a law


@dataclass(frozen=True)
class BoardRun:
    name: str
    title: str
    image: FirmwareImage | None = None
    results: Mapping[str, EmulatorResult] | None = None  # by stream, or by task
    skipped: str = ""  # why it did not run: a tool is missing
    failed: str = ""  # why it did not run: something is wrong

    @property
    def passed(self) -> bool:
        """False when it failed or any bit differs; a board that was skipped is not judged."""
        return not self.failed and all(
            r.identical and r.hash_matches for r in (self.results or {}).values()
        )

    @property
    def problems(self) -> list[str]:
        found = [f"board {self.name}: {self.failed}"] if self.failed else []
        for label, r in (self.results or {}).items():
            where = f"board {r.board}, {label}"
            if r.first_difference is not None:
                d = r.first_difference
                found.append(
                    f"{where}: {d.output} at step {d.step} is {d.board}, on the host {d.host}"
                )
            if not r.hash_matches:
                found.append(f"{where}: runs content {r.content_hash}, expected {r.expected_hash}")
        return found

    def summary(self, steps: str) -> list[str]:
        lines = [f"board {self.name}: skipped: {self.skipped}"] if self.skipped else []
        for label, r in (self.results or {}).items():
            same = "every bit as on the host" if r.identical else "BITS DIFFER"
            n = r.instructions
            count = f", {n['median']} instructions a {steps} (median, emulated)" if n else ""
            lines.append(f"board {r.board}, {label}: {r.steps} {steps}s, {same}{count}")
        return lines


def emulated(
    device: Device,
    board: str,
    deflections: Mapping[str, npt.NDArray[Any]],
    ticks: int,
    told: Callable[[str], Callable[[int, int], None]],
) -> tuple[FirmwareImage, dict[str, EmulatorResult]]:
    """Build firmware and run it: with a law on a closed loop's inputs, else on deflections."""
    system = device.system
    results: dict[str, EmulatorResult] = {}
    with tempfile.TemporaryDirectory(prefix="esea-") as scratch:
        told(f"building firmware for {board}")
        image = build_firmware(device, board, Path(scratch) / "image")
        if device.laws:
            told("recording the tuning case")
            inputs = record_drive(device, ticks).inputs
            results |= run_tasks_in_emulator(device, image, inputs, progress=told("tasks"))
        for label, theta in deflections.items():
            given = {t.name: deflection_inputs(system, theta, t) for t in system.tasks}
            found = run_tasks_in_emulator(device, image, given, progress=told(label))
            several = len(found) > 1
            results |= {f"{label}, {t}" if several else label: r for t, r in found.items()}
    return image, results


def run_board(
    device: Device,
    board: str,
    deflections: Mapping[str, npt.NDArray[Any]],
    say: Say,
    ticks: int = TICKS,
) -> BoardRun:
    known = firmware_boards()
    title = known[board].title if board in known else ""

    def told(what: str) -> Callable[[int, int], None]:
        say(what)
        return lambda done, steps: say(f"emulating {what}: {100 * done // steps} %")

    try:
        image, results = emulated(device, board, deflections, ticks, told)
        return BoardRun(board, title, image, results)
    except UserError as error:
        if board not in known or os.environ.get("ESEA_REQUIRE_TOOLS") == "1":
            raise
        return BoardRun(board, title, skipped=str(error))
    except RuntimeError as error:
        # A board that does not build or answer is a finding: the page says so and fails.
        return BoardRun(board, title, failed=str(error))


Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Run:
    """One deflection through the device's C, complete task, on the host."""

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
    device: Device
    verification: Verification  # the C against the symbolic Blocks
    bundles: tuple[Bundle, ...]
    board: BoardRun
    command: str  # makes the page again
    runs: tuple[Run, ...] = ()
    mapping: MappingFile | None = None
    simulations: dict[str, Simulation] = field(default_factory=dict)
    yardsticks: dict[str, Simulation] = field(default_factory=dict)
    reach: tuple[dict[str, Any], ...] = ()  # of a drive: what it was tried on

    @property
    def same_specimen(self) -> bool:
        """Whether the recording's torque is this device's own: they bear the same name."""
        return self.mapping is not None and self.mapping.mapping.device.name == self.device.name

    def comparisons(self, block: str, real: str) -> list[Comparison]:
        every = self.verification.comparisons
        return [c for c in every if c.block == block and c.real == real]
