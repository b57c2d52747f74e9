"""What was published, and the verdict on it: data in, verdicts out."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

Kind = Literal["numbers", "inputs", "claims", "drawn", "people", "data", "plain"]
REPRODUCED = "reproduced"
TAKEN = "taken over"
DIFFERS = "differs"
UNEXPLAINED = "differs, and nothing says why"
NOT_RUN = "not run here"
WORDS = {
    "drawn": "drawn again",
    "people": "not reproducible; simulated beside it",
    "data": "not reproducible",
    "plain": "nothing to compute",
}


@dataclass(frozen=True)
class Printed:
    """A table or figure of the thesis, or a number of its text."""

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
    simulated: bool = False

    @property
    def chapter(self) -> int:
        return int(self.id.split()[1].split(".")[0])


@dataclass(frozen=True)
class Misprint:
    """What is printed, what is meant, and what shows it."""

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
        return {
            "id": p.id,
            "chapter": p.chapter,
            "title": p.title,
            "verdict": self.verdict,
            "why": self.why,
            "unit": p.unit,
            "rows": rows,
            "simulated": p.simulated and bool(self.ours),
            "command": p.command,
        }


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
        why = "; ".join(filter(None, ["as the thesis says", p.because]))
        return VerdictOn(p, REPRODUCED, why, ours)
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
