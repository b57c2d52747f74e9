"""The assessment on the study engine: probing movements, pendulum test, passive range of motion.

Pure steps, as every task: ``angle_rad`` and ``torque_Nm`` come in, a scene goes out, and at the end
a row.  The next probing movement follows from the rows before it, so that a session that was cut
off goes on where it was, and a log replays to the same movements.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from esea_gen.errors import UserError
from esea_host.assess import Measure, Summary
from esea_host.assess.database import ResponseDataBase, shipped
from esea_host.assess.hypotheses import Hypotheses
from esea_host.assess.passive_tests import MotionRange, PendulumResult, motion_range, pendulum_test
from esea_host.assess.patients import DEG, MEAN_HEIGHT_M, MEAN_MASS_KG, Array
from esea_host.assess.probing import Comfort, ProbingMovement, informative, next_movement
from esea_host.assess.responses import LegRecording, Location, MovementReadings, along, passage
from esea_host.assess.session import Assessment, assessed_hypotheses
from esea_host.study.scene import Scene, Shape, Text
from esea_host.study.task import (
    Actor,
    DataColumn,
    Inputs,
    Row,
    Situation,
    StudyTask,
    TaskEvent,
    TaskParameters,
    TaskSignal,
    TaskStep,
    TrialOutcome,
    register,
)

SHOWN, PAUSE_S, TRIES = 2, 1.0, 3
LEG = 30.0  # length in a scene
Sample = tuple[float, float, float]
INPUTS = {"angle_rad": TaskSignal("theta_load_rad"), "torque_Nm": TaskSignal("tau_Nm")}


def leg_scene(
    texts: Sequence[str],
    comfort: Comfort,
    angle_rad: float | None = None,
    target_rad: float | None = None,
    location_rad: float | None = None,
) -> Scene:
    """A leg from its side: thigh level, knee in the middle; requested and actual movement."""

    def shank(role: str, angle: float, share: float = 1.0, wide: float = 1.0) -> Shape:
        x, y = LEG * share * float(np.cos(angle)), -LEG * share * float(np.sin(angle))
        return Shape("line", role, 0.0, 0.0, wide, x, y)

    def foot(role: str, angle: float, size: float, kind: Any = "disc") -> Shape:
        return Shape(kind, role, LEG * float(np.cos(angle)), -LEG * float(np.sin(angle)), size)

    shapes = [Shape("line", "guide", -LEG, 0.0, 1.0, 0.0, 0.0), Shape("disc", "guide", 0, 0, 1.2)]
    shapes += [shank("boundary", a, 1.15, 0.25) for a in (comfort.low_rad, comfort.high_rad)]
    if location_rad is not None:
        shapes.append(foot("node", location_rad, 1.6, "square"))
    if angle_rad is not None:
        shapes += [shank("cursor", angle_rad), foot("cursor", angle_rad, 1.8)]
    if target_rad is not None:
        shapes += [shank("target", target_rad), foot("target", target_rad, 2.6, "ring")]
    return Scene(tuple(shapes), tuple(Text(t) for t in (*texts, "knee_notice")))


class KneeParameters(TaskParameters):
    height_m: float = Field(MEAN_HEIGHT_M, ge=1.0, le=2.3, description="body height")
    mass_kg: float = Field(MEAN_MASS_KG, ge=15, le=250, description="body mass")
    low_deg: float = Field(0.0, ge=0, le=160, description="reach: least bending")
    high_deg: float = Field(130.0, ge=0, le=160, description="reach: most bending")
    fastest_deg_s: float = Field(120.0, gt=0, le=300, description="fastest comfortable speed")
    simulated: str = Field("S3", description="simulated patient, such as S3 or rigid")

    def comfort(self) -> Comfort:
        return Comfort(self.low_deg * DEG, self.high_deg * DEG, self.fastest_deg_s * DEG)


@dataclass(frozen=True)
class KneeState:
    parameters: Any
    past: tuple[Row, ...] = ()
    movement: ProbingMovement | None = None
    phase: str = "show"
    began_s: float = 0.0
    tries: int = 0
    samples: tuple[Sample, ...] = ()

    def with_sample(self, time_s: float, inputs: Inputs) -> KneeState:
        sample = (time_s, float(inputs["angle_rad"]), float(inputs.get("torque_Nm", 0.0)))
        return replace(self, samples=(*self.samples, sample))

    def recording(self) -> LegRecording:
        t, angle, torque = np.array(self.samples).T
        return LegRecording(t, angle, torque, self.parameters.height_m, self.parameters.mass_kg)


class _KneeTask(StudyTask):
    Parameters = KneeParameters
    inputs: ClassVar = INPUTS

    def begin(self, situation: Situation) -> KneeState:
        return KneeState(situation.parameters, situation.past)


# -- probing ------------------------------------------------------------------------------------


class ProbeParameters(KneeParameters):
    database: str = Field("", description="database file; default: the simulated knee's")
    mixed: bool = Field(False, description="also consider two disorders at once")
    summary: Summary = Field("people", description="of the database")
    measure: Measure = Field("expected", description="measure that chooses movements")


@lru_cache(maxsize=4)
def _known(path: str, summary: str, mixed: bool) -> tuple[ResponseDataBase, Hypotheses]:
    data = ResponseDataBase.load(Path(path)) if path else shipped()
    return data, assessed_hypotheses(data, summary, mixed)


def assessment_of(parameters: Any, rows: Sequence[Row]) -> Assessment:
    """Result of the probing movements among a participant's rows."""
    data, hypotheses = _known(parameters.database, parameters.summary, parameters.mixed)
    session = Assessment(data, hypotheses=hypotheses, clock=str)  # a step knows no clock
    for row in rows:
        if row["task"] == ProbeTask.name:
            _take_row(session, row)
    return session


def _take_row(session: Assessment, row: Row) -> None:
    if row["readings"]:
        places = tuple(Location(a, r) for a, r, _ in row["readings"])
        values = np.array([y for _, _, y in row["readings"]])
        error, distance = np.array(row["error_Nm2"]), float(row["distance"])
        session.observe_movement(MovementReadings(places, values, error, distance))
    if not row["passed"]:
        session.missed(Location(row["asked_rad"], row["asked_rad_s"]))


@register
class ProbeTask(_KneeTask):
    """The most telling movement: shown twice, then followed; again where it was missed."""

    name = "knee-probe"
    Parameters = ProbeParameters
    columns = (
        DataColumn("asked_rad", float, "requested bending"),
        DataColumn("asked_rad_s", float, "its rate"),
        DataColumn("passed", bool, "whether the location was reached"),
        DataColumn("distance", float, "distance of the nearest point, in tolerances"),
        DataColumn("tries", int, "number of attempts"),
        DataColumn("readings", list, "angle_rad, rate_rad_s, response_Nm of each place passed"),
        DataColumn("error_Nm2", list, "covariance of the errors of these responses"),
        DataColumn("most_like", str, "most probable answer afterwards"),
        DataColumn("probability", float, "its probability"),
        DataColumn("settled", bool, "whether probabilities have stopped changing"),
    )

    def longest_s(self, parameters: Any) -> float:
        return float((SHOWN + TRIES) * (parameters.comfort().longest_s + PAUSE_S) + 1)

    def begin(self, situation: Situation) -> KneeState:
        """With the movement that tells most after all before."""
        state = super().begin(situation)
        given = state.parameters
        session = assessment_of(given, state.past)
        value = informative(session, given.comfort(), given.measure)
        return replace(state, movement=next_movement(session, given.comfort(), value))

    def step(self, state: Any, time_s: float, inputs: Inputs) -> TaskStep:
        move = state.movement
        period_s = move.duration_s + PAUSE_S
        if state.phase == "show" and time_s - state.began_s >= SHOWN * period_s:
            state = replace(state, phase="follow", began_s=time_s)
        inside = (time_s - state.began_s) % period_s
        if state.phase == "follow":
            if time_s - state.began_s >= period_s:
                return self._judged(state, time_s, inputs)
            state = state.with_sample(time_s, inputs)
        return TaskStep(state, _probe_scene(state, inside, inputs))

    def _judged(self, state: KneeState, time_s: float, inputs: Inputs) -> TaskStep:
        move = state.movement
        assert move is not None
        found, tries = along(passage(state.recording()), move.location), state.tries + 1
        again = replace(state, began_s=time_s, tries=tries, samples=())
        scene = _probe_scene(again, 0.0, inputs)
        passed = found is not None and found.passed
        if not passed and tries < TRIES:
            return TaskStep(again, scene, events=(TaskEvent("missed", {"tries": tries}),))
        pairs = zip(found.locations, found.responses_Nm, strict=True) if found else ()
        row: dict[str, Any] = {
            "asked_rad": move.location.angle_rad,
            "asked_rad_s": move.location.rate_rad_s,
            "passed": passed,
            "distance": found.distance if found else None,
            "tries": tries,
            "readings": [[w.angle_rad, w.rate_rad_s, float(y)] for w, y in pairs],
            "error_Nm2": found.error_Nm2.tolist() if found else [],
        }
        session = assessment_of(state.parameters, state.past)
        _take_row(session, row)
        best = max(session.by_name().items(), key=lambda x: x[1])
        row |= {"most_like": best[0], "probability": best[1], "settled": session.settled}
        return TaskStep(again, scene, outcome=TrialOutcome(row))

    def simulate(self, situation: Situation, rng: np.random.Generator) -> Actor:
        """The leg of a simulated patient, and hands that follow the display."""
        from esea_host.assess.simulated import probing_actor

        state = self.begin(situation)
        assert state.movement is not None
        still_s = SHOWN * (state.movement.duration_s + PAUSE_S)
        return probing_actor(state.parameters, state.movement, still_s, PAUSE_S, rng)


def _probe_scene(state: KneeState, inside_s: float, inputs: Inputs) -> Scene:
    move = state.movement
    assert move is not None
    key = "knee_watch" if state.phase == "show" else "knee_again" if state.tries else "knee_follow"
    target, comfort = float(move.at(inside_s)[0]), state.parameters.comfort()
    return leg_scene((key,), comfort, inputs["angle_rad"], target, move.location.angle_rad)


# -- tests of the first day -----------------------------------------------------------------------


class _FirstDayTask(_KneeTask):
    # The leg is watched for so many seconds; then one figure comes of all samples.

    @abstractmethod
    def scene(self, given: Any, time_s: float, angle_rad: float) -> Scene: ...

    @abstractmethod
    def measured(self, state: KneeState) -> Any: ...

    def longest_s(self, parameters: Any) -> float:
        return float(parameters.seconds) + 1

    def step(self, state: Any, time_s: float, inputs: Inputs) -> TaskStep:
        scene = self.scene(state.parameters, time_s, inputs["angle_rad"])
        state = state.with_sample(time_s, inputs)
        if time_s < state.parameters.seconds:
            return TaskStep(state, scene)
        try:
            found = self.measured(state)
        except UserError as error:
            return TaskStep(state, scene, outcome=TrialOutcome(None, str(error)))
        row = {c.name: getattr(found, c.name) for c in self.columns}
        return TaskStep(state, scene, outcome=TrialOutcome(row))


class PendulumParameters(KneeParameters):
    seconds: float = Field(12.0, ge=4, le=60, description="how long the leg is watched")


@register
class PendulumTask(_FirstDayTask):
    """Wartenberg's pendulum test: the leg is let go from a straight knee."""

    name = "knee-pendulum"
    Parameters = PendulumParameters
    inputs: ClassVar = {"angle_rad": INPUTS["angle_rad"]}
    columns = (
        DataColumn("relaxation_index", float, "first swing over start to rest"),
        DataColumn("first_swing_rad", float, "angle of the first fall"),
        DataColumn("rest_rad", float, "bending at rest"),
        DataColumn("damping_ratio", float, "from the decay of half swings; missing with few"),
        DataColumn("frequency_Hz", float, "of the swings; missing with few"),
        DataColumn("swings", int, "number of swings"),
        DataColumn("reached_rest", bool, "whether it had come to rest"),
    )

    def scene(self, given: Any, time_s: float, angle_rad: float) -> Scene:
        return leg_scene(("knee_let_fall",), given.comfort(), angle_rad)

    def measured(self, state: KneeState) -> PendulumResult:
        t, angle, _ = np.array(state.samples).T
        return pendulum_test(t, angle)

    def simulate(self, situation: Situation, rng: np.random.Generator) -> Actor:
        from esea_host.assess.simulated import falling_actor

        return falling_actor(situation.parameters, situation.parameters.seconds + 0.5, rng)


class LoopParameters(KneeParameters):
    seconds: float = Field(48.0, ge=10, le=600, description="how long it is moved")
    period_s: float = Field(16.0, ge=6, le=120, description="of one bending and straightening")


@register
class RangeTask(_FirstDayTask):
    """Passive range of motion: bent and straightened slowly, torque over angle."""

    name = "knee-range"
    Parameters = LoopParameters
    columns = (
        DataColumn("low_rad", float, "least bending"),
        DataColumn("high_rad", float, "most bending"),
        DataColumn("fastest_rad_s", float, "fastest movement"),
        DataColumn("slow", bool, "slow enough to be passive"),
        DataColumn("cycles", int, "complete cycles"),
        DataColumn("stiffness_Nm_rad", float, "of the middle third"),
        DataColumn("loop_J", float, "work lost in a cycle"),
    )

    def scene(self, given: Any, time_s: float, angle_rad: float) -> Scene:
        target = float(_slow(given, np.array(time_s))[0])
        return leg_scene(("knee_slowly",), given.comfort(), angle_rad, target)

    def measured(self, state: KneeState) -> MotionRange:
        return motion_range(state.recording())

    def simulate(self, situation: Situation, rng: np.random.Generator) -> Actor:
        from esea_host.assess.simulated import following_actor

        given = situation.parameters
        return following_actor(given, lambda t: _slow(given, t), given.seconds + 0.5, rng)


def _slow(given: Any, time_s: Array) -> tuple[Array, Array]:
    # Five degrees short of the reach at either end: hands overshoot.
    comfort, w = given.comfort(), 2 * np.pi / given.period_s
    low, high = comfort.low_rad + 5 * DEG, comfort.high_rad - 5 * DEG
    half = (high - low) / 2
    return low + half * (1 - np.cos(w * time_s)), half * w * np.sin(w * time_s)
