"""Single steps of the safety Blocks against NumPy, from any state and input.

Every next state, output and flag, at the edges of ranges and beyond, with any tunables; numbers of
the drive are those of ``elbow_drive.toml``, typed by hand.  The limits: ``limits_model.py``.
"""

from __future__ import annotations

from math import exp, pi

import numpy as np

from esea_gen.control.limits.redundancy import redundancy
from esea_gen.control.passivity import passivity
from esea_gen.control.reference import reference
from tests.single_steps import COUNT, Steps, word

where, clip = np.where, np.clip
H = 1e-3
TAU, FULL, SPEED, U = 20.0, 4.47, 12.0, 0.221  # largest of each
N, J, LAG_S = 74.0, 0.663, 0.03488


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


def test_a_step_of_the_reference(drive):
    """(5.24) with the sign of a stiffness, the wish adapted, and joined at a change of mode."""
    run = Steps(reference(drive))
    t, c, s, u = run.t, run.c, run.s, run.u
    np.testing.assert_allclose(c.keep, np.exp(-H / t.blend_s))
    for name in ("Kp_Nm_rad", "Kd_Nms_rad", "tau_range_Nm"):
        np.testing.assert_array_equal(getattr(c, name), getattr(t, name))
    sound = run.ok & run.whole & (u.wish_ok > 0.5)
    mode = where(sound, np.ceil(u.mode - 0.5), 0)
    tau_d = clip(u.wish_gain * u.tau_desired_Nm + u.wish_shift_Nm, -TAU, TAU)
    spring = c.Kp_Nm_rad * (u.theta_desired_rad - u.theta_load_rad)
    damper = c.Kd_Nms_rad * (u.omega_desired_rad_s - u.omega_load_rad_s)
    law = tau_d + where(mode == 2, spring + damper, 0)
    changed = mode != s.mode_last
    joined = where(changed, s.tau_set_Nm - law, s.offset_Nm) * c.keep
    offset = where(changed & (s.mode_last < 0.5), u.tau_Nm - law, joined)
    wanted = where(mode > 0, law + offset, u.tau_Nm)
    tau_set = where(run.ok, clip(wanted, -c.tau_range_Nm, c.tau_range_Nm), s.tau_set_Nm)
    clipped = run.ok & (abs(wanted) > c.tau_range_Nm)
    run.compare(
        {
            "next_mode_last": mode,
            "next_offset_Nm": where(mode > 0, offset, 0),
            "next_tau_set_Nm": tau_set,
            "y_tau_set_Nm": tau_set,
            "y_tau_hold_Nm": (tau_set - u.wish_shift_Nm) / u.wish_gain,
            "y_tau_blend_Nm": where(mode > 0, offset, 0) / u.wish_gain,
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
