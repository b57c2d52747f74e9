"""The tasks' mathematics: pure steps ``(state, time, inputs) -> (state, scene, requests, events)``.

No clock, no window, no file; random numbers from the seed in the state.  Lengths in the scene are
shares of half its width: 1 is the edge.  Requests are empty: both tasks only look at the wrist.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

S = TypeVar("S")

# Equation 6.1, rad (the unit is our reading), and Hz.
TRACKED_RAD, TRACKED_HZ = 0.04, (0.1, 0.2, 0.4, 0.5)
FAMILIAR_RAD, FAMILIAR_HZ = math.radians(10.0), 0.2
# Equation 6.2.
DAMPING_NMS_RAD, INERTIA_KGM2 = 0.011, 1e-5


@dataclass(frozen=True)
class Mark:
    """A shape of the scene: kind (disc, bar), role of colour, centre, half its size."""

    kind: str
    role: str
    x: float
    y: float
    half_width: float
    half_height: float


@dataclass(frozen=True)
class PureStep(Generic[S]):
    """What a step gives: the next state and scene, requests to the device, events by name."""

    state: S
    scene: tuple[Mark, ...]
    requests: Mapping[str, float]
    events: tuple[str, ...]


def tracked_rad(time_s: float) -> float:
    """Target of the trajectory tracking, equation 6.1."""
    return TRACKED_RAD * math.fsum(math.sin(2 * math.pi * f * time_s) for f in TRACKED_HZ)


def familiar_rad(time_s: float) -> float:
    """Target of the familiarisation: 10 deg at 0.2 Hz."""
    return FAMILIAR_RAD * math.sin(2 * math.pi * FAMILIAR_HZ * time_s)


# -- tracking -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TrackingState:
    """State: the clock of the target stands still in a pause.

    elapsed_s: of the target; squared_rad2_s: integral of the squared error, for the score.
    """

    familiarisation: bool = False
    last_s: float = 0.0
    elapsed_s: float = 0.0
    squared_rad2_s: float = 0.0
    paused: bool = False

    @property
    def target_rad(self) -> float:
        """Where the wrist should be."""
        return (familiar_rad if self.familiarisation else tracked_rad)(self.elapsed_s)

    @property
    def rms_error_rad(self) -> float:
        """Score so far: root mean square error."""
        return math.sqrt(self.squared_rad2_s / self.elapsed_s) if self.elapsed_s > 0 else 0.0


def tracking_step(
    state: TrackingState, time_s: float, inputs: Mapping[str, float]
) -> PureStep[TrackingState]:
    """One step of tracking.  Inputs: ``theta_rad``; ``pause`` above 0 holds the target."""
    step_s = _elapsed(state.last_s, time_s)
    paused = inputs.get("pause", 0.0) > 0
    events = _paused(state.paused, paused)
    moved = replace(state, last_s=time_s, paused=paused)
    if not paused:
        moved = replace(moved, elapsed_s=state.elapsed_s + step_s)
        error = inputs["theta_rad"] - moved.target_rad
        moved = replace(moved, squared_rad2_s=state.squared_rad2_s + error**2 * step_s)
    # The largest target: four amplitudes, or one of the familiarisation's.
    full = FAMILIAR_RAD if state.familiarisation else len(TRACKED_HZ) * TRACKED_RAD
    scene = (
        Mark("disc", "target", 0.8 * moved.target_rad / full, 0.0, 0.05, 0.05),
        Mark("disc", "cursor", 0.8 * inputs["theta_rad"] / full, 0.0, 0.03, 0.03),
    )
    return PureStep(moved, scene, {}, events)


# -- pong -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Paddle:
    """Mass-damper driven by the wrist's angle: J x'' = F - c x'."""

    x: float = 0.0
    speed_1_s: float = 0.0


def paddle_step(paddle: Paddle, force_Nm: float, step_s: float) -> Paddle:
    """The paddle after a step under a force that is held: exact, whatever the step.

    Its time constant is J/c = 0.91 ms, shorter than a sample at 1 kHz: Euler's method would be all
    but unstable there.
    """
    rate_1_s = DAMPING_NMS_RAD / INERTIA_KGM2
    final_1_s = force_Nm / DAMPING_NMS_RAD
    gone = -math.expm1(-rate_1_s * step_s)  # 1 - exp(-c h / J), exact for short steps too
    apart = paddle.speed_1_s - final_1_s
    return Paddle(
        paddle.x + final_1_s * step_s + apart * gone / rate_1_s,
        final_1_s + apart * (1.0 - gone),
    )


@dataclass(frozen=True)
class PongState:
    """State of the game: paddle at the left edge, ball, counts, seed of the serves.

    lost: the paddle is off the screen.  half_paddle, half_ball: sizes.
    """

    seed: int
    paddle: Paddle = Paddle()
    ball_x: float = 0.0
    ball_y: float = 0.0
    ball_x_1_s: float = 0.0
    ball_y_1_s: float = 0.0
    last_s: float = 0.0
    serves: int = 0
    saved: int = 0
    missed: int = 0
    lost: bool = False
    paused: bool = False
    speed_1_s: float = 0.8
    half_paddle: float = 0.18
    half_ball: float = 0.03

    @property
    def score(self) -> float:
        """Share of the balls that were stopped."""
        done = self.saved + self.missed
        return self.saved / done if done else 0.0


_PADDLE_X = -0.95
# In one step the ball and its walls are met at most this often, however late the step comes.
_MOST_BOUNCES = 64


def pong_step(state: PongState, time_s: float, inputs: Mapping[str, float]) -> PureStep[PongState]:
    """One step of Pong.  Inputs: ``theta_rad``, ``pause``, and ``recentre`` for a lost paddle.

    Events: served, saved, missed, paddle_lost, paddle_recentred, paused, resumed.
    """
    step_s = _elapsed(state.last_s, time_s)
    paused = inputs.get("pause", 0.0) > 0
    events = list(_paused(state.paused, paused))
    moved = replace(state, last_s=time_s, paused=paused)
    if not paused:
        moved = replace(moved, paddle=paddle_step(state.paddle, inputs["theta_rad"], step_s))
        if moved.serves == 0:
            moved = _served(moved)
            events.append("served")
        moved, more = _ball(moved, step_s)
        events += more
        lost = abs(moved.paddle.x) > 1 + moved.half_paddle
        if lost and not moved.lost:
            events.append("paddle_lost")
        moved = replace(moved, lost=lost)
    if moved.lost and inputs.get("recentre", 0.0) > 0:
        moved = replace(moved, paddle=Paddle(), lost=False)
        events.append("paddle_recentred")
    scene = (
        Mark("bar", "cursor", _PADDLE_X, moved.paddle.x, 0.02, moved.half_paddle),
        Mark("disc", "target", moved.ball_x, moved.ball_y, moved.half_ball, moved.half_ball),
    )
    return PureStep(moved, scene, {}, tuple(events))


def _served(state: PongState) -> PongState:
    # From the seed and the number of the serve: no generator is carried along.
    angle = float(np.random.default_rng([state.seed, state.serves]).uniform(-0.9, 0.9))
    return replace(
        state,
        serves=state.serves + 1,
        ball_x=0.0,
        ball_y=0.0,
        ball_x_1_s=-state.speed_1_s * math.cos(angle),
        ball_y_1_s=state.speed_1_s * math.sin(angle),
    )


def _ball(state: PongState, step_s: float) -> tuple[PongState, list[str]]:
    # From wall to wall within the step: no speed and no step carries the ball through one.
    left, events, s = step_s, [], state
    low, high = _PADDLE_X + s.half_ball, 1 - s.half_ball
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
        elif abs(s.ball_y - s.paddle.x) <= s.half_paddle + s.half_ball:
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


def _elapsed(last_s: float, time_s: float) -> float:
    if not time_s >= last_s:
        raise ValueError(f"time goes back from {last_s} s to {time_s} s")
    return time_s - last_s


def _paused(before: bool, now: bool) -> tuple[str, ...]:
    if before == now:
        return ()
    return ("paused",) if now else ("resumed",)
