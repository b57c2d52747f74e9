"""Sections of a device that only measures: torque, its errors by format, and their bounds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.hostlib.library import compile_device
from esea_gen.identify import (
    MappingFile,
    Recording,
    load_mapping,
    load_recordings,
    recorded_deflections,
)
from esea_gen.identify.recording.recorded import Misfits
from esea_gen.identify.verdict import temperature_tunables
from esea_gen.language.block import Block
from esea_gen.language.ports import unit_of
from esea_gen.language.stream import single
from esea_gen.plotting import svg
from esea_gen.report import common, figures
from esea_gen.report.common import REAL_NAMES, assumed, board_note, made_with
from esea_gen.report.findings import Array, Findings, Run, Say
from esea_gen.report.page import PageSection, count_text
from esea_gen.verify.bounds import operating_ranges
from esea_gen.verify.compare import F64_TOLERANCE
from esea_gen.verify.streams import deflection_inputs, domain_chirp, first_axis

CHIRP = "chirp in the domain"
IDENTIFIED = "identified domain"
PARTS = (
    ("spring", "tau_spring_Nm"),
    ("hysteresis", "tau_hysteresis_Nm"),
    ("rate terms", "tau_rate_Nm"),
)


def deflect(
    device: Device, recording: Path | None, data: Path | None, say: Say
) -> tuple[tuple[Run, ...], MappingFile | None]:
    """Run the C on recorded deflections, or on a chirp where there is no recording."""
    if recording is None:
        return (_run(device, CHIRP, domain_chirp(device), None, say),), None
    source = load_mapping(recording, data)
    # The deflections are what every other command runs; the recording knows its data sets.
    deflections = recorded_deflections(device, recording, data)
    recorded = load_recordings(source)
    runs = (_run(device, r.label, single(deflections[r.label]), r, say) for r in recorded)
    return tuple(runs), source


def _run(
    device: Device, label: str, theta_rad: Array, recording: Recording | None, say: Say
) -> Run:
    say(f"running the C: {label}")
    outputs = {}
    for real in REAL_NAMES:
        task = compile_device(device, real).task(device.system.tasks[0].name)
        if recording is not None:
            task.prepare(temperature_tunables(device, device.system, recording))
        outputs[real], _ = task.run(deflection_inputs(device.system, theta_rad), trace=False)
    time_s = np.arange(len(theta_rad)) * device.period_s
    sensor = {real: first_axis(device.system, outputs[real]) for real in REAL_NAMES}
    return Run(label, time_s, theta_rad, outputs, sensor, recording)


def _outputs(block: Block) -> list[str]:
    return [p.name for p in block.outputs if not p.flags]


def _fit(found: Findings) -> dict[str, Any] | None:
    """Errors of the C against the measured torque, where it is this device's own."""
    if not found.same_specimen:
        return None
    full = found.device.tau_full_scale_Nm
    sets: list[dict[str, Any]] = []
    errors, apart = [], 0.0
    for run in found.runs:
        r = run.recording
        if r is not None:
            f32, f64 = (run.torque_at(real, r.time_s) for real in ("f32", "f64"))
            apart = max(apart, float(np.abs(f32 - f64).max()))
            errors.append((r, f32 - r.tau_Nm))
            sets += [{"recording": run.label} for _ in r.sets]
    misfits = Misfits.of("Nm", errors)
    for row, (s, judged) in zip(sets, misfits.rows(full), strict=True):
        row |= {"label": s.label, "amplitude_rad": s.amplitude_rad}
        row |= {"cycles": dict(sorted(s.cycles.items())), **judged}
    means = misfits.means(full)
    percents = {role: means[f"{role}_percent"] for role in ("training", "held_out")}
    return {"sets": sets, "mean_rms_percent": percents, "f32_minus_f64_max_Nm": apart}


def _flags_seen(found: Findings) -> list[dict[str, Any]]:
    """In how many steps of each run a status bit was set."""
    rows = []
    for run in found.runs:
        for x in found.device.system.outputs:
            for i, flag in enumerate(x.port.flags):
                word = run.outputs["f32"][x.name].astype(np.int64)
                steps = int(np.count_nonzero((word >> i) & 1))
                if steps:
                    row = {"stream": run.label, "status": x.name, "flag": flag.name}
                    rows.append(row | {"meaning": flag.meaning, "steps": steps, "of": len(word)})
    return rows


def _worst(found: Findings, real: str) -> dict[str, Any]:
    verification = found.verification
    full = verification.full_scale
    torque = verification.worst(real, "sensor").get("tau_Nm", 0.0)
    outputs = {b.name: _outputs(b) for b in found.device.system.kinds}
    every = (
        (c.errors[k], k, c)
        for c in verification.comparisons
        if c.real == real
        for k in outputs[c.block]
        if k in c.errors
    )
    error, k, c = max(every, key=lambda e: e[0] / full[e[1]])
    row = {"percent": 100 * error / full[k], "error": error, "output": k, "unit": unit_of(k)}
    row |= {"block": c.block, "stream": c.stream, "bound_percent": 100 * c.limits[k] / full[k]}
    return row | {"torque_percent": 100 * torque / full["tau_Nm"]}


def _head(found: Findings) -> dict[str, Any]:
    return {"worst": {real: _worst(found, real) for real in REAL_NAMES}}


def verdict(found: Findings) -> dict[str, Any]:
    """The sensor's accuracy: the largest error against a measured torque."""
    full = found.device.tau_full_scale_Nm
    fit = _fit(found)
    for role, words in (("held_out", "held-out cycles"), ("training", "cycles of the training")):
        sets = [s[role] for s in fit["sets"] if s[role] is not None] if fit else []
        if fit and sets:
            error = max(s["max_Nm"] for s in sets)
            text = f"The sensor's error is at most {error:.2g} Nm of {full:.3g} Nm"
            how = f"{words} of the recording; "
            how += f"RMS {fit['mean_rms_percent'][role]:.2g} % of full scale"
            break
    else:
        text, error = "The sensor's accuracy is not known", None
        how = "give --recording with the measured torque of this device"
    content = {"range_Nm": full, "largest_Nm": error, "problems": []}
    return {"text": text, "how": how, "whole": error is not None} | content


def summary(found: Findings) -> list[str]:
    lines = [
        f"{REAL_NAMES[real]}: worst error {w['percent']:.2g} % of full scale "
        f"({w['block']}.{w['output']}, {w['stream']}), limit {w['bound_percent']:.2g} %"
        for real, w in _head(found)["worst"].items()
    ]
    lines += found.board.summary("step")
    fit = _fit(found)
    if fit is not None:
        means = fit["mean_rms_percent"]
        shown = [f"{v:.2f} % {k.replace('_', ' ')}" for k, v in means.items() if v is not None]
        lines.append(f"fit to the measured torque, RMS in % of full scale: {', '.join(shown)}")
    lines.append(f"{len(assumed(found))} values are assumed")
    if not found.device.rate_terms:
        lines.append("rate terms not identified")
    return lines


def _plots(found: Findings) -> dict[str, Any]:
    differences = []
    for run in found.runs:
        f32, f64 = (run.sensor[real]["tau_Nm"].astype(np.float64) for real in ("f32", "f64"))
        differences.append((run.time_s, f32 - f64))
    traces = [_trace(run, found.same_specimen) for run in found.runs]
    drawn = figures.plots(traces, found.device.tau_full_scale_Nm, differences)
    pairs = zip(drawn, found.runs, strict=True)
    return {"plots": [p | {"steps": len(run.theta_rad)} for p, run in pairs]}


def _trace(run: Run, same_specimen: bool) -> figures.Curve:
    r = run.recording
    if r is not None and same_specimen:
        return figures.recorded(r, run.torque_at("f32", r.time_s))
    sensor = {k: v.astype(np.float64) for k, v in run.sensor["f32"].items()}
    components = tuple((name, sensor[key]) for name, key in PARTS if np.any(sensor[key]))
    whole = (("torque", np.arange(len(run.time_s))),)
    return figures.Curve(
        run.label,
        run.time_s,
        run.theta_rad,
        sensor["tau_Nm"],
        None,
        whole,
        np.zeros(len(run.time_s), dtype=bool),
        components=components,
    )


def _errors(found: Findings) -> dict[str, Any]:
    content = {"verification": found.verification.to_dict(), "end_to_end": _end_to_end(found)}
    return content | {"status_seen": _flags_seen(found)}


def _error_figures(found: Findings) -> dict[str, Any]:
    return {"overview": _overview(found), "tolerance": F64_TOLERANCE}


def _end_to_end(found: Findings) -> list[dict[str, Any]]:
    """float32 against float64, whole task, per stream and output."""
    rows = []
    for run in found.runs:
        f32, f64 = run.outputs["f32"], run.outputs["f64"]
        for x in found.device.system.outputs:
            if x.port.flags:
                continue
            full = found.verification.full_scale[x.signals[0].port]
            error = float(np.abs(f32[x.name].astype(np.float64) - f64[x.name]).max())
            row = {"stream": run.label, "output": x.name, "unit": unit_of(x.name)}
            rows.append(row | {"max_error": error, "percent": 100 * error / full})
    return rows


def _overview(found: Findings) -> Any:
    """Figure of the torque's errors by stream, next to the fit."""
    full = found.device.tau_full_scale_Nm
    sensor = {(c.stream, c.real): c for c in found.verification.comparisons if c.block == "sensor"}

    def percent(stream: str, real: str, what: str) -> float | None:
        c = sensor.get((stream, real))
        torque = None if c is None else getattr(c, what).get("tau_Nm")
        return None if torque is None else 100 * float(torque) / full

    rows = []
    for stream in dict.fromkeys(s for s, _ in sensor):
        f64, f32 = percent(stream, "f64", "errors"), percent(stream, "f32", "errors")
        rows.append((stream, f64, f32, percent(stream, "f32", "limits")))
    means = (_fit(found) or {}).get("mean_rms_percent", {})
    rms = means.get("held_out") or means.get("training")
    figure = figures.error_overview(rows, rms)
    return svg(figure, "overview", "Largest torque errors by stream and number format")


def _bounds(found: Findings) -> dict[str, Any]:
    """Derived float32 bounds, with the worst that was seen below each."""
    full = found.verification.full_scale
    rows = []
    for block in found.device.system.kinds:
        for domain, bound in found.verification.bounds.get(block.name, {}).items():
            ranges = {p.name: (max(abs(p.low), abs(p.high)), p.unit) for p in block.inputs}
            if domain == IDENTIFIED:
                operating = operating_ranges(found.device, block)
                ranges = {k[2:]: (v[1], unit_of(k[2:])) for k, v in operating.items()}
            outputs = []
            for k, v in bound.outputs.items():
                seen = _seen(found, block.name, domain, k)
                row = {"output": k, "unit": unit_of(k), "bound": v, "percent": 100 * v / full[k]}
                outputs.append(row | {"seen": seen})
            row = {"block": block.name, "domain": domain, "method": bound.method}
            row["assumptions"] = list(bound.assumptions)
            row["ranges"] = [{"name": k, "high": v, "unit": u} for k, (v, u) in ranges.items()]
            rows.append(row | {"outputs": outputs})
    return {"bounds": rows}


def _seen(found: Findings, block: str, domain: str, key: str) -> float | None:
    # A stream is held against the tighter bound only when it stays inside the domain; which
    # bound applied shows in its limit.
    limit = found.verification.bounds[block][domain].outputs[key]
    held = [c for c in found.comparisons(block, "f32") if c.limits.get(key) == limit]
    every = None if domain == IDENTIFIED else found.verification.worst("f32", block).get(key)
    return max((c.errors[key] for c in held if key in c.errors), default=every)


def _notes(found: Findings) -> dict[str, Any]:
    file = found.device.file
    notes = []
    if not found.device.rate_terms:
        notes.append(
            "Rate terms not identified: the device has no Maxwell element"
            + (", equations (3.3) and (3.4) are not in its code" if file.elastomer else "")
            + ", and its torque does not depend on the rate."
        )
    notes += [
        f"{len(assumed(found))} values are assumed; they are listed with the parameters.",
        "No real hardware was run. The board is emulated: it shows the bits of every result, "
        "how many instructions a step takes, and how much stack, never a time in seconds.",
        *board_note(found),
        *_recording_notes(found),
        "Recorded deflections are interpolated to the sensing rate and rounded to float32; the "
        f"{file.encoder.resolution_bits.value:.0f} bit steps of the device's encoder are not "
        "simulated here.",
        "float32 bounds hold for each Block with exact inputs. In the task the sensor is given "
        "a rate that carries the velocity estimate's own error; that chain is measured "
        "(end to end), not bounded.",
    ]
    notes += [
        f"{row['stream']}: {row['flag']} in {count_text(row['steps'])} of "
        f"{count_text(row['of'])} steps ({row['meaning']})."
        for row in _flags_seen(found)
    ]
    return {"notes": notes, **made_with(found)}


def _recording_notes(found: Findings) -> list[str]:
    if found.mapping is None:
        return ["No recording was given: nothing here is compared with a measured torque."]
    if not found.same_specimen:
        m = found.mapping.mapping.device
        return [
            f"The deflection was recorded on '{m.title}' ({m.name}). Its measured torque is "
            f"another specimen's, so it is not compared with this device's model."
        ]
    out = [
        "The fit to the measured torque judges the model and its parameters, not the C; "
        "it does not affect pass or fail."
    ]
    if any(r.recording is not None and not r.recording.timed for r in found.runs):
        out.append("The recording has no time: its sampling period is assumed.")
    return out


HEAD = PageSection("sensing/head", content=_head)
SECTIONS = (
    PageSection("sensing/way", "Data flow"),
    PageSection("sensing/torque", "Torque", lambda found: {"fit": _fit(found)}, _plots),
    *(common.EQUATIONS, common.PARAMETERS),
    PageSection("sensing/errors", "Errors", _errors, _error_figures),
    PageSection("sensing/bounds", "Bounds", _bounds),
    *(common.CODE, common.FIRMWARE),
    PageSection("device/notes", "Notes and limits", _notes),
)
