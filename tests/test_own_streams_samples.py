"""Streams of the reference, the sliding mode, the trend, the person and the limits, each sample."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.special import betainc

from esea_gen.control import limits_streams
from esea_gen.control.limits import limits
from esea_gen.control.reference import reference
from esea_gen.control.reference_streams import STREAMS as OF_REFERENCE
from esea_gen.control.sliding_mode import sliding_mode
from esea_gen.control.sliding_mode_streams import STREAMS as OF_SLIDING_MODE
from esea_gen.control.trend import trend
from esea_gen.language.stream import SPECIAL
from esea_gen.observe.human import extended_state
from esea_gen.observe.human_streams import STREAMS as OF_PERSON

from .test_linear_loop import variant

SEED = 3
T = np.arange(3000)


def same(found, typed, scale):
    """Equal to a float32 number's rounding, and what is none likewise."""
    np.testing.assert_allclose(found, typed, rtol=2e-7, atol=2e-7 * scale)


def spoilt(x, share, rng):
    """A few samples that are no number."""
    hit = rng.random(len(x)) < share
    x[hit] = rng.choice(SPECIAL, int(hit.sum()))
    return np.float32(x)


def test_the_references_inputs_swing_about_their_middles(drive):
    block, rng = reference(drive), np.random.default_rng(SEED)
    (stream,) = OF_REFERENCE.events(block, np.random.default_rng(SEED))
    for i, p in enumerate(block.inputs):
        x = 0.5 * (p.high + p.low) + 0.3 * (p.high - p.low) * np.sin(T / (40 + 7 * i))
        if p.name == "mode":
            x = np.repeat([1.0, 2.0, 0.0, 2.0, 1.0, 0.0] * 2, 250)
        same(stream.inputs[p.name], spoilt(x, 0.002, rng), p.high)


def test_what_the_sliding_mode_is_given_besides_the_command(drive):
    block, rng = sliding_mode(drive), np.random.default_rng(SEED)
    streams = OF_SLIDING_MODE.events(block, np.random.default_rng(SEED))
    grow = 10 ** ((T % 900) / 450 - 2)
    most = 74 * 0.221 / 0.663
    for name, size, period in (
        ("delta_set_rad", 0.3 * 0.35, 260),
        ("theta_rad", 0.3 * 0.35, 240),
        ("delta_rate_rad_s", 0.05 * 25, 70),
        ("delta_acc_rad_s2", 0.02 * 3 * most, 50),
        ("omega_motor_rad_s", 0.05 * 12, 80),
        ("omega_load_rad_s", 0.05 * 12, 85),
        ("tau_Nm", 2, 150),
        ("tau_h_Nm", 2, 190),
        ("d4_rad_s2", 0.1 * most, 110),
        ("u_a_Nm", 0.5 * 0.221, 60),
    ):
        wave = size * np.sin(2 * np.pi * T / period + rng.uniform(0, 6))
        typed = wave * (grow if period in (240, 260) else grow + 0.2)
        for stream in streams:
            same(stream.inputs[name], typed, size)
    asked = np.where(T % 680 >= 510, 0, np.where(T % 1400 < 700, 1, 2))
    assert all(np.array_equal(s.inputs["mode"], asked) for s in streams)
    assert [s.steps for s in streams] == [3000, 3000]


def test_the_trend_is_tried_with_steps_noise_and_full_scale(drive):
    block, rng = trend(drive), np.random.default_rng(SEED)
    (stream,) = block.streams.events(block, np.random.default_rng(SEED))
    steps = rng.random(3000) < 0.004
    x = 4 * np.sin(T / 60) + np.cumsum(steps * rng.normal(0, 0.4, 3000))
    x += np.where(T % 1000 >= 500, rng.normal(0, 0.04, 3000), 0)
    x[2600:] = 20 * np.sign(np.sin(T[2600:] / 7))
    same(stream.inputs["tau_wanted_Nm"], spoilt(np.clip(x, -20, 20), 0.003, rng), 20)


@pytest.mark.parametrize(
    ("human_Nm", "sweep"),
    # The fastest a joint of 12 rad/s may turn for a third of it; a weak person takes longer.
    [(20.0, 35 / 16 * 4.3 / 3.6), (1.0, np.sqrt(7.6 * 4.3 * 0.22 / 0.3))],
)
def test_the_joint_sweeps_as_fast_as_the_person_can(human_Nm, sweep):
    block = extended_state(variant(joint__tau_human_max_Nm=human_Nm))
    ordinary, unseen = OF_PERSON.events(block, np.random.default_rng(SEED))
    low, high, steps = -0.95, 3.35, round(1000 * sweep)
    beside = np.array([2e-3, 5e-4, 3e-4, 1e-4, 0])
    ends = [1.2, *(high - beside), *(low + beside)]
    parts = [np.full(200, 1.2)]
    for a, b in pairwise(ends):
        x = np.linspace(0, 1, max(200, round(steps * abs(b - a) / 4.3)))
        parts += [a + (b - a) * betainc(4, 4, x), np.full(200, b)]
    angles = np.concatenate(parts)
    same(ordinary.inputs["theta_load_rad"], angles, 4)
    wave = np.sin(2 * np.pi * np.arange(len(angles)) / 3000) ** 3
    same(ordinary.inputs["tau_Nm"], 0.2 * human_Nm * wave, 1)
    up = np.linspace(low, high, steps)
    way = np.concatenate([up, np.full(200, high), up[::-1], np.full(200, low)])
    half = steps // 2
    way[half : 2 * half + 100] = np.nan
    way[steps + 200 + half : steps + 200 + 2 * half + 100] = np.nan
    same(unseen.inputs["theta_load_rad"], way, 4)
    assert not unseen.inputs["tau_Nm"].any()
    assert (ordinary.rough, unseen.rough) == (False, True)


# The limits of the shipped drive: 0.221 Nm, 8 Nm, 0.3 rad, 10 rad/s, -0.15 to 2.5 rad.
MIDDLE, HALF, BENT = 1.175, 1.325, 0.2 * 0.3
QUIET = {
    "tau_Nm": 0.8,
    "theta_rad": BENT,
    "theta_load_rad": MIDDLE,
    "theta_motor_rad": MIDDLE + BENT,
    **dict.fromkeys(("request_ok", "sensing_ok", "clock_ok", "coeffs_ok"), 1.0),
    **dict.fromkeys(("omega_load_rad_s", "omega_motor_rad_s", "stop", "late_level"), 0.0),
}


def quiet(steps, reach, rng):
    """A joint where all is in order, released from step 3 on, with a command that wanders."""
    x = {n: np.full(steps, v) for n, v in QUIET.items()}
    k = np.arange(steps)
    x["control_beat"] = 1.0 + (240 + k // 5) % 255
    wild = rng.uniform(-reach, reach, steps // 5 + 1) * 0.221
    x["u_command_Nm"] = np.repeat(wild, 5)[:steps]
    x["mode"], x["rearm"] = np.zeros(steps), np.zeros(steps)
    release(x, 3)
    return x


def release(x, at):
    x["mode"][at : at + 8] = x["u_command_Nm"][at : at + 8] = x["stop"][at : at + 8] = 0
    x["rearm"][at + 4 :] = (x["rearm"][at] + 1) % 8
    x["mode"][at + 8 :] = 1


def alike(stream, typed):
    assert set(stream.inputs) == set(typed)
    for name, x in typed.items():
        np.testing.assert_allclose(stream.inputs[name], x, rtol=1e-6, atol=1e-6, err_msg=name)


def test_the_joint_of_the_limits_goes_to_both_ends_of_its_range_and_speed(drive):
    x = quiet(3000, 1.6, np.random.default_rng(SEED))
    wave = np.sin(2 * np.pi * np.arange(400) / 399)
    for at, reach in ((17, HALF - 0.06), (417, HALF + 0.12)):
        x["theta_load_rad"][at : at + 400] = MIDDLE + reach * wave
        x["theta_motor_rad"][at : at + 400] = MIDDLE + (reach + BENT) * wave
    for at, fast in ((817, 8.7 * wave), (1617, 9.5 * wave)):
        x["omega_load_rad_s"][at : at + 400] = fast
        x["omega_motor_rad_s"][at : at + 400] = 0.5 * fast
        x["omega_load_rad_s"][at + 400 : at + 800] = -0.5 * fast
        x["omega_motor_rad_s"][at + 400 : at + 800] = fast
    x["mode"][2417:2457], x["mode"][2457:2477] = 0, 2
    alike(limits_streams._held_back(limits(drive), np.random.default_rng(SEED)), x)


def test_the_limits_are_given_energy_braked_and_left_to_forget(drive):
    """7.2 Nm at 7.5 rad/s are 54 W: 15 J and a fifth more in 333 ms."""
    x = quiet(2 * 333 + 1700 + 400, 0.5, np.random.default_rng(SEED))
    for at, omega in ((17, 7.5), (368, -7.5)):
        x["tau_Nm"][at : at + 333] = 7.2
        x["omega_load_rad_s"][at : at + 333] = omega
        release(x, at + 337)
    release(x, 719 + 1300)
    alike(limits_streams._energy(limits(drive), np.random.default_rng(SEED)), x)


def test_requests_that_must_be_refused_and_one_after_each(drive):
    x = quiet(1500, 0.5, np.random.default_rng(SEED))
    at = 3
    x["rearm"][:] = 0
    x["mode"][:] = 0

    def request(jump=1, **others):
        nonlocal at
        x["rearm"][at:] = (x["rearm"][at] + jump) % 8
        for name, value in ({"mode": 0, "u_command_Nm": 0} | others).items():
            x[name][at : at + 4] = value
        at += 7

    def released():
        nonlocal at
        release(x, at)
        at += 14

    def latched():
        nonlocal at
        x["stop"][at : at + 2] = 1
        at += 5

    x["u_command_Nm"][:] = np.repeat(
        np.random.default_rng(SEED).uniform(-0.5, 0.5, 301) * 0.221, 5
    )[:1500]
    request(3)
    for _ in range(9):
        released()
    for jump in (2, 5, 7):
        latched()
        request(jump)
        released()
    for wrong in ({"mode": 1}, {"u_command_Nm": 0.01}, {"stop": 1}, {"tau_Nm": 8.8}):
        latched()
        request(**wrong)
        released()
    request()
    released()
    latched()
    x["rearm"][at] = 3.5
    # What is no number is none to count from.
    at += 1
    request()
    released()
    alike(limits_streams._requests(limits(drive), np.random.default_rng(SEED)), x)
