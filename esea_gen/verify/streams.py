"""Input streams that try a Block: ordinary, nasty, invalid and recorded.

Every valid sample is a float32 number, so that all number formats are given the same input; what
counts (:func:`esea_gen.emit.ranges.counts`) is given whole numbers.  What random inputs cannot
bring about, such as a latch that opens, a Block brings along: :mod:`esea_gen.verify.events`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import product

import casadi as ca
import numpy as np
import numpy.typing as npt

from esea_gen.emit.ranges import counts
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.system import System

SPECIAL = (np.nan, np.inf, -np.inf, 3.4e38, -3.4e38)


@dataclass(frozen=True)
class Stream:
    """An input stream, with states put in from outside at some steps.

    inputs: per input port: (steps,) or (steps, size), float64 values that float32 holds exactly.
    injections: before the step, ``{state port: value}`` overwrites the state.
    coefficients: from the step on, ``{coefficient port: value}`` stands in the memory of the
        coefficients; those not named are as prepared from the default tunables.
    """

    name: str
    inputs: dict[str, Array]
    injections: dict[int, dict[str, Array]] = field(default_factory=dict)
    coefficients: dict[int, dict[str, Array]] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(next(iter(self.inputs.values())))


def single(values: npt.ArrayLike) -> Array:
    """Round to float32, kept as float64."""
    with np.errstate(over="ignore"):
        return np.asarray(values, dtype=np.float64).astype(np.float32).astype(np.float64)


def _shape(port: Port, steps: int) -> tuple[int, ...]:
    return (steps,) if port.size == 1 else (steps, port.size)


def _walk(rng: np.random.Generator, port: Port, steps: int, reach: float, step: float) -> Array:
    # A random walk reflected at the ends of part of the range.
    middle, half = 0.5 * (port.low + port.high), 0.5 * reach * (port.high - port.low)
    raw = np.cumsum(rng.normal(0.0, step * half, _shape(port, steps)), axis=0)
    folded = np.abs((raw / half + 1) % 4 - 2) - 1
    return single(middle + half * folded)


def _chirp(port: Port, steps: int, reach: float, phase: float) -> Array:
    t = np.linspace(0.0, 1.0, steps)
    middle, half = 0.5 * (port.low + port.high), 0.5 * reach * (port.high - port.low)
    wave = middle + half * np.sin(2 * np.pi * (2 * t + 20 * t * t) + phase)
    return single(wave if port.size == 1 else np.tile(wave[:, None], (1, port.size)))


def _thresholds(rng: np.random.Generator, block: Block, port: Port, steps: int) -> Array:
    # Ends of the range, constants of the Block that have the port's unit and multiples of them,
    # their float neighbours, zeros of both signs, subnormals.
    marks = [port.low, port.high, 0.0, -0.0, 1e-45, -1e-45, 1.2e-38]
    for c in block.constants:
        if c.unit == port.unit:
            marks += [k * s * c.value for k in range(1, 12) for s in (-1, 1)]
    for f in (p for p in block.outputs if p.flags):
        marks += [s * x.threshold for x in f.flags for s in (-1, 1)]
    values = np.asarray(marks, dtype=np.float32)
    around = np.concatenate(
        [
            values,
            np.nextafter(values, np.float32(np.inf)),
            np.nextafter(values, np.float32(-np.inf)),
        ]
    ).astype(np.float64)
    around = around[(around >= port.low) & (around <= port.high)]
    held = np.repeat(rng.choice(around, steps), rng.integers(1, 4, steps))[:steps]
    return held if port.size == 1 else np.tile(held[:, None], (1, port.size))


def _whole(port: Port, values: Array) -> Array:
    return np.rint(values) + 0.0 if counts(port) else values


def streams(block: Block, seed: int = 1, steps: int = 3000) -> list[Stream]:
    """The streams of a Block: generated ones, and those it brings along.

    return: random walk, noise over the whole range, chirp, reversals, thresholds, jumps, invalid
        inputs, corrupt states (where it has a state), and :func:`esea_gen.verify.events.events`.
    """
    from esea_gen.verify.events import events

    rng = np.random.default_rng(seed)

    def each(make: Callable[[int, Port], Array]) -> dict[str, Array]:
        return {p.name: _whole(p, make(i, p)) for i, p in enumerate(block.inputs)}

    def reversals(_: int, p: Port) -> Array:
        turns = rng.uniform(-0.6, 0.6, steps // 25 + 2)
        knots = np.arange(len(turns)) * 25
        wave = np.interp(np.arange(steps), knots, turns)
        held = np.where(
            (np.arange(steps) // 400) % 3 == 2, wave[(np.arange(steps) // 50) * 50], wave
        )
        value = single(0.5 * (p.low + p.high) + 0.5 * (p.high - p.low) * held)
        return value if p.size == 1 else np.tile(value[:, None], (1, p.size))

    def jumps(_: int, p: Port) -> Array:
        return single(rng.choice([p.low, p.high, 0.5 * p.high, 0.0], _shape(p, steps)))

    noise = each(lambda _, p: single(rng.uniform(p.low, p.high, _shape(p, steps))))
    walk = each(lambda _, p: _walk(rng, p, steps, 0.55, 0.01))
    invalid = {k: v.copy() for k, v in walk.items()}
    for p in block.inputs:
        hit = rng.random(invalid[p.name].shape) < 0.08
        beyond = [*SPECIAL, *single([1.5 * p.high + 1e-3, 1.5 * p.low - 1e-3])]
        invalid[p.name][hit] = rng.choice(beyond, int(hit.sum()))
    first = next(iter(invalid.values()))
    first[0] = np.nan  # the very first sample, before there is anything to hold
    injections: dict[int, dict[str, Array]] = {}
    for k in range(20, steps, 40) if block.state else ():
        p = block.state[int(rng.integers(len(block.state)))]
        value = _whole(p, single(rng.uniform(p.low, p.high, p.size)))
        if rng.random() < 0.8:
            value[int(rng.integers(p.size))] = rng.choice([*SPECIAL, 1e6, -1e6, 3 * p.high + 1])
        injections[k] = {p.name: value}
    found = [
        Stream("random walk", walk),
        Stream("noise over the range", noise),
        Stream("chirp", each(lambda i, p: _chirp(p, steps, 0.57, 0.7 * i))),
        Stream("reversals and plateaus", each(reversals)),
        Stream("thresholds", each(lambda _, p: _thresholds(rng, block, p, steps))),
        Stream("jumps", each(jumps)),
        Stream("invalid inputs", invalid),
    ]
    if injections:
        found.append(Stream("corrupt states", walk, injections))
    return [*found, *events(block, seed)]


def deflection_inputs(system: System, theta_rad: npt.ArrayLike) -> dict[str, Array]:
    """One deflection for every axis of a measuring System.

    theta_rad: deflection at the sensing rate, shape (steps,).
    """
    theta = single(theta_rad)
    return {x.name: theta for x in system.task_inputs(system.tasks[0])}


def first_axis(system: System, outputs: Mapping[str, Array]) -> dict[str, Array]:
    """The outputs of a task's first sensor, under the names of its Block's ports."""
    found = system.task_outputs(system.tasks[0])
    instance = next(x.signals[0].instance for x in found if x.signals[0].port == "tau_Nm")
    return {x.signals[0].port: outputs[x.name] for x in found if x.signals[0].instance == instance}


def inside(stream: Stream, limits: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a stream's inputs stay inside ranges.

    limits: by input name.
    """
    return all(
        bool(np.all((stream.inputs[k] >= low) & (stream.inputs[k] <= high)))
        for k, (low, high) in limits.items()
        if k in stream.inputs
    )


def at_the_limits(
    block: Block, dtype: npt.DTypeLike = np.float32, seed: int = 1, steps: int = 3000
) -> Stream:
    """Inputs, states and counters at their limits and one unit in the last place to either side.

    Not one of :func:`streams`: it is for comparisons bit by bit, within one number format.

    dtype: the format whose neighbouring numbers are meant; with float64, not every sample is a
        float32 number.
    return: every state element and counter is put at, just inside and just outside each end.
    """
    rng = np.random.default_rng(seed)

    def around(p: Port) -> Array:
        ends = [p.low, p.high, 0.0, 1e-3 * p.high]
        # Where an output of the same unit is clipped or flagged: a state can reach that exactly.
        ends += [x for q in block.outputs if q.unit == p.unit for x in (q.low, q.high)]
        marks = np.array([x for x in dict.fromkeys(ends) if p.low <= x <= p.high], dtype=dtype)
        sides = [np.nextafter(marks, np.full_like(marks, s * np.inf)) for s in (-1, 1)]
        return np.concatenate([marks, *sides]).astype(np.float64)

    inputs = {}
    for p in block.inputs:
        slow = _walk(rng, p, steps, 0.55, 0.01)
        hit = rng.random(slow.shape) < 0.2
        slow[hit] = rng.choice(around(p), int(hit.sum()))
        inputs[p.name] = slow
    cases: list[dict[str, Array]] = []
    for p in block.state:
        for element in range(p.size):
            for value in around(p):
                state = np.full(p.size, p.init)
                state[element] = value
                # Among states as they are, and alone: nothing then moves it off the limit.
                rest = {q.name: np.full(q.size, q.init) for q in block.state}
                cases += [{p.name: state}, rest | {p.name: state}]
        if p.size > 1:
            # The guard of a vector sums magnitudes: come close to its limit from both sides.
            total = float(np.float32(1.001 * p.size * max(abs(p.low), abs(p.high))))
            limit = np.array([total], dtype)
            for value in (limit, np.nextafter(limit, 0), np.nextafter(limit, 2 * limit)):
                state = np.zeros(p.size)
                state[int(rng.integers(p.size))] = value[0]
                cases.append({p.name: state})
            for element in range(p.size):
                for value in (1.01 * total, -1.01 * total):
                    state = np.zeros(p.size)
                    state[element] = single(value)
                    cases.append({p.name: state})
            for share in (0.999999, 1.000001):
                weights = rng.dirichlet(np.ones(p.size)) * rng.choice([-1, 1], p.size)
                cases.append({p.name: np.asarray(weights * total * share, dtype).astype(float)})
    counters = [f"n_{f.name.lower()}" for q in block.outputs for f in q.flags if f.counted]
    top = 2**32 - 1
    cases += [{c: np.array(top - k)} for c in counters for k in (0, 1, 40)]
    for _ in range(40):
        cases.append({p.name: single(rng.uniform(p.low, p.high, p.size)) for p in block.state})
    rng.shuffle(cases)
    # States and inputs at ends together, the same and mixed, so that sums and clips meet theirs;
    # inputs in their middle too, and just short of the ends.
    ports = (*block.inputs, *block.state)
    ends = []
    for k in range(120):
        upper, mixed, near = k % 2 == 1, k > 3, 1.0 if k < 64 else rng.uniform(0.97, 1.0)
        other = {p.name: mixed and rng.random() < 0.5 for p in ports}
        ends.append({p.name: near * _end(p, upper ^ other[p.name]) for p in ports})
        for p in block.inputs:
            if mixed and rng.random() < 0.4:
                ends[-1][p.name] = 0.5 * (p.low + p.high)
    at = range(3, steps, max(1, (steps - 3) // (len(ends) + len(cases))))
    for end, step in zip(ends, at, strict=False):
        for p in block.inputs:
            inputs[p.name][step] = single(end[p.name])
    together = [{p.name: single(np.full(p.size, end[p.name])) for p in block.state} for end in ends]
    for k, case in enumerate(together[1::2]):
        case |= {c: np.array(top - k % 3) for c in counters}
    # An invalid input in the very step whose state is corrupt: nothing is left to be held.
    for step in list(at)[len(ends) :: 6]:
        for p in block.inputs:
            inputs[p.name][step] = np.nan
    cases = together + cases
    return Stream("at the limits", inputs, dict(zip(at, cases, strict=False)))


def other_memories(
    block: Block, dtype: npt.DTypeLike = np.float32, seed: int = 2, steps: int = 3000
) -> list[Stream]:
    """A Block with another memory: other coefficients, and states that only a long past brings.

    Not part of :func:`streams` either: the derived bounds are those of the default tunables.

    return: for a Block with tunables one stream at the limits, with coefficients prepared from
        tunables at their ends; :func:`esea_gen.verify.events.memories`; and, starting from the
        states of these and of :func:`streams`, :func:`esea_gen.verify.ties.aimed_stream`; and each
        counter at its end, alone.
    """
    from esea_gen.verify.events import memories
    from esea_gen.verify.ties import aimed_stream

    found = memories(block, dtype, seed) + _full_counters(block, seed)
    found += aimed_stream(
        block, [*streams(block, steps=1000), *memories(block, dtype, seed)], dtype
    )
    if not block.tunables:
        return found
    rng = np.random.default_rng(seed)
    sets = list(product(*((t.low, t.high) for t in block.tunables[:3])))
    changes: dict[int, dict[str, Array]] = {}
    for k, ends in enumerate(rng.permutation(sets)):
        # The first three in every combination of their ends, the rest at random.
        rest = [rng.choice([t.low, t.high, t.default]) for t in block.tunables[3:]]
        prepared = block.prepare.call([ca.DM(v) for v in (*ends, *rest)])
        changes[k * steps // len(sets)] = {
            p.name: single(np.asarray(v, dtype=float).ravel())
            for p, v in zip(block.coefficients, prepared, strict=True)
        }
    base = at_the_limits(block, dtype, seed, steps)
    return [Stream("tunables at their ends", base.inputs, base.injections, changes), *found]


def _full_counters(block: Block, seed: int) -> list[Stream]:
    # One counter at its end and the others at 0, while the Block does what it does.
    names = [f"n_{f.name.lower()}" for q in block.outputs for f in q.flags if f.counted]
    out = []
    for stream in streams(block, seed, 600) if names else ():
        if stream.name in ("corrupt states", "chirp", "random walk"):
            continue
        cases = {}
        for k, step in enumerate(range(10, stream.steps, 30)):
            full = names[k % len(names)]
            cases[step] = {n: np.array(2**32 - 1 if n == full else 0) for n in names}
        both = {
            k: cases.get(k, {}) | stream.injections.get(k, {})
            for k in sorted({*cases, *stream.injections})
        }
        out.append(Stream(f"{stream.name}, counters at their ends", stream.inputs, both))
    return out


def _end(port: Port, upper: bool) -> float:
    # The lower end of a range that starts at zero is no extreme: take the upper one.
    return port.high if upper or port.low == 0 else port.low
