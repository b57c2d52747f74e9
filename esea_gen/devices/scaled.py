"""Numbers of a ``scaled`` device, derived from those in its file.

A file with ``extends`` and ``scaled = true`` has the numbers of joint, rubber, gear, motor and
encoders that are available.  Any other number is the base's times powers of the ratios between the
two, so that the new drive is the base's in other units.  A number that the file gives is never
changed.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any

from esea_gen.devices.designed import OBSERVER_GAINS, observer_gains
from esea_gen.devices.fields import field_facts
from esea_gen.errors import UserError

DIGITS = 4
SPEED_ROOM = 0.8  # of the half turn that the motor's shaft may make in two sensing periods
TRAVEL_ROOM_RAD = 0.5  # beyond the range of motion, for the limits to act
MOST_LAMBDA_1_S = 19.8  # with a quick motor; a tenth below the best of the trials on the wrist
# What two drives are compared by: numbers whose product is taken.
RATIOS = {
    "stiffness": ("elastomer.k1_Nm_rad",),
    "drive torque": ("actuator.gear_ratio", "actuator.u_max_Nm"),
    "motor torque": ("actuator.u_max_Nm",),
    "gear ratio": ("actuator.gear_ratio",),
    "drive inertia": ("actuator.J_kgm2",),
    "trip torque": ("safety.tau_max_Nm",),
    "control rate": ("timing.control_rate_Hz",),
    "motor lag": ("actuator.tau_c_s",),
}
# By which of them numbers go, and with which power.
_POWERS: tuple[tuple[dict[str, float], str], ...] = (
    ({}, "sliding_mode.phi_rad_s predictive.interval_s"),
    # The cost of a torque error and of the motor's rate, as shares: then the loop's poles stay,
    # whatever torque, ratio and lag.
    ({"stiffness": -2}, "predictive.Q"),
    ({"stiffness": -2, "gear ratio": 2, "motor lag": 2}, "predictive.R"),
    (
        {"stiffness": 1},
        "elastomer.k3_Nm_rad3 elastomer.alpha_Nm_rad elastomer.maxwell.kv_Nm_rad "
        "elastomer.maxwell.A_Nms_rad elastomer.maxwell.eps1_Nms_rad domain.tau_full_scale_Nm "
        "limits.tau_Nm joint.tau_human_max_Nm sliding_mode.k1_unc_Nm_rad passivity.Kp_max_Nm_rad "
        "sliding_mode.k3_unc_Nm_rad3 passivity.energy_J cable.contact_Nm adaptation.offset_Nm "
        "redundancy.cable_Nm_rad redundancy.cable_least_Nm_rad",
    ),
    ({"drive torque": 1}, "actuator.fv_Nms_rad actuator.fc_Nm redundancy.torque_Nm"),
    ({"motor torque": 1}, "safety.u_rate_Nm_s"),
    ({"drive inertia": 1}, "sliding_mode.J_unc_kgm2"),
    ({"trip torque": 1}, "safety.energy_J"),
    (
        {"control rate": 1},
        "joint.motor_velocity_Hz joint.load_velocity_Hz sliding_mode.setpoint_filter_Hz",
    ),
    ({"motor lag": -1}, "sliding_mode.lambda_1_s"),
    (
        {"stiffness": 0.5, "drive inertia": 0.5},
        "passivity.damping_Nms_rad passivity.least_Nms_rad passivity.Kd_max_Nms_rad",
    ),
)
POWERS = {key: powers for powers, keys in _POWERS for key in keys.split()}


def scaled_to(
    merged: Mapping[str, Any], own: Mapping[str, Any], base: Mapping[str, Any], name: str
) -> dict[str, Any]:
    """A file's numbers merged over its base's, with those scaled that the file does not give."""
    made = copy.deepcopy(dict(merged))
    needed = [*(k for keys in RATIOS.values() for k in keys), "joint.Jh_kgm2"]
    if lost := [k for k in needed if _number(base, k) is None]:
        raise UserError(
            f"scaled = true: {name} has no {lost[0]} to scale from.",
            'Write extends = "elbow_drive", or take scaled out.',
        )

    def put(key: str, value: float, how: str) -> None:
        *path, last = key.split(".")
        if last not in _at(own, path) and math.isfinite(value):
            facts = field_facts(key)
            value = min(max(float(f"{value:.{DIGITS}g}"), facts["low"]), facts["high"])
            _at(made, path)[last] = {"value": value, "status": "assumed", "source": how}

    def of(key: str, document: Mapping[str, Any] = made) -> float:
        number = _number(document, key)
        return math.nan if number is None else number

    if not all(of(k) > 0 for k in (*needed, "timing.sense_rate_Hz")):
        return made  # wrong numbers, of which the checks tell
    n, ahead_s = of("actuator.gear_ratio"), 2 / of("timing.sense_rate_Hz")
    if (rotor := _number(own, "actuator.rotor_kgm2")) is not None:
        put("actuator.J_kgm2", rotor * n * n, "rotor_kgm2 times the gear ratio squared")
    quickest = min(of("actuator.omega_max_rad_s"), SPEED_ROOM * math.pi / (n * ahead_s))
    put("actuator.omega_max_rad_s", quickest, f"{name}'s, or what the motor's encoder can follow")
    slower = quickest / of("actuator.omega_max_rad_s", base)
    put("safety.omega_max_rad_s", slower * of("safety.omega_max_rad_s", base), f"{name}'s share")
    put("safety.u_max_Nm", of("actuator.u_max_Nm"), "the motor's limit")
    period_s = 1 / of("timing.control_rate_Hz")
    if of("timing.control_release_s", base) > period_s:
        put("timing.control_release_s", period_s, "the control period, below that of the base")
    for end, sign in (("min", -1), ("max", 1)):
        beyond = of(f"safety.rom_{end}_rad") + sign * TRAVEL_ROOM_RAD
        put(f"joint.theta_{end}_rad", beyond, "beyond the range of motion, room for the limits")
    for gain, value in zip(OBSERVER_GAINS, observer_gains(base, made), strict=True):
        put(f"disturbance.{gain}", value, f"the poles in time of {name}'s")
    for key, powers in POWERS.items():
        if (number := _number(base, key)) is None:
            continue
        factor = math.prod((of(k) / of(k, base)) ** p for r, p in powers.items() for k in RATIOS[r])
        most = MOST_LAMBDA_1_S if key == "sliding_mode.lambda_1_s" else math.inf
        by = " and ".join(f"{r}^{p:g}" if p != 1 else r for r, p in powers.items())
        put(key, min(factor * number, most), f"{name}'s, scaled by {by}" if by else f"{name}'s")
    return made


def _at(document: Mapping[str, Any], path: list[str]) -> Any:
    for part in path:
        document = document.get(part, {}) if isinstance(document, dict) else {}
    return document


def _number(document: Mapping[str, Any], key: str) -> float | None:
    value = _at(document, [*key.split("."), "value"])
    return float(value) if isinstance(value, int | float) else None
