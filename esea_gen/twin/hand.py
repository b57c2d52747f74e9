"""Simulated hands between two drives.

Every number is assumed; what is published gives the order and the shape:

- Passive stiffness: radial-ulnar deviation is stiffer than flexion-extension, and the axes of the
  ellipse are turned by about 20 deg, softest along the dart thrower's line, from ulnar flexion to
  radial extension (Formica, Charles, Zollo, Guglielmelli, Hogan and Krebs 2012, J. Neurophysiol.
  108, 1158).  The paper's matrices could not be had: the two principal stiffnesses are assumed.
- Stiffness dominates a slow wrist's rotations, coupling by inertia is small (Charles and Hogan
  2011, J. Biomech. 44, 614), coupling by damping is not (Peaden and Charles 2014, J. Biomech. 47,
  2779): the damping is assumed proportional to the passive stiffness.
- The cable's loss and backlash over the elbow's: assumed, as of a capstan.  The encoders have the
  device file's bits.
- Ends of the range of motion: Ryu, Cooney, Askew, An and Chao 1991, J. Hand Surg. 16A, 409.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from esea_gen.device import Device
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError, choose
from esea_gen.model.sensing import of_axis
from esea_gen.twin.people import PlantVariant, named_plant
from esea_gen.twin.published import Person

Pair = tuple[float, float]

_TILT_RAD = math.radians(20.0)
_SOFTEST_NM_RAD, _STIFFEST_NM_RAD = 0.9, 2.2
_DAMPING_S = 0.02  # damping over passive stiffness: 0.02 and 0.04 Nms/rad
_INERTIA_SHARE = 0.03  # inertia between the axes over that of one
# A wrist's drive is beside the joint: a capstan in place of the elbow's cable in its sheath.
_CAPSTAN = {"cable_loss": 0.3, "cable_backlash_rad": 0.3}
# Extension and radial deviation are positive.
ENDS_RAD = tuple(
    (math.radians(low), math.radians(high)) for low, high in ((-79.0, 59.0), (-38.0, 21.0))
)
_END_NM_RAD, _END_NMS_RAD = 60.0, 0.5


@dataclass(frozen=True)
class CoupledHand:
    """A hand on two axes, each number a pair in the order of the device's axes."""

    people: tuple[Person, Person]
    passive_Nm_rad: Pair = (0.0, 0.0)
    passive_cross_Nm_rad: float = 0.0
    inertia_cross_kgm2: float = 0.0
    damping_cross_Nms_rad: float = 0.0
    rest_rad: Pair = (0.0, 0.0)
    ends_rad: tuple[Pair, Pair] = (ENDS_RAD[0], ENDS_RAD[1])

    def __post_init__(self) -> None:
        for name, matrix in self.matrices().items():
            (a, b), (_, d) = matrix
            if not (a >= 0 and d >= 0 and (b * b < a * d or b == 0)):
                raise UserError(
                    f"The hand's {name} [[{a:g}, {b:g}], [{b:g}, {d:g}]] is not positive definite.",
                    f"Give an element off the diagonal within {math.sqrt(max(a * d, 0)):g}.",
                )

    def matrices(self) -> dict[str, tuple[Pair, Pair]]:
        """``inertia``, ``damping`` (the hand's own) and ``stiffness`` (passive), symmetric."""
        one, two = self.people
        diagonals = {
            "inertia": (one.Jh_kgm2, self.inertia_cross_kgm2, two.Jh_kgm2),
            "damping": (
                one.own_damping_Nms_rad,
                self.damping_cross_Nms_rad,
                two.own_damping_Nms_rad,
            ),
            "stiffness": (
                self.passive_Nm_rad[0],
                self.passive_cross_Nm_rad,
                self.passive_Nm_rad[1],
            ),
        }
        return {n: ((a, b), (b, d)) for n, (a, b, d) in diagonals.items()}

    def values(self, axes: Sequence[str]) -> dict[str, float]:
        out = {
            "inertia_cross_kgm2": self.inertia_cross_kgm2,
            "damping_cross_Nms_rad": self.damping_cross_Nms_rad,
            "passive_cross_Nm_rad": self.passive_cross_Nm_rad,
        }
        for i, axis in enumerate(axes):
            low, high = self.ends_rad[i]
            own = self.people[i].values() | {
                "passive_Nm_rad": self.passive_Nm_rad[i],
                "rest_rad": self.rest_rad[i],
                "joint_min_rad": low,
                "joint_max_rad": high,
                "joint_stop_Nm_rad": _END_NM_RAD,
                "joint_stop_Nms_rad": _END_NMS_RAD,
            }
            out |= {of_axis(n, axis): x for n, x in own.items()}
        return out


def wrist(
    intent_Nm_rad: float,
    intent_Nms_rad: float,
    *,
    Jh_kgm2: float = 0.009,
    feedforward: bool = True,
    noise_Nm: float = 0.0,
    passive_scale: float = 1.0,
) -> CoupledHand:
    """A hand by its behaviour on each axis: stiffness and damping towards its intended path."""
    c, s = math.cos(_TILT_RAD), math.sin(_TILT_RAD)
    soft, stiff = passive_scale * _SOFTEST_NM_RAD, passive_scale * _STIFFEST_NM_RAD
    passive = soft * c * c + stiff * s * s, soft * s * s + stiff * c * c
    cross = (soft - stiff) * s * c
    person = Person(
        Jh_kgm2=Jh_kgm2,
        spring_Nm_rad=intent_Nm_rad,
        damping_Nms_rad=intent_Nms_rad,
        feedforward=feedforward,
        own_damping_Nms_rad=0.0,
        gravity_Nm=0.0,
        torque_noise_Nm=noise_Nm,
        torque_noise_Hz=2.0,
    )
    one, two = (replace(person, own_damping_Nms_rad=_DAMPING_S * k) for k in passive)
    return CoupledHand(
        (one, two),
        passive,
        cross,
        inertia_cross_kgm2=_INERTIA_SHARE * Jh_kgm2,
        damping_cross_Nms_rad=_DAMPING_S * cross,
    )


# A handle that nobody holds, and people as the single axis has them.
NOBODY = CoupledHand(
    people=(replace(wrist(0.0, 0.0, Jh_kgm2=0.006).people[0], own_damping_Nms_rad=0.01),) * 2
)
HANDS = {
    "nobody": NOBODY,
    "none": wrist(0.0, 0.0),
    "limp": wrist(0.0, 0.0),
    "ideal": wrist(8.0, 0.4),
    "uncertain": wrist(5.0, 0.2, noise_Nm=0.05),
    "uncertain-no-feedforward": wrist(5.0, 0.2, feedforward=False, noise_Nm=0.05),
    "stiff": wrist(60.0, 1.0),
}
"""Hands that have names; ``none`` is one whose axes are clamped."""
HAND_NAMES = (*HANDS, "random")


def random_hand(seed: int) -> CoupledHand:
    """A hand drawn from a family: relaxed to stiff, light to heavy."""
    rng = np.random.default_rng([seed, 2])
    stiffness = float(rng.uniform(0.0, 20.0))
    inertia = float(rng.uniform(0.006, 0.015))
    ratio = float(rng.uniform(0.2, 0.8))
    return wrist(
        stiffness,
        2 * ratio * math.sqrt(stiffness * inertia),
        Jh_kgm2=inertia,
        noise_Nm=float(rng.uniform(0.0, 0.1)),
        passive_scale=float(rng.uniform(0.6, 1.5)),
    )


def named_hand(name: str, seed: int = 0) -> CoupledHand:
    choose("hand", name, HAND_NAMES)
    return random_hand(seed) if name == "random" else HANDS[name]


def hand_variant(device: DeviceData | Device, plant: str, hand: str, seed: int) -> PlantVariant:
    """The plant of a device with two axes, each drive drawn by itself, and a hand."""
    values: dict[str, float] = {}
    for i, axis in enumerate(device.axes):
        one = named_plant(plant, device, 2 * seed + i)
        own = {n: x * _CAPSTAN.get(n, 1.0) for n, x in one.values.items()}
        own["joint_encoder_bits"] = float(device.file.encoder.resolution_bits.value)
        values |= {of_axis(n, axis): x for n, x in own.items()}
    values |= named_hand(hand, seed).values(device.axes)
    values |= {of_axis("clamped", a): float(hand == "none") for a in device.axes}
    return PlantVariant(device, plant != "ideal", values)
