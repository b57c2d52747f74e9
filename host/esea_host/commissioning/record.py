"""Record of a commissioning: results, figures, a device's folder."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from esea_gen.errors import UserError
from esea_gen.files import locked, write_json, write_whole
from esea_gen.link.kept import kept_use
from esea_gen.link.transport import LinkError
from esea_gen.plotting import BOUND, INK, MEASURED, MODEL, RULE, STYLE
from esea_host.commissioning.startup import StartupCheck
from esea_host.connection import ConnectedDevice
from esea_host.recording.layout import Array

KIND, VERSION, NAME = "esea-host commissioning", 1, "record.json"
Line = tuple[str, Array]  # label, values
COLOURS = (MODEL, MEASURED, BOUND)
OF_START = ("zero",)  # steps whose result a board loses when it is switched off


class BoardUnit(NamedTuple):
    serial: str  # every serial number that is known of it; empty: none
    start: int  # number of its start, another one after every loss of power

    def __str__(self) -> str:
        return self.serial or f"no serial number, start {self.start}"


def unit_of(device: ConnectedDevice) -> BoardUnit:
    """Ask a board which one it is: by its USB port and by its named encoders."""
    found, address = [], device.address
    if address is not None and address.kind == "serial":
        from serial.tools.list_ports import comports

        port = os.path.realpath(address.place.partition(":")[0])
        ports = [p for p in comports() if p.device == port and p.serial_number]
        found = [f"USB {p.serial_number}" for p in ports]
    with suppress(LinkError):
        named = [str(serial) for serial, _ in kept_use(device.session).encoders if serial]
        found += [f"encoders {', '.join(named)}"] if named else []
    return BoardUnit(", ".join(found), device.boot_number())


def done_at(entry: Mapping[str, Any]) -> str:
    """When an entry was written."""
    moment = datetime.fromtimestamp(entry["host_ns"] * 1e-9, UTC)
    return f"{moment:%Y-%m-%d %H:%M} UTC"


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

    def lines(self, simulated: bool = False) -> list[str]:
        kind, word = " (simulated)" * simulated, "PASSED" if self.passed else "FAILED"
        out = [f"{self.title}{kind}: {word}"]
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
    """A folder with ``record.json`` and pictures; entries are added, never changed.

    Only those of the board that is connected count.
    """

    def __init__(self, folder: Path, device: str, unit: BoardUnit) -> None:
        self.folder, self.device, self.unit = Path(folder), device, unit
        self.entries: list[dict[str, Any]] = []
        self._read()

    def _read(self) -> None:
        path, device = self.folder / NAME, self.device
        if not path.exists():
            return
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            kind, of = (content["kind"], content["version"]), str(content["device"])
            self.entries = [dict(e) for e in content["entries"]]
            for e in self.entries:
                _ = done_at(e), e["step"], e["passed"], e["simulated"], e["device_digest"]
        except (OSError, ArithmeticError, ValueError, KeyError, TypeError) as error:
            raise UserError(
                f"{path} cannot be read as a record ({error}).", "Name another folder: --record."
            ) from None
        if kind != (KIND, VERSION):
            raise UserError(f"{path} is not a record of this version.", "Name another folder.")
        if of != device:
            raise UserError(
                f"{path} is the record of a {of}, not of a {device}.",
                "Give each machine a folder of its own: --record.",
            )

    def add(self, result: StepResult, device: ConnectedDevice) -> dict[str, Any]:
        """Write a result down, its picture first; others may write to the folder meanwhile."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with locked(self.folder / ".record.lock", wait_s=10.0):
            self._read()
            return self._add(result, device)

    def _add(self, result: StepResult, device: ConnectedDevice) -> dict[str, Any]:
        number = len(self.entries) + 1
        drawn = BytesIO()
        result.picture.savefig(drawn, format="png", dpi=110)
        picture = f"{number:03d}-{result.step}.png"
        write_whole(self.folder / picture, drawn.getvalue())
        identity, self.unit = device.identity, unit_of(device)
        facts, now_ns = identity.facts(), time.time_ns()
        entry = {
            "number": number,
            "host_ns": now_ns,
            "utc": datetime.fromtimestamp(now_ns // 10**9, UTC).isoformat(),
            "board_serial": self.unit.serial,
            "board_start": self.unit.start,
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
        """The newest entry of a step for this board and the device file as it is now."""
        fits = (e for e in reversed(self.entries) if e["step"] == step and self._counts(e))
        return next((e for e in fits if e["device_digest"] == digest), None)

    def _counts(self, entry: Mapping[str, Any]) -> bool:
        unit = BoardUnit(entry.get("board_serial", ""), entry.get("board_start", -1))
        by_start = not unit.serial or entry["step"] in OF_START
        return unit.serial == self.unit.serial and (not by_start or unit.start == self.unit.start)

    def notice(self) -> str:
        """Which board this is, and which earlier results do not count for it."""
        text = f"Board: {self.unit}."
        if not self.unit.serial:
            text += " Results count until it is switched off; to name its encoders: esea-host kept."
        if others := [e for e in self.entries if not self._counts(e)]:
            text += (
                f" {self.folder / NAME} keeps {len(others)} results of another board or an earlier "
                f"start, the last of {done_at(others[-1])}; they do not count for this one."
            )
        return text

    def summary(self, steps: tuple[tuple[str, str], ...], digest: str) -> list[str]:
        lines = []
        for name, title in steps:
            entry = self.last(name, digest)
            word = "not done" if entry is None else "passed" if entry["passed"] else "FAILED"
            if entry is not None:
                word += f"{' (simulated)' if entry['simulated'] else ''}, {done_at(entry)}"
            lines.append(f"  {name:12}{title:34}{word}")
        return lines
