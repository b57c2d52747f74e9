"""Values of a kernel that are integers in C, and named values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any

from esea_gen.emit.printed import field_type
from esea_gen.emit.walker import COMPARING, SELECTING, Kernel, both_arms
from esea_gen.language.ports import Port

UNSIGNED, SIGNED = "uint32_t", "int32_t"
MOST_WHOLE = 2**31 - 1
_JOINING = frozenset({"add", "sub", *SELECTING})
_SIGNED = frozenset({"fabs", "fmin", "fmax", "mul"})

Ends = tuple[float, float]


def kind_of(port: Any) -> str:
    return getattr(port, "kind", "quantity")


def _joined(op: str, ends: Sequence[Ends]) -> Ends | None:
    # Where the result lies; None where C has no operation of integers, or a zero may be negative.
    lows, highs = zip(*ends, strict=True)
    if op == "sub":
        return lows[0] - highs[1], highs[0] - lows[1]
    if op == "add":
        return sum(lows), sum(highs)
    if op == "mul":
        positive = [low for low, high in ends if low == high > 0]
        return (lows[0] * lows[1], highs[0] * highs[1]) if positive else None
    if op == "fabs":
        return 0.0, max(-lows[0], highs[0])
    if op in ("fmin", "fmax"):
        choose = min if op == "fmin" else max
        return choose(lows), choose(highs)
    return min(lows), max(highs)


def integer_nodes(
    kernel: Kernel, argument: Callable[[int], Any], ports: Sequence[Port]
) -> dict[int, str]:
    """C type of each node that C computes as an integer: counts, sums and selections of them.

    A constant is either, and so is a choice of constants, which is whole where all that reads it
    is.  Nothing is whole that could wrap: what memory holds for a signed count is only chosen and
    compared, until the guard has chosen it.
    """
    nodes = kernel.nodes
    ends: dict[int, Ends] = {}  # of what can be a whole number
    types: dict[int, str] = {}
    found: dict[int, str] = {}
    raw = set()  # signed counts as memory holds them: any pattern
    for i, n in enumerate(nodes):
        parts = n.args[n.op in SELECTING :]
        if n.op == "input":
            port = argument(n.source[0])
            if kind_of(port) == "count":
                ends[i] = port.low, port.high
                found[i] = types[i] = field_type(port, "")
                raw |= {i} if port.low < 0 else set()
        elif n.op == "const":
            if n.value == n.value // 1:
                ends[i] = n.value, n.value
        elif n.op in _JOINING | _SIGNED and all(a in ends for a in parts):
            arms = both_arms(nodes, n)[1:] or parts
            given = [ends[a] for a in arms]
            zero = [(0.0, 0.0)] if n.op == "if_else_zero" else []
            op = n.op if arms == parts else "select"
            reached = _joined(op, [*given, *zero])
            unguarded = op not in SELECTING and not raw.isdisjoint(arms)
            if reached is None or unguarded or max(-reached[0], reached[1]) > MOST_WHOLE:
                continue
            alike = n.op in _JOINING and all(low >= 0 for low, _ in (*given, reached))
            ends[i], types[i] = reached, UNSIGNED if alike else SIGNED
            if any(a in found for a in parts):
                found[i] = types[i]
    read_as_number, read_as_signed = set[int](), set[int]()
    for r, port in zip(kernel.results, ports, strict=False):
        read_as_number |= set(r) if port.kind == "quantity" else set()
    if not ports:
        read_as_number |= {i for r in kernel.results for i in r}
    for i in reversed(range(len(nodes))):
        n = nodes[i]
        if i in types and i not in read_as_number:
            found.setdefault(i, SIGNED if i in read_as_signed else types[i])
        compares = n.op in COMPARING and any(a in found for a in n.args)
        if not (i in found or (compares and all(a in ends for a in n.args))):
            read_as_number |= set(n.args)
        read_as_signed |= set(n.args) if found.get(i) == SIGNED else set()
    return found


def chosen_nodes(
    kernel: Kernel, argument: Callable[[int], Any], ports: Sequence[Port]
) -> dict[int, type[IntEnum]]:
    """Nodes with a choice's numbers: arguments, results, and selections from them."""
    nodes = kernel.nodes
    fed = {i: argument(n.source[0]) for i, n in enumerate(nodes) if n.op == "input"}
    fed |= {i: p for r, p in zip(kernel.results, ports, strict=False) for i in r}
    found = {i: p.choices for i, p in fed.items() if getattr(p, "choices", None) is not None}
    selects = [(i, *n.args[1:]) for i, n in enumerate(nodes) if n.op in SELECTING]
    for select in (*selects, *reversed(selects)):
        alike = [i for i in select if nodes[i].op != "const"]  # a constant is any choice's
        known = [found[i] for i in alike if i in found]
        found |= dict.fromkeys(alike, known[0]) if known else {}
    return found
