"""Benchmarks compare programs that give the same answers.  No figure of time is asserted."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.targets import boards_for
from tests.benchmarks.peers import CASADI, CompiledPeer, EvaluatorPeer, NumpyPeer, peer_programs
from tests.benchmarks.steps import AIMS, board_rows, drive_subjects, host_rows, subjects
from tests.benchmarks.twin import PYTHON, twin_rows
from tests.benchmarks.whole_tick import AIM, latency, whole_tick
from tests.conftest import require_tool

STEPS = 40


@pytest.mark.ci
@pytest.mark.parametrize("name", ["elbow", "knee"])
def test_every_peer_gives_the_same_answer(name):
    require_tool("gcc")
    device = load_device(name)
    _, block, system, stream = next(subjects(device, 300))
    expected, _ = block.simulator().run(stream.inputs)
    wanted = np.column_stack([expected[p.name] for p in block.outputs])
    programs = peer_programs(device, block, stream, system)
    peers = {k: CompiledPeer(k, files, block, stream) for k, files in programs.items()}
    peers["evaluator"] = EvaluatorPeer(block, stream)
    if name == "elbow":
        peers["numpy"] = NumpyPeer(device, stream)
    for key, peer in peers.items():
        assert peer.run(2) > 0
        got = peer.results()
        error = np.abs(got - wanted[:, : got.shape[1]]).max() / device.tau_full_scale_Nm
        assert error < (1e-5 if "f32" in key or "float" in key else 1e-12), key
    assert peers[CASADI].results().tobytes() == peers["generated f64"].results().tobytes()


@pytest.mark.ci
def test_steps_on_boards_are_counted_and_compute_the_hosts_bits(elbow):
    for tool in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(tool)
    for subject in subjects(elbow, STEPS):
        if subject[0] in AIMS:
            rows = board_rows(elbow, subject, lambda _: None)
            assert len(rows) == len(boards_for("instructions"))
            # Counts, not times; the code is the same on all three, the instruction sets are not.
            assert all(AIMS[subject[0]] / 4 < r["ours"] < AIMS[subject[0]] for r in rows)


@pytest.mark.ci
def test_a_block_of_a_drive_runs_on_what_it_is_given_in_closed_loop(drive):
    for tool in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(tool)
    made = {s[0]: s for s in drive_subjects(drive, STEPS)}
    assert len(made) == len(drive.system.blocks)
    subject = made["elbow_drive reference"]
    assert all(50 < r["ours"] < 1000 for r in board_rows(drive, subject, lambda _: None))
    assert [r["unit"] for r in host_rows(drive, subject, 1, every_peer=False)] == ["ns"]


@pytest.mark.ci
def test_the_plant_in_python_has_the_torque_of_the_generated_one(drive):
    """Integrated in two ways that share no code."""
    require_tool("gcc")
    tight, *_, fixed = PYTHON
    peers = {k: PYTHON[k] for k in (tight, fixed)}
    rows = twin_rows(drive, 1, lambda _: None, fast_ms=400, slow_ms=260, peers=peers)
    found = {r["name"].removeprefix("torque error of the twin's plant, "): r for r in rows}
    rms = found[f"RMS vs {tight}"]
    assert rms["ours"] < 2e-4
    assert rms["peer"] < 1e-5
    assert found[f"largest vs {fixed}"]["peer"] < 3e-3


def test_a_reading_reaches_the_motor_within_a_period_of_control_and_a_release(drive):
    """By the latches: seen by control a tick later at the earliest, its command a tick after it."""
    require_tool("gcc")
    through_control, limits = latency(drive)
    control = drive.system.tasks[-1]
    assert sorted(through_control) == list(range(2, 2 + control.every))
    # From one phase to the next the wait for the next run is one tick shorter.
    for now, then in pairwise(through_control):
        assert then == (now - 1 if now > 2 else 1 + control.every)
    assert limits == 3  # bad frames are bridged; the tick in which they are not


@pytest.mark.slow
def test_the_whole_tick_on_the_cortex_m4f_is_within_its_aim(drive):
    for tool in ("qemu-system-arm", "arm-none-eabi-gcc"):
        require_tool(tool)
    found = whole_tick(drive, runs=1)
    assert 5000 < found.tick[1] < 20000
    assert 1000 < found.control[1] < 4000
    assert found.share < AIM
    assert found.stack_bound_bytes < found.stack_bytes
