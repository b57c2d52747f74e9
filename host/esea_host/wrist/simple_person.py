"""The simplest participant: sees where to go and goes there, for checks of tasks and protocols."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from esea_host.study.scene import Scene
from esea_host.study.task import Actor, Inputs

LIMITS_DEG = ((-60.0, 50.0), (-30.0, 20.0))
WALL_DEG = 6.0


class Follower(Actor):
    """Goes to the target, or to the origin, along a first-order lag, within a range of motion."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.time_s = rng, 0.0
        self.theta = np.zeros(2)

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        self.time_s = round(self.time_s + 0.01, 6)
        aim = next((s for s in scene.shapes if s.role == "target"), None)
        seen = next((s for s in scene.shapes if s.role == "cursor"), None)
        if aim is None:
            aim = next((s for s in scene.shapes if s.role == "origin"), None)
        if aim is not None and seen is not None:
            wanted = np.array([aim.x - seen.x, aim.y - seen.y])
            self.theta += np.clip(0.06 * wanted, -0.6, 0.6) + 0.01 * self.rng.normal(size=2)
        impaired = requests.get("impairment", 0.0) > 0.5
        for k, (low, high) in enumerate(LIMITS_DEG):
            top = WALL_DEG if impaired and k == 0 else high
            self.theta[k] = min(max(self.theta[k], low), top)
        return self.time_s, {"fe_deg": float(self.theta[0]), "ru_deg": float(self.theta[1])}
