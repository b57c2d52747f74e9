"""The cable between gear and motor side in the model of predictive control: elastic, with a gap."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.control.predictive.horizon import Tape
from esea_gen.devices.file import DeviceData
from esea_gen.language.ports import Constant, Port, around, threshold
from esea_gen.observe import drive_of
from esea_gen.observe.cable import cable_of, give_most_rad_Nm, wound_range_rad

# Inside its gap the model's cable keeps this share of its stiffness: with none, the prediction
# would not see from inside that a command leads to any torque, and would give none for ever.
GAP_SHARE = 1 / 15


# The motor-side part is so light that it stands where the torques of cable and elastomer balance:
# one step of Newton's method a substep, with one stiffness for the elastomer.  A step is off by a
# third of itself at most, and the next one makes up.
class CableModel:
    """Numbers of the cable, and its part of a substep."""

    def __init__(self, device: DeviceData, soft_Nm_rad: float) -> None:
        own, redundancy = cable_of(device)
        stiff = redundancy.cable_Nm_rad.value
        inside = GAP_SHARE * stiff
        self.loss, self.tau_lim = own.loss.value, drive_of(device).tau_Nm
        self.gap_most = threshold(own.backlash_most_rad.value)
        self.wound_lim = wound_range_rad(device)
        self.by_angle = soft_Nm_rad / (inside + soft_Nm_rad)
        self.by_torque = 1 / (inside + soft_Nm_rad)
        self.soft, self.inside = soft_Nm_rad, inside
        self.give_most = threshold(give_most_rad_Nm(device))

    def pull(self, t: Tape, tau_e: Any) -> Any:
        # Far beyond the elastomer's range its stiffness makes steps of ``follow`` overshoot
        # without end.
        return t.keep(
            "pull",
            _held_to(tau_e, self.tau_lim),
            {tau_e: lambda _: ca.if_else(ca.fabs(tau_e) < self.tau_lim, 1, 0)},
        )

    # First as if inside the gap, where ``held`` stays wound; of what is then beyond one of its ends
    # the share ``back`` goes on into the elastomer.
    def follow(
        self, t: Tape, x: SimpleNamespace, turned: Any, carried_Nm: Any, p: SimpleNamespace
    ) -> Any:
        """Deflection after the gear has ``turned`` against the load; the cable carries a torque."""
        held = t.let("held", self.by_angle * (turned - x.delta) + self.by_torque * carried_Nm)
        half = 0.5 * p.gap_rad
        back = (1 - self.inside * p.give_rad_Nm) / (1 + self.soft * p.give_rad_Nm)
        over = t.keep(
            "over",
            held - _held_to(held, half),
            {held: lambda _: ca.if_else(ca.fabs(held) < half, 0, 1)},
        )
        return t.let("delta_next", turned - held + back * over)

    def coulomb(self, t: Tape, fc_Nm: float, pull: Any) -> Any:
        """Coulomb friction with the cable's loss: a share of its torque, against the motion."""
        return t.keep(
            "coulomb",
            fc_Nm + self.loss * ca.fabs(pull),
            {pull: lambda _: ca.if_else(pull < 0, -self.loss, self.loss)},
        )

    def constants(self, device: DeviceData) -> tuple[Constant, ...]:
        names = ("cable_Nm_rad", "loss", "backlash_most_rad")
        found = (*device.constants("redundancy"), *device.constants("cable"))
        return tuple(c for c in found if c.name in names)

    def ports(self) -> tuple[Port, ...]:
        return (
            around("wound_rad", self.wound_lim, "gear minus motor-side angle, from mid-gap"),
            Port("give_rad_Nm", 0.0, self.give_most, "one over the cable's stiffness"),
            Port("gap_rad", 0.0, self.gap_most, "whole backlash of the cable"),
        )


def _held_to(x: Any, most: Any) -> Any:
    # A clip of something finite, to rounding, in half the instructions.
    return 0.5 * (ca.fabs(x + most) - ca.fabs(x - most))
