"""Intervals of computed values for every possible input of the emitted arithmetic.

Rounding keeps order, so the ends of a result are those of the operands' ends, in the format's own
arithmetic (:mod:`esea_gen.verify.executor`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from esea_gen.emit.formats.base import Format
from esea_gen.emit.walker import Kernel, Node, fuse_selects
from esea_gen.verify.executor import operation


@dataclass(frozen=True)
class Interval:
    low: float
    high: float
    nan: bool = False

    @property
    def settled(self) -> bool:
        return self.low == self.high and not self.nan

    def inside(self, low: float, high: float) -> Interval:
        return Interval(max(self.low, low), min(self.high, high), self.nan)


ANYTHING = Interval(-math.inf, math.inf, True)
UNDECIDED, TRUE, FALSE = Interval(0, 1), Interval(1, 1), Interval(0, 0)
# Elementary functions of one operand, which rise; and where they are numbers.
RISING = {"exp": -math.inf, "tanh": -math.inf, "sqrt": 0.0, "log": math.ulp(0.0), "pow": 0.0}


def _hull(x: Interval, y: Interval) -> Interval:
    return Interval(min(x.low, y.low), max(x.high, y.high), x.nan or y.nan)


def _size(x: Interval) -> Interval:
    nearest = 0.0 if x.low <= 0 <= x.high else min(abs(x.low), abs(x.high))
    return Interval(nearest, max(abs(x.low), abs(x.high)), x.nan)


def _truth(x: Interval) -> Interval:
    if x.low == x.high == 0 and not x.nan:
        return FALSE
    return UNDECIDED if x.nan or x.low <= 0 <= x.high else TRUE


class _Evaluator:
    def __init__(self, kernel: Kernel, fmt: Format) -> None:
        self.kernel, self.fmt = kernel, fmt
        self.values: list[Interval] = []

    def corners(self, n: Node, *operands: Interval) -> Interval:
        # The operation at all corners, each rounded as the format rounds.
        ends = product(*((x.low, x.high) for x in operands))
        columns = [np.array(c, self.fmt.dtype) for c in zip(*ends, strict=True)]
        with np.errstate(all="ignore"):
            found = operation(n, columns, self.fmt, self.kernel).astype(float)
        if np.any(np.isnan(found)):
            return ANYTHING
        return Interval(float(found.min()), float(found.max()), any(x.nan for x in operands))

    def one(self, n: Node, v: Sequence[Interval]) -> Interval:
        if n.op == "const":
            c = float(self.fmt.dtype.type(n.value))
            return Interval(c, c)
        if n.op in ("not", "and", "or"):
            return self.corners(n, *map(_truth, v))
        if n.op in ("lt", "le", "eq", "ne"):
            return self.compared(n, *v)
        if n.op in ("if_else_zero", "select"):
            other = v[2] if n.op == "select" else FALSE
            if v[0].settled:
                return v[1] if v[0].low else other
            return _hull(v[1], other)
        if n.op in ("fmin", "fmax") and (v[0].nan or v[1].nan):
            return _hull(*v)  # which of the two is taken is a matter of the format
        if n.op in RISING:
            return self.rising(n, v)
        if n.op in ("fabs", "sq"):
            return self.corners(n, _size(v[0]))
        if n.op in ("div", "inv") and v[-1].low <= 0 <= v[-1].high:
            return ANYTHING
        found = self.corners(n, *v)
        if n.op == "sign" and v[0].nan:  # 0 of what is not a number
            return _hull(Interval(found.low, found.high), FALSE)
        return self.between(n, found) if n.op == "add" else self.square(n, found)

    def compared(self, n: Node, x: Interval, y: Interval) -> Interval:
        if x.nan or y.nan:
            return UNDECIDED
        if n.op in ("lt", "le"):
            return self.corners(n, x, y)
        apart = x.high < y.low or x.low > y.high
        same = x.settled and y.settled and x.low == y.low
        if not (apart or same):
            return UNDECIDED
        return TRUE if same == (n.op == "eq") else FALSE

    def rising(self, n: Node, v: Sequence[Interval]) -> Interval:
        # With some units in the last place to spare.
        x = v[0]
        if n.op == "pow":
            exponent = self.kernel.nodes[n.args[1]]
            if exponent.op != "const" or exponent.value <= 0 or x.nan:
                return ANYTHING
        if x.low < RISING[n.op]:
            return ANYTHING
        found, room = self.corners(n, *v), 8 * self.fmt.epsilon
        kind = self.fmt.dtype.type
        low, high = found.low - room * abs(found.low), found.high + room * abs(found.high)
        return Interval(float(kind(low)), float(kind(high)), x.nan)

    def square(self, n: Node, found: Interval) -> Interval:
        # (c x) x with c >= 0 has no sign, however it is bracketed.
        for a, b in (n.args, n.args[::-1]) if n.op == "mul" else ():
            inner = self.kernel.nodes[a]
            for c, x in (inner.args, inner.args[::-1]) if inner.op == "mul" else ():
                if x == b and self.values[c].low >= 0 and not self.values[c].nan:
                    return Interval(max(found.low, 0.0), max(found.high, 0.0), found.nan)
        return found

    def between(self, n: Node, found: Interval) -> Interval:
        # p + g (u - p) with g in [0, 1): no farther than u, whatever intervals say.  With g a few
        # units in the last place below 1, rounding of product and difference cannot reach beyond.
        for a, b in (n.args, n.args[::-1]):
            product_ = self.chosen(b)
            for g, d in (product_.args, product_.args[::-1]) if product_.op == "mul" else ():
                gain, difference = self.values[g], self.chosen(d)
                if difference.op != "sub" or difference.args[1] != a:
                    continue
                if gain.low >= 0 and gain.high <= 1 - 16 * self.fmt.epsilon and not gain.nan:
                    both = _hull(self.values[a], self.values[difference.args[0]])
                    return found.inside(both.low, both.high)
        return found

    def chosen(self, i: int) -> Node:
        # A node, or what is taken instead of 0.
        n = self.kernel.nodes[i]
        return self.kernel.nodes[n.args[1]] if n.op == "if_else_zero" else n


def node_interval(kernel: Kernel, fmt: Format, n: Node, v: Sequence[Interval]) -> Interval:
    return _Evaluator(kernel, fmt).one(n, v)


def computed_intervals(
    kernel: Kernel,
    fmt: Format,
    arguments: Sequence[Sequence[Interval]],
    undecided: Collection[int] = (),
) -> list[Interval]:
    everything = Kernel(kernel.name, kernel.nodes, (tuple(range(len(kernel.nodes))),))
    fused = fuse_selects(everything)
    work = _Evaluator(fused, fmt)
    for i, n in enumerate(fused.nodes):
        if n.op == "input":
            work.values.append(arguments[n.source[0]][n.source[1]])
        else:
            work.values.append(
                UNDECIDED if i in undecided else work.one(n, [work.values[a] for a in n.args])
            )
    return work.values
