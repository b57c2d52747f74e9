"""Robustness table: one model mismatch per run, with its picture."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis.campaign import Progress
from esea_gen.analysis.plots import COLOURS, new_figure, styled
from esea_gen.errors import UserError
from esea_gen.plotting import INK
from esea_gen.studies.simulation import Simulation, csv_lines, simulate
from esea_gen.twin.case import Scale, Setting
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.judge import ROUGH_HEADS, ROUGHNESS, rough_cells
from esea_gen.twin.off import off_families

SWINGING_NM = 0.15  # RMS of the elbow's true error above 4 Hz from which a run counts as swinging
ENDINGS = {k: k for k in ("unstable", "swinging", "tripped")}
ENDINGS |= {"fault": "latched", "failed": "failed"}
MEDIANS = ("rms_true_Nm", "rms_above_4Hz_Nm", *ROUGHNESS)


def _by_seed(entries: Sequence[dict[str, Any]], key: str) -> list[float]:
    # Of each plant the mean over the study's cases.
    seeds: dict[Any, list[float]] = {}
    for e in entries:
        if e.get(key) is not None:
            seeds.setdefault(e["seed"], []).append(e[key])
    return [float(np.mean(v)) for v in seeds.values()]


def _swings_Nm(done: Simulation) -> float:
    return SWINGING_NM * Scale.of(controller_device(done.setting.controller)).torque


def _row(done: Simulation) -> dict[str, Any]:
    entries = done.cases()
    family = off_families()[done.setting.off]
    row: dict[str, Any] = {
        "off": family.name,
        "family": family.group,
        "meaning": family.meaning,
        "controller": done.setting.controller,
        "runs": len(entries),
    }
    for key in MEDIANS:
        values = _by_seed(entries, key)
        row[key] = float(np.median(values)) if values else None
        row[f"{key}_worst"] = max(values) if values else None
    row |= {k: sum(bool(e.get(k)) for e in entries) for k in ("unstable", "tripped", "fault")}
    row["swinging"] = sum((e.get("rms_above_4Hz_Nm") or 0) > _swings_Nm(done) for e in entries)
    row["failed"] = sum("failure" in e for e in entries)
    return row


@dataclass(frozen=True)
class OffTable:
    done: tuple[Simulation, ...]

    def rows(self) -> list[dict[str, Any]]:
        return [_row(d) for d in self.done]

    @property
    def sound(self) -> bool:
        return all(d.sound for d in self.done)

    def cases(self) -> list[dict[str, Any]]:
        return [
            {"controller": d.setting.controller} | entry for d in self.done for entry in d.cases()
        ]

    def to_dict(self) -> dict[str, Any]:
        first = self.done[0]
        return {
            "experiment": first.study.name,
            "title": first.study.title,
            "controllers": list(dict.fromkeys(d.setting.controller for d in self.done)),
            "plant": first.setting.plant,
            "person": first.person,
            "format": first.setting.real,
            "simulated": True,
            "seeds": list(first.seeds),
            "off": self.rows(),
            "cases": self.cases(),
        }

    def csv(self) -> str:
        return csv_lines(self.cases())

    def table(self) -> list[str]:
        first = self.done[0]
        seeds = len(first.seeds)
        wide = max(14, *(len(row["controller"]) + 2 for row in self.rows()))
        lines = [
            f"{first.study.title}: plant {first.setting.plant}, person {first.person}, "
            f"simulated; medians over {seeds} plant{'s' if seeds > 1 else ''}, Nm",
            f"{'off':18}{'controller':{wide}}{'RMS true':>10}{'worst':>9}{'above 4 Hz':>12}"
            + "".join(f"{h:>12}" for h in ROUGH_HEADS)
            + "  ended",
        ]
        for row in self.rows():
            cells = [row["rms_true_Nm"], row["rms_true_Nm_worst"], row["rms_above_4Hz_Nm"]]
            numbers = [math.nan if c is None else c for c in cells]
            ends = [f"{row[k]} {text}" for k, text in ENDINGS.items() if row[k]]
            lines.append(
                f"{row['off']:18}{row['controller']:{wide}}"
                + "".join(f"{x:>{w}.4f}" for x, w in zip(numbers, (10, 9, 12), strict=True))
                + "".join(f"{c:>12}" for c in rough_cells(row))
                + f"  {', '.join(ends)}".rstrip()
            )
        if any(row[k] for row in self.rows() for k in ("tripped", "fault")):
            lines.append("errors of runs that tripped or latched include the time after that")
        return lines

    def figure(self) -> Figure:
        return _drawn(self.rows(), {_swings_Nm(d) for d in self.done})


@styled
def _drawn(rows: Sequence[dict[str, Any]], swings_Nm: set[float]) -> Figure:
    names = list(dict.fromkeys(r["off"] for r in rows))
    controllers = list(dict.fromkeys(r["controller"] for r in rows))
    high, tall = 0.8 / len(controllers), 0.09 * len(names) * (1 + len(controllers))
    figure, (left, right) = new_figure(9.6, 1.2 + tall, ncols=2, sharey=True)
    for axes, key in ((left, MEDIANS[0]), (right, MEDIANS[1])):
        for k, controller in enumerate(controllers):
            mine = {r["off"]: r for r in rows if r["controller"] == controller}
            y = np.arange(len(names)) + (k - 0.5 * (len(controllers) - 1)) * high
            # The error of a motor that is off says nothing of the law.
            off = [mine[n]["tripped"] + mine[n]["fault"] > mine[n]["runs"] / 2 for n in names]
            told = [math.nan if mine[n][key] is None else mine[n][key] for n in names]
            x = np.where(off, math.nan, told)
            colour = COLOURS[k % len(COLOURS)]
            axes.barh(y, np.nan_to_num(x), 0.9 * high, color=colour, label=controller)
            gone = y[np.isnan(x)]
            if len(gone):  # a line without points has no place, and upsets the layout
                axes.plot(0 * gone, gone, "x", color=colour, ms=5, clip_on=False)
                label = "most runs tripped or latched" if k == 0 else None
                axes.plot([], [], "x", color=INK, ms=5, label=label)
        axes.grid(visible=False, axis="y")
    left.set_xlabel("RMS true error, N·m")
    right.set_xlabel("of it above 4 Hz, N·m")
    for level in swings_Nm:
        right.axvline(level, color=INK, lw=1, ls=(0, (4, 2)), label="swinging")
    for axes, least in ((left, 0.1), (right, 1.1 * max(swings_Nm))):
        axes.set_xlim(0, max(least, axes.get_xlim()[1]))
    left.set_yticks(range(len(names)), names)
    left.set_ylim(len(names) - 0.4, -0.6)
    handles, labels = right.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=5)
    return figure


def simulate_off(
    study: str, settings: Sequence[Setting], *, progress: Progress | None = None, **how: Any
) -> Simulation | OffTable:
    """Run a study in settings that differ in controller and family; ``how`` as of `simulate`."""
    if not settings:
        raise UserError("No setting is given.", "Give one or more.")
    if len(settings) == 1:
        return simulate(study, settings[0], progress=progress, **how)
    done: list[Simulation] = []
    failed = 0
    for k, setting in enumerate(settings):

        def tell(n: int, total: int, bad: int, k: int = k, before: int = failed) -> None:
            if progress is not None:
                progress(k * total + n, len(settings) * total, before + bad)

        one = simulate(study, setting, progress=tell, **how)
        failed += len(one.monte_carlo.failures)
        # Of many studies the signals would fill the memory.
        done.append(dataclasses.replace(one, kept={}))
    return OffTable(tuple(done))
