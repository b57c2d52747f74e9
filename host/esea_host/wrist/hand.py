"""The simulated hand of the wrist display: dragged, led by the guide, or wandering."""

from __future__ import annotations

import math

from esea_host.people.person import minimum_jerk
from esea_host.study.scene import Scene

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
