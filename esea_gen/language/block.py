"""Block: the one language in which everything that runs on the controller board is written.

A Block is symbolic.  It has constants (folded in when code is generated), tunables (changeable at
run time, within bounds), coefficients (prepared from the tunables, only when these change), a
state, inputs and outputs, and three functions::

    prepare(tunables)                    -> coefficients
    init(coefficients)                   -> state
    step(coefficients, state, inputs)    -> (state', outputs)      at a fixed period

``Block.define`` puts the guard of the design round every step, so that no author can forget it: an
input outside its port's physical range (NaN and infinity are outside every range) is replaced by
the value the port names, and a state outside its range starts the Block afresh.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.language.component import (
    Component,
    Executor,
    PrepareFn,
    check_ports,
    collect,
    in_a_row,
    start_functions,
)
from esea_gen.language.ports import (
    Constant,
    Equation,
    Port,
    Tunable,
    flag_word,
    port_ok,
    symbols_of,
)
from esea_gen.language.stream import OwnStreams


class Guard(SimpleNamespace):
    """Result of the guard in this step: ``inputs_ok``, ``state_ok`` (symbols, 1 or 0)."""

    inputs_ok: ca.SX
    state_ok: ca.SX

    def status(self, *bits: Any) -> ca.SX:
        """Status word of :func:`status_port`: the guard's two flags, then the Block's own.

        Parameters
        ----------
        *bits : casadi.SX
            1 or 0 each.
        """
        return flag_word([ca.logic_not(self.inputs_ok), ca.logic_not(self.state_ok), *bits])


class Labels:
    """Collects names for intermediate values, so that the emitted C reads like the equations."""

    def __init__(self) -> None:
        self.items: list[tuple[str, str, ca.SX]] = []

    def __call__(self, name: str, value: ca.SX, comment: str = "") -> ca.SX:
        """Name an intermediate value."""
        self.items.append((name, comment, value))
        return value


StepResult = tuple[dict[str, Any], dict[str, Any]]
StepFn = Callable[
    [SimpleNamespace, SimpleNamespace, SimpleNamespace, Guard, Labels],
    tuple[Mapping[str, Any], Mapping[str, Any]],
]


@dataclass(frozen=True)
class Solved:
    """A value that an equation defines, by any solver: its residual bounds its error.

    Parameters
    ----------
    residual : str
        Label of the equation's residual at the value, computed in the same step.
    most : float
        Largest magnitude of the computed residual while no flag says otherwise, with what exact
        arithmetic leaves of it.
    slope : float
        Least slope of the residual over the value, above 0.
    jump : float
        Largest jump of the value where its defining unknown crosses zero.
    follows : mapping of str to float
        Largest slope of every other state and output that is a number over the value, by port.
        Where given it carries the value's error to them; else intervals do, operation by operation.
    """

    residual: str
    most: float
    slope: float
    jump: float = 0.0
    follows: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Block(Component):
    """A unit of controller code whose step is one straight line.  Build one with :meth:`define`.

    Parameters
    ----------
    name, title, period_s, constants, tunables, coefficients, state, inputs, outputs
        As in :class:`esea_gen.language.component.Component`.
    equations, prepare, init, streams, starts_latched
        As there.
    step : casadi.Function
        Scalar expressions (SX); one argument or result per port, in port order.
    labelled_step : casadi.Function
        ``step`` with the labelled intermediate values as further results.
    labels : tuple of (str, str)
        Name and comment of each of these.
    split : mapping of str to tuple of float
        Magnitudes at which the error analysis cuts the range of a state (``s_...``), an input
        (``u_...``) or, in fixed point, a labelled value of which a fact is known.
    facts : mapping of str to (low, high)
        Ranges of labelled values that follow from algebra, which intervals cannot see; the error
        analysis takes them as proven.
    solved : mapping of str to Solved
        Labelled values, of which a fact is known too, that an equation defines.  The error analysis
        of fixed point bounds them by their residual and not by the way on which they were found.
    """

    kind = "block"

    step: ca.Function = field(repr=False)
    labelled_step: ca.Function = field(repr=False)
    labels: tuple[tuple[str, str], ...] = ()
    split: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    facts: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    solved: Mapping[str, Solved] = field(default_factory=dict)

    @classmethod
    def define(
        cls,
        name: str,
        title: str,
        *,
        period_s: float,
        state: tuple[Port, ...],
        inputs: tuple[Port, ...],
        outputs: tuple[Port, ...],
        step: StepFn,
        constants: tuple[Constant, ...] = (),
        tunables: tuple[Tunable, ...] = (),
        coefficients: tuple[Port, ...] = (),
        prepare: PrepareFn | None = None,
        equations: tuple[Equation, ...] = (),
        split: Mapping[str, tuple[float, ...]] | None = None,
        facts: Mapping[str, tuple[float, float]] | None = None,
        solved: Mapping[str, Solved] | None = None,
        streams: OwnStreams | None = None,
        starts_latched: bool = False,
    ) -> Block:
        """Build a Block from Python functions on symbols.

        Parameters
        ----------
        name, title, period_s, constants, tunables, coefficients, state, inputs, outputs
            As in the class.
        equations, split, facts, solved, streams, starts_latched
            As in the class.
        step : callable
            ``step(c, s, u, guard, label) -> (next_state, outputs)``: ``c``, ``s``, ``u`` hold one
            symbol per coefficient, state and input (already guarded); the results map port names
            to expressions.
        prepare : callable, optional
            ``prepare(t) -> coefficients`` with one symbol per tunable; needed with tunables.

        Raises
        ------
        ValueError
            For ports that are missing, doubled or of the wrong size, or a free symbol in a result.
        """
        check_ports(name, title, period_s, tunables, coefficients, state, inputs, outputs)
        prepare_f, init_f = start_functions(name, tunables, coefficients, state, prepare)
        coef, raw_s, raw_u = map(symbols_of, (coefficients, state, inputs))
        label = Labels()
        s, u, guard = _guarded(label, state, inputs, raw_s, raw_u)
        s_next, y = step(SimpleNamespace(**coef), s, u, guard, label)
        values = collect(name, "state", state, s_next) + collect(name, "output", outputs, y)
        groups = {"c": coef, "s": raw_s, "u": raw_u}
        arguments = {f"{k}_{n}": x for k, group in groups.items() for n, x in group.items()}
        names = [f"next_{p.name}" for p in state] + [f"y_{p.name}" for p in outputs]
        results = dict(zip(names, values, strict=True))
        step_f, labelled_f = _step_functions(name, arguments, results, label)
        return cls(
            name=name,
            title=title,
            period_s=period_s,
            constants=constants,
            tunables=tunables,
            coefficients=coefficients,
            state=state,
            inputs=inputs,
            outputs=outputs,
            equations=equations,
            prepare=prepare_f,
            init=init_f,
            step=step_f,
            labelled_step=labelled_f,
            labels=tuple((n, c) for n, c, _ in label.items),
            split=dict(split or {}),
            facts=dict(facts or {}),
            solved=dict(solved or {}),
            streams=streams or OwnStreams(),
            starts_latched=starts_latched,
        )._known()

    @classmethod
    def of(cls, parts: Any, **more: Any) -> Block:
        """Build a Block from an object whose attributes are the arguments of :meth:`define`.

        Parameters
        ----------
        parts : object
            Has ``h``, the period, ``name``, ``title``, ``step``, its ports and what else it needs.
        **more
            The rest of :meth:`define`, or in place of what the object has.

        Returns
        -------
        Block
            The Block, its step guarded.
        """
        names = set(inspect.signature(cls.define).parameters) - {"period_s"}
        known = {n: getattr(parts, n) for n in names if hasattr(parts, n)} | more
        if not known.get("tunables"):
            known.pop("prepare", None)
        return cls.define(period_s=parts.h, **known)

    def _known(self) -> Block:
        # Not where a Block is copied: a deliberate fault may take away what is split.
        labels = {n for n, _ in self.labels}
        if unknown := sorted(set(self.facts) - labels):
            raise ValueError(f"block {self.name}: facts of values that have no label: {unknown}")
        for value, by in self.solved.items():
            if value not in self.facts or by.residual not in labels:
                needs = f"{value} needs a fact and {by.residual} a label"
                raise ValueError(f"block {self.name}: {needs}")
            if not (by.slope > 0 and by.most >= 0 and by.jump >= 0):
                raise ValueError(f"block {self.name}: the slope of {by.residual} must be above 0")
        cut = {f"s_{p.name}" for p in self.state} | {f"u_{p.name}" for p in self.inputs}
        if unknown := sorted(set(self.split) - cut - set(self.facts)):
            what = "splits of unknown states, inputs or facts"
            raise ValueError(f"block {self.name}: {what}: {unknown}")
        return self

    @property
    def kernels(self) -> dict[str, ca.Function]:
        """The step, by its name."""
        return {"step": self.step}

    @property
    def flag_results(self) -> tuple[int, ...]:
        """Which results of ``step`` are status words."""
        return tuple(len(self.state) + k for k, p in enumerate(self.outputs) if p.flags)

    def simulator(self, tunables: Mapping[str, float] | None = None) -> Simulator:
        """An executor of this Block: CasADi's own evaluator, float64.

        Parameters
        ----------
        tunables : mapping of str to float, optional
            Values other than the defaults.
        """
        return Simulator(self, tunables)


def _guarded(
    label: Labels,
    state: tuple[Port, ...],
    inputs: tuple[Port, ...],
    raw_s: Mapping[str, ca.SX],
    raw_u: Mapping[str, ca.SX],
) -> tuple[SimpleNamespace, SimpleNamespace, Guard]:
    state_ok = _all([port_ok(raw_s[p.name], p) for p in state])
    label("state_ok", state_ok, "Guard: a corrupt state restarts the block.")
    s = dict(raw_s)
    s |= {p.name: _chosen(p, state_ok, s[p.name], p.init) for p in state if p.repair == "init"}
    u, valid = {}, []
    for p in inputs:
        ok = label(f"{p.name}_ok", port_ok(raw_u[p.name], p))
        held = s[p.on_invalid] if isinstance(p.on_invalid, str) else p.on_invalid
        u[p.name] = _chosen(p, ok, raw_u[p.name], held)
        if p.size == 1:
            label(f"{p.name}_used", u[p.name], "Guard: an invalid input is replaced.")
        valid.append(ok)
    inputs_ok = label("inputs_ok", _all(valid))
    guard = Guard(inputs_ok=inputs_ok, state_ok=state_ok)
    return SimpleNamespace(**s), SimpleNamespace(**u), guard


def _chosen(p: Port, ok: ca.SX, raw: ca.SX, other: Any) -> ca.SX:
    # A port's value where it is valid, else another; of a flag a condition.
    if p.kind != "flag":
        return ca.if_else(ok, raw, other)
    return ca.logic_or(ca.logic_not(ok), raw) if other else ca.logic_and(ok, raw)


def _step_functions(
    name: str, arguments: Mapping[str, ca.SX], results: Mapping[str, ca.SX], label: Labels
) -> tuple[ca.Function, ca.Function]:
    # ``step`` and ``labelled_step``: the same expressions.
    labels = [n for n, _, _ in label.items]
    if len(labels) != len(set(labels)):
        raise ValueError(f"block {name}: a label occurs twice in {labels}")
    shared = ca.cse([*results.values(), *(v for _, _, v in label.items)])
    symbols, values = list(arguments.values()), shared[: len(results)]
    bound = {str(x) for a in symbols for x in ca.symvar(a)}
    if unbound := sorted({str(x) for x in ca.symvar(ca.veccat(*values))} - bound):
        raise ValueError(f"block {name}: step uses unbound symbols {unbound}")
    labelled = [*results, *(f"label_{n}" for n in labels)]
    return (
        ca.Function(f"{name}_step", symbols, values, list(arguments), list(results)),
        ca.Function(f"{name}_labelled_step", symbols, shared, list(arguments), labelled),
    )


def _all(conditions: list[ca.SX]) -> ca.SX:
    return reduce(ca.logic_and, conditions) if conditions else ca.SX(1)


class Simulator(Executor):
    """Runs a Block with CasADi's own evaluator.

    Parameters
    ----------
    block : Block
    tunables : mapping of str to float, optional
        Values other than the defaults.
    """

    def __init__(self, block: Block, tunables: Mapping[str, float] | None = None) -> None:
        super().__init__(block, tunables)
        self._next, following = in_a_row(block.state)
        self._buffer, self._evaluate = block.step.buffer()
        buffer: Any = self._buffer
        for i, a in enumerate([*self._c.values(), *self._s.values(), *self._u.values()]):
            buffer.set_arg(i, memoryview(a))  # type: ignore[arg-type]
        for i, r in enumerate([*following.values(), *self._y.values()]):
            buffer.set_res(i, memoryview(r))  # type: ignore[arg-type]
        self.reset()

    def _advance(self) -> None:
        self._evaluate()
        self._state[:] = self._next
