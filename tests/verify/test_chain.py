"""Rate and torque together, against the continuous model and between the number formats."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from esea_gen.device import with_numbers
from esea_gen.devices.designed import suited_bandwidth_Hz
from esea_gen.hostlib.library import CBoard, compile_device, run_schedule
from esea_gen.twin.trajectories import reaches
from esea_gen.verify.chain import search_chain

H = 1e-3
FINE = 5  # steps of the continuous model in a period
FULL_NM = 4.47
COUNT = {bits: 2 * np.pi / 2**bits for bits in (12, 14)}


def continuous(theta: np.ndarray) -> np.ndarray:
    """(3.1 to 3.11) with the numbers of table 3.2, typed again, on a fine grid.

    Stops as sums of increments; the Maxwell element by its exact solution for a frozen viscosity.
    """
    h, r = H / FINE, 0.0197 * np.arange(1, 11)
    weights, stop, tau_r = 10.3 * np.exp(-62.5 * r), np.zeros(10), 0.0
    out = np.empty(len(theta))
    last = theta[0]
    for k, now in enumerate(theta):
        move, middle = now - last, 0.5 * (now + last)
        stop = np.clip(stop + move, -r, r)
        drag = 0.732 * abs(move / h) ** 0.77 + 0.0130
        x = h * 51.6 * drag / (53.9 * abs(middle) ** 2.77 + 0.0288)
        tau_r = tau_r * np.exp(-x) - 51.6 * move * np.expm1(-x) / x
        out[k] = 239.0 * now**3 + 9.39 * now + tau_r + weights @ stop
        last = now
    return out


@pytest.fixture(scope="module")
def sweep():
    t = np.arange(0, 12, H / FINE)
    theta = np.deg2rad(10) * np.sin(np.pi * t * t / 12)
    load = np.deg2rad(45) * (1 - np.cos(2 * np.pi * 0.2 * t))
    return theta[::FINE], load[::FINE], continuous(theta)[::FINE]


def read(theta, load, bits: int):
    count = COUNT[bits]
    return (np.round((theta + load) / count) - np.round(load / count)) * count


def of_full_scale(error) -> float:
    return 100 * float(np.sqrt(np.mean(error[1000:] ** 2))) / FULL_NM


def sensed(library, theta) -> dict[str, np.ndarray]:
    return run_schedule(CBoard(library), {"sense": {"theta_rad": theta}})["sense"]


def smoothed(library, theta, bandwidth_Hz: float = 15.0) -> dict[str, np.ndarray]:
    """What the sensor is given."""
    velocity, smoothing = (library.block(n) for n in ("velocity", "smoothing"))
    velocity.prepare({"bandwidth_Hz": bandwidth_Hz})
    velocity.reset(), smoothing.reset()
    rate = velocity.run({"theta_rad": theta}, trace=False)[0]["omega_mid_rad_s"]
    given = {"theta_rad": theta, "omega_rad_s": rate}
    theta = smoothing.run(given, trace=False)[0]["theta_smooth_rad"]
    return {"theta_rad": theta, "omega_rad_s": rate}


@pytest.mark.parametrize(("bits", "aim"), [(12, 0.4), (14, 0.1)])
def test_counts_cost_the_torque_little(elbow_f64, sweep, bits, aim):
    theta, load, true = sweep
    counts = read(theta, load, bits)
    assert of_full_scale(sensed(elbow_f64, counts)["tau_Nm"] - true) < aim
    # Given the counts themselves, the same sensor errs by more than twice as much.
    sensor = elbow_f64.block("sensor")
    sensor.reset()
    raw, _ = sensor.run(smoothed(elbow_f64, counts) | {"theta_rad": counts}, trace=False)
    assert of_full_scale(raw["tau_Nm"] - true) > 2 * aim


def test_the_bandwidth_that_suits_an_encoder_keeps_the_aims(elbow, sweep):
    """Sweep at 12 and 14 bits, reaches with a count of next to nothing."""
    theta, load, true = sweep
    for bits, aim in ((12, 0.4), (14, 0.1)):
        library = compile_device(with_numbers(elbow, {"encoder.resolution_bits": bits}), "f64")
        given = smoothed(library, read(theta, load, bits), suited_bandwidth_Hz(bits))
        sensor = library.block("sensor")
        sensor.reset()
        assert of_full_scale(sensor.run(given, trace=False)[0]["tau_Nm"] - true) < aim
    ends, lasting = np.array([0.1, -0.15, 0.05]), np.array([0.4, 0.5, 0.3])
    fine = reaches(ends, lasting, H / FINE)
    library = compile_device(with_numbers(elbow, {"encoder.resolution_bits": 24}), "f64")
    given = smoothed(library, fine[::FINE], suited_bandwidth_Hz(24))
    error = library.block("sensor").run(given, trace=False)[0]["tau_Nm"] - continuous(fine)[::FINE]
    assert 100 * float(np.sqrt(np.mean(error**2))) / FULL_NM < 0.05
    # By hand: five bits double it.
    assert [suited_bandwidth_Hz(b) for b in (9, 14, 19, 24)] == [7.5, 15.0, 30.0, 60.0]


def test_the_worst_of_a_search_is_found_again(elbow, elbow_f64, elbow_f32):
    found = search_chain(elbow, ("f32",), trials=24, seed=3)
    (worst,) = found.errors
    theta = reaches(np.array(worst.ends_rad), np.array(worst.lasting_s), H)
    if worst.bits:
        theta = np.round(theta / COUNT[12]) * COUNT[12]
    theta = np.float32(theta)
    error = sensed(elbow_f32, theta)["tau_Nm"] - sensed(elbow_f64, theta.astype(float))["tau_Nm"]
    assert np.max(np.abs(error)) == pytest.approx(worst.error_Nm, rel=0.05)
    # The two Blocks together are worse than the sensor alone (2e-6 Nm), and within the aim.
    assert 1e-5 < worst.error_Nm < 2e-3
    assert found.passed
    assert search_chain(elbow, ("f32",), trials=2, seed=3).errors[0].error_Nm <= worst.error_Nm


def test_fixed_point_comes_to_rest_where_double_precision_does(elbow, elbow_f64):
    # The viscosity is steepest at rate zero: 3e-5 rad/s left over were 0.06 % of full scale.
    q31 = compile_device(elbow, "q31")
    theta = reaches(np.array([0.1, -0.2]), np.array([0.7, 1.1]), H)
    rates = []
    for library in (elbow_f64, q31):
        velocity = library.block("velocity")
        velocity.reset()
        rates.append(velocity.run({"theta_rad": theta}, trace=False)[0]["omega_mid_rad_s"])
    assert np.max(np.abs(rates[1] - rates[0])) < 1e-5
    error = sensed(q31, theta)["tau_Nm"] - sensed(elbow_f64, theta)["tau_Nm"]
    assert 100 * np.max(np.abs(error)) / FULL_NM < 0.02


@pytest.mark.parametrize("bits", [12, 14])
def test_white_counts_are_smoothed_by_the_filters_own_gain(elbow, bits):
    # Half a count either way of each encoder, spread evenly and independent from sample to sample:
    # variance count^2/12 each.  What is left by the stationary variance of angle, rate,
    # acceleration and smoothed deflection, x' = M x + k u.
    p, g = np.exp(-2 * np.pi * H * np.array([15, 8])) * [1, -1] + [0, 1]
    k = np.array([1 - p**3, 1.5 * (1 - p) ** 2 * (1 + p) / H, (1 - p) ** 3 / H**2])
    ahead = np.array([[1, H, H * H / 2], [0, 1, H], [0, 0, 1]])
    m = np.zeros((4, 4))
    m[:3, :3] = ahead - np.outer(k, ahead[0])
    m[3] = (1 - g) * np.array([0, H, H * H / 2, 1])
    gains = np.array([*k, g])
    left = np.sqrt(solve_discrete_lyapunov(m, np.outer(gains, gains))[3, 3])
    noise = COUNT[bits] * (np.random.default_rng(4).uniform(-0.5, 0.5, (2, 200_000)).sum(axis=0))
    device = with_numbers(elbow, {"encoder.resolution_bits": bits})
    given = smoothed(compile_device(device, "f64"), 0.05 + noise)["theta_rad"]
    assert np.std(given[1000:]) == pytest.approx(COUNT[bits] * left / np.sqrt(6), rel=0.05)
    assert left < 1 / 3  # where raw counts leave 1


@pytest.mark.parametrize("real", ["f64", "f32", "q31"])
def test_an_invalid_sample_shows_in_the_sensors_own_status(elbow, real):
    theta = np.concatenate([np.linspace(0, 0.1, 200), [np.nan] * 3, [0.36, -0.36], [0.1] * 5])
    got = sensed(compile_device(elbow, real), theta)
    bad = np.abs(np.nan_to_num(theta, nan=1.0)) > 0.35
    for word in ("sensor_status", "smoothing_status", "velocity_status"):
        assert (np.array(got[word]).astype(int) & 1).astype(bool).tolist() == bad.tolist()
    # The sensor stands where it was: nothing but the Maxwell element moves.
    assert np.ptp(np.array(got["tau_spring_Nm"])[199:205]) == 0
