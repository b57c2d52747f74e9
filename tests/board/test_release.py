"""Limits of predictive control: weights in f32, release times."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from esea_gen.board import release as releases
from esea_gen.board.release import TaskTimes, task_times
from esea_gen.control.predictive.drive import LEAST_SHARE
from esea_gen.device import load_device
from esea_gen.devices.file import controller_document
from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary
from esea_gen.targets import BOARDS
from tests.benchmarks.predictive import stress_rows
from tests.conftest import require_tool
from tests.own_device import own_device
from tests.rendered_program import render_program

M4F = BOARDS["netduinoplus2"]
NOT_CONVEX, CAP_REACHED, NOT_OPTIMAL = 4, 8, 16


# -- weights ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mpc():
    program = load_device("elbow_mpc").system.blocks["predictive"]
    renderer = render_program(program, "f32")
    return program, HostLibrary(renderer.system, renderer).block("predictive")


def stream(program, rows):
    out, at = {}, 0
    for p in program.inputs:
        block = rows[:, at : at + p.size].astype(np.float32).astype(float)
        out[p.name] = block[:, 0] if p.size == 1 else block
        at += p.size
    return out


def whole_ranges(program, count):
    rng = np.random.default_rng(3)
    columns = [rng.uniform(p.low, p.high, (count, p.size)) for p in program.inputs]
    columns[[p.name for p in program.inputs].index("mode")][:] = 1.0
    return np.hstack(columns)


def test_single_precision_holds_at_every_corner_of_the_weights(mpc):
    program, runner = mpc
    tunables = {t.name: t for t in program.tunables}
    corners = itertools.product(*([t.low, t.high] for t in tunables.values()))
    given = [stream(program, r) for r in (stress_rows(program, 400), whole_ranges(program, 400))]
    for corner in corners:
        runner.prepare(dict(zip(tunables, corner, strict=True)))
        for inputs in given:
            y, _ = runner.run(inputs, trace=False)
            status = y["status"].astype(int)
            assert not np.any(status & NOT_CONVEX), corner
            # Feasible all the same, and told of.
            assert np.mean(status & (CAP_REACHED | NOT_OPTIMAL) > 0) < 0.02, corner
            assert np.all(np.isfinite(y["u_Nm"]))


def test_a_weight_below_its_share_counts_as_its_share(mpc):
    program, _ = mpc
    names = [p.name for p in program.coefficients]

    def prepared(q, r):
        simulator = program.simulator({"Q": q, "R": r})
        return dict(zip(names, simulator.coefficients.values(), strict=True))["root_r"]

    lag = load_device("elbow_mpc").file.actuator.tau_c_s.value
    assert prepared(300.0, 1.0) == pytest.approx(1 / lag)
    assert prepared(1.0, 0.005) == pytest.approx(math.sqrt(0.005) / lag)
    assert prepared(1e5, 1e-4) == pytest.approx(math.sqrt(10.0) / lag)
    assert LEAST_SHARE == 1e-4


# -- the release -----------------------------------------------------------------------------------


def times(control, sense=5000, release=0.001, cycles=1.5):
    """As :func:`task_times` makes them, of given counts; worked out by hand."""
    busy = {"sense": sense * cycles / 168e6, "control": control * cycles / 168e6}
    end = busy["control"] + math.ceil(busy["control"] / 1e-3 + 0.1) * busy["sense"]
    ended = {"sense": busy["sense"], "control": end}
    counts = {"sense": sense, "control": control}
    released = {"sense": 0.001, "control": release}
    return TaskTimes("d", M4F, counts, ended, released, cycles, 0.001, 1e8)


def test_a_release_before_the_end_is_refused_with_the_one_that_fits():
    times(90_000).check()
    with pytest.raises(UserError, match=r"control takes up to 112313 instructions") as found:
        times(112_313).check()
    assert "timing.control_release_s = 0.002" in str(found.value.fix)
    times(112_313, release=0.002).check()
    with pytest.raises(UserError, match="released after 2 ms"):
        times(112_313, release=0.002, cycles=3.0).check()


@pytest.fixture(scope="module")
def at_1_ms():
    given = controller_document("mpc")["predictive"].items()
    values = {k: v if isinstance(v, str) else v["value"] for k, v in given}
    return own_device(name="early", predictive=values)


@pytest.mark.slow
def test_predictive_control_fits_on_the_m4f_by_its_cycles_an_instruction(at_1_ms, monkeypatch):
    require_tool("arm-none-eabi-gcc")
    shipped = task_times(load_device("elbow_mpc"), M4F)
    shipped.check()
    # The Program alone is bound by 52 094; the other Blocks, latches and checksum come on top.
    assert 52_094 < shipped.instructions["control"] < 56_000
    each = 1.5 / 168e6
    alone = shipped.instructions["control"] * each
    assert alone < shipped.ended_s["control"] <= 1e-3
    assert shipped.ended_s["control"] == pytest.approx(alone + shipped.instructions["sense"] * each)
    task_times(at_1_ms, M4F).check()
    early = task_times(at_1_ms, M4F, cycles=3.0)
    with pytest.raises(UserError, match=r"does not fit on netduinoplus2.*released after 1 ms"):
        early.check()
    # The emulated FPGA image runs at a tenth of the clock of a common Cortex-M7.
    with pytest.raises(UserError, match=r"mps2-an500 .* and 25 MHz; they need 9\d\S* MHz"):
        task_times(at_1_ms, BOARDS["mps2-an500"]).check()
    drive = task_times(load_device("elbow_drive"), M4F)
    drive.check()
    # The slowest clock at which it fits, to a ten-thousandth; the one that the board starts at is
    # slower.
    assert 19e6 < drive.least_Hz < 20e6
    monkeypatch.setattr(releases, "task_bounds", lambda *_: drive.instructions)
    task_times(load_device("elbow_drive"), replace(M4F, clock_Hz=drive.least_Hz)).check()
    slower = replace(M4F, clock_Hz=0.999 * drive.least_Hz)
    with pytest.raises(UserError, match=r"may end 1\.8") as found:
        task_times(load_device("elbow_drive"), slower).check()
    assert "take a board of 19" in str(found.value.fix)


def test_tasks_of_one_rate_wait_for_each_other(monkeypatch):
    wrist = load_device("wrist_drive")
    counts = {t.name: 30_000 if t.every == 1 else 40_000 for t in wrist.system.tasks}
    monkeypatch.setattr(releases, "task_bounds", lambda *_: counts)
    ended = task_times(wrist, M4F, cycles=1.0).ended_s
    # Both of control, and both of sensing in each tick that begins before they have ended.
    assert ended["control_flexion"] == ended["control_deviation"]
    assert ended["control_flexion"] == pytest.approx((2 * 40_000 + 2 * 30_000) / 168e6)
    assert ended["sense_flexion"] == pytest.approx(60_000 / 168e6)


def test_a_board_without_a_clock_says_so():
    with pytest.raises(UserError, match="Linux\\) has no clock"):
        task_times(load_device("elbow_drive"), BOARDS["myrio"])
    with pytest.raises(UserError, match="cycles"):
        task_times(load_device("elbow_drive"), M4F, cycles=math.nan)
