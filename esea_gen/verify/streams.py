"""Input streams that try a Block: ordinary, nasty, invalid and recorded.

Every valid sample is a float32 number, so that all number formats are given the same input.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from esea_gen.block import Array, Block, Port

SPECIAL = (np.nan, np.inf, -np.inf, 3.4e38, -3.4e38)


@dataclass(frozen=True)
class Stream:
    """An input stream, with states put in from outside at some steps.

    Parameters
    ----------
    name : str
        What it tries.
    inputs : dict of str to ndarray
        Per input port: (steps,) or (steps, size), float64 values that float32 holds exactly.
    injections : dict of int to dict
        Before the step, ``{state port: value}`` overwrites the state.
    """

    name: str
    inputs: dict[str, Array]
    injections: dict[int, dict[str, Array]] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(next(iter(self.inputs.values())))


def single(values: npt.ArrayLike) -> Array:
    """Round to float32, kept as float64.

    Parameters
    ----------
    values : array_like
        Numbers.

    Returns
    -------
    ndarray
        Float64, each a float32 number.
    """
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


def streams(block: Block, seed: int = 1, steps: int = 3000) -> list[Stream]:
    """The generated streams of a Block.

    Parameters
    ----------
    block : Block
        What to try.
    seed : int
        Seed of the random ones.
    steps : int
        Length of each.

    Returns
    -------
    list of Stream
        Random walk, noise over the whole range, chirp, reversals, thresholds, jumps, invalid
        inputs, corrupt states.
    """
    rng = np.random.default_rng(seed)

    def each(make: object) -> dict[str, Array]:
        return {p.name: make(i, p) for i, p in enumerate(block.inputs)}  # type: ignore[operator]

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
    for k in range(20, steps, 40):
        p = block.state[int(rng.integers(len(block.state)))]
        value = single(rng.uniform(p.low, p.high, p.size))
        if rng.random() < 0.8:
            value[int(rng.integers(p.size))] = rng.choice([*SPECIAL, 1e6, -1e6, 3 * p.high + 1])
        injections[k] = {p.name: value}
    return [
        Stream("random walk", walk),
        Stream("noise over the range", noise),
        Stream("chirp", each(lambda i, p: _chirp(p, steps, 0.57, 0.7 * i))),
        Stream("reversals and plateaus", each(reversals)),
        Stream("thresholds", each(lambda _, p: _thresholds(rng, block, p, steps))),
        Stream("jumps", each(jumps)),
        Stream("invalid inputs", invalid),
        Stream("corrupt states", walk, injections),
    ]


def inside(stream: Stream, limits: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a stream's inputs stay inside ranges.

    Parameters
    ----------
    stream : Stream
        The stream.
    limits : mapping of str to (low, high)
        By input name.

    Returns
    -------
    bool
        False when any sample is outside or NaN.
    """
    return all(
        bool(np.all((stream.inputs[k] >= low) & (stream.inputs[k] <= high)))
        for k, (low, high) in limits.items()
        if k in stream.inputs
    )
