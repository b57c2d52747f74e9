"""What a virtual participant does in these tasks.  Simulated; nothing set by a published median."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from esea_host.interaction.rig import HANDLE_KGM2
from esea_host.interaction.tasks import (
    DAMPING_NMS_RAD,
    PADDLE_X,
    PongParameters,
    TrackingParameters,
    screen_deg,
)
from esea_host.people.hand import MovingHand, shape
from esea_host.people.person import VirtualParticipant
from esea_host.study.scene import Scene
from esea_host.study.task import Inputs, Situation

# Nobody is asked for more than in the familiarisation.
MOST_DEG = 10.0
# Nobody hurries the paddle more than this before the ball comes; assumed.
LEAST_TIME_S = 0.5
# A paddle that has left the screen for so long is brought back; assumed.
LOST_S = 3.0


class MovedRig(Protocol):
    """What a player's hand moves."""

    def advance(self, muscle: Sequence[float]) -> list[float]: ...


class RigPlayer(MovingHand):
    """A person on the rig, for one trial."""

    def __init__(
        self,
        who: VirtualParticipant,
        rig: MovedRig,
        aims: list[float],
        situation: Situation,
        paused: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__(who, aims, HANDLE_KGM2)
        self.rig, self.asked = rig, situation.parameters
        self.read: list[float] = []
        self.waited: list[bool] = []
        self._paused = paused
        self._lost_since_s: float | None = None

    def move(self, muscles: Sequence[Sequence[float]], requests: Mapping[str, float]) -> Inputs:
        """A frame of the rig; the encoder's milliseconds are kept."""
        new = self.rig.advance(muscles[0])
        self.read += new
        self.waited += [self._paused()] * len(new)
        long = self._lost_since_s is not None and self.time_s - self._lost_since_s > LOST_S
        return {"theta_rad": self.read[-1], "recentre": float(long)}

    def pointed_deg(self, scene: Scene, across: float, up: float) -> tuple[float, ...]:
        """Across is the angle; in the game, where the angle is a speed, up is."""
        if isinstance(self.asked, TrackingParameters):
            return (min(max(across, -1.0), 1.0) * screen_deg(self.asked.target),)
        return (min(max(up, -1.0), 1.0) * MOST_DEG,)

    def look(self, scene: Scene) -> None:
        """What the screen tells of the own hand, and whether the paddle is there at all."""
        super().look(scene)
        cursor = shape(scene, "cursor")
        if cursor is None:
            return
        if isinstance(self.asked, TrackingParameters):
            self.feel((cursor.x * screen_deg(self.asked.target),))
            return
        lost = min(abs(cursor.y), abs(cursor.to_y)) > 1 and cursor.y * cursor.to_y > 0
        if not lost:
            self._lost_since_s = None
        elif self._lost_since_s is None:
            self._lost_since_s = self.time_s

    def plan(self, axis: int, scene: Scene, aims_then: tuple[float, ...]) -> None:
        if isinstance(self.asked, TrackingParameters):
            self._follow(self.asked, scene, aims_then[0])
        elif isinstance(self.asked, PongParameters):
            self._play(self.asked, scene)

    def _follow(self, asked: TrackingParameters, scene: Scene, aim_then: float) -> None:
        target, cursor = shape(scene, "target"), shape(scene, "cursor")
        if target is None or cursor is None:
            return
        m, deg = self.who.model, screen_deg(asked.target)
        # On by what the target has moved since it was seen, and will move during half of the way.
        ahead = self.speed_seen("target")[0] * (m.delay_s + m.submovement_s / 2)
        wanted = deg * (target.x + ahead - cursor.x) / self.who.gain[0]
        # What has been commanded since that was seen, and what is still to come of it.
        wanted -= self.end(0) - aim_then
        self.correct(0, wanted, m.submovement_s)

    def _play(self, asked: PongParameters, scene: Scene) -> None:
        # The angle of the wrist is the paddle's speed: chosen so that it meets the ball.
        ball, paddle = shape(scene, "target"), shape(scene, "cursor")
        if ball is None or paddle is None:
            return
        m = self.who.model
        y = (paddle.y + paddle.to_y) / 2 + self.speed_seen("cursor")[1] * m.delay_s
        speed_x, speed_y = self.speed_seen("target")
        goal, left_s = 0.0, 1.0
        if speed_x < 0:
            left_s = (ball.x - PADDLE_X) / -speed_x - m.delay_s
            goal = _folded(ball.y + speed_y * (left_s + m.delay_s), 1.0 - asked.half_ball)
        speed = (goal - y) / max(left_s - m.submovement_s / 2, LEAST_TIME_S)
        theta = math.degrees(speed * asked.half_screen * DAMPING_NMS_RAD)
        theta = min(max(theta, -MOST_DEG), MOST_DEG)
        self.correct(0, theta / self.who.gain[0] - self.end(0), m.submovement_s)


def _folded(y: float, high: float) -> float:
    # Where a ball is that bounces between the walls at -high and high.
    period = 4.0 * high
    x = (y + high) % period
    return (x if x <= 2 * high else period - x) - high
