"""Intervals of computed values: what no input can make the emitted arithmetic do."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from esea_gen.emit.formats.base import Format
from esea_gen.emit.walker import Kernel, Node, fuse_selects


@dataclass(frozen=True)
class Interval:
    """What a computed value may be."""

    low: float
    high: float
    nan: bool = False

    @property
    def settled(self) -> bool:
        """Whether it is one number."""
        return self.low == self.high and not self.nan


ANYTHING = Interval(-math.inf, math.inf, True)
UNDECIDED, TRUE, FALSE = Interval(0, 1), Interval(1, 1), Interval(0, 0)


def _hull(x: Interval, y: Interval) -> Interval:
    return Interval(min(x.low, y.low), max(x.high, y.high), x.nan or y.nan)


class _Evaluator:
    def __init__(self, kernel: Kernel, fmt: Format) -> None:
        self.kernel, self.fmt = kernel, fmt
        self.number: Callable[[float], float] = lambda x: float(fmt.dtype.type(x))
        self.values: list[Interval] = []

    def corners(self, f: Callable[[float, float], float], x: Interval, y: Interval) -> Interval:
        # The operation at the four corners, each computed exactly enough and rounded once.
        kind = self.fmt.dtype.type
        ends = [f(kind(a), kind(b)) for a in (x.low, x.high) for b in (y.low, y.high)]
        found = [float(e) for e in ends]
        if any(math.isnan(e) for e in found):
            return ANYTHING
        return Interval(min(found), max(found), x.nan or y.nan)

    def monotone(self, f: Callable[[float], float], x: Interval) -> Interval:
        # An elementary function, with some units in the last place to spare.
        room = 8 * self.fmt.epsilon
        ends = [f(x.low), f(x.high)]
        low, high = (e - s * room * abs(e) for e, s in zip(ends, (1, -1), strict=True))
        return Interval(self.number(low), self.number(high), x.nan)

    def one(self, i: int, n: Node) -> Interval:
        v = [self.values[a] for a in n.args]
        if n.op == "const":
            c = self.number(n.value)
            return Interval(c, c)
        if n.op in ("lt", "le", "eq", "ne"):
            return _compare(n.op, *v)
        if n.op in ("not", "and", "or"):
            return _logic(n.op, v)
        if n.op in ("if_else_zero", "select"):
            other = v[2] if n.op == "select" else Interval(0, 0)
            if v[0].settled:
                return v[1] if v[0].low else other
            return _hull(v[1], other)
        if n.op in ("fmin", "fmax"):
            if v[0].nan or v[1].nan:  # which of the two is taken is a matter of the format
                return _hull(*v)
            pick = min if n.op == "fmin" else max
            return Interval(pick(v[0].low, v[1].low), pick(v[0].high, v[1].high))
        if n.op in ("add", "sub", "mul", "div"):
            return self.binary(n, *v)
        return self.unary(n, v)

    def binary(self, n: Node, x: Interval, y: Interval) -> Interval:
        with np.errstate(all="ignore"):
            if n.op == "add":
                found = self.corners(lambda a, b: a + b, x, y)
                return self.between(n, found)
            if n.op == "sub":
                return self.corners(lambda a, b: a - b, x, y)
            if n.op == "mul":
                found = self.corners(lambda a, b: a * b, x, y)
                return self.square(n, found)
            if y.low <= 0 <= y.high:
                return ANYTHING
            return self.corners(lambda a, b: a / b, x, y)

    def square(self, n: Node, found: Interval) -> Interval:
        # (c x) x with c >= 0 has no sign, however it is bracketed.
        for a, b in (n.args, n.args[::-1]):
            inner = self.kernel.nodes[a]
            for c, x in (inner.args, inner.args[::-1]) if inner.op == "mul" else ():
                if x == b and self.values[c].low >= 0 and not self.values[c].nan:
                    return Interval(max(found.low, 0.0), max(found.high, 0.0), found.nan)
        return found

    def between(self, n: Node, found: Interval) -> Interval:
        # p + g (u - p) with g in [0, 1): no farther than u, whatever intervals say.  With g a few
        # units in the last place below 1, rounding of product and difference cannot reach beyond.
        for a, b in (n.args, n.args[::-1]):
            product = self.chosen(b)
            if product.op != "mul":
                continue
            for g, d in (product.args, product.args[::-1]):
                gain, difference = self.values[g], self.chosen(d)
                if difference.op != "sub" or difference.args[1] != a:
                    continue
                if gain.low >= 0 and gain.high <= 1 - 16 * self.fmt.epsilon and not gain.nan:
                    both = _hull(self.values[a], self.values[difference.args[0]])
                    low, high = max(found.low, both.low), min(found.high, both.high)
                    return Interval(low, high, found.nan)
        return found

    def chosen(self, i: int) -> Node:
        # A node, or what is taken instead of 0.
        n = self.kernel.nodes[i]
        return self.kernel.nodes[n.args[1]] if n.op == "if_else_zero" else n

    def unary(self, n: Node, v: list[Interval]) -> Interval:
        x = v[0]
        nearest = 0.0 if x.low <= 0 <= x.high else min(abs(x.low), abs(x.high))
        size = Interval(nearest, max(abs(x.low), abs(x.high)), x.nan)
        with np.errstate(all="ignore"):
            if n.op == "neg":
                return Interval(-x.high, -x.low, x.nan)
            if n.op == "fabs":
                return size
            if n.op == "sq":
                return self.corners(lambda a, b: a * b, size, size)
            if n.op == "twice":
                return self.corners(lambda a, b: a * b, Interval(2, 2), x)
            if n.op == "inv":
                return self.binary(Node("div"), Interval(1, 1), x)
        if n.op == "sign":
            low, high = (float((e > 0) - (e < 0)) for e in (x.low, x.high))
            return Interval(min(low, 0) if x.nan else low, max(high, 0) if x.nan else high)
        if n.op == "pow":
            exponent = self.kernel.nodes[n.args[1]]
            if exponent.op != "const" or exponent.value <= 0 or x.low < 0 or x.nan:
                return ANYTHING
            return self.monotone(lambda a: math.pow(a, exponent.value), x)
        if n.op == "sqrt" and x.low >= 0:
            return self.monotone(math.sqrt, x)
        if n.op == "tanh":
            return self.monotone(math.tanh, x)
        if n.op == "exp":
            # Beyond 700 the exponential is no longer a number.
            return self.monotone(lambda a: math.exp(a) if a < 700 else math.inf, x)
        if n.op == "log" and x.low > 0:
            return self.monotone(math.log, x)
        return ANYTHING


def _compare(op: str, x: Interval, y: Interval) -> Interval:
    if x.nan or y.nan:
        return UNDECIDED
    if op == "lt":
        return TRUE if x.high < y.low else FALSE if x.low >= y.high else UNDECIDED
    if op == "le":
        return TRUE if x.high <= y.low else FALSE if x.low > y.high else UNDECIDED
    apart = x.high < y.low or x.low > y.high
    same = x.settled and y.settled and x.low == y.low
    if not (apart or same):
        return UNDECIDED
    return TRUE if same == (op == "eq") else FALSE


def _logic(op: str, v: list[Interval]) -> Interval:
    def truth(x: Interval) -> bool | None:
        if x.nan:
            return None
        if x.low == x.high == 0:
            return False
        return None if x.low <= 0 <= x.high else True

    known = [truth(x) for x in v]
    if op == "not":
        return UNDECIDED if known[0] is None else FALSE if known[0] else TRUE
    strong = op == "or"
    if strong in known:
        return TRUE if strong else FALSE
    if None in known:
        return UNDECIDED
    return FALSE if strong else TRUE


def computed_intervals(
    kernel: Kernel,
    fmt: Format,
    arguments: Sequence[Sequence[Interval]],
    undecided: Collection[int] = (),
) -> list[Interval]:
    """Intervals of every value that a kernel computes."""
    everything = Kernel(kernel.name, kernel.nodes, (tuple(range(len(kernel.nodes))),))
    fused = fuse_selects(everything)
    work = _Evaluator(fused, fmt)
    for i, n in enumerate(fused.nodes):
        if n.op == "input":
            work.values.append(arguments[n.source[0]][n.source[1]])
        else:
            work.values.append(UNDECIDED if i in undecided else work.one(i, n))
    return work.values


__all__ = ["ANYTHING", "Interval", "computed_intervals"]
