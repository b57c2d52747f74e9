"""Analysis of real data: bandwidths and steps of a metal series elastic actuator.

Data: I. Tregear, Series Elastic Actuation, Imperial College London, 2023, recordings of a closed
torque loop at one sample per 1.5 to 3 ms, irregular.  None of it is shipped; `check_on_data` takes
the folder.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis.frequency import Bandwidth, FrequencyResponse
from esea_gen.analysis.plots import bode
from esea_gen.analysis.response import checked, checked_time
from esea_gen.analysis.step import StepMetrics, step_metrics
from esea_gen.analysis.sweeps import Sweep, sweep_response
from esea_gen.errors import UserError
from esea_gen.language.ports import Array
from esea_gen.studies.registry import Reproduction
from esea_gen.tables import read_table

SWEEP = Sweep(0.0, 40.0, 40.0)
STEP_S = 3.0
SMOOTHING = 99
AUTHOR_DROP_DB = 4.5
PUBLISHED = {
    "open": "published_SEAMotorBandwidth.csv",
    "closed": "published_SEABandwidthClosedLoop.csv",
}


def author_bandwidth(time_s: Array, u: Array, y: Array) -> float:
    """Bandwidth by the definition that reproduces the published figures."""
    from scipy.signal import savgol_filter

    time = checked_time(time_s)
    x, z = checked("u", u, len(time)), checked("y", y, len(time))
    lines = np.arange(0, len(time) / (2 * time[-1]), 1 / time[-1])
    if len(lines) < SMOOTHING:
        raise UserError(f"{len(time)} samples.", f"{2 * SMOOTHING} are needed.")
    ratio = (np.fft.fft(z) / np.fft.fft(x))[: len(lines)]
    gain = savgol_filter(20 * np.log10(np.abs(ratio)), SMOOTHING, 1)
    phase = savgol_filter(np.degrees(np.angle(ratio)), SMOOTHING, 1)
    turn = int(np.argmin(phase))
    # The line of the minimum belongs to both halves, hence the 1.
    back = np.flatnonzero(phase[turn:] >= np.max(phase[: turn + 1]))
    bound = turn + 1 + int(back[0]) if back.size else len(lines)
    above = np.flatnonzero(gain >= gain[0] - AUTHOR_DROP_DB)
    return float(lines[above[above <= bound][-1]])


@dataclass(frozen=True)
class SweepCheck:
    file: str
    loop: str
    published_Hz: float
    author_Hz: float
    local: Bandwidth
    local_author_drop: Bandwidth
    command: Bandwidth
    response: FrequencyResponse


@dataclass(frozen=True)
class DataCheck:
    sweeps: tuple[SweepCheck, ...]
    steps: dict[str, dict[str, StepMetrics]]

    @property
    def reproduced(self) -> bool:
        return all(abs(s.author_Hz - s.published_Hz) < 1e-6 for s in self.sweeps)

    def to_dict(self) -> dict[str, Any]:
        sweeps = [vars(s) | {"response": s.response.to_dict()} for s in self.sweeps]
        return {"reproduced": self.reproduced, "sweeps": sweeps, "steps": self.steps}

    def table(self) -> list[str]:
        lines = []
        for s in self.sweeps:
            lines += [
                f"{s.loop} loop, {s.file}",
                f"  published                                  {s.published_Hz:8.3f} Hz",
                f"  author's definition (4.5 dB, last line)    {s.author_Hz:8.3f} Hz",
            ]
            for label, b in (
                ("local fits, -3.01 dB of lowest", s.local),
                ("local fits, -4.5 dB of lowest", s.local_author_drop),
                ("local fits, -3.01 dB of the command", s.command),
            ):
                value = "    none" if b.bandwidth_Hz is None else f"{b.bandwidth_Hz:8.3f}"
                note = ", rises above it again" if b.returns else ""
                peak = f"peak {b.peak_dB:+.1f} dB at {b.peak_Hz:.1f} Hz"
                lines.append(f"  {label:43}{value} Hz ({peak}{note})")
        for file, both in self.steps.items():
            for name, metrics in both.items():
                head, *rest = metrics.table()
                lines += [f"step, {file}, {name}", f"  {head}", *rest]
        found = "come out to 1e-6 Hz" if self.reproduced else "DO NOT come out"
        return [*lines, f"By the author's definition the published bandwidths {found}."]

    def figure(self) -> Figure:
        return bode([(f"{s.loop} loop", s.response, s.local) for s in self.sweeps])


def _columns(path: Path, *names: str) -> list[Array]:
    table = read_table(path, names)
    return [table.numbers(n) for n in names]


def _published(folder: Path, loop: str, torque_Nm: float, repetition: int) -> float:
    path = folder / PUBLISHED[loop]
    bandwidth_Hz, rated_Nm = _columns(path, "bandwidth", "torque")
    rows = bandwidth_Hz[rated_Nm == torque_Nm]
    if len(rows) < repetition:
        raise UserError(
            f"{path}: {len(rows)} rows for {torque_Nm:g} Nm, repetition {repetition} is needed.",
            "Use the file as published.",
        )
    return float(rows[repetition - 1])


def _sweep(folder: Path, path: Path) -> SweepCheck:
    named = re.match(r"bw_sea(_cl)?-([\d.]+)-(\d+)-", path.name)
    if named is None:
        raise UserError(f"{path}: not a sweep's name.", "Use the file names of the data set.")
    loop = "closed" if named[1] else "open"
    time, u, y = _columns(path, "time", "torque_in", "torque_ati")
    response = sweep_response(time, u, y, SWEEP)
    return SweepCheck(
        path.name,
        loop,
        _published(folder, loop, float(named[2]), int(named[3])),
        author_bandwidth(time, u, y),
        response.bandwidth(),
        response.bandwidth(drop_dB=AUTHOR_DROP_DB),
        response.bandwidth(passband_gain=1.0),
        response,
    )


def check_on_data(folder: Path | str, progress: Callable[[str], None] | None = None) -> DataCheck:
    root = Path(folder)
    say = progress or (lambda _: None)
    sweeps = sorted((root / "chirp").glob("*.csv"))
    steps = sorted((root / "step_closed_loop").glob("*.csv"))
    if not sweeps or not steps:
        raise UserError(
            f"{root}: {len(sweeps)} sweeps in chirp/ and {len(steps)} steps in step_closed_loop/.",
            "Give the folder of the data set, with both.",
        )
    checks = []
    for path in sweeps:
        say(f"sweep {path.name}")
        checks.append(_sweep(root, path))
    judged: dict[str, dict[str, StepMetrics]] = {}
    for path in steps:
        say(f"step {path.name}")
        names = ("torque_ati", "torque_sea")
        time, *torques = _columns(path, "time", *names)
        judged[path.name] = {
            name: step_metrics(time, torque, step_s=STEP_S, after=1.0)
            for name, torque in zip(names, torques, strict=True)
        }
    return DataCheck(tuple(checks), judged)


class PublishedBandwidths(Reproduction[DataCheck]):
    """Published bandwidths and steps of a metal series elastic actuator, from its recordings."""

    name = "bandwidth"
    title = "Bandwidths of a metal series elastic actuator"
    recordings = True

    def run(self, say: Callable[[str], None], folder: Path | None) -> DataCheck:
        assert folder is not None
        return check_on_data(folder, say)

    def reproduced(self, outcome: DataCheck) -> bool:
        return outcome.reproduced
