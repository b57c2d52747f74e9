"""Proven error of a planned Block: one step's, and for all time."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from esea_gen.emit.fixed.elementary import EXPONENT_ERROR
from esea_gen.emit.fixed.plan import BlockPlan, coefficients_raw
from esea_gen.emit.fixed.values import LoweredKernel, Value
from esea_gen.emit.spans import Known, RangeError, Rounding, Span, numeric_nodes, span
from esea_gen.emit.step_errors import (
    BEYOND,
    Bound,
    ComputedStep,
    Errors,
    Ranges,
    StepErrors,
    bound_of,
    step_bound_of,
)
from esea_gen.language.block import Solved


class FixedRounding(Rounding):
    """Rounding of every operation, as recorded by the lowering."""

    def __init__(self, lowered: LoweredKernel) -> None:
        super().__init__(lowered.kernel)
        self.lowered = lowered

    def computed(self, i: int) -> bool:
        """False for a part of a status word."""
        return self.lowered.values[i] is not None

    def constant(self, value: float, boxes: int) -> Span:
        """Exact: how it is stored depends on who uses it."""
        return span(value, value, 0.0, boxes)

    def _own(self, i: int) -> Value:
        own = self.lowered.values[i]
        assert own is not None
        return own

    def read(self, i: int, x: Span) -> Span:
        """An input; a coefficient, which passes no check, has its raw range."""
        return x if x.reach is not None else replace(x, reach=self._own(i).reach)

    def stored(self, i: int) -> Mapping[int, float]:
        """Errors of the operands that are constants."""
        return self._own(i).constants

    def key(self, i: int) -> Hashable:
        """Errors of its own, and the range."""
        return self._own(i).rounding

    def exponent_error(self, exponent: float) -> float:
        """Half of 2^-27."""
        return EXPONENT_ERROR * 1.001

    def finished(self, i: int, operands: Sequence[Span], x: Span) -> Span:
        """With the errors that the operation adds."""
        own = self._own(i)
        more = 1 + own.relative
        a, r = x.a * more + own.local, x.r * more + own.relative
        # Away from zero a small absolute error is carried as a relative one: products and quotients
        # of wide intervals then keep it small, where an absolute one would meet the other's
        # largest.
        away = (x.low > 0) | (x.high < 0)
        if away.any():
            least = np.minimum(np.abs(x.low), np.abs(x.high))
            share = a / np.where(away, least, 1.0)
            use = away & (share <= np.maximum(8 * r, 2.0**-30))
            a, r = np.where(use, 0.0, a), np.where(use, r + share, r)
        # What is emitted never leaves its proven interval.
        return Span(x.low, x.high, a, r, own.reach)

    def settled(self, i: int, operands: Sequence[Span]) -> bool:
        """Of exact numbers that the comparison does not round."""
        own = self.lowered.values[i]
        return own is not None and own.local == 0 and super().settled(i, operands)


class Propagation(StepErrors):
    """One step's errors of a planned Block, at its default tunables.

    known: of other plans of the same Planner, with the same ranges and room.
    """

    def __init__(
        self,
        plan: BlockPlan,
        ranges: Ranges | None = None,
        input_errors: Mapping[str, float] | None = None,
        room: float = 0.0,
        known: Known | None = None,
    ) -> None:
        self.plan = plan
        computed = ComputedStep(
            plan.block,
            FixedRounding(plan.step),
            {i: name for i, (name, _) in plan.labels.items()},
            plan.facts,
            lambda: _coefficients(plan),
            plan.step.conversions,
        )
        super().__init__(computed, ranges, room, input_errors, known)
        node = {name: i for i, name in computed.labels.items()}
        self.solved = {node[k]: (s, node[s.residual]) for k, s in self.block.solved.items()}

    def once(self, errors: Errors) -> tuple[Errors, tuple[str, ...]]:
        """Errors of all results, for the allowed residuals of solved values."""
        found, assumptions = super().once(errors)
        return found, assumptions + tuple(
            f"{self.block.name}: |{s.residual}| of {name} is at most {s.most:g}"
            for name, s in self.block.solved.items()
        )

    def values(self, errors: Errors) -> tuple[list[Span], tuple[str, ...]]:
        """Every node's Span: a solved value's from its residual, not from the way to it."""
        if not self.solved:
            return self.propagated(errors)
        # What the residual's own computation errs by, the value being what it is; with it the
        # residual bounds the value's distance from where the exact one is 0.
        values, _ = self.propagated(errors, {i: self._given(i, 0.0) for i in self.solved})
        pinned = {}
        for i, (s, r) in self.solved.items():
            error = (s.most + float(values[r].error.max())) / s.slope + s.jump
            for k, slope in self._followers(s, r):
                own = values[k]
                pinned[k] = replace(own, a=own.error + slope * error, r=np.zeros(self.count))
            pinned[i] = self._given(i, error)
        carried, assumptions = self.propagated(errors, pinned)
        if len(pinned) > len(self.solved):
            # Between the value and what follows it errors are those of the first analysis.
            pairs = zip(carried, values, strict=True)
            carried = [a if np.all(a.error >= b.error) else b for a, b in pairs]
        return carried, assumptions

    def _given(self, i: int, error: float) -> Span:
        # The lowering cuts it to its fact, so that what is computed lies there too.
        low, high = (np.broadcast_to(e, (self.count,)) for e in self.facts[i])
        return Span(low, high, np.full(self.count, error), np.zeros(self.count), (low, high))

    def _followers(self, s: Solved, residual: int) -> Iterator[tuple[int, float]]:
        # Nodes that follow a solved value by a known slope; the residual by its least.
        if not s.follows:
            return
        yield residual, s.slope
        ports = (*self.block.state, *self.block.outputs)
        for p, nodes in zip(ports, self.kernel.results, strict=True):
            for k in nodes if not p.flags else ():
                if k not in self.solved and k != residual:
                    yield k, s.follows[p.name]

    @property
    def followed(self) -> frozenset[int]:
        """Nodes whose errors count: all, or those that do not merely lead to a solved value."""
        if not self.solved:
            return frozenset(range(len(self.kernel.nodes)))
        return frozenset(numeric_nodes(self.kernel, self.block.flag_results, self.solved))


def _coefficients(plan: BlockPlan) -> list[list[tuple[float, float]]]:
    exact = plan.block.simulator().coefficients.values()
    rows = zip(exact, coefficients_raw(plan), plan.fields["coeffs"], strict=True)
    return [
        [(float(x), abs(r * f.lsb - float(x))) for x, r in zip(values, raw, strict=True)]
        for values, raw, f in rows
    ]


def block_bound(
    plan: BlockPlan,
    ranges: Ranges | None = None,
    input_errors: Mapping[str, float] | None = None,
    known: Known | None = None,
) -> Bound:
    """Worst-case error in q31 against exact rounding, for any number of steps."""
    return bound_of(Propagation(plan, ranges, input_errors, known=known), "q31")


def step_bound(plan: BlockPlan, known: Known | None = None) -> Bound:
    """Worst-case error that one step adds in q31."""
    return step_bound_of(Propagation(plan, room=BEYOND, known=known), "q31")


def any_bound(plan: BlockPlan, known: Mapping[float, Known] | None = None) -> Bound:
    """The bound for all time where the Block forgets its errors, else the one for a step.

    known: by the room of :class:`Propagation`, of other plans of the same Planner.
    """
    known = known or {}
    try:
        return block_bound(plan, known=known.get(0.0))
    except RangeError:
        return step_bound(plan, known=known.get(BEYOND))
