"""The wrist study's tables from recordings, beside the published ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_host.statistics import NoStatisticError, holm, signed_rank
from esea_host.study.folder import StudyFolder
from esea_host.study.log import well_formed
from esea_host.wrist.metrics import learning, tracking

Row = Mapping[str, Any]
Values = Mapping[str, float | None]


@dataclass(frozen=True)
class Wanted:
    metric: str
    unit: str
    first: str
    second: str
    medians: tuple[float | None, float | None]
    p: float | None


# Thesis tables 7.1 to 7.4 and the p values in its text.
TRACKED = (
    ("dominant frequency", "Hz", "frequency_h_Hz", "frequency_c_Hz"),
    ("amplitude there", "deg/s", "amplitude_h_deg_s", "amplitude_c_deg_s"),
    ("peak speed", "deg/s", "peak_h_deg_s", "peak_c_deg_s"),
)
TRACKED_PUBLISHED = {
    "7.1 validation, RU": (((0.24, 0.24), 0.50), ((37.6, 34.5), 0.0098), ((51.2, 47.3), 0.027)),
    "7.2 validation, FE": (((0.21, 0.22), 0.75), ((69.6, 66.6), 0.19), ((95.0, 91.8), 0.32)),
}
RMS_PUBLISHED = {"7.1 validation, RU": 21.0, "7.2 validation, FE": 22.1}
LEARNED = (
    ("FE targets achieved", "of 15", "achieved_FE"),
    ("FE SSE", "deg^2", "sse_FE_deg2"),
    ("RU targets achieved", "of 15", "achieved_RU"),
    ("RU SSE", "deg^2", "sse_RU_deg2"),
    ("after-effect", "deg", "after_effect_deg"),
)
SESSIONS_PUBLISHED = (
    *(((11.0, 11.0), 0.89), ((746.6, 694.4), 0.15), ((9.5, 10.5), 0.94)),
    *(((813.9, 697.9), 0.20), ((-4.65, -4.31), 0.74)),
)
STATES_PUBLISHED = (
    *(((12.5, 10.0), 0.016), ((734.6, 706.4), 0.55), ((11.0, 9.0), 0.16)),
    *(((879.9, 697.9), 0.15), ((-4.50, -4.31), 0.74)),
)


@dataclass(frozen=True)
class TableLine:
    """n: people with both values; p_holm: over its table; note: why there is no test."""

    metric: str
    unit: str
    n: int
    first: float | None = None
    second: float | None = None
    p: float | None = None
    p_holm: float | None = None
    method: str = "none"
    zeros: int = 0
    effect: float | None = None
    effect_low: float | None = None
    effect_high: float | None = None
    published: tuple[float | None, float | None] = (None, None)
    published_p: float | None = None
    note: str = ""


@dataclass(frozen=True)
class WristResult:
    """Everything that the analysis gives."""

    simulated: bool
    participants: int
    tables: Mapping[str, tuple[TableLine, ...]]
    people: Mapping[str, Mapping[str, Values]]
    sides: Mapping[str, tuple[str, str]]

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def analyse(folder: Path) -> WristResult:
    study = StudyFolder.open(folder, durable=False, runs=False)
    simulated = study.simulated
    codes = sorted({c for c, _, _ in study.sessions()})
    by_code = {c: study.rows(c, strict=False) for c in codes}
    tracked, learned = {}, {}
    for code, rows in by_code.items():
        with well_formed(folder / code):
            tracked[code], learned[code] = _tracked(rows), _learned(rows)
    if not any(tracked.values()) and not any(learned.values()):
        raise UserError(
            f"{folder} holds no completed trial of the wrist study.", "Run a session of it first."
        )
    tables: dict[str, tuple[TableLine, ...]] = {}
    sides: dict[str, tuple[str, str]] = {}
    people: dict[str, Mapping[str, Values]] = {}
    for title, tracks in TRACKED_PUBLISHED.items():
        axis = title[-2:]
        values = {c: t[axis] for c, t in tracked.items() if axis in t}
        lines = [
            Wanted(m, unit, a, b, medians, p)
            for (m, unit, a, b), (medians, p) in zip(TRACKED, tracks, strict=True)
        ]
        table = _tested(lines, values)
        tables[title] = (*table, _rms(values, RMS_PUBLISHED[title]))
        sides[title], people[title] = ("healthy", "constrained"), values
    for title, keys, names, published in (
        ("7.3 sessions", (0, 1), ("session 1", "session 2"), SESSIONS_PUBLISHED),
        ("7.4 states", (False, True), ("healthy", "constrained"), STATES_PUBLISHED),
    ):
        values = {c: _two(found, keys) for c, found in learned.items() if found}
        lines = [
            Wanted(m, unit, f"{k} 1", f"{k} 2", medians, p)
            for (m, unit, k), (medians, p) in zip(LEARNED, published, strict=True)
        ]
        tables[title] = _tested(lines, values)
        sides[title], people[title] = names, values
    return WristResult(simulated, len(by_code), tables, people, sides)


def _tracked(rows: Sequence[Row]) -> dict[str, Values]:
    # Per axis the medians over the trials.
    found: dict[str, Values] = {}
    for axis in ("FE", "RU"):
        trials = [tracking(r) for r in rows if r["task"] == "wrist.track" and r["axis"] == axis]
        if trials:
            found[axis] = {k: float(np.median([t[k] for t in trials])) for k in trials[0]}
    return found


def _learned(rows: Sequence[Row]) -> list[tuple[int, bool, Values]]:
    # Session, whether it was constrained, and its values.
    own = [r for r in rows if r["task"] == "wrist.catch" and not r["familiarisation"]]
    found: list[tuple[int, bool, Values]] = []
    for session in sorted({r["session"] for r in own}):
        part = [r for r in own if r["session"] == session]
        found.append((session, bool(part[0]["impairment"]), learning(part)))
    return found


def _two(found: Sequence[tuple[int, bool, Values]], keys: tuple[Any, Any]) -> Values:
    by_session = isinstance(keys[0], int) and not isinstance(keys[0], bool)
    out: dict[str, float | None] = {}
    for session, constrained, values in found:
        own = session if by_session else constrained
        side = keys.index(own) + 1
        out |= {f"{k} {side}": v for k, v in values.items()}
    return out


def _tested(lines: Sequence[Wanted], values: Mapping[str, Values]) -> tuple[TableLine, ...]:
    found = [_line(w, values) for w in lines]
    tested = {k: x.p for k, x in enumerate(found) if x.p is not None}
    for k, p in zip(tested, holm(list(tested.values())) if tested else (), strict=True):
        found[k] = replace(found[k], p_holm=float(p))
    return tuple(found)


def _line(w: Wanted, values: Mapping[str, Values]) -> TableLine:
    pairs = [(v.get(w.first), v.get(w.second)) for v in values.values()]
    both = np.array([(a, b) for a, b in pairs if a is not None and b is not None], np.float64)
    known = TableLine(w.metric, w.unit, len(both), published=w.medians, published_p=w.p)
    if not len(both):
        return replace(known, note="nobody has both values")
    medians = np.median(both, axis=0)
    known = replace(known, first=float(medians[0]), second=float(medians[1]))
    try:
        test = signed_rank(both[:, 0], both[:, 1])
    except NoStatisticError as error:
        return replace(known, note=str(error))
    return replace(
        known,
        p=test.p,
        method=f"Wilcoxon signed-rank, {test.method}; zero differences: {test.zero_method}",
        zeros=test.zeros,
        effect=test.rank_biserial,
        effect_low=test.rank_biserial_low,
        effect_high=test.rank_biserial_high,
    )


def _rms(values: Mapping[str, Values], published: float) -> TableLine:
    each = [v["rms_error_percent"] for v in values.values()]
    known = [x for x in each if x is not None]
    return TableLine(
        "RMS speed error of the peak",
        "%",
        len(known),
        second=float(np.median(known)) if known else None,
        published=(None, published),
        note="one value a person: nothing to compare",
    )
