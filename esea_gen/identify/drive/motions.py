"""A path of the gear, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from esea_gen.language.ports import Array

REST_S = 0.3


@dataclass(frozen=True)
class GearPath:
    """Where the gear is to be, from the start of a procedure on; one row a tick."""

    theta_rad: Array
    omega_rad_s: Array
    alpha_rad_s2: Array

    @classmethod
    def through(
        cls, legs: Sequence[tuple[float, float]], tick_s: float, accel_rad_s2: float = 4.0
    ) -> GearPath:
        """From 0 through ends: each leg an end and the speed on the way, with a rest behind it."""
        rates: list[Array] = []
        at = 0.0
        for end, speed in legs:
            span = end - at
            ramp = min(speed / accel_rad_s2, math.sqrt(abs(span) / accel_rad_s2))
            ramp = max(round(ramp / tick_s), 1) * tick_s
            cruise = max(round((abs(span) / speed - ramp) / tick_s), 0) * tick_s
            top = span / (ramp + cruise)
            n, m = round(ramp / tick_s), round(cruise / tick_s)
            up = top * np.arange(1, n + 1) / n
            rates += [up, np.full(m, top), top - up, np.zeros(round(REST_S / tick_s))]
            at = end
        omega = np.concatenate(rates)
        theta = np.cumsum(omega) * tick_s
        return cls(theta, omega, np.gradient(omega, tick_s))

    def __len__(self) -> int:
        return len(self.theta_rad)
