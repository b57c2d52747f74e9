"""A guided calibration: the study's tasks one after another, without a session."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from esea_gen.errors import UserError
from esea_host.people.person import minimum_jerk
from esea_host.study.scene import Scene, Text
from esea_host.study.task import Inputs, Situation, task_named
from esea_host.wrist.calibration import AXES, calibrated
from esea_host.wrist.normalisation import NodeSpeeds, check_nodes, normalise
from esea_host.wrist.tasks import dot

RANGE_S, MOVEMENTS = 6.0, 5
CURSOR_SHARE = 0.05  # of half the width
TITLES = {
    "wrist.neutral": "neutral position",
    "wrist.range": "range",
    "wrist.velocity": "sweeps",
}


@dataclass(frozen=True)
class GuideStep:
    task: str
    parameters: Mapping[str, Any]

    @property
    def constrained(self) -> bool:
        return bool(self.parameters["impairment"])

    @property
    def title(self) -> str:
        axis = f", {self.parameters['axis']}" if "axis" in self.parameters else ""
        return f"{'constrained' if self.constrained else 'healthy'}: {TITLES[self.task]}{axis}"


def guide_steps(constraint: bool, range_s: float, movements: int) -> tuple[GuideStep, ...]:
    steps = []
    for impairment in (False, True) if constraint else (False,):
        state = {"impairment": impairment}
        steps.append(GuideStep("wrist.neutral", state))
        steps += [
            GuideStep("wrist.range", state | {"axis": a, "way": way, "seconds": range_s})
            for a in AXES
            for way in (1, -1)
        ]
        sweep = {"movements": movements}
        steps += [GuideStep("wrist.velocity", state | sweep | {"axis": a}) for a in AXES]
    return tuple(steps)


class CalibrationGuide:
    """Leads through a calibration, frame by frame; ``advice``: why the last step is repeated."""

    def __init__(
        self, constraint: bool, range_s: float = RANGE_S, movements: int = MOVEMENTS
    ) -> None:
        self._constraint = constraint
        self.steps = guide_steps(constraint, range_s, movements)
        self.past: list[dict[str, Any]] = []
        self.advice, self.scene = "", Scene()
        self._state: Any = None
        self._begun_s = 0.0

    @property
    def current(self) -> GuideStep | None:
        at = len(self.past)
        return self.steps[at] if at < len(self.steps) else None

    def back(self, steps: int = 1) -> None:
        """Repeat the step before this one; at the end, the last one."""
        del self.past[max(0, len(self.past) - steps) :]
        self._state = None

    def step(self, time_s: float, inputs: Inputs, acts: bool) -> None:
        step = self.current
        if step is None:
            return
        if self._constraint and acts != step.constrained:
            # Switched where the wrist rests; a step that has begun starts again.
            here = dot("cursor", inputs["fe_deg"], inputs["ru_deg"])
            self._state, self.scene = None, _readable(Scene((here,), (Text("wait"),), 90.0))
            return
        task = task_named(step.task, "calibration")
        if self._state is None:
            parameters = task.Parameters(**step.parameters)
            self._state = task.begin(Situation(parameters, "", tuple(self.past), 0))
            self._begun_s = time_s
        done = task.step(self._state, round(time_s - self._begun_s, 6), inputs)
        self._state, self.scene = done.state, _readable(done.scene)
        if done.outcome is None:
            return
        self._state, self.advice = None, done.outcome.reason
        if done.outcome.row is not None:
            self.past.append({"task": step.task, **done.outcome.row})
            self.advice = " ".join(done.outcome.row.get("complaints", ()))
            self._check(step)

    def _check(self, step: GuideStep) -> None:
        # What no cursor map could be made of is measured again at once.
        p = step.parameters
        if "axis" not in p or p.get("way") == 1:
            return
        found = calibrated(self.past, step.constrained)
        try:
            if step.task == "wrist.range":
                low, high = found.range_of(p["axis"])
                nodes = found.nodes(p["axis"])
                speeds = NodeSpeeds(low, high, tuple(nodes), (1.0,) * len(nodes))
            else:
                speeds = found.speeds(p["axis"])
            check_nodes(step.title, speeds)
            if step.task == "wrist.velocity" and step.constrained:
                normalise(calibrated(self.past, False).speeds(p["axis"]), speeds)
        except UserError as error:
            self.advice = str(error)
            self.back(2 if step.task == "wrist.range" else 1)


def _readable(scene: Scene) -> Scene:
    # The cursor at least as large as can be seen from two metres.
    least = CURSOR_SHARE * scene.half_width
    shapes = (
        replace(s, size=max(s.size, least)) if s.role == "cursor" else s for s in scene.shapes
    )
    return replace(scene, shapes=tuple(shapes))


LIMITS_DEG = (-55.0, 45.0), (-25.0, 18.0)
WANDER_DEG, WANDER_HZ = (35.0, 13.0), (0.15, 0.23)
PEAK_DEG_S, LEAST_S, PATIENCE_S = 110.0, 0.4, 1.0
MOST_PUSH_DEG = 25.0  # beyond a wall
MIN_JERK = 1.875  # peak over mean speed of a minimum-jerk movement


class WanderingHand:
    def __init__(self) -> None:
        self.dragged_deg: tuple[float, float] | None = None
        self.aim_deg = (0.0, 0.0)
        self._target: tuple[float, float] | None = None
        self._from = self._to = (0.0, 0.0)
        self._begun_s, self._length_s = 0.0, LEAST_S

    def aim(
        self, time_s: float, scene: Scene | None, angles_deg: tuple[float, float]
    ) -> tuple[float, float]:
        if self.dragged_deg is not None:
            goal = self.dragged_deg
        elif scene is not None:
            goal = self._led(time_s, scene)
        else:
            turns = zip(WANDER_DEG, WANDER_HZ, strict=True)
            fe, ru = (a * math.sin(2 * math.pi * f * time_s) for a, f in turns)
            goal = fe, ru
        fe, ru = (
            min(max(min(max(g, x - MOST_PUSH_DEG), x + MOST_PUSH_DEG), low), high)
            for g, (low, high), x in zip(goal, LIMITS_DEG, angles_deg, strict=True)
        )
        self.aim_deg = fe, ru
        return self.aim_deg

    def _led(self, time_s: float, scene: Scene) -> tuple[float, float]:
        # To each new target in one minimum-jerk movement; again if it is not reached.
        target = next((s for s in scene.shapes if s.role == "target"), None)
        cursor = next((s for s in scene.shapes if s.role == "cursor"), None)
        place = None if target is None or cursor is None else (target.x, target.y)
        late = time_s > self._begun_s + self._length_s + PATIENCE_S
        if place != self._target or late:
            self._target, self._begun_s, self._from = place, time_s, self.aim_deg
            self._to = (0.0, 0.0)
            if place is not None and target is not None and cursor is not None:
                off = target.x - cursor.x, target.y - cursor.y
                fe, ru = (
                    min(max(a + d, low), high)
                    for a, d, (low, high) in zip(self.aim_deg, off, LIMITS_DEG, strict=True)
                )
                self._to = fe, ru
            length = math.dist(self._from, self._to) * MIN_JERK / PEAK_DEG_S
            self._length_s = max(length, LEAST_S)
        share = minimum_jerk((time_s - self._begun_s) / self._length_s)
        fe, ru = (a + share * (b - a) for a, b in zip(self._from, self._to, strict=True))
        return fe, ru
