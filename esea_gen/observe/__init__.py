"""Observers: rates, disturbance of the drive, torque of the person."""

from __future__ import annotations

from dataclasses import dataclass

from esea_gen.devices.fields import Actuator, Disturbance, Impedance, Joint
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.ports import f32_inside, threshold

ELBOW_NM = 4.47  # the full scale of the elbow


# Ranges are the largest plausible magnitudes; d4 is the acceleration that the whole motor torque
# gives, for more than that no command could make up.
@dataclass(frozen=True)
class Drive:
    actuator: Actuator
    joint: Joint
    disturbance: Disturbance
    impedance: Impedance
    control_period_s: float
    theta_low_rad: float
    theta_high_rad: float
    delta_rad: float
    omega_rad_s: float
    rate_rad_s: float
    tau_Nm: float
    tau_h_Nm: float
    u_Nm: float
    d4_rad_s2: float
    torque_scale: float  # full scale over the elbow's, on which absolute numbers were found


def torque_scale(device: DeviceData) -> float:
    """Full scale over the elbow's, by which absolute torques and stiffnesses go."""
    return device.tau_full_scale_Nm / ELBOW_NM


def has_drive(device: DeviceData) -> bool:
    """Whether a device has all that a motor and the limits before it need, whatever the law."""
    f = device.file
    needed = f.actuator, f.joint, f.disturbance, f.impedance, f.safety, f.timing.control_rate_Hz
    return None not in needed


def drive_of(device: DeviceData) -> Drive:
    f = device.file
    a, j, d, i = f.actuator, f.joint, f.disturbance, f.impedance
    rate = f.timing.control_rate_Hz
    if a is None or j is None or d is None or i is None or rate is None:
        raise UserError(
            f"{device.origin}: the device has no drive: torque control needs the sections "
            "actuator, joint, disturbance and impedance, and "
            "timing.control_rate_Hz.",
            'Write extends = "elbow_drive" and give what differs.',
        )
    # The coupling turns the motor side beyond the joint's own range; a deflection fits in as well,
    # so that its rate can go through the same filter.
    delta = f.limits.theta_rad.value
    low, high = f32_inside(
        min(j.theta_min_rad.value, 0.0) - delta, max(j.theta_max_rad.value, 0.0) + delta
    )
    return Drive(
        actuator=a,
        joint=j,
        disturbance=d,
        impedance=i,
        control_period_s=1.0 / rate.value,
        theta_low_rad=low,
        theta_high_rad=high,
        delta_rad=threshold(delta),
        omega_rad_s=threshold(max(a.omega_max_rad_s.value, j.omega_max_rad_s.value)),
        rate_rad_s=threshold(f.limits.omega_rad_s.value),
        tau_Nm=threshold(f.limits.tau_Nm.value),
        tau_h_Nm=threshold(j.tau_human_max_Nm.value),
        u_Nm=threshold(a.u_max_Nm.value),
        d4_rad_s2=threshold(a.gear_ratio.value * a.u_max_Nm.value / a.J_kgm2.value),
        torque_scale=torque_scale(device),
    )
