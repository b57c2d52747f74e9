"""Proven error of a planned Block: one step's, and for all time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np

from esea_gen.emit.error_bounds import (
    BEYOND,
    Bound,
    Errors,
    fixed_point,
    is_linear,
    limits_of,
    linear_assumptions,
    linear_bound,
    pieces,
)
from esea_gen.emit.fixed.bound import Array, Known, Span, analyse, numeric_nodes, span
from esea_gen.emit.fixed.plan import BlockPlan, coefficients_raw
from esea_gen.emit.ranges import Analysis, RangeError
from esea_gen.emit.ranges import RangeValue as FloatValue
from esea_gen.language.block import Block, Solved


def _exact_coefficients(block: Block) -> list[Array]:
    return list(block.simulator().coefficients.values())


def _point(value: float, error: float, boxes: int) -> Span:
    # A number that is not 0 errs relatively: what it multiplies may be cut by a clip afterwards.
    if value == 0:
        return span(value, value, error, boxes)
    number = np.full(boxes, value)
    return Span(number, number, np.zeros(boxes), np.full(boxes, error / abs(value)))


def _finer(cuts: Sequence[float], limits: tuple[float, float]) -> list[float]:
    # Between every two cuts one more: all boxes go through at once here, and what multiplies two
    # wide intervals gains most (knee_printed: a quarter of the bound).
    edges = [*sorted(cuts), max(abs(x) for x in limits)]
    return [*cuts, *(math.sqrt(a * b) for a, b in pairwise(edges) if 0 < a < b)]


class Propagation:
    """One step's errors of a planned Block, from errors of its states."""

    def __init__(
        self,
        plan: BlockPlan,
        ranges: Mapping[str, tuple[float, float]],
        input_errors: Mapping[str, float],
        room: float = 0.0,
        known: Known | None = None,
    ) -> None:
        self.plan, self.block, self.known = plan, plan.block, known or Known()
        self.limits = limits_of(self.block, ranges)
        if self.known.setting is None:
            self.known.setting = self._setting(room)
        self.boxes, self.facts, self.coefficients = self.known.setting
        self.count = len(self.boxes)
        node = {name: i for i, (name, _) in plan.labels.items()}
        self.solved = {node[k]: (s, node[s.residual]) for k, s in self.block.solved.items()}
        self.inputs = [
            [self._held(f"u_{p.name}", input_errors.get(p.name, 0.0))] * p.size
            for p in self.block.inputs
        ]

    def _setting(self, room: float) -> tuple[Any, Any, list[list[Span]]]:
        # Boxes, facts in them, and coefficients: no plan of a Planner has others.
        boxes, facts = self._boxes(
            {k: (a - room * (b - a), b + room * (b - a)) for k, (a, b) in self.limits.items()}
        )
        coefficients = [
            [
                _point(float(x), abs(r * f.lsb - float(x)), len(boxes))
                for x, r in zip(exact, raw, strict=True)
            ]
            for exact, raw, f in zip(
                _exact_coefficients(self.block),
                coefficients_raw(self.plan),
                self.plan.fields["coeffs"],
                strict=True,
            )
        ]
        return boxes, facts, coefficients

    def _boxes(
        self, limits: Mapping[str, tuple[float, float]]
    ) -> tuple[list[dict[str, tuple[float, float]]], dict[int, tuple[Array, Array]]]:
        # Boxes of states and inputs, times pieces of the labelled values that are cut: a value that
        # follows from the others lies in one of its pieces, whatever they are.
        axes = [
            [(name, pair) for pair in pieces(limits[name], _finer(cuts, limits[name]))]
            if name in limits
            else [(name, pair) for pair in pieces(self.block.facts[name], cuts)]
            for name, cuts in self.block.split.items()
        ]
        boxes = [dict(limits) | dict(choice) for choice in product(*axes)]
        names = {i: name for i, (name, _) in self.plan.labels.items()}
        facts = {}
        for i, (low, high) in self.plan.facts.items():
            ends = [box.get(names[i], (low, high)) for box in boxes]
            facts[i] = np.array([e[0] for e in ends]), np.array([e[1] for e in ends])
        return boxes, facts

    @property
    def zero(self) -> Errors:
        return [[0.0] * p.size for p in self.block.state]

    def _held(self, name: str, error: float) -> Span:
        if name not in self.known.ends:
            low, high = (np.array([box[name][end] for box in self.boxes]) for end in (0, 1))
            self.known.ends[name] = low, high
        low, high = self.known.ends[name]
        return Span(low, high, np.full(self.count, error), np.zeros(self.count), True)

    def once(self, errors: Errors) -> Analysis:
        results, assumptions, _ = self._analysed(errors)
        assumptions += tuple(
            f"{self.block.name}: |{s.residual}| of {name} is at most {s.most:g}"
            for name, s in self.block.solved.items()
        )
        return Analysis(
            tuple(
                tuple(
                    FloatValue(float(v.low.min()), float(v.high.max()), float(v.error.max()))
                    for v in r
                )
                for r in results
            ),
            assumptions,
        )

    def _analysed(self, errors: Errors) -> tuple[list[list[Span]], tuple[str, ...], list[Span]]:
        state = [
            [self._held(f"s_{p.name}", x) for x in e]
            for p, e in zip(self.block.state, errors, strict=True)
        ]

        def analysed(solved: Mapping[int, Span]) -> tuple[Any, Any, list[Span]]:
            return analyse(
                self.plan.step,
                [*self.coefficients, *state, *self.inputs],
                self.block.flag_results,
                self.facts,
                self.count,
                solved,
                self.known,
            )

        if not self.solved:
            return analysed({})
        # What the residual's own computation errs by, the value being what it is; with it the
        # residual bounds the value's distance from where the exact one is 0.
        _, _, values = analysed({i: self._given(i, 0.0) for i in self.solved})
        pinned = {}
        for i, (s, r) in self.solved.items():
            error = (s.most + float(values[r].error.max())) / s.slope + s.jump
            for k, slope in self._followers(s, r):
                own = values[k]
                pinned[k] = Span(own.low, own.high, own.error + slope * error, np.zeros(self.count))
            pinned[i] = self._given(i, error)
        results, assumptions, carried = analysed(pinned)
        if len(pinned) > len(self.solved):
            # Between the value and what follows it errors are those of the first analysis.
            pairs = zip(carried, values, strict=True)
            carried = [a if np.all(a.error >= b.error) else b for a, b in pairs]
        return results, assumptions, carried

    def _given(self, i: int, error: float) -> Span:
        # The lowering cuts it to its fact, so that what is computed lies there too.
        low, high = (np.broadcast_to(e, (self.count,)) for e in self.facts[i])
        return Span(low, high, np.full(self.count, error), np.zeros(self.count), True)

    def _followers(self, s: Solved, residual: int) -> Iterator[tuple[int, float]]:
        # Nodes that follow a solved value by a known slope; the residual by its least.
        if not s.follows:
            return
        yield residual, s.slope
        ports = (*self.block.state, *self.block.outputs)
        for p, nodes in zip(ports, self.plan.step.kernel.results, strict=True):
            for k in nodes if not p.flags else ():
                if k not in self.solved and k != residual:
                    yield k, s.follows[p.name]

    def node_errors(self, errors: Errors) -> list[float]:
        """Largest |error| of every value of the step, the decisions before it being the same."""
        return [float(v.error.max()) for v in self._analysed(errors)[2]]

    @property
    def followed(self) -> frozenset[int]:
        """Nodes whose errors count: all, or those that do not merely lead to a solved value."""
        if not self.solved:
            return frozenset(range(len(self.plan.step.kernel.nodes)))
        return frozenset(numeric_nodes(self.plan.step, self.block.flag_results, self.solved))

    def state_errors(self, result: Analysis) -> Errors:
        out = []
        for p, r in zip(self.block.state, result.results, strict=False):
            low, high = self.limits[f"s_{p.name}"]
            out.append([min(v.error, high - low) for v in r])
        return out

    def outputs(self, result: Analysis) -> dict[str, float]:
        return {
            p.name: float(max(v.error for v in r))
            for p, r in zip(
                self.block.outputs, result.results[len(self.block.state) :], strict=True
            )
            if not p.flags
        }


def block_bound(
    plan: BlockPlan,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    input_errors: Mapping[str, float] | None = None,
    known: Known | None = None,
) -> Bound:
    """Worst-case error of a Block in q31 against exact arithmetic, for any number of steps."""
    block = plan.block
    step = Propagation(plan, ranges or {}, input_errors or {}, known=known)
    method, extra = "fixed point", tuple[str, ...]()
    solved = fixed_point(step.once, step.state_errors, step.zero)
    idle = solved is not None and any(
        max(e) > 0.25 * (step.limits[f"s_{p.name}"][1] - step.limits[f"s_{p.name}"][0])
        for p, e in zip(block.state, solved, strict=True)
    )
    if (solved is None or idle) and is_linear(plan.step.kernel, len(block.coefficients)):
        solved, idle = linear_bound(block, step.state_errors(step.once(step.zero))), False
        method, extra = "linear", linear_assumptions(block)
    if solved is None or idle:
        raise RangeError(f"{block.name}: not stable, rounding errors may grow without limit")
    final = step.once(solved)
    return Bound(
        "q31",
        math.inf,
        step.outputs(final),
        {p.name: max(e) for p, e in zip(block.state, solved, strict=True)},
        method,
        final.assumptions + extra,
    )


def step_bound(
    plan: BlockPlan,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    known: Known | None = None,
) -> Bound:
    """Worst-case error that one step adds, from the same memory.

    For a Block that :func:`block_bound` refuses: an integral, or a limit on the rate of change,
    adds its rounding errors up.
    """
    step = Propagation(plan, ranges or {}, {}, BEYOND, known)
    final = step.once(step.zero)
    states = step.state_errors(final)
    return Bound(
        "q31",
        1,
        step.outputs(final),
        {p.name: max(e) for p, e in zip(plan.block.state, states, strict=True)},
        "one step",
        final.assumptions,
    )


def any_bound(plan: BlockPlan, known: Mapping[float, Known] | None = None) -> Bound:
    """The bound for all time where the Block forgets its errors, else the one for a step."""
    known = known or {}
    try:
        return block_bound(plan, known=known.get(0.0))
    except RangeError:
        return step_bound(plan, known=known.get(BEYOND))
