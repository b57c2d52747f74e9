"""The drive's disturbance and the cable's gap typed again: docs/observers.md, docs/cable.md."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy import abs, clip, exp, tanh, where

from esea_gen.observe.cable import cable_observer
from esea_gen.observe.disturbance import drive_observer, drive_observer_by_gear, gear_observer
from tests.single_steps import COUNT, Steps, word

H = 1e-3
# Of elbow_drive.toml, typed again.
N, J, FV, FC, WIDTH, TAU_C, U, TAU = 74.0, 0.663, 0.5551, 0.4688, 0.05, 0.03488, 0.221, 20
D_MOST = N * U / J


def range_of(block, name: str) -> float:
    (port,) = {p.name: p for p in (*block.state, *block.outputs) if p.name == name}.values()
    assert port.low == -port.high
    return port.high


@pytest.mark.parametrize("which", [drive_observer, drive_observer_by_gear, gear_observer])
def test_a_step_of_the_drives_disturbance(drive, which):
    """(5.1), (5.2) and (5.5); by the motor's own encoder a tenth of the torque is lost."""
    run = Steps(which(drive))
    s, u = run.s, run.u
    motor, gear = which is drive_observer, which is gear_observer
    omega, loss = (u.omega_motor_rad_s, 0) if motor else (u.omega_gear_rad_s, 0 if gear else 0.1)
    if gear:
        share = 1 - math.exp(-20 * H)
    else:
        share = 1 - exp(-H * run.t.bandwidth_1_s)
        np.testing.assert_allclose(run.c.share, share, atol=1e-12)
        np.testing.assert_allclose(run.c.keep, 1 - share)
        (bandwidth,) = run.block.tunables
        # At most L T = 1/2, T the delay of a fourth-order Butterworth filter of 15 Hz, or a period.
        delay_s = 2 * (math.cos(math.pi / 8) + math.cos(3 * math.pi / 8)) / (2 * math.pi * 15)
        assert bandwidth.high == pytest.approx(0.5 / (delay_s if motor else H))
    rubbed = FC + loss * abs(u.tau_Nm)
    passive = -(FV * omega + rubbed * tanh(omega / WIDTH) + u.tau_Nm) / J
    decay = math.exp(-H / TAU_C)
    driven = s.u_held_Nm + (s.u_a_Nm - s.u_held_Nm) * (1 - decay) * TAU_C / H
    seen = (omega - s.omega_last_rad_s) / H
    model = N / J * driven + (passive + s.passive_rad_s2) / 2
    moved = s.d4_rad_s2 + share * (seen - model - s.d4_rad_s2)
    ready = run.ok & (s.primed != 0)
    d4 = where(ready, clip(moved, -D_MOST, D_MOST), s.d4_rad_s2)
    u_a = s.u_held_Nm + (s.u_a_Nm - s.u_held_Nm) * decay
    beyond = abs(moved) > D_MOST
    expected = {
        "next_primed": run.ok,
        "next_omega_last_rad_s": omega,
        "next_passive_rad_s2": passive,
        "next_u_held_Nm": u.u_Nm,
        "next_u_a_Nm": u_a,
        "next_d4_rad_s2": d4,
        "y_d_gear_rad_s2" if gear else "y_d4_rad_s2": d4,
    }
    if motor:
        expected["y_u_a_Nm"] = u_a
    if gear:
        lagged = s.a_rad_s2 + share * (seen - s.a_rad_s2)
        beyond |= abs(lagged) > 4 * D_MOST
        a = where(ready, clip(lagged, -4 * D_MOST, 4 * D_MOST), s.a_rad_s2)
        moves = np.maximum(abs(a), s.moved_rad_s2 * math.exp(-H / 0.1))
        expected |= {"next_a_rad_s2": a, "next_moved_rad_s2": moves, "y_moves_rad_s2": moves}
        assert range_of(run.block, "a_rad_s2") == pytest.approx(4 * D_MOST)
    run.compare(expected | {"y_status": word(~run.ok, ~run.whole, ready & beyond)})
    # Every part of (5.2) at its largest together, at 12 rad/s and 20 Nm.
    most = (N * U + FV * 12 + FC + TAU * (1 + loss)) / J
    assert most < range_of(run.block, "passive_rad_s2") < 1.002 * most
    assert range_of(run.block, "d4_rad_s2") == pytest.approx(D_MOST)


def test_a_step_of_the_cables_gap(drive):
    """[cable 1] to [cable 7], decided by torque, by what was shown, and by where the gear is."""

    def together(s, u, rng):
        # A gear that has turned as far as the motor side, but for the gap's ends, and a mean.
        s["low_rad"][:] = rng.uniform(-0.03, 0.02, COUNT)
        s["high_rad"][:] = s["low_rad"] + rng.uniform(0, 0.03, COUNT)
        u["theta_gear_rad"][:] = u["theta_motor_rad"] + rng.uniform(-0.06, 0.06, COUNT)
        u["tau_Nm"][:] = rng.choice([0.1, 1.0, 4.0], COUNT) * rng.uniform(-1, 1, COUNT)
        s["mean_rad"][:] = u["theta_gear_rad"] - u["theta_motor_rad"] + rng.normal(0, 0.02, COUNT)
        s["mean_Nm"][:] = u["tau_Nm"] + rng.uniform(-2, 2, COUNT)

    run = Steps(cable_observer(drive), together=together)
    s, u = run.s, run.u
    ok = run.ok & (u.motor_usable >= 0.5) & (u.gear_usable >= 0.5)
    turned = u.theta_gear_rad - u.theta_motor_rad
    rubs = 0.1 * abs(u.tau_Nm) * clip(u.omega_gear_rad_s / 0.05, -1, 1)
    pull = u.tau_Nm + rubs
    carried = pull * s.give_rad_Nm
    seen, was = turned - carried, s.primed != 0
    high, low = where(was, s.high_rad, seen + 0.003), where(was, s.low_rad, seen - 0.003)
    pulls, pushes = u.tau_Nm > 0.2, u.tau_Nm < -0.2
    share = 1 - math.exp(-20 * H)
    lies = where(pulls, high, where(pushes, low, clip(seen, low, high)))
    off = share * (seen - lies)
    at_high, at_low = pulls | (~pushes & (seen > high)), pushes | (~pulls & (seen < low))
    up, down = s.high_shown > 0.5, s.low_shown > 0.5
    new_high = high + where(at_high | (at_low & ~up), off, 0)
    new_low = low + where(at_low | (at_high & ~down), off, 0)
    # The gap is 0 to 30 mrad; the end that was moved stays.
    kept_low = where(at_low, new_low, clip(new_low, new_high - 0.03, new_high))
    kept_high = where(at_low, clip(new_high, new_low, new_low + 0.03), new_high)
    lain = where(pulls, kept_high, where(pushes, kept_low, clip(seen, kept_low, kept_high)))
    wound = lain - (kept_high + kept_low) / 2
    count = 2 * math.pi / 4096
    delta = u.theta_rad + where(ok, clip(seen - lain, -count, count), 0)
    most = range_of(run.block, "delta_rad")
    closed = u.mode > 1.5
    taut = ok & (pulls | pushes)
    on = taut & (s.taut != 0)
    change = where(on, pull - s.mean_Nm, 0)
    missed = clip(where(on, turned - s.mean_rad, 0) - s.give_rad_Nm * change, -0.03, 0.03)
    give = clip(s.give_rad_Nm + 0.2 * share * missed * clip(change, -1, 1), 0, 1 / 80)
    slow = 1 - math.exp(-0.25 * 20 * H)
    gap = where(closed, 0, where(ok, np.minimum(kept_high - kept_low, 0.03), 0.006))
    run.compare(
        {
            "next_primed": ok,
            "next_high_rad": where(ok, kept_high, s.high_rad),
            "next_low_rad": where(ok, kept_low, s.low_rad),
            "next_high_shown": ok & ((was & up) | pulls),
            "next_low_shown": ok & ((was & down) | pushes),
            "next_taut": taut,
            "next_mean_rad": where(on, s.mean_rad + slow * (turned - s.mean_rad), turned),
            "next_mean_Nm": where(on, s.mean_Nm + slow * (pull - s.mean_Nm), pull),
            "next_give_rad_Nm": give,
            "y_delta_rad": clip(delta, -most, most),
            "y_wound_rad": where(ok & ~closed, wound, 0) + carried,
            "y_give_rad_Nm": give,
            "y_gap_rad": gap,
            "y_status": word(~run.ok, ~run.whole, ~ok),
        }
    )
