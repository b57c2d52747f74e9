"""Emitted example program: it runs the complete drive, compares values, and can fail."""

from __future__ import annotations

import math
import re

import casadi as ca
import pytest

import esea_gen
from esea_gen.device import parse_device
from esea_gen.emit.build import render_device
from esea_gen.emit.example import example
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.hostlib.library import block_system
from esea_gen.language.ports import Flag, flag_word
from esea_gen.language.system import System
from esea_gen.verify.gates import check_objects, run_example
from tests.made_up import made, port
from tests.own_device import own_text

REALS = ("f64", "f32", "q31")


@pytest.fixture(scope="module")
def texts(drive):
    return {real: render_device(drive, [real])[0].files for real in REALS}


@pytest.fixture(scope="module")
def rows(drive):
    """The recording as a table: one mapping a tick."""
    made = example(drive.system)
    names = [*(c.name for c in made.columns), *(f"expected {x.name}" for x in made.checked)]
    return [dict(zip(names, (*r.given, *r.expected), strict=True)) for r in made.rows]


# -- it runs ---------------------------------------------------------------------------------------


@pytest.mark.ci
@pytest.mark.parametrize("real", REALS)
def test_the_drives_example_agrees_at_every_tick_and_its_latch_holds(texts, rows, real):
    run = run_example(texts[real], real)
    assert run.problems == (), run.said
    assert run.agree == run.checked == len(rows)
    assert run.held == run.asked == 8


@pytest.mark.ci
def test_the_example_of_predictive_control_agrees():
    device = esea_gen.load_device("elbow_mpc")
    run = run_example(render_device(device, ["f32"])[0].files, "f32", quick=True)
    assert run.problems == (), run.said
    assert run.checked >= 100
    assert run.asked == 8


def test_the_example_in_whole_numbers_of_a_device_that_measures(elbow):
    run = run_example(render_device(elbow, ["q31"])[0].files, "q31", quick=True)
    assert (run.problems, run.checked, run.asked) == ((), 12, 0)


TURNED = {"encoder.motor": {"zero_rad": 1.0}, "encoder.load": {"zero_rad": -2.0, "direction": -1}}
OTHERS = {
    "two axes": own_text('axes = ["flexion", "deviation"]\n'),
    "encoder turned round, zero elsewhere": own_text(**TURNED),
}


@pytest.mark.ci
@pytest.mark.parametrize("title", sorted(OTHERS))
def test_the_example_of_another_drive(title):
    device = parse_device(OTHERS[title], "mine.toml")
    run = run_example(render_device(device, ["f32"])[0].files, "f32", quick=True)
    assert run.problems == (), run.said
    assert run.checked >= 100
    assert example(device.system).driven


@pytest.mark.ci
def test_encoders_that_nobody_has_calibrated_are_calibrated_by_the_example(drive):
    text = re.sub(r"(?m)^zero_rad = .*$", "", drive.toml())
    files = render_device(parse_device(text, "new.toml"), ["f32"])[0].files
    assert "params.encoder_motor.zeroed = 1.0f; /* as a calibration would */" in files["main.c"]
    assert run_example(files, "f32", quick=True).problems == ()


# -- what the recording is -------------------------------------------------------------------------


def test_the_latch_is_opened_as_the_limits_demand(rows):
    """Mode 0, then one more rearm, then torque mode; and the fault tells of each."""
    states = [(r["mode"], r["rearm"], r["expected fault"]) for r in rows]
    order = [s for k, s in enumerate(states) if k == 0 or s != states[k - 1]]
    # Never armed; armed; torque control: from the table of the faults, typed by hand.
    assert order == [(0, 0, 1), (0, 1, 0), (1, 1, 0)]
    assert all(r["expected u_Nm"] == 0 for r in rows if r["mode"] == 0)


def test_motor_and_torque_move_and_the_command_is_no_constant(drive, rows):
    counts = 2 * math.pi / 2 ** int(drive.file.encoder.resolution_bits.value)
    deflection = [(r["count_motor"] - r["count_load"]) * counts for r in rows]
    torque = [r["expected tau_Nm"] for r in rows]
    command = [r["expected u_Nm"] for r in rows]
    # A spring: the largest deflection has a torque of its sign, stiffer than k1 alone.
    k = deflection.index(max(deflection, key=abs))
    assert abs(deflection[k]) > 0.005
    assert abs(torque[k]) > 9.39 * abs(deflection[k])
    assert math.copysign(1, torque[k]) == math.copysign(1, deflection[k])
    assert 60 <= len(rows) <= 200
    assert min(command) < -0.01
    assert max(command) > 0.01
    within = [u for u in command if 0 < abs(u) < 0.22]  # neither off nor at the motor's limit
    assert len(set(within)) > 10
    assert len({r["count_gear"] for r in rows}) > 60
    assert len({r["count_motor"] for r in rows}) > 3
    assert len({r["count_load"] for r in rows}) > 10


# -- it can fail -----------------------------------------------------------------------------------


def faulty(files, name, find, put):
    text, count = re.subn(find, put, files[name])
    assert count >= 1, (name, find)
    return dict(files) | {name: text}


# Goes on after a stop with what it remembered from before: the state of the limits, copied back.
REMEMBERS = r"""
    static esea_elbow_drive_limits_state_t kept;
    static int stopped;
    if (in->stop > 0 && !stopped)
        kept = state->limits;
    if (stopped && !(in->stop > 0))
        state->limits = kept;
    stopped = in->stop > 0;
"""
FAULTS = {
    "sensor's sign": (
        "esea_elbow_drive_sensor.c",
        r"(out->tau_Nm = )([^;]+);",
        r"\1-(\2);",
        "samples",
    ),
    "stop is ignored": ("esea_elbow_drive_limits.c", r"\bin->stop\b", "0", "promises"),
    "nothing is released": (
        "esea_elbow_drive.c",
        r"state->latched\.stamp_control_beat = state->pending\.stamp_control_beat;",
        ";",
        "samples",
    ),
    "the latch forgets": (
        "esea_elbow_drive.c",
        r"(void esea_elbow_drive_sense_step\([^{]*\{)",
        r"\1" + REMEMBERS,
        "promises",
    ),
    "one percent of the command": (
        "esea_elbow_drive.c",
        r"(out->u_Nm = )([^;]+);",
        r"\1(\2) + (\2) / 100;",
        "samples",
    ),
}


@pytest.mark.ci
@pytest.mark.parametrize(
    ("title", "real"),
    [(t, "f32") for t in FAULTS] + [(t, "q31") for t in ("sensor's sign", "stop is ignored")]
    + [("stop is ignored", "f64"), ("sensor's sign", "f64")],
)  # fmt: skip
def test_a_fault_in_the_c_is_seen(texts, title, real):
    name, find, put, seen = FAULTS[title]
    run = run_example(faulty(texts[real], name, find, put), real, quick=True)
    assert run.checked > 0, run.problems  # it compiled
    assert any(seen in p for p in run.problems), run.said
    assert any("exit code is 1" in p for p in run.problems)


# -- an example that compares nothing --------------------------------------------------------------


@pytest.mark.ci
def test_the_gates_refuse_an_example_that_compares_nothing(elbow):
    files = dict(render_device(elbow, ["f32"])[0].files)
    files["main.c"] = (
        '#include <stdio.h>\nint main(void) { puts("0 of 0 samples agree"); return 0; }'
    )
    problems = check_objects(elbow, "host", files=files).problems
    assert problems == ("main.c: the example compares nothing",)
    files["main.c"] = "int main(void) { return }"
    assert check_objects(elbow, "host", files=files).problems == (
        "main.c: the example does not compile",
    )


def one_block(low: float, high: float, moves: bool = True, size: int = 1) -> System:
    """A System of one Block: y = x, or y that stays."""

    def step(_c, _s, u, guard, _label):
        y = u.x_Nm[0] if moves else ca.SX(0.5 * (low + high))
        return {}, {"y_Nm": y, "status": flag_word([ca.logic_not(guard.inputs_ok)])}

    flags = (Flag("INPUT_INVALID", "the input was outside its range"),)
    ends = port("y_Nm", low, high), port("status", 0, 1, flags=flags)
    inputs = (port("x_Nm", low, high, size, on_invalid=low),)
    return block_system(made(step, (), inputs, ends, name="small"))


RANGES = ((0, 1), (0, 4095), (-1e-3, 1e-3), (-2, 900), (-5, 0), (3, 4), (0, 50))


@pytest.mark.parametrize(("low", "high"), RANGES)
def test_any_range_that_holds_more_than_a_value_gets_its_triangle(low, high):
    made = example(one_block(low, high))
    assert len(made.samples) == 12
    assert len({s.expected for s in made.samples}) > 1
    given = [(made.start + k) * made.lattice for k in (-made.peak, made.peak)]
    assert low <= given[0] < given[1] <= high
    assert math.frexp(made.lattice)[0] == 0.5  # a power of two
    # Round zero where that is inside, else round a quarter; half way to the nearer end at most.
    middle = 0.0 if low < 0 < high else low + (high - low) / 4
    assert abs(made.start * made.lattice - middle) <= made.lattice / 2
    assert made.peak * made.lattice <= 0.5 * min(high - middle, middle - low)


@pytest.mark.parametrize("real", REALS)
def test_a_triangle_that_does_not_start_at_zero_runs(real):
    renderer = Renderer(one_block(3.0, 4.0), FORMATS[real], "-", "-", "Small")
    run = run_example(renderer.folder(), real, quick=True)
    assert (run.problems, run.checked) == ((), 12), run.said


def test_a_system_that_cannot_be_tried_is_refused():
    with pytest.raises(UserError, match=r"small.* compare nothing: it has no external input"):
        example(one_block(0.0, 1.0, size=2))
    with pytest.raises(UserError, match=r"small.* compare nothing: x_Nm moves no output"):
        example(one_block(0.0, 1.0, moves=False))


def test_a_drive_whose_latch_cannot_be_opened_is_refused(drive):
    text, count = re.subn(r"(?m)^(tau_max_Nm = \{ value = )8.0", r"\g<1>0.05", drive.toml())
    assert count == 1
    with pytest.raises(UserError, match=r"cannot show the drive at work: .* fault is 9: the inter"):
        render_device(parse_device(text, "weak.toml"), ["f32"])
