"""Whether a recording is all that was recorded, and what is missing of it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any


class RecordingState(Enum):
    """How a recording came down to us, the worst first."""

    DAMAGED = "damaged"
    DISK_FULL = "disk full"
    TRUNCATED = "truncated"
    DISCONNECTED = "disconnected"
    COMPLETE = "complete"


MEANINGS = {
    RecordingState.DAMAGED: "bytes were changed or lost after they had been written",
    RecordingState.DISK_FULL: "the disk was full: what had been written by then is there",
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

    def to_dict(self) -> dict[str, Any]:
        return {**vars(self), "lost": dict(self.lost)}


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
        return {
            "state": self.state.value,
            "states": [s.value for s in self.states],
            "damages": [d.to_dict() for d in self.damages],
            "readable_bytes": self.readable_bytes,
            "size_bytes": self.size_bytes,
            "checked": self.checked,
            "lost": dict(self.lost),
        }


def warn_unless_complete(name: object, integrity: Integrity) -> None:
    """Say beside a result that its recording is not complete."""
    if not integrity.complete:
        print(f"{name}: the recording is {integrity}", file=sys.stderr, flush=True)
