"""Comparisons by which a step checks its arguments against their ports' ranges."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from esea_gen.emit.walker import Kernel
from esea_gen.language.block import Block
from esea_gen.language.ports import Port


def range_checks(kernel: Kernel, ports: Mapping[int, Port]) -> dict[int, tuple[list[int], ...]]:
    """Per argument, the comparisons that let it pass, one of each list."""
    found: dict[int, tuple[list[int], ...]] = {
        k: ([], []) if p.size == 1 else ([],) for k, p in ports.items()
    }

    def constant(i: int) -> float | None:
        return kernel.nodes[i].value if kernel.nodes[i].op == "const" else None

    for i, n in enumerate(kernel.nodes):
        if n.op != "le":
            continue
        first, second = (kernel.nodes[a] for a in n.args)
        low, high = constant(n.args[0]), constant(n.args[1])
        for leaf, side in ((first, 0), (second, 1)):
            p = ports.get(leaf.source[0]) if leaf.op == "input" else None
            if p is None or p.size > 1:
                continue
            if (side == 0 and high is not None and high <= p.high) or (
                side == 1 and low is not None and low >= p.low
            ):
                found[leaf.source[0]][side].append(i)
        elements = _summed(kernel, n.args[0]) if first.op == "add" else None
        if elements and high is not None:
            k = elements[0][0]
            p = ports.get(k)
            if (
                p
                and sorted(elements) == [(k, e) for e in range(p.size)]
                and high <= vector_total(p)
            ):
                found[k][0].append(i)
    return found


def _summed(kernel: Kernel, i: int) -> list[tuple[int, int]] | None:
    # The elements whose magnitudes a node adds up.
    n = kernel.nodes[i]
    if n.op == "fabs" and kernel.nodes[n.args[0]].op == "input":
        return [kernel.nodes[n.args[0]].source]
    parts = [_summed(kernel, a) for a in n.args] if n.op == "add" else [None]
    return None if None in parts else [x for p in parts for x in p or ()]


def vector_total(p: Port) -> float:
    """Limit of a vector's sum of magnitudes in its guard."""
    return float(np.float32(1.001 * p.size * max(abs(p.low), abs(p.high))))


def coefficient_checks(block: Block, kernel: Kernel) -> dict[int, frozenset[int]]:
    """Coefficients that a step checks itself, and all nodes of that check."""
    checks = range_checks(kernel, dict(enumerate(block.coefficients)))
    return {
        k: frozenset(j for side in sides for i in side for j in _way(kernel, i))
        for k, sides in checks.items()
        if all(sides)
    }


def _way(kernel: Kernel, i: int) -> list[int]:
    # A comparison and what it sums up.
    if kernel.nodes[i].op not in ("le", "add", "fabs"):
        return []
    return [i, *(j for a in kernel.nodes[i].args for j in _way(kernel, a))]
