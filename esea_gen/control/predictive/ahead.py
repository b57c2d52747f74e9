"""Desired values of predictive control at the end of every interval of its horizon."""

from __future__ import annotations

from functools import reduce
from itertools import accumulate, pairwise
from operator import mul
from typing import Any

import casadi as ca

from esea_gen.control.predictive.horizon import Horizon
from esea_gen.control.reference import adapted_inputs
from esea_gen.devices.fields import field_facts
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, around, clip, flag_word, threshold
from esea_gen.model.mode import Mode
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

# A stiffness below this pulls by less than a thousandth of a Nm whatever the angle.
LEAST_KP = 1e-4


EQUATION = """
    [blend] | tau_ahead | tau_d + o * exp(-t / T_b) | \
        wanted torque with the offset of a change of mode, as it will have faded
"""


# An offset starts a law from the measured torque; along the horizon it fades as it will.  In one
# layer the path stays so near to the load side, as it moves on, that the stiffness asks for
# tau_range_Nm at most: as the set torque's clip does in two layers.
def ahead(
    device: DeviceData,
    horizon: Horizon,
    *,
    given: bool,
    one_layer: bool,
    torque_given: bool | None = None,
) -> Block:
    """Desired torque, and the impedance law's path and gains, at the end of every interval."""
    return Block.of(
        _Ahead(device, horizon, given, one_layer, given if torque_given is None else torque_given)
    )


class _Ahead:
    def __init__(
        self, device: DeviceData, horizon: Horizon, given: bool, one_layer: bool, torque_given: bool
    ) -> None:
        self.horizon = horizon
        self.given, self.torque_given = given, torque_given
        self.one_layer = one_layer
        self.drive = drive_of(device)
        self.h = self.drive.control_period_s
        self.n = horizon.intervals
        self.many = self.n if given else 1
        self.tau_lim, self.omega_lim = self.drive.tau_Nm, self.drive.omega_rad_s
        self.full_scale = threshold(device.tau_full_scale_Nm)
        # Gains as a law may get them: the damping that is added comes on top.
        self.kp_high, self.kd_high = (
            field_facts(f"impedance.{k}")["high"] for k in ("Kp_Nm_rad", "Kd_Nms_rad")
        )
        self.low, self.high = self.drive.theta_low_rad, self.drive.theta_high_rad
        angle = self.high - self.low
        self.widest = threshold(
            1.01 * (2 * self.tau_lim + self.kp_high * angle + 2 * self.kd_high * self.omega_lim)
        )
        self.passive = device.file.passivity is not None
        # A future that is extrapolated is that of an adapted wish already.
        self.adapted = adapted_inputs(device) if given else ()
        self.ticks = [round(t / device.period_s) for t in horizon.ends_s]
        self.name = "ahead"
        self.title = "What is wanted along the horizon"
        self.state: tuple[Port, ...] = ()
        self.inputs, self.outputs = self._ports()
        self.equations = equations(EQUATION)

    def fades(self, keep: Any) -> list[Any]:
        squares = [keep]
        while len(squares) < max(self.ticks).bit_length():
            squares.append(squares[-1] * squares[-1])

        def power(k: int) -> Any:
            factors = [x for i, x in enumerate(squares) if k >> i & 1]
            return reduce(mul, factors, ca.SX(1))

        steps = [power(b - a) for a, b in pairwise((0, *self.ticks))]
        return list(accumulate(steps, mul, initial=ca.SX(1)))[1:]

    def along(self, x: Any, given: bool) -> list[Any]:
        return ca.vertsplit(x) if given else [x] * self.n

    def _ports(self) -> tuple[tuple[Port, ...], tuple[Port, ...]]:
        full = self.full_scale
        inputs = [
            Port.choice("mode", Mode, "active mode"),
            around("tau_preview_Nm", self.tau_lim, "desired torque at interval ends", self.n)
            if self.torque_given
            else around("tau_wanted_Nm", self.tau_lim, "present desired torque"),
            around("offset_Nm", self.widest, "from the law to where the torque was, now"),
            Port("keep", 0.0, 1.0, "share of the offset that a sensing period keeps"),
            # Above 0, so that no clip has both ends at a zero, of which there are two.
            Port("tau_range_Nm", 0.009 * full, full, "largest |set torque|", on_invalid=full),
            *self.adapted,
        ]
        gains = (
            Port("Kp_Nm_rad", 0.0, self.kp_high, "stiffness", equation="(5.24)"),
            Port("Kd_Nms_rad", 0.0, self.kd_high, "damping", equation="(5.24)"),
        )
        if self.passive:
            # Along the horizon, not as a torque that holds: the law knows how the limb will move.
            inputs.append(Port("damping_Nms_rad", 0.0, self.kd_high, "damping that was added"))
        flags = (Flag("INPUT_INVALID", "an input was NaN or outside its range; off", True),)
        outputs = [around("tau_d_Nm", self.tau_lim, "desired torque at interval ends", self.n)]
        if self.one_layer:
            word = "preview" if self.given else "wanted"
            inputs += [
                Port(f"theta_{word}_rad", self.low, self.high, "desired angle", self.many),
                around(f"omega_{word}_rad_s", self.omega_lim, "desired rate", self.many),
                *gains,
                Port("theta_load_rad", self.low, self.high, "load side's angle"),
                around("omega_load_rad_s", self.omega_lim, "load side's rate"),
            ]
            outputs += [
                Port("theta_d_rad", self.low, self.high, "desired angle at these ends", self.n),
                around("omega_d_rad_s", self.omega_lim, "desired rate at these ends", self.n),
                *gains,
            ]
        else:
            inputs.append(around("tau_set_Nm", full, "set torque, impedance mode"))
            if self.passive:
                inputs.append(around("omega_load_rad_s", self.omega_lim, "load side's rate"))
        outputs += [
            Port.choice("mode", Mode, "active mode; 0 with an invalid input"),
            Port.flag("request_ok", "1 while every input is sound; else the limits latch"),
            Port("status", 0, 1, "status", flags=flags),
        ]
        return tuple(inputs), tuple(outputs)

    def step(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        wanted = u.tau_preview_Nm if self.torque_given else u.tau_wanted_Nm
        law = label("impedance", u.mode == Mode.IMPEDANCE, "the impedance law holds")
        ahead = self.along(wanted, self.torque_given)
        if self.adapted:
            ahead = [w * u.wish_gain + u.wish_shift_Nm for w in ahead]
        tau = [
            clip(w + u.offset_Nm * f, -u.tau_range_Nm, u.tau_range_Nm)
            for w, f in zip(ahead, self.fades(u.keep), strict=True)
        ]
        if not self.one_layer:
            if self.passive:
                resists = label("resists_Nm", u.damping_Nms_rad * u.omega_load_rad_s)
                reach = u.tau_range_Nm
                tau = [clip(t - resists, -reach, reach) for t in tau]
            tau = [ca.if_else(law, u.tau_set_Nm, t) for t in tau]
        outputs: dict[str, Any] = {"tau_d_Nm": tau}
        if self.one_layer:
            kp = label("stiffness_Nm_rad", ca.if_else(law, u.Kp_Nm_rad, 0))
            reach = label(
                "reach_rad", u.tau_range_Nm / ca.fmax(kp, LEAST_KP), "where it asks for all"
            )
            word = "preview" if self.given else "wanted"
            omega = self.along(vars(u)[f"omega_{word}_rad_s"], self.given)
            start = self.along(vars(u)[f"theta_{word}_rad"], self.given)
            kd = ca.if_else(law, u.Kd_Nms_rad, 0)
            if self.passive:
                # Against the wanted rate the law damps as before, so that this one damps all.
                tau = [
                    clip(t - u.damping_Nms_rad * w, -self.tau_lim, self.tau_lim)
                    for t, w in zip(tau, omega, strict=True)
                ]
                outputs["tau_d_Nm"] = tau
                kd = clip(kd + u.damping_Nms_rad, 0.0, self.kd_high)
            path = []
            for k, end in enumerate(self.horizon.ends_s):
                theta = (
                    start[k] if self.given else clip(start[k] + end * omega[k], self.low, self.high)
                )
                coasting = clip(u.theta_load_rad + end * u.omega_load_rad_s, self.low, self.high)
                # Between two angles of the range, and so in it.
                path.append(clip(theta, coasting - reach, coasting + reach))
            outputs |= {"theta_d_rad": path, "omega_d_rad_s": omega}
            outputs |= {"Kp_Nm_rad": kp, "Kd_Nms_rad": kd}
        mode = ca.if_else(guard.inputs_ok, u.mode, Mode.OFF)
        outputs |= {
            "mode": label("mode_taken", mode, "off when not sound"),
            "request_ok": guard.inputs_ok,
            "status": flag_word([ca.logic_not(guard.inputs_ok)]),
        }
        return {}, outputs
