"""Holes in a stream: where, how many runs are missing, and who lost them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, Self

from esea_gen.errors import UserError
from esea_gen.link.received import shown

REASONS = {
    "board": "the board had no room for them: they were never sent",
    "checksum": "frames came with a wrong checksum",
    "link": "frames were lost on the way",
    "host": "the host could not keep up and dropped them",
    "disconnected": "the link was broken meanwhile",
    "recording": "a piece of the recording is damaged",
    "foreign": "the imported log says so: its time jumps there",
}


@dataclass(frozen=True)
class Gap:
    """Runs of a task that are missing between two that are there."""

    stream: str
    after_tick: int
    before_tick: int
    missing: int  # runs; -1 where nobody knows
    reason: str  # a key of :data:`REASONS`
    board_ns: int = -1  # time of the run before the hole, on the board's clock; see :class:`Table`

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self | None:
        """What :meth:`to_dict` gave, from a file; None for anything else."""
        found = {f.name: content.get(f.name, f.default) for f in fields(cls)}
        texts = [found["stream"], found["reason"]]
        numbers = [found[n] for n in ("after_tick", "before_tick", "missing", "board_ns")]
        if any(type(t) is not str for t in texts) or any(type(n) is not int for n in numbers):
            return None
        if any(abs(n) >= 1 << 63 for n in numbers):
            return None
        return cls(**found | {"stream": shown(texts[0]), "reason": shown(texts[1])})

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    def __str__(self) -> str:
        count = "some runs" if self.missing < 0 else f"{self.missing} runs"
        count = "perhaps runs" if self.missing < 0 and self.reason == "recording" else count
        where = f"between ticks {self.after_tick} and {self.before_tick}"
        if self.before_tick < 0:
            where = f"after tick {self.after_tick}" if self.after_tick >= 0 else "everywhere"
        return f"{self.stream}: {count} missing {where}: {REASONS.get(self.reason, self.reason)}"


class GapError(UserError):
    """A figure was asked for over a stretch with a hole in it."""

    def __init__(self, what: str, gaps: tuple[Gap, ...]) -> None:
        super().__init__(what, "Take a stretch between the gaps: Table.pieces() lists them.")
        self.gaps = gaps
