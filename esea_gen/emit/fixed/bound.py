"""Worst-case error of a lowered kernel against exact arithmetic, and of a Block for all time.

Every value carries the interval of its exact value and a bound on |computed - exact|, pushed
through operation by operation; what an operation adds itself is what the lowering recorded.  All
boxes of a Block's split ranges go through at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from esea_gen.emit.fixed.elementary import EXPONENT_ERROR
from esea_gen.emit.fixed.values import COMPARES, ZERO, LoweredKernel, Value
from esea_gen.emit.ranges import RangeError

Array = npt.NDArray[np.float64]
T = TypeVar("T")


@dataclass(eq=False)  # not frozen, for some 10^5 are made in a search
class Span:
    """Interval of the exact value and error model, one entry a box; it is never changed."""

    low: Array
    high: Array
    a: Array  # ``|computed - exact| <= a + r |exact|``, shape (boxes,)
    r: Array
    held: bool = False  # whether the computed value, too, lies in the interval

    @cached_property
    def magnitude(self) -> Array:
        return np.maximum(np.abs(self.low), np.abs(self.high))

    @cached_property
    def error(self) -> Array:
        return np.asarray(self.a + self.r * self.magnitude)

    @property
    def exact(self) -> bool:
        return not np.any(self.a) and not np.any(self.r)

    @property
    def content(self) -> Hashable:
        arrays = (self.low, self.high, self.a, self.r)
        return (*(x.tobytes() for x in arrays), self.held)


MOST_KNOWN = 6
"""Results of one node that are remembered."""


@dataclass
class Known:
    """Results of a kernel's nodes, by all that they follow from: a search asks again and again.

    Of a Block's plans most values are the same, and of one plan's analyses what no state leads to.
    All analyses that share it have the same boxes and facts.
    """

    results: dict[int, dict[Hashable, tuple[Span, str]]] = field(default_factory=dict)
    given: dict[int, dict[Hashable, Span]] = field(default_factory=dict)
    points: dict[int, Span] = field(default_factory=dict)
    ends: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    setting: Any = None  # what else the analyses share, made by the first

    def one(self, where: int, x: Span) -> Span:
        """The Span known of a node with the same content, or this one."""
        return _latest(self.given.setdefault(where, {}), x.content, lambda: x)

    def result(
        self, i: int, key: Hashable, make: Callable[[], tuple[Span, str]]
    ) -> tuple[Span, str]:
        """The result of node ``i``, made where it is not known."""

        def made() -> tuple[Span, str]:
            x, assumption = make()
            return self.one(i, x), assumption

        return _latest(self.results.setdefault(i, {}), key, made)


def _latest(known: dict[Hashable, T], key: Hashable, make: Callable[[], T]) -> T:
    # What is asked for moves to the end; of too many the one that was asked for longest ago goes.
    found = known.pop(key) if key in known else make()
    known[key] = found
    if len(known) > MOST_KNOWN:
        del known[next(iter(known))]
    return found


def span(low: float, high: float, error: float, boxes: int) -> Span:
    return Span(np.full(boxes, low), np.full(boxes, high), np.full(boxes, error), np.zeros(boxes))


def _corners(x: Span, y: Span, function: Any) -> tuple[Array, Array]:
    values = np.stack([function(p, q) for p in (x.low, x.high) for q in (y.low, y.high)])
    return values.min(axis=0), values.max(axis=0)


def _add(x: Span, y: Span) -> Span:
    low, high = x.low + y.low, x.high + y.high
    total = x.error + y.error
    # Where nothing cancels the relative errors do not grow: that form, unless it is far worse.
    alike = ((x.low >= 0) & (y.low >= 0)) | ((x.high <= 0) & (y.high <= 0))
    a, r = x.a + y.a, np.maximum(x.r, y.r)
    relative = alike & (a + r * np.maximum(np.abs(low), np.abs(high)) <= 2 * total)
    return Span(low, high, np.where(relative, a, total), np.where(relative, r, 0.0))


def _neg(x: Span) -> Span:
    return Span(-x.high, -x.low, x.a, x.r)


def _mul(x: Span, y: Span, same: bool) -> Span:
    low, high = _corners(x, y, np.multiply)
    if same:
        low = np.where((x.low <= 0) & (x.high >= 0), 0.0, low)
    a = x.magnitude * y.a * (1 + x.r) + y.magnitude * x.a * (1 + y.r) + x.a * y.a
    return Span(low, high, a, x.r + y.r + x.r * y.r)


def _div(x: Span, y: Span) -> Span:
    if np.any((y.low <= 0) & (y.high >= 0)):
        raise RangeError("division by a range that holds zero")
    floor = np.minimum(np.abs(y.low), np.abs(y.high))
    k = y.r + y.a / floor
    if np.any(k >= 1):
        raise RangeError("division by a value whose error is as large as itself")
    low, high = _corners(x, y, np.divide)
    return Span(low, high, x.a / (floor * (1 - k)), (x.r + k) / (1 - k))


def _pow(x: Span, c: float) -> Span:
    low, high = np.maximum(x.low, 0.0), np.maximum(x.high, 0.0)
    top = high * (1 + x.r) + x.a
    if c < 0:
        below = low * (1 - x.r) - x.a
        if np.any(below <= 0):
            raise RangeError("a negative power of a range that reaches zero")
        a, r = -c * below ** (c - 1) * x.a, np.expm1(c * np.log1p(-x.r))
        ends = high**c, low**c
    else:
        if c >= 1:
            a, r = c * top ** (c - 1) * x.a, np.expm1(c * np.log1p(x.r))
        else:
            # The slope is unbounded at zero, but (X + e)^c - X^c <= e^c.
            below = low * (1 - x.r) - x.a
            safe = np.where(below > 0, below, 1.0)
            a = np.where(below > 0, np.minimum(x.a**c, c * safe ** (c - 1) * x.a), x.a**c)
            r = _root_share(x.r, c)
        ends = low**c, high**c
    # The exponent is off by half of 2^-27.  Where x stays away from 0 that is a relative error;
    # else x^c |ln x| is bounded: it rises up to x = exp(-1/c) and falls from there to 1.
    off = EXPONENT_ERROR * 1.001
    floor = np.where(low > 0, low, 1.0)
    logs = np.maximum(np.abs(np.log(floor)), np.abs(np.log(np.maximum(top, 1e-300))))
    relative = np.where(low > 0, np.expm1(off * logs), np.inf)
    peak = np.clip(top, 1e-300, math.exp(-1 / abs(c)))
    beyond = np.where(top > 1, top ** abs(c) * np.log(np.maximum(top, 1.0)), 0.0)
    tilt = off * np.maximum(beyond, peak ** abs(c) * np.abs(np.log(peak)))
    near = np.where(low > 0, relative, 0.0) * ends[1] <= 8 * tilt
    use = (low > 0) & ((c < 0) | near)
    return Span(*ends, a + np.where(use, 0.0, tilt), r + np.where(use, relative, 0.0))


def _root_share(r: Array, c: float) -> Array:
    # The share by which x^c errs, 0 < c < 1, where x does by r: more on the lower side, by all of
    # it at most.
    above = np.maximum(1.0, np.expm1(c * np.log1p(r)))
    return np.where(r <= 0.5, -np.expm1(c * np.log1p(-np.minimum(r, 0.5))), above)


def _monotone(x: Span, name: str) -> Span:
    e, zero = x.error, np.zeros_like(x.low)
    if name == "exp":
        return Span(np.exp(x.low), np.exp(x.high), zero, np.expm1(e))
    if name == "tanh":
        return Span(np.tanh(x.low), np.tanh(x.high), e, zero)
    if name == "sqrt":
        low, high = np.maximum(x.low, 0.0), np.maximum(x.high, 0.0)
        # |sqrt(x + a) - sqrt(x)| <= sqrt(a), and a / sqrt(x) away from zero.
        root, below = np.sqrt(x.a), low * (1 - x.r)
        safe = np.where(below > 0, below, 1.0)
        a = np.where(below > 0, np.minimum(root, x.a / np.sqrt(safe)), root)
        return Span(np.sqrt(low), np.sqrt(high), a, _root_share(x.r, 0.5))
    if np.any(x.low - e <= 0):
        raise RangeError("log of a range that reaches zero")
    return Span(np.log(x.low), np.log(x.high), -np.log1p(-e / x.low), zero)


def _either(x: Span, y: Span, low: Array, high: Array) -> Span:
    # One of two values: |error| <= max_i (a_i + r_i |z|).
    magnitude = np.maximum(np.abs(low), np.abs(high))
    mine, other = (x.a <= y.a) & (x.r <= y.r), (y.a <= x.a) & (y.r <= x.r)
    flat = np.maximum(x.a + x.r * magnitude, y.a + y.r * magnitude)
    a = np.where(mine, y.a, np.where(other, x.a, flat))
    return Span(low, high, a, np.where(mine, y.r, np.where(other, x.r, 0.0)))


def _seen(x: Span, own: Value | None) -> tuple[Array, Array]:
    # Where exact and computed value lie; what is emitted never leaves its proven interval.
    if x.held:
        return x.low, x.high
    low, high = x.low - x.error, x.high + x.error
    if own is not None:
        low = np.minimum(x.low, np.maximum(low, float(own.low)))
        high = np.maximum(x.high, np.minimum(high, float(own.high)))
    return low, high


def _decide(
    op: str, x: Span, y: Span, own: tuple[Value | None, Value | None]
) -> tuple[Array, Array]:
    # Interval of the truth value, from what both exact and computed arithmetic can see.
    (xl, xh), (yl, yh) = _seen(x, own[0]), _seen(y, own[1])
    yes, no = {
        "le": (xh <= yl, xl > yh),
        "lt": (xh < yl, xl >= yh),
        "eq": (np.zeros_like(xl, bool), (xh < yl) | (xl > yh)),
        "ne": ((xh < yl) | (xl > yh), np.zeros_like(xl, bool)),
    }[op]
    return np.where(yes, 1.0, 0.0), np.where(no, 0.0, 1.0)


def _select(c: Span, x: Span, y: Span) -> Span:
    first, second = c.low == 1, c.high == 0
    both = _either(x, y, np.minimum(x.low, y.low), np.maximum(x.high, y.high))

    def pick(p: Array, q: Array, else_: Array) -> Array:
        return np.where(first, p, np.where(second, q, else_))

    return Span(
        pick(x.low, y.low, both.low),
        pick(x.high, y.high, both.high),
        pick(x.a, y.a, both.a),
        pick(x.r, y.r, both.r),
    )


def _extreme(op: str, x: Span, y: Span) -> Span:
    f = np.minimum if op == "fmin" else np.maximum
    both = _either(x, y, f(x.low, y.low), f(x.high, y.high))
    # Where one side wins in exact and in computed arithmetic alike, its error alone counts.
    room = x.error + y.error
    if op == "fmin":
        mine, other = y.low - x.high >= room, x.low - y.high >= room
    else:
        mine, other = x.low - y.high >= room, y.low - x.high >= room
    return Span(
        both.low,
        both.high,
        np.where(mine, x.a, np.where(other, y.a, both.a)),
        np.where(mine, x.r, np.where(other, y.r, both.r)),
    )


def _operation(op: str, v: list[Span], same: bool, exponent: float) -> Span:
    zero = np.zeros_like(v[0].low)
    if op == "add":
        return _add(v[0], v[1])
    if op == "sub":
        return _add(v[0], _neg(v[1]))
    if op in ("mul", "sq"):
        return _mul(v[0], v[-1], same)
    if op == "div":
        return _div(v[0], v[1])
    if op == "neg":
        return _neg(v[0])
    if op == "twice":
        return Span(2 * v[0].low, 2 * v[0].high, 2 * v[0].a, v[0].r)
    if op == "fabs":
        crosses = (v[0].low <= 0) & (v[0].high >= 0)
        low = np.where(crosses, 0.0, np.minimum(np.abs(v[0].low), np.abs(v[0].high)))
        return Span(low, v[0].magnitude, v[0].a, v[0].r)
    if op in ("fmin", "fmax"):
        return _extreme(op, v[0], v[1])
    if op == "pow":
        return _pow(v[0], exponent)
    if op in ("exp", "log", "sqrt", "tanh"):
        return _monotone(v[0], op)
    if op == "sign":
        e = v[0].error
        sure = (v[0].low > e) | (v[0].high < -e) | (e == 0)
        return Span(np.sign(v[0].low), np.sign(v[0].high), np.where(sure, 0.0, 2.0), zero)
    if op == "select":
        return _select(*v)
    if op == "if_else_zero":
        return _select(v[0], v[1], Span(zero, zero, zero, zero))
    raise RangeError(f"no error rule for '{op}'")


def _relative(x: Span) -> Span:
    # Away from zero a small absolute error is carried as a relative one: products and quotients
    # of wide intervals then keep it small, where an absolute one would meet the other's largest.
    least = np.minimum(np.abs(x.low), np.abs(x.high))
    away = (x.low > 0) | (x.high < 0)
    share = x.a / np.where(away, least, 1.0)
    use = away & (share <= np.maximum(8 * x.r, 2.0**-30))
    return Span(x.low, x.high, np.where(use, 0.0, x.a), np.where(use, x.r + share, x.r), x.held)


def _logic(op: str, v: list[Span]) -> Span:
    zero = np.zeros_like(v[0].low)
    sure = [np.asarray((x.low > 0) | (x.high < 0), dtype=np.float64) for x in v]
    maybe = [np.asarray((x.low != 0) | (x.high != 0), dtype=np.float64) for x in v]
    if op == "not":
        low: Array = np.asarray(1.0 - maybe[0], dtype=np.float64)
        return Span(low, np.asarray(1.0 - sure[0], dtype=np.float64), zero, zero)
    if op == "and":
        return Span(np.minimum(*sure), np.minimum(*maybe), zero, zero)
    return Span(np.maximum(*sure), np.maximum(*maybe), zero, zero)


def numeric_nodes(
    lowered: LoweredKernel, flag_results: Sequence[int], solved: Collection[int] = ()
) -> set[int]:
    kernel = lowered.kernel
    needed = {i for k, r in enumerate(kernel.results) if k not in flag_results for i in r}
    for i in reversed(range(len(kernel.nodes))):
        if i in needed and i not in solved:
            needed.update(kernel.nodes[i].args)
    return needed


def analyse(
    lowered: LoweredKernel,
    arguments: Sequence[Sequence[Span]],
    flag_results: Sequence[int] = (),
    facts: Mapping[int, tuple[Array, Array]] | None = None,
    boxes: int = 1,
    solved: Mapping[int, Span] | None = None,
    known: Known | None = None,
) -> tuple[list[list[Span]], tuple[str, ...], list[Span]]:
    kernel = lowered.kernel
    solved, facts, known = solved or {}, facts or {}, known or Known()
    numeric = numeric_nodes(lowered, flag_results, solved)
    values: list[Span] = []
    assumptions = []
    for i, n in enumerate(kernel.nodes):
        own = lowered.values[i]
        if n.op == "input":
            values.append(known.one(i, arguments[n.source[0]][n.source[1]]))
            continue
        if n.op == "const" or own is None or (solved and i not in numeric):
            # Of what is a part of a status word, or not followed, nothing is known.
            if i not in known.points:
                number = n.value if n.op == "const" else 0.0
                known.points[i] = span(number, number, 0.0, boxes)
            values.append(known.points[i])
            continue
        if i in solved:
            values.append(known.one(i, solved[i]))
            continue
        node = _Node(lowered, i, facts.get(i), i in numeric)
        v = [_operand(values, k) for k in n.args]
        value, assumption = known.result(i, (node.key, *v), partial(node.result, v))
        values.append(value)
        if assumption:
            assumptions.append(assumption)
    results = [
        [
            Span(values[i].low, values[i].high, values[i].a + c, values[i].r)
            for i, c in zip(r, conversion, strict=True)
        ]
        for r, conversion in zip(kernel.results, lowered.conversions, strict=True)
    ]
    return results, tuple(assumptions), values


def _operand(values: list[Span], k: int) -> Span:
    if k == ZERO:
        raise RangeError("a select's missing arm is no operand")
    return values[k]


@dataclass(frozen=True)
class _Node:
    # A node of a lowered kernel that is computed: the fact known of it, whether a number needs it.
    lowered: LoweredKernel
    i: int
    fact: tuple[Array, Array] | None
    numeric: bool

    @property
    def own(self) -> Value:
        found = self.lowered.values[self.i]
        assert found is not None
        return found

    @property
    def key(self) -> Hashable:
        # All of the lowering that the result depends on; operands and facts aside.
        own, n = self.own, self.lowered.kernel.nodes[self.i]
        sides = [self.lowered.values[k] for k in n.args] if n.op in COMPARES else []
        ranges = [x and (x.low, x.high) for x in sides]
        stored = tuple(own.constants.items())
        return own.local, own.relative, stored, self.numeric, *ranges

    def result(self, given: list[Span]) -> tuple[Span, str]:
        kernel, i, own = self.lowered.kernel, self.i, self.own
        n = kernel.nodes[i]
        stored = [own.constants.get(position, 0.0) for position in range(len(given))]
        v = [
            Span(x.low, x.high, x.a + c, x.r) if c else x
            for x, c in zip(given, stored, strict=True)
        ]
        zero = np.zeros_like(v[0].low)
        if n.op in COMPARES:
            owners = self.lowered.values[n.args[0]], self.lowered.values[n.args[1]]
            low, high = _decide(n.op, v[0], v[1], owners)
            sure = v[0].exact and v[1].exact and own.local == 0
            open_ = self.numeric and not sure and bool(np.any(low != high))
            said = f"{kernel.name}: v{i} = {n.op}" if open_ else ""
            return Span(low, high, zero, zero), said
        if n.op in ("and", "or", "not"):
            return _logic(n.op, v), ""
        exponent = kernel.nodes[n.args[1]].value if n.op == "pow" else 0.0
        result = _operation(n.op, v, n.args[0] == n.args[-1], exponent)
        low, high = result.low, result.high
        if self.fact is not None:
            low = np.maximum(low, self.fact[0])
            # In a box that no value can be in, any value will do.
            high = np.maximum(np.minimum(high, self.fact[1]), low)
        more = 1 + own.relative
        result = _relative(
            Span(low, high, result.a * more + own.local, result.r * more + own.relative)
        )
        if not np.all(np.isfinite(result.error)):
            raise RangeError(f"{kernel.name}: value v{i} ({n.op}) has no finite error")
        return result, ""
