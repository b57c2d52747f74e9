"""Predictive control on the board and in closed loop: bound, warnings, standard experiments."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.board.bound import BoundError, blocks_of, disassemble
from esea_gen.hostlib.library import HostLibrary
from esea_gen.studies.registry import load_study
from esea_gen.studies.simulation import ClosedLoopStudy
from esea_gen.twin.case import Setting
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.judge import judge
from esea_gen.twin.run import run_case
from tests.benchmarks import predictive
from tests.benchmarks.predictive_loop import recorded_rows
from tests.box_qp_program import box_qp
from tests.conftest import require_tool
from tests.rendered_program import render_program

pytestmark = pytest.mark.ci


@pytest.fixture(scope="module")
def program():
    # The one that "simulate --controller mpc" runs: preview, impedance in one layer.
    return controller_device("mpc").system.blocks["predictive"]


def rms(experiment: str, controller: str, case: int = 0, seed: int = 1) -> float:
    found = load_study(experiment, ClosedLoopStudy).cases()[case]
    figures = judge(found, run_case(found, Setting(controller, "real", "uncertain"), seed), 0.221)
    assert not figures["unstable"]
    assert not figures["fault"]
    return figures["rms_true_Nm"]


def test_the_bound_holds_and_meets_its_aim(program):
    require_tool("arm-none-eabi-gcc")
    require_tool("qemu-system-arm")
    cost = predictive.cost_on(program, "Cortex-M4F")
    assert cost.bound.instructions <= predictive.AIM_BOUND
    rows = predictive.stress_rows(program, 150)
    seen, command = predictive.seen_on_m4f(program, rows)
    assert 0.3 * cost.bound.instructions < seen.max() <= cost.bound.instructions
    # The board's bits are the host's.
    renderer = render_program(program, "f32")
    runner = HostLibrary(renderer.system, renderer).block("predictive")
    stream, at = {}, 0
    for p in program.inputs:
        block = rows[:, at : at + p.size].astype(np.float32).astype(float)
        stream[p.name] = block[:, 0] if p.size == 1 else block
        at += p.size
    y, _ = runner.run(stream, trace=False)
    assert np.array_equal(y["u_Nm"], command)
    assert cost.state_bytes < 4096


def test_a_typical_step_meets_its_aim(program):
    require_tool("arm-none-eabi-gcc")
    require_tool("qemu-system-arm")
    seen = []
    for experiment in ("tuning", "backdriven", "bread"):
        case = load_study(experiment, ClosedLoopStudy).cases()[0]
        free = {"load_free": 0.0 if case.trajectory.clamped else 1.0}
        seen.append(predictive.seen_on_m4f(program, recorded_rows("mpc", case, 60), free)[0])
    assert np.median(seen) <= predictive.AIM_TYPICAL


@pytest.mark.parametrize("core", list(predictive.CORES))
def test_the_bound_of_a_box_qp_on_every_core(core):
    require_tool("arm-none-eabi-gcc")
    # Above 16 variables loops stay loops; one size of these is enough.
    sizes = (2, 5, 17) if core == "Cortex-M4F" else (2, 5)
    costs = [predictive.cost_on(box_qp(n), core).bound.instructions for n in sizes]
    assert costs == sorted(costs)
    # Straight parts alone: a cap of 0 takes one pass through the search, not a third of one.
    assert predictive.cost_on(box_qp(5, cap=0), core).bound.instructions < 0.5 * costs[1]


def test_what_cannot_be_bounded_is_an_error(tmp_path):
    require_tool("arm-none-eabi-gcc")
    renderer = render_program(box_qp(3), "f32")
    functions = disassemble(
        predictive.build_program(renderer, tmp_path, "Cortex-M4F", predictive.entry_files(renderer))
    )
    name = "esea_box_qp_alone_box_qp_step"
    assert blocks_of(name, functions)
    i = functions[name][1]
    jump = type(i)(i.address, "bx", "r3", i.file, i.line)
    with pytest.raises(BoundError, match="register"):
        blocks_of(name, functions | {name: [functions[name][0], jump]})


def test_the_standard_experiments(drive):
    # Real plant, uncertain person; medians over ten seeds are in docs/laws-compared.md.
    assert rms("tuning", "mpc") < 0.06
    assert rms("backdriven", "mpc", case=3) < 0.07
