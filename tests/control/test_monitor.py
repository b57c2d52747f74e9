"""Monitors of encoders and command: roughness, stuck bits, swings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.control.limits.monitor import encoder_monitor, monitor
from tests.own_device import own_device

ROOM = 22, 22, 22, 22, 34, 66  # counts that a bit may stay
NONE, SWINGS, ROUGH, STUCK = range(4)


# -- what is sound ---------------------------------------------------------------------------------


def doubted(device, angle_rad, *, noise_rad=0.0, seed=0, change=lambda c: c, side="load"):
    """Doubt, tick by tick, of an encoder at these angles, its count changed."""
    bits = 17 if side == "gear" else int(device.file.encoder.resolution_bits.value)
    shaken = angle_rad + noise_rad * np.random.default_rng(seed).standard_normal(len(angle_rad))
    count = change(np.floor(shaken * 2**bits / (2 * math.pi)) % 2**bits)
    inputs = {"count": count, "frame_error": np.zeros(len(count))}
    y, _ = encoder_monitor(device, side).simulator().run(inputs)
    return y["doubt"].astype(int)


def swung(device, u_Nm, missed_Nm=2.0):
    """Doubt, tick by tick, of a command, with the set torque missed by so much."""
    block = monitor(device)
    inputs = {p.name: np.zeros(len(u_Nm)) for p in block.inputs}
    inputs |= {"u_command_Nm": u_Nm, "tau_set_Nm": np.broadcast_to(missed_Nm, len(u_Nm)).copy()}
    y, _ = block.simulator().run(inputs)
    return y["doubt"].astype(int)


def motion(speed_rad_s: float, amplitude_rad: float = 0.4, seconds: float = 1.0):
    t = 1e-3 * np.arange(round(1000 * seconds))
    return 0.7 + amplitude_rad * np.sin(speed_rad_s / amplitude_rad * t)


@pytest.mark.parametrize(
    "bits", [10, 12, *(pytest.param(b, marks=pytest.mark.ci) for b in (14, 17))]
)
def test_sound_encoders_are_not_doubted(bits):
    """Rest, slow and fast, steadily and in swings, coarse and fine, with noise and a wild frame."""
    device = own_device(encoder={"resolution_bits": bits})

    def wild(count):
        return np.where(np.arange(len(count)) == 300, (count + 2**bits // 100) % 2**bits, count)

    paths = [motion(0.3), motion(1.5), motion(9.0, 0.9), motion(4.0, 0.05)]
    # Rest, and a quarter, a half and one count of 12 bits in a tick.
    paths += [0.2 + 1e-3 * np.arange(1000) * v for v in (0.0, 0.383495, 0.76699, 1.5339808)]
    for k, path in enumerate(paths):
        assert not doubted(device, path, noise_rad=0.00105 * (k % 2), seed=k, change=wild).any(), k


def test_a_push_at_the_limit_and_a_movement_to_and_fro_are_no_swings(drive):
    t = 1e-3 * np.arange(3000)
    for u in (np.full(3000, 0.221), -0.221 * np.sign(np.sin(2 * np.pi * 6 * t))):
        assert not swung(drive, u).any()


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_swings_that_keep_the_torque_are_chatter(drive, way):
    """At 20 Hz; 0.18 of the full torque is 0.8 Nm, and one peak of the error counts one swing."""
    t = np.arange(3000)
    u = 0.221 * np.where(t % 50 < 25, way, -way)
    assert not swung(drive, u, 0.79 * way).any()
    assert (swung(drive, u, 0.82 * way) == SWINGS).any()
    assert not swung(drive, u, np.where(t % 500 == 7, 4.0, 0.0)).any()


# -- what is not -----------------------------------------------------------------------------------


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("value", [0, 1])
@pytest.mark.parametrize("bit", range(6))
def test_a_stuck_bit_is_found_within_the_motion_that_is_stated(drive, bit, value, way):
    def change(count):
        clear = count - count // 2**bit % 2 * 2**bit
        return clear + value * 2**bit

    speed = 0.4 * way
    path = 0.7 + 1e-3 * speed * np.arange(1000)
    found = doubted(drive, path, change=change)
    first = np.flatnonzero(found == STUCK)[0]
    # The room, and up to two blocks until what is read has moved so far.
    assert abs(path[first] - path[0]) * 4096 / (2 * math.pi) <= ROOM[bit] + 2 ** (bit + 1) + 1
    assert set(found) <= {NONE, ROUGH, STUCK}


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("value", [0, 1])
@pytest.mark.parametrize("bit", [14, 15])
def test_a_stuck_bit_of_the_motors_encoder_is_found_within_four_times_its_weight(
    drive, bit, value, way
):
    """Bit 15 is 21 mrad at the joint; slow, so that no roughness shows it."""

    def change(count):
        return count - count // 2**bit % 2 * 2**bit + value * 2**bit

    path = 0.7 + 74 * way * 0.05e-3 * np.arange(2000)
    assert not doubted(drive, path, side="gear").any()
    first = np.flatnonzero(doubted(drive, path, change=change, side="gear") == STUCK)[0]
    assert abs(path[first] - path[0]) * 2**17 / (2 * math.pi) <= 4 * 2**bit


@pytest.mark.parametrize("side", ["motor", "load"])
@pytest.mark.parametrize(("noise_rad", "ticks"), [(0.0042, 100), (0.008, 30)])
def test_noise_is_found_soon(drive, noise_rad, ticks, side):
    for seed in range(4):
        found = doubted(drive, np.full(200, 0.3), noise_rad=noise_rad, seed=seed, side=side)
        assert np.flatnonzero(found == ROUGH)[0] <= ticks


@pytest.mark.parametrize("way", [1, -1])
def test_the_motors_own_encoder_is_rough_beyond_what_the_drive_can_do(drive, way):
    """37 rad/s² of the joint, by motor and rubber, with a sound encoder's noise; gear 74."""
    t = 1e-3 * np.arange(3000)
    for turn in (4.0, 20.0, 60.0):
        path = way * 74 * 36.0 / turn**2 * np.sin(turn * t)
        assert not doubted(drive, path, noise_rad=0.00105, side="gear").any()
        shaken = doubted(drive, path, noise_rad=74 * 1e-4, side="gear")
        assert np.flatnonzero(shaken == ROUGH)[0] <= 40


@pytest.mark.parametrize(("rate_Hz", "seconds"), [(20, 1.0), (13, 3.0)])
def test_a_command_that_swings_is_found_in_the_time_that_is_stated(drive, rate_Hz, seconds):
    t = 1e-3 * np.arange(4000)
    found = swung(drive, 0.221 * np.sign(np.sin(2 * np.pi * rate_Hz * t)))
    assert 0.3 < t[np.flatnonzero(found == SWINGS)[0]] <= seconds
