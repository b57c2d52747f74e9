"""Error bounds of a Block: where a stated float32 bound comes from.

One step's errors (:mod:`esea_gen.emit.ranges`) over the boxes of its ranges; for all time as a
fixed point, or through the powers of a linear Block's state matrix.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from esea_gen.emit.ranges import Analysis, RangeError, RangeValue, analyse
from esea_gen.emit.walker import Kernel, fuse_selects, labelled_kernel, walk
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port

if TYPE_CHECKING:  # the q31 format is planned with this module's bounds
    from esea_gen.emit.formats.base import Format

# A little beyond the ports' ranges, so that the guard's own comparisons stay undecided.
BEYOND = 1e-6

Errors = list[list[float]]


@dataclass(frozen=True)
class Bound:
    """Worst-case error of a Block in a number format, against exact arithmetic."""

    format: str
    steps: float
    outputs: dict[str, float]
    states: dict[str, float]
    method: str  # ``fixed point``, ``linear`` or ``one step``
    assumptions: tuple[str, ...]  # decisions taken as equal; inputs taken as whole numbers


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
    """Whether a port counts: a mode, a number of frames, a stamp."""
    values = (port.low, port.high, port.init)
    return (
        port.unit == "1"
        and port.high - port.low > 1
        and all(x == math.floor(x) and abs(x) < 2.0**24 for x in values)
    )


class _Step:
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
        self._found: dict[tuple[tuple[float, ...], ...] | None, Analysis] = {}
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
            self._found.clear()
        self.assumptions = tuple(
            f"{block.name}: {p.name} is a whole number"
            for p in block.inputs
            if f"u_{p.name}" in self.whole
        )

    def __call__(self, errors: Errors, kernel: Kernel | None = None) -> Analysis:
        key = tuple(map(tuple, errors)) if kernel is None else None
        if key in self._found:  # a search for a fixed point comes by the same errors again
            return self._found[key]
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
        worst = _worst(parts)
        if key is not None:
            self._found[key] = worst
        return worst

    def _input(self, box: Mapping[str, tuple[float, float]], name: str) -> RangeValue:
        low, high = box[name]
        return RangeValue(low, high, whole=name in self.whole)

    def _state(self, box: Mapping[str, tuple[float, float]], name: str, error: float) -> RangeValue:
        return RangeValue(*box[name], error, 0.0, *box[name], name in self.whole and error == 0)

    def state_errors(self, result: Analysis) -> Errors:
        out = []
        for p, r in zip(self.block.state, result.results, strict=False):
            low, high = self.limits[f"s_{p.name}"]
            out.append([min(v.error, high - low) for v in r])
        return out

    def bound(
        self, final: Analysis, states: Errors, steps: float, method: str, *extra: str
    ) -> Bound:
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
        method, extra = "linear", linear_assumptions(block)
    if solved is None or idle:
        raise RangeError(f"{block.name}: not stable, rounding errors may grow without limit")
    return once.bound(once(solved), solved, math.inf, method, *extra)


def step_bound(
    block: Block, fmt: Format, ranges: Mapping[str, tuple[float, float]] | None = None
) -> Bound:
    """Derive the error that one step of a Block adds, from the same memory.

    For a Block that :func:`block_bound` refuses: an integral, or a limit on the rate of change,
    adds its rounding errors up.
    """
    once = _Step(block, fmt, ranges, BEYOND)
    final = once(once.zero)
    return once.bound(final, once.state_errors(final), 1, "one step")


def node_errors(block: Block, fmt: Format) -> tuple[Kernel, list[float]]:
    """Largest |error| of every value of a step, from the same memory."""
    once = _Step(block, fmt, None, BEYOND)
    kernel = once.kernel
    everything = Kernel(kernel.name, kernel.nodes, (tuple(range(len(kernel.nodes))),))
    return kernel, [v.error for v in once(once.zero, everything).results[0]]


def whole_nodes(block: Block, kernel: Kernel, fmt: Format) -> frozenset[int]:
    """Values of a step that are whole numbers, as long as what counts is given whole numbers."""
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
    """
    axes = []
    for name, cuts in block.split.items():
        if name in limits:
            axes.append([(name, pair) for pair in pieces(limits[name], cuts)])
    return [dict(limits) | dict(choice) for choice in product(*axes)]


def pieces(limits: tuple[float, float], cuts: Sequence[float]) -> list[tuple[float, float]]:
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


def fixed_point(
    once: Callable[[Errors], Analysis], state_errors: Callable[[Analysis], Errors], zero: Errors
) -> Errors | None:
    """Find errors of the states that one step does not make larger."""

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


def state_jacobian(block: Block) -> ca.Function:
    """How the next states change with the states: arguments of ``step``, one square matrix."""
    arguments = block.step.sx_in()
    n_c = len(block.coefficients)
    symbols = ca.veccat(*arguments[n_c : n_c + len(block.state)])
    results = block.step.call(arguments)
    after = ca.veccat(*results[: len(block.state)])
    return ca.Function("A", arguments, [ca.densify(ca.jacobian(after, symbols))])


def state_matrix(block: Block) -> Array | None:
    """The one matrix by which a linear Block's states go on, at its default tunables."""
    jacobian = state_jacobian(block)
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
    flags = started_flags(block)
    a[flags, :] = 0.0
    a[:, flags] = 0.0
    return a


def started_flags(block: Block) -> list[int]:
    names = [p.name for p in block.state for _ in range(p.size)]
    return [k for k, name in enumerate(names) if name == "primed"]


def linear_assumptions(block: Block) -> tuple[str, ...]:
    """What :func:`linear_bound` takes as given of every step."""
    return f"{block.name}: no clip of a state acts", f"{block.name}: no invalid input is bridged"


def linear_bound(block: Block, local: Errors) -> Errors | None:
    a = state_matrix(block)
    if a is None or np.max(np.abs(np.linalg.eigvals(a))) >= 1:
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
