"""Worst-case error of a Block in any number format: of one step, and for all time.

One step's errors (:mod:`esea_gen.emit.spans`) over the boxes of its ranges; for all time as a fixed
point, or through the powers of a linear Block's state matrix.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.emit.spans import Known, RangeError, Rounding, Span, propagate, span
from esea_gen.emit.walker import Kernel
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port

# A little beyond the ports' ranges, so that the guard's own comparisons stay undecided.
BEYOND = 1e-6

Errors = list[list[float]]
Ranges = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Bound:
    """Worst-case error of a Block in a number format, against exact rounding."""

    format: str
    # It holds for so many: inf when the Block forgets its errors; 1 for what one step adds.
    steps: float
    outputs: dict[str, float]
    states: dict[str, float]
    method: str  # ``fixed point``, ``linear`` or ``one step``
    assumptions: tuple[str, ...]  # decisions taken as equal; inputs taken as whole numbers

    def with_errors_of(self, other: Bound) -> Bound:
        """Add the bound of a reference that has errors itself."""
        return replace(
            self,
            outputs={k: v + other.outputs[k] for k, v in self.outputs.items()},
            states={k: v + other.states[k] for k, v in self.states.items()},
        )


def counts(port: Port) -> bool:
    """Whether a port counts: a mode, a number of frames, a stamp.

    An input of that kind is given whole numbers; a state of that kind is one where the analysis
    finds that every step makes it one.
    """
    values = (port.low, port.high, port.init)
    return (
        port.unit == "1"
        and port.high - port.low > 1
        and all(x == math.floor(x) and abs(x) < 2.0**24 for x in values)
    )


@dataclass(frozen=True)
class ComputedStep:
    """A Block's step as a number format computes it."""

    block: Block
    rounding: Rounding
    labels: Mapping[int, str]
    facts: Mapping[int, tuple[float, float]]
    # Exact coefficients and the errors of the stored ones, by port and element.
    coefficients: Callable[[], list[list[tuple[float, float]]]]
    # By result and element: error of the conversion to the port's format.
    conversions: Sequence[Sequence[float]]


class StepErrors:
    """One step's errors, from errors of the states.

    ranges: ranges of states and inputs that replace their ports'.
    room: share of each range that inputs and states may lie beyond it: the guard's own comparisons
        then stay undecided, and what follows an invalid input or a corrupt state counts as well.
    known: of other analyses with the same boxes, facts and coefficients.
    """

    def __init__(
        self,
        computed: ComputedStep,
        ranges: Ranges | None = None,
        room: float = 0.0,
        input_errors: Mapping[str, float] | None = None,
        known: Known | None = None,
    ) -> None:
        self.computed, self.block, self.known = computed, computed.block, known or Known()
        self.kernel = computed.rounding.kernel
        own = {f"s_{p.name}": (p.low, p.high) for p in self.block.state}
        own |= {f"u_{p.name}": (p.low, p.high) for p in self.block.inputs}
        if unknown := sorted(set(ranges or ()) - set(own)):
            name = self.block.name
            raise ValueError(f"block {name}: no state or input {unknown}; there are {list(own)}")
        self.limits = own | dict(ranges or {})
        self._set(room, 1)
        self._input_errors, self._room = input_errors or {}, room
        self.whole = self._whole_ports()

    def _set(self, room: float, cases: int) -> None:
        if self.known.setting is None:
            self.known.setting = self._setting(room, cases)
        self.boxes, self.facts, self._coefficients, self._ends = self.known.setting
        self.count = len(self.boxes)

    def _setting(self, room: float, cases: int) -> tuple[Any, ...]:
        # Boxes of states and inputs, times pieces of the labelled values that are cut (a value that
        # follows from the others lies in one of its pieces, whatever they are); facts in them.
        block, computed = self.block, self.computed
        limits = {k: (a - room * (b - a), b + room * (b - a)) for k, (a, b) in self.limits.items()}
        axes = []
        for name, cuts in block.split.items():
            if name in limits:
                parts = pieces(limits[name], _finer(cuts, limits[name]))
            else:
                parts = pieces(block.facts[name], cuts)
            axes.append([(name, pair) for pair in parts])
        boxes = [dict(limits) | dict(choice) for choice in product(*axes)] * cases
        facts = {}
        for i, fact in computed.facts.items():
            ends = [box.get(computed.labels[i], fact) for box in boxes]
            facts[i] = np.array([e[0] for e in ends]), np.array([e[1] for e in ends])
        points = [[_point(*pair, len(boxes)) for pair in c] for c in computed.coefficients()]
        return boxes, facts, points, dict[str, tuple[Array, Array]]()

    def _whole_ports(self) -> frozenset[str]:
        # Ports that count.  The states are whole if, all of them taken as whole, one step leaves
        # them whole; drop those that it does not, until none is dropped.
        block = self.block
        if not self.computed.rounding.keeps_whole:
            return frozenset()
        self.whole = frozenset(f"u_{p.name}" for p in block.inputs if counts(p))
        self.whole |= {f"s_{p.name}" for p in block.state if counts(p)}
        while True:
            values, _ = self.values(self.zero)
            lost = {
                f"s_{p.name}"
                for p, r in zip(block.state, self.kernel.results, strict=False)
                if not all(values[i].whole for i in r)
            }
            if not lost & self.whole:
                return self.whole
            self.whole -= lost

    @property
    def zero(self) -> Errors:
        """No error in any state."""
        return [[0.0] * p.size for p in self.block.state]

    def held(self, name: str, error: float | Array) -> Span:
        """A state or input, which has passed its port's check: both its values lie in the range."""
        if name not in self._ends:
            low, high = (np.array([box[name][end] for box in self.boxes]) for end in (0, 1))
            self._ends[name] = low, high
        low, high = self._ends[name]
        errors = np.full(self.count, error), np.zeros(self.count)
        return Span(low, high, *errors, (low, high), name in self.whole and not np.any(error))

    def propagated(
        self, errors: Sequence[Sequence[Any]], solved: Mapping[int, Span] | None = None
    ) -> tuple[list[Span], tuple[str, ...]]:
        """Every node's Span, and the assumptions."""
        block, given = self.block, self._input_errors
        state = [
            [self.held(f"s_{p.name}", x) for x in e]
            for p, e in zip(block.state, errors, strict=True)
        ]
        inputs = [[self.held(f"u_{p.name}", given.get(p.name, 0.0))] * p.size for p in block.inputs]
        arguments = [*self._coefficients, *state, *inputs]
        words, rounding = block.flag_results, self.computed.rounding
        more = self.facts, self.count, solved, self.known
        return propagate(rounding, arguments, words, *more)

    def values(self, errors: Errors) -> tuple[list[Span], tuple[str, ...]]:
        """Every node's Span, and the assumptions, whatever the format knows besides."""
        return self.propagated(errors)

    def once(self, errors: Errors) -> tuple[Errors, tuple[str, ...]]:
        """Errors of all results, the worst of all boxes, and their assumptions."""
        values, assumptions = self.values(errors)
        found = [[float(x.max()) for x in row] for row in self._box_by_box(values)]
        whole = tuple(
            f"{self.block.name}: {p.name} is a whole number"
            for p in self.block.inputs
            if f"u_{p.name}" in self.whole
        )
        return found, assumptions + whole

    def _box_by_box(self, values: Sequence[Span]) -> list[list[Array]]:
        # Errors of all results.
        rows = zip(self.kernel.results, self.computed.conversions, strict=True)
        return [
            [values[i].a + c + values[i].r * values[i].magnitude for i, c in zip(*row, strict=True)]
            for row in rows
        ]

    def images(self, cases: Sequence[Errors]) -> Iterator[Errors]:
        """Errors of the next states, from errors of the states, case by case.

        Of a Block with a single box many cases go through at once, each a box of its own: an array
        of ten numbers takes little longer than one.
        """
        if len(cases) > 1 and self.count == 1 and not self.block.solved:
            beside = copy(self)
            beside.known = self.known.beside.setdefault(len(cases), Known())
            beside._set(self._room, len(cases))
            errors = [list(np.transpose(e)) for e in zip(*cases, strict=True)]
            with suppress(RangeError):  # of one case: that need not be one that is asked for
                values, _ = beside.propagated(errors)
                found = self._box_by_box(values)
                for k in range(len(cases)):
                    yield self.state_errors([[float(x[k]) for x in row] for row in found])
                return
        yield from (self.state_errors(self.once(e)[0]) for e in cases)

    def node_errors(self, errors: Errors) -> list[float]:
        """Largest |error| of every value of the step, the decisions before it being the same."""
        return [float(v.error.max()) for v in self.values(errors)[0]]

    def state_errors(self, results: Errors) -> Errors:
        """Of the next states: at most their range, for exact and computed both lie in it."""
        out = []
        for p, r in zip(self.block.state, results, strict=False):
            low, high = self.limits[f"s_{p.name}"]
            out.append([min(e, high - low) for e in r])
        return out

    def outputs(self, results: Errors) -> dict[str, float]:
        """Of the outputs that are numbers."""
        pairs = zip(self.block.outputs, results[len(self.block.state) :], strict=True)
        return {p.name: max(r) for p, r in pairs if not p.flags}


def bound_of(step: StepErrors, name: str) -> Bound:
    """Worst-case error of a Block for any number of steps, at its default tunables.

    The inputs are taken as exact in the format.  The state's error is a fixed point of one step's
    error propagation, verified as inductive: errors no larger going in come out no larger.  For a
    linear Block, whose stability intervals cannot see, one step's own error is summed through the
    powers of its state matrix instead.
    """
    block, limits = step.block, step.limits
    method, extra = "fixed point", tuple[str, ...]()
    solved = fixed_point(step)
    # At the ends of the states' own ranges it says nothing.
    idle = solved is not None and any(
        max(e) > 0.25 * (limits[f"s_{p.name}"][1] - limits[f"s_{p.name}"][0])
        for p, e in zip(block.state, solved, strict=True)
    )
    if (solved is None or idle) and is_linear(step.kernel, len(block.coefficients)):
        local = step.state_errors(step.once(step.zero)[0])
        solved, idle = linear_bound(block, local, step.known), False
        taken = ("no clip of a state acts", "no invalid input is bridged")
        method, extra = "linear", tuple(f"{block.name}: {x}" for x in taken)
    if solved is None or idle:
        raise RangeError(f"{block.name}: not stable, rounding errors may grow without limit")
    return _bound(step, name, math.inf, solved, method, extra)


def step_bound_of(step: StepErrors, name: str) -> Bound:
    """Worst-case error that one step adds, from the same memory, ``step`` having room.

    For a Block that forgets no error: an integral, or a limit on the rate of change, adds its
    rounding errors up.  It holds for corrupt states and invalid inputs too.
    """
    return _bound(step, name, 1, None, "one step", ())


def _bound(
    step: StepErrors,
    name: str,
    steps: float,
    states: Errors | None,
    method: str,
    extra: tuple[str, ...],
) -> Bound:
    results, assumptions = step.once(states or step.zero)
    after = states or step.state_errors(results)
    return Bound(
        name,
        steps,
        step.outputs(results),
        {p.name: max(e) for p, e in zip(step.block.state, after, strict=True)},
        method,
        assumptions + extra,
    )


def pieces(limits: tuple[float, float], cuts: Sequence[float]) -> list[tuple[float, float]]:
    # Each magnitude cuts on both sides of zero, where the range holds it.
    low, high = limits
    inside = sorted({c for m in cuts for c in (m, -m) if low < c < high})
    return list(pairwise([low, *inside, high]))


def _finer(cuts: Sequence[float], limits: tuple[float, float]) -> list[float]:
    # Between every two cuts one more: what multiplies two wide intervals gains most (knee_printed:
    # a quarter of the bound).
    edges = [*sorted(cuts), max(abs(x) for x in limits)]
    return [*cuts, *(math.sqrt(a * b) for a, b in pairwise(edges) if 0 < a < b)]


def _point(value: float, error: float, boxes: int) -> Span:
    # A number that is not 0 errs relatively: what it multiplies may be cut by a clip afterwards.
    if value == 0:
        return span(value, value, error, boxes)
    number = np.full(boxes, value)
    return Span(number, number, np.zeros(boxes), np.full(boxes, error / abs(value)))


def fixed_point(step: StepErrors) -> Errors | None:
    """Find errors of the states that one step does not make larger."""

    def image(errors: Errors) -> Errors:
        return next(iter(step.images([errors])))

    def scaled(errors: Errors, factor: float) -> Errors:
        # An error that has stopped growing is its own bound; only the others are searched for.
        rows = zip(errors, before, strict=True)
        return [
            [e if e <= b * (1 + 1e-12) else factor * e for e, b in zip(new, old, strict=True)]
            for new, old in rows
        ]

    def inductive(cases: list[Errors]) -> Iterator[bool]:
        for after, errors in zip(step.images(cases), cases, strict=True):
            pairs = zip(after, errors, strict=True)
            yield all(n <= e for new, old in pairs for n, e in zip(new, old, strict=True))

    before = errors = step.zero
    for _ in range(3):
        before, errors = errors, image(errors)
    # Any multiple that is inductive is a bound; find the smallest power of 4, halve the gap ...
    powers = [4.0**k for k in range(13)]
    good = inductive([scaled(errors, x) for x in powers])
    factor = next((x for x, is_bound in zip(powers, good, strict=True) if is_bound), None)
    if factor is None:
        return None
    low = factor / 4
    for _ in range(4 if factor > 1 else 0):
        middle = math.sqrt(low * factor)
        if all(inductive([scaled(errors, middle)])):
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


def linear_bound(block: Block, local: Errors, known: Known | None = None) -> Errors | None:
    known = known or Known()
    if known.matrix is None:
        known.matrix = (state_matrix(block),)
    (a,) = known.matrix
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
