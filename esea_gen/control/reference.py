"""From what is wanted to the set torque, and from the deflection set-point to its rates."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal, get_args

import casadi as ca
import sympy as sp

from esea_gen.control.reference_streams import STREAMS
from esea_gen.devices.fields import field_facts
from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Flag, Port, Tunable, clip, flag_word, threshold
from esea_gen.model.symbolic import equation, to_casadi
from esea_gen.observe import drive_of

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

OFF, TORQUE, IMPEDANCE = 0.0, 1.0, 2.0

KP, KD = sp.symbols("K_p K_d", nonnegative=True)
THETA_D, OMEGA_D, THETA_L, OMEGA_L, TAU_D = sp.symbols(
    "theta_d omega_d theta_l omega_l tau_d", real=True
)
# (5.24) with the sign of a stiffness: the coupling's torque acts + on the load.
IMPEDANCE_LAW = TAU_D + KP * (THETA_D - THETA_L) + KD * (OMEGA_D - OMEGA_L)

BLEND_S, BLEND_LOW_S, BLEND_HIGH_S = 0.2, 0.02, 5.0


def reference(device: DeviceData) -> Block:
    """Set torque from the mode, the wanted torque and the impedance law.

    Parameters
    ----------
    device : DeviceData
        A device with a drive.

    Returns
    -------
    Block
        Inputs ``mode`` (0 off, 1 torque, 2 impedance), the wanted torque, angle and rate, the load
        side's angle and rate, and the measured torque; outputs ``tau_set_Nm`` for the inverse, the
        ``mode`` that holds, ``request_ok`` for the limits, and a status word.

    Raises
    ------
    UserError
        When the device has no drive.

    Notes
    -----
    Off, the set torque is the measured one.  When a law takes over from off, the difference between
    the measured torque and the law becomes an offset that decays with ``blend_s``: the set torque
    starts where the coupling is, whatever was wanted before.  From one law to another it goes
    on from where the set torque was.  An invalid input or a corrupt state means off for that
    step, with the last set torque held, and ``request_ok`` 0, on which the limits latch; what was
    set before an off does not come back.
    """
    drive = drive_of(device)
    h = device.period_s
    tau_lim, omega_lim = drive.tau_Nm, drive.omega_rad_s
    full_scale = threshold(device.tau_full_scale_Nm)
    kp, kd = drive.impedance.Kp_Nm_rad, drive.impedance.Kd_Nms_rad
    kp_high, kd_high = (field_facts(f"impedance.{k}")["high"] for k in ("Kp_Nm_rad", "Kd_Nms_rad"))
    angle = drive.theta_high_rad - drive.theta_low_rad
    # The widest that the law can ask for, and its offset from any measured torque.
    widest = threshold(1.01 * (2 * tau_lim + kp_high * angle + 2 * kd_high * omega_lim))

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        return {
            "Kp_Nm_rad": t.Kp_Nm_rad,
            "Kd_Nms_rad": t.Kd_Nms_rad,
            "keep": ca.exp(-h / t.blend_s),
            "tau_range_Nm": t.tau_range_Nm,
        }

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        sound = ca.logic_and(guard.inputs_ok, guard.state_ok)
        asked = ca.if_else(u.mode > 1.5, IMPEDANCE, ca.if_else(u.mode > 0.5, TORQUE, OFF))
        mode = label("mode_taken", ca.if_else(sound, asked, OFF), "0 off, 1 torque, 2 impedance")
        law = label(
            "law_Nm",
            to_casadi(
                IMPEDANCE_LAW,
                {
                    TAU_D: u.tau_desired_Nm,
                    KP: ca.if_else(mode > 1.5, c.Kp_Nm_rad, 0),
                    KD: ca.if_else(mode > 1.5, c.Kd_Nms_rad, 0),
                    THETA_D: u.theta_desired_rad,
                    OMEGA_D: u.omega_desired_rad_s,
                    THETA_L: u.theta_load_rad,
                    OMEGA_L: u.omega_load_rad_s,
                },
            ),
            "(5.24) with the sign of a stiffness",
        )
        on = mode > 0.5
        changed = label("changed", mode != s.mode_last, "the mode is another than a step ago")
        # From one law to another the set torque goes on from where it was: the measured one would
        # make a step of the tracking error.  It fades in that step already, so that neither a
        # rounding error nor an old wish lives on through one change after another.
        gone_on = ca.if_else(changed, s.tau_set_Nm - law, s.offset_Nm) * c.keep
        from_off = ca.logic_and(changed, s.mode_last < 0.5)
        offset = label(
            "offset_Nm",
            ca.if_else(from_off, u.tau_Nm - law, gone_on),
            "from the law to where the torque was, fading",
        )
        wanted = label("wanted_Nm", ca.if_else(on, law + offset, u.tau_Nm))
        limited = clip(wanted, -c.tau_range_Nm, c.tau_range_Nm)
        tau_set = label(
            "tau_set_Nm",
            ca.if_else(guard.inputs_ok, limited, s.tau_set_Nm),
            "invalid input: hold",
        )
        next_state = {
            "mode_last": mode,
            "offset_Nm": ca.if_else(on, offset, 0),
            "tau_set_Nm": tau_set,
        }
        outputs = {
            "tau_set_Nm": tau_set,
            "mode": mode,
            "request_ok": sound,
            "status": flag_word(
                [
                    ca.logic_not(guard.inputs_ok),
                    ca.logic_not(guard.state_ok),
                    ca.logic_and(guard.inputs_ok, ca.fabs(wanted) > c.tau_range_Nm),
                    ca.logic_and(on, changed),
                ]
            ),
        }
        return next_state, outputs

    flags = (
        Flag("INPUT_INVALID", "an input was NaN or outside its range; the limits latch", True),
        Flag("STATE_REPAIRED", "the state was corrupt; the limits latch", True),
        Flag(
            "CLIPPED",
            "the set torque was clipped at tau_range_Nm",
            False,
            ("tau_set_Nm",),
            full_scale,
        ),
        Flag("ENTERED", "a law took over in this step, from where the torque was"),
    )
    facts = "impedance: the law of the mode that was left does not count"
    low, high = drive.theta_low_rad, drive.theta_high_rad
    offset_s, keep_s = sp.Symbol("o_k-1"), sp.Symbol("T_b")
    return Block.define(
        "reference",
        "Set torque from mode, wanted torque and impedance law",
        period_s=h,
        constants=(*device.constants("impedance"), *device.constants("domain")),
        tunables=(
            Tunable(
                "Kp_Nm_rad",
                kp.value,
                0.0,
                kp_high,
                "stiffness: higher pulls harder to the wanted angle",
                kp.source,
                kp.status,
            ),
            Tunable(
                "Kd_Nms_rad",
                kd.value,
                0.0,
                kd_high,
                "damping: higher resists motion other than the wanted one",
                kd.source,
                kd.status,
            ),
            Tunable(
                "blend_s",
                BLEND_S,
                BLEND_LOW_S,
                BLEND_HIGH_S,
                "time constant from the measured torque to a new law: longer is gentler",
                "a fifth of a second is felt as smooth and over before a movement is",
            ),
            Tunable(
                "tau_range_Nm",
                full_scale,
                0.01 * full_scale,
                full_scale,
                "largest |set torque|: may only be narrowed below the identified range",
                "domain.tau_full_scale_Nm",
            ),
        ),
        coefficients=(
            Port("Kp_Nm_rad", 0.0, kp_high, "stiffness", equation="(5.24)"),
            Port("Kd_Nms_rad", 0.0, kd_high, "damping", equation="(5.24)"),
            Port("keep", 0.0, 1.0, "share of the offset that a step keeps"),
            Port("tau_range_Nm", 0.0, full_scale, "largest |set torque|"),
        ),
        prepare=prepare,
        state=(
            Port("mode_last", OFF, IMPEDANCE, "mode of the last step"),
            Port("offset_Nm", -widest, widest, "from the law to where the torque was; " + facts),
            Port("tau_set_Nm", -full_scale, full_scale, "set torque of the last step"),
        ),
        inputs=(
            Port("mode", OFF, IMPEDANCE, "0 off, 1 torque, 2 impedance (rounded)"),
            Port("tau_desired_Nm", -tau_lim, tau_lim, "wanted interaction torque"),
            Port("theta_desired_rad", low, high, "wanted angle of the joint"),
            Port("omega_desired_rad_s", -omega_lim, omega_lim, "wanted rate of the joint"),
            Port("theta_load_rad", low, high, "load side's angle"),
            Port("omega_load_rad_s", -omega_lim, omega_lim, "load side's rate"),
            Port("tau_Nm", -tau_lim, tau_lim, "measured interaction torque on the load"),
        ),
        outputs=(
            Port("tau_set_Nm", -full_scale, full_scale, "set torque, for the inverse"),
            Port("mode", OFF, IMPEDANCE, "mode that holds in this step"),
            Port("request_ok", 0, 1, "1 while every input and the memory are sound"),
            Port("status", 0, 15, "what is known of this set torque", flags=flags),
        ),
        equations=(
            equation("(5.24), sign of a stiffness", "tau_law", IMPEDANCE_LAW, "impedance law"),
            equation(
                "[blend]",
                "tau_set",
                sp.Symbol("tau_law") + offset_s * sp.exp(-sp.Symbol("h") / keep_s),
                "offset from where the torque was at the change of mode, fading",
            ),
        ),
        step=step,
        streams=STREAMS,
    )


Kind = Literal["observer", "differences"]


def setpoint_rates(
    device: DeviceData, kind: Kind = "observer", *, bandwidth_Hz: float | None = None
) -> Block:
    """Rate and acceleration of the deflection set-point.

    Parameters
    ----------
    device : DeviceData
        A device with a drive.
    kind : {"observer", "differences"}
        ``observer``: a third-order tracking observer with a triple real pole, which follows a
        constant acceleration without error.  ``differences``: plain first and second difference,
        as printed.
    bandwidth_Hz : float, optional
        Default of the observer's tunable bandwidth.

    Returns
    -------
    Block
        Input ``theta_set_rad``, the inverse's set-point; outputs ``delta_set_rad``,
        ``delta_rate_rad_s``, ``delta_acc_rad_s2`` and a status word.

    Raises
    ------
    UserError
        When the device has no drive.
    ValueError
        For another kind.

    Notes
    -----
    The set-point carries no encoder noise, but it has corners: where the motion turns round, all
    stop operators of the inverse begin to move at once and the stiffness jumps.  A second
    difference makes spikes of these.  The observer gives angle, rate and acceleration that belong
    together, with one knob.
    """
    if kind not in get_args(Kind):
        raise ValueError(f"kind must be one of {get_args(Kind)}, got {kind!r}")
    drive = drive_of(device)
    h = device.period_s
    delta_lim, rate_lim = drive.delta_rad, drive.rate_rad_s
    # What the whole motor torque could do to the bare drive, three times over: a larger one is no
    # acceleration that the drive could follow.
    acc_lim = threshold(ACCELERATION_ROOM * drive.d4_rad_s2)
    return (_observer if kind == "observer" else _differences)(
        device, h, delta_lim, rate_lim, acc_lim, bandwidth_Hz
    )


ACCELERATION_ROOM = 3.0
SETPOINT_BANDWIDTH_HZ = 50.0


def _set_flags(rate_lim: float, acc_lim: float) -> tuple[Flag, ...]:
    return (
        Flag("INPUT_INVALID", "the set-point was NaN or outside its range; it is held", True),
        Flag("STATE_REPAIRED", "the state was corrupt; started afresh", True),
        Flag("RATE_CLIPPED", "the rate was clipped", True, ("delta_rate_rad_s",), rate_lim),
        Flag(
            "ACCELERATION_CLIPPED",
            "the acceleration was clipped",
            True,
            ("delta_acc_rad_s2",),
            acc_lim,
        ),
    )


def _set_ports(
    delta_lim: float, rate_lim: float, acc_lim: float, held: str
) -> tuple[tuple[Port, ...], tuple[Port, ...]]:
    inputs = (
        Port(
            "theta_set_rad",
            -delta_lim,
            delta_lim,
            "deflection set-point from the inverse",
            on_invalid=held,
        ),
    )
    outputs = (
        Port("delta_set_rad", -delta_lim, delta_lim, "deflection set-point"),
        Port("delta_rate_rad_s", -rate_lim, rate_lim, "its rate"),
        Port("delta_acc_rad_s2", -acc_lim, acc_lim, "its acceleration"),
        Port(
            "status",
            0,
            15,
            "what is known of this set-point",
            flags=_set_flags(rate_lim, acc_lim),
        ),
    )
    return inputs, outputs


def _observer(
    device: DeviceData,
    h: float,
    delta_lim: float,
    rate_lim: float,
    acc_lim: float,
    bandwidth_Hz: float | None,
) -> Block:
    high = 0.1 / h
    # The transient of a step over the whole range; an output is clipped, the memory is not.
    delta_room, rate_room = 2 * delta_lim, 4 * rate_lim
    acc_room = threshold(rate_room / h)

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        pole = ca.exp(-2 * math.pi * h * t.bandwidth_Hz)
        q = 1 - pole
        return {
            "alpha": 1 - pole * pole * pole,
            "beta_1_s": 1.5 * q * q * (1 + pole) / h,
            "gamma_1_s2": q * q * q / (h * h),
        }

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        expected = s.delta_rad + h * (s.rate_rad_s + 0.5 * h * s.acc_rad_s2)
        ok = guard.inputs_ok
        predicted = label(
            "predicted_rad", ca.if_else(s.primed, expected, u.theta_set_rad), "prediction"
        )
        error = label("innovation_rad", u.theta_set_rad - predicted, "innovation")
        rate = s.rate_rad_s + h * s.acc_rad_s2 + c.beta_1_s * error
        acc = s.acc_rad_s2 + c.gamma_1_s2 * error
        # Held: a set-point that stands still where the last valid one was.
        next_delta = label(
            "delta_raw_rad", ca.if_else(ok, predicted + c.alpha * error, s.held_rad), "filtered"
        )
        next_rate = label("rate_raw_rad_s", ca.if_else(ok, rate, 0), "its rate")
        next_acc = label("acc_raw_rad_s2", ca.if_else(ok, acc, 0), "its acceleration")
        next_state = {
            "primed": ca.logic_or(s.primed, ok),
            "held_rad": u.theta_set_rad,
            "delta_rad": clip(next_delta, -delta_room, delta_room),
            "rate_rad_s": clip(next_rate, -rate_room, rate_room),
            "acc_rad_s2": clip(next_acc, -acc_room, acc_room),
        }
        outputs = {
            "delta_set_rad": clip(next_delta, -delta_lim, delta_lim),
            "delta_rate_rad_s": clip(next_rate, -rate_lim, rate_lim),
            "delta_acc_rad_s2": clip(next_acc, -acc_lim, acc_lim),
            "status": flag_word(
                [
                    ca.logic_not(ok),
                    ca.logic_not(guard.state_ok),
                    ca.fabs(next_rate) > rate_lim,
                    ca.fabs(next_acc) > acc_lim,
                ]
            ),
        }
        return next_state, outputs

    inputs, outputs = _set_ports(delta_lim, rate_lim, acc_lim, "held_rad")
    e, p, q, hs = sp.symbols("e p q h")
    return Block.define(
        "setpoint_rates",
        "Rate and acceleration of the deflection set-point: tracking observer",
        period_s=h,
        constants=device.constants("timing"),
        tunables=(
            Tunable(
                "bandwidth_Hz",
                min(bandwidth_Hz or SETPOINT_BANDWIDTH_HZ, high),
                2.0,
                high,
                "bandwidth of the triple pole: higher follows faster, lower smooths the corners",
                "docs/control.md",
            ),
        ),
        coefficients=(
            Port("alpha", 0.0, 1.0, "position gain"),
            Port("beta_1_s", 0.0, 3.0 / h, "velocity gain"),
            Port("gamma_1_s2", 0.0, 1.0 / h**2, "acceleration gain"),
        ),
        prepare=prepare,
        state=(
            Port("primed", 0.0, 1.0, "1 once a valid sample has been seen"),
            Port("held_rad", -delta_lim, delta_lim, "last valid set-point"),
            Port("delta_rad", -delta_room, delta_room, "filtered set-point"),
            Port("rate_rad_s", -rate_room, rate_room, "its rate"),
            Port("acc_rad_s2", -acc_room, acc_room, "its acceleration"),
        ),
        inputs=inputs,
        outputs=outputs,
        equations=(
            equation("[set 1]", "alpha", 1 - p**3, "position gain; p the pole, q = 1 - p"),
            equation("[set 2]", "beta", sp.Rational(3, 2) * q**2 * (1 + p) / hs, "rate gain"),
            equation("[set 3]", "gamma", q**3 / hs**2, "acceleration gain"),
            equation("[set 4]", "delta", sp.Symbol("delta_p") + sp.Symbol("alpha") * e, "update"),
        ),
        step=step,
    )


def _differences(
    device: DeviceData,
    h: float,
    delta_lim: float,
    rate_lim: float,
    acc_lim: float,
    bandwidth_Hz: float | None,
) -> Block:
    if bandwidth_Hz is not None:
        raise ValueError("plain differences have no bandwidth_Hz")

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        ok = guard.inputs_ok
        raw = ca.if_else(s.primed, (u.theta_set_rad - s.delta_rad) * (1 / h), 0)
        rate = label("delta_rate_rad_s", clip(raw, -rate_lim, rate_lim), "first difference")
        change = ca.if_else(s.moving, (rate - s.rate_rad_s) * (1 / h), 0)
        acc = label("delta_acc_rad_s2", clip(change, -acc_lim, acc_lim), "second difference")
        next_state = {
            "primed": ca.logic_or(s.primed, ok),
            "moving": s.primed,
            "delta_rad": u.theta_set_rad,
            "rate_rad_s": rate,
        }
        outputs = {
            "delta_set_rad": u.theta_set_rad,
            "delta_rate_rad_s": rate,
            "delta_acc_rad_s2": acc,
            "status": flag_word(
                [
                    ca.logic_not(ok),
                    ca.logic_not(guard.state_ok),
                    ca.fabs(raw) > rate_lim,
                    ca.fabs(change) > acc_lim,
                ]
            ),
        }
        return next_state, outputs

    inputs, outputs = _set_ports(delta_lim, rate_lim, acc_lim, "delta_rad")
    d_k, d_1, d_2, hs = (sp.Symbol(n) for n in ("delta_k", "delta_k-1", "delta_k-2", "h"))
    return Block.define(
        "setpoint_rates",
        "Rate and acceleration of the deflection set-point: plain differences",
        period_s=h,
        constants=device.constants("timing"),
        state=(
            Port("primed", 0.0, 1.0, "1 once a valid sample has been seen"),
            Port("moving", 0.0, 1.0, "1 once a rate is known"),
            Port("delta_rad", -delta_lim, delta_lim, "set-point of the last step"),
            Port("rate_rad_s", -rate_lim, rate_lim, "rate of the last step"),
        ),
        inputs=inputs,
        outputs=outputs,
        equations=(
            equation("[set 1]", "delta'", (d_k - d_1) / hs, "first difference"),
            equation("[set 2]", "delta''", (d_k - 2 * d_1 + d_2) / hs**2, "second difference"),
        ),
        step=step,
    )
