"""The thesis, recomputed: every table and figure of chapters 3 to 8 beside ours, with a verdict."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from esea_gen import __version__
from esea_gen.reproduce.catalogue import (
    DIFFERS,
    NOT_RUN,
    REPRODUCED,
    TAKEN,
    UNEXPLAINED,
    Misprint,
    VerdictOn,
    judge_printed,
    published,
)
from esea_gen.reproduce.given import HostResults
from esea_gen.reproduce.measures import Measures
from esea_gen.reproduce.reproduction import Reproduction

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

    def markdown(self) -> str:
        out = ["# The thesis, recomputed", "", NOTE, "", f"Made by esea-gen {__version__}.", ""]
        for chapter in dict.fromkeys(j.printed.chapter for j in self.judged):
            out += [f"## Chapter {chapter}", ""]
            for j in self.judged:
                if j.printed.chapter == chapter:
                    out += _section(j)
        if self.misprints:
            head = "| where | printed | meant | shown by |\n|---|---|---|---|"
            out += ["## Misprints and readings", "", head]
            for m, numbers in self.misprints:
                shown = ", ".join(f"{n}: {x:.4g}" for n, x in numbers.items())
                out.append(f"| {m.place} | {m.printed} | {m.meant} | {shown} |")
        return "\n".join(out).rstrip() + "\n"

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


def _section(j: VerdictOn) -> list[str]:
    p = j.printed
    simulated = " Ours is **simulated**." if p.simulated and j.ours else ""
    why = f": {j.why}" if j.why else ""
    out = [f"### {p.id}: {p.title}", "", f"**{j.verdict}**{why}.{simulated}", ""]
    names = dict.fromkeys([*p.published, *j.ours])
    if names and (j.ours or p.published):
        unit = f" / {p.unit}" if p.unit else ""
        out += [f"| | published{unit} | ours{unit} |", "|---|---|---|"]
        for name in names:
            both = (p.published.get(name), j.ours.get(name))
            cells = ["–" if x is None else f"{x:.4g}" for x in both]
            out.append(f"| {name} | {cells[0]} | {cells[1]} |")
        out.append("")
    if p.command:
        out += [f"`{p.command}`", ""]
    return out


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
