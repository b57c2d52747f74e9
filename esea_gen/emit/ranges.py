"""Ranges and rounding errors of a kernel: where a stated float32 bound comes from.

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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise, product
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from esea_gen.emit.elementary import ACCURACY_ULP, EXPONENT_FRACTION_BITS, exponent_q27
from esea_gen.emit.walker import Kernel, Node, fuse_selects, labelled_kernel, walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port

if TYPE_CHECKING:  # the q31 format is planned with this module's bounds
    from esea_gen.emit.formats.base import Format

# Largest error of the platform's float64 libm, in units in the last place (glibc documents 1).
LIBM_ULP = 1.0


class RangeError(Exception):
    """A range or an error grew without limit."""


@dataclass(slots=True)
class RangeValue:
    """Range and error of one value; never changed once made.

    a, r: error model: ``|computed - exact| <= a + r |exact|``.
    computed_low, computed_high: interval of the computed value.
    whole: the exact value is a whole number that the format holds, and the computed one is it.
    """

    low: float
    high: float
    a: float = 0.0
    r: float = 0.0
    computed_low: float = -math.inf
    computed_high: float = math.inf
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
        """Whether the computed value is the exact one."""
        return self.a == 0 and self.r == 0


@dataclass(frozen=True)
class Analysis:
    """Result of an analysis.

    assumptions: decisions that rounding could turn: taken as equal.
    """

    results: tuple[tuple[RangeValue, ...], ...]
    assumptions: tuple[str, ...]


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
        if c < 1 and x.r < 1:
            r = -math.expm1(c * math.log1p(-x.r))  # then the lower side errs more
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
    """Push ranges and errors through a kernel.

    flag_results: results that are status words: a decision that only they use is no assumption.
    facts: ranges of nodes known from algebra; the kernel must then be fused already.
    """
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
            result = _operation(arithmetic, kernel, n, v)
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
    for i in range(len(kernel.nodes) - 1, -1, -1):
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


@dataclass(frozen=True)
class Bound:
    """Worst-case error of a Block in a number format, against exact arithmetic.

    steps: number of steps it holds for: ``inf`` when the Block forgets its errors; 1 for what one
        step adds, from the same memory.
    method: ``fixed point``, ``linear`` or ``one step``.
    assumptions: decisions taken as equal; inputs taken as whole numbers.
    """

    format: str
    steps: float
    outputs: dict[str, float]
    states: dict[str, float]
    method: str
    assumptions: tuple[str, ...]


def _coefficients(block: Block, fmt: Format) -> list[list[RangeValue]]:
    if not block.tunables:
        return []
    values = [ca.DM(t.default) for t in block.tunables]
    prepared = [np.asarray(c, dtype=float).ravel() for c in block.prepare.call(values)]
    arguments = [[RangeValue(t.default, t.default)] for t in block.tunables]
    derived = analyse(walk(block.prepare), fmt, arguments).results
    return [
        [RangeValue(x, x, v.error) for x, v in zip(c, d, strict=True)]
        for c, d in zip(prepared, derived, strict=True)
    ]


def counts(port: Port) -> bool:
    """Whether a port counts: a mode, a number of frames, a stamp.

    return: true without a unit, with whole ends more than one apart and a whole initial value, all
        below 2^24. An input of that kind is given whole numbers; a state of that kind is one where
        the analysis finds that every step makes it one.
    """
    values = (port.low, port.high, port.init)
    return (
        port.unit == "1"
        and port.high - port.low > 1
        and all(x == math.floor(x) and abs(x) < 2.0**24 for x in values)
    )


class _Step:
    """One step of a Block under the error analysis, over its ranges.

    room: share of each range that inputs and states may lie beyond it: the guard's own comparisons
        then stay undecided, and what follows an invalid input or a corrupt state counts as well.
    """

    def __init__(
        self,
        block: Block,
        fmt: Format,
        ranges: Mapping[str, tuple[float, float]] | None,
        room: float = 0.0,
    ) -> None:
        self.block, self.fmt = block, fmt
        self.kernel, self.facts = _with_facts(block)
        self.coefficients = _coefficients(block, fmt)
        self.limits = limits_of(block, ranges or {})
        self.boxes = boxes_of(
            block,
            {k: (a - room * (b - a), b + room * (b - a)) for k, (a, b) in self.limits.items()},
        )
        self.zero = [[0.0] * p.size for p in block.state]
        self.whole = {f"u_{p.name}" for p in block.inputs if counts(p)}
        self.whole |= {f"s_{p.name}" for p in block.state if counts(p)}
        # The states are whole if, all of them taken as whole, one step leaves them whole; drop
        # those that it does not, until none is dropped.
        while True:
            after = self(self.zero).results
            lost = {
                f"s_{p.name}"
                for p, r in zip(block.state, after, strict=False)
                if f"s_{p.name}" in self.whole and not all(v.whole for v in r)
            }
            if not lost:
                break
            self.whole -= lost
        self.assumptions = tuple(
            f"{block.name}: {p.name} is a whole number"
            for p in block.inputs
            if f"u_{p.name}" in self.whole
        )

    def __call__(self, errors: Errors, kernel: Kernel | None = None) -> Analysis:
        """Errors of the results of one step from errors of the states, the worst of all boxes."""
        parts = []
        for box in self.boxes:
            state = [
                [self._state(box, f"s_{p.name}", x) for x in e]
                for p, e in zip(self.block.state, errors, strict=True)
            ]
            inputs = [[self._input(box, f"u_{p.name}")] * p.size for p in self.block.inputs]
            arguments = [*self.coefficients, *state, *inputs]
            flags = self.block.flag_results if kernel is None else ()
            parts.append(analyse(kernel or self.kernel, self.fmt, arguments, flags, self.facts))
        return _worst(parts)

    def _input(self, box: Mapping[str, tuple[float, float]], name: str) -> RangeValue:
        low, high = box[name]
        return RangeValue(low, high, whole=name in self.whole)

    def _state(self, box: Mapping[str, tuple[float, float]], name: str, error: float) -> RangeValue:
        return RangeValue(*box[name], error, 0.0, *box[name], name in self.whole and error == 0)

    def state_errors(self, result: Analysis) -> Errors:
        """Errors of the states: both the exact and the computed one lie in the port's range."""
        out = []
        for p, r in zip(self.block.state, result.results, strict=False):
            low, high = self.limits[f"s_{p.name}"]
            out.append([min(v.error, high - low) for v in r])
        return out

    def bound(
        self, final: Analysis, states: Errors, steps: float, method: str, *extra: str
    ) -> Bound:
        """The errors as a Bound."""
        outputs = final.results[len(self.block.state) :]
        return Bound(
            self.fmt.name,
            steps,
            {
                p.name: float(max(v.error for v in r))
                for p, r in zip(self.block.outputs, outputs, strict=True)
                if not p.flags
            },
            {p.name: float(max(e)) for p, e in zip(self.block.state, states, strict=True)},
            method,
            final.assumptions + self.assumptions + extra,
        )


def block_bound(
    block: Block, fmt: Format, ranges: Mapping[str, tuple[float, float]] | None = None
) -> Bound:
    """Derive a Block's worst-case error, for any number of steps, at its default tunables.

    The inputs are taken as exact in the format.  The state's error is a fixed point of one step's
    error propagation, verified as inductive: errors no larger going in come out no larger.  For a
    linear Block, whose stability intervals cannot see, one step's own error is summed through the
    powers of its state matrix instead.

    ranges: ``{"u_theta_rad": (low, high), "s_tau_r_Nm": ...}``: inputs and states that stay inside
        these ranges instead of their ports'.
    """
    once = _Step(block, fmt, ranges)
    limits = once.limits
    method, extra = "fixed point", tuple[str, ...]()
    solved = fixed_point(once, once.state_errors, once.zero)
    # At the ends of the states' own ranges it says nothing.
    idle = solved is not None and any(
        max(e) > 0.25 * (limits[f"s_{p.name}"][1] - limits[f"s_{p.name}"][0])
        for p, e in zip(block.state, solved, strict=True)
    )
    if (solved is None or idle) and is_linear(once.kernel, len(block.coefficients)):
        solved, idle = linear_bound(block, once.state_errors(once(once.zero))), False
        method, extra = "linear", (f"{block.name}: no clip of a state acts",)
    if solved is None or idle:
        raise RangeError(f"{block.name}: not stable, rounding errors may grow without limit")
    return once.bound(once(solved), solved, math.inf, method, *extra)


# A little beyond the ports' ranges, so that the guard's own comparisons stay undecided.
BEYOND = 1e-6


def step_bound(
    block: Block, fmt: Format, ranges: Mapping[str, tuple[float, float]] | None = None
) -> Bound:
    """Derive the error that one step of a Block adds, from the same memory.

    For a Block that :func:`block_bound` refuses: an integral, or a limit on the rate of change,
    adds its rounding errors up.

    return: with ``steps`` 1: of the outputs, and of the states after the step. It holds for corrupt
        states and invalid inputs too.
    """
    once = _Step(block, fmt, ranges, BEYOND)
    final = once(once.zero)
    return once.bound(final, once.state_errors(final), 1, "one step")


def node_errors(block: Block, fmt: Format) -> tuple[Kernel, list[float]]:
    """Largest |error| of every value of a step, from the same memory.

    return: per node, given that all decisions before it are the same.
    """
    once = _Step(block, fmt, None, BEYOND)
    kernel = once.kernel
    everything = Kernel(kernel.name, kernel.nodes, (tuple(range(len(kernel.nodes))),))
    return kernel, [v.error for v in once(once.zero, everything).results[0]]


def whole_nodes(block: Block, kernel: Kernel, fmt: Format) -> frozenset[int]:
    """Values of a step that are whole numbers, as long as what counts is given whole numbers.

    return: nodes of ``kernel``; empty when the analysis finds no finite range for one.
    """
    everything = Kernel(kernel.name, kernel.nodes, (tuple(range(len(kernel.nodes))),))
    try:
        once = _Step(block, fmt, None, BEYOND)
        once.facts = {}
        (values,) = once(once.zero, fuse_selects(everything)).results
    except RangeError:
        return frozenset()
    return frozenset(i for i, v in enumerate(values) if v.whole)


def _with_facts(block: Block) -> tuple[Kernel, dict[int, tuple[float, float]]]:
    # The fused step, and which of its nodes a fact is known of.
    kernel, labels = labelled_kernel(block, fuse_selects)
    return kernel, {node: block.facts[n] for node, n, _ in labels if n in block.facts}


def limits_of(
    block: Block, ranges: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Ranges of a Block's states (``s_...``) and inputs (``u_...``).

    ranges: ranges to use instead of the ports'.
    """
    own = {f"s_{p.name}": (p.low, p.high) for p in block.state}
    own |= {f"u_{p.name}": (p.low, p.high) for p in block.inputs}
    unknown = sorted(set(ranges) - set(own))
    if unknown:
        raise ValueError(f"block {block.name}: no state or input {unknown}; there are {list(own)}")
    return own | dict(ranges)


def boxes_of(
    block: Block, limits: Mapping[str, tuple[float, float]]
) -> list[dict[str, tuple[float, float]]]:
    """Cut the ranges where the Block says: one box for every choice of pieces.

    Cuts of labelled values are left out: only the analysis of whole numbers takes them.

    limits: from :func:`limits_of`.
    """
    axes = []
    for name, cuts in block.split.items():
        if name in limits:
            axes.append([(name, pair) for pair in pieces(limits[name], cuts)])
    return [dict(limits) | dict(choice) for choice in product(*axes)]


def pieces(limits: tuple[float, float], cuts: Sequence[float]) -> list[tuple[float, float]]:
    """Cut a range at magnitudes.

    limits: the range.
    cuts: magnitudes; each cuts on both sides of zero, where the range holds it.
    """
    low, high = limits
    inside = sorted({c for m in cuts for c in (m, -m) if low < c < high})
    return list(pairwise([low, *inside, high]))


def _worst(parts: Sequence[Analysis]) -> Analysis:
    # A box's error is turned into an absolute one, so that the worst of all boxes is one number.
    results = []
    for values in zip(*(p.results for p in parts), strict=True):
        results.append(
            tuple(
                RangeValue(
                    min(v.low for v in e),
                    max(v.high for v in e),
                    max(v.error for v in e),
                    whole=all(v.whole for v in e),
                )
                for e in zip(*values, strict=True)
            )
        )
    return Analysis(tuple(results), tuple(sorted({a for p in parts for a in p.assumptions})))


Errors = list[list[float]]


def fixed_point(
    once: Callable[[Errors], Analysis], state_errors: Callable[[Analysis], Errors], zero: Errors
) -> Errors | None:
    """Find errors of the states that one step does not make larger.

    once: errors of the results of one step from errors of the states.
    return: an inductive bound per state and element; None when none is found.
    """

    def image(errors: Errors) -> Errors:
        return state_errors(once(errors))

    def scaled(errors: Errors, factor: float) -> Errors:
        # An error that has stopped growing is its own bound; only the others are searched for.
        rows = zip(errors, before, strict=True)
        return [
            [e if e <= b * (1 + 1e-12) else factor * e for e, b in zip(new, old, strict=True)]
            for new, old in rows
        ]

    def inductive(errors: Errors) -> bool:
        pairs = zip(image(errors), errors, strict=True)
        return all(n <= e for new, old in pairs for n, e in zip(new, old, strict=True))

    before = errors = zero
    for _ in range(3):
        before, errors = errors, image(errors)
    # Any multiple that is inductive is a bound; find the smallest power of 4, halve the gap ...
    factor = 1.0
    while not inductive(scaled(errors, factor)):
        factor *= 4
        if factor > 4.0**12:
            return None
    low = factor / 4
    for _ in range(4 if factor > 1 else 0):
        middle = math.sqrt(low * factor)
        if inductive(scaled(errors, middle)):
            factor = middle
        else:
            low = middle
    # ... and let the errors that do not accumulate fall back to their own size: the image of an
    # inductive bound is a bound again.
    errors = scaled(errors, factor)
    for _ in range(3):
        errors = image(errors)
    return errors


def is_linear(kernel: Kernel, coefficients: int) -> bool:
    """Whether states and inputs enter a step only linearly, up to clips and selections."""
    varies: list[bool] = []
    for n in kernel.nodes:
        moving = [varies[k] for k in n.args]
        if n.op == "input":
            varies.append(n.source[0] >= coefficients)
            continue
        # |x| only feeds comparisons in a linear Block, and bends nothing there.
        bent = n.op in ("sq", "inv", "pow", "exp", "log", "tanh", "sqrt", "sign")
        if (bent and any(moving)) or (n.op == "mul" and all(moving)):
            return False
        if n.op == "div" and moving[1]:
            return False
        varies.append(any(moving))
    return True


def linear_bound(block: Block, local: Errors) -> Errors | None:
    """Sum one step's own errors through the powers of a linear Block's state matrix.

    return: bound for any number of steps; None when the matrix varies or is not stable.
    """
    state = block.step.sx_in()
    n_c = len(block.coefficients)
    symbols = ca.veccat(*state[n_c : n_c + len(block.state)])
    results = block.step.call(state)
    jacobian = ca.Function(
        "A", state, [ca.jacobian(ca.veccat(*results[: len(block.state)]), symbols)]
    )
    prepared = block.prepare.call([ca.DM(t.default) for t in block.tunables])
    # Once primed and inside all limits the matrix must be one and the same wherever it is taken.
    rng = np.random.default_rng(0)
    a: Array | None = None
    # What counts (a mode, a key) chooses between matrices: it takes each of its values.

    def drawn(p: Port, scale: float) -> ca.DM:
        if p.name == "primed":
            return ca.DM([1.0])
        if counts(p):
            return ca.DM(rng.integers(int(p.low), int(p.high) + 1, p.size).astype(float))
        return ca.DM(scale * rng.uniform(p.low, p.high, p.size))

    for scale in (0.0, *[0.02] * 40):
        middle = [drawn(p, scale) for p in block.state]
        inputs = [drawn(p, scale) for p in block.inputs]
        found: Array = np.asarray(ca.DM(jacobian(*prepared, *middle, *inputs)), dtype=float)
        if a is not None and not np.allclose(found, a, rtol=1e-12, atol=0.0):
            return None
        a = found
    assert a is not None
    flags = [k for k, p in enumerate(block.state) if p.name == "primed" for _ in range(p.size)]
    a[flags, :] = 0.0
    a[:, flags] = 0.0
    if np.max(np.abs(np.linalg.eigvals(a))) >= 1:
        return None
    d = np.concatenate([np.asarray(e) for e in local])
    total, power = np.zeros_like(d), np.eye(len(d))
    while True:
        step = np.abs(power) @ d
        total += step
        if np.all(step <= 1e-12 * total + 1e-300):
            break
        power = a @ power
    sizes = np.cumsum([p.size for p in block.state])[:-1]
    return [list(map(float, 1.000001 * part)) for part in np.split(total, sizes)]


__all__ = [
    "Analysis",
    "Bound",
    "RangeError",
    "RangeValue",
    "analyse",
    "block_bound",
    "counts",
    "node_errors",
    "step_bound",
    "whole_nodes",
]
