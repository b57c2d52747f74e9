"""Shared part of the floating-point formats: a kernel's operations in C."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from esea_gen.emit.formats.base import Format
from esea_gen.emit.integers import SIGNED, UNSIGNED, chosen_nodes, integer_nodes, kind_of
from esea_gen.emit.local_names import meanings, namer, parts
from esea_gen.emit.naming import Naming
from esea_gen.emit.printed import EmittedBlock, PrintedKernel, Statement, bare, number_name
from esea_gen.emit.walker import (
    COMPARING,
    OPERATIONS,
    SELECTING,
    Kernel,
    Node,
    UnsupportedOperationError,
    checked_from_zero,
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
_CHAINS = frozenset({"and", "or", "add"})  # read from the left, brackets or none
# Longest text of a value that is printed where it is used.
_SHORT = {"mul": 34, "sub": 34, "add": 34, "neg": 34, "fabs": 60, "fmin": 60, "fmax": 60}
_CALLS = frozenset({"fabs", "fmin", "fmax", "sign", "sqrt", "exp", "log", "tanh", "pow"})
# Operands that need no brackets.
_SEPARATED = _CALLS | COMPARING


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
        """C expression of an elementary function; None for another node."""

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

    def expression(self, node: Node, args: Sequence[str], kernel: Kernel, whole: bool) -> str:
        _, pattern = OPERATIONS[node.op]
        if pattern:
            return pattern.format(*args, f="i" if whole else "f", **self._numbers)
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
        block: Any,  # a Block, or a Program but for its step
        function: str,
        kernel: Kernel,
        names: dict[int, tuple[str, str]] | None = None,
    ) -> PrintedKernel:
        others = meanings(block, function, kernel)
        if function == "prepare":
            access = self._access([("params", block.tunables)])
            return print_kernel(kernel, self, access, {}, others=others, ports=block.coefficients)
        coefficients = [("coeffs", block.coefficients)]
        if function == "init":
            access = self._access(coefficients)
            return print_kernel(kernel, self, access, {}, others=others, ports=block.state)
        access = self._access([*coefficients, ("state", block.state), ("in", block.inputs)])
        ports = (*block.state, *block.outputs)
        names = names or {}
        others = parts(kernel, others | {i: name for i, (name, _) in names.items()})
        return print_kernel(kernel, self, access, names, block.flag_results, others, ports=ports)

    def _access(self, groups: list[tuple[str, tuple[Any, ...]]]) -> Access:
        flat = [(pointer, p) for pointer, ports in groups for p in ports]
        clash = {p.name for _, p in flat if [q.name for _, q in flat].count(p.name) > 1}

        def access(argument: int, element: int) -> tuple[str, str, Any]:
            pointer, p = flat[argument]
            size = getattr(p, "size", 1)
            name = f"{pointer}_{p.name}" if p.name in clash else p.name
            index = "" if size == 1 else f"[{element}]"
            local = f"{name}_now" if pointer == "state" else name
            local = local if size == 1 else f"{local}_{element}"
            return local, f"{pointer}->{p.name}{index}", p

        return access


# Of an input: local name, place in memory, and its port; None where it is a number in any case.
Access = Callable[[int, int], tuple[str, str, Any]]


def _whole_text(value: float, choices: type[IntEnum] | None, c_type: str | None) -> str:
    suffix = "" if c_type == SIGNED else "u"
    return number_name(value, choices) or f"{value:.0f}{suffix}"


def _whole_bound(n: Node, position: int, value: float) -> float:
    """The whole number that a comparison of one with a constant is with."""
    down = (n.op == "lt") == (position == 0)
    return math.floor(value) if down else math.ceil(value)


def _number(fmt: FloatingFormat, condition: str) -> str:
    return f"({condition} ? {fmt.literal(1.0)} : {fmt.literal(0.0)})"


@dataclass
class _Operands:
    """C text of a node's operands: as conditions, as integers or in the format."""

    fmt: FloatingFormat
    kernel: Kernel
    access: Access
    ports: Sequence[Port]

    def __post_init__(self) -> None:
        def port(argument: int) -> Any:
            return self.access(argument, 0)[2]

        self.whole = integer_nodes(self.kernel, port, self.ports)
        self.choices = chosen_nodes(self.kernel, port, self.ports)
        inputs = {i: port(n.source[0]) for i, n in enumerate(self.kernel.nodes) if n.op == "input"}
        # In memory, which may hold any pattern.
        self.flags = {i for i, p in inputs.items() if kind_of(p) == "flag"}

    def compares_whole(self, n: Node) -> str:
        """C type in which a comparison compares integers; empty where it compares numbers."""
        types = {self.whole[a] for a in n.args if a in self.whole}
        if n.op not in COMPARING or not types:
            return ""
        c_type = SIGNED if SIGNED in types else UNSIGNED
        for c in (self.kernel.nodes[a] for a in n.args if a not in self.whole):
            above, between = c.value >= 0 or c_type == SIGNED, n.op in ("lt", "le")
            if c.op != "const" or not (above and (between or c.value % 1 == 0)):
                return ""
        return c_type

    def text(self, i: int, position: int, text: str) -> str:
        n = self.kernel.nodes[i]
        a = n.args[position]
        operand = self.kernel.nodes[a]
        alike = n.op in ("eq", "ne") and all(self.kernel.nodes[k].boolean for k in n.args)
        if n.op in LOGICAL or alike or (n.op in SELECTING and position == 0):
            if operand.boolean:
                return text
            whole = a in self.flags or a in self.whole
            zero = _whole_text(0, None, self.whole.get(a)) if whole else self.fmt.literal(0.0)
            return f"({text} != {zero})"
        compares = self.compares_whole(n)
        if c_type := compares or self.whole.get(i):
            if operand.op != "const":
                if self.whole.get(a) != c_type:  # or a choice that is a number as well
                    return f"({c_type}){text}"
                return bare(text) if compares or n.op in _CALLS else text
            value = _whole_bound(n, position, operand.value) if compares else operand.value
            named = n.op in ("eq", "ne") or not compares
            of = [self.choices[k] for k in (*n.args, i) if named and k in self.choices]
            return _whole_text(value, of[0] if of else None, c_type)
        if a in self.flags:
            return _number(self.fmt, f"{text} != 0u")
        if a in self.whole:
            return f"({self.fmt.c_type}){text}"
        if operand.boolean:
            return _number(self.fmt, text)
        separated = n.op in _SEPARATED or (n.op in SELECTING and operand.op == "const")
        return bare(text) if separated else text

    def result(self, i: int, text: str, port: Port | None) -> str:
        """C text for a port's field; without a port it is a number."""
        n = self.kernel.nodes[i]
        if port is None or port.kind == "quantity":
            if i in self.whole:
                return f"({self.fmt.c_type}){text}"
            return _number(self.fmt, text) if n.boolean else text
        c_type = f"{port.integer}_t"
        if i in self.whole or i in self.flags:
            return text if self.whole.get(i, UNSIGNED) == c_type else f"({c_type}){text}"
        if n.boolean:
            return f"({text} ? 1u : 0u)"
        if n.op == "const" and (n.value >= 0 or c_type == SIGNED) and n.value % 1 == 0:
            return _whole_text(n.value, port.choices, c_type)
        raise UnsupportedOperationError(
            f"{self.kernel.name}: {port.name} is a {port.kind}, but its value is not a whole number"
        )


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
    inputs = {i: access(*n.source) for i, n in enumerate(kernel.nodes) if n.op == "input"}
    name_of = namer({x[0] for x in inputs.values()}, labels, others or {})
    chained: dict[int, tuple[str, str | None]] = {}  # printed where they are used, without brackets
    write = _Operands(fmt, kernel, access, ports)
    whole, choices = write.whole, write.choices

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
            read, source, port = inputs[i]
            arguments.add(n.source[0])
            c_type = fmt.c_type if kind_of(port) == "quantity" else f"{port.integer}_t"
            statements.append(Statement(c_type, read, source))
            atoms.append(read)
            continue
        operands = []
        for position, a in enumerate(n.args):
            same = chained.get(a) == (n.op, whole.get(i))
            read_on = same and (n.op != "add" or position == 0)
            operands.append(bare(atoms[a]) if read_on else write.text(i, position, atoms[a]))
        checked = checked_from_zero(kernel, n)
        unsigned = whole.get(checked) == UNSIGNED or checked in write.flags  # never below 0
        if unsigned:
            most = kernel.nodes[kernel.nodes[n.args[0]].args[1]].value
            text = f"{atoms[checked]} <= {_whole_text(most, choices.get(checked), UNSIGNED)}"
        elif i in whole and n.op == "if_else_zero":
            text = f"{operands[0]} ? {operands[1]} : {_whole_text(0, choices.get(i), whole[i])}"
        else:
            text = fmt.expression(n, operands, kernel, i in whole)
        named = labels.get(i)
        # A boolean used once reads best where it is used; so does a short product or difference.
        short = n.boolean or len(text) <= _SHORT.get(n.op, 0)
        if named is None and i not in wanted and uses[i] == 1 and short:
            atoms.append(text if n.op in _CALLS else f"({text})")
            if n.op in _CHAINS and not unsigned:
                chained[i] = n.op, whole.get(i)
            continue
        c_type = "bool" if n.boolean else whole.get(i, fmt.c_type)
        statements.append(Statement(c_type, name_of(i), text, named[1] if named else ""))
        atoms.append(statements[-1].name)

    def result(k: int, i: int) -> str:
        if k in words:
            return atoms[i] if i in bits else f"(uint32_t){atoms[i]}"
        return write.result(i, atoms[i], ports[k] if ports else None)

    results = tuple(tuple(result(k, i) for i in r) for k, r in enumerate(kernel.results))
    return PrintedKernel(tuple(statements), results, frozenset(arguments))
