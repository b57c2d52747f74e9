"""The example program's inputs and tolerances, by hand; no program is compiled here."""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.example import DriveExample, _Run, example, has_drive, tolerance, triangle
from esea_gen.emit.example_encoders import ExampleEncoder, encoder_of
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.system import System, Task

TURN = 2 * math.pi


def twice(low: float, high: float) -> System:
    """y = x and z = 2 x, where w has x's range and v another; all inputs external."""
    names = (("x_Nm", low, high), ("w_Nm", low, high), ("v_rad", 0.5, 2.0))

    def step(_c, _s, u, _guard, _label):
        return {}, {"still": 1.0, "z_Nm": 2 * u.x_Nm}

    block = Block.define(
        "twice",
        "Twice",
        period_s=0.001,
        state=(),
        inputs=tuple(Port(n, a, b, "in", on_invalid=a) for n, a, b in names),
        outputs=(Port("still", 0, 5, "stays"), Port("z_Nm", 2 * low, 2 * high, "out")),
        step=step,
    )
    given = {n: (f"twice.{n}",) for n, _, _ in names}
    made = {n: f"twice.{n}" for n in ("still", "z_Nm")}
    return System("small", 0.001, {"twice": block}, (Task("run", ("twice",)),), {}, given, made)


@pytest.mark.parametrize(
    ("low", "high", "start", "peak", "lattice"),
    [
        # Round zero, half way to the nearer end; 128 steps and more, 255 at most.
        (-1.0, 1.0, 0, 128, 2.0**-8),
        (-2.0, 900.0, 0, 128, 2.0**-7),
        (-3.0, 3.0, 0, 192, 2.0**-7),
        # Round a quarter of what does not hold zero.
        (3.0, 4.0, 3328, 128, 2.0**-10),
        (0.0, 50.0, 400, 200, 2.0**-5),
        # A count moves in steps of one, and of no more.
        (0.0, 4095.0, 1024, 255, 1.0),
        (0.0, 131071.0, 32768, 255, 1.0),
        (-4000.0, 4000.0, 0, 250, 8.0),
        (0.0, 96.0, 384, 192, 2.0**-4),
    ],
)
def test_a_triangle_by_hand(low, high, start, peak, lattice):
    made = example(twice(low, high))
    assert (made.start, made.peak, made.lattice) == (start, peak, lattice)
    assert made.steps == 4 * peak
    assert (made.input.name, made.output.name) == ("x_Nm", "z_Nm")  # what stays is not compared
    assert made.checked == (made.output,)
    # Twelve samples, in the middle of as many stretches.
    apart = 4 * peak // 12
    first = 4 * peak // 24
    assert [s.step for s in made.samples] == [k for k in range(4 * peak) if k % apart == first]
    for s in made.samples:
        at = s.step % (4 * peak)
        up = at if at <= peak else 2 * peak - at if at <= 3 * peak else at - 4 * peak
        assert s.expected == pytest.approx(2 * (start + up) * lattice, abs=5.1e-7)
        assert s.expected == round(s.expected, 6)
    # What is alike stands where the triangle starts; all else at zero, or at the nearer end.
    assert dict(made.held) == {"x_Nm": start * lattice, "w_Nm": start * lattice, "v_rad": 0.5}


def test_a_wave_has_its_corners():
    assert [triangle(k, 2) for k in range(9)] == [0, 1, 2, 1, 0, -1, -2, -1, 0]
    assert [triangle(k, 2) for k in (8, 9, 10, 14, 17)] == [0, 1, 2, -2, 1]  # and again


def test_a_tolerance_is_a_share_of_the_range_to_one_digit():
    system = twice(-3.0, 2.0)
    still, z = system.outputs
    assert tolerance(system, z, 1e-5) == 6e-5
    assert tolerance(system, z, 2.4e-5) == 1e-4  # 1.44e-4
    assert tolerance(system, still, 1e-5) == 5e-5
    assert not has_drive(system)


@pytest.mark.parametrize(("sign", "zero"), [(1, 0.0), (-1, 0.3), (1, -2.0)])
def test_an_encoder_is_asked_for_its_zero_and_its_direction(sign, zero):
    def step(_c, _s, u, _guard, _label):
        return {}, {"theta_rad": sign * u.count * (TURN / 4096) + zero + 0 * u.frame_error}

    block = Block.define(
        "encoder",
        "Counts",
        period_s=0.001,
        state=(),
        inputs=(Port("count", 0, 4095, "count"), Port("frame_error", 0, 1, "bad")),
        outputs=(Port("theta_rad", -9, 9, "angle"),),
        step=step,
    )
    found = encoder_of(block, {})
    assert (found.full, found.sign) == (4096, sign)
    assert found.at_zero_rad == pytest.approx(zero)
    for count in (0, 1, 700, 4095):
        assert found.count(sign * count * TURN / 4096 + zero) == count
    assert found.count(zero + sign * TURN) == 0
    assert found.count(zero + sign * 0.49 * TURN / 4096) == 0
    assert found.count(zero + sign * 0.51 * TURN / 4096) == 1


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("part", [0.001, 0.005, 0.009])
def test_a_direction_is_told_by_the_short_way_round(sign, part):
    # The angle jumps by a turn within the hundredth from count 0 on, at 0.1, 0.5 or 0.9 of it.
    full = 4096

    def step(_c, _s, u, _guard, _label):
        turns = u.count / full
        turns = turns - ca.if_else(turns > part, 1, 0)
        return {}, {"theta_rad": sign * (turns * TURN + 3.0) + 0 * u.frame_error}

    block = Block.define(
        "encoder",
        "Counts",
        period_s=0.001,
        state=(),
        inputs=(Port("count", 0, full - 1, "count"), Port("frame_error", 0, 1, "bad")),
        outputs=(Port("theta_rad", -9, 9, "angle"),),
        step=step,
    )
    found = encoder_of(block, {})
    assert (found.sign, found.at_zero_rad) == (sign, pytest.approx(sign * 3.0))


def test_an_encoder_has_twenty_steps_to_settle_and_one_behind_the_gear_starts_anywhere():
    def step(_c, s, u, _guard, _label):
        settled = ca.if_else(s.steps >= 19, u.count * (-TURN / 1000) + 0.25, 7.0)
        return {"steps": s.steps + 1}, {"theta_rad": settled + 0 * u.frame_error}

    def encoder(name: str) -> Block:
        return Block.define(
            name,
            "Counts",
            period_s=0.001,
            state=(Port("steps", 0, 99, "so far"),),
            inputs=(Port("frame_error", 0, 1, "bad"), Port("count", 0, 999, "count")),
            outputs=(Port("theta_rad", -9, 9, "angle"),),
            step=step,
        )

    found = encoder_of(encoder("encoder"), {})
    assert (found.sign, found.full) == (-1.0, 1000)
    assert found.at_zero_rad == pytest.approx(0.25)
    assert found.count(0.25 + 0.1 * TURN) == 900
    assert encoder_of(encoder("encoder_gear"), {}) == ExampleEncoder(0.0, 1.0, 1000)


# -- ticks -----------------------------------------------------------------------------------------


class Recorder:
    """A System's simulator that writes down what it is asked, and gives three outputs."""

    def __init__(self, tunables):
        self.tunables, self.asked = tunables, []

    def release(self, tick):
        self.asked.append(tick)

    def step(self, task, **inputs):
        self.asked.append((task, {n: np.asarray(v).tolist() for n, v in inputs.items()}))
        return {
            "count": float(len(self.asked)),
            task: np.float64(2.0),
            "pair": np.array([1.0, 2.0]),
        }


def test_at_each_tick_the_tasks_run_that_are_due_with_what_was_given_last():
    ports = {"x": Port("x", 0, 9, "in"), "v": Port("v", 0, 9, "in", 3)}
    inputs = {n: SimpleNamespace(name=n, port=p) for n, p in ports.items()}
    tasks = [
        SimpleNamespace(name=n, every=e, phase=p)
        for n, e, p in (("a", 1, 0), ("b", 3, 0), ("c", 4, 3), ("d", 5, 2))
    ]
    reads = {"a": ("x",), "b": ("v",), "c": (), "d": ("x", "v")}
    system = SimpleNamespace(
        tasks=tasks,
        simulator=Recorder,
        task_inputs=lambda task: [inputs[n] for n in reads[task.name]],
    )
    run = _Run(system, {"i": {"gain": 2.0}}, {"x": 1.0, "v": 2.0})
    assert run.simulator.tunables == {"i": {"gain": 2.0}}
    assert run.tick({}) == {"count": 3.0, "a": 2.0, "b": 2.0}
    assert run.simulator.asked == [0, ("a", {"x": 1.0}), ("b", {"v": [2.0] * 3})]
    run.simulator.asked.clear()
    run.tick({"x": 5.0})
    run.tick({"v": 7.0})
    out = run.tick({})
    assert run.simulator.asked == [
        *(1, ("a", {"x": 5.0})),
        *(2, ("a", {"x": 5.0}), ("d", {"x": 5.0, "v": [7.0] * 3})),
        *(3, ("a", {"x": 5.0}), ("b", {"v": [7.0] * 3}), ("c", {})),
    ]
    assert out == run.out == {"count": 9.0, "a": 2.0, "b": 2.0, "c": 2.0, "d": 2.0}
    for _ in range(4, 13):
        run.tick({})
    due = {n: [] for n in "abcd"}
    for asked in run.simulator.asked:
        if isinstance(asked, int):
            tick = asked
        else:
            due[asked[0]].append(tick)
    assert due == {"a": [*range(1, 13)], "b": [3, 6, 9, 12], "c": [3, 7, 11], "d": [2, 7, 12]}


# -- the recording of a drive ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def system(drive) -> System:
    return drive.system


@pytest.fixture(scope="module")
def made(system) -> DriveExample:
    found = example(system)
    assert isinstance(found, DriveExample)
    return found


# Its tasks run every tick and every fifth: 20 ticks to settle, 5 armed, 120 to move, 10 to rest.
ARM, START, END, ALL = 20, 25, 145, 155
MIDDLE = 0.5 * (-0.15 + 2.5)  # of the range of motion


def columns(made: DriveExample) -> dict[str, list[float]]:
    values = zip(*(row.given for row in made.rows), strict=True)
    return {c.name: list(v) for c, v in zip(made.columns, values, strict=True)}


def test_when_what_is_wanted_of_a_drive(made):
    found = columns(made)
    assert {len(v) for v in found.values()} == {ALL}
    assert found["mode"] == [float(k >= START) for k in range(ALL)]
    assert found["rearm"] == [float(k >= ARM) for k in range(ALL)]
    # 4 % of 8 Nm on a parabola over four thirds of the way, in steps of 2^-8 Nm.
    for k, wanted in enumerate(found["tau_desired_Nm"]):
        x = 1.5 * (k - START) / 120
        exact = 0.32 * x * (2 - x) if START <= k < END else 0.0
        assert abs(wanted - exact) <= 2.0**-9
        assert wanted * 2**8 == int(wanted * 2**8)
    assert max(found["tau_desired_Nm"]) == 82 / 256
    assert (made.wait, made.rearmed, made.driven) == (15, 1, True)


def test_the_load_moves_evenly_and_the_motor_as_its_drive(made, system):
    found = columns(made)
    # 0.2 rad/s from the middle of the range once torque is wanted; 12 bits a turn.
    for k, count in enumerate(found["count_load"]):
        angle = MIDDLE + 0.2 * max(k - START, 0) * 1e-3
        assert abs(count - angle / TURN * 4096) <= 0.51
    # The motor under its command, (5.1) and (5.2) with the file's numbers, an explicit step each.
    theta, omega, u = MIDDLE, 0.0, 0.0
    for k, row in enumerate(made.rows):
        assert abs(found["count_motor"][k] - theta / TURN * 4096) <= 0.52
        off = (found["count_gear"][k] - theta * 74 / TURN * 2**17) % 2**17
        assert min(off, 2**17 - off) <= 20
        command, torque, _ = row.expected
        u += (command - u) * (1 - math.exp(-1e-3 / 0.03488))
        friction = 0.5551 * omega + 0.4688 * math.tanh(omega / 0.05)
        omega += 1e-3 * (74 * u - friction - torque) / 0.663
        theta += 1e-3 * omega


def test_what_is_compared_and_what_the_latch_is_asked(made, system):
    assert [x.name for x in made.checked] == ["u_Nm", "tau_Nm", "fault"]
    (axis,) = made.axes
    assert (axis.mode.name, axis.command.name, axis.fault.name) == ("mode", "u_Nm", "fault")
    assert (made.stop.name, made.rearm.name) == ("stop", "rearm")
    assert (made.off, made.torque, made.stopped) == (0.0, 1.0, 4.0)
    moved = {"count_motor", "count_load", "count_gear", "mode", "rearm", "tau_desired_Nm"}
    assert set(columns(made)) == moved
    assert set(made.held) == {x.name for x in system.inputs} - moved
    assert set(made.held.values()) == {0.0}
    assert made.tunables == ()
    faults = [row.expected[2] for row in made.rows]
    assert faults == [1.0] * ARM + [0.0] * (ALL - ARM)
    assert all(row.expected[0] == 0.0 for row in made.rows[:START])
    # A command may be off by 0.4 % of its range whatever the format, a torque by the format's own.
    command, torque, _ = made.checked
    assert tolerance(system, command, 1e-5) == 0.0009
    assert tolerance(system, torque, 1e-5) == float(f"{1e-5 * torque.port.high:.1g}")
    assert has_drive(system)
