"""Common base of Block and Program: names, ports, tunables, start, run."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from esea_gen.language.names import check_name
from esea_gen.language.ports import Array, Constant, Equation, Port, Tunable, symbols_of
from esea_gen.language.stream import OwnStreams

Kind = Literal["block", "program"]
PrepareFn = Callable[[SimpleNamespace], Mapping[str, Any]]


@dataclass(frozen=True)
class Component(ABC):
    """A unit that runs on the controller board with a fixed period: a Block or a Program."""

    name: str  # lower case C identifier; becomes ``esea_<device>_<name>_step``
    title: str
    period_s: float  # fixed sampling period
    constants: tuple[Constant, ...]
    tunables: tuple[Tunable, ...]
    coefficients: tuple[Port, ...]
    state: tuple[Port, ...]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    equations: tuple[Equation, ...]
    prepare: ca.Function = field(repr=False)
    init: ca.Function = field(repr=False)
    # What random inputs do not bring about.
    streams: OwnStreams = field(default=OwnStreams(), repr=False, kw_only=True)
    # Starts afresh, its latch closed, where a copied state is resumed.
    starts_latched: bool = field(default=False, kw_only=True)

    kind: ClassVar[Kind]

    @property
    @abstractmethod
    def kernels(self) -> dict[str, ca.Function]:
        """The straight-line functions that a step is made of, by name."""

    @abstractmethod
    def simulator(self, tunables: Mapping[str, float] | None = None) -> Executor:
        """An executor, freshly initialised."""

    @property
    def status_port(self) -> Port | None:
        return next((p for p in self.outputs if p.flags), None)

    def default_tunables(self) -> dict[str, float]:
        return {t.name: t.default for t in self.tunables}

    def taken_tunables(self, given: Mapping[str, float] | None) -> dict[str, float]:
        """Value of every tunable: the defaults, replaced by the supplied values."""
        values = self.default_tunables()
        known = {t.name: t for t in self.tunables}
        for key, value in (given or {}).items():
            if key not in known:
                raise ValueError(f"{self.kind} {self.name} has no tunable {key}; it has {[*known]}")
            t = known[key]
            values[key] = t.taken(float(value))
            if not t.low <= values[key] <= t.high:
                raise ValueError(f"{key} = {value} is outside [{t.low}, {t.high}]")
        return values


class Executor(ABC):
    """Runs a Component in Python, step by step, in float64."""

    def __init__(self, component: Component, tunables: Mapping[str, float] | None = None) -> None:
        self.block = component
        values = component.taken_tunables(tunables)
        prepared = component.prepare.call([ca.DM(v) for v in values.values()]) if values else []
        self._c = {
            p.name: np.asarray(c, dtype=float).ravel()
            for p, c in zip(component.coefficients, prepared, strict=True)
        }
        self._state, self._s = in_a_row(component.state)
        self._inputs, self._u = in_a_row(component.inputs)
        self._outputs, self._y = in_a_row(component.outputs)

    @abstractmethod
    def _advance(self) -> None:
        """One step on the arrays of inputs, state and outputs."""

    def reset(self) -> None:
        for s in self._s.values():
            s[:] = 0.0
        initial = self.block.init.call([ca.DM(c) for c in self._c.values()])
        for name, v in zip(self.block.init.name_out(), initial, strict=True):
            self._s[name.removesuffix("_0")][:] = np.asarray(v, dtype=float).ravel()

    @property
    def coefficients(self) -> dict[str, Array]:
        return {n: c.copy() for n, c in self._c.items()}

    @coefficients.setter
    def coefficients(self, values: Mapping[str, Any]) -> None:
        for name in self._c.keys() & values.keys():
            self._c[name][:] = np.asarray(values[name], dtype=float).ravel()

    @property
    def state(self) -> dict[str, Array]:
        """A copy of the state, by name."""
        return {n: s.copy() for n, s in self._s.items()}

    @state.setter
    def state(self, values: Mapping[str, Any]) -> None:
        for name in self._s.keys() & values.keys():
            self._s[name][:] = np.asarray(values[name], dtype=float).ravel()
        _reject_fractions(self.block.state, self._s)

    def step(self, **inputs: float | Array) -> dict[str, Any]:
        if inputs.keys() != self._u.keys():
            raise TypeError(f"{self.block.name}.step takes {[*self._u]}, got {sorted(inputs)}")
        for name, value in inputs.items():
            self._u[name][:] = value
        _reject_fractions(self.block.inputs, self._u)
        self._advance()
        out: dict[str, Any] = {}
        for p in self.block.outputs:
            y = self._y[p.name]
            out[p.name] = int(y[0]) if p.flags else float(y[0]) if p.size == 1 else y.copy()
        return out

    def __repr__(self) -> str:
        ends = (", ".join(ports) for ports in (self._u, self._y))
        rate = f"{1 / self.block.period_s:g} Hz"
        return f"<{type(self).__name__} of {self.block.name}, {rate}: {' -> '.join(ends)}>"

    def run(self, inputs: Any) -> tuple[Any, Any]:
        """Run over a stream, going on from the present state; outputs and states, step by step.

        They come as the inputs do: arrays by port; a pandas DataFrame with a column a port, of a
        vector one an element, ``x[0]``; or one array with these columns in the ports' order.
        """
        rows = self._rows(inputs)
        steps = len(rows)
        outputs = np.empty((steps, len(self._outputs)))
        states = np.empty((steps, len(self._state)))
        for k in range(steps):
            self._inputs[:] = rows[k]
            _reject_fractions(self.block.inputs, self._u)
            self._advance()
            outputs[k] = self._outputs
            states[k] = self._state
        found = (outputs, self._y), (states, self._s)
        if isinstance(inputs, Mapping):
            return _columns(*found[0]), _columns(*found[1])
        if hasattr(inputs, "columns"):
            frame, index = type(inputs), inputs.index
            made = [frame(a, index=index, columns=_elements(ports)) for a, ports in found]
            return made[0], made[1]
        return outputs, states

    def _rows(self, inputs: Any) -> Array:
        # The inputs as a row a step.
        table = not isinstance(inputs, Mapping) and hasattr(inputs, "columns")
        if not isinstance(inputs, Mapping) and not table:
            rows = self._numbers("the array", inputs)
            if rows.ndim != 2 or rows.shape[1] != len(self._inputs):
                raise ValueError(
                    f"{self.block.name}.run: an array of shape {rows.shape}, and its inputs are "
                    f"{len(self._inputs)} columns: {', '.join(_elements(self._u))}"
                )
            return rows
        names = _elements(self._u) if table else list(self._u)
        if missing := [n for n in names if n not in inputs]:
            raise ValueError(f"{self.block.name}.run: no {missing[0]}; it takes {names}")
        columns = {n: self._numbers(n, inputs[n]) for n in names}
        for n, c in columns.items():
            if c.ndim != 2 or c.shape[1] != (1 if table else len(self._u[n])):
                raise ValueError(f"{self.block.name}.run: {n} has the wrong shape, {c.shape}")
        if len({len(c) for c in columns.values()}) > 1:
            lengths = {n: len(c) for n, c in columns.items()}
            raise ValueError(f"{self.block.name}.run: inputs of different lengths: {lengths}")
        return np.column_stack(list(columns.values()))

    def _numbers(self, name: str, values: Any) -> Array:
        try:
            found = np.asarray(values, dtype=float)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{self.block.name}.run: {name}: {error}") from None
        return found[:, None] if found.ndim == 1 else found


def _reject_fractions(ports: Sequence[Port], values: Mapping[str, Array]) -> None:
    # Of a flag or a count what is not a whole number is invalid: C can hold none.
    for p in ports:
        if p.kind != "quantity":
            x = values[p.name]
            x[np.ceil(x) != x] = np.nan


def in_a_row(ports: Sequence[Port]) -> tuple[Array, dict[str, Array]]:
    """An array for all ports, so that a step moves all at once, and each port's part of it."""
    ends = np.cumsum([p.size for p in ports], dtype=int).tolist()
    whole = np.zeros(ends[-1] if ends else 0)
    return whole, {p.name: whole[e - p.size : e] for p, e in zip(ports, ends, strict=True)}


def _elements(ports: Mapping[str, Array]) -> list[str]:
    return [n if len(a) == 1 else f"{n}[{i}]" for n, a in ports.items() for i in range(len(a))]


def _columns(table: Array, ports: Mapping[str, Array]) -> dict[str, Array]:
    """A table's columns by port: (steps,) for scalars, (steps, size) for vectors."""
    found, first = {}, 0
    for name, part in ports.items():
        last = first + len(part)
        found[name] = table[:, first if len(part) == 1 else slice(first, last)].copy()
        first = last
    return found


def check_ports(
    name: str, title: str, period_s: float, *groups: tuple[Port | Tunable, ...]
) -> None:
    """Reject wrong names and titles, a non-positive period and signed counts on wires."""
    check_name("block", name)
    if not title.isprintable() or any(b in title for b in ("*/", "/*", "\\")):
        raise ValueError(f"block {name}: title {title!r} would end or break a comment of the C")
    if not (math.isfinite(period_s) and period_s > 0):
        raise ValueError(f"block {name}: period_s must be positive, got {period_s}")
    for group in groups:
        names = [p.name for p in group]
        if len(names) != len({n.lower() for n in names}):  # macros and messages have one case
            raise ValueError(f"block {name}: a port name occurs twice, in any case, in {names}")
    if signed := [p.name for p in chain(*groups[3:]) if p.kind == "count" and p.low < 0]:
        raise ValueError(f"block {name}: {signed} count below 0, which only a state may")


def collect(
    block: str, kind: str, ports: tuple[Port, ...], values: Mapping[str, Any]
) -> list[ca.SX]:
    """The expressions of ports, in their order; refused when one is missing or of another size."""
    missing = sorted({p.name for p in ports} - set(values))
    extra = sorted(set(values) - {p.name for p in ports})
    if missing or extra:
        raise ValueError(f"block {block}: {kind}s missing {missing}, unknown {extra}")
    out = []
    for p in ports:
        v = values[p.name]
        v = ca.vertcat(*v) if isinstance(v, (list, tuple)) else ca.SX(v)
        if v.shape != (p.size, 1):
            raise ValueError(f"block {block}: {kind} {p.name} has shape {v.shape}, not {p.size}")
        out.append(ca.densify(v))
    return out


def start_functions(
    name: str,
    tunables: tuple[Tunable, ...],
    coefficients: tuple[Port, ...],
    state: tuple[Port, ...],
    prepare: PrepareFn | None,
) -> tuple[ca.Function, ca.Function]:
    if bool(tunables) != bool(coefficients) or bool(tunables) != (prepare is not None):
        raise ValueError(f"block {name}: tunables, coefficients and prepare go together")
    tun, coef = symbols_of(tunables), symbols_of(coefficients)
    values = dict(prepare(SimpleNamespace(**tun))) if prepare else {}
    prepared = ca.Function(
        f"{name}_prepare",
        list(tun.values()),
        collect(name, "coefficient", coefficients, values),
        [t.name for t in tunables],
        # A tunable that passes through as a coefficient keeps its name; CasADi wants two.
        [f"c_{c.name}" for c in coefficients],
    )
    _check_coefficients(name, tunables, coefficients, prepared)
    return (
        prepared,
        ca.Function(
            f"{name}_init",
            list(coef.values()),
            [ca.DM.ones(p.size) * p.init for p in state],
            list(coef),
            [f"{p.name}_0" for p in state],
        ),
    )


def _check_coefficients(
    block: str, tunables: tuple[Tunable, ...], coefficients: tuple[Port, ...], prepare: ca.Function
) -> None:
    # At the defaults, and with each tunable at its bounds: fixed point clips there, floats do not.
    start = [t.default for t in tunables]
    for k, t in enumerate(tunables):
        for value in (t.default, t.low, t.high):
            made = prepare.call([ca.DM(v) for v in (*start[:k], value, *start[k + 1 :])])
            for p, c in zip(coefficients, made, strict=True):
                room = 1e-6 * max(abs(p.low), abs(p.high))
                for x in np.asarray(c).flat:
                    if not p.low - room <= x <= p.high + room:
                        at = f"{x:.6g} at {t.name} = {value:g}, outside [{p.low:g}, {p.high:g}]"
                        raise ValueError(f"block {block}: coefficient {p.name} is {at}")
