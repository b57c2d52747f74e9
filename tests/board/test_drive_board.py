"""Interleaved tasks of a drive on a board against the closed loop, bit for bit."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import esea_gen
from esea_gen.board import emulator
from esea_gen.board.emulator import RunningBoard, first_difference, run_tasks_in_emulator
from esea_gen.board.firmware import build_firmware
from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.twin.recorded import record_drive
from tests.conftest import require_tool
from tests.firmware_harness import run_in_emulator

pytestmark = pytest.mark.ci

TICKS = 600


@pytest.fixture(scope="module")
def device():
    return esea_gen.load_device("elbow_drive")


@pytest.fixture(scope="module")
def drive(device):
    return record_drive(device, TICKS)


@pytest.fixture(scope="module")
def native(device, tmp_path_factory):
    """The image for this computer, with sanitizers."""
    return build_firmware(device, "host", tmp_path_factory.mktemp("native"))


def test_both_tasks_give_the_bits_of_the_closed_loop(device, native, drive):
    results = run_tasks_in_emulator(device, native, drive.inputs)
    assert {t: r.steps for t, r in results.items()} == {"sense": TICKS, "control": TICKS // 5}
    for name, r in results.items():
        assert r.task == name
        assert r.identical
        assert r.hash_matches
        assert r.instructions == {}  # this computer counts none
        assert r.step_stack_bytes > 0
        assert r.sequence_gaps == r.bad_frames == r.lost_bytes == 0
        # A second way: what the controller gave in the loop with the plant, in another program.
        assert first_difference(r.outputs, drive.outputs[name]) is None
    # The case is in motion, so that equal bits say something.
    assert np.ptp(results["sense"].outputs["tau_Nm"]) > 1
    assert np.ptp(results["control"].outputs["u_command_Nm"]) > 0.2
    assert not np.any(results["sense"].outputs["fault"][50:])  # held until armed


def test_a_count_more_is_seen_in_the_tick_in_which_each_task_can_know_of_it(device, native, drive):
    late = 403
    counts = drive.inputs["sense"]["count_motor"].copy()
    counts[late] += 1
    changed = {**drive.inputs, "sense": {**drive.inputs["sense"], "count_motor": counts}}
    with RunningBoard(device, native) as board:
        board.reset()
        outputs, _ = board.run_tasks(changed)
    found = {t: first_difference(outputs[t], drive.outputs[t]) for t in outputs}
    assert found["sense"].step == late
    # Control runs at 400, too early to know, and at 405; its command is released a tick later.
    assert found["control"].step == 405 // 5
    first = {
        name: int(np.argmin(outputs[task][name] == drive.outputs[task][name]))
        for task, name in (("sense", "u_Nm"), ("control", "u_command_Nm"))
    }
    assert first == {"u_Nm": 406, "u_command_Nm": 405 // 5}


def test_one_task_of_two_runs_alone(device, native, drive):
    # The command never comes, and the limits say so: the same here and there.
    alone = run_in_emulator(device, native, drive.inputs["sense"])
    assert alone.identical
    assert np.any(alone.outputs["fault"])


def test_a_difference_is_told(device, native, drive, monkeypatch):
    host = emulator.run_schedule

    def other(*arguments):
        found = host(*arguments)
        gain = found["control"]["k_smc_Nm"] = np.float32(found["control"]["k_smc_Nm"])
        gain[7] = np.nextafter(gain[7], np.float32(np.inf))
        return found

    monkeypatch.setattr(emulator, "run_schedule", other)
    results = run_tasks_in_emulator(device, native, drive.inputs)
    assert results["sense"].identical
    assert not results["control"].identical
    difference = results["control"].first_difference
    assert (difference.step, difference.output) == (7, "k_smc_Nm")
    assert int(difference.board, 16) != int(difference.host, 16)
    assert results["control"].to_dict()["first_difference"]["output"] == "k_smc_Nm"


# -- command line ---------------------------------------------------------------------------------


def run_cli(*arguments: str):
    return CliRunner().invoke(app, ["emulate", *arguments])


def test_the_command_runs_both_tasks(native, monkeypatch, tmp_path):
    monkeypatch.setattr("esea_gen.report.findings.build_firmware", lambda *_: native)
    path = tmp_path / "out.json"
    done = run_cli("elbow_drive", "--board", "host", "--seconds", "0.3", "--json", str(path))
    assert done.exit_code == 0, done.output
    content = json.loads(path.read_text())
    assert (content["device"], content["case"]) == ("elbow_drive", "tuning")
    assert {t: r["steps"] for t, r in content["tasks"].items()} == {"sense": 300, "control": 60}
    assert all(r["identical"] for r in content["tasks"].values())
    rows = [line for line in done.output.splitlines() if "the host's" in line]
    assert [("sense" in r, "control" in r) for r in rows] == [(True, False), (False, True)]


def test_the_command_fails_on_a_difference(native, drive, monkeypatch):
    host = emulator.run_schedule
    monkeypatch.setattr("esea_gen.twin.recorded.record_drive", lambda *_: drive)

    def other(*arguments):
        found = host(*arguments)
        found["sense"]["tau_Nm"][3] += 1
        return found

    monkeypatch.setattr("esea_gen.report.findings.build_firmware", lambda *_: native)
    monkeypatch.setattr(emulator, "run_schedule", other)
    done = run_cli("elbow_drive", "--board", "host", "--seconds", "0.05")
    assert done.exit_code == 1
    assert "DIFFER" in done.output
    assert "output='tau_Nm'" in done.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["elbow_drive", "--seconds", "0"], "--seconds 0"),
        (["elbow_drive", "--seconds", "1000"], "Give 1 to 36667 ms"),
        (["elbow_drive", "--recording", "x.toml"], "recorded deflection"),
        (["elbow_drive", "--board", "arduino"], "netduinoplus2"),
        (["elbow", "--seconds", "1"], "--seconds is for a drive"),
    ],
)
def test_what_cannot_be_run_is_refused(arguments, words):
    done = run_cli(*arguments)
    assert isinstance(done.exception, UserError)
    assert words in str(done.exception)


# -- emulated -------------------------------------------------------------------------------------


@pytest.mark.ci
def test_both_tasks_on_the_emulated_board(device, drive, tmp_path):
    require_tool("arm-none-eabi-gcc")
    require_tool("qemu-system-arm")
    image = build_firmware(device, "netduinoplus2", tmp_path)
    assert image.flash_bytes < 110 << 10
    assert image.ram_bytes < 20 << 10
    inputs = {
        "sense": {n: a[:200] for n, a in drive.inputs["sense"].items()},
        "control": {"": np.zeros(40)},
    }
    results = run_tasks_in_emulator(device, image, inputs)
    for name, r in results.items():
        assert r.identical
        assert (
            first_difference(r.outputs, {n: a[: r.steps] for n, a in drive.outputs[name].items()})
            is None
        )
        n = r.instructions
        assert 0 < n["min"] <= n["median"] <= n["max"]
        assert r.step_stack_bytes < r.stack_peak_bytes < r.stack_bytes
    # Counts, not times; sensing with its fourteen Blocks is the larger part by far.
    assert 3000 < results["sense"].instructions["median"] < 11000
    assert 300 < results["control"].instructions["median"] < 2000
