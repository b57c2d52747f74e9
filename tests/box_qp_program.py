"""The box QP's solver alone as a Program: checked inputs, a status word."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from esea_gen.control.predictive.box_qp import UNROLL_MOST, QpMemory, add_box_qp
from esea_gen.control.predictive.kernels import one, same, zero
from esea_gen.language.builder import Builder, declare_ports
from esea_gen.language.ports import Flag, Port, clip, flag_word
from esea_gen.language.program import Program
from esea_gen.language.statements import Memory

FLAGS = (
    Flag("INPUT_INVALID", "a number was NaN, infinite or too large, or low above high", True),
    Flag("NOT_CONVEX", "the Hessian is not positive definite", True),
    Flag("CAP_REACHED", "iterations ran out; x is feasible, not optimal", True),
    Flag("NOT_OPTIMAL", "the optimality check at the end failed", True),
)


def box_qp(
    n: int, *, cap: int | None = None, period_s: float = 0.005, largest: float = 1e12
) -> Program:
    """The solver as a Program; of an invalid problem x is the box's point nearest to 0."""
    b = Builder()
    memory = add_box_qp(b, n, cap)
    inputs = (
        Port("H", -largest, largest, "Hessian, lower triangle row by row", memory.H.size),
        Port("f", -largest, largest, "gradient at 0", n),
        Port("low", -largest, largest, "lower bounds", n),
        Port("high", -largest, largest, "upper bounds", n),
        Port("start", -largest, largest, "where to start", n),
    )
    outputs = (
        Port("x", -largest, largest, "minimum, or the best point found", n),
        Port("residual", 0, largest, "largest projected gradient step, in widths of the box"),
        Port("iterations", 0, 1000, "changes of the active set"),
        Port("status", 0, 15, "what is known of x", flags=FLAGS),
    )
    u = declare_ports(b, "in", inputs)
    y = declare_ports(b, "out", outputs)
    valid = b.array("valid", 1, "local")
    total = b.array("total", 1, "local")
    with b.part("step", comment="Check the numbers, solve, report."):
        _check(b, inputs, u, valid, total, largest)
        with b.when(valid[0]):
            arrays = {"H": memory.H, "f": memory.f, "low": memory.low, "high": memory.high}
            for source, target in (arrays | {"start": memory.x}).items():
                with b.loop(0, target.size, unroll=n <= UNROLL_MOST) as i:
                    b.call("copy", [u[source][i]], [target[i]], same)
            b.invoke("qp_solve")
        with b.otherwise():
            _rest(b, memory)
        _answer(b, memory, valid, y, largest)
    return Program.define(
        "box_qp",
        f"Box-constrained quadratic program of {n} variables",
        period_s=period_s,
        builder=b,
        inputs=inputs,
        outputs=outputs,
    )


def _check(
    b: Builder,
    inputs: Sequence[Port],
    u: Mapping[str, Memory],
    valid: Memory,
    total: Memory,
    largest: float,
) -> None:
    # NaN and infinity make a sum of magnitudes that is not below its limit.
    unroll = u["f"].size <= UNROLL_MOST
    b.call("good", [], [valid[0]], one)
    for p in inputs:
        b.call("none", [], [total[0]], zero)
        with b.loop(0, p.size, unroll=unroll) as i:
            b.call("magnitude", [u[p.name][i], total[0]], [total[0]], lambda x, s: s + ca.fabs(x))
        b.call(
            "finite",
            [total[0], valid[0]],
            [valid[0]],
            lambda t, v, most=largest * p.size: ca.logic_and(v, t <= most),
        )
    with b.loop(0, u["f"].size, unroll=unroll) as i:
        b.call(
            "ordered",
            [u["low"][i], u["high"][i], valid[0]],
            [valid[0]],
            lambda low, high, v: ca.logic_and(v, low <= high),
        )


def _rest(b: Builder, m: QpMemory) -> None:
    with b.loop(0, m.x.size, unroll=m.x.size <= UNROLL_MOST) as i:
        b.call("rest", [], [m.x[i], m.low[i], m.high[i]], lambda: (0, 0, 0))
    b.call(
        "no_result",
        [],
        [m.convex[0], m.capped[0], m.optimal[0], m.residual[0]],
        lambda: (1, 0, 1, 0),
    )
    b.call("none", [], [m.iterations[0]], zero)


def _answer(
    b: Builder, m: QpMemory, valid: Memory, y: Mapping[str, Memory], largest: float
) -> None:
    with b.loop(0, m.x.size, unroll=m.x.size <= UNROLL_MOST) as i:
        b.call(
            "safe",
            [m.x[i], m.low[i], m.high[i], m.convex[0]],
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
        [*(valid[0], m.convex[0], m.capped[0], m.optimal[0]), *(m.residual[0], m.iterations[0])],
        [y["status"][0], y["residual"][0], y["iterations"][0]],
        lambda valid, convex, capped, optimal, residual, iterations: (
            flag_word(
                map(
                    ca.SX,
                    [
                        ca.logic_not(valid),
                        ca.logic_not(convex),
                        ca.logic_and(capped, convex),
                        ca.logic_not(optimal),
                    ],
                )
            ),
            ca.fmin(residual, largest),
            iterations,
        ),
    )
