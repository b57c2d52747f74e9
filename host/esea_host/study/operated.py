"""A source of inputs as an operator has it: in the clock's time, with switches to press."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

from esea_gen.errors import UserError
from esea_host.study.plan import PlannedTrial
from esea_host.study.scene import Scene
from esea_host.study.source import InputSource
from esea_host.study.task import Actor, Inputs, Situation, StudyTask
from esea_host.study.watching import Gauge

PIECE_S = 0.02  # so long at most nobody hears a stop
LATE_S = 0.25  # who is later than that does not hurry to catch up


class OperatedSource(InputSource):
    """A source inside, slowed down to the clock, with what is pressed put to its inputs."""

    def __init__(
        self, inner: InputSource, speed: float, pressed: Callable[[], Mapping[str, float]]
    ) -> None:
        if not speed > 0:
            raise UserError(f"A speed of {speed:g}.", "Give one above 0; 1 is the clock's.")
        self.inner, self.speed, self.pressed = inner, speed, pressed

    def wait(self, until_s: float) -> None:
        """Wait for the clock, unless somebody asks to stop."""
        while (left_s := until_s - time.monotonic()) > 0 and not self.ask():
            time.sleep(min(left_s, PIECE_S))

    def ready(self) -> Mapping[str, Any]:
        self.inner.listen_to(self)
        return self.inner.ready()

    def before(self, trial: PlannedTrial) -> str:
        return self.inner.before(trial)

    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        return _Operated(self.inner.trial(task, situation, number), self, task.switches)

    def over(self, number: int, state: str) -> None:
        self.inner.over(number, state)

    def rest(self, seconds: float) -> None:
        """Wait as long, and longer while a pause is pressed."""
        if math.isfinite(self.speed):
            self.wait(time.monotonic() + seconds / self.speed)
        self.inner.rest(seconds)
        while self.pressed().get("pause") and not self.ask():
            time.sleep(PIECE_S)

    def now_s(self) -> float:
        return self.inner.now_s()

    def status(self) -> str:
        return self.inner.status()

    def broken(self) -> str:
        return self.inner.broken()

    def tick_s(self) -> float | None:
        return self.inner.tick_s()

    def gauges(self) -> tuple[Gauge, ...]:
        return self.inner.gauges()


class _Operated(Actor):
    def __init__(self, inner: Actor, source: OperatedSource, switches: tuple[str, ...]) -> None:
        self._inner, self._source, self._switches = inner, source, switches
        self._begun_s = time.monotonic()

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        """As the actor inside, not before its time; a switch is there only while it is pressed."""
        held = {k: v for k, v in self._source.pressed().items() if k in self._switches}
        self._source.inner.paused = "pause" in held
        time_s, inputs = self._inner.react(scene, requests)
        if math.isfinite(self._source.speed):
            due_s = self._begun_s + time_s / self._source.speed
            late_s = time.monotonic() - due_s
            if late_s > LATE_S:
                self._begun_s += late_s
            self._source.wait(due_s)
        return time_s, {**inputs, **held} if held else inputs
