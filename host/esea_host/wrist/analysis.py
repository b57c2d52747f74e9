"""The wrist study's tables from recordings, beside the published ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_host.statistics import NoStatisticError, holm, signed_rank
from esea_host.study.exchange import omissions, veiled_names
from esea_host.study.folder import StudyFolder
from esea_host.study.log import well_formed

Row = Mapping[str, Any]
Array = npt.NDArray[np.float64]
PADDED = 16  # a spectrum of some seconds is coarse: transformed over so many times its length
LEAST_PEAK = 0.25  # below this share of the largest, peaks are corrections, not movements
TARGETS = 15  # of an axis in a block
Values = Mapping[str, float | None]


@dataclass(frozen=True)
class TableComparison:
    """A line of a published table: names of either side's value, their medians, and p."""

    metric: str
    unit: str
    first: str
    second: str
    medians: tuple[float | None, float | None]
    p: float | None


@dataclass(frozen=True)
class StudyTable:
    """A published table; rms: its RMS speed error, which has one side."""

    sides: tuple[str, str]
    lines: tuple[TableComparison, ...]
    rms: float | None = None


HEALTHY, CONSTRAINED = "healthy", "constrained"
TRACKED = (
    ("dominant frequency", "Hz", "frequency_h_Hz", "frequency_c_Hz"),
    ("amplitude there", "deg/s", "amplitude_h_deg_s", "amplitude_c_deg_s"),
    ("peak speed", "deg/s", "peak_h_deg_s", "peak_c_deg_s"),
)
LEARNED = tuple(
    (metric, unit, f"{name} 1", f"{name} 2")
    for metric, unit, name in (
        ("FE targets achieved", f"of {TARGETS}", "achieved_FE"),
        ("FE SSE", "deg^2", "sse_FE_deg2"),
        ("RU targets achieved", f"of {TARGETS}", "achieved_RU"),
        ("RU SSE", "deg^2", "sse_RU_deg2"),
        ("after-effect", "deg", "after_effect_deg"),
    )
)


def _lines(
    measured: Sequence[tuple[str, str, str, str]], *published: tuple[float, float, float]
) -> tuple[TableComparison, ...]:
    each = zip(measured, published, strict=True)
    return tuple(TableComparison(*m, (first, second), p) for m, (first, second, p) in each)


# Thesis tables 7.1 to 7.4: medians of either side, and the p values in its text.
RU_TRACKED, FE_TRACKED = "7.1 validation, RU", "7.2 validation, FE"
SESSIONS, STATES = "7.3 sessions", "7.4 states"
TABLES = {
    RU_TRACKED: StudyTable(
        (HEALTHY, CONSTRAINED),
        _lines(TRACKED, (0.24, 0.24, 0.50), (37.6, 34.5, 0.0098), (51.2, 47.3, 0.027)),
        21.0,
    ),
    FE_TRACKED: StudyTable(
        (HEALTHY, CONSTRAINED),
        _lines(TRACKED, (0.21, 0.22, 0.75), (69.6, 66.6, 0.19), (95.0, 91.8, 0.32)),
        22.1,
    ),
    SESSIONS: StudyTable(
        ("session 1", "session 2"),
        _lines(
            LEARNED,
            *((11.0, 11.0, 0.89), (746.6, 694.4, 0.15), (9.5, 10.5, 0.94)),
            *((813.9, 697.9, 0.20), (-4.65, -4.31, 0.74)),
        ),
    ),
    STATES: StudyTable(
        (HEALTHY, CONSTRAINED),
        _lines(
            LEARNED,
            *((12.5, 10.0, 0.016), (734.6, 706.4, 0.55), (11.0, 9.0, 0.16)),
            *((879.9, 697.9, 0.15), (-4.50, -4.31, 0.74)),
        ),
    ),
}


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
    """Everything that the analysis gives.

    blinded: states have neutral names, in an order that only the study's key tells.
    """

    simulated: bool
    participants: int
    tables: Mapping[str, tuple[TableLine, ...]]
    people: Mapping[str, Mapping[str, Values]]
    sides: Mapping[str, tuple[str, str]]
    blinded: bool = False
    left_out: tuple[str, ...] = ()


def analyse(folder: Path, blinded: bool = False) -> WristResult:
    study = StudyFolder.open(folder, durable=False, runs=False)
    blinded = blinded or any(study.blinded(role) for role in ("operator", "analyst"))
    left_out = tuple(omissions(study))
    by_code = {c: study.rows(c, strict=False) for c in sorted({s[0] for s in study.sessions()})}
    tracked, learned = {}, {}
    for code, rows in by_code.items():
        with well_formed(folder / code):
            tracked[code], learned[code] = _tracked(rows), _learned(rows)
    if not any(tracked.values()) and not any(learned.values()):
        raise UserError(
            f"{folder} holds no completed trial of the wrist study.", "Run a session of it first."
        )
    people: dict[str, dict[str, Values]] = {
        title: {c: found[axis] for c, found in tracked.items() if axis in found}
        for title, axis in ((RU_TRACKED, "RU"), (FE_TRACKED, "FE"))
    }
    tested, sides = dict(TABLES), {title: table.sides for title, table in TABLES.items()}
    swapped = False
    if blinded:
        names = veiled_names(study)
        order = sorted(names, key=names.__getitem__)
        swapped = order != [HEALTHY, CONSTRAINED]
        sides[STATES] = (names[order[0]], names[order[1]])
        # Beside the published medians one could tell which is which.
        lines = TABLES[STATES].lines
        tested[STATES] = replace(
            TABLES[STATES], lines=tuple(replace(x, medians=(None, None), p=None) for x in lines)
        )
    # The two sides of a session's values: its number, and whether it was constrained.
    for title, side in ((SESSIONS, lambda x: x[0]), (STATES, lambda x: int(x[1] != swapped))):
        people[title] = {
            code: {f"{k} {side(x) + 1}": v for x in found for k, v in x[2].items()}
            for code, found in learned.items()
            if found
        }
    tables = {title: _tested(table, people[title]) for title, table in tested.items()}
    return WristResult(study.simulated, len(by_code), tables, people, sides, blinded, left_out)


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
    parts = ([r for r in own if r["session"] == s] for s in sorted({r["session"] for r in own}))
    return [(p[0]["session"], bool(p[0]["impairment"]), learning(p)) for p in parts]


def _tested(table: StudyTable, values: Mapping[str, Values]) -> tuple[TableLine, ...]:
    found = [_line(w, values) for w in table.lines]
    tested = {k: x.p for k, x in enumerate(found) if x.p is not None}
    for k, p in zip(tested, holm(list(tested.values())) if tested else (), strict=True):
        found[k] = replace(found[k], p_holm=float(p))
    if table.rms is not None:
        found.append(_rms(values, table.rms))
    return tuple(found)


def _line(w: TableComparison, values: Mapping[str, Values]) -> TableLine:
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
        return replace(known, p=1.0, note=str(error))  # counts in the family of Holm
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
    known = [x for v in values.values() if (x := v["rms_error_percent"]) is not None]
    return TableLine(
        "RMS speed error of the peak",
        "%",
        len(known),
        second=float(np.median(known)) if known else None,
        published=(None, published),
        note="one value a person: nothing to compare",
    )


# -- of one participant ---------------------------------------------------------------------------


def speed(time_s: npt.ArrayLike, x_deg: npt.ArrayLike) -> tuple[Array, float]:
    """Speed at equal steps, deg/s, and the step."""
    t, x = np.asarray(time_s, np.float64), np.asarray(x_deg, np.float64)
    step = float(t[-1] - t[0]) / (len(t) - 1)
    even = t[0] + step * np.arange(len(t))
    return np.asarray(np.gradient(np.interp(even, t, x), step)), step


def dominant(values: Array, step_s: float) -> tuple[float, float]:
    """Frequency of the largest component, Hz, and its amplitude."""
    n = len(values)
    spectrum = 2.0 / n * np.abs(np.fft.rfft(values - np.mean(values), PADDED * n))
    k = int(np.argmax(spectrum))
    return k / (PADDED * n * step_s), float(spectrum[k])


def median_peak(values: Array) -> float:
    """Median of the peaks of the magnitude, one between two changes of sign."""
    edges = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1])) + 1
    peaks = np.array([np.max(np.abs(part)) for part in np.split(values, edges) if len(part)])
    return float(np.median(peaks[peaks >= LEAST_PEAK * np.max(peaks)]))


def tracking(row: Row) -> dict[str, float]:
    healthy, step = speed(row["time_s"], row["target_deg"])
    shown, _ = speed(row["time_s"], row["cursor_deg"])
    h, c = dominant(healthy, step), dominant(shown, step)
    rms = float(np.sqrt(np.mean((healthy - shown) ** 2)))
    return {
        "frequency_h_Hz": h[0],
        "frequency_c_Hz": c[0],
        "amplitude_h_deg_s": h[1],
        "amplitude_c_deg_s": c[1],
        "peak_h_deg_s": median_peak(healthy),
        "peak_c_deg_s": median_peak(shown),
        "rms_error_percent": 100.0 * rms / float(np.max(np.abs(healthy))),
    }


def after_effect_deg(row: Row, pulls_away: bool) -> float:
    """On a standing target, how far beyond it, or away first; negative as published."""
    if pulls_away:
        return float(row["nearest_deg"] - row["distance_deg"])
    return float(min(row["distance_deg"] - row["furthest_deg"], 0.0))


def learning(rows: Sequence[Row]) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    blocks = list(dict.fromkeys(r["block"] for r in rows))
    for axis in ("FE", "RU"):
        counts, errors = [], []
        for block in blocks:
            own = [r for r in rows if r["block"] == block and r["axis"] == axis and not r["catch"]]
            caught = [r["sse_deg2"] for r in own if r["achieved"]]
            if own:  # of a block that was cut short, the share of those shown
                counts.append(TARGETS * len(caught) / len(own))
            if caught:
                errors.append(float(np.median(caught)))
        found[f"achieved_{axis}"] = float(np.median(counts)) if counts else None
        found[f"sse_{axis}_deg2"] = float(np.median(errors)) if errors else None
    catch = [r for r in rows if r["catch"]]
    moving = [r for r in rows if not r["catch"]]
    pulls = bool(moving) and float(np.mean([r["pulled_away"] for r in moving])) > 0.5
    effects = [after_effect_deg(r, pulls) for r in catch]
    found["after_effect_deg"] = float(np.median(effects)) if effects else None
    return found
