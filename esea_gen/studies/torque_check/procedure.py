"""Torque of a hanging mass and its uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from scipy.optimize import brentq

from esea_gen.devices.drive_relations import spring_Nm
from esea_gen.errors import UserError

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData


def require(what: str, value: float, low: float, high: float, unit: str, fix: str) -> None:
    """Refuse a number out of its range; NaN is in none."""
    if not low <= value <= high:
        raise UserError(f"{what} = {value:g} {unit} is not within {low:g} to {high:g} {unit}.", fix)


@dataclass(frozen=True)
class KnownLoad:
    mass_kg: float
    arm_m: float
    angle_rad: float = 0.0
    u_mass_kg: float = 0.005
    u_arm_m: float = 0.001
    u_angle_rad: float = math.radians(1.0)
    g_m_s2: float = 9.81
    u_g_m_s2: float = 0.02

    def __post_init__(self) -> None:
        known = "Give the measured value."
        require("the mass", self.mass_kg, 0.01, 100.0, "kg", known)
        require("the arm", self.arm_m, 0.01, 2.0, "m", known)
        tilt, most = math.degrees(self.angle_rad), 60.0
        require("the arm's angle", tilt, -most, most, "deg", "Bring the arm nearer the horizontal.")
        require("the mass's uncertainty", self.u_mass_kg, 0.0, self.mass_kg, "kg", known)
        require("the arm's uncertainty", self.u_arm_m, 0.0, self.arm_m, "m", known)
        require("the angle's uncertainty", math.degrees(self.u_angle_rad), 0.0, 30.0, "deg", known)
        require("gravity", self.g_m_s2, 9.7, 9.9, "m/s^2", "Give the local value, or leave it out.")
        require("gravity's uncertainty", self.u_g_m_s2, 0.0, 0.1, "m/s^2", known)

    @property
    def weight_Nm(self) -> float:
        """m g r: the torque with the arm horizontal."""
        return self.mass_kg * self.g_m_s2 * self.arm_m

    @property
    def torque_Nm(self) -> float:
        """m g r cos(angle)."""
        return self.weight_Nm * math.cos(self.angle_rad)

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


REPEATS = 3
# A smaller load is refused.  One below the second share can fail a sensor but not pass it: a count
# of the encoders is then above a hundredth of the load, and the rubber's stiffening hardly acts.
SMALLEST_LOAD_PCT, JUDGED_LOAD_PCT = 25.0, 40.0

Kind = Literal["zero", "plus", "minus"]


@dataclass(frozen=True)
class JudgedLimit:
    name: str
    percent: float
    what: str
    reason: str
    load_percent: float = 0.0

    def torque_Nm(self, full_scale_Nm: float, load_Nm: float) -> float:
        """The limit for a known load, before any uncertainty is taken off."""
        return (self.percent * full_scale_Nm + self.load_percent * load_Nm) / 100

    @property
    def shares(self) -> str:
        """Its parts, for people."""
        own = f"{self.percent:g} % of full scale"
        return f"{self.load_percent:g} % of the load + {own}" if self.load_percent else own


LIMITS = (
    JudgedLimit(
        "zero",
        2.0,
        "|mean| of an unloaded phase",
        "an offset is felt as a constant pull; the model's best published validation is 0.7 %, and "
        "two counts of a 12 bit encoder are 0.9 % of the elbow near zero",
    ),
    JudgedLimit(
        "zero return",
        2.0,
        "|unloaded mean after a load less the one before it|",
        "hysteresis and creep that the model does not describe stay behind after unloading",
    ),
    JudgedLimit(
        "accuracy",
        0.5,
        "|loaded mean, less the offset of the unloaded ones beside it, less the known load|, which "
        "must stay below the limit less the known load's uncertainty",
        "a gain error is felt as the same share of every torque, so the load counts; the published "
        "error of other elastomers of the kind is 2.9 to 3.7 % RMS; the fixed part is one count "
        "of 12 bits",
        3.0,
    ),
    JudgedLimit(
        "repeatability",
        0.5,
        "largest less smallest error of one direction",
        "the published change of the error over a day's sessions is 1.4 to 2.7 %; the same load "
        "minutes apart must do as well",
        2.0,
    ),
    JudgedLimit(
        "symmetry",
        0.5,
        "|mean error of one direction less that of the other|",
        "specimens were discarded for asymmetry; a shift of the zero within the rubber shows here",
        3.0,
    ),
    JudgedLimit(
        "drift",
        1.0,
        "|change over a recorded phase, along its straight line|",
        "a still load that seems to change is creep, temperature or a slipping mount; one count "
        "of 12 bits that changes half way makes 1.5 times its torque",
        1.5,
    ),
    JudgedLimit(
        "noise",
        2.0,
        "standard deviation about that straight line",
        "a deflection that toggles between two counts of 12 bits makes 1.6 % where the elbow is "
        "steepest, rate terms included",
    ),
)
ZERO_LIMIT = LIMITS[0]


@dataclass(frozen=True)
class ProcedureStep:
    label: str
    kind: Kind
    text: str


def static_torque_Nm(device: DeviceData, theta_rad: float) -> float:
    """Torque at a deflection that was reached slowly from rest, rate terms relaxed (3.2, 3.9)."""
    e = device.elastomer
    zone = e.dead_zone_rad.value if e.dead_zone_rad else 0.0
    delta = max(theta_rad - zone, 0.0)
    torque = spring_Nm(device.file, theta_rad)
    for i in range(1, int(e.stops.value) + 1):
        r = e.omega_rad.value * i
        torque += e.alpha_Nm_rad.value * math.exp(-e.beta_1_rad.value * r) * min(delta, r)
    return torque


def stiffening(device: DeviceData, load_Nm: float) -> float:
    """Torque by an encoder's offset under a load, over the one unloaded."""
    most_rad, h = device.file.domain.theta_max_rad.value, 1e-3
    at_rad = brentq(lambda x: static_torque_Nm(device, x) - load_Nm, 0.0, most_rad)
    first, low, high = (static_torque_Nm(device, x) for x in (h, at_rad - h, at_rad + h))
    return 0.5 * float((high - low) / first) if first else 1.0  # play


def largest_torque_Nm(device: DeviceData) -> float:
    return min(
        device.tau_full_scale_Nm, static_torque_Nm(device, device.file.domain.theta_max_rad.value)
    )


def load_range_Nm(device: DeviceData) -> tuple[float, float]:
    return SMALLEST_LOAD_PCT / 100 * device.tau_full_scale_Nm, largest_torque_Nm(device)


def judged_from_Nm(device: DeviceData) -> float:
    """Smallest load that a sensor can pass with."""
    return JUDGED_LOAD_PCT / 100 * device.tau_full_scale_Nm


def procedure(repeats: int = REPEATS) -> tuple[ProcedureStep, ...]:
    require("repeats", repeats, 2, 20, "loads", "Repeatability needs at least two.")
    unload = "Take the mass off; leave the arm as it is, and do not touch it."
    steps = [ProcedureStep("zero_1", "zero", unload)]
    for kind, how in (
        ("plus", "so that it turns the joint in the positive direction"),
        ("minus", "so that it turns the joint in the negative direction"),
    ):
        for n in range(1, repeats + 1):
            text = f"Hang the mass on the arm {how}, without a jerk; let go of it."
            steps.append(ProcedureStep(f"{kind}_{n}", kind, text))  # type: ignore[arg-type]
            steps.append(ProcedureStep(f"zero_{1 + len(steps) // 2}", "zero", unload))
    return tuple(steps)
