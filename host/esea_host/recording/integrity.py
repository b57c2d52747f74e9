"""Completeness of a recording, and its gaps."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from typing import Any, Self

from esea_gen.errors import UserError
from esea_gen.files import plain
from esea_gen.link.received import shown


class RecordingState(Enum):
    """How a recording came down to us, the worst first."""

    DAMAGED = "damaged"
    DISK_FULL = "disk full"
    TRUNCATED = "truncated"
    DISCONNECTED = "disconnected"
    COMPLETE = "complete"


MEANINGS = {
    RecordingState.DAMAGED: "bytes were changed or lost after they had been written",
    RecordingState.DISK_FULL: "the disk was full: all data until then is there",
    RecordingState.TRUNCATED: "it was not finished, or its end is cut off",
    RecordingState.DISCONNECTED: "the board went away and did not come back",
    RecordingState.COMPLETE: "all that was recorded is there",
}


@dataclass(frozen=True)
class Damage:
    offset: int
    end: int
    what: str  # what is wrong there
    start_s: float | None = None
    end_s: float | None = None
    lost: Mapping[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        times = "" if self.start_s is None else f" ({self.start_s:.3f} to {self.end_s:.3f} s)"
        lost = ", ".join(f"{n} of {topic}" for topic, n in self.lost.items() if n)
        what = f"bytes {self.offset} to {self.end}{times}: {self.what}"
        return f"{what}; messages lost: {lost}" if lost else what


@dataclass(frozen=True)
class Integrity:
    states: tuple[RecordingState, ...]  # all that apply, the worst first
    damages: tuple[Damage, ...]  # places that cannot be used
    readable_bytes: int
    size_bytes: int
    checked: bool
    lost: Mapping[str, int]  # messages that are not there, by topic; empty where no index tells

    @property
    def state(self) -> RecordingState:
        return self.states[0]

    @property
    def complete(self) -> bool:
        return self.state is RecordingState.COMPLETE

    def __str__(self) -> str:
        text = ", ".join(s.value for s in self.states)
        if not self.complete:
            text += f" ({'; '.join(MEANINGS[s] for s in self.states)})"
        if RecordingState.TRUNCATED in self.states:
            text += f", read up to byte {self.readable_bytes} of {self.size_bytes}"
        if not self.checked:
            text += ", without checksums: a changed value is not noticed"
        lost = ", ".join(f"{n} of {topic}" for topic, n in self.lost.items())
        return f"{text}; messages missing: {lost}" if lost else text

    def to_dict(self) -> dict[str, Any]:
        return {"state": self.state.value, **plain(self)}


REASONS = {
    "board": "the board had no room for them: they were never sent",
    "checksum": "frames came with a wrong checksum",
    "link": "frames were lost on the way",
    "host": "the host could not keep up and dropped them",
    "disconnected": "the link was broken meanwhile",
    "recording": "a piece of the recording is damaged",
    "foreign": "the imported log's time jumps there",
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
        """Inverse of :meth:`to_dict`, from a file; None for anything else."""
        found = {f.name: content.get(f.name, f.default) for f in fields(cls)}
        texts = [found["stream"], found["reason"]]
        numbers = [found[n] for n in ("after_tick", "before_tick", "missing", "board_ns")]
        whole = (type(n) is int and abs(n) < 1 << 63 for n in numbers)
        if any(type(t) is not str for t in texts) or not all(whole):
            return None
        return cls(**found | {"stream": shown(texts[0]), "reason": shown(texts[1])})

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
        super().__init__(what, "Export it and cut it there; in Python, Table.pieces() cuts it.")
        self.gaps = gaps


def warn_unless_complete(name: object, integrity: Integrity) -> None:
    """Say beside a result that its recording is not complete."""
    if not integrity.complete:
        print(f"{name}: the recording is {integrity}", file=sys.stderr, flush=True)
