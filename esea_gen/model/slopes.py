"""Block with the exact derivatives of its outputs by tunables: forward mode, step by step.

Along ``s+ = f(c, s, u)`` runs ``ds+/dp = df/ds ds/dp + df/dc dc/dp``, stored as further states,
only for states that depend on a tunable (Griewank, Walther, "Evaluating Derivatives", 2008).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Port, around

FAR = 1e30  # range of a derivative: it has none of its own


def sloped(block: Block, outputs: Sequence[str], by: Sequence[str]) -> Block:
    """A Block that gives outputs of another and their derivatives by its tunables."""
    tunables = {t.name: ca.SX.sym(t.name) for t in block.tunables}
    prepared = block.prepare(*tunables.values())
    prepared = ca.vertcat(*(prepared if isinstance(prepared, tuple) else (prepared,)))
    by_tunable = ca.jacobian(prepared, ca.vertcat(*(tunables[n] for n in by)))
    form = _Form(block, outputs, by_tunable)
    kept = Port("c_slopes", -FAR, FAR, "derivatives of the coefficients", by_tunable.nnz())
    state = (*block.state, *form.state())
    slopes = around("slopes", FAR, "derivatives of the outputs", len(outputs) * len(by))
    count = len(block.coefficients)

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        given = [getattr(t, x.name) for x in block.tunables]
        values = block.prepare(*given)
        values = values if isinstance(values, tuple) else (values,)
        held: list[Any] = by_tunable.nonzeros()
        found = ca.Function("d", list(tunables.values()), [ca.vertcat(*held)])
        out = {p.name: v for p, v in zip(block.coefficients, values[:count], strict=True)}
        return out | {kept.name: found(*given)}

    return Block.define(
        "slopes",
        f"{block.title}, and its derivatives",
        period_s=form.h,
        step=form.step,
        tunables=block.tunables,
        coefficients=(*block.coefficients, kept),
        prepare=prepare,
        state=state,
        inputs=block.inputs,
        outputs=(*(p for p in block.outputs if p.name in outputs), slopes),
    )


class _Form:
    def __init__(self, block: Block, outputs: Sequence[str], by_tunable: ca.SX) -> None:
        self.h, self.block, self.outputs = block.period_s, block, outputs
        self.tunables = by_tunable.shape[1]
        self.seeds = by_tunable.sparsity()
        groups = (block.coefficients, block.state, block.inputs)
        self.symbols = [[ca.SX.sym(p.name, p.size) for p in group] for group in groups]
        self.c: ca.SX = ca.vertcat(*self.symbols[0])
        self.s: ca.SX = ca.vertcat(*self.symbols[1])
        results: Any = block.step(*[x for group in self.symbols for x in group])
        results = results if isinstance(results, tuple) else (results,)
        self.next: ca.SX = ca.vertcat(*results[: len(block.state)])
        every = dict(zip((p.name for p in block.outputs), results[len(block.state) :], strict=True))
        self.wanted: ca.SX = ca.vertcat(*(every[n] for n in outputs))
        self.moved = self._reached()

    def _reached(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        # By tunable and state, whether it moves: what depends on what moves moves too.
        direct = _pattern(self.next, self.c) @ np.array(ca.DM(self.seeds, 1), bool)
        within = _pattern(self.next, self.s)
        moved = direct > 0
        while True:
            more = moved | (within.astype(int) @ moved.astype(int) > 0)
            if np.array_equal(more, moved):
                return np.asarray(moved.T)
            moved = more

    def state(self) -> tuple[Port, ...]:
        count = int(self.moved.sum())
        return (Port("s_slopes", -FAR, FAR, "derivatives of the state", count),) if count else ()

    def step(
        self, c: Any, s: Any, u: Any, guard: Guard, label: Labels
    ) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        known = self._known(c, s)
        moved, slopes = [], []
        for k, reached in enumerate(self.moved):
            states, outputs = self._along(k, known)
            moved += [states[int(i)] for i in np.flatnonzero(reached)]
            slopes.append(outputs)
        block = self.block
        given = [getattr(c, p.name) for p in block.coefficients]
        given += [getattr(s, p.name) for p in block.state]
        given += [getattr(u, p.name) for p in block.inputs]
        memory, wanted, followed, slopes_now = ca.substitute(
            [self.next, self.wanted, ca.vertcat(*moved), ca.vertcat(*_by_output(slopes))],
            [x for group in self.symbols for x in group],
            given,
        )
        nexts = ca.vertsplit(memory, np.cumsum([0, *(p.size for p in block.state)]).tolist())
        out = {p.name: v for p, v in zip(block.state, nexts, strict=True)}
        if moved:
            out["s_slopes"] = followed
        values = dict(zip(self.outputs, ca.vertsplit(wanted), strict=True))
        return out, values | {"slopes": slopes_now}

    def _known(self, c: Any, s: Any) -> tuple[ca.SX, ca.SX]:
        by_tunable = ca.SX(self.seeds, c.c_slopes)
        by_state = ca.SX(*self.moved.T.shape)
        place = 0
        for k, reached in enumerate(self.moved):
            for i in np.flatnonzero(reached):
                by_state[int(i), k] = s.s_slopes[place]
                place += 1
        return by_tunable, by_state

    def _along(self, k: int, known: tuple[ca.SX, ca.SX]) -> tuple[ca.SX, ca.SX]:
        # What tunable k does to next state and outputs: through the coefficients, and through the
        # state.  The first has no number where a power's base is 0: its share is 0 there.
        by_tunable, by_state = known
        every = ca.vertcat(self.next, self.wanted)
        direct = ca.jtimes(every, self.c, by_tunable[:, k])
        direct = ca.if_else(ca.fabs(direct) <= FAR, direct, 0)
        total = direct + ca.jtimes(every, self.s, by_state[:, k])
        return total[: self.next.shape[0]], total[self.next.shape[0] :]


def _by_output(slopes: Sequence[ca.SX]) -> list[ca.SX]:
    # Given by tunable; wanted output by output.
    table = ca.horzcat(*slopes)
    return [table[i, :].T for i in range(table.shape[0])]


def _pattern(values: ca.SX, symbols: ca.SX) -> np.ndarray[Any, np.dtype[np.intp]]:
    # Of the derivative, not of the value: what a comparison looks at moves nothing.
    columns = []
    for unit in np.eye(symbols.shape[0]):
        moved = ca.densify(ca.jtimes(values, symbols, ca.DM(unit)))
        columns.append([not moved[i].is_zero() for i in range(moved.shape[0])])
    return np.array(columns).T.astype(np.intp)
