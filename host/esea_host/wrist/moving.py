"""Tasks with a cursor: tracking one's own healthy motion, and catching the target that moves."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydantic import Field

from esea_gen.errors import UserError
from esea_host.study.scene import Scene, Shape, Text
from esea_host.study.task import (
    DataColumn,
    Inputs,
    Situation,
    TaskEvent,
    TaskStep,
    TrialOutcome,
    register,
)
from esea_host.study.words import keyed
from esea_host.wrist.calibration import AXES, Method, calibrated, cursor_maps
from esea_host.wrist.normalisation import CursorMap
from esea_host.wrist.tasks import IMPAIRMENT, OnAxis, Way, _WristTask, angles, dot, place, requests

Row = Mapping[str, Any]
MASS_KG, DAMPING_KG_S = 5.0, 18.0  # equation 7.7; the printed unit kgm/s is a misprint
WITHIN_DEG, HOLD_S, REACH_S = 2.0, 0.75, 10.0
SHARE, LARGER_SHARE = 0.20, 0.25
ANGLES_SEEN = 0.25  # of the distance: a first excursion that far is a strategy, not a tremor


class OnScreen(OnAxis):
    method: Method = Field("rbf", description="normalisation: none, linear, published or rbf")


# First columns of their rows.
SHOWN = (
    IMPAIRMENT,
    DataColumn("axis", str, "FE or RU"),
    DataColumn("method", str, "normalisation"),
)


def _about(p: OnScreen) -> dict[str, Any]:
    return {"impairment": p.impairment, "axis": p.axis, "method": p.method}


def _since(near: bool, before_s: float | None, now_s: float) -> float | None:
    # From when on something has been so without a break.
    return (now_s if before_s is None else before_s) if near else None


@dataclass(frozen=True)
class Cursor:
    """From angles to the screen: the neutral position at 0; constrained, through the maps."""

    neutral: tuple[float, float]
    maps: Mapping[str, CursorMap] | None

    def logged(self) -> Row:
        if self.maps is None:
            return {}
        fitted = {a: m.numbers() for a, m in self.maps.items()}
        text = json.dumps(fitted, sort_keys=True)
        digest = hashlib.sha256(text.encode()).hexdigest()
        return {"normalisation": fitted, "normalisation_sha256": digest}

    def at(self, inputs: Inputs) -> tuple[float, float]:
        raw = [a - n for a, n in zip(angles(inputs), self.neutral, strict=True)]
        if self.maps is not None:
            raw = [float(self.maps[a].position(x)) for a, x in zip(AXES, raw, strict=True)]
        return raw[0], raw[1]


def cursor_of(past: Sequence[Row], parameters: OnScreen) -> Cursor:
    maps = cursor_maps(past, parameters.method) if parameters.impairment else None
    return Cursor(calibrated(past, parameters.impairment).neutral, maps)


# -- validation ------------------------------------------------------------------------------------


class TrackParameters(OnScreen):
    take: int = Field(0, ge=0, le=20, description="which block of the healthy calibration, from 0")
    start_within_deg: float = Field(5.0, gt=0, le=90, description="how near its start is ready")
    start_s: float = Field(8.0, gt=0, le=60, description="then it starts anyhow")


@dataclass(frozen=True)
class Tracking:
    parameters: TrackParameters
    cursor: Cursor
    healthy: tuple[tuple[float, ...], tuple[float, ...]]
    ready_since_s: float | None = None
    begun_s: float | None = None
    times: tuple[float, ...] = ()
    cursors: tuple[float, ...] = ()
    targets: tuple[float, ...] = ()


@register
class Track(_WristTask):
    name = "wrist.track"
    Parameters = TrackParameters
    columns = (
        *SHOWN,
        DataColumn("time_s", list, "times of the samples"),
        DataColumn("cursor_deg", list, "cursor along the axis"),
        DataColumn("target_deg", list, "the healthy motion"),
    )

    def longest_s(self, parameters: Any) -> float:
        return float(parameters.start_s) + 30.0

    def begin(self, situation: Situation) -> Tracking:
        p = situation.parameters
        traces = calibrated(situation.past, False).traces.get(p.axis, ())
        if p.take >= len(traces) or not len(traces[p.take][0]):
            raise UserError(
                f"There is no healthy movement block {p.take} of {p.axis} to replay: "
                f"{len(traces)} were recorded.",
                "Name one of them with take, or put the healthy calibration before.",
            )
        times, thetas = traces[p.take]
        # Constrained, 0 is the middle of the range; so it is for what is tracked there.
        middle = sum(calibrated(situation.past, False).range_of(p.axis)) / 2 * p.impairment
        healthy = (tuple(t - times[0] for t in times), tuple(x - middle for x in thetas))
        return Tracking(p, cursor_of(situation.past, p), healthy)

    def step(self, state: Tracking, time_s: float, inputs: Inputs) -> TaskStep:
        p = state.parameters
        times, thetas = state.healthy
        x, y = state.cursor.at(inputs)
        if state.begun_s is None:
            return self._get_ready(state, time_s, (x, y))
        shown = time_s - state.begun_s
        target = _interpolated(shown, times, thetas, len(state.times))
        state = replace(
            state,
            times=(*state.times, shown),
            cursors=(*state.cursors, x if p.axis == "FE" else y),
            targets=(*state.targets, target),
        )
        shapes = (dot("target", *place(p.axis, target), 4.0), dot("cursor", x, y, 2.5))
        outcome = None
        if shown >= times[-1]:
            taken = {"time_s": list(state.times), "cursor_deg": list(state.cursors)}
            outcome = TrialOutcome(_about(p) | taken | {"target_deg": list(state.targets)})
        return TaskStep(state, Scene(shapes, (Text("follow"),), 90.0), requests(p), (), outcome)

    def _get_ready(self, state: Tracking, time_s: float, here: tuple[float, float]) -> TaskStep:
        # The motion starts once the cursor has been at its start for half a second.
        p, start = state.parameters, state.healthy[1][0]
        near = abs(here[AXES.index(p.axis)] - start) <= p.start_within_deg
        since = _since(near, state.ready_since_s, time_s)
        held = since is not None and time_s - since >= 0.5
        begun = time_s if held or time_s >= p.start_s else None
        events = (
            (TaskEvent("started", {"ready": held, **state.cursor.logged()}),)
            if begun is not None
            else ()
        )
        shapes = (dot("target", *place(p.axis, start), 4.0), dot("cursor", *here, 2.5))
        state = replace(state, ready_since_s=since, begun_s=begun)
        return TaskStep(state, Scene(shapes, (Text("follow"),), 90.0), requests(p), events)


def _interpolated(
    time_s: float, times: Sequence[float], values: Sequence[float], near: int
) -> float:
    # ``near``: about how many samples are past, so that nothing is searched from the start.
    k = min(near, len(times) - 1)
    while k > 0 and times[k] > time_s:
        k -= 1
    while k + 1 < len(times) and times[k + 1] <= time_s:
        k += 1
    if k + 1 == len(times) or time_s <= times[k]:
        return float(values[k])
    share = (time_s - times[k]) / (times[k + 1] - times[k])
    return float(values[k] + share * (values[k + 1] - values[k]))


# -- motor learning --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Moving:
    x_deg: float
    v_deg_s: float = 0.0


def advance(
    target: Moving, cursor_from_deg: float, cursor_to_deg: float, dt_s: float, rate_1_s: float
) -> Moving:
    """One step of equation 7.7, exact for a cursor that moves evenly between two samples."""
    speed = (cursor_to_deg - cursor_from_deg) / dt_s
    slip = target.v_deg_s - speed
    kept = math.exp(-rate_1_s * dt_s)
    moved = speed * dt_s + slip * (1.0 - kept) / rate_1_s
    return Moving(target.x_deg + moved, speed + kept * slip)


def target_distance_deg(smallest_deg: float) -> float:
    """Distance of targets: a fifth of the smallest range, a quarter if that is too near."""
    for share in (SHARE, LARGER_SHARE):
        if share * smallest_deg > WITHIN_DEG:
            return share * smallest_deg
    raise UserError(
        f"The smallest range of motion is {smallest_deg:.1f} deg: targets at "
        f"{100 * LARGER_SHARE:.0f} % of it would appear within {WITHIN_DEG:g} deg of the origin, "
        "caught before anything moves.",
        f"More than {WITHIN_DEG / LARGER_SHARE:g} deg are needed: measure again with another "
        "neutral position; a person who cannot reach that cannot do this task.",
    )


class CatchParameters(OnScreen):
    way: Way = Field(1, description="1 extension or radial, -1 flexion or ulnar")
    stationary: bool = Field(False, description="whether the target stands still")
    mass_kg: float = Field(MASS_KG, gt=0, le=100, description="of the target")
    damping_kg_s: float = Field(DAMPING_KG_S, gt=0, le=1000, description="to the cursor")
    boundary_share: float = Field(
        1.5, gt=0.2, le=5, description="outer boundary over the smallest range (not published)"
    )
    sse_rate_Hz: float = Field(
        100.0, gt=0, le=1000, description="sampling of the SSE (not published)"
    )
    home_s: float = Field(10.0, gt=0, le=60, description="longest way back to the origin")
    reach_s: float = Field(REACH_S, gt=0, le=60, description="then it is missed")


@dataclass(frozen=True)
class Catching:
    parameters: CatchParameters
    cursor: Cursor
    distance_deg: float
    boundary_deg: float
    home_since_s: float | None = None
    shown_s: float | None = None
    last_s: float = 0.0
    last: tuple[float, float] = (0.0, 0.0)
    target: tuple[Moving, Moving] = (Moving(0.0), Moving(0.0))
    within_since_s: float | None = None
    sse_deg2: float = 0.0
    furthest_deg: float = 0.0
    nearest_deg: float = 0.0
    pulled_away: bool | None = None


@register
class Catch(_WristTask):
    name = "wrist.catch"
    Parameters = CatchParameters
    columns = (
        *SHOWN,
        DataColumn("stationary", bool, "whether the target stood still"),
        DataColumn("achieved", bool, "within 2 deg for 750 ms"),
        DataColumn("left", bool, "whether it was lost over the boundary"),
        DataColumn("reach_time_s", float, "from its appearance to the end"),
        DataColumn("sse_deg2", float, "sum of squared distances at sse_rate_Hz"),
        DataColumn("distance_deg", float, "where it appeared"),
        DataColumn("furthest_deg", float, "cursor's furthest way towards it"),
        DataColumn("nearest_deg", float, "cursor's furthest way from it, negative"),
        DataColumn("pulled_away", bool, "whether the cursor went away from it first"),
    )

    def longest_s(self, parameters: Any) -> float:
        return float(parameters.home_s + parameters.reach_s)

    def begin(self, situation: Situation) -> Catching:
        p = situation.parameters
        smallest = calibrated(situation.past, False).smallest_deg()
        distance = target_distance_deg(smallest)
        cursor = cursor_of(situation.past, p)
        return Catching(p, cursor, distance, p.boundary_share * smallest)

    def step(self, state: Catching, time_s: float, inputs: Inputs) -> TaskStep:
        here = state.cursor.at(inputs)
        if state.shown_s is None:
            return self._home(state, time_s, here)
        state, events = self._moved(state, time_s, here)
        p, shown = state.parameters, time_s - (state.shown_s or 0.0)
        held = state.within_since_s is not None and time_s - state.within_since_s >= HOLD_S
        left = math.hypot(state.target[0].x_deg, state.target[1].x_deg) > state.boundary_deg
        outcome = None
        if held or left or shown >= p.reach_s:
            outcome = TrialOutcome(self._row(state, shown, held, left and not held))
            events = (*events, TaskEvent("caught" if held else "missed"))
        return TaskStep(
            state, self._scene(state, here, outcome, held), requests(p), events, outcome
        )

    def _home(self, state: Catching, time_s: float, here: tuple[float, float]) -> TaskStep:
        since = _since(math.hypot(*here) <= WITHIN_DEG, state.home_since_s, time_s)
        p = state.parameters
        state = replace(state, home_since_s=since, last_s=time_s, last=here)
        events: tuple[TaskEvent, ...] = ()
        outcome = None
        if since is not None and time_s - since >= 0.5:
            x, y = place(p.axis, p.way * state.distance_deg)
            state = replace(state, shown_s=time_s, target=(Moving(x), Moving(y)))
            events = (TaskEvent("target", {"x_deg": x, "y_deg": y, **state.cursor.logged()}),)
        elif time_s >= p.home_s:
            outcome = TrialOutcome(None, keyed("reason.not_home"))
        return TaskStep(state, self._scene(state, here, None, False), requests(p), events, outcome)

    def _moved(
        self, state: Catching, time_s: float, here: tuple[float, float]
    ) -> tuple[Catching, tuple[TaskEvent, ...]]:
        p, dt = state.parameters, time_s - state.last_s
        target = state.target
        if not p.stationary:
            rate = p.damping_kg_s / p.mass_kg
            moved = [
                advance(t, a, b, dt, rate) for t, a, b in zip(target, state.last, here, strict=True)
            ]
            target = (moved[0], moved[1])
        error = math.hypot(here[0] - target[0].x_deg, here[1] - target[1].x_deg)
        since = state.within_since_s
        inside = error <= WITHIN_DEG
        events = (TaskEvent("within"),) if inside and since is None else ()
        along = p.way * here[AXES.index(p.axis)]
        away = state.pulled_away
        if away is None and abs(along) > ANGLES_SEEN * state.distance_deg:
            away = along < 0
        state = replace(
            state,
            last_s=time_s,
            last=here,
            target=target,
            within_since_s=_since(inside, since, time_s),
            sse_deg2=state.sse_deg2 + error**2 * dt * p.sse_rate_Hz,
            furthest_deg=max(state.furthest_deg, along),
            nearest_deg=min(state.nearest_deg, along),
            pulled_away=away,
        )
        return state, events

    def _row(self, state: Catching, shown: float, held: bool, left: bool) -> Row:
        p = state.parameters
        kept = ("sse_deg2", "distance_deg", "furthest_deg", "nearest_deg")
        return {
            **_about(p),
            "stationary": p.stationary,
            "achieved": held,
            "left": left,
            "reach_time_s": shown,
            **{name: getattr(state, name) for name in kept},
            "pulled_away": bool(state.pulled_away),
        }

    def _scene(
        self, state: Catching, here: tuple[float, float], outcome: TrialOutcome | None, held: bool
    ) -> Scene:
        shapes = [
            Shape("ring", "boundary", 0.0, 0.0, state.boundary_deg),
            dot("origin", 0.0, 0.0, 0.8),
        ]
        if state.shown_s is not None:
            role = "failed" if outcome is not None and not held else "target"
            x, y = (t.x_deg for t in state.target)
            shapes.append(Shape("disc", role, x, y, WITHIN_DEG))
        shapes.append(dot("cursor", *here, 0.8))
        text = "reach" if outcome is None else "caught" if held else "missed"
        return Scene(tuple(shapes), (Text(text),), 1.3 * state.boundary_deg)
