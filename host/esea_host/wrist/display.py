"""Content of the wrist display from a board's telemetry.  No window."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from esea_gen.device import Device
from esea_host.connection import Batch
from esea_host.study.fitting import ACTS, DeviceSignals
from esea_host.study.scene import Scene, Shape
from esea_host.study.task import task_named
from esea_host.wrist.calibration import AXES
from esea_host.wrist.guide import CalibrationGuide
from esea_host.wrist.normalisation import CursorMap
from esea_host.wrist.stored import WristCalibration
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
        neutral = state.neutral_deg if state else (0.0, 0.0)
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
