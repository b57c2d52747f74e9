"""The board on its own clock, emulated: ticks, telemetry, tasks that are preempted, the stack."""

from __future__ import annotations

import re
import subprocess

import numpy as np
import pytest

from esea_gen.board.emulator import RunningBoard, first_difference
from esea_gen.board.firmware import build_firmware
from esea_gen.board.stack import CallGraph
from esea_gen.device import load_device
from esea_gen.emit.build import render_device
from esea_gen.emit.roles import board_roles
from esea_gen.errors import UserError
from esea_gen.hostlib import compile_device
from esea_gen.hostlib.library import CBoard, run_schedule
from esea_gen.twin.recorded import record_drive
from tests.conftest import require_tool
from tests.own_device import own_text
from tests.proof.preempt import PreemptionResult, instructions_of, preempt_everywhere, slower_task

pytestmark = pytest.mark.ci

BOARD = "netduinoplus2"
TICKS = 300
NOTHING = np.float32(np.nan), np.uint32(2**32 - 1)  # a number and a whole one, not measured
TABLE_DRIVER = """
#include "cortex_m.h"
static const float table[] = {{ {values} }};
static void sample(float *measured)
{{
    static uint32_t next;
    measured[0] = table[next++ % (sizeof table / sizeof table[0])];
}}
void esea_board_drivers(esea_port_t *port)
{{
    port->sample = sample;
}}
"""


@pytest.fixture(scope="module", autouse=True)
def tools():
    for name in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(name)


@pytest.fixture(scope="module")
def drive_image(drive, tmp_path_factory):
    return build_firmware(drive, BOARD, tmp_path_factory.mktemp("drive"))


def told(board, name: str, count: int) -> list:
    """So many messages of a name, in order."""
    found = [board.wait_for(name) for _ in range(count)]
    assert np.all(np.diff([m.sequence for m in found]) > 0)
    return found


def untold(messages: list, every: int = 1) -> int:
    """Runs between the first and the last that were not told of: on a busy computer the emulated
    line is held up, and the board leaves out what finds no room."""
    at = np.array([m.sequence for m in messages])
    assert not np.any((at - at[0]) % every)
    return int((at[-1] - at[0]) // every + 1 - len(at))


def column(messages, name: str) -> np.ndarray:
    values = [getattr(m, name) for m in messages]
    return np.array(values, np.uint32 if isinstance(values[0], int) else np.float32)


def test_every_tick_of_a_sensor_on_its_own_clock_is_told_and_is_the_hosts(tmp_path):
    """A driver gives a table of angles; every bit of 300 runs in a row."""
    elbow = load_device("elbow")
    theta_rad = (0.2 * np.sin(np.arange(4000) * 0.013)).astype(np.float32)
    theta_rad[1000::997] = np.nan
    text = ", ".join("0.0f / 0.0f" if np.isnan(x) else f"{float(x).hex()}f" for x in theta_rad)
    image = build_firmware(elbow, BOARD, tmp_path, drivers=TABLE_DRIVER.format(values=text))
    with RunningBoard(elbow, image) as board:
        board.tell("ESEA_SENSE_OUT", 1000)
        runs = told(board, "ESEA_SENSE_OUT", TICKS)
        clock = board.clock()
    assert runs[-1].sequence < len(theta_rad)
    # The table's first value was measured at tick 0, when the clock started.
    given = {"theta_rad": theta_rad[: runs[-1].sequence + 1]}
    host, _ = compile_device(elbow, "f32").task("sense").run(given, trace=False)
    outputs = {n: column(runs, n) for n in host}
    at = [m.sequence for m in runs]
    assert first_difference(outputs, {n: a[at] for n, a in host.items()}) is None
    assert np.ptp(outputs["tau_Nm"]) > 1
    assert untold(runs) <= clock.dropped
    assert clock.lost_ticks == clock.late_runs == 0


@pytest.mark.parametrize("name", [BOARD, "mps2-an385"])
def test_both_tasks_of_a_drive_run_by_themselves(drive, drive_image, tmp_path, name):
    """There is no driver: what they make of no measurement at all, at 1 kHz and 200 Hz."""
    image = drive_image if name == BOARD else build_firmware(drive, name, tmp_path)
    with RunningBoard(drive, image) as board:
        assert board.state() == "UNREFERENCED"
        for task in ("SENSE", "CONTROL"):
            for side in ("IN", "OUT"):
                board.tell(f"ESEA_{task}_{side}", 1000)
        sense = told(board, "ESEA_SENSE_OUT", TICKS)
        given = told(board, "ESEA_SENSE_IN", 50)
        control = told(board, "ESEA_CONTROL_OUT", TICKS // 5)
        clock, info = board.clock(), board.info()
    assert untold(sense) + untold(control, 5) <= clock.dropped
    assert clock.lost_ticks == clock.late_runs == clock.missed_runs == 0
    roles = board_roles(drive.system)
    nothing = {x.name: NOTHING[x.port.whole] for x in roles.measured}
    for m in given:
        assert all(np.array_equal(getattr(m, n), x, True) for n, x in nothing.items())
        assert (m.mode, m.stop, m.rearm) == (0, 1, 0)
    # The host's library, given that from tick 0 on, with encoders that have no zero.
    ticks = max(sense[-1].sequence, control[-1].sequence) + 1
    inputs = {n: np.full(ticks, x) for n, x in nothing.items()}
    inputs |= {n: np.full(ticks, float(n == "stop"), np.float32) for n in roles.wanted_names}
    unzeroed = {e.instance: {"zeroed": 0.0} for e in roles.encoders}
    library = compile_device(drive, image.real)
    host = run_schedule(
        CBoard(library.board().library, unzeroed),
        {"sense": inputs, "control": {"": np.zeros((ticks + 4) // 5)}},
    )
    for runs, task in ((sense, "sense"), (control, "control")):
        at = [m.sequence // drive.system.task(task).every for m in runs]
        for output, values in host[task].items():
            wanted = values[at].astype(np.uint32 if values.dtype == np.uint32 else np.float32)
            assert np.array_equal(column(runs, output), wanted), (task, output)
    assert info.stack_peak_bytes <= sum(image.stack_bounds_bytes.values()) <= info.stack_bytes


def test_all_of_a_tasks_values_stream_at_1_kHz_while_parameters_are_read(drive, drive_image):
    with RunningBoard(drive, drive_image) as board:
        sense, control = board.stream(["sense.*", "control.*"])
        assert (sense.rate_Hz, control.rate_Hz) == (1000, 200)
        assert len(board.parameters()) == len(drive.system.tunables)
        assert board.set_parameter("velocity.bandwidth_Hz", 20.0) == 20
        first, second = board.time_sync(), board.time_sync()
        times: dict[str, list[int]] = {sense.task: [], control.task: []}
        while len(times["sense"]) < 500:
            samples = board.samples(board.receive())
            if samples is not None:
                times[samples.names[0].partition(".")[0]] += samples.times
        traffic, clock, info = board.traffic(), board.clock(), board.info()
    for task, every in (("sense", 1), ("control", 5)):
        assert set(np.diff(times[task])) == {every}
    assert traffic.stream_dropped == clock.dropped == clock.lost_ticks == clock.late_runs == 0
    # The emulated clock goes by instructions, not by time: it only goes forward.
    assert second.offset_ns + second.host_ns > first.offset_ns + first.host_ns
    assert info.stack_peak_bytes <= sum(drive_image.stack_bounds_bytes.values())


# -- preempted at an instruction -------------------------------------------------------------------


def functions(device) -> list[str]:
    """Of the slower task: its entry, its Blocks, and what they call."""
    task = slower_task(device)
    blocks = [f"esea_{device.name}_{device.system.blocks[b].name}_step" for b in task.blocks]
    return [f"esea_{device.name}_{task.name}_step", *blocks, "esea_f32_tanh", "exp2_biased"]


def swept(device, image, inputs, step: int, each: int = 1) -> PreemptionResult:
    return preempt_everywhere(
        device, image, inputs, instructions_of(image, functions(device))[::step], each
    )


@pytest.fixture(scope="module")
def given(drive):
    """What its tasks are given for 160 ticks: 16 of every second run of control."""
    return record_drive(drive, 160).inputs


@pytest.fixture(scope="module")
def later(tmp_path_factory):
    path = tmp_path_factory.mktemp("device") / "later.toml"
    path.write_text(own_text(name="elbow_later", timing={"control_release_s": 0.002}))
    return load_device(str(path))


def test_sensing_before_any_instruction_of_control_changes_no_bit(later, tmp_path):
    """Every ninetieth one; outputs of each run, and the whole state where none is under way."""
    image = build_firmware(later, BOARD, tmp_path)
    found = swept(later, image, record_drive(later, 300).inputs, 90)
    assert found.differences == ()
    assert len(found.preemptions) >= 12
    assert len({p.where for p in found.preemptions}) == len(found.preemptions)
    assert not any(p.late for p in found.preemptions)


@pytest.mark.slow
def test_sensing_before_every_instruction_of_control_changes_no_bit(later, tmp_path):
    """Those that are not reached stand behind a branch that the recorded run does not take."""
    image = build_firmware(later, BOARD, tmp_path)
    found = swept(later, image, record_drive(later, 30000).inputs, 1)
    assert found.differences == ()
    assert not any(p.late for p in found.preemptions)
    assert len(found.preemptions) > 0.6 * found.instructions


def test_a_tick_among_the_marks_of_a_runs_end(drive, drive_image, given):
    """Its last instructions: until the last mark is set the run is late, and counts as late."""
    last = instructions_of(drive_image, functions(drive)[:1])[-14:]
    found = preempt_everywhere(drive, drive_image, given, last, each=2)
    assert len(found.preemptions) >= 12
    assert {p.late for p in found.preemptions} == {True, False}
    assert found.differences == ()


def test_values_that_are_not_latched_are_found(later, tmp_path, monkeypatch):
    """Armed: control reads what sensing releases meanwhile, in place of what it took hold of."""
    files = dict(render_device(later, ["f32"])[0].files)
    name = "esea_elbow_later.c"
    body = files[name]
    at = body.index("void esea_elbow_later_control_step(")
    files[name] = body[:at] + body[at:].replace("state->control_held.", "state->latched.")
    image = build_firmware(later, BOARD, tmp_path, files)
    entries = instructions_of(image, functions(later)[:1])
    found = preempt_everywhere(
        later, image, record_drive(later, 200).inputs, [entries[len(entries) // 4]] * 20
    )
    assert len(found.preemptions) >= 10
    assert found.differences != ()


# -- the stack -------------------------------------------------------------------------------------


def test_the_stack_is_bounded_by_the_sum_of_what_each_priority_may_need(drive_image):
    bounds = drive_image.stack_bounds_bytes
    assert set(bounds) == {"main", "slower", "tick", "receive"}
    assert sum(bounds.values()) < drive_image.stack_bytes
    # Each holds the deepest step that runs there.
    assert bounds["tick"] > drive_image.step_stack_bytes["sense"] + 104
    assert bounds["slower"] > drive_image.step_stack_bytes["control"] + 104


def test_a_stack_of_unknown_size_is_refused(tmp_path):
    (tmp_path / "a.c").write_text("void sink(char *); void top(int n) { char b[n]; sink(b); }")
    command = ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-O1", "-fcallgraph-info=su", "-c", "a.c"]
    subprocess.run(command, cwd=tmp_path, check=True)
    with pytest.raises(ValueError, match="top uses a stack of unknown size"):
        CallGraph.read([tmp_path / "a.ci"])


def test_an_image_whose_stack_may_not_do_is_refused(drive, tmp_path):
    files = dict(render_device(drive, ["f32"])[0].files)
    body = r"(void esea_elbow_drive_control_step\([^{]*\{)"
    big = r"\1 volatile char big[6000]; big[0] = 1; big[5999] = big[0];"
    files["esea_elbow_drive.c"] = re.sub(body, big, files["esea_elbow_drive.c"], count=1)
    with pytest.raises(UserError, match="the stack may need"):
        build_firmware(drive, BOARD, tmp_path, files)
