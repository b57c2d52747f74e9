"""The probing movement as a task: a moving target on a screen, a pure step, no clock, no window.

``step(time, inputs) -> (scene, requests, events)``.  A scene is data: shapes, roles of colour,
texts; whoever draws it decides what they look like.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_host.assess import NOTICE
from esea_host.assess.patients import DEG
from esea_host.assess.probing import Comfort, ProbingMovement
from esea_host.assess.responses import LegRecording, Reading, nearest_reading, passage

SHOWN, PAUSE_S, TRIES = 2, 1.0, 3
Shape = Mapping[str, Any]


@dataclass
class ProbingState:
    """All that a step remembers."""

    phase: str = "show"  # show, follow, done, failed
    began_s: float | None = None
    tries: int = 0
    samples: list[tuple[float, float, float]] = field(default_factory=list)
    reading: Reading | None = None


class ProbingTask:
    """One probing movement: shown twice, then followed; asked again where the location was missed.

    Parameters
    ----------
    movement : ProbingMovement
        Through the location at its midpoint.
    comfort : Comfort
        Shown as the limits of reach.
    height_m, mass_kg : float
        Of the body, for the weight of the leg.
    """

    def __init__(
        self,
        movement: ProbingMovement,
        comfort: Comfort,
        height_m: float,
        mass_kg: float,
        tolerance: float = 1.0,
    ) -> None:
        self.movement, self.comfort = movement, comfort
        self.height_m, self.mass_kg, self.tolerance = height_m, mass_kg, tolerance
        self.state = ProbingState()

    @property
    def period_s(self) -> float:
        """One showing of the movement, and the pause after it."""
        return self.movement.duration_s + PAUSE_S

    def step(
        self, time_s: float, inputs: Mapping[str, float]
    ) -> tuple[list[Shape], dict[str, float], list[dict[str, Any]]]:
        """One step: ``angle_rad`` and ``torque_Nm`` in; scene, requests and events out.

        Requests are empty: the device has no motor.
        """
        s, events = self.state, []
        if s.began_s is None:
            s.began_s = time_s
            events.append({"kind": "shown", "location": self.movement.location.text()})
        elapsed = time_s - s.began_s
        if s.phase == "show" and elapsed >= SHOWN * self.period_s:
            self._begin_following(time_s)
            elapsed = 0.0
        if s.phase == "follow":
            s.samples.append((time_s, float(inputs["angle_rad"]), float(inputs["torque_Nm"])))
            if elapsed >= self.period_s:
                events += self._judge(time_s)
                elapsed = 0.0
        return self._scene(elapsed, inputs.get("angle_rad")), {}, events

    def _begin_following(self, time_s: float) -> None:
        self.state.phase, self.state.began_s = "follow", time_s
        self.state.samples = []

    def _judge(self, time_s: float) -> list[dict[str, Any]]:
        s = self.state
        s.tries += 1
        t, angle, torque = (np.array(x) for x in zip(*s.samples, strict=True))
        try:
            recording = LegRecording(t, angle, torque, self.height_m, self.mass_kg)
            s.reading = nearest_reading(passage(recording), self.movement.location, self.tolerance)
        except UserError as error:
            s.reading = None
            s.phase = "failed"
            return [{"kind": "failed", "reason": str(error)}]
        if s.reading is not None:
            s.phase = "done"
            event = {"kind": "passed", "location": s.reading.location.text()}
            return [event | {"response_Nm": s.reading.response_Nm, "distance": s.reading.distance}]
        if s.tries >= TRIES:
            s.phase = "failed"
            return [{"kind": "failed", "reason": f"missed {TRIES} times"}]
        self._begin_following(time_s)
        return [{"kind": "missed", "tries": s.tries}]

    def _scene(self, elapsed_s: float, angle_rad: float | None) -> list[Shape]:
        inside = elapsed_s % self.period_s
        target = float(self.movement.at(inside)[0])
        texts = {
            "show": "Watch the target.",
            "follow": "Move the leg with the target.",
            "done": "Thank you. The location was passed.",
            "failed": "The location was not passed.",
        }
        if self.state.phase == "follow" and self.state.tries:
            texts["follow"] = "Once more: move the leg with the target."
        scene: list[Shape] = [
            {"shape": "text", "role": "notice", "text": NOTICE},
            {"shape": "text", "role": "instruction", "text": texts[self.state.phase]},
            {
                "shape": "arc",
                "role": "reach",
                "from_deg": self.comfort.low_rad / DEG,
                "to_deg": self.comfort.high_rad / DEG,
            },
            {"shape": "leg", "role": "target", "angle_deg": target / DEG},
            {
                "shape": "mark",
                "role": "location",
                "angle_deg": self.movement.location.angle_rad / DEG,
            },
        ]
        if angle_rad is not None and np.isfinite(angle_rad):
            scene.append({"shape": "leg", "role": "measured", "angle_deg": angle_rad / DEG})
        return scene
