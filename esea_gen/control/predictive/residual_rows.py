"""The residuals of a cost over a horizon, their gradients, and the condensed QP of them."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.control.predictive.box_qp import UNROLL_MOST, QpMemory
from esea_gen.control.predictive.horizon import Model
from esea_gen.control.predictive.kernels import plus, same, take_from, zero
from esea_gen.language.builder import Builder
from esea_gen.language.statements import Ix, Memory


class ResidualRows:
    """Writes the parts ``effort`` and ``error`` of an interval, and ``gram``.

    x, u, p, r: state, input, parameters and references in an interval.
    dx: sensitivities of the state, by input.
    guarded: inputs of the Program.
    """

    def __init__(
        self,
        b: Builder,
        model: Model,
        qp: QpMemory,
        *,
        x: Memory,
        u: Memory,
        p: Memory,
        r: Memory,
        dx: Memory,
        guarded: Mapping[str, Memory],
    ) -> None:
        self.b, self.m, self.qp, self.n, self.nx = b, model, qp, qp.x.size, x.size
        self.x, self.u, self.p, self.r, self.dx, self.guarded = x, u, p, r, dx, guarded
        self.rows: list[tuple[Memory, Memory]] = []

    def write(self) -> None:
        """The parts."""
        # Rows of the residuals' Jacobian, by interval: parts with the interval as a parameter.
        for effort in (True, False):
            kind = "effort" if effort else "error"
            comment = "Residuals at the start" if effort else "Residuals at the end"
            with self.b.part(kind, "k", comment=f"{comment} of an interval, with gradients.") as (
                k,
            ):
                self._residuals(k, effort)
        self._gram()

    def _residuals(self, k: Ix, effort: bool) -> None:
        m, b, nx = self.m, self.b, self.nx
        x = ca.SX.sym("x", nx)
        u = ca.SX.sym("u")
        p = ca.SX.sym("p", len(m.parameters))
        r = ca.SX.sym("r", len(m.references))
        states = SimpleNamespace(**dict(zip(m.states, ca.vertsplit(x), strict=True)))
        pars = SimpleNamespace(**dict(zip(m.parameters, ca.vertsplit(p), strict=True)))
        refs = SimpleNamespace(**dict(zip(m.references, ca.vertsplit(r), strict=True)))
        if effort:
            rows = list(m.effort(states, u, pars))
        else:
            rows = list(m.error(states, pars, refs))
            for i, (source, preview) in enumerate(m.references.values()):
                place = self.guarded[source][k] if preview else self.guarded[source][0]
                b.call("reference", [place], [self.r[i]], same)
        triangle = b.memory["qp_row"]
        for number, row in enumerate(rows):
            kind = f"{'effort' if effort else 'error'}_{number}"
            value = b.array(f"{kind}_value", self.n, meaning="residual, by interval")
            gradient = b.array(
                f"{kind}_rows", self.n * (self.n + 1) // 2, meaning="its gradient, packed rows"
            )
            self.rows.append((value, gradient))
            expression = ca.SX(row)
            by_x, by_u = ca.jacobian(expression, x), ca.jacobian(expression, u)
            used = [int(c) for c in by_x.sparsity().get_col()]
            partial = [ca.simplify(by_x[0, c]) for c in used]
            slope = b.array(f"{kind}_slope", max(1, len(used)), "local")
            shared = [self.x[:], self.u[0], self.p[0 : p.numel()], self.r[0 : r.numel()]]
            f = ca.Function(
                kind, [x, u, p, r], [expression, ca.densify(ca.vertcat(*partial, ca.SX(0, 1)))]
            )
            b.run(f, shared, [value[k], slope[0 : len(used)]])
            d = ca.SX.sym("d", nx)
            g = ca.SX.sym("g", len(used))
            chain: Any = ca.SX(0)
            for i, c in enumerate(used):
                chain = chain + g[i] * d[c]
            column = ca.Function(f"{kind}_column", [d, g], [ca.densify(ca.SX(chain))])
            with b.loop(0, k if effort else k + 1, most=self.n) as j:
                b.run(
                    column,
                    [self.dx[nx * j : nx], slope[0 : len(used)]],
                    [gradient[triangle.at(k) + j]],
                )
            if effort:
                own = ca.Function(f"{kind}_own", [x, u, p], [ca.densify(m.u_max * by_u)])
                b.run(own, shared[:3], [gradient[triangle.at(k) + k]])

    def _gram(self) -> None:
        # A residual r + J (z - plan) adds J'J to the Hessian and J' (r - J plan) to the gradient.
        b, n, qp, triangle = self.b, self.n, self.qp, self.b.memory["qp_row"]
        pair = b.memory["qp_pair"]
        unroll = n <= UNROLL_MOST
        total = b.array("total", 1, "local")
        with b.part("gram", comment="Hessian and gradient from the residuals' rows."):
            for value, rows in self.rows:
                with b.loop(0, n, unroll=unroll) as k:
                    b.call("begin", [value[k]], [total[0]], same)
                    with b.loop(0, k + 1, most=n, unroll=unroll) as j:
                        b.call(
                            "at_plan",
                            [total[0], rows[triangle.at(k) + j], qp.x[j]],
                            [total[0]],
                            take_from,
                        )
                    b.call("end", [total[0]], [value[k]], same)
            with b.loop(0, n, unroll=unroll) as i:
                b.call("none", [], [total[0]], zero)
                for value, rows in self.rows:
                    with b.loop(i, n, most=n, unroll=unroll) as k:
                        b.call(
                            "gradient",
                            [total[0], rows[pair.at(k * n + i)], value[k]],
                            [total[0]],
                            plus,
                        )
                b.call("end", [total[0]], [qp.f[i]], same)
                with b.loop(0, i + 1, most=n, unroll=unroll) as j:
                    b.call("none", [], [total[0]], zero)
                    for _, rows in self.rows:
                        with b.loop(i, n, most=n, unroll=unroll) as k:
                            b.call(
                                "gram",
                                [total[0], rows[pair.at(k * n + i)], rows[pair.at(k * n + j)]],
                                [total[0]],
                                plus,
                            )
                    b.call("end", [total[0]], [qp.H[triangle.at(i) + j]], same)
