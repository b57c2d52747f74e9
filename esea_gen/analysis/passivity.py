"""Passivity of a rendered impedance over its gains, from the energy of recorded runs.

A passive hand and a passive driving point cannot oscillate, whatever the hand's inertia,
damping and stiffness; one that is not passive needs a look at each hand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.analysis.response import Array, checked, plain
from esea_gen.errors import UserError

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Hand:
    """A passive hand or arm."""

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


def hand_family(
    inertia_kgm2: Sequence[float],
    damping_Nms_rad: Sequence[float],
    stiffness_Nm_rad: Sequence[float],
) -> tuple[Hand, ...]:
    """Every combination of some inertias, dampings and stiffnesses."""
    every = product(inertia_kgm2, damping_Nms_rad, stiffness_Nm_rad)
    return tuple(Hand(f"J {j:g}, B {b:g}, K {k:g}", j, b, k) for j, b, k in every)


# -- energy of a run ------------------------------------------------------------------------------


@dataclass(frozen=True)
class EnergyBalance:
    """Energy that a driving point took in over a run."""

    absorbed_J: Array
    stored_J: float
    exchanged_J: float

    @property
    def generated_J(self) -> float:
        """Energy given out beyond what was ever put in; 0 for a passive driving point."""
        return max(0.0, -float(np.min(self.absorbed_J)) - self.stored_J)

    @property
    def index(self) -> float:
        """Generated over exchanged energy: 0 passive, towards 1 active."""
        return self.generated_J / self.exchanged_J if self.exchanged_J > 0 else 0.0


def energy_balance(
    theta_rad: npt.ArrayLike,
    tau_Nm: npt.ArrayLike,
    *,
    held: bool = False,
    stored_J: float = 0.0,
) -> EnergyBalance:
    """Energy that a rendered impedance takes in from the hand."""
    theta = checked("theta_rad", theta_rad)
    tau = checked("tau_Nm", tau_Nm, len(theta))
    if not (stored_J >= 0 and math.isfinite(stored_J)):
        raise UserError(f"stored_J: {stored_J} J.", "Give 0 or more.")
    mean = tau[:-1] if held else 0.5 * (tau[:-1] + tau[1:])
    parts = -mean * np.diff(theta)
    absorbed = np.concatenate([[0.0], np.cumsum(parts)])
    return EnergyBalance(absorbed, stored_J, float(np.sum(np.abs(parts))))


@dataclass(frozen=True)
class PassivityMap:
    """Energy generated over gains and hands."""

    kp_Nm_rad: Array
    kd_Nms_rad: Array
    hands: tuple[Hand, ...]
    generated_J: Array
    index: Array
    diverging: Bools
    tolerance: float

    @property
    def stable(self) -> Bools:
        """No hand makes it swing up, shape (p, d)."""
        return np.asarray(~np.any(self.diverging, axis=2))

    @property
    def passive(self) -> Bools:
        """No hand gets more out than it put in, shape (p, d)."""
        return np.asarray(np.all(self.index <= self.tolerance, axis=2)) & self.stable

    def to_dict(self) -> dict[str, Any]:
        return {
            "kp_Nm_rad": plain(self.kp_Nm_rad),
            "kd_Nms_rad": plain(self.kd_Nms_rad),
            "hands": [vars(h) for h in self.hands],
            "generated_J": plain(self.generated_J),
            "index": plain(self.index),
            "diverging": plain(self.diverging),
            "stable": plain(self.stable),
            "passive": plain(self.passive),
            "tolerance": self.tolerance,
        }
