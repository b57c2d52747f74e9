"""A controller of two axes in closed loop with two drives and a hand."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.control.impairment import PUBLISHED
from esea_gen.device import load_device, parse_device
from esea_gen.errors import UserError
from esea_gen.model.sensing import of_axis
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.studies.wall import push_case
from esea_gen.twin.case import Setting
from esea_gen.twin.run import axis_of, compiled_loop, plant_variant, run_case, run_on
from esea_gen.verify.faults.campaign import bound_ticks
from esea_gen.verify.faults.kinds import BoardFault
from esea_gen.verify.faults.rig import SCENES, rig_of
from tests.own_device import own_device, own_text

DEVICE = load_device("wrist_drive")
AXES = DEVICE.axes
WALL = {"base": "wrist_drive", "name": "wrist_published", "impairment": {"wall": "published"}}


@pytest.mark.parametrize(
    ("axis", "controller"),
    [(AXES[0], "wrist_drive"), pytest.param(AXES[1], "mpc@wrist_drive", marks=pytest.mark.ci)],
)
def test_one_axis_follows_and_the_other_stays_without_torque(axis, controller):
    case = load_study("tuning", ClosedLoopStudy).cases()[0]
    run = run_case(case, Setting(controller, "real", "none", axis=axis), 3)
    w = case.trajectory.window
    error = run["tau_e_Nm"][w] - case.trajectory.tau_desired_Nm[w]
    assert np.sqrt(np.mean(error**2)) < 0.06
    (other,) = set(AXES) - {axis}
    assert np.max(np.abs(run[of_axis("tau_e_Nm", other)][w])) < 0.1


def test_an_axis_that_is_not_there_is_rejected():
    with pytest.raises(UserError, match="roll"):
        axis_of(DEVICE, Setting("wrist_drive", axis="roll"))


def ripple(device, push_Nm, hand_Nm_rad, seed):
    variant = plant_variant(device, "random", "random", seed)
    case = push_case(push_Nm, hand_Nm_rad)
    loop = compiled_loop(device, True, "f32")
    run = run_on(loop, device, variant, case, Setting(plant="random", axis="flexion"), seed)
    tau = run["tau_e_Nm"][case.trajectory.window]
    t = np.linspace(-1, 1, len(tau))
    assert run["fault"][-1] == 0
    return np.max(np.abs(tau - np.polyval(np.polyfit(t, tau, 2), t))), float(np.mean(tau))


@pytest.mark.parametrize("hand_Nm_rad", [0.0, 60.0])
@pytest.mark.parametrize("push_Nm", [0.5, 2.0])
def test_the_wall_holds_without_swinging(push_Nm, hand_Nm_rad):
    for seed in (4000, 4001):
        size, mean = ripple(DEVICE, push_Nm, hand_Nm_rad, seed)
        assert size < 0.1
        assert mean == pytest.approx(-push_Nm, abs=0.15)


def test_the_published_wall_by_name():
    device = own_device(**WALL)
    found = {t.name: t.default for i, t in device.system.tunables if i == "impairment_flexion"}
    for name, value in PUBLISHED.items():
        assert found[name] == pytest.approx(value, rel=1e-6)


def test_axes_without_a_wall():
    found = {(i, t.name): t.default for i, t in DEVICE.system.tunables}
    assert found["impairment_flexion", "Kp_Nm_rad"] > 0
    assert found["impairment_deviation", "Kp_Nm_rad"] == 0
    assert found["impairment_deviation", "Kv_Nms_rad"] > 0
    wrong = own_text(**WALL) + 'wall_axes = ["roll"]\n'
    with pytest.raises(UserError, match="roll"):
        parse_device(wrong, "wrong.toml")


@pytest.mark.parametrize("axis", [AXES[0], pytest.param(AXES[1], marks=pytest.mark.ci)])
@pytest.mark.parametrize("scene", SCENES[1:3], ids=lambda s: s.name)
def test_one_encoder_releases_both_axes_in_time(axis, scene):
    fault = BoardFault(of_axis("count_load", axis), "NaN")
    rig = rig_of(DEVICE)
    felt = rig.run(scene, fault, 1000, 1)
    assert felt.found_ticks is not None
    assert felt.found_ticks <= bound_ticks(DEVICE, fault)
    assert not rig.board.motor_on
    assert rig.board.motors_Nm == (0.0,) * len(AXES)
