"""The page of an identification: parameters, how sure they are, and how well they fit."""

from __future__ import annotations

from typing import Any

import numpy as np

from esea_gen.devices.fields import field_facts
from esea_gen.emit.build import device_hash
from esea_gen.identify import Identification
from esea_gen.model.elastomer import RATE_KEYS
from esea_gen.report import figures
from esea_gen.report.page import finite, render


def identification_page(result: Identification) -> str:
    """The page of an identification, one self-contained file."""
    content = finite(result.to_dict())
    device = result.device
    parameters = [
        {"key": key, "meaning": field_facts(_dotted(key))["text"], **p}
        for key, p in content["parameters"].items()
    ]
    assumed = [
        {"key": key, "value": q.value, "status": q.status, "source": q.source}
        for key, q in device.quantities()
        if q.status == "assumed"
    ]
    points = figures.POINTS_PER_PAGE // (2 * max(len(result.series), 4))
    plots = []
    traces = [_trace(result, label, series) for label, series in result.series.items()]
    shared = figures.share_loops(traces)
    for i, trace in enumerate(traces):
        plots.append(
            {
                "label": trace.label,
                "parts": len((shared or trace).parts),
                "shared": shared is not None,
                "most": figures.MOST_PANELS,
                # A shared figure stands with the first recording.
                "loops": figures.loops(shared or trace, f"loops{i}", points)
                if shared is None or i == 0
                else "",
                "time": figures.over_time(trace, f"time{i}", points, result.full_scale_Nm, None),
                "held_out": trace.held_out is not None,
            }
        )
    direction = content["uncertainty"]["weakest"] or {}
    return render(
        "report/identification.html.j2",
        title=device.title,
        r=content,
        content_hash=device_hash(device),
        parameters=parameters,
        assumed=assumed,
        weakest=sorted((direction.get("direction") or {}).items(), key=lambda kv: -abs(kv[1])),
        weakest_change=direction.get("rms_change_Nm"),
        bounds_hit=[p for p in parameters if p["at_bound"]],
        spread=figures.spread([(p["key"], p["value"], p["sigma"]) for p in parameters], "spread"),
        plots=plots,
    )


def _dotted(key: str) -> str:
    return f"elastomer.maxwell.{key}" if key in RATE_KEYS else f"elastomer.{key}"


def _trace(result: Identification, label: str, series: dict[str, Any]) -> figures.Curve:
    recording = next(r for r in result.recordings if r.label == label)
    parts = [
        (
            f"{s.label}, amplitude {np.degrees(s.amplitude_rad):.3g}°",
            np.sort(np.concatenate([s.training, s.held_out])),
        )
        for s in recording.sets
    ]
    if len(parts) != 1 or len(parts[0][1]) != len(series["time_s"]):
        parts.append(("whole recording", np.arange(len(series["time_s"]))))
    held = series["role"] == 2
    return figures.Curve(
        label,
        series["time_s"],
        series["theta_rad"],
        series["tau_model_Nm"],
        series["tau_Nm"],
        tuple(parts),
        held if held.any() and not held.all() else None,
        "identified model (C, float64)",
    )


__all__ = ["identification_page"]
