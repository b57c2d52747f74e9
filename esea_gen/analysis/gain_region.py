"""Stability and passivity of a rendered impedance over its gains, from a linear sampled loop.

Plant and hand stay in continuous time, the controller is sampled and held; what happens between
the samples is exact.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.analysis.linear_loop import Controller, LinearPlant, close_loop
from esea_gen.analysis.passivity import Bools, Hand, checked_gains, letters
from esea_gen.analysis.response import Array, checked_period, plain
from esea_gen.errors import UserError


@dataclass(frozen=True)
class GainRegion:
    """Stability and passivity over gains, from the linear loop.

    kp_Nm_rad, kd_Nms_rad: gains, shapes (p,) and (d,).
    hands: hands that the loop was closed with, h of them.
    radius: largest eigenvalue's magnitude, shape (p, d, h).
    passive: whether the driving point is passive without any hand, shape (p, d).
    least: least relative real part of the driving point's admittance, shape (p, d).
    least_Hz: its frequency, shape (p, d).
    """

    kp_Nm_rad: Array
    kd_Nms_rad: Array
    hands: tuple[Hand, ...]
    radius: Array
    passive: Bools
    least: Array
    least_Hz: Array

    @property
    def stable(self) -> Bools:
        """Stable with every hand, shape (p, d)."""
        return np.asarray(np.all(self.radius < 1, axis=2))

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content: gains, hands and the arrays."""
        content = {k: plain(v) for k, v in vars(self).items() if k != "hands"}
        return content | {"hands": [vars(h) for h in self.hands], "stable": plain(self.stable)}

    def table(self) -> list[str]:
        """The map in letters, one line a stiffness, and the hand that is worst most often."""
        lines = letters(self.kp_Nm_rad, self.kd_Nms_rad, self.stable, self.passive)
        if not self.stable.all():
            worst = np.bincount(np.argmax(self.radius, axis=2)[~self.stable])
            lines.append(f"unstable first with: {self.hands[int(np.argmax(worst))].name}")
        return lines


def gain_region(
    loop: Callable[[float, float], tuple[LinearPlant, Controller]],
    kp_Nm_rad: Sequence[float] | Array,
    kd_Nms_rad: Sequence[float] | Array,
    hands: Iterable[Hand],
    *,
    parts: int = 8,
    progress: Callable[[int, int], None] | None = None,
) -> GainRegion:
    """Map stability with each hand and passivity of the driving point over gains.

    loop: ``loop(kp, kd) -> (Plant, Controller)``, linearised at rest.
    progress: told after each pair of gains how many of how many are done.
    """
    kp, kd, people = (
        checked_gains("kp_Nm_rad", kp_Nm_rad),
        checked_gains("kd_Nms_rad", kd_Nms_rad),
        tuple(hands),
    )
    if not people:
        raise UserError("hands: none.", "Give at least one.")
    shape = (len(kp), len(kd))
    radius = np.zeros((*shape, len(people)))
    passive, least, least_Hz = np.zeros(shape, dtype=np.bool_), np.zeros(shape), np.zeros(shape)
    for done, (i, j) in enumerate(np.ndindex(*shape), 1):
        plant, controller = loop(float(kp[i]), float(kd[j]))
        for h, hand in enumerate(people):
            radius[i, j, h] = close_loop(plant.holding(hand), controller, parts=1).radius
        passive[i, j], least[i, j], least_Hz[i, j] = close_loop(
            plant, controller, parts=parts
        ).passivity()
        if progress is not None:
            progress(done, math.prod(shape))
    return GainRegion(kp, kd, people, radius, passive, least, least_Hz)


def required_damping(
    transfer: Callable[[npt.NDArray[np.complex128]], npt.NDArray[np.complex128]],
    period_s: float,
    *,
    points: int = 4096,
) -> float:
    """Damping that a rigid driving point needs to render a sampled impedance passively.

    transfer: h(z), resisting torque per angle, Nm/rad, for an array of z.
    return: nms/rad: the driving point is passive if, and only if, its own damping is more.

    b > T/2 / (1 - cos wT) Re{(1 - exp(-j wT)) H(exp(j wT))} for 0 <= w <= pi/T, from [1]_; for the
    spring and damper H = K + B (z - 1)/(T z) its largest value is K T/2 + |B|.

    .. [1] J. E. Colgate, G. G. Schenkel, Passivity of a class of sampled-data systems: application
       to haptic interfaces, Journal of Robotic Systems 14 (1), 1997, 37-47.
    """
    angle = np.linspace(np.pi / points, np.pi, points)
    z = np.exp(1j * angle)
    value = (1 - 1 / z) * transfer(z)
    needed = 0.5 * checked_period(period_s) * value.real / (1 - np.cos(angle))
    return float(np.max(needed))
