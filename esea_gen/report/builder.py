"""Report of a device on one page: results, accuracy, checks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from esea_gen.device import Device
from esea_gen.emit.build import render_device
from esea_gen.emit.dialect import render_dialect
from esea_gen.errors import UserError
from esea_gen.files import plain
from esea_gen.report import drive, reach, sensing
from esea_gen.report.common import REAL_NAMES
from esea_gen.report.findings import Findings, Say, run_board
from esea_gen.report.page import render
from esea_gen.targets import DEFAULT_BOARD
from esea_gen.verify.equivalence import verify
from esea_gen.verify.verdict import Verification


@dataclass(frozen=True)
class Report(Findings):
    @property
    def kind(self) -> ModuleType:
        """Whose sections: of the closed loop where there is a law."""
        return drive if self.device.laws else sensing

    @property
    def matches(self) -> bool:
        """Whether the C is the model's, here and on the board."""
        return self.verification.passed and self.board.passed

    @property
    def passed(self) -> bool:
        # How well a model fits or a controller follows does not enter.
        return self.matches and not drive.problems(self)

    @property
    def mismatches(self) -> list[str]:
        return [*verification_problems(self.verification), *self.board.problems]

    @property
    def problems(self) -> list[str]:
        return self.mismatches + drive.problems(self)

    def verdicts(self) -> dict[str, Any]:
        """Two separate verdicts: the C against the model, and the device's behaviour."""
        ran = self.board.results
        text = "The C matches the model" if self.matches else "The C does not match the model"
        where = "here and on the emulated board" if ran else "here; the board was not run"
        code = {"matches": self.matches, "text": text, "how": where, "problems": self.mismatches}
        return {"code": code, "device": self.kind.verdict(self)}

    def to_dict(self) -> dict[str, Any]:
        """The findings, JSON-ready: no NaN, no time of day, no path."""
        content: dict[str, Any] = {
            "device": {"name": self.device.name, "title": self.device.title},
            "content_hash": self.verification.content_hash,
            "passed": self.passed,
            "verdicts": self.verdicts(),
            "problems": self.problems,
        }
        for section in (self.kind.HEAD, *self.kind.SECTIONS):
            content |= section.content(self)
        finished: dict[str, Any] = plain(content | {"command": self.command}, null=True)
        return finished

    def summary(self) -> list[str]:
        problems, both = self.problems, self.verdicts().values()
        lines = [
            f"{self.device.title} (content {self.verification.content_hash})",
            *(f"{'FAILED: ' * bool(v['problems'])}{v['text']}; {v['how']}." for v in both),
            *problems[:10],
        ]
        if len(problems) > 10:
            lines.append(f"... {len(problems) - 10} more problems, see the page")
        return [*lines, *self.kind.summary(self)]

    def html(self) -> str:
        head, sections, title = self.kind.HEAD, self.kind.SECTIONS, self.device.title
        return render(head, sections, self, title=title, f=self.to_dict(), reals=REAL_NAMES)


def verification_problems(verification: Verification) -> Iterator[str]:
    for c in verification.comparisons:
        where = f"{c.block}, {REAL_NAMES[c.real]}, {c.stream}"
        yield from (f"{where}: {p}" for p in c.problems)
        if c.status_differences:
            yield f"{where}: status differs in {c.status_differences} steps"
        if c.bit_identical is False:
            yield f"{where}: bits differ from CasADi's own C"


def gather(
    device: Device,
    recording: Path | None = None,
    data: Path | None = None,
    board: str = DEFAULT_BOARD,
    progress: Say | None = None,
) -> Report:
    """Build, verify, emulate and measure a device; with a law simulate it too."""
    if device.laws and (recording is not None or data is not None):
        raise UserError(
            f"{device.name} has a drive: its page is of closed-loop runs and takes no recording.",
            "Leave --recording and --data out, or report on the device that it extends.",
        )
    say = progress or (lambda _: None)
    found: dict[str, Any] = {}
    if device.laws:
        deflections = {}
        found["simulations"], found["yardsticks"] = drive.close_loop(device, say)
        found["reach"] = reach.tried(device, drive.own_law(device), drive.PLANT, say)
    else:
        found["runs"], found["mapping"] = sensing.deflect(device, recording, data, say)
        deflections = {r.label: r.theta_rad for r in found["runs"]}
    say("generating")
    formats = tuple(REAL_NAMES)
    bundles = (*render_device(device, formats), render_dialect(device))
    recorded = deflections if recording is not None else {}
    verification = verify(device, formats, recorded, progress=say)
    board_run = run_board(device, board, deflections, say)
    command = _command(device, recording, data, board)
    return Report(device, verification, bundles, board_run, command, **found)


def _command(device: Device, recording: Path | None, data: Path | None, board: str) -> str:
    words = ["esea-gen report", device.argument]
    if device.given[1]:
        words.append(f"--controller {','.join(Path(n).name for n in device.given[1].split(','))}")
    if recording is not None:
        words.append(f"--recording {recording.name}")
    if data is not None:
        words.append("--data DIR")
    if board != DEFAULT_BOARD:
        words.append(f"--board {board}")
    return " ".join(words)
