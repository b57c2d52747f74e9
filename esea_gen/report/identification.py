"""The page of an identification: parameters, how sure they are, and how well they fit."""

from __future__ import annotations

from typing import Any

from esea_gen.devices.fields import field_facts
from esea_gen.emit.build import device_hash
from esea_gen.files import plain
from esea_gen.identify import Identification
from esea_gen.identify.family.choice import THESIS
from esea_gen.identify.identified import Identified
from esea_gen.identify.published.space import place_of
from esea_gen.plotting import svg
from esea_gen.report import figures
from esea_gen.report.page import PageSection, render


def identification_page(result: Identified) -> str:
    content = plain(result.to_dict(), null=True) | {"content_hash": device_hash(result.device)}
    model = f'"{content["model"]["member"]}"' if "model" in content else THESIS
    content["command"] = f"esea-gen identify {content['mapping']} --model {model}"
    parameters = [
        {"key": key, "meaning": field_facts(place_of(key))["text"], **p}
        for key, p in content.get("parameters", {}).items()
    ]
    assumed = [(key, q) for key, q in result.device.quantities() if q.status == "assumed"]
    title = f"Identification: {result.device.title}"
    shown = {"title": title, "f": content, "parameters": parameters, "assumed": assumed}
    own = PARAMETERS if isinstance(result, Identification) else TERMS
    sections = (SECTIONS[0], own, *SECTIONS[1:])
    return render(PageSection("identification/head"), sections, result, **shown)


def _uncertainty(result: Identification) -> dict[str, Any]:
    content = plain(result.to_dict(), null=True)
    weakest = content["uncertainty"]["weakest"] or {}
    direction = (weakest.get("direction") or {}).items()
    rows = [(key, p["value"], p["sigma"]) for key, p in content["parameters"].items()]
    ordered = sorted(direction, key=lambda kv: -abs(kv[1]))
    change = weakest.get("rms_change_Nm")
    spread = svg(figures.spread(rows), "spread", "Standard deviations of the parameters")
    return {"weakest": ordered, "weakest_change": change, "spread": spread}


def _torque(result: Identified) -> dict[str, Any]:
    model, torque = "identified model (C, float64)", result.verdict.torque_Nm
    traces = [figures.recorded(r, torque[r.label], model) for r in result.recordings]
    return {"plots": figures.plots(traces, result.full_scale_Nm, [None] * len(traces))}


PARAMETERS = PageSection("identification/parameters", "Parameters", shown=_uncertainty)
TERMS = PageSection("identification/terms", "Terms")
SECTIONS = (
    PageSection("identification/notes", "Notes"),
    PageSection("identification/errors", "Errors"),
    PageSection("identification/torque", "Torque", shown=_torque),
    PageSection("identification/specimen", "Specimen"),
    PageSection("identification/search", "Data and search"),
)
