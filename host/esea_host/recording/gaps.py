"""Holes in a stream: where, how many runs are missing, and who lost them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from esea_gen.errors import UserError

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
    """Runs of a task that are missing between two that are there.

    after_tick, before_tick: base ticks of the runs on both sides; -1 where there is none.
    missing: runs; -1 where nobody knows.
    board_ns: time of the run before the hole, on the board's clock; see :class:`Table`.
    reason: a key of :data:`REASONS`.
    """

    stream: str
    after_tick: int
    before_tick: int
    missing: int
    reason: str
    board_ns: int = -1

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    def __str__(self) -> str:
        count = "runs" if self.missing < 0 else f"{self.missing} runs"
        where = f"between ticks {self.after_tick} and {self.before_tick}"
        return f"{self.stream}: {count} missing {where}: {REASONS.get(self.reason, self.reason)}"


class GapError(UserError):
    """A figure was asked for over a stretch with a hole in it.

    Parameters
    ----------
    what : str
        Which stretch, which hole.
    gaps : tuple of Gap
        The holes.
    """

    def __init__(self, what: str, gaps: tuple[Gap, ...]) -> None:
        super().__init__(what, "Take a stretch between the gaps: Table.pieces() lists them.")
        self.gaps = gaps
