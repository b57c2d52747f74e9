"""Ranges and rounding errors of a kernel, operation by operation.

Every value of a kernel carries the interval of its exact value and an error model

    |computed - exact| <= a + r |exact|

pushed through operation by operation (the standard model of floating-point arithmetic, with a
term for underflow).  A comparison whose operands carry no error, or whose outcome follows from the
intervals, is decided alike in all formats; so is the comparison with zero of a sum of two exact
numbers, which no rounding turns into zero nor past it.  Any other is listed as an assumption.

Sums, products and choices of whole numbers below the format's largest (2^24 in f32) are exact.

References
----------
.. [1] N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., SIAM 2002, ch. 2, 3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from esea_gen.emit.elementary import ACCURACY_ULP, EXPONENT_FRACTION_BITS, exponent_q27
from esea_gen.emit.walker import Kernel, Node, fuse_selects

if TYPE_CHECKING:  # the q31 format is planned with this module's bounds
    from esea_gen.emit.formats.base import Format

# Largest error of the platform's float64 libm, in units in the last place (glibc documents 1).
LIBM_ULP = 1.0


class RangeError(Exception):
    """A range or an error grew without limit."""


@dataclass(slots=True)
class RangeValue:
    low: float
    high: float
    a: float = 0.0  # error model: ``|computed - exact| <= a + r |exact|``
    r: float = 0.0
    computed_low: float = -math.inf  # interval of the computed value
    computed_high: float = math.inf
    # The exact value is a whole number that the format holds, and the computed one is it.
    whole: bool = False
    magnitude: float = field(init=False)
    error: float = field(init=False)

    def __post_init__(self) -> None:
        # Made some 10^6 times in a bound: written for speed.
        low, high = self.low, self.high
        self.magnitude = m = max(high, -low)
        self.error = e = self.a + self.r * m
        self.computed_low = max(self.computed_low, low - e)
        self.computed_high = min(self.computed_high, high + e)

    @property
    def exact(self) -> bool:
        return self.a == 0 and self.r == 0


@dataclass(frozen=True)
class Analysis:
    results: tuple[tuple[RangeValue, ...], ...]
    assumptions: tuple[str, ...]  # decisions that rounding could turn: taken as equal


def _either(x: RangeValue, y: RangeValue, magnitude: float) -> tuple[float, float]:
    # Error model of a result z that is one of two values: |error| <= max_i (a_i + r_i |z|).
    for p, q in ((x, y), (y, x)):
        if p.a <= q.a and p.r <= q.r:
            return q.a, q.r
    return max(x.a + x.r * magnitude, y.a + y.r * magnitude), 0.0


class _Arithmetic:
    def __init__(self, fmt: Format) -> None:
        self.u = fmt.epsilon
        self.tiny = float(np.finfo(fmt.dtype).smallest_subnormal)
        self.fmt = fmt
        self.most = 1 / self.u  # all whole numbers up to here are numbers of the format
        self._constants: dict[float, RangeValue] = {}

    def elementary(self, name: str) -> float:
        # Relative error of a function: one unit in the last place is at most 2 u relative.
        ulp = LIBM_ULP if self.fmt.needs_libm else ACCURACY_ULP[name]
        return 2 * ulp * self.u

    def rounded(
        self, low: float, high: float, a: float, r: float, u: float | None = None
    ) -> RangeValue:
        u = self.u if u is None else u
        return RangeValue(low, high, a * (1 + u) + self.tiny, r * (1 + u) + u)

    def const(self, c: float) -> RangeValue:
        known = self._constants.get(c)
        if known is None:
            stored = float(self.fmt.dtype.type(c))
            whole = c == math.floor(c) and abs(c) <= self.most
            known = RangeValue(c, c, abs(stored - c), 0.0, stored, stored, whole)
            self._constants[c] = known
        return known

    def kept_whole(self, low: float, high: float, *operands: RangeValue) -> bool:
        # Whether a whole result of whole operands is a number of the format, so without rounding.
        return all(x.whole for x in operands) and max(high, -low) <= self.most

    def add(self, x: RangeValue, y: RangeValue) -> RangeValue:
        low, high = x.low + y.low, x.high + y.high
        if self.kept_whole(low, high, x, y):
            return RangeValue(low, high, whole=True)
        absolute = self.rounded(low, high, x.error + y.error, 0.0)
        if (x.low >= 0 and y.low >= 0) or (x.high <= 0 and y.high <= 0):
            # Nothing cancels: the relative errors do not grow.  Keep that form unless the absolute
            # one is far smaller (1 plus something small of poor relative accuracy).
            relative = self.rounded(low, high, x.a + y.a, max(x.r, y.r))
            if relative.error <= 2 * absolute.error:
                return relative
        return absolute

    def neg(self, x: RangeValue) -> RangeValue:
        return RangeValue(-x.high, -x.low, x.a, x.r, -x.computed_high, -x.computed_low, x.whole)

    def mul(self, x: RangeValue, y: RangeValue) -> RangeValue:
        corners = [p * q for p in (x.low, x.high) for q in (y.low, y.high)]
        if self.kept_whole(min(corners), max(corners), x, y):
            return RangeValue(min(corners), max(corners), whole=True)
        a = x.magnitude * y.a * (1 + x.r) + y.magnitude * x.a * (1 + y.r) + x.a * y.a
        return self.rounded(min(corners), max(corners), a, x.r + y.r + x.r * y.r)

    def sq(self, x: RangeValue) -> RangeValue:
        full = self.mul(x, x)
        low = 0.0 if x.low <= 0 <= x.high else min(x.low**2, x.high**2)
        return RangeValue(low, x.magnitude**2, full.a, full.r, whole=full.whole)

    def div(self, x: RangeValue, y: RangeValue) -> RangeValue:
        if y.low <= 0 <= y.high:
            raise RangeError(f"division by a range that holds zero: [{y.low:g}, {y.high:g}]")
        floor = min(abs(y.low), abs(y.high))
        k = y.r + y.a / floor
        if k >= 1:
            raise RangeError("division by a value whose error is as large as itself")
        corners = [p / q for p in (x.low, x.high) for q in (y.low, y.high)]
        return self.rounded(
            min(corners), max(corners), x.a / (floor * (1 - k)), (x.r + k) / (1 - k)
        )

    def fabs(self, x: RangeValue) -> RangeValue:
        low = 0.0 if x.low <= 0 <= x.high else min(abs(x.low), abs(x.high))
        return RangeValue(low, x.magnitude, x.a, x.r, whole=x.whole)

    def sign(self, x: RangeValue) -> RangeValue:
        low, high = (float((e > 0) - (e < 0)) for e in (x.low, x.high))
        # A sign that rounding may turn is wrong by as much as 2.
        turns = min(x.low, x.computed_low) <= 0 <= max(x.high, x.computed_high) and not x.exact
        return RangeValue(low, high, 2.0, 0.0) if turns else RangeValue(low, high, whole=True)

    def extreme(self, x: RangeValue, y: RangeValue, pick: str) -> RangeValue:
        f = min if pick == "fmin" else max
        low, high = f(x.low, y.low), f(x.high, y.high)
        return RangeValue(
            low,
            high,
            *_either(x, y, max(abs(low), abs(high))),
            f(x.computed_low, y.computed_low),
            f(x.computed_high, y.computed_high),
            x.whole and y.whole,
        )

    def hull(self, x: RangeValue, y: RangeValue) -> RangeValue:
        low, high = min(x.low, y.low), max(x.high, y.high)
        return RangeValue(
            low,
            high,
            *_either(x, y, max(abs(low), abs(high))),
            min(x.computed_low, y.computed_low),
            max(x.computed_high, y.computed_high),
            x.whole and y.whole,
        )

    def pow(self, x: RangeValue, c: float) -> RangeValue:
        if x.low < 0 or c <= 0:
            raise RangeError("only a power of a value that is not negative, by a positive constant")
        top = x.high * (1 + x.r) + x.a
        # For c < 1 the root's slope is unbounded at zero, but (X + a)^c - X^c <= a^c.
        a = c * top ** (c - 1) * x.a if c >= 1 else x.a**c
        bottom = x.low * (1 - x.r) - x.a
        if c < 1 and bottom > 0:  # away from zero the slope at the lower end bounds it
            a = min(a, c * bottom ** (c - 1) * x.a)
        r = math.expm1(c * math.log1p(x.r))
        if c < 1:  # then the lower side errs more, by all of it at most
            r = -math.expm1(c * math.log1p(-x.r)) if x.r < 1 else max(r, 1.0)
        if not self.fmt.needs_libm and x.high > 0:
            # The exponent is stored in 27 fractional bits; below 2^-149 the power underflows.
            dc = abs(exponent_q27(c) * 2.0**-EXPONENT_FRACTION_BITS - c)
            logs = [abs(math.log(max(e, 1e-45))) for e in (x.low, x.high)]
            r += math.expm1(dc * max(logs))
        return self.rounded(x.low**c, x.high**c, a, r, self.elementary("powk"))

    def monotone(self, x: RangeValue, name: str) -> RangeValue:
        f = {"exp": math.exp, "sqrt": math.sqrt, "log": math.log, "tanh": math.tanh}[name]
        e = x.error
        if name == "exp":
            return self.rounded(f(x.low), f(x.high), 0.0, math.expm1(e), self.elementary(name))
        if name == "tanh":
            return self.rounded(f(x.low), f(x.high), e, 0.0, self.elementary(name))
        if name == "sqrt" and x.low >= 0:
            # |sqrt(x + e) - sqrt(x)| <= sqrt(e), and e / sqrt(x) away from zero.
            spread = min(math.sqrt(e), e / math.sqrt(x.low)) if x.low > 0 else math.sqrt(e)
            return self.rounded(f(x.low), f(x.high), spread, 0.0, self.elementary(name))
        if x.low - e <= 0:
            raise RangeError(f"{name} of a range that reaches zero")
        slope = 1 / (x.low - e)
        return self.rounded(f(x.low), f(x.high), slope * e, 0.0, self.elementary(name))


@cache
def _arithmetic_of(fmt: Format) -> _Arithmetic:
    return _Arithmetic(fmt)


def _decide(op: str, x: RangeValue, y: RangeValue) -> RangeValue | None:
    # True or false in exact and in computed arithmetic alike, from the intervals; else None.
    high, low = max(x.high, x.computed_high), min(x.low, x.computed_low)
    other_low, other_high = min(y.low, y.computed_low), max(y.high, y.computed_high)
    yes, no = RangeValue(1, 1, whole=True), RangeValue(0, 0, whole=True)
    if op == "le":
        return yes if high <= other_low else no if low > other_high else None
    if op == "lt":
        return yes if high < other_low else no if low >= other_high else None
    return None


def analyse(
    kernel: Kernel,
    fmt: Format,
    arguments: Sequence[Sequence[RangeValue]],
    flag_results: Sequence[int] = (),
    facts: Mapping[int, tuple[float, float]] | None = None,
) -> Analysis:
    """Push ranges and errors through a kernel."""
    if facts is None:
        kernel = fuse_selects(kernel)
    known = facts or {}
    arithmetic = _arithmetic_of(fmt)
    values: list[RangeValue] = []
    turned = []
    unknown = RangeValue(0, 1, whole=True)
    for i, n in enumerate(kernel.nodes):
        v = [values[k] for k in n.args]
        if n.op == "const":
            result = arithmetic.const(n.value)
        elif n.op == "input":
            result = arguments[n.source[0]][n.source[1]]
        elif n.op in ("lt", "le", "eq", "ne"):
            decided = _decide(n.op, v[0], v[1])
            alike = v[0].exact and v[1].exact
            if decided is None and not alike and not _is_sign(kernel, n, values):
                turned.append(i)
            result = decided or unknown
        elif n.op == "not":
            settled = _settled(v[0])
            result = RangeValue(1 - v[0].high, 1 - v[0].low, whole=True) if settled else unknown
        elif n.op in ("and", "or"):
            result = _logic(n.op, v[0], v[1])
        else:
            try:
                result = _operation(arithmetic, kernel, n, v)
            except OverflowError:  # of an exponential or a power, in float64
                result = RangeValue(-math.inf, math.inf)
        if i in known:
            low, high = known[i]
            low, high = max(result.low, low), min(result.high, high)
            result = RangeValue(low, high, result.a, result.r, whole=result.whole)
        if not math.isfinite(result.error) or not math.isfinite(result.magnitude):
            raise RangeError(f"{kernel.name}: value v{i} ({n.op}) has no finite range")
        values.append(result)
    assumptions = []
    if turned:
        numbers = [r for k, r in enumerate(kernel.results) if k not in flag_results]
        numeric = _needed(kernel, numbers)
        assumptions = [
            f"{kernel.name}: v{i} = {kernel.nodes[i].op}" for i in turned if i in numeric
        ]
    return Analysis(tuple(tuple(values[i] for i in r) for r in kernel.results), tuple(assumptions))


def _is_sign(kernel: Kernel, comparison: Node, values: Sequence[RangeValue]) -> bool:
    # A sum of two exact numbers against zero.  Rounding keeps its sign, and, as there are
    # subnormal numbers, makes it zero only where it is.
    for a, b in (comparison.args, comparison.args[::-1]):
        summed, other = kernel.nodes[a], kernel.nodes[b]
        if other.op == "const" and other.value == 0 and summed.op in ("add", "sub"):
            return all(values[k].exact for k in summed.args)
    return False


def _needed(kernel: Kernel, results: Sequence[Sequence[int]]) -> set[int]:
    needed = {i for r in results for i in r}
    for i in reversed(range(len(kernel.nodes))):
        if i in needed:
            needed.update(kernel.nodes[i].args)
    return needed


def _settled(v: RangeValue) -> bool:
    return v.low == v.high and v.low in (0.0, 1.0)


def _logic(op: str, x: RangeValue, y: RangeValue) -> RangeValue:
    strong = 0.0 if op == "and" else 1.0
    for p in (x, y):
        if _settled(p) and p.low == strong:
            return RangeValue(strong, strong, whole=True)
    if _settled(x) and _settled(y):
        return RangeValue(1 - strong, 1 - strong, whole=True)
    return RangeValue(0, 1, whole=True)


def _operation(arithmetic: _Arithmetic, kernel: Kernel, n: Node, v: list[RangeValue]) -> RangeValue:
    if n.op == "add":
        return arithmetic.add(*v)
    if n.op == "sub":
        return arithmetic.add(v[0], arithmetic.neg(v[1]))
    if n.op in ("mul", "div"):
        return getattr(arithmetic, n.op)(*v)  # type: ignore[no-any-return]
    if n.op in ("neg", "sq", "fabs", "sign"):
        return getattr(arithmetic, n.op)(v[0])  # type: ignore[no-any-return]
    if n.op == "twice":
        whole = arithmetic.kept_whole(2 * v[0].low, 2 * v[0].high, v[0])
        return RangeValue(2 * v[0].low, 2 * v[0].high, 2 * v[0].a, v[0].r, whole=whole)
    if n.op == "inv":
        return arithmetic.div(RangeValue(1, 1), v[0])
    if n.op in ("fmin", "fmax"):
        return arithmetic.extreme(v[0], v[1], n.op)
    if n.op == "pow":
        exponent = kernel.nodes[n.args[1]]
        if exponent.op != "const":
            raise RangeError(f"{kernel.name}: a power with an exponent that is not constant")
        return arithmetic.pow(v[0], exponent.value)
    if n.op in ("exp", "log", "sqrt", "tanh"):
        return arithmetic.monotone(v[0], n.op)
    if n.op in ("if_else_zero", "select"):
        other = v[2] if n.op == "select" else RangeValue(0, 0, whole=True)
        if _settled(v[0]):
            return v[1] if v[0].low else other
        return arithmetic.hull(v[1], other)
    raise RangeError(f"{kernel.name}: no range rule for '{n.op}'")
