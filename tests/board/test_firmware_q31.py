"""The q31 C below the application on an emulated board without an FPU, bit for bit the host's."""

from __future__ import annotations

import re

import numpy as np
import pytest

from esea_gen.board.emulator import RunningBoard, run_tasks_in_emulator
from esea_gen.board.firmware import build_firmware
from esea_gen.device import load_device
from esea_gen.emit.build import format_hash, render_device
from esea_gen.hostlib import compile_device
from esea_gen.link.transport import LinkError
from esea_gen.twin.recorded import record_drive
from tests.conftest import require_tool
from tests.firmware_harness import run_in_emulator

pytestmark = pytest.mark.ci

BOARD = "mps2-an385"
STEPS = 400
TICKS = 300


def deflection_rad() -> np.ndarray:
    """Reversals through zero, and numbers that have no raw number."""
    theta = (0.2 * np.sin(np.arange(STEPS) * 0.05)).astype(np.float32)
    theta[300:308] = [np.nan, np.inf, -np.inf, 3.4e38, -0.0, 1e-40, 1.0, -1.0]
    return theta


@pytest.fixture(scope="module")
def tools():
    for name in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(name)


@pytest.fixture(scope="module")
def run(elbow, tools, tmp_path_factory):
    image = build_firmware(elbow, BOARD, tmp_path_factory.mktemp("q31"))
    return run_in_emulator(elbow, image, {"theta_rad": deflection_rad()})


def altered(elbow, name: str, find: str, put: str) -> dict[str, str]:
    """The device's q31 files with one place changed."""
    files = dict(render_device(elbow, ["q31"])[0].files)
    text = re.sub(find, put, files[name], count=1)
    assert text != files[name], find
    return files | {name: text}


def test_every_number_on_the_link_is_the_hosts(elbow, run):
    assert run.identical, run.first_difference
    assert run.board == BOARD
    assert run.content_hash == run.expected_hash == format_hash(elbow, "q31")
    assert run.sequence_gaps == run.bad_frames == run.lost_bytes == 0
    assert 0 < run.stack_peak_bytes < run.stack_bytes
    # Whole numbers and their conversions, on a core that calls the library for float ones: above
    # the 1564 instructions of the step alone, far below the 8805 of the float step.
    assert 1564 < run.instructions["median"] < 3000


def test_the_torque_is_the_double_precision_one(elbow, run):
    # A second way: no raw number on it.
    theta = deflection_rad().astype(float)
    exact, _ = compile_device(elbow, "f64").task("sense").run({"theta_rad": theta}, trace=False)
    assert np.ptp(exact["tau_Nm"]) > 2
    assert np.max(np.abs(run.outputs["tau_Nm"] - exact["tau_Nm"])[:300]) < 1e-3
    # What has no raw number is no valid input in either format.
    assert np.array_equal(run.outputs["sensor_status"][:308], exact["sensor_status"][:308])


def test_a_float_in_the_control_code_is_refused(elbow, tools, tmp_path):
    body = r"(void esea_elbow_sense_step\([^{]*\{)"
    control = altered(elbow, "esea_elbow.c", body, r"\1 volatile float x = 1.0f; x = x * 3.0f;")
    with pytest.raises(RuntimeError, match=r"not q31 only: esea_elbow\.o: __aeabi_fmul"):
        build_firmware(elbow, BOARD, tmp_path, control)


def test_a_parameter_is_the_nearest_whole_number_of_its_format(elbow, tools, tmp_path):
    with RunningBoard(elbow, build_firmware(elbow, BOARD, tmp_path)) as board:
        (stream,) = board.stream(["velocity_status", "omega_rad_s"])
        for value in (2.0, 100.0, 3.14159274, 60.7):
            got = board.set_parameter("velocity.bandwidth_Hz", value)
            assert abs(got - value) <= 2.0**-24 * value
        with pytest.raises(LinkError, match="outside 2 to 100"):
            board.set_parameter("velocity.bandwidth_Hz", 100.5)
        assert board.parameters() == {"velocity.bandwidth_Hz": got}
        assert board.samples(board.wait_for("ESEA_DATA")).names == stream.names


def test_a_whole_drive_runs_in_whole_numbers(tools, tmp_path):
    drive = load_device("elbow_drive")
    image = build_firmware(drive, BOARD, tmp_path)
    found = run_tasks_in_emulator(drive, image, record_drive(drive, TICKS).inputs)
    assert {t: r.steps for t, r in found.items()} == {"sense": TICKS, "control": TICKS // 5}
    for r in found.values():
        assert r.identical, r.first_difference
        assert r.hash_matches
    assert np.ptp(found["sense"].outputs["tau_Nm"]) > 0.1
    assert np.any(found["control"].outputs["u_command_Nm"] != 0)
