"""The simplest participant of these tasks, for checks of tasks and protocols: no device, no law."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from esea_host.study.scene import Scene
from esea_host.study.task import Actor, Inputs

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
