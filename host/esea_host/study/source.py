"""Sources of a session's inputs, and its observers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from esea_host.study.edge import number, of_task
from esea_host.study.plan import PlannedTrial, generator
from esea_host.study.scene import Scene
from esea_host.study.task import Actor, Inputs, Situation, StudyTask, TaskStep


class TrialOnly(str):
    """A reason that ends the running trial; the session goes on, and the trial comes again."""

    __slots__ = ()


NEAR = 0.85  # of the way to a limit


@dataclass(frozen=True)
class Gauge:
    name: str
    value: float
    low: float
    high: float
    unit: str

    @property
    def near(self) -> bool:
        """Whether the value is near a limit, or unknown."""
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        return not abs(self.value - middle) <= NEAR * half


class SessionWatcher:
    """Receives all events in the session's thread; this one only draws and stops."""

    def __init__(
        self, show: Callable[[Scene], object] = lambda _: None, stop: Callable[[], str] = lambda: ""
    ) -> None:
        self._show, self._stop = show, stop

    def turn(self) -> str:
        """Why to stop now, or nothing; asked at every step, and while something is waited for."""
        return self._stop()

    def between(self) -> None:
        """No trial runs: the moment to skip, to repeat, or to make the session wait."""

    def waits(self, words: str) -> None:
        """Report what the session waits for, and the action to take; empty: no longer."""

    def breaks(self, words: str, drive: bool) -> str:
        """Why the session ends as the source was lost; else it is made ready again, and armed."""
        return words if drive else ""  # nobody can be asked before a motor moves a person

    def rests(self, seconds: float, rest: Callable[[float], None]) -> None:
        """A rest: called to pass the time of the source."""
        rest(seconds)

    def pressed(self) -> Mapping[str, float]:
        """Switches that are pressed now, 1 each."""
        return {}

    def begins(self, trial: PlannedTrial) -> None: ...

    def paces(self, time_s: float) -> None:
        """Inputs of this time of the trial have come: the moment to wait for the clock."""

    def steps(self, time_s: float, step: TaskStep) -> None:
        self._show(step.scene)

    def ends(self, number: int, state: str, reason: str, row: Mapping[str, Any]) -> None:
        """A trial has ended, and it is on disk; no data but of a completed one."""


class InputSource(ABC):
    """Where a session's inputs come from: a board, or simulated people."""

    # Set by the session: why to stop waiting; what is waited for, in words (empty: no longer);
    # a writer of events into its log; whether the task is held, for a device's own recording.
    ask: Callable[[], str] = staticmethod(lambda: "")
    waits: Callable[[str], None] = staticmethod(lambda _: None)
    say: Callable[..., None] = staticmethod(lambda *_, **__: None)
    paused = drive = False  # drive: its motor is armed when it is made ready

    @property
    @abstractmethod
    def simulated(self) -> bool:
        """Whether no real person, or no real device, is behind it."""

    @abstractmethod
    def ready(self) -> Mapping[str, Any]:
        """Check zero and limits; a key ``problem`` keeps the session from starting."""

    def before(self, trial: PlannedTrial) -> str:
        """Reason why the next trial cannot begin: it remains to be done, and the session ends."""
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


class _Timed(Actor):
    # A task's own actor, whose time the source can read.
    def __init__(self, task: StudyTask, inner: Actor) -> None:
        self.task, self.inner, self.time_s = task, inner, 0.0

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        reacted: tuple[float, Inputs] = of_task(self.task, self._react, scene, requests)
        return reacted

    def _react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        time_s, inputs = self.inner.react(scene, requests)
        self.time_s = number(time_s, f"{self.task.name}: time of the simulated person")
        return self.time_s, dict(inputs)


class SimulatedSource(InputSource):
    """Each trial is done by :meth:`StudyTask.simulate`; rests pass in no time."""

    simulated = True

    def __init__(self, seed: int = 0) -> None:
        self.seed, self._past_s = seed, 0.0
        self._actor: Any = None  # of the trial; its time_s is the trial's

    def ready(self) -> Mapping[str, Any]:
        return {"simulated": self.simulated}

    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        self._past_s = self.now_s()
        rng = generator(self.seed, number, situation.seed)
        actor = self._actor = _Timed(task, of_task(task, task.simulate, situation, rng))
        return actor

    def rest(self, seconds: float) -> None:
        self._past_s, self._actor = self.now_s() + seconds, None

    def now_s(self) -> float:
        return self._past_s + (self._actor.time_s if self._actor else 0.0)
