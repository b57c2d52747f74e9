"""Programs as C: loops and calls here, kernels by the walker, the rest by a template."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from esea_gen.emit.formats.base import Format
from esea_gen.emit.formats.floating import FloatingFormat, print_kernel
from esea_gen.emit.printed import PrintedKernel, bare, comment
from esea_gen.emit.walker import Kernel, walk
from esea_gen.errors import UserError
from esea_gen.language.builder import array_name
from esea_gen.language.program import Program
from esea_gen.language.statements import (
    EPSILON,
    Call,
    Exit,
    For,
    Invoke,
    Ix,
    Memory,
    Part,
    ProgramError,
    Ref,
    SetIndex,
    Statement,
    When,
    reads_of,
    walk_statements,
)

_POINTERS = ("coeffs", "state", "in", "out")


@dataclass(frozen=True)
class LoopBound:
    """Bounds of one printed loop, for a complete step."""

    part: str
    var: str  # its index variable in the C; no other loop has it
    entries: int  # how often it is entered at most
    passes: int  # how often its body runs at most, all entries together


@dataclass(frozen=True)
class PrintedPart:
    name: str
    pointers: tuple[str, ...]  # which of coeffs, state, in and out it takes
    params: tuple[str, ...]
    locals: tuple[Memory, ...]
    indices: tuple[str, ...]
    lines: tuple[str, ...]
    comment: str


@dataclass(frozen=True)
class EmittedProgram:
    block: Program
    prepare: PrintedKernel | None
    init: PrintedKernel
    parts: tuple[PrintedPart, ...]  # each after those it invokes; ``step`` last
    tables: tuple[tuple[str, str, tuple[str, ...]], ...]  # c type, name and literals of each table
    loops: tuple[LoopBound, ...]
    template: str = "device/esea_program.c.j2"


def emit_program(
    program: Program, fmt: Format, kernels: Mapping[int, Kernel] | None = None
) -> EmittedProgram:
    if not isinstance(fmt, FloatingFormat):  # its arrays declare no ranges to plan whole numbers
        raise UserError(
            f"The program {program.name} cannot be emitted in {fmt.name}.",
            f"Choose from {', '.join(EPSILON)}.",
        )
    return _Writer(program, fmt, program.name, kernels or {}).emit()


def _frozen(env: Mapping[str, int]) -> tuple[tuple[str, int], ...]:
    return tuple(sorted(env.items()))


LoopKey = tuple[str, tuple[tuple[str, int], ...]]


def loop_totals(program: Program) -> dict[LoopKey, tuple[int, int]]:
    """How often each printed loop is entered and passed in one step, at most.

    Both ways of every condition are taken and no loop is left early; ranges that depend on loops
    around, through calls too, are evaluated, so that a triangle counts as a triangle.  A loop's own
    ``total``, where it states one, is taken when it is less.
    """
    tables = program.index_tables
    totals: dict[LoopKey, tuple[int, int]] = {}

    def known(x: Ix, env: Mapping[str, int]) -> int | None:
        e = x.fold(env, tables)
        return None if e.terms or e.lookups else e.constant

    def count(
        body: Sequence[Statement], env: dict[str, int], unrolled: dict[str, int], times: int
    ) -> None:
        for s in body:
            if isinstance(s, When):
                count(s.then, env, unrolled, times)
                count(s.otherwise, env, unrolled, times)
            elif isinstance(s, Invoke):
                part = program.parts[s.part]
                values = {n: known(a, env) for n, a in zip(part.params, s.args, strict=True)}
                count(part.body, {n: v for n, v in values.items() if v is not None}, {}, times)
            elif isinstance(s, For):
                start, stop = known(s.start, env), known(s.stop, env)
                exact = start is not None and stop is not None
                most = known(s.most, env)
                if most is None:
                    raise ProgramError(f"{program.name}: loop {s.var} has no bound")
                n = min(most, max(0, (stop or 0) - (start or 0))) if exact else most
                key = (s.var, _frozen(unrolled))
                if not s.unroll:
                    entries, passes = totals.get(key, (0, 0))
                    totals[key] = (entries + times, passes + n * times)
                leaf = not any(isinstance(x, (For, When, Invoke)) for x in s.body)
                if leaf or n == 0:
                    continue
                if start is None:
                    count(s.body, {k: v for k, v in env.items() if k != s.var}, unrolled, times * n)
                    continue
                for i in range(start, start + n):
                    inner = unrolled | {s.var: i} if s.unroll else unrolled
                    count(s.body, env | {s.var: i}, inner, times)

    count(program.parts["step"].body, {}, {}, 1)
    stated = {
        s.var: s.total
        for part in program.parts.values()
        for s in walk_statements(part.body)
        if isinstance(s, For) and s.total is not None
    }
    return {
        (var, env): (entries, min(passes, stated.get(var, passes)))
        for (var, env), (entries, passes) in totals.items()
    }


@dataclass
class _Context:
    part: Part
    env: dict[str, int] = field(default_factory=dict)  # unrolled loops
    names: dict[str, str] = field(default_factory=dict)


class _Writer:
    def __init__(
        self, program: Program, fmt: FloatingFormat, stem: str, kernels: Mapping[int, Kernel]
    ) -> None:
        # Tables and parts are static: they need no prefix.
        self.program, self.fmt, self.stem = program, fmt, stem
        self.kernels = dict(kernels)
        self.loops: list[LoopBound] = []
        self.totals = loop_totals(program)
        self.count = 0
        self.used: set[str] = set()  # tables that the text names

    def emit(self) -> EmittedProgram:
        program, fmt = self.program, self.fmt
        prepare = None
        if program.tunables:
            prepare = fmt.function(program, "prepare", fmt.passes(walk(program.prepare)))
        init = fmt.function(program, "init", fmt.passes(walk(program.init)))
        parts = tuple(self._part(p) for p in self._ordered())
        tables = []
        for m in program.memory.values():
            if m.name in self.used:
                c_type, literals = fmt.c_type, tuple(f"{v}u" for v in m.values)
                if m.region == "table":
                    literals = tuple(map(fmt.literal, m.values[fmt.name]))
                else:
                    c_type = "uint8_t" if max(m.values) < 256 else "uint16_t"
                tables.append((c_type, f"{self.stem}_{m.name}", literals))
        return EmittedProgram(program, prepare, init, parts, tuple(tables), tuple(self.loops))

    def _ordered(self) -> list[Part]:
        done: list[Part] = []

        def visit(part: Part) -> None:
            for s in walk_statements(part.body):
                if isinstance(s, Invoke):
                    visit(self.program.parts[s.part])
            if part not in done:
                done.append(part)

        visit(self.program.parts["step"])
        return done

    def _pointers(self, part: Part) -> tuple[str, ...]:
        memory = self.program.memory
        regions = set()
        for s in walk_statements(part.body):
            if isinstance(s, Invoke):
                regions |= set(self._pointers(self.program.parts[s.part]))
            refs, expressions = reads_of(s)
            regions |= {memory[r.array].region for r in refs}
            if isinstance(s, Call):
                expressions = [r.start for r in refs]
            while expressions:
                for _, table, inner in expressions.pop().lookups:
                    regions.add(memory[table].region)
                    expressions.append(inner)
        return tuple(p for p in _POINTERS if p in regions or (p == "state" and "work" in regions))

    def _part(self, part: Part) -> PrintedPart:
        locals_, indices = [], []
        for s in walk_statements(part.body):
            if isinstance(s, SetIndex) and s.var not in indices:
                indices.append(s.var)
            if isinstance(s, Call):
                for r in (*s.args, *s.results):
                    m = self.program.memory[r.array]
                    if m.region == "local" and m not in locals_:
                        locals_.append(m)
        lines = self._body(part.body, _Context(part), 1)
        return PrintedPart(
            part.name,
            self._pointers(part),
            part.params,
            tuple(locals_),
            tuple(indices),
            tuple(lines),
            part.comment,
        )

    def _index(self, ix: Ix, context: _Context) -> str:
        e = ix.fold(context.env, self.program.index_tables)
        parts = []
        for c, v in e.terms:
            name = context.names.get(v, v)
            parts.append(name if c == 1 else f"{c} * {name}")
        for c, t, i in e.lookups:
            text = f"(int){self.place(Ref(t, i, 1), 0, context)}"
            parts.append(text if c == 1 else f"{c} * {text}")
        if e.constant or not parts:
            parts.append(str(e.constant))
        return " + ".join(parts).replace("+ -", "- ")

    def place(self, ref: Ref, element: int, context: _Context) -> str:
        m = self.program.memory[ref.array]
        local = m.name.rpartition(".")[2]
        at = self._index(ref.start + element * ref.stride, context)
        if m.region in ("table", "index"):
            self.used.add(m.name)
            return f"{self.stem}_{local}[{at}]"
        if m.region == "local":
            return f"{local}[{at}]"
        pointer = "state" if m.region == "work" else m.region
        return f"{pointer}->{local}" + ("" if m.size == 1 else f"[{at}]")

    def _body(self, body: Sequence[Statement], context: _Context, depth: int) -> list[str]:
        lines: list[str] = []
        pad = "    " * depth
        for s in body:
            if isinstance(s, Call):
                lines += self._call(s, context, depth)
            elif isinstance(s, SetIndex):
                lines.append(f"{pad}{s.var} = {self._index(s.value, context)};")
            elif isinstance(s, Exit):
                lines.append(f"{pad}if ({self._holds(s.flag, context)})")
                lines.append(f"{pad}    break;")
            elif isinstance(s, Invoke):
                pointers = self._pointers(self.program.parts[s.part])
                args = [*pointers, *(self._index(a, context) for a in s.args)]
                lines.append(f"{pad}{self.stem}_{s.part}({', '.join(args)});")
            elif isinstance(s, When):
                lines += self._when(s, context, depth)
            else:
                lines += self._for(s, context, depth)
        return lines

    def _holds(self, flag: Ref, context: _Context) -> str:
        whole = self.program.memory[flag.array].port.whole
        zero = "0u" if whole else self.fmt.literal(0.0)
        return f"{self.place(flag, 0, context)} != {zero}"

    def _when(self, s: When, context: _Context, depth: int) -> list[str]:
        pad = "    " * depth
        if isinstance(s.flag, Ref):
            condition = self._holds(s.flag, context)
        else:
            left, op, right = s.flag
            condition = f"{self._index(left, context)} {op} {self._index(right, context)}"
        lines = [f"{pad}if ({condition}) {{", *self._body(s.then, context, depth + 1)]
        if s.otherwise:
            lines += [f"{pad}}} else {{", *self._body(s.otherwise, context, depth + 1)]
        return [*lines, f"{pad}}}"]

    def _for(self, s: For, context: _Context, depth: int) -> list[str]:
        pad = "    " * depth
        tables = self.program.index_tables
        if s.unroll:
            start, stop = (x.fold(context.env, tables) for x in (s.start, s.stop))
            if start.terms or start.lookups or stop.terms or stop.lookups:
                raise ProgramError(f"loop {s.var} cannot be unrolled: its range varies")
            lines = []
            for i in range(start.constant, stop.constant):
                context.env[s.var] = i
                lines += self._body(s.body, context, depth)
            context.env.pop(s.var, None)
            return lines
        self.count += 1
        name = f"{s.var}_{self.count}"
        context.names[s.var] = name
        entries, passes = self.totals.get((s.var, _frozen(context.env)), (0, 0))
        self.loops.append(LoopBound(context.part.name, name, entries, passes))
        low, high = self._index(s.start, context), self._index(s.stop, context)
        inside = self._body(s.body, context, depth + 1)
        del context.names[s.var]
        return [
            f"{pad}for (int {name} = {low}; {name} < {high}; ++{name}) {{"
            f" /* at most {passes} passes in a step */",
            *inside,
            f"{pad}}}",
        ]

    def _call(self, s: Call, context: _Context, depth: int) -> list[str]:
        key = id(s.kernel)
        if key not in self.kernels:
            self.kernels[key] = self.fmt.passes(walk(s.kernel))
        kernel = self.kernels[key]
        memory = self.program.memory
        status = {array_name("out", p.name) for p in self.program.outputs if p.flags}
        words = [k for k, r in enumerate(s.results) if r.array in status]
        printed = print_kernel(
            kernel,
            self.fmt,
            lambda a, e: (
                *(f"a{a}_{e}", self.place(s.args[a], e, context)),
                memory[s.args[a].array].port,
            ),
            {},
            words,
            ports=[memory[r.array].port for r in s.results],
        )
        pad = "    " * depth
        lines = [f"{pad}{{"]
        if s.note:
            lines.insert(0, comment(s.note, 4 * depth))
        for x in printed.statements:
            lines.append(f"{pad}    const {x.c_type} {x.name} = {x.expression};")
        for ref, atoms in zip(s.results, printed.results, strict=True):
            for e, atom in enumerate(atoms):
                lines.append(f"{pad}    {self.place(ref, e, context)} = {bare(atom)};")
        lines.append(f"{pad}}}")
        if len(lines) == 3 + bool(s.note):  # one statement needs no braces
            lines[-3:] = [lines[-2][4:]]
        return lines


def loop_lines(text: str, loops: Sequence[LoopBound]) -> dict[str, tuple[int, int]]:
    lines = text.splitlines()
    found = {}
    for loop in loops:
        heads = [i for i, x in enumerate(lines) if re.match(rf"\s*for \(int {loop.var} = ", x)]
        if len(heads) != 1:
            raise ProgramError(f"loop {loop.var} stands {len(heads)} times in the C")
        pad = len(lines[heads[0]]) - len(lines[heads[0]].lstrip())
        end = next(i for i in range(heads[0] + 1, len(lines)) if lines[i] == " " * pad + "}")
        found[loop.var] = (heads[0] + 1, end + 1)
    return found
