"""Content of the wrist display from a board's telemetry, and a guided calibration.  No window."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_host.connection import Batch
from esea_host.people.person import minimum_jerk
from esea_host.study.fitting import ACTS, DeviceSignals
from esea_host.study.scene import Scene, Shape, Text
from esea_host.study.task import Inputs, Situation, task_named
from esea_host.wrist.calibration import AXES, WristCalibration, calibrated
from esea_host.wrist.normalisation import CursorMap, NodeSpeeds, check_nodes, normalise
from esea_host.wrist.tasks import dot, place

Floats = npt.NDArray[np.float64]
INPUTS = {"FE": "fe_deg", "RU": "ru_deg"}
FRAME_S, SAME_S = 0.01, 1e-6
MOST_ROWS = 2000  # that wait for the other axis
HALF_WIDTH_DEG = 70.0
CURSOR_SHARE, NODE_SHARE, EDGE_SHARE = 0.075, 0.03, 0.006  # of half the width


@dataclass(frozen=True)
class AxisView:
    """One axis now, from the neutral position."""

    name: str
    theta_deg: float
    cursor_deg: float
    factor: float


@dataclass(frozen=True)
class DisplayPicture:
    """acts: None without a constraint; applied: whether the cursor goes through the maps."""

    time_s: float
    acts: bool | None
    applied: bool
    axes: tuple[AxisView, ...]
    raw: Scene
    normalised: Scene


class WristDisplay:
    """Takes telemetry, gives pictures; a guide takes the same frames."""

    def __init__(self, device: Device, calibration: WristCalibration | None = None) -> None:
        signals, task = DeviceSignals(device), task_named("wrist.neutral", "the display")
        taps, acting = signals.taps(task), signals.of_axes(ACTS)
        names = {a: task.inputs[n].axis for a, n in INPUTS.items()}
        self.can_constrain = acting.keys() >= set(names.values())
        self.streams = {taps[n].stream: a for a, n in INPUTS.items()}
        self._angles = {a: taps[n] for a, n in INPUTS.items()}
        self._acting = {a: acting[n].column for a, n in names.items()} if self.can_constrain else {}
        # Of each axis its rows that are not used yet: time_s, theta_deg, acts.
        self._pending = {a: np.empty((0, 3)) for a in AXES}
        self._due_s = -math.inf
        self.time_s, self.angles_deg, self.acts = 0.0, (0.0, 0.0), False
        self.guide: CalibrationGuide | None = None
        self.calibrate(calibration)

    def calibrate(self, calibration: WristCalibration | None) -> None:
        self.maps: dict[str, CursorMap] | None = calibration.maps() if calibration else None
        self.calibration = calibration

    # -- telemetry ---------------------------------------------------------------------------------

    def receive(self, batches: Sequence[Batch]) -> None:
        """Take rows as they came: a frame each 10 ms of the board's time."""
        for batch in batches:
            if axis := self.streams.get(batch.layout.name):
                self._take(axis, batch)
        while self._frame():
            pass

    def _take(self, axis: str, batch: Batch) -> None:
        tap, rows = self._angles[axis], batch.rows
        acts = rows[self._acting[axis]] if self.can_constrain else np.zeros(len(rows))
        theta_deg = tap.factor * rows[tap.column].astype(np.float64)
        new = np.column_stack([batch.board_ns * 1e-9, theta_deg, acts])
        self._pending[axis] = np.concatenate([self._pending[axis], new])[-MOST_ROWS:]

    def _frame(self) -> bool:
        # The first row of FE that is due, with the newest one of RU by then.
        fe, ru = (self._pending[a] for a in AXES)
        i = int(np.searchsorted(fe[:, 0], self._due_s - SAME_S))
        if i == len(fe) or not len(ru) or fe[i, 0] > ru[-1, 0] + SAME_S:
            return False
        j = int(np.searchsorted(ru[:, 0], fe[i, 0] + SAME_S)) - 1
        if j < 0:  # RU has only begun
            self._due_s = float(ru[0, 0])
            return True
        self.time_s = float(fe[i, 0])
        self.angles_deg = float(fe[i, 1]), float(ru[j, 1])
        self.acts = bool(min(fe[i, 2], ru[j, 2]) > 0.5)
        self._due_s = self.time_s + FRAME_S
        self._pending = {"FE": fe[i + 1 :], "RU": ru[j:]}
        if self.guide is not None:
            inputs = {"fe_deg": self.angles_deg[0], "ru_deg": self.angles_deg[1]}
            self.guide.step(self.time_s, inputs, self.acts)
        return True

    # -- picture -----------------------------------------------------------------------------------

    @property
    def applied(self) -> bool:
        return self.maps is not None and (self.acts or not self.can_constrain)

    @property
    def half_width_deg(self) -> float:
        """Of both panes: room for the healthy range, and for where the maps lead."""
        if self.calibration is None:
            return HALF_WIDTH_DEG
        ends = [x for a in AXES for x in self.calibration.healthy.axis(a).range_deg]
        for mapped in (self.maps or {}).values():
            ends += mapped.position([mapped.low_deg, mapped.high_deg]).tolist()
        return 1.2 * max(map(abs, ends))

    def picture(self) -> DisplayPicture:
        state = self.calibration.state(self.applied) if self.calibration else None
        neutral = (state.neutral_fe_deg, state.neutral_ru_deg) if state else (0.0, 0.0)
        axes = tuple(
            self._axis(a, x - n) for a, x, n in zip(AXES, self.angles_deg, neutral, strict=True)
        )
        raw, normalised = self._panes(axes)
        acts = self.acts if self.can_constrain else None
        return DisplayPicture(self.time_s, acts, self.applied, axes, raw, normalised)

    def _axis(self, name: str, theta_deg: float) -> AxisView:
        if not self.applied or self.maps is None:
            return AxisView(name, theta_deg, theta_deg, 1.0)
        mapped = self.maps[name]
        cursor, factor = mapped.position(theta_deg), mapped.scaling(theta_deg)
        return AxisView(name, theta_deg, float(cursor), float(factor))

    def _panes(self, axes: Sequence[AxisView]) -> tuple[Scene, Scene]:
        raw_x, raw_y = (a.theta_deg for a in axes)
        x, y = (a.cursor_deg for a in axes)
        raw, normalised = [], []
        if self.calibration is not None:
            healthy = self.calibration.healthy
            state = self.calibration.state(self.applied) or healthy
            # Where the maps apply, 0 is the middle of either range.
            middle = {a: sum(healthy.axis(a).range_deg) / 2 * self.applied for a in AXES}
            for axis in AXES:
                nodes = np.array(state.axis(axis).nodes_deg)
                there = self.maps[axis].position(nodes) if self.applied and self.maps else nodes
                raw += self._nodes(axis, nodes)
                normalised += self._nodes(axis, there)
            raw += self._box([state.axis(a).range_deg for a in AXES])
            ends = [np.array(healthy.axis(a).range_deg) - middle[a] for a in AXES]
            normalised += self._box([(float(e[0]), float(e[1])) for e in ends])
        half = self.half_width_deg
        cross = [
            Shape("line", "guide", *place(a, -half), 0.3 * EDGE_SHARE * half, *place(a, half))
            for a in AXES
        ]
        size = CURSOR_SHARE * half
        left = Scene((*cross, *raw, dot("cursor", raw_x, raw_y, size)), (), half)
        return left, Scene((*cross, *normalised, dot("cursor", x, y, size)), (), half)

    def _nodes(self, axis: str, nodes_deg: Floats) -> list[Shape]:
        size = NODE_SHARE * self.half_width_deg
        return [Shape("ring", "node", *place(axis, float(n)), size) for n in nodes_deg]

    def _box(self, ranges: Sequence[tuple[float, float]]) -> list[Shape]:
        (left, right), (bottom, top) = ranges
        corners = [(left, bottom), (right, bottom), (right, top), (left, top), (left, bottom)]
        edge = EDGE_SHARE * self.half_width_deg
        return [Shape("line", "boundary", *a, edge, *b) for a, b in pairwise(corners)]


RANGE_S, MOVEMENTS = 6.0, 5
GUIDED_SHARE = 0.05  # of the cursor, of half the width
TITLES = {"wrist.neutral": "neutral position", "wrist.range": "range", "wrist.velocity": "sweeps"}


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
    least = GUIDED_SHARE * scene.half_width
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
