"""Rate and torque together, against the continuous model and between the number formats."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.hostlib.runner import CBoard, run_schedule
from esea_gen.studies.chain import reaches
from esea_gen.verify.chain import ChainError, ChainReport, search_chain

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


@pytest.mark.parametrize(("bits", "aim"), [(12, 0.4), (14, 0.1)])
def test_counts_cost_the_torque_little(elbow_f64, sweep, bits, aim):
    theta, load, true = sweep
    counts = read(theta, load, bits)
    assert of_full_scale(sensed(elbow_f64, counts)["tau_Nm"] - true) < aim
    # Given the counts themselves, the same sensor errs by more than twice as much.
    velocity, sensor = (elbow_f64.block(n) for n in ("velocity", "sensor"))
    velocity.reset(), sensor.reset()
    rate = velocity.run({"theta_rad": counts}, trace=False)[0]["omega_mid_rad_s"]
    raw, _ = sensor.run({"theta_rad": counts, "omega_rad_s": rate}, trace=False)
    assert of_full_scale(raw["tau_Nm"] - true) > 2 * aim


def test_a_fine_encoder_with_a_faster_observer(elbow_f64):
    ends, lasting = np.array([0.1, -0.15, 0.05]), np.array([0.4, 0.5, 0.3])
    fine = reaches(ends, lasting, H / FINE)
    theta, true = fine[::FINE], continuous(fine)[::FINE]
    velocity, sensor = (elbow_f64.block(n) for n in ("velocity", "sensor"))
    errors = []
    for bandwidth in (15.0, 60.0):
        velocity.prepare({"bandwidth_Hz": bandwidth})
        velocity.reset(), sensor.reset()
        y, _ = velocity.run({"theta_rad": theta}, trace=False)
        seen = {"theta_rad": y["theta_filtered_rad"], "omega_rad_s": y["omega_mid_rad_s"]}
        error = sensor.run(seen, trace=False)[0]["tau_Nm"] - true
        errors.append(100 * float(np.sqrt(np.mean(error**2))) / FULL_NM)
    assert errors[1] < 0.05 < errors[0]


def test_the_deflection_is_never_more_than_a_count_behind(elbow_f64):
    # Slow, fast, and a jump in one step: the observer's estimate, typed again,
    # within a count of what the encoders say.
    t = np.arange(3000) * H
    theta = 0.15 * np.sin(2 * np.pi * 3 * t**2)
    theta[2000:] += 0.1
    velocity = elbow_f64.block("velocity")
    velocity.reset()
    got = velocity.run({"theta_rad": theta}, trace=False)[0]["theta_filtered_rad"]
    p = np.exp(-2 * np.pi * H * 15)
    gains = np.array([1 - p**3, 1.5 * (1 - p) ** 2 * (1 + p) / H, (1 - p) ** 3 / H**2])
    state, expected = np.array([theta[0], 0, 0]), []
    for now in theta:
        ahead = np.array([[1, H, H * H / 2], [0, 1, H], [0, 0, 1]]) @ state
        state = ahead + gains * (now - ahead[0])
        state[1] = np.clip(state[1], -100, 100)
        expected.append(np.clip(state[0], now - COUNT[12], now + COUNT[12]))
    assert got == pytest.approx(np.array(expected), abs=1e-7)
    apart = np.abs(got - theta)
    assert np.max(apart) == pytest.approx(COUNT[12], rel=1e-6)  # the limit acts, and holds
    assert np.median(apart[:500]) < 0.1 * COUNT[12]  # it is a filter, no copy


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
    few = search_chain(elbow, ("f32",), trials=2, seed=3).errors[0]
    assert few.error_Nm <= worst.error_Nm


def test_a_search_beyond_the_aim_fails_and_says_so():
    bad = ChainError("q31", 0.01, 0.021e-2 * FULL_NM, (0.1,), (0.2,), 12)
    good = ChainError("f32", 0.01, 0.019e-2 * FULL_NM, (0.1,), (0.2,), 0)
    assert not ChainReport("elbow", FULL_NM, 5, (good, bad)).passed
    assert ChainReport("elbow", FULL_NM, 5, (good,)).passed
    assert "12 bit" in ChainReport("elbow", FULL_NM, 5, (good, bad)).table()[-1]
    with pytest.raises(UserError, match="reads counts"):
        search_chain(load_device("elbow_drive"), trials=1)
