"""The passive sensor in the twin: cuff, dead zone, encoders; each against a second way."""

from __future__ import annotations

import math

import numpy as np
import pytest

import esea_gen
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_block, compile_system
from esea_gen.model.inverse import exact_inverse
from esea_gen.twin.parameters import STEP_S
from esea_gen.twin.passive import ENCODER_NOISE_RAD, HAND_Nms_rad, PassiveTwin, passive_system

CUFF_kgm2 = 0.003
DEAD_ZONE_RAD = math.radians(2.81)


@pytest.fixture(scope="module")
def knee():
    return esea_gen.load_device("knee")


@pytest.fixture(scope="module")
def twin(knee):
    return PassiveTwin(knee)


@pytest.fixture(scope="module")
def plant(knee):
    """Cuff and coupling alone, step by step."""
    return compile_system(passive_system(knee), "f64").block("plant")


@pytest.fixture(scope="module")
def slow(twin):
    """Hands that push and pull slowly on a limb that moves."""
    t = np.arange(0, 8, 0.002)
    tau, angle = 12 * np.sin(2 * math.pi * 0.25 * t), 1 + 0.8 * np.sin(2 * math.pi * 0.2 * t)
    return t, tau, angle, twin.run(t, tau, angle, np.random.default_rng(3))


def moved(plant, tau, seconds):
    """The cuff under a torque, the limb held: time, angle, torque of the coupling."""
    n = round(seconds / STEP_S)
    still = {"theta_l_rad": np.zeros(n), "omega_l_rad_s": np.zeros(n)}
    plant.reset()
    out, _ = plant.run({"tau_hand_Nm": np.full(n, tau), **still}, trace=False)
    return STEP_S * np.arange(1, n + 1), out["theta_m_rad"], out["tau_e_Nm"]


def test_in_the_dead_zone_the_cuff_is_a_mass_with_a_damper(plant):
    """J w' = tau - b w in closed form, until the coupling is touched."""
    t, theta, tau_e = moved(plant, 0.5, 0.2)
    inside = theta < DEAD_ZONE_RAD
    lag_s = CUFF_kgm2 / HAND_Nms_rad
    exact = 0.5 / HAND_Nms_rad * (t - lag_s * -np.expm1(-t / lag_s))
    assert 0.04 < t[inside][-1] < 0.07  # it takes its time to cross
    assert np.abs(theta - exact)[inside].max() < 1e-4
    assert np.all(tau_e[inside] == 0)
    assert tau_e.max() > 0.3


def test_what_the_hands_do_not_spend_on_the_cuff_reaches_the_limb(plant):
    """Impulse: of hands, less damper and coupling, is J w; and at rest all of it passes."""
    t, theta, tau_e = moved(plant, 10.0, 1.0)
    speed = np.gradient(theta, STEP_S)
    left = np.cumsum(10.0 - tau_e) * STEP_S - HAND_Nms_rad * theta
    assert left[:-1] == pytest.approx(CUFF_kgm2 * speed[:-1], abs=2e-3)
    assert tau_e[t > 0.8] == pytest.approx(10.0, abs=0.05)


def test_away_from_the_dead_zone_it_is_the_exact_inverse(plant, knee, slow):
    """Deflection from the torque through the model: the other way to it, solved and not moved."""
    t, tau, angle, run = slow
    want, _ = compile_block(exact_inverse(knee)).run({"tau_Nm": run.tau_true_Nm}, trace=False)
    theta_l = np.interp(run.time_s, t, angle)
    # The limb's own torque, in the plant's step.
    h = np.arange(len(t) * round(0.002 / STEP_S)) * STEP_S
    limb = np.interp(h, t, angle)
    plant.reset()
    plant.put_state({"theta_m_rad": limb[0]})
    out, _ = plant.run(
        {
            "tau_hand_Nm": np.interp(h, t, tau),
            "theta_l_rad": limb,
            "omega_l_rad_s": np.diff(limb, prepend=limb[0]) / STEP_S,
        },
        trace=False,
    )
    twist = np.interp(run.time_s, h, out["theta_m_rad"]) - theta_l
    apart = (np.abs(run.tau_true_Nm) > 5) & (run.time_s > 0.5)
    assert apart.mean() > 0.5
    assert np.abs(twist - want["theta_rad"])[apart].max() < 1e-3  # of 0.1 rad
    assert np.abs(run.tau_true_Nm - np.interp(run.time_s, t, tau))[apart].max() < 0.5


def test_encoders_count_and_are_noisy(knee, twin, slow):
    t, _, angle, run = slow
    count = 2 * math.pi / 4096
    assert twin.count_rad == pytest.approx(count)
    whole = run.theta_l_rad / count
    assert whole == pytest.approx(np.round(whole), abs=1e-6)
    off = run.theta_l_rad - np.interp(run.time_s, t, angle)
    assert np.abs(off).max() < 1.5 * count + 5 * ENCODER_NOISE_RAD
    # Held still, it is the noise that makes counts change.
    at, seen = np.arange(2000) * 1e-3, {}
    for noise in (0.0, 4 * ENCODER_NOISE_RAD):
        twin.encoder_noise_rad, before = noise, twin.encoder_noise_rad
        held = twin.run(at, 0 * at, 0 * at + 0.7, np.random.default_rng(5))
        twin.encoder_noise_rad, seen[noise] = before, np.ptp(held.theta_l_rad)
    quiet, noisy = seen.values()
    assert quiet == 0
    assert noisy >= count / 2


def test_its_own_c_reads_the_torque(slow):
    """Sensor and plant have the same rubber: what is left is counts, noise, and the dead zone."""
    *_, run = slow
    off = run.tau_Nm - run.tau_true_Nm
    assert 0.02 < np.sqrt(np.mean(off**2)) < 0.25
    assert np.abs(off).max() < 1.0


def test_the_same_seed_the_same_run(twin, slow):
    t, tau, angle, run = slow
    assert np.array_equal(twin.run(t, tau, angle, np.random.default_rng(3)).tau_Nm, run.tau_Nm)
    assert not np.array_equal(twin.run(t, tau, angle, np.random.default_rng(4)).tau_Nm, run.tau_Nm)


def test_hands_beyond_the_plant_are_refused(twin):
    for tau in ([0.0, math.nan], [0.0, 2000.0]):
        with pytest.raises(UserError, match="leave the plant's ranges"):
            twin.run(np.array([0.0, 0.1]), np.array(tau), np.zeros(2), np.random.default_rng(1))
    with pytest.raises(UserError, match="one axis and no motor"):
        PassiveTwin(esea_gen.load_device("wrist"))
