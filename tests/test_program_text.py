"""Programs as text: a small one of every statement, its lines and its loops' counts by hand."""

from __future__ import annotations

import casadi as ca
import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.program_c import EmittedProgram, LoopBound, emit_program, loop_lines, loop_totals
from esea_gen.emit.program_render import program_system, render_program
from esea_gen.emit.walker import walk
from esea_gen.errors import UserError
from esea_gen.language.builder import Builder, declare_ports
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.program import Program
from esea_gen.language.statements import ProgramError


def zero():
    return ca.SX(0)


def same(x):
    return x


def define(b: Builder, **more) -> Program:
    inputs = (Port("x", -1.0, 1.0, "in", 2),)
    outputs = (Port("y", -1.0, 1.0, "out", 3),)
    state = (Port("m", -1.0, 1.0, "memory", init=0.5),)
    more = {"inputs": inputs, "outputs": outputs, "state": state} | more
    for region, group in (("in", "inputs"), ("out", "outputs"), ("state", "state")):
        declare_ports(b, region, [p for p in more[group] if f"{region}.{p.name}" not in b.memory])
    return Program.define("small", "Small", period_s=0.1, builder=b, **more)


def every_statement() -> Program:
    b = Builder()
    numbers = b.table("numbers", [0.25, 0.5, 1.0], "numbers")
    order = b.index_table("order", [2, 0, 1], "an order")
    far = b.index_table("far", [3, 256], "needs two bytes")
    b.table("unread", [1.0], "nobody reads it")
    work = b.array("work", 9, "work")
    place, hand = b.array("place", 1, "work"), b.array("hand", 1, "local")
    inputs, outputs = b.array("in.x", 2, "in"), b.array("out.y", 3, "out")
    memory = b.array("state.m", 1, "state")
    with b.part("inner", "row", "most", comment="One row.") as (row, most):
        at = b.index("at")
        b.set(at, 3 * row + 1)
        with b.loop(row, most, most=3) as i:
            b.call("copy", [numbers[order.at(i)]], [work[at + 2 * i - 4]], same)
            b.exit_if(work[0])
    with b.part("step"):
        b.call("zero", [], [work[4]], zero, note="Starts at nothing.")
        with b.loop(0, 2, unroll=True, name="k") as k:
            b.invoke("inner", k, k + 1)
            with b.loop(k, 3, most=3, name="j") as j:
                b.call("take", [inputs[1]], [hand[0]], same)
                b.call("give", [hand[0]], [outputs[j]], same)
        with b.when((far.at(0), "<", order.at(1) + 2)):
            b.call("zero", [], [memory[0]], zero)
        with b.otherwise():
            b.call("take", [work[0:2:3]], [work[3:2]], lambda x: x)
        with b.when(memory[0]), b.loop(0, far.at(0), most=3, total=2) as i:
            b.call("zero", [], [work[place.at(0) + i]], zero)
    return define(b)


@pytest.fixture(scope="module")
def printed() -> EmittedProgram:
    return emit_program(every_statement(), FORMATS["f64"])


INNER = """\
    at_1 = 3 * row + 1;
    for (int i2_1 = row; i2_1 < most; ++i2_1) { /* at most 2 passes in a step */
        {
            const double a0_0 = small_numbers[(int)small_order[i2_1]];
            state->work[at_1 + 2 * i2_1 - 4] = a0_0;
        }
        if (state->work[0] != 0.0)
            break;
    }"""
STEP = """\
    /* Starts at nothing. */
    state->work[4] = 0.0;
    small_inner(state, 0, 1);
    for (int j4_2 = 0; j4_2 < 3; ++j4_2) { /* at most 3 passes in a step */
        {
            const double a0_0 = in->x[1];
            hand[0] = a0_0;
        }
        {
            const double a0_0 = hand[0];
            out->y[j4_2] = a0_0;
        }
    }
    small_inner(state, 1, 2);
    for (int j4_3 = 1; j4_3 < 3; ++j4_3) { /* at most 2 passes in a step */
        {
            const double a0_0 = in->x[1];
            hand[0] = a0_0;
        }
        {
            const double a0_0 = hand[0];
            out->y[j4_3] = a0_0;
        }
    }
    if (3 < 2) {
        state->m = 0.0;
    } else {
        {
            const double a0_0 = state->work[0];
            const double a0_1 = state->work[3];
            state->work[3] = a0_0;
            state->work[4] = a0_1;
        }
    }
    if (state->m != 0.0) {
        for (int i5_4 = 0; i5_4 < 3; ++i5_4) { /* at most 2 passes in a step */
            state->work[i5_4 + (int)state->place] = 0.0;
        }
    }"""


def test_lines_of_every_statement(printed):
    inner, step = printed.parts
    assert "\n".join(inner.lines) == INNER
    assert "\n".join(step.lines) == STEP


def test_what_a_part_takes_and_holds(printed):
    inner, step = printed.parts
    assert (inner.name, inner.params, inner.comment) == ("inner", ("row", "most"), "One row.")
    assert (inner.pointers, inner.indices, inner.locals) == (("state",), ("at_1",), ())
    assert (step.name, step.params, step.comment) == ("step", (), "")
    assert (step.pointers, step.indices) == (("state", "in", "out"), ())
    assert [m.name for m in step.locals] == ["hand"]


def asks_in(write, *params: str) -> tuple[str, ...]:
    """Pointers of a part that holds what is written, where the step passes numbers to it."""
    b = Builder()
    given = {n: b.array(n, 3, "work") for n in ("work", "place")}
    given |= {"hand": b.array("hand", 4, "local"), "order": b.index_table("order", [2, 0, 1], "")}
    ports = (("in", "in.x", 2), ("out", "out.y", 3), ("state", "state.m", 1))
    given |= {region: b.array(name, size, region) for region, name, size in ports}
    with b.part("takes", "n") as (n,):
        b.call("zero", [], [given["hand"][n]], zero)
    with b.part("asks"):
        write(b, **given)
    with b.part("step"):
        b.invoke("asks")
    *_, asks, _ = emit_program(define(b), FORMATS["f64"]).parts
    assert asks.name == "asks"
    return asks.pointers


def in_loop(b: Builder, hand, start, stop) -> None:
    with b.loop(start, stop, most=3) as i:
        b.call("zero", [], [hand[i]], zero)


def on_way(b: Builder, hand, flag) -> None:
    with b.when(flag):
        b.call("zero", [], [hand[0]], zero)


PLACED = {
    "an argument": lambda b, at, hand, **_: b.call("copy", [hand[at]], [hand[0]], same),
    "the second argument": lambda b, at, hand, **_: b.call(
        "sum", [hand[1], hand[at]], [hand[0]], lambda x, y: x + y
    ),
    "a result": lambda b, at, hand, **_: b.call("zero", [], [hand[at]], zero),
    "a start": lambda b, at, hand, **_: in_loop(b, hand, at, 2),
    "a stop": lambda b, at, hand, **_: in_loop(b, hand, 0, at),
    "a value": lambda b, at, **_: b.set(b.index("k"), at),
    "a parameter": lambda b, at, **_: b.invoke("takes", at),
    "a left side": lambda b, at, hand, **_: on_way(b, hand, (at, "<", 1)),
    "a right side": lambda b, at, hand, **_: on_way(b, hand, (1, "==", at)),
}


@pytest.mark.parametrize("where", PLACED)
def test_a_part_that_reads_a_place_in_working_memory_alone_takes_the_state(where):
    write = PLACED[where]
    assert asks_in(lambda b, place, **g: write(b, at=place.at(1), place=place, **g)) == ("state",)
    assert asks_in(
        lambda b, place, order, **g: write(b, at=2 * order.at(place.at(1)), place=place, **g)
    ) == ("state",)
    assert asks_in(lambda b, order, **g: write(b, at=order.at(1), **g)) == ()


def test_a_part_takes_what_its_flags_and_its_calls_are_in():
    def leave(b, flag):
        with b.loop(0, 2):
            b.exit_if(flag)

    regions = {"work": "state", "state": "state", "in": "in", "out": "out"}
    for name, pointer in regions.items():
        assert asks_in(lambda b, n=name, **g: on_way(b, g["hand"], g[n][0])) == (pointer,)
        assert asks_in(lambda b, n=name, **g: leave(b, g[n][0])) == (pointer,)
        assert asks_in(lambda b, n=name, **g: b.call("copy", [g[n][0]], [g["hand"][0]], same)) == (
            pointer,
        )
    assert asks_in(lambda b, **g: b.call("copy", [g["in"][0]], [g["out"][0]], same)) == (
        "in",
        "out",
    )
    assert asks_in(
        lambda b, **g: b.call("copy", [g["in"][0]], [g["work"][0]], same)
    ) == ("state", "in")  # fmt: skip


def test_flags_are_the_elements_that_they_name():
    b = Builder()
    work, place = b.array("work", 9, "work"), b.array("place", 3, "work")
    with b.part("step"), b.loop(2, 5) as i:
        with b.when(work[i + 1]):
            b.call("zero", [], [work[3:2:4]], lambda: ca.SX.zeros(2))
        b.exit_if(place[2])
    (step,) = emit_program(define(b), FORMATS["f32"]).parts
    assert step.lines[1:-1] == (
        "        if (state->work[i1_1 + 1] != 0.0f) {",
        "            {",
        "                state->work[3] = 0.0f;",
        "                state->work[7] = 0.0f;",
        "            }",
        "        }",
        "        if (state->place[2] != 0.0f)",
        "            break;",
    )


def test_a_loop_of_no_passes_is_printed_and_what_is_in_it_never_runs():
    b = Builder()
    work = b.array("work", 9, "work")
    with b.part("step"), b.loop(3, 3), b.loop(0, 4) as i:
        b.call("zero", [], [work[i]], zero)
    made = emit_program(define(b), FORMATS["f64"])
    assert [(n.entries, n.passes) for n in made.loops] == [(1, 0), (0, 0)]
    assert made.parts[0].lines[1].endswith("/* at most 0 passes in a step */")


def test_unrolled_loops_follow_those_around_and_tables():
    b = Builder()
    work, order = b.array("work", 9, "work"), b.index_table("order", [2, 0, 1], "an order")
    with b.part("step"), b.loop(0, 3, unroll=True) as k:
        with b.loop(k, 2, most=2, unroll=True) as i:
            b.call("zero", [], [work[4 * k + i]], zero)
        with b.loop(0, order.at(k), most=2, unroll=True) as i:
            b.call("zero", [], [work[5 + i]], zero)
    (step,) = emit_program(define(b), FORMATS["f64"]).parts
    # 0 and 1, then the table's 2; 4 + 1, then its 0; none, then its 1.
    assert step.lines == tuple(f"    state->work[{k}] = 0.0;" for k in (0, 1, 5, 6, 5, 5))


def test_tables_that_are_read_and_no_others(printed):
    assert printed.tables == (
        ("double", "small_numbers", ("0.25", "0.5", "1.0")),
        ("uint8_t", "small_order", ("2u", "0u", "1u")),
    )
    assert emit_program(every_statement(), FORMATS["f32"]).tables[0] == (
        "float", "small_numbers", ("0.25f", "0.5f", "1.0f"),
    )  # fmt: skip


def test_a_table_of_larger_numbers_has_two_bytes():
    for most, c_type in ((255, "uint8_t"), (256, "uint16_t")):
        b = Builder()
        far = b.index_table("far", [0, most], "far")
        work = b.array("work", 300, "work")
        with b.part("step"), b.loop(0, 2) as i:
            b.call("zero", [], [work[far.at(i)]], zero)
        assert emit_program(define(b), FORMATS["f64"]).tables == (
            (c_type, "small_far", ("0u", f"{most}u")),
        )


def test_how_often_loops_are_entered_and_passed(printed):
    # Rows 0 and 1 once each, a pass a row; three and two of y; and at most the stated two of three.
    assert printed.loops == (
        LoopBound("inner", "i2_1", 2, 2),
        LoopBound("step", "j4_2", 1, 3),
        LoopBound("step", "j4_3", 1, 2),
        LoopBound("step", "i5_4", 1, 2),
    )
    assert loop_totals(every_statement()) == {
        ("i2", ()): (2, 2),
        ("j4", (("k3", 0),)): (1, 3),
        ("j4", (("k3", 1),)): (1, 2),
        ("i5", ()): (1, 2),
    }


def triangle(most: int | None = None) -> Program:
    """Rows of 0, 1, 2 and 3, each entered twice, and a row whose length only the step knows."""
    b = Builder()
    work, place = b.array("work", 9, "work"), b.array("place", 1, "work")
    with b.part("row", "n") as (n,), b.loop(0, n, most=5) as i:
        b.call("zero", [], [work[i]], zero)
    with b.part("step"):
        with b.loop(0, 4, name="k") as k, b.loop(0, 2, name="t"):
            b.invoke("row", k)
        with b.loop(0, place.at(0), most=7, name="u"):
            b.invoke("row", place.at(0))
        first = place.at(0)
        with b.loop(first, first + 2, most=2, name="v") as v, b.loop(0, v, most=3, name="w") as w:
            b.call("zero", [], [work[w]], zero)
    return define(b)


def test_a_triangle_counts_as_one_and_what_is_not_known_as_its_most():
    totals = {var: n for (var, _), n in loop_totals(triangle()).items()}
    # Twice 0 + 1 + 2 + 3; and 7 rows of no known length, of at most 5.
    assert totals == {"i1": (8 + 7, 12 + 35), "k2": (1, 4), "t3": (4, 8), "u4": (1, 7),
                      "v5": (1, 2), "w6": (2, 6)}  # fmt: skip


def test_loops_of_both_ways_count_and_those_that_start_elsewhere():
    b = Builder()
    work, flag = b.array("work", 9, "work"), b.array("flag", 1, "work")
    with b.part("step"):
        with b.loop(2, 5, name="k") as k, b.when(flag[0]), b.loop(1, k, most=9, name="up") as i:
            b.call("zero", [], [work[i]], zero)
        with b.when(flag[0]):
            b.call("zero", [], [work[0]], zero)
        with b.otherwise(), b.loop(3, 7, name="other") as j:
            b.call("zero", [], [work[j]], zero)
        with b.loop(1, 4, name="outer") as k:
            with b.when(flag[0]):
                b.call("zero", [], [work[0]], zero)
            with b.otherwise(), b.loop(k, 6, most=9, name="down") as j:
                b.call("zero", [], [work[j]], zero)
    totals = {var: n for (var, _), n in loop_totals(define(b)).items()}
    # 1 + 2 + 3 of k = 2, 3, 4; 5 + 4 + 3 of k = 1, 2, 3.
    assert totals == {"k1": (1, 3), "up2": (3, 6), "other3": (1, 4), "outer4": (1, 3),
                      "down5": (3, 12)}  # fmt: skip


def test_a_loop_from_where_only_the_step_knows_counts_at_each_entry():
    b = Builder()
    work, place = b.array("work", 9, "work"), b.array("place", 1, "work")
    first = place.at(0)
    with b.part("step"), b.loop(0, 3), b.loop(first, first + 2, most=2), b.loop(0, 4) as i:
        b.call("zero", [], [work[i]], zero)
    assert list(loop_totals(define(b)).values()) == [(1, 3), (3, 6), (6, 24)]


def test_prepare_init_and_words_are_printed():
    b = Builder()
    word = b.array("out.status", 1, "out")
    x, gain = b.array("in.x", 2, "in"), b.array("coeffs.gain", 1, "coeffs")
    with b.part("step"):
        b.call("tell", [x[0], gain[0]], [word[0]], lambda x, g: flag_word([x > g]))
    coefficients = (Port("gain", 0.0, 2.0, "gain"),)
    outputs = (Port("status", 0, 1, "told", flags=(Flag("MORE", "more"),)),)
    program = define(
        b,
        outputs=outputs,
        tunables=(Tunable("half", 0.5, 0.25, 1.0, "half"),),
        coefficients=coefficients,
        prepare=lambda t: {"gain": 2 * t.half},
    )
    made = emit_program(program, FORMATS["f64"])
    assert next(s.expression for s in made.prepare.statements) == "params->half"
    assert made.init.results[-1] == ("0.5",)
    (step,) = made.parts
    assert step.pointers == ("coeffs", "in", "out")
    text = "\n".join(step.lines)
    assert "const double a0_0 = in->x[0];" in text
    assert "const double a1_0 = coeffs->gain;" in text
    assert "    out->status = (uint32_t)(" in text
    assert emit_program(every_statement(), FORMATS["f64"]).prepare is None


def test_lines_of_loops_in_a_text(printed):
    text = "\n".join([*printed.parts[0].lines, *printed.parts[1].lines])
    found = loop_lines(text, printed.loops)
    assert found["i2_1"] == (2, 9)
    lines = text.splitlines()
    for first, last in found.values():
        pad = lines[first - 1].split("for")[0]
        assert lines[last - 1] == pad + "}"
        assert sum(line == pad + "}" for line in lines[first : last - 1]) == 0
    with pytest.raises(ProgramError, match="loop other stands 0 times"):
        loop_lines(text, (LoopBound("step", "other", 1, 1),))
    with pytest.raises(ProgramError, match="loop i2_1 stands 2 times"):
        loop_lines(text + "\n" + text, printed.loops)


def test_a_loop_ends_at_its_own_bracket():
    text = """\
        }
    for (int a_1 = 0; a_1 < 2; ++a_1) {
    }
    for (int b_2 = 0; b_2 < 2; ++b_2) {
        for (int b_21 = 0; b_21 < 2; ++b_21) {
            }
        }
    }
    }"""
    loops = [LoopBound("step", n, 1, 1) for n in ("b_2", "b_21", "a_1")]
    assert loop_lines(text, loops) == {"a_1": (2, 3), "b_2": (4, 8), "b_21": (5, 7)}


def test_what_cannot_be_printed_is_refused():
    with pytest.raises(UserError, match="program small cannot be emitted in q31") as told:
        emit_program(every_statement(), FORMATS["q31"])
    assert "Choose from f64, f32." in str(told.value)
    b = Builder()
    place = b.array("place", 1, "work")
    with b.part("step"), b.loop(0, place.at(0), most=3, unroll=True):
        b.call("zero", [], [place[0]], zero)
    with pytest.raises(ProgramError, match="cannot be unrolled: its range varies"):
        emit_program(define(b), FORMATS["f64"])


def test_a_kernel_may_be_printed_in_anothers_place():
    b = Builder()
    work = b.array("work", 2, "work")
    with b.part("step"):
        b.call("copy", [work[0]], [work[1]], same)
    program = define(b)
    call = program.parts["step"].body[0]
    a = ca.SX.sym("a")
    other = walk(ca.Function("copy", [a], [a * 3]))
    (part,) = emit_program(program, FORMATS["f64"], {id(call.kernel): other}).parts
    assert "state->work[1] = " in "\n".join(part.lines)
    assert "3.0 * a0_0" in "\n".join(part.lines)


def test_a_program_alone_is_a_system_whose_every_port_is_outside():
    program = every_statement()
    system = program_system(program, "mine")
    assert (system.name, system.base_period_s, dict(system.blocks)) == (
        "mine", 0.1, {"small": program},
    )  # fmt: skip
    (task,) = system.tasks
    assert (task.name, task.blocks, task.every) == ("control", ("small",), 1)
    for outside, port in ((system.inputs, "x"), (system.outputs, "y")):
        (one,) = outside
        (signal,) = one.signals
        assert (one.name, signal.instance, signal.port) == (port, "small", port)
    renderer = render_program(program, "f32")
    assert (renderer.system.name, renderer.fmt) == ("program", FORMATS["f32"])
    told = renderer.env.globals
    assert [told[k] for k in ("content_hash", "command", "title")] == ["-", "-", "Small"]
    renderer.render = lambda template, **context: template
    made = renderer.files()
    own = {"esea_program.c", "esea_program.h", "esea_program_real.h", "esea_program_small.c"}
    assert set(made) == own | {p.name for p in FORMATS["f32"].sources()}
    assert made["esea_program_small.c"] == "device/esea_program.c.j2"
    assert "esea_f32_sqrt" in made["esea_f32.c"]
