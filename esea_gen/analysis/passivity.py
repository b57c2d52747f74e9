"""Passivity of a rendered impedance over its gains, from the energy of recorded runs.

A passive hand and a passive driving point cannot oscillate, whatever the hand's inertia,
damping and stiffness; one that is not passive needs a look at each hand.
`esea_gen.analysis.gain_region` does the same on matrices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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
    """A passive hand or arm.

    Parameters
    ----------
    name : str
        For tables.
    inertia_kgm2, damping_Nms_rad, stiffness_Nm_rad : float
        0 or more.
    """

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
    """Every combination of some inertias, dampings and stiffnesses.

    Parameters
    ----------
    inertia_kgm2, damping_Nms_rad, stiffness_Nm_rad : sequence of float
        Values of each.

    Returns
    -------
    tuple of Hand
        Named after their numbers.

    Raises
    ------
    UserError
        When a value is below 0.
    """
    every = product(inertia_kgm2, damping_Nms_rad, stiffness_Nm_rad)
    return tuple(Hand(f"J {j:g}, B {b:g}, K {k:g}", j, b, k) for j, b, k in every)


# -- energy of a run ------------------------------------------------------------------------------


@dataclass(frozen=True)
class EnergyBalance:
    """Energy that a driving point took in over a run.

    Parameters
    ----------
    absorbed_J : ndarray
        Taken in since the start, at the samples of the angle, shape (n,).
    stored_J : float
        What the driving point held at the start.
    exchanged_J : float
        Energy that went either way, in total.
    """

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
    """Energy that a rendered impedance takes in from the hand.

    Parameters
    ----------
    theta_rad : array_like
        Angle of the driving point, shape (n,).
    tau_Nm : array_like
        Torque of the driving point ON the hand, at the same samples, shape (n,).
    held : bool
        The torque keeps a sample's value until the next sample: the sum is then exact.  Otherwise
        the trapezoidal rule is taken.
    stored_J : float
        Energy it holds at the start, for example of a virtual spring that starts deflected.

    Returns
    -------
    EnergyBalance
        Its running sum.

    Raises
    ------
    UserError
        On bad signals.
    """
    theta = checked("theta_rad", theta_rad)
    tau = checked("tau_Nm", tau_Nm, len(theta))
    if not (stored_J >= 0 and math.isfinite(stored_J)):
        raise UserError(f"stored_J: {stored_J} J.", "Give 0 or more.")
    mean = tau[:-1] if held else 0.5 * (tau[:-1] + tau[1:])
    parts = -mean * np.diff(theta)
    absorbed = np.concatenate([[0.0], np.cumsum(parts)])
    return EnergyBalance(absorbed, stored_J, float(np.sum(np.abs(parts))))


@dataclass(frozen=True)
class HandRun:
    """What a run of the closed loop leaves for the energy balance.

    Parameters
    ----------
    theta_rad, tau_Nm : ndarray
        Angle of the driving point and its torque on the hand, shape (n,) each; a stopped run may
        hold values that are not finite.
    held : bool
        The torque is held between samples.
    stored_J : float
        Energy of the driving point at the start.
    """

    theta_rad: Array
    tau_Nm: Array
    held: bool = False
    stored_J: float = 0.0

    @property
    def diverges(self) -> bool:
        """Not finite, or swinging more in the last third than in the second, by over 10 %."""
        theta = np.asarray(self.theta_rad, dtype=np.float64)
        if not (np.all(np.isfinite(theta)) and np.all(np.isfinite(self.tau_Nm))):
            return True
        third = len(theta) // 3
        second, last = (float(np.std(p)) for p in (theta[third : 2 * third], theta[2 * third :]))
        floor = 1e-9 * max(1.0, float(np.max(np.abs(theta))))
        return last > 1.1 * second + floor


@dataclass(frozen=True)
class PassivityMap:
    """Energy generated over gains and hands.

    Parameters
    ----------
    kp_Nm_rad, kd_Nms_rad : ndarray
        Gains, shapes (p,) and (d,).
    hands : tuple of Hand
        The hands, h of them.
    generated_J, index : ndarray
        Shape (p, d, h); infinite where the run is not finite.
    diverging : ndarray of bool
        Shape (p, d, h).
    tolerance : float
        Index up to which a run counts as passive.
    """

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
        """JSON-ready content: gains, hands and the arrays."""
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

    def table(self) -> list[str]:
        """The map in letters, one line a stiffness."""
        return letters(self.kp_Nm_rad, self.kd_Nms_rad, self.stable, self.passive)


def letters(kp: Array, kd: Array, stable: Bools, passive: Bools) -> list[str]:
    """A map over gains in letters.

    Parameters
    ----------
    kp, kd : ndarray
        Gains, shapes (p,) and (d,).
    stable, passive : ndarray of bool
        Shape (p, d).

    Returns
    -------
    list of str
        A legend, a head and one line a stiffness.
    """
    lines = [
        "P passive, s stable with every hand, . unstable with one",
        f"{'Kp | Kd':>10}" + "".join(f"{d:>8.3g}" for d in kd),
    ]
    for i, p in enumerate(kp):
        marks = ("P" if passive[i, j] else "s" if stable[i, j] else "." for j in range(len(kd)))
        lines.append(f"{p:>10.3g}" + "".join(f"{m:>8}" for m in marks))
    return lines


def checked_gains(name: str, values: Sequence[float] | Array) -> Array:
    """Gains of a map.

    Parameters
    ----------
    name : str
        For messages.
    values : sequence of float
        The gains.

    Returns
    -------
    ndarray
        The same.

    Raises
    ------
    UserError
        When they are not finite or do not rise.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not len(array) or not np.all(np.isfinite(array)):
        raise UserError(f"{name}: {array}.", "Give a row of finite gains.")
    if np.any(np.diff(array) <= 0):
        raise UserError(f"{name}: {array} does not rise.", "Sort the gains, each once.")
    return array


Runner = Callable[[float, float, Hand], HandRun]


def passivity_map(
    run: Runner,
    kp_Nm_rad: Sequence[float] | Array,
    kd_Nms_rad: Sequence[float] | Array,
    hands: Sequence[Hand],
    *,
    tolerance: float = 1e-6,
    progress: Callable[[int, int], None] | None = None,
) -> PassivityMap:
    """Run the closed loop over gains and hands and balance each run's energy.

    Parameters
    ----------
    run : callable
        ``run(kp, kd, hand) -> HandRun``: a closed-loop run with that hand, set in motion.
    kp_Nm_rad, kd_Nms_rad : sequence of float
        Gains, rising.
    hands : sequence of Hand
        The hands.
    tolerance : float
        Index up to which a run counts as passive: rounding, and the quadrature of torques that are
        not held.
    progress : callable, optional
        Told after each run how many of how many are done.

    Returns
    -------
    PassivityMap
        Necessary, not sufficient: a run can show activity, not that there never is any.

    Raises
    ------
    UserError
        On gains that do not rise, or no hands.
    """
    kp, kd, people = (
        checked_gains("kp_Nm_rad", kp_Nm_rad),
        checked_gains("kd_Nms_rad", kd_Nms_rad),
        tuple(hands),
    )
    if not people:
        raise UserError("hands: none.", "Give at least one.")
    shape = (len(kp), len(kd), len(people))
    generated, index = np.zeros(shape), np.zeros(shape)
    diverging = np.zeros(shape, dtype=np.bool_)
    total = math.prod(shape)
    for done, (i, j, h) in enumerate(np.ndindex(*shape), 1):
        result = run(float(kp[i]), float(kd[j]), people[h])
        diverging[i, j, h] = result.diverges
        if np.all(np.isfinite(result.theta_rad)) and np.all(np.isfinite(result.tau_Nm)):
            balance = energy_balance(
                result.theta_rad, result.tau_Nm, held=result.held, stored_J=result.stored_J
            )
            generated[i, j, h], index[i, j, h] = balance.generated_J, balance.index
        else:
            generated[i, j, h] = index[i, j, h] = math.inf
        if progress is not None:
            progress(done, total)
    return PassivityMap(kp, kd, people, generated, index, diverging, tolerance)
