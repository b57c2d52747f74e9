"""Estimators a second time: as fits through the past, and as integrals in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.control.setpoint import setpoint_rates
from esea_gen.model.filters import tracking_observer
from esea_gen.observe.disturbance import drive_observer

H = 1e-3
N, J, FV, FC, WIDTH, TAU_C = 74.0, 0.663, 0.5551, 0.4688, 0.05, 0.03488


def fitted(theta: np.ndarray, bandwidth: float) -> np.ndarray:
    """Angle, rate and acceleration of the parabola that fits the past best.

    A tracking observer with a triple real pole p is the least-squares parabola through all of the
    past, a sample n periods old counting p^n.  Before the first sample lies rest at its value.
    """
    p = math.exp(-2 * math.pi * bandwidth * H)
    count = math.ceil(60 / (1 - p))
    age = np.arange(count)
    design = np.stack([np.ones(count), -age * H, (age * H) ** 2 / 2], axis=1)
    weighted = design.T * p**age
    row = np.linalg.solve(weighted @ design, weighted)
    past = np.concatenate([np.full(count - 1, theta[0]), theta])
    return np.stack([np.convolve(past, r, mode="valid") for r in row])


def ramp_and_stop(end_rad: float, rate_rad_s: float, wait: int = 400) -> np.ndarray:
    ramp = np.arange(-end_rad, end_rad, rate_rad_s * H)
    return np.concatenate([np.full(20, -end_rad), ramp, np.full(wait, end_rad)])


def wander(reach_rad: float, seed: int, count: int = 1500) -> np.ndarray:
    t = np.arange(count) * H
    rng = np.random.default_rng(seed)
    waves = sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.7, 2.3, 5.1))
    return reach_rad / 3 * waves + rng.normal(0, 2e-4, count)


# -- the deflection's rate -------------------------------------------------------------------------


@pytest.mark.parametrize("bandwidth", [5.0, 15.0, 40.0])
def test_the_deflection_rate_is_that_of_the_best_parabola(elbow, bandwidth):
    theta = wander(0.1, 1)
    angle, rate, acceleration = fitted(theta, bandwidth)
    simulator = tracking_observer(elbow).simulator({"bandwidth_Hz": bandwidth})
    y, s = simulator.run({"theta_rad": theta})
    assert not np.any(y["status"])
    assert y["omega_rad_s"] == pytest.approx(rate, abs=1e-7)
    assert s["theta_hat_rad"] == pytest.approx(angle, abs=1e-9)
    middle = np.concatenate([[0.0], (rate + H / 2 * acceleration)[:-1]])
    assert y["omega_mid_rad_s"] == pytest.approx(middle, abs=1e-7)


@pytest.mark.parametrize("bandwidth", [15.0, 40.0])
def test_what_overshoots_the_ports_range_is_not_cut(elbow, bandwidth):
    # From a steady ramp to a stop just inside the deflection's range of 0.35 rad: the estimate
    # goes on beyond it, and the rate comes back as it would anywhere else.
    theta = ramp_and_stop(0.349, 6.0)
    angle, rate, _ = fitted(theta, bandwidth)
    assert 0.352 < np.max(angle) < 0.7
    assert np.max(np.abs(rate)) < 25
    y, s = tracking_observer(elbow).simulator({"bandwidth_Hz": bandwidth}).run({"theta_rad": theta})
    assert not np.any(y["status"])
    assert s["theta_hat_rad"] == pytest.approx(angle, abs=1e-9)
    assert y["omega_rad_s"] == pytest.approx(rate, abs=1e-7)


def test_a_rate_beyond_its_range_is_cut_in_the_output_alone(elbow):
    theta = np.concatenate([np.zeros(20), np.full(300, 0.3)])
    _, rate, acceleration = fitted(theta, 40.0)
    middle = np.concatenate([[0.0], (rate + H / 2 * acceleration)[:-1]])
    assert 25 < np.max(rate) < 100
    y, s = tracking_observer(elbow).simulator({"bandwidth_Hz": 40.0}).run({"theta_rad": theta})
    assert s["v_rad_s"] == pytest.approx(rate, abs=1e-7)
    assert y["omega_rad_s"] == pytest.approx(np.clip(rate, -25, 25), abs=1e-6)
    assert y["omega_mid_rad_s"] == pytest.approx(np.clip(middle, -25, 25), abs=1e-6)
    clipped = (np.abs(rate) > 25) | (np.abs(middle) > 25)
    assert np.array_equal(y["status"], 4.0 * clipped)


# -- the set-point's rates -------------------------------------------------------------------------


@pytest.mark.parametrize("bandwidth", [10.0, 50.0, 100.0])
def test_the_set_points_rates_are_those_of_the_best_parabola(drive, bandwidth):
    theta = wander(0.05, 2)
    angle, rate, acceleration = fitted(theta, bandwidth)
    simulator = setpoint_rates(drive).simulator({"bandwidth_Hz": bandwidth})
    y, _ = simulator.run({"theta_set_rad": theta})
    status = y["status"].astype(int)
    assert not np.any(status & 7)  # the acceleration's clip aside
    assert y["delta_set_rad"] == pytest.approx(angle, abs=1e-9)
    assert y["delta_rate_rad_s"] == pytest.approx(rate, abs=1e-7)
    # Three times what the whole motor torque does to the bare drive: 3 n u / J.
    most = 3 * N * 0.221 / J
    assert y["delta_acc_rad_s2"] == pytest.approx(np.clip(acceleration, -most, most), abs=1e-5)
    assert np.mean(np.abs(acceleration) < most) > 0.3


# -- disturbance of the drive ----------------------------------------------------------------------


def lag(u: np.ndarray, start_Nm: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(5.1) under a held command: the motor's torque at the samples, its mean over each period."""
    at, mean = [start_Nm], []
    for value in u:
        keep = math.exp(-H / TAU_C)
        # The integral of u + (u_a - u) exp(-t / tau_c).
        mean.append(value + (at[-1] - value) * TAU_C * (1 - keep) / H)
        at.append(value + (at[-1] - value) * keep)
    return np.array(at), np.array(mean)


def command(count: int) -> np.ndarray:
    return np.random.default_rng(3).choice([-0.2, -0.05, 0.1, 0.2], count // 10).repeat(10)


@pytest.mark.parametrize("bandwidth", [1.0, 5.0, 15.0])
def test_the_drives_disturbance_holds_the_lags_integral(drive, bandwidth):
    # The motor side held fast: what it does not explain is the motor's torque alone, so that
    # every digit of its mean over a period counts.
    u = command(2000)
    at, mean = lag(u)
    rest = np.zeros(len(u))
    simulator = drive_observer(drive).simulator({"bandwidth_1_s": bandwidth})
    y, _ = simulator.run({"u_Nm": u, "omega_motor_rad_s": rest, "tau_Nm": rest})
    assert not np.any(y["status"])
    d4, expected = 0.0, []
    for k in range(len(u)):
        if k:
            d4 += (1 - math.exp(-bandwidth * H)) * (-N / J * mean[k - 1] - d4)
        expected.append(d4)
    assert y["d4_rad_s2"] == pytest.approx(np.array(expected), rel=1e-10, abs=1e-12)
    assert y["u_a_Nm"] == pytest.approx(at[:-1], rel=1e-10, abs=1e-14)
    # A trapezoid over the lag errs by (h / tau_c)^2 / 12 of what the motor lacks: it would show.
    assert np.max(np.abs(0.5 * (at[1:] + at[:-1]) - mean)) > 1e-5


def test_the_drives_disturbance_is_the_rest_of_the_motion(drive):
    # Any motion, any torque: 5.2 solved for d4, friction and coupling by the mean of both ends.
    rng = np.random.default_rng(4)
    count = 1500
    t = np.arange(count) * H
    omega = 0.8 * np.sin(2 * np.pi * 1.3 * t) + 0.1 * np.sin(2 * np.pi * 7.0 * t)
    tau = 2.0 * np.sin(2 * np.pi * 0.9 * t + 1.0) + rng.normal(0, 0.01, count)
    u = command(count)
    _, mean = lag(u)
    loss = (FV * omega + FC * np.tanh(omega / WIDTH) + tau) / J
    unexplained = np.diff(omega) / H - (N / J * mean[:-1] - 0.5 * (loss[1:] + loss[:-1]))
    assert np.max(np.abs(unexplained)) < 60
    d4, expected = 0.0, [0.0]
    for x in unexplained:
        d4 = float(np.clip(d4 * math.exp(-5 * H) + (1 - math.exp(-5 * H)) * x, -24.66, 24.66))
        expected.append(d4)
    y, _ = (
        drive_observer(drive)
        .simulator()
        .run({"u_Nm": u, "omega_motor_rad_s": omega, "tau_Nm": tau})
    )
    assert not np.any(y["status"])
    assert y["d4_rad_s2"] == pytest.approx(np.array(expected), rel=1e-9, abs=1e-11)
