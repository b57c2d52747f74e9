"""Everything known of a device, on one page: what it computes, how well, how it was checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.device import Device
from esea_gen.devices.file import shipped_devices
from esea_gen.emit.build import Bundle, render_device
from esea_gen.emit.dialect import render_dialect
from esea_gen.emit.render import versions
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_device
from esea_gen.identify import (
    MappingFile,
    Recording,
    Replay,
    load_mapping,
    load_recordings,
    recordings_for,
)
from esea_gen.identify.recording import resample
from esea_gen.language.block import Block
from esea_gen.language.ports import unit_of
from esea_gen.language.stream import single
from esea_gen.report import figures
from esea_gen.report.contents import (
    OPERATION_GROUPS,
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
from esea_gen.report.page import count_text, finite, render
from esea_gen.targets import BOARDS, DEFAULT_BOARD
from esea_gen.verify.bounds import operating_ranges
from esea_gen.verify.compare import F64_TOLERANCE
from esea_gen.verify.emulator import EmulatorResult, run_in_emulator
from esea_gen.verify.equivalence import verify
from esea_gen.verify.firmware import FirmwareImage
from esea_gen.verify.streams import deflection_inputs, domain_chirp, first_axis
from esea_gen.verify.verdict import Verification

Array = npt.NDArray[Any]
Say = Callable[[str], None]

CHIRP = "chirp in the domain"
STATE_STORY = {
    "fixed point": "errors are carried through one step by interval arithmetic, and a state error "
    "is accepted only when a step gives none larger (inductive), so it holds for any number of "
    "steps",
    "linear": "one step's own rounding error is summed over all powers of the state matrix, so it "
    "holds for any number of steps",
}


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
    mapping: meaning of the recordings, when there are any.
    """

    device: Device
    verification: Verification
    bundles: tuple[Bundle, ...]
    runs: tuple[Run, ...]
    board: BoardRun
    mapping: MappingFile | None
    command: str

    # -- judgement ---------------------------------------------------------------------------

    @property
    def passed(self) -> bool:
        """Whether the C is what was promised, on every target that was run.

        The fit to a measured torque is a figure of the model, not of the C, and does not enter.
        """
        return self.verification.passed and self.board.passed

    @property
    def same_specimen(self) -> bool:
        """Whether the recording's torque is this device's own: they bear the same name."""
        return self.mapping is not None and self.mapping.mapping.device.name == self.device.name

    @property
    def problems(self) -> list[str]:
        """Everything that failed, one line each."""
        return [*verification_problems(self.verification), *board_problems(self.board)]

    # -- figures and tables ------------------------------------------------------------------

    def _outputs(self, block: Block) -> list[str]:
        return [p.name for p in block.outputs if not p.flags]

    def worst(self, real: str) -> dict[str, Any]:
        """Largest output error of any Block and stream in a number format."""
        full = self.verification.full_scale
        torque = self.verification.worst(real, "sensor").get("tau_Nm", 0.0)
        return max(
            (
                {
                    "percent": 100 * c.errors[k] / full[k],
                    "error": c.errors[k],
                    "output": k,
                    "unit": unit_of(k),
                    "block": c.block,
                    "stream": c.stream,
                    "bound_percent": 100 * c.limits[k] / full[k],
                    "torque_percent": 100 * torque / full["tau_Nm"],
                }
                for c in self.verification.comparisons
                if c.real == real
                for k in self._outputs(self._block(c.block))
                if k in c.errors
            ),
            key=lambda w: w["percent"],
        )

    def _block(self, name: str) -> Any:
        return next(b for b in self.device.system.kinds if b.name == name)

    def assumed(self) -> list[dict[str, Any]]:
        """Every assumed number: of the device file, and of the mapping file in use."""
        out = [p for p in self.parameters() if p["status"] == "assumed"]
        if self.mapping is not None:
            m = self.mapping.mapping
            for key, q in (
                ("deflection.scale_rad_per_m", m.deflection.scale_rad_per_m),
                ("torque.scale_Nm_per_N", m.torque.scale_Nm_per_N),
                ("sampling.period_s", m.sampling.period_s),
            ):
                if q is not None and q.status == "assumed":
                    unit = {"scale_rad_per_m": "rad/m", "scale_Nm_per_N": "Nm/N", "period_s": "s"}
                    out.append(
                        {
                            "key": key,
                            "value": q.value,
                            "unit": unit[key.split(".")[1]],
                            "status": q.status,
                            "source": f"{q.source} ({self.mapping.origin})",
                            "meaning": "scale or period of the recording",
                            "section": "recording",
                        }
                    )
        return out

    def parameters(self) -> list[dict[str, Any]]:
        """Every number of the device file with its unit, status and source."""
        return quantities(self.device)

    def fit(self) -> dict[str, Any] | None:
        """Errors of the C against the measured torque, where it is this device's own."""
        if not self.same_specimen:
            return None
        full = self.device.tau_full_scale_Nm
        sets: list[dict[str, Any]] = []
        apart = 0.0
        for run in self.runs:
            r = run.recording
            if r is None:
                continue
            model = {real: run.torque_at(real, r.time_s) for real in REALS}
            apart = max(apart, float(np.abs(model["f32"] - model["f64"]).max()))
            error = model["f32"] - r.tau_Nm
            for s in r.sets:
                sets.append(
                    {
                        "recording": run.label,
                        "label": s.label,
                        "amplitude_rad": s.amplitude_rad,
                        "cycles": dict(sorted(s.cycles.items())),
                        "training": _errors(error[s.training], full),
                        "held_out": _errors(error[s.held_out], full),
                    }
                )
        means = {
            role: _mean([s[role]["rms_percent"] for s in sets if s[role] is not None])
            for role in ("training", "held_out")
        }
        return {"sets": sets, "mean_rms_percent": means, "f32_minus_f64_max_Nm": apart}

    def end_to_end(self) -> list[dict[str, Any]]:
        """float32 against float64, whole task, per stream and output."""
        full = self.verification.full_scale
        rows = []
        for run in self.runs:
            single_, double = run.outputs["f32"], run.outputs["f64"]
            for x in self.device.system.outputs:
                if x.port.flags:
                    continue
                error = float(np.abs(single_[x.name].astype(np.float64) - double[x.name]).max())
                rows.append(
                    {
                        "stream": run.label,
                        "output": x.name,
                        "unit": unit_of(x.name),
                        "max_error": error,
                        "percent": 100 * error / full[x.signals[0].port],
                    }
                )
        return rows

    def flags_seen(self) -> list[dict[str, Any]]:
        """In how many steps of each run a status bit was set."""
        rows = []
        for run in self.runs:
            for x in self.device.system.outputs:
                for i, flag in enumerate(x.port.flags):
                    word = run.outputs["f32"][x.name].astype(np.int64)
                    steps = int(np.count_nonzero((word >> i) & 1))
                    if steps:
                        rows.append(
                            {
                                "stream": run.label,
                                "status": x.name,
                                "flag": flag.name,
                                "meaning": flag.meaning,
                                "steps": steps,
                                "of": len(word),
                            }
                        )
        return rows

    def equations(self) -> list[dict[str, str]]:
        """Equations by Block."""
        return [
            {"block": b.name, "number": e.number, "text": e.text, "mathml": e.mathml}
            for b in self.device.system.kinds
            for e in b.equations
        ]

    def code(self) -> dict[str, Any]:
        """Generated files with their sizes, and operations of every kernel."""
        return generated_code(self.device, self.bundles)

    def bounds(self) -> list[dict[str, Any]]:
        """Derived float32 bounds, with the worst that was seen below each."""
        rows = []
        for block in self.device.system.kinds:
            ranges = operating_ranges(self.device, block)
            seen = self.verification.worst("f32", block.name)
            for domain, bound in self.verification.bounds.get(block.name, {}).items():
                rows.append(
                    {
                        "block": block.name,
                        "domain": domain,
                        "method": bound.method,
                        "assumptions": list(bound.assumptions),
                        "ranges": [
                            {"name": k[2:], "high": v[1], "unit": unit_of(k[2:])}
                            for k, v in ranges.items()
                        ]
                        if domain == "identified domain"
                        else [
                            {"name": p.name, "high": max(abs(p.low), abs(p.high)), "unit": p.unit}
                            for p in block.inputs
                        ],
                        "outputs": [
                            {
                                "output": k,
                                "unit": unit_of(k),
                                "bound": v,
                                "percent": 100 * v / self.verification.full_scale[k],
                                "seen": self._seen(block.name, domain, k, seen),
                            }
                            for k, v in bound.outputs.items()
                        ],
                    }
                )
        return rows

    def _seen(self, block: str, domain: str, key: str, every: dict[str, float]) -> float | None:
        # A stream is held against the tighter bound only when it stays inside the domain; which
        # bound applied shows in its limit.
        limit = self.verification.bounds[block][domain].outputs[key]
        found = [
            c.errors[key]
            for c in self.verification.comparisons
            if c.block == block and c.real == "f32" and key in c.errors and c.limits[key] == limit
        ]
        return max(found, default=None if domain == "identified domain" else every.get(key))

    def notes(self) -> list[str]:
        """What is assumed, and what this page does not show."""
        d = self.device
        out = []
        if d.file.elastomer.maxwell is None:
            out.append(
                "Rate terms not identified: the device has no Maxwell element, equations (3.3) and "
                "(3.4) are not in its code, and its torque does not depend on the rate."
            )
        n = len(self.assumed())
        out.append(f"{n} values are assumed; they are listed with the parameters.")
        out.append(
            "No real hardware was run. The board is emulated: it shows the bits of every result, "
            "how many instructions a step takes, and how much stack, never a time in seconds."
        )
        if self.board.skipped:
            out.append(f"The firmware was not run: {self.board.skipped}")
        if self.mapping is not None and not self.same_specimen:
            m = self.mapping.mapping.device
            out.append(
                f"The deflection was recorded on '{m.title}' ({m.name}). Its measured torque is "
                f"another specimen's, so it is not compared with this device's model."
            )
        if self.mapping is None:
            out.append("No recording was given: nothing here is compared with a measured torque.")
        elif self.same_specimen:
            out.append(
                "The fit to the measured torque judges the model and its parameters, not the C; "
                "it does not enter pass or fail."
            )
            if any(r.recording is not None and not r.recording.timed for r in self.runs):
                out.append("The recording has no time: its sampling period is assumed.")
        out.append(
            "Recorded deflections are interpolated to the sensing rate and rounded to float32; the "
            f"{d.file.encoder.resolution_bits.value:.0f} bit steps of the device's encoder are not "
            "simulated here."
        )
        out.append(
            "float32 bounds hold for each Block with exact inputs. In the task the sensor is given "
            "a rate that carries the velocity estimate's own error; that chain is measured "
            "(end to end), not bounded."
        )
        for row in self.flags_seen():
            out.append(
                f"{row['stream']}: {row['flag']} in {count_text(row['steps'])} of "
                f"{count_text(row['of'])} steps ({row['meaning']})."
            )
        return out

    # -- output ------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The findings, JSON-ready: no NaN, no time of day, no path.

        return: verdict, headline figures, parameters, equations, errors, bounds, code, board,
            notes.
        """
        worst = {real: self.worst(real) for real in REALS}
        board = self.board
        results = {}
        for label, r in (board.results or {}).items():
            # How long the emulation took says nothing of the device.
            results[label] = {k: v for k, v in r.to_dict().items() if k != "duration_s"}
        content: dict[str, Any] = finite(
            {
                "device": {"name": self.device.name, "title": self.device.title},
                "content_hash": self.verification.content_hash,
                "passed": self.passed,
                "problems": self.problems,
                "worst": worst,
                "fit": self.fit(),
                "rate_terms": self.device.file.elastomer.maxwell is not None,
                "assumed": [a["key"] for a in self.assumed()],
                "parameters": self.parameters(),
                "equations": self.equations(),
                "verification": self.verification.to_dict(),
                "bounds": self.bounds(),
                "end_to_end": self.end_to_end(),
                "status_seen": self.flags_seen(),
                "code": self.code(),
                "board": {
                    "name": board.name,
                    "title": board.title,
                    "skipped": board.skipped,
                    "failed": board.failed,
                    "image": None if board.image is None else board.image.to_dict(),
                    "streams": results,
                },
                "notes": self.notes(),
                "versions": self._versions(),
                "command": self.command,
            }
        )
        return content

    def _versions(self) -> dict[str, str]:
        out = dict(versions())
        if self.board.image is not None:
            out["firmware compiler"] = self.board.image.compiler
        for r in (self.board.results or {}).values():
            out["emulator"] = r.emulator
        return out

    def summary(self) -> list[str]:
        """A few lines for the terminal."""
        lines = [
            f"{self.device.title}: {'passed' if self.passed else 'FAILED'} "
            f"(content {self.verification.content_hash})"
        ]
        lines += self.problems[:10]
        if len(self.problems) > 10:
            lines.append(f"... {len(self.problems) - 10} more problems, see the page")
        for real in REALS:
            w = self.worst(real)
            lines.append(
                f"{REAL_NAMES[real]}: worst error {w['percent']:.2g} % of full scale "
                f"({w['block']}.{w['output']}, {w['stream']}), limit {w['bound_percent']:.2g} %"
            )
        b = self.board
        if b.skipped:
            lines.append(f"board {b.name}: skipped: {b.skipped}")
        for label, r in (b.results or {}).items():
            same = "every bit as on the host" if r.identical else "BITS DIFFER"
            n = r.instructions
            count = f", {n['median']} instructions a step (median, emulated)" if n else ""
            lines.append(f"board {r.board}, {label}: {r.steps} steps, {same}{count}")
        fit = self.fit()
        if fit is not None:
            means = fit["mean_rms_percent"]
            shown = [f"{v:.2f} % {k.replace('_', ' ')}" for k, v in means.items() if v is not None]
            lines.append(f"fit to the measured torque, RMS in % of full scale: {', '.join(shown)}")
        lines.append(f"{len(self.assumed())} values are assumed")
        if self.device.file.elastomer.maxwell is None:
            lines.append("rate terms not identified")
        return lines

    def html(self) -> str:
        """The page, one self-contained file."""
        content = self.to_dict()
        return render(
            "report/device.html.j2",
            title=self.device.title,
            f=content,
            axes=self.device.axes,
            assumed=self.assumed(),
            sections=by_section(content["parameters"]),
            blocks=block_tables(self.device),
            streams=self._stream_tables(),
            states=self._state_table(),
            plots=self._plots(),
            overview=self._overview(),
            groups=OPERATION_GROUPS,
            reals=REAL_NAMES,
            stories=STATE_STORY,
            tolerance=F64_TOLERANCE,
            period_s=self.device.period_s,
            full_scale_Nm=self.device.tau_full_scale_Nm,
            same_specimen=self.same_specimen,
            recorded=self.mapping is not None,
            emulated=self.board.name in BOARDS and bool(BOARDS[self.board.name].machine),
            mapping_title="" if self.mapping is None else self.mapping.mapping.device.title,
            steps_verified=sum(c.steps for c in self.verification.comparisons),
        )

    def _stream_tables(self) -> list[dict[str, Any]]:
        tables = []
        for block in self.device.system.kinds:
            by_real = {
                real: {
                    c.stream: c
                    for c in self.verification.comparisons
                    if c.block == block.name and c.real == real
                }
                for real in REALS
            }
            rows = []
            for name, c64 in by_real["f64"].items():
                c32 = by_real["f32"].get(name)
                rows.append({"stream": name, "steps": c64.steps, "f64": c64, "f32": c32})
            tables.append({"block": block.name, "outputs": self._outputs(block), "rows": rows})
        return tables

    def _state_table(self) -> list[dict[str, Any]]:
        rows = []
        for block in self.device.system.kinds:
            worst = {real: self.verification.worst(real, block.name) for real in REALS}
            bounds = self.verification.bounds.get(block.name, {})
            for p in block.state:
                if p.name in worst["f32"]:
                    wide = bounds.get("port ranges")
                    rows.append(
                        {
                            "block": block.name,
                            "state": p.name,
                            "unit": p.unit,
                            "full_scale": self.verification.full_scale[p.name],
                            "f64": worst["f64"][p.name],
                            "f32": worst["f32"][p.name],
                            "bound": None if wide is None else wide.states[p.name],
                        }
                    )
        return rows

    def _overview(self) -> Any:
        """Figure of the torque's errors by stream, next to the fit."""
        full = self.device.tau_full_scale_Nm
        rows = []
        found = {
            (c.stream, c.real): c for c in self.verification.comparisons if c.block == "sensor"
        }
        for stream in dict.fromkeys(s for s, _ in found):

            def percent(values: dict[str, float] | None) -> float | None:
                return None if not values else 100 * values["tau_Nm"] / full

            c64, c32 = found.get((stream, "f64")), found.get((stream, "f32"))
            rows.append(
                figures.StreamError(
                    stream,
                    percent(c64.errors if c64 and "tau_Nm" in c64.errors else None),
                    percent(c32.errors if c32 and "tau_Nm" in c32.errors else None),
                    percent(c32.limits if c32 else None),
                )
            )
        fit = self.fit()
        rms = None
        if fit is not None:
            rms = fit["mean_rms_percent"]["held_out"] or fit["mean_rms_percent"]["training"]
        return figures.error_overview(rows, rms, "overview")

    def _plots(self) -> list[dict[str, Any]]:
        plots = []
        points = figures.POINTS_PER_PAGE // (2 * max(len(self.runs), 4))
        traces = [self._trace(run) for run in self.runs]
        shared = figures.share_loops(traces)
        for i, (run, trace) in enumerate(zip(self.runs, traces, strict=True)):
            rounding = run.sensor["f32"]["tau_Nm"].astype(np.float64) - run.sensor["f64"]["tau_Nm"]
            plots.append(
                {
                    "label": run.label,
                    "steps": len(run.theta_rad),
                    "measured": trace.measured_Nm is not None,
                    "held_out": trace.held_out is not None,
                    "parts": len((shared or trace).parts),
                    "shared": shared is not None,
                    "drawn": min(len((shared or trace).parts), figures.MOST_PANELS),
                    "loops": _loops(trace, shared, i, points),
                    "time": figures.over_time(
                        trace,
                        f"time{i}",
                        points,
                        self.device.tau_full_scale_Nm,
                        (run.time_s, rounding),
                    ),
                }
            )
        return plots

    def _trace(self, run: Run) -> figures.Curve:
        r = run.recording
        if r is None or not self.same_specimen:
            every = np.arange(len(run.time_s))
            return figures.Curve(
                run.label,
                run.time_s,
                run.theta_rad,
                run.sensor["f32"]["tau_Nm"].astype(np.float64),
                None,
                (("torque", every),),
                components=tuple(
                    (name, run.sensor["f32"][key].astype(np.float64))
                    for name, key in (
                        ("spring", "tau_spring_Nm"),
                        ("hysteresis", "tau_hysteresis_Nm"),
                        ("rate terms", "tau_rate_Nm"),
                    )
                    if np.any(run.sensor["f32"][key])
                ),
            )
        parts = []
        mask = np.zeros(len(r.time_s), dtype=bool)
        for s in r.sets:
            mask[s.held_out] = True
            samples = np.sort(np.concatenate([s.training, s.held_out]))
            parts.append((f"{s.label}, amplitude {np.degrees(s.amplitude_rad):.3g}°", samples))
        # All samples once more, conditioning cycles and transitions too: nothing is hidden.
        if len(parts) != 1 or len(parts[0][1]) != len(r.time_s):
            parts.append(("whole recording", np.arange(len(r.time_s))))
        return figures.Curve(
            run.label,
            r.time_s,
            r.theta_rad,
            run.torque_at("f32", r.time_s),
            r.tau_Nm,
            tuple(parts),
            mask if mask.any() and not mask.all() else None,
        )


def _errors(error: Array, full_scale_Nm: float) -> dict[str, float] | None:
    if not len(error):
        return None
    rms, peak = float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
    return {
        "rms_Nm": rms,
        "rms_percent": 100 * rms / full_scale_Nm,
        "max_Nm": peak,
        "max_percent": 100 * peak / full_scale_Nm,
    }


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _loops(trace: figures.Curve, shared: figures.Curve | None, i: int, points: int) -> str:
    # A shared figure stands with the first recording.
    if shared is not None and i > 0:
        return ""
    return figures.loops(shared or trace, f"loops{i}", points)


def gather(
    device: Device,
    recording: Path | None = None,
    data: Path | None = None,
    board: str = DEFAULT_BOARD,
    progress: Say | None = None,
) -> Findings:
    """Build, verify, emulate and measure a device.

    data: folder of the recordings; the mapping file's own when not given.
    """
    if device.drive is not None:
        raise UserError(
            f"{device.name} has a drive; this page is of a torque sensor alone.",
            "Use esea_gen.report.drive.gather_drive, or report on the device it extends.",
        )
    say = progress or (lambda _: None)
    say("reading")
    source = None if recording is None else load_mapping(recording, data)
    recorded: list[tuple[Replay, Recording]] = []
    if recording is not None and source is not None:
        # The replay is what every other command runs; the recording knows its data sets.
        replays = recordings_for(device, recording, data)
        recorded = list(zip(replays, load_recordings(source), strict=True))
    say("generating")
    bundles = (*render_device(device, REALS), render_dialect(device))
    runs = [_run(device, r.label, single(r.theta_rad), raw, say) for r, raw in recorded]
    if not runs:
        runs = [_run(device, CHIRP, domain_chirp(device), None, say)]
    deflections = {r.label: r.theta_rad for r in runs if r.recording is not None}
    verification = verify(device, REALS, deflections, progress=say)
    board_run = run_board(device, board, {r.label: r.theta_rad for r in runs}, say)
    shipped = device.name in shipped_devices() and device.origin == f"{device.name}.toml"
    words = ["esea-gen report", device.name if shipped else device.origin]
    if recording is not None:
        words.append(f"--recording {Path(recording).name}")
    if data is not None:
        words.append("--data DIR")
    if board != DEFAULT_BOARD:
        words.append(f"--board {board}")
    return Findings(device, verification, bundles, tuple(runs), board_run, source, " ".join(words))


def _run(
    device: Device, label: str, theta_rad: Array, recording: Recording | None, say: Say
) -> Run:
    say(f"running the C: {label}")
    outputs = {}
    for real in REALS:
        task = compile_device(device, real).task(device.system.tasks[0].name)
        outputs[real], _ = task.run(deflection_inputs(device.system, theta_rad), trace=False)
    time_s = np.arange(len(theta_rad)) * device.period_s
    sensor = {real: first_axis(device.system, outputs[real]) for real in REALS}
    return Run(label, time_s, theta_rad, outputs, sensor, recording)


def run_board(device: Device, board: str, deflections: Mapping[str, Array], say: Say) -> BoardRun:
    """Build firmware and run deflections on it.

    return: skipped when a tool is missing, failed when the firmware does not build or answer.
    """

    def emulate(image: FirmwareImage, results: dict[str, EmulatorResult]) -> None:
        for label, theta in deflections.items():

            def told(done: int, steps: int, label: str = label) -> None:
                say(f"emulating {label}: {100 * done // steps} %")

            results[label] = run_in_emulator(
                device, image, deflection_inputs(device.system, theta), progress=told
            )

    return on_board(device, board, say, emulate)


__all__ = ["BoardRun", "Findings", "Run", "gather", "run_board"]
