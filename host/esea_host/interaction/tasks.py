"""The tasks of the cross-over.  Input ``theta_rad``: the wrist's angle as the encoder has it.

``pause`` above 0 pauses a task, ``recentre`` returns a lost paddle; both may be left out. Lengths
in a scene are shares of half its width: 1 is the edge.  The device gets no request, because it has
no motor: only the installed element differs.
"""

from __future__ import annotations

import math
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
    TaskBrokenError,
    TaskEvent,
    TaskParameters,
    TaskSignal,
    TaskStep,
    TrialOutcome,
    register,
)

# Equation 6.1, rad (the unit is our reading), and Hz.
TRACKED_RAD, TRACKED_HZ = 0.04, (0.1, 0.2, 0.4, 0.5)
FAMILIAR_RAD, FAMILIAR_HZ = math.radians(10.0), 0.2
# Equation 6.2.
DAMPING_NMS_RAD, INERTIA_KGM2 = 0.011, 1e-5
# Where the largest target stands on the screen.
TARGET_SHARE = 0.8
ELEMENT = DataColumn("element", str, "which compliant element was built in")


class WithElement(TaskParameters):
    element: Literal["spring", "elastomer", "equal"] = Field(
        "spring", description="the element in the rig: spring, elastomer or equal"
    )
    stiffness_Nm_deg: float = Field(
        0.0, ge=0, description="of a spring; 0: beside the elastomer of the device as published"
    )
    seconds: float = Field(75.0, ge=1, le=600, description="how long, pauses left out")


MOST_RAD = 0.2


class SimplePlayer(Actor):
    """The hand goes, with a lag and a little noise, the way from cursor to target."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.time_s, self.theta_rad = rng, 0.0, 0.0

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        self.time_s = round(self.time_s + 0.01, 6)
        by_role = {s.role: s for s in scene.shapes}
        if "target" in by_role and "cursor" in by_role:
            target, cursor = by_role["target"], by_role["cursor"]
            if cursor.kind == "line":
                # The angle is a speed of the paddle: a hand that is held where the speed is right.
                apart = target.y - (cursor.y + cursor.to_y) / 2
                self.theta_rad += 0.3 * (0.3 * apart - self.theta_rad)
            else:
                self.theta_rad += 0.03 * (target.x - cursor.x)
            self.theta_rad += 1e-4 * float(self.rng.normal())
        self.theta_rad = min(max(self.theta_rad, -MOST_RAD), MOST_RAD)
        return self.time_s, {"theta_rad": self.theta_rad}


def tracked_rad(time_s: float) -> float:
    """Target of the trajectory tracking, equation 6.1."""
    return TRACKED_RAD * math.fsum(math.sin(2 * math.pi * f * time_s) for f in TRACKED_HZ)


def familiar_rad(time_s: float) -> float:
    """Target of the familiarisation: 10 deg at 0.2 Hz."""
    return FAMILIAR_RAD * math.sin(2 * math.pi * FAMILIAR_HZ * time_s)


class _InteractionTask(StudyTask):
    version = "2"
    inputs: ClassVar = {"theta_rad": TaskSignal("theta_load_rad")}
    switches: ClassVar[tuple[str, ...]] = ("pause",)

    def longest_s(self, parameters: Any) -> float:
        return float(parameters.seconds)

    def simulate(self, situation: Situation, rng: np.random.Generator) -> Actor:
        return SimplePlayer(rng)


# -- tracking -------------------------------------------------------------------------------------


class TrackingParameters(WithElement):
    target: Literal["four sines", "one sine"] = Field(
        "four sines", description='"four sines" of equation 6.1, or "one sine" to get used to it'
    )


@dataclass(frozen=True)
class TrackingState:
    """State of tracking; the target's clock stops in a pause."""

    parameters: TrackingParameters
    last_s: float = 0.0
    elapsed_s: float = 0.0
    squared_rad2_s: float = 0.0
    paused: bool = False

    @property
    def target_rad(self) -> float:
        four = self.parameters.target == "four sines"
        return (tracked_rad if four else familiar_rad)(self.elapsed_s)

    @property
    def rms_error_rad(self) -> float:
        return math.sqrt(self.squared_rad2_s / self.elapsed_s) if self.elapsed_s > 0 else 0.0


def screen_deg(target: str) -> float:
    """Angle at the edge of the screen."""
    four = target == "four sines"
    return math.degrees(len(TRACKED_HZ) * TRACKED_RAD if four else FAMILIAR_RAD) / TARGET_SHARE


@register
class TargetTracking(_InteractionTask):
    """Trajectory tracking, and the familiarisation."""

    name = "interaction.tracking"
    Parameters = TrackingParameters
    columns = (
        ELEMENT,
        DataColumn("target", str, "four sines or one sine"),
        DataColumn("seconds", float, "how long, pauses left out"),
        DataColumn("rms_error_deg", float, "the score: root mean square error"),
    )

    def begin(self, situation: Situation) -> TrackingState:
        return TrackingState(situation.parameters)

    def step(self, state: TrackingState, time_s: float, inputs: Inputs) -> TaskStep:
        step_s, theta, p = _elapsed(state.last_s, time_s), inputs["theta_rad"], state.parameters
        paused = inputs.get("pause", 0.0) > 0
        events = _paused(state.paused, paused)
        state = replace(state, last_s=time_s, paused=paused)
        if not paused:
            state = replace(state, elapsed_s=state.elapsed_s + step_s)
            squared = (theta - state.target_rad) ** 2 * step_s
            state = replace(state, squared_rad2_s=state.squared_rad2_s + squared)
        full = math.radians(screen_deg(p.target))
        shapes = (
            Shape("disc", "target", state.target_rad / full, 0.0, 0.05),
            Shape("disc", "cursor", theta / full, 0.0, 0.03),
        )
        # To a tenth: a number that flickers is not read.
        error_deg = round(math.degrees(state.rms_error_rad), 1)
        texts = (Text("follow"), Text("error", {"error_deg": error_deg}), *_waiting(paused))
        outcome = None
        if _over(state.elapsed_s, p.seconds):
            row = {"element": p.element, "target": p.target, "seconds": state.elapsed_s}
            outcome = TrialOutcome(row | {"rms_error_deg": math.degrees(state.rms_error_rad)})
        return TaskStep(state, Scene(shapes, texts, 1.0), {}, events, outcome)


# -- pong -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Paddle:
    """Mass-damper driven by the wrist's angle: J x'' = F - c x'.  The unit of x is not printed."""

    x: float = 0.0
    speed_1_s: float = 0.0


def paddle_step(paddle: Paddle, force_Nm: float, step_s: float) -> Paddle:
    """State of the paddle after a step under a constant force: exact for any step.

    Its time constant is J/c = 0.91 ms, shorter than a sample at 1 kHz: Euler's method would be all
    but unstable there.
    """
    rate_1_s = DAMPING_NMS_RAD / INERTIA_KGM2
    final_1_s = force_Nm / DAMPING_NMS_RAD
    gone = -math.expm1(-rate_1_s * step_s)  # 1 - exp(-c h / J), exact for short steps too
    apart = paddle.speed_1_s - final_1_s
    return Paddle(
        paddle.x + final_1_s * step_s + apart * gone / rate_1_s, final_1_s + apart * (1.0 - gone)
    )


class PongParameters(WithElement):
    """The game; all of it but equation 6.2 is assumed."""

    half_screen: float = Field(
        10.0, gt=0, description="half the screen's height in the paddle's unit"
    )
    speed_1_s: float = Field(0.8, gt=0, le=5, description="of the ball, half screens a second")
    half_paddle: float = Field(0.18, gt=0, lt=0.9, description="half its length, in half screens")
    half_ball: float = Field(0.03, gt=0, lt=0.3, description="radius of the ball, in half screens")


@dataclass(frozen=True)
class PongState:
    """State of the game: paddle at the left edge, ball, counts, seed of the serves."""

    parameters: PongParameters
    seed: int
    paddle: Paddle = Paddle()
    ball_x: float = 0.0
    ball_y: float = 0.0
    ball_x_1_s: float = 0.0
    ball_y_1_s: float = 0.0
    last_s: float = 0.0
    elapsed_s: float = 0.0
    serves: int = 0
    saved: int = 0
    missed: int = 0
    times_lost: int = 0
    lost: bool = False
    paused: bool = False

    @property
    def paddle_y(self) -> float:
        return self.paddle.x / self.parameters.half_screen

    @property
    def score(self) -> float | None:
        """Share of the balls that were stopped; None before the first."""
        done = self.saved + self.missed
        return self.saved / done if done else None


PADDLE_X = -0.95
# In one step the ball and its walls are met at most this often, however late the step comes.
_MOST_BOUNCES = 64


@register
class Pong(_InteractionTask):
    """Events: served, saved, missed, paddle_lost, paddle_recentred, paused, resumed."""

    name = "interaction.pong"
    switches = ("pause", "recentre")
    Parameters = PongParameters
    columns = (
        ELEMENT,
        DataColumn("seconds", float, "how long, pauses left out"),
        DataColumn("saved", int, "balls that were stopped"),
        DataColumn("missed", int, "balls that were not"),
        DataColumn("score", float, "share that was stopped; none without a ball"),
        DataColumn("times_lost", int, "how often the paddle left the screen"),
    )

    def begin(self, situation: Situation) -> PongState:
        return PongState(situation.parameters, situation.seed)

    def step(self, state: PongState, time_s: float, inputs: Inputs) -> TaskStep:
        step_s, p = _elapsed(state.last_s, time_s), state.parameters
        paused = inputs.get("pause", 0.0) > 0
        events = list(_paused(state.paused, paused))
        state = replace(state, last_s=time_s, paused=paused)
        if not paused:
            paddle = paddle_step(state.paddle, inputs["theta_rad"], step_s)
            state = replace(state, paddle=paddle, elapsed_s=state.elapsed_s + step_s)
            if state.serves == 0:
                state = _served(state)
                events.append(TaskEvent("served"))
            state, more = _ball(state, step_s)
            events += [TaskEvent(n) for n in more]
            lost = abs(state.paddle_y) > 1 + p.half_paddle
            if lost and not state.lost:
                events.append(TaskEvent("paddle_lost"))
                state = replace(state, times_lost=state.times_lost + 1)
            state = replace(state, lost=lost)
        if state.lost and inputs.get("recentre", 0.0) > 0:
            state = replace(state, paddle=Paddle(), lost=False)
            events.append(TaskEvent("paddle_recentred"))
        outcome = self._outcome(state) if _over(state.elapsed_s, p.seconds) else None
        return TaskStep(state, self._scene(state), {}, tuple(events), outcome)

    def _outcome(self, state: PongState) -> TrialOutcome:
        row = {"element": state.parameters.element, "seconds": state.elapsed_s}
        counts = {"saved": state.saved, "missed": state.missed, "times_lost": state.times_lost}
        return TrialOutcome(row | counts | {"score": state.score})

    def _scene(self, state: PongState) -> Scene:
        y, half = state.paddle_y, state.parameters.half_paddle
        ball = Shape("disc", "target", state.ball_x, state.ball_y, state.parameters.half_ball)
        bar = Shape("line", "cursor", PADDLE_X, y - half, 0.02, PADDLE_X, y + half)
        texts = [Text("pong"), Text("score", {"saved": state.saved, "missed": state.missed})]
        texts += [Text("lost")] if state.lost else []
        return Scene((bar, ball), (*texts, *_waiting(state.paused)), 1.0)


def _served(state: PongState) -> PongState:
    # From the seed and the number of the serve: no generator is carried along.
    angle = float(np.random.default_rng([state.seed, state.serves]).uniform(-0.9, 0.9))
    speed = state.parameters.speed_1_s
    return replace(
        state,
        serves=state.serves + 1,
        ball_x=0.0,
        ball_y=0.0,
        ball_x_1_s=-speed * math.cos(angle),
        ball_y_1_s=speed * math.sin(angle),
    )


def _ball(state: PongState, step_s: float) -> tuple[PongState, list[str]]:
    # From wall to wall within the step: no speed and no step carries the ball through one.
    left, events, s, p = step_s, [], state, state.parameters
    low, high = PADDLE_X + p.half_ball, 1 - p.half_ball
    for _ in range(_MOST_BOUNCES):
        to_x = _until(s.ball_x, s.ball_x_1_s, low, high)
        to_y = _until(s.ball_y, s.ball_y_1_s, -high, high)
        free = min(left, to_x, to_y)
        s = replace(s, ball_x=s.ball_x + s.ball_x_1_s * free, ball_y=s.ball_y + s.ball_y_1_s * free)
        left -= free
        if left <= 0:
            break
        if to_y <= to_x:
            s = replace(s, ball_y_1_s=-s.ball_y_1_s)
        elif s.ball_x_1_s > 0:
            s = replace(s, ball_x_1_s=-s.ball_x_1_s)
        elif abs(s.ball_y - s.paddle_y) <= p.half_paddle + p.half_ball:
            s = replace(s, ball_x_1_s=-s.ball_x_1_s, saved=s.saved + 1)
            events.append("saved")
        else:
            s = _served(replace(s, missed=s.missed + 1))
            events += ["missed", "served"]
    return s, events


def _until(at: float, speed: float, low: float, high: float) -> float:
    if speed == 0:
        return math.inf
    return max(0.0, ((high if speed > 0 else low) - at) / speed)


# -- both -----------------------------------------------------------------------------------------


def _elapsed(last_s: float, time_s: float) -> float:
    if not time_s >= last_s:
        raise TaskBrokenError(f"time goes back from {last_s} s to {time_s} s")
    return time_s - last_s


def _over(elapsed_s: float, seconds: float) -> bool:
    # Sums of steps: a rounding short of the end is the end.
    return elapsed_s >= seconds - 1e-6


def _waiting(paused: bool) -> tuple[Text, ...]:
    return (Text("paused"),) if paused else ()


def _paused(before: bool, now: bool) -> tuple[TaskEvent, ...]:
    if before == now:
        return ()
    return (TaskEvent("paused" if now else "resumed"),)
