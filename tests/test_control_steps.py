"""Blocks between a set-point and a command, typed a second time in NumPy: single steps, any memory.

Every next state, output and flag, at the edges of ranges and beyond, with any tunables; numbers of
the drive are those of ``elbow_drive.toml``, typed by hand.  What a step of the limits and of the
trend does is typed in ``limits_model.py`` and ``test_trend.py``.
"""

from __future__ import annotations

from math import exp, pi

import numpy as np
import pytest

from esea_gen.control.law_switch import law_switch
from esea_gen.control.limits.block import command_stamp
from esea_gen.control.limits.redundancy import redundancy
from esea_gen.control.setpoint import setpoint_rates
from esea_gen.control.sliding_mode.controller import sliding_mode
from esea_gen.control.sliding_mode.governor import smoothed_setpoint, torque_lead
from esea_gen.device import parse_device

from .single_steps import COUNT, Steps, word
from .test_sliding_mode import PUBLISHED

where, clip, sign = np.where, np.clip, np.sign
H, TS = 1e-3, 5e-3
FULL, SPEED, U, RATE = 4.47, 12.0, 0.221, 25.0  # largest of each
N, J, FV, FC, WIDTH, LAG_S, JH = 74.0, 0.663, 0.5551, 0.4688, 0.05, 0.03488, 0.22
BENT, D4 = 0.35, N * U / J
ACC = 3 * D4


# -- set-point -------------------------------------------------------------------------------------


def test_a_step_of_the_torque_lead(drive):
    run = Steps(torque_lead(drive))
    s, u = run.s, run.u
    acts = run.ok & (u.mode > 0.5) & (u.mode < 1.5)
    keep = exp(-H / 0.1)
    slow = np.minimum((1 - keep) * where(acts, run.t.share * u.trust, 0) + keep * s.slow, 1)
    governed = np.minimum(slow, u.settled)
    # A rate and an acceleration that fade over 1 s, 70 ms on.
    by_rate = 1 - exp(-0.07)
    motion = by_rate * u.tau_rate_Nm_s + (by_rate - 0.07 * exp(-0.07)) * u.tau_curve_Nm_s2
    run.compare(
        {
            "next_slow": slow,
            "next_tau_set_Nm": u.tau_set_Nm,
            "y_tau_led_Nm": clip(u.tau_set_Nm + governed * motion, -FULL, FULL),
            "y_governed": governed,
            "y_status": word(~run.ok, ~run.whole),
        }
    )


def test_a_step_of_the_smoothed_set_point(drive):
    run = Steps(smoothed_setpoint(drive))
    s, u = run.s, run.u
    sound = run.ok & (s.primed != 0)
    lag, last, lags = 0.07 / 3, u.theta_set_rad, []
    for kept in (s.first_rad, s.second_rad, s.third_rad):
        moved = last + exp(-H / lag) * (kept - last)
        last = where(sound & (u.governed > 0.01), moved, u.theta_set_rad)
        lags.append(last)
    share = where(sound, 0.999 * u.governed, 0)

    def mixed(plain, smooth):
        return (1 - share) * plain + share * smooth

    first, second, third = lags
    rate, acc = (second - third) / lag, (first - 2 * second + third) / lag**2
    run.compare(
        {
            "next_primed": (s.primed != 0) | run.ok,
            "next_first_rad": first,
            "next_second_rad": second,
            "next_third_rad": third,
            "y_delta_set_rad": mixed(u.delta_set_rad, third),
            "y_delta_rate_rad_s": clip(mixed(u.delta_rate_rad_s, rate), -RATE, RATE),
            "y_delta_acc_rad_s2": clip(mixed(u.delta_acc_rad_s2, acc), -ACC, ACC),
            "y_theta_smooth_rad": mixed(u.theta_set_rad, third),
            "y_status": word(~run.ok, ~run.whole),
        }
    )


def test_a_step_of_the_set_points_observer(drive):
    """Three poles at one place, predicted exactly for an acceleration that stays."""
    run = Steps(setpoint_rates(drive))
    s, u, ok = run.s, run.u, run.ok
    p = np.exp(-2 * pi * H * run.t.bandwidth_Hz)
    predicted = s.delta_rad + H * s.rate_rad_s + H * H / 2 * s.acc_rad_s2
    predicted = where(s.primed != 0, predicted, u.theta_set_rad)
    error = u.theta_set_rad - predicted
    angle = where(ok, predicted + (1 - p**3) * error, s.held_rad)
    rate = s.rate_rad_s + H * s.acc_rad_s2 + 1.5 * (1 - p) ** 2 * (1 + p) / H * error
    rate, acc = where(ok, rate, 0), where(ok, s.acc_rad_s2 + ((1 - p) / H) ** 3 * H * error, 0)
    clipped = (abs(rate) > RATE) | (abs(angle) > 2 * BENT)
    run.compare(
        {
            "next_primed": (s.primed != 0) | ok,
            "next_held_rad": u.theta_set_rad,
            "next_delta_rad": clip(angle, -2 * BENT, 2 * BENT),
            "next_rate_rad_s": clip(rate, -4 * RATE, 4 * RATE),
            "next_acc_rad_s2": clip(acc, -4 * RATE / H, 4 * RATE / H),
            "y_delta_set_rad": clip(angle, -BENT, BENT),
            "y_delta_rate_rad_s": clip(rate, -RATE, RATE),
            "y_delta_acc_rad_s2": clip(acc, -ACC, ACC),
            "y_status": word(~ok, ~run.whole, clipped, abs(acc) > ACC),
        }
    )


def test_a_step_of_plain_differences(drive):
    def together(s, u, rng):
        u["theta_set_rad"][:] = clip(s["delta_rad"] + rng.normal(0, 0.01, COUNT), -0.34, 0.34)

    run = Steps(setpoint_rates(drive, "differences"), together=together)
    s, u = run.s, run.u
    raw = where(s.primed != 0, (u.theta_set_rad - s.delta_rad) / H, 0)
    rate = clip(raw, -RATE, RATE)
    change = where(s.moving != 0, (rate - s.rate_rad_s) / H, 0)
    run.compare(
        {
            "next_primed": (s.primed != 0) | run.ok,
            "next_moving": s.primed,
            "next_delta_rad": u.theta_set_rad,
            "next_rate_rad_s": rate,
            "y_delta_set_rad": u.theta_set_rad,
            "y_delta_rate_rad_s": rate,
            "y_delta_acc_rad_s2": clip(change, -ACC, ACC),
            "y_status": word(~run.ok, ~run.whole, abs(raw) > RATE, abs(change) > ACC),
        }
    )


# -- command ---------------------------------------------------------------------------------------


def held_together(s, u, rng):
    """The command that is applied is one of the last two, or nearly; the error is often small."""
    kind = rng.integers(5, size=COUNT)
    last, before = s["u_last_Nm"], s["u_before_Nm"]
    near = rng.choice([1.0, -1.0, 0.0], COUNT) * rng.choice([0.9e-3, 1.1e-3], COUNT) * U
    applied = np.select([kind == 0, kind == 1], [last, before], u["u_applied_Nm"]) + near
    u["u_applied_Nm"][:] = clip(applied, -0.2209, 0.2209)
    k = rng.random(COUNT) < 0.7
    for values in (s, u):
        for name in set(values) - {"mode", "active", "u_applied_Nm", "u_last_Nm", "u_before_Nm"}:
            if name not in ("soft", "square"):
                values[name][k] *= 0.02
    if "square" in s:
        s["square"][:] = rng.uniform(0.2, 0.5, COUNT)


@pytest.mark.parametrize("published", [False, True])
def test_a_step_of_the_sliding_mode(drive, published):
    """(5.12) to (5.22), friction ahead, lead, entry, the integral's rest, and what softens."""
    device = parse_device(PUBLISHED, "printed.toml") if published else drive
    run = Steps(sliding_mode(device), together=held_together)
    t, c, s, u = run.t, run.c, run.s, run.u
    lam, phi, lead = t.lambda_1_s, t.phi_rad_s, t.lead
    np.testing.assert_allclose(c.lambda2_1_s2, lam**2)
    np.testing.assert_allclose(c.integral_gain_1_s, TS * lam**2)
    on = run.ok & run.whole & (u.mode > 0.5)
    entering = on & (s.active == 0)
    e = u.delta_set_rad - u.theta_rad
    rate = u.delta_rate_rad_s - u.omega_motor_rad_s + u.omega_load_rad_s
    softened, soft = {}, 0
    if not published:
        # Two high-passes of 4 Hz, one after the other; its mean square over 0.5 s; back in 60 s.
        follow, gain = 1 - exp(-2 * pi * 4 * TS), 1 - exp(-TS / 0.5)
        last = where(entering, e, s.slow_rad)
        slow = (1 - follow) * last + follow * e
        middle = (1 - follow) * s.middle_rad + follow * (e - slow)
        swing = clip((e - slow - middle) / 6.5e-3, -1, 1)
        square = (1 - gain) * s.square + gain * swing**2
        asked = clip((square * 6.5**2 - 3.5**2) / (3.9**2 - 3.5**2), 0, 1)
        now = np.maximum(t.softening * asked, s.soft * exp(-TS / 60))
        kept = {"slow_rad": slow, "middle_rad": middle, "square": square, "soft": now}
        softened = {f"next_{n}": where(on, x, 0) for n, x in kept.items()}
        soft = s.soft
        lam = lam * (1 - 0.5 * soft)
        lead = np.minimum(lead * (1 + 0.6 * soft), 4)
    straight = rate + 2 * lam * e
    integral = where(entering, -straight, s.integral_rad_s)
    surface = where(entering, 0, straight + s.integral_rad_s)
    acc, omega = 0, u.omega_motor_rad_s
    if not published:
        acc = u.delta_acc_rad_s2 + t.load_share * (u.tau_Nm + u.tau_h_Nm) / JH
        should = u.omega_load_rad_s + u.delta_rate_rad_s + 0.035 * u.delta_acc_rad_s2
        omega = (1 - t.friction_ahead) * omega + t.friction_ahead * should
        omega = clip(omega, -SPEED, SPEED)
    a, sig = acc + 2 * lam * rate + lam**2 * e, np.tanh(omega / WIDTH)
    u_eq = (J * (a - u.d4_rad_s2) + FV * omega + FC * sig + u.tau_Nm) / N
    bent = abs(u.theta_rad)
    unsure = 1.5 * bent + 1.5 * bent**3 + 0.25 * (FV * abs(omega) + FC * abs(sig))
    k_smc = 0.05 * (abs(a) + abs(u.d4_rad_s2)) + unsure + (J + 0.05) * 1e-3
    k_smc = t.margin * k_smc / N
    law = u_eq + k_smc * clip(surface / phi, -1, 1)
    driven = lead * law - (lead - 1) * u.u_a_Nm
    bounded = clip(driven, -U, U)
    missing = where(entering, u.u_applied_Nm - bounded, s.offset_Nm)
    raw = bounded + missing
    command = where(on, clip(raw, -U, U), 0)
    here = where((driven > U) | (raw > U), 1, where((driven < -U) | (raw < -U), -1, 0))
    short, before = s.u_last_Nm - u.u_applied_Nm, s.u_before_Nm - u.u_applied_Nm
    nearer = where(entering, 0, where(abs(short) < abs(before), short, before))
    lacks = where(here == 0, where(abs(nearer) > 1e-3 * U, sign(nearer), 0), here)
    rests = lacks * e > 0
    grown = integral + where(rests, 0, TS * lam**2 * e)
    most = RATE + 2 * SPEED + 2 * 25 * 2 * BENT
    beyond = (abs(driven) > U) | (abs(raw) > U)
    flags = [
        ~run.ok,
        ~run.whole,
        on & beyond,
        on & (abs(surface) > phi),
        on & (rests | (abs(grown) > most)),
        on,
        entering,
    ]
    run.compare(
        softened
        | {
            "next_active": on,
            "next_integral_rad_s": where(on, clip(grown, -most, most), 0),
            "next_offset_Nm": where(on, missing * exp(-TS / LAG_S), 0),
            "next_u_last_Nm": command,
            "next_u_before_Nm": where(on, where(entering, u.u_applied_Nm, s.u_last_Nm), 0),
            "y_u_command_Nm": command,
            "y_u_wanted_Nm": where(on, driven, 0),
            "y_s_rad_s": where(on, surface, 0),
            "y_u_eq_Nm": where(on, u_eq, 0),
            "y_k_smc_Nm": where(on, k_smc, 0),
            "y_status": word(*flags, *([] if published else [on & (soft > 0.01)])),
        },
        near=abs(abs(grown) - most) < 1e-5,
    )


def test_a_step_of_the_switch_between_laws(drive):
    def together(s, u, rng):
        u["law"][:] = rng.choice([0.0, 1.0, 2.0, 0.5], COUNT)
        k = rng.random(COUNT) < 0.5
        u["law"][k] = s["law_held"][k] = np.rint(s["law_held"][k])

    run = Steps(law_switch(drive, ["one", "other", "third"], ["other", "third"]), together=together)
    s, u = run.s, run.u
    keep = np.exp(-TS / run.t.fade_s)
    np.testing.assert_allclose(run.c.keep, keep)
    unknown = ~np.isin(u.law, (0, 1, 2))
    held = where(unknown, s.law_held, u.law)
    # A place that is none, from a memory that is whole, is the first.
    at = np.select([held == 1, held == 2], [1, 2], 0)
    command = np.choose(at, [u.u_one_Nm, u.u_other_Nm, u.u_third_Nm])
    sound = np.choose(at, [np.ones(COUNT), u.ok_other, u.ok_third])
    offset = where(held == s.law_held, keep * s.offset_Nm, s.u_last_Nm - command)
    joined = clip(command + offset, -U, U)
    run.compare(
        {
            "next_law_held": held,
            "next_offset_Nm": clip(offset, -2 * U, 2 * U),
            "next_u_last_Nm": joined,
            "y_u_command_Nm": joined,
            "y_request_ok": run.ok & (sound == 1),
            "y_law_held": held,
            "y_status": word(~run.ok, ~run.whole, unknown, abs(command + offset) > U),
        },
        near=abs(abs(command + offset) - U) < 3e-8,
    )


@pytest.mark.parametrize("checked", [False, True])
def test_a_step_of_the_stamp(drive, checked):
    run = Steps(command_stamp(drive, checked=checked))
    s, u = run.s, run.u
    sound = run.ok & ((u.request_ok == 1) if checked else True)
    beat = where(s.beats >= 255, 1, s.beats + 1)
    run.compare(
        {
            "next_beats": beat,
            "y_u_command_Nm": where(sound, u.u_command_Nm, 0),
            "y_control_beat": where(sound, beat, 0),
            "y_status": word(~sound, ~run.whole),
        }
    )


def test_a_step_of_the_comparison(drive):
    """[red 1] to [red 4]: a cable of 150 Nm/rad, 80 at its softest; rooms of the device file."""

    def together(s, u, rng):
        for name in ("theta_motor_rad", "theta_gear_rad", "d_gear_rad_s2", "moves_rad_s2"):
            u[name] *= rng.choice([1.0, 0.05], COUNT)

    run = Steps(redundancy(drive), together=together)
    s, u = run.s, run.u
    ready = run.ok & run.whole & (u.motor_usable >= 0.5) & (u.gear_usable >= 0.5)
    found = u.theta_gear_rad - u.theta_motor_rad - u.tau_Nm / 150
    zeroed = s.zeroed > 0.5
    apart = where(zeroed, found - s.zero_rad, 0)
    angles = ready & (abs(apart) > 0.06 + abs(u.tau_Nm) * (1 / 80 - 1 / 150))
    torque = J * u.d_gear_rad_s2
    most = 2.2 + 0.25 * abs(u.tau_Nm) + 0.35 * J * u.moves_rad_s2
    torques = ready & (abs(torque) > most)
    run.compare(
        {
            "next_zero_rad": where(zeroed | ~ready, s.zero_rad, found),
            "next_zeroed": ready,
            "y_agree": ready & ~angles & ~torques,
            "y_apart_rad": where(ready, apart, 0),
            "y_apart_Nm": torque,
            "y_room_Nm": most,
            "y_status": word(~run.ok, ~run.whole, ~ready, angles, torques),
        }
    )
