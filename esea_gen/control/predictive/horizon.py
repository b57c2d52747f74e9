"""Prediction horizon: symbolic plant, cost, and their derivatives.

The plant's substep names its intermediate values (:meth:`Tape.let`).  Each depends on few others,
so its partial derivatives are few; those that are not constants are computed once a substep, and
one small kernel carries every column of the sensitivity matrix over the same names.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.language.component import PrepareFn
from esea_gen.language.ports import Constant, Equation, Port, Tunable


@dataclass(frozen=True)
class Horizon:
    """Grid of the prediction; through ``delay_s`` the command in force holds."""

    intervals: int = 10
    interval_s: float = 0.02
    substeps: int = 4
    delay_s: float = 0.001
    long_intervals: int = 0  # so many, the last, are twice as long

    @property
    def substep_s(self) -> float:
        return self.interval_s / self.substeps

    @property
    def delay_substeps(self) -> int:
        """Steps in which the delay is predicted, none longer than a substep."""
        return math.ceil(self.delay_s / self.substep_s - 1e-9)

    @property
    def grids(self) -> tuple[tuple[int, int, int], ...]:
        """Of intervals of one length: first, stop, and how many times ``interval_s`` each takes."""
        near = self.intervals - self.long_intervals
        return ((0, near, 1), *(((near, self.intervals, 2),) if self.long_intervals else ()))

    @property
    def lengths_s(self) -> tuple[float, ...]:
        return tuple(many * self.interval_s for a, b, many in self.grids for _ in range(a, b))

    @property
    def ends_s(self) -> tuple[float, ...]:
        """End of every interval, counted from the measurement."""
        near = self.intervals - self.long_intervals
        return tuple(
            self.delay_s + (i + max(0, i - near)) * self.interval_s
            for i in range(1, self.intervals + 1)
        )


@dataclass(frozen=True)
class Stops:
    """Stop operators of the elastomer (3.5 to 3.11)."""

    r: tuple[float, ...]  # thresholds, rising from above 0
    p: tuple[float, ...]  # their weights


@dataclass(frozen=True)
class Entry:
    """A named value of a substep; ``slopes`` are its partial derivatives if supplied."""

    symbol: ca.SX
    value: ca.SX
    link: bool
    slopes: list[tuple[ca.SX, ca.SX]] | None


class Tape:
    """Names the intermediate values of a substep, in order."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self.memory_at: int | None = None
        self.memory_symbol: ca.SX | None = None

    def let(self, name: str, value: Any) -> ca.SX:
        """Name a value over which derivatives are chained, as several others depend on it."""
        return self._add(name, value, True, None)

    def keep(
        self, name: str, value: Any, slopes: Mapping[ca.SX, Callable[[ca.SX], Any]] | None = None
    ) -> ca.SX:
        """Name a value computed once, but no link; ``slopes`` in terms of itself."""
        return self._add(name, value, False, slopes)

    def power(self, name: str, base: Any, exponent: float) -> ca.SX:
        """A power whose derivative costs a division, not a second power."""
        b = self.keep(f"{name}_base", base)
        return self.keep(name, b**exponent, {b: lambda y: exponent * y / b})

    def _add(
        self,
        name: str,
        value: Any,
        link: bool,
        slopes: Mapping[ca.SX, Callable[[ca.SX], Any]] | None,
    ) -> ca.SX:
        symbol = ca.SX.sym(name)
        given = None if slopes is None else [(s, ca.SX(f(symbol))) for s, f in slopes.items()]
        self.entries.append(Entry(symbol, ca.SX(value), link, given))
        return symbol

    def memory(self, deflection: ca.SX) -> ca.SX:
        """Torque of the stop operators at a deflection; once in a substep."""
        if self.memory_at is not None:
            raise ValueError("the memory is asked twice in one substep")
        last = self.entries[-1] if self.entries else None
        if last is None or not last.link or not ca.is_equal(last.symbol, deflection):
            raise ValueError("the memory takes the value that 'let' named last")
        self.memory_at = len(self.entries)
        self.memory_symbol = ca.SX.sym("tau_memory")
        return self.memory_symbol


SubstepFn = Callable[
    [Tape, float, SimpleNamespace, ca.SX, SimpleNamespace, SimpleNamespace], Mapping[str, Any]
]


# start(inputs, tau_memory) -> states at the measurement; substep(tape, h, x, u, p, w) -> next
# states, with parameters p and forecasts w; error(x, p, r) and effort(x, u, p): what is to be 0 at
# the end and at the start of every interval, weights included.  effort_share: share of the last
# plan's effort that is to be 0; of the rest only the change counts.  references: input, and whether
# it has one value an interval (preview).  forecasts: f(inputs, p, s) with s the ``shape`` of time
# in the middle of the interval. enable: input above 0.5 while it is to act.  deflection(inputs): at
# which ``play`` was taken.
@dataclass(frozen=True)
class Model:
    """A plant, its cost, and the ports that feed them."""

    states: tuple[str, ...]
    start: Callable[[SimpleNamespace, Any], Mapping[str, Any]]
    substep: SubstepFn
    error: Callable[[SimpleNamespace, SimpleNamespace, SimpleNamespace], Sequence[Any]]
    effort: Callable[[SimpleNamespace, Any, SimpleNamespace], Sequence[Any]]
    inputs: tuple[Port, ...]
    in_force: str
    u_max: float
    u_name: str = "u_Nm"
    enable: str = ""
    references: Mapping[str, tuple[str, bool]] = field(default_factory=dict)
    forecasts: Mapping[str, Callable[[SimpleNamespace, SimpleNamespace, Any], Any]] = field(
        default_factory=dict
    )
    shape: Callable[[float], float] = float
    parameters: tuple[str, ...] = ()
    effort_share: float = 1.0
    stops: Stops | None = None
    play: str = ""
    deflection: Callable[[SimpleNamespace], Any] | None = None
    constants: tuple[Constant, ...] = ()
    tunables: tuple[Tunable, ...] = ()
    coefficients: tuple[Port, ...] = ()
    prepare: PrepareFn | None = None
    equations: tuple[Equation, ...] = ()


# before(x, u, p, w) -> named values, deflection
# after(x, u, p, w, named, tau, slope of the free stop operators) -> next x, coefficients
# onward: after without coefficients, for what is not differentiated
# column, newest: (dx, coefficients, offset) -> next dx, d deflection, for an earlier interval's
#     input and this one's; the stop operators' sensitivity is slope times d deflection, less offset
@dataclass(frozen=True)
class Linearised:
    """A substep split at the memory, with its derivative by state and input."""

    before: ca.Function
    after: ca.Function
    onward: ca.Function
    column: ca.Function
    newest: ca.Function
    named: int
    coefficients: int


def _scalars(names: Sequence[str]) -> tuple[ca.SX, SimpleNamespace]:
    symbols = [ca.SX.sym(n) for n in names]
    return ca.vertcat(*symbols) if symbols else ca.SX(0, 1), SimpleNamespace(
        **dict(zip(names, symbols, strict=True))
    )


class _Coefficients:
    # Derivatives that are not constants, each kept once.
    def __init__(self) -> None:
        self.values: list[ca.SX] = []
        self.symbols: list[ca.SX] = []

    def of(self, value: ca.SX) -> ca.SX:
        if value.is_constant():
            return value
        for v, s in zip(self.values, self.symbols, strict=True):
            if ca.is_equal(v, value, 100):
                return s
            if ca.is_equal(-v, value, 100) or ca.is_equal(v, -value, 100):
                return -s
        self.values.append(value)
        self.symbols.append(ca.SX.sym(f"k{len(self.values)}"))
        return self.symbols[-1]


def _resolve(expressions: list[ca.SX], entries: Sequence[Entry]) -> list[ca.SX]:
    """Expressions with a tape's names expanded."""
    if not entries:
        return expressions
    symbols, values = [e.symbol for e in entries], [e.value for e in entries]
    return list(ca.substitute_inplace(symbols, values, expressions)[1])


def linearise(model: Model, h: float, u_scale: float) -> Linearised:
    """Split and differentiate a model's substep."""
    x_all, x = _scalars(model.states)
    p_all, p = _scalars(model.parameters)
    w_all, w = _scalars(tuple(model.forecasts))
    u = ca.SX.sym("u")
    tape = Tape()
    result = dict(model.substep(tape, h, x, u, p, w))
    if set(result) != set(model.states):
        raise ValueError(f"the substep gives {sorted(result)}, the states are {model.states}")
    if (tape.memory_at is not None) != (model.stops is not None):
        raise ValueError("a substep asks the memory exactly when the model has stop operators")
    cut = len(tape.entries) if tape.memory_at is None else tape.memory_at
    tau = ca.SX.sym("tau") if tape.memory_symbol is None else tape.memory_symbol
    nothing = ca.SX(0)
    deflection = tape.entries[cut - 1].value if tape.memory_at is not None else nothing

    held = _Coefficients()
    d = {n: ca.SX.sym(f"d_{n}") for n in model.states}
    slope, offset = ca.SX.sym("slope"), ca.SX.sym("offset")
    partials = _Partials(tape, [*ca.vertsplit(x_all), u, tau])

    def tangents(seed: float) -> tuple[list[ca.SX], ca.SX]:
        moving: dict[str, Any] = {n: d[n] for n in model.states}
        if seed:
            moving["u"] = seed
        d_deflection: Any = ca.SX(0)

        def tangent(value: ca.SX) -> ca.SX:
            out: Any = ca.SX(0)
            by = partials.of(value)
            if "tau_memory" in by:
                # The memory's stiffness joins what else moves with the deflection.
                by_tau, key = by.pop("tau_memory"), tape.entries[cut - 1].symbol.name()
                by[key] = ca.simplify(by.get(key, ca.SX(0)) + by_tau * slope)
                out = out - held.of(by_tau) * offset
            for name, partial in by.items():
                if name in moving:
                    out = out + held.of(partial) * moving[name]
            return ca.SX(out)

        for i, entry in enumerate(tape.entries):
            if entry.link:
                moving[entry.symbol.name()] = tangent(entry.value)
            if tape.memory_at is not None and i == cut - 1:
                d_deflection = moving[entry.symbol.name()]
        return [tangent(ca.SX(result[n])) for n in model.states], ca.SX(d_deflection)

    newest_next, newest_d = tangents(u_scale)
    column_next, column_d = tangents(0.0)
    k_all = ca.vertcat(*held.symbols) if held.symbols else ca.SX(0, 1)
    d_all = ca.vertcat(*[d[n] for n in model.states])

    values = _resolve([ca.SX(result[n]) for n in model.states] + held.values, tape.entries[cut:])
    # What was named before the memory comes from where the first half has put it, if it is read.
    read = {s.name() for v in values for s in ca.symvar(v)}
    first = [e.symbol for e in tape.entries[:cut] if e.symbol.name() in read]
    named = ca.SX.sym("named", len(first)) if first else ca.SX(0, 1)
    before_values = _resolve([*first, deflection], tape.entries[:cut])
    before = ca.Function(
        "before",
        [x_all, u, p_all, w_all],
        [ca.densify(ca.vertcat(*before_values[:-1])), ca.densify(before_values[-1])],
    )
    values = [ca.substitute(v, ca.vertcat(*first), named) for v in values] if first else values
    n = len(model.states)
    following = ca.densify(ca.vertcat(*values[:n]))
    derivatives = ca.densify(ca.vertcat(*values[n:], ca.SX(0, 1)))
    arguments = [x_all, u, p_all, w_all, named, tau]
    after = ca.Function("after", [*arguments, slope], ca.cse([following, derivatives]))
    onward = ca.Function("onward", arguments, ca.cse([following]))
    kernels = []
    for name, d_next, d_delta in (
        ("column", column_next, column_d),
        ("newest", newest_next, newest_d),
    ):
        outputs = ca.cse([ca.densify(ca.vertcat(*d_next)), ca.densify(d_delta)])
        kernels.append(ca.Function(name, [d_all, k_all, offset], outputs))
    column, newest = kernels
    return Linearised(before, after, onward, column, newest, len(first), len(held.values))


class _Partials:
    # Partial derivatives by the links of a tape, through what is only kept: from the value back, so
    # that what several links share is multiplied once.
    def __init__(self, tape: Tape, roots: Sequence[ca.SX]) -> None:
        self.kept: dict[str, dict[str, ca.SX]] = {}
        self.symbols = {s.name(): s for s in roots}
        names = [s.name() for s in roots] + [e.symbol.name() for e in tape.entries]
        if len(names) != len(set(names)):
            raise ValueError(f"a substep names a value twice: {names}")
        for e in tape.entries:
            if not e.link:
                self.kept[e.symbol.name()] = self._slopes(e.value, e.slopes)
            self.symbols[e.symbol.name()] = e.symbol

    def of(self, value: ca.SX) -> dict[str, ca.SX]:
        found = self._slopes(value, None)
        for name in reversed(self.kept):
            if name not in found:
                continue
            weight = found.pop(name)
            for key, partial in self.kept[name].items():
                found[key] = ca.simplify(found.get(key, ca.SX(0)) + weight * partial)
        return {k: v for k, v in found.items() if not (v.is_constant() and v.is_zero())}

    def _slopes(self, value: ca.SX, given: list[tuple[ca.SX, ca.SX]] | None) -> dict[str, ca.SX]:
        if given is None:
            given = [(s, ca.jacobian(value, s)) for s in ca.symvar(value)]
        return {
            # Parameters and forecasts do not move.
            s.name(): ca.simplify(ca.densify(partial))
            for s, partial in given
            if s.name() in self.symbols and partial.nnz()
        }
