"""Faults of a kernel: its node list with one place changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from esea_gen.emit.elementary import EXPONENT_FRACTION_BITS, exponent_q27
from esea_gen.emit.formats.base import Format
from esea_gen.emit.walker import COMPARING, SELECTING, Kernel, Node

# What stands instead of an operation: kind, operation, whether its operands change places.
SWAPS: dict[str, tuple[tuple[str, str, bool], ...]] = {
    "add": (("+ to -", "sub", False),),
    "sub": (("- to +", "add", False), ("operands swapped", "sub", True)),
    "mul": (("* to /", "div", False),),
    "div": (("/ to *", "mul", False), ("operands swapped", "div", True)),
    "lt": (("< to <=", "le", False), ("< to >=", "le", True)),
    "le": (("<= to <", "lt", False), ("<= to >=", "le", True)),
    "eq": (("== to !=", "ne", False),),
    "ne": (("!= to ==", "eq", False),),
    "and": (("&& to ||", "or", False),),
    "or": (("|| to &&", "and", False),),
    "fmin": (("fmin to fmax", "fmax", False),),
    "fmax": (("fmax to fmin", "fmin", False),),
}
DROPS = {"fabs": "fabs dropped", "not": "! dropped", "neg": "minus sign dropped"}
# A group of argument elements that a wrong access may confuse: those of one struct.
Elements = Sequence[tuple[int, int]]


@dataclass(frozen=True)
class Edit:
    kind: str
    site: int
    now: Node | int
    helpers: tuple[Node, ...] = ()
    result: tuple[int, int] | None = None

    def apply(self, kernel: Kernel) -> tuple[Kernel, list[int]]:
        """The changed kernel, and the new node for each old one."""
        nodes: list[Node] = []
        place: list[int] = []
        read: dict[tuple[int, int], int] = {}

        def put(n: Node, made: Sequence[int]) -> int:
            if n.op == "input" and n.source in read:  # an element is read once
                return read[n.source]
            args = tuple(place[a] if a >= 0 else made[~a] for a in n.args)
            nodes.append(Node(n.op, args, n.value, n.source))
            if n.op == "input":
                read[n.source] = len(nodes) - 1
            return len(nodes) - 1

        def changed() -> int:
            made: list[int] = []
            for helper in self.helpers:
                made.append(put(helper, made))
            if isinstance(self.now, Node):
                return put(self.now, made)
            return place[self.now] if self.now >= 0 else made[~self.now]

        for i, n in enumerate(kernel.nodes):
            place.append(changed() if i == self.site and self.result is None else put(n, ()))
        results = [[place[i] for i in r] for r in kernel.results]
        if self.result is not None:
            results[self.result[0]][self.result[1]] = changed()
        return Kernel(kernel.name, tuple(nodes), tuple(map(tuple, results))), place


def _constant(value: float) -> Node:
    return Node("const", value=float(value))


def _other_constants(value: float, fmt: Format, whole: bool = False) -> Iterator[tuple[str, float]]:
    kind = fmt.dtype.type
    c = kind(value)
    if c == 0 or whole:  # of whole numbers, less would change nothing
        yield "constant off by one", float(c + 1)
        return
    yield "constant off by 1 %", float(c * kind(1.01))
    yield "constant off by 1 ulp", float(np.nextafter(c, np.copysign(kind(np.inf), c)))
    if c < 0:
        yield "sign of a constant", float(-c)


def _other_exponents(value: float) -> Iterator[tuple[str, float]]:
    raw = exponent_q27(value)
    yield "exponent off by 1 %", round(raw * 1.01) * 2.0**-EXPONENT_FRACTION_BITS
    yield "exponent off by 2^-27", (raw + 1) * 2.0**-EXPONENT_FRACTION_BITS


def _constants(kernel: Kernel, i: int, fmt: Format, whole: set[int]) -> Iterator[Edit]:
    # Each use of a constant by itself.
    n = kernel.nodes[i]
    counts = n.op in COMPARING and all(a in whole or kernel.nodes[a].op == "const" for a in n.args)
    arms = [kernel.nodes[a] for a in n.args[1:]] if n.op in SELECTING else []
    chosen = bool(arms) and all(a.op == "const" for a in arms)
    for position, a in enumerate(n.args):
        c = kernel.nodes[a]
        if c.op != "const":
            continue
        if chosen and position:  # a bit of a status word: rounding would change nothing
            others = iter([("status bit moved", 2 * c.value or 1.0)])
        elif n.op == "pow" and position == 1 and not fmt.needs_libm:
            others = _other_exponents(c.value)
        else:
            others = _other_constants(c.value, fmt, counts)
        args = tuple(~0 if k == position else b for k, b in enumerate(n.args))
        for kind, value in others:
            if np.isfinite(fmt.dtype.type(value)):
                yield Edit(kind, i, Node(n.op, args), (_constant(value),))


def _implied_constants(n: Node, i: int, fmt: Format) -> Iterator[Edit]:
    # Squares, doubles and inverses, which are printed with an operator or a constant.
    if n.op == "sq":
        yield Edit("* to /", i, Node("div", (n.args[0], n.args[0])))
    elif n.op in ("twice", "inv"):
        op, other, kind, value = (
            ("mul", "div", "* to /", 2.0) if n.op == "twice" else ("div", "mul", "/ to *", 1.0)
        )
        yield Edit(kind, i, Node(other, (~0, n.args[0])), (_constant(value),))
        for kind, c in _other_constants(value, fmt):
            yield Edit(kind, i, Node(op, (~0, n.args[0])), (_constant(c),))


def _selects(kernel: Kernel, i: int, conditions: Sequence[int]) -> Iterator[Edit]:
    n = kernel.nodes[i]
    condition, first, *rest = n.args
    if rest:
        yield Edit("select arms swapped", i, Node("select", (condition, rest[0], first)))
        yield Edit("select always second", i, rest[0])
    else:
        inverted = Node("not", (condition,))
        yield Edit("select arms swapped", i, Node("if_else_zero", (~0, first)), (inverted,))
        yield Edit("select always second", i, ~0, (_constant(0.0),))
    yield Edit("select always first", i, first)
    others = [c for c in conditions if c < i and c != condition]
    if others:
        nearest = min(others, key=lambda c: (abs(c - condition), c))
        yield Edit("condition of another select", i, Node(n.op, (nearest, *n.args[1:])))


def _words(kernel: Kernel, words: Sequence[int]) -> set[int]:
    # The sums and bits that make up status words.
    found: set[int] = set()
    front = [i for k in words for i in kernel.results[k]]
    while front:
        i = front.pop()
        n = kernel.nodes[i]
        if n.op in ("add", "if_else_zero") and i not in found:
            found.add(i)
            front += n.args if n.op == "add" else ()
    return found


def kernel_edits(
    kernel: Kernel, fmt: Format, groups: Sequence[Elements], words: Sequence[int], whole: set[int]
) -> Iterator[Edit]:
    """Every fault of a kernel, of whose values some are whole numbers."""
    parts = _words(kernel, words)
    conditions = sorted({n.args[0] for n in kernel.nodes if n.op in SELECTING})
    following = {e: g[(k + 1) % len(g)] for g in groups if len(g) > 1 for k, e in enumerate(g)}
    for i, n in enumerate(kernel.nodes):
        if n.op == "const":
            continue
        if n.op == "input":
            if n.source in following:
                wrong = Node("input", source=following[n.source])
                yield Edit("read from the wrong field", i, wrong)
            continue
        if n.op == "add" and i in parts:
            yield Edit("status flag dropped", i, n.args[0])
            yield Edit("status flag dropped", i, n.args[1])
            continue
        for kind, op, turned in SWAPS.get(n.op, ()):
            yield Edit(kind, i, Node(op, n.args[::-1] if turned else n.args))
        if n.op in ("fmin", "fmax"):
            yield Edit(f"{n.op} dropped", i, n.args[0])
            yield Edit(f"{n.op} always clips", i, n.args[1])
        if n.op in DROPS:
            yield Edit(DROPS[n.op], i, n.args[0])
        if n.op in SELECTING:
            yield from _selects(kernel, i, conditions)
        yield from _constants(kernel, i, fmt, whole)
        yield from _implied_constants(n, i, fmt)
        if not n.boolean and n.op != "neg" and i not in parts:
            yield Edit("result negated", i, Node("neg", (~0,)), (n,))
    for k, row in enumerate(kernel.results):
        for e, i in enumerate(row):
            if kernel.nodes[i].op == "const":
                for kind, value in _other_constants(kernel.nodes[i].value, fmt):
                    yield Edit(kind, i, ~0, (_constant(value),), (k, e))


def describe(kernel: Kernel, names: dict[int, str], edit: Edit) -> str:
    def atom(i: int) -> str:
        if i < 0:
            return text(edit.helpers[~i])
        n = kernel.nodes[i]
        return text(n) if n.op in ("const", "input") and i not in names else names.get(i, f"v{i}")

    def text(n: Node) -> str:
        if n.op == "const":
            return repr(n.value)
        if n.op == "input":
            return f"argument {n.source[0]}[{n.source[1]}]"
        return f"{n.op}({', '.join(map(atom, n.args))})"

    now = text(edit.now) if isinstance(edit.now, Node) else atom(edit.now)
    where = f"result {edit.result[0]}[{edit.result[1]}]" if edit.result else atom(edit.site)
    return f"{where} = {text(kernel.nodes[edit.site])}  ->  {now}"
