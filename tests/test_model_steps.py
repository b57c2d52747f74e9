"""Blocks of the coupling, typed a second time in NumPy: single steps, any memory.

Every next state, output and flag, at the edges of ranges and beyond.  Numbers are those of table
3.2 of the thesis and of ``elbow_drive.toml`` and ``knee.toml``, typed by hand.  The front end of an
encoder is typed in ``test_encoder.py``.
"""

from __future__ import annotations

from math import ceil, exp, log, pi
from pathlib import Path

import numpy as np
import pytest

import esea_gen
from esea_gen.device import load_device, parse_device
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.filters import tracking_observer
from esea_gen.model.joint import deflection

from .conftest import without
from .single_steps import COUNT, Steps, word

where, clip = np.where, np.clip
H = 1e-3


def test_a_step_of_the_rate(drive):
    """A triple pole: [obs 1] to [obs 3] with the gains of the fading memory."""

    def together(s, u, rng):
        k = rng.random(COUNT) < 0.5
        u["theta_rad"][k] = clip(
            s["theta_hat_rad"][k] + 1e-3 * rng.normal(size=k.sum()), -0.34, 0.34
        )

    run = Steps(tracking_observer(drive), together=together)
    s, u = run.s, run.u
    p = np.exp(-2 * pi * H * run.t.bandwidth_Hz)
    alpha, beta, gamma = 1 - p**3, 1.5 * (1 - p) ** 2 * (1 + p) / H, (1 - p) ** 3 / H**2
    for name, x in {"alpha": alpha, "beta_1_s": beta, "gamma_1_s2": gamma}.items():
        np.testing.assert_allclose(getattr(run.c, name), x, rtol=1e-6)
    # What stands in for an angle that is none is the angle that is known, primed or not.
    predicted = s.theta_hat_rad + H * s.v_rad_s + H * H / 2 * s.a_rad_s2
    predicted = where(s.primed != 0, predicted, u.theta_rad)
    e = u.theta_rad - predicted
    middle, rate = s.v_rad_s + H / 2 * s.a_rad_s2, s.v_rad_s + H * s.a_rad_s2 + beta * e
    run.compare(
        {
            "next_primed": (s.primed != 0) | run.ok,
            "next_theta_hat_rad": clip(predicted + alpha * e, -0.7, 0.7),
            "next_v_rad_s": clip(rate, -100, 100),
            "next_a_rad_s2": clip(s.a_rad_s2 + gamma * e, -1e5, 1e5),
            "y_omega_rad_s": clip(rate, -25, 25),
            "y_omega_mid_rad_s": clip(middle, -25, 25),
            "y_status": word(~run.ok, ~run.whole, (abs(rate) > 25) | (abs(middle) > 25)),
        },
        near=(abs(abs(rate) - 25) < 1e-4) | (abs(abs(middle) - 25) < 1e-4),
    )


def test_a_step_of_the_deflection(drive):
    """What can be trusted: both encoders, the comparison, and a deflection in its range."""

    def together(_s, u, rng):
        k = rng.random(COUNT) < 0.6
        u["theta_motor_rad"][k] = clip(
            u["theta_load_rad"][k] + rng.uniform(-0.5, 0.5, k.sum()), -3, 3
        )
        u["motor_usable"][k] = u["load_usable"][k] = 1

    run = Steps(deflection(drive), together=together)
    u = run.u
    delta = u.theta_motor_rad - u.theta_load_rad
    outside = abs(delta) > 0.35
    usable = (u.motor_usable >= 0.5) & (u.load_usable >= 0.5)
    agree = u.agree >= 0.5
    run.compare(
        {
            "y_theta_rad": clip(delta, -0.35, 0.35),
            "y_sensing_ok": run.ok & usable & agree & ~outside,
            "y_status": word(~run.ok, ~usable, outside, ~agree),
        },
        near=abs(abs(delta) - 0.35) < 1e-7,
    )


# Table 3.2: k1, k3, alpha, beta, omega; kv, A, m, eps1, B, n, eps2.
ELBOW = (9.39, 239, 10.3, 62.5, 0.0197), (51.6, 53.9, 2.77, 0.0288, 0.732, 0.77, 0.013)


@pytest.mark.parametrize("tunable", [False, True])
def test_a_step_of_the_torque(tunable):
    """(3.1) to (3.11), the Maxwell element by a series of third order."""

    def together(s, u, rng):
        # From one step to the next the coupling turns a little; rates of three decades.
        u["theta_rad"][:] = clip(s["theta_prev_rad"] + rng.uniform(-0.03, 0.03, COUNT), -0.34, 0.34)
        k = rng.random(COUNT) < 0.5
        u["omega_rad_s"][k] = 2 * 10 ** rng.uniform(-3, 0, k.sum())

    block = torque_sensor(load_device("elbow"), tunable=tunable)
    run = Steps(block, together=together)
    s, u, t = run.s, run.u, run.t
    spring, rate = ELBOW
    if tunable:
        names = ("k1_Nm_rad", "k3_Nm_rad3", "alpha_Nm_rad", "beta_1_rad", "omega_rad")
        names_of_rate = ("kv_Nm_rad", "A_Nms_rad", "m", "eps1_Nms_rad", "B", "n", "eps2")
        shipped = block.default_tunables()
        assert [shipped[n] for n in (*names, *names_of_rate)] == pytest.approx([*spring, *rate])
        spring, rate = ([getattr(t, n) for n in ns] for ns in (names, names_of_rate))
    k1, k3, alpha, beta, omega = spring
    kv, a, m, eps1, b, n, eps2 = rate
    primed = (s.primed != 0) & run.whole
    last = where(primed, s.theta_prev_rad, u.theta_rad)
    theta, moved = u.theta_rad, u.theta_rad - last
    r = omega * np.arange(1, 11)[:, None]
    play = clip(where(primed, s.play_rad, theta), theta - r, theta + r)
    hysteresis = (alpha * np.exp(-beta * r) * (theta - play)).sum(axis=0)
    halfway = s.theta_prev_rad + H / 2 * u.omega_rad_s
    eta = (a * abs(halfway) ** m + eps1) / (b * abs(u.omega_rad_s) ** n + eps2)
    x = H * kv / eta
    # exp(x) - 1 over x, as far as the third order.
    series = 1 + x / 2 + x * x / 6
    turned = clip(moved, -25 * H, 25 * H)
    raw = (s.tau_r_Nm + kv * turned * series) / (1 + x * series)
    maxwell, spring_Nm = clip(raw, -20, 20), k1 * theta + k3 * theta**3
    total = spring_Nm + maxwell + hysteresis
    outside = [
        abs(theta) > 11.5 * pi / 180,
        abs(u.omega_rad_s) > 61.6 * pi / 180,
        abs(total) > 4.47,
    ]
    clipped = [abs(moved) > 25 * H, abs(raw) > 20]
    run.compare(
        {
            "next_primed": primed | run.ok,
            "next_theta_prev_rad": theta,
            "next_tau_r_Nm": maxwell,
            "next_play_rad": play,
            "y_tau_Nm": clip(total, -20, 20),
            "y_tau_spring_Nm": clip(spring_Nm, -20, 20),
            "y_tau_rate_Nm": maxwell,
            "y_tau_hysteresis_Nm": clip(hysteresis, -20, 20),
            "y_status": word(~run.ok, ~run.whole, *outside, *clipped),
        },
        near=abs(abs(raw) - 20) < 1e-4,
    )


def test_a_step_of_a_torque_with_a_dead_zone():
    """(8.7), (8.8): nothing inside it, the Maxwell element at rest there."""
    device = load_device("knee")
    e = {k.removeprefix("elastomer."): q.value for k, q in device.quantities()}
    dead, kv = e["dead_zone_rad"], e["maxwell.kv_Nm_rad"]
    run = Steps(torque_sensor(device))
    s, u = run.s, run.u
    limits = device.file.limits

    def beyond(x):
        return np.sign(x) * np.maximum(abs(x) - dead, 0)

    h, most, reach = (
        device.period_s,
        limits.tau_Nm.value,
        limits.omega_rad_s.value * device.period_s,
    )
    primed = (s.primed != 0) & run.whole
    last = where(primed, s.theta_prev_rad, u.theta_rad)
    delta = beyond(u.theta_rad)
    r = e["omega_rad"] * np.arange(1, int(e["stops"]) + 1)[:, None]
    play = clip(where(primed, s.play_rad, delta), delta - r, delta + r)
    weight = e["alpha_Nm_rad"] * np.exp(-e["beta_1_rad"] * r)
    gain = (
        e["maxwell.A_Nms_rad"]
        * abs(beyond(s.theta_prev_rad) + h / 2 * u.omega_rad_s) ** e["maxwell.m"]
        + e["maxwell.eps1_Nms_rad"]
    )
    drag = e["maxwell.B"] * abs(u.omega_rad_s) ** e["maxwell.n"] + e["maxwell.eps2"]
    still = e["maxwell.eps2"] / e["maxwell.eps1_Nms_rad"]
    x = h * kv * where(abs(s.theta_prev_rad) > dead, drag / gain, still)
    series = 1 + x / 2 + x * x / 6
    turned = clip(delta - beyond(last), -reach, reach)
    raw = (s.tau_r_Nm + kv * turned * series) / (1 + x * series)
    spring_Nm = e["k1_Nm_rad"] * delta + e["k3_Nm_rad3"] * delta**3
    total = spring_Nm + clip(raw, -most, most) + (weight * (delta - play)).sum(axis=0)
    found = run.found
    clear = (abs(abs(raw) - most) > 1e-4) & (abs(abs(s.theta_prev_rad) - dead) > 1e-7)
    assert clear.mean() > 0.9
    assert 50 < np.sum(delta == 0) < COUNT
    for name, wanted in (
        ("next_tau_r_Nm", clip(raw, -most, most)),
        ("y_tau_spring_Nm", clip(spring_Nm, -most, most)),
        ("y_tau_Nm", clip(total, -most, most)),
    ):
        np.testing.assert_allclose(found[name][clear], wanted[clear], rtol=2e-6, atol=2e-5)
    np.testing.assert_allclose(found["next_play_rad"], play, atol=1e-6)
    assert exp(-kv * h * still) > 0.5  # a step at rest does not forget all


def test_without_rate_terms_nothing_is_remembered_but_the_stops():
    text = (Path(esea_gen.__file__).parent / "devices/elbow.toml").read_text(encoding="utf-8")
    plain = parse_device(without(text, "elastomer.maxwell"), "plain.toml")
    block = torque_sensor(plain)
    assert (block.split, block.facts) == ({}, {})
    run = Steps(block)
    for name in ("next_tau_r_Nm", "y_tau_rate_Nm"):
        assert not run.found[name].any()
    theta = run.u.theta_rad
    np.testing.assert_allclose(
        run.found["y_tau_spring_Nm"], 9.39 * theta + 239 * theta**3, rtol=2e-6, atol=1e-6
    )


@pytest.mark.parametrize(("name", "dead"), [("elbow", 0.0), ("knee", None)])
def test_where_the_analysis_of_errors_cuts_the_viscosity(name, dead):
    """Each part of deflection and rate spans one factor, at least 3, in at most seven parts."""
    device = load_device(name)
    e = {k.removeprefix("elastomer."): q.value for k, q in device.quantities()}
    dead = e["dead_zone_rad"] if dead is None else dead
    limits, block = device.file.limits, torque_sensor(device)
    assert block.facts == {"share": (0.0, 1.0)}
    assert set(block.split) == {"s_theta_prev_rad", "u_omega_rad_s"}
    for port, own, names, reach in (
        (
            "s_theta_prev_rad",
            dead,
            ("A_Nms_rad", "m", "eps1_Nms_rad"),
            limits.theta_rad.value - dead,
        ),
        ("u_omega_rad_s", 0.0, ("B", "n", "eps2"), limits.omega_rad_s.value),
    ):
        gain, power, least = (e[f"maxwell.{n}"] for n in names)
        cuts = list(block.split[port])
        if own:
            assert cuts.pop(0) == pytest.approx(own, rel=1e-6)
        levels = [gain * (x - own) ** power + least for x in cuts]
        top = gain * reach**power + least
        factor = max(3.0, (top / least) ** (1 / 6))
        count = ceil(log(0.999 * top / least) / log(factor)) - 1
        assert len(levels) == count <= 6
        assert levels == pytest.approx([least * factor ** (k + 1) for k in range(count)], rel=1e-4)
