"""The benchmarks compare programs that give the same answers.  No figure of time is asserted."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from esea_gen.bench import bench
from esea_gen.bench.bench import Row, benchmark_stream, instruction_rows, main, step_rows, table
from esea_gen.bench.peers import CompiledPeer, EvaluatorPeer, NumpyPeer, peer_sources
from esea_gen.device import load_device

from .conftest import require_tool

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
    content = json.loads(path.read_text())
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
