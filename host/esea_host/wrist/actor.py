"""What a virtual participant does in the tasks of the wrist study.  Simulated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from esea_host.people.hand import MovingHand, Submovement, shape
from esea_host.people.person import VirtualParticipant
from esea_host.study.scene import Scene, Shape
from esea_host.study.task import Inputs
from esea_host.wrist.target import DAMPING_KG_S, MASS_KG
from esea_host.wrist.worn import HANDLE_KGM2, WornWrist


def _runs_away(length_s: float) -> float:
    # Share of an even movement of this length by which the target of equation 7.7 has moved.
    tau = MASS_KG / DAMPING_KG_S
    return 1.0 - tau / length_s * (1.0 - math.exp(-length_s / tau))


class WristActor(MovingHand):
    """A person in the virtual device, for one trial.

    Parameters
    ----------
    who : VirtualParticipant
        Learns by it.
    rig : WornWrist
        The device.
    task : str
        Name of the task: people are told what to do.
    aims : list of float
        Where the hand is held, both axes, deg; goes on from trial to trial.
    """

    def __init__(
        self, who: VirtualParticipant, rig: WornWrist, task: str, aims: list[float]
    ) -> None:
        super().__init__(who, aims, HANDLE_KGM2)
        self.rig, self.task = rig, task
        self.appeared_s: float | None = None

    def move(self, muscles: Sequence[Sequence[float]], requests: Mapping[str, float]) -> Inputs:
        """A frame of the device."""
        return self.rig.advance_by(muscles, requests)

    def look(self, scene: Scene) -> None:
        """A target that appears is a new one to react to."""
        super().look(scene)
        if self.task == "wrist.catch" and self.appeared_s is None and shape(scene, "target"):
            self.appeared_s = self.time_s

    def plan(self, axis: int, scene: Scene, aims_then: tuple[float, ...]) -> None:
        """As the task asks."""
        m = self.who.model
        if self.task == "wrist.neutral":
            self._go_home(axis)
            return
        goal, cursor = self._goal(scene), shape(scene, "cursor")
        if goal is None or cursor is None:
            return
        length = m.submovement_s
        at = goal.y if axis else goal.x
        if self.task == "wrist.track":
            at += self.speed_seen("target")[axis] * (m.delay_s + length / 2)
            # It is their own motion: nobody expects it beyond half of their own range.
            limb = self.who.limbs[axis]
            half = math.degrees(limb.high_rad - limb.low_rad) / 2
            at = min(max(at, -half), half)
        wanted = at - (cursor.y if axis else cursor.x)
        # What has been commanded since that was seen, and what is still to come of it.
        gain = self.who.gain[axis]
        wanted = wanted / gain - (self.end(axis) - aims_then[axis])
        if self.task in ("wrist.range", "wrist.velocity"):
            length = max(m.sweep_s * min(abs(wanted) / 60.0, 1.0), m.submovement_s)
        if self.task == "wrist.catch" and goal.role == "target":
            # What is known of equation 7.7: it goes on for a while, and runs from the hand.
            tau = MASS_KG / DAMPING_KG_S
            coasts = m.delay_s + tau * (1.0 - math.exp(-length / tau))
            wanted += self.who.known * self.speed_seen("target")[axis] * coasts / gain
            wanted /= 1.0 - self.who.known * _runs_away(length)
        self.correct(axis, wanted, length)

    def _go_home(self, axis: int) -> None:
        # Felt, not seen: where the wrist rests by itself.
        if not self.running or all(x.axis != axis for x in self.running):
            home = math.degrees(self.who.limbs[axis].rest_rad) - self.base[axis]
            self.running.append(Submovement(axis, self.time_s, self.who.model.sweep_s, home))
            self.next_s[axis] = math.inf

    def _goal(self, scene: Scene) -> Shape | None:
        target = shape(scene, "target")
        if self.task != "wrist.catch":
            return target
        shown = self.appeared_s is not None
        if shown and self.time_s < (self.appeared_s or 0.0) + self.who.model.reaction_s:
            return None
        return target or shape(scene, "origin")
