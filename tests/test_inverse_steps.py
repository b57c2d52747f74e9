"""Both inverses, typed a second time in NumPy: single steps from any memory of the model.

Whatever the exact one's set-point is, next state, rate, torque, residual and flags follow from it;
that it is the right one is seen by bisection of the typed model's torque.
"""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.language.ports import threshold
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.published_inverse import filter_taps, published_inverse

from .single_steps import COUNT, Steps, word

where, clip = np.where, np.clip
H = 1e-3
# Table 3.2 of the thesis, and of the knee table 8.1, both in the order of the names.
SPRING = ("k1_Nm_rad", "k3_Nm_rad3", "alpha_Nm_rad", "beta_1_rad", "omega_rad", "stops")
NAMES = (*SPRING, "dead_zone_rad")
RATE = ("kv_Nm_rad", "A_Nms_rad", "m", "eps1_Nms_rad", "B", "n", "eps2")
ELBOW = (9.39, 239, 10.3, 62.5, 0.0197, 10, 0.0), (51.6, 53.9, 2.77, 0.0288, 0.732, 0.77, 0.013)


class Model:
    """The sensor of chapter 3, at a deflection and a rate from any memory."""

    def __init__(self, device) -> None:
        found = {k.removeprefix("elastomer."): q.value for k, q in device.quantities()}
        named = {
            **dict(zip(NAMES, ELBOW[0], strict=True)),
            **dict(zip(RATE, ELBOW[1], strict=True)),
        }
        if device.file.name != "elbow":
            named = {n: found[n if n in NAMES else f"maxwell.{n}"] for n in (*NAMES, *RATE)}
            # Where there is a dead zone, as every number format holds them.
            same = ("dead_zone_rad", "A_Nms_rad", "B", "eps1_Nms_rad", "eps2")
            named |= {n: threshold(named[n]) for n in same}
        self.e, limits = named, device.file.limits
        self.most, self.fast = limits.tau_Nm.value, limits.omega_rad_s.value
        self.far = limits.theta_rad.value
        d = device.file.domain
        self.domain = d.theta_max_rad.value, d.omega_max_rad_s.value, d.tau_full_scale_Nm.value

    def beyond(self, x):
        return np.sign(x) * np.maximum(abs(x) - self.e["dead_zone_rad"], 0)

    def at(self, s, theta, omega, ready):
        """Next state, torque, and the rate torque before its clip."""
        e, dead = self.e, self.e["dead_zone_rad"]
        last = self.beyond(where(ready, s.theta_prev_rad, theta))
        x = self.beyond(theta)
        r = e["omega_rad"] * np.arange(1, int(e["stops"]) + 1)[:, None]
        play = clip(where(ready, s.play_rad, x), x - r, x + r)
        weights = e["alpha_Nm_rad"] * np.exp(-e["beta_1_rad"] * r)
        middle = self.beyond(s.theta_prev_rad) + H / 2 * omega
        over_eta = (e["B"] * abs(omega) ** e["n"] + e["eps2"]) / (
            e["A_Nms_rad"] * abs(middle) ** e["m"] + e["eps1_Nms_rad"]
        )
        if dead:
            rests = abs(s.theta_prev_rad) <= dead
            over_eta = where(rests, e["eps2"] / e["eps1_Nms_rad"], over_eta)
        z = H * e["kv_Nm_rad"] * over_eta
        series = 1 + z / 2 + z * z / 6
        moved = clip(x - last, -self.fast * H, self.fast * H)
        raw = (s.tau_r_Nm + e["kv_Nm_rad"] * moved * series) / (1 + z * series)
        rate = clip(raw, -self.most, self.most)
        spring = e["k1_Nm_rad"] * x + e["k3_Nm_rad3"] * x**3
        return play, rate, spring + rate + (weights * (x - play)).sum(axis=0), raw


def memory_of(model):
    """Play states with a common history, but for some; requests near what is known."""
    gap = model.e["omega_rad"]

    def together(s, u, rng):
        place = s["theta_prev_rad"]
        place[:] = where(rng.random(COUNT) < 0.7, rng.uniform(-0.6, 0.6, COUNT) * model.far, place)
        turns = rng.uniform(-1, 1, (int(model.e["stops"]), COUNT))
        turns = where(rng.random(COUNT) < 0.3, np.sign(turns), turns)
        turns = where(rng.random(COUNT) < 0.1, 1.5 * turns, turns)
        s["play_rad"].base[:] = model.beyond(place) + gap * np.cumsum(turns, axis=0)
        s["primed"][:] = rng.random(COUNT) < 0.85
        near = rng.random(COUNT) < 0.75
        u["tau_Nm"][near] = rng.uniform(-1.3, 1.3, near.sum()) * model.domain[2]
        u["tau_Nm"][::97] = threshold(model.domain[2]) * rng.choice([-1, 1], COUNT)[::97]
        for name in ("v_rad_s", "a_rad_s2", "w1_rad_s", "w2_rad_s", "theta_hat_rad"):
            if name in s:
                k = rng.random(COUNT) < 0.5
                s[name][k] *= 0.02

    return together


def observed(run, model, ready, theta):
    """Next memory of the rate, whether it is clipped, and the rate of the step's middle."""
    s, p = run.s, np.exp(-2 * np.pi * H * run.t.bandwidth_Hz)
    alpha, beta, gamma = 1 - p**3, 1.5 * (1 - p) ** 2 * (1 + p) / H, (1 - p) ** 3 / H**2
    middle = s.v_rad_s + H / 2 * s.a_rad_s2
    predicted = where(ready, s.theta_hat_rad + H * middle, theta)
    e = theta - predicted
    raw = {
        "theta_hat_rad": (predicted + alpha * e, 2 * model.far),
        "v_rad_s": (s.v_rad_s + H * s.a_rad_s2 + beta * e, 4 * model.fast),
        "a_rad_s2": (s.a_rad_s2 + gamma * e, 4 * model.fast / H),
    }
    beyond = np.logical_or.reduce([abs(x) > most for x, most in raw.values()])
    kept = {k: clip(x, -most, most) for k, (x, most) in raw.items()}
    return kept, beyond


def differences(run, model, ready, theta):
    moved = where(ready, theta - run.s.theta_prev_rad, 0) / H
    kept = {"w1_rad_s": clip(moved, -model.fast, model.fast)}
    kept["w2_rad_s"] = where(ready, run.s.w1_rad_s, 0)
    return kept, abs(moved) > model.fast


@pytest.mark.parametrize("name", ["elbow", "knee"])
@pytest.mark.parametrize("rate", ["observer", "extrapolated"])
def test_a_step_of_the_exact_inverse(name, rate):
    device = load_device(name)
    model = Model(device)
    run = Steps(exact_inverse(device, rate=rate), together=memory_of(model))
    s, u = run.s, run.u
    first = s.play_rad[0] - model.beyond(s.theta_prev_rad)
    gaps = abs(np.concatenate([first[None, :], np.diff(s.play_rad, axis=0)])).max(axis=0)
    widest = model.e["omega_rad"] + 1e-5
    nested = gaps <= widest
    ready = (s.primed != 0) & run.whole & nested
    s.tau_r_Nm = where(ready, s.tau_r_Nm, 0)
    if rate == "observer":
        omega = clip(s.v_rad_s + H / 2 * s.a_rad_s2, -model.fast, model.fast)
    else:
        omega = clip(2 * s.w1_rad_s - s.w2_rad_s, -model.fast, model.fast)
    theta, last = run.found["y_theta_rad"], where(ready, s.theta_prev_rad, 0)
    assert np.all(theta[~run.ok] == last[~run.ok])
    play, tau_r, tau, raw = model.at(s, theta, omega, ready)
    kept, beyond = (observed if rate == "observer" else differences)(run, model, ready, theta)
    missing, moved = u.tau_Nm - tau, where(ready, model.beyond(theta) - model.beyond(last), 0)
    at_end = abs(theta) >= model.far * (1 - 1e-7)
    clamped = (abs(u.tau_Nm) > model.most) | at_end
    clipped = (abs(moved) > model.fast * H) | beyond | (abs(raw) > model.most)
    far, fast, full = model.domain
    run.compare(
        {
            "next_primed": ready | run.ok,
            "next_theta_prev_rad": theta,
            "next_tau_r_Nm": tau_r,
            "next_play_rad": play,
            **{f"next_{k}": v for k, v in kept.items()},
            "y_theta_rad": theta,
            "y_omega_mid_rad_s": omega,
            "y_tau_model_Nm": clip(tau, -model.most, model.most),
            "y_residual_Nm": missing,
            "y_step_rad": moved,
            "y_status": word(
                ~run.ok,
                ~(run.whole & nested),
                abs(theta) > far,
                abs(omega) > fast,
                abs(u.tau_Nm) > threshold(full),
                run.ok & clamped,
                clipped,
                run.ok & ~clamped & (abs(missing) > 5e-6 * model.most),
            ),
        },
        both="NOT_CONVERGED",
        # What each part keeps of a memory that is none is tried in test_inverse.py.
        near=~run.whole | (abs(gaps - widest) < 1e-8) | (abs(abs(raw) - model.most) < 1e-6),
    )
    low, high = np.full(COUNT, -model.far), np.full(COUNT, model.far)
    for _ in range(60):
        middle = (low + high) / 2
        below = model.at(s, middle, omega, ready)[2] < clip(u.tau_Nm, -model.most, model.most)
        low, high = where(below, middle, low), where(below, high, middle)
    dead = model.e["dead_zone_rad"]
    inside = run.ok & (abs(low) > dead + 1e-6)
    np.testing.assert_allclose(theta[inside], low[inside], atol=1e-6)
    assert inside.mean() > 0.5


def low_pass(name):
    """10 Hz, ideal but for its ends, or the eleven printed numbers."""
    n = np.arange(1, 16)
    side = np.sin(0.02 * np.pi * n) / (np.pi * n)
    ideal = np.concatenate([side[::-1], [0.02], side])
    half = np.array([0.024, 0.12, 0.23, 0.20, 0.0])
    printed = np.concatenate([half, [-0.12], half[::-1]])
    return {
        None: np.zeros(0),
        "a": ideal,
        "a_normalised": ideal / ideal.sum(),
        "b": printed,
        "b_normalised": printed / 1.028,
        "b_rounding": printed * 1.0165 / 1.028,
    }[name]


@pytest.mark.parametrize("name", ["a", "a_normalised", "b", "b_normalised", "b_rounding"])
def test_taps_of_the_published_filters(name):
    assert filter_taps(name) == pytest.approx(low_pass(name), rel=1e-12)


def envelope(torque):
    """Real root of 239 x^3 + 9.39 x, by bisection."""
    low, high = np.full(COUNT, -1.0), np.full(COUNT, 1.0)
    for _ in range(70):
        middle = (low + high) / 2
        below = (239 * middle**2 + 9.39) * middle < torque
        low, high = where(below, middle, low), where(below, high, middle)
    return low


@pytest.mark.parametrize("name", [None, "a", "b_rounding"])
@pytest.mark.parametrize("tunable", [False, True])
def test_a_step_of_the_published_inverse(name, tunable):
    model, taps = Model(load_device("elbow")), low_pass(name)

    def together(s, u, rng):
        near = rng.random(COUNT) < 0.75
        u["tau_Nm"][near] = rng.uniform(-6, 6, near.sum())
        u["tau_Nm"][::97] = threshold(4.47) * rng.choice([-1, 1], COUNT)[::97]
        s["inverse_play_rad"].base[:] *= where(rng.random(COUNT) < 0.8, 0.03, 1)
        if name:
            s["difference_Nm"].base[:] *= where(rng.random(COUNT) < 0.8, 0.1, 1)
            s["primed"][:] = rng.random(COUNT) < 0.8
            k = rng.random(COUNT) < 0.6
            s["theta_prev_rad"][k] = envelope(u["tau_Nm"])[k] + rng.normal(0, 0.01, k.sum())
            s["theta_prev_rad"][:] = clip(s["theta_prev_rad"], -0.34, 0.34)
            s["play_rad"].base[:, k] = s["theta_prev_rad"][k] + 0.01

    block = published_inverse(load_device("elbow"), name, tunable=tunable)
    run = Steps(block, together=together)
    s, u = run.s, run.u
    past = s.difference_Nm if name else np.zeros((0, COUNT))
    wanted = u.tau_Nm - taps @ past
    asked = clip(wanted, -20, 20)
    kappa, phi, chi = 0.106, 4.84, 0.00233
    if tunable:
        kappa, phi, chi = run.t.kappa_rad, run.t.phi_1_rad, run.t.chi_rad
    r = chi * np.arange(1, 11)[:, None]
    play = clip(s.inverse_play_rad, envelope(asked) - r, envelope(asked) + r)
    total = (kappa * np.exp(-phi * r) * play).sum(axis=0)
    theta = clip(total, -0.35, 0.35)
    flags = [
        ~run.ok,
        ~run.whole,
        abs(u.tau_Nm) > threshold(4.47),
        (abs(wanted) > 20) | (abs(total) > 0.35),
    ]
    expected = {"next_inverse_play_rad": play, "y_theta_rad": theta, "y_u_Nm": asked}
    near = (abs(abs(total) - 0.35) < 1e-7) | (abs(abs(wanted) - 20) < 1e-6)
    if name:
        primed = (s.primed != 0) & run.whole
        rate = where(primed, theta - s.theta_prev_rad, 0) / H
        stops, tau_r, tau, raw = model.at(s, theta, clip(rate, -25, 25), primed)
        missed = tau - asked
        flags.append((abs(rate) > 25) | (abs(missed) > 40) | (abs(raw) > 20))
        near = near | (abs(abs(rate) - 25) < 1e-5)
        expected |= {
            "next_primed": np.ones(COUNT),  # a request that is none is one of 0
            "next_theta_prev_rad": theta,
            "next_tau_r_Nm": tau_r,
            "next_play_rad": stops,
            "next_difference_Nm": np.concatenate([clip(missed, -40, 40)[None, :], past[:-1]]),
        }
    run.compare(expected | {"y_status": word(*flags)}, near=near)
    reach = {p.name: p.high for p in block.state}
    assert reach["inverse_play_rad"] == pytest.approx(4 * 20 / 9.39)
    assert reach.get("difference_Nm", 40) == pytest.approx(40)
