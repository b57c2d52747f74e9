"""The figures of a run, each in closed form from signals that nobody simulated."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.twin.case import IMPEDANCE, TORQUE
from esea_gen.twin.judge import above, desired_torque, judge, rough_cells
from esea_gen.twin.published import PLANTS

N = 6000
T = np.arange(N) / 1000
WINDOW = slice(1000, 6000)  # 5 s
U_MAX_NM = 0.2
RATE_LIMITED_BIT = 12  # the word's thirteenth flag, in the dialect


def made(mode=TORQUE, **plant):
    """A case that asks for a sine of 2 Nm and 1 Hz, and a run that is off by 0.3 Nm at 20 Hz."""
    desired = 2.0 * np.sin(2 * np.pi * T)
    error = 0.3 * np.sin(2 * np.pi * 20 * T)
    path = SimpleNamespace(
        window=WINDOW,
        tau_desired_Nm=desired,
        theta_p_rad=np.full(N, 0.5),
        omega_p_rad_s=np.full(N, 0.25),
    )
    gains = {"reference": {"Kp_Nm_rad": 3.0, "Kd_Nms_rad": 0.4}}
    case = SimpleNamespace(trajectory=path, mode=mode, tunables=gains)
    rest = {"theta_l_rad": np.zeros(N), "omega_l_rad_s": np.full(N, -1.0)}
    rest |= {"tau_e_Nm": desired + error, "omega_g_rad_s": np.zeros(N), "tripped": np.zeros(N)}
    u = np.where(np.arange(N) % 2 == 0, 0.1, -0.1)
    u[2000:2500] = -U_MAX_NM
    limits = np.zeros(N)
    limits[3000:3100] = 1 << RATE_LIMITED_BIT
    limits[3200:3300] = 1 << (RATE_LIMITED_BIT - 1)
    controller = {"tau_Nm": desired + error + 0.05, "u_Nm": u, "fault": np.zeros(N)}
    controller["limits_status"] = limits
    return case, SimpleNamespace(plant=rest | plant, controller=controller, missed_runs=0)


def test_errors_are_of_the_window_and_of_truth_and_model_apart():
    case, run = made()
    run.plant["tau_e_Nm"][:1000] += 100  # before the window nothing counts
    found = judge(case, run, U_MAX_NM)
    assert found["rms_true_Nm"] == pytest.approx(0.3 / math.sqrt(2), rel=1e-6)
    assert found["rms_model_Nm"] == pytest.approx(math.hypot(0.3 / math.sqrt(2), 0.05), rel=1e-6)
    # Fifty samples a period: the two nearest lie half a sample beside the crest.
    assert found["max_true_Nm"] == pytest.approx(0.3 * math.cos(math.pi / 50), rel=1e-6)
    assert (found["unstable"], found["tripped"], found["fault"]) == (0, 0, 0)
    assert "rms_normalised" not in found
    assert "missed_runs" not in found
    run.missed_runs = 7
    assert judge(case, run, U_MAX_NM)["missed_runs"] == 7


def test_what_is_above_4_hz_is_the_swing_and_not_the_motion():
    slow, fast = np.sin(2 * np.pi * T), np.sin(2 * np.pi * 20 * T)
    middle = slice(1500, 4500)
    assert np.abs(above(slow)[middle]).max() < 1e-3
    assert np.abs(above(slow + fast) - fast)[middle].max() < 4e-3
    # Fourth order twice: at its corner half the amplitude.
    assert np.abs(above(np.sin(2 * np.pi * 4 * T))[middle]).max() == pytest.approx(0.5, abs=5e-3)
    found = judge(*made(), U_MAX_NM)
    assert found["rms_above_4Hz_Nm"] == pytest.approx(0.3 / math.sqrt(2), rel=1e-2)


def test_share_at_the_limit_and_roughness():
    case, run = made()
    found = judge(case, run, U_MAX_NM)
    assert found["limited_share"] == 500 / 5000
    assert found["rate_limited_share"] == 100 / 5000
    assert found["noise_above_5Hz_Nm"] == pytest.approx(0.3 / math.sqrt(2), rel=1e-2)
    # Of two sines only the one above 20 Hz counts, and none that is as slow as a wanted torque.
    run.controller["u_Nm"] = 0.1 * np.sin(2 * np.pi * 5 * T) + 0.02 * np.sin(2 * np.pi * 60 * T)
    run.plant["tau_e_Nm"] = case.trajectory.tau_desired_Nm + 0.3 * np.sin(2 * np.pi * T)
    found = judge(case, run, U_MAX_NM)
    assert found["command_above_20Hz_Nm"] == pytest.approx(0.02 / math.sqrt(2), rel=2e-2)
    assert found["noise_above_5Hz_Nm"] < 1e-3
    shown = rough_cells(found | {"noise_above_5Hz_Nm": None})
    assert [c.split()[-1] for c in shown] == ["mNm", "-", "%"]


@pytest.mark.parametrize(("beyond", "told"), [(0.999, 0), (1.001, 1)])
def test_what_ends_a_run(beyond, told):
    speed, error = PLANTS.unstable.max_gear_speed_rad_s, PLANTS.unstable.max_true_error_Nm
    case, run = made()
    run.plant["omega_g_rad_s"][10] = -beyond * speed  # anywhere
    assert judge(case, run, U_MAX_NM)["unstable"] == told
    case, run = made()
    run.plant["tau_e_Nm"][3000] = run.plant["tau_e_Nm"][3000] * 0 - beyond * error
    run.plant["tau_e_Nm"][3000] += case.trajectory.tau_desired_Nm[3000]
    assert judge(case, run, U_MAX_NM)["unstable"] == told
    assert judge(case, run, U_MAX_NM, torque=10.0)["unstable"] == 0  # of a larger device
    case, run = made()
    run.plant["tripped"][-1] = told
    run.controller["fault"][5999] = 8 * told
    run.controller["fault"][5] = 8  # released before the window
    found = judge(case, run, U_MAX_NM)
    assert (found["tripped"], found["fault"]) == (told, told)


def test_in_impedance_mode_the_wish_is_the_spring_and_damper_on_the_true_angle():
    case, run = made(IMPEDANCE)
    wish = 2.0 * np.sin(2 * np.pi * T) + 3.0 * 0.5 + 0.4 * 1.25
    np.testing.assert_allclose(desired_torque(case, run), wish)
    run.plant["tau_e_Nm"] = wish + 0.25
    found = judge(case, run, U_MAX_NM)
    assert found["rms_true_Nm"] == pytest.approx(0.25)
    assert found["largest_desired_Nm"] == pytest.approx(2 + 1.5 + 0.5, rel=1e-4)
    assert found["rms_normalised"] == pytest.approx(0.25 / 4.0, rel=1e-4)
