"""Nominal drive as numbers, for open-loop recordings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass
class NominalDrive:
    """Motor and drive with the numbers of ``[actuator]`` (5.1), (5.2), from rest."""

    numbers: Mapping[str, float]
    period_s: float
    theta_rad: float
    omega_rad_s: float = field(default=0.0, init=False)
    u_a_Nm: float = field(default=0.0, init=False)

    def move(self, u_Nm: float, tau_Nm: float) -> float:
        """One period under a motor command and the coupling's torque; the angle at its end."""
        a, h = self.numbers, self.period_s
        self.u_a_Nm += (u_Nm - self.u_a_Nm) * (1 - math.exp(-h / a["tau_c_s"]))
        w = self.omega_rad_s
        friction = a["fv_Nms_rad"] * w + a["fc_Nm"] * math.tanh(w / a["coulomb_width_rad_s"])
        given = a["gear_ratio"] * self.u_a_Nm - friction - tau_Nm
        self.omega_rad_s += h * given / a["J_kgm2"]
        self.theta_rad += h * self.omega_rad_s
        return self.theta_rad
