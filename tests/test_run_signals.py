"""What a closed-loop run is given: signals along a path, tunables merged, rates made alike."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.twin import run as module
from esea_gen.twin.case import IMPEDANCE, TORQUE, Case, Setting
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.parameters import plant_tunables
from esea_gen.twin.people import real_plant
from esea_gen.twin.published import PEOPLE
from esea_gen.twin.run import plant_variant, previews, run_on, told
from esea_gen.twin.trajectories import Trajectory

SIGNALS = ("stop", "law", "frame_error_gear", "tau_preview_Nm")


def path_of(n, clamped=False):
    k = np.arange(n, dtype=float)
    return Trajectory("path", k, 10 * k, 100 * k, -k, 0, n, clamped)


DRIVE = load_device("elbow_drive")


@pytest.fixture
def drive():
    return DRIVE


@pytest.fixture
def rated(monkeypatch):
    """Makes a device of a period and of these Blocks, with the elbow's drive."""
    monkeypatch.setattr(module, "device_horizon", lambda _: SimpleNamespace(ends_s=(0.004,)))
    tasks = [SimpleNamespace(every=1), SimpleNamespace(every=5)]

    def made(*blocks, period_s=1e-3):
        system = SimpleNamespace(tasks=tasks, blocks=dict.fromkeys(blocks))
        return SimpleNamespace(
            period_s=period_s, system=system, file=DRIVE.file, origin="x", axes=("",)
        )

    return made


@pytest.mark.parametrize(("tick_s", "early"), [(1e-3, 1), (2e-3, 2)])
def test_a_preview_is_of_the_ends_of_the_intervals_as_seen_a_tick_ago(tick_s, early):
    path = path_of(40)
    horizon = SimpleNamespace(ends_s=(0.005, 0.0104, 0.030))
    found = previews(path, horizon, tick_s)
    at = np.minimum(np.arange(40)[:, None] + np.array([5, 10, 30]) - early, 39)
    assert list(found) == ["tau_preview_Nm", "theta_preview_rad", "omega_preview_rad_s"]
    for values, factor in zip(found.values(), (-1, 1, 10), strict=True):
        np.testing.assert_array_equal(values, factor * at)
    np.testing.assert_array_equal(previews(path, horizon)["theta_preview_rad"][0], [4, 9, 29])


def clocked(monkeypatch, every, period_s):
    monkeypatch.setattr(module, "device_horizon", lambda _: SimpleNamespace(ends_s=(0.004,)))
    tasks = [SimpleNamespace(every=1), SimpleNamespace(every=every)]
    return SimpleNamespace(period_s=period_s, system=SimpleNamespace(tasks=tasks), axes=("",))


@pytest.mark.parametrize(
    ("every", "armed", "on"),
    # 30 and 60 ms, and of a slow task two and a half and three periods.
    [(5, 30, 60), (12, 30, 60), (13, 33, 60), (20, 50, 60), (21, 53, 63), (40, 100, 120)],
)
def test_a_controller_is_off_then_armed_then_on(monkeypatch, every, armed, on):
    device = clocked(monkeypatch, every, 1e-3)
    path = path_of(200)
    found = told(device, SimpleNamespace(signals=SIGNALS), path, IMPEDANCE)
    assert np.flatnonzero(found["rearm"] == 1).tolist() == list(range(armed, 200))
    assert found["mode"].tolist() == on * [0.0] + (200 - on) * [2.0]
    for name in ("stop", "law", "frame_error_gear"):
        assert found[name].tolist() == 200 * [0.0]
    np.testing.assert_array_equal(
        found["tau_preview_Nm"][:, 0], -np.minimum(np.arange(200) + 3, 199)
    )
    for name, array in path.signals().items():
        np.testing.assert_array_equal(found[name], array)
    assert set(found) == {"mode", "rearm", *SIGNALS, *path.signals()}


def test_a_device_of_another_rate_is_told_what_holds_at_its_ticks(monkeypatch):
    path = path_of(200)
    for period_s, expected in (
        (2e-3, 2 * np.arange(100)),
        (5e-4, np.arange(400) // 2),
        (0.75e-3, np.minimum(0.75 * np.arange(267) + 1e-6, 199).astype(int)),
    ):
        device = clocked(monkeypatch, 10, period_s)
        found = told(device, SimpleNamespace(signals=()), path, TORQUE)
        np.testing.assert_array_equal(found["theta_p_rad"], expected)
        # 30 ms and 60 ms of time, whatever the tick.
        assert np.flatnonzero(found["mode"])[0] * period_s == pytest.approx(0.060, abs=period_s)


def test_plants_and_people_by_name(drive):
    for plant, cable in (("ideal", False), ("real", True), ("random", True)):
        made = plant_variant(drive, plant, "none", 3)
        assert (made.cable, made.values["clamped"], made.step_s) == (cable, 1.0, 2e-4)
    assert plant_variant(drive, "real", "none", 3).values == {
        **real_plant(drive, seed=3).values,
        **PEOPLE["none"].values(),
    }
    for name in ("ideal", "uncertain", "uncertain-no-feedforward"):
        values = plant_variant(drive, "random", name, 3).values
        assert values.items() >= PEOPLE[name].values().items()
    one, other = (plant_variant(drive, "ideal", "random", k).values for k in (1, 2))
    assert one["Jh_kgm2"] != other["Jh_kgm2"]
    for arguments in (("odd", "none"), ("ideal", "odd")):
        with pytest.raises(UserError, match="odd"):
            plant_variant(drive, *arguments, 0)


@pytest.mark.parametrize(
    ("period_s", "step_s"),
    [(1e-3, 2e-4), (2e-3, 2e-4), (5e-4, 5e-4 / 3), (4e-4, 2e-4), (1.1e-3, 1.1e-3 / 6)],
)
def test_a_plant_takes_whole_steps_in_a_tick_none_longer_than_its_own(drive, period_s, step_s):
    device = SimpleNamespace(period_s=period_s, file=drive.file, axes=("",))
    assert plant_variant(device, "ideal", "none", 0).step_s == pytest.approx(step_s, rel=1e-12)


class Loop:
    """Keeps what it is given; gives back what counts its ticks."""

    def __init__(self, plant):
        self.signals, self.plant = {}, plant

    def run(self, signals, plant, tunables, **more):
        self.given = signals, plant, tunables, more
        n = len(signals["mode"])
        k = np.arange(n, dtype=float)
        return ClosedLoopRun({"theta_l_rad": k}, {"u_Nm": -k}, 0.5 * k, 7)


def plant_of(cable):
    """Blocks with the tunables of a plant."""
    parts = {"plant": plant_tunables(DRIVE, cable), "encoders": ()}
    return SimpleNamespace(
        blocks={k: SimpleNamespace(tunables=t) for k, t in parts.items()},
        tunables=[(k, x) for k, t in parts.items() for x in t],
    )


def ran(device, case, setting, cable=True, **more):
    loop = Loop(plant_of(cable))
    variant = real_plant(DRIVE, seed=2).having(**more)
    found = run_on(loop, device, variant, case, setting, 2)
    return found, loop.given


def test_a_run_merges_its_own_tunables_over_those_of_the_setting(rated):
    drive = rated()
    told_before = {"limits": {"a": 1.0, "b": 2.0}, "reference": {"c": 3.0}}
    case = Case(
        "x", path_of(300), TORQUE, {"limits": {"b": 5.0}, "law": {"d": 6.0}}, {"fc_Nm": 0.9}
    )
    setting = Setting(tunables=told_before, off="delay+5ms", fault="slip:gear@0.1=0.2")
    found, (signals, plant, tunables, more) = ran(drive, case, setting, fc_Nm=0.1, fv_Nms_rad=0.2)
    assert tunables == {
        "limits": {"a": 1.0, "b": 5.0},
        "reference": {"c": 3.0},
        "law": {"d": 6.0},
    }
    assert told_before["limits"]["b"] == 2.0
    assert (plant["fc_Nm"], plant["fv_Nms_rad"]) == (0.9, 0.2)
    assert (more["seed"], more["delay_ticks"], more["missed"]) == (2, 5, None)
    assert str(more["fault"]) == "slip:gear@0.1=0.2"
    assert found.missed_runs == 7
    assert found.time_s[2] == 1.0  # as the loop gave it back
    assert signals["mode"][-1] == 1
    # What a rigid plant does not have is left out where a case asks, and refused of a family.
    case = Case("x", path_of(300), TORQUE, {}, {"cable_loss": 0.3, "fc_Nm": 0.7})
    _, (_, plant, _, more) = ran(drive, case, Setting(), cable=False, cable_loss=0.11)
    assert (plant["cable_loss"], plant["fc_Nm"], more["fault"]) == (0.11, 0.7, None)
    with pytest.raises(UserError, match="cable is rigid"):
        ran(drive, case, Setting(off="backlash-30mrad"), cable=False)


def test_what_predictive_control_is_told_beside(rated):
    device = rated("predictive")
    for mode, controller, clamped, expected in (
        (TORQUE, "mpc", True, {"load_free": 0.0}),
        (TORQUE, "mpc-published", False, {"load_free": 1.0}),
        (IMPEDANCE, "mpc", False, {"load_free": 1.0}),
        (IMPEDANCE, "mpc-published-b", False, {"load_free": 1.0, "Q": 1.0, "R": 0.005}),
    ):
        case = Case("x", path_of(300, clamped), mode)
        _, (_, _, tunables, _) = ran(device, case, Setting(controller))
        assert tunables == {"predictive": expected}
    own = Setting("mpc", tunables={"predictive": {"load_free": 0.5, "z": 1.0}})
    _, (_, _, tunables, _) = ran(device, Case("x", path_of(300)), own)
    assert tunables == {"predictive": {"load_free": 0.5, "z": 1.0}}
    _, (_, _, tunables, _) = ran(rated("law"), Case("x", path_of(300)), Setting())
    assert tunables == {}


def test_what_was_adapted_is_told_beneath_what_a_setting_says(rated, monkeypatch):
    drive = rated("adaptation")
    monkeypatch.setattr(module, "_weighed", lambda *given: {"gain": 0.9, "of": given[2:]})
    own = Setting(plant="random", off="lag-x2", adapted=True)
    _, (_, _, tunables, _) = ran(drive, Case("x", path_of(300)), own)
    assert tunables == {"adaptation": {"gain": 0.9, "of": ("random", "lag-x2", 2)}}
    own = Setting(tunables={"adaptation": {"gain": 1.1}}, adapted=True)
    _, (_, _, tunables, _) = ran(drive, Case("x", path_of(300)), own)
    assert tunables["adaptation"]["gain"] == 1.1
    less = SimpleNamespace(origin="less.toml", system=SimpleNamespace(blocks={}))
    module.refuse_unadapted(less, Setting())
    with pytest.raises(UserError, match=r"less.toml: .* no section \[adaptation\]"):
        module.refuse_unadapted(less, own)


def test_a_device_of_another_rate_is_judged_at_that_of_the_paths(drive, rated):
    device = rated(period_s=2e-3)
    setting = Setting(off="missed-10%")
    found, (signals, _, _, more) = ran(device, Case("x", path_of(300)), setting)
    assert len(signals["mode"]) == len(more["missed"]) == 150
    np.testing.assert_array_equal(found.plant["theta_l_rad"], np.arange(300) // 2)
    np.testing.assert_array_equal(found.controller["u_Nm"], -(np.arange(300) // 2))
    np.testing.assert_allclose(found.time_s, np.arange(300) / 1000)
    assert found.missed_runs == 7
    every = module.deviation("missed-10%", drive, 2).missed(300, 2)
    np.testing.assert_array_equal(more["missed"], every[::2])
    _, (_, _, _, more) = ran(device, Case("x", path_of(300)), Setting(off="delay+10ms"))
    assert more["delay_ticks"] == 5


@pytest.mark.parametrize(("clamped", "person"), [(True, "none"), (False, "uncertain")])
def test_a_case_is_run_on_the_device_plant_and_person_of_its_setting(monkeypatch, clamped, person):
    monkeypatch.setattr(module, "controller_device", lambda name: f"device of {name}")
    monkeypatch.setattr(
        module, "plant_variant", lambda *given: SimpleNamespace(cable="cable", given=given)
    )
    monkeypatch.setattr(module, "compiled_loop", lambda *given: given)
    monkeypatch.setattr(module, "run_on", lambda *given: given)
    case, setting = Case("x", path_of(3, clamped)), Setting("mpc", "random", "uncertain", "q31")
    loop, device, variant, *rest = module.run_case(case, setting, 7)
    assert loop == ("device of mpc", "cable", "q31")
    assert device == "device of mpc"
    assert variant.given == ("device of mpc", "random", person, 7)
    assert rest == [case, setting, 7]


def test_what_is_weighed_is_swung_with_nobody_in_the_same_plant(monkeypatch):
    monkeypatch.setattr(module, "plant_variant", lambda *given: given)
    monkeypatch.setattr(module, "run_on", lambda *given: given)
    monkeypatch.setattr(module, "found_by", lambda run: run)
    found = module._weighed.__wrapped__("loop", "device", "random", "lag-x2", 7)
    loop, device, variant, case, setting, seed = found
    assert (loop, device, seed) == ("loop", "device", 7)
    assert variant == ("device", "random", "ideal", 7)
    assert case.name == "weighing"
    assert setting == Setting(plant="random", off="lag-x2")
