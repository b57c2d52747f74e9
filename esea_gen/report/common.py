"""Sections that the page of every device has: numbers, equations, code, firmware, notes."""

from __future__ import annotations

from typing import Any

from esea_gen.device import Device
from esea_gen.devices.fields import field_facts
from esea_gen.devices.numbers import Quantity
from esea_gen.emit.formats import FLOATING_FORMATS, FORMATS
from esea_gen.emit.render import block_kernels, versions
from esea_gen.identify import MappingFile
from esea_gen.language.ports import unit_of
from esea_gen.report.findings import Findings
from esea_gen.report.page import PageSection
from esea_gen.targets import BOARDS

REAL_NAMES = {real: f"float{real[1:]}" for real in FLOATING_FORMATS}


def quantities(device: Device) -> list[dict[str, Any]]:
    """Every number of the device file with its unit, status and source."""
    found = []
    for key, q in device.quantities():
        row = {"key": key, "value": q.value, "unit": unit_of(key), "status": q.status}
        row |= {"source": q.source, "meaning": field_facts(key)["text"]}
        found.append(row | {"section": key.rsplit(".", 1)[0]})
    return found


def assumed(found: Findings) -> list[dict[str, Any]]:
    """Every assumed number: of the device file, and of the mapping file in use."""
    out = [p for p in quantities(found.device) if p["status"] == "assumed"]
    if found.mapping is not None:
        for key, unit, q in scales(found.mapping):
            if q.status == "assumed":
                source = f"{q.source} ({found.mapping.origin})"
                out.append({"key": key, "value": q.value, "unit": unit, "source": source})
    return out


def scales(source: MappingFile) -> list[tuple[str, str, Quantity]]:
    """Numbers by which a mapping makes SI units: key, unit, value."""
    m = source.mapping
    known = (
        ("deflection.scale_rad_per_m", "rad/m", m.deflection.scale_rad_per_m),
        ("torque.scale_Nm_per_N", "Nm/N", m.torque.scale_Nm_per_N),
        ("sampling.period_s", "s", m.sampling.period_s),
    )
    return [(key, unit, q) for key, unit, q in known if q is not None]


def _parameters(found: Findings) -> dict[str, Any]:
    keys = [a["key"] for a in assumed(found)]
    return {"assumed": keys, "parameters": quantities(found.device)}


def _parameters_shown(found: Findings) -> dict[str, Any]:
    groups: dict[str, list[dict[str, Any]]] = {}
    for p in quantities(found.device):
        groups.setdefault(p["section"], []).append(p)
    return {"assumed": assumed(found), "groups": groups}


def _equations(found: Findings) -> dict[str, Any]:
    equations = [
        {"block": b.name, "number": e.number, "text": e.text, "mathml": e.mathml}
        for b in found.device.system.kinds
        for e in b.equations
    ]
    rate_terms = found.device.rate_terms
    return {"rate_terms": rate_terms, "equations": equations}


def _code(found: Findings) -> dict[str, Any]:
    """Generated files with their sizes, and operations of every straight-line kernel."""
    folders = []
    for bundle in found.bundles:
        files: list[dict[str, Any]] = [
            {"name": n, "bytes": len(t.encode()), "lines": t.count("\n")}
            for n, t in sorted(bundle.files.items())
        ]
        sums = {k: sum(f[k] for f in files) for k in ("bytes", "lines")}
        folders.append({"folder": bundle.folder, "files": files, **sums})
    kernels = []
    for block in found.device.system.kinds:
        if block.kind == "program":
            continue  # how often its loops run each kernel is no one number
        for verb, kernel in block_kernels(block).items():
            for real in REAL_NAMES if verb != "init" else ():
                cost = dict(sorted(FORMATS[real].passes(kernel).cost().items()))
                what = {"block": block.name, "kernel": verb, "format": real}
                kernels.append({**what, "operations": cost, "total": sum(cost.values())})
    kernels.sort(key=lambda k: (k["block"], k["kernel"] != "step", k["format"] != "f64"))
    return {"code": {"folders": folders, "kernels": kernels}}


def _firmware(found: Findings) -> dict[str, Any]:
    board = found.board
    content: dict[str, Any] = {k: getattr(board, k) for k in ("name", "title", "skipped", "failed")}
    content["image"] = None if board.image is None else board.image.to_dict()
    content["tasks" if found.device.laws else "streams"] = _results(found)
    return {"board": content}


def _results(found: Findings) -> dict[str, dict[str, Any]]:
    # How long the emulation took says nothing of the device.
    return {
        label: {k: v for k, v in r.to_dict().items() if k != "duration_s"}
        for label, r in (found.board.results or {}).items()
    }


def _firmware_shown(found: Findings) -> dict[str, Any]:
    board, results = found.board, _results(found)
    good = not board.failed and all(r["identical"] for r in results.values())
    return {
        "results": results,
        "ran": bool(results),
        "board_good": good if results or board.failed else None,  # none: not known
        "emulated": board.name in BOARDS and bool(BOARDS[board.name].machine),
    }


def made_with(found: Findings) -> dict[str, Any]:
    """Versions of all that had a part in the page."""
    made = dict(versions())
    if found.board.image is not None:
        made["firmware compiler"] = found.board.image.compiler
    for r in (found.board.results or {}).values():
        made["emulator"] = r.emulator
    return {"versions": made}


def board_note(found: Findings) -> list[str]:
    return [f"The firmware was not run: {found.board.skipped}"] if found.board.skipped else []


PARAMETERS = PageSection("device/parameters", "Parameters", _parameters, _parameters_shown)
EQUATIONS = PageSection("device/equations", "Equations", _equations)
CODE = PageSection("device/code", "Code", _code)
FIRMWARE = PageSection("device/firmware", "Firmware", _firmware, _firmware_shown)
