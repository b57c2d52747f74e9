"""The known torque of a hanging mass, and how well it is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

from esea_gen.errors import UserError


def require(what: str, value: float, low: float, high: float, unit: str, fix: str) -> None:
    """Refuse a number out of its range; NaN is in none."""
    if not low <= value <= high:
        raise UserError(f"{what} = {value:g} {unit} is not within {low:g} to {high:g} {unit}.", fix)


@dataclass(frozen=True)
class KnownLoad:
    """The load, and how well it is known: standard uncertainties."""

    mass_kg: float
    arm_m: float
    angle_rad: float = 0.0
    u_mass_kg: float = 0.005
    u_arm_m: float = 0.001
    u_angle_rad: float = math.radians(1.0)
    g_m_s2: float = 9.81
    u_g_m_s2: float = 0.02

    def __post_init__(self) -> None:
        known = "Give what the scales and the ruler say."
        require("the mass", self.mass_kg, 0.01, 100.0, "kg", known)
        require("the arm", self.arm_m, 0.01, 2.0, "m", known)
        tilt, most = math.degrees(self.angle_rad), 60.0
        require("the arm's angle", tilt, -most, most, "deg", "Bring the arm nearer the horizontal.")
        require("the mass's uncertainty", self.u_mass_kg, 0.0, self.mass_kg, "kg", known)
        require("the arm's uncertainty", self.u_arm_m, 0.0, self.arm_m, "m", known)
        require("the angle's uncertainty", math.degrees(self.u_angle_rad), 0.0, 30.0, "deg", known)
        require("gravity", self.g_m_s2, 9.7, 9.9, "m/s^2", "Give that of the place, or leave it.")
        require("gravity's uncertainty", self.u_g_m_s2, 0.0, 0.1, "m/s^2", known)

    @property
    def torque_Nm(self) -> float:
        """m g r cos(angle)."""
        return self.mass_kg * self.g_m_s2 * self.arm_m * math.cos(self.angle_rad)

    @property
    def budget_Nm(self) -> dict[str, float]:
        torque, u = self.torque_Nm, self.u_angle_rad
        return {
            "mass": torque * self.u_mass_kg / self.mass_kg,
            "arm": torque * self.u_arm_m / self.arm_m,
            "angle": abs(torque * math.tan(self.angle_rad)) * u,
            "angle, second order": torque * u * u / math.sqrt(2),
            "gravity": torque * self.u_g_m_s2 / self.g_m_s2,
        }

    @property
    def u_torque_Nm(self) -> float:
        return math.sqrt(sum(v * v for v in self.budget_Nm.values()))
