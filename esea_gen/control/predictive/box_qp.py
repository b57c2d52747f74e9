r"""Box-constrained quadratic program: exact, always feasible, with a cap on its iterations.

    minimise  x' H x / 2 + f' x     subject to  low <= x <= high,     H positive definite

A primal active-set method (J. Nocedal, S. J. Wright, "Numerical Optimization", 2006, algorithm
16.3) on a symmetric tableau.  First every variable is free: an LDL' factorisation (n^3 / 6
multiply-adds) proves H positive and gives the stationary point.  Only if that lies outside the box,
the factors become minus the inverse (n^3 / 3 more), which is the tableau.  A sweep on a variable
(J. H. Goodnight, The American Statistician 33(3), 1979; n (n + 1) / 2) then ties it to a bound or
lets it go free, and n numbers more give the new stationary point.  x walks there; the first bound
in its way is tied; once there, the bound whose release lowers the cost most is freed, until no
release lowers it.  Every x on the way is feasible and not worse than the one before.  A projected
Newton or interior-point method factorises again in every iteration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca

from esea_gen.control.predictive.kernels import one, plus, same, take_from, zero
from esea_gen.errors import UserError
from esea_gen.language.builder import Builder
from esea_gen.language.ports import clip
from esea_gen.language.statements import EPSILON, Ix, Memory, Ref

UNROLL_MOST = 16  # up to here straight code is faster and still small
SIZES = (1, 100)


def packed(i: int, j: int) -> int:
    """Place of an element of a symmetric matrix, lower triangle row by row."""
    a, b = max(i, j), min(i, j)
    return a * (a + 1) // 2 + b


@dataclass(frozen=True)
class QpMemory:
    """Arrays of a box QP inside a Program: problem, start and result ``x``, verdict."""

    H: Memory
    f: Memory
    low: Memory
    high: Memory
    x: Memory
    convex: Memory
    capped: Memory
    optimal: Memory
    residual: Memory
    iterations: Memory


def iteration_cap(n: int) -> int:
    """Changes of the active set after the first sweep; about 2 n is the most seen."""
    return 3 * n


def add_box_qp(b: Builder, n: int, cap: int | None = None) -> QpMemory:
    """Add the parts ``qp_sweep`` and ``qp_solve`` to a Program."""
    if not SIZES[0] <= n <= SIZES[1]:
        raise UserError(
            f"A box QP has {n} variables; {SIZES[0]} to {SIZES[1]} are possible.",
            "Choose another horizon.",
        )
    cap = iteration_cap(n) if cap is None else cap
    if not 0 <= cap <= 1000:
        raise UserError(f"The iteration cap is {cap}; 0 to 1000 are possible.", "Leave it out.")
    size = n * (n + 1) // 2
    m = QpMemory(
        b.array("qp_H", size, meaning="Hessian, lower triangle by rows"),
        b.array("qp_f", n, meaning="gradient at 0"),
        b.array("qp_low", n, meaning="lower bounds"),
        b.array("qp_high", n, meaning="upper bounds"),
        b.array("qp_x", n, meaning="start and result"),
        b.flag("qp_convex", "1 when every pivot was positive"),
        b.flag("qp_capped", "1 when the iterations ran out"),
        b.flag("qp_optimal", "1 when the check at the end passed"),
        b.array("qp_residual", 1, meaning="largest projected gradient step"),
        b.count("qp_iterations", cap + 1, "changes of the active set"),
    )
    _Writer(b, n, m).write(cap)
    return m


class _Writer:
    def __init__(self, b: Builder, n: int, m: QpMemory) -> None:
        self.b, self.n, self.m = b, n, m
        self.loop = partial(b.loop, unroll=n <= UNROLL_MOST)
        self.each = partial(b.each, n, unroll=n <= UNROLL_MOST)
        self.T = b.array("qp_T", m.H.size, meaning="factors of H, or swept tableau: its inverse")
        self.y = b.array(
            "qp_y", n, meaning="stationary point: values where free, gradients where tied"
        )
        self.full = b.flag("qp_full", "1 when T is the tableau")
        self.side = b.array("qp_side", n, meaning="-1 free, 1 tied")
        self.pair = b.index_table(
            "qp_pair", [packed(i, j) for i in range(n) for j in range(n)], "place of (i, j)"
        )
        self.row = b.index_table("qp_row", [packed(i, 0) for i in range(n)], "place of (i, 0)")

        def table(name: str, value: Callable[[float], float], meaning: str) -> Memory:
            return b.table(name, {k: [value(e)] for k, e in EPSILON.items()}, meaning)

        # Below this share of a variable's own curvature a pivot counts as 0.
        self.tiny = table("qp_tiny", lambda e: 8 * e, "smallest pivot share")
        # A release that moves its variable by less than this share of the box is rounding.
        self.still = table("qp_still", lambda e: e**0.7, "smallest release")
        self.fine = table("qp_fine", lambda e: e**0.8, "nothing to refine")
        self.near = table("qp_near", lambda e: e**0.5, "optimality tolerance")

    def write(self, cap: int) -> None:
        """The parts, in the order in which they are printed."""
        b = self.b
        self._sweep()
        self.part = b.array("part", 1, "local")
        self.best = b.array("best", 1, "local")
        self.flag = b.flag("flag", region="local")
        self.stop = b.flag("stop", region="local")
        self.product = b.array("qp_p", self.n, meaning="a matrix times a vector")
        self.column = b.array("column", self.n, "local")
        self._factor()
        self._newton()
        self._invert()
        with b.part("qp_gradient", comment="Gradient at x into y."):
            self._times(self.m.H, self.m.x, self.y, self.m.f)
        with b.part("qp_refine", comment="A Newton step takes out of x what rounding put into it."):
            self._refine()
        # A part of its own: where a compiler knows that all are free it enters the loop in two
        # places, and its passes cannot be bounded.
        with b.part("qp_free", comment="Every variable free, and its stationary point."):
            self._free_all()
        with b.part(
            "qp_solve", comment="Box QP: x from its start to the minimum, at most so many changes."
        ):
            b.invoke("qp_free")
            with b.loop(0, cap + 1) as _:
                self._change()
            self._verdict()

    def _diagonal(self, matrix: Memory, i: Ix) -> Ref:
        return matrix[self.pair.at(i * (self.n + 1))]

    def _box(self) -> tuple[Memory, ...]:
        m = self.m
        return self.side, m.x, self.y, m.low, m.high

    def _sweep(self) -> None:
        b, n, m, T, y, side = self.b, self.n, self.m, self.T, self.y, self.side
        c = b.array("c", n, "local")
        scale = b.array("inv_step_side", 3, "local")
        new_y, new_d, share = (b.array(x, 1, "local") for x in ("new_y", "new_d", "share"))
        with b.part(
            "qp_sweep",
            "p",
            comment="Free variable p, or tie it where x holds it: one symmetric sweep.",
        ) as (p,):
            own = self._diagonal(T, p)
            with self.loop(0, n) as i:
                b.call("copy", [T[self.pair.at(p * n + i)]], [c[i]], same)
            b.call(
                "pivot",
                [own, self._diagonal(m.H, p), side[p], m.x[p], y[p], self.tiny[0], m.convex[0]],
                [scale[:], new_y[0], new_d[0], side[p], m.convex[0]],
                _pivot,
            )
            with self.loop(0, n) as i:
                # Side 1: gradients rise; -1: values fall; by the pivot column times the step.
                b.call("shift", [y[i], side[i], c[i], scale[:]], [y[i], share[0]], _shift)
                self._rank_one(i, 0, i + 1, share, c)
            with self.loop(0, n) as i:
                known = [c[i], scale[0], scale[2]]
                b.call("edge", known, [T[self.pair.at(p * n + i)]], lambda c, inv, s: c * inv * s)
            b.call("keep", [new_y[0], new_d[0]], [y[p], own], lambda y, d: (y, d))

    def _rank_one(self, i: Ix, start: Ix | int, stop: Ix, share: Memory, c: Memory) -> None:
        with self.loop(start, stop, most=self.n) as j:
            there = self.T[self.row.at(i) + j]
            self.b.call("rank_one", [there, share[0], c[j]], [there], take_from)

    def _factor(self) -> None:
        b, n, T, convex = self.b, self.n, self.T, self.m.convex[0]
        with (
            b.part("qp_factor", comment="Factors of H: unit lower ones, minus inverse pivots."),
            self.loop(0, n) as p,
        ):
            own = self._diagonal(T, p)
            known = [own, self._diagonal(self.m.H, p), self.tiny[0], convex]
            b.call("first", known, [own, convex], _first)
            with self.loop(p + 1, n, most=n) as i:
                self._eliminate(i, p + 1, T[self.row.at(i) + p], own)

    def _invert(self) -> None:
        n, T, part = self.n, self.T, self.part
        with (
            self.b.part("qp_invert", comment="Factors of H to minus its inverse."),
            self.loop(0, n) as p,
        ):
            with self.loop(0, p, most=n) as i:
                self._eliminate(i, 0, T[self.row.at(p) + i], self._diagonal(T, p))
            with self.loop(p + 1, n, most=n) as i:
                self.b.call("copy", [T[self.row.at(i) + p]], [part[0]], same)
                self._rank_one(i, 0, p, part, self.column)

    def _eliminate(self, i: Ix, start: Ix | int, there: Ref, pivot: Ref) -> None:
        c, part = self.column, self.part
        self.b.call("share", [there, pivot], [c[i], part[0]], lambda x, d: (x, -(x * d)))
        self._rank_one(i, start, i + 1, part, c)
        self.b.call("copy", [part[0]], [there], same)

    def _newton(self) -> None:
        b, n, T, part, p = self.b, self.n, self.T, self.part, self.product
        with b.part("qp_newton", comment="From gradient y the step to the stationary point."):
            with self.loop(0, n) as i:
                b.call("copy", [self.y[i]], [part[0]], same)
                with self.loop(0, i, most=n) as j:
                    b.call("forward", [part[0], T[self.row.at(i) + j], p[j]], [part[0]], take_from)
                b.call("copy", [part[0]], [p[i]], same)
            with self.loop(0, n) as i:
                b.call("scale", [p[i], self._diagonal(T, i)], [p[i]], lambda x, d: x * d)
            with self.loop(1, n) as k:
                i = n - k
                b.call("copy", [p[i]], [part[0]], same)
                with self.loop(0, i, most=n) as j:
                    b.call("backward", [p[j], part[0], T[self.row.at(i) + j]], [p[j]], take_from)

    def _times(self, matrix: Memory, vector: Memory, to: Memory, start: Memory | None) -> None:
        # Each element of the triangle once, for both of its places.
        b, part = self.b, self.part
        if start is not None:
            self.each("begin", [start], [to], same)
        else:
            self.each("none", [], [to], zero)
        with self.loop(0, self.n) as i:
            b.call("own", [to[i], self._diagonal(matrix, i), vector[i]], [part[0]], plus)
            with self.loop(0, i, most=self.n) as j:
                known = [matrix[self.row.at(i) + j], vector[i], vector[j], part[0], to[j]]
                b.call("both", known, [part[0], to[j]], _both)
            b.call("copy", [part[0]], [to[i]], same)

    def _refine(self) -> None:
        b, m, side, y, product = self.b, self.m, self.side, self.y, self.product
        self.each("free_only", [side, y], [y], lambda side, g: ca.if_else(side < 0, g, 0))
        with b.when(self.full[0]):
            self._times(self.T, y, product, None)
        with b.otherwise():
            b.invoke("qp_newton")
        self.each("refine", [side, m.x, product, m.low, m.high], [m.x], _refine)

    def _free_all(self) -> None:
        b, m, full = self.b, self.m, self.full[0]
        begun = [m.convex[0], m.capped[0], m.iterations[0], full]
        b.call("begun", [], begun, lambda: (1, 1, 0, 0))
        self.each("inside", [m.x, m.low, m.high], [m.x, self.side], _inside)
        b.each(m.H.size, "copy", [m.H], [self.T], same, unroll=self.n <= UNROLL_MOST)
        b.invoke("qp_gradient")
        b.invoke("qp_factor")
        b.invoke("qp_newton")
        self.each("outside", [m.x, self.product, m.low, m.high, full], [self.y, full], _outside)
        with b.when(full):
            b.invoke("qp_invert")

    def _change(self) -> None:
        # One change of the active set: tie what is in the way, else free what promises most.
        b, m, y = self.b, self.m, self.y
        best, stop = self.best, self.stop
        which = b.index("which")
        b.call("whole", [], [best[0]], one)
        self._best(which, "reach", lambda i: [], _reach)
        self.each("advance", [*self._box(), best[0]], [m.x], _advance)
        with b.when((which, "<", self.n)):
            b.call("tie", [y[which], m.low[which], m.high[which]], [m.x[which]], _bound)
        with b.otherwise():
            b.call("none", [], [best[0]], zero)
            self._best(
                which, "promise", lambda i: [self._diagonal(self.T, i), self.still[0]], _promise
            )
            b.call("finished", [best[0]], [stop[0]], lambda best: ca.logic_not(best > 0))
            with b.when(stop[0]):
                b.call("done", [], [m.capped[0]], zero)
            b.exit_if(stop[0])
        b.invoke("qp_sweep", which)
        b.call("count", [m.iterations[0]], [m.iterations[0]], lambda k: k + 1)
        b.call("lost", [m.convex[0]], [stop[0]], ca.logic_not)
        b.exit_if(stop[0])

    def _best(
        self, which: Ix, name: str, more: Callable[[Ix], list[Ref]], better: Callable[..., Any]
    ) -> None:
        # The variable that is better than ``best`` and than all others; without one, n.
        b, best, flag = self.b, self.best[0], self.flag[0]
        b.set(which, self.n)
        with self.loop(0, self.n) as i:
            known = [*(x[i] for x in self._box()), *more(i), best]
            b.call(name, known, [flag, best], better)
            with b.when(flag):
                b.set(which, i)

    def _verdict(self) -> None:
        b, m, stop = self.b, self.m, self.stop
        self._residual()
        # Only a minimum is refined (elsewhere the step would leave the best point so far), and only
        # where rounding has left something to refine.
        b.call(
            "rough",
            [m.residual[0], m.capped[0], self.fine[0]],
            [stop[0]],
            lambda r, capped, fine: ca.logic_and(ca.logic_not(capped), r > fine),
        )
        with b.when(stop[0]):
            b.invoke("qp_refine")
            self._residual()
        b.call(
            "verdict",
            [m.residual[0], self.near[0], m.convex[0], m.capped[0]],
            [m.optimal[0]],
            lambda r, near, convex, capped: ca.logic_and(
                r <= near, ca.logic_and(convex, ca.logic_not(capped))
            ),
        )

    def _residual(self) -> None:
        b, m = self.b, self.m
        b.invoke("qp_gradient")
        b.call("none", [], [m.residual[0]], zero)
        with self.loop(0, self.n) as i:
            known = [m.x[i], self.y[i], m.low[i], m.high[i], self._diagonal(m.H, i), m.residual[0]]
            b.call("residual", known, [m.residual[0]], _residual)


def _pivot(d: Any, h: Any, s: Any, x: Any, y: Any, tiny: Any, convex: Any) -> tuple[Any, ...]:
    # Entering: s = 1, y the gradient; leaving: s = -1, y the free value, x the bound.  A pivot
    # that is not positive (or NaN) changes nothing and is remembered.
    entering = s > 0
    sound = ca.logic_and(s * d > ca.if_else(entering, tiny * h, 0), convex)
    inv = ca.if_else(sound, 1 / ca.if_else(sound, d, 1), 0)
    step = -(ca.if_else(entering, y, x - y)) * inv
    new = ca.if_else(entering, x + step, step)
    return ca.vertcat(inv, step, s), new, -inv, -s, sound


def _first(d: Any, h: Any, tiny: Any, convex: Any) -> tuple[Any, ...]:
    sound = ca.logic_and(d > tiny * h, convex)
    inv = ca.if_else(sound, 1 / ca.if_else(sound, d, 1), 0)
    return -inv, sound


def _outside(x: Any, step: Any, low: Any, high: Any, full: Any) -> tuple[Any, Any]:
    y = x + step
    return y, ca.logic_or(full, ca.logic_or(y < low, y > high))


def _shift(y: Any, side: Any, c: Any, scale: Any) -> Any:
    return y + side * (c * scale[1]), c * scale[0]


def _both(h: Any, xi: Any, xj: Any, si: Any, sj: Any) -> Any:
    return si + h * xj, sj + h * xi


def _inside(x: Any, low: Any, high: Any) -> Any:
    return clip(x, low, high), ca.SX(-1)


def _bound(y: Any, low: Any, high: Any) -> Any:
    return ca.if_else(y < low, low, high)


def _reach(side: Any, x: Any, y: Any, low: Any, high: Any, best: Any) -> Any:
    # Share of the way to the stationary point at which this variable meets its bound.
    beyond = ca.logic_and(side < 0, ca.logic_or(y < low, y > high))
    share = (_bound(y, low, high) - x) / ca.if_else(beyond, y - x, 1)
    first = ca.logic_and(beyond, share < best)
    return first, ca.if_else(first, share, best)


def _advance(side: Any, x: Any, y: Any, low: Any, high: Any, share: Any) -> Any:
    moved = ca.if_else(share < 1, x + share * (y - x), y)
    return ca.if_else(side < 0, clip(moved, low, high), x)


def _promise(
    side: Any, x: Any, y: Any, low: Any, high: Any, curvature: Any, still: Any, best: Any
) -> Any:
    # How far a tied variable would move inwards if freed, y / curvature, and what that gains.
    push = ca.if_else(x >= high, y, -y)
    moves = push > still * (high - low) * curvature
    worth = push * push / ca.if_else(side > 0, curvature, 1)
    first = ca.logic_and(ca.logic_and(side > 0, low < high), ca.logic_and(moves, worth > best))
    return first, ca.if_else(first, worth, best)


def _refine(side: Any, x: Any, step: Any, low: Any, high: Any) -> Any:
    return ca.if_else(side < 0, clip(x + step, low, high), x)


def _residual(x: Any, g: Any, low: Any, high: Any, h: Any, worst: Any) -> Any:
    # In units of the box, so that one tolerance serves all problems.
    span = ca.if_else(high > low, high - low, 1)
    step = ca.fabs(clip(x - g / ca.if_else(h > 0, h, 1), low, high) - x) / span
    # A step inside the box is at most 1; NaN counts as 2 and so fails the check.
    return ca.fmax(worst, ca.if_else(step <= 1.5, step, 2))
