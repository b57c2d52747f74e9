"""A virtual participant: sees the scene late, moves in submovements, is noisy, adapts.  Simulated.

The numbers were fixed from the literature before the first study was run, and none was set by a
published median of chapter 7.

References
----------
[1] T. Flash, N. Hogan, J. Neuroscience 5, 1985: minimum-jerk movements.
[2] D. Meyer et al., Psychological Review 95, 1988; R. Miall, D. Weir, J. Stein, J. Motor Behavior
    25, 1993: intermittent submovements, two to three a second.
[3] J. Saunders, D. Knill, Experimental Brain Research 152, 2003: corrections of the hand begin
    about 160 ms after what is seen.
[4] R. van Beers, P. Haggard, D. Wolpert, J. Neurophysiology 91, 2004; C. Harris, D. Wolpert, Nature
    394, 1998: noise in proportion to the command.
[5] M. Smith, A. Ghazizadeh, R. Shadmehr, PLoS Biology 4, 2006: two processes of adaptation.
[6] J. Ryu et al., J. Hand Surgery 16A, 1991: range of the wrist, 40 people.
[7] D. Formica et al., J. Neurophysiology 108, 2012: passive stiffness of the wrist.
[8] S. Delp, A. Grinspan, R. Buchanan, J. Biomechanics 29, 1996: moments of 7 to 12 Nm at most.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from esea_host.study.scene import Scene, Shape
from esea_host.study.task import Actor, Inputs
from esea_host.wrist.rig import Limb, Rig
from esea_host.wrist.target import DAMPING_KG_S, MASS_KG

FRAME_S = 0.01


@dataclass(frozen=True)
class PersonModel:
    """Numbers of the people, before they differ.

    Parameters
    ----------
    delay_s : float
        From the screen to a correction [3].
    reaction_s : float
        To a target that appears; a simple choice takes about 0.25 s.
    submovement_s, every_s : float
        Length of a submovement of a few degrees, and least time between two [2].
    sweep_s : float
        From end to end, comfortably; assumed.
    noise : float
        Standard deviation of a submovement's size over its size [4].
    retain, learn : tuple of float
        Fast and slow process [5].
    stiffness_Nm_rad, damping_ratio : float
        Of the hand on its aim; wrists reach some 3 to 10 Nm/rad when they work.
    effort_Nm : float
        The torque at which people stop; assumed, a third of the most [8].
    gain_rate : float
        Share by which the sense of how far the cursor goes is corrected in a trial; assumed.
    spread : float
        Between people: coefficient of variation of each of these; assumed.
    range_deg : tuple of float
        Flexion, extension, ulnar, radial [6].
    """

    delay_s: float = 0.16
    reaction_s: float = 0.25
    submovement_s: float = 0.40
    every_s: float = 0.35
    sweep_s: float = 0.9
    noise: float = 0.08
    retain: tuple[float, float] = (0.59, 0.992)
    learn: tuple[float, float] = (0.21, 0.02)
    stiffness_Nm_rad: float = 8.0
    damping_ratio: float = 0.6
    effort_Nm: float = 3.0
    gain_rate: float = 0.3
    spread: float = 0.10
    range_deg: tuple[float, float, float, float] = (79.0, 59.0, 38.0, 21.0)
    passive_Nm_rad: tuple[float, float] = (0.8, 1.7)  # [7], FE and RU
    inertia_kgm2: float = 0.003


@dataclass
class VirtualParticipant:
    """One participant, between trials.

    fast, slow: what is known of how far a target runs away, 1 all of it [5].
    gain: of the cursor over the hand, as it is felt, per axis.
    """

    model: PersonModel
    limbs: tuple[Limb, Limb]
    rng: np.random.Generator
    fast: float = 0.0
    slow: float = 0.0
    gain: list[float] = field(default_factory=lambda: [1.0, 1.0])

    @property
    def known(self) -> float:
        """What is expected of a target: 0 that it stands, 1 that it moves as equation 7.7."""
        return self.fast + self.slow

    def learn(self, moved: bool) -> None:
        """A target was seen to move, or to stand."""
        error = float(moved) - self.known
        m = self.model
        self.fast = m.retain[0] * self.fast + m.learn[0] * error
        self.slow = m.retain[1] * self.slow + m.learn[1] * error

    def forget(self, days: float) -> None:
        """Time passes: the fast process is gone; the slow one, as in a trial a day (assumed)."""
        self.fast, self.slow = 0.0, self.slow * self.model.retain[1] ** (10 * days)


def person(rng: np.random.Generator, model: PersonModel) -> VirtualParticipant:
    """Draw a person.

    Parameters
    ----------
    rng : numpy.random.Generator
        Its own.
    model : PersonModel
        The people it comes from.

    Returns
    -------
    VirtualParticipant
        Each number by a normal factor, cut at two deviations.
    """

    def about(value: float) -> float:
        return value * (1.0 + model.spread * float(np.clip(rng.normal(), -2, 2)))

    flexion, extension, ulnar, radial = (about(x) for x in model.range_deg)
    one = PersonModel(
        delay_s=about(model.delay_s),
        reaction_s=about(model.reaction_s),
        submovement_s=about(model.submovement_s),
        every_s=about(model.every_s),
        sweep_s=about(model.sweep_s),
        noise=about(model.noise),
        retain=model.retain,
        learn=(about(model.learn[0]), about(model.learn[1])),
        stiffness_Nm_rad=about(model.stiffness_Nm_rad),
        damping_ratio=about(model.damping_ratio),
        effort_Nm=about(model.effort_Nm),
        gain_rate=model.gain_rate,
        spread=model.spread,
        range_deg=(flexion, extension, ulnar, radial),
        inertia_kgm2=about(model.inertia_kgm2),
    )
    ends = ((-flexion, extension), (-ulnar, radial))
    limbs = []
    for (low, high), stiffness in zip(ends, model.passive_Nm_rad, strict=True):
        k = about(stiffness)
        damping = 2 * 0.3 * math.sqrt(k * one.inertia_kgm2)
        limbs.append(Limb(one.inertia_kgm2, k, damping, 0.0, math.radians(low), math.radians(high)))
    return VirtualParticipant(one, (limbs[0], limbs[1]), rng)


def minimum_jerk(share: float) -> float:
    """Way of a minimum-jerk movement over its time [1]."""
    s = min(max(share, 0.0), 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


@dataclass(frozen=True)
class _Submovement:
    axis: int
    start_s: float
    length_s: float
    size_deg: float

    def at(self, time_s: float) -> float:
        return self.size_deg * minimum_jerk((time_s - self.start_s) / self.length_s)


def _runs_away(length_s: float) -> float:
    # Share of an even movement of this length by which the target of equation 7.7 has moved.
    tau = MASS_KG / DAMPING_KG_S
    return 1.0 - tau / length_s * (1.0 - math.exp(-length_s / tau))


def shape(scene: Scene, role: str) -> Shape | None:
    """The shape of a role; None where there is none."""
    return next((s for s in scene.shapes if s.role == role), None)


class WristActor(Actor):
    """A person in the virtual device, for one trial.

    Parameters
    ----------
    who : VirtualParticipant
        Learns by it.
    rig : Rig
        The device.
    task : str
        Name of the task: people are told what to do.
    aims : list of float
        Where the hand is held, both axes, deg; goes on from trial to trial.
    """

    def __init__(self, who: VirtualParticipant, rig: Rig, task: str, aims: list[float]) -> None:
        self.who, self.rig, self.task, self.aims = who, rig, task, aims
        self.base = list(aims)
        self.time_s = 0.0
        self.running: list[_Submovement] = []
        self.next_s = [0.0, 0.0]
        self.seen: deque[tuple[float, Scene, tuple[float, float]]] = deque()
        self.appeared_s: float | None = None
        self.met: str = ""

    def react(self, scene: Scene, requests: Mapping[str, float]) -> tuple[float, Inputs]:
        """One frame."""
        self.time_s = round(self.time_s + FRAME_S, 6)
        self._look(scene)
        before = list(self.aims)
        self._aim()
        m = self.who.model
        muscle = []
        for k, limb in enumerate(self.who.limbs):
            inertia = limb.inertia_kgm2 + 0.006
            damping = 2 * m.damping_ratio * math.sqrt(m.stiffness_Nm_rad * inertia)
            ends = (math.radians(before[k]), math.radians(self.aims[k]))
            muscle.append((m.stiffness_Nm_rad, damping, *ends, m.effort_Nm))
        self.rig.advance(muscle, requests.get("impairment", 0.0) > 0.5)
        fe, ru = (math.degrees(a.theta_rad) for a in self.rig.axes)
        return self.time_s, {"fe_deg": fe, "ru_deg": ru}

    # -- seeing -------------------------------------------------------------------------------

    def _look(self, scene: Scene) -> None:
        self.seen.append((self.time_s, scene, (self.aims[0], self.aims[1])))
        delay = self.who.model.delay_s
        while len(self.seen) > 2 and self.seen[1][0] <= self.time_s - delay:
            self.seen.popleft()
        if self.task == "wrist.catch" and self.appeared_s is None and shape(scene, "target"):
            self.appeared_s = self.time_s

    # -- moving -------------------------------------------------------------------------------

    def _aim(self) -> None:
        keep = []
        for x in self.running:
            if self.time_s >= x.start_s + x.length_s:
                self.base[x.axis] += x.size_deg
            else:
                keep.append(x)
        self.running = keep
        _, scene, aims_then = self.seen[0]
        if self.time_s > self.who.model.delay_s:
            for axis in (0, 1):
                if self.time_s >= self.next_s[axis]:
                    self._plan(axis, scene, aims_then)
        for axis in (0, 1):
            self.aims[axis] = self.base[axis] + sum(
                x.at(self.time_s) for x in self.running if x.axis == axis
            )

    def _plan(self, axis: int, scene: Scene, aims_then: tuple[float, float]) -> None:
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
            at += self._speed_seen(axis) * (m.delay_s + length / 2)
            # It is their own motion: nobody expects it beyond half of their own range.
            limb = self.who.limbs[axis]
            half = math.degrees(limb.high_rad - limb.low_rad) / 2
            at = min(max(at, -half), half)
        wanted = at - (cursor.y if axis else cursor.x)
        # What has been commanded since that was seen, and what is still to come of it.
        end = self.base[axis] + sum(x.size_deg for x in self.running if x.axis == axis)
        gain = self.who.gain[axis]
        wanted = wanted / gain - (end - aims_then[axis])
        if self.task in ("wrist.range", "wrist.velocity"):
            length = max(m.sweep_s * min(abs(wanted) / 60.0, 1.0), m.submovement_s)
        if self.task == "wrist.catch" and goal.role == "target":
            # What is known of equation 7.7: it goes on for a while, and runs from the hand.
            tau = MASS_KG / DAMPING_KG_S
            coasts = m.delay_s + tau * (1.0 - math.exp(-length / tau))
            wanted += self.who.known * self._speed_seen(axis) * coasts / gain
            wanted /= 1.0 - self.who.known * _runs_away(length)
        if abs(wanted) < 0.4:
            return
        limb = self.who.limbs[axis]
        size = wanted * (1.0 + m.noise * float(self.who.rng.normal()))
        low, high = (math.degrees(x) for x in (limb.low_rad, limb.high_rad))
        size = min(max(size, low - 10 - end), high + 10 - end)
        self.running.append(_Submovement(axis, self.time_s, length, size))
        self.next_s[axis] = self.time_s + max(m.every_s, length if length > 0.6 else 0.0)

    def _go_home(self, axis: int) -> None:
        # Felt, not seen: where the wrist rests by itself.
        if not self.running or all(x.axis != axis for x in self.running):
            home = math.degrees(self.who.limbs[axis].rest_rad) - self.base[axis]
            self.running.append(_Submovement(axis, self.time_s, self.who.model.sweep_s, home))
            self.next_s[axis] = math.inf

    def _goal(self, scene: Scene) -> Shape | None:
        target = shape(scene, "target")
        if self.task != "wrist.catch":
            return target
        shown = self.appeared_s is not None
        if shown and self.time_s < (self.appeared_s or 0.0) + self.who.model.reaction_s:
            return None
        return target or shape(scene, "origin")

    def _speed_seen(self, axis: int) -> float:
        # Of the target, between the two oldest scenes that are kept.
        if len(self.seen) < 4:
            return 0.0
        (t0, s0, _), (t1, s1, _) = self.seen[0], self.seen[3]
        a, b = shape(s0, "target"), shape(s1, "target")
        if a is None or b is None or t1 <= t0:
            return 0.0
        return ((b.y - a.y) if axis else (b.x - a.x)) / (t1 - t0)
