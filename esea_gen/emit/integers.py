"""Values of a kernel that are integers in C, and named values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from itertools import chain, product
from operator import add, mul, sub
from typing import Any

from esea_gen.emit.printed import field_type
from esea_gen.emit.walker import COMPARING, SELECTING, Kernel, both_arms
from esea_gen.language.ports import Port

UNSIGNED, SIGNED = "uint32_t", "int32_t"
_UNSIGNED = SELECTING | {"add", "sub"}
_RULES: dict[str, Any] = {"add": add, "sub": sub, "mul": mul, "fabs": abs, "fmin": min, "fmax": max}


def kind_of(port: Any) -> str:
    return getattr(port, "kind", "quantity")


def integer_nodes(
    kernel: Kernel, argument: Callable[[int], Any], ports: Sequence[Port]
) -> dict[int, str]:
    """C type of each node that C computes as an integer: counts, sums and selections of them.

    A constant is either, and so is a choice of constants, which is whole where all that reads it
    is.  Nothing is whole that could wrap: what memory holds for a signed count is only chosen and
    compared, until the guard has chosen it.
    """
    nodes = kernel.nodes
    ends: dict[int, tuple[float, float]] = {}  # of what can be a whole number
    types, found = dict[int, str](), dict[int, str]()
    raw = set[int]()  # signed counts as memory holds them: any pattern
    for i, n in enumerate(nodes):
        parts = n.args[n.op in SELECTING :]
        if n.op == "input":
            port = argument(n.source[0])
            if kind_of(port) == "count":
                ends[i] = port.low, port.high
                found[i] = types[i] = field_type(port, "")
                raw |= {i} if port.low < 0 else set()
        elif n.op == "const" and n.value == n.value // 1:
            ends[i] = n.value, n.value
        elif n.op in _UNSIGNED | _RULES.keys() and all(a in ends for a in parts):
            arms = both_arms(nodes, n)[1:] or parts
            chooses = n.op in SELECTING or arms != parts
            given = [ends[a] for a in arms]
            corners = product(*given)
            reached = [*chain(*given)] if chooses else [_RULES[n.op](*x) for x in corners]
            reached += [0.0] * (n.op in ("if_else_zero", "fabs"))
            low, high = min(reached), max(reached)
            # A zero that is negative, or what memory holds, is a number.
            signs = n.op == "mul" and not any(x == y > 0 for x, y in given)
            if signs or max(-low, high) >= 2**31 or not (chooses or raw.isdisjoint(arms)):
                continue
            unsigned = n.op in _UNSIGNED and low >= 0 and all(x >= 0 for x, _ in given)
            ends[i], types[i] = (low, high), UNSIGNED if unsigned else SIGNED
            if any(a in found for a in parts):
                found[i] = types[i]
    kinds = [p.kind for p in ports] or ["quantity"] * len(kernel.results)
    numbers = (r for r, kind in zip(kernel.results, kinds, strict=False) if kind == "quantity")
    read_as_number, read_as_signed = set(chain(*numbers)), set[int]()
    for i in reversed(range(len(nodes))):
        n = nodes[i]
        if i in types and i not in read_as_number:
            found.setdefault(i, SIGNED if i in read_as_signed else types[i])
        compares = n.op in COMPARING and any(a in found for a in n.args)
        if not (i in found or (compares and all(a in ends for a in n.args))):
            read_as_number |= set(n.args)
        read = (i, *n.args) if compares else (i,)
        read_as_signed |= set(n.args) if SIGNED in map(found.get, read) else set()
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
