"""Adaptation of the wish to the rubber at hand."""

from __future__ import annotations

import numpy as np
import pytest

import esea_gen
from esea_gen.control.adaptation import adaptation
from esea_gen.control.reference import reference
from esea_gen.device import parse_device
from esea_gen.errors import UserError
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.case import Setting
from esea_gen.twin.run import run_case
from tests.conftest import without
from tests.control.test_passive_block import SHIPPED
from tests.own_device import own_device

CASE = "1.7 Nm 0.6 Hz"


def test_nothing_but_the_wish_reads_the_adaptation(drive):
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
    text = SHIPPED.read_text(encoding="utf-8")
    section = "[adaptation]" + text.split("[adaptation]")[1].split("\n[")[0]
    with pytest.raises(UserError, match=r"section \[actuator\] is missing"):
        own_device(section, "elbow")
    with pytest.raises(UserError, match="scale_least"):
        own_device(adaptation={"scale_least": 1.2})


def test_a_rubber_that_is_off_is_adapted_to():
    """Ten per cent soft: 0.12 Nm without, 0.04 with its gain set, which is what a true one has."""
    case = load_study("tuning", ClosedLoopStudy).case(CASE)
    errors = []
    for gain in (1.0, 1 / 0.9):
        tunables = {"adaptation": {"share": 1.0, "gain": gain}}
        run = run_case(case, Setting("smc", "real", "none", "f32", tunables, off="rubber-10"), 0)
        assert run["fault"][-1] == 0
        left = (run["tau_e_Nm"] - case.trajectory.tau_desired_Nm)[case.trajectory.window]
        errors.append(np.sqrt(np.mean(left**2)))
    assert errors[0] > 0.10
    assert errors[1] < 0.06


@pytest.mark.slow
@pytest.mark.parametrize("real", ["f32", "q31"])
def test_off_the_drive_gives_the_bits_of_one_without_the_section(bare, tmp_path, real):
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
