"""Nonlinear model predictive control with an input box, as a program of kernels.

From a symbolic plant and a cost (:class:`esea_gen.control.horizon.Model`) come a rollout over the
horizon, the exact forward sensitivities of every state and of the elastomer's memory, the condensed
quadratic program and its solver: one real-time iteration [1]_ (one linearisation, one QP) a step.

How the elastomer's memory is carried: stop operators with thresholds r_1 < r_2 < ... keep, in a
sound state, |E_i - E_j| <= |r_i - r_j|, so that the saturated ones are always the first few, all on
the same side.  A saturated (tied) operator's play state follows the deflection and needs no
arithmetic; work arises only when one is tied or let go.  The sensitivity of a free operator's play
state is that of the deflection at the moment when it was let go, so that the history of the
deflection's sensitivity is all there is to keep.

References
----------
.. [1] M. Diehl et al., "Real-time optimization and nonlinear model predictive control of processes
   governed by differential-algebraic equations", J. Process Control 12(4), 2002.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.control.box_qp import UNROLL_MOST, QpMemory, add_box_qp, flags_of
from esea_gen.control.horizon import Horizon, Linearised, Model, linearise
from esea_gen.language.builder import Builder, declare_ports, guard_inputs
from esea_gen.language.ports import Flag, Port, clip, in_range
from esea_gen.language.program import Program
from esea_gen.language.statements import Ix, Memory

FLAGS = (
    Flag("INPUT_INVALID", "an input was NaN or outside its range; the command is 0", True),
    Flag("STATE_REPAIRED", "the plan was corrupt; it was started afresh", True),
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
    """The controller of a model as a Program.

    period_s: period of the control task; the last plan is shifted by it.
    return: the model's inputs; outputs the command (named ``model.u_name``), the QP's residual and
        a status word; the plan is what it carries from step to step.
    """
    return _Writer(model, horizon, period_s, cap).program(name, title)


class _Writer:
    def __init__(self, model: Model, horizon: Horizon, period_s: float, cap: int | None) -> None:
        self.m, self.z, self.period_s = model, horizon, period_s
        self.b = b = Builder()
        n, nx = horizon.intervals, len(model.states)
        self.n, self.nx = n, nx
        self.qp: QpMemory = add_box_qp(b, n, cap)
        self.lin = linearise(model, horizon.substep_s, model.u_max)
        self.late: Linearised | None = None
        if horizon.delay_s > 0:
            self.late = linearise(model, horizon.delay_s / horizon.delay_substeps, model.u_max)
        self.coeffs = declare_ports(b, "coeffs", model.coefficients)
        self.plan_port = Port("plan", -1.0, 1.0, "inputs planned, over the largest", n)
        self.outputs = (
            Port(model.u_name, -model.u_max, model.u_max, "command"),
            Port("residual", 0.0, 2.0, "QP: largest projected gradient step, widths of the box"),
            Port("iterations", 0, 1000, "QP: changes of its active set"),
            Port("status", 0, 2 ** len(FLAGS) - 1, "what is known of the command", flags=FLAGS),
        )
        self.plan = declare_ports(b, "state", (self.plan_port,))["plan"]
        self.out = declare_ports(b, "out", self.outputs)
        declare_ports(b, "in", model.inputs)

        self.x = b.array("x", nx, meaning="state of the rollout")
        self.p = b.array("p", max(1, len(model.parameters)), meaning="parameters of the plant")
        self.w = b.array("w", max(1, len(model.forecasts)), meaning="forecasts, this interval")
        self.r = b.array("ref", max(1, len(model.references)), meaning="references")
        self.u = b.array("u", 1, meaning="input of this interval")
        self.named = b.array("named", max(1, self.lin.named), meaning="values before the memory")
        self.k = b.array("k", max(1, self.lin.coefficients), meaning="derivatives of a substep")
        self.delta = b.array("delta", 1, meaning="deflection of the memory, last")
        self.ahead = b.array("delta_next", 1, meaning="deflection of the memory, next")
        self.tau = b.array("tau_memory", 1, meaning="torque of the memory")
        self.slope = b.array("slope", 1, meaning="stiffness of the free stop operators")
        self.dx = b.array("dx", n * nx, meaning="sensitivities of the state, by input")
        self.back = b.array("back", n, meaning="sensitivity of the free operators' play torque")
        self.rows: list[tuple[Memory, Memory]] = []
        self.valid = b.array("valid", 1, meaning="1 when every input was inside its range")
        self.unused = b.array("unused", 1, meaning="takes what nothing reads")
        if model.stops:
            stops, steps = model.stops, horizon.intervals * horizon.substeps
            count = len(stops.r)
            self.play = b.array("play", count, meaning="play states of the stop operators")
            self.tied = b.array("tied", 1, meaning="how many are tied: the first ones")
            self.sense = b.array("sense", 1, meaning="side on which they are tied, 1 or -1")
            self.base = b.array("base", 1, meaning="play torque of the free ones")
            self.weight = b.array("weight", 1, meaning="weight of those tied together")
            # Those let go together are a group.  Groups are stacked: the newest is first in order.
            self.groups = b.array("groups", 1, meaning="how many groups of free operators")
            self.first = b.array("first", 1, meaning="first one whose history is not yet taken")
            self.group_end = b.array("group_end", count + 1, meaning="where each group ends")
            self.group_since = b.array(
                "group_since", count + 1, meaning="substep in which each was let go"
            )
            self.history = b.array(
                "history", (steps + 1) * n, meaning="sensitivity of the deflection, by substep"
            )
            r, p = np.array(stops.r), np.array(stops.p)
            upto = [float(np.sum((r * p)[:i])) for i in range(count + 1)]
            self.t_r = b.table("stop_r", r, "thresholds")
            self.t_p = b.table("stop_p", p, "weights")
            self.t_gap = b.table("stop_gap", np.diff(r, prepend=0.0), "threshold differences")
            self.t_tied = b.table("stop_tied", upto, "torque of the tied ones, by their number")
            self.t_free = b.table(
                "stop_free",
                [float(np.sum(p[i:])) for i in range(count + 1)],
                "stiffness of the free ones, by the number tied",
            )
            self.t_let = b.table(
                "stop_let", [float(np.sum(p[:i])) for i in range(count + 1)], "what is let go"
            )
            # Inputs that can matter at the end of substep t: those of intervals begun before it.
            self.columns = b.index_table(
                "columns", [-(-t // horizon.substeps) for t in range(steps + 1)], "active inputs"
            )

    # -- the parts -------------------------------------------------------------------------------

    def program(self, name: str, title: str) -> Program:
        m, b = self.m, self.b
        if m.stops:
            self._roll()
        with b.part("guard", comment="Valid inputs; others are replaced."):
            self.guarded = guard_inputs(b, m.inputs, self.valid)
        self._substep()
        self._gather()
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

    def _roll(self) -> None:
        assert self.m.stops is not None
        z, count = self.z, len(self.m.stops.r)
        steps = z.intervals * z.substeps
        turn, more, stop = (self.b.array(n, 1, "local") for n in ("turn", "more", "stop_here"))
        self._let_go(count, 2 * sum(-(-t // z.substeps) for t in range(steps)))
        self._tie(count, steps + z.delay_substeps, stop)
        self._roll_on(count, turn, more)

    def _let_go(self, count: int, most: int) -> None:
        # Each call lets go at most one group, and leaves at most one of them partly tied.
        b, weight = self.b, self.weight
        tied, groups = self.tied.at(0), self.groups.at(0)
        with (
            b.part(
                "lose", "since", comment="Take the history of a group of operators that are tied."
            ) as (since,),
            b.loop(0, self.columns.at(since), most=self.n, total=most) as j,
        ):
            b.call(
                "lose",
                [self.back[j], weight[0], self.history[since * self.n + j]],
                [self.back[j]],
                _take_from,
            )

        # Both are rare: what nearly every call needs stands alone in "roll".
        with b.part(
            "let_go", "t", comment="Let go all that are tied, where the deflection was: one group."
        ) as (t,):
            with b.loop(0, tied, most=count) as i:
                b.call(
                    "let_go",
                    [self.delta[0], self.sense[0], self.t_r[i], self.t_p[i], self.base[0]],
                    [self.play[i], self.base[0]],
                    _let_go,
                )
            b.call(
                "push",
                [
                    *(self.t_let[tied], self.tied[0], self.substep_number[t]),
                    *(self.groups[0], self.sense[0]),
                ],
                [
                    *(weight[0], self.group_end[groups], self.group_since[groups]),
                    *(self.groups[0], self.tied[0], self.sense[0]),
                ],
                lambda weight, tied, now, count, sense: (weight, tied, now, count + 1, 0, -sense),
            )
            with b.loop(0, self.columns.at(t), most=self.n) as j:
                b.call(
                    "gain",
                    [self.back[j], weight[0], self.history[t * self.n + j]],
                    [self.back[j]],
                    _mac,
                )

    def _tie(self, count: int, rolls: int, stop: Memory) -> None:
        b, tied, first = self.b, self.tied.at(0), self.first.at(0)
        with b.part("tie", comment="Tie those that the deflection has moved beyond their stops."):
            b.call("first", [self.tied[0]], [self.first[0]], _same)
            with b.loop(tied, count, most=count) as i:
                b.call(
                    "stays",
                    [self.ahead[0], self.sense[0], self.play[i], self.t_r[i]],
                    [stop[0]],
                    lambda *known: ca.logic_not(_beyond(*known)),
                )
                b.leave(stop[0])
                b.call(
                    "tie",
                    [self.play[i], self.t_p[i], self.base[0], self.tied[0]],
                    [self.base[0], self.tied[0]],
                    lambda play, p, base, tied: (base - p * play, tied + 1),
                )
            with b.when((first, "<", tied)):
                self._take_histories(count, rolls)

    def _roll_on(self, count: int, turn: Memory, more: Memory) -> None:
        b, tied = self.b, self.tied.at(0)
        with b.part(
            "roll",
            "t",
            comment="Stop operators, exactly, from one deflection to the next, with sensitivities.",
        ) as (t,):
            with b.when((0, "<", tied)):
                b.call(
                    "turned",
                    [self.ahead[0], self.delta[0], self.sense[0]],
                    [turn[0]],
                    lambda new, old, sense: sense * (new - old) < 0,
                )
                with b.when(turn[0]):
                    b.invoke("let_go", t)
            with b.otherwise():
                b.call(
                    "direction",
                    [self.ahead[0], self.delta[0]],
                    [self.sense[0]],
                    lambda new, old: ca.if_else(new < old, -1, 1),
                )
            with b.when((tied, "<", count)):
                b.call(
                    "beyond",
                    [self.ahead[0], self.sense[0], self.play[tied], self.t_r[tied]],
                    [more[0]],
                    _beyond,
                )
                with b.when(more[0]):
                    b.invoke("tie")
            b.call(
                "torque",
                [self.t_tied[tied], self.t_free[tied], self.base[0], self.sense[0], self.ahead[0]],
                [self.tau[0], self.slope[0]],
                lambda held, free, base, sense, new: (sense * held + (free * new - base), free),
            )
            b.call("on", [self.ahead[0]], [self.delta[0]], _same)

    def _take_histories(self, count: int, rolls: int) -> None:
        b, weight = self.b, self.weight
        tied, first, groups = self.tied.at(0), self.first.at(0), self.groups.at(0)
        stop = b.array("whole", 1, "local")
        # What groups were tied whole; each had been let go in a call before.
        with b.loop(0, count + 1, total=2 * rolls) as _:
            b.call(
                "whole",
                [self.group_end[groups - 1], self.tied[0]],
                [stop[0]],
                lambda end, tied: end > tied,
            )
            b.leave(stop[0])
            b.call(
                "weight",
                [
                    *(self.t_let[self.group_end.at(groups - 1)], self.t_let[first]),
                    self.group_end[groups - 1],
                ],
                [weight[0], self.first[0]],
                lambda end, start, first: (end - start, first),
            )
            b.invoke("lose", self.group_since.at(groups - 1))
            b.call("pop", [self.groups[0]], [self.groups[0]], lambda k: k - 1)
        with b.when((first, "<", tied)):
            b.call(
                "weight",
                [self.t_let[tied], self.t_let[first]],
                [weight[0]],
                lambda end, start: end - start,
            )
            b.invoke("lose", self.group_since.at(groups - 1))

    @property
    def substep_number(self) -> Memory:
        """Table of whole numbers as reals: a loop's index that a kernel can store."""
        name = "number"
        if name not in self.b.memory:
            steps = self.n * self.z.substeps
            self.b.table(name, [float(t) for t in range(steps + 1)], "whole numbers")
        return self.b.memory[name]

    def _gram(self) -> None:
        # A residual r + J (z - plan) adds J'J to the Hessian and J' (r - J plan) to the gradient.
        b, n, qp, triangle = self.b, self.n, self.qp, self.b.memory["qp_row"]
        pair = b.memory["qp_pair"]
        unroll = n <= UNROLL_MOST
        total = b.array("total", 1, "local")
        with b.part("gram", comment="Hessian and gradient from the residuals' rows."):
            for value, rows in self.rows:
                with b.loop(0, n, unroll=unroll) as k:
                    b.call("begin", [value[k]], [total[0]], _same)
                    with b.loop(0, k + 1, most=n, unroll=unroll) as j:
                        b.call(
                            "at_plan",
                            [total[0], rows[triangle.at(k) + j], qp.x[j]],
                            [total[0]],
                            _take_from,
                        )
                    b.call("end", [total[0]], [value[k]], _same)
            with b.loop(0, n, unroll=unroll) as i:
                b.call("none", [], [total[0]], _zero)
                for value, rows in self.rows:
                    with b.loop(i, n, most=n, unroll=unroll) as k:
                        b.call(
                            "gradient",
                            [total[0], rows[pair.at(k * n + i)], value[k]],
                            [total[0]],
                            _mac,
                        )
                b.call("end", [total[0]], [qp.f[i]], _same)
                with b.loop(0, i + 1, most=n, unroll=unroll) as j:
                    b.call("none", [], [total[0]], _zero)
                    for _, rows in self.rows:
                        with b.loop(i, n, most=n, unroll=unroll) as k:
                            b.call(
                                "gram",
                                [total[0], rows[pair.at(k * n + i)], rows[pair.at(k * n + j)]],
                                [total[0]],
                                _mac,
                            )
                    b.call("end", [total[0]], [qp.H[triangle.at(i) + j]], _same)

    def _substep(self) -> None:
        b, nx, n = self.b, self.nx, self.n
        k = self.k[0 : self.lin.coefficients]
        with b.part("substep", "t", "interval", comment="One substep with all sensitivities.") as (
            t,
            interval,
        ):
            self._nominal(self.lin, t, k)
            with b.loop(0, interval, most=n - 1) as j:
                b.run(
                    self.lin.column,
                    [self.dx[nx * j : nx], k, self.back[j]],
                    [self.dx[nx * j : nx], self._hist(t, j)],
                    "An input of an earlier interval.",
                )
            b.run(
                self.lin.newest,
                [self.dx[nx * interval : nx], k, self.back[interval]],
                [self.dx[nx * interval : nx], self._hist(t, interval)],
                "The input of this interval.",
            )

    def _hist(self, t: Ix, j: Ix) -> Any:
        if not self.m.stops:
            return self.unused[0]
        return self.history[(t + 1) * self.n + j]

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
        if self.m.stops:
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
        sound = b.array("sound", 1, meaning="1 when the plan was")
        unroll = n <= UNROLL_MOST
        qp = self.qp
        share = min(1.0, self.period_s / z.interval_s)
        with b.part("step", comment=""):
            b.invoke("guard")
            b.call("good", [], [sound[0]], _one)
            with b.loop(0, n, unroll=unroll) as j:
                b.call(
                    "plan_ok",
                    [self.plan[j], sound[0]],
                    [sound[0]],
                    lambda v, ok: ca.logic_and(ok, in_range(v, -1.0, 1.0)),
                )
            with b.loop(0, n, unroll=unroll) as j:
                b.call(
                    "plan_used",
                    [self.plan[j], sound[0]],
                    [qp.x[j]],
                    lambda v, ok: ca.if_else(ok, v, 0),
                )
            # Warm start: the last plan, a period later.
            with b.loop(0, n - 1, unroll=unroll) as j:
                b.call(
                    "shift_plan",
                    [qp.x[j], qp.x[j + 1]],
                    [qp.x[j]],
                    lambda a, c: a + share * (c - a),
                )
            for array, value in ((qp.low, -1.0), (qp.high, 1.0)):
                with b.loop(0, array.size, unroll=unroll) as j:
                    b.call(f"fill_{array.name}", [], [array[j]], _constant(value))
            self._start()
            if self.late is not None:
                # Through the computing delay, with the command that is in force.
                b.call("in_force", [self.guarded[m.in_force][0]], [self.u[0]], _same)
                self._forecast(Ix(n))
                if z.delay_substeps == 1:
                    self._nominal(self.late, Ix(0))
                else:
                    with b.loop(0, z.delay_substeps, name="late"):
                        self._nominal(self.late, Ix(0))
            with b.loop(0, n, name="interval") as k:
                self._interval(k)
            b.invoke("gram")
            b.invoke("qp_solve")
            self._report(valid, sound)

    def _interval(self, k: Ix) -> None:
        m, b, nx, z, qp = self.m, self.b, self.nx, self.z, self.qp
        b.call("input", [qp.x[k]], [self.u[0]], lambda v: m.u_max * v)
        self._forecast(k)
        with b.loop(0, nx, unroll=True) as i:
            b.call("none", [], [self.dx[nx * k + i]], _zero)
        b.call("none", [], [self.back[k]], _zero)
        b.invoke("effort", k)
        with b.loop(0, z.substeps, name="substep") as s:
            b.invoke("substep", k * z.substeps + s, k)
        b.invoke("error", k)

    def _start(self) -> None:
        m, b = self.m, self.b
        g = self.guarded
        names = [p.name for p in m.inputs if p.size == 1]
        values = [g[n][0] for n in names]
        if m.stops:
            assert m.deflection is not None
            at = m.deflection
            count = len(m.stops.r)
            stop = b.array("stop_state", 1, "local")

            def deflection(*inputs: Any) -> Any:
                return at(SimpleNamespace(**dict(zip(names, inputs, strict=True))))

            b.call("deflection", values, [self.delta[0]], deflection)
            # Nested as the operators themselves keep it, whatever the input holds.
            b.call("none", [], [stop[0]], _zero)
            b.call("none", [], [self.base[0]], _zero)
            with b.loop(0, count, unroll=True) as i:
                b.call(
                    "nest",
                    [
                        *(self.delta[0], g[m.play][i], self.t_gap[i], self.t_p[i]),
                        *(stop[0], self.base[0]),
                    ],
                    [stop[0], self.play[i], self.base[0]],
                    _nest,
                )
            # Those that were never let go have no history; their group is never taken whole.
            b.call(
                "bottom",
                [],
                [self.groups[0], self.group_end[0], self.group_since[0]],
                lambda: (1, count + 1, 0),
            )
            b.call(
                "loose",
                [self.t_free[0], self.base[0], self.delta[0]],
                [self.tau[0], self.tied[0], self.sense[0], self.slope[0]],
                lambda free, base, delta: (free * delta - base, 0, 1, free),
            )
        else:
            b.call("no_memory", [], [self.tau[0], self.slope[0]], lambda: (0, 0))

        def start(tau: Any, *inputs: Any) -> Any:
            got = m.start(SimpleNamespace(**dict(zip(names, inputs, strict=True))), tau)
            return ca.vertcat(*[got[s] for s in m.states])

        b.call("start", [self.tau[0], *values], [self.x[:]], start)
        for number, name in enumerate(m.parameters):
            source = g[name] if name in g else self.coeffs[name]
            b.call("parameter", [source[0]], [self.p[number]], _same)

    def _forecast(self, k: Ix) -> None:
        m, b, z = self.m, self.b, self.z
        if not m.forecasts:
            return
        # The last entry is for the delay itself.
        middles = [end - 0.5 * z.interval_s for end in z.ends_s] + [0.5 * z.delay_s]
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

    def _gather(self) -> None:
        # Rows of the residuals' Jacobian, by interval: parts with the interval as a parameter.
        for effort in (True, False):
            kind = "effort" if effort else "error"
            comment = "Residuals at the start" if effort else "Residuals at the end"
            with self.b.part(kind, "k", comment=f"{comment} of an interval, with gradients.") as (
                k,
            ):
                self._residuals(k, effort)

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
                b.call("reference", [place], [self.r[i]], _same)
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

    def _report(self, valid: Memory, sound: Memory) -> None:
        m, b, n, qp = self.m, self.b, self.n, self.qp
        unroll = n <= UNROLL_MOST
        fine = b.array("fine", 1, meaning="1 when the plan can be used")
        b.call("usable", [valid[0], qp.convex[0]], [fine[0]], ca.logic_and)
        with b.loop(0, n, unroll=unroll) as j:
            b.call(
                "plan_fine",
                [qp.x[j], fine[0]],
                [fine[0]],
                lambda v, ok: ca.logic_and(ok, in_range(v, -1.0, 1.0)),
            )
        acts = b.array("acts", 1, "local")
        b.call("acts", [fine[0]], [acts[0]], _same)
        if m.enable:
            b.call(
                "enabled",
                [fine[0], self.guarded[m.enable][0]],
                [acts[0]],
                lambda ok, on: ca.logic_and(ok, on > 0.5),
            )
        with b.loop(0, n, unroll=unroll) as j:
            b.call(
                "plan_next",
                [qp.x[j], acts[0]],
                [self.plan[j]],
                lambda v, ok: ca.if_else(ok, clip(v, -1.0, 1.0), 0),
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
            lambda valid, sound, convex, capped, optimal, fine: flags_of(
                ca.logic_not(valid),
                ca.logic_not(sound),
                ca.logic_or(ca.logic_not(convex), ca.logic_and(valid, ca.logic_not(fine))),
                ca.logic_and(capped, convex),
                ca.logic_not(optimal),
            ),
        )


def _same(x: Any) -> Any:
    return x


def _zero() -> Any:
    return ca.SX(0)


def _one() -> Any:
    return ca.SX(1)


def _constant(value: float) -> Any:
    return {0.0: _zero, 1.0: _one, -1.0: _minus_one}[value]


def _minus_one() -> Any:
    return ca.SX(-1)


def _beyond(new: Any, sense: Any, play: Any, r: Any) -> Any:
    return sense * (new - play) > r


def _mac(total: Any, a: Any, b: Any) -> Any:
    return total + a * b


def _take_from(total: Any, a: Any, b: Any) -> Any:
    return total - a * b


def _let_go(delta: Any, sense: Any, r: Any, weight: Any, base: Any) -> Any:
    # As it will be taken again, so that the rounding goes too.
    play = delta - sense * r
    return play, base + weight * play


def _nest(delta: Any, play: Any, gap: Any, weight: Any, stop: Any, base: Any) -> Any:
    held = clip(delta - play, stop - gap, stop + gap)
    kept = delta - held
    return held, kept, base + weight * kept
