"""From CasADi's instruction list to C text."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from esea_gen.emit import walker
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.formats.floating import print_kernel


def evaluate(kernel, inputs):
    """Evaluate a kernel in Python floats: an executor that shares nothing with the printers."""
    value: list[float] = []
    import math

    table = {
        "add": lambda a, b: a + b,
        "sub": lambda a, b: a - b,
        "mul": lambda a, b: a * b,
        "div": lambda a, b: a / b,
        "neg": lambda a: -a,
        "sq": lambda a: a * a,
        "twice": lambda a: 2 * a,
        "inv": lambda a: 1 / a,
        "fabs": abs,
        "fmin": min,
        "fmax": max,
        "lt": lambda a, b: float(a < b),
        "le": lambda a, b: float(a <= b),
        "and": lambda a, b: float(bool(a) and bool(b)),
        "or": lambda a, b: float(bool(a) or bool(b)),
        "not": lambda a: float(not a),
        "if_else_zero": lambda c, a: a if c else 0.0,
        "select": lambda c, a, b: a if c else b,
        "exp": math.exp,
        "sqrt": math.sqrt,
        "pow": math.pow,
    }
    for n in kernel.nodes:
        if n.op == "const":
            value.append(n.value)
        elif n.op == "input":
            value.append(inputs[n.source[0]][n.source[1]])
        else:
            value.append(table[n.op](*(value[a] for a in n.args)))
    return [[value[i] for i in r] for r in kernel.results]


def sample() -> ca.Function:
    x, y = ca.SX.sym("x"), ca.SX.sym("y", 2)
    c = ca.logic_and(x <= y[0], ca.logic_not(x < -1))
    z = ca.if_else(c, ca.fmin(x * y[1], 3), ca.exp(-(x**2)) / (1 + y[0] ** 2))
    return ca.Function("sample", [x, y], [z, ca.vertcat(ca.fabs(x) ** 0.77, 2 * x - y[1])])


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3))
def test_the_walk_keeps_the_meaning(x: float, a: float, b: float):
    f = sample()
    expected = [np.asarray(v).ravel() for v in f.call([x, ca.DM([a, b])])]
    for kernel in (walker.walk(f), walker.fuse_selects(walker.walk(f))):
        for e, g in zip(expected, evaluate(kernel, [[x], [a, b]]), strict=True):
            assert g == pytest.approx(list(e), rel=1e-15, abs=1e-300)


def test_selects_are_fused_and_dead_nodes_dropped():
    kernel = walker.fuse_selects(walker.walk(sample()))
    assert "select" in kernel.cost()
    assert "if_else_zero" not in kernel.cost()
    assert kernel.cost()["pow"] == 1


@pytest.mark.parametrize("arms", [(0, 1), (1, 0)])
@pytest.mark.parametrize("opposed", [2, 3])
def test_two_arms_of_a_condition_and_its_opposite_are_fused_in_either_order(arms, opposed):
    # x where x < y, and y where that, or else y < x, does not hold.
    nodes = [
        walker.Node("input", source=(0, 0)),
        walker.Node("input", source=(1, 0)),
        walker.Node("lt", (1, 0)),
        walker.Node("lt", (0, 1)),
        walker.Node("not", (opposed,)),
        walker.Node("if_else_zero", (3, 0)),
        walker.Node("if_else_zero", (4, 1)),
    ]
    nodes.append(walker.Node("add", (5 + arms[0], 5 + arms[1])))
    nodes.append(walker.Node("sub", (7, 1)))
    made = walker.fuse_selects(walker.Kernel("f", tuple(nodes), ((8, 2), (7,))))
    if opposed == 2:
        assert made.nodes == tuple(nodes)
        return
    # The other condition is a result, the opposite and both arms are nobody's.
    assert made.nodes == (*nodes[:4], walker.Node("select", (3, 0, 1)), walker.Node("sub", (4, 1)))
    assert made.results == ((5, 2), (4,))


def word_kernel(*more: walker.Node) -> walker.Kernel:
    """Bits 0, 1 and 3 of a word by three conditions; results are a sum, the word, its first bit."""
    nodes = (
        walker.Node("input", source=(0, 0)),
        walker.Node("input", source=(1, 0)),
        walker.Node("lt", (0, 1)),
        walker.Node("le", (1, 0)),
        walker.Node("eq", (0, 1)),
        *(walker.Node("const", value=v) for v in (1.0, 2.0, 8.0)),
        walker.Node("if_else_zero", (2, 5)),
        walker.Node("if_else_zero", (3, 6)),
        walker.Node("add", (8, 9)),
        walker.Node("if_else_zero", (4, 7)),
        walker.Node("add", (10, 11)),
        walker.Node("add", (0, 1)),
        *more,
    )
    return walker.Kernel("f", nodes, ((13,), (12,), (8,)))


def test_bits_of_a_status_word_from_the_lowest_up():
    kernel = word_kernel()
    uses = walker.use_counts(kernel)
    assert uses == [4, 4, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0]
    word = walker.StatusWord(((2, 0), (3, 1), (4, 3)), frozenset({8, 9, 10, 11}))
    first = walker.StatusWord(((2, 0),), frozenset())
    for words, found in (
        ((), {}),
        ((0,), {}),
        ((1,), {12: word}),
        ((2,), {8: first}),
        ((0, 2, 1), {12: word, 8: first}),
    ):
        assert walker.status_words(kernel, words, uses) == found
    # A sum inside that something else takes too; the word itself may be taken.
    for taken, found in ((10, {}), (11, {}), (9, {}), (12, {12: word})):
        other = word_kernel(walker.Node("neg", (taken,)))
        assert walker.status_words(other, (1,), walker.use_counts(other)) == found


def test_what_cannot_be_emitted_is_refused():
    x = ca.SX.sym("x")
    number = ca.OP_ERF
    with pytest.raises(walker.UnsupportedOperationError) as told:
        walker.walk(ca.Function("f", [x], [ca.erf(x + 1)]))
    said = f"f: CasADi operation number {number} at instruction 3 cannot be emitted"
    assert told.value.what.startswith(said)
    assert told.value.fix == "Try another number format with --real."
    kernel = walker.walk(ca.Function("f", [x], [x**20.5]))
    with pytest.raises(walker.UnsupportedOperationError, match=r"20\.5"):
        print_kernel(kernel, FORMATS["f32"], lambda a, e: ("x", "in->x", None), {})
    kernel = walker.walk(ca.Function("f", [x], [x + 1e60]))
    with pytest.raises(walker.UnsupportedOperationError, match="float32"):
        print_kernel(kernel, FORMATS["f32"], lambda a, e: ("x", "in->x", None), {})


@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_float_literals_read_back_and_are_float(value: float):
    text = FORMATS["f32"].literal(value)
    assert text.endswith("f")
    assert "." in text or "e" in text
    assert np.float32(text[:-1]) == np.float32(value)
