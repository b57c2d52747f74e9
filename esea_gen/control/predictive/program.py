"""Nonlinear model predictive control with an input box, as a program of kernels.

A rollout with exact forward sensitivities, the condensed quadratic program and its solver: one
real-time iteration a step (M. Diehl et al., J. Process Control 12(4), 2002).
"""

from __future__ import annotations

import math
from functools import partial
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.control.predictive.box_qp import UNROLL_MOST, QpMemory, add_box_qp
from esea_gen.control.predictive.horizon import Horizon, Linearised, Model, linearise
from esea_gen.control.predictive.kernels import one, plus, same, take_from, zero
from esea_gen.control.predictive.stop_rollout import StopRollout
from esea_gen.language.builder import Builder, declare_ports, guard_inputs
from esea_gen.language.ports import Flag, Port, clip, flag_word, in_range
from esea_gen.language.program import Program
from esea_gen.language.statements import Ix, Memory, Ref

FLAGS = (
    Flag("INPUT_INVALID", "an input was NaN or outside its range; the command is 0", True),
    Flag("STATE_REPAIRED", "the plan was corrupt; it was restarted", True),
    Flag("NOT_CONVEX", "the Hessian was not positive (or not a number); the command is 0", True),
    Flag("CAP_REACHED", "the QP's iterations ran out; the command is its best feasible one", True),
    Flag("NOT_OPTIMAL", "the QP's optimality check failed; the command is feasible", True),
)


def predictive_program(
    model: Model,
    horizon: Horizon,
    *,
    period_s: float,
    name: str = "predictive",
    title: str = "Model predictive control",
    cap: int | None = None,
) -> Program:
    """Controller of a model as a Program; its state is the plan, shifted by a period."""
    return _Writer(model, horizon, period_s, cap).program(name, title)


class _Writer:
    def __init__(self, model: Model, horizon: Horizon, period_s: float, cap: int | None) -> None:
        self.m, self.z, self.period_s = model, horizon, period_s
        self.b = b = Builder()
        n, nx = horizon.intervals, len(model.states)
        self.n, self.nx = n, nx
        self.loop = partial(b.loop, unroll=n <= UNROLL_MOST)
        self.each = partial(b.each, n, unroll=n <= UNROLL_MOST)
        self.qp: QpMemory = add_box_qp(b, n, cap)
        # One a length of intervals: what each takes is folded into its kernels.
        self.lins = [
            linearise(model, many * horizon.substep_s, model.u_max) for *_, many in horizon.grids
        ]
        self.late: Linearised | None = None
        if horizon.delay_s > 0:
            self.late = linearise(model, horizon.delay_s / horizon.delay_substeps, model.u_max)
        self.coeffs = declare_ports(b, "coeffs", model.coefficients)
        self.plan_port = Port("plan", -1.0, 1.0, "inputs planned, over the largest", n)
        self.outputs = (
            Port(model.u_name, -model.u_max, model.u_max, "command"),
            Port("residual", 0.0, 2.0, "QP: largest projected gradient step, widths of the box"),
            Port.count("iterations", 1000, "QP: changes of its active set"),
            Port("status", 0, 2 ** len(FLAGS) - 1, "status of the command", flags=FLAGS),
        )
        self.plan = declare_ports(b, "state", (self.plan_port,))["plan"]
        self.out = declare_ports(b, "out", self.outputs)
        declare_ports(b, "in", model.inputs)

        self.x = b.array("x", nx, meaning="state of the rollout")
        self.p = b.array("p", max(1, len(model.parameters)), meaning="parameters of the plant")
        self.w = b.array("w", max(1, len(model.forecasts)), meaning="forecasts, this interval")
        self.r = b.array("ref", max(1, len(model.references)), meaning="references")
        self.u = b.array("u", 1, meaning="input of this interval")
        self.named = b.array(
            "named", max(1, *(x.named for x in self.lins)), meaning="values before the memory"
        )
        self.k = b.array(
            "k", max(1, *(x.coefficients for x in self.lins)), meaning="derivatives of a substep"
        )
        self.delta = b.array("delta", 1, meaning="deflection of the memory, last")
        self.ahead = b.array("delta_next", 1, meaning="deflection of the memory, next")
        self.tau = b.array("tau_memory", 1, meaning="torque of the memory")
        self.slope = b.array("slope", 1, meaning="stiffness of the free stop operators")
        self.dx = b.array("dx", n * nx, meaning="sensitivities of the state, by input")
        self.back = b.array("back", n, meaning="sensitivity of the free operators' play torque")
        self.valid = b.flag("valid", "1 when every input was inside its range")
        self.unused = b.array("unused", 1, meaning="takes what nothing reads")
        self.rows: list[tuple[Memory, Memory]] = []  # value and gradient of every residual
        self.stops: StopRollout | None = None
        if model.stops:
            shared = self.delta, self.ahead, self.tau, self.slope, self.back
            self.stops = StopRollout(b, model.stops, horizon, *shared)

    def program(self, name: str, title: str) -> Program:
        m, b = self.m, self.b
        if self.stops is not None:
            self.stops.write()
        with b.part("guard", comment="Valid inputs; others are replaced."):
            self.guarded = guard_inputs(b, m.inputs, self.valid)
        for lin, (*_, many) in zip(self.lins, self.z.grids, strict=True):
            self._substep(lin, _suffix(many))
            # Rows of the residuals' Jacobian, by interval: parts with the interval as a parameter.
            for kind, where in (("effort", "start"), ("error", "end")):
                comment = f"Residuals at the {where} of an interval, with gradients."
                with b.part(kind + _suffix(many), "k", comment=comment) as (k,):
                    self._residuals(k, kind, many)
        self._gram()
        self._step()
        return Program.define(
            name,
            title,
            period_s=self.period_s,
            builder=b,
            state=(self.plan_port,),
            inputs=m.inputs,
            outputs=self.outputs,
            constants=m.constants,
            tunables=m.tunables,
            coefficients=m.coefficients,
            prepare=m.prepare,
            equations=m.equations,
        )

    def _substep(self, lin: Linearised, suffix: str) -> None:
        b, nx, n = self.b, self.nx, self.n
        k = self.k[0 : lin.coefficients]
        comment = "One substep with all sensitivities."
        with b.part(f"substep{suffix}", "t", "interval", comment=comment) as (t, interval):

            def history(j: Ix) -> Ref:
                return self.stops.sensitivity(t, j) if self.stops else self.unused[0]

            self._nominal(lin, t, k)
            with b.loop(0, interval, most=n - 1) as j:
                b.run(
                    lin.column,
                    [self.dx[nx * j : nx], k, self.back[j]],
                    [self.dx[nx * j : nx], history(j)],
                    "An input of an earlier interval.",
                )
            b.run(
                lin.newest,
                [self.dx[nx * interval : nx], k, self.back[interval]],
                [self.dx[nx * interval : nx], history(interval)],
                "The input of this interval.",
            )

    def _nominal(self, lin: Linearised, t: Ix, k: Any = None) -> None:
        b = self.b
        p = self.p[0 : len(self.m.parameters)]
        w = self.w[0 : len(self.m.forecasts)]
        named = self.named[0 : lin.named]
        b.run(
            lin.before,
            [self.x[:], self.u[0], p, w],
            [named, self.ahead[0]],
            "Up to the new deflection.",
        )
        if self.stops is not None:
            b.invoke("roll", t)
        known = [self.x[:], self.u[0], p, w, named, self.tau[0]]
        if k is None:
            b.run(lin.onward, known, [self.x[:]], "From there to the new state.")
            return
        b.run(
            lin.after,
            [*known, self.slope[0]],
            [self.x[:], k],
            "From there to the new state, with the derivatives.",
        )

    def _step(self) -> None:
        m, b, n, z = self.m, self.b, self.n, self.z
        valid = self.valid
        sound = b.flag("sound", "1 when the plan was")
        qp = self.qp
        with b.part("step", comment=""):
            b.invoke("guard")
            b.call("good", [], [sound[0]], one)
            self.each("plan_ok", [self.plan, sound[0]], [sound[0]], _and_inside)
            self.each("plan_used", [self.plan, sound[0]], [qp.x], _or_none)
            # Warm start: the last plan, a period later.
            for first, stop, many in z.grids:
                share = min(1.0, self.period_s / (many * z.interval_s))

                def shift(a: Any, c: Any, share: float = share) -> Any:
                    return a + share * (c - a)

                with self.loop(first, min(stop, n - 1)) as j:
                    b.call("shift_plan", [qp.x[j], qp.x[j + 1]], [qp.x[j]], shift)
            self.each("fill_box", [], [qp.low, qp.high], lambda: (-1, 1))
            self._start()
            if self.late is not None:
                # Through the computing delay, with the command that is in force.
                b.call("in_force", [self.guarded[m.in_force][0]], [self.u[0]], same)
                self._forecast(Ix(n))
                if z.delay_substeps == 1:
                    self._nominal(self.late, Ix(0))
                else:
                    with b.loop(0, z.delay_substeps, name="late"):
                        self._nominal(self.late, Ix(0))
            for first, stop, many in z.grids:
                with b.loop(first, stop, name="interval") as k:
                    self._interval(k, _suffix(many))
            b.invoke("gram")
            b.invoke("qp_solve")
            self._report(valid, sound)

    def _interval(self, k: Ix, suffix: str) -> None:
        m, b, nx, z, qp = self.m, self.b, self.nx, self.z, self.qp
        b.call("input", [qp.x[k]], [self.u[0]], lambda v: m.u_max * v)
        self._forecast(k)
        with b.loop(0, nx, unroll=True) as i:
            b.call("none", [], [self.dx[nx * k + i]], zero)
        b.call("none", [], [self.back[k]], zero)
        b.invoke(f"effort{suffix}", k)
        with b.loop(0, z.substeps, name="substep") as s:
            b.invoke(f"substep{suffix}", k * z.substeps + s, k)
        b.invoke(f"error{suffix}", k)

    def _start(self) -> None:
        m, b = self.m, self.b
        g = self.guarded
        # What is wanted does not tell where the plant is; play states have their own way in.
        apart = {m.play, *(source for source, _ in m.references.values())}
        told = [p for p in m.inputs if p.size == 1 or p.name not in apart]
        names = [p.name for p in told]
        values = [g[p.name][0] if p.size == 1 else g[p.name][:] for p in told]
        if self.stops is not None:
            assert m.deflection is not None
            at = m.deflection

            def deflection(*inputs: Any) -> Any:
                return at(SimpleNamespace(**dict(zip(names, inputs, strict=True))))

            b.call("deflection", values, [self.delta[0]], deflection)
            self.stops.start(g[m.play])
        else:
            b.call("no_memory", [], [self.tau[0], self.slope[0]], lambda: (0, 0))

        def start(tau: Any, *inputs: Any) -> Any:
            got = m.start(SimpleNamespace(**dict(zip(names, inputs, strict=True))), tau)
            return ca.vertcat(*[got[s] for s in m.states])

        b.call("start", [self.tau[0], *values], [self.x[:]], start)
        for number, name in enumerate(m.parameters):
            source = g[name] if name in g else self.coeffs[name]
            b.call("parameter", [source[0]], [self.p[number]], same)

    def _forecast(self, k: Ix) -> None:
        m, b, z = self.m, self.b, self.z
        if not m.forecasts:
            return
        # The last entry is for the delay itself.
        middles = [end - 0.5 * h for end, h in zip(z.ends_s, z.lengths_s, strict=True)]
        middles.append(0.5 * z.delay_s)
        shapes = [m.shape(t) for t in middles]
        table = b.memory.get("middle") or b.table("middle", shapes, "shape of the forecasts")
        names = [p.name for p in m.inputs if p.size == 1]
        values = [self.guarded[n][0] for n in names]

        def forecast(t: Any, p: Any, *inputs: Any) -> Any:
            u = SimpleNamespace(**dict(zip(names, inputs, strict=True)))
            pars = SimpleNamespace(**dict(zip(m.parameters, ca.vertsplit(p), strict=True)))
            return ca.vertcat(*[f(u, pars, t) for f in m.forecasts.values()])

        p = self.p[0 : len(m.parameters)]
        b.call("forecast", [table[k], p, *values], [self.w[0 : len(m.forecasts)]], forecast)

    def _residuals(self, k: Ix, kind: str, many: int) -> None:
        m, b, nx, effort = self.m, self.b, self.nx, kind == "effort"
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
            name = f"{kind}_{number}"
            if many == 1:
                size, text = self.n * (self.n + 1) // 2, "its gradient, packed rows"
                value = b.array(f"{name}_value", self.n, meaning="residual, by interval")
                gradient = b.array(f"{name}_rows", size, meaning=text)
                self.rows.append((value, gradient))
            value, gradient = b.memory[f"{name}_value"], b.memory[f"{name}_rows"]
            name += _suffix(many)
            # The sum stands for an integral: a long interval weighs more.
            expression = ca.SX(row) * math.sqrt(many) if many > 1 else ca.SX(row)
            by_x, by_u = ca.jacobian(expression, x), ca.jacobian(expression, u)
            used = [int(c) for c in by_x.sparsity().get_col()]
            partial = [ca.simplify(by_x[0, c]) for c in used]
            slope = b.array(f"{name}_slope", max(1, len(used)), "local")
            shared = [self.x[:], self.u[0], self.p[0 : p.numel()], self.r[0 : r.numel()]]
            at_plan = m.effort_share * expression if effort else expression
            f = ca.Function(
                name, [x, u, p, r], [at_plan, ca.densify(ca.vertcat(*partial, ca.SX(0, 1)))]
            )
            b.run(f, shared, [value[k], slope[0 : len(used)]])
            d = ca.SX.sym("d", nx)
            g = ca.SX.sym("g", len(used))
            chain: Any = ca.SX(0)
            for i, c in enumerate(used):
                chain = chain + g[i] * d[c]
            column = ca.Function(f"{name}_column", [d, g], [ca.densify(ca.SX(chain))])
            with b.loop(0, k if effort else k + 1, most=self.n) as j:
                b.run(
                    column,
                    [self.dx[nx * j : nx], slope[0 : len(used)]],
                    [gradient[triangle.at(k) + j]],
                )
            if effort:
                own = ca.Function(f"{name}_own", [x, u, p], [ca.densify(m.u_max * by_u)])
                b.run(own, shared[:3], [gradient[triangle.at(k) + k]])

    def _gram(self) -> None:
        # A residual r + J (z - plan) adds J'J to the Hessian and J' (r - J plan) to the gradient.
        b, n, qp, triangle = self.b, self.n, self.qp, self.b.memory["qp_row"]
        pair = b.memory["qp_pair"]
        with b.part("gram", comment="Hessian and gradient from the residuals' rows."):
            for value, rows in self.rows:
                with self.loop(0, n) as k, self.loop(0, k + 1, most=n) as j:
                    known = [value[k], rows[triangle.at(k) + j], qp.x[j]]
                    b.call("at_plan", known, [value[k]], take_from)
            with self.loop(0, n) as i:
                b.call("none", [], [qp.f[i]], zero)
                for value, rows in self.rows:
                    with self.loop(i, n, most=n) as k:
                        known = [qp.f[i], rows[pair.at(k * n + i)], value[k]]
                        b.call("gradient", known, [qp.f[i]], plus)
                with self.loop(0, i + 1, most=n) as j:
                    total = qp.H[triangle.at(i) + j]
                    b.call("none", [], [total], zero)
                    for _, rows in self.rows:
                        with self.loop(i, n, most=n) as k:
                            known = [total, rows[pair.at(k * n + i)], rows[pair.at(k * n + j)]]
                            b.call("gram", known, [total], plus)

    def _report(self, valid: Memory, sound: Memory) -> None:
        m, b, qp = self.m, self.b, self.qp
        fine = b.flag("fine", "1 when the plan can be used")
        b.call("usable", [valid[0], qp.convex[0]], [fine[0]], ca.logic_and)
        self.each("plan_fine", [qp.x, fine[0]], [fine[0]], _and_inside)
        acts = fine
        if m.enable:
            acts = b.flag("acts", region="local")
            b.call(
                "enabled",
                [fine[0], self.guarded[m.enable][0]],
                [acts[0]],
                lambda ok, on: ca.logic_and(ok, on > 0.5),
            )
        self.each(
            "plan_next",
            [qp.x, acts[0]],
            [self.plan],
            lambda v, ok: _or_none(clip(v, -1.0, 1.0), ok),
        )
        limit = self.outputs[0].high
        b.call(
            "command",
            [self.plan[0], qp.residual[0], qp.iterations[0]],
            [self.out[m.u_name][0], self.out["residual"][0], self.out["iterations"][0]],
            lambda v, res, count: (
                clip(m.u_max * v, -limit, limit),
                ca.if_else(res <= 2, res, 2),
                count,
            ),
        )
        b.call(
            "report",
            [valid[0], sound[0], qp.convex[0], qp.capped[0], qp.optimal[0], fine[0]],
            [self.out["status"][0]],
            lambda valid, sound, convex, capped, optimal, fine: flag_word(
                map(
                    ca.SX,
                    [
                        ca.logic_not(valid),
                        ca.logic_not(sound),
                        ca.logic_or(ca.logic_not(convex), ca.logic_and(valid, ca.logic_not(fine))),
                        ca.logic_and(capped, convex),
                        ca.logic_not(optimal),
                    ],
                )
            ),
        )


def _suffix(many: int) -> str:
    return "" if many == 1 else "_long"


def _and_inside(v: Any, ok: Any) -> Any:
    return ca.logic_and(ok, in_range(v, -1.0, 1.0))


def _or_none(v: Any, ok: Any) -> Any:
    return ca.if_else(ok, v, 0)
