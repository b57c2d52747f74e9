"""The deflection between the encoders' counts, for the torque sensor of a device that measures."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Port, around, clip, status_port, threshold
from esea_gen.model.symbolic import equations

# How fast what the rate predicts is corrected by the counts.  From 2 to 15 Hz the torque's error
# changes by a fifth: lower is better for sweeps, higher for reaches.
CORNER_HZ = 8.0


# Quantised counts cost the torque two to three times the error.  Two encoders are off by half a
# count each at most: a deflection farther than a count from theirs would be wrong.
def smoothed_deflection(device: DeviceData) -> Block:
    """Deflection moved on by its rate, corrected by the counts, within one count of them."""
    h, limit = device.period_s, threshold(device.file.limits.theta_rad.value)
    fastest = threshold(device.file.limits.omega_rad_s.value)
    count = threshold(2 * math.pi / 2**device.file.encoder.resolution_bits.value)
    gain = 1 - math.exp(-2 * math.pi * h * CORNER_HZ)
    text = "deflection within one count of the measured one; outside the sensor's range while "
    text += "that one is invalid"

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        ahead = s.theta_last_rad + h * u.omega_rad_s
        ahead = label("ahead_rad", ca.if_else(s.primed, ahead, u.theta_rad), "[ahead]")
        # Written so that intervals see it forget: its errors have a bound for all time.
        smooth = (1 - gain) * ahead + gain * u.theta_rad
        near = label("near_rad", clip(smooth, u.theta_rad - count, u.theta_rad + count), "[near]")
        ok = guard.inputs_ok
        next_state = {
            "primed": ca.logic_or(s.primed, ok),
            "theta_last_rad": ca.if_else(ok, near, s.theta_last_rad),
        }
        outputs = {
            "theta_smooth_rad": ca.if_else(ok, clip(near, -limit, limit), 2 * limit),
            "status": guard.status(),
        }
        return next_state, outputs

    return Block.define(
        "smoothing",
        "Deflection between the encoders' counts",
        period_s=h,
        constants=device.constants("timing"),
        state=(
            Port.flag("primed", "1 once a valid sample has been seen"),
            around("theta_last_rad", limit + 2 * count, "smoothed deflection of the last step"),
        ),
        inputs=(
            around("theta_rad", limit, "deflection: motor-side minus load-side angle"),
            around("omega_rad_s", fastest, "deflection rate over the step that ends here"),
        ),
        outputs=(
            around("theta_smooth_rad", 2 * limit, text, equation="[near]"),
            status_port(
                "status of this sample",
                "deflection or rate was NaN or outside its range; the last one is held",
                "the state was corrupt; smoothing was restarted",
            ),
        ),
        equations=equations(EQUATIONS),
        step=step,
    )


EQUATIONS = """
    [ahead] | theta_a | theta{s,k-1} + h * omega_m | moved on by the rate
    [near] | theta_s | \
        Max(theta_k - q_c, Min(theta_a + kappa * (theta_k - theta_a), theta_k + q_c)) | \
        corrected, within a count of the encoders'
"""
