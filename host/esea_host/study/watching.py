"""Who looks on while a session runs, and may say what comes next; gauges of a device."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from esea_host.study.scene import Scene
from esea_host.study.task import TaskStep

if TYPE_CHECKING:
    from esea_host.study.plan import PlannedTrial

Stop = Callable[[], str]
Show = Callable[[Scene], None]


class TrialOnly(str):
    """A reason that ends the running trial; the session goes on, and the trial comes again."""

    __slots__ = ()


@dataclass(frozen=True)
class Gauge:
    name: str
    value: float
    low: float
    high: float
    unit: str


def not_stopped() -> str:
    return ""


def told_nobody(*_: Any, **__: Any) -> None: ...


def shown_nowhere(_: Scene) -> None: ...


class SessionWatcher:
    """Is told all that happens, in the session's thread; this one only draws and stops."""

    def __init__(self, show: Show = shown_nowhere, stop: Stop = not_stopped) -> None:
        self._show, self._stop = show, stop

    def turn(self) -> str:
        """Why to stop now, or nothing; asked at every step, and while something is waited for."""
        return self._stop()

    def between(self) -> None:
        """No trial runs: the moment to skip, to repeat, or to make the session wait."""
        return

    def waits(self, words: str) -> None:
        """Something is waited for, and what to do; empty: no longer."""
        return

    def rests(self, seconds: float) -> None:
        return

    def begins(self, trial: PlannedTrial) -> None:
        return

    def steps(self, time_s: float, step: TaskStep) -> None:
        self._show(step.scene)

    def ends(self, number: int, state: str, reason: str, row: Mapping[str, Any]) -> None:
        """A trial has ended, and it is on disk; no data but of a completed one."""
        return
