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
    """Where a session's inputs come from: a board, or simulated people."""

    ask: Stop = staticmethod(not_stopped)
    waits: Callable[[str], None] = staticmethod(told_nobody)
    say: Callable[..., None] = staticmethod(told_nobody)
    paused: bool = False

    def listen_to(self, other: InputSource) -> None:
        self.ask, self.waits, self.say = other.ask, other.waits, other.say

    @abstractmethod
    def ready(self) -> Mapping[str, Any]:
        """Check zero and limits; a key ``problem`` keeps the session from starting."""

    def before(self, trial: PlannedTrial) -> str:
        """What keeps the coming trial from beginning: it stays to be done, and the session ends."""
        return ""

    @abstractmethod
    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor: ...

    def over(self, number: int, state: str) -> None:
        """The trial has ended, completed or not: the device's own recording ends with it."""
        return

    @abstractmethod
    def rest(self, seconds: float) -> None: ...

    def close(self) -> None:
        return

    @abstractmethod
    def now_s(self) -> float: ...

    def status(self) -> str:
        return ""

    def broken(self) -> str:
        """Why it has to be made ready again before the next trial; empty while it has not."""
        return ""

    def tick_s(self) -> float | None:
        """When the newest sample was taken, by the monotonic clock; None where nobody knows."""
        return None

    def gauges(self) -> tuple[Gauge, ...]:
        return ()
