"""Programs: kernels called in loops of bounded trip count, with static work memory.

A Block's step is one straight-line function.  A step with loops (a rollout over a horizon, a
quadratic program) is a Program: the same ports, tunables, ``prepare`` and ``init``, and a body made
of a few statements::

    call    a kernel (a CasADi function on scalars) on slices of arrays
    loop    a fixed number of times, or at most so many times with an exit
    when    one way or the other
    set     a whole number, which only indexes arrays
    invoke  a part of the body defined elsewhere

There is no heap, no recursion and no loop without a bound; every array is a port, a table of
constants, or work memory in the caller's state struct.  One description is run in Python
(:class:`ProgramSimulator`, float64, kernels by CasADi's evaluator) and printed as C, so that the
f64 C gives the executor's bits.  Kernels go through the same walker and printer as a Block's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.language.builder import Builder, array_name
from esea_gen.language.component import Component, Executor, PrepareFn, check_ports, start_functions
from esea_gen.language.ports import Array, Constant, Equation, Port, Tunable
from esea_gen.language.statements import (
    Call,
    Exit,
    Invoke,
    Memory,
    Part,
    ProgramError,
    Ref,
    SetIndex,
    Statement,
    When,
    walk_statements,
)
from esea_gen.language.stream import OwnStreams


@dataclass(frozen=True)
class Program(Component):
    """A unit like a Block, with a body of loops in place of one straight-line step.

    Build one with :meth:`define`.

    name, title, period_s, constants, tunables, coefficients, inputs, outputs, equations, streams:
    as in :class:`esea_gen.language.component.Component`. state: what one step leaves to the next,
    then the work arrays, which carry nothing. prepare, init: as there; ``init`` of what is carried.
    starts_latched: as there. memory: every array by name. parts: the body; ``step`` is the entry.
    """

    kind = "program"

    memory: Mapping[str, Memory] = field(repr=False)
    parts: Mapping[str, Part] = field(repr=False)

    @classmethod
    def define(
        cls,
        name: str,
        title: str,
        *,
        period_s: float,
        builder: Builder,
        inputs: tuple[Port, ...],
        outputs: tuple[Port, ...],
        state: tuple[Port, ...] = (),
        constants: tuple[Constant, ...] = (),
        tunables: tuple[Tunable, ...] = (),
        coefficients: tuple[Port, ...] = (),
        prepare: PrepareFn | None = None,
        equations: tuple[Equation, ...] = (),
        streams: OwnStreams | None = None,
    ) -> Program:
        """Build a Program.

        The builder must hold one array a port (see :func:`declare_ports`) and the part ``step``.
        """
        check_ports(name, title, period_s, tunables, coefficients, state, inputs, outputs)
        work = tuple(m.port for m in builder.memory.values() if m.region == "work")
        program = cls(
            name,
            title,
            period_s,
            constants,
            tunables,
            coefficients,
            state + work,
            inputs,
            outputs,
            equations,
            *start_functions(name, tunables, coefficients, state, prepare),
            dict(builder.memory),
            dict(builder.parts),
            streams=streams or OwnStreams(),
        )
        program._check()
        return program

    def _check(self) -> None:
        for region, ports in (
            ("coeffs", self.coefficients),
            ("state", self.carried),
            ("in", self.inputs),
            ("out", self.outputs),
        ):
            for p in ports:
                m = self.memory.get(array_name(region, p.name))
                if m is None or m.region != region or m.size != p.size:
                    raise ProgramError(f"{self.name}: no array for port {p.name}")
        if "step" not in self.parts:
            raise ProgramError(f"{self.name}: no part 'step'")
        for part in self.parts.values():
            for s in walk_statements(part.body):
                if not isinstance(s, Call):
                    continue
                for r in (*s.args, *s.results):
                    if r.array not in self.memory:
                        raise ProgramError(f"{self.name}: no array {r.array}")
                for r in s.results:
                    if self.memory[r.array].region in ("coeffs", "in", "table", "index"):
                        raise ProgramError(f"{self.name}: {s.kernel.name()} writes to {r.array}")

    @property
    def work(self) -> tuple[Memory, ...]:
        return tuple(m for m in self.memory.values() if m.region == "work")

    @property
    def carried(self) -> tuple[Port, ...]:
        return self.state[: len(self.state) - len(self.work)]

    @cached_property
    def index_tables(self) -> dict[str, tuple[int, ...]]:
        return {n: m.values for n, m in self.memory.items() if m.region == "index"}

    @property
    def kernels(self) -> dict[str, ca.Function]:
        """The kernels of the body by a name of their own: ``k1_copy``, ``k2_pivot`` ..."""
        found: dict[int, ca.Function] = {}
        for part in self.parts.values():
            for s in walk_statements(part.body):
                if isinstance(s, Call):
                    found.setdefault(id(s.kernel), s.kernel)
        return {f"k{i}_{f.name()}": f for i, f in enumerate(found.values(), 1)}

    def simulator(self, tunables: Mapping[str, float] | None = None) -> ProgramSimulator:
        return ProgramSimulator(self, tunables)


class _ExitLoopError(Exception):
    """A loop is left early."""


class ProgramSimulator(Executor):
    """Runs a Program in Python, float64, kernels by CasADi's evaluator."""

    def __init__(self, program: Program, tunables: Mapping[str, float] | None = None) -> None:
        super().__init__(program, tunables)
        self.program = program
        arrays: dict[str, Array] = {}
        for region, group in (
            ("coeffs", self._c),
            ("state", self._s),
            ("in", self._u),
            ("out", self._y),
        ):
            arrays |= {array_name(region, name): values for name, values in group.items()}
        for n, m in program.memory.items():
            if m.region == "work":
                arrays[n] = self._s[n]
            elif m.region in ("table", "index"):
                arrays[n] = np.array(m.values["f64"] if m.region == "table" else m.values, float)
            elif m.region == "local":
                arrays[n] = np.zeros(m.size)
        self.arrays = arrays
        # Work arrays may hold whole numbers that index others.
        self.tables: dict[str, Any] = arrays | program.index_tables
        self._buffers: dict[int, tuple[list[Array], list[Array], Callable[[], None], Any]] = {}
        self._code = {n: self._compile(p.body) for n, p in program.parts.items()}
        self.passes: dict[str, int] = {}
        self.reset()

    def array(self, name: str) -> Array:
        """A copy of an array as the last step left it."""
        return self.arrays[name].copy()

    def _advance(self) -> None:
        self._passed: dict[str, int] = {}
        indices: dict[str, int] = {}
        for s in self._code["step"]:
            s(indices)

    # -- the interpreter: statements become closures ---------------------------------------------

    def _compile(self, body: Sequence[Statement]) -> list[Callable[[dict[str, int]], None]]:
        return [self._closure(s) for s in body]

    def _closure(self, s: Statement) -> Callable[[dict[str, int]], None]:
        tables = self.tables
        if isinstance(s, Call):
            return self._call(s)
        if isinstance(s, SetIndex):
            var, value = s.var, s.value
            return lambda env: env.__setitem__(var, value.value(env, tables))
        if isinstance(s, Exit):
            array, start = self.arrays[s.flag.array], s.flag.start

            def exit_loop(env: dict[str, int]) -> None:
                if array[start.value(env, tables)] != 0:
                    raise _ExitLoopError

            return exit_loop
        if isinstance(s, Invoke):
            part, args = self.program.parts[s.part], s.args

            def invoke(env: dict[str, int]) -> None:
                inner = {n: a.value(env, tables) for n, a in zip(part.params, args, strict=True)}
                for f in self._code[part.name]:
                    f(inner)

            return invoke
        if isinstance(s, When):
            return self._when(s)
        loop, inside = s, self._compile(s.body)

        def run_loop(env: dict[str, int]) -> None:
            start, stop = loop.start.value(env, tables), loop.stop.value(env, tables)
            most = loop.most.value(env, tables)
            if stop - start > most:
                raise ProgramError(f"loop {loop.var}: {stop - start} passes, bound {most}")
            done = 0
            try:
                for i in range(start, stop):
                    env[loop.var] = i
                    done += 1
                    for f in inside:
                        f(env)
            except _ExitLoopError:
                pass
            self.passes[loop.var] = max(done, self.passes.get(loop.var, 0))
            if loop.total is not None:
                together = self._passed[loop.var] = self._passed.get(loop.var, 0) + done
                if together > loop.total:
                    raise ProgramError(
                        f"loop {loop.var}: {together} passes in a step, stated {loop.total}"
                    )

        return run_loop

    def _when(self, s: When) -> Callable[[dict[str, int]], None]:
        tables, then, other = self.tables, self._compile(s.then), self._compile(s.otherwise)
        flag = s.flag

        def true(env: dict[str, int]) -> bool:
            if isinstance(flag, Ref):
                return bool(self.arrays[flag.array][flag.start.value(env, tables)] != 0)
            left, right = flag[0].value(env, tables), flag[2].value(env, tables)
            return left < right if flag[1] == "<" else left == right

        def choose(env: dict[str, int]) -> None:
            for f in then if true(env) else other:
                f(env)

        return choose

    def _call(self, s: Call) -> Callable[[dict[str, int]], None]:
        key = id(s.kernel)
        if key not in self._buffers:
            buffer, evaluate = s.kernel.buffer()
            hold: Any = buffer
            a = [np.zeros(s.kernel.numel_in(i)) for i in range(s.kernel.n_in())]
            r = [np.zeros(s.kernel.numel_out(i)) for i in range(s.kernel.n_out())]
            for i, x in enumerate(a):
                hold.set_arg(i, memoryview(x))  # type: ignore[arg-type]
            for i, x in enumerate(r):
                hold.set_res(i, memoryview(x))  # type: ignore[arg-type]

            # The buffer must outlive its evaluator: it is kept beside it.
            self._buffers[key] = (a, r, evaluate, hold)
        a, r, go, _ = self._buffers[key]
        tables = self.tables
        # The arrays stay where they are: the view of a place serves every later step.
        reads = [(x, f, dict[int, Array]()) for x, f in zip(a, s.args, strict=True) if f.length]
        writes = [(x, f, dict[int, Array]()) for x, f in zip(r, s.results, strict=True) if f.length]

        def seen(f: Ref, k: int) -> Array:
            array, last = self.arrays[f.array], k + f.stride * (f.length - 1)
            if not (0 <= k < len(array) and 0 <= last < len(array)):
                raise ProgramError(f"{s.kernel.name()}: {f.array}[{k}..{last}] of {len(array)}")
            return array[k : last + 1 : f.stride]

        def call(env: dict[str, int]) -> None:
            for x, f, views in reads:
                k = f.start.value(env, tables)
                if k not in views:
                    views[k] = seen(f, k)
                x[:] = views[k]
            go()
            for x, f, views in writes:
                k = f.start.value(env, tables)
                if k not in views:
                    views[k] = seen(f, k)
                views[k][:] = x

        return call
