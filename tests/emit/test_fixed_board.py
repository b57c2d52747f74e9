"""q31 on emulated boards without an FPU: the host's bits, and its cost against f32."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from esea_gen.board.bare import run_bare
from esea_gen.cli import app
from esea_gen.verify.streams import domain_chirp
from tests.conftest import require_tool


@pytest.fixture(scope="module")
def inputs(elbow):
    for tool in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(tool)
    theta = domain_chirp(elbow, 2.0)[::8][:150].copy()
    theta[20] = 5.0  # an invalid sample on the way
    (task,) = elbow.system.tasks
    (source,) = elbow.system.task_inputs(task)
    return {task.name: {source.name: theta}}


@pytest.mark.ci
@pytest.mark.parametrize("board", ["m3", "m0"])
def test_bit_for_bit_the_host_and_cheaper_than_soft_float(elbow, inputs, board):
    fixed = run_bare(elbow, "q31", board, inputs)
    assert fixed.identical, fixed.first_difference
    soft = run_bare(elbow, "f32", board, inputs)
    assert soft.identical, soft.first_difference
    # Measured: 5.5 times on the M3, 3.2 times on the M0, which has no 64-bit product.
    assert soft.instructions["mean"] > (5.0 if board == "m3" else 3.0) * fixed.instructions["mean"]
    assert fixed.flash_bytes < 16 * 1024
    assert fixed.ram_bytes < 200
    assert fixed.stack_bytes < 600


@pytest.mark.ci
def test_the_command_compares_bits_signals_and_says_what_fails(tmp_path, monkeypatch):
    require_tool("gcc")
    from esea_gen.verify import fixed_report

    monkeypatch.setattr(fixed_report, "published_motions", lambda device: iter(()))
    content = tmp_path / "fixed.json"
    done = CliRunner().invoke(app, ["fixed", "elbow", "--json", str(content)])
    assert done.exit_code == 0, done.output
    said = json.loads(content.read_text())
    assert said["passed"]
    assert {b["block"] for b in said["blocks"]} == {"velocity", "smoothing", "sensor"}
    for b in said["blocks"]:
        assert 0 < b["measured"] <= b["proven"] < 5e-5
        assert b["proven_for"] == "all time"
    (signal,) = said["signals"]
    assert signal["steps"] == 60000
    assert 0 < signal["share"] < said["aim_share"]
    # It can fail: an aim that rounding cannot meet.
    monkeypatch.setattr(fixed_report, "AIM_SHARE", 1e-9)
    assert CliRunner().invoke(app, ["fixed", "elbow"]).exit_code == 1
