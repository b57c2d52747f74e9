"""A simulated wrist drive with a participant's hand in it, for a session.  Simulated.

The board is the firmware's application, its two motors turn the twin's drives, and all that a task
sees has come over the link.  Handle and drives are assumed, as all numbers of the device are.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from esea_gen.device import Device, load_device
from esea_gen.model.sensing import of_axis
from esea_gen.twin.hand import CoupledHand, wrist
from esea_gen.twin.published import Person
from esea_host.people.person import Limb, VirtualParticipant
from esea_host.simulated import LockstepDevice, SimulatedBoard
from esea_host.study.board import WORKING, BoardSource
from esea_host.study.task import Actor, Inputs, Situation, StudyTask

HANDLE_KGM2 = 0.006
RESTS_S = 2.0  # of a rest so much is waited for; the hand lies still
TICKS, TICK_S = 10, 1e-3  # of a frame
LIMP = [(0.0,) * 5] * 2  # muscles of a hand that rests, while the motors are off


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
    """What the muscles of both axes do, asked once a tick."""

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
        """What they do in the next frame, as of :meth:`Limb.torque_Nm`."""
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


class WornWrist(BoardSource):
    """A participant in the simulated drive, through its link, in lockstep."""

    def __init__(
        self, who: VirtualParticipant, folder: Path | None = None, device: Device | None = None
    ) -> None:
        self.who = who
        self.board = SimulatedBoard(device or wrist_drive(), person="nobody")
        self.muscles = Muscles(self.board, who.limbs)
        link = LockstepDevice(self.board)
        super().__init__(link, folder, True, link.advance)
        self._moved, self._skipped_s = False, 0.0

    @abstractmethod
    def hand(self, task: StudyTask, situation: Situation, number: int) -> Actor: ...

    @abstractmethod
    def idle(self) -> Sequence[Sequence[float]]: ...

    def ready(self) -> Mapping[str, Any]:
        """With the hand in the handle; a latched limit is cleared: nobody real is in it."""
        self.board.set_up(person=hand_of(self.who.limbs), hand=self.muscles)
        if self.device.state() == "FAULT":
            self.device.clear()
        return super().ready()

    def trial(self, task: StudyTask, situation: Situation, number: int) -> Actor:
        self.begin(task, situation, number)
        return self.hand(task, situation, number)

    def advance_by(
        self, muscles: Sequence[Sequence[float]], requests: Mapping[str, float]
    ) -> Inputs:
        self.muscles.frame(muscles)
        self._moved = True
        return self.frame(requests)

    def angles_deg(self) -> list[float]:
        return [gauge.value for gauge in self.gauges() if gauge.unit == "deg"]

    def pull(self) -> None:
        if not self._moved:
            self.muscles.frame(self.idle() if self.status() in WORKING else LIMP)
        self._moved = False
        super().pull()

    def rest(self, seconds: float) -> None:
        """The hand relaxes, and time passes."""
        super().rest(min(seconds, RESTS_S))
        self._skipped_s += max(0.0, seconds - RESTS_S)

    def now_s(self) -> float:
        return super().now_s() + self._skipped_s

    def close(self) -> None:
        super().close()
        self.device.close()
