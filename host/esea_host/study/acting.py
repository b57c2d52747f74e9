"""A source of inputs for a run without a board: every task's own simulated participant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from esea_host.study.edge import number, of_task
from esea_host.study.plan import generator
from esea_host.study.scene import Scene
from esea_host.study.source import InputSource
from esea_host.study.task import Actor, Inputs, Situation, StudyTask


class Timed(Actor):
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

    def __init__(self, seed: int) -> None:
        self.seed, self._past_s = seed, 0.0
        self._actor: Timed | None = None

    def ready(self) -> Mapping[str, Any]:
        return {"simulated": True}

    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        """The task's own actor, with random numbers of its own trial."""
        self._past_s = self.now_s()
        rng = generator(self.seed, number, situation.seed)
        self._actor = Timed(task, of_task(task, task.simulate, situation, rng))
        return self._actor

    def rest(self, seconds: float) -> None:
        self._past_s, self._actor = self.now_s() + seconds, None

    def now_s(self) -> float:
        return self._past_s + (self._actor.time_s if self._actor else 0.0)
