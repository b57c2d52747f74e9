"""The tasks of the wrist study.  Inputs ``fe_deg`` and ``ru_deg``: the joint's angles.

In angles as on the screen x is flexion (-) and extension (+), y ulnar (-) and radial (+) deviation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

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
from esea_host.study.words import keyed
from esea_host.wrist.calibration import (
    AXES,
    LEAST_PASSES,
    Calibrated,
    Complaint,
    calibrated,
    quality,
)

Axis = Literal["FE", "RU"]
Way = Literal[-1, 1]


IMPAIRMENT = DataColumn("impairment", bool, "whether the simulated impairment was asked for")


class OnAxis(TaskParameters):
    axis: Axis = Field("FE", description='"FE" or "RU"')
    impairment: bool = Field(False, description="whether the simulated impairment acts")


def angles(inputs: Inputs) -> tuple[float, float]:
    return inputs["fe_deg"], inputs["ru_deg"]


def requests(parameters: Any) -> Mapping[str, float]:
    return {"impairment": float(parameters.impairment)}


def dot(role: str, x: float, y: float, size: float = 1.0) -> Shape:
    return Shape("disc", role, x, y, size)


def place(axis: str, value: float) -> tuple[float, float]:
    """A point on an axis of the screen."""
    return (value, 0.0) if axis == "FE" else (0.0, value)


LIMITS_DEG = ((-60.0, 50.0), (-30.0, 20.0))
WALL_DEG = 6.0


class Follower(Actor):
    """Goes to the target, or to the origin, along a first-order lag, within a range of motion."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.time_s = rng, 0.0
        self.theta = np.zeros(2)

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        self.time_s = round(self.time_s + 0.01, 6)
        aim = next((s for s in scene.shapes if s.role == "target"), None)
        seen = next((s for s in scene.shapes if s.role == "cursor"), None)
        if aim is None:
            aim = next((s for s in scene.shapes if s.role == "origin"), None)
        if aim is not None and seen is not None:
            wanted = np.array([aim.x - seen.x, aim.y - seen.y])
            self.theta += np.clip(0.06 * wanted, -0.6, 0.6) + 0.01 * self.rng.normal(size=2)
        impaired = requests.get("impairment", 0.0) > 0.5
        for k, (low, high) in enumerate(LIMITS_DEG):
            top = WALL_DEG if impaired and k == 0 else high
            self.theta[k] = min(max(self.theta[k], low), top)
        return self.time_s, {"fe_deg": float(self.theta[0]), "ru_deg": float(self.theta[1])}


class _WristTask(StudyTask):
    version = "2"
    inputs: ClassVar = {
        "fe_deg": TaskSignal("theta_load_rad", "flexion"),
        "ru_deg": TaskSignal("theta_load_rad", "deviation"),
    }

    def conditions(self, parameters: Any) -> Mapping[str, float]:
        return requests(parameters)

    def simulate(self, situation: Situation, rng: np.random.Generator) -> Actor:
        return Follower(rng)


# -- neutral ---------------------------------------------------------------------------------------


class NeutralParameters(TaskParameters):
    impairment: bool = Field(False, description="whether the simulated impairment acts")
    seconds: float = Field(3.0, ge=1, le=30, description="how long; the last second counts")
    still_deg: float = Field(2.0, gt=0, le=20, description="most motion in that second")


@dataclass(frozen=True)
class Resting:
    parameters: NeutralParameters
    kept: tuple[tuple[float, float, float], ...] = ()


@register
class Neutral(_WristTask):
    name = "wrist.neutral"
    Parameters = NeutralParameters
    columns = (
        IMPAIRMENT,
        DataColumn("neutral_fe_deg", float, "mean of the last second"),
        DataColumn("neutral_ru_deg", float, "mean of the last second"),
    )

    def longest_s(self, parameters: Any) -> float:
        return 4.0 * float(parameters.seconds)

    def begin(self, situation: Situation) -> Resting:
        return Resting(situation.parameters)

    def step(self, state: Resting, time_s: float, inputs: Inputs) -> TaskStep:
        kept = (*(x for x in state.kept if x[0] > time_s - 1.0), (time_s, *angles(inputs)))
        outcome = None
        p, values = state.parameters, np.array(kept)[:, 1:]
        fe, ru = (float(x) for x in np.mean(values, axis=0))
        still = float(np.max(np.ptp(values, axis=0))) <= p.still_deg
        if time_s >= p.seconds and still:
            found = {"neutral_fe_deg": fe, "neutral_ru_deg": ru}
            outcome = TrialOutcome({"impairment": p.impairment, **found})
        elif time_s >= self.longest_s(p):
            outcome = TrialOutcome(None, keyed("reason.not_still", still_deg=p.still_deg))
        # The room that the hand is to stay in, round where it was in the last second.
        room = Shape("ring", "guide", fe, ru, 1.0 + p.still_deg)
        texts = (Text("neutral"), *(() if still else (Text("still"),)))
        scene = Scene((room, dot("cursor", *angles(inputs))), texts)
        asked = requests(state.parameters)
        return TaskStep(replace(state, kept=kept), scene, asked, (), outcome)


# -- range -----------------------------------------------------------------------------------------


class RangeParameters(OnAxis):
    way: Way = Field(1, description="1 extension or radial, -1 flexion or ulnar")
    seconds: float = Field(4.0, ge=1, le=60, description="how long")


@dataclass(frozen=True)
class Reaching:
    parameters: RangeParameters
    middle: tuple[float, float]
    end_deg: float = 0.0


DIRECTIONS = {
    ("FE", 1): "range_up",
    ("FE", -1): "range_down",
    ("RU", 1): "range_thumb",
    ("RU", -1): "range_little",
}


@register
class Range(_WristTask):
    name = "wrist.range"
    Parameters = RangeParameters
    columns = (
        IMPAIRMENT,
        DataColumn("axis", str, "FE or RU"),
        DataColumn("way", int, "1 or -1"),
        DataColumn("end_deg", float, "furthest angle from the neutral position"),
    )

    def longest_s(self, parameters: Any) -> float:
        return float(parameters.seconds)

    def begin(self, situation: Situation) -> Reaching:
        past = calibrated(situation.past, situation.parameters.impairment)
        return Reaching(situation.parameters, past.neutral)

    def step(self, state: Reaching, time_s: float, inputs: Inputs) -> TaskStep:
        p = state.parameters
        theta = angles(inputs)[AXES.index(p.axis)] - state.middle[AXES.index(p.axis)]
        end = max(state.end_deg, p.way * theta)
        outcome = None
        if time_s >= p.seconds:
            row = {"axis": p.axis, "way": p.way, "end_deg": float(p.way * end)}
            row["impairment"] = p.impairment
            outcome = TrialOutcome(row)
        far = place(p.axis, 100.0 * p.way)
        shapes = (
            Shape("line", "guide", 0.0, 0.0, 0.4, *place(p.axis, 60.0 * p.way)),
            dot("target", *far),
            Shape("ring", "node", *place(p.axis, p.way * end), 4.0),
            dot("cursor", *place(p.axis, theta), 2.5),
        )
        texts = [Text(DIRECTIONS[p.axis, p.way]), Text("reached", {"end_deg": round(end)})]
        # Who stands still before the time is up may have more to give.
        texts += [Text("further")] if end - p.way * theta > 5.0 and outcome is None else []
        scene = Scene(shapes, tuple(texts), 90.0)
        return TaskStep(replace(state, end_deg=end), scene, requests(p), (), outcome)


# -- velocity --------------------------------------------------------------------------------------


PATIENCE_S = 8.0
NOT_REACHED = Complaint("further", keyed("advice.end_not_reached", seconds=PATIENCE_S))


class VelocityParameters(OnAxis):
    movements: int = Field(5, ge=2, le=50, description="how many, from end to end")
    longest_s: float = Field(30.0, gt=1, le=300, description="then it ends anyhow")
    near_end: float = Field(
        0.05, gt=0, lt=0.5, description="share of the range that is an end, if no node is in it"
    )


@dataclass(frozen=True)
class Sweeping:
    parameters: VelocityParameters
    past: Calibrated
    done: int = -1  # the way to the first end does not count
    way: int = -1
    times: tuple[float, ...] = ()
    thetas: tuple[float, ...] = ()
    end_s: float = 0.0
    wanting: tuple[Complaint, ...] = ()


@register
class VelocitySweep(_WristTask):
    name = "wrist.velocity"
    version = "3"
    Parameters = VelocityParameters
    columns = (
        IMPAIRMENT,
        DataColumn("axis", str, "FE or RU"),
        DataColumn("movements", int, "that were made"),
        DataColumn("time_s", list, "times of the samples"),
        DataColumn("theta_deg", list, "angle from the neutral position"),
        DataColumn("complaints", list, "what was not good enough, and what to do"),
    )

    def longest_s(self, parameters: Any) -> float:
        return float(parameters.longest_s)

    def begin(self, situation: Situation) -> Sweeping:
        p = situation.parameters
        past = calibrated(situation.past, p.impairment)
        past.range_of(p.axis)
        return Sweeping(p, past)

    def step(self, state: Sweeping, time_s: float, inputs: Inputs) -> TaskStep:
        p = state.parameters
        k = AXES.index(p.axis)
        low, high = state.past.range_of(p.axis)
        theta = angles(inputs)[k] - state.past.neutral[k]
        room, nodes = p.near_end * (high - low), state.past.nodes(p.axis)
        # Never short of the outermost node, which would not be crossed by who turns round there.
        bottom, top = min([low + room, *nodes]), max([high - room, *nodes])
        there = theta < bottom if state.way < 0 else theta >= top
        done = state.done + there
        events: tuple[TaskEvent, ...] = ()
        state = replace(
            state,
            done=done,
            way=-state.way if there else state.way,
            end_s=time_s if there else state.end_s,
            times=(*state.times, time_s) if done >= 0 else (),
            thetas=(*state.thetas, theta) if done >= 0 else (),
        )
        if there and state.done > 0:
            # Once a movement: what it was like, on disk, on both screens.
            passes = min(state.done, LEAST_PASSES)
            found = quality(low, high, [(state.times, state.thetas)], passes)
            state = replace(state, wanting=tuple(found))
        if there:
            advice = [c.words for c in state.wanting]
            about = {"theta_deg": theta, "done": max(state.done, 0), "advice": advice}
            events = (TaskEvent("end_reached", about),)
        elif time_s - state.end_s > PATIENCE_S and NOT_REACHED not in state.wanting:
            state = replace(state, wanting=(*state.wanting, NOT_REACHED))
            events = (TaskEvent("end_not_reached", {"advice": [NOT_REACHED.words]}),)
        over = state.done >= p.movements or time_s >= p.longest_s
        outcome = self._outcome(state, low, high) if over else None
        return TaskStep(state, self._scene(state, theta), requests(p), events, outcome)

    def _outcome(self, state: Sweeping, low: float, high: float) -> TrialOutcome:
        complaints = [NOT_REACHED]  # not even once: there is nothing to judge
        if state.times:
            complaints = quality(low, high, [(state.times, state.thetas)])
        return TrialOutcome(
            {
                "impairment": state.parameters.impairment,
                "axis": state.parameters.axis,
                "movements": max(state.done, 0),
                "time_s": list(state.times),
                "theta_deg": list(state.thetas),
                "complaints": [c.words for c in complaints],
            }
        )

    def _scene(self, state: Sweeping, theta: float) -> Scene:
        axis = state.parameters.axis
        low, high = state.past.range_of(axis)
        # A full disc is a node that was crossed often and fast enough so far.
        short = (
            {c.node_deg for c in state.wanting} if state.done > 0 else set(state.past.nodes(axis))
        )
        nodes = [
            Shape("ring" if n in short else "disc", "node", *place(axis, n), 2.0)
            for n in state.past.nodes(axis)
        ]
        goal = dot("target", *place(axis, low if state.way < 0 else high), 4.0)
        left = state.parameters.movements - max(state.done, 0)
        words = [Text(w) for w in dict.fromkeys(c.key for c in state.wanting)]
        cursor = dot("cursor", *place(axis, theta), 2.5)
        return Scene((goal, *nodes, cursor), (Text("sweep", {"left": left}), *words), 90.0)
