"""Virtual participants do the wrist study, through the same engine and tasks.  Simulated.

The board is the firmware's application, its two motors turn the twin's drives, and all that a task
sees has come over the link.  Handle and drives are assumed, as all numbers of the device are.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from esea_gen.device import Device, load_device
from esea_gen.model.sensing import of_axis
from esea_gen.twin.hand import CoupledHand, wrist
from esea_gen.twin.published import Person
from esea_host.people.control import FRAME_S, AxisController
from esea_host.people.hand import ActingHand, Pointer, shape
from esea_host.people.person import (
    Limb,
    Muscle,
    PersonModel,
    VirtualParticipant,
    minimum_jerk,
    minimum_jerk_speed,
)
from esea_host.people.source import VirtualPeople
from esea_host.simulated import LockstepDevice, SimulatedBoard
from esea_host.study.board import WORKING, BoardSource
from esea_host.study.many import run_everybody
from esea_host.study.protocol import Protocol, parse_protocol
from esea_host.study.scene import Scene
from esea_host.study.source import InputSource
from esea_host.study.task import Actor, Inputs, Situation, StudyTask, TaskParameters
from esea_host.wrist.moving import DAMPING_KG_S, MASS_KG

PROTOCOL = Path(__file__).parent / "protocol.toml"
HANDLE_KGM2 = 0.006
RESTS_S = 2.0  # of a rest so much is waited for; the hand lies still
TICKS, TICK_S = 10, 1e-3  # of a frame
LIMP = [(0.0,) * 5] * 2  # muscles of a hand that rests, while the motors are off
PACED = ("wrist.neutral", "wrist.range", "wrist.velocity")  # the cursor is the hand itself there
TASK_RATE_1_S = DAMPING_KG_S / MASS_KG
# Who has come to rest that far from where they wanted to be goes on; assumed.
LEAST_RAD = math.radians(1.0)
SEEN_TO_RUN_S = 0.5  # after the reaction: then it is clear whether a target runs or stands; assumed


@cache
def wrist_drive() -> Device:
    return load_device("wrist_drive")


def hand_of(limbs: Sequence[Limb]) -> CoupledHand:
    """A participant's hand and handle, on both axes; coupled as the twin's standard hand is."""
    usual = wrist(0.0, 0.0)
    people = tuple(
        Person(
            Jh_kgm2=limb.inertia_kgm2 + HANDLE_KGM2,
            spring_Nm_rad=0.0,
            damping_Nms_rad=0.0,
            feedforward=False,
            own_damping_Nms_rad=limb.damping_Nms_rad,
            gravity_Nm=0.0,
            torque_noise_Nm=0.0,
            torque_noise_Hz=2.0,
        )
        for limb in limbs
    )

    def between(own: Sequence[float], name: str) -> float:
        # Off the diagonal the same share of it.
        (a, b), (_, d) = usual.matrices()[name]
        return b / math.sqrt(a * d) * math.sqrt(own[0] * own[1])

    one, two = limbs
    return CoupledHand(
        (people[0], people[1]),
        (one.stiffness_Nm_rad, two.stiffness_Nm_rad),
        between([x.stiffness_Nm_rad for x in limbs], "stiffness"),
        between([x.Jh_kgm2 for x in people], "inertia"),
        between([x.damping_Nms_rad for x in limbs], "damping"),
        (one.rest_rad, two.rest_rad),
        ((one.low_rad, one.high_rad), (two.low_rad, two.high_rad)),
    )


class Muscles:
    """Muscle torques of both axes, computed once a tick."""

    def __init__(self, board: SimulatedBoard, limbs: Sequence[Limb]) -> None:
        self._board = board
        # The passive wrist and its ends are the twin's.
        free = {"stiffness_Nm_rad": 0.0, "damping_Nms_rad": 0.0}
        ends = {"low_rad": -math.inf, "high_rad": math.inf}
        self._limbs = [replace(x, **free, **ends) for x in limbs]
        joint = "theta_l_rad", "omega_l_rad_s"
        self._names = [tuple(of_axis(n, a) for n in joint) for a in board.axes]
        self._frame: Sequence[Sequence[float]] = LIMP
        self._tick = 0

    def frame(self, muscles: Sequence[Sequence[float]]) -> None:
        """Torques in the next frame, as of :meth:`Limb.torque_Nm`."""
        self._frame, self._tick = muscles, 0

    def __call__(self) -> list[dict[str, float]]:
        self._tick += 1
        share, truth = min(self._tick / TICKS, 1.0), self._board.plant.truth()
        each = zip(self._limbs, self._frame, self._names, strict=True)
        return [
            {
                "theta_p_rad": 0.0,
                "tau_Nm": limb.torque_Nm(truth[a], truth[b], muscle, share, TICKS * TICK_S),
            }
            for limb, muscle, (a, b) in each
        ]


class VirtualPerson(BoardSource):
    """A person in the simulated drive, in lockstep; a real pointer may move the hand."""

    def __init__(
        self,
        who: VirtualParticipant,
        folder: Path | None = None,
        pointer: Pointer | None = None,
        device: Device | None = None,
    ) -> None:
        self.who, self.pointer, self.arm = who, pointer, Arm(who)
        self.board = SimulatedBoard(device or wrist_drive(), person="nobody")
        self.muscles = Muscles(self.board, who.limbs)
        link = LockstepDevice(self.board)
        super().__init__(link, folder, True, link.advance)
        self._moved, self._skipped_s = False, 0.0
        self._resting: WristActor | None = None

    def ready(self) -> Mapping[str, Any]:
        """With the hand in the handle; a latched limit is cleared: nobody real is in it."""
        self.board.set_up(person=hand_of(self.who.limbs), hand=self.muscles)
        if self.device.state() == "FAULT":
            self.device.clear()
        return super().ready()

    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        self.begin(task, situation, number)
        self._resting = None
        hand = WristActor(self, task.name, situation.parameters)
        hand.pointer = self.pointer
        return hand

    def idle(self) -> Sequence[Muscle]:
        """The hand goes where it rests by itself."""
        if self._resting is None:
            self._resting = WristActor(self, "wrist.neutral", TaskParameters())
        self.arm.felt_deg[:] = [gauge.value for gauge in self.gauges() if gauge.unit == "deg"]
        return self._resting.rests()

    def advance_by(
        self, muscles: Sequence[Sequence[float]], requests: Mapping[str, float]
    ) -> Inputs:
        self.muscles.frame(muscles)
        self._moved = True
        return self.frame(requests)

    def pull(self) -> None:
        if not self._moved:
            self.muscles.frame(self.idle() if self.status() in WORKING else LIMP)
        self._moved = False
        super().pull()

    def rest(self, seconds: float) -> None:
        super().rest(min(seconds, RESTS_S))
        self._skipped_s += max(0.0, seconds - RESTS_S)

    def now_s(self) -> float:
        return super().now_s() + self._skipped_s

    def close(self) -> None:
        super().close()
        self.device.close()


class Arm:
    """A participant's wrist in a device; goes on from trial to trial."""

    def __init__(self, who: VirtualParticipant) -> None:
        self.axes = [AxisController(who.model, x, HANDLE_KGM2, who.rng) for x in who.limbs]
        self.aims_deg = [0.0] * len(self.axes)
        self.felt_deg = [0.0] * len(self.axes)


class WristActor(ActingHand):
    """A person for one trial, who sees the target run away, and feels the impairment."""

    def __init__(self, rig: VirtualPerson, task: str, parameters: TaskParameters) -> None:
        super().__init__(rig.who, rig.arm.aims_deg, HANDLE_KGM2)
        self.rig, self.arm, self.task = rig, rig.arm, task
        self.appeared_s: float | None = None
        self._moves, self._learnt = not getattr(parameters, "stationary", True), False
        self._seen: deque[Scene] = deque(maxlen=self.arm.axes[0].seen_frames)
        self._role = ""
        for x in self.arm.axes:
            # In a chase the hand would take its own haste for the device's.
            x.enter(bool(getattr(parameters, "impairment", False)), task in PACED)
        self._asked_deg = [math.nan] * len(self.arm.axes)
        # Of each axis: when a movement begins, from where it goes, and to where.
        self._paths = [(math.inf, x.goal_rad, x.goal_rad) for x in self.arm.axes]

    def move(self, muscles: Sequence[Muscle], requests: Mapping[str, float]) -> Inputs:
        return self.rig.advance_by(muscles, requests)

    def rests(self) -> Sequence[Muscle]:
        """Torques of the muscles in a frame between trials."""
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
        """Follow the task, on delayed perception."""
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


def wrist_protocol(seed: int, method: str = "rbf") -> Protocol:
    """The shipped protocol, with a seed of the study and a method of normalisation."""
    text = PROTOCOL.read_text(encoding="utf-8")
    text = text.replace("seed = 1\n", f"seed = {seed}\n", 1)
    text = text.replace("impairment = true }", f'impairment = true, method = "{method}" }}', 1)
    return parse_protocol(text, PROTOCOL.name)


def worn(who: VirtualParticipant, _index: int, _session: int) -> InputSource:
    return VirtualPerson(who)


def run_study(
    folder: Path,
    participants: int,
    seed: int,
    jobs: int = 1,
    method: str = "rbf",
    model: PersonModel | None = None,
    protocol: Protocol | None = None,
    cluster: str | None = None,
    say: Callable[[str], None] | None = None,
) -> list[str]:
    asked = protocol or wrist_protocol(seed, method)
    SimulatedBoard(wrist_drive(), person="nobody").close()  # compiled before the processes start
    people = VirtualPeople(seed, model or PersonModel(), worn)
    return run_everybody(folder, asked, participants, people, jobs, cluster, say)
