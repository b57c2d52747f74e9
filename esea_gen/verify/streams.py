"""Input streams that try a Block: ordinary, nasty, invalid and recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from esea_gen.device import Device
from esea_gen.emit.step_errors import counts
from esea_gen.language.block import Block
from esea_gen.language.component import Component
from esea_gen.language.ports import Array, Port
from esea_gen.language.stream import SPECIAL, Stream, single
from esea_gen.language.system import External, System, Task


def _shape(port: Port, steps: int) -> tuple[int, ...]:
    return (steps,) if port.size == 1 else (steps, port.size)


def _spread(port: Port, column: Array) -> Array:
    # The same in every element.
    return column if port.size == 1 else np.tile(column[:, None], (1, port.size))


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
    return single(_spread(port, wave))


def _thresholds(rng: np.random.Generator, block: Component, port: Port, steps: int) -> Array:
    # Ends of the range, constants of the Block that have the port's unit and multiples of them,
    # their float neighbours, zeros of both signs, subnormals.
    marks = [port.low, port.high, 0.0, -0.0, 1e-45, -1e-45, 1.2e-38]
    for c in block.constants:
        if c.unit == port.unit:
            marks += [k * s * c.value for k in range(1, 12) for s in (-1, 1)]
    for f in (p for p in block.outputs if p.flags):
        marks += [s * x.threshold for x in f.flags for s in (-1, 1)]
    values = np.asarray(marks, dtype=np.float32)
    beside = [np.nextafter(values, np.float32(end)) for end in (np.inf, -np.inf)]
    around = np.concatenate([values, *beside]).astype(np.float64)
    around = around[(around >= port.low) & (around <= port.high)]
    return _spread(port, np.repeat(rng.choice(around, steps), rng.integers(1, 4, steps))[:steps])


def _whole(port: Port, values: Array) -> Array:
    return np.rint(values) + 0.0 if counts(port) or port.whole else values


def streams(block: Component, seed: int = 1, steps: int = 3000) -> list[Stream]:
    """The streams of a Block: generated ones, and those it brings along."""
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
        return _spread(p, single(0.5 * (p.low + p.high) + 0.5 * (p.high - p.low) * held))

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
    # Each input moves without regard to the others and to what a joint can do.
    found = [replace(s, rough=True) for s in found]
    return [*found, *block.streams.events(block, np.random.default_rng(seed))]


def inside(stream: Stream, limits: Mapping[str, tuple[float, float]]) -> bool:
    return all(
        bool(np.all((stream.inputs[k] >= low) & (stream.inputs[k] <= high)))
        for k, (low, high) in limits.items()
        if k in stream.inputs
    )


def at_the_limits(
    block: Block, dtype: npt.DTypeLike = np.float32, seed: int = 1, steps: int = 3000
) -> Stream:
    """Inputs, states and counters at their limits and one unit in the last place to either side."""
    rng = np.random.default_rng(seed)

    inputs = {}
    for p in block.inputs:
        slow = _walk(rng, p, steps, 0.55, 0.01)
        slow = np.rint(slow) if p.whole else slow
        hit = rng.random(slow.shape) < 0.2
        slow[hit] = rng.choice(_around(block, p, dtype), int(hit.sum()))
        inputs[p.name] = slow
    cases = list(_states_at_limits(rng, block, dtype))
    counters = [f"n_{f.name.lower()}" for q in block.outputs for f in q.flags if f.counted]
    top = 2**32 - 1
    cases += [{c: np.array(top - k)} for c in counters for k in (0, 1, 40)]
    for _ in range(40):
        drawn = {p.name: single(rng.uniform(p.low, p.high, p.size)) for p in block.state}
        wholes = {p.name for p in block.state if p.whole}
        cases.append({n: np.rint(x) if n in wholes else x for n, x in drawn.items()})
    rng.shuffle(cases)
    # States and inputs at ends together, the same and mixed, so that sums and clips meet theirs;
    # inputs in their middle too, and just short of the ends.
    ports = (*block.inputs, *block.state)
    ends = []
    for k in range(120):
        upper, mixed, near = k % 2 == 1, k > 3, 1.0 if k < 64 else rng.uniform(0.97, 1.0)
        other = {p.name: mixed and rng.random() < 0.5 for p in ports}
        scale = {p.name: 1.0 if p.whole else near for p in ports}
        ends.append({p.name: scale[p.name] * _end(p, upper ^ other[p.name]) for p in ports})
        for p in block.inputs:
            if mixed and rng.random() < 0.4:
                ends[-1][p.name] = p.low if p.whole else 0.5 * (p.low + p.high)
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


def _around(block: Block, p: Port, dtype: npt.DTypeLike) -> Array:
    # Numbers at and beside the ends of a port's range.
    if p.kind == "flag":
        return np.array([0.0, 1.0, 2.0, -1.0])
    if p.kind == "count":
        return np.array([p.low - 1, p.low, p.low + 1, p.high - 1, p.high, p.high + 1])
    ends = [p.low, p.high, 0.0, 1e-3 * p.high]
    # Where an output of the same unit is clipped or flagged: a state can reach that exactly.
    ends += [x for q in block.outputs if q.unit == p.unit for x in (q.low, q.high)]
    marks = np.array([x for x in dict.fromkeys(ends) if p.low <= x <= p.high], dtype=dtype)
    sides = [np.nextafter(marks, np.full_like(marks, s * np.inf)) for s in (-1, 1)]
    return np.concatenate([marks, *sides]).astype(np.float64)


def _states_at_limits(
    rng: np.random.Generator, block: Block, dtype: npt.DTypeLike
) -> Iterator[dict[str, Array]]:
    for p in block.state:
        for element in range(p.size):
            for value in _around(block, p, dtype):
                state = np.full(p.size, p.init)
                state[element] = value
                # Among states as they are, and alone: nothing then moves it off the limit.
                rest = {q.name: np.full(q.size, q.init) for q in block.state}
                yield {p.name: state}
                yield rest | {p.name: state}
        if p.size > 1:
            # The guard of a vector sums magnitudes: come close to its limit from both sides.
            total = float(np.float32(1.001 * p.size * max(abs(p.low), abs(p.high))))
            limit = np.array([total], dtype)
            for value in (limit, np.nextafter(limit, 0), np.nextafter(limit, 2 * limit)):
                state = np.zeros(p.size)
                state[int(rng.integers(p.size))] = value[0]
                yield {p.name: state}
            for element in range(p.size):
                for value in (1.01 * total, -1.01 * total):
                    state = np.zeros(p.size)
                    state[element] = single(value)
                    yield {p.name: state}
            for share in (0.999999, 1.000001):
                weights = rng.dirichlet(np.ones(p.size)) * rng.choice([-1, 1], p.size)
                yield {p.name: np.asarray(weights * total * share, dtype).astype(float)}


def _end(port: Port, upper: bool) -> float:
    # The lower end of a range that starts at zero is no extreme: take the upper one.
    return port.high if upper or port.low == 0 else port.low


# -- devices and whole systems ---------------------------------------------------------------------


def domain_chirp(device: Device, duration_s: float = 8.0) -> Array:
    """A deflection chirp that stays inside the identified domain, shape (steps,)."""
    theta = 0.95 * device.file.domain.theta_max_rad.value
    rate = 0.8 * device.file.domain.omega_max_rad_s.value
    t = np.arange(0.0, duration_s, device.period_s)
    top_Hz = rate / (2 * np.pi * theta)
    return single(theta * np.sin(np.pi * top_Hz * t * t / duration_s))


def recorded_stream(device: Device, theta_rad: Array, name: str = "recorded") -> dict[str, Stream]:
    """A recorded deflection as a stream for each Block that it reaches, wired as in the System."""
    theta = single(theta_rad)
    rates, _ = device.velocity.simulator().run({"theta_rad": theta})
    given = {"theta_rad": theta, "omega_rad_s": single(rates["omega_mid_rad_s"])}
    found = {"velocity": Stream(name, {"theta_rad": theta}), "sensor": Stream(name, given)}
    for block in device.system.kinds:
        if block.name == "smoothing":
            smooth, _ = block.simulator().run(given)
            found["smoothing"] = Stream(name, given)
            theta = single(smooth["theta_smooth_rad"])
            found["sensor"] = Stream(name, given | {"theta_rad": theta})
    return found


def deflection_inputs(
    system: System, theta_rad: npt.ArrayLike, task: Task | None = None
) -> dict[str, Array]:
    """One deflection for every axis of a task of a measuring System; default: its first task."""
    theta = single(theta_rad)

    def given(x: External) -> Array:
        if x.name.startswith("count_motor"):
            full = x.port.high + 1
            return single(np.floor(np.float64(theta) / (2 * np.pi) * full) % full)
        return 0 * theta if x.name.startswith(("count_", "frame_error_")) else theta

    return {x.name: given(x) for x in system.task_inputs(task or system.tasks[0])}


def first_axis(system: System, outputs: Mapping[str, Array]) -> dict[str, Array]:
    """The outputs of a task's first sensor, under the names of its Block's ports."""
    found = system.task_outputs(system.tasks[0])
    instance = next(x.signals[0].instance for x in found if x.signals[0].port == "tau_Nm")
    return {x.signals[0].port: outputs[x.name] for x in found if x.signals[0].instance == instance}


def working_inputs(system: System, task: Task, steps: int) -> dict[str, Array]:
    """Inputs of a task under which a controlling System works: encoders move, a law acts."""
    t = np.arange(float(steps))
    found = {}
    for i, x in enumerate(system.task_inputs(task)):
        name = x.name
        if name.startswith("count"):
            value = np.floor(0.02 * x.port.high * (1 + np.sin(t / 150 + 0.9 * i)))
        elif name.startswith("frame_error"):
            value = np.where((t > 0) & (t % 211 == 7 * i), 1.0, 0.0)
        elif name == "mode":
            value = np.where(t < 60, 0.0, 1.0 + (t // 300) % 2)
        elif name == "rearm":
            value = np.where(t < 30, 0.0, 1.0)
        elif name == "stop":
            value = np.where(t > steps - 50, 1.0, 0.0)
        else:
            value = 0.2 * x.port.high * np.sin(t / (37 + 5 * i))
        found[name] = single(_spread(x.port, value))
    return found
