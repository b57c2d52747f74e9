"""Statements of docs/velocity.md against the emitted C."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.hostlib.library import CRunner
from esea_gen.language.stream import single

H = 1e-3
OUTPUTS = {False: "omega_rad_s", True: "omega_mid_rad_s"}
BANDWIDTHS = (5.0, 15.0, 40.0)


def observer(library, bandwidth: float) -> CRunner:
    runner = library.block("velocity")
    runner.prepare({"bandwidth_Hz": bandwidth})
    return runner


def run(runner: CRunner, theta) -> dict[str, np.ndarray]:
    runner.reset()
    got, _ = runner.run({"theta_rad": single(theta)}, trace=False)
    assert not np.any(got["status"])
    return {k: v.astype(float) for k, v in got.items()}


def pole(bandwidth: float) -> float:
    return math.exp(-2 * math.pi * H * bandwidth)


def settled(bandwidth: float) -> int:
    return math.ceil(30 / (1 - pole(bandwidth)))


def response(bandwidth: float, f: float, mid: bool) -> complex:
    """Estimate over true rate, by the page's transfer functions."""
    p, z = pole(bandwidth), np.exp(2j * math.pi * f * H)
    q = 1 - p
    b, g = 1.5 * q * q * (1 + p), q**3
    top = (b + g / 2) * (z - 1) + g if mid else z * (b * (z - 1) + g)
    return complex((z - 1) * top / (z - p) ** 3 / (2j * math.pi * f * H))


@pytest.mark.parametrize("bandwidth", BANDWIDTHS)
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_constant_rate_and_acceleration_leave_no_error(elbow_f64, elbow_f32, real, bandwidth):
    runner = observer(elbow_f64 if real == "f64" else elbow_f32, bandwidth)
    wait = settled(bandwidth)
    t = np.arange(wait + 300) * H
    top = t[-1]
    # Of a ramp of 0.3 rad in all, and of a parabola from -0.15 to 0.15 rad; float32 input.
    size = (1 if real == "f64" else 30) * 5e-7 * bandwidth
    for theta, rate in (
        (lambda x: 0.3 * x / top - 0.15, lambda x: 0.3 / top + 0 * x),
        (lambda x: 0.3 * (x / top) ** 2 - 0.15, lambda x: 0.6 * x / top**2),
    ):
        got = run(runner, theta(t))
        assert np.max(np.abs(got["omega_rad_s"] - rate(t))[wait:]) < size
        assert np.max(np.abs(got["omega_mid_rad_s"] - rate(t - H / 2))[wait:]) < size


@pytest.mark.parametrize("bandwidth", BANDWIDTHS)
@pytest.mark.parametrize("f", [0.5, 4.0, 24.0])
def test_gain_and_delay_of_a_sine(elbow_f64, bandwidth, f):
    runner, wait = observer(elbow_f64, bandwidth), settled(bandwidth)
    t = np.arange(wait + round(4 / f / H)) * H
    amplitude = 0.1 if f < 2 else 0.02
    got = run(runner, amplitude * np.sin(2 * math.pi * f * t))
    base = np.stack([np.cos(2 * math.pi * f * t), np.sin(2 * math.pi * f * t)], axis=1)[wait:]
    for mid, name in OUTPUTS.items():
        c, s = np.linalg.lstsq(base, got[name][wait:], rcond=None)[0]
        found = (c - 1j * s) / (amplitude * 2 * math.pi * f)
        assert abs(found - response(bandwidth, f, mid)) < 1e-5 * abs(found) + 2e-6


@pytest.mark.parametrize("bandwidth", BANDWIDTHS)
def test_noise_of_quantised_motion(elbow_f64, bandwidth):
    # Dithered by a motion of many counts a sample, so that quantisation is white: both encoders.
    count, p, n = 2 * math.pi / 2**12, pole(bandwidth), 120_000
    rng = np.random.default_rng(12)
    motor, load = (np.round(rng.uniform(0, 1000, n)) + rng.uniform(-0.5, 0.5, n) for _ in range(2))
    got = run(
        observer(elbow_f64, bandwidth), (np.round(motor) - motor - np.round(load) + load) * count
    )
    q, white = 1 - p, count / math.sqrt(6)
    gains = {
        False: math.sqrt(q**3 * (13 + 50 * p + 49 * p**2) / (2 * (1 + p) ** 5)) / H,
        True: math.sqrt(14 * q**3 / (1 + p) ** 3) / H,
    }
    for mid, name in OUTPUTS.items():
        assert np.std(got[name][settled(bandwidth) :]) == pytest.approx(
            gains[mid] * white, rel=0.05
        )
