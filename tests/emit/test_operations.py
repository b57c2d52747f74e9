"""Every operation of a kernel against a plain table, in all executors.

The second executor against Python's own arithmetic, the count of sides taken against masks written
out, the error at an operating point against derivatives of CasADi.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.elementary import ACCURACY_ULP
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.walker import Kernel, Node
from esea_gen.language.builder import Builder, declare_ports
from esea_gen.language.ports import Port
from esea_gen.language.program import Program
from esea_gen.verify.executor import evaluate
from tests.operating_point import PointAnalysis

F32, F64 = FORMATS["f32"], FORMATS["f64"]
U = 2.0**-24
PAIRS = [(x, y) for x in (-2.5, -0.75, 0.0, 0.75, 3.0) for y in (-1.5, 0.75, 3.0)]

ROUNDED = {
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
    "neg": lambda x, y: -x,
    "fabs": lambda x, y: abs(x),
    "sq": lambda x, y: x * x,
    "twice": lambda x, y: x + x,
    "inv": lambda x, y: 1 / y,
    "sign": lambda x, y: math.copysign(1, x) if x else 0.0,
    "fmin": min,
    "fmax": max,
    "if_else_zero": lambda x, y: y if x else 0.0,
    "lt": lambda x, y: x < y,
    "le": lambda x, y: x <= y,
    "eq": lambda x, y: x == y,
    "ne": lambda x, y: x != y,
    "not": lambda x, y: not x,
    "and": lambda x, y: bool(x and y),
    "or": lambda x, y: bool(x or y),
}
ONE = {"neg", "fabs", "sq", "twice", "sign", "not"}


def results(fmt, op, pairs=PAIRS, args=None, more=()):
    """Of one operation on pairs of numbers, as a format computes it."""
    first = (Node("input", source=(0, 0)), Node("input", source=(0, 1)), *more)
    given = args or ((1,) if op == "inv" else (0,) if op in ONE else (0, 1))
    kernel = Kernel("k", (*first, Node(op, given)), ((len(first),),))
    return evaluate(kernel, fmt, [np.array(pairs, fmt.dtype)])[-1]


@pytest.mark.parametrize("fmt", [F32, F64], ids=["f32", "f64"])
@pytest.mark.parametrize("op", ROUNDED)
def test_an_operation_is_the_exact_one_rounded_once(fmt, op):
    found = results(fmt, op)
    exact = [ROUNDED[op](x, y) for x, y in PAIRS]
    truth = op in ("lt", "le", "eq", "ne", "not", "and", "or")
    assert found.dtype == (np.bool_ if truth else fmt.dtype)
    assert found.tolist() == [e if truth else float(fmt.dtype.type(e)) for e in exact]


@pytest.mark.parametrize("fmt", [F32, F64], ids=["f32", "f64"])
def test_functions_choices_and_powers(fmt):
    points = [(0.3, 1.7), (2.0, -0.6), (0.9, 0.0), (5.0, 3.1)]
    rel = 2.0**-23 if fmt is F32 else 1e-15
    for op in ("exp", "log", "sqrt", "tanh"):
        expected = [getattr(math, op)(float(np.float32(x))) for x, _ in points]
        x = np.float32(points)
        assert results(fmt, op, x, (0,)).tolist() == pytest.approx(expected, rel=rel)
    x = np.float32(points).astype(float)
    expected = [a**b for a, b in x.tolist()]
    assert results(fmt, "pow", np.float32(points)).tolist() == pytest.approx(expected, rel=rel)
    # An exponent that is a constant has a function of its own in f32.
    by = (Node("const", value=0.75),)
    expected = [a**0.75 for a, _ in x.tolist()]
    got = results(fmt, "pow", np.float32(points), (0, 2), by)
    assert got.tolist() == pytest.approx(expected, rel=rel)
    # A choice of three; a number is true when it is not 0, a boolean is 1 or 0 where summed.
    assert results(fmt, "select", PAIRS, (0, 1, 2), (Node("const", value=7.0),)).tolist() == [
        y if x else 7.0 for x, y in PAIRS
    ]
    less = (Node("lt", (0, 1)),)
    for op, exact in (
        ("add", lambda x, y: (x < y) + y),
        ("if_else_zero", lambda x, y: y if x < y else 0.0),
    ):
        got = results(fmt, op, PAIRS, (2, 1), less)
        assert got.tolist() == [exact(x, y) for x, y in PAIRS]
        assert got.dtype == fmt.dtype


def test_of_equal_zeros_and_of_nan_each_format_takes_its_own():
    pairs = [(0.0, -0.0), (-0.0, 0.0)]
    for op in ("fmin", "fmax"):
        # f32 keeps the first, f64 the second: as the C of each is printed.
        assert np.signbit(results(F32, op, pairs)).tolist() == [False, True]
        assert np.signbit(results(F64, op, pairs)).tolist() == [True, False]
        numbers = [(math.nan, 1.0), (1.0, math.nan)]
        assert np.isnan(results(F32, op, numbers)).tolist() == [True, False]
        assert np.isnan(results(F64, op, numbers)).tolist() == [False, True]


# -- which sides of a decision were taken ----------------------------------------------------------

X, Y = ca.SX.sym("x"), ca.SX.sym("y")


# -- how far an operating point is off -------------------------------------------------------------

V = ca.SX.sym("v")
C = 0.8125  # a number that float32 holds
AT = {
    # Expression of a rounded value v, what it rounds itself in units of u, and v.
    "v + c": (V + C, 1, 0.7),
    "v - c": (V - C, 1, 0.7),
    "c - v": (C - V, 1, 0.7),
    "c v": (C * V, 1, 0.7),
    "v / c": (V / C, 1, 0.7),
    "c / v": (C / V, 1, 0.7),
    "1 / v": (1 / V, 1, 0.7),
    "v v": (V * V, 1, 0.7),
    "-v": (-V, 0, 0.7),
    "2 v": (2 * V, 0, 0.7),
    "v / 4": (0.25 * V, 0, 0.7),
    "|v|": (ca.fabs(V), 0, 0.7),
    "|-v|": (ca.fabs(V), 0, -0.7),
    "exp": (ca.exp(V), 2 * ACCURACY_ULP["exp"], 0.7),
    "log": (ca.log(V), 2 * ACCURACY_ULP["log"], 0.7),
    "sqrt": (ca.sqrt(V), 2 * ACCURACY_ULP["sqrt"], 0.7),
    "tanh": (ca.tanh(V), 2 * ACCURACY_ULP["tanh"], 0.7),
    "power": (V**2.5, 2 * ACCURACY_ULP["powk"], 0.7),
    "least": (ca.fmin(V, C), 0, 0.7),
    "least, the other": (ca.fmin(V, C), 0, 0.9),
    "most": (ca.fmax(V, C), 0, 0.9),
    "most, the other": (ca.fmax(V, C), 0, 0.7),
    "chosen": (ca.if_else(V < C, 3 * V, 5 * V), 1, 0.7),
    "chosen, the other": (ca.if_else(V < C, 3 * V, 5 * V), 1, 0.9),
    "or none": (ca.if_else(V > C, V, 0), 0, 0.7),
    "or it": (ca.if_else(V > C, V, 0), 0, 0.9),
    "its sign": (ca.sign(V) + 0.25, 0, -0.7),
    "by both": (ca.if_else(ca.logic_and(V > 0, V < C), V, 2 * V), 0, 0.7),
    "by one": (ca.if_else(ca.logic_or(V > 1, V < 0), V, 2 * V), 0, 0.7),
    "by neither": (ca.if_else(ca.logic_not(V <= C), V, 2 * V), 0, 0.7),
}


def program(function, kinds=("in",), tunables=(), prepare=None) -> Program:
    """y of one kernel on what is given."""
    b = Builder()
    inputs = tuple(Port(n, -9.0, 9.0, n) for n in ("p", "q"))
    outputs = (Port("y", -1e4, 1e4, "y"),)
    coefficients = (Port("c", -9.0, 9.0, "c"),) if tunables else ()
    b.table("kept", [0.1, 9.0, 0.3, 8.0])
    declare_ports(b, "in", inputs)
    declare_ports(b, "coeffs", coefficients)
    out = declare_ports(b, "out", outputs)
    reads = {
        "in": [b.memory["in.p"][0], b.memory["in.q"][0]],
        "coeffs": [b.memory["coeffs.c"][0]] if tunables else [],
        "table": [b.memory["kept"][0:2:2]],
    }
    with b.part("step"):
        b.call("one", [r for k in kinds for r in reads[k]], [out["y"][:]], function)
    return Program.define(
        *("one", "made up"),
        period_s=1e-3,
        builder=b,
        inputs=inputs,
        outputs=outputs,
        tunables=tunables,
        coefficients=coefficients,
        prepare=prepare,
    )


@pytest.mark.parametrize("name", AT)
def test_an_error_comes_through_an_operation_by_its_slope(name):
    expression, own, at = AT[name]
    f = ca.Function("f", [V], [expression, ca.jacobian(expression, V)])
    p = float(np.float32(at / 0.61))
    q = float(np.float32(0.61))
    value, slope = map(float, f(p * q))
    found = PointAnalysis(program(lambda x, y: f(x * y)[0])).bound(p=p, q=q)
    # Of the product itself, then of what is made of it.
    expected = abs(slope) * U * abs(p * q) + own * U * abs(value)
    assert found.exact["y"] == pytest.approx(value, rel=1e-15)
    assert found.errors["y"] == pytest.approx(expected, rel=1e-9, abs=1e-30)
    assert found.near == 0
    # Beside another way from the same rounding its sign counts too.
    more = PointAnalysis(program(lambda x, y: f(x * y)[0] + 0.25 * (x * y))).bound(p=p, q=q)
    expected += (abs(slope + 0.25) - abs(slope)) * U * abs(p * q) + U * abs(value + 0.25 * p * q)
    assert more.errors["y"] == pytest.approx(expected, rel=1e-9, abs=1e-30)


@pytest.mark.parametrize("share", [1e-4, -1e-4])
def test_decisions_that_rounding_may_turn_are_counted(share):
    p, q = float(np.float32(1.2)), float(np.float32(0.6))
    for close, near in ((0.9, 1), (1.1, 0)):
        edge = p * q * (1 + close * share)
        for compared in (lambda v, e: v < e, lambda v, e: v <= e, lambda v, e: e < v):
            f = program(lambda x, y, e=edge, by=compared: ca.if_else(by(x * y, e), 1, 2))
            assert PointAnalysis(f).bound(p=p, q=q).near == near
    # Of numbers as they are given none can turn, however close.
    f = program(lambda x, y: ca.if_else(x < y, 1, 2))
    assert PointAnalysis(f).bound(p=p, q=p).near == 0
