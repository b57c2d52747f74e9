"""Where a session's inputs come from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from esea_host.study.task import Actor, Situation, StudyTask
from esea_host.study.watching import Gauge, Stop, not_stopped, told_nobody

if TYPE_CHECKING:
    from esea_host.study.plan import PlannedTrial


class InputSource(ABC):
    """Where a session's inputs come from: a board, or simulated people.

    ask: while something is waited for, why to stop waiting; the session sets it, as the next two.
    waits: told what is waited for, in words for the operator; nothing any more: empty.
    say: writes an event into the session's log.
    paused: whether the task is held, for a device's own recording.
    """

    ask: Stop = staticmethod(not_stopped)
    waits: Callable[[str], None] = staticmethod(told_nobody)
    say: Callable[..., None] = staticmethod(told_nobody)
    paused: bool = False

    def listen_to(self, other: InputSource) -> None:
        """Ask and tell whom another source asks and tells."""
        self.ask, self.waits, self.say = other.ask, other.waits, other.say

    @abstractmethod
    def ready(self) -> Mapping[str, Any]:
        """Check zero and limits before the first trial and after every break; what was found.

        A key ``problem`` with words keeps the session from starting.
        """

    def before(self, trial: PlannedTrial) -> str:
        """What keeps the coming trial from beginning: it stays to be done, and the session ends."""
        return ""

    @abstractmethod
    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        """Who acts in the coming trial."""

    def over(self, number: int, state: str) -> None:
        """The trial has ended, completed or not: the device's own recording ends with it."""
        return

    @abstractmethod
    def rest(self, seconds: float) -> None:
        """Wait as long."""

    def close(self) -> None:
        """Let go of what it holds."""
        return

    @abstractmethod
    def now_s(self) -> float:
        """Time since the session's start."""

    def status(self) -> str:
        """In which state the device is, in a word."""
        return ""

    def broken(self) -> str:
        """Why it has to be made ready again before the next trial; empty while it has not."""
        return ""

    def tick_s(self) -> float | None:
        """When the newest sample was taken, by the monotonic clock; None where nobody knows."""
        return None

    def gauges(self) -> tuple[Gauge, ...]:
        """What an operator sees of the device, beside its limits."""
        return ()
