"""Does normalisation do what it is for?  The same virtual people under four methods.  Simulated.

The same people, seeds and order; only the cursor's map in the constrained state differs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from esea_host.wrist.analysis import FE_TRACKED, RU_TRACKED, STATES, WristResult, analyse
from esea_host.wrist.calibration import METHODS
from esea_host.wrist.virtual import run_study

TRACK_KEY = "rms_error_percent"


@dataclass(frozen=True)
class MethodOutcome:
    """One method: medians over people; gaps are healthy less constrained."""

    method: str
    people: int
    refused: tuple[str, ...]
    rms_percent: Mapping[str, float | None]
    peak_ratio: Mapping[str, float | None]
    achieved_gap: Mapping[str, float | None]
    after_effect_gap_deg: float | None


def _median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None


def _gap(result: WristResult, key: str) -> float | None:
    pairs = ((v.get(f"{key} 1"), v.get(f"{key} 2")) for v in result.people[STATES].values())
    return _median([a - b for a, b in pairs if a is not None and b is not None])


def outcome(method: str, folder: Path, refused: list[str]) -> MethodOutcome:
    result = analyse(folder)
    rms, ratio = {}, {}
    for title in (RU_TRACKED, FE_TRACKED):
        axis, people = title[-2:], result.people[title].values()
        rms[axis] = _median([x for x in (v[TRACK_KEY] for v in people) if x is not None])
        pairs = [(v["peak_h_deg_s"], v["peak_c_deg_s"]) for v in people]
        ratio[axis] = _median([c / h for h, c in pairs if h and c is not None])
    whole = [v for v in result.people[STATES].values() if "after_effect_deg 2" in v]
    return MethodOutcome(
        method,
        len(whole),
        tuple(refused),
        rms,
        ratio,
        {a: _gap(result, f"achieved_{a}") for a in ("FE", "RU")},
        _gap(result, "after_effect_deg"),
    )


def compare_methods(
    folder: Path, participants: int, seed: int, jobs: int = 1, cluster: str | None = None
) -> tuple[MethodOutcome, ...]:
    found = []
    for method in METHODS:
        refused = run_study(folder / method, participants, seed, jobs, method, cluster=cluster)
        found.append(outcome(method, folder / method, refused))
    return tuple(found)
