"""Ranges and rounding errors of a kernel's operations in any number format.

Every value carries the interval of its exact value and an error model

    |computed - exact| <= a + r |exact|

pushed through operation by operation: what an operation does to the errors of its operands is here,
what it adds is in a format's :class:`Rounding`.  A comparison whose operands carry no error, or
whose outcome follows from the intervals, is decided alike in all formats; any other is listed as an
assumption.  All boxes of a Block's split ranges go through at once.

References
----------
.. [1] N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., SIAM 2002, ch. 2, 3.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from esea_gen.emit.walker import BOOLEAN, Kernel, Node

Array = npt.NDArray[np.float64]
T = TypeVar("T")
COMPARES = frozenset({"lt", "le", "eq", "ne"})
MOST_KNOWN = 6  # results of one node that are remembered


class RangeError(Exception):
    """A range or an error grew without limit."""


@dataclass(eq=False)  # not frozen, for some 10^5 are made in a search
class Span:
    """Interval of the exact value and error model, one entry a box; it is never changed."""

    low: Array
    high: Array
    a: Array
    r: Array
    # What the computed value never leaves, where more is known of it than its error.
    reach: tuple[Any, Any] | None = None
    whole: bool = False  # a whole number that the format holds, and computed as it is
    signed: bool = False  # computed with the exact value's sign, 0 where that is

    @cached_property
    def magnitude(self) -> Array:
        return np.maximum(np.abs(self.low), np.abs(self.high))

    @cached_property
    def error(self) -> Array:
        return np.asarray(self.a + self.r * self.magnitude)

    @property
    def exact(self) -> bool:
        return not self.a.any() and not self.r.any()

    @cached_property
    def seen(self) -> tuple[Array, Array]:
        """Where exact and computed value lie."""
        low, high = self.low - self.error, self.high + self.error
        if self.reach is not None:
            low = np.minimum(self.low, np.maximum(low, self.reach[0]))
            high = np.maximum(self.high, np.minimum(high, self.reach[1]))
        return low, high

    @property
    def content(self) -> Hashable:
        ends = [x.tobytes() if isinstance(x, np.ndarray) else x for x in self.reach or ()]
        arrays = self.low, self.high, self.a, self.r
        return (*(x.tobytes() for x in arrays), *ends, self.whole, self.signed)


def span(low: float, high: float, error: float, boxes: int) -> Span:
    """The same interval and error in every box."""
    return Span(np.full(boxes, low), np.full(boxes, high), np.full(boxes, error), np.zeros(boxes))


@dataclass
class Known:
    """Cache of a kernel's node results by their inputs, for repeated queries of a search.

    Of a Block's plans most values are the same, and of one plan's analyses what no state leads to.
    All analyses that share it have the same boxes and facts.
    """

    # Per node: results, with the assumption that a comparison is; the latest last.
    results: dict[int, dict[Hashable, tuple[Span, str]]] = field(default_factory=dict)
    # Per node: the one Span of some content, for what follows is told by identity.
    given: dict[int, dict[Hashable, Span]] = field(default_factory=dict)
    points: dict[int, Span] = field(default_factory=dict)  # constants, and what nothing follows
    setting: Any = None  # what else the analyses share, made by the first
    matrix: tuple[Any] | None = None  # of a linear Block, or that it has none
    beside: dict[int, Known] = field(default_factory=dict)  # of so many cases at once

    def one(self, where: int, x: Span) -> Span:
        known, key = self.given.setdefault(where, {}), x.content
        return _keep(known, key, known.pop(key, x))


def _keep(known: dict[Hashable, T], key: Hashable, found: T) -> T:
    # What is asked for moves to the end; of too many the one that was asked for longest ago goes.
    known[key] = found
    if len(known) > MOST_KNOWN:
        del known[next(iter(known))]
    return found


class Rounding(ABC):
    """Rounding errors that a number format adds to one kernel's operations."""

    keeps_whole = False  # whether sums and products of whole numbers are exact

    def __init__(self, kernel: Kernel) -> None:
        self.kernel = kernel

    def computed(self, i: int) -> bool:
        """Whether a node is a value of its own."""
        return True

    @abstractmethod
    def constant(self, value: float, boxes: int) -> Span:
        """A number of the kernel."""

    def read(self, i: int, x: Span) -> Span:
        """An input as it is read."""
        return x

    def stored(self, i: int) -> Mapping[int, float]:
        """By operand position: the error of a constant as it is stored for a node."""
        return {}

    def key(self, i: int) -> Hashable:
        """All of the format that a node's result depends on."""
        return None

    @abstractmethod
    def exponent_error(self, exponent: float) -> float:
        """How far the exponent of a power may be off."""

    @abstractmethod
    def finished(self, i: int, operands: Sequence[Span], x: Span) -> Span:
        """A node's result with its own rounding and reach; so far its operands' errors alone."""

    def settled(self, i: int, operands: Sequence[Span]) -> bool:
        """Whether a comparison, undecided by intervals, is decided alike all the same."""
        return operands[0].exact and operands[1].exact


# -- one operation ---------------------------------------------------------------------------------


def _corners(x: Span, y: Span, function: Any) -> tuple[Array, Array]:
    values = np.stack([function(p, q) for p in (x.low, x.high) for q in (y.low, y.high)])
    return values.min(axis=0), values.max(axis=0)


def _add(x: Span, y: Span) -> Span:
    low, high = x.low + y.low, x.high + y.high
    total = x.error + y.error
    # Where nothing cancels the relative errors do not grow: that form, unless it is far worse.
    alike = ((x.low >= 0) & (y.low >= 0)) | ((x.high <= 0) & (y.high <= 0))
    if not alike.any():
        return Span(low, high, total, _none(x))
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
    if ((y.low <= 0) & (y.high >= 0)).any():
        raise RangeError("division by a range that holds zero")
    floor = np.minimum(np.abs(y.low), np.abs(y.high))
    k = y.r + y.a / floor
    if (k >= 1).any():
        raise RangeError("division by a value whose error is as large as itself")
    low, high = _corners(x, y, np.divide)
    return Span(low, high, x.a / (floor * (1 - k)), (x.r + k) / (1 - k))


def _pow(x: Span, c: float, off: float) -> Span:
    # off: of the exponent as it is stored.
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
    if off == 0:
        return Span(*ends, a, r)
    # Where x stays away from 0 the exponent's error is a relative one; else x^c |ln x| is bounded:
    # it rises up to x = exp(-1/c) and falls from there to 1.
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


def _sqrt(x: Span) -> Span:
    low, high = np.maximum(x.low, 0.0), np.maximum(x.high, 0.0)
    # |sqrt(x + a) - sqrt(x)| <= sqrt(a), and a / sqrt(x) away from zero.
    root, below = np.sqrt(x.a), low * (1 - x.r)
    safe = np.where(below > 0, below, 1.0)
    a = np.where(below > 0, np.minimum(root, x.a / np.sqrt(safe)), root)
    return Span(np.sqrt(low), np.sqrt(high), a, _root_share(x.r, 0.5))


def _log(x: Span) -> Span:
    if np.any(x.low - x.error <= 0):
        raise RangeError("log of a range that reaches zero")
    return Span(np.log(x.low), np.log(x.high), -np.log1p(-x.error / x.low), _none(x))


def _fabs(x: Span) -> Span:
    crosses = (x.low <= 0) & (x.high >= 0)
    low = np.where(crosses, 0.0, np.minimum(np.abs(x.low), np.abs(x.high)))
    return Span(low, x.magnitude, x.a, x.r)


def _sign(x: Span) -> Span:
    # A sign that rounding may turn is wrong by as much as 2.
    sure = (x.low > x.error) | (x.high < -x.error) | (x.error == 0)
    return Span(np.sign(x.low), np.sign(x.high), np.where(sure, 0.0, 2.0), _none(x))


def _either(x: Span, y: Span, low: Array, high: Array) -> Span:
    # One of two values: |error| <= max_i (a_i + r_i |z|).
    magnitude = np.maximum(np.abs(low), np.abs(high))
    mine, other = (x.a <= y.a) & (x.r <= y.r), (y.a <= x.a) & (y.r <= x.r)
    flat = np.maximum(x.a + x.r * magnitude, y.a + y.r * magnitude)
    a = np.where(mine, y.a, np.where(other, x.a, flat))
    return Span(low, high, a, np.where(mine, y.r, np.where(other, x.r, 0.0)))


def _select(c: Span, x: Span, y: Span) -> Span:
    first, second = c.low == 1, c.high == 0
    both = _either(x, y, np.minimum(x.low, y.low), np.maximum(x.high, y.high))
    if not (first | second).any():
        return both

    def pick(p: Array, q: Array, else_: Array) -> Array:
        return np.where(first, p, np.where(second, q, else_))

    return Span(
        pick(x.low, y.low, both.low),
        pick(x.high, y.high, both.high),
        pick(x.a, y.a, both.a),
        pick(x.r, y.r, both.r),
    )


def _extreme(f: Any, x: Span, y: Span) -> Span:
    both = _either(x, y, f(x.low, y.low), f(x.high, y.high))
    # Where one side wins in exact and in computed arithmetic alike, its error alone counts.
    room = x.error + y.error
    if f is np.minimum:
        mine, other = y.low - x.high >= room, x.low - y.high >= room
    else:
        mine, other = x.low - y.high >= room, y.low - x.high >= room
    return Span(
        both.low,
        both.high,
        np.where(mine, x.a, np.where(other, y.a, both.a)),
        np.where(mine, x.r, np.where(other, y.r, both.r)),
    )


def _none(x: Span) -> Array:
    return np.zeros_like(x.low)


def _point(like: Span, value: float) -> Span:
    zero = _none(like)
    return Span(zero + value, zero + value, zero, zero, whole=True)


_RULES: dict[str, Callable[..., Span]] = {
    "add": _add,
    "sub": lambda x, y: _add(x, _neg(y)),
    "mul": lambda x, y: _mul(x, y, False),
    "sq": lambda x: _mul(x, x, True),
    "div": _div,
    "inv": lambda x: _div(_point(x, 1.0), x),
    "neg": _neg,
    "twice": lambda x: Span(2 * x.low, 2 * x.high, 2 * x.a, x.r),
    "fabs": _fabs,
    "sign": _sign,
    "fmin": partial(_extreme, np.minimum),
    "fmax": partial(_extreme, np.maximum),
    "exp": lambda x: Span(np.exp(x.low), np.exp(x.high), _none(x), np.expm1(x.error)),
    "tanh": lambda x: Span(np.tanh(x.low), np.tanh(x.high), x.error, _none(x)),
    "sqrt": _sqrt,
    "log": _log,
    "select": _select,
    "if_else_zero": lambda c, x: _select(c, x, _point(x, 0.0)),
}


def _decided(op: str, x: Span, y: Span) -> Span:
    # The truth value, from what both exact and computed arithmetic can see.
    (xl, xh), (yl, yh) = x.seen, y.seen
    apart = (xh < yl) | (xl > yh)
    never = np.zeros_like(apart)
    yes, no = {
        "le": (xh <= yl, xl > yh),
        "lt": (xh < yl, xl >= yh),
        "eq": (never, apart),
        "ne": (apart, never),
    }[op]
    zero = np.zeros_like(xl)
    return Span(np.where(yes, 1.0, 0.0), np.where(no, 0.0, 1.0), zero, zero, whole=True)


def _logic(op: str, v: list[Span]) -> Span:
    zero = np.zeros_like(v[0].low)
    sure = [np.asarray((x.low > 0) | (x.high < 0), dtype=np.float64) for x in v]
    maybe = [np.asarray((x.low != 0) | (x.high != 0), dtype=np.float64) for x in v]
    if op == "not":
        return Span(1.0 - maybe[0], 1.0 - sure[0], zero, zero, whole=True)
    f = np.minimum if op == "and" else np.maximum
    return Span(f(*sure), f(*maybe), zero, zero, whole=True)


# -- a kernel --------------------------------------------------------------------------------------


def numeric_nodes(
    kernel: Kernel, flag_results: Sequence[int], solved: Collection[int] = ()
) -> set[int]:
    """Nodes on which a result depends that is a number, not a status word."""
    needed = {i for k, r in enumerate(kernel.results) if k not in flag_results for i in r}
    for i in reversed(range(len(kernel.nodes))):
        if i in needed and i not in solved:
            needed.update(kernel.nodes[i].args)
    return needed


@np.errstate(all="ignore")
def propagate(
    rounding: Rounding,
    arguments: Sequence[Sequence[Span]],
    flag_results: Sequence[int] = (),
    facts: Mapping[int, tuple[Any, Any]] | None = None,
    boxes: int = 1,
    solved: Mapping[int, Span] | None = None,
    known: Known | None = None,
) -> tuple[list[Span], tuple[str, ...]]:
    """Push ranges and errors through a kernel: every node's Span, and the assumptions.

    Of ``solved`` nodes the Span is given, and what leads to them alone is left out.  ``known`` is
    of earlier analyses with the same boxes and facts.  A decision that only status words use is no
    assumption.
    """
    kernel = rounding.kernel
    solved, facts, known = solved or {}, facts or {}, known or Known()
    numeric = numeric_nodes(kernel, flag_results, solved)
    values: list[Span] = []
    assumptions = []
    for i, n in enumerate(kernel.nodes):
        if n.op == "input":
            values.append(known.one(i, rounding.read(i, arguments[n.source[0]][n.source[1]])))
            continue
        if n.op == "const" or not rounding.computed(i) or (solved and i not in numeric):
            # Of what is a part of a status word, or not followed, nothing is known.
            if i not in known.points:
                of = rounding.constant(n.value, boxes) if n.op == "const" else None
                known.points[i] = of or span(0.0, 0.0, 0.0, boxes)
            values.append(known.points[i])
            continue
        if i in solved:
            values.append(known.one(i, solved[i]))
            continue
        v = [values[k] for k in n.args]
        earlier, key = known.results.setdefault(i, {}), (rounding.key(i), i in numeric, *v)
        found = earlier.pop(key, None)
        if found is None:
            value, said = _result(rounding, i, v, facts.get(i), i in numeric)
            found = known.one(i, value), said
        value, said = _keep(earlier, key, found)
        values.append(value)
        if said:
            assumptions.append(said)
    return values, tuple(assumptions)


def _result(
    rounding: Rounding, i: int, v: list[Span], fact: tuple[Any, Any] | None, numeric: bool
) -> tuple[Span, str]:
    # A node's Span, and the assumption that a comparison is.
    kernel = rounding.kernel
    n = kernel.nodes[i]
    if own := rounding.stored(i):
        v = [Span(x.low, x.high, x.a + own[k], x.r) if k in own else x for k, x in enumerate(v)]
    if n.op in COMPARES:
        found = _decided(n.op, *v)
        open_ = numeric and bool((found.low != found.high).any()) and not rounding.settled(i, v)
        return found, f"{kernel.name}: v{i} = {n.op}" if open_ else ""
    if n.op in BOOLEAN:
        return _logic(n.op, v), ""
    x = rounding.finished(i, v, _cut(_ruled(rounding, n, v), fact))
    if not np.isfinite(x.error + x.magnitude).all():
        raise RangeError(f"{kernel.name}: value v{i} ({n.op}) has no finite range")
    return x, ""


def _ruled(rounding: Rounding, n: Node, v: list[Span]) -> Span:
    kernel = rounding.kernel
    if n.op == "pow":
        exponent = kernel.nodes[n.args[1]]
        if exponent.op != "const":
            raise RangeError(f"{kernel.name}: a power with an exponent that is not constant")
        return _pow(v[0], exponent.value, rounding.exponent_error(exponent.value))
    if n.op == "mul" and n.args[0] == n.args[1]:
        return _mul(v[0], v[1], True)
    if n.op not in _RULES:
        raise RangeError(f"{kernel.name}: no range rule for '{n.op}'")
    return _RULES[n.op](*v)


def _cut(x: Span, fact: tuple[Any, Any] | None) -> Span:
    if fact is None:
        return x
    low = np.maximum(x.low, fact[0])
    # In a box that no value can be in, any value will do.
    return replace(x, low=low, high=np.maximum(np.minimum(x.high, fact[1]), low))
