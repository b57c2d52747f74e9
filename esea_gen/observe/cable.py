"""The cable between gear and motor side: how far it is wound up, and where its backlash is now."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.devices.fields import Cable, Redundancy
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, around, clip, status_port, threshold
from esea_gen.model.mode import Mode
from esea_gen.model.sections import section_of
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

USED = ("backlash_rad", "backlash_most_rad", "loss", "contact_Nm", "rate_1_s")


# The give is learnt at this share of the rate of the ends, for a torque that changes by 1 Nm; from
# what changes faster than this share of that rate.
LEARN_1_Nm2, MEAN_SHARE = 0.2, 0.25
CLOSED_IN = int(Mode.IMPEDANCE)  # the mode in which the gap counts as closed
GIVES = "one over the cable's stiffness"


EQUATIONS = """
    [cable 1] | z | theta_g - theta_m - tau_k / k_c | where in the gap the cable lies
    [cable 2] | tau_k | tau_e + l_c * Abs(tau_e) * Max(-1, Min(1, omega_g / omega_w)) | \
        what the cable carries: the coupling's torque, and what rubs on the way
    [cable 3] | z_e | Piecewise((z_high, tau_e > tau_0), (z_low, tau_e < -tau_0), \
        (Max(z_low, Min(z_high, z)), true)) | at an end while torque says so, else between both
    [cable 4] | dz_end | (1 - exp(-L * h)) * (z - z_e) | \
        the end at which it lies is learnt; b = z_high - z_low
    [cable 5] | w | z_e - (z_high + z_low) / 2 + tau_k / k_c | winding
    [cable 7] | delta | theta + Max(-q, Min(q, z - z_e)) | deflection; q: a count of the encoder
"""


def cable_of(device: DeviceData) -> tuple[Cable, Redundancy]:
    why = "a law that knows the cable needs it", 'Add it, or write drive = "rigid" in [predictive].'
    return section_of(device, "cable", *why), section_of(device, "redundancy", *why)


def wound_range_rad(device: DeviceData) -> float:
    """Largest winding of the cable, from the middle of its gap."""
    own, redundancy = cable_of(device)
    carried_Nm = drive_of(device).tau_Nm * (1 + own.loss.value)
    by_torque = carried_Nm / redundancy.cable_least_Nm_rad.value
    return threshold(1.01 * (0.5 * own.backlash_most_rad.value + by_torque))


def give_most_rad_Nm(device: DeviceData) -> float:
    """One over the stiffness of the softest cable."""
    _, redundancy = cable_of(device)
    return 1 / redundancy.cable_least_Nm_rad.value


# The motor-side part is light, so the cable carries the elastomer's torque and tells by its winding
# less tau/k where in the gap it is.  Above contact_Nm it lies at an end, which is learnt by a lag
# of rate_1_s; below it is as measured, between both.  An end not shown yet moves along with the
# other one.  Unknown zeros of the encoders are in the ends, and fall out of what is given.
def cable_observer(device: DeviceData) -> Block:
    """Winding of the cable, and its backlash, from the encoders at both of its ends."""
    return Block.of(_Cable(device))


class _Cable:
    def __init__(self, device: DeviceData) -> None:
        self.own, redundancy = cable_of(device)
        drive = self.drive = drive_of(device)
        self.device, self.width = device, drive.actuator.coulomb_width_rad_s.value
        self.h = device.period_s
        self.count_rad = 2 * math.pi / 2**device.file.encoder.resolution_bits.value
        self.give = 1 / redundancy.cable_Nm_rad.value
        self.usual, self.most = self.own.backlash_rad.value, self.own.backlash_most_rad.value
        self.contact = threshold(self.own.contact_Nm.value)
        self.share = 1 - math.exp(-self.h * self.own.rate_1_s.value)
        span = drive.theta_high_rad - drive.theta_low_rad
        side = max(abs(drive.theta_low_rad), abs(drive.theta_high_rad))
        self.gear_lim = span * 1.01
        self.turned_lim = 1.01 * (self.gear_lim + side)
        self.softest = threshold(give_most_rad_Nm(device))
        pull_Nm = threshold(1.01 * drive.tau_Nm * (1 + self.own.loss.value))
        self.seen_lim = 1.01 * (self.turned_lim + pull_Nm * self.softest)
        self.mean_share = 1 - math.exp(-self.h * MEAN_SHARE * self.own.rate_1_s.value)
        self.end_lim = 1.01 * (self.seen_lim + self.most)
        self.wound_lim = wound_range_rad(device)
        self.name = "cable"
        self.title = "Cable between gear and motor side: winding and backlash"
        self.equations = equations(EQUATIONS)
        own = [c for c in self.device.constants("cable") if c.name in USED]
        stiff = [c for c in self.device.constants("redundancy") if c.name == "cable_Nm_rad"]
        self.constants = (*own, *stiff)
        self.state = (
            Port.flag("primed", "1 when the last sample was comparable"),
            around("high_rad", self.end_lim, "end of the gap at which the gear pulls upwards"),
            around("low_rad", self.end_lim, "other end of the gap"),
            Port.flag("high_shown", "1 once a torque has shown the upper end"),
            Port.flag("low_shown", "1 once a torque has shown the lower end"),
            Port.flag("taut", "1 while the cable is at an end"),
            around("mean_rad", self.turned_lim, "mean angle since the cable became taut"),
            around("mean_Nm", pull_Nm, "mean torque since the cable became taut"),
            Port("give_rad_Nm", 0.0, self.softest, GIVES, init=self.give),
        )
        low, high = self.drive.theta_low_rad, self.drive.theta_high_rad
        self.inputs = (
            around("theta_gear_rad", self.gear_lim, "joint angle by the drive's encoder"),
            Port.flag("gear_usable", "1 when the motor's encoder is usable"),
            Port("theta_motor_rad", low, high, "joint angle, motor side of the coupling"),
            Port.flag("motor_usable", "1 when the motor-side encoder is usable"),
            around("tau_Nm", self.drive.tau_Nm, "interaction torque, carried by the cable"),
            around("omega_gear_rad_s", self.drive.omega_rad_s, "gear's rate, at the joint"),
            Port.choice("mode", Mode, "active mode"),
            around("theta_rad", self.drive.delta_rad, "deflection by the joint's encoders"),
        )
        self.outputs = (
            around("delta_rad", self.drive.delta_rad, "deflection, motor side by the gear"),
            around("wound_rad", self.wound_lim, "gear minus motor-side angle, from mid-gap"),
            Port("give_rad_Nm", 0.0, self.softest, GIVES),
            Port("gap_rad", 0.0, threshold(self.most), "whole backlash"),
            status_port(
                "status of this sample",
                "an input was NaN or outside its range",
                "the state was corrupt; the gap is learned again",
                Flag("NOT_COMPARED", "an encoder is unusable; mid-gap is assumed"),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        both = ca.logic_and(u.motor_usable, u.gear_usable)
        ok = label("ok", ca.logic_and(guard.inputs_ok, both), "both angles can be compared")
        lost = self.own.loss.value * ca.fabs(u.tau_Nm)
        pull = u.tau_Nm + lost * clip(u.omega_gear_rad_s / self.width, -1.0, 1.0)
        pull = label("pull_Nm", pull, "[cable 2] what the cable carries")
        carried = label("carried_rad", pull * s.give_rad_Nm, "[cable 1] winding by it")
        seen = u.theta_gear_rad - u.theta_motor_rad - carried
        seen = label("seen_rad", seen, "[cable 1] where in the gap")
        # Without a sample before, the ends lie about this one.
        high = ca.if_else(s.primed, s.high_rad, seen + 0.5 * self.usual)
        low = ca.if_else(s.primed, s.low_rad, seen - 0.5 * self.usual)
        pulls = label("pulls", u.tau_Nm > self.contact, "surely at the upper end")
        pushes = label("pushes", u.tau_Nm < -self.contact, "surely at the lower end")
        lies = ca.if_else(pulls, high, ca.if_else(pushes, low, clip(seen, low, high)))
        lies = label("lies_rad", lies, "[cable 3] where it must lie")
        off = label("learnt_rad", self.share * (seen - lies), "[cable 4]")
        at_high = ca.logic_or(pulls, ca.logic_and(ca.logic_not(pushes), seen > high))
        at_low = ca.logic_or(pushes, ca.logic_and(ca.logic_not(pulls), seen < low))
        up, down = s.high_shown, s.low_shown
        takes_high = ca.logic_or(at_high, ca.logic_and(at_low, ca.logic_not(up)))
        takes_low = ca.logic_or(at_low, ca.logic_and(at_high, ca.logic_not(down)))
        new_high = high + ca.if_else(takes_high, off, 0.0)
        new_low = low + ca.if_else(takes_low, off, 0.0)
        # The gap is no less than none and no more than the largest: the end that moves wins.
        kept_low = ca.if_else(at_low, new_low, clip(new_low, new_high - self.most, new_high))
        kept_high = ca.if_else(at_low, clip(new_high, new_low, new_low + self.most), new_high)
        middle = 0.5 * (kept_high + kept_low)
        between = ca.if_else(pushes, kept_low, clip(seen, kept_low, kept_high))
        wound = ca.if_else(pulls, kept_high, between)
        give = self.learnt_give(s, u, pull, ca.logic_and(ok, ca.logic_or(pulls, pushes)), label)
        # The gear's encoder is far finer than the motor side's, whose reading is off by a count at
        # most.
        finer = ca.if_else(ok, clip(seen - wound, -self.count_rad, self.count_rad), 0.0)
        delta = clip(u.theta_rad + finer, -self.drive.delta_rad, self.drive.delta_rad)
        # The person's torque as observed trembles by 0.3 Nm with the joint encoders' steps, and
        # what is predicted with it meets the ends of the gap: in the mean the command then holds
        # the gear inside, and a limp hand on a rendered spring drifts without any torque.
        closed = label("closed", u.mode == CLOSED_IN, "the gap counts as closed")
        wound = ca.if_else(closed, 0.0, wound - middle) + carried
        # To rounding.
        gap = ca.if_else(closed, 0.0, ca.fmin(kept_high - kept_low, self.most))
        usual = ca.if_else(closed, 0.0, self.usual)
        next_state = {
            "primed": ok,
            "high_rad": ca.if_else(ok, kept_high, s.high_rad),
            "low_rad": ca.if_else(ok, kept_low, s.low_rad),
            "high_shown": ca.logic_and(ok, ca.logic_or(ca.logic_and(s.primed, up), pulls)),
            "low_shown": ca.logic_and(ok, ca.logic_or(ca.logic_and(s.primed, down), pushes)),
            **give,
        }
        outputs = {
            "delta_rad": label("delta_rad", delta, "[cable 7]"),
            "wound_rad": label("wound_rad", ca.if_else(ok, wound, carried), "[cable 3]"),
            "give_rad_Nm": give["give_rad_Nm"],
            "gap_rad": label("gap_rad", ca.if_else(ok, gap, usual), "[cable 4]"),
            "status": guard.status(ca.logic_not(ok)),
        }
        return next_state, outputs

    def learnt_give(
        self, s: SimpleNamespace, u: SimpleNamespace, pull: Any, taut: Any, label: Labels
    ) -> dict[str, Any]:
        """Learnt compliance of the cable: from both changes while it is taut (LMS)."""
        goes_on = ca.logic_and(taut, s.taut)
        turned = u.theta_gear_rad - u.theta_motor_rad
        by_angle = ca.if_else(goes_on, turned - s.mean_rad, 0.0)
        by_torque = ca.if_else(goes_on, pull - s.mean_Nm, 0.0)
        by_torque = label("change_Nm", by_torque, "[cable 6] since taut")
        missed = label("missed_rad", by_angle - s.give_rad_Nm * by_torque, "[cable 6]")
        by = self.drive.torque_scale
        step = clip(missed, -self.most, self.most) * clip(by_torque, -by, by)
        give = s.give_rad_Nm + LEARN_1_Nm2 / by**2 * self.share * step
        share = self.mean_share
        return {
            "taut": taut,
            "mean_rad": ca.if_else(goes_on, s.mean_rad + share * (turned - s.mean_rad), turned),
            "mean_Nm": ca.if_else(goes_on, s.mean_Nm + share * (pull - s.mean_Nm), pull),
            "give_rad_Nm": label("give_rad_Nm", clip(give, 0.0, self.softest), "[cable 6]"),
        }
