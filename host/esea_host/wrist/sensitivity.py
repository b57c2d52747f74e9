"""Sensitivity of the wrist study's conclusions to the model of people.  Simulated.

The study is run again with one number of :class:`~esea_host.people.person.PersonModel` at either
end of its range, the same people otherwise: same seed, same order of trials.
"""

from __future__ import annotations

import html
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure

from esea_gen.files import write_whole
from esea_gen.pages import plain_page
from esea_gen.plotting import INK, STYLE, svg
from esea_host.people.person import PersonModel
from esea_host.study.protocol import parse_protocol
from esea_host.wrist.analysis import FE_TRACKED, RU_TRACKED, STATES, WristResult, analyse
from esea_host.wrist.calibration import METHODS
from esea_host.wrist.virtual import PROTOCOL, run_study

EARLY = "early.json"  # sessions of a run that ended early
CLEAR = 0.5  # rank-biserial: three quarters of the ranks go one way


@dataclass(frozen=True)
class PersonSpan:
    """The range of a number of the model of people, and whose it is."""

    name: str
    field: str
    low: Any
    high: Any
    source: str = "assumed"


SMOOTH = "J. Saunders, D. Knill, Experimental Brain Research 162, 2005: direction, distance"
PINCH = "R. Balakrishnan, I. MacKenzie, CHI 1997: from the finger alone to a pinch grip"
PACES = "Marras, Schoenmarklin, 1993; high end assumed"
RANGES = PersonModel().range_deg
SPANS = (
    PersonSpan("correction's delay, 117 to 200 ms", "delay_s", 0.117, 0.200, SMOOTH),
    PersonSpan("accuracy, 3 to 4.5 bits/s", "bits_s", 3.0, 4.5, PINCH),
    PersonSpan("torque's noise, 1 to 10 %", "torque_noise", 0.01, 0.1),
    PersonSpan("contracted muscles, 0.3 to 2 Nm/rad", "contracted_Nm_rad", 0.3, 2.0),
    PersonSpan("reaction, 200 to 350 ms", "reaction_s", 0.2, 0.35),
    PersonSpan(
        "comfortable speed, 29 and 17, or 60 and 40 deg/s",
        *("comfortable_deg_s", (29.0, 17.0), (60.0, 40.0), PACES),
    ),
    PersonSpan("effort, 2 to 4.5 Nm", "effort_Nm", 2.0, 4.5),
    PersonSpan("learning, half to twice", "learn", (0.105, 0.01), (0.42, 0.04)),
    PersonSpan(
        "range, less or more by 20 %",
        "range_deg",
        tuple(0.8 * x for x in RANGES),
        tuple(1.2 * x for x in RANGES),
    ),
)


@dataclass(frozen=True)
class ShiftedRun:
    name: str
    end: str
    source: str
    effects: Mapping[str, float | None]
    changed: tuple[str, ...]
    early: tuple[str, ...]


def effects_of(result: WristResult) -> dict[str, float | None]:
    """Rank-biserial correlation of every comparison of tables 7.1 to 7.4; below 0: grows."""
    found: dict[str, float | None] = {}
    for title, lines in result.tables.items():
        axis = title[-2:] + " " if title.startswith(("7.1", "7.2")) else ""
        for x in lines:
            if not x.note.startswith("one value"):
                even = 0.0 if x.n else None  # people there are, and every difference is 0
                found[f"{title[:3]} {axis}{x.metric}"] = even if x.effect is None else x.effect
    return found


def conclusion(effect: float | None) -> str:
    """Conclusion: more, less, or neither; none if nothing can be compared."""
    if effect is None:
        return "none"
    # The first side less the second: positive means that the second is smaller.
    return "less" if effect >= CLEAR else "more" if effect <= -CLEAR else "neither"


def changed(usual: Mapping[str, float | None], now: Mapping[str, float | None]) -> tuple[str, ...]:
    pairs = ((k, conclusion(usual[k]), conclusion(now.get(k))) for k in usual)
    return tuple(f"{k}: {a} to {b}" for k, a, b in pairs if a != b)


def sensitivity(
    folder: Path,
    participants: int,
    seed: int,
    jobs: int = 1,
    cluster: str | None = None,
    spans: Sequence[PersonSpan] = SPANS,
) -> tuple[ShiftedRun, ...]:
    """Run the study as it is and with each number shifted, one acquisition block a session."""
    text = PROTOCOL.read_text(encoding="utf-8").replace("copies = 3\n", "copies = 1\n")
    protocol = parse_protocol(text.replace("seed = 1\n", f"seed = {seed}\n", 1), PROTOCOL.name)
    plan: list[tuple[str, str, str, Mapping[str, Any]]] = [("as it is", "", "", {})]
    for x in spans:
        ends = (("low", x.low), ("high", x.high))
        plan += [(x.name, end, x.source, {x.field: value}) for end, value in ends]
    found: list[ShiftedRun] = []
    for name, end, source, shift in plan:
        place = folder / "-".join([f"{participants}x{seed}", *shift, end or "usual"])
        if not place.exists():
            model = replace(PersonModel(), **shift)
            begun = place.with_name(place.name + ".begun")
            shutil.rmtree(begun, ignore_errors=True)
            early = run_study(
                begun, participants, seed, jobs, model=model, protocol=protocol, cluster=cluster
            )
            write_whole(begun / EARLY, json.dumps(early))
            begun.rename(place)
        early = json.loads((place / EARLY).read_text(encoding="utf-8"))
        effects = effects_of(analyse(place))
        other = changed(found[0].effects, effects) if found else ()
        found.append(ShiftedRun(name, end, source, effects, other, tuple(early)))
    return tuple(found)


def sensitivity_figure(runs: Sequence[ShiftedRun]) -> Figure:
    keys = list(runs[0].effects)
    values = np.array(
        [[np.nan if r.effects[k] is None else r.effects[k] for k in keys] for r in runs]
    )
    with style.context(STYLE):
        figure = Figure(figsize=(9.0, 0.28 * len(runs) + 2.6), layout="constrained")
        axes = figure.subplots()
        # Not to the ends of the colours: a ring is to be seen on every cell.
        image = axes.imshow(-values, cmap="PuOr", vmin=-1.7, vmax=1.7, aspect="auto")
        axes.grid(visible=False)
        usual = [conclusion(runs[0].effects[k]) for k in keys]
        for row, run in enumerate(runs):
            for column, k in enumerate(keys):
                if conclusion(run.effects[k]) != usual[column]:
                    axes.plot(column, row, "o", mfc="white", mec=INK, ms=8, mew=1.5)
        axes.set_xticks(range(len(keys)), keys, rotation=50, ha="right", fontsize=8)
        names = [f"{r.name}: {r.end}" if r.end else r.name for r in runs]
        axes.set_yticks(range(len(runs)), names, fontsize=8)
        bar = figure.colorbar(image, ax=axes, pad=0.01, ticks=(-1, 0, 1))
        bar.ax.set_ylim(-1, 1)
        bar.ax.set_yticklabels(["all less", "even", "all more"], fontsize=8)
        axes.set_title(
            "simulated participants: constrained against healthy (7.3: session 2 against 1)\n"
            "ring: another conclusion than as it is; empty: nothing to compare",
            fontsize=9,
        )
    return figure


def sensitivity_page(runs: Sequence[ShiftedRun], participants: int) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(r.name)}</td><td>{r.end}</td><td>{html.escape(r.source)}</td>"
        f"<td>{html.escape('; '.join(r.changed)) or '-'}</td></tr>"
        for r in runs[1:]
    )
    return plain_page(
        "Wrist study: sensitivity",
        f"<h1>Sensitivity: {participants} SIMULATED participants</h1>"
        f"<figure>{svg(sensitivity_figure(runs), 's', 'Effects in every run')}</figure>"
        "<div class='table'><table><tr><th>number</th><th>end</th><th>range from</th>"
        f"<th>other conclusions</th></tr>{rows}</table></div>",
    )


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
