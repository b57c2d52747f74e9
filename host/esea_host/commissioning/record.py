"""What a step found, drawn and kept: results, their pictures, and a device's record of them."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from esea_gen.errors import UserError
from esea_gen.files import write_json, write_whole
from esea_gen.plotting import BOUND, INK, MEASURED, MODEL, RULE, STYLE
from esea_host.commissioning.startup import StartupCheck
from esea_host.connection.identity import Identity
from esea_host.recording.layout import Array

KIND, VERSION, NAME = "esea-host commissioning", 1, "record.json"
Line = tuple[str, Array]  # label, values
COLOURS = (MODEL, MEASURED, BOUND)


def new_picture(title: str, simulated: bool, rows: int = 1) -> tuple[Figure, list[Axes]]:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.2, 2.4 + 2.2 * rows), layout="constrained")
        axes = [figure.add_subplot(rows, 1, k + 1) for k in range(rows)]
        kind = "Simulated: " if simulated else ""
        figure.suptitle(f"{kind}{title}", x=0.01, ha="left", color=INK, fontsize=11)
    return figure, axes


def over(
    axes: Axes, x: Array, lines: Sequence[Line], x_label: str, y_label: str, limit: float = 0.0
) -> None:
    """Lines over the same values; a limit either way, where there is one."""
    with mpl.rc_context(STYLE):
        for (label, values), colour in zip(lines, COLOURS, strict=False):
            axes.plot(x, values, color=colour, lw=1.1, label=label)
        for side in (-limit, limit) if limit else ():
            axes.axhline(side, color=INK, lw=0.8, ls=(0, (4, 3)))
        axes.set(xlabel=x_label, ylabel=y_label)
        axes.legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 1), borderpad=0)


def against(
    axes: Axes,
    labels: Sequence[str],
    x: Sequence[Array],
    y: Sequence[Array],
    x_label: str,
    y_label: str,
) -> None:
    """Lines of values that ought to be equal."""
    with mpl.rc_context(STYLE):
        for label, xs, ys, colour in zip(labels, x, y, COLOURS, strict=False):
            axes.plot(xs, ys, color=colour, lw=0.8, label=label)
        axes.axline((0, 0), slope=1, color=INK, lw=0.8, ls=(0, (4, 3)), label="equal")
        axes.set(xlabel=x_label, ylabel=y_label)
        axes.legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 1), borderpad=0)


def torque_bars(axes: Axes, shares: Mapping[str, float]) -> None:
    """Values over their limits, the worst of all phases, by criterion."""
    with mpl.rc_context(STYLE):
        colours = [MODEL if s <= 1 else "#b3261e" for s in shares.values()]
        percent = [100 * s for s in shares.values()]
        axes.barh(range(len(shares)), percent, color=colours, height=0.6)
        axes.axvline(100, color=INK, lw=0.8, ls=(0, (4, 3)))
        axes.set_yticks(range(len(shares)), list(shares))
        axes.invert_yaxis()
        axes.grid(color=RULE, axis="x")
        axes.set(xlabel="% of its limit, the worst of all phases")


@dataclass(frozen=True)
class StepResult:
    step: str
    title: str
    picture: Figure  # drawn, not yet written
    checks: tuple[StartupCheck, ...] = ()
    problem: tuple[str, str] | None = None
    found: Mapping[str, Any] = field(default_factory=dict)  # numbers by name with unit
    note: str = ""  # what was changed on the board

    @property
    def passed(self) -> bool:
        """Whether there was something to judge, and all of it is within its limits."""
        return self.problem is None and bool(self.checks) and all(c.passed for c in self.checks)

    def lines(self) -> list[str]:
        out = [f"{self.title}: {'PASSED' if self.passed else 'FAILED'}"]
        out += [f"  {self.note}"] if self.note else []
        if self.problem is not None:
            out += [f"  {self.problem[0]}", f"    Fix: {self.problem[1]}"]
        for c in self.checks:
            out.append(f"  {c.line()}")
            if not c.passed:
                out.append(f"    Fix: {c.fix}")
        return out

    def to_dict(self) -> dict[str, Any]:
        what, fix = self.problem or ("", "")
        return {
            "step": self.step,
            "title": self.title,
            "passed": self.passed,
            "problem": what,
            "fix": fix,
            "checks": [c.to_dict() for c in self.checks],
            "found": dict(self.found),
        }


class CommissioningRecord:
    """A folder with ``record.json`` and pictures; entries are added, never changed."""

    def __init__(self, folder: Path, device: str) -> None:
        self.folder, self.device = Path(folder), device
        self.entries: list[dict[str, Any]] = []
        path = self.folder / NAME
        if not path.exists():
            return
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            kind, of = (content["kind"], content["version"]), str(content["device"])
            self.entries = [dict(e) for e in content["entries"]]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UserError(
                f"{path} cannot be read as a record ({error}).", "Name another folder: --record."
            ) from None
        if kind != (KIND, VERSION):
            raise UserError(f"{path} is no record of this version.", "Name another folder.")
        if of != device:
            raise UserError(
                f"{path} is the record of a {of}, not of a {device}.",
                "Give each machine a folder of its own: --record.",
            )

    def add(self, result: StepResult, identity: Identity) -> dict[str, Any]:
        """Write a result down, its picture first."""
        number = len(self.entries) + 1
        drawn = BytesIO()
        result.picture.savefig(drawn, format="png", dpi=110)
        picture = f"{number:03d}-{result.step}.png"
        write_whole(self.folder / picture, drawn.getvalue())
        facts = identity.facts()
        entry = {
            "number": number,
            "host_ns": time.time_ns(),
            **result.to_dict(),
            "picture": picture,
            "device_digest": identity.device.digest,
            **{k: facts[k] for k in ("content_hash", "real", "board", "simulated", "versions")},
        }
        self.entries.append(entry)
        content = {"kind": KIND, "version": VERSION, "device": self.device}
        write_json(self.folder / NAME, "host-commissioning", content | {"entries": self.entries})
        return entry

    def last(self, step: str, digest: str) -> dict[str, Any] | None:
        """The newest entry of a step for the device file as it is now."""
        fits = (e for e in reversed(self.entries) if e["step"] == step)
        return next((e for e in fits if e["device_digest"] == digest), None)

    def summary(self, steps: tuple[tuple[str, str], ...], digest: str) -> list[str]:
        lines = []
        for name, title in steps:
            entry = self.last(name, digest)
            word = "not done" if entry is None else "passed" if entry["passed"] else "FAILED"
            kind = " (simulated)" if entry is not None and entry["simulated"] else ""
            lines.append(f"  {name:12}{title:34}{word}{kind}")
        return lines
