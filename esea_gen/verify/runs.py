"""A stream through a Block: through its C, CasADi's own C, its symbols, a Program's executor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import cffi
import numpy as np

from esea_gen.emit.formats.f64 import casadi_c
from esea_gen.files import template_folder
from esea_gen.hostlib.compiler import compile_sources
from esea_gen.hostlib.library import CRunner
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.program import Program
from esea_gen.language.stream import Stream
from esea_gen.language.system import System

# CasADi's own minimum and maximum of before C99, in place of libm's: bits are compared.
TIES = "casadi_ties.h"

Run = tuple[dict[str, Array], dict[str, Array]]  # outputs and states, per port


class CasadiOracle:
    """CasADi's own generated C of a System's Blocks, compiled for the host."""

    def __init__(self, system: System) -> None:
        self.stem = f"esea_{system.name}_casadi"
        files = {n.removeprefix("reference/"): t for n, t in casadi_c(system).items()}
        for name in ("casadi_loop.c", TIES):
            files[name] = (template_folder() / "verify" / name).read_text(encoding="utf-8")
        path = compile_sources(files, ("-include", TIES), ("-lm",))
        self.ffi = cffi.FFI()
        names = [f"{self.stem}_{b.name}_step" for b in system.kinds if b.kind == "block"]
        self.ffi.cdef(
            "void esea_casadi_run(int (*)(const double**, double**, int*, double*, int), "
            "const double**, double**, int*, double*, double*, const double*, size_t, double*, "
            "size_t, const double*, size_t, const double*, double*, double*, size_t);"
        )
        self.ffi.cdef(
            "".join(
                f"int {n}(const double**, double**, int*, double*, int);\n"
                f"int {n}_work(int*, int*, int*, int*);\n"
                for n in names
            )
        )
        self.lib: Any = self.ffi.dlopen(str(path))

    def run(
        self, block: Block, coefficients: list[Array], state: list[Array], stream: Stream
    ) -> Run:
        ffi, function = self.ffi, getattr(self.lib, f"{self.stem}_{block.name}_step")
        sizes = [ffi.new("int*") for _ in range(4)]
        getattr(self.lib, f"{self.stem}_{block.name}_step_work")(*sizes)
        c, (s, u, after, y) = (
            _Cells(block.coefficients),
            map(_Cells, (block.state, block.inputs, block.state, block.outputs)),
        )

        def pointers(cells: Sequence[_Cells], count: int, kind: str) -> Any:
            found = ffi.new(f"{kind} *[{max(count, 1)}]")
            for i, part in enumerate(p for group in cells for p in group.parts):
                found[i] = ffi.cast("double *", part.ctypes.data)
            return found

        def at(values: Array) -> Any:
            return ffi.cast("double *", values.ctypes.data)

        arguments = pointers((c, s, u), sizes[0][0], "const double")
        results = pointers((after, y), sizes[1][0], "double")
        iw = ffi.new(f"int[{max(sizes[2][0], 1)}]")
        w = ffi.new(f"double[{max(sizes[3][0], 1)}]")
        given = np.concatenate(
            [
                np.asarray(stream.inputs[p.name], np.float64).reshape(stream.steps, p.size)
                for p in block.inputs
            ],
            axis=1,
        )
        out = np.empty((stream.steps, len(y.values)))
        trace = np.empty((stream.steps, len(s.values)))
        prepared = [np.array(v, dtype=np.float64) for v in coefficients]
        c.put(dict(zip(c.names, prepared, strict=True)))
        s.put(dict(zip(s.names, state, strict=True)))
        for start, stop in _segments(stream):
            if start in stream.coefficients:
                values = changed(block, prepared, stream.coefficients[start])
                c.put(dict(zip(c.names, values, strict=True)))
            s.put(stream.injections.get(start, {}))
            self.lib.esea_casadi_run(
                *(function, arguments, results, iw, w),
                *(at(s.values), at(after.values), len(s.values), at(u.values), len(u.values)),
                *(at(y.values), len(y.values)),
                *(at(given[start:]), at(out[start:]), at(trace[start:]), stop - start),
            )
        return y.split(out), s.split(trace)


class _Cells:
    # The numbers of some ports, one after the other in one array.

    def __init__(self, ports: Sequence[Port]) -> None:
        self.ports, self.names = ports, [p.name for p in ports]
        ends = np.cumsum([0, *(p.size for p in ports)]).tolist()
        self.slices = [slice(a, b) for a, b in pairwise(ends)]
        self.values = np.zeros(ends[-1])
        self.parts = [self.values[x] for x in self.slices]

    def put(self, values: Mapping[str, Array]) -> None:
        for name, part in zip(self.names, self.parts, strict=True):
            if name in values:
                part[:] = values[name]

    def split(self, rows: Array) -> dict[str, Array]:
        # Columns by port.
        return {
            p.name: _flat(p, np.ascontiguousarray(rows[:, x]))
            for p, x in zip(self.ports, self.slices, strict=True)
        }


def _flat(p: Port, a: Array) -> Array:
    return a[:, 0] if p.size == 1 else a


def changed(block: Block, prepared: list[Array], values: Mapping[str, Array]) -> list[Array]:
    """Coefficients of a Block, as prepared, with some put in from outside."""
    return [
        np.asarray(values.get(p.name, c), dtype=c.dtype).reshape(c.shape)
        for p, c in zip(block.coefficients, prepared, strict=True)
    ]


def run_symbolic(block: Block, stream: Stream) -> Run:
    """A stream through the symbolic Block, at its default tunables."""
    simulator = block.simulator()
    prepared = list(simulator.coefficients.values())
    parts = []
    for start, stop in _segments(stream):
        if start in stream.coefficients:
            values = changed(block, prepared, stream.coefficients[start])
            names = (p.name for p in block.coefficients)
            simulator.coefficients = dict(zip(names, values, strict=True))
        if start in stream.injections:
            simulator.state = stream.injections[start]
        parts.append(simulator.run({k: v[start:stop] for k, v in stream.inputs.items()}))
    return _join(parts)


def run_executor(program: Program, stream: Stream) -> Run:
    simulator = program.simulator()
    y: dict[str, list[Array]] = {p.name: [] for p in program.outputs}
    s: dict[str, list[Array]] = {p.name: [] for p in program.state}
    for k in range(stream.steps):
        if k in stream.injections:
            simulator.state = stream.injections[k]
        for name, value in simulator.step(**{n: v[k] for n, v in stream.inputs.items()}).items():
            y[name].append(value)
        for name, value in simulator.state.items():
            s[name].append(value if len(value) > 1 else value[0])
    return {n: np.array(v, float) for n, v in y.items()}, {n: np.array(v) for n, v in s.items()}


def run_c(runner: CRunner, stream: Stream, restore: bool = False, raw: bool = False) -> Run:
    """A stream through the compiled Block, freshly initialised."""
    parts = []
    bounds = _segments(stream)
    if restore:
        middle = stream.steps // 2
        bounds = [
            piece
            for a, b in bounds
            for piece in ([(a, middle), (middle, b)] if a < middle < b else [(a, b)])
        ]
    prepared = [bytes(runner.library.ffi.buffer(c)) for c in runner._coeffs]
    for start, stop in bounds:
        if start in stream.coefficients:
            _put_coefficients(runner, prepared, stream.coefficients[start])
        if start in stream.injections:
            runner.put_state(stream.injections[start])
        elif restore and start:
            saved = runner.state
            runner.run({k: v[:7] for k, v in stream.inputs.items()}, trace=False)
            runner.reset()
            runner.state = saved
        piece = {k: v[start:stop] for k, v in stream.inputs.items()}
        parts.append(runner.run(piece, raw=raw))
    return _join(parts)


def changed_by_restore(
    runner: CRunner, stream: Stream, got: Run, *groups: Iterable[str], raw: bool = False
) -> list[str]:
    """Message on outputs and states that a stop and a restored state change."""
    again = run_c(runner, stream, restore=True, raw=raw)
    return [
        f"{name}: stop and restore changes it"
        for a, b, names in zip(got, again, groups, strict=True)
        for name in names
        if a[name].tobytes() != b[name].tobytes()
    ]


def not_finite(ports: Iterable[Port], values: Mapping[str, Array]) -> list[str]:
    """Message on values that are not numbers."""
    return [
        f"{p.name} is not finite"
        for p in ports
        if not np.all(np.isfinite(np.asarray(values[p.name], float)))
    ]


def _put_coefficients(runner: CRunner, prepared: list[bytes], values: Mapping[str, Array]) -> None:
    dtype = runner.library.dtype(f"{runner.stem}_coeffs_t")
    for held, before in zip(map(runner.library.ffi.buffer, runner._coeffs), prepared, strict=True):
        held[:] = before
        for name, value in values.items():
            np.frombuffer(held, dtype)[name] = value


def _segments(stream: Stream) -> list[tuple[int, int]]:
    cuts = sorted({0, stream.steps, *stream.injections, *stream.coefficients})
    return list(pairwise(cuts))


def _join(parts: list[Run]) -> Run:
    def cat(k: int) -> dict[str, Array]:
        return {name: np.concatenate([p[k][name] for p in parts]) for name in parts[0][k]}

    return cat(0), cat(1)
