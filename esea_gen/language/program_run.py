"""The reference executor of a Program: Python, float64, kernels by CasADi's evaluator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.language.block import Array
from esea_gen.language.program import (
    Call,
    Invoke,
    Leave,
    Program,
    ProgramError,
    Ref,
    SetIndex,
    Statement,
    When,
    array_name,
)


class _LeaveError(Exception):
    """A loop is left early."""


class ProgramSimulator:
    """Runs a Program in Python, float64, kernels by CasADi's evaluator.

    tunables: values other than the defaults.
    """

    def __init__(self, program: Program, tunables: Mapping[str, float] | None = None) -> None:
        self.block = program
        values = program.default_tunables()
        for key, value in (tunables or {}).items():
            t = next((t for t in program.tunables if t.name == key), None)
            if t is None:
                raise ValueError(f"{program.name} has no tunable {key}; it has {list(values)}")
            if not t.low <= value <= t.high:
                raise ValueError(f"{key} = {value} is outside [{t.low}, {t.high}]")
            values[key] = float(value)
        self._arrays = {
            n: np.array(m.values["f64"]) if m.region == "table" else np.zeros(m.size)
            for n, m in program.memory.items()
            if m.region != "index"
        }
        # Work arrays may hold whole numbers that index others.
        self._tables: dict[str, Any] = dict(program.index_tables) | self._arrays
        prepared = program.prepare.call([ca.DM(v) for v in values.values()]) if values else []
        for p, c in zip(program.coefficients, prepared, strict=True):
            self._arrays[array_name("coeffs", p.name)][:] = np.asarray(c, dtype=float).ravel()
        self._buffers: dict[int, tuple[list[Array], list[Array], Callable[[], None], Any]] = {}
        self._code = {n: self._compile(p.body) for n, p in program.parts.items()}
        self.passes: dict[str, int] = {}
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        c = [self._arrays[array_name("coeffs", p.name)] for p in self.block.coefficients]
        initial = self.block.init.call([ca.DM(x) for x in c])
        for p, v in zip(self.block.carried, initial, strict=True):
            self._arrays[array_name("state", p.name)][:] = np.asarray(v, dtype=float).ravel()
        for m in self.block.work:
            self._arrays[m.name][:] = 0.0

    @property
    def coefficients(self) -> dict[str, Array]:
        """Coefficients prepared from the tunables."""
        return {
            p.name: self._arrays[array_name("coeffs", p.name)].copy()
            for p in self.block.coefficients
        }

    @property
    def state(self) -> dict[str, Array]:
        """A copy of the state, by name, work arrays included."""
        carried = {
            p.name: self._arrays[array_name("state", p.name)].copy() for p in self.block.carried
        }
        return carried | {m.name: self._arrays[m.name].copy() for m in self.block.work}

    @state.setter
    def state(self, values: Mapping[str, Any]) -> None:
        for p in self.block.carried:
            if p.name in values:
                given = np.asarray(values[p.name], dtype=float).ravel()
                self._arrays[array_name("state", p.name)][:] = given

    def array(self, name: str) -> Array:
        """A copy of a work array as the last step left it."""
        return self._arrays[name].copy()

    def step(self, **inputs: Any) -> dict[str, Any]:
        """One step.

        return: one value per output port: float, ndarray for a vector, int for a status word.
        """
        if set(inputs) != {p.name for p in self.block.inputs}:
            raise TypeError(
                f"{self.block.name}.step takes {[p.name for p in self.block.inputs]}, "
                f"got {sorted(inputs)}"
            )
        for p in self.block.inputs:
            self._arrays[array_name("in", p.name)][:] = inputs[p.name]
        self._passed: dict[str, int] = {}
        for s in self._code["step"]:
            s({})
        out: dict[str, Any] = {}
        for p in self.block.outputs:
            y = self._arrays[array_name("out", p.name)]
            if p.flags:
                out[p.name] = int(y[0])
            else:
                out[p.name] = float(y[0]) if p.size == 1 else y.copy()
        return out

    def run(self, inputs: Mapping[str, Any]) -> tuple[dict[str, Array], dict[str, Array]]:
        """Run over a stream, going on from the present state.

        inputs: one array per input port, shape (steps,) or (steps, size).
        return: one array per port: (steps,) for scalars, (steps, size) for vectors; the state is
            the one after each step.
        """
        rows = {k: np.asarray(v, dtype=float) for k, v in inputs.items()}
        steps = len(next(iter(rows.values())))
        y: dict[str, list[Any]] = {p.name: [] for p in self.block.outputs}
        s: dict[str, list[Any]] = {p.name: [] for p in self.block.state}
        for k in range(steps):
            for name, value in self.step(**{n: v[k] for n, v in rows.items()}).items():
                y[name].append(value)
            for name, value in self.state.items():
                s[name].append(value if len(value) > 1 else value[0])
        return (
            {n: np.array(v, dtype=float) for n, v in y.items()},
            {n: np.array(v) for n, v in s.items()},
        )

    # -- the interpreter: statements become closures ---------------------------------------------

    def _compile(self, body: Sequence[Statement]) -> list[Callable[[dict[str, int]], None]]:
        return [self._closure(s) for s in body]

    def _closure(self, s: Statement) -> Callable[[dict[str, int]], None]:
        tables = self._tables
        if isinstance(s, Call):
            return self._call(s)
        if isinstance(s, SetIndex):
            var, value = s.var, s.value
            return lambda env: env.__setitem__(var, value.value(env, tables))
        if isinstance(s, Leave):
            array, start = self._arrays[s.flag.array], s.flag.start

            def leave(env: dict[str, int]) -> None:
                if array[start.value(env, tables)] != 0:
                    raise _LeaveError

            return leave
        if isinstance(s, Invoke):
            part, args = self.block.parts[s.part], s.args

            def invoke(env: dict[str, int]) -> None:
                inner = {n: a.value(env, tables) for n, a in zip(part.params, args, strict=True)}
                for f in self._code[part.name]:
                    f(inner)

            return invoke
        if isinstance(s, When):
            return self._when(s)
        loop, inside = s, self._compile(s.body)

        def run(env: dict[str, int]) -> None:
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
            except _LeaveError:
                pass
            self.passes[loop.var] = max(done, self.passes.get(loop.var, 0))
            if loop.total is not None:
                together = self._passed[loop.var] = self._passed.get(loop.var, 0) + done
                if together > loop.total:
                    raise ProgramError(
                        f"loop {loop.var}: {together} passes in a step, stated {loop.total}"
                    )

        return run

    def _when(self, s: When) -> Callable[[dict[str, int]], None]:
        tables, then, other = self._tables, self._compile(s.then), self._compile(s.otherwise)
        flag = s.flag

        def true(env: dict[str, int]) -> bool:
            if isinstance(flag, Ref):
                return bool(self._arrays[flag.array][flag.start.value(env, tables)] != 0)
            left, right = flag[0].value(env, tables), flag[2].value(env, tables)
            return left < right if flag[1] == "<" else left == right

        def run(env: dict[str, int]) -> None:
            for f in then if true(env) else other:
                f(env)

        return run

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
        tables = self._tables
        reads = [(x, self._arrays[f.array], f) for x, f in zip(a, s.args, strict=True)]
        writes = [(x, self._arrays[f.array], f) for x, f in zip(r, s.results, strict=True)]

        def place(f: Ref, env: dict[str, int], size: int) -> slice:
            if f.length == 0:
                return slice(0, 0)
            k = f.start.value(env, tables)
            last = k + f.stride * (f.length - 1)
            if not (0 <= k < size and 0 <= last < size):
                raise ProgramError(f"{s.kernel.name()}: {f.array}[{k}..{last}] of {size}")
            return slice(k, last + 1, f.stride)

        def run(env: dict[str, int]) -> None:
            for x, array, f in reads:
                x[:] = array[place(f, env, len(array))]
            go()
            for x, array, f in writes:
                array[place(f, env, len(array))] = x

        return run
