"""Writer of a Program's body: arrays, kernels called on them, loops and conditions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import casadi as ca

from esea_gen.language.ports import Port, port_ok
from esea_gen.language.statements import (
    EPSILON,
    WORK_RANGE,
    Call,
    Exit,
    For,
    Invoke,
    Ix,
    Memory,
    Part,
    ProgramError,
    Ref,
    Region,
    SetIndex,
    Statement,
    When,
)


class Builder:
    """Collects the arrays and statements of a Program.

    Use :meth:`part` for each piece; the piece named ``step`` is the entry.
    """

    def __init__(self) -> None:
        self.memory: dict[str, Memory] = {}
        self.parts: dict[str, Part] = {}
        self._body: list[list[Statement]] = []
        self._kernels: dict[tuple[Any, ...], ca.Function] = {}
        self._functions: list[object] = []
        self._fresh = 0

    def array(
        self,
        name: str,
        size: int,
        region: Region = "work",
        meaning: str = "",
        values: Any = None,
        port: Port | None = None,
    ) -> Memory:
        if name in self.memory or size < 1:
            raise ProgramError(f"array {name}: the name is taken or the size {size} is below 1")
        port = port or Port(name, -WORK_RANGE, WORK_RANGE, f"work: {meaning or name}", size)
        self.memory[name] = Memory(name, size, region, port, values)
        return self.memory[name]

    def flag(self, name: str, meaning: str = "", region: Region = "work") -> Memory:
        return self.array(name, 1, region, port=Port.flag(name, f"work: {meaning}"))

    def count(self, name: str, high: int, meaning: str, size: int = 1, low: int = 0) -> Memory:
        port = Port.count(name, high, f"work: {meaning}", size=size, low=low)
        return self.array(name, size, port=port)

    def table(self, name: str, values: Any, meaning: str = "") -> Memory:
        given = values if isinstance(values, Mapping) else dict.fromkeys(EPSILON, values)
        content = {k: tuple(float(x) for x in v) for k, v in given.items()}
        return self.array(name, len(content["f64"]), "table", meaning, content)

    def index_table(self, name: str, values: Sequence[int], meaning: str = "") -> Memory:
        port = Port.count(name, max(1, *values), meaning, size=len(values))
        return self.array(name, len(values), "index", values=tuple(map(int, values)), port=port)

    @contextmanager
    def part(self, name: str, *params: str, comment: str = "") -> Iterator[tuple[Ix, ...]]:
        body: list[Statement] = []
        self.parts[name] = Part(name, params, body, comment)
        self._body.append(body)
        yield tuple(Ix(0, ((1, p),)) for p in params)
        self._body.pop()

    def call(
        self,
        name: str,
        args: Sequence[Ref],
        results: Sequence[Ref],
        function: Callable[..., Any],
        note: str = "",
    ) -> None:
        """Call a kernel written as a Python function of symbols."""
        key = (name, tuple(a.length for a in args), id(function))
        if key not in self._kernels:
            symbols = [ca.SX.sym(f"a{i}", a.length) for i, a in enumerate(args)]
            got = function(*symbols)
            got = list(got) if isinstance(got, (tuple, list)) else [got]
            self._kernels[key] = ca.Function(name, symbols, [ca.densify(ca.SX(g)) for g in got])
            # The function's id must stay its own: it is kept as long as the kernel.
            self._functions.append(function)
        self.run(self._kernels[key], args, results, note)

    def run(
        self, kernel: ca.Function, args: Sequence[Ref], results: Sequence[Ref], note: str = ""
    ) -> None:
        want = [kernel.numel_in(i) for i in range(kernel.n_in())]
        give = [kernel.numel_out(i) for i in range(kernel.n_out())]
        if want != [a.length for a in args] or give != [r.length for r in results]:
            raise ProgramError(
                f"kernel {kernel.name()}: takes {want} and gives {give}, called with "
                f"{[a.length for a in args]} and {[r.length for r in results]}"
            )
        self._body[-1].append(Call(kernel, tuple(args), tuple(results), note))

    @contextmanager
    def loop(
        self,
        start: Ix | int,
        stop: Ix | int,
        most: Ix | int | None = None,
        unroll: bool = False,
        name: str = "i",
        total: int | None = None,
    ) -> Iterator[Ix]:
        a, b = Ix.of(start), Ix.of(stop)
        span = b - a
        if most is None:
            if span.terms or span.lookups:
                raise ProgramError("a loop with a variable range needs a bound: give 'most'")
            most = max(0, span.constant)
        self._fresh += 1
        var = f"{name}{self._fresh}"
        body: list[Statement] = []
        self._body[-1].append(For(var, a, b, Ix.of(most), body, unroll, total))
        self._body.append(body)
        yield Ix(0, ((1, var),))
        self._body.pop()

    def each(
        self,
        size: int,
        name: str,
        args: Sequence[Memory | Ref],
        results: Sequence[Memory | Ref],
        function: Callable[..., Any],
        unroll: bool = False,
    ) -> None:
        """Call a kernel for every element of the arrays among its arguments and results."""
        with self.loop(0, size, unroll=unroll) as i:
            known = [x[i] if isinstance(x, Memory) else x for x in args]
            found = [x[i] if isinstance(x, Memory) else x for x in results]
            self.call(name, known, found, function)

    @contextmanager
    def when(self, flag: Ref | tuple[Ix | int, str, Ix | int]) -> Iterator[None]:
        cond = flag if isinstance(flag, Ref) else (Ix.of(flag[0]), flag[1], Ix.of(flag[2]))
        body: list[Statement] = []
        self._body[-1].append(When(cond, body, []))
        self._body.append(body)
        yield
        self._body.pop()

    @contextmanager
    def otherwise(self) -> Iterator[None]:
        """Open the other way of the :meth:`when` just before."""
        last = self._body[-1][-1] if self._body[-1] else None
        if not isinstance(last, When):
            raise ProgramError("'otherwise' must follow 'when'")
        self._body.append(last.otherwise)
        yield
        self._body.pop()

    def exit_if(self, flag: Ref) -> None:
        """Exit the innermost loop when a real element is not 0."""
        self._body[-1].append(Exit(flag))

    def index(self, name: str) -> Ix:
        """An index variable of the part that is open."""
        self._fresh += 1
        return Ix(0, ((1, f"{name}_{self._fresh}"),))

    def set(self, var: Ix, value: Ix | int) -> None:
        self._body[-1].append(SetIndex(var.terms[0][1], Ix.of(value)))

    def invoke(self, part: str, *args: Ix | int) -> None:
        """Run a part that has been opened before."""
        if part not in self.parts or len(self.parts[part].params) != len(args):
            raise ProgramError(f"no part {part} with {len(args)} parameters")
        self._body[-1].append(Invoke(part, tuple(Ix.of(a) for a in args)))


def array_name(region: str, port: str) -> str:
    return f"{region}.{port}"


def declare_ports(builder: Builder, region: Region, ports: Sequence[Port]) -> dict[str, Memory]:
    return {
        p.name: builder.array(array_name(region, p.name), p.size, region, port=p) for p in ports
    }


def guard_inputs(builder: Builder, inputs: Sequence[Port], ok: Memory) -> dict[str, Memory]:
    """The guard of ``Block.define`` as kernels: copies of valid inputs."""
    held = {}
    builder.call("all_ok", [], [ok[:]], lambda: ca.SX(1))
    for p in inputs:
        source = builder.memory[array_name("in", p.name)]
        own = replace(p, name=f"g_{p.name}", meaning=f"work: guarded: {p.meaning}", equation="")
        held[p.name] = target = builder.array(own.name, p.size, port=own)

        def check(x: ca.SX, good: ca.SX, p: Port = p) -> tuple[ca.SX, ca.SX]:
            fine = port_ok(x, p)
            return ca.if_else(fine, x, float(p.on_invalid)), ca.logic_and(good, fine)

        builder.call(f"guard_{p.name}", [source[:], ok[:]], [target[:], ok[:]], check)
    return held
