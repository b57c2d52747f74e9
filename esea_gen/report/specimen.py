"""Specimen page: measurements, fit of the model, used share of its life.

For a missing result the page names the command that computes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from esea_gen.devices.fields import field_facts
from esea_gen.emit.build import device_hash
from esea_gen.identify.family.choice import THESIS
from esea_gen.identify.notes import LIKELY
from esea_gen.identify.published.space import place_of
from esea_gen.identify.verdict import RATE_EDGES, TORQUE_EDGES
from esea_gen.report import figures
from esea_gen.report.common import scales
from esea_gen.report.page import PageSection, render
from esea_gen.report.specimen_results import AGREED, COMPARED, LIFE, NAMES, SpecimenResults

SCALES = {
    "deflection.scale_rad_per_m": "deflection",
    "torque.scale_Nm_per_N": "torque",
    "sampling.period_s": "sampling period",
}


def specimen_page(found: SpecimenResults, command: str) -> str:
    content = found.identified | {"command": command, "content_hash": device_hash(found.device)}
    model = content["model"]["member"] if "model" in content else THESIS
    shown = {
        "title": f"Specimen: {found.device.title}",
        "f": content,
        "facts": found.source.mapping.specimen,
        "scales": [
            {"what": SCALES[key], "unit": unit} | q.model_dump()
            for key, unit, q in scales(found.source)
        ],
        "model": model,
        "compared": found.others.get(COMPARED),
        "agreed": found.others.get(AGREED),
        "lives": found.others.get(LIFE),
        "names": NAMES,
        "wanted": found.wanted(),
    }
    return render(PageSection("specimen/head"), SECTIONS, found, **shown)


def _loops(found: SpecimenResults) -> dict[str, Any]:
    traces = []
    for r in found.recordings:
        curve = figures.recorded(r, found.verdict.torque_Nm[r.label], "model")
        sets = tuple(p for p in curve.parts if p[0] != figures.WHOLE)
        traces.append(replace(curve, parts=sets))
    whole = figures.joined(traces)
    drawn = figures.loops_svg(whole, "loops", figures.POINTS_PER_PAGE // 2)
    return {"loops": drawn, "panels": len(whole.parts), "most": figures.MOST_PANELS}


def _parameters(found: SpecimenResults) -> dict[str, Any]:
    """Each number of the model with its interval and where it comes from."""
    known, content = dict(found.device.quantities()), found.identified
    rows = []
    for key, p in content.get("parameters", {}).items():
        place = place_of(key)
        row = {"name": key, "meaning": field_facts(place)["text"], "unit": p["unit"]}
        rows.append(row | _interval(p["value"], p["sigma"], p["low"], p["high"], known[place]))
    for i, t in enumerate(content["model"]["terms"] if "model" in content else ()):
        least = -math.inf if t["kind"] == "offset" else 0.0
        q = known[f"family.terms[{i}].weight_Nm"]
        row = {"name": t["kind"], "meaning": t["term"], "unit": "Nm"}
        rows.append(row | _interval(t["weight_Nm"], t["sigma_Nm"], least, math.inf, q))
    t = content["model"].get("temperature") if "model" in content else None
    if t is not None:
        q = known["family.temperature.per_K"]
        ends = field_facts("family.temperature.per_K")
        text = "change a kelvin of every weight but an offset's, by the rubber's temperature"
        row = {"name": "per_K", "meaning": text, "unit": "1/K"}
        rows.append(row | _interval(t["per_K"], t["sigma_per_K"], ends["low"], ends["high"], q))
    return {"parameters": rows, "warmth": t}


def _interval(
    value: float, sigma: float | None, low: float, high: float, quantity: Any
) -> dict[str, Any]:
    ends = None
    if sigma is not None:
        ends = max(value - LIKELY * sigma, low), min(value + LIKELY * sigma, high)
    source = quantity.source.partition("; standard deviation")[0]
    return {"value": value, "interval": ends, "status": quantity.status, "source": source}


def _models(found: SpecimenResults) -> dict[str, Any]:
    if COMPARED not in found.others:
        return {}
    rows = found.others[COMPARED]["compare"]
    cells = {(r["model"], r["condition"]): r for r in rows}
    models = list(dict.fromkeys(r["model"] for r in rows))
    conditions = list(dict.fromkeys(r["condition"] for r in rows))
    return {"cells": cells, "models": models, "conditions": conditions}


def _worth(found: SpecimenResults) -> dict[str, Any]:
    content = found.identified
    cells = {(w["torque"], w["rate"]): w for w in content["worth"]}
    torques = list(dict.fromkeys(w["torque"] for w in content["worth"]))
    rates = list(dict.fromkeys(w["rate"] for w in content["worth"]))

    def seen(torque: str | None, rate: str | None) -> bool:
        cell = cells[torque, rate]
        return bool(cell["samples"] or cell["held_out"])

    # Classes above what was measured at all are left out; an empty one between stays.
    torques = _till_last(torques, [seen(t, None) for t in torques])
    rates = _till_last(rates, [seen(None, r) for r in rates])
    widest = max((w["band_Nm"] or 0.0 for w in content["worth"]), default=0.0)
    scale, most = content["full_scale_Nm"], content["domain"]["omega_max_rad_s"]
    return {
        "classes": cells,
        "torques": list(zip(torques, [None, *_spans(TORQUE_EDGES, scale)], strict=False)),
        "rates": list(zip(rates, [None, *_spans(RATE_EDGES, most)], strict=False)),
        "widest": widest,
    }


def _till_last(names: list[Any], seen: list[bool]) -> list[Any]:
    return names[: max((i + 1 for i, x in enumerate(seen) if x), default=0)]


def _spans(edges: Sequence[float], scale: float) -> list[tuple[float, float | None]]:
    ends = [scale * e if math.isfinite(e) else None for e in edges[1:]]
    return [(scale * a, b) for a, b in zip(edges[:-1], ends, strict=True)]


def _lived(found: SpecimenResults) -> dict[str, Any]:
    one = found.coupling
    if one is None:
        return {"one": None}
    width = one["width_rad"]
    classes = [(k * width, (k + 1) * width, h / 2) for k, h in enumerate(one["halves"]) if h]
    return {"one": one, "ranges": classes, "cycles": sum(one["halves"]) / 2}


SECTIONS = (
    PageSection("identification/notes", "Notes"),
    PageSection("specimen/loops", "Loops", shown=_loops),
    PageSection("identification/errors", "Errors"),
    PageSection("specimen/parameters", "Parameters", shown=_parameters),
    PageSection("specimen/models", "Model choice", shown=_models),
    PageSection("specimen/worth", "What the torque is worth", shown=_worth),
    PageSection("specimen/reliability", "Reliability"),
    PageSection("specimen/life", "Life used", shown=_lived),
    PageSection("specimen/files", "Files"),
)
