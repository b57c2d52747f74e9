"""Numbers of the limits in a device file, and relations between them."""

from __future__ import annotations

import math
from functools import reduce

from esea_gen.devices.fields import Actuator, Joint, Safety
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.ports import f32_inside, threshold

SLOTS = 10  # parts of the energy window
STALE_PERIODS = 5  # control periods without a new stamp that count as a fault
JOINT_RAD = math.pi  # how far a joint without [joint] may turn from its neutral position
COMMAND_RANGE = 4.0  # times the motor's largest torque: beyond is no command but a fault


def safety_sections(device: DeviceData) -> tuple[Safety, Actuator, Joint, int]:
    """The sections that the limits need, and the control task's period in sensing periods."""
    file = device.file
    rate = file.timing.control_rate_Hz
    for name in ("safety", "actuator", "joint", "timing.control_rate_Hz"):
        if reduce(getattr, name.split("."), file) is None:
            raise UserError(
                f"{device.origin}: {name} is missing: the limits before the motor need it.",
                'Add it, or write extends = "elbow_drive" and give what differs.',
            )
    assert file.safety is not None
    assert file.actuator is not None
    assert file.joint is not None
    assert rate is not None
    every = round(file.timing.sense_rate_Hz.value / rate.value)
    return file.safety, file.actuator, file.joint, every


def check_safety(device: DeviceData) -> None:
    """A limit beyond its port's range would show as an invalid input: the wrong reason."""
    omega = device.file.limits.omega_rad_s.value
    value = {
        "joint.theta_min_rad": -JOINT_RAD,
        "joint.theta_max_rad": JOINT_RAD,
        "joint.omega_max_rad_s": omega,
        "actuator.omega_max_rad_s": 2 * omega,
        **{k: q.value for k, q in device.quantities()},
    }
    margin = value["safety.rom_margin_rad"]
    for low, less, high, more in (
        ("safety.rom_min_rad", 0.0, "safety.rom_max_rad", 0.0),
        ("joint.theta_min_rad", 0.0, "safety.rom_min_rad", -margin),
        ("safety.rom_max_rad", margin, "joint.theta_max_rad", 0.0),
        ("safety.omega_max_rad_s", 0.0, "joint.omega_max_rad_s", 0.0),
        ("safety.omega_max_rad_s", 0.0, "actuator.omega_max_rad_s", 0.0),
    ):
        if value[low] + less >= value[high] + more:
            room = f" with safety.rom_margin_rad = {margin:g}" if less or more else ""
            raise UserError(
                f"{device.origin}: {low} = {value[low]:g} is not below {high} = "
                f"{value[high]:g}{room}: the limit could never act.",
                f"Lower {low} or raise {high}{', or narrow the margin' if room else ''}.",
            )


def command_range(device: DeviceData) -> float:
    safety, actuator, _, _ = safety_sections(device)
    most = max(safety.u_max_Nm.value, actuator.u_max_Nm.value)
    return threshold(COMMAND_RANGE * most)


class LimitNumbers:
    """As the ports hold them: float32 numbers, so that all formats decide alike."""

    def __init__(self, device: DeviceData) -> None:
        self.safety, actuator, joint, every = safety_sections(device)
        check_safety(device)
        self.h = device.period_s
        self.u_max, self.tau_max, self.theta_max, self.omega_max, self.energy_max, self.margin = (
            threshold(x.value)
            for x in (
                self.safety.u_max_Nm,
                self.safety.tau_max_Nm,
                self.safety.theta_max_rad,
                self.safety.omega_max_rad_s,
                self.safety.energy_J,
                self.safety.rom_margin_rad,
            )
        )
        self.u_rate = threshold(self.safety.u_rate_Nm_s.value)
        self.step_max = threshold(self.u_rate * self.h)
        self.rom_min, self.rom_max = f32_inside(
            self.safety.rom_min_rad.value, self.safety.rom_max_rad.value
        )
        self.trip_low, self.trip_high = f32_inside(
            self.rom_min - self.margin, self.rom_max + self.margin
        )
        self.theta_lim = threshold(device.file.limits.theta_rad.value)
        self.tau_lim = threshold(device.file.limits.tau_Nm.value)
        self.load_low, self.load_high = joint.theta_min_rad.value, joint.theta_max_rad.value
        self.omega_load_lim = joint.omega_max_rad_s.value
        self.omega_motor_lim = actuator.omega_max_rad_s.value
        self.command_lim = command_range(device)
        self.stale_ticks = float(STALE_PERIODS * every)
        # The bound of what a drive gives reckons with the compiled rate: it holds down to a tenth.
        self.least_rate_share = 0.01 if device.file.passivity is None else 0.1
        self.slot_ticks = max(
            1, math.ceil(self.safety.energy_window_s.value / (SLOTS * self.h) - 1e-9)
        )
        self.slot_lim = threshold(
            1.01 * self.slot_ticks * self.h * self.tau_lim * self.omega_load_lim
        )
