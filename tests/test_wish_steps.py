"""Blocks between a wish and a set-point, typed a second time in NumPy: single steps, any memory.

Every next state, output and flag, at the edges of ranges and beyond, with any tunables; numbers of
the drive are those of ``elbow_drive.toml``, typed by hand.  What a step of the limits and of the
trend does is typed in ``limits_model.py`` and ``test_trend.py``.
"""

from __future__ import annotations

from math import exp, factorial, pi

import numpy as np

from esea_gen.control.adaptation import adaptation
from esea_gen.control.passivity import passivity
from esea_gen.control.reference import reference

from .single_steps import COUNT, Steps, word

where, clip = np.where, np.clip
H = 1e-3
TAU, FULL, SPEED, U = 20.0, 4.47, 12.0, 0.221  # largest of each
N, J, LAG_S = 74.0, 0.663, 0.03488


def test_a_step_of_the_adaptation(drive):
    """[adapt 1] to [adapt 7] with their lags, memories and conditions."""
    block = adaptation(drive)

    def together(s, u, rng):
        # A joint near where the mass hangs, and a sensor that nearly shows its torque.
        k = rng.random(COUNT) < 0.5
        for name, size in (("theta_load_rad", 2.5), ("tau_Nm", 3.0), ("omega_load_rad_s", 1.0)):
            u[name][k] = rng.uniform(-size, size, k.sum()) * (name != "theta_load_rad") + (
                rng.uniform(0, 2.5, k.sum()) * (name == "theta_load_rad")
            )
        s["tau_lag_Nm"][k] = rng.uniform(-3, 3, k.sum())
        s["omega_lag_rad_s"][k] = u["omega_load_rad_s"][k]
        for name in ("weight_lag_Nm", "stop_known_Nm"):
            s[name][k] = s["tau_lag_Nm"][k]

    run = Steps(block, together=together)
    c, s, u = run.t, run.s, run.u
    assert all(np.allclose(getattr(run.c, n), x, rtol=1e-6) for n, x in vars(c).items())
    weighs = run.ok & (u.sensing_ok >= 0.5) & (c.mass_Nm > 0)
    was, goes_on = s.weighed != 0, weighs & (s.weighed != 0)
    # The weight by the first four terms of the sine, as far as the horizontal.
    turned = u.theta_load_rad - c.mass_angle_rad
    x = clip(turned, -1.6, 1.6)
    weight = c.mass_Nm * sum((-1) ** k * x ** (2 * k + 1) / factorial(2 * k + 1) for k in range(4))
    follow = 1 - exp(-2 * pi * 2 * H)
    lags = {
        name: where(goes_on, last + follow * (now - last), now)
        for name, last, now in (
            ("weight_lag_Nm", s.weight_lag_Nm, weight),
            ("omega_lag_rad_s", s.omega_lag_rad_s, u.omega_load_rad_s),
            ("tau_lag_Nm", s.tau_lag_Nm, u.tau_Nm),
        )
    }
    alpha = where(goes_on, (u.omega_load_rad_s - s.omega_lag_rad_s) * follow / H, 0)
    raw = lags["weight_lag_Nm"] + c.mass_kgm2 * alpha + c.mass_Nms_rad * lags["omega_lag_rad_s"]
    known = clip(raw, -FULL, FULL)
    within = (abs(turned) <= 1.6) & (abs(raw) <= FULL)
    # A stop operator of 0.8 Nm in play form.
    play = where(was, clip(s.stop_known_Nm, known - 0.8, known + 0.8), known)
    loss = known - play
    beside = where(was, known - s.mean_Nm, 0)
    share = 1 - exp(-H / 5)
    square = where(was, (1 - share) * s.square_Nm2 + share * beside**2, 0)
    ends = {"gain": (1 / 1.3, 1 / 0.7), "loss": (-0.4, 0.4), "offset_Nm": (-0.3, 0.3)}
    now = {n: clip(getattr(c, n) + getattr(s, f"more_{n}"), *ends[n]) for n in ends}
    missed = lags["tau_lag_Nm"] - now["gain"] * known - now["loss"] * loss - now["offset_Nm"]
    informed = weighs & within & (square > 0.05)
    plausible = abs(missed) <= 0.5 + 0.5 * abs(known)
    learns = informed & plausible
    step = where(learns, H * 0.5 * missed, 0)
    beyond, more = np.zeros(COUNT, dtype=bool), {}
    for name, by in (("gain", 0.5 * known), ("loss", loss), ("offset_Nm", 0.5)):
        raw = now[name] + step * by
        kept = clip(raw, *ends[name])
        beyond |= abs(raw - kept) > 1e-7
        start, last = getattr(c, name), getattr(s, f"more_{name}")
        more[f"next_more_{name}"] = where(learns, kept - start, last)
    fade = 1 - exp(-H / 1.0)
    wish = {
        f"wish_{name}": getattr(s, f"wish_{name}")
        + fade * (neutral + c.share * (now[name] - neutral) - getattr(s, f"wish_{name}"))
        for name, neutral in (("gain", 1), ("loss", 0), ("offset_Nm", 0))
    }
    d = u.tau_desired_Nm
    held = clip(s.stop_wish_Nm, d - 0.8, d + 0.8)
    flags = (~run.ok, ~run.whole, learns, beyond, informed & ~plausible)
    run.compare(
        {f"next_{n}": v for n, v in (lags | wish).items()}
        | more
        | {
            "next_weighed": weighs,
            "next_stop_known_Nm": play,
            "next_mean_Nm": where(was, s.mean_Nm + share * beside, known),
            "next_square_Nm2": square,
            "next_stop_wish_Nm": where(s.wished != 0, held, d),
            "next_wished": 1,
            "y_wish_gain": wish["wish_gain"],
            "y_wish_shift_Nm": wish["wish_loss"] * (d - held) + wish["wish_offset_Nm"],
            **{f"y_{n}": x for n, x in now.items()},
            "y_missed_Nm": where(weighs, missed, 0),
            "y_status": word(*flags),
        }
    )


def test_a_step_of_the_reference(drive):
    """(5.24) with the sign of a stiffness, the wish adapted, and joined at a change of mode."""
    run = Steps(reference(drive))
    t, c, s, u = run.t, run.c, run.s, run.u
    np.testing.assert_allclose(c.keep, np.exp(-H / t.blend_s))
    for name in ("Kp_Nm_rad", "Kd_Nms_rad", "tau_range_Nm"):
        np.testing.assert_array_equal(getattr(c, name), getattr(t, name))
    sound = run.ok & run.whole
    mode = where(sound, np.ceil(u.mode - 0.5), 0)
    tau_d = clip(u.wish_gain * u.tau_desired_Nm + u.wish_shift_Nm, -TAU, TAU)
    spring = c.Kp_Nm_rad * (u.theta_desired_rad - u.theta_load_rad)
    damper = c.Kd_Nms_rad * (u.omega_desired_rad_s - u.omega_load_rad_s)
    law = tau_d + where(mode == 2, spring + damper, 0)
    changed = mode != s.mode_last
    joined = where(changed, s.tau_set_Nm - law, s.offset_Nm) * c.keep
    offset = where(changed & (s.mode_last < 0.5), u.tau_Nm - law, joined)
    wanted = where(mode > 0, law + offset, u.tau_Nm)
    limited = clip(wanted, -c.tau_range_Nm, c.tau_range_Nm)
    tau_set = where(run.ok, limited, s.tau_set_Nm)
    clipped = run.ok & (abs(wanted) > c.tau_range_Nm)
    run.compare(
        {
            "next_mode_last": mode,
            "next_offset_Nm": where(mode > 0, offset, 0),
            "next_tau_set_Nm": tau_set,
            "y_tau_set_Nm": tau_set,
            "y_mode": mode,
            "y_request_ok": sound,
            "y_status": word(~run.ok, ~run.whole, clipped, (mode > 0) & changed),
        }
    )


def test_a_step_of_the_passivity(drive):
    """[pas 1] to [pas 6]: damping at a mean of 0.4 s, a bound of 4 J, both by hand."""

    def together(s, u, rng):
        # Joints that have moved a little, a mean near nothing; a drive that has little left.
        for side in ("load", "motor"):
            u[f"theta_{side}_rad"][:] = clip(
                s[f"theta_{side}_last_rad"] + rng.uniform(-0.02, 0.02, COUNT), -0.9, 3.3
            )
        k = rng.random(COUNT) < 0.7
        s["square_rad2_s2"][k] *= 1e-3
        s["power_W"][k] *= 1e-5
        s["given_J"][k] = rng.uniform(0, 4, k.sum())
        u["omega_motor_rad_s"][k] = rng.uniform(-3, 3, k.sum())
        s["moving_J"][k] *= 0.05

    run = Steps(passivity(drive), together=together)
    c, s, u = run.c, run.s, run.u
    for n, x in vars(run.t).items():
        np.testing.assert_allclose(getattr(c, n), x, rtol=1e-6)
    seen = run.ok & (u.sensing_ok > 0.5)
    going, on = seen & (s.seen > 0.5), seen & (u.mode > 0.5)
    stiff, damps = where(u.mode > 1.5, u.Kp_Nm_rad, 0), where(u.mode > 1.5, u.Kd_Nms_rad, 0)
    error = u.tau_Nm - u.tau_set_Nm - damps * u.omega_load_rad_s
    reach = SPEED * H
    moved = clip(u.theta_load_rad - s.theta_load_last_rad, -reach, reach)
    counted, gain = going & on, 1 - exp(-H / 0.4)
    mean_W = 0.5 * (error + s.error_last_Nm) * moved / H
    power = s.power_W + gain * (where(counted, mean_W, 0) - s.power_W)
    square = s.square_rad2_s2 + gain * (where(counted, u.omega_load_rad_s**2, 0) - s.square_rad2_s2)
    most = np.maximum(0.35 - damps, 0)
    missing = power + (c.least_Nms_rad + LAG_S * stiff) * square
    change = where(missing > 0, 6.0, 0.7) * missing
    change = H * (change + (most - s.damping_Nms_rad) * 0.04**2 / 1.0) / (square + 0.04**2)
    damping = clip(s.damping_Nms_rad + change, 0, most)
    added = where(on, damping, 0)
    ahead = (u.mode < 1.5) & (square > 0.01**2)
    # The drive: speed of all its energy, its lag and the delay of the speed's filter.
    fastest, keep = (2 * 4 / J) ** 0.5, exp(-H / LAG_S)
    late_s = np.sum(2 * np.sin(np.array([1, 3]) * pi / 8)) / (2 * pi * 30) + 0.5 * H
    extra, step = late_s * (1 - keep) / H, 50 * H
    ticks = (1 + extra) * U / step
    turned = clip(u.theta_motor_rad - s.theta_motor_last_rad, -reach, reach)
    worked = 0.5 * (u.tau_Nm + s.tau_last_Nm) * turned - np.maximum(u.tau_set_Nm * turned, 0)
    moving = where(seen, J * u.omega_motor_rad_s**2 / 2, s.moving_J)
    # The lag backward: its torque goes from v to m, the work of both is Omega n of its integral.
    grown_s = LAG_S * (1 / keep - 1)
    blind = fastest * N * (grown_s * s.v_Nm - (grown_s - H) * s.most_Nm)
    blind = blind + np.maximum(s.moving_J - moving, 0)
    given = clip(s.given_J + where(going, worked, blind), 0, 120)
    base = given + moving + fastest * N * (LAG_S + late_s) * s.v_Nm
    most_Nm = (c.energy_J - base) / (fastest * N * H * (1 + extra + ticks))
    most_Nm = clip(most_Nm, 0, 4 * U)
    passed = where(run.ok, clip(u.u_command_Nm, -most_Nm, most_Nm), 0)
    left = np.minimum(np.maximum(abs(passed), s.most_Nm - step), U)
    closed = abs(passed - u.u_command_Nm) > 1e-12
    given_J = {"next_given_J": given, "y_given_J": given}
    run.compare(
        given_J
        | {
            "next_power_W": power,
            "next_square_rad2_s2": square,
            "next_damping_Nms_rad": damping,
            "next_theta_load_last_rad": u.theta_load_rad,
            "next_error_last_Nm": error,
            "next_theta_motor_last_rad": u.theta_motor_rad,
            "next_tau_last_Nm": u.tau_Nm,
            "next_moving_J": moving,
            "next_v_Nm": left + (s.v_Nm - left) * keep,
            "next_most_Nm": np.maximum(left, 0),
            "next_seen": seen,
            "y_tau_set_Nm": clip(u.tau_set_Nm - added * u.omega_load_rad_s, -FULL, FULL),
            "y_damping_Nms_rad": added,
            "y_mode_ahead": where(on, where(ahead, 2, u.mode), 0),
            "y_request_ok": (u.request_ok == 1) & run.whole,
            "y_u_command_Nm": passed,
            "y_held_J": base + fastest * N * H * ticks * s.most_Nm,
            "y_status": word(
                ~run.ok,
                ~run.whole,
                on & (added > 1e-12),
                run.ok & closed,
                abs(u.omega_motor_rad_s) > fastest,
            ),
        },
        near=(added > 0) & (added < 1e-7),
    )
