"""Encoders, smoothed deflection and passive sensor, typed again in NumPy: single steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.model.encoder import encoder
from esea_gen.model.gear_encoder import gear_encoder
from esea_gen.model.joint import deflection
from esea_gen.model.smoothing import smoothed_deflection
from esea_gen.twin.passive import passive_block
from esea_gen.twin.plant import true_sensor

from .single_steps import COUNT, Steps, word
from .test_encoder import make, q, row

where, clip = np.where, np.clip
H, FULL = 1e-3, 2**17
PER_RAD = FULL * 74 / (2 * math.pi)
# 12 rad/s for a tick and one count; the joint's range and 0.35 rad either way.
FASTEST, FARTHEST = math.ceil(0.012 * PER_RAD) + 1, math.ceil(4.3 * PER_RAD)


TABLE = (0.01, -0.02, 0.005, 0.03)


@pytest.mark.parametrize(
    ("motor", "fastest", "bridged", "sign", "table"),
    [
        ("", math.ceil((0.012 + math.radians(0.5)) * 4096 / (2 * math.pi)) + 1, 3, 1, (0.0,)),
        (
            f"held_max = {q(2)}\nstep_max_rad = {q(0.04)}\ndirection = {q(-1)}\n{row(TABLE)}",
            math.floor(0.04 * 4096 / (2 * math.pi)),
            2,
            -1,
            TABLE,
        ),
    ],
)
def test_a_step_of_a_joint_encoder(motor, fastest, bridged, sign, table):
    def together(s, u, rng):
        moved = rng.integers(1, 6, COUNT) * fastest + rng.integers(-1, 2, COUNT)
        moved = where(rng.random(COUNT) < 0.5, rng.integers(0, fastest, COUNT), moved)
        near = rng.random(COUNT) < 0.85
        s["count_last"][:] = where(near, np.rint(s["count_last"]), s["count_last"])
        u["count"][near] = ((s["count_last"] + moved * rng.choice([-1, 1], COUNT)) % 4096)[near]
        u["frame_error"][rng.random(COUNT) < 0.6] = 0
        s["lost"][rng.random(COUNT) < 0.7] = 0
        s["settled"][rng.random(COUNT) < 0.5] = 4
        s["turn"][:] = np.rint(rng.uniform(-4, 4, COUNT))
        # Half way between two whole numbers, too.
        for values, name, halves in (
            (u, "frame_error", [0.5]),
            (s, "lost", [0.5]),
            (s, "settled", [0.5, 1.5, 2.5, 3.5]),
            (s, "held", [0.5, 1.5, 2.5]),
        ):
            k = rng.random(COUNT) < 0.08
            values[name][k] = rng.choice(halves, k.sum())

    def whole(x, low, high):
        return clip(np.ceil(x - 0.5), low, high)

    run = Steps(encoder(make(motor=motor), "motor"), together=together)
    s, u, c = run.s, run.u, run.c
    assert [x.value for x in run.block.constants] == [12, fastest, bridged]
    started, settled, lost = s.settled > 0.5, s.settled > 3.5, s.lost > 0.5
    flagged = run.ok & (u.frame_error > 0.5)
    readable = run.ok & ~flagged
    raw = u.count - s.count_last
    wrap = where(started, (raw < -2048) * 1.0 - (raw > 2048), 0)
    held = sum((s.held > k - 0.5).astype(int) for k in range(1, bridged + 1))
    near = abs(raw + 4096 * wrap) <= fastest * (held + 1) + 0.5
    odd = started & readable & ~near
    start = readable & ~settled & (~started | ~near)
    good = readable & (start | near) & ~lost
    # The joint stands within half a turn of 1.2 rad, the middle of its range.
    first = sign * (1.2 + c.offset_rad) / (2 * math.pi) - u.count / 4096
    wanted = where(start, first, s.turn + wrap)
    turn = where(good, whole(wanted, -4, 4), s.turn)
    count = where(good, u.count, s.count_last)
    bad = where(good, 0, whole(s.held + 1, 0, bridged + 1))
    late = bad > bridged + 0.5
    lost = lost | (settled & odd & late) | (good & (abs(wanted) > 4.5))
    agreed = where(start, 1, whole(s.settled + 1, 1, 4))
    settled = where(good, agreed, where(late, 0, s.settled))
    doubts = late, settled < 3.5, c.zeroed < 0.5, lost
    nodes = np.arange(len(table) + 1) * 4096 / len(table)
    angle = (turn + count / 4096) * 2 * math.pi + np.interp(count, nodes, [*table, table[0]])
    run.compare(
        {
            "next_count_last": count,
            "next_turn": turn,
            "next_held": bad,
            "next_settled": settled,
            "next_lost": lost,
            "y_theta_rad": sign * angle - c.offset_rad,
            "y_usable": ~np.logical_or.reduce(doubts),
            "y_status": word(~run.ok, ~run.whole, flagged, odd, *doubts),
        },
        near=start & (abs(wanted % 1 - 0.5) < 1e-6),
    )


def test_a_step_of_the_motors_encoder(drive):
    def together(s, u, rng):
        moved = rng.choice([0.4, 0.9, 1, 1.9, 2, 2.9, 3, 3.2], COUNT) * FASTEST
        moved = np.rint(moved + rng.integers(-2, 3, COUNT)) * rng.choice([-1, 1], COUNT)
        near = rng.random(COUNT) < 0.8
        s["count_last"][:] = np.rint(s["count_last"])
        u["count"][near] = ((s["count_last"] + moved) % FULL)[near]
        u["frame_error"][rng.random(COUNT) < 0.7] = 0
        s["started"][rng.random(COUNT) < 0.6] = 1
        for values, name, halves in (
            (u, "frame_error", [0.5]),
            (s, "started", [0.5]),
            (s, "held", [0.5, 1.5]),
        ):
            k = rng.random(COUNT) < 0.08
            values[name][k] = rng.choice(halves, k.sum())
        ends = rng.random(COUNT) < 0.2
        s["moved"][ends] = rng.choice([-1, 1], ends.sum()) * rng.integers(
            FARTHEST - 2 * FASTEST, FARTHEST, ends.sum()
        )

    run = Steps(gear_encoder(drive), together=together)
    s, u = run.s, run.u
    assert [c.value for c in run.block.constants] == [17, 74, FASTEST, 2]
    most = next(p.high for p in run.block.outputs if p.name == "theta_gear_rad")
    assert 1 <= most / (FARTHEST / PER_RAD) < 1 + 2e-6
    flagged, started = run.ok & (u.frame_error > 0.5), s.started > 0.5
    readable = run.ok & ~flagged
    moved = (u.count - s.count_last + FULL / 2) % FULL - FULL / 2
    bridged = (s.held > 0.5).astype(int) + (s.held > 1.5)
    near = abs(moved) <= FASTEST * (bridged + 1) + 0.5
    good, late = readable & started & near, s.held > 1.5
    fresh = readable & (~started | late) & ~good
    taken = good | fresh
    total = s.moved + where(good, moved, 0)
    outside = abs(total) > FARTHEST + 0.5
    rate = clip(moved / (bridged + 1) / PER_RAD / H, -12.12, 12.12)
    rate = where(good, rate, where(fresh, 0, s.omega_rad_s))
    usable = (taken | (started & ~late)) & ~fresh & ~outside
    kept = clip(total, -FARTHEST, FARTHEST)
    run.compare(
        {
            "next_count_last": where(taken, u.count, s.count_last),
            "next_moved": kept,
            "next_held": where(taken, 0, where(late, 2, s.held + 1)),
            "next_started": started | taken,
            "next_omega_rad_s": rate,
            "y_theta_gear_rad": kept / PER_RAD,
            "y_omega_gear_rad_s": rate,
            "y_gear_usable": usable,
            "y_status": word(
                ~run.ok,
                ~run.whole,
                flagged,
                started & readable & ~near,
                ~usable,
                outside,
            ),
        }
    )


def test_a_step_of_the_smoothed_deflection():
    """Moved on by the rate, drawn to the counts at 8 Hz, never farther than a count from them."""
    device = load_device("elbow")
    count = 2 * math.pi / 4096

    def together(s, u, rng):
        near = rng.random(COUNT) < 0.7
        u["theta_rad"][near] = (s["theta_last_rad"] + rng.normal(0, 2 * count, COUNT))[near]
        u["theta_rad"][:] = clip(u["theta_rad"], -0.34, 0.34)
        u["omega_rad_s"][near] *= 0.02

    run = Steps(smoothed_deflection(device), together=together)
    s, u = run.s, run.u
    ahead = where(s.primed != 0, s.theta_last_rad + H * u.omega_rad_s, u.theta_rad)
    drawn = ahead - math.expm1(-16 * math.pi * H) * (u.theta_rad - ahead)
    near = clip(drawn, u.theta_rad - count, u.theta_rad + count)
    run.compare(
        {
            "next_primed": (s.primed != 0) | run.ok,
            "next_theta_last_rad": where(run.ok, near, s.theta_last_rad),
            "y_theta_smooth_rad": where(run.ok, clip(near, -0.35, 0.35), 0.7),
            "y_status": word(~run.ok, ~run.whole),
        }
    )
    ends = {p.name: p.high for p in (*run.block.state, *run.block.inputs, *run.block.outputs)}
    assert ends == pytest.approx(
        {
            "primed": 1,
            "theta_last_rad": 0.35 + 2 * count,
            "theta_rad": 0.35,
            "omega_rad_s": 25,
            "theta_smooth_rad": 0.7,
            "status": 3,
        },
        rel=1e-6,
    )
    assert all(p.low in (-p.high, 0) for p in (*run.block.state, *run.block.outputs))


def test_a_step_of_the_cuff_between_hands_and_limb():
    """Half a kick, a drift, half a kick: what damps acts at the speed of the end."""
    knee, h = load_device("knee"), 2e-4

    def together(s, u, rng):
        u["theta_l_rad"][:] = clip(s["theta_m_rad"] + rng.uniform(-0.3, 0.3, COUNT), -19, 19)
        small = rng.random(COUNT) < 0.8
        for name in ("omega_m_rad_s", "theta_prev_rad"):
            s[name][small] *= 0.01
        s["alpha_m_rad_s2"][:] *= 1e-4

    run = Steps(passive_block(knee, h), together=together)
    s, u, t = run.s, run.u, run.t
    sensor = true_sensor(knee, h)
    v = s.omega_m_rad_s + h / 2 * s.alpha_m_rad_s2
    x, rate = s.theta_m_rad + h * v, v - u.omega_l_rad_s
    held = [np.atleast_2d(getattr(s, p.name)) for p in sensor.state]
    rows = sensor.step.map(COUNT).call([*held, (x - u.theta_l_rad)[None, :], rate[None, :]])
    names = [p.name for p in (*sensor.state, *sensor.outputs)]
    shown = {n: np.array(r) for n, r in zip(names, rows, strict=True)}
    tau = shown["tau_Nm"][0]
    b = t.hand_damping_Nms_rad
    # J a = tau_hand - b (v + h/2 a - omega_l) - tau_e
    a = (u.tau_hand_Nm - b * rate - tau) / (t.cuff_inertia_kgm2 + b * h / 2)
    memory = {p.name: shown[p.name] for p in sensor.state}
    run.compare(
        {
            "next_theta_m_rad": x,
            "next_omega_m_rad_s": v + h / 2 * a,
            "next_alpha_m_rad_s2": a,
            **{f"next_{k}": m[0] if len(m) == 1 else m for k, m in memory.items()},
            "y_tau_e_Nm": tau,
            "y_theta_m_rad": x,
            "y_theta_l_rad": u.theta_l_rad,
            "y_plant_status": word(~run.ok, ~run.whole),
        }
    )


def test_what_a_motors_encoder_cannot_be_made_of(drive):
    for key in ("actuator", "joint"):
        less = type(drive)(drive.file.model_copy(update={key: None}), "x.toml")
        with pytest.raises(UserError, match=r"x.toml: the motor's encoder needs the sections"):
            gear_encoder(less)
    less = type(drive)(drive.file.model_copy(update={"joint": None}), "x.toml")
    with pytest.raises(UserError, match=r"x.toml: section \[joint\] is missing"):
        deflection(less)
