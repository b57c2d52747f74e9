"""Fixed point beyond the sensor: every Block of torque control, the whole System, long signals."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

import esea_gen
from esea_gen.board import bare
from esea_gen.board.bare import emulate, run_bare
from esea_gen.cli import app
from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed.errors import any_bound, block_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.fixed.plan import Planner
from esea_gen.emit.fixed.report import range_report
from esea_gen.emit.fixed.values import LoweringError
from esea_gen.emit.spans import RangeError
from esea_gen.hostlib import compile_device
from esea_gen.hostlib.library import CBoard, run_schedule
from esea_gen.identify import recorded_deflections
from esea_gen.language.ports import clip
from esea_gen.language.system import System, Task
from esea_gen.model.sensing import zeros_missing
from esea_gen.studies.tracking import TuningCase
from esea_gen.twin.case import Setting
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.recorded import record_drive
from esea_gen.twin.run import run_case
from esea_gen.verify.fixed import bounds_of, compare_fixed, single_steps, states_before
from esea_gen.verify.fixed_report import AIM_SHARE, compare_signal, published_motions
from esea_gen.verify.runs import run_c
from esea_gen.verify.streams import domain_chirp, streams
from esea_gen.verify.traces import trace_stream
from tests.benchmarks.fixed import PROGRAMS, run_filter
from tests.conftest import ROOT, require_tool
from tests.made_up import made, port

pytestmark = pytest.mark.ci

HDRB = ROOT / "tests" / "data" / "hdrb" / "hdrb.toml"
# Rate limits and integrals keep what rounding adds; sums of counts are exact in every format;
# the set-point's error is one step's by nature.
FORGETFUL = {
    *("limits", "sliding_mode", "inverse", "reference", "set_trend"),
    *("passivity", "adaptation", "encoder_monitor", "encoder_monitor_gear", "interpolation"),
}


@pytest.fixture(scope="module")
def drive():
    require_tool("gcc")
    # The very device of the closed loop: its plan is then searched for once.
    return controller_device("smc")


@pytest.fixture(scope="module")
def library(drive):
    return compile_device(drive, "q31")


@pytest.fixture(scope="module")
def bounds(drive):
    return bounds_of(drive)


def test_every_block_of_torque_control_bit_for_bit_and_inside_its_bound(drive, library, bounds):
    turned = {}
    for block in drive.system.kinds:
        plan, runner = plan_block(block), library.block(block.name)
        for stream in streams(block, steps=300):
            found = compare_fixed(drive, plan, runner, stream, bounds[block.name])
            assert found.passed, f"{block.name}, {stream.name}: {found.problems}"
            turned[block.name] = turned.get(block.name, 0) + found.turned
    # Rounding turns a decision only where a value stands at its threshold to the last bit.
    assert sum(turned.values()) <= 4


def test_four_products_of_16_bits_give_the_same_bits(drive, library):
    """The C as compiled for a Cortex-M0, here on the host."""
    narrow = compile_device(drive, "q31", ("-DESEA_Q31_NARROW",))
    assert narrow.path != library.path
    for block in drive.system.kinds:
        for stream in streams(block, steps=120):
            got, expected = (
                run_c(x.block(block.name), stream, raw=True) for x in (narrow, library)
            )
            for a, b in zip(got, expected, strict=True):
                assert all(np.array_equal(a[n], b[n]) for n in a), (block.name, stream.name)


def test_bounds_of_torque_control(drive, bounds):
    assert {n for n, b in bounds.items() if not math.isinf(b.steps)} == FORGETFUL
    for block in drive.system.kinds:
        for p in block.outputs:
            # An extrapolation: what its rate is off by is one step's, over its square.
            if not p.flags and block.name != "set_trend":
                share = bounds[block.name].outputs[p.name] / max(abs(p.low), abs(p.high))
                # The inverse's model torque carries its set-point's error times the stiffness; the
                # damping is a quotient of small powers.
                most = {"inverse": 4e-4, "passivity": 2.5e-3}.get(block.name, 1.1e-4)
                assert share < most, (block.name, p.name)


def test_a_wrong_decision_is_not_explained_by_rounding(drive, library):
    """The comparison can fail: a condition of the C that is always false shows."""
    block = next(b for b in drive.system.kinds if b.name == "limits")
    plan, runner = plan_block(block), library.block("limits")
    stream = streams(block, steps=200)[0]
    _, states = runner.run(stream.inputs, raw=True)
    before = states_before(plan, stream, states)
    assert not single_steps(plan, stream, before).turned.any()
    steps = [dataclasses.replace(s) for s in plan.step.steps]
    k = next(i for i, s in enumerate(steps) if s.expr.bits == 1)
    steps[k] = dataclasses.replace(steps[k], expr=ex.literal(0, 1))
    broken = dataclasses.replace(plan, step=dataclasses.replace(plan.step, steps=tuple(steps)))
    found = single_steps(broken, stream, before)
    assert found.turned.any()
    assert found.unexplained.any()


def test_the_whole_system_in_q31(drive, library):
    """Eight seconds of the trace stream through both tasks: C in q31 against C in f64."""
    system, (stream, _) = drive.system, trace_stream(drive)
    length = len(next(iter(stream.values())))
    inputs = {}
    for task in system.tasks:
        given = {x.name: stream[x.name][task.phase :: task.every] for x in system.task_inputs(task)}
        inputs[task.name] = given or {"": np.zeros(len(range(task.phase, length, task.every)))}
    board = library.board(zeros_missing(drive.system))
    assert isinstance(board, CBoard)
    got = run_schedule(board, inputs)
    exact = run_schedule(compile_device(drive, "f64").board(zeros_missing(drive.system)), inputs)
    moved = 0
    for task in system.tasks:
        for x in system.task_outputs(task):
            a, b = (y[task.name][x.name].astype(np.float64) for y in (got, exact))
            if x.port.flags:
                names = [f.name for f in x.port.flags]
                turned = np.bitwise_xor(a.astype(np.int64), b.astype(np.int64))
                # Their threshold is zero: last bits decide.
                for name, most in (("RATE_LIMITED", 2), ("DAMPED", 24)):
                    bit = 1 << names.index(name) if name in names else 0
                    assert np.sum(turned & bit != 0) <= most
                    turned &= ~bit
                assert not turned.any(), (x.name, np.unique(turned, return_counts=True))
                continue
            if x.port.unit == "1":
                assert np.array_equal(a, b), x.name
                continue
            # Measured: 0.29 % of the motor command (the damping added is a quotient of small
            # powers), 0.13 % of what the drive's observers leave over, below 0.05 % of all else.
            full = max(abs(x.port.low), abs(x.port.high))
            share = {"u_": 0.004, "d4_": 0.002, "apart_": 0.002}.get(
                x.name.split("_")[0] + "_", 0.001
            )
            assert np.max(np.abs(a - b)) < share * full, x.name
            moved += np.ptp(b) > 0
    assert moved > 10


def test_a_board_takes_tunables_in_units_and_refuses_bad_ones(library):
    system = library.system
    instance, tunable = system.tunables[0]
    CBoard(library, {instance: {tunable.name: tunable.default}})
    with pytest.raises(ValueError, match=rf"{instance}\.{tunable.name}"):
        CBoard(library, {instance: {tunable.name: 2 * tunable.high + 1}})
    with pytest.raises(ValueError, match=rf"{instance}\.{tunable.name}"):
        CBoard(library, {instance: {tunable.name: float("nan")}})
    # A bound is taken as the device file states it: within one float32 rounding.
    for instance, tunable in system.tunables:
        above = float(np.nextafter(np.float32(tunable.high), np.float32(np.inf)))
        CBoard(library, {instance: {tunable.name: above}})


def test_what_does_not_forget_has_a_bound_of_one_step(drive):
    block = next(b for b in drive.system.kinds if b.name == "sliding_mode")
    plan = plan_block(block)
    with pytest.raises(RangeError, match="not stable"):
        block_bound(plan)
    bound = any_bound(plan)
    assert bound.steps == 1
    assert bound.outputs["u_command_Nm"] < 5e-5 * 0.221
    # In 32 bits alone the ratio s/phi loses what its clip gives back.
    narrow = any_bound(Planner(block).plan())
    assert narrow.outputs["u_command_Nm"] > 50 * bound.outputs["u_command_Nm"]
    assert any("clip" in why for why in plan.why_wide.values())


def test_the_closed_loop_in_the_virtual_exoskeleton():
    """The tuning case of the thesis, the controller in q31 against the one in f64."""
    require_tool("gcc")
    (case,) = TuningCase().cases()
    runs = {
        real: run_case(case, Setting("smc", "real", "none", real), 0)
        for real in ("f64", "f32", "q31")
    }
    desired, after = case.trajectory.tau_desired_Nm, slice(3000, None)
    true = {real: r.plant["tau_e_Nm"] for real, r in runs.items()}
    rms = {real: np.sqrt(np.mean((y - desired)[after] ** 2)) for real, y in true.items()}
    apart = {real: np.sqrt(np.mean((y - true["f64"])[after] ** 2)) for real, y in true.items()}
    # Encoders quantise: any two formats part within a count.  Measured: f32 1.6e-3, q31 1.7e-3 Nm.
    assert 0 < apart["q31"] < 2 * apart["f32"] < 0.01
    assert rms["q31"] == pytest.approx(rms["f64"], rel=0.02)
    assert not np.any(runs["q31"]["fault"][after])
    assert np.array_equal(runs["q31"]["mode_held"], runs["f64"]["mode_held"])


def test_both_tasks_on_a_board_bit_for_bit(drive, monkeypatch):
    """Encoders to motor command on a Cortex-M0, from counts of the loop with the virtual plant."""
    for tool in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(tool)
    inputs, ran = record_drive(drive, 60).inputs, {}

    def content(files, board):
        return board.machine, *sorted(files.items())

    def kept(files, board):
        ran[content(files, board)] = emulate(files, board)
        return ran[content(files, board)]

    monkeypatch.setattr(bare, "emulate", kept)
    found = run_bare(drive, "q31", "m0", inputs)
    assert found.identical, found.first_difference
    assert found.steps == 60
    # Four ticks of five run the sensing task alone.
    assert found.instructions["min"] < found.instructions["mean"] < found.instructions["max"]
    assert found.flash_bytes < 104 * 1024
    assert found.ram_bytes + found.stack_bytes < 4096
    # The comparison can fail: the host's board is given another count at one tick.
    honest, calls = CBoard.step, []

    def other(self, task_name, **given):
        calls.append(task_name)
        if calls.count("sense") == 40 and task_name == "sense":
            given["count_load"] += 3
        return honest(self, task_name, **given)

    monkeypatch.setattr(CBoard, "step", other)
    # The board's side is as before: the very files that it ran.
    monkeypatch.setattr(bare, "emulate", lambda files, board: ran[content(files, board)])
    changed = run_bare(drive, "q31", "m0", inputs)
    assert not changed.identical
    assert "at step 39" in changed.first_difference


# -- signals ---------------------------------------------------------------------------------------


def test_published_motions_stay_within_the_aim(elbow):
    require_tool("gcc")
    found = [compare_signal(elbow, name, theta) for name, theta in published_motions(elbow)]
    assert len(found) == 6
    assert all(0 < s.share < AIM_SHARE for s in found), found


@pytest.mark.parametrize(
    "name",
    [
        "elbow",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("wrist", "knee", "knee_printed")),
    ],
)
def test_the_recorded_rubber_stays_within_the_aim(name):
    require_tool("gcc")
    device = esea_gen.load_device(name)
    found = recorded_deflections(device, HDRB, None)
    assert found
    for title, theta in found.items():
        assert 0 < compare_signal(device, title, theta).share < AIM_SHARE, title


# -- report and benchmark --------------------------------------------------------------------------


def test_ranges_names_what_cannot_be_lowered_and_draws(tmp_path):
    figure, content = tmp_path / "ranges.png", tmp_path / "ranges.json"
    done = CliRunner().invoke(
        app, ["ranges", "elbow", "--figure", str(figure), "--json", str(content)]
    )
    assert done.exit_code == 0, done.output
    found = json.loads(content.read_text())["blocks"]
    assert set(found) == {"velocity", "smoothing", "sensor"}
    rows = {r["name"]: r for r in found["velocity"]["values"]}
    # 0.35 rad in units of 2^-31 rad, inwards.
    limit = math.floor(float(np.float32(0.35)) * 2**31)
    assert rows["theta_rad"]["raw"][1] in (limit, math.floor(0.35 * 2**31))
    assert rows["theta_rad"]["unit"] == "rad"
    assert "theta_rad" in done.output
    assert found["sensor"]["proven_error"]["percent_of_range"]["tau_Nm"] < 0.05
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_the_report_goes_on_behind_a_block_that_is_refused():
    joint = esea_gen.load_device("elbow_drive").system.blocks["joint"]
    ratio = made(
        lambda c, s, u, guard, label: ({}, {"share": clip(u.over_Nm / u.under_Nm, -1, 1)}),
        inputs=(port("over_Nm", -1, 1), port("under_Nm", -1, 1)),
        outputs=(port("share", -1, 1),),
        **{"name": "ratio", "period_s": joint.period_s},
    )
    with pytest.raises(LoweringError, match=r"under_Nm.*range .* holds zero.*positive offset"):
        plan_block(ratio)
    system = System(
        "two",
        joint.period_s,
        {"ratio": ratio, "joint": joint},
        (Task("run", ("ratio", "joint")),),
        {},
        {p.name: (f"{b.name}.{p.name}",) for b in (ratio, joint) for p in b.inputs},
        {"theta_rad": "joint.theta_rad"},
    )
    report = range_report("two", system)
    text = "\n".join(report.table())
    assert "cannot be lowered: ratio" in text
    assert "holds zero" in text
    assert report.blocks[1].plan is not None
    assert len(report.figure().axes) == 2
    assert report.to_dict()["blocks"]["ratio"]["lowered"] is False


def test_the_filter_written_by_hand_is_the_same_filter(elbow):
    """It may only be compared if it does the same: against exact arithmetic, gaps and clips too."""
    for tool in ("gcc", "arm-none-eabi-gcc", "qemu-system-arm"):
        require_tool(tool)
    theta = domain_chirp(elbow, 8.0)[-300:].copy()
    theta[:4], theta[100:103] = np.nan, np.nan
    theta[200:] = 0.3  # a jump that clips the rate
    for program in PROGRAMS:
        found = run_filter(elbow, program, "m3", theta)
        assert found.error_rad_s < (1e-5 if program == "hand" else 2e-4), program
        assert found.instructions < (2000 if program == "f32" else 300)
