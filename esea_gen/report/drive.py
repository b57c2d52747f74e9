"""Report sections of a device with a drive: tasks, checks, results on the virtual exoskeleton."""

from __future__ import annotations

from typing import Any

import numpy as np

from esea_gen.control.limits.faults import FAULT_TEXT, Fault
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.language.ports import unit_of
from esea_gen.plotting import svg
from esea_gen.report import common, reach
from esea_gen.report.common import REAL_NAMES, assumed, board_note, made_with
from esea_gen.report.findings import Findings, Say
from esea_gen.report.page import PageSection
from esea_gen.studies.simulation import Simulation, default_person, simulate
from esea_gen.twin.case import Setting
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.judge import ROUGH_HEADS, ROUGHNESS, rough_cells
from esea_gen.verify.verdict import Comparison

YARDSTICK = "smc-published"
COMPARED = ("tuning", "backdriven", "bread", "impedance")
ALONE = ("step", "frequency", "output-impedance")
PLANT = "real"
BADLY = ("unstable", "tripped", "fault", "failure")


def own_law(device: Device) -> str:
    """Name of the device's controller in `simulate`."""
    name, law = device.given
    return f"{law}@{name}" if law else name


def close_loop(device: Device, say: Say) -> tuple[dict[str, Simulation], dict[str, Simulation]]:
    """Run the experiments: with the device's controller, and as published on its plant."""

    def run(experiment: str, which: str) -> Simulation:
        say(f"{experiment}: {which}")
        return simulate(experiment, Setting(which, PLANT, default_person(experiment, PLANT)))

    ours = {e: run(e, own_law(device)) for e in (*COMPARED, *ALONE)}
    if no_yardstick(device):
        return ours, {}
    return ours, {e: run(e, f"{YARDSTICK}@{device.given[0]}") for e in COMPARED}


def no_yardstick(device: Device) -> str:
    """Why sliding mode control as published does not go with a device; empty where it does."""
    try:
        assert controller_device(f"{YARDSTICK}@{device.given[0]}").system is not None
    except UserError as refused:
        return refused.what
    return ""


def verdict(found: Findings) -> dict[str, Any]:
    """How far the drive reaches; a run of the experiments that ended spoils it."""
    return reach.verdict(found) | {"problems": problems(found)}


def summary(found: Findings) -> list[str]:
    lines = []
    rows = _experiments(found)["experiments"]
    for name in COMPARED:
        mine = [r for r in rows if r["experiment"] == name]
        line = f"{name}: RMS of the true torque's error {_mean_text(mine, 'rms_true_Nm')}"
        if name in found.yardsticks:
            line += f"; as published {_mean_text(mine, 'printed_rms_true_Nm')}"
        lines.append(line)
    return [*lines, *found.board.summary("run")]


def _mean_text(rows: list[dict[str, Any]], key: str) -> str:
    # A run that failed has no figure.
    known = [r[key] for r in rows if r[key] is not None]
    return f"{np.mean(known):.3f} Nm" if known else "not known"


def problems(found: Findings) -> list[str]:
    return [
        f"{name}, {case['name']}: {', '.join(_ended(case, k) for k in BADLY if case.get(k))}"
        for name, simulation in found.simulations.items()
        for case in simulation.cases()
        if any(case.get(k) for k in BADLY)
    ]


def _ended(case: dict[str, Any], how: str) -> str:
    """A fault by its name, a failure by its reason."""
    if how == "fault":
        fault = Fault(int(case["fault_reason"]))
        after = " (after the trip, with the motor off)" if case["tripped"] else ""
        return f"latched {fault.name}, {FAULT_TEXT[fault]}{after}"
    if how == "tripped":
        return "the drive tripped (speed, or effective torque of the motor)"
    return f"failed: {case[how]}" if how == "failure" else how


def _tasks(found: Findings) -> dict[str, Any]:
    system, period_ms = found.device.system, 1000 * found.device.period_s
    tasks = []
    for t in system.tasks:
        task = {"name": t.name, "period_ms": period_ms * t.every, "phase": t.phase}
        task |= {"release": t.release_ticks, "blocks": list(t.blocks)}
        task["inputs"] = [x.name for x in system.task_inputs(t)]
        task["outputs"] = [x.name for x in system.task_outputs(t)]
        tasks.append(task | {"latches": [latch.name for latch in system.latches_read(t)]})
    return {"tasks": tasks}


def _experiments(found: Findings) -> dict[str, Any]:
    """Torque errors by case, sliding mode control as published beside, where it goes with it."""
    rows = []
    nothing = {"rms_true_Nm": None, "unstable": False}
    for name in COMPARED:
        yardstick = found.yardsticks.get(name)
        printed = {c["name"]: c for c in yardstick.cases()} if yardstick else {}
        study = found.simulations[name].study
        # The thesis' figures are of its own device.
        thesis = study.thesis_Nm.get(YARDSTICK) if found.device.shipped else None
        for case in found.simulations[name].cases():
            beside = printed.get(case["name"], nothing)
            ours, theirs = case["rms_true_Nm"], beside["rms_true_Nm"]
            row: dict[str, Any] = {"experiment": name, "case": case["name"]}
            row |= {k: case[k] for k in ("rms_true_Nm", "rms_model_Nm", "max_true_Nm", "unstable")}
            row |= {k: case.get(k) for k in ("limited_share", *ROUGHNESS)}
            row |= {"printed_rms_true_Nm": theirs, "printed_unstable": beside["unstable"]}
            row["ratio"] = ours / theirs if ours is not None and theirs else None
            rows.append(row | {"thesis_rms_Nm": thesis})
    return {"experiments": rows}


def _figures(found: Findings) -> dict[str, Any]:
    """Of every simulation, those of the response too."""
    captions = {name: s.study.title for name, s in found.simulations.items()}
    done = found.simulations.items()
    figures = {name: svg(s.figure(), f"drive-{name}", captions[name]) for name, s in done}
    content: dict[str, Any] = {"captions": captions, "figures": figures, "compared": COMPARED}
    rough = {"rough_heads": ROUGH_HEADS, "rough": rough_cells}
    return content | rough | {"yardstick": YARDSTICK}


def _response(found: Findings) -> dict[str, Any]:
    content = {name: found.simulations[name].to_dict() for name in ALONE}
    taken = {"frequency": ("bandwidth", "margins"), "step": ("steps",)}
    taken["output-impedance"] = ("impedance_fit",)
    return {"response": {k: content[name][k] for name, keys in taken.items() for k in keys}}


def _checks(found: Findings) -> dict[str, Any]:
    """Per Block: steps compared, worst float32 error against its limit, float64's bits."""
    rows = []
    for block in found.device.system.kinds:
        of = {real: found.comparisons(block.name, real) for real in REAL_NAMES}
        row: dict[str, Any] = {"block": block.name, "title": block.title}
        row |= {"streams": len(of["f64"]), "steps": sum(c.steps for c in of["f64"])}
        row["bits_equal"] = all(c.bit_identical is not False for c in of["f64"])
        row["passed"] = all(c.passed for cs in of.values() for c in cs)
        # A residual is of the torque, which need be no output of the Block.
        scales = {"tau_Nm": found.device.tau_full_scale_Nm}
        scales |= found.verification.full_scales[block.name]
        rows.append(row | _worst(scales, of["f32"]))
    return {"checks": rows}


def _worst(scales: dict[str, float], comparisons: list[Comparison]) -> dict[str, Any]:
    residuals = [(*c.residual, c.stream) for c in comparisons if c.residual is not None]
    if residuals:
        error, limit, stream = max(residuals, key=lambda r: r[:2])
        percent = 100 * error / scales["tau_Nm"]
        row = {"rule": "residual", "output": "tau_Nm", "error": error, "limit": limit}
        return row | {"percent": percent, "stream": stream}
    rules = ", ".join(sorted({c.rule for c in comparisons}))
    every = [
        (100 * e / scales[k] if scales.get(k) else 0.0, k, e, c.limits.get(k), c.stream)
        for c in comparisons
        for k, e in c.errors.items()
        if k in scales
    ]
    if not every:
        return {"rule": rules, "output": None}
    percent, key, error, most, stream = max(every, key=lambda x: x[0])
    row = {"rule": rules, "output": key, "unit": unit_of(key), "error": error}
    return row | {"limit": most, "percent": percent, "stream": stream}


def _yardstick_note(found: Findings) -> str:
    if not found.yardsticks:
        return f"No results “as published”: {no_yardstick(found.device)}"
    return (
        f"“As published” is {YARDSTICK}: the thesis' sliding mode control with its gaps filled, "
        "on the same plant and person. The thesis' own figures are of its own device, and shown "
        "for that one only."
    )


def _notes(found: Findings) -> dict[str, Any]:
    notes = [
        f"{len(assumed(found))} values are assumed; they are listed with the parameters.",
        "No real hardware was run and no person took part. The exoskeleton and the person are "
        "models; the board is emulated: bits, instructions and stack, never a time in seconds.",
        "Torque errors are of the true elastomer of the model plant, which differs from the "
        "device file as a real one does (friction, gear, cable, 12 bit encoders). One seed; "
        "esea-gen simulate runs many.",
        _yardstick_note(found),
        "Exit code 0: the C matches the model, and no run of the device's controller was unstable "
        "or ended early. The size of an error does not affect it.",
        *board_note(found),
    ]
    return {"notes": notes, **made_with(found)}


HEAD = PageSection("drive/head")
SECTIONS = (
    PageSection("drive/tasks", "Tasks", _tasks),
    PageSection("drive/experiments", "Experiments", _experiments, _figures),
    PageSection("drive/response", "Response", _response),
    PageSection("drive/checks", "Checks", _checks),
    *(common.FIRMWARE, common.PARAMETERS, common.EQUATIONS, common.CODE),
    PageSection("device/notes", "Notes and limits", _notes),
)
