"""Kernels as nodes and as C: small ones whose every line is written by hand."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.checks import coefficient_checks, range_checks, vector_total
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.formats.floating import print_kernel
from esea_gen.emit.local_names import LocalNames, meanings, unused
from esea_gen.emit.printed import PrintedKernel, Statement, bare, comment, early_stores
from esea_gen.emit.walker import (
    Kernel,
    Node,
    StatusWord,
    UnsupportedOperationError,
    calls_first,
    fuse_selects,
    labelled_kernel,
    needed_nodes,
    prune,
    status_words,
    use_counts,
    walk,
)
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word, in_range, port_ok

X, Y, Z = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("z")
F32, F64 = FORMATS["f32"], FORMATS["f64"]


def kernel_of(*expressions, arguments=(X, Y, Z)) -> Kernel:
    return walk(ca.Function("f", list(arguments), list(expressions)))


def lines(kernel: Kernel, fmt=F64, labels=None, words=(), others=None) -> tuple[list[str], tuple]:
    """Statements of a printed kernel, the reads of x, y and z left out, and its results."""
    made = print_kernel(
        kernel, fmt, lambda a, e: ("xyz"[a], f"in->{'xyz'[a]}"), labels or {}, words, others
    )
    said = [f"{s.c_type} {s.name} = {s.expression}" for s in made.statements]
    reads = [f"{fmt.c_type} {c} = in->{c}" for c in "xyz"]
    return [s for s in said if s not in reads], made.results


# -- as C ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("expression", "said", "result"),
    [
        (X + Y, ["double v2 = x + y"], "v2"),
        (X - Y, ["double v2 = x - y"], "v2"),
        (X / Y, ["double v2 = x / y"], "v2"),
        (-X, ["double v1 = -x"], "v1"),
        (X**2, ["double v1 = x * x"], "v1"),
        (2 * X, ["double v1 = 2.0 * x"], "v1"),
        (1 / X, ["double v1 = 1.0 / x"], "v1"),
        (X * -0.3, ["double v2 = (-0.3) * x"], "v2"),
        (ca.fabs(X), ["double v1 = esea_fabs(x)"], "v1"),
        (ca.sign(X), ["double v1 = esea_sign(x)"], "v1"),
        (ca.fmin(X, Y), ["double v2 = esea_fmin(x, y)"], "v2"),
        (ca.fmax(X, Y), ["double v2 = esea_fmax(x, y)"], "v2"),
        (ca.sqrt(X), ["double v1 = sqrt(x)"], "v1"),
        (X**1.7, ["double v2 = pow(x, 1.7)"], "v2"),
        # What is used once and short stands where it is used; what is used twice has its name.
        (X * Y + Z, ["double v4 = (x * y) + z"], "v4"),
        ((X + Y) * Z, ["double v4 = (x + y) * z"], "v4"),
        (X + Y + Z, ["double v4 = x + y + z"], "v4"),
        (X + (Y + Z), ["double v4 = x + (y + z)"], "v4"),
        (X - (Y - Z), ["double v4 = x - (y - z)"], "v4"),
        (
            (X / Y) * Z + X / Y,
            ["double v2 = x / y", "double v5 = (v2 * z) + v2"],
            "v5",
        ),
        # Conditions are of type bool and stand alone or as a number where one is wanted.
        (X < Y, ["bool v2 = x < y"], "(v2 ? 1.0 : 0.0)"),
        ((X <= Y) * Z, ["double v4 = ((x <= y) ? 1.0 : 0.0) * z"], "v4"),
        (
            ca.if_else(ca.logic_and(X < Y, ca.logic_and(Y < Z, X != Z)), X, 0),
            ["double v7 = ((x < y) && (y < z) && (x != z)) ? x : 0.0"],
            "v7",
        ),
        (
            ca.if_else(ca.logic_and(ca.logic_and(X < Y, Y == Z), X != Z), X, 0),
            ["double v7 = ((x < y) && (y == z) && (x != z)) ? x : 0.0"],
            "v7",
        ),
        (
            ca.if_else(ca.logic_not(ca.logic_or(X < Y, Y < Z)), X, 0),
            ["double v6 = (!((x < y) || (y < z))) ? x : 0.0"],
            "v6",
        ),
        (ca.if_else(X, Y, 0), ["double v2 = (x != 0.0) ? y : 0.0"], "v2"),
        (ca.logic_not(X), ["bool v1 = !(x != 0.0)"], "(v1 ? 1.0 : 0.0)"),
    ],
)
def test_a_line_of_c_by_hand(expression, said, result):
    kernel = prune(kernel_of(expression))
    made, results = lines(kernel)
    # Names tell the node: renumbered from what was read, so that the order of walking is free.
    assert [shape(s) for s in made] == [shape(s) for s in said]
    assert shape(results[0][0]) == shape(result)


def shape(text: str) -> str:
    """C without the numbers of its values, and sums and products the walker may turn around."""
    order: dict[str, str] = {}
    return re.sub(r"\bv\d+\b", lambda m: order.setdefault(m[0], f"v#{len(order)}"), text)


def test_a_choice_of_two_is_one_in_single_precision():
    kernel = F32.passes(kernel_of(ca.if_else(X < Y, X, Z)))
    made, _ = lines(kernel, F32)
    assert [shape(m) for m in made] == ["float v#0 = (x < y) ? x : z"]
    kernel = F64.passes(kernel_of(ca.if_else(X < Y, X, Z)))
    made, _ = lines(kernel)
    assert len(made) == 4  # as CasADi has it: condition, two arms, their sum
    with pytest.raises(UnsupportedOperationError, match="the f32 format has no operation 'atan'"):
        lines(Kernel("f", (Node("input"), Node("atan", (0,))), ((1,),)), F32)
    for value in (np.inf, np.nan):
        with pytest.raises(UnsupportedOperationError, match="cannot be emitted"):
            F64.literal(value)


@pytest.mark.parametrize(
    ("value", "single", "double"),
    [
        (0.0, "0.0f", "0.0"),
        (1.0, "1.0f", "1.0"),
        (-2.5, "-2.5f", "-2.5"),
        (0.1, "0.1f", "0.1"),
        (2e-4, "0.0002f", "0.0002"),
        (9e-5, "9.0e-05f", "9e-05"),
        (9999999.0, "9999999.0f", "9999999.0"),
        (1e7, "1.0e+07f", "10000000.0"),
        (1e22, "1.0e+22f", "1e+22"),
    ],
)
def test_literals(value, single, double):
    assert (F32.literal(value), F64.literal(value)) == (single, double)


def test_powers_of_single_precision_carry_their_exponent_in_whole_numbers():
    made, _ = lines(kernel_of(X**1.75), F32)
    assert made[0].endswith(f"esea_f32_powk(x, INT32_C({7 << 25}) /* 1.75 */)")
    made, _ = lines(kernel_of(X**Y), F32)
    assert made[0].endswith("esea_f32_pow(x, y)")
    for f, name in ((ca.exp, "exp"), (ca.log, "log"), (ca.tanh, "tanh"), (ca.sqrt, "sqrt")):
        assert lines(kernel_of(f(X)), F32)[0][0].endswith(f"esea_f32_{name}(x)")
        assert lines(kernel_of(f(X)), F64)[0][0].endswith(f" {name}(x)")


def test_a_short_sum_stands_where_it_is_used():
    kernel = kernel_of((X + Y) * Z)
    for letters, own in ((30, False), (31, True)):  # 34 columns of "x + y", and one more
        names = ("x" * letters, "y", "z")
        made = print_kernel(kernel, F64, lambda a, e, n=names: (n[a], n[a]), {})
        sums = [s for s in made.statements if s.expression == f"{names[0]} + y"]
        assert bool(sums) is own


def test_labels_and_ports_name_what_they_stand_for():
    kernel = kernel_of(X * Y + Z, X * Y)
    product = next(i for i, n in enumerate(kernel.nodes) if n.op == "mul")
    total = kernel.results[0][0]
    made = print_kernel(
        kernel, F64, lambda a, e: ("xyz"[a], "xyz"[a]), {product: ("area", "its size")}, (),
        {total: "total", product: "other"},
    )  # fmt: skip
    named = {s.name: s for s in made.statements}
    assert (named["area"].expression, named["area"].comment) == ("x * y", "its size")
    assert shape(named["total"].expression) in ("area + z", "z + area")
    assert made.results == (("total",), ("area",))
    assert made.used_arguments == frozenset({0, 1, 2})


@pytest.mark.parametrize("fmt", [F32, F64])
def test_a_status_word_is_put_together_from_its_bits(fmt):
    word = flag_word([X < Y, Y < Z, X < Z])
    kernel = fmt.passes(kernel_of(word))
    made, (result,) = lines(kernel, fmt, words=(0,), others={kernel.results[0][0]: "status"})
    if fmt is F64:  # as numbers, which CasADi adds
        assert not any("esea_bit" in m for m in made)
        return
    assert made[0].startswith("uint32_t status = ")
    assert sorted(made[0].split(" = ")[1].split(" | ")) == [
        "esea_bit(x < y, 0u)", "esea_bit(x < z, 2u)", "esea_bit(y < z, 1u)",
    ]  # fmt: skip
    assert result == ("status",)


def test_status_words_are_found_and_what_only_looks_like_one_is_not():
    def found(expression, *more):
        kernel = kernel_of(expression, *more)
        return kernel, status_words(kernel, (0,), use_counts(kernel))

    kernel, words = found(flag_word([X < Y, Y < Z]))
    ((root, word),) = words.items()
    assert isinstance(word, StatusWord)
    assert root == kernel.results[0][0]
    assert {(kernel.nodes[c].args, bit) for c, bit in word.flags} == {
        (tuple(kernel_index(kernel, a) for a in pair), bit)
        for pair, bit in (((0, 1), 0), ((1, 2), 1))
    }
    # Its two arms, but not itself, nor what they ask.
    assert {kernel.nodes[i].op for i in word.parts} == {"if_else_zero"}
    assert len(word.parts) == 2
    for other in (
        ca.if_else(X < Y, 3.0, 0) + ca.if_else(Y < Z, 1.0, 0),  # no power of two
        ca.if_else(X < Y, 2.0, 0) + ca.if_else(Y < Z, 2.0, 0),  # one bit twice
        ca.if_else(X < Y, 2.0, 0) - ca.if_else(Y < Z, 1.0, 0),
        ca.if_else(X, 2.0, 0) + ca.if_else(Y < Z, 1.0, 0),  # no condition
        ca.if_else(X < Y, 0.5, 0) + ca.if_else(Y < Z, 1.0, 0),
        X + Y,
    ):
        assert found(other)[1] == {}
    arm = ca.if_else(X < Y, 2.0, 0)
    assert (
        found(arm + ca.if_else(Y < Z, 1.0, 0), ca.fmax(arm, Z))[1] == {}
    )  # an arm with another use


def kernel_index(kernel: Kernel, argument: int) -> int:
    return next(
        i for i, n in enumerate(kernel.nodes) if n.op == "input" and n.source[0] == argument
    )


# -- as nodes --------------------------------------------------------------------------------------


def test_equal_values_are_one_and_what_nothing_needs_goes():
    kernel = kernel_of(X * Y + 0.5, X * Y - 0.5)
    assert [n.op for n in kernel.nodes].count("mul") == 1
    assert [n.value for n in kernel.nodes if n.op == "const"] == [0.5]
    mul = next(i for i, n in enumerate(kernel.nodes) if n.op == "mul")
    half = next(i for i, n in enumerate(kernel.nodes) if n.op == "const")
    uses = use_counts(kernel)
    assert (uses[mul], uses[half]) == (2, 2)
    assert kernel.cost() == {"mul": 1, "add": 1, "sub": 1}
    one = Kernel("g", kernel.nodes, kernel.results[:1])
    left = prune(one)
    assert needed_nodes(one) == [i for i in range(len(one.nodes)) if one.nodes[i].op != "sub"]
    assert left.cost() == {"mul": 1, "add": 1}
    assert left.nodes[left.results[0][0]].op == "add"
    assert all(a < i for i, n in enumerate(left.nodes) for a in n.args)


def test_numbers_are_shared_and_a_zero_has_no_sign():
    # As CasADi keeps them.
    for value in (0.0, -0.0, -2.5):
        kernel = kernel_of(ca.fmin(X, value), ca.fmax(Y, abs(value) if value == 0 else value))
        assert [str(n.value) for n in kernel.nodes if n.op == "const"] == [str(value + 0.0)]


def test_a_listing_line_by_line():
    kernel = Kernel(
        "f",
        (
            Node("input", source=(1, 2)),
            Node("const", value=0.5),
            Node("mul", (0, 1)),
        ),
        ((2,), (0, 2)),
    )
    assert kernel.listing().splitlines() == [
        "f",
        "v0 = input 1[2]",
        "v1 = const 0x1.0000000000000p-1",
        "v2 = mul 0 1",
        "result 0 = 2",
        "result 1 = 0 2",
    ]


def test_long_operations_first_then_what_waits_for_none_then_the_rest():
    kernel = kernel_of(Y / (Z + 3) + ca.exp(X * 2.5) * Y, X - Z)
    ordered = calls_first(kernel)
    ops = [n.op for n in ordered.nodes]
    assert sorted(ops) == sorted(n.op for n in kernel.nodes)
    # What leads to the exponential, then quotient and difference, then what takes its result.
    place = ops.index("exp")
    assert ops.index("mul") < place < ops.index("div") < len(ops)
    assert place < ops.index("sub")
    assert max(ops.index("div"), ops.index("sub")) < len(ops) - 1 - ops[::-1].index("mul")
    assert all(a < i for i, n in enumerate(ordered.nodes) for a in n.args)
    leading = set(range(place + 1))
    assert {ops[i] for i in leading} == {"input", "const", "mul", "exp"}
    # Depth first: one product is done before the other's sum or difference is begun.
    said = [n.op for n in calls_first(kernel_of((X + Y) * 3, (X - Y) * 5)).nodes]
    assert said.index("mul") < max(said.index("sub"), said.index("add"))


def test_two_arms_of_one_condition_become_a_choice():
    kernel = fuse_selects(kernel_of(ca.if_else(X < Y, X, Z)))
    (root,) = kernel.results[0]
    choice = kernel.nodes[root]
    assert choice.op == "select"
    condition, first, second = (kernel.nodes[a] for a in choice.args)
    assert (condition.op, first.source, second.source) == ("lt", (0, 0), (2, 0))
    # Two arms of two conditions stay a sum.
    kernel = fuse_selects(kernel_of(ca.if_else(X < Y, X, 0) + ca.if_else(Z < Y, Z, 0)))
    assert kernel.nodes[kernel.results[0][0]].op == "add"


# -- names -----------------------------------------------------------------------------------------


def test_a_name_that_is_free_stays_and_another_gets_an_ending():
    assert unused("tau", ()) == "tau"
    assert unused("tau", {"tau", "tau_"}) == "tau__"
    assert unused("double", ()) == "double_"
    assert unused("state", ()) == "state_"
    assert unused("M_PI", ()) == "M_PI_value"
    assert unused("M_PI", {"M_PI_value"}) == "M_PI_value_"
    names = LocalNames({"x"}, {3: ("x", ""), 4: ("area", "")}, {5: "area", 6: "y"})
    assert [names.define(i) for i in (3, 4, 5, 6, 7)] == ["x_", "area", "area_", "y", "v7"]


def filter_block() -> Block:
    def step(c, s, u, guard, label):
        y = label("mixed_rad", c.half * s.m_rad + c.one * u.x_rad)
        moved = y > 0.25
        return (
            {"m_rad": y, "v_rad": [s.v_rad[1], y * 0.5]},
            {"y_rad": y + 1, "status": flag_word([ca.logic_not(guard.inputs_ok), moved])},
        )

    flags = (Flag("INPUT_INVALID", "replaced"), Flag("MOVED", "moved"))
    return Block.define(
        "filter",
        "Filter",
        period_s=0.001,
        tunables=(Tunable("half", 0.5, 0.25, 0.75, "half"),),
        coefficients=(Port("half", 0.25, 0.75, "half"), Port("one", 0.25, 2.0, "one")),
        prepare=lambda t: {"half": 1 * t.half, "one": 2 * t.half},
        state=(
            Port("m_rad", -9.0, 9.0, "memory", init=0.25),
            Port("v_rad", -9.0, 9.0, "older", 2),
        ),
        inputs=(Port("x_rad", -1.0, 1.0, "input", on_invalid=0.5),),
        outputs=(Port("y_rad", -9.0, 9.0, "out"), Port("status", 0, 3, "flags", flags=flags)),
        step=step,
    )


def test_values_are_named_by_the_ports_that_they_come_from_and_go_to():
    block = filter_block()
    kernel, labels = labelled_kernel(block, F32.passes)
    named = {i: (name, said) for i, name, said in labels}
    assert {n for n, _ in named.values()} >= {"mixed_rad", "state_ok", "inputs_ok", "x_rad_used"}
    found = meanings(block, "step", kernel, named)
    by_name = {name: i for i, name in found.items()}
    results = [list(r) for r in kernel.results]
    assert by_name["y_rad_out"] == results[2][0]
    assert by_name["status"] == results[3][0]
    assert by_name["v_rad_next_1"] == results[1][1]
    assert {"m_rad_used", "v_rad_used_1", "moved", "input_invalid"} <= set(by_name)
    used = kernel.nodes[by_name["m_rad_used"]]
    assert used.op in ("select", "if_else_zero")
    assert kernel.nodes[used.args[1]].source == (2, 0)  # behind two coefficients
    second = kernel.nodes[by_name["v_rad_used_1"]]
    assert kernel.nodes[second.args[1]].source == (3, 1)
    assert kernel.nodes[by_name["moved"]].op == "lt"
    init = F32.passes(walk(block.init))
    assert set(meanings(block, "init", init, {}).values()) <= {"m_rad", "v_rad_0", "v_rad_1"}
    short = meanings(block, "step", kernel, named, lambda name: name[:1])
    assert {"y_out", "m_used", "v_next_1"} <= set(short.values())
    # The sum of two arms has the name where no pass has made them one.
    kernel, labels = labelled_kernel(block, F64.passes)
    found = meanings(block, "step", kernel, {i: (n, s) for i, n, s in labels})
    (used,) = (i for i, name in found.items() if name == "m_rad_used")
    assert kernel.nodes[used].op == "add"


# -- pieces of text --------------------------------------------------------------------------------


def test_brackets_round_the_whole_go_and_others_stay():
    for text, wanted in (
        ("(a + b)", "a + b"),
        ("((a) + b)", "(a) + b"),
        ("(a) + (b)", "(a) + (b)"),
        ("a", "a"),
        ("(a", "(a"),
        ("f(a)", "f(a)"),
    ):
        assert bare(text) == wanted


def test_comments_are_closed_once_and_wrapped():
    assert comment("a */ b") == "/* a * / b */"
    assert comment("one", 4) == "    /* one */"
    assert comment("one  two\n three") == "/* one two three */"
    assert comment("one two three", 0, 13) == "/* one two\n * three */"
    assert comment("one two three four", 2, 15) == "  /* one two\n   * three\n   * four */"
    wide = comment("word " * 40).splitlines()
    assert max(map(len, wide)) <= 98
    assert min(map(len, wide[:-1])) > 98 - 3 - 3 - 5


def test_a_state_is_stored_once_its_old_value_is_read_and_its_new_one_known():
    block = filter_block()

    def statement(name: str, expression: str) -> Statement:
        return Statement("float", name, expression)

    step = PrintedKernel(
        (
            statement("x", "in->x_rad"),
            statement("m_next", "x * 2.0f"),
            statement("old", "state->m_rad"),
            statement("first", "state->v_rad[0]"),
            statement("y", "old + first"),
        ),
        (("m_next",), ("(old)", "0.5f"), ("y",), ("0u",)),
        frozenset(),
    )
    # m waits until it is read, v[0] for its own reading, and v[1], that nobody reads, for nothing.
    assert early_stores(block, step) == (
        ("state->v_rad[1] = 0.5f;",),
        (),
        ("state->m_rad = m_next;",),
        ("state->v_rad[0] = old;",),
        (),
    )
    named = early_stores(block, step, {"m_rad": "memory"})
    assert named[1] == ("state->memory = m_next;",)


# -- checks ----------------------------------------------------------------------------------------


def checked(*conditions) -> dict[int, tuple[int, ...]]:
    """How many comparisons hold each end of x (scalar) and of y (two elements)."""
    y = ca.SX.sym("y", 2)
    kernel = walk(ca.Function("f", [X, y], [c(X, y) for c in conditions]))
    ports = {0: Port("x", -1.0, 2.0, "x"), 1: Port("y", -1.0, 2.0, "y", 2)}
    return {k: tuple(map(len, v)) for k, v in range_checks(kernel, ports).items()}


def test_comparisons_that_hold_a_range():
    vector = Port("y", -1.0, 2.0, "y", 2)
    total = float(np.float32(1.001 * 2 * 2.0))
    assert vector_total(vector) == total
    for condition, scalar, elements in (
        (lambda x, y: x <= 2, (1, 0), 0),
        (lambda x, y: x >= -1, (0, 1), 0),
        (lambda x, y: in_range(x, -1, 2), (1, 1), 0),
        (lambda x, y: in_range(x, -0.5, 1), (1, 1), 0),  # narrower holds it too
        (lambda x, y: in_range(x, -1.5, 2.5), (0, 0), 0),
        (lambda x, y: x < 2, (0, 0), 0),
        (lambda x, y: port_ok(y, vector), (0, 0), 1),
        (lambda x, y: ca.fabs(y[0]) <= 1, (0, 0), 0),
        (lambda x, y: ca.fabs(y[0]) + y[1] <= 1, (0, 0), 0),
        (lambda x, y: ca.fabs(y[1]) + ca.fabs(y[0]) <= 1, (0, 0), 1),
        (lambda x, y: ca.fabs(y[0]) + ca.fabs(y[1]) + ca.fabs(y[1]) <= 1, (0, 0), 0),
        (lambda x, y: ca.norm_1(y) <= total * 1.01, (0, 0), 0),
        (lambda x, y: y[0] <= 1, (0, 0), 0),
    ):
        assert checked(condition) == {0: scalar, 1: (elements,)}


@pytest.mark.parametrize("ends", ["both", "upper", "none"])
def test_a_coefficient_is_checked_where_both_its_ends_are(ends):
    def step(c, s, u, guard, label):
        sound = {
            "both": in_range(c.gain, 0.5, 1.5),
            "upper": c.gain <= 1.5,
            "none": ca.SX(1),
        }[ends]
        return {}, {"y_Nm": ca.if_else(sound, c.gain * u.x_Nm, 0.0)}

    block = Block.define(
        "gain",
        "Gain",
        period_s=1e-3,
        tunables=(Tunable("gain", 1.0, 0.5, 1.5, "factor"),),
        coefficients=(Port("gain", 0.5, 1.5, "factor"),),
        prepare=lambda t: {"gain": 1 * t.gain},
        state=(),
        inputs=(Port("x_Nm", -1.0, 1.0, "in"),),
        outputs=(Port("y_Nm", -2.0, 2.0, "out"),),
        step=step,
    )
    kernel = fuse_selects(walk(block.step))
    found = coefficient_checks(block, kernel)
    if ends != "both":
        assert found == {}
        return
    assert set(found) == {0}
    assert {kernel.nodes[i].op for i in found[0]} == {"le"}
    assert len(found[0]) == 2
