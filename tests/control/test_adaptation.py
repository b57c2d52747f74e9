"""Adaptation of the wish to the rubber at hand, learnt with a known mass."""

from __future__ import annotations

import math

import numpy as np
import pytest

import esea_gen
from esea_gen.control.adaptation import adaptation
from esea_gen.control.reference import reference
from esea_gen.device import parse_device
from esea_gen.errors import UserError
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy, simulate_case
from esea_gen.twin.case import Setting
from esea_gen.twin.run import run_case
from tests.conftest import require_tool, without
from tests.control.test_passive_block import SHIPPED

H, MASS_NM, HANGS_RAD = 0.001, 3.0, 1.0
HUNG = {"mass_Nm": MASS_NM, "mass_angle_rad": HANGS_RAD}
CASE = "1.7 Nm 0.6 Hz"


@pytest.fixture(scope="module")
def drive():
    return esea_gen.load_device("elbow_drive")


@pytest.fixture(scope="module")
def block(drive):
    return adaptation(drive)


def flags(block) -> dict[str, int]:
    status = next(p for p in block.outputs if p.name == "status")
    return {f.name: 1 << i for i, f in enumerate(status.flags)}


def swung(seconds: float, Hz: float = 0.25, size: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    """Angle and rate of the joint."""
    t = np.arange(round(seconds / H)) * H
    w = 2 * math.pi * Hz
    return HANGS_RAD + size * np.sin(w * t), size * w * np.cos(w * t)


def stop_operator(x: np.ndarray, r: float) -> np.ndarray:
    """By its definition (3.5 to 3.7): sums of increments, clipped."""
    e = np.zeros_like(x)
    for k in range(1, len(x)):
        e[k] = min(max(x[k] - x[k - 1] + e[k - 1], -r), r)
    return e


def run(block, tau: np.ndarray, angle: np.ndarray, rate: np.ndarray, tunables, **more):
    """Outputs by name, of every step; the simulator, which holds the state."""
    given = {"tau_desired_Nm": 0.0, "sensing_ok": 1.0} | more
    given |= {"tau_Nm": tau, "theta_load_rad": angle, "omega_load_rad_s": rate}
    simulator = block.simulator(tunables)
    y, _ = simulator.run({n: np.broadcast_to(v, tau.shape) for n, v in given.items()})
    return y, simulator


def test_a_spring_off_by_its_scale_is_found(block):
    """The gain is one over the scale; an offset and a loss on top of it are found beside it."""
    angle, rate = swung(25, size=1.3)
    true = MASS_NM * np.sin(angle - HANGS_RAD)
    for scale, loss, offset in ((0.8, 0.0, 0.0), (1.2, -0.15, 0.08)):
        shown = true / scale + loss * stop_operator(true, 0.8) + offset
        y, _ = run(block, shown, angle, rate, HUNG)
        # The lag of 2 Hz delays the stop operator's corners: a hundredth of the torque.
        assert y["gain"][-1] == pytest.approx(1 / scale, abs=0.01)
        assert y["loss"][-1] == pytest.approx(loss, abs=0.02)
        assert y["offset_Nm"][-1] == pytest.approx(offset, abs=0.01)
        assert np.max(np.abs(y["missed_Nm"][-4000:])) < 0.04
        assert int(y["status"][-1]) == flags(block)["LEARNS"]


def test_nothing_but_the_wish_reads_what_was_learnt(drive):
    """So no limit, no comparison and no observer moves: an adaptation cannot move a trip."""
    for device in (drive, esea_gen.load_device("elbow_mpc")):
        readers = {a.instance for a, b in device.system.wires.items() if b.instance == "adaptation"}
        assert readers <= {"reference", "ahead"}


@pytest.fixture(scope="module")
def bare() -> str:
    """The shipped drive without the section."""
    text = without(SHIPPED.read_text(encoding="utf-8"), "adaptation")
    return text.replace('name = "elbow_drive"', 'name = "bare"')


def test_a_device_without_the_section_has_neither_block_nor_ports(bare):
    device = parse_device(bare, "bare.toml")
    assert "adaptation" not in device.system.blocks
    assert not {"wish_gain", "wish_shift_Nm"} & {p.name for p in reference(device).inputs}
    with pytest.raises(UserError, match=r"\[adaptation\] is missing"):
        adaptation(device)


def test_it_goes_with_a_drive_and_names_what_it_may_not():
    def own(base: str, section: str) -> str:
        return f'schema = 1\nextends = "{base}"\nname = "own"\ntitle = "Own"\n{section}'

    text = SHIPPED.read_text(encoding="utf-8")
    section = "[adaptation]" + text.split("[adaptation]")[1].split("\n[")[0]
    with pytest.raises(UserError, match=r"section \[actuator\] is missing"):
        parse_device(own("elbow", section), "own.toml")
    scale = 'scale_least = { value = 1.2, status = "assumed", source = "x" }'
    with pytest.raises(UserError, match="scale_least"):
        parse_device(own("elbow_drive", f"[adaptation]\n{scale}\n"), "own.toml")


REAL = {"plant": "real", "person": "none", "real": "f32"}


def test_a_rubber_that_is_off_is_adapted_to():
    """Ten per cent soft: 0.12 Nm without, 0.04 with, which is what a true rubber has."""
    require_tool("gcc")
    plain, adapted = (
        simulate_case("tuning", CASE, 0, controller="smc", off="rubber-10", adapted=adapted, **REAL)
        for adapted in (False, True)
    )
    assert plain["rms_true_Nm"] > 0.10
    assert adapted["rms_true_Nm"] < 0.06
    assert not adapted["unstable"]
    assert not adapted["fault"]


@pytest.mark.slow
@pytest.mark.parametrize("real", ["f32", "q31"])
def test_off_the_drive_gives_the_bits_of_one_without_the_section(bare, tmp_path, real):
    require_tool("gcc")
    path = tmp_path / "bare.toml"
    path.write_text(bare, encoding="utf-8")
    case = load_study("tuning", ClosedLoopStudy).case(CASE)
    with_it, without_it, armed = (
        run_case(case, Setting(controller, "real", "none", real, tunables), 0)
        for controller, tunables in (
            ("elbow_drive", {"adaptation": {"gain": 1.2, "loss": 0.1}}),
            (str(path), {}),
            ("elbow_drive", {"adaptation": {"gain": 1.2, "share": 1.0}}),
        )
    )
    assert np.array_equal(with_it["u_Nm"], without_it["u_Nm"])
    assert np.array_equal(with_it["tau_set_Nm"], without_it["tau_set_Nm"])
    assert not np.array_equal(armed["u_Nm"], without_it["u_Nm"])


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["smc", "mpc"])
@pytest.mark.parametrize(
    ("off", "most_Nm"),
    [("rubber-20", 0.08), ("rubber+20", 0.08), ("hysteresis-x2", 0.06), ("relaxation", 0.06)],
)
def test_each_way_for_a_rubber_to_be_off(controller, off, most_Nm):
    require_tool("gcc")
    found = simulate_case("tuning", CASE, 0, controller=controller, off=off, adapted=True, **REAL)
    assert found["rms_true_Nm"] < most_Nm
