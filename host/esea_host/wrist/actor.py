"""What a virtual participant does in the tasks of the wrist study.  Simulated."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence

from esea_host.people.control import FRAME_S, AxisController
from esea_host.people.hand import ActingHand, shape
from esea_host.people.person import Muscle, VirtualParticipant, minimum_jerk, minimum_jerk_speed
from esea_host.study.scene import Scene
from esea_host.study.task import Inputs, TaskParameters
from esea_host.wrist.target import DAMPING_KG_S, MASS_KG
from esea_host.wrist.worn import HANDLE_KGM2, WornWrist

PACED = ("wrist.neutral", "wrist.range", "wrist.velocity")  # the cursor is the hand itself there
TASK_RATE_1_S = DAMPING_KG_S / MASS_KG
# Who has come to rest that far from where they wanted to be goes on; assumed.
LEAST_RAD = math.radians(1.0)
SEEN_TO_RUN_S = 0.5  # after the reaction: then it is clear whether a target runs or stands; assumed


class Arm:
    """A participant's wrist in a device; goes on from trial to trial."""

    def __init__(self, who: VirtualParticipant, handle_kgm2: float) -> None:
        self.axes = [AxisController(who.model, x, handle_kgm2, who.rng) for x in who.limbs]
        self.aims_deg = [0.0] * len(self.axes)
        self.felt_deg = [0.0] * len(self.axes)


class WristActor(ActingHand):
    """A person for one trial, who sees the target run away, and feels the impairment."""

    def __init__(
        self,
        who: VirtualParticipant,
        rig: WornWrist,
        arm: Arm,
        task: str,
        parameters: TaskParameters,
    ) -> None:
        super().__init__(who, arm.aims_deg, HANDLE_KGM2)
        self.rig, self.arm, self.task = rig, arm, task
        self.appeared_s: float | None = None
        self._moves, self._learnt = not getattr(parameters, "stationary", True), False
        self._seen: deque[Scene] = deque(maxlen=arm.axes[0].seen_frames)
        self._role = ""
        for x in arm.axes:
            # In a chase the hand would take its own haste for the device's.
            x.enter(bool(getattr(parameters, "impairment", False)), task in PACED)
        self._asked_deg = [math.nan] * len(arm.axes)
        # Of each axis: when a movement begins, from where it goes, and to where.
        self._paths = [(math.inf, x.goal_rad, x.goal_rad) for x in arm.axes]

    def move(self, muscles: Sequence[Muscle], requests: Mapping[str, float]) -> Inputs:
        return self.rig.advance_by(muscles, requests)

    def rests(self) -> Sequence[Muscle]:
        """What the muscles do in a frame between trials."""
        self.time_s = round(self.time_s + FRAME_S, 6)
        self.look(Scene())
        return self.act({})

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        time_s, inputs = super().react(scene, requests)
        self.arm.felt_deg[:] = inputs["fe_deg"], inputs["ru_deg"]
        return time_s, inputs

    def look(self, scene: Scene) -> None:
        """Notice a target that appears, learn how it moves, and how far the cursor goes."""
        self._seen.append(scene)
        cursor = shape(scene, "cursor")
        if cursor and self.task not in PACED:
            self.feel((cursor.x, cursor.y))
        if self.task != "wrist.catch":
            return
        if self.appeared_s is None:
            self.appeared_s = self.time_s if shape(scene, "target") else None
        elif not self._learnt and self._reacted(SEEN_TO_RUN_S):
            self.who.learn(self._moves)
            self._learnt = True

    def _reacted(self, more_s: float = 0.0) -> bool:
        since = math.inf if self.appeared_s is None else self.appeared_s
        return self.time_s > since + self.who.model.reaction_s + more_s

    def act(self, requests: Mapping[str, float]) -> Sequence[Muscle]:
        """As the task asks, on what was seen a delay ago."""
        axes = self.arm.axes
        blind = len(self._seen) < axes[0].seen_frames
        if self.task in PACED:
            for k in range(len(axes)):
                self._pace(k, None if blind else self._seen[0])
        elif not blind:
            self._pursue(self._seen[0])
        muscles = [x.frame(math.radians(a)) for x, a in zip(axes, self.arm.felt_deg, strict=True)]
        self.aims[:] = [math.degrees(x.angle_rad) for x in axes]
        return muscles

    def _pursue(self, scene: Scene) -> None:
        cursor, goal = shape(scene, "cursor"), shape(scene, "target")
        if self.task == "wrist.catch" and (goal is None or not self._reacted()):
            goal = shape(scene, "origin")
        if goal is None or cursor is None:
            return
        if goal.role != self._role:
            self._role = goal.role
            caught = self.task == "wrist.catch" and goal.role == "target"
            for x in self.arm.axes:
                # In twentieths: fewer gains to solve.
                x.expect(TASK_RATE_1_S * round(20 * self.who.known) / 20 if caught else 0.0)
        away = (goal.x - cursor.x, goal.y - cursor.y)
        for x, distance, gain in zip(self.arm.axes, away, self.who.gain, strict=True):
            x.see(math.radians(distance) / gain)

    def _pace(self, axis: int, scene: Scene | None) -> None:
        # At one's own pace: minimum jerk, in a time that does not depend on the distance.
        arm, limb, m = self.arm.axes[axis], self.who.limbs[axis], self.who.model
        begin, start, end = self._paths[axis]
        lasts = math.degrees(limb.high_rad - limb.low_rad) / m.comfortable_deg_s[axis]
        share = (self.time_s - begin) / lasts
        arm.goal_rad = start + (end - start) * minimum_jerk(share)
        arm.goal_rad_s = (end - start) * minimum_jerk_speed(share) / lasts
        if scene is None:
            return
        if self.task == "wrist.neutral":  # felt, not seen
            asked, to = 0.0, limb.rest_rad
        else:
            target, cursor = shape(scene, "target"), shape(scene, "cursor")
            if target is None or cursor is None:
                return
            asked, seen = (target.y, cursor.y) if axis else (target.x, cursor.x)
            to = arm.angle_seen_rad + math.radians(asked - seen)
        short = self.time_s > begin + lasts + m.reaction_s and abs(to - end) > LEAST_RAD
        if asked != self._asked_deg[axis] or short:
            self._asked_deg[axis] = asked
            most = math.radians(10.0)
            to = min(max(to, limb.low_rad - most), limb.high_rad + most)
            wait = m.reaction_s - arm.seen_frames * FRAME_S
            self._paths[axis] = self.time_s + max(wait, 0.0), arm.goal_rad, to
