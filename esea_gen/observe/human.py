"""Torque of the person on the load side: first-order lag (5.10), and extended-state observer."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
import sympy as sp

from esea_gen.errors import UserError
from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Array, Flag, Port, Tunable, clip, flag_word, threshold
from esea_gen.model.symbolic import equation
from esea_gen.observe import drive_of
from esea_gen.observe.disturbance import bandwidth_tunable, share_of

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

# The decay of the torque's rate may be tuned by this factor either way.
DECAY_FACTOR = 5.0
# Slowest error mode that a set of gains may have, as a share of a step: 1 is the border.
SLOWEST_POLE = 0.9999


def lag_observer(device: DeviceData) -> Block:
    """Torque of the person in momentum form, a first-order lag (5.10).

    Parameters
    ----------
    device : DeviceData
        A device with a drive.

    Returns
    -------
    Block
        Inputs ``omega_load_rad_s`` and ``tau_Nm``; outputs ``tau_h_Nm`` and a status word.

    Raises
    ------
    UserError
        When the device has no drive, or the bandwidth is above what the velocity filter allows.

    Notes
    -----
    As :func:`esea_gen.observe.disturbance.drive_observer`, on the load side's (5.3).  In float32
    an increment below half a unit in the last place is lost, so that the estimate stops short of
    its end by up to 2^-25 of its size over L h: at 0.25 1/s and 1 kHz 1.2e-4 of the torque.
    """
    drive = drive_of(device)
    h = device.period_s
    inertia = drive.joint.Jh_kgm2.value
    tau_lim, tau_h_lim, omega_lim = drive.tau_Nm, drive.tau_h_Nm, drive.omega_rad_s

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        return {"share": share_of(t.bandwidth_1_s, h)}

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        ok = guard.inputs_ok
        ready = label("ready", ca.logic_and(ok, s.primed), "two valid samples in a row")
        rise = (u.omega_load_rad_s - s.omega_last_rad_s) * (inertia / h)
        model = label("model_Nm", 0.5 * (u.tau_Nm + s.tau_last_Nm), "(5.3) mean over the step")
        moved = s.tau_h_Nm + c.share * (rise - model - s.tau_h_Nm)
        tau_h = label(
            "tau_h_Nm",
            ca.if_else(ready, clip(moved, -tau_h_lim, tau_h_lim), s.tau_h_Nm),
            "(5.10)",
        )
        next_state = {
            "primed": ok,
            "omega_last_rad_s": u.omega_load_rad_s,
            "tau_last_Nm": u.tau_Nm,
            "tau_h_Nm": tau_h,
        }
        outputs = {
            "tau_h_Nm": tau_h,
            "status": flag_word(
                [
                    ca.logic_not(ok),
                    ca.logic_not(guard.state_ok),
                    ca.logic_and(ready, ca.fabs(moved) > tau_h_lim),
                ]
            ),
        }
        return next_state, outputs

    flags = (
        Flag("INPUT_INVALID", "an input was NaN or outside its range; tau_h is held", True),
        Flag("STATE_REPAIRED", "the state was corrupt; the observer was started afresh", True),
        Flag("CLIPPED", "the estimate was clipped at its range", True, ("tau_h_Nm",), tau_h_lim),
    )
    tau_p, h_s, bandwidth = sp.Symbol("tau_h,k-1"), sp.Symbol("h"), sp.Symbol("L")
    rise_s = (sp.Symbol("omega_l,k") - sp.Symbol("omega_l,k-1")) / h_s
    unexplained = sp.Symbol("J_h") * rise_s - sp.Symbol("tau_e") - tau_p
    return Block.define(
        "human_lag",
        "Torque of the person: first-order lag",
        period_s=h,
        constants=device.constants("joint"),
        tunables=(
            bandwidth_tunable(
                device,
                drive.disturbance.human_1_s,
                drive.joint.load_velocity_Hz,
                "disturbance.human_1_s",
                "joint.load_velocity_Hz",
            ),
        ),
        coefficients=(Port("share", 0.0, 1.0, "taken up in one step", equation="(5.10)"),),
        prepare=prepare,
        state=(
            Port("primed", 0.0, 1.0, "1 when the last sample was valid"),
            Port("omega_last_rad_s", -omega_lim, omega_lim, "load side's rate, last step"),
            Port("tau_last_Nm", -tau_lim, tau_lim, "interaction torque, last step"),
            Port("tau_h_Nm", -tau_h_lim, tau_h_lim, "torque of the person", equation="(5.10)"),
        ),
        inputs=(
            Port(
                "omega_load_rad_s",
                -omega_lim,
                omega_lim,
                "load side's rate",
                on_invalid="omega_last_rad_s",
            ),
            Port(
                "tau_Nm",
                -tau_lim,
                tau_lim,
                "interaction torque on the load",
                on_invalid="tau_last_Nm",
            ),
        ),
        outputs=(
            Port("tau_h_Nm", -tau_h_lim, tau_h_lim, "torque of the person", equation="(5.10)"),
            Port("status", 0, 7, "what is known of this estimate", flags=flags),
        ),
        equations=(
            equation("(5.3)", "J_h omega_l'", sp.Symbol("tau_e") + sp.Symbol("tau_h"), "load side"),
            equation(
                "(5.10)",
                "tau_h,k",
                tau_p + (1 - sp.exp(-bandwidth * h_s)) * unexplained,
                "torque of the person: a lag of bandwidth L",
            ),
        ),
        step=step,
    )


def error_matrix(device: DeviceData, decay_s: float | None = None) -> Array:
    """How the extended-state observer's error goes on from step to step.

    Parameters
    ----------
    device : DeviceData
        A device with a drive.
    decay_s : float, optional
        Decay of the torque's rate, seconds; the device's when not given.

    Returns
    -------
    ndarray
        Shape (4, 4): error after a correction, from the error after the last one; the order is
        angle, rate, torque, rate of the torque.
    """
    drive = drive_of(device)
    d = drive.disturbance
    decay = d.decay_s.value if decay_s is None else decay_s
    h, inertia = device.period_s, drive.joint.Jh_kgm2.value
    keep = math.exp(-h / decay)
    model = np.eye(4)
    model[0, 1:3] = h, h * h / (2 * inertia)
    model[1, 2] = h / inertia
    model[2, 3] = decay * (1 - keep)
    model[3, 3] = keep
    gains = (d.gain_theta, d.gain_omega_1_s, d.gain_tau_Nm_rad, d.gain_rate_Nm_s_rad)
    correction = np.eye(4)
    correction[:, 0] -= [g.value for g in gains]
    return np.asarray(correction @ model)


def extended_state(device: DeviceData) -> Block:
    """Torque of the person, its rate, and the load side's motion, by an extended-state observer.

    Parameters
    ----------
    device : DeviceData
        A device with a drive.

    Returns
    -------
    Block
        Inputs ``theta_load_rad`` and ``tau_Nm``; outputs ``tau_h_Nm``, ``tau_h_rate_Nm_s``,
        ``omega_load_rad_s``, ``theta_load_est_rad`` and a status word.

    Raises
    ------
    UserError
        When the device has no drive, or the gains let an error grow or stay for some decay that
        may be tuned.

    Notes
    -----
    Four states: angle, rate, torque of the person, its rate, which decays with its time constant.
    Each step corrects the prediction by steady gains on the encoder's innovation, and predicts the
    next step with the torque measured now.  Without a valid angle it predicts only: the rate of the
    torque decays, and the torque comes to rest.
    """
    drive = drive_of(device)
    d = drive.disturbance
    h, inertia = device.period_s, drive.joint.Jh_kgm2.value
    tau_lim, tau_h_lim, omega_lim = drive.tau_Nm, drive.tau_h_Nm, drive.omega_rad_s
    decay = d.decay_s
    decay_low, decay_high = decay.value / DECAY_FACTOR, decay.value * DECAY_FACTOR
    for value in (decay_low, decay.value, decay_high):
        slowest = float(np.max(np.abs(np.linalg.eigvals(error_matrix(device, value)))))
        if slowest > SLOWEST_POLE:
            raise UserError(
                f"{device.origin}: disturbance.gain_...: with a decay of {value:g} s an error of "
                f"the extended-state observer is multiplied by {slowest:.5f} a step; the limit is "
                f"{SLOWEST_POLE:g}.",
                "Raise gain_theta and gain_omega_1_s or lower gain_tau_Nm_rad and "
                "gain_rate_Nm_s_rad.",
            )
    gain = {
        "theta": d.gain_theta.value,
        "omega": d.gain_omega_1_s.value,
        "tau": d.gain_tau_Nm_rad.value,
        "rate": d.gain_rate_Nm_s_rad.value,
    }
    # What the largest torque could rise by within the shortest decay.
    rate_lim = threshold(2 * tau_h_lim / decay_low)
    # A prediction may lie beyond what is given out, by a step of the fastest motion.
    omega_room, tau_room = threshold(1.01 * omega_lim), threshold(1.01 * tau_h_lim)

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        keep = ca.exp(-h / t.decay_s)
        return {"keep": keep, "reach_s": t.decay_s * (1 - keep)}

    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        seen = guard.inputs_ok
        predicted = ca.if_else(s.primed, s.theta_rad, u.theta_load_rad)
        innovation = label(
            "innovation_rad",
            ca.if_else(seen, u.theta_load_rad - predicted, 0),
            "encoder less prediction; 0 without a valid sample",
        )
        theta = clip(
            predicted + gain["theta"] * innovation, drive.theta_low_rad, drive.theta_high_rad
        )
        omega_raw = s.omega_rad_s + gain["omega"] * innovation
        tau_raw = s.tau_h_Nm + gain["tau"] * innovation
        rate_raw = s.rate_Nm_s + gain["rate"] * innovation
        omega = label("omega_load_rad_s", clip(omega_raw, -omega_lim, omega_lim), "corrected")
        tau_h = label("tau_h_Nm", clip(tau_raw, -tau_h_lim, tau_h_lim), "corrected")
        rate = label("tau_h_rate_Nm_s", clip(rate_raw, -rate_lim, rate_lim), "corrected")
        acceleration = label("acceleration_rad_s2", (u.tau_Nm + tau_h) * (1 / inertia), "(5.3)")
        start = ca.logic_or(s.primed, seen)
        following = clip(
            theta + h * (omega + 0.5 * h * acceleration),
            drive.theta_low_rad,
            drive.theta_high_rad,
        )
        next_state = {
            "primed": start,
            "theta_rad": following,
            "omega_rad_s": ca.if_else(
                start, clip(omega + h * acceleration, -omega_room, omega_room), 0
            ),
            "tau_h_Nm": ca.if_else(start, clip(tau_h + c.reach_s * rate, -tau_room, tau_room), 0),
            "rate_Nm_s": ca.if_else(start, c.keep * rate, 0),
            "tau_last_Nm": u.tau_Nm,
        }
        outputs = {
            "tau_h_Nm": tau_h,
            "tau_h_rate_Nm_s": rate,
            "omega_load_rad_s": omega,
            "theta_load_est_rad": theta,
            "status": flag_word(
                [
                    ca.logic_not(seen),
                    ca.logic_not(guard.state_ok),
                    ca.fabs(omega_raw) > omega_lim,
                    ca.fabs(tau_raw) > tau_h_lim,
                    ca.fabs(rate_raw) > rate_lim,
                ]
            ),
        }
        return next_state, outputs

    flags = (
        Flag(
            "INPUT_INVALID",
            "an input was NaN or outside its range; the observer predicts without correction",
            True,
        ),
        Flag("STATE_REPAIRED", "the state was corrupt; the observer was started afresh", True),
        *(
            Flag(f"{word}_CLIPPED", f"the {what} was clipped at its range", True, (name,), limit)
            for word, what, name, limit in (
                ("OMEGA", "load side's rate", "omega_load_rad_s", omega_lim),
                ("TORQUE", "torque of the person", "tau_h_Nm", tau_h_lim),
                ("TORQUE_RATE", "rate of that torque", "tau_h_rate_Nm_s", rate_lim),
            )
        ),
    )
    x, v, a, r, nu, h_s, t_d = sp.symbols("theta_l omega_l tau_h rho nu h T_d")
    tau_e, jh = sp.symbols("tau_e J_h")
    l1, l2, l3, l4 = sp.symbols("l_1 l_2 l_3 l_4")
    return Block.define(
        "human_eso",
        "Torque of the person: extended-state observer",
        period_s=h,
        constants=(
            *device.constants("joint"),
            *(k for k in device.constants("disturbance") if k.name.startswith("gain_")),
        ),
        tunables=(
            Tunable(
                "decay_s",
                decay.value,
                decay_low,
                decay_high,
                "decay of the torque's rate: longer trusts a rate longer and overshoots more",
                decay.source,
                decay.status,
            ),
        ),
        coefficients=(
            Port("keep", 0.0, 1.0, "share of the torque's rate that a step keeps"),
            Port("reach_s", 0.0, h, "torque gained in a step, per rate"),
        ),
        prepare=prepare,
        state=(
            Port("primed", 0.0, 1.0, "1 once a valid sample has been seen"),
            Port("theta_rad", drive.theta_low_rad, drive.theta_high_rad, "predicted angle"),
            Port("omega_rad_s", -omega_room, omega_room, "predicted rate"),
            Port("tau_h_Nm", -tau_room, tau_room, "predicted torque"),
            Port("rate_Nm_s", -rate_lim, rate_lim, "predicted rate of the torque"),
            Port("tau_last_Nm", -tau_lim, tau_lim, "interaction torque, last step"),
        ),
        inputs=(
            Port(
                "theta_load_rad",
                drive.theta_low_rad,
                drive.theta_high_rad,
                "load side's angle",
                on_invalid="theta_rad",
            ),
            Port(
                "tau_Nm",
                -tau_lim,
                tau_lim,
                "interaction torque on the load",
                on_invalid="tau_last_Nm",
            ),
        ),
        outputs=(
            Port("tau_h_Nm", -tau_h_lim, tau_h_lim, "torque of the person"),
            Port("tau_h_rate_Nm_s", -rate_lim, rate_lim, "its rate"),
            Port("omega_load_rad_s", -omega_lim, omega_lim, "load side's rate"),
            Port(
                "theta_load_est_rad",
                drive.theta_low_rad,
                drive.theta_high_rad,
                "load side's angle, corrected",
            ),
            Port("status", 0, 31, "what is known of this estimate", flags=flags),
        ),
        equations=(
            equation("[eso 1]", "nu", sp.Symbol("theta_enc") - x, "innovation"),
            equation("[eso 2]", "theta_l", x + l1 * nu, "angle, corrected"),
            equation("[eso 3]", "omega_l", v + l2 * nu, "rate, corrected"),
            equation("[eso 4]", "tau_h", a + l3 * nu, "torque of the person, corrected"),
            equation("[eso 5]", "rho", r + l4 * nu, "its rate, corrected"),
            equation(
                "[eso 6]",
                "theta_l,k+1",
                x + h_s * v + h_s**2 * (tau_e + a) / (2 * jh),
                "prediction",
            ),
            equation("[eso 7]", "omega_l,k+1", v + h_s * (tau_e + a) / jh, "prediction (5.3)"),
            equation("[eso 8]", "tau_h,k+1", a + t_d * (1 - sp.exp(-h_s / t_d)) * r, "prediction"),
            equation("[eso 9]", "rho_k+1", sp.exp(-h_s / t_d) * r, "prediction"),
        ),
        step=step,
    )
