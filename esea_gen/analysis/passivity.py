"""Passivity of a rendered impedance over its gains, from the energy of recorded runs.

A passive hand and a passive driving point cannot oscillate, whatever the hand's inertia, damping
and stiffness; one that is not passive must be checked with each hand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from esea_gen.analysis.response import checked
from esea_gen.errors import UserError
from esea_gen.language.ports import Array

FIRMEST = 1e4  # the stiffest spring that the plant takes, Nm/rad


@dataclass(frozen=True)
class Hand:
    name: str
    inertia_kgm2: float = 0.0
    damping_Nms_rad: float = 0.0
    stiffness_Nm_rad: float = 0.0

    def __post_init__(self) -> None:
        for key in ("inertia_kgm2", "damping_Nms_rad", "stiffness_Nm_rad"):
            value = getattr(self, key)
            if not (value >= 0 and math.isfinite(value)):
                raise UserError(
                    f"Hand '{self.name}': {key} is {value}.", "A passive hand has 0 or more."
                )

    def scaled(self, by: float) -> Hand:
        """The hand on a device of so many times the torque."""
        own = self.inertia_kgm2, self.damping_Nms_rad, self.stiffness_Nm_rad
        return hand_family(*([min(by * x, FIRMEST)] for x in own))[0]


def hand_family(
    inertia_kgm2: Sequence[float],
    damping_Nms_rad: Sequence[float],
    stiffness_Nm_rad: Sequence[float],
) -> tuple[Hand, ...]:
    """Every combination of some inertias, dampings and stiffnesses."""
    every = product(inertia_kgm2, damping_Nms_rad, stiffness_Nm_rad)
    return tuple(Hand(f"J {j:g}, B {b:g}, K {k:g}", j, b, k) for j, b, k in every)


@dataclass(frozen=True)
class EnergyBalance:
    absorbed_J: Array

    @property
    def generated_J(self) -> float:
        """Output energy beyond all input energy; 0 for a passive driving point."""
        return max(0.0, -float(np.min(self.absorbed_J)))


def energy_balance(theta_rad: npt.ArrayLike, tau_Nm: npt.ArrayLike) -> EnergyBalance:
    """Energy that a rendered impedance takes in from the hand, by the trapezoidal rule."""
    theta = checked("theta_rad", theta_rad)
    tau = checked("tau_Nm", tau_Nm, len(theta))
    parts = -0.5 * (tau[:-1] + tau[1:]) * np.diff(theta)
    return EnergyBalance(np.concatenate([[0.0], np.cumsum(parts)]))
