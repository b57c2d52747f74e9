"""Ranges and rounding errors of a kernel: where a stated float32 bound comes from.

Every value of a kernel carries the interval of its exact value and an error model

    |computed - exact| <= a + r |exact|

pushed through operation by operation (the standard model of floating-point arithmetic, with a
term for underflow).  A comparison whose operands carry no error, or whose outcome follows from the
intervals, is decided alike in all formats; any other is listed as an assumption.

References
----------
.. [1] N. J. Higham, "Accuracy and Stability of Numerical Algorithms", 2nd ed., SIAM 2002, ch. 2, 3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import casadi as ca
import numpy as np

from esea_gen.block import Array, Block
from esea_gen.emit.elementary import ACCURACY_ULP, EXPONENT_FRACTION_BITS, exponent_q27
from esea_gen.emit.formats import Format
from esea_gen.emit.walker import Kernel, Node, fuse_selects, walk

# Largest error of the platform's float64 libm, in units in the last place (glibc documents 1).
LIBM_ULP = 1.0


class RangeError(Exception):
    """A range or an error grew without limit."""


@dataclass(frozen=True)
class Value:
    """Range and error of one value.

    Parameters
    ----------
    low, high : float
        Interval of the exact value.
    a, r : float
        Error model: ``|computed - exact| <= a + r |exact|``.
    computed_low, computed_high : float
        Interval of the computed value.
    """

    low: float
    high: float
    a: float = 0.0
    r: float = 0.0
    computed_low: float = -math.inf
    computed_high: float = math.inf

    def __post_init__(self) -> None:
        e = self.error
        object.__setattr__(self, "computed_low", max(self.computed_low, self.low - e))
        object.__setattr__(self, "computed_high", min(self.computed_high, self.high + e))

    @property
    def magnitude(self) -> float:
        """Largest |exact value|."""
        return max(abs(self.low), abs(self.high))

    @property
    def error(self) -> float:
        """Largest |computed - exact|."""
        return self.a + self.r * self.magnitude

    @property
    def exact(self) -> bool:
        """Whether the computed value is the exact one."""
        return self.a == 0 and self.r == 0


@dataclass(frozen=True)
class Analysis:
    """Result of an analysis.

    Parameters
    ----------
    results : tuple of tuple of Value
        Per result and element.
    assumptions : tuple of str
        Decisions that rounding could turn: taken as equal.
    """

    results: tuple[tuple[Value, ...], ...]
    assumptions: tuple[str, ...]


def _either(x: Value, y: Value, magnitude: float) -> tuple[float, float]:
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

    def elementary(self, name: str) -> float:
        # Relative error of a function: one unit in the last place is at most 2 u relative.
        ulp = LIBM_ULP if self.fmt.needs_libm else ACCURACY_ULP[name]
        return 2 * ulp * self.u

    def rounded(self, low: float, high: float, a: float, r: float, u: float | None = None) -> Value:
        u = self.u if u is None else u
        return Value(low, high, a * (1 + u) + self.tiny, r * (1 + u) + u)

    def const(self, c: float) -> Value:
        stored = float(self.fmt.dtype.type(c))
        return Value(c, c, abs(stored - c), 0.0, stored, stored)

    def add(self, x: Value, y: Value) -> Value:
        low, high = x.low + y.low, x.high + y.high
        absolute = self.rounded(low, high, x.error + y.error, 0.0)
        if (x.low >= 0 and y.low >= 0) or (x.high <= 0 and y.high <= 0):
            # Nothing cancels: the relative errors do not grow.  Keep that form unless the absolute
            # one is far smaller (1 plus something small of poor relative accuracy).
            relative = self.rounded(low, high, x.a + y.a, max(x.r, y.r))
            if relative.error <= 2 * absolute.error:
                return relative
        return absolute

    def neg(self, x: Value) -> Value:
        return Value(-x.high, -x.low, x.a, x.r, -x.computed_high, -x.computed_low)

    def mul(self, x: Value, y: Value) -> Value:
        corners = [p * q for p in (x.low, x.high) for q in (y.low, y.high)]
        a = x.magnitude * y.a * (1 + x.r) + y.magnitude * x.a * (1 + y.r) + x.a * y.a
        return self.rounded(min(corners), max(corners), a, x.r + y.r + x.r * y.r)

    def sq(self, x: Value) -> Value:
        full = self.mul(x, x)
        low = 0.0 if x.low <= 0 <= x.high else min(x.low**2, x.high**2)
        return Value(low, x.magnitude**2, full.a, full.r)

    def div(self, x: Value, y: Value) -> Value:
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

    def fabs(self, x: Value) -> Value:
        low = 0.0 if x.low <= 0 <= x.high else min(abs(x.low), abs(x.high))
        return Value(low, x.magnitude, x.a, x.r)

    def extreme(self, x: Value, y: Value, pick: str) -> Value:
        f = min if pick == "fmin" else max
        low, high = f(x.low, y.low), f(x.high, y.high)
        return Value(
            low,
            high,
            *_either(x, y, max(abs(low), abs(high))),
            f(x.computed_low, y.computed_low),
            f(x.computed_high, y.computed_high),
        )

    def hull(self, x: Value, y: Value) -> Value:
        low, high = min(x.low, y.low), max(x.high, y.high)
        return Value(
            low,
            high,
            *_either(x, y, max(abs(low), abs(high))),
            min(x.computed_low, y.computed_low),
            max(x.computed_high, y.computed_high),
        )

    def pow(self, x: Value, c: float) -> Value:
        if x.low < 0 or c <= 0:
            raise RangeError("only a power of a value that is not negative, by a positive constant")
        top = x.high * (1 + x.r) + x.a
        # For c < 1 the root's slope is unbounded at zero, but (X + a)^c - X^c <= a^c.
        a = c * top ** (c - 1) * x.a if c >= 1 else x.a**c
        r = math.expm1(c * math.log1p(x.r))
        if c < 1 and x.r < 1:
            r = -math.expm1(c * math.log1p(-x.r))  # then the lower side errs more
        if self.fmt.name == "f32" and x.high > 0:
            # The exponent is stored in 27 fractional bits; below 2^-149 the power underflows.
            dc = abs(exponent_q27(c) * 2.0**-EXPONENT_FRACTION_BITS - c)
            logs = [abs(math.log(max(e, 1e-45))) for e in (x.low, x.high)]
            r += math.expm1(dc * max(logs))
        return self.rounded(x.low**c, x.high**c, a, r, self.elementary("powk"))

    def monotone(self, x: Value, name: str) -> Value:
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


def _decide(op: str, x: Value, y: Value) -> Value | None:
    # True or false in exact and in computed arithmetic alike, from the intervals; else None.
    high, low = max(x.high, x.computed_high), min(x.low, x.computed_low)
    other_low, other_high = min(y.low, y.computed_low), max(y.high, y.computed_high)
    yes, no = Value(1, 1), Value(0, 0)
    if op == "le":
        return yes if high <= other_low else no if low > other_high else None
    if op == "lt":
        return yes if high < other_low else no if low >= other_high else None
    return None


def analyse(
    kernel: Kernel,
    fmt: Format,
    arguments: Sequence[Sequence[Value]],
    flag_results: Sequence[int] = (),
    facts: Mapping[int, tuple[float, float]] | None = None,
) -> Analysis:
    """Push ranges and errors through a kernel.

    Parameters
    ----------
    kernel : Kernel
        As walked; selects are fused here.
    fmt : Format
        Number format.
    arguments : sequence of sequence of Value
        Per argument and element.
    flag_results : sequence of int
        Results that are status words: a decision that only they use is no assumption.
    facts : mapping of int to (low, high), optional
        Ranges of nodes known from algebra; the kernel must then be fused already.

    Returns
    -------
    Analysis
        Ranges and errors of the results.

    Raises
    ------
    RangeError
        For a division by a range holding zero and the like.
    """
    if facts is None:
        kernel = fuse_selects(kernel)
    known = facts or {}
    arithmetic = _Arithmetic(fmt)
    values: list[Value] = []
    assumptions = []
    unknown = Value(0, 1)
    numeric = _needed(kernel, [r for k, r in enumerate(kernel.results) if k not in flag_results])
    for i, n in enumerate(kernel.nodes):
        v = [values[k] for k in n.args]
        if n.op == "const":
            result = arithmetic.const(n.value)
        elif n.op == "input":
            result = arguments[n.source[0]][n.source[1]]
        elif n.op in ("lt", "le", "eq", "ne"):
            decided = _decide(n.op, v[0], v[1])
            if decided is None and i in numeric and not (v[0].exact and v[1].exact):
                assumptions.append(f"{kernel.name}: v{i} = {n.op}")
            result = decided or unknown
        elif n.op == "not":
            result = Value(1 - v[0].high, 1 - v[0].low) if _settled(v[0]) else unknown
        elif n.op in ("and", "or"):
            result = _logic(n.op, v[0], v[1])
        else:
            result = _operation(arithmetic, kernel, n, v)
        if i in known:
            low, high = known[i]
            result = Value(max(result.low, low), min(result.high, high), result.a, result.r)
        if not math.isfinite(result.error) or not math.isfinite(result.magnitude):
            raise RangeError(f"{kernel.name}: value v{i} ({n.op}) has no finite range")
        values.append(result)
    return Analysis(tuple(tuple(values[i] for i in r) for r in kernel.results), tuple(assumptions))


def _needed(kernel: Kernel, results: Sequence[Sequence[int]]) -> set[int]:
    needed = {i for r in results for i in r}
    for i in range(len(kernel.nodes) - 1, -1, -1):
        if i in needed:
            needed.update(kernel.nodes[i].args)
    return needed


def _settled(v: Value) -> bool:
    return v.low == v.high and v.low in (0.0, 1.0)


def _logic(op: str, x: Value, y: Value) -> Value:
    strong = 0.0 if op == "and" else 1.0
    for p in (x, y):
        if _settled(p) and p.low == strong:
            return Value(strong, strong)
    if _settled(x) and _settled(y):
        return Value(1 - strong, 1 - strong)
    return Value(0, 1)


def _operation(arithmetic: _Arithmetic, kernel: Kernel, n: Node, v: list[Value]) -> Value:
    if n.op == "add":
        return arithmetic.add(*v)
    if n.op == "sub":
        return arithmetic.add(v[0], arithmetic.neg(v[1]))
    if n.op in ("mul", "div"):
        return getattr(arithmetic, n.op)(*v)  # type: ignore[no-any-return]
    if n.op in ("neg", "sq", "fabs"):
        return getattr(arithmetic, n.op)(v[0])  # type: ignore[no-any-return]
    if n.op == "twice":
        return Value(2 * v[0].low, 2 * v[0].high, 2 * v[0].a, v[0].r)
    if n.op == "inv":
        return arithmetic.div(Value(1, 1), v[0])
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
        other = v[2] if n.op == "select" else Value(0, 0)
        if _settled(v[0]):
            return v[1] if v[0].low else other
        return arithmetic.hull(v[1], other)
    raise RangeError(f"{kernel.name}: no range rule for '{n.op}'")


@dataclass(frozen=True)
class Bound:
    """Worst-case error of a Block in a number format, against exact arithmetic.

    Parameters
    ----------
    format : str
        Number format.
    steps : float
        Number of steps it holds for: ``inf`` when the Block forgets its errors.
    outputs, states : dict of str to float
        Largest |error| per port.
    method : str
        ``fixed point`` or ``linear``.
    assumptions : tuple of str
        Decisions taken as equal.
    """

    format: str
    steps: float
    outputs: dict[str, float]
    states: dict[str, float]
    method: str
    assumptions: tuple[str, ...]


def _coefficients(block: Block, fmt: Format) -> list[list[Value]]:
    if not block.tunables:
        return []
    values = [ca.DM(t.default) for t in block.tunables]
    prepared = [np.asarray(c, dtype=float).ravel() for c in block.prepare.call(values)]
    arguments = [[Value(t.default, t.default)] for t in block.tunables]
    derived = analyse(walk(block.prepare), fmt, arguments).results
    return [
        [Value(x, x, v.error) for x, v in zip(c, d, strict=True)]
        for c, d in zip(prepared, derived, strict=True)
    ]


def block_bound(
    block: Block, fmt: Format, ranges: Mapping[str, tuple[float, float]] | None = None
) -> Bound:
    """Derive a Block's worst-case error, for any number of steps, at its default tunables.

    The inputs are taken as exact in the format.  The state's error is a fixed point of one step's
    error propagation, verified as inductive: errors no larger going in come out no larger.  For a
    linear Block, whose stability intervals cannot see, one step's own error is summed through the
    powers of its state matrix instead.

    Parameters
    ----------
    block : Block
        The Block.
    fmt : Format
        Number format.
    ranges : mapping, optional
        ``{"u_theta_rad": (low, high), "s_tau_r_Nm": ...}``: inputs and states that stay inside
        these ranges instead of their ports'.

    Returns
    -------
    Bound
        Per output and state.

    Raises
    ------
    RangeError
        When neither way gives a finite bound.
    """
    kernel, facts = _with_facts(block)
    coefficients = _coefficients(block, fmt)
    limits = _limits(block, ranges or {})
    boxes = _boxes(block, limits)

    def once(errors: list[list[float]]) -> Analysis:
        parts = []
        for box in boxes:
            state = [
                [Value(*box[f"s_{p.name}"], x, 0.0, *box[f"s_{p.name}"]) for x in e]
                for p, e in zip(block.state, errors, strict=True)
            ]
            inputs = [[Value(*box[f"u_{p.name}"])] * p.size for p in block.inputs]
            arguments = [*coefficients, *state, *inputs]
            parts.append(analyse(kernel, fmt, arguments, block.flag_results, facts))
        return _worst(parts)

    def state_errors(result: Analysis) -> list[list[float]]:
        # Both the exact and the computed state lie in the port's range.
        out = []
        for p, r in zip(block.state, result.results, strict=False):
            low, high = limits[f"s_{p.name}"]
            out.append([min(v.error, high - low) for v in r])
        return out

    zero = [[0.0] * p.size for p in block.state]
    method, extra = "fixed point", tuple[str, ...]()
    solved = _fixed_point(once, state_errors, zero)
    # At the ends of the states' own ranges it says nothing.
    idle = solved is not None and any(
        max(e) > 0.25 * (limits[f"s_{p.name}"][1] - limits[f"s_{p.name}"][0])
        for p, e in zip(block.state, solved, strict=True)
    )
    if (solved is None or idle) and _is_linear(kernel, len(block.coefficients)):
        solved, idle = _linear_bound(block, state_errors(once(zero))), False
        method, extra = "linear", (f"{block.name}: no clip of a state acts",)
    if solved is None or idle:
        raise RangeError(f"{block.name}: not stable, rounding errors may grow without limit")
    final = once(solved)
    outputs = final.results[len(block.state) :]
    return Bound(
        fmt.name,
        math.inf,
        {
            p.name: float(max(v.error for v in r))
            for p, r in zip(block.outputs, outputs, strict=True)
            if not p.flags
        },
        {p.name: max(e) for p, e in zip(block.state, solved, strict=True)},
        method,
        final.assumptions + extra,
    )


def _with_facts(block: Block) -> tuple[Kernel, dict[int, tuple[float, float]]]:
    # The fused step, and which of its nodes a fact is known of.
    labelled = fuse_selects(walk(block.labelled_step))
    count = block.step.n_out()
    nodes = {
        name: r[0] for (name, _), r in zip(block.labels, labelled.results[count:], strict=True)
    }
    facts = {nodes[name]: limits for name, limits in block.facts.items()}
    return Kernel(labelled.name, labelled.nodes, labelled.results[:count]), facts


def _limits(
    block: Block, ranges: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    own = {f"s_{p.name}": (p.low, p.high) for p in block.state}
    own |= {f"u_{p.name}": (p.low, p.high) for p in block.inputs}
    unknown = sorted(set(ranges) - set(own))
    if unknown:
        raise ValueError(f"block {block.name}: no state or input {unknown}; there are {list(own)}")
    return own | dict(ranges)


def _boxes(
    block: Block, limits: Mapping[str, tuple[float, float]]
) -> list[dict[str, tuple[float, float]]]:
    axes = []
    for name, cuts in block.split.items():
        low, high = limits[name]
        inside = sorted({c for m in cuts for c in (m, -m) if low < c < high})
        edges = [low, *inside, high]
        axes.append([(name, pair) for pair in pairwise(edges)])
    return [dict(limits) | dict(choice) for choice in product(*axes)]


def _worst(parts: Sequence[Analysis]) -> Analysis:
    # A box's error is turned into an absolute one, so that the worst of all boxes is one number.
    results = []
    for values in zip(*(p.results for p in parts), strict=True):
        results.append(
            tuple(
                Value(min(v.low for v in e), max(v.high for v in e), max(v.error for v in e))
                for e in zip(*values, strict=True)
            )
        )
    return Analysis(tuple(results), tuple(sorted({a for p in parts for a in p.assumptions})))


Errors = list[list[float]]


def _fixed_point(
    once: Callable[[Errors], Analysis], state_errors: Callable[[Analysis], Errors], zero: Errors
) -> Errors | None:
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


def _is_linear(kernel: Kernel, coefficients: int) -> bool:
    # Whether states and inputs enter only linearly, up to clips and selections.
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


def _linear_bound(block: Block, local: Errors) -> Errors | None:
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
    for scale in (0.0, *[0.02] * 40):
        middle = [
            ca.DM([1.0])
            if p.name == "primed"
            else ca.DM(scale * rng.uniform(p.low, p.high, p.size))
            for p in block.state
        ]
        inputs = [ca.DM(scale * rng.uniform(p.low, p.high, p.size)) for p in block.inputs]
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


__all__ = ["Analysis", "Bound", "RangeError", "Value", "analyse", "block_bound"]
