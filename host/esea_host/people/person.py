"""Virtual participant: parameters of a person who learns.  Simulated.

The wrist study moves by optimal feedback control (:mod:`esea_host.people.control`), the interaction
study in submovements.  The numbers come from the literature, rounded; none was set by a published
median of chapter 6 or 7.

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
[9] R. Balakrishnan, I. MacKenzie, CHI 1997: 4.1 bits a second with the wrist.
[10] A. Hamilton, K. Jones, D. Wolpert, Experimental Brain Research 157, 2004: torque varies in
    proportion to its mean, by some per cent.
[11] W. Marras, R. Schoenmarklin, Ergonomics 36, 1993: mean speeds of the wrist in work with the
    hands.
[12] D. Hoffman, P. Strick, J. Neuroscience 6, 1986: a wrist's movements of any size last as long.
[13] F. Crevecoeur, D. Munoz, S. Scott, J. Neuroscience 36, 2016: 50 ms until a limb is felt.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

END_NM_RAD, END_NMS_RAD = 40.0, 0.6
NO_TORQUE = (0.0, 0.0)


class Muscle(NamedTuple):
    """Torque of an axis' muscles in a frame, on any plant.

    An impedance about a path that is even from ``start_rad`` to ``end_rad``, and a torque that goes
    evenly from ``torque_start_Nm`` to ``torque_end_Nm`` beside it; both together at most most_Nm.
    """

    stiffness_Nm_rad: float
    damping_Nms_rad: float
    start_rad: float
    end_rad: float
    most_Nm: float
    torque_start_Nm: float = 0.0
    torque_end_Nm: float = 0.0


@dataclass(frozen=True)
class Limb:
    """A wrist on one axis, without its muscles.

    inertia_kgm2: of the hand.  stiffness_Nm_rad, damping_Nms_rad: passive, about rest_rad. low_rad,
    high_rad: anatomical range, with a stiff end.
    """

    inertia_kgm2: float
    stiffness_Nm_rad: float
    damping_Nms_rad: float
    rest_rad: float
    low_rad: float
    high_rad: float

    def torque_Nm(
        self, theta: float, omega: float, muscle: Sequence[float], share: float, frame_s: float
    ) -> float:
        """Of muscles and passive wrist, at a share of a frame."""
        stiffness, damping, start, end, most = muscle[:5]
        first, last = muscle[5:] or NO_TORQUE
        rate = (end - start) / frame_s
        own = first + share * (last - first)
        own += stiffness * (start + share * (end - start) - theta) + damping * (rate - omega)
        own = most if own > most else -most if own < -most else own
        passive = -self.stiffness_Nm_rad * (theta - self.rest_rad) - self.damping_Nms_rad * omega
        if theta < self.low_rad:
            passive -= END_NM_RAD * (theta - self.low_rad) + END_NMS_RAD * omega
        elif theta > self.high_rad:
            passive -= END_NM_RAD * (theta - self.high_rad) + END_NMS_RAD * omega
        return own + passive


@dataclass(frozen=True)
class PersonModel:
    """Parameters of the average person.

    delay_s: from the screen to a correction [3].
    reaction_s: to a target that appears; a simple choice takes about 0.25 s.
    submovement_s, every_s: length of a submovement of a few degrees, and least time between two
        [2].
    noise: standard deviation of a submovement's size over its size [4].
    retain, learn: fast and slow process [5].
    stiffness_Nm_rad, damping_ratio: of the hand on its aim; wrists reach some 3 to 10 Nm/rad when
        they work.
    effort_Nm: the torque at which people stop; assumed, a third of the most [8].
    gain_rate: share by which the sense of how far the cursor goes is corrected in a trial; assumed.
    spread: between people: coefficient of variation of each of these; assumed.
    range_deg: flexion, extension, ulnar, radial [6].
    felt_s: from a motion to a reaction to what is felt of it [13].
    bits_s: accuracy gained in a second of a movement [9].
    torque_noise: standard deviation of a steady torque over its mean [10].
    sense_noise: share of the noise of the senses that is there.
    contracted_Nm_rad: stiffness that contracted muscles add about where the hand is taken to be;
        assumed.
    comfortable_deg_s: mean speed from end to end of FE and RU [11]; shorter ways take as long [12].
    """

    delay_s: float = 0.16
    reaction_s: float = 0.25
    submovement_s: float = 0.40
    every_s: float = 0.35
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
    felt_s: float = 0.05
    bits_s: float = 4.1
    torque_noise: float = 0.03
    sense_noise: float = 1.0
    contracted_Nm_rad: float = 1.0
    comfortable_deg_s: tuple[float, float] = (42.0, 26.0)


@dataclass
class VirtualParticipant:
    """One participant, between trials."""

    model: PersonModel
    limbs: tuple[Limb, Limb]
    rng: np.random.Generator
    fast: float = 0.0  # what is known of how far a target runs away, 1 all of it [5]
    slow: float = 0.0
    # Of the cursor over the hand, as it is felt, per axis.
    gain: list[float] = field(default_factory=lambda: [1.0, 1.0])

    @property
    def known(self) -> float:
        """Expected motion of a target: 0 static, 1 moving as in equation 7.7."""
        return self.fast + self.slow

    def learn(self, moved: bool) -> None:
        """Learn from a target that moved or not."""
        error = float(moved) - self.known
        m = self.model
        self.fast = m.retain[0] * self.fast + m.learn[0] * error
        self.slow = m.retain[1] * self.slow + m.learn[1] * error

    def forget(self, days: float) -> None:
        """Time passes: the fast process is gone; the slow one, as in a trial a day (assumed)."""
        self.fast, self.slow = 0.0, self.slow * self.model.retain[1] ** (10 * days)


def person(rng: np.random.Generator, model: PersonModel) -> VirtualParticipant:
    def about(value: float) -> float:
        return value * (1.0 + model.spread * float(np.clip(rng.normal(), -2, 2)))

    # By themselves, so that a further number changes nobody's others.
    factors = (1.0 + model.spread * np.clip(rng.spawn(1)[0].normal(size=3), -2, 2)).tolist()
    flexion, extension, ulnar, radial = (about(x) for x in model.range_deg)
    fe_deg_s, ru_deg_s = model.comfortable_deg_s
    one = replace(  # draws in the order of these lines
        model,
        delay_s=about(model.delay_s),
        reaction_s=about(model.reaction_s),
        submovement_s=about(model.submovement_s),
        every_s=about(model.every_s),
        comfortable_deg_s=((pace := about(1.0)) * fe_deg_s, pace * ru_deg_s),
        noise=about(model.noise),
        learn=(about(model.learn[0]), about(model.learn[1])),
        stiffness_Nm_rad=about(model.stiffness_Nm_rad),
        damping_ratio=about(model.damping_ratio),
        effort_Nm=about(model.effort_Nm),
        range_deg=(flexion, extension, ulnar, radial),
        inertia_kgm2=about(model.inertia_kgm2),
        bits_s=model.bits_s * factors[0],
        torque_noise=model.torque_noise * factors[1],
        contracted_Nm_rad=model.contracted_Nm_rad * factors[2],
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


def minimum_jerk_speed(share: float) -> float:
    """Its rate over that share."""
    s = min(max(share, 0.0), 1.0)
    return 30.0 * (s * (1.0 - s)) ** 2
