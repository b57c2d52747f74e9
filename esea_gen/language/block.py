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

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from types import SimpleNamespace
from typing import Any, Literal

import casadi as ca
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Status = Literal["published", "identified", "assumed", "derived"]

UNIT_SUFFIXES = {
    "_rad": "rad",
    "_deg": "deg",
    "_rad_s": "rad/s",
    "_rad_s2": "rad/s^2",
    "_Nm": "Nm",
    "_Nm_rad": "Nm/rad",
    "_Nm_rad3": "Nm/rad^3",
    "_Nms_rad": "Nm s/rad",
    "_1_rad": "1/rad",
    "_1_s": "1/s",
    "_1_s2": "1/s^2",
    "_s": "s",
    "_Hz": "Hz",
    "_bits": "bit",
    "_kgm2": "kg m^2",
    "_rad_s3": "rad/s^3",
    "_Nm_s": "Nm/s",
    "_Nm_s2": "Nm/s^2",
    "_Nm_s_rad": "Nm/(rad s)",
    "_J": "J",
    "_W": "W",
}


def unit_of(name: str) -> str:
    """Unit that a name carries in its suffix.

    Parameters
    ----------
    name : str
        A quantity's name, such as ``omega_mid_rad_s``.

    Returns
    -------
    str
        The unit, ``"1"`` for a name without a known suffix (a dimensionless quantity).
    """
    best = max((s for s in UNIT_SUFFIXES if name.endswith(s)), key=len, default="")
    return UNIT_SUFFIXES.get(best, "1")


def f32_inside(low: float, high: float) -> tuple[float, float]:
    """Snap an interval's ends inwards to float32 numbers.

    Every threshold that decides something is such a number, so that f64 and f32 decide alike on the
    same input.

    Parameters
    ----------
    low, high : float
        Ends of the interval.

    Returns
    -------
    tuple of float
        The ends, each the nearest float32 not outside the interval.
    """
    lo, hi = np.float32(low), np.float32(high)
    if float(lo) < low:
        lo = np.nextafter(lo, np.float32(np.inf))
    if float(hi) > high:
        hi = np.nextafter(hi, np.float32(-np.inf))
    return float(lo), float(hi)


def threshold(value: float) -> float:
    """A positive threshold as the nearest float32 not above it (all formats then decide alike).

    Parameters
    ----------
    value : float
        Threshold.

    Returns
    -------
    float
        The snapped threshold.
    """
    return f32_inside(-value, value)[1]


@dataclass(frozen=True)
class Flag:
    """One bit of a status word.

    Parameters
    ----------
    name : str
        Upper case name, ``INPUT_INVALID``.
    meaning : str
        What it tells the reader of a log.
    counted : bool
        Whether the C keeps a saturating counter of the steps in which it was set.
    compares : tuple of str
        Outputs whose magnitude, once computed, decides the bit; empty when the inputs alone do, so
        that all number formats agree.
    threshold : float
        What it is compared with.
    """

    name: str
    meaning: str
    counted: bool = False
    compares: tuple[str, ...] = ()
    threshold: float = 0.0


@dataclass(frozen=True)
class Port:
    """A named value that crosses a Block's border: input, output, state or coefficient.

    Parameters
    ----------
    name : str
        Name with its unit as suffix (``theta_rad``).
    low, high : float
        Physical range; snapped inwards to float32 numbers.
    meaning : str
        One sentence for headers, telemetry and reports.
    size : int
        Number of elements.
    equation : str
        Number of the equation it comes from, as printed in the source.
    init : float
        States: value after ``init``.
    on_invalid : float or str
        Inputs: the constant, or the name of the state, used in place of an invalid value.
    repair : {"init", "block"}
        States: ``init`` lets the guard put the initial value in place of a corrupt one; ``block``
        leaves that to the Block's own step, which is told through ``guard.state_ok``.
    flags : tuple of Flag
        Outputs that are status words: the bits, least significant first.
    """

    name: str
    low: float
    high: float
    meaning: str
    size: int = 1
    equation: str = ""
    init: float = 0.0
    on_invalid: float | str = 0.0
    repair: Literal["init", "block"] = "init"
    flags: tuple[Flag, ...] = ()

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"port {self.name}: range [{self.low}, {self.high}] is empty")
        if self.size < 1:
            raise ValueError(f"port {self.name}: size {self.size} is below 1")
        low, high = f32_inside(self.low, self.high)
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)

    @property
    def unit(self) -> str:
        """Unit from the name's suffix; ``"1"`` when dimensionless."""
        return "bits" if self.flags else unit_of(self.name)


@dataclass(frozen=True)
class Tunable:
    """A value that may be changed while the board runs.

    Parameters
    ----------
    name : str
        Name with its unit as suffix.
    default, low, high : float
        Default and the bounds outside which a change is refused; bounds are snapped inwards to
        float32 numbers, and a default as near as rounding is the bound (:meth:`taken`).
    meaning : str
        One sentence, with the effect of turning it up.
    source : str
        Where the default comes from.
    status : str
        ``published``, ``identified`` or ``assumed``.
    """

    name: str
    default: float
    low: float
    high: float
    meaning: str
    source: str = ""
    status: Status = "assumed"

    def __post_init__(self) -> None:
        low, high = f32_inside(self.low, self.high)
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)
        object.__setattr__(self, "default", self.taken(self.default))
        if not self.low <= self.default <= self.high:
            raise ValueError(
                f"tunable {self.name}: default {self.default} outside [{self.low}, {self.high}]"
            )

    def taken(self, value: float) -> float:
        """A value as it is set: the bound, for one that only float32's rounding puts beyond it.

        Bounds are snapped inwards, so the number that a device file or a message names as the bound
        lies beyond by up to one rounding.

        Parameters
        ----------
        value : float
            A value somebody gave.

        Returns
        -------
        float
            The bound within one float32 rounding of it, else ``value``, inside the bounds or not.
        """
        for bound, beyond in ((self.low, value < self.low), (self.high, value > self.high)):
            if beyond and abs(value - bound) <= float(np.spacing(np.float32(abs(bound)))):
                return bound
        return value

    @property
    def unit(self) -> str:
        """Unit from the name's suffix."""
        return unit_of(self.name)


@dataclass(frozen=True)
class Constant:
    """A number folded into the code, kept here for headers and reports.

    Parameters
    ----------
    name : str
        Name with its unit as suffix.
    value : float
        The number, SI units.
    source : str
        Table, equation or recording it comes from.
    status : str
        ``published``, ``identified``, ``assumed`` or ``derived``.
    """

    name: str
    value: float
    source: str
    status: Status

    @property
    def unit(self) -> str:
        """Unit from the name's suffix."""
        return unit_of(self.name)


@dataclass(frozen=True)
class Equation:
    """An equation a Block implements, for documents and comments.

    Parameters
    ----------
    number : str
        Number in the source, ``"(3.4)"``; ours start with ``"["``.
    mathml : str
        Presentation MathML, printed by SymPy from the expression that is evaluated.
    text : str
        What it says, in a few words.
    """

    number: str
    mathml: str
    text: str


class Guard(SimpleNamespace):
    """What the guard found in this step: ``inputs_ok``, ``state_ok`` (symbols, 1 or 0)."""

    inputs_ok: ca.SX
    state_ok: ca.SX


class Labels:
    """Collects names for intermediate values, so that the emitted C reads like the equations."""

    def __init__(self) -> None:
        self.items: list[tuple[str, str, ca.SX]] = []

    def __call__(self, name: str, value: ca.SX, comment: str = "") -> ca.SX:
        """Name an intermediate value."""
        self.items.append((name, comment, value))
        return value


def _symbols(ports: Iterable[Port | Tunable]) -> dict[str, ca.SX]:
    return {p.name: ca.SX.sym(p.name, getattr(p, "size", 1)) for p in ports}


def in_range(x: ca.SX, low: float, high: float) -> ca.SX:
    """Whether a value is inside a range; false for NaN (promise 5: test before any clip).

    Parameters
    ----------
    x : casadi.SX
        Scalar.
    low, high : float
        Ends, both inside.

    Returns
    -------
    casadi.SX
        1 or 0.
    """
    return ca.logic_and(x <= high, x >= low)


def port_ok(x: ca.SX, port: Port) -> ca.SX:
    """Whether a port's value is plausible.

    A scalar must be inside its range.  For a vector the sum of magnitudes must be within size times
    the largest magnitude (and a thousandth, room for rounding): one comparison finds any NaN,
    infinity or blown-up element.

    Parameters
    ----------
    x : casadi.SX
        The value, ``port.size`` elements.
    port : Port
        Its port.

    Returns
    -------
    casadi.SX
        1 or 0.
    """
    if port.size == 1:
        return in_range(x, port.low, port.high)
    total = ca.fabs(x[0])
    for i in range(1, port.size):
        total = total + ca.fabs(x[i])
    return total <= float(np.float32(1.001 * port.size * max(abs(port.low), abs(port.high))))


def clip(x: ca.SX, low: Any, high: Any) -> ca.SX:
    """Clip a value that has passed its port check.

    Parameters
    ----------
    x : casadi.SX
        Scalar, not NaN.
    low, high : float or casadi.SX
        Ends.

    Returns
    -------
    casadi.SX
        ``max(min(x, high), low)``.
    """
    return ca.fmax(ca.fmin(x, high), low)


PrepareFn = Callable[[SimpleNamespace], Mapping[str, Any]]
StepFn = Callable[
    [SimpleNamespace, SimpleNamespace, SimpleNamespace, Guard, Labels],
    tuple[Mapping[str, Any], Mapping[str, Any]],
]


@dataclass(frozen=True)
class Solved:
    """A value that an equation defines, however it was found: its residual bounds its error.

    Parameters
    ----------
    residual : str
        Label of the equation's residual at the value, computed in the same step.
    most : float
        Largest magnitude of the computed residual while no flag says otherwise.
    slope : float
        Least slope of the residual over the value, above 0; in exact arithmetic the residual is 0.
    jump : float
        Largest jump of the value where its defining unknown crosses zero.
    """

    residual: str
    most: float
    slope: float
    jump: float = 0.0


@dataclass(frozen=True)
class Block:
    """A unit of controller code.  Build one with :meth:`define`.

    Parameters
    ----------
    name : str
        Lower case C identifier; becomes ``esea_<device>_<name>_step``.
    title : str
        One line of purpose.
    period_s : float
        Fixed sampling period.
    constants, tunables, coefficients, state, inputs, outputs : tuple
        Its ports and numbers.
    equations : tuple of Equation
        What it implements.
    prepare, init, step : casadi.Function
        The kernels, scalar expressions (SX); one argument or result per port, in port order.
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

    name: str
    title: str
    period_s: float
    constants: tuple[Constant, ...]
    tunables: tuple[Tunable, ...]
    coefficients: tuple[Port, ...]
    state: tuple[Port, ...]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    equations: tuple[Equation, ...]
    prepare: ca.Function = field(repr=False)
    init: ca.Function = field(repr=False)
    step: ca.Function = field(repr=False)
    labelled_step: ca.Function = field(repr=False)
    labels: tuple[tuple[str, str], ...] = ()
    split: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    facts: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    solved: Mapping[str, Solved] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """``block``: one straight-line step; a Program's is ``program``."""
        return "block"

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
    ) -> Block:
        """Build a Block from Python functions on symbols.

        Parameters
        ----------
        name, title, period_s, constants, tunables, coefficients, state, inputs, outputs
            As in the class.
        equations, split, facts, solved
            As in the class.
        step : callable
            ``step(c, s, u, guard, label) -> (next_state, outputs)``: ``c``, ``s``, ``u`` hold one
            symbol per coefficient, state and input (already guarded); the results map port names
            to expressions.
        prepare : callable, optional
            ``prepare(t) -> coefficients`` with one symbol per tunable; needed with tunables.

        Returns
        -------
        Block
            The Block, its step guarded.

        Raises
        ------
        ValueError
            For ports that are missing, doubled or of the wrong size, or a free symbol in a result.
        """
        if not (math.isfinite(period_s) and period_s > 0):
            raise ValueError(f"block {name}: period_s must be positive, got {period_s}")
        for group in (tunables, coefficients, state, inputs, outputs):
            names = [p.name for p in group]
            if len(names) != len(set(names)):
                raise ValueError(f"block {name}: a port name occurs twice in {names}")
        if bool(tunables) != bool(coefficients) or bool(tunables) != (prepare is not None):
            raise ValueError(f"block {name}: tunables, coefficients and prepare go together")

        tun, coef = _symbols(tunables), _symbols(coefficients)
        raw_s, raw_u = _symbols(state), _symbols(inputs)

        coefficient_values = dict(prepare(SimpleNamespace(**tun))) if prepare else {}
        prepare_f = ca.Function(
            f"{name}_prepare",
            list(tun.values()),
            _collect(name, "coefficient", coefficients, coefficient_values),
            [t.name for t in tunables],
            # A tunable that passes through as a coefficient keeps its name; CasADi wants two.
            [f"c_{c.name}" for c in coefficients],
        )
        init_f = ca.Function(
            f"{name}_init",
            list(coef.values()),
            [ca.DM.ones(p.size) * p.init for p in state],
            list(coef),
            [f"{p.name}_0" for p in state],
        )

        label = Labels()
        state_ok = _all([port_ok(raw_s[p.name], p) for p in state])
        label("state_ok", state_ok, "Guard: a corrupt state starts the block afresh.")
        s = {
            p.name: ca.if_else(state_ok, raw_s[p.name], p.init)
            if p.repair == "init"
            else raw_s[p.name]
            for p in state
        }
        u, valid = {}, []
        for p in inputs:
            ok = label(f"{p.name}_ok", port_ok(raw_u[p.name], p))
            held = s[p.on_invalid] if isinstance(p.on_invalid, str) else p.on_invalid
            u[p.name] = ca.if_else(ok, raw_u[p.name], held)
            if p.size == 1:
                label(f"{p.name}_used", u[p.name], "Guard: an invalid input is replaced.")
            valid.append(ok)
        inputs_ok = label("inputs_ok", _all(valid))

        s_next, y = step(
            SimpleNamespace(**coef),
            SimpleNamespace(**s),
            SimpleNamespace(**u),
            Guard(inputs_ok=inputs_ok, state_ok=state_ok),
            label,
        )
        results = _collect(name, "state", state, s_next) + _collect(name, "output", outputs, y)
        names = [n for n, _, _ in label.items]
        unknown = sorted(set(facts or {}) - set(names))
        if unknown:
            raise ValueError(f"block {name}: facts of values that have no label: {unknown}")
        for value, by in (solved or {}).items():
            if value not in (facts or {}) or by.residual not in names:
                raise ValueError(f"block {name}: {value} needs a fact and {by.residual} a label")
            if not (by.slope > 0 and by.most >= 0 and by.jump >= 0):
                raise ValueError(f"block {name}: the slope of {by.residual} must be above 0")
        cut = {f"s_{p.name}" for p in state} | {f"u_{p.name}" for p in inputs} | set(facts or {})
        unknown = sorted(set(split or {}) - cut)
        if unknown:
            raise ValueError(f"block {name}: splits of what is no state, input or fact: {unknown}")
        if len(names) != len(set(names)):
            raise ValueError(f"block {name}: a label occurs twice in {names}")
        shared = ca.cse(results + [v for _, _, v in label.items])
        results, labelled = shared[: len(results)], shared[len(results) :]

        arguments = [*coef.values(), *raw_s.values(), *raw_u.values()]
        argument_names = [f"c_{n}" for n in coef] + [f"s_{n}" for n in raw_s]
        argument_names += [f"u_{n}" for n in raw_u]
        result_names = [f"next_{p.name}" for p in state] + [f"y_{p.name}" for p in outputs]
        free = ca.symvar(ca.veccat(*results))
        bound = {str(x) for a in arguments for x in ca.symvar(a)}
        unbound = sorted(str(x) for x in free if str(x) not in bound)
        if unbound:
            raise ValueError(f"block {name}: step uses unbound symbols {unbound}")
        step_f = ca.Function(f"{name}_step", arguments, results, argument_names, result_names)
        labelled_f = ca.Function(
            f"{name}_labelled_step",
            arguments,
            results + labelled,
            argument_names,
            result_names + [f"label_{n}" for n, _, _ in label.items],
        )
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
        )

    @property
    def status_port(self) -> Port | None:
        """The output that is a status word, if there is one."""
        return next((p for p in self.outputs if p.flags), None)

    @property
    def flag_results(self) -> tuple[int, ...]:
        """Which results of ``step`` are status words."""
        return tuple(len(self.state) + k for k, p in enumerate(self.outputs) if p.flags)

    def default_tunables(self) -> dict[str, float]:
        """Default of every tunable."""
        return {t.name: t.default for t in self.tunables}

    def simulator(self, tunables: Mapping[str, float] | None = None) -> Simulator:
        """A reference executor of this Block: CasADi's own evaluator, float64.

        Parameters
        ----------
        tunables : mapping of str to float, optional
            Values other than the defaults.

        Returns
        -------
        Simulator
            Freshly initialised.
        """
        return Simulator(self, tunables)


def _all(conditions: list[ca.SX]) -> ca.SX:
    return reduce(ca.logic_and, conditions) if conditions else ca.SX(1)


def _collect(
    block: str, kind: str, ports: tuple[Port, ...], values: Mapping[str, Any]
) -> list[ca.SX]:
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


class Simulator:
    """Runs a Block symbolically, step by step, in float64.

    Parameters
    ----------
    block : Block
        What to run.
    tunables : mapping of str to float, optional
        Values other than the defaults.

    Raises
    ------
    ValueError
        For a tunable that is unknown or outside its bounds.
    """

    def __init__(self, block: Block, tunables: Mapping[str, float] | None = None) -> None:
        self.block = block
        values = block.default_tunables()
        for key, value in (tunables or {}).items():
            tunable = next((t for t in block.tunables if t.name == key), None)
            if tunable is None:
                raise ValueError(f"block {block.name} has no tunable {key}; it has {list(values)}")
            taken = tunable.taken(float(value))
            if not tunable.low <= taken <= tunable.high:
                raise ValueError(f"{key} = {value} is outside [{tunable.low}, {tunable.high}]")
            values[key] = taken
        prepared = block.prepare.call([ca.DM(v) for v in values.values()]) if values else []
        self._c = [np.asarray(c, dtype=float).ravel() for c in prepared]
        self._s = [np.zeros(p.size) for p in block.state]
        self._u = [np.zeros(p.size) for p in block.inputs]
        self._y = [np.zeros(p.size) for p in block.outputs]
        self._next = [np.zeros(p.size) for p in block.state]
        self._buffer, self._evaluate = block.step.buffer()
        buffer: Any = self._buffer
        for i, a in enumerate([*self._c, *self._s, *self._u]):
            buffer.set_arg(i, memoryview(a))  # type: ignore[arg-type]
        for i, r in enumerate([*self._next, *self._y]):
            buffer.set_res(i, memoryview(r))  # type: ignore[arg-type]
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        initial = self.block.init.call([ca.DM(c) for c in self._c])
        for s, v in zip(self._s, initial, strict=True):
            s[:] = np.asarray(v, dtype=float).ravel()

    @property
    def coefficients(self) -> dict[str, Array]:
        """Coefficients prepared from the tunables."""
        return {p.name: c.copy() for p, c in zip(self.block.coefficients, self._c, strict=True)}

    @property
    def state(self) -> dict[str, Array]:
        """A copy of the state, by name."""
        return {p.name: s.copy() for p, s in zip(self.block.state, self._s, strict=True)}

    @state.setter
    def state(self, values: Mapping[str, Any]) -> None:
        for p, s in zip(self.block.state, self._s, strict=True):
            if p.name in values:
                s[:] = np.asarray(values[p.name], dtype=float).ravel()

    def step(self, **inputs: float | Array) -> dict[str, Any]:
        """One step.

        Parameters
        ----------
        **inputs : float or ndarray
            One value per input port.

        Returns
        -------
        dict
            One value per output port: float, ndarray for a vector, int for a status word.

        Raises
        ------
        TypeError
            When the names are not the input ports'.
        """
        if set(inputs) != {p.name for p in self.block.inputs}:
            raise TypeError(
                f"{self.block.name}.step takes {[p.name for p in self.block.inputs]}, "
                f"got {sorted(inputs)}"
            )
        for p, a in zip(self.block.inputs, self._u, strict=True):
            a[:] = inputs[p.name]
        self._advance()
        out: dict[str, Any] = {}
        for p, y in zip(self.block.outputs, self._y, strict=True):
            if p.flags:
                out[p.name] = int(y[0])
            else:
                out[p.name] = float(y[0]) if p.size == 1 else y.copy()
        return out

    def _advance(self) -> None:
        self._evaluate()
        for s, n in zip(self._s, self._next, strict=True):
            s[:] = n

    def run(self, inputs: Mapping[str, Any]) -> tuple[dict[str, Array], dict[str, Array]]:
        """Run over a stream, going on from the present state.

        Parameters
        ----------
        inputs : mapping of str to array
            One array per input port, shape (steps,) or (steps, size).

        Returns
        -------
        outputs, states : dict of str to ndarray
            One array per port: (steps,) for scalars, (steps, size) for vectors; the state is the
            one after each step.
        """
        block = self.block
        columns = [np.asarray(inputs[p.name], dtype=float) for p in block.inputs]
        n = len(columns[0])
        u = [c.reshape(n, -1) for c in columns]
        y = [np.empty((n, p.size)) for p in block.outputs]
        s = [np.empty((n, p.size)) for p in block.state]
        for k in range(n):
            for a, column in zip(self._u, u, strict=True):
                a[:] = column[k]
            self._advance()
            for store, value in zip(y, self._y, strict=True):
                store[k] = value
            for store, value in zip(s, self._s, strict=True):
                store[k] = value

        def squeeze(p: Port, a: Array) -> Array:
            return a[:, 0] if p.size == 1 else a

        return (
            {p.name: squeeze(p, a) for p, a in zip(block.outputs, y, strict=True)},
            {p.name: squeeze(p, a) for p, a in zip(block.state, s, strict=True)},
        )


def flag_word(bits: Iterable[ca.SX]) -> ca.SX:
    """Pack flags into a status word, first flag in the lowest bit.

    Parameters
    ----------
    bits : iterable of casadi.SX
        1 or 0 each, at most 24 of them (exact in float32).

    Returns
    -------
    casadi.SX
        The word as a whole number.
    """
    word: Any = ca.SX(0)
    for i, b in enumerate(bits):
        if i >= 24:
            raise ValueError("a status word has at most 24 flags")
        word = word + ca.if_else(b, float(1 << i), 0)
    return ca.SX(word)
