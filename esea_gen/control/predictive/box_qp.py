r"""Box-constrained quadratic program: exact, always feasible, with a cap on its iterations.

    minimise  x' H x / 2 + f' x     subject to  low <= x <= high,     H positive definite

A primal active-set method (J. Nocedal, S. J. Wright, "Numerical Optimization", 2006, algorithm
16.3) on a symmetric tableau.  A sweep on a variable (J. H. Goodnight, The American Statistician
33(3), 1979; n (n + 1) / 2 multiply-adds) lets it go free or ties it to a bound, and n numbers
more give the new stationary point.  First every variable is freed, which proves H positive.  Then
x walks to the stationary point; the first bound in its way is tied; once there, the bound whose
release promises most is freed; until none promises anything.  Every x on the way is feasible and
none is worse than the one before.  A projected Newton or interior-point method factorises anew in
every iteration.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import casadi as ca

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
        b.array("qp_convex", 1, meaning="1 when every pivot was positive"),
        b.array("qp_capped", 1, meaning="1 when the iterations ran out"),
        b.array("qp_optimal", 1, meaning="1 when the check at the end passed"),
        b.array("qp_residual", 1, meaning="largest projected gradient step"),
        b.array("qp_iterations", 1, meaning="changes of the active set"),
    )
    _Writer(b, n, m).write(cap)
    return m


class _Writer:
    def __init__(self, b: Builder, n: int, m: QpMemory) -> None:
        size = m.H.size
        self.b, self.n, self.m, self.unroll = b, n, m, n <= UNROLL_MOST
        self.T = b.array("qp_T", size, meaning="swept tableau; minus the inverse where free")
        self.y = b.array(
            "qp_y", n, meaning="stationary point: values where free, gradients where tied"
        )
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
        self.flag = b.array("flag", 1, "local")
        self.stop = b.array("stop", 1, "local")
        self.product = b.array("qp_p", self.n, meaning="a matrix times a vector")
        with b.part("qp_gradient", comment="Gradient at x into y."):
            self._times(self.m.H, self.m.f, self.m.x, self.y)
        with b.part(
            "qp_refine",
            comment="A Newton step with the tableau takes out of x what rounding put into it.",
        ):
            self._refine()
        with b.part(
            "qp_solve", comment="Box QP: x from its start to the minimum, at most so many changes."
        ):
            self._free_all()
            with b.loop(0, cap + 1) as _:
                self._change()
            self._verdict()

    def _each(self) -> AbstractContextManager[Ix]:
        return self.b.loop(0, self.n, unroll=self.unroll)

    def _box(self, i: Ix) -> tuple[Ref, ...]:
        m = self.m
        return self.side[i], m.x[i], self.y[i], m.low[i], m.high[i]

    def _sweep(self) -> None:
        b, n, m, T, y, side = self.b, self.n, self.m, self.T, self.y, self.side
        c = b.array("c", n, "local")
        scale = b.array("inv_step_side", 3, "local")
        with b.part(
            "qp_sweep",
            "p",
            comment="Free variable p, or tie it where x holds it: one symmetric sweep.",
        ) as (p,):
            own = self.pair.at(p * (n + 1))
            with self._each() as i:
                b.call("copy", [T[self.pair.at(p * n + i)]], [c[i]], same)
            b.call(
                "pivot",
                [T[own], m.H[own], side[p], m.x[p], y[p], self.tiny[0], m.convex[0]],
                [scale[:], y[p], T[own], side[p], m.convex[0]],
                _pivot,
            )
            new_y = b.array("new_y", 1, "local")
            new_d = b.array("new_d", 1, "local")
            b.call("keep", [y[p], T[own]], [new_y[0], new_d[0]], _same_two)
            share = b.array("share", 1, "local")
            with self._each() as i:
                # Side 1: gradients rise; -1: values fall; by the pivot column times the step.
                b.call("shift", [y[i], side[i], c[i], scale[:]], [y[i], share[0]], _shift)
                with b.loop(0, i + 1, most=n, unroll=self.unroll) as j:
                    place = self.row.at(i) + j
                    b.call("rank_one", [T[place], share[0], c[j]], [T[place]], _rank)
            with self._each() as i:
                b.call("edge", [c[i], scale[:]], [T[self.pair.at(p * n + i)]], _edge)
            b.call("keep", [new_y[0], new_d[0]], [y[p], T[own]], _same_two)

    def _times(self, matrix: Memory, start: Memory | None, vector: Memory, to: Memory) -> None:
        # Each element of the triangle once, for both of its places.
        b, part = self.b, self.part
        with self._each() as i:
            if start is not None:
                b.call("begin", [start[i]], [to[i]], same)
            else:
                b.call("none", [], [to[i]], zero)
        with self._each() as i:
            own = matrix[self.pair.at(i * (self.n + 1))]
            b.call("own", [own, vector[i], to[i]], [part[0]], _own)
            with b.loop(0, i, most=self.n, unroll=self.unroll) as j:
                b.call(
                    "both",
                    [matrix[self.row.at(i) + j], vector[i], vector[j], part[0], to[j]],
                    [part[0], to[j]],
                    _both,
                )
            b.call("copy", [part[0]], [to[i]], same)

    def _refine(self) -> None:
        b, m, side, y, product = self.b, self.m, self.side, self.y, self.product
        with self._each() as i:
            b.call("free_only", [side[i], y[i]], [y[i]], _free_only)
        self._times(self.T, None, y, product)
        with self._each() as i:
            known = [side[i], m.x[i], product[i], m.low[i], m.high[i]]
            b.call("refine", known, [m.x[i]], _refine)

    def _free_all(self) -> None:
        b, m = self.b, self.m
        b.call("good", [], [m.convex[0]], one)
        b.call("ready", [], [m.capped[0]], one)
        b.call("none", [], [m.iterations[0]], zero)
        with self._each() as i:
            b.call("inside", [m.x[i], m.low[i], m.high[i]], [m.x[i], self.side[i]], _inside)
        with b.loop(0, m.H.size, unroll=self.unroll) as i:
            b.call("copy", [m.H[i]], [self.T[i]], same)
        b.invoke("qp_gradient")
        with b.loop(0, self.n) as p:
            b.invoke("qp_sweep", p)

    def _change(self) -> None:
        # One change of the active set: tie what is in the way, else free what promises most.
        b, m, y = self.b, self.m, self.y
        best, flag, stop = self.best, self.flag, self.stop
        which = b.index("which")
        b.set(which, self.n)
        b.call("whole", [], [best[0]], one)
        with self._each() as i:
            b.call("reach", [*self._box(i), best[0]], [flag[0], best[0]], _reach)
            with b.when(flag[0]):
                b.set(which, i)
        with self._each() as i:
            b.call("advance", [*self._box(i), best[0]], [m.x[i]], _advance)
        with b.when((which, "<", self.n)):
            b.call("tie", [m.x[which], y[which], m.low[which], m.high[which]], [m.x[which]], _tie)
        with b.otherwise():
            b.call("none", [], [best[0]], zero)
            with self._each() as i:
                curvature = self.T[self.pair.at(i * (self.n + 1))]
                b.call(
                    "promise",
                    [*self._box(i), curvature, self.still[0], best[0]],
                    [flag[0], best[0]],
                    _promise,
                )
                with b.when(flag[0]):
                    b.set(which, i)
            b.call("finished", [best[0]], [stop[0]], _is_zero)
            with b.when(stop[0]):
                b.call("done", [], [m.capped[0]], zero)
            b.exit_if(stop[0])
        b.invoke("qp_sweep", which)
        b.call("count", [m.iterations[0]], [m.iterations[0]], lambda k: k + 1)
        b.call("lost", [m.convex[0]], [stop[0]], _is_zero)
        b.exit_if(stop[0])

    def _verdict(self) -> None:
        b, m, stop = self.b, self.m, self.stop
        self._residual()
        # Only a minimum is refined (elsewhere the step would leave the best point so far), and only
        # where rounding has left something to refine.
        b.call("rough", [m.residual[0], m.capped[0], self.fine[0]], [stop[0]], _rough)
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
        with self._each() as i:
            curvature = m.H[self.pair.at(i * (self.n + 1))]
            b.call(
                "residual",
                [m.x[i], self.y[i], m.low[i], m.high[i], curvature, m.residual[0]],
                [m.residual[0]],
                _residual,
            )


# Not those of ``kernels``: a kernel of the same name and function is one kernel, and a Program that
# holds the solver has kernels of these names of its own.
def same(x: Any) -> Any:
    return x


def zero() -> Any:
    return ca.SX(0)


def one() -> Any:
    return ca.SX(1)


def _pivot(d: Any, h: Any, s: Any, x: Any, y: Any, tiny: Any, convex: Any) -> tuple[Any, ...]:
    # Entering: s = 1, y the gradient; leaving: s = -1, y the free value, x the bound.  A pivot
    # that is not positive (or NaN) changes nothing and is remembered.
    entering = s > 0
    sound = ca.logic_and(s * d > ca.if_else(entering, tiny * h, 0), convex)
    inv = ca.if_else(sound, 1 / ca.if_else(sound, d, 1), 0)
    step = -(ca.if_else(entering, y, x - y)) * inv
    new = ca.if_else(entering, x + step, step)
    return ca.vertcat(inv, step, s), new, -inv, -s, sound


def _same_two(x: Any, y: Any) -> Any:
    return x, y


def _shift(y: Any, side: Any, c: Any, scale: Any) -> Any:
    return y + side * (c * scale[1]), c * scale[0]


def _rank(t: Any, share: Any, c: Any) -> Any:
    return t - share * c


def _edge(c: Any, scale: Any) -> Any:
    return c * scale[0] * scale[2]


def _is_zero(x: Any) -> Any:
    return ca.logic_not(x > 0)


def _own(a: Any, x: Any, s: Any) -> Any:
    return s + a * x


def _both(h: Any, xi: Any, xj: Any, si: Any, sj: Any) -> Any:
    return si + h * xj, sj + h * xi


def _inside(x: Any, low: Any, high: Any) -> Any:
    return clip(x, low, high), ca.SX(1)


def _beyond(side: Any, y: Any, low: Any, high: Any) -> Any:
    return ca.logic_and(side < 0, ca.logic_or(y < low, y > high))


def _reach(side: Any, x: Any, y: Any, low: Any, high: Any, best: Any) -> Any:
    # Share of the way to the stationary point at which this variable meets its bound.
    beyond = _beyond(side, y, low, high)
    bound = ca.if_else(y < low, low, high)
    share = (bound - x) / ca.if_else(beyond, y - x, 1)
    first = ca.logic_and(beyond, share < best)
    return first, ca.if_else(first, share, best)


def _advance(side: Any, x: Any, y: Any, low: Any, high: Any, share: Any) -> Any:
    moved = ca.if_else(share < 1, x + share * (y - x), y)
    return ca.if_else(side < 0, clip(moved, low, high), x)


def _tie(x: Any, y: Any, low: Any, high: Any) -> Any:
    return ca.if_else(y < low, low, high)


def _promise(
    side: Any, x: Any, y: Any, low: Any, high: Any, curvature: Any, still: Any, best: Any
) -> Any:
    # How far a tied variable would move inwards if freed, y / curvature, and what that gains.
    push = ca.if_else(x >= high, y, -y)
    moves = push > still * (high - low) * curvature
    worth = push * push / ca.if_else(side > 0, curvature, 1)
    first = ca.logic_and(ca.logic_and(side > 0, low < high), ca.logic_and(moves, worth > best))
    return first, ca.if_else(first, worth, best)


def _rough(residual: Any, capped: Any, fine: Any) -> Any:
    return ca.logic_and(ca.logic_not(capped > 0), residual > fine)


def _free_only(side: Any, g: Any) -> Any:
    return ca.if_else(side < 0, g, 0)


def _refine(side: Any, x: Any, step: Any, low: Any, high: Any) -> Any:
    return ca.if_else(side < 0, clip(x + step, low, high), x)


def _residual(x: Any, g: Any, low: Any, high: Any, h: Any, worst: Any) -> Any:
    # In units of the box, so that one tolerance serves all problems.
    span = ca.if_else(high > low, high - low, 1)
    step = ca.fabs(clip(x - g / ca.if_else(h > 0, h, 1), low, high) - x) / span
    # A step inside the box is at most 1; NaN counts as 2 and so fails the check.
    return ca.fmax(worst, ca.if_else(step <= 1.5, step, 2))
