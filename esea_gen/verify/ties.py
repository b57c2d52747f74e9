"""Streams that aim at the decisions of a Block: where a threshold a little off would show.

A comparison, minimum or maximum whose operands are far apart tells nothing of its threshold.  So
for each one, from states that its Block has been in, one input or state is moved until both
operands meet, and then a little to either side.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from esea_gen.block import Array, Block, Port
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.walker import Kernel
from esea_gen.verify.streams import Stream, single

AIMED = frozenset({"lt", "le", "fmin", "fmax"})
# Beside the tie itself: units in the last place, and shares of the moved value's range.
SIDES_ULP = (-2, 2)
SIDES_SHARE = (-1e-3, 1e-3, -1e-5, 1e-5)
ITERATIONS = 6


def aimed_stream(
    block: Block,
    tried: Sequence[Stream],
    dtype: npt.DTypeLike = np.float32,
    seed: int = 5,
    trials: int = 8,
) -> list[Stream]:
    """A stream of single steps, each near a tie of one decision of a Block.

    Parameters
    ----------
    block : Block
        The Block, at its default tunables.
    tried : sequence of Stream
        Whose states and inputs it starts from.
    dtype : dtype
        The format whose neighbouring numbers are meant.
    seed : int
        Seed of the choices.
    trials : int
        Ties looked for of each decision; each that is found gives three steps.

    Returns
    -------
    list of Stream
        The stream; none when no decision could be aimed at.
    """
    from esea_gen.verify.equivalence import run_symbolic
    from esea_gen.verify.executor import (
        coefficients_of,
        emitted_kernel,
        evaluate,
        initial_state,
        step_arguments,
    )

    fmt = FORMATS["f64"]
    kernel, _ = emitted_kernel(block, fmt)
    ports = (*block.state, *block.inputs)
    first = len(block.coefficients)
    cones = _cones(kernel, first)
    decisions = [
        i for i, n in enumerate(kernel.nodes) if n.op in AIMED and any(cones[a] for a in n.args)
    ]
    if not decisions:
        return []
    rng = np.random.default_rng(seed)
    trials = max(300, min(1600, trials * len(decisions)))
    coefficients = coefficients_of(block, fmt, {})
    initial = initial_state(block, fmt, coefficients)
    # Any step of the given streams that lies within all ports' ranges.
    pool: list[list[Array]] = []
    for stream in tried:
        if stream.coefficients:
            continue
        _, states = run_symbolic(block, stream)
        arguments = step_arguments(block, stream, states, initial, coefficients, fmt)[first:]
        inside = np.all(
            [
                np.all((a >= p.low) & (a <= p.high), axis=1)
                for p, a in zip(ports, arguments, strict=True)
            ],
            axis=0,
        )
        chosen = np.flatnonzero(inside)
        if len(chosen):
            chosen = rng.choice(chosen, min(len(chosen), 400), replace=False)
            pool.append([a[chosen] for a in arguments])
    if not pool:
        return []
    base = [np.concatenate([p[k] for p in pool]) for k in range(len(ports))]
    rows = rng.integers(len(base[0]), size=trials)
    # Rounded before, so that the tie is one of the numbers that the stream holds.
    start = [single(b[rows]) for b in base]
    aims = np.resize(rng.permutation(decisions), trials)
    moved = [_pick(rng, cones, kernel.nodes[i].args) for i in aims]

    def gap(values: Array) -> tuple[Array, list[Array]]:
        arguments = [a.copy() for a in start]
        for k, (argument, element) in enumerate(moved):
            arguments[argument - first][k, element] = values[k]
        full = [np.tile(c, (trials, 1)) for c in coefficients] + arguments
        nodes = evaluate(kernel, fmt, full)
        pairs = [kernel.nodes[i].args for i in aims]
        found = [float(nodes[a][k]) - float(nodes[b][k]) for k, (a, b) in enumerate(pairs)]
        return np.array(found), arguments

    own: list[Port] = [ports[argument - first] for argument, _ in moved]
    low, high = np.array([p.low for p in own]), np.array([p.high for p in own])
    x0 = np.array([start[a - first][k, e] for k, (a, e) in enumerate(moved)])
    x1 = np.clip(
        x0 + rng.uniform(-1, 1, trials) * 10.0 ** rng.uniform(-6, 0, trials) * (high - low),
        low,
        high,
    )
    d0, _ = gap(x0)
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            d1, _ = gap(x1)
            step = d1 * (x1 - x0) / (d1 - d0)
            better = np.where(np.isfinite(step), x1 - step, x1)
            x0, d0, x1 = x1, d1, np.clip(better, low, high)
        last, arguments = gap(x1)
        met = np.abs(last) <= 1e-6 * np.maximum(np.abs(d0) + np.abs(x1), 1e-3)
    return _steps(block, arguments, moved, x1, met, (low, high), dtype, rng)


def _cones(kernel: Kernel, first: int) -> list[frozenset[tuple[int, int]]]:
    # Per node, the elements of states and inputs that it depends on.
    out: list[frozenset[tuple[int, int]]] = []
    for n in kernel.nodes:
        if n.op == "input":
            out.append(frozenset({n.source} if n.source[0] >= first else ()))
        else:
            out.append(frozenset().union(*(out[a] for a in n.args)))
    return out


def _pick(
    rng: np.random.Generator, cones: list[frozenset[tuple[int, int]]], args: tuple[int, ...]
) -> tuple[int, int]:
    elements = sorted(frozenset().union(*(cones[a] for a in args)))
    return elements[int(rng.integers(len(elements)))]


def _steps(
    block: Block,
    arguments: list[Array],
    moved: list[tuple[int, int]],
    values: Array,
    met: Array,
    ends: tuple[Array, Array],
    dtype: npt.DTypeLike,
    rng: np.random.Generator,
) -> list[Stream]:
    first = len(block.coefficients)
    kind = np.dtype(dtype).type
    rows: list[list[Array]] = []
    for k in np.flatnonzero(met):
        argument, element = moved[k]
        tie = kind(values[k])
        sides = [float(tie)]
        for ulps in SIDES_ULP:
            x = tie
            for _ in range(abs(ulps)):
                x = np.nextafter(x, kind(np.copysign(np.inf, ulps)))
            sides.append(float(x))
        room = ends[1][k] - ends[0][k]
        sides += [float(single(values[k] + s * room)) for s in SIDES_SHARE]
        for x in (sides[0], *rng.choice(sides[1:], 2, replace=False)):
            row = [a[k].copy() for a in arguments]
            row[argument - first][element] = x
            rows.append(row)
    if not rows:
        return []
    count = len(block.state)
    injections = {
        k: {p.name: row[i] for i, p in enumerate(block.state)} for k, row in enumerate(rows)
    }
    inputs = {}
    for i, p in enumerate(block.inputs):
        column = np.array([row[count + i] for row in rows])
        inputs[p.name] = column[:, 0] if p.size == 1 else column
    return [Stream("aimed at every decision", inputs, injections if count else {})]
