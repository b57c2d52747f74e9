"""Adaptation and trend typed a second time in NumPy: docs/control.md and docs/predictive.md."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy import abs, clip, exp, where

from esea_gen.control.adaptation import adaptation
from esea_gen.control.trend import trend
from tests.single_steps import COUNT, Steps, word

H, TS, FULL, TAU = 1e-3, 5e-3, 4.47, 20.0


def lag(seconds: float, h: float = H) -> float:
    return 1 - math.exp(-h / seconds)


def test_a_step_of_the_adaptation(drive):
    """[adapt 1] and [adapt 2]: a stop of 0.8 Nm on the wish; what is set fades in with 1 s."""
    run = Steps(adaptation(drive))
    c, s, tau_d = run.c, run.s, run.u.tau_desired_Nm
    neutral = {"wish_gain": (1, "gain"), "wish_loss": (0, "loss")}
    neutral["wish_offset_Nm"] = (0, "offset_Nm")
    wish = {
        name: vars(s)[name] + lag(1.0) * (zero + c.share * (vars(c)[n] - zero) - vars(s)[name])
        for name, (zero, n) in neutral.items()
    }
    held = clip(s.stop_wish_Nm, tau_d - 0.8, tau_d + 0.8)
    run.compare(
        {
            **{f"next_{n}": v for n, v in wish.items()},
            "next_stop_wish_Nm": where(s.wished != 0, held, tau_d),
            "next_wished": np.ones(COUNT),
            "y_wish_gain": wish["wish_gain"],
            "y_wish_shift_Nm": wish["wish_loss"] * (tau_d - held) + wish["wish_offset_Nm"],
            "y_status": word(~run.ok, ~run.whole),
        }
    )


def swings_on(wanted, rate, acc, trust, q, means, ends_s):
    """A sine through three equal lags, taken back by its own differential equation."""
    if not ends_s:
        return []
    rates, accs, effort = means.values()
    T = np.minimum(TS * (1 / q - 0.75), 0.012)
    seen = np.minimum(accs / (rates + 1e-6), (8 * math.pi) ** 2)
    w = np.minimum(np.sqrt(seen / (1 - (3 * T) ** 2 * seen)), 8 * math.pi)
    pair = np.array([rate - 3 * T * acc, acc])
    for _ in range(3):
        pair = pair + T * np.array([pair[1], -(w**2) * pair[0]])
    less = clip((0.78**2 - effort) / (0.78**2 - 0.65**2), 0, 1)
    share = 1 - trust * (1 - less) / (1 + (math.pi / np.maximum(w, 1e-9)) ** 4)
    apart = np.maximum(w**2, 1)
    ahead = []
    for t in ends_s:
        turn = np.minimum(w * t, 1.5 * math.pi)
        time = np.minimum(1.5 * math.pi / np.sqrt(apart), t)
        moved = (
            t * np.sinc(turn / math.pi) * pair[0]
            + time**2 / 2 * np.sinc(turn / 2 / math.pi) ** 2 * pair[1]
        )
        ahead.append(
            wanted + (1 - share) * pair[1] / apart + share * trust * math.exp(-t / 2) * moved
        )
    return ahead


@pytest.mark.parametrize("ends_s", [(), (0.022, 0.2, 1.0)])
def test_a_step_of_the_trend(drive, ends_s):
    """[trend 1] to [trend 10]: a median of three, noise that slows it down, steps set aside."""

    def together(s, u, rng):
        # Increments of the size of what counts as a step, and rates that are believed.
        size = 10.0 ** rng.uniform(-3, 0.5, COUNT)
        u["tau_wanted_Nm"][:] = clip(s["last_Nm"] + size * rng.normal(0, 1, COUNT), -TAU, TAU)
        s["noise_Nm"] *= 0.01 * rng.random(COUNT)
        for name in ("rate_Nm_s", "acc_Nm_s2", "miss_Nm"):
            s[name] *= rng.choice([1.0, 0.01], COUNT)
        if ends_s:
            s["accs_Nm2_s4"][:] = np.minimum(
                1e6, 10 ** rng.uniform(0, 3, COUNT) * s["rates_Nm2_s2"]
            )

    run = Steps(trend(drive, ends_s), together=together)
    s, u = run.s, run.u
    turn = 2 * math.pi * (4 if ends_s else 3)
    rate_most, acc_most = turn * FULL, turn**2 * FULL
    np.testing.assert_allclose(run.c.quick, 1 - exp(-2 * math.pi * TS * run.t.bandwidth_Hz))
    np.testing.assert_allclose(run.c.noises_1_Nm, 1 / run.t.quiet_Nm)
    fresh = where(s.primed != 0, u.tau_wanted_Nm - s.last_Nm, 0)
    middle = np.median([fresh, *s.raw_Nm], axis=0)
    aside, room = fresh - middle, 0.01 + 4 * s.noise_Nm
    left = np.maximum(2 * room - abs(aside), 0)
    kept = clip(aside, -left, left)
    grown = middle + kept
    stepped = np.maximum(np.minimum(abs(aside - kept) / 0.1, 1), s.stepped * math.exp(-TS / 0.15))
    bend = abs(grown - 2 * s.grown_Nm[0] + s.grown_Nm[1])
    noise = s.noise_Nm + lag(0.2, TS) * (bend - s.noise_Nm)
    per = run.c.noises_1_Nm
    q = run.c.quick / (1 + np.minimum(per * np.maximum(noise, bend), 100))
    p = 1 - q
    miss = s.miss_Nm + grown - TS * s.rate_Nm_s - TS**2 / 2 * s.acc_Nm_s2
    rate = s.rate_Nm_s + TS * s.acc_Nm_s2 + 1.5 * q**2 * (1 + p) / TS * miss
    acc = s.acc_Nm_s2 + q**3 / TS**2 * miss
    full = (abs(rate) > rate_most) | (abs(acc) > acc_most)
    near = (abs(abs(rate) / rate_most - 1) < 1e-6) | (abs(abs(acc) / acc_most - 1) < 1e-6)
    rate, acc = clip(rate, -rate_most, rate_most), clip(acc, -acc_most, acc_most)
    trust = 1 / (1 + (np.minimum(per * noise, 100) / 10) ** 2)
    means = {}
    if ends_s:
        values = {"rates_Nm2_s2": rate, "accs_Nm2_s4": acc, "effort": u.u_Nm / 0.221}
        means = {
            f"next_{n}": vars(s)[n] + lag(0.5, TS) * (v**2 - vars(s)[n]) for n, v in values.items()
        }
    ahead = [
        clip(x, -TAU, TAU) for x in swings_on(u.tau_wanted_Nm, rate, acc, trust, q, means, ends_s)
    ]
    miss_most = 4 * TAU
    run.compare(
        {
            "next_primed": (s.primed != 0) | run.ok,
            "next_last_Nm": u.tau_wanted_Nm,
            "next_raw_Nm": np.array([fresh, s.raw_Nm[0]]),
            "next_grown_Nm": np.array([grown, s.grown_Nm[0]]),
            "next_noise_Nm": noise,
            "next_stepped": stepped,
            "next_miss_Nm": clip(p**3 * miss, -miss_most, miss_most),
            "next_rate_Nm_s": rate,
            "next_acc_Nm_s2": acc,
            **({"y_tau_ahead_Nm": np.array(ahead)} | means if ends_s else {}),
            "y_tau_rate_Nm_s": rate,
            "y_tau_curve_Nm_s2": acc,
            "y_trust": trust,
            "y_settled": 1 - stepped,
            "y_status": word(~run.ok, ~run.whole, full),
        },
        near=near,
    )
