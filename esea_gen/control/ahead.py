"""What predictive control follows, for the end of every interval of its horizon."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import casadi as ca
import sympy as sp

from esea_gen.control.horizon import Horizon
from esea_gen.devices.fields import field_facts
from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Flag, Port, clip, flag_word, threshold
from esea_gen.model.symbolic import equation
from esea_gen.observe import drive_of

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

# A stiffness below this pulls by less than a thousandth of a Nm whatever the angle.
LEAST_KP = 1e-4


def ahead(device: DeviceData, horizon: Horizon, *, given: bool, one_layer: bool) -> Block:
    """Wanted torque, and the impedance law's path and gains, along the horizon.

    The reference Block starts a law from the measured torque: an offset makes up the difference and
    fades.  Along the horizon the offset fades as it will: bumpless with a known future too.

    given: whether the future is an input (one value for the end of each interval); else the wanted
        torque and the wanted rate hold from now on.
    one_layer: whether the predictive controller holds the impedance law itself; else its reference
        in impedance mode is the set torque, which holds from now on.
    return: inputs: from the reference Block ``mode``, ``offset_Nm``, ``keep`` and ``tau_range_Nm``;
        the wanted torque, ``tau_preview_Nm`` or ``tau_wanted_Nm``; in two layers ``tau_set_Nm``; in
        one layer the gains, the wanted path and the load side's motion. Outputs: ``tau_d_Nm``, in
        one layer also ``theta_d_rad``, ``omega_d_rad_s`` and the gains (0 outside impedance mode),
        ``mode`` and a status word.

    In one layer the path stays so near to the load side, as it moves on by itself, that the
    stiffness asks for ``tau_range_Nm`` at most: as the set torque's clip does in two layers.
    """
    drive = drive_of(device)
    n = horizon.intervals
    many = n if given else 1
    tau_lim, omega_lim = drive.tau_Nm, drive.omega_rad_s
    full_scale = threshold(device.tau_full_scale_Nm)
    kp_high, kd_high = (field_facts(f"impedance.{k}")["high"] for k in ("Kp_Nm_rad", "Kd_Nms_rad"))
    low, high = drive.theta_low_rad, drive.theta_high_rad
    angle = high - low
    widest = threshold(1.01 * (2 * tau_lim + kp_high * angle + 2 * kd_high * omega_lim))
    ticks = [round(t / device.period_s) for t in horizon.ends_s]

    def fades(keep: Any) -> list[Any]:
        squares = [keep]
        while len(squares) < max(ticks).bit_length():
            squares.append(squares[-1] * squares[-1])

        def power(k: int) -> Any:
            factors = [x for i, x in enumerate(squares) if k >> i & 1]
            out: Any = ca.SX(1)
            for x in factors:
                out = out * x
            return out

        out, last, value = [], 0, ca.SX(1)
        for k in ticks:
            value = value * power(k - last)
            out.append(value)
            last = k
        return out

    def along(x: Any) -> list[Any]:
        return ca.vertsplit(x) if given else [x] * n

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        wanted = u.tau_preview_Nm if given else u.tau_wanted_Nm
        law = label("impedance", u.mode > 1.5, "the impedance law holds")
        tau = [
            clip(w + u.offset_Nm * f, -u.tau_range_Nm, u.tau_range_Nm)
            for w, f in zip(along(wanted), fades(u.keep), strict=True)
        ]
        if not one_layer:
            tau = [ca.if_else(law, u.tau_set_Nm, t) for t in tau]
        outputs: dict[str, Any] = {"tau_d_Nm": tau}
        if one_layer:
            kp = label("stiffness_Nm_rad", ca.if_else(law, u.Kp_Nm_rad, 0))
            reach = label(
                "reach_rad", u.tau_range_Nm / ca.fmax(kp, LEAST_KP), "where it asks for all"
            )
            omega = along(u.omega_preview_rad_s if given else u.omega_wanted_rad_s)
            start = along(u.theta_preview_rad if given else u.theta_wanted_rad)
            path = []
            for k, end in enumerate(horizon.ends_s):
                theta = start[k] if given else clip(start[k] + end * omega[k], low, high)
                coasting = clip(u.theta_load_rad + end * u.omega_load_rad_s, low, high)
                # Between two angles of the range, and so in it.
                path.append(clip(theta, coasting - reach, coasting + reach))
            outputs |= {
                "theta_d_rad": path,
                "omega_d_rad_s": omega,
                "Kp_Nm_rad": kp,
                "Kd_Nms_rad": ca.if_else(law, u.Kd_Nms_rad, 0),
            }
        outputs |= {
            "mode": label(
                "mode_taken", ca.if_else(guard.inputs_ok, u.mode, 0), "off when not sound"
            ),
            "request_ok": guard.inputs_ok,
            "status": flag_word([ca.logic_not(guard.inputs_ok)]),
        }
        return {}, outputs

    inputs = [
        Port("mode", 0.0, 2.0, "0 off, 1 torque, 2 impedance"),
        Port("tau_preview_Nm", -tau_lim, tau_lim, "wanted torque at the intervals' ends", n)
        if given
        else Port("tau_wanted_Nm", -tau_lim, tau_lim, "wanted torque now"),
        Port("offset_Nm", -widest, widest, "from the law to where the torque was, now"),
        Port("keep", 0.0, 1.0, "share of the offset that a sensing period keeps"),
        # Above 0, so that no clip has both ends at a zero, of which there are two.
        Port(
            "tau_range_Nm",
            0.009 * full_scale,
            full_scale,
            "largest |set torque|",
            on_invalid=full_scale,
        ),
    ]
    gains = (
        Port("Kp_Nm_rad", 0.0, kp_high, "stiffness", equation="(5.24)"),
        Port("Kd_Nms_rad", 0.0, kd_high, "damping", equation="(5.24)"),
    )
    flags = (Flag("INPUT_INVALID", "an input was NaN or outside its range; off", True),)
    outputs = [Port("tau_d_Nm", -tau_lim, tau_lim, "wanted torque at the intervals' ends", n)]
    if one_layer:
        word = "preview" if given else "wanted"
        inputs += [
            Port(f"theta_{word}_rad", low, high, "wanted angle", many),
            Port(f"omega_{word}_rad_s", -omega_lim, omega_lim, "wanted rate", many),
            *gains,
            Port("theta_load_rad", low, high, "load side's angle"),
            Port("omega_load_rad_s", -omega_lim, omega_lim, "load side's rate"),
        ]
        outputs += [
            Port("theta_d_rad", low, high, "wanted angle at the intervals' ends", n),
            Port("omega_d_rad_s", -omega_lim, omega_lim, "wanted rate there", n),
            *gains,
        ]
    else:
        inputs.append(Port("tau_set_Nm", -full_scale, full_scale, "set torque, impedance mode"))
    outputs += [
        Port("mode", 0.0, 2.0, "mode that holds; 0 with an invalid input"),
        Port("request_ok", 0, 1, "1 while every input is sound; else the limits latch"),
        Port("status", 0, 1, "what is known of it", flags=flags),
    ]
    tau_d, o, t, blend = sp.symbols("tau_d o t T_b")
    return Block.define(
        "ahead",
        "What is wanted along the horizon",
        period_s=drive.control_period_s,
        state=(),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        equations=(
            equation(
                "[blend]",
                "tau_ahead",
                tau_d + o * sp.exp(-t / blend),
                "wanted torque with the offset of a change of mode, as it will have faded",
            ),
        ),
        step=step,
    )
