"""In closed loop: changes of mode make no bump, and nothing restarts by itself."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.control.laws.predictive import device_horizon
from esea_gen.control.limits.faults import Fault
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.people import real_plant
from esea_gen.twin.published import PEOPLE

TICKS = 6000
NO_GAINS = {"reference": {"Kp_Nm_rad": 0.0, "Kd_Nms_rad": 0.0}}


@pytest.fixture(scope="module")
def loop(drive):
    return ClosedLoop(drive.system, real_plant(drive), "f32")


@pytest.fixture(scope="module")
def run(drive, loop):
    plant = real_plant(drive, seed=0).having(PEOPLE["none"], clamped=1.0)

    def ran(tau_Nm, **changes):
        zero = np.zeros(TICKS)
        t = np.arange(TICKS)
        signals = dict.fromkeys(loop.signals, zero) | {
            "theta_p_rad": zero,
            "omega_p_rad_s": zero,
            "alpha_p_rad_s2": zero,
            "tau_desired_Nm": tau_Nm,
            "mode": np.where(t < 60, 0.0, 1.0),
            "rearm": (t >= 30).astype(float),
        }
        return loop.run(signals | changes, plant.values, NO_GAINS, seed=0)

    return ran


def sine(amplitude_Nm: float, hertz: float) -> np.ndarray:
    return amplitude_Nm * np.sin(2 * np.pi * hertz * np.arange(TICKS) / 1000)


@pytest.mark.parametrize("at", [3000, 3300, 3600, 3900])
def test_equal_laws_change_next_to_nothing(run, at):
    # Kp = Kd = 0: impedance mode wants what torque mode wants.
    wanted = sine(2.5, 0.6)
    mode = np.where(np.arange(TICKS) < 60, 0.0, 1.0)
    kept = run(wanted)
    mode[at:] = 2
    changed = run(wanted, mode=mode)
    assert np.abs(np.diff(changed.controller["tau_set_Nm"]))[at - 1] < 2e-3
    assert np.all(changed.controller["mode_held"][at:] == 2)
    apart = np.abs(changed.plant["tau_e_Nm"] - kept.plant["tau_e_Nm"])
    assert np.max(apart[:at]) == 0
    # No bump; later on the two modes part, for the governor is torque mode's alone.
    assert np.max(apart[at : at + 30]) < 0.01
    assert np.max(apart[at:]) < 0.5


@pytest.mark.parametrize("period", [1, 2, 7])
def test_switching_to_and_fro_does_not_run_away(run, period):
    t = np.arange(TICKS)
    mode = np.where((t // period) % 2 == 0, 1.0, 2.0)
    mode[:60] = 0
    got = run(np.where(t > 500, 2.0, 0.0), mode=mode)
    assert np.max(np.abs(got.plant["tau_e_Nm"])) < 2.3
    assert np.max(got.controller["fault"][100:]) == 0


@pytest.mark.parametrize("name", ["tau_desired_Nm", "theta_desired_rad", "omega_desired_rad_s"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e6])
def test_an_invalid_wish_stops_at_once_and_for_good(run, name, bad):
    wanted = sine(2.0, 0.6)
    broken = np.array(wanted if name == "tau_desired_Nm" else np.zeros(TICKS))
    broken[3203:3210] = bad
    got = run(wanted, **{name: broken}).controller
    assert np.any(got["u_Nm"][3190:3203] != 0)
    assert np.all(got["u_Nm"][3203:] == 0)
    assert np.all(got["fault"][3203:] == Fault.INPUT_INVALID)


def test_it_goes_on_only_off_and_rearmed(run):
    broken = sine(2.0, 0.6).copy()
    broken[3000] = np.nan
    t = np.arange(TICKS)
    mode = np.where(t < 60, 0.0, 1.0)
    mode[3500:3700] = 0
    rearm = (t >= 30).astype(float)
    rearm[3600:] = 2
    got = run(broken, mode=mode, rearm=rearm).controller
    assert np.all(got["u_Nm"][3000:3700] == 0)
    assert np.any(got["u_Nm"][3700:4000] != 0)
    assert np.all(got["fault"][3600:] == 0)


@pytest.mark.parametrize("name", ["tau_preview_Nm", "theta_preview_rad", "omega_preview_rad_s"])
def test_an_invalid_future_stops_predictive_control_for_good(foreseen, name):
    loop, signals, plant = foreseen
    broken = np.array(signals[name])
    # As long as a control period: what falls between two of its runs is never read.
    broken[1200:1206, 3] = np.nan
    got = loop.run(signals | {name: broken}, plant.values, seed=0).controller
    assert np.any(got["u_Nm"][1190:1200] != 0)
    assert np.all(got["u_Nm"][1207:] == 0)
    assert np.all(got["fault"][1207:] == Fault.CONTROL_STALE)


@pytest.fixture(scope="module")
def foreseen():
    device = controller_device("mpc")
    plant = real_plant(device, seed=0).having(PEOPLE["none"], clamped=1.0)
    loop = ClosedLoop(device.system, plant, "f32")
    n = 2000
    t = np.arange(n)
    wanted = 2.0 * np.sin(2 * np.pi * 0.6 * t / 1000)
    ends = np.rint(np.array(device_horizon(device).ends_s) * 1000).astype(int)
    zero = np.zeros(n)
    signals = dict.fromkeys(loop.signals, zero) | {
        "theta_p_rad": zero,
        "omega_p_rad_s": zero,
        "alpha_p_rad_s2": zero,
        "tau_desired_Nm": wanted,
        "mode": np.where(t < 60, 0.0, 1.0),
        "rearm": (t >= 30).astype(float),
        "tau_preview_Nm": wanted[np.minimum(t[:, None] + ends, n - 1)],
        "theta_preview_rad": np.zeros((n, len(ends))),
        "omega_preview_rad_s": np.zeros((n, len(ends))),
    }
    return loop, signals, plant
