"""Sliding mode torque control of the motor side relative to the load side (5.12 to 5.22).

SymPy derives the equivalent control from the surface and the plant, and the switching gain from the
same line with every number uncertain; CasADi evaluates what it derived.
"""

from __future__ import annotations

import math
from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import casadi as ca
import sympy as sp

from esea_gen.control.linear_loop import check_loop, sliding_mode_numbers
from esea_gen.control.reference import ACCELERATION_ROOM
from esea_gen.control.sliding_mode_streams import STREAMS
from esea_gen.devices.fields import field_facts
from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Flag, Port, Tunable, clip, flag_word, threshold
from esea_gen.model.symbolic import equation, to_casadi
from esea_gen.observe import drive_of
from esea_gen.observe.disturbance import (
    ACCELERATION,
    D4,
    FC,
    FV,
    OMEGA_M,
    TAU_E,
    U_A,
    WIDTH,
    J,
    N,
)

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

LAMBDA = sp.Symbol("lambda", positive=True)
ERROR, ERROR_RATE, INTEGRAL, SET_ACC = sp.symbols("e e' I theta_d''", real=True)
SURFACE = ERROR_RATE + 2 * LAMBDA * ERROR + LAMBDA**2 * INTEGRAL
DELTA = sp.Symbol("delta", real=True)
J_UNC, FV_UNC, FC_UNC, TAU_UNC, J_MAX, ETA, K1_UNC, K3_UNC = (
    sp.Symbol(n, nonnegative=True)
    for n in ("J_unc", "f_v,unc", "f_c,unc", "tau_e,unc", "J_max", "eta", "k_1,unc", "k_3,unc")
)
TORQUE_UNCERTAINTY = K1_UNC * sp.Abs(DELTA) + K3_UNC * sp.Abs(DELTA) ** 3
# theta_d'' + 2 lambda e' + lambda^2 e: the acceleration that keeps the surface.
WANTED = sp.Symbol("a_w", real=True)
WANTED_ACCELERATION = SET_ACC + 2 * LAMBDA * ERROR_RATE + LAMBDA**2 * ERROR

# The share of the largest command by which the applied one may miss it before the integral rests.
LIMITED_SHARE = 1e-3
LEAD, LEAD_HIGH = 2.0, 4.0
# Above, the loop swings with the shipped motor's lag (docs/control.md), and a slope near the
# control rate is not followed at all.
LAMBDA_LOW_1_S, LAMBDA_HIGH_1_S, LAMBDA_SHARE = 1.0, 25.0, 0.125
MARGIN_HIGH = 5.0


@cache
def equivalent_control() -> sp.Expr:
    """Equivalent control: the motor torque that keeps the surface (5.16, 5.17).

    Returns
    -------
    sympy.Expr
        Solution of s' = 0 for u_a, with the plant (5.2) put in for the motor side's acceleration.
    """
    t = sp.Symbol("t")
    theta_d, theta_m, integral = (sp.Function(n)(t) for n in ("theta_d", "theta_m", "I"))
    e = theta_d - theta_m
    surface = SURFACE.subs(
        {ERROR_RATE: sp.diff(e, t), ERROR: e, INTEGRAL: integral}, simultaneous=True
    )
    slope = sp.diff(surface, t).subs(sp.diff(integral, t), e)
    slope = slope.subs(sp.diff(theta_m, t, 2), ACCELERATION)
    slope = slope.subs(sp.diff(theta_d, t, 2), SET_ACC)
    slope = slope.subs(sp.diff(theta_d, t), ERROR_RATE + sp.diff(theta_m, t))
    slope = sp.expand(slope.subs(theta_d, ERROR + theta_m))
    ((solution,),) = sp.linsolve([slope], U_A)
    return sp.expand(solution)


@cache
def switching_gain() -> sp.Expr:
    """Smallest switching gain that reaches the surface whatever the uncertain numbers are (5.20).

    Returns
    -------
    sympy.Expr
        Motor torque, at the motor shaft.

    Notes
    -----
    With the equivalent control of the model put into the plant with true numbers, ``J_true s'`` is
    linear in the numbers' errors.  Each error at its largest, against ``s``, and J_max eta on top
    for the reaching rate, gives the sum of magnitudes.  J_max is J + J_unc.
    """
    errors = {
        J: (sp.Symbol("dJ"), J_UNC),
        FV: (sp.Symbol("dfv"), FV_UNC),
        FC: (sp.Symbol("dfc"), FC_UNC),
        TAU_E: (sp.Symbol("dtau"), TAU_UNC),
    }
    true = {x: x + d for x, (d, _) in errors.items()}
    model = equivalent_control().subs(SET_ACC, WANTED - 2 * LAMBDA * ERROR_RATE - LAMBDA**2 * ERROR)
    plant = ACCELERATION.subs(true, simultaneous=True).subs(U_A, model)
    pull = sp.expand(sp.cancel(sp.together(true[J] * (WANTED - plant))))
    bound = J_MAX * ETA
    for d, largest in errors.values():
        for term in sp.Add.make_args(sp.expand(pull.coeff(d))):
            bound += largest * sp.Abs(term)
    return bound / N


def sliding_mode(device: DeviceData, *, lead: float | None = None) -> Block:
    """Sliding mode torque controller.

    Parameters
    ----------
    device : DeviceData
        A device with a drive.
    lead : float, optional
        Default of the tunable ``lead``.  When not given, 1 where the device file takes the
        set-point's acceleration as zero (the controller is then the printed one), else 2.

    Returns
    -------
    Block
        Inputs: the deflection set-point with rate and acceleration, the deflection, the rates of
        both sides, interaction torque, torque of the person, disturbance of the drive, the motor's
        torque by its model, mode, and the command that is applied.  Outputs: ``u_command_Nm``, what
        the law wants before any limit ``u_wanted_Nm``, the surface ``s_rad_s``, equivalent control
        ``u_eq_Nm``, switching gain ``k_smc_Nm`` and a status word.

    Raises
    ------
    UserError
        When the device has no drive, its slope lambda is outside what can be followed, or the loop
        inside the layer is not damped.

    Notes
    -----
    Controlled is the motor side relative to the load side, ``e = delta_d - delta``, so that
    ``theta_d = theta_l + delta_d``.  The integral's part of the surface, lambda^2 times the
    integral, is what is kept: it is a rate, and does not jump when lambda is tuned.

    On entry (the mode was 0, or the last step was invalid) the integral is set so that the surface
    is 0, and what is missing between the law and the command that is applied becomes an offset that
    fades with the motor's lag: the command starts where it is.  Off, the command is 0.

    The integral rests while the command is clipped, here or by what follows, and the error would
    drive it further.  The applied command is compared with the last two commands: which of the two
    it stems from depends on when the control task's command is released.
    """
    drive = drive_of(device)
    sm = sliding_mode_numbers(device)
    h = drive.control_period_s
    a = drive.actuator
    inertia, ratio = a.J_kgm2.value, a.gear_ratio.value
    model_acceleration = sm.setpoint_acceleration == "model"
    phi = sm.phi_rad_s.value
    u_lim, tau_lim, tau_h_lim, d_lim = drive.u_Nm, drive.tau_Nm, drive.tau_h_Nm, drive.d4_rad_s2
    omega_lim, rate_lim, delta_lim = drive.omega_rad_s, drive.rate_rad_s, drive.delta_rad
    acc_lim = threshold(ACCELERATION_ROOM * d_lim)
    lambda_low, lambda_high = LAMBDA_LOW_1_S, min(LAMBDA_HIGH_1_S, LAMBDA_SHARE / h)
    if not lambda_low <= sm.lambda_1_s.value <= lambda_high:
        # A higher rate helps only up to where the motor's lag sets the limit.
        by_rate = lambda_high < sm.lambda_1_s.value <= LAMBDA_HIGH_1_S
        need = math.ceil(sm.lambda_1_s.value / LAMBDA_SHARE)
        raise UserError(
            f"{device.origin}: sliding_mode.lambda_1_s = {sm.lambda_1_s.value:g} 1/s is outside "
            f"{lambda_low:g} to {lambda_high:g} 1/s, what "
            + (
                f"timing.control_rate_Hz = {1 / h:g} Hz allows."
                if by_rate
                else "the motor's lag allows: the loop swings, or does not follow."
            ),
            f"Give a value inside{f', or raise the rate to {need} Hz or more' if by_rate else ''}.",
        )
    lead_here = (LEAD if model_acceleration else 1.0) if lead is None else lead
    check_loop(device, lead_here)
    error_lim = 2 * delta_lim
    error_rate_lim = rate_lim + 2 * omega_lim
    integral_lim = threshold(error_rate_lim + 2 * lambda_high * error_lim)
    s_lim = threshold(2.002 * integral_lim)
    fade = math.exp(-h / a.tau_c_s.value)
    limited = threshold(LIMITED_SHARE * u_lim)
    numbers: dict[Any, Any] = {
        J: inertia,
        N: ratio,
        FV: a.fv_Nms_rad.value,
        FC: a.fc_Nm.value,
        WIDTH: a.coulomb_width_rad_s.value,
        J_UNC: sm.J_unc_kgm2.value,
        FV_UNC: sm.fv_share.value * a.fv_Nms_rad.value,
        FC_UNC: sm.fc_share.value * a.fc_Nm.value,
        J_MAX: inertia + sm.J_unc_kgm2.value,
        ETA: sm.eta_rad_s2.value,
        K1_UNC: sm.k1_unc_Nm_rad.value,
        K3_UNC: sm.k3_unc_Nm_rad3.value,
    }
    wanted_lim = (
        acc_lim
        + (tau_lim + tau_h_lim) / drive.joint.Jh_kgm2.value
        + 2 * lambda_high * error_rate_lim
        + lambda_high**2 * error_lim
    )
    k_lim = threshold(
        1.01
        * MARGIN_HIGH
        / ratio
        * (
            numbers[J_UNC] * (wanted_lim + d_lim)
            + numbers[FV_UNC] * omega_lim
            + numbers[FC_UNC]
            + numbers[K1_UNC] * delta_lim
            + numbers[K3_UNC] * delta_lim**3
            + numbers[J_MAX] * numbers[ETA]
        )
        + 1e-6
    )
    eq_lim = threshold(
        1.01
        / ratio
        * (inertia * (wanted_lim + d_lim) + numbers[FV] * omega_lim + numbers[FC] + tau_lim)
    )

    wanted_u = threshold(1.01 * (LEAD_HIGH * (eq_lim + k_lim) + LEAD_HIGH * u_lim))

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        return {
            "lambda_1_s": t.lambda_1_s,
            "lambda2_1_s2": t.lambda_1_s * t.lambda_1_s,
            "integral_gain_1_s": h * t.lambda_1_s * t.lambda_1_s,
            "layer_s_rad": 1 / t.phi_rad_s,
            "margin": t.margin,
            "lead": t.lead - 1,
            "load_share": t.load_share,
        }

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        sound = ca.logic_and(guard.inputs_ok, guard.state_ok)
        on = label("on", ca.logic_and(sound, u.mode > 0.5), "whether the controller acts")
        entering = label("entering", ca.logic_and(on, ca.logic_not(s.active)), "from off to on")

        e = label("e_rad", u.delta_set_rad - u.theta_rad, "theta_d - theta_m")
        moving = u.omega_motor_rad_s - u.omega_load_rad_s
        e_rate = label("e_rate_rad_s", u.delta_rate_rad_s - moving, "its rate")
        straight = label(
            "straight_rad_s", e_rate + 2 * c.lambda_1_s * e, "(5.12) without the integral"
        )
        integral = ca.if_else(entering, -straight, s.integral_rad_s)
        surface = label(
            "s_rad_s",
            ca.if_else(entering, 0, straight + integral),
            "(5.12); 0 on entry",
        )
        if model_acceleration:
            load = (u.tau_Nm + u.tau_h_Nm) * (1 / drive.joint.Jh_kgm2.value)
            set_acc = u.delta_acc_rad_s2 + c.load_share * load
        else:
            set_acc = ca.SX(0)
        label("set_acc_rad_s2", set_acc, "theta_d''")

        values = numbers | {
            LAMBDA: c.lambda_1_s,
            ERROR: e,
            ERROR_RATE: e_rate,
            SET_ACC: set_acc,
            OMEGA_M: u.omega_motor_rad_s,
            TAU_E: u.tau_Nm,
            D4: u.d4_rad_s2,
            DELTA: u.theta_rad,
        }
        wanted = label(
            "wanted_rad_s2",
            set_acc + 2 * c.lambda_1_s * e_rate + c.lambda2_1_s2 * e,
            "theta_d'' + 2 lambda e' + lambda^2 e",
        )
        compact = equivalent_control().subs(
            SET_ACC, WANTED - 2 * LAMBDA * ERROR_RATE - LAMBDA**2 * ERROR
        )
        u_eq = label(
            "u_eq_Nm",
            to_casadi(sp.together(compact), values | {WANTED: wanted}),
            "(5.16, 5.17) solution of s' = 0",
        )
        tau_unc = label("tau_unc_Nm", to_casadi(TORQUE_UNCERTAINTY, values), "tau_e,unc")
        least = to_casadi(switching_gain(), values | {WANTED: wanted, TAU_UNC: tau_unc})
        k_smc = label("k_smc_Nm", c.margin * least, "(5.20)")
        reach = label("reach", surface * c.layer_s_rad, "s/phi")
        law = label("law_Nm", u_eq + k_smc * clip(reach, -1, 1), "(5.22) motor torque wanted")
        driven = label("driven_Nm", law + c.lead * (law - u.u_a_Nm), "against the motor's lag")
        bounded = clip(driven, -u_lim, u_lim)
        missing = ca.if_else(entering, u.u_applied_Nm - bounded, s.offset_Nm)
        raw = label("raw_Nm", bounded + missing, "with the offset of the entry")
        command = label("u_command_Nm", ca.if_else(on, clip(raw, -u_lim, u_lim), 0))

        # Which way is the command held back?  1: it wanted to be higher.  First here, then by what
        # follows.
        high = ca.logic_or(driven > u_lim, raw > u_lim)
        low = ca.logic_or(driven < -u_lim, raw < -u_lim)
        short, before = s.u_last_Nm - u.u_applied_Nm, s.u_before_Nm - u.u_applied_Nm
        nearer = ca.if_else(ca.fabs(short) < ca.fabs(before), short, before)
        nearer = ca.if_else(entering, 0, nearer)
        here = ca.if_else(high, 1.0, ca.if_else(low, -1.0, 0.0))
        after = ca.if_else(nearer > limited, 1.0, ca.if_else(nearer < -limited, -1.0, 0.0))
        held_back = label(
            "held_back", ca.if_else(here == 0, after, here), "sign of what the command lacks"
        )
        rests = label("rests", held_back * e > 0, "the error would wind the integral up")
        grown = clip(
            integral + ca.if_else(rests, 0, c.integral_gain_1_s * e), -integral_lim, integral_lim
        )
        next_state = {
            "active": on,
            "integral_rad_s": ca.if_else(on, grown, 0),
            "offset_Nm": ca.if_else(on, missing * fade, 0),
            "u_last_Nm": command,
            "u_before_Nm": ca.if_else(on, ca.if_else(entering, u.u_applied_Nm, s.u_last_Nm), 0),
        }
        outputs = {
            "u_command_Nm": command,
            "u_wanted_Nm": ca.if_else(on, driven, 0),
            "s_rad_s": ca.if_else(on, surface, 0),
            "u_eq_Nm": ca.if_else(on, u_eq, 0),
            "k_smc_Nm": ca.if_else(on, k_smc, 0),
            "status": flag_word(
                [
                    ca.logic_not(guard.inputs_ok),
                    ca.logic_not(guard.state_ok),
                    ca.logic_and(on, ca.fabs(driven) > u_lim),
                    ca.logic_and(on, ca.fabs(reach) > 1),
                    ca.logic_and(on, rests),
                    on,
                    entering,
                ]
            ),
        }
        return next_state, outputs

    flags = (
        Flag("INPUT_INVALID", "an input was NaN or outside its range; no torque asked for", True),
        Flag("STATE_REPAIRED", "the state was corrupt; no torque asked for in this step", True),
        Flag(
            "SATURATED",
            "the command was clipped at the motor's limit",
            True,
            ("u_command_Nm",),
            u_lim,
        ),
        Flag("LAYER_LEFT", "|s| is beyond the boundary layer", False, ("s_rad_s",), phi),
        Flag("INTEGRAL_RESTS", "the command is held back; the integral does not grow"),
        Flag("ACTIVE", "the controller acts"),
        Flag("ENTERED", "the controller took over in this step, from the applied command"),
    )
    delta, rate = "deflection set-point", "rate of the deflection set-point"
    return Block.define(
        "sliding_mode",
        "Sliding mode torque controller",
        period_s=h,
        constants=device.constants("actuator")
        + device.constants("sliding_mode")
        + tuple(k for k in device.constants("joint") if k.name == "Jh_kgm2"),
        tunables=(
            Tunable(
                "lambda_1_s",
                sm.lambda_1_s.value,
                lambda_low,
                lambda_high,
                "slope of the surface: higher is stiffer and nearer to the drive's own modes",
                sm.lambda_1_s.source,
                sm.lambda_1_s.status,
            ),
            Tunable(
                "phi_rad_s",
                phi,
                field_facts("sliding_mode.phi_rad_s")["low"],
                field_facts("sliding_mode.phi_rad_s")["high"],
                "width of the boundary layer: narrower is stiffer and chatters sooner",
                sm.phi_rad_s.source,
                sm.phi_rad_s.status,
            ),
            Tunable(
                "margin",
                1.0,
                1.0,
                MARGIN_HIGH,
                "factor on the switching gain of (5.20); 1 is its smallest",
                "thesis chapter 5: equality in (5.20)",
                "published",
            ),
            Tunable(
                "lead",
                lead_here,
                1.0,
                LEAD_HIGH,
                "how many times faster than the motor's lag the torque follows; 1 takes u_a as u_c",
                "1: thesis chapter 5; more: docs/control.md",
            ),
            Tunable(
                "load_share",
                1.0 if model_acceleration else 0.0,
                0.0,
                1.0,
                "share of the load's estimated acceleration in the set-point's acceleration",
                "docs/control.md",
            ),
        ),
        coefficients=(
            Port("lambda_1_s", 0.0, lambda_high, "slope of the surface", equation="(5.12)"),
            Port("lambda2_1_s2", 0.0, 1.01 * lambda_high**2, "its square"),
            Port("integral_gain_1_s", 0.0, 1.01 * h * lambda_high**2, "square times period"),
            Port("layer_s_rad", 0.0, 1.01e3, "1/phi", equation="(5.22)"),
            Port("margin", 1.0, MARGIN_HIGH, "factor on the switching gain", equation="(5.20)"),
            Port("lead", 0.0, LEAD_HIGH - 1, "gain against the motor's lag"),
            Port("load_share", 0.0, 1.0, "share of the load's acceleration"),
        ),
        prepare=prepare,
        state=(
            Port("active", 0.0, 1.0, "1 when the controller acted in the last step"),
            Port("integral_rad_s", -integral_lim, integral_lim, "lambda^2 times the integral of e"),
            Port("offset_Nm", -2.01 * u_lim, 2.01 * u_lim, "fading offset of the entry"),
            Port("u_last_Nm", -u_lim, u_lim, "command of the last step"),
            Port("u_before_Nm", -u_lim, u_lim, "command of the step before"),
        ),
        inputs=(
            Port("delta_set_rad", -delta_lim, delta_lim, delta),
            Port("delta_rate_rad_s", -rate_lim, rate_lim, rate),
            Port("delta_acc_rad_s2", -acc_lim, acc_lim, "acceleration of the set-point"),
            Port(
                "theta_rad", -delta_lim, delta_lim, "deflection: motor-side minus load-side angle"
            ),
            Port("omega_motor_rad_s", -omega_lim, omega_lim, "motor side's rate"),
            Port("omega_load_rad_s", -omega_lim, omega_lim, "load side's rate"),
            Port("tau_Nm", -tau_lim, tau_lim, "interaction torque on the load"),
            Port("tau_h_Nm", -tau_h_lim, tau_h_lim, "torque of the person"),
            Port("d4_rad_s2", -d_lim, d_lim, "disturbance of the drive", equation="(5.5)"),
            Port("u_a_Nm", -u_lim, u_lim, "motor torque by its model", equation="(5.1)"),
            Port("mode", 0.0, 2.0, "0 off; 1 torque and 2 impedance act alike here"),
            Port("u_applied_Nm", -u_lim, u_lim, "command that the motor holds"),
        ),
        outputs=(
            Port("u_command_Nm", -u_lim, u_lim, "command at the motor shaft", equation="(5.22)"),
            Port("u_wanted_Nm", -wanted_u, wanted_u, "what the law wants before any limit"),
            Port("s_rad_s", -s_lim, s_lim, "surface", equation="(5.12)"),
            Port("u_eq_Nm", -eq_lim, eq_lim, "equivalent control", equation="(5.16)"),
            Port("k_smc_Nm", 0.0, k_lim, "switching gain", equation="(5.20)"),
            Port("status", 0, 127, "what is known of this command", flags=flags),
        ),
        equations=(
            equation("(5.12)", "s", SURFACE, "surface of second order with integral"),
            equation("(5.16, 5.17)", "u_eq", equivalent_control(), "solution of s' = 0"),
            equation("(5.20)", "k_smc", switching_gain(), "smallest switching gain"),
            equation("[a_w]", WANTED, WANTED_ACCELERATION, "acceleration that keeps the surface"),
            equation("[tau_unc]", TAU_UNC, TORQUE_UNCERTAINTY, "uncertain coupling torque"),
            equation(
                "(5.22)",
                "u",
                sp.Symbol("u_eq")
                + sp.Symbol("k_smc") * sp.Max(-1, sp.Min(1, sp.Symbol("s") / sp.Symbol("phi"))),
                "motor torque wanted",
            ),
            equation(
                "[lead]",
                "u_c",
                sp.Symbol("u") + (sp.Symbol("kappa") - 1) * (sp.Symbol("u") - U_A),
                "command that makes the motor follow kappa times faster; 1 as printed",
            ),
        ),
        step=step,
        streams=STREAMS,
    )
