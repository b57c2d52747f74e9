"""The benchmarks compare programs that give the same answers.  No figure of time is asserted."""

from __future__ import annotations

import dataclasses
import json
import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.device import load_device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.twin.parameters import plant_tunables
from esea_gen.twin.recorded import record_drive
from esea_gen.twin.run import plant_variant
from tests.benchmarks import sensor as bench
from tests.benchmarks import steps as bench_steps
from tests.benchmarks import twin
from tests.benchmarks.boards import BOARDS, Count, checksum, count_step
from tests.benchmarks.peers import (
    CompiledPeer,
    EvaluatorPeer,
    NumpyPeer,
    count_board_instructions,
    peer_sources,
)
from tests.benchmarks.recorded import block_streams, task_rows
from tests.benchmarks.row import Row
from tests.benchmarks.sensor import benchmark_stream, instruction_rows, main, step_rows, table
from tests.benchmarks.steps import (
    AIMS,
    BLOCKS,
    alone,
    drive_load,
    drive_subjects,
    step_cost_rows,
    step_table,
    subjects,
    task_cost_rows,
    task_sources,
)
from tests.benchmarks.twin import torque_errors, twin_rows, twin_table
from tests.benchmarks.twin_peers import PlantEquations

from .conftest import require_tool
from .test_plant import slopes, torque_of

pytestmark = pytest.mark.ci

STEPS = 300
KEYS = ["name", "ours", "peer", "ratio", "unit"]


@pytest.mark.parametrize("name", ["elbow", "knee"])
def test_every_peer_gives_the_same_answer(name):
    require_tool("gcc")
    device = load_device(name)
    block = device.sensor
    stream = benchmark_stream(device, block, STEPS)
    expected, _ = block.simulator().run(stream.inputs)
    wanted = np.column_stack([expected[p.name] for p in block.outputs])
    scale = device.tau_full_scale_Nm
    sources = peer_sources(device, block, stream)
    peers = [CompiledPeer(s, block, stream) for k, s in sources.items() if "floor" not in k]
    peers += [EvaluatorPeer(block, stream, whole) for whole in (True, False)]
    if NumpyPeer.fits(device):
        peers.append(NumpyPeer(device, stream))
    assert name != "elbow" or isinstance(peers[-1], NumpyPeer)
    for peer in peers:
        assert peer.run(2) > 0
        got = peer.results()
        single = "f32" in peer.name or "float" in peer.name
        columns = got.shape[1]
        assert columns in (1, wanted.shape[1])
        error = np.abs(got - wanted[:, :columns]).max() / scale
        assert error < (1e-5 if single else 1e-12), peer.name
    first = CompiledPeer(sources["casadi f64"], block, stream)
    first.run(1)
    ours = CompiledPeer(sources["f64"], block, stream)
    ours.run(1)
    assert first.results().tobytes() == ours.results().tobytes()


def test_the_rows(elbow):
    require_tool("gcc")
    rows = step_rows(elbow, elbow.sensor, 1, lambda _: None, steps=STEPS)
    names = [r.name for r in rows]
    assert len(set(names)) == len(names)
    for real in ("f64", "f32"):
        for peer in ("CasADi C (f64)", "CasADi evaluator", "NumPy loop", "moving inputs"):
            assert any(n.startswith(f"sensor step {real} vs {peer}") for n in names)
    for r in rows:
        assert r.unit == "ns"
        assert min(r.ours, r.peer, r.ratio) > 0
        assert list(r.to_dict()) == KEYS
    assert len(table(rows).splitlines()) == 1 + len(rows)


def test_instructions_on_an_emulated_board(elbow, monkeypatch):
    require_tool("arm-none-eabi-gcc")
    require_tool("qemu-system-arm")
    monkeypatch.setattr(shutil, "which", _without("valgrind", shutil.which))
    said: list[str] = []
    rows = instruction_rows(elbow, elbow.sensor, said.append, steps=60)
    assert any("left out" in s and "valgrind" in s for s in said)
    found = {r.name: r for r in rows}
    row = found["sensor step f32 vs CasADi C (f64), Cortex-M4F, emulated"]
    assert row.unit == "instructions"
    # Counts, not times: double arithmetic is software there.
    assert 200 < row.ours < 1500
    assert row.ratio > 10


def test_instructions_on_this_machine(elbow, monkeypatch):
    require_tool("gcc")
    require_tool("valgrind")
    monkeypatch.setattr(shutil, "which", _without("arm-none-eabi-gcc", shutil.which))
    rows = instruction_rows(elbow, elbow.sensor, lambda _: None, steps=60)
    row = next(r for r in rows if r.name == "sensor step f32 vs CasADi C (f64), this machine")
    assert row.ratio > 1


@pytest.fixture(scope="module")
def aimed(elbow):
    """The Blocks whose count has an aim, with 40 steps each."""
    return [s for s in subjects(elbow, 40) if s.name in AIMS]


@pytest.mark.parametrize("board", BOARDS, ids=lambda b: b.processor.name)
def test_steps_on_boards_are_counted_and_compute_the_hosts_bits(elbow, aimed, board):
    for tool in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(tool)
    steps = 40
    assert {s.name for s in aimed} == set(AIMS)
    for subject in aimed:
        block, system = subject.block, subject.system
        sources = peer_sources(elbow, block, subject.stream, system)["f32"]
        here = CompiledPeer(sources, block, subject.stream)
        here.run(1)
        renderer = Renderer(system, FORMATS["f32"], "-", "-", "")
        step = f"esea_{system.name}_{block.name}_step"
        found = count_step(board, sources, renderer, step, steps)
        assert found.checksum == checksum(here.results())
        assert found.least <= found.mean <= found.most
        # Counts, not times; the code is the same on all three, the instruction sets are not.
        assert AIMS[subject.name] / 4 < found.mean < AIMS[subject.name]
        if board.processor.name == "cortex-m4f" and subject.name == "sensor":
            # A second way: the timer, which also counts the loop round the step.
            extra = {n: renderer.render(f"bench/{n}.j2") for n in ("bare.c", "bare.ld")}
            timed = count_board_instructions(sources, extra, steps)
            assert 3 < timed - found.mean < 15


def test_a_changed_result_changes_the_checksum():
    values = np.arange(12.0).reshape(4, 3)
    assert checksum(np.zeros((0, 3))) == 2166136261
    assert checksum(np.zeros(1)) == _fnv(bytes(8))
    other = values.copy()
    other[2, 1] = np.nextafter(other[2, 1], 9)
    assert checksum(values) != checksum(other)


def _fnv(data: bytes) -> int:
    total = 0x811C9DC5
    for byte in data:
        total = (total ^ byte) * 0x01000193 % 2**32
    return total


def test_every_inverse_is_a_subject(elbow):
    found = {s.name: s for s in subjects(elbow, 30)}
    names = ["no observer"] + [f"filter {n}" for n in ("a", "a_normalised", "b", "b_normalised")]
    assert list(found)[:3] == ["sensor", "velocity", "inverse exact"]
    assert {f"inverse published, {n}" for n in [*names, "filter b_rounding"]} < set(found)
    for s in found.values():
        assert s.stream.steps == 30
        assert s.block in s.system.kinds


def test_costs_without_an_emulator_are_times_alone(elbow, monkeypatch):
    require_tool("gcc")
    monkeypatch.setattr(shutil, "which", _without("qemu-system-arm", shutil.which))
    few = [s for s in subjects(elbow, 30) if s.name in ("sensor", "velocity")]
    monkeypatch.setattr("tests.benchmarks.steps.subjects", lambda *_: few)
    said: list[str] = []
    rows = step_cost_rows(elbow, 1, said.append, 30, 30)
    assert [r.unit for r in rows] == ["ns", "ns"]
    assert sum("left out" in s for s in said) == len(BOARDS)
    assert step_table(rows)[2].startswith("sensor")


def test_aims_are_judged_by_the_rows():
    def rows(sensor: float, inverse: float) -> list[Row]:
        return [
            Row.exact(f"{n}, one f32 step on Cortex-M4F vs CasADi C (f64)", x, 9e4, "instructions")
            for n, x in (("sensor", sensor), ("inverse exact", inverse))
        ]

    assert [line[-4:] for line in step_table(rows(900, 2500))[-2:]] == [" met"] * 2
    lines = step_table(rows(901, 2501))
    assert all(line.endswith("MISSED") for line in lines[-2:])
    assert step_table([Row.exact("other", 1.0, 2.0, "ns")]) == []


def _without(name, which):
    return lambda command: None if command == name else which(command)


def test_main_writes_the_list(tmp_path, monkeypatch, capsys):
    rows = [
        Row("sensor step f32 vs CasADi C (f64)", 40.0, 90.0, 2.25, "ns", 2.2, 2.3),
        Row.exact("counted", 5.0, 10.0, "instructions"),
    ]
    monkeypatch.setattr(bench, "run_benchmarks", lambda *_: rows)
    path = tmp_path / "bench.json"
    assert main(["--json", str(path)]) == 0
    content = json.loads(path.read_text())["rows"]
    assert content[1] == {
        "name": "counted",
        "ours": 5.0,
        "peer": 10.0,
        "ratio": 2.0,
        "unit": "instructions",
    }
    said = capsys.readouterr().out
    assert "2.20 to 2.30  ns" in said
    assert "2.25, met" in said


def test_main_refuses_what_cannot_be(tmp_path, capsys):
    assert main(["elbo", "--json", str(tmp_path / "b.json")]) == 2
    assert "Did you mean elbow?" in capsys.readouterr().err


# -- a drive's tasks and Blocks -------------------------------------------------------------------

RUNS = 24


@pytest.fixture(scope="module")
def elbow_drive(drive):
    return drive


@pytest.fixture(scope="module")
def recorded(elbow_drive):
    require_tool("gcc")
    return record_drive(elbow_drive, 5 * RUNS)


def test_a_recording_has_every_input_of_every_task_at_its_runs(elbow_drive, recorded):
    for task in elbow_drive.system.tasks:
        names = [x.name for x in elbow_drive.system.task_inputs(task)] or [""]
        assert list(recorded.inputs[task.name]) == names
        assert {len(a) for a in recorded.inputs[task.name].values()} == {5 * RUNS // task.every}
    sense = recorded.inputs["sense"]
    assert np.array_equal(sense["count_motor"], recorded.run.plant["count_motor"])
    assert sense["mode"][0] == 0
    assert sense["mode"][-1] == 1
    # Some of it moves: the wanted torque is 1.7 Nm sin(2 pi 0.6 t).
    t = 1e-3 * np.arange(5 * RUNS)
    assert sense["tau_desired_Nm"] == pytest.approx(1.7 * np.sin(2 * np.pi * 0.6 * t), abs=1e-6)


def test_streams_of_blocks_are_what_stands_on_their_wires(elbow_drive, recorded):
    found = block_streams(elbow_drive, recorded, RUNS)
    assert set(found) == set(elbow_drive.system.blocks)
    assert {s.steps for s in found.values()} == {RUNS}
    for side in ("motor", "load"):
        given = recorded.inputs["sense"][f"count_{side}"][:RUNS]
        assert np.array_equal(found[f"encoder_{side}"].inputs["count"], given)
    # Latched: control sees a millisecond ago, at its own period.
    measured = recorded.run.controller["theta_rad"][4 : 5 * RUNS - 1 : 5]
    assert found["smc"].inputs["theta_rad"][1:] == pytest.approx(measured, abs=1e-6)
    # And its beat comes a millisecond after the run.
    assert found["limits"].inputs["control_beat"][:8].tolist() == [0, 1, 1, 1, 1, 1, 2, 2]


def test_rows_of_tasks_replay_the_closed_loop(elbow_drive, recorded):
    rows = task_rows(elbow_drive, recorded, {"sense": RUNS, "control": 4})
    system = elbow_drive.system
    for name, runs in (("sense", RUNS), ("control", 4)):
        task = system.task(name)
        latches = sum(x.port.size for x in system.latches_read(task))
        assert rows[name].shape == (runs, len(system.task_inputs(task)) + latches)
    altered = {n: a.copy() for n, a in recorded.outputs["control"].items()}
    altered["surface_rad_s"][2] = 1.0
    other = dataclasses.replace(recorded, outputs=recorded.outputs | {"control": altered})
    with pytest.raises(RuntimeError, match="surface_rad_s of task control"):
        task_rows(elbow_drive, other, {"sense": RUNS, "control": 4})
    with pytest.raises(ValueError, match="fewer than"):
        task_rows(elbow_drive, recorded, {"control": RUNS + 1})


def test_a_block_alone_is_the_c_that_ships(elbow_drive):
    def text(system, name):
        files = Renderer(system, FORMATS["f32"], "-", "-", elbow_drive.title).files()
        return files[f"esea_elbow_drive_{name}.c"]

    for name in ("smc", "reference"):
        block = elbow_drive.system.blocks[name]
        shipped = text(elbow_drive.system, block.name)
        assert text(alone(elbow_drive, block), block.name) == shipped


def test_a_task_is_counted_and_computes_the_closed_loops_bits(elbow_drive, recorded, monkeypatch):
    for tool in ("arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(tool)
    runs, task = RUNS // 2, elbow_drive.system.task("control")
    rows = task_rows(elbow_drive, recorded, {"control": runs})["control"]
    renderer = Renderer(elbow_drive.system, FORMATS["f32"], "-", "-", "")
    found = count_step(
        BOARDS[0],
        task_sources(elbow_drive, task, rows),
        renderer,
        "esea_elbow_drive_control_step",
        runs,
    )
    given = recorded.outputs["control"]
    wanted = np.column_stack(
        [given[x.name][:runs] for x in elbow_drive.system.task_outputs(task)]
    ).astype(float)
    assert found.checksum == checksum(wanted)
    assert 300 < found.least <= found.mean <= found.most < 1800

    # The same through the rows, the counting itself replaced.
    blocks = [
        Row.exact(bench_steps._row_name(f"elbow_drive {i}", "Cortex-M4F"), 100.0, 1.0, "-")
        for t in elbow_drive.system.tasks
        for i in t.blocks
    ]
    sums = {"sense": 20, "control": 4}
    seen = iter(
        checksum(
            np.column_stack(
                [
                    recorded.outputs[t.name][x.name][:runs]
                    for x in elbow_drive.system.task_outputs(t)
                ]
            ).astype(float)
        )
        for t in elbow_drive.system.tasks
    )
    monkeypatch.setattr(bench_steps, "count_step", lambda *_: Count(500.0, 1, 2, next(seen)))
    made = task_cost_rows(elbow_drive, recorded, blocks, lambda _: None, runs)
    assert {r.name: r.peer for r in made} == {
        f"elbow_drive task {t}, one f32 step on Cortex-M4F vs {BLOCKS}": 100.0 * n
        for t, n in sums.items()
    }
    monkeypatch.setattr(bench_steps, "count_step", lambda *_: Count(500.0, 1, 2, 0))
    with pytest.raises(RuntimeError, match="other bits"):
        task_cost_rows(elbow_drive, recorded, blocks, lambda _: None, runs)


def test_a_block_of_the_drive_is_counted(elbow_drive, recorded):
    for tool in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(tool)
    made = {s.name: s for s in drive_subjects(elbow_drive, recorded, RUNS)}
    assert len(made) == len(elbow_drive.system.blocks)
    subject = made["elbow_drive reference"]
    sources = peer_sources(elbow_drive, subject.block, subject.stream, subject.system)["f32"]
    here = CompiledPeer(sources, subject.block, subject.stream)
    here.run(1)
    renderer = Renderer(subject.system, FORMATS["f32"], "-", "-", "")
    step = "esea_elbow_drive_reference_step"
    found = count_step(BOARDS[0], sources, renderer, step, RUNS)
    assert found.checksum == checksum(here.results())
    assert 50 < found.mean < 1000


def test_what_the_counts_allow(elbow_drive):
    rows = [
        Row.exact(f"elbow_drive task {t}, one f32 step on Cortex-M4F vs {BLOCKS}", n, 1.0, "-")
        for t, n in (("sense", 6000.0), ("control", 700.0))
    ]
    lines = drive_load(elbow_drive, rows)
    # 6000 * 1000 + 700 * 200 = 6.14e6 a second; of 168e6 that is 3.65 %.
    assert "6.14 million" in lines[0]
    assert "assumed, not measured" in lines[0]
    assert "3.7 %" in lines[1]
    assert "27 times" in lines[1]
    assert "7.3 %" in lines[2]
    assert drive_load(elbow_drive, rows[:1]) == []


# -- the twin -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def in_python(elbow_drive):
    """The plant in Python, and its numbers."""
    plant = plant_variant(elbow_drive, "real", "none", 3)
    defaults = {t.name: t.default for t in plant_tunables(elbow_drive, True)}
    return PlantEquations(elbow_drive, plant, defaults), defaults | plant.values


@settings(max_examples=40)
@given(
    st.lists(st.floats(-0.3, 0.3), min_size=6, max_size=6),
    st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3),
    st.floats(-0.22, 0.22),
)
def test_the_plant_in_python_has_the_slopes_of_the_plants_own_tests(in_python, numbers, path, u_Nm):
    """Those are typed from the thesis, with its numbers."""
    model, p = in_python
    y, (_, memory), held = np.array(numbers), model.rest(), np.zeros(10)
    for x in path:
        state = [0.0, 0.0, x, 0.0, 0.0, 0.0]
        radii = 0.0197 * np.arange(1, 11)
        held = np.clip(held + x - memory[0], -radii, radii)
        memory = model.turned(state, memory)
    xg, vg, xm, vm, u_a, tau_r = y
    theirs = [xg, vg, xm, vm, 0.0, 0.0, u_a, tau_r]
    turn = (path[-1], held)

    def rest(_):
        return 0.0, 0.0, 0.0

    want = slopes(0.0, theirs, u_Nm, turn, p, rest)
    got = model.slopes(0.0, y, u_Nm, memory)
    assert model.torque_Nm(y, memory) == pytest.approx(torque_of(theirs, turn), abs=1e-9)
    assert got == pytest.approx([want[i] for i in (0, 1, 2, 3, 6, 7)], rel=1e-9, abs=1e-9)


def test_the_coupling_stop_pushes_and_never_pulls(in_python):
    model, p = in_python
    _, memory = model.rest()
    stop, stiff = p["coupling_stop_rad"], p["coupling_stop_Nm_rad"]

    def torque(x, v):
        return model.torque_Nm([0.0, 0.0, x, v, 0.0, 0.0], memory)

    assert torque(stop + 0.01, 0.0) - torque(stop, 0.0) == pytest.approx(0.01 * stiff, rel=0.2)
    assert torque(stop + 1e-4, -100.0) == pytest.approx(torque(stop, 0.0), abs=0.1)
    assert torque(-stop - 0.01, 0.0) == pytest.approx(-torque(stop + 0.01, 0.0))


def test_the_twins_rows(elbow_drive, monkeypatch):
    require_tool("gcc")
    every = twin.python_peers
    monkeypatch.setattr(twin, "python_peers", lambda *a: [every(*a)[0], every(*a)[-1]])
    rows = twin_rows(elbow_drive, 1, lambda _: None, fast_ms=400, slow_ms=260)
    found = {r.name: r for r in rows}
    assert len(found) == len(rows)
    for r in rows:
        assert r.unit in ("ns", "Nm")
        assert min(r.ours, r.peer, r.ratio) > 0
    tight = found["torque error of the twin's plant, RMS vs solve_ivp, LSODA, 1e-8"]
    # Integrated in two ways that share no code, the torque is the same.
    assert tight.ours < 2e-4
    assert tight.peer < 1e-5
    fixed = found["torque error of the twin's plant, largest vs Python loop, RK4 at 0.2 ms"]
    assert fixed.peer < 3e-3
    assert any(line.startswith("plant alone in C") for line in twin_table(rows))


def test_the_goal_is_judged_by_the_rows():
    def rows(times: float) -> list[Row]:
        own = 1e6 / times
        return [
            Row.exact("twin, closed loop vs real time", own, 1e6, "ns"),
            Row.exact("twin, plant vs real time", own / 2, 1e6, "ns"),
        ]

    assert twin_table(rows(201.0))[-1].endswith(" met")
    assert twin_table(rows(199.0))[-1].endswith(" MISSED")
    assert twin_table([]) == []


def test_errors_of_torque():
    truth = np.zeros(4)
    assert torque_errors(np.array([3.0, -4.0, 0.0]), truth) == (pytest.approx(5 / 3**0.5), 4.0)
