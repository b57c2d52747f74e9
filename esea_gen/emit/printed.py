"""Kernels and Blocks as pieces of C text, whatever their number format."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass

from esea_gen.language.block import Block


def comment(text: str, indent: int = 0, width: int = 98) -> str:
    pad = " " * indent
    safe = " ".join(text.replace("*/", "* /").split())
    lines = textwrap.wrap(safe, width - indent - 6)
    if len(lines) <= 1:
        return f"{pad}/* {safe} */"
    return "\n".join(
        [f"{pad}/* {lines[0]}"]
        + [f"{pad} * {x}" for x in lines[1:-1]]
        + [f"{pad} * {lines[-1]} */"]
    )


def bare(text: str) -> str:
    """C text without the brackets round the whole of it."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for i, c in enumerate(text):
        depth += (c == "(") - (c == ")")
        if depth == 0 and i < len(text) - 1:
            return text
    return text[1:-1]


@dataclass(frozen=True)
class Statement:
    c_type: str
    name: str
    expression: str
    comment: str = ""


@dataclass(frozen=True)
class PrintedKernel:
    statements: tuple[Statement, ...]
    results: tuple[tuple[str, ...], ...]  # per result, per element, the C atom that holds it
    used_arguments: frozenset[int]


@dataclass(frozen=True)
class EmittedBlock:
    block: Block
    prepare: PrintedKernel | None
    init: PrintedKernel
    step: PrintedKernel
    stores: tuple[tuple[str, ...], ...]  # per statement of the step, the state that it completes
    template: str = "device/esea_block.c.j2"


def early_stores(block: Block, step: PrintedKernel) -> tuple[tuple[str, ...], ...]:
    """Where in a step each state can be stored: as soon as the old one is read and the new known.

    Stored at the end, every new state would stay alive until there; with ten stop operators and
    sixteen registers that costs a tenth of the step.
    """
    count = len(step.statements)
    defined = {s.name: i for i, s in enumerate(step.statements)}
    read = {s.expression: i for i, s in enumerate(step.statements)}
    after: list[list[str]] = [[] for _ in range(count)]
    for p, atoms in zip(block.state, step.results, strict=False):
        for i, atom in enumerate(atoms):
            place = f"state->{p.name}" + ("" if p.size == 1 else f"[{i}]")
            waits = [defined[w] for w in re.findall(r"[A-Za-z_]\w*", atom) if w in defined]
            waits.append(read.get(place, 0))
            after[max(waits)].append(f"{place} = {bare(atom)};")
    return tuple(map(tuple, after))
