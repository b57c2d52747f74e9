r"""Box-constrained quadratic program: exact, always feasible, with a cap on its iterations.

    minimise  x' H x / 2 + f' x     subject to  low <= x <= high,     H positive definite

A primal active-set method on a symmetric tableau.  Sweeping the tableau on a variable (a symmetric
Gauss-Jordan step, n (n + 1) / 2 multiply-adds) lets the variable go free or ties it to a bound, and
an update of n numbers gives the new stationary point.  First every variable is freed, which proves
H positive; the stationary point is then the unconstrained minimum, and where it lies inside the box
nothing else is to be done.  Otherwise x walks from its start to the stationary point, is stopped by
the first bound in its way, which is tied; once there, the bound whose release promises most is
freed; until none promises anything.  Every x on the way is feasible and none is worse than the one
before, so that the last is the best when the cap is reached.

Why not a projected Newton or an interior-point method, as our trials had: those factorise anew in
every iteration (n^3 / 6), this one changes the factor by one variable, and the bound on its running
time is what it nearly always takes.  On random problems with ten variables, most of them at bounds,
it changed 30 variables at most, the first ten included; docs/predictive.md has the table.

References
----------
.. [1] J. Nocedal, S. J. Wright, "Numerical Optimization", 2nd ed., Springer 2006, algorithm 16.3.
.. [2] J. H. Goodnight, "A tutorial on the SWEEP operator", The American Statistician 33(3), 1979.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from esea_gen.errors import UserError
from esea_gen.language.builder import Builder, declare_ports
from esea_gen.language.ports import Flag, Port, clip, flag_word
from esea_gen.language.program import Program
from esea_gen.language.statements import EPSILON, Memory

UNROLL_MOST = 16  # up to here straight code is faster and still small
SIZES = (1, 100)

FLAGS = (
    Flag("INPUT_INVALID", "a number was NaN, infinite or too large, or low above high", True),
    Flag("NOT_CONVEX", "the Hessian is not positive definite", True),
    Flag("CAP_REACHED", "iterations ran out; x is feasible, not optimal", True),
    Flag("NOT_OPTIMAL", "the optimality check at the end failed", True),
)


def packed(i: int, j: int) -> int:
    """Place of an element of a symmetric matrix, lower triangle row by row."""
    a, b = max(i, j), min(i, j)
    return a * (a + 1) // 2 + b


@dataclass(frozen=True)
class QpMemory:
    """Arrays of a box QP inside a Program.

    H, f, low, high: the problem: packed Hessian, gradient at 0, bounds.
    x: start (any numbers; they are clipped) and result.
    iterations: changes of the active set after the first sweep over all variables.
    residual: largest distance between x and its projected gradient step, each gradient over its own
        diagonal element of H.
    """

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


def flags_of(*conditions: Any) -> ca.SX:
    """A status word from conditions."""
    return flag_word(ca.SX(c) for c in conditions)


def iteration_cap(n: int) -> int:
    """Cap on the changes of the active set after the first sweep over all variables.

    return: ``3 n``; the most seen on our random and worst-case problems is about ``2 n``.
    """
    return 3 * n


def add_box_qp(b: Builder, n: int, cap: int | None = None) -> QpMemory:
    """Add the parts ``qp_sweep`` and ``qp_solve`` to a Program.

    cap: cap on the iterations, :func:`iteration_cap` when not given.
    """
    if not SIZES[0] <= n <= SIZES[1]:
        raise UserError(
            f"A box QP has {n} variables; {SIZES[0]} to {SIZES[1]} are possible.",
            "Choose another horizon.",
        )
    cap = iteration_cap(n) if cap is None else cap
    if not 0 <= cap <= 1000:
        raise UserError(f"The iteration cap is {cap}; 0 to 1000 are possible.", "Leave it out.")
    size = n * (n + 1) // 2
    unroll = n <= UNROLL_MOST
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
    T = b.array("qp_T", size, meaning="swept tableau; minus the inverse where free")
    y = b.array("qp_y", n, meaning="stationary point: values where free, gradients where tied")
    side = b.array("qp_side", n, meaning="-1 free, 1 tied")
    pair = b.index_table(
        "qp_pair", [packed(i, j) for i in range(n) for j in range(n)], "place of (i, j)"
    )
    row = b.index_table("qp_row", [packed(i, 0) for i in range(n)], "place of (i, 0)")
    # Below this share of a variable's own curvature a pivot counts as 0.
    tiny = b.table("qp_tiny", {k: [8 * e] for k, e in EPSILON.items()}, "smallest pivot share")
    # A release that moves its variable by less than this share of the box is rounding.
    still = b.table("qp_still", {k: [e**0.7] for k, e in EPSILON.items()}, "smallest release")
    fine = b.table("qp_fine", {k: [e**0.8] for k, e in EPSILON.items()}, "nothing to refine")
    near = b.table("qp_near", {k: [e**0.5] for k, e in EPSILON.items()}, "optimality tolerance")

    _sweep(b, n, unroll, m, T, y, side, pair, row, tiny)
    _solve(b, n, unroll, cap, m, T, y, side, pair, row, still, fine, near)
    return m


def _sweep(
    b: Builder,
    n: int,
    unroll: bool,
    m: QpMemory,
    T: Memory,
    y: Memory,
    side: Memory,
    pair: Memory,
    row: Memory,
    tiny: Memory,
) -> None:
    c = b.array("c", n, "local")
    scale = b.array("inv_step_side", 3, "local")

    def pivot(d: Any, h: Any, s: Any, x: Any, y: Any, tiny: Any, convex: Any) -> tuple[Any, ...]:
        # Entering: s = 1, y the gradient; leaving: s = -1, y the free value, x the bound.  A pivot
        # that is not positive (or NaN) changes nothing and is remembered.
        entering = s > 0
        sound = ca.logic_and(s * d > ca.if_else(entering, tiny * h, 0), convex)
        inv = ca.if_else(sound, 1 / ca.if_else(sound, d, 1), 0)
        step = -(ca.if_else(entering, y, x - y)) * inv
        new = ca.if_else(entering, x + step, step)
        return ca.vertcat(inv, step, s), new, -inv, -s, sound

    with b.part(
        "qp_sweep", "p", comment="Free variable p, or tie it where x holds it: one symmetric sweep."
    ) as (p,):
        with b.loop(0, n, unroll=unroll) as i:
            b.call("copy", [T[pair.at(p * n + i)]], [c[i]], _same)
        b.call(
            "pivot",
            [
                T[pair.at(p * (n + 1))],
                m.H[pair.at(p * (n + 1))],
                side[p],
                m.x[p],
                y[p],
                tiny[0],
                m.convex[0],
            ],
            [scale[:], y[p], T[pair.at(p * (n + 1))], side[p], m.convex[0]],
            pivot,
        )
        new_y = b.array("new_y", 1, "local")
        new_d = b.array("new_d", 1, "local")
        b.call("keep", [y[p], T[pair.at(p * (n + 1))]], [new_y[0], new_d[0]], _same_two)
        share = b.array("share", 1, "local")
        with b.loop(0, n, unroll=unroll) as i:
            # 1 tied, -1 free: gradients rise and values fall by the pivot column times the step.
            b.call("shift", [y[i], side[i], c[i], scale[:]], [y[i], share[0]], _shift)
            with b.loop(0, i + 1, most=n, unroll=unroll) as j:
                b.call("rank_one", [T[row.at(i) + j], share[0], c[j]], [T[row.at(i) + j]], _rank)
        with b.loop(0, n, unroll=unroll) as i:
            b.call("edge", [c[i], scale[:]], [T[pair.at(p * n + i)]], _edge)
        b.call("keep", [new_y[0], new_d[0]], [y[p], T[pair.at(p * (n + 1))]], _same_two)


def _same(x: Any) -> Any:
    return x


def _same_two(x: Any, y: Any) -> Any:
    return x, y


def _shift(y: Any, side: Any, c: Any, scale: Any) -> Any:
    return y + side * (c * scale[1]), c * scale[0]


def _rank(t: Any, share: Any, c: Any) -> Any:
    return t - share * c


def _edge(c: Any, scale: Any) -> Any:
    return c * scale[0] * scale[2]


def _solve(
    b: Builder,
    n: int,
    unroll: bool,
    cap: int,
    m: QpMemory,
    T: Memory,
    y: Memory,
    side: Memory,
    pair: Memory,
    row: Memory,
    still: Memory,
    fine: Memory,
    near: Memory,
) -> None:
    part = b.array("part", 1, "local")
    best = b.array("best", 1, "local")
    flag = b.array("flag", 1, "local")
    stop = b.array("stop", 1, "local")

    product = b.array("qp_p", n, meaning="a matrix times a vector")

    def times(matrix: Memory, start: Any, vector: Memory, to: Memory) -> None:
        # Each element of the triangle once, for both of its places.
        with b.loop(0, n, unroll=unroll) as i:
            b.call("begin", [start(i)], [to[i]], _same) if start else b.call(
                "none", [], [to[i]], _zero
            )
        with b.loop(0, n, unroll=unroll) as i:
            b.call("own", [matrix[pair.at(i * (n + 1))], vector[i], to[i]], [part[0]], _mac)
            with b.loop(0, i, most=n, unroll=unroll) as j:
                b.call(
                    "both",
                    [matrix[row.at(i) + j], vector[i], vector[j], part[0], to[j]],
                    [part[0], to[j]],
                    _both,
                )
            b.call("copy", [part[0]], [to[i]], _same)

    with b.part("qp_gradient", comment="Gradient at x into y."):
        times(m.H, lambda i: m.f[i], m.x, y)
    with b.part(
        "qp_refine",
        comment="A Newton step with the tableau takes out of x what rounding put into it.",
    ):
        with b.loop(0, n, unroll=unroll) as i:
            b.call("free_only", [side[i], y[i]], [y[i]], _free_only)
        times(T, None, y, product)
        with b.loop(0, n, unroll=unroll) as i:
            b.call(
                "refine",
                [side[i], m.x[i], product[i], m.low[i], m.high[i]],
                [m.x[i]],
                _refine,
            )

    def residual() -> None:
        b.invoke("qp_gradient")
        b.call("none", [], [m.residual[0]], _zero)
        with b.loop(0, n, unroll=unroll) as i:
            b.call(
                "residual",
                [m.x[i], y[i], m.low[i], m.high[i], m.H[pair.at(i * (n + 1))], m.residual[0]],
                [m.residual[0]],
                _residual,
            )

    with b.part(
        "qp_solve", comment="Box QP: x from its start to the minimum, at most so many changes."
    ):
        b.call("good", [], [m.convex[0]], _one)
        b.call("ready", [], [m.capped[0]], _one)
        b.call("none", [], [m.iterations[0]], _zero)
        with b.loop(0, n, unroll=unroll) as i:
            b.call("inside", [m.x[i], m.low[i], m.high[i]], [m.x[i], side[i]], _inside)
        with b.loop(0, n * (n + 1) // 2, unroll=unroll) as i:
            b.call("copy", [m.H[i]], [T[i]], _same)
        b.invoke("qp_gradient")
        with b.loop(0, n) as p:
            b.invoke("qp_sweep", p)
        with b.loop(0, cap + 1) as _:
            which = b.index("which")
            b.set(which, n)
            b.call("whole", [], [best[0]], _one)
            with b.loop(0, n, unroll=unroll) as i:
                b.call(
                    "reach",
                    [side[i], m.x[i], y[i], m.low[i], m.high[i], best[0]],
                    [flag[0], best[0]],
                    _reach,
                )
                with b.when(flag[0]):
                    b.set(which, i)
            with b.loop(0, n, unroll=unroll) as i:
                b.call(
                    "advance",
                    [side[i], m.x[i], y[i], m.low[i], m.high[i], best[0]],
                    [m.x[i]],
                    _advance,
                )
            with b.when((which, "<", n)):
                b.call(
                    "tie", [m.x[which], y[which], m.low[which], m.high[which]], [m.x[which]], _tie
                )
            with b.otherwise():
                b.call("none", [], [best[0]], _zero)
                with b.loop(0, n, unroll=unroll) as i:
                    b.call(
                        "promise",
                        [
                            side[i],
                            m.x[i],
                            y[i],
                            m.low[i],
                            m.high[i],
                            T[pair.at(i * (n + 1))],
                            still[0],
                            best[0],
                        ],
                        [flag[0], best[0]],
                        _promise,
                    )
                    with b.when(flag[0]):
                        b.set(which, i)
                b.call("finished", [best[0]], [stop[0]], _is_zero)
                with b.when(stop[0]):
                    b.call("done", [], [m.capped[0]], _zero)
                b.leave(stop[0])
            b.invoke("qp_sweep", which)
            b.call("count", [m.iterations[0]], [m.iterations[0]], lambda k: k + 1)
            b.call("lost", [m.convex[0]], [stop[0]], _is_zero)
            b.leave(stop[0])
        residual()
        # Only a minimum is refined (elsewhere the step would leave the best point so far), and only
        # where rounding has left something to refine.
        b.call("rough", [m.residual[0], m.capped[0], fine[0]], [stop[0]], _rough)
        with b.when(stop[0]):
            b.invoke("qp_refine")
            residual()
        b.call(
            "verdict",
            [m.residual[0], near[0], m.convex[0], m.capped[0]],
            [m.optimal[0]],
            lambda r, near, convex, capped: ca.logic_and(
                r <= near, ca.logic_and(convex, ca.logic_not(capped))
            ),
        )


def _one() -> Any:
    return ca.SX(1)


def _zero() -> Any:
    return ca.SX(0)


def _is_zero(x: Any) -> Any:
    return ca.logic_not(x > 0)


def _mac(a: Any, x: Any, s: Any) -> Any:
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


def box_qp(
    n: int, *, cap: int | None = None, period_s: float = 0.005, largest: float = 1e12
) -> Program:
    """The solver alone as a Program.

    largest: largest magnitude of an input; beyond it the input is invalid.
    return: inputs ``H`` (packed lower triangle), ``f``, ``low``, ``high``, ``start``; outputs
        ``x``, ``residual`` and a status word. With an invalid input or an indefinite H, x is the
        point of the box nearest to 0 (0 for an invalid input) and the status says so.
    """
    b = Builder()
    size = max(1, n * (n + 1) // 2)
    inputs = (
        Port("H", -largest, largest, "Hessian, lower triangle row by row", size),
        Port("f", -largest, largest, "gradient at 0", max(1, n)),
        Port("low", -largest, largest, "lower bounds", max(1, n)),
        Port("high", -largest, largest, "upper bounds", max(1, n)),
        Port("start", -largest, largest, "where to start", max(1, n)),
    )
    outputs = (
        Port("x", -largest, largest, "minimum, or the best point found", max(1, n)),
        Port("residual", 0, largest, "largest projected gradient step, in widths of the box"),
        Port("iterations", 0, 1000, "changes of the active set"),
        Port("status", 0, 15, "what is known of x", flags=FLAGS),
    )
    memory = add_box_qp(b, n, cap)
    u = declare_ports(b, "in", inputs)
    y = declare_ports(b, "out", outputs)
    valid = b.array("valid", 1, "local")
    total = b.array("total", 1, "local")
    unroll = n <= UNROLL_MOST
    limit = largest

    def magnitude(x: Any, s: Any) -> Any:
        return s + ca.fabs(x)

    with b.part("step", comment="Check the numbers, solve, report."):
        b.call("good", [], [valid[0]], _one)
        for p in inputs:
            b.call("none", [], [total[0]], _zero)
            with b.loop(0, p.size, unroll=unroll) as i:
                b.call("magnitude", [u[p.name][i], total[0]], [total[0]], magnitude)
            most = limit * p.size
            b.call(
                "finite",
                [total[0], valid[0]],
                [valid[0]],
                lambda t, v, most=most: ca.logic_and(v, t <= most),
            )
        with b.loop(0, n, unroll=unroll) as i:
            b.call(
                "ordered",
                [u["low"][i], u["high"][i], valid[0]],
                [valid[0]],
                lambda low, high, v: ca.logic_and(v, low <= high),
            )
        with b.when(valid[0]):
            for source, target in (
                ("H", memory.H),
                ("f", memory.f),
                ("low", memory.low),
                ("high", memory.high),
                ("start", memory.x),
            ):
                with b.loop(0, target.size, unroll=unroll) as i:
                    b.call("copy", [u[source][i]], [target[i]], _same)
            b.invoke("qp_solve")
        with b.otherwise():
            with b.loop(0, n, unroll=unroll) as i:
                b.call("rest", [], [memory.x[i], memory.low[i], memory.high[i]], lambda: (0, 0, 0))
            b.call(
                "no_result",
                [],
                [memory.convex[0], memory.capped[0], memory.optimal[0], memory.residual[0]],
                lambda: (1, 0, 1, 0),
            )
            b.call("none", [], [memory.iterations[0]], _zero)
        with b.loop(0, n, unroll=unroll) as i:
            b.call(
                "safe",
                [memory.x[i], memory.low[i], memory.high[i], memory.convex[0]],
                [y["x"][i]],
                # In the box, so not NaN either.
                lambda x, low, high, convex: ca.if_else(
                    ca.logic_and(convex, ca.logic_and(x >= low, x <= high)),
                    x,
                    clip(ca.SX(0), low, high),
                ),
            )
        b.call(
            "report",
            [
                *(valid[0], memory.convex[0], memory.capped[0], memory.optimal[0]),
                *(memory.residual[0], memory.iterations[0]),
            ],
            [y["status"][0], y["residual"][0], y["iterations"][0]],
            lambda valid, convex, capped, optimal, residual, iterations: (
                flags_of(
                    ca.logic_not(valid),
                    ca.logic_not(convex),
                    ca.logic_and(capped, convex),
                    ca.logic_not(optimal),
                ),
                ca.fmin(residual, limit),
                iterations,
            ),
        )
    return Program.define(
        "box_qp",
        f"Box-constrained quadratic program of {n} variables",
        period_s=period_s,
        builder=b,
        inputs=inputs,
        outputs=outputs,
    )
