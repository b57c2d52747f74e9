"""Worked example: a control law in one file.

Proportional control of the measured torque, with the coupling's speed fed back as damping.  It
takes the place of the sliding mode between the same encoders, torque sensor, observers and limits::

    esea-gen simulate tuning --controller examples/proportional.py:LAW
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

# --8<-- [start:imports]
import casadi as ca
import sympy as sp

from esea_gen.control.law import Base, Law, Parts
from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Flag, Port, Tunable, clip, flag_word
from esea_gen.model.symbolic import equation
from esea_gen.observe import drive_of

# --8<-- [end:imports]


# --8<-- [start:block]
def proportional(base: Base) -> Block:
    """Torque error, smoothed, and the speeds of the coupling's two sides; a motor torque out."""
    drive, period_s = drive_of(base.device), base.control_period_s
    gear = drive.actuator.gear_ratio.value
    tau_Nm, u_Nm = drive.tau_Nm, drive.u_Nm

    # Runs when a tunable changes, not at every step.
    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        return {
            "gain": t.gain / gear,
            "share": 1 - ca.exp(-2 * ca.pi * period_s * t.filter_Hz),
            "damping_Nms_rad": t.damping_Nms_rad / gear,
        }

    # Runs every period.  What stands in s and u has passed the guard: no NaN, nothing out of range.
    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        active = label("active", ca.logic_and(guard.inputs_ok, u.mode >= 1), "off: no torque")
        error = label("error_Nm", u.tau_set_Nm - u.tau_Nm, "[p 1]")
        rate = label("rate_rad_s", u.omega_motor_rad_s - u.omega_load_rad_s, "of the coupling")
        smooth = label("smooth_Nm", s.error_Nm + c.share * (error - s.error_Nm), "[p 2]")
        wanted = label(
            "wanted_Nm",
            u.tau_set_Nm * (1 / gear) + c.gain * smooth - c.damping_Nms_rad * rate,
            "[p 3]",
        )
        return (
            {"error_Nm": ca.if_else(active, smooth, 0)},
            {
                "u_command_Nm": ca.if_else(active, clip(wanted, -u_Nm, u_Nm), 0),
                "status": flag_word(
                    [
                        ca.logic_not(guard.inputs_ok),
                        ca.logic_not(guard.state_ok),
                        ca.fabs(wanted) > u_Nm,
                    ]
                ),
            },
        )

    e, smooth, tau, tau_d, n, k, d = sp.symbols("e e_f tau_e tau_d n k d")
    w_m, w_l, share = sp.symbols("omega_m omega_l a")
    return Block.define(
        "proportional",
        "Proportional control of the torque",
        period_s=period_s,
        tunables=(
            Tunable("gain", 8.0, 0.0, 10.0, "torque error: higher follows closer, then swings"),
            Tunable("filter_Hz", 50.0, 1.0, 80.0, "smoothing: higher is quicker and rougher"),
            Tunable("damping_Nms_rad", 5.0, 0.0, 50.0, "damping: higher swings less, lags more"),
        ),
        coefficients=(
            Port("gain", 0.0, 10.0, "gain over the gear ratio"),
            Port("share", 0.0, 1.0, "share of the error that one period lets in"),
            Port("damping_Nms_rad", 0.0, 50.0, "damping over the gear ratio"),
        ),
        prepare=prepare,
        state=(Port("error_Nm", -2 * tau_Nm, 2 * tau_Nm, "torque error, smoothed"),),
        inputs=(
            Port.count("mode", 2, "0 off, 1 torque, 2 impedance"),
            Port("tau_set_Nm", -tau_Nm, tau_Nm, "wanted torque"),
            Port("tau_Nm", -tau_Nm, tau_Nm, "measured torque"),
            Port("omega_motor_rad_s", -drive.omega_rad_s, drive.omega_rad_s, "motor side's speed"),
            Port("omega_load_rad_s", -drive.omega_rad_s, drive.omega_rad_s, "load side's speed"),
        ),
        outputs=(
            Port("u_command_Nm", -u_Nm, u_Nm, "motor torque asked for; the limits come behind it"),
            Port(
                "status",
                0,
                7,
                "what is known of this step",
                flags=(
                    Flag("INPUT_INVALID", "an input was invalid; no torque is asked for", True),
                    Flag("STATE_REPAIRED", "the state was corrupt; it starts again", True),
                    Flag("CLIPPED", "the torque was clipped", True, ("u_command_Nm",), u_Nm),
                ),
            ),
        ),
        equations=(
            equation("[p 1]", "e", tau_d - tau, "torque error"),
            equation("[p 2]", "e_f", smooth + share * (e - smooth), "smoothed"),
            equation("[p 3]", "u", (tau_d + k * smooth - d * (w_m - w_l)) / n, "motor torque"),
        ),
        step=step,
    )


# --8<-- [end:block]


# --8<-- [start:law]
def parts(base: Base) -> Parts:
    """One Block in the control task; its inputs are fed by the signals of their names."""
    return Parts(control={"proportional": proportional(base)}, command="proportional.u_command_Nm")


LAW = Law("proportional", "Proportional torque control", parts)
# --8<-- [end:law]
