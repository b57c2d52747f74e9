"""The person's torque ahead of time: a parabola through its past, as the thesis has it."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Array, Flag, Port, around, clip, status_port, threshold
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

# The thesis fits the past 11 values and evaluates at the next 11; their spacing is not given: at
# 1 ms the noise of a value would grow ten thousandfold until the eleventh next one.
VALUES, SPACING_S = 11, 0.05
MOST_KEPT = 501


def parabola_weights(values: int = VALUES, spacing_s: float = SPACING_S) -> Array:
    """(3, values): times the values c of y(t) = c0 + c1 t + c2 t^2, t from the newest value on."""
    t = -spacing_s * np.arange(values)
    return np.asarray(np.linalg.pinv(np.vander(t, 3, increasing=True)))


# At a control rate above 20 Hz the values between are kept too: 11 values 0.05 s apart, of which
# the newest is now.  Until there are so many, the first one stands for those that are missing.
def parabola(device: DeviceData) -> Block:
    """Torque of the person with slope and curvature, from a parabola through past values."""
    return Block.of(_Parabola(device))


class _Parabola:
    def __init__(self, device: DeviceData) -> None:
        drive = drive_of(device)
        self.h = drive.control_period_s
        self.every = round(SPACING_S / self.h)
        self.count = (VALUES - 1) * self.every + 1
        if self.every < 1 or abs(self.every * self.h - SPACING_S) > 1e-9 or self.count > MOST_KEPT:
            raise UserError(
                f"{device.origin}: timing.control_rate_Hz = {1 / self.h:g} Hz does not suit the "
                f"parabola through values {SPACING_S:g} s apart: it takes a multiple of "
                f"{1 / SPACING_S:g} Hz up to {(MOST_KEPT - 1) / (VALUES - 1) / SPACING_S:g} Hz.",
                'Change the rate, or write person = "extended_state" in [predictive].',
            )
        self.weights = parabola_weights()
        self.tau_lim = drive.tau_h_Nm
        # The farthest that any past within its range can give.
        reach = self.tau_lim * np.sum(np.abs(self.weights), axis=1)
        self.rate_lim, self.curve_lim = threshold(1.01 * reach[1]), threshold(2.02 * reach[2])
        self.name = "parabola"
        self.title = "Torque of the person ahead: parabola through its past"
        self.state = (
            Port.flag("primed", "1 once a valid value has been seen"),
            around("last_Nm", self.tau_lim, "value of the last step"),
            around("past_Nm", self.tau_lim, "values before it, newest first", self.count - 2),
        )
        self.equations = equations(
            "[parabola] | tau_h | c_0 + c_1 * t + c_2 * t**2 | least squares, 11 values"
        )
        text = "estimated torque of the person"
        self.inputs = (around("tau_h_Nm", self.tau_lim, text, 1, "(5.10)", on_invalid="last_Nm"),)
        fit, clipped = ("tau_h_fit_Nm",), "the fit was clipped at its range"
        self.outputs = (
            around("tau_h_fit_Nm", self.tau_lim, "present value of the parabola"),
            around("tau_h_rate_Nm_s", self.rate_lim, "present slope of the parabola"),
            around("tau_h_curve_Nm_s2", self.curve_lim, "second derivative"),
            status_port(
                "status",
                "the input was NaN or outside its range; the last one is used",
                "the state was corrupt; restarted",
                Flag("CLIPPED", clipped, True, fit, self.tau_lim),
            ),
        )

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        ok = guard.inputs_ok
        primed = ca.logic_or(s.primed, ok)
        past = [ca.if_else(s.primed, x, u.tau_h_Nm) for x in (s.last_Nm, *ca.vertsplit(s.past_Nm))]
        kept = [u.tau_h_Nm, *past][: self.count]
        fit = [
            sum((float(w) * kept[i * self.every] for i, w in enumerate(row)), ca.SX(0))
            for row in self.weights
        ]
        value = label("fit_Nm", fit[0], "least squares through 11 values, now")
        out = ca.fabs(value) > self.tau_lim
        next_state = {"primed": primed, "last_Nm": kept[0], "past_Nm": kept[1 : self.count - 1]}
        outputs = {
            "tau_h_fit_Nm": clip(value, -self.tau_lim, self.tau_lim),
            "tau_h_rate_Nm_s": clip(fit[1], -self.rate_lim, self.rate_lim),
            "tau_h_curve_Nm_s2": clip(2 * fit[2], -self.curve_lim, self.curve_lim),
            "status": guard.status(out),
        }
        return next_state, outputs
