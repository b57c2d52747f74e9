"""Consistency checks of redundant encoders and of the motor torque.

The motor's own encoder, through the cable, is compared with the motor-side one; the torque of the
coupling with that of the motor, which detects a wrong load-side encoder.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, around, status_port
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of


# A zero between the angles is set in the first run that finds both encoders usable: angles that
# part stay parted until one encoder has failed and come back, or init.  Torques may agree again.
def redundancy(device: DeviceData) -> Block:
    """Whether encoders and motor torque agree."""
    return Block.of(_Redundancy(device))


class _Redundancy:
    def __init__(self, device: DeviceData) -> None:
        found = section_of(device, "redundancy")
        self.device, self.drive, self.own = device, drive_of(device), found
        self.h = self.drive.control_period_s
        self.J = self.drive.actuator.J_kgm2.value
        self.stiffness = found.cable_Nm_rad.value
        self.softer = 1 / found.cable_least_Nm_rad.value - 1 / self.stiffness
        span = self.drive.theta_high_rad - self.drive.theta_low_rad
        self.gear_lim = span * 1.01
        self.side_lim = max(abs(self.drive.theta_high_rad), abs(self.drive.theta_low_rad))
        self.angle_lim = (self.gear_lim + self.side_lim + self.drive.tau_Nm / self.stiffness) * 1.01
        self.apart_lim = 2 * self.angle_lim
        self.torque_lim = self.J * self.drive.d4_rad_s2 * 1.001
        self.room_lim = 1.001 * (
            found.torque_Nm.value
            + found.torque_share.value * self.drive.tau_Nm
            + found.inertia_share.value * self.J * 4 * self.drive.d4_rad_s2
        )
        self.name = "redundancy"
        self.title = "Whether encoders and motor torque contradict one another"
        self.constants = (*device.constants("redundancy"), *self.inertia())
        self.state = (
            around("zero_rad", self.angle_lim, "drive angle minus motor-side angle, at rest"),
            Port.flag("zeroed", "1 once this offset is set"),
        )
        self.equations = equations(EQUATIONS)
        low, high = self.drive.theta_low_rad, self.drive.theta_high_rad
        self.inputs = (
            Port("theta_motor_rad", low, high, "joint angle, motor side of the coupling"),
            Port.flag("motor_usable", "1 when the motor-side encoder is usable"),
            around("theta_gear_rad", self.gear_lim, "joint angle by the drive's encoder"),
            Port.flag("gear_usable", "1 when the motor's encoder is usable"),
            around("d_gear_rad_s2", self.drive.d4_rad_s2, "acceleration not explained by (5.2)"),
            around("tau_Nm", self.drive.tau_Nm, "interaction torque measured by the coupling"),
            Port("moves_rad_s2", 0.0, 4 * self.drive.d4_rad_s2, "recent acceleration of the drive"),
        )
        self.outputs = (
            Port.flag("agree", "1 when all comparable sensors agree"),
            around("apart_rad", self.apart_lim, "drive angle minus motor-side angle"),
            around("apart_Nm", self.torque_lim, "unexplained torque at the drive"),
            Port("room_Nm", 0.0, self.room_lim, "present limit of the unexplained torque"),
            status_port(
                "status of this sample",
                "an input was NaN or outside its range",
                "the state was corrupt and the zero is lost; the limits latch",
                Flag("NOT_COMPARED", "an encoder is unusable; no comparison"),
                Flag("ANGLES_PART", "the motor's encoder contradicts the motor-side encoder"),
                Flag(
                    "TORQUES_PART",
                    "the drive's motion contradicts the torques of motor and coupling",
                ),
            ),
        )

    def inertia(self) -> tuple[Any, ...]:
        return tuple(c for c in self.device.constants("actuator") if c.name == "J_kgm2")

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        both = ca.logic_and(u.motor_usable, u.gear_usable)
        # A repaired memory has no zero: the limits latch, and the person who rearms takes it anew.
        sound = ca.logic_and(guard.inputs_ok, guard.state_ok)
        ready = label("ready", ca.logic_and(sound, both), "both angles can be compared")
        zeroed = s.zeroed
        found = label(
            "found_rad",
            u.theta_gear_rad - u.theta_motor_rad - u.tau_Nm * (1 / self.stiffness),
            "[red 1] what the cable's torque leaves",
        )
        apart = label("apart_rad", ca.if_else(zeroed, found - s.zero_rad, 0.0), "[red 1]")
        room = label(
            "room_rad",
            self.own.apart_rad.value + self.softer * ca.fabs(u.tau_Nm),
            "[red 2] backlash, and a softer cable",
        )
        angles = label("angles_part", ca.logic_and(ready, ca.fabs(apart) > room))
        torque = label("apart_Nm", self.J * u.d_gear_rad_s2, "[red 3] what nothing explains")
        most = label(
            "room_Nm",
            self.own.torque_Nm.value
            + self.own.torque_share.value * ca.fabs(u.tau_Nm)
            + self.own.inertia_share.value * self.J * u.moves_rad_s2,
            "[red 4] friction, the gear's disturbance, the models of elastomer and drive",
        )
        torques = label("torques_part", ca.logic_and(ready, ca.fabs(torque) > most))
        agree = label("agree", ca.logic_and(ready, ca.logic_not(ca.logic_or(angles, torques))))
        keep = ca.logic_or(zeroed, ca.logic_not(ready))
        next_state = {"zero_rad": ca.if_else(keep, s.zero_rad, found), "zeroed": ready}
        outputs = {
            "agree": agree,
            "apart_rad": ca.if_else(ready, apart, 0.0),
            "apart_Nm": torque,
            "room_Nm": most,
            "status": guard.status(ca.logic_not(ready), angles, torques),
        }
        return next_state, outputs


EQUATIONS = """
    [red 1] | a_theta | theta_g - theta_m - tau_e / k_c - theta_0 | how far the two angles are apart
    [red 2] | Abs(a_theta) | theta_a + (1 / k_min - 1 / k_c) * Abs(tau_e) | room
    [red 3] | a_tau | J * d_g | torque left unexplained
    [red 4] | Abs(a_tau) | tau_a + c_tau * Abs(tau_e) + c_J * J * a_g | its room
"""
