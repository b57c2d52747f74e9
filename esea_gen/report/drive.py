"""A device with a drive on one page: tasks, checks, what it does on the virtual exoskeleton."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.devices.file import shipped_devices
from esea_gen.emit.build import Bundle, render_device
from esea_gen.emit.dialect import render_dialect
from esea_gen.emit.render import versions
from esea_gen.language.ports import unit_of
from esea_gen.plotting import svg
from esea_gen.report.contents import (
    REAL_NAMES,
    REALS,
    BoardRun,
    block_tables,
    board_problems,
    by_section,
    generated_code,
    on_board,
    quantities,
    verification_problems,
)
from esea_gen.report.page import finite, render
from esea_gen.studies.outcome import Simulation
from esea_gen.studies.simulation import default_person, simulate
from esea_gen.targets import DEFAULT_BOARD
from esea_gen.twin.case import Setting
from esea_gen.twin.recorded import record_drive
from esea_gen.verify.emulator import EmulatorResult, run_tasks_in_emulator
from esea_gen.verify.equivalence import verify
from esea_gen.verify.firmware import FirmwareImage
from esea_gen.verify.verdict import Comparison, Verification

Say = Callable[[str], None]

YARDSTICK = "smc-published"
COMPARED = ("tuning", "backdriven", "bread", "impedance")
ALONE = ("step", "frequency", "output-impedance")
PLANT = "real"
TICKS = 3000


@dataclass(frozen=True)
class DriveFindings:
    """What was found of a device with a drive.

    verification: the C against the symbolic Blocks.
    simulations: by experiment, of the device's controller.
    yardsticks: the same of sliding mode control as printed, where it is compared.
    """

    device: Device
    verification: Verification
    bundles: tuple[Bundle, ...]
    simulations: dict[str, Simulation]
    yardsticks: dict[str, Simulation]
    board: BoardRun
    command: str

    # -- judgement ---------------------------------------------------------------------------

    @property
    def passed(self) -> bool:
        """Whether the C is what was promised, and no run of the device's controller was unstable.

        How small the torque's error is, is a figure of the controller and does not enter.
        """
        return not self.problems

    @property
    def problems(self) -> list[str]:
        """Everything that failed, one line each."""
        found = [*verification_problems(self.verification), *board_problems(self.board)]
        for name, simulation in self.simulations.items():
            for case in simulation.cases():
                words = [k for k in ("unstable", "tripped", "fault", "failure") if case.get(k)]
                if words:
                    found.append(f"{name}, {case['name']}: {', '.join(words)}")
        return found

    # -- tables ------------------------------------------------------------------------------

    def tasks(self) -> list[dict[str, Any]]:
        """Tasks with their Blocks in order, and what crosses the System's border."""
        system = self.device.system
        return [
            {
                "name": t.name,
                "period_ms": 1000 * self.device.period_s * t.every,
                "phase": t.phase,
                "release": t.release_ticks,
                "blocks": list(t.blocks),
                "inputs": [x.name for x in system.task_inputs(t)],
                "outputs": [x.name for x in system.task_outputs(t)],
                "latches": [latch.name for latch in system.latches_read(t)],
            }
            for t in system.tasks
        ]

    def experiments(self) -> list[dict[str, Any]]:
        """Torque errors by case, sliding mode control as printed beside."""
        rows = []
        for name in COMPARED:
            printed = {c["name"]: c for c in self.yardsticks[name].cases()}
            for case in self.simulations[name].cases():
                beside = printed[case["name"]]
                ours, theirs = case["rms_true_Nm"], beside["rms_true_Nm"]
                rows.append(
                    {
                        "experiment": name,
                        "case": case["name"],
                        **{k: case[k] for k in ("rms_true_Nm", "rms_model_Nm", "max_true_Nm")},
                        "unstable": case["unstable"],
                        "limited_share": case.get("limited_share"),
                        "printed_rms_true_Nm": theirs,
                        "printed_unstable": beside["unstable"],
                        "ratio": ours / theirs if ours is not None and theirs else None,
                        "thesis_rms_Nm": beside["thesis_rms_Nm"],
                    }
                )
        return rows

    def response(self) -> dict[str, Any]:
        """Bandwidth, margins, steps and output impedance."""
        content = {name: self.simulations[name].to_dict() for name in ALONE}
        return {
            "bandwidth": content["frequency"]["bandwidth"],
            "margins": content["frequency"]["margins"],
            "steps": content["step"]["steps"],
            "impedance_fit": content["output-impedance"]["impedance_fit"],
        }

    def checks(self) -> list[dict[str, Any]]:
        """Per Block: steps compared, worst float32 error against its limit, float64's bits."""
        rows = []
        for block in self.device.system.kinds:
            of = {
                real: [
                    c
                    for c in self.verification.comparisons
                    if c.block == block.name and c.real == real
                ]
                for real in REALS
            }
            rows.append(
                {
                    "block": block.name,
                    "title": block.title,
                    "streams": len(of["f64"]),
                    "steps": sum(c.steps for c in of["f64"]),
                    "bits_equal": all(c.bit_identical is not False for c in of["f64"]),
                    "passed": all(c.passed for cs in of.values() for c in cs),
                    **self._worst(block.name, of["f32"]),
                }
            )
        return rows

    def _worst(self, block: str, comparisons: list[Comparison]) -> dict[str, Any]:
        rules = sorted({c.rule for c in comparisons})
        judged = [c for c in comparisons if c.residual is not None]
        if judged:
            c = max(judged, key=lambda c: c.residual or (0.0, 0.0))
            assert c.residual is not None
            full = self.verification.full_scales[block].get("tau_Nm", 1.0)
            return {
                "rule": "residual",
                "output": "tau_Nm",
                "error": c.residual[0],
                "limit": c.residual[1],
                "percent": 100 * c.residual[0] / full,
                "stream": c.stream,
            }
        scales = self.verification.full_scales[block]
        every = [
            (100 * e / scales[k] if scales.get(k) else 0.0, k, e, c.limits.get(k), c.stream)
            for c in comparisons
            for k, e in c.errors.items()
            if k in scales
        ]
        if not every:
            return {"rule": ", ".join(rules), "output": None}
        percent, key, error, limit, stream = max(every, key=lambda x: x[0])
        return {
            "rule": ", ".join(rules),
            "output": key,
            "unit": unit_of(key),
            "error": error,
            "limit": limit,
            "percent": percent,
            "stream": stream,
        }

    def notes(self) -> list[str]:
        """What is assumed, and what this page does not show."""
        assumed = sum(p["status"] == "assumed" for p in quantities(self.device))
        out = [
            f"{assumed} values are assumed; they are listed with the parameters.",
            "No real hardware was run and no person took part. The exoskeleton and the person are "
            "models; the board is emulated: bits, instructions and stack, never a time in seconds.",
            "Torque errors are of the true elastomer of the model plant, which differs from the "
            "device file as a real one does (friction, gear, cable, 12 bit encoders). One seed; "
            "esea-gen simulate runs many.",
            f"“As printed” is {YARDSTICK}: the thesis' sliding mode control with its gaps filled, "
            "on the same plant and person. The thesis' own figures are of its own device.",
            "An unstable run of the device's controller fails this page; the size of an error does "
            "not.",
        ]
        if self.board.skipped:
            out.append(f"The firmware was not run: {self.board.skipped}")
        return out

    # -- output ------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The findings, JSON-ready: no NaN, no time of day, no path.

        return: verdict, tasks, experiments, response, checks, parameters, code, board, notes.
        """
        board = self.board
        results = {
            t: {k: v for k, v in r.to_dict().items() if k != "duration_s"}
            for t, r in (board.results or {}).items()
        }
        made = dict(versions())
        if board.image is not None:
            made["firmware compiler"] = board.image.compiler
        for r in (board.results or {}).values():
            made["emulator"] = r.emulator
        parameters = quantities(self.device)
        content: dict[str, Any] = finite(
            {
                "device": {"name": self.device.name, "title": self.device.title},
                "content_hash": self.verification.content_hash,
                "passed": self.passed,
                "problems": self.problems,
                "tasks": self.tasks(),
                "experiments": self.experiments(),
                "response": self.response(),
                "checks": self.checks(),
                "assumed": [p["key"] for p in parameters if p["status"] == "assumed"],
                "parameters": parameters,
                "code": generated_code(self.device, self.bundles),
                "board": {
                    "name": board.name,
                    "title": board.title,
                    "skipped": board.skipped,
                    "failed": board.failed,
                    "image": None if board.image is None else board.image.to_dict(),
                    "tasks": results,
                },
                "notes": self.notes(),
                "versions": made,
                "command": self.command,
            }
        )
        return content

    def summary(self) -> list[str]:
        """A few lines for the terminal."""
        lines = [
            f"{self.device.title}: {'passed' if self.passed else 'FAILED'} "
            f"(content {self.verification.content_hash})",
            *self.problems[:10],
        ]
        rows = self.experiments()
        for name in COMPARED:
            found = [r for r in rows if r["experiment"] == name]
            ours = np.mean([r["rms_true_Nm"] for r in found if r["rms_true_Nm"] is not None])
            theirs = np.mean([r["printed_rms_true_Nm"] for r in found])
            lines.append(
                f"{name}: RMS of the true torque's error {ours:.3f} Nm; as printed {theirs:.3f} Nm"
            )
        b = self.board
        if b.skipped:
            lines.append(f"board {b.name}: skipped: {b.skipped}")
        for task, r in (b.results or {}).items():
            same = "every bit as on the host" if r.identical else "BITS DIFFER"
            n = r.instructions
            count = f", {n['median']} instructions a run (median, emulated)" if n else ""
            lines.append(f"board {r.board}, {task}: {r.steps} runs, {same}{count}")
        return lines

    def html(self) -> str:
        """The page, one self-contained file."""
        content = self.to_dict()
        captions = {name: self.simulations[name].study.title for name in (*COMPARED, *ALONE)}
        return render(
            "report/drive.html.j2",
            title=self.device.title,
            f=content,
            blocks=block_tables(self.device),
            assumed=[p for p in content["parameters"] if p["status"] == "assumed"],
            sections=by_section(content["parameters"]),
            figures={
                name: svg(s.figure(), f"drive-{name}", captions[name])
                for name, s in self.simulations.items()
            },
            captions=captions,
            compared=COMPARED,
            reals=REAL_NAMES,
            steps_verified=sum(c.steps for c in self.verification.comparisons),
            comparisons=len(self.verification.comparisons),
            yardstick=YARDSTICK,
        )


def gather_drive(
    device: Device, board: str = DEFAULT_BOARD, progress: Say | None = None
) -> DriveFindings:
    """Build, verify, simulate and emulate a device with a drive."""
    say = progress or (lambda _: None)
    say("generating")
    bundles = (*render_device(device, REALS), render_dialect(device))
    shipped = device.name in shipped_devices() and device.origin == f"{device.name}.toml"
    name, law = device.given
    controller = f"{law}@{name}" if law else name

    def run(experiment: str, which: str) -> Simulation:
        say(f"{experiment}: {which}")
        person = default_person(experiment, PLANT)
        return simulate(experiment, Setting(which, PLANT, person))

    simulations = {name: run(name, controller) for name in (*COMPARED, *ALONE)}
    yardsticks = {name: run(name, YARDSTICK) for name in COMPARED}
    verification = verify(device, REALS, progress=say)
    board_run = run_tasks_on_board(device, board, TICKS, say)
    words = ["esea-gen report", device.name if shipped else device.origin]
    if board != DEFAULT_BOARD:
        words.append(f"--board {board}")
    return DriveFindings(
        device, verification, bundles, simulations, yardsticks, board_run, " ".join(words)
    )


def run_tasks_on_board(device: Device, board: str, ticks: int, say: Say) -> BoardRun:
    """Build firmware and run a drive's tasks on it, inputs as in closed loop.

    return: skipped when a tool is missing, failed when the firmware does not build or answer.
    """

    def emulate(image: FirmwareImage, results: dict[str, EmulatorResult]) -> None:
        inputs = record_drive(device, ticks).inputs
        results |= run_tasks_in_emulator(
            device,
            image,
            inputs,
            progress=lambda done, runs: say(f"emulating: {100 * done // runs} %"),
        )

    return on_board(device, board, say, emulate)


__all__ = ["DriveFindings", "gather_drive", "run_tasks_on_board"]
