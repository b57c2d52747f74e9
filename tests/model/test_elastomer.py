"""The torque sensor and velocity estimate against independent derivations and published figures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import esea_gen

P = {
    "alpha": 10.3,
    "beta": 62.5,
    "omega": 0.0197,
    "k1": 9.39,
    "k3": 239.0,
    "A": 53.9,
    "B": 0.732,
    "m": 2.77,
    "n": 0.77,
    "eps1": 0.0288,
    "eps2": 0.0130,
    "kv": 51.6,
}


def stop_operators(theta: np.ndarray) -> np.ndarray:
    """Hysteresis torque written as the thesis prints it: stop operators, summed increments."""
    r = P["omega"] * np.arange(1, 11)
    w = P["alpha"] * np.exp(-P["beta"] * r)
    e, out = np.zeros(10), np.zeros(len(theta))
    for k in range(1, len(theta)):
        e = np.clip(theta[k] - theta[k - 1] + e, -r, r)
        out[k] = w @ e
    return out


def viscosity(theta: float, rate: float) -> float:
    return (P["A"] * abs(theta) ** P["m"] + P["eps1"]) / (P["B"] * abs(rate) ** P["n"] + P["eps2"])


def tight_maxwell(theta, rate, times: np.ndarray, refine: int) -> np.ndarray:
    """Equation 3.3 on a grid ``refine`` times finer: exact step for the viscosity at its middle."""
    h = (times[1] - times[0]) / refine
    tau, out = 0.0, [0.0]
    for t0 in times[:-1]:
        for j in range(refine):
            middle = t0 + (j + 0.5) * h
            w = rate(middle)
            eta = viscosity(theta(middle), w)
            decay = np.exp(-P["kv"] * h / eta)
            tau = decay * tau + eta * (1 - decay) * w
        out.append(tau)
    return np.array(out)


def chirp(amplitude: float, sweep_Hz_s: float):
    return (
        lambda t: amplitude * np.sin(np.pi * sweep_Hz_s * t * t),
        lambda t: amplitude * 2 * np.pi * sweep_Hz_s * t * np.cos(np.pi * sweep_Hz_s * t * t),
    )


@pytest.fixture(scope="module")
def sensor():
    return esea_gen.load_device("elbow").sensor


@settings(max_examples=25)
@given(arrays(float, 60, elements=st.floats(-0.3, 0.3)))
def test_play_form_is_the_stop_operator(theta: np.ndarray):
    sensor = esea_gen.load_device("elbow").sensor
    out, _ = sensor.simulator().run({"theta_rad": theta, "omega_rad_s": np.zeros(60)})
    assert out["tau_hysteresis_Nm"] == pytest.approx(stop_operators(theta), abs=1e-13)


@pytest.mark.parametrize(("rate_Hz", "limit_pct"), [(1000, 0.01), (500, 0.05)])
def test_discretisation_with_ideal_encoders(rate_Hz: int, limit_pct: float):
    # 10 deg chirp up to 1 Hz in 8 s, against a grid 20 times finer; % of 4.47 Nm (spec/4).
    text = esea_gen.load_device("elbow").toml()
    device = esea_gen.device.parse_device(
        text.replace("sense_rate_Hz = { value = 1000.0", f"sense_rate_Hz = {{ value = {rate_Hz}.0"),
        "rate.toml",
    )
    theta, rate = chirp(np.deg2rad(10), 1 / 8)
    t = np.arange(0, 8, 1 / rate_Hz)
    inputs = {"theta_rad": theta(t), "omega_rad_s": rate(t - 0.5 / rate_Hz)}
    out, _ = device.sensor.simulator().run(inputs)
    error = out["tau_rate_Nm"] - tight_maxwell(theta, rate, t, 20)
    assert 100 * np.max(np.abs(error)) / 4.47 < limit_pct


def test_published_behaviour(elbow_f64):
    # spec/4: 11.5 deg chirp 0-1 Hz gives +-4.49 Nm; 10 deg at 0.01 Hz +-3.05 Nm and a loop of
    # 87.6 mJ; hysteresis saturates at 0.118 Nm.
    runner = elbow_f64.task("sense")

    def measured(theta):
        runner.reset()
        return runner.run({"theta_rad": theta}, trace=False)[0]

    t = np.arange(0, 120, 1e-3)
    fast = measured(np.deg2rad(11.5) * np.sin(np.pi / 120 * t * t))
    assert np.max(np.abs(fast["tau_Nm"])) == pytest.approx(4.49, abs=0.005)
    assert np.max(np.abs(fast["tau_hysteresis_Nm"])) == pytest.approx(0.118, abs=0.0005)

    t = np.arange(0, 200, 1e-3)
    theta = np.deg2rad(10) * np.sin(2 * np.pi * 0.01 * t)
    torque = measured(theta)["tau_Nm"]
    assert np.max(np.abs(torque)) == pytest.approx(3.05, abs=0.005)
    cycle = t >= 100
    loop_mJ = 1e3 * np.trapezoid(torque[cycle], theta[cycle])
    assert loop_mJ == pytest.approx(87.6, abs=0.1)


def test_observer_poles_are_the_stated_triple_pole():
    # Step response against the closed form of three equal poles p = exp(-2 pi f h): the error of
    # the position estimate is (a + b k + c k^2) p^k, so its third weighted difference vanishes.
    device = esea_gen.load_device("elbow")
    p = np.exp(-2 * np.pi * 15 * 1e-3)
    simulator = device.velocity.simulator()
    simulator.step(theta_rad=0.0)
    errors = []
    for _ in range(60):
        simulator.step(theta_rad=0.1)
        errors.append(simulator.state["theta_hat_rad"][0] - 0.1)
    weighted = np.array(errors) / p ** np.arange(60)
    assert np.diff(weighted, 3) == pytest.approx(0, abs=1e-9 * np.max(np.abs(weighted)))


def test_rate_with_real_encoders_beats_the_filtered_difference():
    # 10 deg chirp to 1 Hz in 30 s, moving load side, 14 bit: RMS torque error in % of full scale,
    # against the torque from the true rate and deflection.  The filtered difference is the
    # 60 Hz one of spec/3, which leaves 0.25 %.
    from scipy.signal import butter, sosfilt

    device = esea_gen.load_device("elbow")
    t = np.arange(0, 30, 1e-3)
    theta_of, rate_of = chirp(np.deg2rad(10), 1 / 30)
    load = np.deg2rad(45) * (1 - np.cos(2 * np.pi * 0.2 * t))
    count = 2 * np.pi / 2**14
    measured = (np.round((load + theta_of(t)) / count) - np.round(load / count)) * count

    def rate_torque(theta, omega):
        return device.sensor.simulator().run({"theta_rad": theta, "omega_rad_s": omega})[0][
            "tau_rate_Nm"
        ]

    true = rate_torque(theta_of(t), rate_of(t - 5e-4))
    rates, _ = device.velocity.simulator().run({"theta_rad": measured})
    difference = sosfilt(
        butter(2, 60, fs=1000, output="sos"), np.diff(measured, prepend=0.0) / 1e-3
    )

    def rms_pct(torque):
        return 100 * np.sqrt(np.mean((torque - true) ** 2)) / 4.47

    ours = rms_pct(rate_torque(measured, rates["omega_mid_rad_s"]))
    assert ours < 0.22
    assert ours < 0.85 * rms_pct(rate_torque(measured, difference))


@given(st.floats(0, 1e6))
def test_the_share_of_a_maxwell_step_is_at_most_one(x: float):
    # The fact that the error analysis is told: (1 + x/2 + x^2/6) / (1 + x (1 + x/2 + x^2/6)) <= 1.
    from fractions import Fraction

    q = Fraction(x)
    series = 1 + q / 2 + q * q / 6
    assert 0 < series / (1 + q * series) <= 1
