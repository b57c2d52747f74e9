"""Where the wanted torque is going: closed forms, steps, noise, and the loop."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.integrate import quad

from esea_gen.control.predictive.horizon import Horizon
from esea_gen.control.trend import FADE_S, trend
from esea_gen.device import load_device
from esea_gen.devices.file import controller_document
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.run import run_case
from esea_gen.twin.trajectories import fixed_output, tuning
from tests.conftest import require_tool

GRID = Horizon(10, 0.02, 4, 0.002)
ENDS = np.array(GRID.ends_s)
H = 0.005


@cache
def block():
    return trend(load_device("elbow_drive"), GRID.ends_s)


def ahead(wanted, **tunables):
    """What the Block gives along a wanted torque, shape (steps, intervals); steps every 5 ms."""
    simulator = block().simulator(tunables)
    return np.array([simulator.step(tau_wanted_Nm=float(w))["tau_ahead_Nm"] for w in wanted])


def gone_on(rate, curve):
    """A torque that goes on with a rate, an acceleration and the fading of both: by quadrature."""
    path = [quad(lambda x: (rate + curve * x) * np.exp(-x / FADE_S), 0, t)[0] for t in ENDS]
    return np.array(path)


@pytest.mark.parametrize("rate", [0.5, -3.0, 12.0])
def test_a_ramp_goes_on_with_its_rate(rate):
    wanted = rate * H * np.arange(60)
    assert ahead(wanted)[-1] == pytest.approx(wanted[-1] + gone_on(rate, 0), abs=2e-3 * abs(rate))


@pytest.mark.parametrize(("size_Nm", "frequency_Hz"), [(1.7, 0.6), (3.0, 1.0), (0.75, 1.5)])
def test_a_sine_goes_on_as_a_triple_pole_sees_it(size_Nm, frequency_Hz):
    # Three poles at 16 Hz that follow an acceleration: acceleration through 1/(1 + x)^3, rate
    # through (1 + 3 x)/(1 + x)^3, with x the Laplace variable over the bandwidth.
    s = 2j * np.pi * frequency_Hz
    x = s / (2 * np.pi * 16)
    turning = size_Nm * np.exp(s * H * np.arange(600)) / 1j
    rate = (turning * s * (1 + 3 * x) / (1 + x) ** 3).real
    curve = (turning * s**2 / (1 + x) ** 3).real
    found = ahead(turning.real)
    for k in range(300, 600, 17):
        expected = turning[k].real + gone_on(rate[k], curve[k])
        assert np.abs(found[k] - expected).max() < 0.04 * size_Nm  # 5 ms steps


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
    assert added(0.1, quiet_Nm=1.0) > 1


# -- in the loop -----------------------------------------------------------------------------------


def held(tmp_path):
    """The same controller that holds the wanted torque still."""
    text = (
        'schema = 1\nextends = "elbow_drive"\nname = "mpc_held"\ntitle = "Test"\n'
        'laws = ["predictive"]\n[timing]\n'
        'control_release_s = { value = 0.002, status = "assumed", source = "test" }\n'
        '[predictive]\nfuture = "held"\n'
    )
    for key, value in controller_document("mpc-no-preview")["predictive"].items():
        if key != "future":
            text += f'{key} = {{ value = {value["value"]}, status = "assumed", source = "test" }}\n'
    path = tmp_path / "held.toml"
    path.write_text(text)
    return str(path)


def test_extrapolation_is_the_default_when_no_future_is_given():
    found = load_device("elbow_drive", "predictive").system
    assert found.task("control").blocks == ("trend", "ahead", "predictive", "redundancy", "stamp")
    assert {x.name for x in found.inputs} == {
        x.name for x in load_device("elbow_drive").system.inputs
    }


@pytest.mark.ci
def test_the_tuning_case_is_followed_without_a_future():
    require_tool("gcc")
    path = tuning()
    run = run_case(Case("tuning", path), Setting("mpc-no-preview"), 0)
    error = (run.plant["tau_e_Nm"] - path.tau_desired_Nm)[path.window]
    # Held still it was 0.378; with the true future it is 0.040.
    assert np.sqrt(np.mean(error**2)) < 0.043


@pytest.mark.ci
def test_a_step_is_followed_as_by_a_held_torque(tmp_path):
    require_tool("gcc")
    wanted = np.where(np.arange(2500) >= 1000, 0.5, 0.0)
    case = Case("step", fixed_output("step", wanted, 1000))
    runs = [run_case(case, Setting(c), 0) for c in ("mpc-no-preview", held(tmp_path))]
    assert np.array_equal(runs[0].controller["u_Nm"], runs[1].controller["u_Nm"])
    assert 0 < runs[0].plant["tau_e_Nm"][1000:].max() - 0.5 < 0.1
    # Armed: they differ as soon as the torque moves on.
    moving = Case("ramp", fixed_output("ramp", np.clip(np.arange(2500) / 1000 - 1, 0, 1), 1000))
    runs = [run_case(moving, Setting(c), 0) for c in ("mpc-no-preview", held(tmp_path))]
    assert not np.array_equal(runs[0].controller["u_Nm"], runs[1].controller["u_Nm"])
