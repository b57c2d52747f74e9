"""Values of a kernel that are unsigned integers in C, and named values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any

import numpy as np

from esea_gen.emit.walker import COMPARING, SELECTING, Kernel, both_arms
from esea_gen.language.ports import Port

MOST_WHOLE = 2**32 - 1


def kind_of(port: Any) -> str:
    return getattr(port, "kind", "quantity")


def unsigned_nodes(
    kernel: Kernel, argument: Callable[[int], Any], ports: Sequence[Port]
) -> set[int]:
    """Nodes that C computes as ``uint32_t``: counts, selections and increments of them.

    A constant is either, and so is a choice of constants, which is whole where all that reads it
    is.  No sum or difference is whole that could wrap.
    """
    nodes = kernel.nodes
    most: dict[int, float] = {}  # of what can be a whole number, and the least
    least: dict[int, float] = {}
    whole = set()
    for i, n in enumerate(nodes):
        parts = n.args[n.op in SELECTING :]
        if n.op == "input":
            port = argument(n.source[0])
            if kind_of(port) == "count":
                least[i], most[i] = port.low, port.high
                whole.add(i)
        elif n.op == "const":
            if n.value >= 0 and n.value == np.floor(n.value):
                least[i] = most[i] = n.value
        elif n.op in (*SELECTING, "add", "sub") and all(a in most for a in parts):
            arms = both_arms(nodes, n)[1:] or parts
            lows, highs = ([ends[a] for a in arms] for ends in (least, most))
            if n.op == "sub":
                low, high = lows[0] - highs[1], highs[0] - lows[1]
            elif n.op == "add" and arms == parts:
                low, high = sum(lows), sum(highs)
            else:
                low, high = min(lows) if len(arms) > 1 else 0.0, max(highs)
            if low >= 0 and high <= MOST_WHOLE:
                least[i], most[i] = low, high
                whole |= {i} & {i for a in parts if a in whole}
    read_as_number: set[int] = set()
    for r, port in zip(kernel.results, ports, strict=False):
        read_as_number |= set(r) if port.kind == "quantity" else set()
    if not ports:
        read_as_number |= {i for r in kernel.results for i in r}
    for i in reversed(range(len(nodes))):
        n = nodes[i]
        if i in most and i not in read_as_number and n.op != "const":
            whole.add(i)
        compares = n.op in COMPARING and any(a in whole for a in n.args)
        if not (i in whole or (compares and all(a in most for a in n.args))):
            read_as_number |= set(n.args)
    return whole


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
