"""Simulated hands: one in a device, one that moves in submovements."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from esea_host.people.person import Muscle, VirtualParticipant, minimum_jerk
from esea_host.study.scene import Scene, Shape
from esea_host.study.task import Actor, Inputs

FRAME_S = 0.01
# Nobody corrects less.
LEAST_DEG = 0.4
# From somebody's pointing, -1 to 1 across and up, where 1 is the edge of the scene.
Pointer = Callable[[], tuple[float, float]]
# A hand follows a pointer no faster than that; assumed.
POINTED_DEG_S = 400.0


@dataclass(frozen=True)
class Submovement:
    axis: int
    start_s: float
    length_s: float
    size_deg: float

    def at(self, time_s: float) -> float:
        """Its part of the way."""
        return self.size_deg * minimum_jerk((time_s - self.start_s) / self.length_s)


def shape(scene: Scene, role: str) -> Shape | None:
    """The shape of a role; None where there is none."""
    return next((s for s in scene.shapes if s.role == role), None)


class ActingHand(Actor):
    """A person with a hand in a device, for one trial; frames of 10 ms."""

    def __init__(self, who: VirtualParticipant, aims: list[float], handle_kgm2: float) -> None:
        self.who, self.aims, self._handle_kgm2 = who, aims, handle_kgm2
        self.time_s = 0.0
        self.pointer: Pointer | None = None
        self._first: tuple[tuple[float, ...], tuple[float, ...]] | None = None

    @abstractmethod
    def look(self, scene: Scene) -> None: ...

    @abstractmethod
    def act(self, requests: Mapping[str, float]) -> Sequence[Muscle]: ...

    @abstractmethod
    def move(self, muscles: Sequence[Muscle], requests: Mapping[str, float]) -> Inputs: ...

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        self.time_s = round(self.time_s + FRAME_S, 6)
        self.look(scene)
        if self.pointer is None:
            muscles = self.act(requests)
        else:
            muscles = self._follow_pointer(scene, *self.pointer())
        return self.time_s, self.move(muscles, requests)

    def hold(self, before_deg: Sequence[float]) -> list[Muscle]:
        """Muscles that hold the hand on its aims, which were elsewhere before."""
        m = self.who.model
        muscles = []
        for k, limb in enumerate(self.who.limbs[: len(self.aims)]):
            inertia = limb.inertia_kgm2 + self._handle_kgm2
            damping = 2 * m.damping_ratio * math.sqrt(m.stiffness_Nm_rad * inertia)
            ends = (math.radians(before_deg[k]), math.radians(self.aims[k]))
            muscles.append(Muscle(m.stiffness_Nm_rad, damping, *ends, m.effort_Nm))
        return muscles

    def pointed_deg(self, scene: Scene, across: float, up: float) -> tuple[float, ...]:
        """Where the hand is to be when somebody points there, in a scene in degrees."""
        return across * scene.half_width, up * scene.half_width

    def _follow_pointer(self, scene: Scene, across: float, up: float) -> list[Muscle]:
        before, most = list(self.aims), POINTED_DEG_S * FRAME_S
        for k, goal in enumerate(self.pointed_deg(scene, across, up)[: len(self.aims)]):
            self.aims[k] += min(max(goal - self.aims[k], -most), most)
        return self.hold(before)

    def feel(self, shown_deg: Sequence[float]) -> None:
        """Learn the cursor's gain once the hand's movement is large enough."""
        hand = self.aims
        if self._first is None:
            self._first = tuple(shown_deg), tuple(hand)
            return
        for k, shown in enumerate(shown_deg):
            moved = hand[k] - self._first[1][k]
            if abs(moved) > 3.0:
                ratio = (shown - self._first[0][k]) / moved
                rate = self.who.model.gain_rate
                self.who.gain[k] += rate * (min(max(ratio, 0.3), 6.0) - self.who.gain[k])
                here = (*self._first[0][:k], shown, *self._first[0][k + 1 :])
                there = (*self._first[1][:k], hand[k], *self._first[1][k + 1 :])
                self._first = here, there


class MovingHand(ActingHand):
    """A hand that moves in submovements, on delayed vision."""

    def __init__(self, who: VirtualParticipant, aims: list[float], handle_kgm2: float) -> None:
        super().__init__(who, aims, handle_kgm2)
        self.base = list(aims)
        self.running: list[Submovement] = []
        self.next_s = [0.0] * len(aims)
        self.seen: deque[tuple[float, Scene, tuple[float, ...]]] = deque()

    @abstractmethod
    def plan(self, axis: int, scene: Scene, aims_then: tuple[float, ...]) -> None:
        """Decide whether to move, from the delayed scene and the aims at its time."""

    def act(self, requests: Mapping[str, float]) -> Sequence[Muscle]:
        before = list(self.aims)
        self._aim()
        return self.hold(before)

    def look(self, scene: Scene) -> None:
        self.seen.append((self.time_s, scene, tuple(self.aims)))
        delay = self.who.model.delay_s
        while len(self.seen) > 2 and self.seen[1][0] <= self.time_s - delay:
            self.seen.popleft()

    def _aim(self) -> None:
        over = [x for x in self.running if self.time_s >= x.start_s + x.length_s]
        for x in over:
            self.base[x.axis] += x.size_deg
            self.running.remove(x)
        _, scene, aims_then = self.seen[0]
        axes = range(len(self.aims))
        if self.time_s > self.who.model.delay_s:
            for axis in axes:
                if self.time_s >= self.next_s[axis]:
                    self.plan(axis, scene, aims_then)
        for axis in axes:
            self.aims[axis] = self.base[axis] + sum(
                x.at(self.time_s) for x in self.running if x.axis == axis
            )

    def end(self, axis: int) -> float:
        """Where the aim will be once all that was commanded is done, deg."""
        return self.base[axis] + sum(x.size_deg for x in self.running if x.axis == axis)

    def correct(self, axis: int, wanted_deg: float, length_s: float) -> None:
        """Begin a submovement, with its noise, unless it is too small to bother."""
        if abs(wanted_deg) < LEAST_DEG:
            return
        m, limb, end = self.who.model, self.who.limbs[axis], self.end(axis)
        size = wanted_deg * (1.0 + m.noise * float(self.who.rng.normal()))
        low, high = (math.degrees(x) for x in (limb.low_rad, limb.high_rad))
        size = min(max(size, low - 10 - end), high + 10 - end)
        self.running.append(Submovement(axis, self.time_s, length_s, size))
        self.next_s[axis] = self.time_s + max(m.every_s, length_s if length_s > 0.6 else 0.0)

    def speed_seen(self, role: str) -> tuple[float, float]:
        """Speed of a shape between the two oldest stored scenes."""
        if len(self.seen) < 4:
            return 0.0, 0.0
        (t0, s0, _), (t1, s1, _) = self.seen[0], self.seen[3]
        a, b = shape(s0, role), shape(s1, role)
        if a is None or b is None or t1 <= t0:
            return 0.0, 0.0
        return (b.x - a.x) / (t1 - t0), (b.y - a.y) / (t1 - t0)
