"""A task in a file of its own: hold the handle near a place for a while."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from esea_host.study.scene import Scene, Shape, Text
from esea_host.study.task import (
    Actor,
    DataColumn,
    Inputs,
    Situation,
    StudyTask,
    TaskEvent,
    TaskParameters,
    TaskSignal,
    TaskStep,
    TrialOutcome,
    register,
)


class Hold(TaskParameters):
    place_deg: float = Field(10.0, ge=-60, le=60, description="where to hold")
    within_deg: float = Field(2.0, gt=0, le=20, description="how near is near enough")
    hold_s: float = Field(0.5, gt=0, le=60, description="how long")
    longest_s: float = Field(5.0, gt=0, le=600, description="then it is missed")


@dataclass(frozen=True)
class Holding:
    hold: Hold
    since_s: float | None = None


@register
class SteadyHold(StudyTask):
    """Hold the handle near a place."""

    name = "steady_hold"
    title = "Hold the handle near a place"
    Parameters = Hold
    inputs: ClassVar = {"theta_deg": TaskSignal("theta_load_rad")}
    columns = (
        DataColumn("held", bool, "whether it was held long enough"),
        DataColumn("place_deg", float, "where to hold"),
        DataColumn("after_s", float, "time until then, or until it was missed"),
    )

    def longest_s(self, parameters: Any) -> float:
        return float(parameters.longest_s)

    def begin(self, situation: Situation) -> Holding:
        return Holding(situation.parameters)

    def step(self, state: Holding, time_s: float, inputs: Inputs) -> TaskStep:
        hold, theta_deg = state.hold, inputs["theta_deg"]
        near = abs(theta_deg - hold.place_deg) <= hold.within_deg
        events: tuple[TaskEvent, ...] = ()
        if near and state.since_s is None:
            events = (TaskEvent("arrived", {"theta_deg": theta_deg}),)
        since_s = (time_s if state.since_s is None else state.since_s) if near else None
        held = since_s is not None and time_s - since_s >= hold.hold_s
        outcome = None
        if held or time_s >= hold.longest_s:
            outcome = TrialOutcome({"held": held, "place_deg": hold.place_deg, "after_s": time_s})
        scene = Scene(
            (
                Shape("ring", "target", hold.place_deg, 0.0, hold.within_deg),
                Shape("disc", "cursor", theta_deg, 0.0, 1.0),
            ),
            (Text("reach"),),
        )
        return TaskStep(replace(state, since_s=since_s), scene, {}, events, outcome)

    def simulate(self, situation: Situation, rng: np.random.Generator) -> Actor:
        return Lagging(rng)


class Lagging(Actor):
    """Sees where the target is and goes there, a little unsteadily."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.time_s, self.theta_deg = rng, 0.0, 0.0

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        self.time_s += 0.02
        aims = [s.x for s in scene.shapes if s.role == "target"]
        if aims:
            self.theta_deg += 0.1 * (aims[0] - self.theta_deg) + 0.1 * float(self.rng.normal())
        return self.time_s, {"theta_deg": self.theta_deg}
