"""Number formats: how a kernel's operations are written in C."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.emit.elementary import exponent_q27
from esea_gen.emit.walker import Kernel, Node, UnsupportedOperationError, calls_first, fuse_selects

# Functions of the f32 format come from the project's own float-only file, the same on all targets.
_F32_CALLS = {
    "sqrt": "esea_f32_sqrt",
    "exp": "esea_f32_exp",
    "log": "esea_f32_log",
    "tanh": "esea_f32_tanh",
}
_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
_COMPARE = {"lt": "<", "le": "<=", "eq": "==", "ne": "!=", "and": "&&", "or": "||"}
# Where a boolean operand is taken as it is, without turning it into a number.
LOGICAL = frozenset({"not", "and", "or"})
SELECTING = frozenset({"if_else_zero", "select"})


@dataclass(frozen=True)
class Format:
    """A number format.

    needs_libm: whether the emitted C links the platform's libm.
    """

    name: str
    c_type: str
    dtype: np.dtype[Any]
    epsilon: float
    needs_libm: bool

    def passes(self, kernel: Kernel) -> Kernel:
        """Rewrite a kernel for this format."""
        return kernel if self.name == "f64" else calls_first(fuse_selects(kernel))

    def literal(self, value: float) -> str:
        """Shortest C literal that reads back as the value in this format."""
        if not np.isfinite(value):
            raise UnsupportedOperationError(f"constant {value} cannot be emitted")
        if self.name == "f64":
            text = repr(float(value))
            return text if "." in text or "e" in text else text + ".0"
        with np.errstate(over="ignore"):
            single = np.float32(value)
        if not np.isfinite(single) or (single == 0 and value != 0):
            raise UnsupportedOperationError(f"constant {value!r} is outside float32's range")
        text = np.format_float_scientific(single, unique=True, trim="0")
        if 1e-4 <= abs(float(single)) < 1e7 or single == 0:
            text = np.format_float_positional(single, unique=True, trim="0")
        return text + "f"

    def expression(self, node: Node, args: Sequence[str], kernel: Kernel) -> str:
        """C expression of one operation.

        args: c text of its operands, each an atom (a name, literal or bracketed expression).
        """
        op = node.op
        if op in _INFIX:
            return f"{args[0]} {_INFIX[op]} {args[1]}"
        if op in _COMPARE:
            return f"{args[0]} {_COMPARE[op]} {args[1]}"
        simple: dict[str, Callable[[], str]] = {
            "neg": lambda: f"-{args[0]}",
            "not": lambda: f"!{args[0]}",
            "sq": lambda: f"{args[0]} * {args[0]}",
            "twice": lambda: f"{self.literal(2.0)} * {args[0]}",
            "inv": lambda: f"{self.literal(1.0)} / {args[0]}",
            "if_else_zero": lambda: f"{args[0]} ? {args[1]} : {self.literal(0.0)}",
            "select": lambda: f"{args[0]} ? {args[1]} : {args[2]}",
            "fabs": lambda: f"esea_fabs({args[0]})",
            "fmin": lambda: f"esea_fmin({args[0]}, {args[1]})",
            "fmax": lambda: f"esea_fmax({args[0]}, {args[1]})",
            "sign": lambda: f"esea_sign({args[0]})",
        }
        if op in simple:
            return simple[op]()
        if self.name == "f64":
            if op in ("sqrt", "exp", "log", "tanh", "pow"):
                return f"{op}({', '.join(args)})"
        elif op in _F32_CALLS:
            return f"{_F32_CALLS[op]}({args[0]})"
        elif op == "pow":
            return self._f32_pow(node, args, kernel)
        raise UnsupportedOperationError(
            f"{kernel.name}: the {self.name} format has no operation '{op}'"
        )

    def _f32_pow(self, node: Node, args: Sequence[str], kernel: Kernel) -> str:
        exponent = kernel.nodes[node.args[1]]
        if exponent.op != "const":
            return f"esea_f32_pow({args[0]}, {args[1]})"
        # A constant exponent goes in as a fixed-point number: rounded to float it would cost ULPs.
        try:
            q27 = exponent_q27(exponent.value)
        except ValueError as error:
            raise UnsupportedOperationError(f"{kernel.name}: {error}") from None
        return f"esea_f32_powk({args[0]}, INT32_C({q27}) /* {exponent.value!r} */)"


FORMATS = {
    "f64": Format("f64", "double", np.dtype(np.float64), 2.0**-53, True),
    "f32": Format("f32", "float", np.dtype(np.float32), 2.0**-24, False),
}
# Whole numbers, each with a format of its own: printed from a range plan (emit/fixed), not here.
Q31 = Format("q31", "int32_t", np.dtype(np.int32), 2.0**-31, False)
ALL_FORMATS = FORMATS | {"q31": Q31}


@dataclass(frozen=True)
class Statement:
    """A line of a printed kernel.

    c_type: type of the constant it defines.
    """

    c_type: str
    name: str
    expression: str
    comment: str = ""


@dataclass(frozen=True)
class PrintedKernel:
    """A kernel as C text.

    results: per result, per element, the C atom that holds it.
    """

    statements: tuple[Statement, ...]
    results: tuple[tuple[str, ...], ...]
    used_arguments: frozenset[int]


@dataclass(frozen=True)
class StatusWord:
    """A status word found in a kernel.

    flags: node of the condition, and its bit.
    """

    flags: tuple[tuple[int, int], ...]
    parts: frozenset[int]


def status_words(
    kernel: Kernel, words: Sequence[int], uses: Sequence[int]
) -> dict[int, StatusWord]:
    """Find the status words that ``flag_word`` built."""
    # A sum of (condition ? power of two : 0), each power once, as flag_word builds it.
    found = {}
    for word in words:
        (root,) = kernel.results[word]
        flags, parts, todo = [], set(), [root]
        while todo:
            i = todo.pop()
            n = kernel.nodes[i]
            if i != root and uses[i] != 1:
                break
            if n.op == "add":
                todo += n.args[::-1]
            elif n.op == "if_else_zero" and kernel.nodes[n.args[0]].boolean:
                value = kernel.nodes[n.args[1]]
                power = value.value.hex().startswith("0x1.0000000000000p+")
                if value.op != "const" or not power:
                    break
                flags.append((n.args[0], int(value.value).bit_length() - 1))
            else:
                break
            parts.add(i)
        else:
            if len({k for _, k in flags}) == len(flags) > 0:
                found[root] = StatusWord(tuple(flags), frozenset(parts - {root}))
    return found


def print_kernel(
    kernel: Kernel,
    fmt: Format,
    access: Callable[[int, int], tuple[str, str]],
    labels: dict[int, tuple[str, str]],
    words: Sequence[int] = (),
) -> PrintedKernel:
    """Print a kernel as a list of C definitions.

    access: ``access(argument, element) -> (local name, C expression that reads it)``.
    words: results that are status words; f32 puts these together as integers, f64 as CasADi does.
    """
    uses = [0] * len(kernel.nodes)
    for n in kernel.nodes:
        for a in n.args:
            uses[a] += 1
    wanted = {i for r in kernel.results for i in r}
    bits = {} if fmt.name == "f64" else status_words(kernel, words, uses)
    parts = {i for word in bits.values() for i in word.parts}
    atoms: list[str] = []
    statements: list[Statement] = []
    arguments = set()
    for i, n in enumerate(kernel.nodes):
        if i in bits:
            flags = (f"((uint32_t){atoms[c]} << {k})" for c, k in bits[i].flags)
            statements.append(Statement("uint32_t", f"v{i}", " | ".join(flags)))
            atoms.append(f"v{i}")
            continue
        if i in parts:
            atoms.append("")
            continue
        if n.op == "const":
            text = fmt.literal(n.value)
            atoms.append(f"({text})" if text.startswith("-") else text)
            continue
        if n.op == "input":
            local, source = access(*n.source)
            arguments.add(n.source[0])
            statements.append(Statement(fmt.c_type, local, source))
            atoms.append(local)
            continue
        operands = []
        for position, a in enumerate(n.args):
            is_condition = n.op in LOGICAL or (n.op in SELECTING and position == 0)
            text = atoms[a]
            if kernel.nodes[a].boolean and not is_condition:
                text = f"({fmt.c_type}){text}"
            elif is_condition and not kernel.nodes[a].boolean:
                text = f"({text} != {fmt.literal(0.0)})"
            operands.append(text)
        text = fmt.expression(n, operands, kernel)
        named = labels.get(i)
        # A boolean used once reads best where it is used; so does a short product or difference.
        inline = (
            named is None
            and i not in wanted
            and uses[i] == 1
            and (n.boolean or (n.op in ("mul", "sub", "add", "neg") and len(text) <= 34))
        )
        if inline:
            atoms.append(f"({text})")
            continue
        c_type = "int" if n.boolean else fmt.c_type
        name, comment = named if named else (f"v{i}", "")
        statements.append(Statement(c_type, name, text, comment))
        atoms.append(name)
    results = tuple(
        tuple(f"({fmt.c_type}){atoms[i]}" if kernel.nodes[i].boolean else atoms[i] for i in r)
        for r in kernel.results
    )
    return PrintedKernel(tuple(statements), results, frozenset(arguments))
