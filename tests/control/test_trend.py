"""Trend of the desired torque: closed forms, steps, noise, closed loop."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from esea_gen.control.predictive.horizon import Horizon
from esea_gen.control.trend import trend
from esea_gen.device import load_device
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.run import run_case
from esea_gen.twin.trajectories import fixed_output, tuning
from tests.own_device import own_text

GRID = Horizon(10, 0.02, 4, 0.002)
ENDS = np.array(GRID.ends_s)
H = 0.005


@cache
def block():
    return trend(load_device("elbow_drive"), GRID.ends_s)


def ahead(wanted, u_Nm=0.0, **tunables):
    """What the Block gives along a wanted torque, shape (steps, intervals); steps every 5 ms."""
    simulator = block().simulator(tunables)
    return np.array(
        [simulator.step(tau_wanted_Nm=float(w), u_Nm=u_Nm)["tau_ahead_Nm"] for w in wanted]
    )


@pytest.mark.parametrize("rate", [0.5, -3.0, 5.0])
def test_a_ramp_goes_on_with_its_rate(rate):
    wanted = rate * H * np.arange(600)
    expected = wanted[-1] + rate * ENDS * np.exp(-ENDS / 2)
    assert ahead(wanted)[-1] == pytest.approx(expected, abs=5e-3 * abs(rate))


@pytest.mark.parametrize("frequency_Hz", [0.6, 1.0, 1.5, 2.0])
@pytest.mark.parametrize("size_Nm", [1.0, -3.0])
def test_a_sine_goes_on_as_a_sine(size_Nm, frequency_Hz):
    def sine(t):
        return 0.5 + size_Nm * np.sin(2 * np.pi * frequency_Hz * t)

    t = H * np.arange(800)[:, None]
    faded = sine(t) + np.exp(-ENDS / 2) * (sine(t + ENDS) - sine(t))
    errors = np.abs(ahead(sine(t[:, 0])) - faded)[400:] / abs(size_Nm)
    # A parabola was off by up to 3 times the sine's size at 2 Hz.
    assert errors[:, ENDS < 0.15].max() < 0.25
    assert errors.max() < 0.5


@pytest.mark.parametrize("size_Nm", [0.05, 0.3, 1.0, -2.5])
def test_a_step_is_not_taken_for_a_motion(size_Nm):
    wanted = np.where(np.arange(300) >= 100, size_Nm, 0.0)
    assert np.array_equal(ahead(wanted), np.repeat(wanted[:, None], 10, axis=1))


def test_a_step_on_a_motion_moves_it_and_no_more():
    t = H * np.arange(400)
    smooth = np.sin(2 * np.pi * 0.5 * t)
    stepped = smooth + np.where(t >= 1.0, 1.2, 0.0)
    # The step's own sample counts as the median of its neighbours: 5 ms of the motion's bend.
    assert np.abs(ahead(stepped) - stepped[:, None] - (ahead(smooth) - smooth[:, None])).max() < 0.1


def test_noise_is_not_taken_for_a_motion():
    def added(sigma, **tunables):
        wanted = np.random.default_rng(5).normal(0, sigma, 2000)
        return (ahead(wanted, **tunables) - wanted[:, None])[400:, 4].std()

    # 0.1 s ahead, whatever the noise.
    assert max(added(s) for s in (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.3)) < 0.03
    # Armed: an observer that no noise slows down.
    assert added(0.1, quiet_Nm=1.0) > 0.2


# -- in the loop -----------------------------------------------------------------------------------


def held(tmp_path):
    """The same controller that holds the wanted torque still."""
    path = tmp_path / "held.toml"
    path.write_text(own_text('controller = "mpc-no-preview"\n', predictive={"future": "held"}))
    return str(path)


def test_extrapolation_is_the_default_when_no_future_is_given():
    found = load_device("elbow_drive", "predictive").system
    assert found.task("control").blocks == ("trend", "ahead", "predictive", "redundancy", "stamp")
    assert {x.name for x in found.inputs} == {
        x.name for x in load_device("elbow_drive").system.inputs
    }


@pytest.mark.ci
def test_the_tuning_case_is_followed_without_a_future():
    path = tuning()
    run = run_case(Case("tuning", path), Setting("mpc-no-preview"), 0)
    error = (run.plant["tau_e_Nm"] - path.tau_desired_Nm)[path.window]
    # Held still it was 0.378; with the true future it is 0.040.
    assert np.sqrt(np.mean(error**2)) < 0.043


@pytest.mark.ci
def test_a_step_is_followed_as_by_a_held_torque(tmp_path):
    case = Case("step", fixed_output("step", np.where(np.arange(2500) >= 1000, 0.5, 0.0), 1000))
    runs = [run_case(case, Setting(c), 0) for c in ("mpc-no-preview", held(tmp_path))]
    assert np.array_equal(runs[0].controller["u_Nm"], runs[1].controller["u_Nm"])
    assert 0 < runs[0].plant["tau_e_Nm"][1000:].max() - 0.5 < 0.1
    # Armed: they differ as soon as the torque moves on.
    moving = Case("ramp", fixed_output("ramp", np.clip(np.arange(2500) / 1000 - 1, 0, 1), 1000))
    runs = [run_case(moving, Setting(c), 0) for c in ("mpc-no-preview", held(tmp_path))]
    assert not np.array_equal(runs[0].controller["u_Nm"], runs[1].controller["u_Nm"])


def peaks(size_Nm, frequency_Hz):
    """At a sine's peak, what of it is asked for: the motor idle and at its limit."""
    t = H * np.arange(801)
    wanted = 0.5 + size_Nm * np.sin(2 * np.pi * frequency_Hz * (t - t[-1]) + np.pi / 2)
    return [ahead(wanted, u_Nm=u)[-1, 0] - 0.5 for u in (0.0, 0.22)]


def test_less_of_what_is_fast_is_asked_of_a_motor_at_its_limit():
    idle, full = peaks(2.0, 2.0)
    assert idle > 1.8
    assert abs(full) < 0.2 * idle
    idle, full = peaks(2.0, 0.2)  # a slow wish is not what takes the motor to its limit
    assert full > 0.9 * idle


@pytest.mark.ci
@pytest.mark.parametrize(
    ("size_Nm", "frequency_Hz", "most_Nm"), [(2, 2, 3.0), (-1, 3, 1.5), (3, 3, 4.5), (-3, 4, 4.0)]
)
def test_what_the_motor_cannot_follow_does_not_swing_up(size_Nm, frequency_Hz, most_Nm):
    wanted = size_Nm * np.sin(2 * np.pi * frequency_Hz * np.arange(3000) / 1000)
    # The law reckons with an arm that moves; before, each latched, and 5 to 8 Nm came of it.
    setting = Setting("mpc-no-preview", tunables={"predictive": {"load_free": 1.0}})
    run = run_case(Case("fast", fixed_output("fast", wanted, 500)), setting, 7)
    assert not run.controller["fault"][500:].any()
    assert not run.plant["tripped"].any()
    assert np.abs(run.plant["tau_e_Nm"]).max() < most_Nm
