"""Programs: rejected input, results, and the same bits in Python and in C."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.emit.program_c import loop_lines, loop_totals
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.builder import Builder, declare_ports, guard_inputs
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.program import Program
from esea_gen.language.statements import ProgramError
from tests.rendered_program import render_program


def bubble(n: int, unroll: bool) -> Program:
    """Sorts its input and counts the exchanges; leaves early when nothing was exchanged."""
    b = Builder()
    inputs = (Port("x", -100.0, 100.0, "numbers", n, on_invalid=0.0),)
    flags = (Flag("INVALID", "an input was replaced", True), Flag("MOVED", "something moved"))
    outputs = (
        Port("y", -100.0, 100.0, "sorted", n),
        Port("exchanges", 0.0, 1e4, "how many"),
        Port("total", 0.0, 1e6, "exchanges so far"),
        Port("status", 0, 3, "flags", flags=flags),
    )
    state = (Port("so_far", 0.0, 1e6, "exchanges of all steps", init=2.0),)
    tunables = (Tunable("sense", 1.0, -1.0, 1.0, "1 rising, -1 falling"),)
    coefficients = (Port("way", -1.0, 1.0, "sign"),)
    for region, ports in (("coeffs", coefficients), ("state", state), ("in", inputs)):
        declare_ports(b, region, ports)
    out = declare_ports(b, "out", outputs)
    so_far, way = b.memory["state.so_far"], b.memory["coeffs.way"]
    ok = b.array("ok", 1, "local")
    work = b.array("sorting", n)
    moved = b.array("moved", 1)
    one = b.array("one", 1, "local")

    def exchange(a, c, way, moved):
        swap = way * (a - c) > 0
        return ca.if_else(swap, c, a), ca.if_else(swap, a, c), moved + ca.if_else(swap, 1, 0)

    with b.part("pass", "last", comment="One pass.") as (last,):
        b.call("none", [], [moved[0]], lambda: ca.SX(0))
        with b.loop(0, last, most=n - 1) as i:
            b.call(
                "exchange",
                [work[i], work[i + 1], way[0], moved[0]],
                [work[i], work[i + 1], moved[0]],
                exchange,
            )
    with b.part("step"):
        held = guard_inputs(b, inputs, ok)
        with b.loop(0, n, unroll=unroll) as i:
            b.call("copy", [held["x"][i]], [work[i]], lambda x: x)
        b.call("none", [], [out["exchanges"][0]], lambda: ca.SX(0))
        with b.loop(0, n - 1) as k:
            b.invoke("pass", n - 1 - k)
            b.call(
                "sum",
                [out["exchanges"][0], moved[0]],
                [out["exchanges"][0], one[0]],
                lambda t, m: (t + m, ca.logic_not(m > 0)),
            )
            b.exit_if(one[0])
        b.run(
            ca.Function("copy_all", [ca.SX.sym("x", n)], [ca.SX.sym("x", n)])
            if False
            else _identity(n),
            [work[:]],
            [out["y"][:]],
        )
        b.call(
            "add",
            [so_far[0], out["exchanges"][0]],
            [so_far[0], out["total"][0]],
            lambda a, e: (ca.fmin(a + e, 1e6), ca.fmin(a + e, 1e6)),
        )
        b.call(
            "status",
            [ok[0], out["exchanges"][0]],
            [out["status"][0]],
            lambda ok, e: flag_word([ca.logic_not(ok), e > 0]),
        )
    return Program.define(
        "bubble",
        "Sorts",
        period_s=0.01,
        builder=b,
        state=state,
        inputs=inputs,
        outputs=outputs,
        tunables=tunables,
        coefficients=coefficients,
        prepare=lambda t: {"way": ca.sign(t.sense)},
    )


def _identity(n: int) -> ca.Function:
    x = ca.SX.sym("x", n)
    return ca.Function("copy_all", [x], [x])


def library(program: Program, real: str):
    renderer = render_program(program, real)
    return HostLibrary(renderer.system, renderer, ("-Wall", "-Wextra", "-Werror", "-pedantic"))


@pytest.fixture(scope="module")
def sorters():
    programs = {u: bubble(7, u) for u in (False, True)}
    made = {
        (u, r): library(p, r).block("bubble") for u, p in programs.items() for r in ("f64", "f32")
    }
    return programs, made


@settings(max_examples=40)
@given(st.lists(st.floats(-99, 99, width=32), min_size=7, max_size=7), st.sampled_from([1.0, -0.5]))
def test_executor_and_c_sort_alike(sorters, values, sense):
    programs, made = sorters
    expected = np.sort(values) if sense > 0 else np.sort(values)[::-1]
    inversions = sum(
        (values[i] > values[j]) if sense > 0 else (values[i] < values[j])
        for i in range(7)
        for j in range(i + 1, 7)
    )
    for unroll, program in programs.items():
        simulator = program.simulator({"sense": sense})
        for _ in range(2):
            out = simulator.step(x=np.array(values))
        assert np.array_equal(out["y"], expected)
        assert out["exchanges"] == inversions
        assert out["total"] == 2 + 2 * inversions
        assert out["status"] == (2 if inversions else 0)
        for real in ("f64", "f32"):
            runner = made[unroll, real]
            runner.prepare({"sense": sense})
            y, states = runner.run({"x": np.array([values, values])})
            assert np.array_equal(y["y"][1], expected)
            assert y["total"][1] == out["total"]
            assert y["status"][1] == out["status"]
            if real == "f64":
                for name, value in simulator.state.items():
                    assert np.array_equal(value, np.ravel(states[name][1]))


def test_the_guard_and_the_counters(sorters):
    _, made = sorters
    for runner in made.values():
        runner.prepare({"sense": 1.0})
        x = np.arange(7.0)
        x[3] = np.nan
        y, states = runner.run({"x": np.array([x, np.arange(7.0)])})
        assert list(y["status"]) == [1, 0]
        assert np.array_equal(y["y"][0], np.zeros(7))
        assert list(states["n_invalid"]) == [1, 1]


def test_loops_carry_their_totals(sorters):
    programs, _ = sorters
    totals = loop_totals(programs[False])
    # Passes over 6, 5, ... 1 pairs; six of them; one copy loop of seven.
    assert sorted(totals.values()) == [(1, 6), (1, 7), (6, 21)]
    renderer = render_program(programs[False], "f64")
    text = renderer.files()["esea_bubble_alone_bubble.c"]
    loops = renderer.emitted["bubble"].loops
    lines = loop_lines(text, loops)
    for loop in loops:
        first, last = lines[loop.var]
        assert f"for (int {loop.var} = " in text.splitlines()[first - 1]
        assert text.splitlines()[last - 1].strip() == "}"


def test_programs_that_are_not_well_formed():
    b = Builder()
    a = b.array("a", 3)
    with pytest.raises(ProgramError, match="taken"):
        b.array("a", 3)
    with b.part("step"):
        with pytest.raises(ProgramError, match="bound"), b.loop(0, b.index("n")):
            pass
        with pytest.raises(ProgramError, match="takes"):
            b.run(_identity(2), [a[:]], [a[0:2]])
        with pytest.raises(ProgramError, match="no part"):
            b.invoke("elsewhere")
        with pytest.raises(ProgramError, match="must follow"), b.otherwise():
            pass
        b.run(_identity(2), [a[2:2]], [a[0:2]])
    program = _define(b)
    with pytest.raises(ProgramError, match=r"a\[2\.\.3\] of 3"):
        program.simulator().step(x=0.0)


def _define(b: Builder) -> Program:
    x, y = (Port("x", -1.0, 1.0, "in"),), (Port("y", -1.0, 1.0, "out"),)
    declare_ports(b, "in", x)
    declare_ports(b, "out", y)
    return Program.define("p", "p", period_s=0.1, builder=b, inputs=x, outputs=y)


def test_a_loop_that_outruns_its_bound_is_caught():
    b = Builder()
    count = b.index_table("count", [5])
    a = b.array("a", 9)
    with b.part("step"), b.loop(0, count.at(0), most=4) as i:
        b.call("zero", [], [a[i]], lambda: ca.SX(0))
    program = _define(b)
    with pytest.raises(ProgramError, match="5 passes, bound 4"):
        program.simulator().step(x=0.0)
