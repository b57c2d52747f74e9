"""A format's own arithmetic in NumPy, bit for bit; only the walker is the printer's."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import casadi as ca
import cffi
import numpy as np

from esea_gen.emit.elementary import exponent_q27, source_paths
from esea_gen.emit.formats import FORMATS, Format
from esea_gen.emit.walker import Kernel, Node, labelled_kernel, walk
from esea_gen.hostlib.codec import Array, to_whole
from esea_gen.hostlib.compiler import compile_sources, declared
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.block import Block
from esea_gen.language.stream import Stream
from esea_gen.verify.runs import CasadiOracle, changed, run_c

UINT32_MAX = 2**32 - 1


@cache
def _elementary() -> tuple[cffi.FFI, Any]:
    # The functions as compiled from the files that travel with the emitted C.
    texts = {path.name: path.read_text(encoding="utf-8") for path in source_paths()}
    header = next(t for n, t in texts.items() if n.endswith(".h") and "tables" not in n)
    ffi = declared(header)
    return ffi, ffi.dlopen(str(compile_sources(texts)))


def _call(name: str, x: Array, *more: Any) -> Array:
    _, lib = _elementary()
    function = getattr(lib, f"esea_f32_{name}")
    return np.fromiter((function(v, *more) for v in x.tolist()), np.float32, len(x))


def emitted_kernel(block: Block, fmt: Format) -> tuple[Kernel, dict[int, tuple[str, str]]]:
    """The step kernel that a format prints, with the names it prints."""
    kernel, labels = labelled_kernel(block, fmt.passes)
    return kernel, {node: (name, comment) for node, name, comment in labels}


def evaluate(kernel: Kernel, fmt: Format, arguments: Sequence[Array]) -> list[Array]:
    """Evaluate a kernel over many argument sets at once."""
    count = len(arguments[0]) if arguments else 1
    dtype = fmt.dtype.type
    values: list[Array] = []
    with np.errstate(all="ignore"):
        for node in kernel.nodes:
            if node.op == "const":
                values.append(np.full(count, dtype(node.value)))
            elif node.op == "input":
                argument, element = node.source
                values.append(np.asarray(arguments[argument][:, element], fmt.dtype))
            else:
                values.append(_value(node, values, fmt, kernel))
    return values


def told_otherwise(
    kernel: Kernel, fmt: Format, values: Sequence[Array], node: int, told: Array
) -> list[Array]:
    """Values of a kernel's nodes with one of them set from outside."""
    out, changed = [*values], {node}
    out[node] = told
    with np.errstate(all="ignore"):
        for i in range(node + 1, len(kernel.nodes)):
            if not changed.isdisjoint(kernel.nodes[i].args):
                out[i] = _value(kernel.nodes[i], out, fmt, kernel)
                changed.add(i)
    return out


def _value(node: Node, values: Sequence[Array], fmt: Format, kernel: Kernel) -> Array:
    result = operation(node, [values[a] for a in node.args], fmt, kernel)
    expected = np.dtype(np.bool_) if node.boolean else fmt.dtype
    if result.dtype != expected:  # a promotion would hide rounding
        raise TypeError(f"{kernel.name}: {node.op} gave {result.dtype}")
    return result


def _truth(x: Array) -> Array:
    return x if x.dtype == np.bool_ else x != 0


def _choose(condition: Array, x: Array, y: Array | np.floating[Any]) -> Array:
    return np.asarray(np.where(condition, x, y))


def operation(node: Node, args: list[Array], fmt: Format, kernel: Kernel) -> Array:
    op = node.op
    if op == "not":
        return ~_truth(args[0])
    if op in ("and", "or"):
        x, y = map(_truth, args)
        return x & y if op == "and" else x | y
    numbers = [a.astype(fmt.dtype) if a.dtype == np.bool_ else a for a in args]
    if op in ("if_else_zero", "select"):
        other = numbers[2] if op == "select" else fmt.dtype.type(0)
        return _choose(_truth(args[0]), numbers[1], other)
    if op == "pow":
        return _power(node, numbers, fmt, kernel)
    if op in ("exp", "log", "sqrt", "tanh"):
        if fmt.needs_libm:
            return np.asarray(getattr(np, op)(numbers[0]))
        return _call(op, numbers[0])
    return _rules(fmt)[op](*numbers)


@cache
def _rules(fmt: Format) -> dict[str, Callable[..., Array]]:
    one, two = (fmt.dtype.type(v) for v in (1, 2))
    # Of two equal zeros f64 takes the second, as CasADi does; f32 the first.
    second = fmt.needs_libm
    return {
        "add": lambda x, y: x + y,
        "sub": lambda x, y: x - y,
        "mul": lambda x, y: x * y,
        "div": lambda x, y: x / y,
        "neg": lambda x: -x,
        "sq": lambda x: x * x,
        "twice": lambda x: two * x,
        "inv": lambda x: one / x,
        "fabs": np.abs,
        "sign": lambda x: (x > 0).astype(x.dtype) - (x < 0).astype(x.dtype),
        "lt": lambda x, y: x < y,
        "le": lambda x, y: x <= y,
        "eq": lambda x, y: x == y,
        "ne": lambda x, y: x != y,
        "fmin": lambda x, y: _choose(x < y, x, y) if second else _choose(y < x, y, x),
        "fmax": lambda x, y: _choose(x > y, x, y) if second else _choose(y > x, y, x),
    }


def _power(node: Node, args: list[Array], fmt: Format, kernel: Kernel) -> Array:
    if fmt.needs_libm:
        return np.asarray(np.power(*args))
    exponent = kernel.nodes[node.args[1]]
    if exponent.op == "const":
        return _call("powk", args[0], exponent_q27(exponent.value))
    _, lib = _elementary()
    pairs = zip(args[0].tolist(), args[1].tolist(), strict=True)
    return np.fromiter((lib.esea_f32_pow(x, y) for x, y in pairs), np.float32, len(args[0]))


@dataclass(frozen=True)
class KernelTrajectory:
    """Outputs and states of a Block on a stream, in one format's bits."""

    stream: Stream
    outputs: dict[str, Array]
    states: dict[str, Array]

    def first_difference(self, outputs: Mapping[str, Array], states: Mapping[str, Array]) -> str:
        """Where another run first differs from this one in any bit."""
        found: list[tuple[int, str]] = []
        for kind, mine, other in (
            ("output", self.outputs, outputs),
            ("state", self.states, states),
        ):
            for name, a in mine.items():
                b = np.ascontiguousarray(other[name], dtype=a.dtype)
                if a.tobytes() == b.tobytes():
                    continue
                word = np.uint64 if a.dtype.itemsize == 8 else np.uint32
                differs = np.ascontiguousarray(a).view(word) != b.view(word)
                step = int(np.argmax(differs.reshape(len(a), -1).any(axis=1)))
                text = f"{self.stream.name}: {kind} {name} at step {step}: "
                found.append((step, f"{text}{b[step]!r} instead of {a[step]!r}"))
        return min(found)[1] if found else ""


def counter_fields(block: Block) -> dict[str, tuple[str, int]]:
    """The counters that the C keeps beside a Block's state."""
    return {
        f"n_{flag.name.lower()}": (port.name, bit)
        for port in block.outputs
        for bit, flag in enumerate(port.flags)
        if flag.counted
    }


def expected_counters(
    block: Block, stream: Stream, outputs: Mapping[str, Array]
) -> dict[str, Array]:
    """Expected counters after each step, limited to their maximum."""
    out = {}
    for field, (port, bit) in counter_fields(block).items():
        seen = outputs[port].astype(np.int64) >> bit & 1
        value, column = 0, np.empty(stream.steps, np.uint32)
        for k in range(stream.steps):
            value = int(stream.injections.get(k, {}).get(field, value))
            value = min(value + int(seen[k]), UINT32_MAX)
            column[k] = value
        out[field] = column
    return out


def step_arguments(
    block: Block, stream: Stream, states: Mapping[str, Array], fmt: Format
) -> list[Array]:
    """Arguments of every step of a recorded run, its coefficients those that stood in memory."""
    coefficients = coefficients_of(block, fmt, {})
    arguments = [np.tile(np.asarray(c, fmt.dtype), (stream.steps, 1)) for c in coefficients]
    with np.errstate(over="ignore"):
        for k, values in sorted(stream.coefficients.items()):
            for a, c in zip(arguments, changed(block, coefficients, values), strict=True):
                a[k:] = c
    for p, start in zip(block.state, initial_state(block, fmt, coefficients), strict=True):
        after = np.asarray(states[p.name], fmt.dtype).reshape(stream.steps, p.size)
        before = np.concatenate([np.asarray(start, fmt.dtype).reshape(1, p.size), after[:-1]])
        for k, values in stream.injections.items():
            if p.name in values:
                with np.errstate(over="ignore"):
                    before[k] = values[p.name]
        arguments.append(before)
    with np.errstate(over="ignore"):
        arguments += [
            np.asarray(stream.inputs[p.name], fmt.dtype).reshape(stream.steps, p.size)
            for p in block.inputs
        ]
    return arguments


def flat_results(kernel: Kernel, fmt: Format, arguments: Sequence[Array]) -> list[Array]:
    """Results of a kernel that is called once."""
    values = evaluate(kernel, fmt, [np.asarray(a, fmt.dtype)[None] for a in arguments])
    return [np.array([values[i][0] for i in r], fmt.dtype) for r in kernel.results]


def coefficients_of(block: Block, fmt: Format, tunables: Mapping[str, float]) -> list[Array]:
    """Coefficients by this executor (float32) or by CasADi's (float64)."""
    if not block.tunables:
        return []
    if fmt.needs_libm:
        return list(block.simulator(tunables).coefficients.values())
    values = block.default_tunables() | dict(tunables)
    kernel = fmt.passes(walk(block.prepare))
    return flat_results(kernel, fmt, [np.array([v]) for v in values.values()])


def initial_state(block: Block, fmt: Format, coefficients: Sequence[Array]) -> list[Array]:
    return flat_results(fmt.passes(walk(block.init)), fmt, coefficients)


def float32_trajectory(
    kernel: Kernel, block: Block, stream: Stream, arguments: Sequence[Array]
) -> KernelTrajectory:
    """Every step of a run evaluated in float32, from the states that the run recorded."""
    fmt = FORMATS["f32"]
    values = evaluate(kernel, fmt, arguments)
    columns = [np.stack([values[i].astype(fmt.dtype) for i in r], axis=1) for r in kernel.results]
    states = {
        p.name: c[:, 0] if p.size == 1 else c for p, c in zip(block.state, columns, strict=False)
    }
    outputs = {}
    for p, c in zip(block.outputs, columns[len(block.state) :], strict=True):
        value = c.astype(np.uint32) if p.flags else c
        outputs[p.name] = value[:, 0] if p.size == 1 else value
    return KernelTrajectory(stream, outputs, states | expected_counters(block, stream, outputs))


def held_stream(block: Block, stream: Stream) -> Stream:
    """A stream as C stores it: a flag or count that is not an integer is invalid."""
    whole = {p.name: p.integer for p in (*block.inputs, *block.state) if p.whole}

    def held(values: Mapping[str, Array]) -> dict[str, Array]:
        return {n: to_whole(x, whole[n]) * 1.0 if n in whole else x for n, x in values.items()}

    injections = {k: held(v) for k, v in stream.injections.items()}
    return replace(stream, inputs=held(stream.inputs), injections=injections)


def exact_trajectory(
    block: Block, library: HostLibrary, stream: Stream, oracle: CasadiOracle | None
) -> KernelTrajectory:
    """The bits that a Block's C must give on a stream."""
    stream = held_stream(block, stream)
    fmt = FORMATS[library.real]
    if oracle is not None:
        coefficients = coefficients_of(block, fmt, {})
        y, s = oracle.run(block, coefficients, initial_state(block, fmt, coefficients), stream)
        status = {p.name: y[p.name].astype(np.uint32) for p in block.outputs if p.flags}
        outputs = y | status
        return KernelTrajectory(stream, outputs, s | expected_counters(block, stream, outputs))
    _, trace = run_c(library.block(block.name), stream)
    arguments = step_arguments(block, stream, trace, fmt)
    kernel, _ = emitted_kernel(block, fmt)
    return float32_trajectory(kernel, block, stream, arguments)


# Settings of the tunables within their bounds, beside their defaults: shares of the room between.
SHARES = (0.0, 0.11, 0.37, 0.5, 0.83, 1.0)
RANDOM_SETTINGS = 40
# And far beyond them, times their defaults: there the terms count that are small within.
# Arithmetic is compared, not sense, so a setting that gives no number is left out.
BEYOND = (1e-3, 0.03, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3)


@dataclass(frozen=True)
class Setup:
    """Expected results of a Block's ``prepare`` and ``init`` in one format, bit for bit."""

    block: Block
    start: list[Array]
    prepared: list[tuple[dict[str, float], list[Array]]]


def expected_setup(block: Block, fmt: Format) -> Setup:
    rng = np.random.default_rng(7)
    count = len(block.tunables)
    shares = [np.full(count, s) for s in SHARES] + [*rng.random((RANDOM_SETTINGS, count))]
    settings = [block.default_tunables()] + [
        {
            t.name: float(np.float32(t.low + s * (t.high - t.low)))
            for t, s in zip(block.tunables, row, strict=True)
        }
        for row in shares
    ]
    settings += [
        {t.name: float(np.float32(factor * t.default)) for t in block.tunables} for factor in BEYOND
    ]
    prepared = []
    for values in settings if count else ():
        if fmt.needs_libm:
            made = block.prepare.call([ca.DM(v) for v in values.values()])
            columns = [np.asarray(c, dtype=float).ravel() for c in made]
        else:
            columns = coefficients_of(block, fmt, values)
        if all(np.all(np.isfinite(c)) for c in columns):
            prepared.append((values, columns))
    return Setup(block, initial_state(block, fmt, coefficients_of(block, fmt, {})), prepared)


def setup_difference(block: Block, library: HostLibrary, expected: Setup | None = None) -> str:
    """Where ``init`` or ``prepare`` of a compiled Block differs from this executor."""
    fmt = FORMATS[library.real]
    wanted = expected or expected_setup(block, fmt)
    runner = library.block(block.name)
    runner.reset()
    now = runner.state[0]
    for p, value in zip(block.state, wanted.start, strict=True):
        if np.asarray(now[p.name], fmt.dtype).tobytes() != value.tobytes():
            return f"init: state {p.name} is {now[p.name]!r} instead of {value!r}"
    for field in counter_fields(block):
        if now[field] != 0:
            return f"init: counter {field} is {now[field]}"
    for tunables, columns in wanted.prepared:
        runner.prepare(tunables)
        (held,) = runner._coeffs
        for p, value in zip(block.coefficients, columns, strict=True):
            got = getattr(held, p.name)
            column = np.array([got] if p.size == 1 else list(got), fmt.dtype)
            if column.tobytes() != value.tobytes():
                return f"prepare({tunables}): {p.name} is {column!r} instead of {value!r}"
    return ""
