"""The thesis, recomputed: every table and figure of chapters 3 to 8 beside ours, with a verdict."""

from __future__ import annotations

import math
import textwrap
import tomllib
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

from matplotlib.figure import Figure

from esea_gen import __version__
from esea_gen.errors import UserError
from esea_gen.files import read_json
from esea_gen.reproduce.measures import Measures
from esea_gen.studies.registry import Reproduction

# A word that only one command writes at the top of its file.
MARKS = {"comparisons": "interaction", "tables": "wrist", "motions": "assess"}
FIX = "Give what esea-host study virtual interaction, ... wrist or esea-host assess evaluate wrote."
COUNT = "number of virtual people"
MEASURED = {"interaction": "interaction", "wrist": "wrist", "assessment": "assess"}
TABLES = {
    "wrist_ru": "7.1 validation, RU",
    "wrist_fe": "7.2 validation, FE",
    "wrist_sessions": "7.3 sessions",
    "wrist_states": "7.4 states",
}
SIDES = {
    "interaction_blocks": {"block 1": "block_1", "block 2": "block_2"},
    "interaction_devices": {"spring": "spring", "elastomer": "elastomer"},
}


@dataclass(frozen=True)
class HostResults:
    found: dict[str, dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def read(cls, paths: Sequence[Path]) -> HostResults:
        found: dict[str, dict[str, Any]] = {}
        for path in paths:
            content = read_json(path, FIX)
            content = content if isinstance(content, dict) else {}
            kinds = [kind for mark, kind in MARKS.items() if mark in content]
            if not kinds:
                raise UserError(f"{path}: not a result of the host's studies.", FIX)
            if content.get("simulated") is False:
                raise UserError(f"{path}: people took part in it, not simulated ones.", FIX)
            found[kinds[0]] = content
        return cls(found)

    def __call__(self, name: str) -> dict[str, float] | None:
        """Numbers of a measure; None where its file was not given."""
        content = self.found.get(MEASURED[name.split("_", maxsplit=1)[0]])
        if content is None:
            return None
        try:
            if name in SIDES:
                return _medians(content, SIDES[name])
            if name in TABLES:
                return _lines(content, TABLES[name])
            return _assessed(content)
        except (KeyError, TypeError, AttributeError) as error:
            raise UserError(f"a result of {name}: without {error}.", FIX) from None


def _medians(content: dict[str, Any], sides: dict[str, str]) -> dict[str, float]:
    found = {
        f"{c['task']} {c['metric']} {shown}": float(c["thesis_medians"][key])
        for c in content["comparisons"]
        for shown, key in sides.items()
    }
    return found | {COUNT: len(content["people"])}


def _lines(content: dict[str, Any], table: str) -> dict[str, float]:
    found = {}
    sides = content["sides"][table]
    for line in content["tables"][table]:
        for side, value in zip(sides, (line["first"], line["second"]), strict=True):
            if value is not None:
                found[f"{line['metric']} {side} / {line['unit']}"] = float(value)
    return found | {COUNT: content["participants"]}


def _assessed(content: dict[str, Any]) -> dict[str, float]:
    words = {"expected": "by expected information", "thesis": "as published", "random": "at random"}
    found = {}
    for way, text in words.items():
        found[f"movements to 95 %, {text}"] = float(content["motions"][way]["mean"])
        found[f"right answers, {text}"] = float(content["ways"][way]["accuracy"])
    return found | {COUNT: content["patients"]["inside"]}


Kind = Literal["numbers", "inputs", "claims", "drawn", "people", "data", "plain"]
REPRODUCED = "reproduced"
TAKEN = "taken over"
DIFFERS = "differs"
UNEXPLAINED = "differs, unexplained"
NOT_RUN = "not run here"
WORDS = {
    "drawn": "drawn again",
    "people": "not reproducible; simulated beside it",
    "data": "not reproducible",
    "plain": "nothing to compute",
}


@dataclass(frozen=True)
class Printed:
    id: str
    title: str
    kind: Kind
    command: str = ""
    measure: str = ""  # of `Measures`; of the host's tools where it begins with ``host.``
    unit: str = ""
    published: Mapping[str, float] = field(default_factory=dict)
    within: float = 0.0  # share by which ours may miss, as reproduced
    most: float = 0.0  # the same, with ``because``
    least: float = math.inf  # how often a claim holds at least, with ``because``
    because: str = ""
    says: str = ""  # of a claim: section and words of the thesis
    simulated: bool = False

    @property
    def chapter(self) -> int:
        return int(self.id.split()[1].split(".")[0])


@dataclass(frozen=True)
class Misprint:
    place: str
    printed: str
    meant: str
    measure: str = ""

    @property
    def chapter(self) -> int:
        return int(self.place.removeprefix("Table ").lstrip("(")[0])


@dataclass(frozen=True)
class VerdictOn:
    printed: Printed
    verdict: str
    why: str
    ours: Mapping[str, float] = field(default_factory=dict)
    off: Mapping[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        p = self.printed
        rows = [
            {"name": n, "published": p.published.get(n), "ours": self.ours.get(n)}
            | {"off": self.off.get(n)}
            for n in dict.fromkeys([*p.published, *self.ours])
        ]
        printed = {k: getattr(p, k) for k in ("id", "chapter", "title", "unit", "command", "says")}
        simulated = p.simulated and bool(self.ours)
        own = {"verdict": self.verdict, "why": self.why, "rows": rows, "simulated": simulated}
        return printed | own


@cache
def published() -> tuple[tuple[Printed, ...], tuple[Misprint, ...]]:
    text = (Path(__file__).parent / "published.toml").read_text(encoding="utf-8")
    found = tomllib.loads(text)
    items = tuple(Printed(**entry) for entry in found["item"])
    return items, tuple(Misprint(**entry) for entry in found["misprint"])


def judge_printed(p: Printed, ours: Mapping[str, float] | None) -> VerdictOn:
    if p.kind in WORDS:
        absent = f" ({NOT_RUN})" if p.measure and ours is None else ""
        return VerdictOn(p, WORDS[p.kind] + absent, p.because, ours or {})
    if ours is None:
        return VerdictOn(p, NOT_RUN, "")
    if p.kind == "claims":
        return _claims(p, ours)
    off = {n: _off(ours[n], x) for n, x in p.published.items()}
    worst = max(off.values())
    good = sum(x <= p.within for x in off.values())
    if p.kind == "inputs":
        told = "our code runs with these numbers" if good == len(off) else "not as printed"
        why = "; ".join(filter(None, [told, p.because]))
        return VerdictOn(p, TAKEN if good == len(off) else UNEXPLAINED, why, ours, off)
    if good == len(off):
        return VerdictOn(p, REPRODUCED, f"within {_percent(worst)}", ours, off)
    told = f"{good} of {len(off)} within {_percent(p.within)}, the worst {_percent(worst)} away"
    if p.because and worst <= p.most:
        return VerdictOn(p, DIFFERS, f"{told}: {p.because}", ours, off)
    return VerdictOn(p, UNEXPLAINED, told, ours, off)


def _claims(p: Printed, ours: Mapping[str, float]) -> VerdictOn:
    missed = {n: ours[n] for n, x in p.published.items() if ours[n] != x}
    if not missed:
        return VerdictOn(p, REPRODUCED, p.because, ours)
    told = "; ".join(f"{n}: {x:g}" for n, x in missed.items())
    if p.because and min(missed.values()) >= p.least:
        return VerdictOn(p, DIFFERS, f"{told}: {p.because}", ours)
    return VerdictOn(p, UNEXPLAINED, told, ours)


def _off(ours: float, printed: float) -> float:
    if printed == 0:
        return 0.0 if ours == 0 else math.inf
    return abs(ours / printed - 1)


def _percent(share: float) -> str:
    return f"{100 * share:.{0 if share >= 0.1 else 1}f} %"


CHAPTERS = (3, 4, 5, 6, 7, 8)
NOTE = (
    "No machine and no person took part in what is computed here. Chapter 5 is simulated: the "
    "controllers' generated C against a virtual exoskeleton; chapters 6 to 8: virtual people. What "
    "the thesis measured on specimens and people cannot be recomputed, for the recordings are not "
    "published."
)


@dataclass(frozen=True)
class Recomputed:
    judged: tuple[VerdictOn, ...]
    misprints: tuple[tuple[Misprint, Mapping[str, float]], ...]

    def counts(self) -> Counter[str]:
        return Counter(j.verdict for j in self.judged)

    @property
    def explained(self) -> bool:
        return not any(j.verdict == UNEXPLAINED for j in self.judged)

    def to_dict(self) -> dict[str, Any]:
        return {
            "tool": f"esea-gen {__version__}",
            "note": NOTE,
            "counts": dict(self.counts()),
            "items": [j.to_dict() for j in self.judged],
            "misprints": [{**vars(m), "numbers": dict(n)} for m, n in self.misprints],
        }

    def table(self) -> list[str]:
        lines = ["The thesis, recomputed", *textwrap.wrap(NOTE, 100), ""]
        for j in self.judged:
            mark = " SIMULATED" if j.printed.simulated and j.ours else ""
            lines.append(f"{j.printed.id:12} {j.verdict}{mark}: {j.printed.title}")
            if j.verdict in (REPRODUCED, TAKEN, DIFFERS, UNEXPLAINED) and j.why:
                lines.append(f"{'':14}{j.why}")
            if j.printed.command and j.verdict in (DIFFERS, UNEXPLAINED, NOT_RUN):
                lines.append(f"{'':14}{j.printed.command}")
        counts = ", ".join(f"{n} {verdict}" for verdict, n in self.counts().most_common())
        unclear = (
            f"{len(self.misprints)} misprints and unclear readings; --page FILE has all of it."
        )
        return [*lines, "", f"{len(self.judged)} tables and figures: {counts}.", unclear]

    def figure(self) -> Figure:
        figure = Figure(figsize=(9, 5.5), layout="constrained")
        ax = figure.subplots()
        shown = [j for j in self.judged if j.printed.kind == "numbers" and j.off]
        for k, j in enumerate(shown):
            ratio = [j.ours[n] / x for n, x in j.printed.published.items() if x]
            ax.plot(ratio, [k] * len(ratio), "o", markersize=5, alpha=0.7)
            ax.text(1.02, k, j.verdict, transform=ax.get_yaxis_transform(), va="center", fontsize=8)
        ax.axvline(1.0, color="0.5", linewidth=0.8)
        ax.set_yticks(range(len(shown)), [j.printed.id for j in shown])
        ax.invert_yaxis()
        ax.set_xlabel("ours / published")
        ax.set_title("Numbers of the thesis, recomputed (figure 5.5 simulated)", fontsize="medium")
        ax.grid(axis="x", alpha=0.3)
        return figure


def recompute(
    say: Callable[[str], None] | None = None,
    *,
    chapters: Collection[int] = CHAPTERS,
    given: Sequence[Path] = (),
) -> Recomputed:
    host = HostResults.read(given)
    measures = Measures(say or (lambda _: None))
    items, misprints = published()
    judged = []
    for p in items:
        if p.chapter not in chapters:
            continue
        if p.measure.startswith("host."):
            ours = host(p.measure.removeprefix("host."))
        else:
            ours = measures(p.measure) if p.measure else None
        judged.append(judge_printed(p, ours))
    wrong = [m for m in misprints if m.chapter in chapters]
    shown = tuple((m, measures(m.measure) if m.measure else {}) for m in wrong)
    return Recomputed(tuple(judged), shown)


class WholeThesis(Reproduction[Recomputed]):
    """Every table and figure of chapters 3 to 8 beside ours, each with a verdict."""

    name = "all"
    title = "The thesis, recomputed"

    def run(self, say: Callable[[str], None], folder: Path | None) -> Recomputed:
        return recompute(say)

    def reproduced(self, outcome: Recomputed) -> bool:
        return outcome.explained
