"""What the floating-point formats share: how a kernel's operations are written in C."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from esea_gen.emit.formats.base import Format
from esea_gen.emit.local_names import meanings, namer
from esea_gen.emit.naming import Naming
from esea_gen.emit.printed import EmittedBlock, PrintedKernel, Statement, bare, field_type
from esea_gen.emit.walker import (
    OPERATIONS,
    Kernel,
    Node,
    UnsupportedOperationError,
    checked_flag,
    labelled_kernel,
    status_words,
    use_counts,
    walk,
)
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.system import System

# Where a boolean operand is taken as it is, without turning it into a number.
LOGICAL = frozenset({"not", "and", "or"})
SELECTING = frozenset({"if_else_zero", "select"})
_CHAINS = frozenset({"and", "or", "add"})  # read from the left, brackets or none
# Longest text of a value that is printed where it is used.
_SHORT = {"mul": 34, "sub": 34, "add": 34, "neg": 34, "fabs": 60, "fmin": 60, "fmax": 60}
_CALLS = frozenset({"fabs", "fmin", "fmax", "sign", "sqrt", "exp", "log", "tanh", "pow"})
# Operands that need no brackets.
_SEPARATED = _CALLS | {"lt", "le", "eq", "ne"}


class FloatingFormat(Format):
    default = True
    floating = True
    verified_by = "esea-gen verify"
    compiler_flags = " -ffp-contract=off"
    header = ""
    example_share = 1e-5
    joins_words: ClassVar[bool]  # whether a status word is put together as an integer

    @abstractmethod
    def _literal(self, value: float) -> str:
        """Literal of a finite number."""

    @abstractmethod
    def _call(self, node: Node, args: Sequence[str], kernel: Kernel) -> str | None:
        """C expression of an elementary function; None for what is none."""

    def literal(self, value: float) -> str:
        if not np.isfinite(value):
            raise UnsupportedOperationError(f"constant {value} cannot be emitted")
        return self._literal(value)

    @cached_property
    def _numbers(self) -> dict[str, str]:
        # That patterns of operations name.
        return {"zero": self.literal(0.0), "one": self.literal(1.0), "two": self.literal(2.0)}

    def naming(self, system: System) -> Naming:
        return Naming(system, self.c_type, self.dtype)

    def expression(self, node: Node, args: Sequence[str], kernel: Kernel) -> str:
        _, pattern = OPERATIONS[node.op]
        if pattern:
            return pattern.format(*args, **self._numbers)
        call = self._call(node, args, kernel)
        if call is None:
            raise UnsupportedOperationError(
                f"{kernel.name}: the {self.name} format has no operation '{node.op}'"
            )
        return call

    def emit(self, block: Block) -> EmittedBlock:
        kernel, labels = labelled_kernel(block, self.passes)
        names = {node: (name, comment) for node, name, comment in labels}
        init = self.function(block, "init", self.passes(walk(block.init)))
        prepare = None
        if block.tunables:
            prepare = self.function(block, "prepare", self.passes(walk(block.prepare)))
        step = self.function(block, "step", kernel, names)
        return EmittedBlock(block, prepare, init, step)

    def function(
        self,
        block: Block,
        function: str,
        kernel: Kernel,
        names: dict[int, tuple[str, str]] | None = None,
    ) -> PrintedKernel:
        others = meanings(block, function, kernel)
        if function == "prepare":
            access = self._access([("params", block.tunables)])
            return print_kernel(kernel, self, access, {}, others=others)
        coefficients = [("coeffs", block.coefficients)]
        if function == "init":
            access = self._access(coefficients)
            return print_kernel(kernel, self, access, {}, others=others, ports=block.state)
        access = self._access([*coefficients, ("state", block.state), ("in", block.inputs)])
        ports = (*block.state, *block.outputs)
        return print_kernel(
            kernel, self, access, names or {}, block.flag_results, others, ports=ports
        )

    def _access(self, groups: list[tuple[str, tuple[Any, ...]]]) -> Access:
        flat = [(pointer, p) for pointer, ports in groups for p in ports]
        clash = {p.name for _, p in flat if [q.name for _, q in flat].count(p.name) > 1}

        def access(argument: int, element: int) -> tuple[str, str, str]:
            pointer, p = flat[argument]
            size = getattr(p, "size", 1)
            name = f"{pointer}_{p.name}" if p.name in clash else p.name
            index = "" if size == 1 else f"[{element}]"
            local = f"{name}_now" if pointer == "state" else name
            local = local if size == 1 else f"{local}_{element}"
            return local, f"{pointer}->{p.name}{index}", field_type(p, self.c_type)

        return access


def _number(fmt: FloatingFormat, condition: str) -> str:
    return f"({condition} ? {fmt.literal(1.0)} : {fmt.literal(0.0)})"


def _operand(
    fmt: FloatingFormat, n: Node, position: int, operand: Node, text: str, stored: bool
) -> str:
    # An operand as its operation takes it: a condition or a number.
    is_condition = n.op in LOGICAL or (n.op in SELECTING and position == 0)
    if stored:
        return f"({text} != 0u)" if is_condition else _number(fmt, f"{text} != 0u")
    if operand.boolean and not is_condition:
        return _number(fmt, text)
    if is_condition and not operand.boolean:
        return f"({text} != {fmt.literal(0.0)})"
    separated = n.op in _SEPARATED or (n.op in SELECTING and operand.op == "const")
    return bare(text) if separated else text


def _flag(kernel: Kernel, i: int, text: str, port: Port) -> str:
    n = kernel.nodes[i]
    if n.op == "const" and n.value in (0.0, 1.0):
        return f"{n.value:.0f}u"
    if not n.boolean:
        raise UnsupportedOperationError(f"{kernel.name}: {port.name} is no condition")
    return f"({text} ? 1u : 0u)"


Access = Callable[[int, int], tuple[str, str, str]]  # local name, place in memory and C type


def print_kernel(
    kernel: Kernel,
    fmt: FloatingFormat,
    access: Access,
    labels: dict[int, tuple[str, str]],
    words: Sequence[int] = (),
    others: Mapping[int, str] | None = None,
    ports: Sequence[Port] = (),  # where the results go, where any of them is a flag
) -> PrintedKernel:
    uses = use_counts(kernel)
    wanted = {i for r in kernel.results for i in r}
    bits = status_words(kernel, words, uses) if fmt.joins_words else {}
    parts = {i for word in bits.values() for i in word.parts}
    atoms: list[str] = []
    statements: list[Statement] = []
    arguments = set()
    reads = {access(*n.source)[0] for n in kernel.nodes if n.op == "input"}
    name_of = namer(reads, labels, others or {})
    chained: dict[int, str] = {}  # operations that stand where they are used, without brackets
    stored: set[int] = set()  # flags in memory, which may hold any pattern

    for i, n in enumerate(kernel.nodes):
        if i in bits:
            flags = (f"esea_bit({bare(atoms[c])}, {k}u)" for c, k in bits[i].flags)
            statements.append(Statement("uint32_t", name_of(i), " | ".join(flags)))
            atoms.append(statements[-1].name)
            continue
        if i in parts:
            atoms.append("")
            continue
        if n.op == "const":
            text = fmt.literal(n.value)
            atoms.append(f"({text})" if text.startswith("-") else text)
            continue
        if n.op == "input":
            read, source, c_type = access(*n.source)
            arguments.add(n.source[0])
            statements.append(Statement(c_type, read, source))
            atoms.append(read)
            if c_type != fmt.c_type:
                stored.add(i)
            continue
        operands = []
        for position, a in enumerate(n.args):
            read_on = chained.get(a) == n.op and (n.op != "add" or position == 0)
            text = bare(atoms[a]) if read_on else atoms[a]  # as C reads it anyway
            if a in stored or not read_on:
                text = _operand(fmt, n, position, kernel.nodes[a], text, a in stored)
            operands.append(text)
        flag = checked_flag(kernel, n)
        text = f"{atoms[flag]} <= 1u" if flag in stored else fmt.expression(n, operands, kernel)
        named = labels.get(i)
        # A boolean used once reads best where it is used; so does a short product or difference.
        inline = (
            named is None
            and i not in wanted
            and uses[i] == 1
            and (n.boolean or len(text) <= _SHORT.get(n.op, 0))
        )
        if inline:
            atoms.append(text if n.op in _CALLS else f"({text})")
            if n.op in _CHAINS:
                chained[i] = n.op
            continue
        c_type = "bool" if n.boolean else fmt.c_type
        statements.append(Statement(c_type, name_of(i), text, named[1] if named else ""))
        atoms.append(statements[-1].name)

    def result(k: int, i: int) -> str:
        if ports and ports[k].kind == "flag":
            return _flag(kernel, i, atoms[i], ports[k])
        if kernel.nodes[i].boolean:
            return _number(fmt, atoms[i])
        return f"(uint32_t){atoms[i]}" if k in words and i not in bits else atoms[i]

    results = tuple(tuple(result(k, i) for i in r) for k, r in enumerate(kernel.results))
    return PrintedKernel(tuple(statements), results, frozenset(arguments))
