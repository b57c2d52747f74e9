"""Wiring, tasks and latches: the symbolic System and its C, however late a slow task runs."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from esea_gen.device import load_device, parse_device
from esea_gen.emit.build import render_device
from esea_gen.hostlib.library import compile_system
from esea_gen.language.alike import alike
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.system import System, Task


def summing(period_s: float, name: str = "fast", gain: bool = False) -> Block:
    """A made-up Block: y = sum of inputs so far (times a tunable), and a vector beside it."""
    tunables = (Tunable("gain", 1.0, -4.0, 4.0, "gain"),) if gain else ()

    def step(c, s, u, guard, label):
        factor = c.factor if gain else 1
        total = s.total + factor * u.x
        return (
            {"total": total, "pair": [s.pair[1], u.x]},
            {
                "y": total,
                "both": [s.pair[0], total],
                "status": flag_word([ca.logic_not(guard.inputs_ok)]),
            },
        )

    return Block.define(
        name,
        "made up",
        period_s=period_s,
        tunables=tunables,
        coefficients=(Port("factor", -4, 4, "gain"),) if gain else (),
        prepare=(lambda t: {"factor": 1 * t.gain}) if gain else None,
        state=(Port("total", -1e6, 1e6, "sum"), Port("pair", -1e6, 1e6, "last two", size=2)),
        inputs=(Port("x", -1e6, 1e6, "what is summed"),),
        outputs=(
            Port("y", -1e6, 1e6, "sum"),
            Port("both", -1e6, 1e6, "two values", size=2),
            Port("status", 0, 1, "status", flags=(Flag("INPUT_INVALID", "bad", True),)),
        ),
        step=step,
    )


def other_first(f: ca.Function) -> ca.Function:
    """The same function, with another first result."""
    symbols = f.sx_in()
    first, *rest = f.call(symbols)
    return ca.Function(f.name(), symbols, [2 * first + 1, *rest], f.name_in(), f.name_out())


def test_blocks_are_emitted_once_only_where_they_compute_the_same():
    one = summing(1e-3, "one")
    said = replace(one.inputs[0], meaning="in other words")
    for same in (summing(1e-3, "other"), replace(one, inputs=(said,))):
        assert alike(one, same)
        assert alike(same, one)
    wider = replace(one.inputs[0], high=2e6)
    for other in (
        summing(2e-3, "other"),
        summing(1e-3, "other", gain=True),
        replace(one, labels=(("total", "the sum"),)),
        replace(one, inputs=(wider,)),
        replace(one, state=one.state[::-1]),
        *(replace(one, **{name: other_first(getattr(one, name))}) for name in ("init", "step")),
    ):
        assert not alike(one, other)
        assert not alike(other, one)


def two_rates(release: int | None = None, gain: bool = True) -> System:
    return System(
        "twotasks",
        1e-3,
        {"fast": summing(1e-3), "slow": summing(4e-3, "slow", gain), "last": summing(1e-3, "last")},
        (
            Task("quick", ("fast", "last")),
            Task("lazy", ("slow",), every=4, phase=1, release=release),
        ),
        wires={"slow.x": "fast.y", "last.x": "slow.y"},
        inputs={"x": ("fast.x",)},
        outputs={"y": "last.y", "both": "last.both", "slow_y": "slow.y", "status": "fast.status"},
    )


def run(step, release, lateness: int, ticks: int = 41) -> list[float]:
    """Run the schedule; the lazy task is preempted and runs ``lateness`` ticks after its start."""
    seen = []
    for tick in range(ticks):
        release(tick)
        if tick >= 1 + lateness and (tick - 1 - lateness) % 4 == 0:
            step("lazy")
        seen.append(step("quick", x=float(tick + 1)))
    return seen


@pytest.mark.parametrize("release", [None, 3])
def test_latched_values_do_not_depend_on_preemption(release):
    results = []
    for lateness in (0, 1, 2):
        simulator = two_rates(release).simulator()
        results.append([y["y"] for y in run(simulator.step, simulator.release, lateness)])
    assert results[0] == results[1] == results[2]
    # Independently: the slow task starts at 1, 5, ...; it then sees fast's sum of one tick before,
    # and what it wrote is seen `release` ticks later, when it is added up once a tick.
    fast = np.cumsum(np.arange(41) + 1)
    slow, seen = 0.0, np.zeros(41)
    for start in range(1, 41, 4):
        slow += fast[start - 1]
        seen[start + (release or 4) :] = slow
    assert results[0] == list(np.cumsum(seen))


@pytest.mark.ci
@pytest.mark.parametrize("lateness", [0, 2])
@pytest.mark.parametrize("gain", [True, False])
@pytest.mark.parametrize("real", ["f64", "f32"])
def test_the_c_does_what_the_symbolic_system_does(real: str, gain: bool, lateness: int):
    system = two_rates(3, gain)
    board = compile_system(system, real).board()
    simulator = system.simulator()
    expected = run(simulator.step, simulator.release, 0)
    for a, b in zip(expected, run(board.step, board.release, lateness), strict=True):
        assert a["y"] == b["y"]
        assert np.array_equal(a["both"], b["both"])
        assert a["status"] == b["status"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": "a b"}, "system name 'a b' is not a C identifier"),
        ({"wires": {"slow.x": "fast.y"}}, "last.x is not fed"),
        ({"wires": {"slow.x": "fast.nothing", "last.x": "slow.y"}}, "no such port fast.nothing"),
        ({"wires": {"slow.x": "fast.both", "last.x": "slow.y"}}, "x 2"),
        ({"inputs": {"x": ("fast.x", "last.x")}}, "fed twice"),
        ({"tasks": (Task("quick", ("fast",)), Task("lazy", ("slow",), 4))}, "tasks run"),
        (
            {"tasks": (Task("quick", ("fast", "last")), Task("lazy", ("slow",), 3))},
            "runs every 0.003",
        ),
        (
            {"tasks": (Task("quick", ("fast", "last")), Task("lazy", ("slow",), 4, phase=4))},
            "phase 4",
        ),
    ],
)
def test_wrong_wiring_is_refused(change, words):
    arguments = {
        "name": "bad",
        "base_period_s": 1e-3,
        "blocks": {
            "fast": summing(1e-3),
            "slow": summing(4e-3, "slow"),
            "last": summing(1e-3, "last"),
        },
        "tasks": (Task("quick", ("fast", "last")), Task("lazy", ("slow",), 4)),
        "wires": {"slow.x": "fast.y", "last.x": "slow.y"},
        "inputs": {"x": ("fast.x",)},
        "outputs": {"y": "last.y"},
    } | change
    with pytest.raises(ValueError, match=words):
        System(**arguments)


def test_order_inside_a_task_is_checked():
    with pytest.raises(ValueError, match="must run before"):
        System(
            "bad",
            1e-3,
            {"a": summing(1e-3), "b": summing(1e-3, "b")},
            (Task("t", ("a", "b")),),
            wires={"a.x": "b.y"},
            inputs={"x": ("b.x",)},
            outputs={},
        )


def test_one_block_may_stand_behind_two_instances():
    block = summing(1e-3, gain=True)
    system = System(
        "pairs",
        1e-3,
        {"left": block, "right": block},
        (Task("go", ("left", "right")),),
        wires={"right.x": "left.y"},
        inputs={"x": ("left.x",)},
        outputs={"y": "right.y"},
    )
    assert len(system.kinds) == 1
    runner = compile_system(system, "f64").task("go")
    assert runner.prepare({"right": {"gain": 2.0}}) == 0
    simulator = system.simulator({"right": {"gain": 2.0}})
    for x in (1.0, -3.0, 2.5):
        assert runner.step(x=x)["y"] == simulator.step("go", x=x)["y"]
    assert runner.prepare({"right": {"gain": 5.0}}) == 2
    assert runner.prepare({"left": {"gain": float("nan")}}) == 1


def test_blocks_that_differ_in_words_only_are_emitted_once():
    device = load_device("elbow_drive")
    blocks = device.system.blocks
    assert blocks["motor_rate"] is blocks["load_rate"] is blocks["set_rate"]
    assert blocks["encoder_motor"] is blocks["encoder_load"]
    assert {"rate", "encoder"} <= {b.name for b in device.system.kinds}
    files = render_device(device, ["f32"])[0].files
    assert "esea_elbow_drive_rate.c" in files
    assert not [n for n in files if "load_rate" in n or "encoder_motor" in n]


def test_blocks_that_differ_in_a_number_are_not():
    text = load_device("elbow_drive").toml()
    assert "load_velocity_Hz = { value = 30.0" in text
    other = text.replace("load_velocity_Hz = { value = 30.0", "load_velocity_Hz = { value = 25.0")
    blocks = parse_device(other, "own.toml").system.blocks
    assert blocks["motor_rate"] is not blocks["load_rate"]
    assert blocks["motor_rate"] is blocks["set_rate"]
