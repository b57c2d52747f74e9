"""The body of a Program, statement by statement: what each does, by small sums done by hand."""

from __future__ import annotations

import re
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.formats.f64 import casadi_c
from esea_gen.language.builder import Builder, declare_ports, guard_inputs
from esea_gen.language.ports import Port, Tunable, threshold
from esea_gen.language.program import Program
from esea_gen.language.statements import (
    EPSILON,
    Call,
    Exit,
    For,
    Invoke,
    Ix,
    Memory,
    ProgramError,
    Ref,
    SetIndex,
    When,
    walk_statements,
)

X, Y = Port("x", -9.0, 9.0, "in", 3), Port("y", -1e4, 1e4, "out", 4)


def body(**ports) -> Builder:
    """A builder with x of three elements and y of four."""
    b = Builder()
    declare_ports(b, "in", ports.get("inputs", (X,)))
    declare_ports(b, "out", (Y,))
    declare_ports(b, "state", ports.get("state", ()))
    return b


def made(b: Builder, **more) -> Program:
    arguments = {"inputs": (X,), "outputs": (Y,)} | more
    return Program.define("p", "made up", period_s=0.1, builder=b, **arguments)


def put(b: Builder, place, value: float = 0.0, plus=()):
    """Put a number, and what is read, into a place."""
    b.call(f"put{value:g}", [*plus], [place], lambda *v: sum(v, ca.SX(value)))


def y_of(b: Builder, *x: float) -> list[float]:
    return made(b).simulator().step(x=np.array(x or (1.0, 2.0, 3.0)))["y"].tolist()


# -- whole numbers that index ----------------------------------------------------------------------


def test_entries_of_tables_in_index_arithmetic():
    i, table = Ix(0, ((1, "i"),)), Memory("t", 3, "index", values=(5, 7, 11))
    tables = {"t": table.values}
    x = 3 * table.at(i + 1) - 2 * i + 4
    assert x.value({"i": 1}, tables) == 3 * 11 - 2 + 4
    assert (x * 2).value({"i": 0}, tables) == 2 * (3 * 7 + 4)
    assert (1 - x).value({"i": 0}, tables) == 1 - (3 * 7 + 4)
    # A place inside a place.
    nested = table.at(table.at(i) - 5)
    assert nested.value({"i": 0}, tables) == 5
    # What is known becomes a number: the index, then the entry; another array stays to be read.
    assert x.fold({"i": 1}, tables) == Ix(35)
    assert x.fold({"i": 1}, {}) == Ix(2, (), ((3, "t", Ix(2)),))
    assert x.fold({}, tables) == x
    assert (x + Ix(0, ((5, "j"),))).fold({"i": 0}, tables) == Ix(25, ((5, "j"),))
    # What cancels is gone.
    assert i - i == Ix(0)
    assert (i + 2) - (i * 3) == Ix(2, ((-2, "i"),))
    assert Ix.of(x) is x
    assert Ix.of(4) == Ix(4)
    assert 2 + i == i + 2 == Ix(2, ((1, "i"),))


def test_slices_are_a_start_a_number_of_elements_and_a_stride():
    m = Memory("a", 7, "work")
    i = Ix(0, ((1, "i"),))
    assert m[:] == Ref("a", Ix(0), 7, 1)
    assert m[4] == Ref("a", Ix(4), 1, 1)
    assert m[i] == Ref("a", i, 1, 1)
    assert m[2:3] == Ref("a", Ix(2), 3, 1)
    assert m[i + 1 : 2 : 3] == Ref("a", i + 1, 2, 3)
    assert m[0:4] == m[0:4:1] == Ref("a", Ix(0), 4, 1)
    # From the start on is all of it only where no number is given either.
    with pytest.raises(TypeError):
        m[2:]
    with pytest.raises(TypeError):
        m[:2]
    assert m.at(2) == Ix(0, (), ((1, "a", Ix(2)),))


def test_every_statement_is_walked_in_its_order():
    call = [Call(ca.Function(f"f{k}", [], []), (), ()) for k in range(5)]
    exit_, put_ = Exit(Ref("a", Ix(0), 1)), SetIndex("n", Ix(1))
    way = When((Ix(0), "<", Ix(1)), [call[1], exit_], [call[2]])
    loop = For("i", Ix(0), Ix(2), Ix(2), [put_, way, call[3]])
    invoke = Invoke("other", ())
    assert list(walk_statements([call[0], loop, invoke, call[4]])) == [
        *(call[0], loop, put_, way, call[1], exit_, call[2], call[3], invoke, call[4])
    ]


# -- what the builder writes down ------------------------------------------------------------------


def test_arrays_and_tables():
    b = Builder()
    with pytest.raises(ProgramError, match="array a: the name is taken or the size 0 is below 1"):
        b.array("a", 0)
    halves = {"f64": np.finfo(float).eps / 2, "f32": float(np.finfo(np.float32).eps) / 2}
    assert halves == EPSILON
    assert b.array("a", 1) == Memory("a", 1, "work", "", None)
    assert b.array("l", 2, "local", "of a part") == Memory("l", 2, "local", "of a part", None)
    same = b.table("t", [1, 2.5, 3], "numbers")
    assert same == Memory(
        *("t", 3, "table", "numbers", {"f64": (1.0, 2.5, 3.0), "f32": (1.0, 2.5, 3.0)})
    )
    own = b.table("o", {"f64": [0.1], "f32": [0.125]})
    assert own.values == {"f64": (0.1,), "f32": (0.125,)}
    assert b.index_table("n", [3.0, 1], "places") == Memory("n", 2, "index", "places", (3, 1))
    assert list(b.memory) == ["a", "l", "t", "o", "n"]
    ports = declare_ports(b, "coeffs", (X, Y))
    assert ports == {
        **{"x": Memory("coeffs.x", 3, "coeffs", "in"), "y": Memory("coeffs.y", 4, "coeffs", "out")}
    }
    with pytest.raises(ProgramError, match=r"array coeffs\.x: the name is taken"):
        declare_ports(b, "coeffs", (X,))


def test_a_loop_goes_as_often_as_its_range_says():
    b = body()
    y, count = b.memory["out.y"], b.index_table("count", [3])
    with b.part("step"):
        for k, (start, stop, most) in enumerate(((0, 5, None), (2, 5, None), (4, 1, None))):
            put(b, y[k])
            with b.loop(start, stop, most, name=f"l{k}_"):
                put(b, y[k], 1.0, [y[k]])
        put(b, y[3])
        with b.loop(1, count.at(0) + 1, 3, total=3, name="counted") as i, b.loop(0, i, 3, total=6):
            put(b, y[3], 1.0, [y[3]])
    bounds = {s.var: s.most for s in walk_statements(b.parts["step"].body) if isinstance(s, For)}
    assert bounds == {"l0_1": Ix(5), "l1_2": Ix(3), "l2_3": Ix(0), "counted4": Ix(3), "i5": Ix(3)}
    simulator = made(b).simulator()
    for _ in range(2):  # totals are of one step
        assert simulator.step(x=np.zeros(3))["y"].tolist() == [5.0, 3.0, 0.0, 1.0 + 2.0 + 3.0]
    loops = [s for s in walk_statements(b.parts["step"].body) if isinstance(s, For)]
    assert [(s.unroll, s.total) for s in loops] == [*3 * [(False, None)], (False, 3), (False, 6)]
    assert simulator.passes == {"l0_1": 5, "l1_2": 3, "l2_3": 0, "counted4": 3, "i5": 3}


def test_passes_beyond_what_is_stated_are_told():
    for most, total, words in (
        (2, None, "loop i2: 3 passes, bound 2"),
        (3, 5, "loop i2: 6 passes in a step, stated 5"),
    ):
        b = body()
        with b.part("step"), b.loop(0, 4) as i, b.loop(0, i, most, total=total):
            put(b, b.memory["out.y"][0])
        with pytest.raises(ProgramError, match=words):
            y_of(b)


def test_an_exit_leaves_the_innermost_loop_at_once():
    b = body()
    y, x = b.memory["out.y"], b.memory["in.x"]
    with b.part("step"):
        put(b, y[0])
        put(b, y[1])
        with b.loop(0, 3) as i:
            with b.loop(0, 9):
                b.exit_if(x[i])
                put(b, y[0], 1.0, [y[0]])
                with b.when(x[2]):
                    b.exit_if(y[0])
            put(b, y[1], 1.0, [y[1]])
        put(b, y[2], 5.0)
        put(b, y[3], 6.0)
    # Where x is not 0 none, else all nine; the outer loop goes on.
    assert y_of(b, 1.0, 0.0, 0.0) == [18.0, 3.0, 5.0, 6.0]
    assert y_of(b, 0.0, -1.0, 0.0) == [18.0, 3.0, 5.0, 6.0]
    assert y_of(b, 0.0, 1.0, 0.5) == [1.0, 3.0, 5.0, 6.0]


def test_one_of_two_ways():
    b = body()
    y, x = b.memory["out.y"], b.memory["in.x"]
    with b.part("step"):
        for k in range(4):
            put(b, y[k])
        with b.loop(0, 4) as i:
            with b.when((i, "<", 2)):
                put(b, y[0], 1.0, [y[0]])
            with b.otherwise():
                put(b, y[0], 10.0, [y[0]])
            with b.when((i * 2 - 2, "==", i)):  # at 2 alone
                put(b, y[1], 1.0, [y[1]])
            with b.when((2, "<", i)):
                put(b, y[2], 1.0, [y[2]])
        with b.when(x[1]):
            put(b, y[3], 3.0)
        with b.otherwise():
            put(b, y[3], 4.0)
    assert y_of(b, 1.0, -2.0, 1.0) == [22.0, 1.0, 1.0, 3.0]
    assert y_of(b, 1.0, 0.0, 1.0) == [22.0, 1.0, 1.0, 4.0]


def test_parts_indices_and_work():
    b = body(state=(Port("kept", -9.0, 1e4, "kept", init=2.0),))
    y, x, kept = b.memory["out.y"], b.memory["in.x"], b.memory["state.kept"]
    order, place = b.index_table("order", [2, 0, 1]), b.array("place", 2, meaning="where")
    weights = b.table("weights", [100.0, 10.0, 1.0])
    own = b.array("own", 1, "local")
    with b.part("take", "from", "to", comment="Weighted.") as (source, target):
        b.call(
            "take",
            [x[order.at(source)], weights[target]],
            [y[target]],
            lambda v, w: v * w,
            "a note",
        )
    with b.part("step"):
        n = b.index("n")
        b.set(n, 2)
        with b.loop(0, 3) as i:
            b.invoke("take", i, n - i)
        b.set(n, n + 1)
        # A whole number that the step puts into a work array, and reads as an index.
        put(b, place[1], 2.0)
        b.call("copy", [x[place.at(1)]], [own[0]], lambda v: v)
        put(b, y[n], 7.0, [own[0], kept[0]])
        put(b, kept[0], 1.0, [kept[0]])
    program = made(b, state=(Port("kept", -9.0, 1e4, "kept", init=2.0),))
    assert b.parts["take"].params == ("from", "to")
    assert (b.parts["take"].comment, b.parts["step"].comment) == ("Weighted.", "")
    assert [s.note for s in walk_statements(b.parts["take"].body)] == ["a note"]
    assert program.index_tables == {"order": (2, 0, 1)}
    assert program.work == (place,)
    assert [p.name for p in program.carried] == ["kept"]
    work = program.state[-1]
    assert (work.name, work.low, work.high, work.size, work.meaning) == (
        *("place", -threshold(3e38), threshold(3e38), 2, "work: where"),
    )
    assert list(program.kernels) == ["k1_take", "k2_put2", "k3_copy", "k4_put7", "k5_put1"]
    s = program.simulator()
    # y[2] = x[2], y[1] = 10 x[0], y[0] = 100 x[1]; then x[2], what is kept, and 7.
    x_now = np.array([1.0, 2.0, 3.0])
    assert s.step(x=x_now)["y"].tolist() == [200.0, 10.0, 3.0, 3.0 + 2.0 + 7.0]
    assert s.step(x=-x_now)["y"].tolist() == [-200.0, -10.0, -3.0, -3.0 + 3.0 + 7.0]
    assert s.state["kept"].tolist() == [4.0]
    assert s.state["place"].tolist() == [0.0, 2.0]
    assert s.array("own").tolist() == [-3.0]
    s.array("own")[0] = 9.0  # a copy
    assert s.array("own").tolist() == [-3.0]
    s.reset()
    assert [v.tolist() for v in s.state.values()] == [[2.0], [0.0, 0.0]]
    for args in ((), (0,), (0, 1, 2)):
        with b.part("more"), pytest.raises(ProgramError, match=f"part take with {len(args)} para"):
            b.invoke("take", *args)


def test_places_outside_an_array_are_told():
    for place, words in (
        (lambda a, i: a[i + 1], r"a\[3\.\.3\] of 3"),
        (lambda a, i: a[i - 1], r"a\[-1\.\.-1\] of 3"),
        (lambda a, i: a[i:2:2], r"a\[1\.\.3\] of 3"),
    ):
        for reads in (True, False):
            b = body()
            a, y = b.array("a", 3), b.memory["out.y"]
            with b.part("step"), b.loop(0, 3) as i:
                ref = place(a, i)
                if reads:
                    b.call("read", [ref], [y[0]], lambda v: v[0])
                else:
                    b.call("write", [], [ref], lambda n=ref.length: ca.DM.zeros(n))
            with pytest.raises(ProgramError, match=words):
                y_of(b)


def test_kernels_read_all_and_then_write_by_their_strides():
    b = body()
    y, x = b.memory["out.y"], b.memory["in.x"]
    a = b.array("a", 6)
    with b.part("step"):
        with b.loop(0, 6) as i:
            put(b, a[i])
        b.call("copy", [x[:]], [a[1:3:2]], lambda v: v)  # 0 1 0 2 0 3
        b.call("turn", [a[1:3]], [a[0:3]], lambda v: v[::-1])  # 1 0 2 | over 2 0 1
        b.call("pair", [a[0:2:5], a[3]], [y[0:2], y[2:2]], lambda p, q: (p, ca.vertcat(q, 2 * q)))
    assert b.memory["a"].size == 6
    # a is 2 0 1 2 0 3.
    assert y_of(b) == [2.0, 3.0, 2.0, 4.0]


def test_kernels_are_one_for_equal_lengths_and_one_function():
    b = body()
    y, x = b.memory["out.y"], b.memory["in.x"]

    def double(v):
        return 2 * v

    with b.part("step"):
        b.call("f", [x[0]], [y[0]], double)
        b.call("f", [x[1]], [y[1]], double)
        b.call("f", [x[0:2]], [y[2:2]], double)
        b.call("g", [x[0]], [y[0]], double)
        b.call("f", [x[0]], [y[0]], lambda v: 3 * v)
    assert list(made(b).kernels) == ["k1_f", "k2_f", "k3_g", "k4_f"]
    assert y_of(b) == [3.0, 4.0, 2.0, 4.0]
    with b.part("more"):
        for args, results in (([x[0]], [y[0:2]]), ([x[0:2]], [y[0]]), ([], [y[0]])):
            kernel = ca.Function("one", [ca.SX.sym("v")], [ca.SX(1)])
            with pytest.raises(
                ProgramError, match=r"kernel one: takes \[1\] and gives \[1\], call"
            ):
                b.run(kernel, args, results)
        with pytest.raises(ProgramError, match="'otherwise' must follow 'when'"), b.otherwise():
            pass


def test_inputs_are_guarded_one_by_one():
    scalar = Port("w", 0.0, 5.0, "one", on_invalid=4.0)
    vector = Port("x", -9.0, 9.0, "three", 3, on_invalid=-1.0)
    b = body(inputs=(vector, scalar))
    y = b.memory["out.y"]
    ok = b.array("ok", 1, "local")
    with b.part("step"):
        held = guard_inputs(b, (vector, scalar), ok)
        b.call("copy", [held["x"][0:2], held["w"][0], ok[0]], [y[:]], ca.vertcat)
    assert {n: (m.name, m.size, m.region, m.meaning) for n, m in held.items()} == {
        "x": ("g_x", 3, "work", "guarded: three"),
        "w": ("g_w", 1, "work", "guarded: one"),
    }
    s = made(b, inputs=(vector, scalar)).simulator()
    for x, w, expected in (
        ([1, 2, 3], 5, [1, 2, 5, 1]),
        ([1, np.nan, 3], 5, [-1, -1, 5, 0]),
        ([1, 2, 3], -0.1, [1, 2, 4, 0]),
        ([1, 2, np.inf], 5.1, [-1, -1, 4, 0]),
        ([9, -9, 9], 0, [9, -9, 0, 1]),
    ):
        assert s.step(x=np.array(x, float), w=float(w))["y"].tolist() == expected


def broken(change) -> Program:
    b = body()
    y = b.memory["out.y"]
    b.table("t", [1.0])
    b.index_table("n", [1])
    with b.part("step"):
        put(b, y[0])
    change(b)
    return made(b)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda b: b.memory.pop("in.x"), "p: no array for port x"),
        (lambda b: b.memory.update({"in.x": Memory("in.x", 2, "in")}), "p: no array for port x"),
        (lambda b: b.memory.update({"out.y": Memory("out.y", 4, "in")}), "p: no array for port y"),
        (lambda b: b.parts.update(other=b.parts.pop("step")), "p: no part 'step'"),
        *(
            (lambda b, n=n: put_into(b, b.memory[n][0]), f"p: put0 writes to {n}")
            for n in ("in.x", "t", "n")
        ),
        (lambda b: put_into(b, Ref("gone", Ix(0), 1)), "p: no array gone"),
        (
            lambda b: put_into(b, b.memory["out.y"][0], [Ref("lost", Ix(0), 1)]),
            "p: no array lost",
        ),
    ],
)
def test_a_body_that_does_not_fit_its_ports_is_refused(change, words):
    with pytest.raises(ProgramError, match=words):
        broken(change)


def put_into(b: Builder, place: Ref, plus=()) -> None:
    with b.part("deep"), b.loop(0, 2), b.when((0, "<", 1)):
        put(b, place, 0.0, plus)


def test_a_program_has_a_period_and_its_ports_once():
    gain = Tunable("gain", 1.0, 0.0, 9.0, "made up")
    for more, words in (
        ({"period_s": 0.0}, "block p: period_s must be positive, got 0.0"),
        ({"inputs": (X, X)}, r"block p: a port name occurs twice in .'x', 'x'."),
        ({"outputs": (Y, Y)}, r"block p: a port name occurs twice in .'y', 'y'."),
        ({"state": (X, X)}, r"block p: a port name occurs twice in .'x', 'x'."),
        ({"coefficients": (Y, X, Y)}, r"block p: a port name occurs twice in .'y', 'x', 'y'."),
        ({"tunables": (gain, gain)}, r"block p: a port name occurs twice in .'gain', 'gain'."),
    ):
        with pytest.raises(ValueError, match=words):
            Program.define(
                "p",
                "made up",
                builder=body(),
                **{"period_s": 0.1, "inputs": (X,), "outputs": (Y,)} | more,
            )


def test_functions_that_nobody_else_keeps_are_kernels_of_their_own():
    b = body()
    y, x = b.memory["out.y"], b.memory["in.x"]
    with b.part("step"):
        put(b, y[0])
        for k in range(1, 20):
            b.call("add", [x[0], y[0]], [y[0]], lambda v, w, k=k: k * v + w)
    assert len(made(b).kernels) == 20
    assert y_of(b, 2.0, 0.0, 0.0)[0] == 2.0 * sum(range(1, 20))


def test_a_part_that_is_closed_is_written_to_no_more():
    b = body()
    y = b.memory["out.y"]
    with b.part("step"):
        put(b, y[0], 1.0)
        with b.part("inner", "to") as (to,):
            put(b, y[to], 5.0)
        put(b, y[1], 2.0)
        b.invoke("inner", 2)
        with b.loop(0, 2) as i, b.when((i, "==", 1)):
            b.invoke("inner", i + 2)
    with pytest.raises(IndexError):
        put(b, y[0], 3.0)
    assert [type(s) for s in b.parts["inner"].body] == [Call]
    assert [type(s) for s in b.parts["step"].body] == [Call, Call, Invoke, For]
    assert y_of(b) == [1.0, 2.0, 5.0, 5.0]


def test_index_variables_are_numbered_as_they_come():
    b = body()
    with b.part("step"):
        assert b.index("n") == Ix(0, ((1, "n_1"),))
        with b.loop(0, 2) as i:
            assert i == Ix(0, ((1, "i2"),))
            assert b.index("n") == Ix(0, ((1, "n_3"),))


def test_without_inputs_all_are_valid():
    b = body()
    y = b.memory["out.y"]
    ok = b.array("ok", 1, "local")
    with b.part("step"):
        assert guard_inputs(b, (), ok) == {}
        for k in range(4):
            b.call("copy", [ok[0]], [y[k]], lambda v: v)
    assert y_of(b) == [1.0] * 4


def test_casadis_own_c_is_that_of_a_programs_kernels():
    b = body()
    y, x = b.memory["out.y"], b.memory["in.x"]
    with b.part("step"):
        b.call("twice", [x[0]], [y[0]], lambda v: 2 * v)
        put(b, y[1], 3.0)
    tuned = {
        "tunables": (Tunable("gain", 1.0, 0.0, 9.0, "made up"),),
        "coefficients": (Port("c", -9.0, 9.0, "made up"),),
        "prepare": lambda t: {"c": 2 * t.gain},
    }
    fixed = made(b)
    declare_ports(b, "coeffs", tuned["coefficients"])
    other = made(b, **tuned)
    for program, verbs in ((fixed, []), (other, ["prepare"])):
        found = casadi_c(SimpleNamespace(name="small", kinds=[program]))
        stem = "esea_small_casadi"
        assert list(found) == [f"reference/{stem}.c", f"reference/{stem}.h"]
        text = found[f"reference/{stem}.h"]
        assert set(re.findall(rf"^int {stem}_p_(\w+)\(const", text, re.MULTILINE)) == {
            *("init", "k1_twice", "k2_put3", *verbs)
        }
        assert f"int {stem}_p_k1_twice(const" in found[f"reference/{stem}.c"]
