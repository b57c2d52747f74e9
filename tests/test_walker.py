"""From CasADi's instruction list to C text."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.formats.floating import print_kernel
from esea_gen.emit.walker import UnsupportedOperationError, fuse_selects, walk


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
    for kernel in (walk(f), fuse_selects(walk(f))):
        got = evaluate(kernel, [[x], [a, b]])
        for e, g in zip(expected, got, strict=True):
            assert g == pytest.approx(list(e), rel=1e-15, abs=1e-300)


def test_selects_are_fused_and_dead_nodes_dropped():
    kernel = fuse_selects(walk(sample()))
    assert "select" in kernel.cost()
    assert "if_else_zero" not in kernel.cost()
    assert kernel.cost()["pow"] == 1


def test_the_listing_tells_every_constant_exactly():
    x = ca.SX.sym("x")
    one = walk(ca.Function("f", [x], [x * 0.1])).listing()
    other = walk(ca.Function("f", [x], [x * np.nextafter(0.1, 1)])).listing()
    assert one != other


def test_what_cannot_be_emitted_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(UnsupportedOperationError, match="cannot be emitted"):
        walk(ca.Function("f", [x], [ca.erf(x)]))
    kernel = walk(ca.Function("f", [x], [x**20.5]))
    with pytest.raises(UnsupportedOperationError, match=r"20\.5"):
        print_kernel(kernel, FORMATS["f32"], lambda a, e: ("x", "in->x"), {})
    kernel = walk(ca.Function("f", [x], [x + 1e60]))
    with pytest.raises(UnsupportedOperationError, match="float32"):
        print_kernel(kernel, FORMATS["f32"], lambda a, e: ("x", "in->x"), {})


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_double_literals_read_back(value: float):
    text = FORMATS["f64"].literal(value)
    assert float(text) == value
    assert "." in text or "e" in text


@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_float_literals_read_back_and_are_float(value: float):
    text = FORMATS["f32"].literal(value)
    assert text.endswith("f")
    assert "." in text or "e" in text
    assert np.float32(text[:-1]) == np.float32(value)
