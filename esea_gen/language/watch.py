"""Watch of a System's tasks: missed ticks, late runs, corrupt coefficients.

Values that no Block can compute: the C determines them where ticks are released and tasks start and
end.  A wire takes them from the instance ``watch``, which is not a Block.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from esea_gen.language.ports import Port

WATCH = "watch"
LATE_STEP = 16  # what a late run adds to late_level; a tick in order takes 1
LATE_MOST = (
    128  # above is too late: twelve control runs in a row, or more than one in 16 ticks for good
)
LATE_FULL = 255  # where it stays

CLOCK_OK = Port.flag("clock_ok", "1 when this tick follows the last one", on_invalid=0.0)
LATE_LEVEL = Port.count(
    "late_level",
    LATE_FULL,
    f"runs that were late: {LATE_STEP} for each, 1 off at each tick",
    on_invalid=LATE_FULL,
)
COEFFS_OK = Port.flag("coeffs_ok", "1 once the coefficients passed their check")
WATCHED = {p.name: p for p in (CLOCK_OK, LATE_LEVEL, COEFFS_OK)}
TICKS = 2**32


@dataclass(frozen=True)
class Watched:
    port: Port


class TaskWatch:
    """The watch as the C has it, for :class:`~esea_gen.language.system.SystemSimulator`."""

    def __init__(self) -> None:
        self.tick: int | None = None
        self.clock_ok = 1
        self.late_level = 0
        self.coeffs_ok = 0
        self.started: dict[str, int] = {}
        self.ended: dict[str, int] = {}

    def see(self, tick: int) -> None:
        in_order = self.tick is None or (tick - self.tick) % TICKS == 1
        self.clock_ok = int(in_order)
        if in_order and self.late_level:
            self.late_level -= 1
        self.tick = tick

    def due(self, task: str) -> None:
        if self.started.get(task, 0) != self.ended.get(task, 0):
            self.late_level = min(self.late_level + LATE_STEP, LATE_FULL)

    def start(self, task: str) -> None:
        self.started[task] = self.started.get(task, 0) + 1

    def end(self, task: str) -> None:
        self.ended[task] = self.started.get(task, 0)

    def values(self) -> Mapping[str, float]:
        return {
            "clock_ok": float(self.clock_ok),
            "late_level": float(self.late_level),
            "coeffs_ok": float(self.coeffs_ok),
        }
