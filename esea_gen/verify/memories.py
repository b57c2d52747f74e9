"""Streams with altered states and coefficients, compared bit by bit.

Distant operands do not test a threshold. From states that the Block has been in, one input or state
is moved until both are equal or differ by one unit in the last place; a stream is stored if it
shows an inverted decision.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import casadi as ca
import joblib
import numpy as np
import numpy.typing as npt

from esea_gen.emit.formats import FORMATS, Format
from esea_gen.emit.walker import Kernel
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.stream import Stream, single
from esea_gen.verify.executor import (
    coefficients_of,
    emitted_kernel,
    evaluate,
    initial_state,
    step_arguments,
    told_otherwise,
)
from esea_gen.verify.runs import run_symbolic
from esea_gen.verify.streams import at_the_limits, streams


def other_memories(
    block: Block, dtype: npt.DTypeLike = np.float32, seed: int = 2, steps: int = 3000
) -> list[Stream]:
    """Other coefficients, and states that only a long past brings."""
    own = block.streams.memories(block, np.dtype(dtype), np.random.default_rng(seed))
    found = [*own, *_full_counters(block, seed)]
    found += aimed_stream(block, [*streams(block, steps=1000), *own], dtype)
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


def _full_counters(block: Block, seed: int) -> Iterator[Stream]:
    # One counter at its end and the others at 0, while the Block does what it does.
    names = [f"n_{f.name.lower()}" for q in block.outputs for f in q.flags if f.counted]
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
        yield Stream(f"{stream.name}, counters at their ends", stream.inputs, both)


AIMED = frozenset({"lt", "le", "fmin", "fmax"})
ITERATIONS = 6
SEED, TRIALS = 5, 8
# Ties looked for, for each one that is wanted: most do not show.
SEARCHED = 8
FEWEST, MOST = 600, 6000
ROUNDS = 4  # the later ones for what still lacks some
# Beside a threshold, and less than the percent by which one may be wrong.
SHARE = 4e-3


def aimed_stream(
    block: Block, tried: Sequence[Stream], dtype: npt.DTypeLike = np.float32
) -> list[Stream]:
    """A stream of single steps, each near a tie of one decision of a Block."""
    aim = _Aim.at(block, next(f for f in FORMATS.values() if f.dtype == np.dtype(dtype)))
    digest = aim.digest(tried)
    if digest not in _FOUND:  # of an equal Block, as devices share them
        _FOUND[digest] = _aimed(aim, tried)
    return _FOUND[digest]


_FOUND: dict[str, list[Stream]] = {}


def _aimed(aim: _Aim, tried: Sequence[Stream]) -> list[Stream]:
    rng = np.random.default_rng(SEED)
    pool = _pool(aim, tried, rng)
    if not pool:
        return []
    cones = _cones(aim.kernel, aim.first)
    lacking = dict.fromkeys(aim.decisions, TRIALS)
    steps: list[list[Array]] = []
    for _ in range(ROUNDS):
        wanted = [i for i, n in lacking.items() if n > 0]
        if not wanted:
            break
        count = int(np.clip(SEARCHED * TRIALS * len(wanted), FEWEST, MOST))
        rows = rng.integers(len(pool[0]), size=count)
        # Rounded before, so that the tie is one of the numbers that the stream holds.
        start = [single(p[rows]) for p in pool]
        aims = np.resize(rng.permutation(wanted), count)
        found = (frozenset().union(*(cones[a] for a in aim.kernel.nodes[i].args)) for i in aims)
        moved = [sorted(x)[int(rng.integers(len(x)))] for x in found]
        search = _Search(aim, start, aims, moved, rng)
        ties = search.ties()
        shown = ties & search.shows()
        chosen: list[int] = []
        for i in wanted:
            good, rest = (np.flatnonzero(x & (aims == i)) for x in (shown, ties & ~shown))
            chosen += [*good[: lacking[i]], *rest[: 0 if len(good) else 2]]
            lacking[i] -= len(good)
        steps += search.near(np.array(chosen, dtype=int))
    return _steps(aim, steps)


@dataclass(frozen=True)
class _Aim:
    # What is aimed at: a Block's step as one format prints it.
    block: Block
    fmt: Format
    kernel: Kernel
    decisions: list[int]
    coefficients: list[Array]

    @classmethod
    def at(cls, block: Block, fmt: Format) -> _Aim:
        kernel, _ = emitted_kernel(block, fmt)
        cones = _cones(kernel, len(block.coefficients))
        decisions = [
            i for i, n in enumerate(kernel.nodes) if n.op in AIMED and any(cones[a] for a in n.args)
        ]
        return cls(block, fmt, kernel, decisions, coefficients_of(block, fmt, {}))

    def digest(self, tried: Sequence[Stream]) -> str:
        # Of all that the search reads.
        exact = coefficients_of(self.block, FORMATS["f64"], {})
        memory = exact, initial_state(self.block, FORMATS["f64"], exact)
        content = self.fmt.name, self.kernel, self.ports, self.coefficients, memory, tried
        return str(joblib.hash(content))

    @property
    def first(self) -> int:
        return len(self.block.coefficients)

    @property
    def ports(self) -> tuple[Port, ...]:
        return (*self.block.state, *self.block.inputs)

    def nodes(self, arguments: Sequence[Array], own: bool = False) -> list[Array]:
        # Every value, in float64 or in the format's own arithmetic.
        full = [np.tile(c, (len(arguments[0]), 1)) for c in self.coefficients] + [*arguments]
        return evaluate(self.kernel, self.fmt if own else FORMATS["f64"], full)


def _pool(aim: _Aim, tried: Sequence[Stream], rng: np.random.Generator) -> list[Array]:
    # Any step of the given streams that lies within all ports' ranges.
    found: list[list[Array]] = []
    for stream in tried:
        if stream.coefficients:
            continue
        _, states = run_symbolic(aim.block, stream)
        arguments = step_arguments(aim.block, stream, states, FORMATS["f64"])[aim.first :]
        inside = np.all(
            [
                np.all((a >= p.low) & (a <= p.high), axis=1)
                for p, a in zip(aim.ports, arguments, strict=True)
            ],
            axis=0,
        )
        chosen = np.flatnonzero(inside)
        if len(chosen):
            chosen = rng.choice(chosen, min(len(chosen), 400), replace=False)
            found.append([a[chosen] for a in arguments])
    return [np.concatenate([p[k] for p in found]) for k in range(len(aim.ports))] if found else []


class _Search:
    # Many ties at once: per row one decision, and one element of an argument that is moved.

    def __init__(
        self,
        aim: _Aim,
        start: list[Array],
        aims: npt.NDArray[Any],
        moved: list[tuple[int, int]],
        rng: np.random.Generator,
    ) -> None:
        self.aim, self.start, self.aims, self.rng = aim, start, aims, rng
        self.moved = np.array([(argument - aim.first, element) for argument, element in moved])
        own = [aim.ports[k] for k, _ in self.moved]
        self.low, self.high = np.array([p.low for p in own]), np.array([p.high for p in own])
        self.at = np.array([start[k][row, e] for row, (k, e) in enumerate(self.moved)])
        self.slope = np.zeros(len(aims))
        self.size = np.zeros(len(aims))

    def arguments(self, values: Array, rows: npt.NDArray[Any]) -> list[Array]:
        out = [a[rows].copy() for a in self.start]
        for k in np.unique(self.moved[rows, 0]):
            hit = np.flatnonzero(self.moved[rows, 0] == k)
            out[k][hit, self.moved[rows[hit], 1]] = values[hit]
        return out

    def operands(
        self, values: Array, rows: npt.NDArray[Any], own: bool = False
    ) -> tuple[Array, Array]:
        nodes = self.aim.nodes(self.arguments(values, rows), own=own)
        kind = self.aim.fmt.dtype if own else np.dtype(float)
        a, b = np.zeros(len(rows), kind), np.zeros(len(rows), kind)
        for i in np.unique(self.aims[rows]):
            hit = self.aims[rows] == i
            first, second = self.aim.kernel.nodes[i].args
            a[hit], b[hit] = nodes[first][hit], nodes[second][hit]
        return a, b

    def ties(self) -> npt.NDArray[np.bool_]:
        # By secants, in float64, from any step towards the tie.
        every, x0 = np.arange(len(self.aims)), self.at
        reach = 10.0 ** self.rng.uniform(-6, 0, len(every)) * (self.high - self.low)
        x1 = np.clip(x0 + self.rng.uniform(-1, 1, len(every)) * reach, self.low, self.high)
        with np.errstate(all="ignore"):
            a, b = self.operands(x0, every)
            d0 = a - b
            far = np.abs(d0)
            for _ in range(ITERATIONS):
                a, b = self.operands(x1, every)
                d1 = a - b
                slope = (d1 - d0) / (x1 - x0)
                step = d1 / slope
                self.slope = np.where(np.isfinite(step) & (step != 0), slope, self.slope)
                better = np.where(np.isfinite(step), x1 - step, x1)
                x0, d0, x1 = x1, d1, np.clip(better, self.low, self.high)
            a, b = self.operands(x1, every)
            # Beside a zero, a share of how far apart they were.
            self.at, self.size = x1, np.where(b == 0, 0.1 * far, np.abs(b))
            room = np.maximum(np.abs(d0) + np.abs(x1), 1e-3)
            return np.asarray(np.abs(a - b) <= 1e-6 * room)

    def beside(self, rows: npt.NDArray[Any], side: Array) -> Array:
        # Where the operands are a small share of the second one apart.
        with np.errstate(all="ignore"):
            step = side * SHARE * self.size[rows] / self.slope[rows]
        found = self.at[rows] + np.where(np.isfinite(step), step, 0.0)
        return np.asarray(single(np.clip(found, self.low[rows], self.high[rows])))

    def shows(self) -> npt.NDArray[np.bool_]:
        # Whether the step gives another result when the decision is the other one.
        kernel = self.aim.kernel
        aimed = {i: np.flatnonzero(self.aims == i) for i in self.aim.decisions}
        moved = self.at.copy()
        for i, rows in aimed.items():
            if not kernel.nodes[i].boolean:  # at the tie a minimum is either operand
                moved[rows] = self.beside(rows, self.rng.choice([-1.0, 1.0], len(rows)))
        nodes = self.aim.nodes(self.arguments(moved, np.arange(len(moved))))
        out = np.zeros(len(self.aims), dtype=bool)
        for i, rows in aimed.items():
            own = [v[rows] for v in nodes]
            if kernel.nodes[i].boolean:
                ways = [np.zeros(len(rows)), np.ones(len(rows))]
            else:
                ways = [own[a] for a in kernel.nodes[i].args]
            one, other = (told_otherwise(kernel, FORMATS["f64"], own, i, w) for w in ways)
            for k in (k for r in kernel.results for k in r):
                out[rows] |= one[k].astype(float) != other[k].astype(float)
        return out

    def near(self, rows: npt.NDArray[Any]) -> list[list[Array]]:
        # Arguments of the steps round the ties, row by row.
        kind = self.aim.fmt.dtype
        tie = _ordered(self.at[rows].astype(kind))
        doubling = 1 << np.arange(3, 20 if kind.itemsize == 4 else 48)
        offsets = np.array([0, *range(1, 8), *doubling])
        best = {s: (np.full(len(rows), np.inf), self.at[rows]) for s in (-1, 0, 1)}
        offsets = np.concatenate([offsets, -offsets[1:]])
        values = _number(tie + offsets[:, None], kind).astype(float)
        inside = (values >= self.low[rows]) & (values <= self.high[rows])
        values = np.where(inside, values, self.at[rows].astype(kind))
        a, b = self.operands(values.ravel(), np.tile(rows, len(offsets)), own=True)
        apart = (_ordered(a) - _ordered(b)).reshape(values.shape)
        for value, within, distance in zip(values, inside, apart, strict=True):
            for side, (least, held) in best.items():
                closer = within & (np.sign(distance) == side) & (np.abs(distance) < least)
                best[side] = (
                    np.where(closer, np.abs(distance), least),
                    np.where(closer, value, held),
                )
        either = self.rng.choice([-1.0, 1.0], len(rows))
        columns = [held for _, held in best.values()] + [self.beside(rows, either)]
        known = [np.isfinite(least) for least, _ in best.values()] + [np.ones(len(rows), bool)]
        out = []
        given = [self.arguments(c, rows) for c in columns]
        for k in range(len(rows)):
            out += [[a[k] for a in g] for g, ok in zip(given, known, strict=True) if ok[k]]
        return out


def _ordered(x: Array) -> npt.NDArray[np.int64]:
    # Whole numbers in the order of the format's numbers, neighbours one apart; both zeros are 0.
    kind = np.int32 if x.dtype.itemsize == 4 else np.int64
    raw = x.view(kind).astype(np.int64)
    return np.asarray(np.where(raw < 0, np.iinfo(kind).min - raw, raw))


def _number(i: npt.NDArray[np.int64], dtype: np.dtype[Any]) -> Array:
    kind = np.int32 if dtype.itemsize == 4 else np.int64
    return np.where(i < 0, np.iinfo(kind).min - i, i).astype(kind).view(dtype)


def _cones(kernel: Kernel, first: int) -> list[frozenset[tuple[int, int]]]:
    # Per node, the elements of states and inputs that its number depends on.  What only decides
    # between numbers is left out: moving it a little moves nothing.
    out: list[frozenset[tuple[int, int]]] = []
    for n in kernel.nodes:
        if n.op == "input":
            out.append(frozenset({n.source} if n.source[0] >= first else ()))
        elif n.boolean:
            out.append(frozenset())
        else:
            moving = n.args[1:] if n.op in ("if_else_zero", "select") else n.args
            out.append(frozenset().union(*(out[a] for a in moving)))
    return out


def _steps(aim: _Aim, rows: list[list[Array]]) -> list[Stream]:
    if not rows:
        return []
    count = len(aim.block.state)
    injections = {
        k: {p.name: row[i] for i, p in enumerate(aim.block.state)} for k, row in enumerate(rows)
    }
    inputs = {}
    for i, p in enumerate(aim.block.inputs):
        column = np.array([row[count + i] for row in rows])
        inputs[p.name] = column[:, 0] if p.size == 1 else column
    return [Stream("aimed at every decision", inputs, injections if count else {})]
