"""What is stated of the velocity estimate, against other derivations and the emitted C."""

from __future__ import annotations

import json
import math
import re

import mpmath
import numpy as np
import pytest
from esea_gen.model.velocity_properties import (
    EXCESS,
    LAG,
    P,
    VelocityProperties,
    velocity_properties,
)
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import butter, freqz, lfilter

from esea_gen.device import with_numbers
from esea_gen.hostlib.runner import CRunner
from esea_gen.language.stream import single

from .conftest import ROOT

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


def state_space(bandwidth: float, h: float = H):
    """The observer's matrices, from the three lines of the predictor and corrector."""
    p = math.exp(-2 * math.pi * h * bandwidth)
    alpha, beta, gamma = 1 - p**3, 1.5 * (1 - p) ** 2 * (1 + p) / h, (1 - p) ** 3 / h**2
    predict = np.array([[1, h, h * h / 2], [0, 1, h], [0, 0, 1]])
    gain = np.array([[alpha], [beta], [gamma]])
    return predict - gain @ predict[:1], gain, np.array([[0, 1, 0.5 * h]])


def settled(bandwidth: float) -> int:
    return math.ceil(30 / (1 - math.exp(-2 * math.pi * H * bandwidth)))


# -- closed forms ------------------------------------------------------------------------------


@pytest.mark.parametrize("bandwidth", [2.0, 10.0, 15.0, 33.0, 100.0])
@pytest.mark.parametrize("h", [1e-3, 2e-3])
def test_noise_gain_against_lyapunov_and_the_sum_of_squares(elbow, bandwidth, h):
    bandwidth = min(bandwidth, 0.1 / h)
    device = elbow if h == H else with_numbers(elbow, {"timing.sense_rate_Hz": 1 / h})
    v = velocity_properties(device, bandwidth)
    # In units of the period, for the equation's condition: the rate's variance over h^2.
    a, b, middle = state_space(bandwidth * h, 1.0)
    spread = solve_discrete_lyapunov(a, b @ b.T) / h**2
    assert v.noise_gain_1_s() == pytest.approx(math.sqrt(spread[1, 1]), rel=1e-7)
    mid = math.sqrt((middle @ spread @ middle.T).item())
    assert v.noise_gain_1_s(True) == pytest.approx(mid, rel=1e-7)
    for which in (False, True):
        impulse = v.impulse_1_s(which)
        assert v.noise_gain_1_s(which) == pytest.approx(np.sqrt(impulse @ impulse), rel=1e-9)


@pytest.mark.parametrize("bandwidth", BANDWIDTHS)
def test_response_against_the_state_space(elbow, bandwidth):
    v = velocity_properties(elbow, bandwidth)
    a, b, middle = state_space(bandwidth)
    f = np.array([0.1, 1.0, bandwidth, 3 * bandwidth, 400.0])
    z = np.exp(2j * np.pi * f * H)
    # After the sample the state is x = A x + B theta; the middle is made of the one before it.
    after = np.array([np.linalg.solve(zi * np.eye(3) - a, zi * b) for zi in z])
    rate = after[:, 1, 0] / (2j * np.pi * f)
    mid = (after[:, 1, 0] + middle[0, 2] * after[:, 2, 0]) / z / (2j * np.pi * f)
    assert v.response(f) == pytest.approx(rate, rel=1e-9)
    assert v.response(f, True) == pytest.approx(mid, rel=1e-9)


@pytest.mark.parametrize("bandwidth", BANDWIDTHS)
@pytest.mark.parametrize("mid", [False, True])
def test_low_frequency_forms_are_the_limits(elbow, bandwidth, mid):
    v = velocity_properties(elbow, bandwidth)
    low = v.mid_delay_s if mid else v.delay_s
    assert low == (H / 2 if mid else 0.0)
    for part in (50, 100):
        f = bandwidth / part
        assert v.gain_at(f, mid) - 1 == pytest.approx(v.gain_excess(f, mid), rel=6 / part)
        assert v.delay_at_s(f, mid) - low == pytest.approx(v.delay_growth_s(f, mid), rel=6 / part)
    if not mid:  # omega_rad_s is what is meant where nothing is said
        for name in ("gain_at", "gain_excess", "delay_at_s", "delay_growth_s"):
            assert getattr(v, name)(f) == getattr(v, name)(f, False), name
        assert np.array_equal(v.impulse_1_s(), v.impulse_1_s(False))
        for name in ("noise_gain_1_s", "worst_gain_1_s", "bandwidth_3dB_Hz"):
            assert getattr(v, name)() == getattr(v, name)(False) != getattr(v, name)(True), name
    # Group delay, by difference: three times the growth, to the second power of the frequency.
    f, df = bandwidth / 50, bandwidth / 1e4
    phase = [-np.angle(v.response(x, mid)) for x in (f - df, f + df)]
    group = (phase[1] - phase[0]) / (4 * math.pi * df)
    assert group - low == pytest.approx(3 * v.delay_growth_s(f, mid), rel=0.1)


@pytest.mark.parametrize("mid", [False, True])
@pytest.mark.parametrize("pole", ["0.2", "0.9"])
def test_low_frequency_forms_to_many_digits(mid, pole):
    # The transfer functions of the docstring at a phase of 1e-8 a sample, with 60 digits.
    with mpmath.workdps(60):
        p, turn = mpmath.mpf(pole), mpmath.mpf("1e-8")
        z, q = mpmath.expj(turn), 1 - p
        b, g = 3 * q**2 * (1 + p) / 2, q**3
        top = (z - 1) * ((b + g / 2) * (z - 1) + g) if mid else z * (z - 1) * (b * (z - 1) + g)
        ratio = top / (z - p) ** 3 / (1j * turn)
        excess = (abs(ratio) - 1) / turn**2
        lag = (-mpmath.arg(ratio) / turn - (mpmath.mpf(1) / 2 if mid else 0)) / turn**2
    at = {P: float(pole)}
    assert float(EXCESS[mid].subs(at)) == pytest.approx(float(excess), rel=1e-10)
    assert float(LAG[mid].subs(at)) == pytest.approx(float(lag), rel=1e-10)


def test_the_default_in_numbers(elbow):
    # What docs/velocity.md says of 15 Hz, 1 kHz.
    v = velocity_properties(elbow)
    assert v.bandwidth_Hz == 15.0
    assert v.delay_at_s(1.5) == pytest.approx(0.76e-3, abs=0.01e-3)
    assert v.delay_at_s(1.5, True) == pytest.approx(1.30e-3, abs=0.01e-3)
    assert v.gain_at(1.5) == pytest.approx(1.027, abs=0.0005)
    assert v.overshoot == pytest.approx(0.239, abs=0.001)
    assert v.bandwidth_3dB_Hz() == pytest.approx(24.3, abs=0.1)
    assert v.noise_gain_1_s() == pytest.approx(37.7, abs=0.1)
    assert v.worst_gain_1_s() == pytest.approx(162.5, abs=0.1)
    content = v.to_dict()
    assert json.loads(json.dumps(content)) == content
    assert content["omega_rad_s"]["noise_rad_s"]["14"] == v.noise_rad_s(14)
    assert content["omega_rad_s"]["f_Hz"] == 1.5
    assert {e.number for e in v.equations} == {f"[obs {i}]" for i in range(4, 10)}
    with pytest.raises(ValueError, match="outside"):
        velocity_properties(elbow, 101.0)
    with pytest.raises(ValueError, match="outside"):
        velocity_properties(elbow, 1.9)


# -- the emitted C ------------------------------------------------------------------------------


@pytest.mark.parametrize("bandwidth", BANDWIDTHS)
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_constant_rate_and_acceleration_leave_no_error(elbow_f64, elbow_f32, real, bandwidth):
    runner = observer(elbow_f64 if real == "f64" else elbow_f32, bandwidth)
    wait = settled(bandwidth)
    t = np.arange(wait + 300) * H
    top = t[-1]
    noise = 2e-8 * VelocityProperties(bandwidth, H).worst_gain_1_s()  # float32 input, f32 rounding
    # A ramp of 0.3 rad in all, then a parabola from -0.15 to 0.15 rad and its rate.
    for theta, rate in (
        (lambda x: 0.3 * x / top - 0.15, lambda x: 0.3 / top + 0 * x),
        (lambda x: 0.3 * (x / top) ** 2 - 0.15, lambda x: 0.6 * x / top**2),
    ):
        got = run(runner, theta(t))
        size = 2 * noise if real == "f64" else 60 * noise
        assert np.max(np.abs(got["omega_rad_s"] - rate(t))[wait:]) < size
        assert np.max(np.abs(got["omega_mid_rad_s"] - rate(t - H / 2))[wait:]) < size
    # Delays of 0 and half a period are told apart: the same against the other time fails.
    assert np.min(np.abs(got["omega_mid_rad_s"] - rate(t))[wait:]) > 0.9 * 0.3 * H / top**2


@pytest.mark.parametrize("bandwidth", BANDWIDTHS)
@pytest.mark.parametrize("f", [0.5, 1.5, 4.0, 24.0])
def test_gain_and_delay_of_a_sine(elbow, elbow_f64, bandwidth, f):
    runner, v = observer(elbow_f64, bandwidth), velocity_properties(elbow, bandwidth)
    wait = settled(bandwidth)
    t = np.arange(wait + round(4 / f / H)) * H
    amplitude = 0.1 if f < 2 else 0.02
    got = run(runner, amplitude * np.sin(2 * math.pi * f * t))
    base = np.stack([np.cos(2 * math.pi * f * t), np.sin(2 * math.pi * f * t)], axis=1)[wait:]
    for mid, name in OUTPUTS.items():
        c, s = np.linalg.lstsq(base, got[name][wait:], rcond=None)[0]
        rate = amplitude * 2 * math.pi * f
        assert math.hypot(c, s) / rate == pytest.approx(v.gain_at(f, mid), rel=1e-5)
        lag = math.remainder(math.atan2(s, c) - 2 * math.pi * f * v.delay_at_s(f, mid), math.tau)
        assert lag / (2 * math.pi * f) == pytest.approx(0.0, abs=2e-7)


@pytest.mark.parametrize("bits", [12, 14])
@pytest.mark.parametrize("bandwidth", BANDWIDTHS)
def test_noise_of_quantised_motion(elbow, elbow_f64, bits, bandwidth):
    # Dithered by a motion of many counts a sample, so that quantisation is white: both encoders.
    runner, v = observer(elbow_f64, bandwidth), velocity_properties(elbow, bandwidth)
    count = 2 * math.pi / 2**bits
    rng = np.random.default_rng(bits)
    n = 120_000
    motor, load = (np.round(rng.uniform(0, 1000, n)) + rng.uniform(-0.5, 0.5, n) for _ in range(2))
    error = (np.round(motor) - motor - np.round(load) + load) * count
    assert np.var(error) == pytest.approx(2 * count**2 / 12, rel=0.02)
    got = run(runner, error)
    wait = settled(bandwidth)
    for mid, name in OUTPUTS.items():
        assert np.std(got[name][wait:]) == pytest.approx(v.noise_rad_s(bits, mid), rel=0.05)
    one = velocity_properties(elbow, bandwidth).noise_rad_s(bits, encoders=1)
    assert one == pytest.approx(v.noise_rad_s(bits) / math.sqrt(2))


@pytest.mark.parametrize("bits", [12, 14])
@pytest.mark.parametrize("speed_counts", [0.011, 0.09, 0.31, 1.7])
def test_slow_motion_stays_below_the_largest_error(elbow, elbow_f64, bits, speed_counts):
    # A fraction of a count a sample: quantisation is a staircase, nothing like white.
    runner, v = observer(elbow_f64, 15.0), velocity_properties(elbow)
    count = 2 * math.pi / 2**bits
    n = min(6000, round(0.6 / (speed_counts * count)))
    k = np.arange(n)
    true = speed_counts * count / H
    got = run(runner, np.round(speed_counts * k) * count - 0.3)
    wait = settled(15.0)
    for mid, name in OUTPUTS.items():
        error = np.max(np.abs(got[name] - true)[wait:], initial=0.0)
        assert error < v.worst_rad_s(bits, mid, encoders=1) * 1.0001
        if speed_counts < 0.02:  # there the staircase is worse than three sigma of the white model
            assert error > 3 * v.noise_rad_s(bits, mid, encoders=1)


def test_the_largest_error_is_reached(elbow, elbow_f64):
    # The bound is tight: the error whose signs are those of the impulse response, turned round.
    runner, v = observer(elbow_f64, 15.0), velocity_properties(elbow)
    half = math.pi / 2**12
    for mid, name in OUTPUTS.items():
        impulse = v.impulse_1_s(mid)
        wave = np.concatenate([np.zeros(50), half * np.sign(impulse[::-1])])
        peak = np.max(np.abs(run(runner, wave)[name]))
        assert peak == pytest.approx(v.worst_rad_s(12, mid, encoders=1), rel=1e-4)


@pytest.mark.parametrize("bandwidth", BANDWIDTHS)
def test_overshoot_of_a_sudden_rate(elbow, elbow_f64, bandwidth):
    runner, v = observer(elbow_f64, bandwidth), velocity_properties(elbow, bandwidth)
    t = np.arange(900) * H
    got = run(runner, 0.2 * np.maximum(t - 0.05, 0))
    assert np.max(got["omega_rad_s"]) / 0.2 - 1 == pytest.approx(v.overshoot, abs=1e-4)


@pytest.mark.parametrize("bandwidth", [5.0, 15.0])
def test_the_3_dB_frequency(elbow, bandwidth):
    v = velocity_properties(elbow, bandwidth)
    for mid in OUTPUTS:
        f = v.bandwidth_3dB_Hz(mid)
        assert v.gain_at(f, mid) == pytest.approx(math.sqrt(0.5), abs=2e-3)
        assert np.all(np.abs(v.response(np.linspace(1.01 * f, 500, 500), mid)) < math.sqrt(0.5))


# -- docs/velocity.md ---------------------------------------------------------------------------


def alternatives() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Differences behind low-pass filters, as numerator and denominator from deflection."""
    difference = np.array([1.0, -1.0]) / H
    found = {"raw difference": (difference, np.array([1.0]))}
    for order, cut in ((1, 30), (2, 60), (2, 30), (2, 15), (4, 30), (4, 10)):
        b, a = butter(order, cut, fs=1 / H)
        found[f"difference, Butterworth {order}, {cut} Hz"] = (np.convolve(b, difference), a)
    return found


def motion(bits: int) -> tuple[np.ndarray, np.ndarray]:
    """Quantised deflection and true rate: the chirp of docs/sensor.md, 60 times as fast a sweep."""
    t = np.arange(20_000) * H
    theta = np.deg2rad(10) * np.sin(np.pi * 0.05 * t * t)
    rate = np.deg2rad(10) * 2 * np.pi * 0.05 * t * np.cos(np.pi * 0.05 * t * t)
    load = np.deg2rad(45) * (1 - np.cos(2 * np.pi * 0.2 * t))
    count = 2 * np.pi / 2**bits
    return (np.round((load + theta) / count) - np.round(load / count)) * count, rate


def line(name: str, delay: float, edge: float, noise, worst: float, rms) -> str:
    cells = [name, f"{1e3 * delay:.2f}", f"{edge:.1f}", f"{noise[0]:.3f} / {noise[1]:.4f}"]
    cells += [f"{worst:.2f}", f"{rms[0]:.3f} / {rms[1]:.4f}"]
    return "| " + " | ".join(cells) + " |"


def table(elbow, library) -> list[str]:
    streams = {bits: motion(bits) for bits in (12, 14)}
    sigma = {bits: 2 * math.pi / 2**bits / math.sqrt(6) for bits in (12, 14)}
    rows = []
    for name, (b, a) in alternatives().items():
        f = np.linspace(1e-3, 499.9, 50_000)
        _, response = freqz(b, a, worN=f, fs=1 / H)
        response = response / (2j * np.pi * f)
        # Group delay at 0.1 Hz, well below every cut-off.
        w, r = freqz(b, a, worN=np.array([0.05, 0.15]), fs=1 / H)
        r = r / (2j * np.pi * w)
        delay = -(np.angle(r[1]) - np.angle(r[0])) / (2 * np.pi * (w[1] - w[0]))
        above = np.flatnonzero(np.abs(response) >= math.sqrt(0.5))[-1]
        impulse = lfilter(b, a, np.eye(1, 3000)[0])
        noise = [s * math.sqrt(impulse @ impulse) for s in sigma.values()]
        worst = 2 * math.pi / 2**12 * np.sum(np.abs(impulse))
        rms = []
        for theta, rate in streams.values():
            estimate = lfilter(b, a, theta)
            rms.append(np.sqrt(np.mean((estimate - rate)[500:] ** 2)))
        rows.append(line(name, delay, f[above], noise, worst, rms))
    for bandwidth in (10.0, 15.0, 20.0, 30.0):
        v, runner = velocity_properties(elbow, bandwidth), observer(library, bandwidth)
        name = f"observer, {bandwidth:g} Hz" + (" (default)" if bandwidth == 15 else "")
        rms = []
        for theta, rate in streams.values():
            runner.reset()
            got, _ = runner.run({"theta_rad": theta}, trace=False)
            rms.append(np.sqrt(np.mean((got["omega_rad_s"] - rate)[500:] ** 2)))
        noise = [v.noise_rad_s(bits) for bits in (12, 14)]
        rows.append(line(name, v.delay_s, v.bandwidth_3dB_Hz(), noise, v.worst_rad_s(12), rms))
    return rows


def test_the_table_of_the_page_is_this_one(elbow, elbow_f64):
    page = (ROOT / "docs" / "velocity.md").read_text()
    printed = [x for x in page.splitlines() if re.match(r"\| (raw|difference|observer)", x)]
    rows = table(elbow, elbow_f64)
    assert len(printed) == len(rows)
    for there, here in zip(printed, rows, strict=True):
        numbers = [[float(x) for x in re.findall(r"\d+\.\d+", y)] for y in (there, here)]
        assert there.split("|")[1] == here.split("|")[1]
        assert numbers[0] == pytest.approx(numbers[1], rel=0.02, abs=0.011)


def test_delay_and_noise_trade_as_the_page_says(elbow, elbow_f64):
    # No filtered difference of the table has less noise than the default without 5 ms of delay.
    v = velocity_properties(elbow)
    for name, (b, a) in alternatives().items():
        if name == "raw difference":
            continue
        impulse = lfilter(b, a, np.eye(1, 3000)[0])
        gain = math.sqrt(impulse @ impulse)
        w, r = freqz(b, a, worN=np.array([0.05, 0.15]), fs=1 / H)
        r = r / (2j * np.pi * w)
        delay = -(np.angle(r[1]) - np.angle(r[0])) / (2 * np.pi * (w[1] - w[0]))
        assert gain > v.noise_gain_1_s() or delay > 5e-3, name
