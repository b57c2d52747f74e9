"""Reference governor of the sliding mode: a set-point that the motor can follow.

The set deflection turns sharply where it leaves the coupling's soft part.  So the set torque is
looked up ahead, and the set deflection smoothed over the same time.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from esea_gen.control.setpoint import ACCELERATION_ROOM
from esea_gen.control.trend import faded, motion_limits
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Port, Tunable, around, clip, status_port, threshold
from esea_gen.model.mode import Mode
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

# Delay of the smoothing: with less the motor's limit is still met at 3 Nm and 1 Hz, with more the
# corners are rounded off (trials with 30, 50, 70, 90 ms: 0.48, 0.28, 0.19, 0.17 Nm there).
SMOOTH_S = 0.07
# As far is looked ahead.
LEAD_S = 0.07
# From not governed to governed: shorter than the offset of a change of mode takes to fade.
FADE_S = 0.1
# A little less than 1: rounding can then not put a mixture of two angles beyond their range.
LEAST_SHARE, MOST_SHARE = 0.01, 0.999


LEAD_EQUATION = """
    [lead 1] | tau_led | tau_set + g * Integral((r + a * x) * exp(-x / T_f), (x, 0, T_l)) | \
        g: share that is governed
"""
SMOOTH_EQUATION = "[smooth] | y | x / (1 + s * T_s / 3)**3 | three lags"


# In impedance mode the set torque follows the motion, and what is led there would cost passivity.
# Nor is noise believed, nor the tenths of a second after a step: with the smoothed one, the law
# would chase a set-point while the cable takes up its slack (0.5 Nm overshot by 92, not 6 %).
def torque_lead(device: DeviceData) -> Block:
    """The set torque a little ahead, for the inverse; in torque mode alone."""
    drive = drive_of(device)
    h, tau_lim, full = device.period_s, drive.tau_Nm, threshold(device.tau_full_scale_Nm)
    rate_lim, curve_lim = motion_limits(device)
    keep = math.exp(-h / FADE_S)
    by_rate, by_curve = faded(LEAD_S)
    acts = "1 looks ahead and smooths; 0 takes the set torque as it comes"

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        torque = u.mode == Mode.TORQUE
        acts = ca.logic_and(guard.inputs_ok, torque)
        asked = label("asked", ca.if_else(acts, c.share * u.trust, 0), "share that is asked for")
        # The rounding of a fixed point number may add a bit to 1, which would be a corrupt state.
        slow = label("slow", ca.fmin((1 - keep) * asked + keep * s.slow, 1), "fading to it")
        governed = label("governed", ca.fmin(slow, u.settled), "not after a step")
        motion = by_rate * u.tau_rate_Nm_s + by_curve * u.tau_curve_Nm_s2
        led = label("led_Nm", u.tau_set_Nm + governed * motion, "set torque ahead")
        given = {
            "tau_led_Nm": clip(led, -full, full),
            "governed": governed,
            "status": guard.status(),
        }
        return {"slow": slow, "tau_set_Nm": u.tau_set_Nm}, given

    return Block.define(
        "torque_lead",
        "Set torque ahead, for a set-point that the motor can follow",
        period_s=h,
        tunables=(Tunable("share", 1.0, 0.0, 1.0, acts, "docs/control.md"),),
        coefficients=(Port("share", 0.0, 1.0, "share of its action"),),
        prepare=vars,
        state=(
            Port("slow", 0.0, 1.0, "share that is governed when nothing steps"),
            around("tau_set_Nm", tau_lim, "set torque of the last step"),
        ),
        inputs=(
            around("tau_set_Nm", tau_lim, "set torque", on_invalid="tau_set_Nm"),
            around("tau_rate_Nm_s", rate_lim, "rate of the set torque"),
            around("tau_curve_Nm_s2", curve_lim, "second derivative of the set torque"),
            Port("trust", 0.0, 1.0, "trust in rate and acceleration, 0 to 1"),
            Port("settled", 0.0, 1.0, "0 after a step, rising to 1"),
            Port.choice("mode", Mode, "active mode"),
        ),
        outputs=(
            around("tau_led_Nm", full, "set torque ahead, for the inverse"),
            Port("governed", 0.0, 1.0, "share that is governed, for the smoothing"),
            _status("not led"),
        ),
        equations=equations(LEAD_EQUATION),
        step=step,
    )


def smoothed_setpoint(device: DeviceData) -> Block:
    """Set deflection, rate and acceleration behind three equal lags, as far as it is governed."""
    drive = drive_of(device)
    h, delta_lim, rate_lim = device.period_s, drive.delta_rad, drive.rate_rad_s
    acc_lim = threshold(ACCELERATION_ROOM * drive.d4_rad_s2)
    lag = SMOOTH_S / 3
    gain = 1 - math.exp(-h / lag)

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        sound = ca.logic_and(guard.inputs_ok, s.primed)
        primed = ca.logic_or(s.primed, guard.inputs_ok)
        # Not governed, the lags stand where the set-point is: they start from there.
        lags_act = label("lags_act", ca.logic_and(sound, u.governed > LEAST_SHARE), "smoothing")
        last = u.theta_set_rad
        lags = []
        for i, kept in enumerate((s.first_rad, s.second_rad, s.third_rad)):
            moved = (1 - gain) * kept + gain * last
            last = label(f"lag_{i}_rad", ca.if_else(lags_act, moved, u.theta_set_rad), "lagged")
            lags.append(last)
        first, second, third = lags
        rate = (1 / lag) * (second - third)
        acc = (1 / lag**2) * (first - 2 * second + third)
        share = label("share", ca.if_else(sound, MOST_SHARE * u.governed, 0), "governed")

        def mixed(plain: Any, smooth: Any) -> Any:
            return plain + share * (smooth - plain)

        outputs = {
            "delta_set_rad": mixed(u.delta_set_rad, third),
            "delta_rate_rad_s": clip(mixed(u.delta_rate_rad_s, rate), -rate_lim, rate_lim),
            "delta_acc_rad_s2": clip(mixed(u.delta_acc_rad_s2, acc), -acc_lim, acc_lim),
            "theta_smooth_rad": mixed(u.theta_set_rad, third),
            "status": guard.status(),
        }
        names = ("first_rad", "second_rad", "third_rad")
        return {"primed": primed, **dict(zip(names, lags, strict=True))}, outputs

    ports = (
        around("delta_set_rad", delta_lim, "deflection set-point"),
        around("delta_rate_rad_s", rate_lim, "rate of the set-point"),
        around("delta_acc_rad_s2", acc_lim, "acceleration of the set-point"),
    )
    raw = around("theta_set_rad", delta_lim, "set-point from the inverse", on_invalid="third_rad")
    return Block.define(
        "smoothed_setpoint",
        "Set deflection that the motor can follow",
        period_s=h,
        state=(
            Port.flag("primed", "1 once a valid sample has been seen"),
            *(around(f"{n}_rad", delta_lim, f"{n} lag") for n in ("first", "second", "third")),
        ),
        inputs=(raw, *ports, Port("governed", 0.0, 1.0, "share that is governed")),
        outputs=(
            *ports,
            around("theta_smooth_rad", delta_lim, "inverse's set-point, smoothed likewise"),
            _status("not smoothed"),
        ),
        equations=equations(SMOOTH_EQUATION),
        step=step,
    )


def governed_wires(device: DeviceData) -> dict[str, str]:
    """The set torque ahead, the inverse, and the set-point smoothed over the same time."""
    seen = ("tau_rate_Nm_s", "tau_curve_Nm_s2", "trust", "settled")
    found = ("delta_set_rad", "delta_rate_rad_s", "delta_acc_rad_s2")
    # Damping that is added follows the limb, and is not to come late.
    late = {"lead.mode": "passivity.mode_ahead"} if device.file.passivity is not None else {}
    return {
        "set_trend.tau_wanted_Nm": "reference.tau_set_Nm",
        **{f"lead.{n}": f"set_trend.{n}" for n in seen},
        "inverse.tau_Nm": "lead.tau_led_Nm",
        **{f"smooth.{n}": f"setpoint.{n}" for n in found},
        "smooth.governed": "lead.governed",
        **late,
    }


def _status(then: str) -> Port:
    invalid = f"an input was NaN or outside its range; {then}"
    return status_port("status", invalid, "the state was corrupt; restarted")
