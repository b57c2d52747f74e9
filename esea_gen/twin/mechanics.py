"""Mechanics of the plant's bodies, symbolically: torques and one integration step."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.language.block import Labels
from esea_gen.twin.encoders import sine_of_turns
from esea_gen.twin.parameters import SINES

NOT_TRIPPED, TRIPPED_SPEED, TRIPPED_TORQUE = 0, 1, 2
WORKS = ("motor", "loss", "elastomer", "person", "disturbance")


def contact(over: ca.SX, rate: ca.SX, stiffness: ca.SX, damping: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Torque of a spring and damper that only push, and the slope of the damper while they do."""
    raw = stiffness * over + damping * rate
    pushes = raw * over > 0
    return ca.if_else(pushes, raw, 0), ca.if_else(pushes, damping, 0)


def beyond(x: ca.SX, low: Any, high: Any) -> ca.SX:
    """How far outside of a range, with its sign; 0 inside."""
    return ca.SX(ca.fmax(x - high, 0) + ca.fmin(x - low, 0))


def limb_torques(c: Any, s: Any, u: Any, x_l: ca.SX, v_l: ca.SX) -> SimpleNamespace:
    """Torques on the load beside the coupling (5.3); ``slope`` and ``d_end`` over its speed.

    ``end`` is how far the joint is beyond its range.
    """
    noise = c.noise_decay * s.noise_Nm + c.noise_gain_Nm * u.noise
    turn = 1 / (2 * math.pi)
    feed = (
        c.Jh_kgm2 * u.alpha_p_rad_s2
        + c.own_damping_Nms_rad * u.omega_p_rad_s
        + c.gravity_Nm * sine_of_turns(turn * u.theta_p_rad)
    )
    held = (
        c.spring_Nm_rad * (u.theta_p_rad - x_l)
        + c.damping_Nms_rad * (u.omega_p_rad_s - v_l)
        + c.feedforward * feed
        - c.own_damping_Nms_rad * v_l
        - c.gravity_Nm * sine_of_turns(turn * x_l)
        + noise
    )
    end = beyond(x_l, c.joint_min_rad, c.joint_max_rad)
    tau_end, d_end = contact(end, v_l, c.joint_stop_Nm_rad, c.joint_stop_Nms_rad)
    slope = c.damping_Nms_rad + c.own_damping_Nms_rad
    return SimpleNamespace(
        held=held, slope=slope, noise=noise, end=end, tau_end=tau_end, d_end=d_end
    )


def move_load(
    c: Any, s: Any, u: Any, tau_e: ca.SX, x_l: ca.SX, v_l: ca.SX, q: float, label: Labels
) -> SimpleNamespace:
    """Load and person under the true torque, friction implicit (5.3)."""
    limb = limb_torques(c, s, u, x_l, v_l)
    a = label(
        "a_l",
        c.free * (tau_e + limb.held - limb.tau_end) / (c.Jh_kgm2 + q * (limb.slope + limb.d_end)),
        "(5.3), friction implicit",
    )
    tau_h = label("tau_h", limb.held - limb.slope * (q * a), "the person, at the end of the step")
    return moved_load(limb, a, v_l + q * a, tau_h)


def moved_load(limb: SimpleNamespace, a: ca.SX, w: ca.SX, tau_h: ca.SX) -> SimpleNamespace:
    """Load side and person at the end of the step."""
    return SimpleNamespace(**vars(limb) | {"a": a, "w": w, "tau_h": tau_h})


def gear_torques(c: Any, x_g: ca.SX, v_g: ca.SX, drive_Nm: ca.SX, label: Labels) -> SimpleNamespace:
    """Disturbance, friction with its slope, and the drive's remaining torque (5.2)."""
    d4 = ca.SX(0)
    for i in range(SINES):
        d4 = d4 + sine_of_turns(c.wave_turns[i] * x_g + c.phase_turns[i])
    d4 = label("d4_rad_s2", c.d4_amplitude_rad_s2 * d4, "(5.2)")
    smooth = ca.tanh(v_g / c.coulomb_width_rad_s)
    slope = c.fv_Nms_rad + c.fc_Nm * (1 - smooth * smooth) / c.coulomb_width_rad_s
    friction = c.fv_Nms_rad * v_g + c.fc_Nm * smooth
    free = drive_Nm + c.J_kgm2 * d4 - friction
    return SimpleNamespace(d4=d4, friction=friction, slope=slope, free=free)


def move_with_cable(
    c: Any, gear: Any, wound: ca.SX, v_g: ca.SX, v_m: ca.SX, tau_e: ca.SX, q: float, label: Labels
) -> SimpleNamespace:
    """Gear and motor-side part at the end of the step, a cable that is wound up between them.

    With the power lost and the energy held between them.
    """
    gap = beyond(wound, -0.5 * c.cable_backlash_rad, 0.5 * c.cable_backlash_rad)
    tau_c, d_c = contact(gap, v_g - v_m, c.cable_stiffness_Nm_rad, c.cable_damping_Nms_rad)
    label("tau_cable_Nm", tau_c, "between gear and motor-side part")
    rub = ca.tanh(v_m / c.cable_loss_width_rad_s)
    lost = c.cable_loss * ca.fabs(tau_c)
    # What of a change of the cable's torque reaches the motor-side part.
    d_m = d_c * (1 - c.cable_loss * rub * ca.sign(tau_c))
    slope_m = c.motor_side_damping_Nms_rad + lost * (1 - rub * rub) / c.cable_loss_width_rad_s
    f_g = gear.free - tau_c
    f_m = tau_c - lost * rub - c.motor_side_damping_Nms_rad * v_m - tau_e
    m_g = c.J_kgm2 + q * (gear.slope + d_c)
    m_m = c.motor_side_inertia_kgm2 + q * (slope_m + d_m)
    share = 1 / (m_g * m_m - q * q * d_c * d_m)
    a_g = label("a_g", (f_g * m_m + q * d_c * f_m) * share, "(5.2), friction implicit")
    a_m = label("a_m", (f_m * m_g + q * d_m * f_g) * share, "motor-side part")
    w_g, w_m = v_g + q * a_g, v_m + q * a_m
    spring = c.cable_stiffness_Nm_rad * gap
    end_c = tau_c + d_c * (q * (a_g - a_m))
    loss = w_m * (lost * rub + slope_m * (q * a_m) + c.motor_side_damping_Nms_rad * v_m) + (
        end_c - spring
    ) * (w_g - w_m)
    kinetic = c.motor_side_inertia_kgm2 * w_m * w_m + spring * gap
    return SimpleNamespace(a_g=a_g, a_m=a_m, w_g=w_g, w_m=w_m, loss=loss, kinetic=kinetic)


def move_rigidly(
    c: Any, gear: Any, v_m: ca.SX, tau_e: ca.SX, q: float, label: Labels
) -> SimpleNamespace:
    """One inertia in place of gear and motor-side part."""
    a = label("a_m", (gear.free - tau_e) / (c.J_kgm2 + q * gear.slope), "(5.2), friction implicit")
    w = v_m + q * a
    none = ca.SX(0)
    return SimpleNamespace(a_g=a, a_m=a, w_g=w, w_m=w, loss=none, kinetic=none)


def trip(c: Any, s: Any, u_a: ca.SX, w_g: ca.SX, label: Labels) -> tuple[ca.SX, ca.SX]:
    """Smoothed square of the torque, and whether the drive has tripped."""
    heat = s.heat + c.heat_share * (u_a * u_a - s.heat)
    hot = ca.if_else(heat > c.trip_torque_Nm * c.trip_torque_Nm, TRIPPED_TORQUE, NOT_TRIPPED)
    fresh = ca.if_else(ca.fabs(w_g) > c.trip_speed_rad_s, TRIPPED_SPEED, hot)
    return heat, label("tripped_next", ca.if_else(s.tripped > 0, s.tripped, fresh))


def powers(
    c: Any, drive_Nm: ca.SX, coupling: Any, load: Any, gear: Any, moved: Any, q: float
) -> dict[str, ca.SX]:
    """Powers in W at the end of the step, by source; ``q`` is half a step."""
    return {
        "motor": drive_Nm * moved.w_g,
        "loss": moved.loss
        + moved.w_g * (gear.friction + gear.slope * (q * moved.a_g))
        + (coupling.tau_jaw - c.coupling_stop_Nm_rad * coupling.jaw) * (moved.w_m - load.w)
        + (load.tau_end - c.joint_stop_Nm_rad * load.end) * load.w,
        "elastomer": coupling.rubber * (moved.w_m - load.w),
        "person": load.tau_h * load.w,
        "disturbance": c.J_kgm2 * gear.d4 * moved.w_g,
    }


def stored_J(c: Any, coupling: Any, load: Any, moved: Any) -> Any:
    """Kinetic energy, and that of cable and stops."""
    return 0.5 * (
        c.J_kgm2 * moved.w_g * moved.w_g
        + moved.kinetic
        + c.Jh_kgm2 * load.w * load.w
        + c.coupling_stop_Nm_rad * coupling.jaw * coupling.jaw
        + c.joint_stop_Nm_rad * load.end * load.end
    )
