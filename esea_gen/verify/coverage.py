"""Branch coverage of emitted arithmetic; a side is set aside only with a proof."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from esea_gen.emit.formats import FORMATS, Format
from esea_gen.emit.walker import Kernel
from esea_gen.hostlib.codec import Array
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.block import Block
from esea_gen.language.stream import Stream
from esea_gen.verify.executor import emitted_kernel, evaluate, step_arguments
from esea_gen.verify.runs import run_c, run_symbolic
from esea_gen.verify.unreachable import guarded_ranges, why_impossible

# What each decision can do.  For a logical operation: each operand must have decided the result
# alone (masking MC/DC), which is more than the result having been true and false.
SIDES: dict[str, tuple[str, ...]] = {
    "fmin": ("first is less", "second is less"),
    "fmax": ("first is greater", "second is greater"),
    "fabs": ("negative", "positive"),
    "sign": ("negative", "positive"),
    "lt": ("true", "false"),
    "le": ("true", "false"),
    "eq": ("true", "false"),
    "ne": ("true", "false"),
    "not": ("true", "false"),
    "and": ("both true", "only first false", "only second false"),
    "or": ("both false", "only first true", "only second true"),
    "if_else_zero": ("true", "false"),
    "select": ("true", "false"),
}


def side_masks(op: str, args: Sequence[Array], value: Array) -> tuple[Array, ...]:
    x = args[0]
    if op in ("fmin", "fmax"):
        y = args[1]
        return (x < y, y < x) if op == "fmin" else (x > y, y > x)
    if op in ("fabs", "sign"):
        return x < 0, x > 0
    if op in ("and", "or"):
        p, q = x != 0, args[1] != 0
        return (p & q, ~p & q, p & ~q) if op == "and" else (~p & ~q, p & ~q, ~p & q)
    truth = value != 0 if op not in ("if_else_zero", "select") else x != 0
    return truth, ~truth


@dataclass
class Decision:
    """One decision of a kernel, with how often each side was taken."""

    node: int
    op: str
    where: str
    seen: dict[str, int]
    proofs: dict[str, str] = field(default_factory=dict)
    detectors: dict[str, str] = field(default_factory=dict)

    @property
    def missing(self) -> list[str]:
        """Sides neither seen, nor proven impossible, nor a detector's."""
        set_aside = self.proofs | self.detectors
        return [s for s, n in self.seen.items() if not n and s not in set_aside]


@dataclass
class Coverage:
    block: str
    real: str
    streams: tuple[str, ...]
    steps: int
    decisions: list[Decision]

    @property
    def sides(self) -> int:
        return sum(len(d.seen) - len(d.proofs) - len(d.detectors) for d in self.decisions)

    @property
    def excluded(self) -> list[str]:
        return self._set_aside("proofs")

    @property
    def detectors(self) -> list[str]:
        """Sides not seen that only a fault of the arithmetic itself takes; argued, not proven."""
        return self._set_aside("detectors")

    def _set_aside(self, why: str) -> list[str]:
        return [
            f"{d.where}: {d.op}, {side}: {text}"
            for d in self.decisions
            for side, text in getattr(d, why).items()
        ]

    @property
    def uncovered(self) -> list[str]:
        return [f"{d.where}: {d.op} never '{s}'" for d in self.decisions for s in d.missing]

    @property
    def ratio(self) -> float:
        return 1.0 - len(self.uncovered) / self.sides if self.sides else 1.0

    def to_dict(self) -> dict[str, Any]:
        return {
            "block": self.block,
            "format": self.real,
            "streams": list(self.streams),
            "steps": self.steps,
            "decisions": len(self.decisions),
            "sides": self.sides,
            "covered": self.sides - len(self.uncovered),
            "ratio": self.ratio,
            "uncovered": self.uncovered,
            "excluded": self.excluded,
            "detectors": self.detectors,
        }


def _where(
    final: Mapping[int, str],
    users: Mapping[int, Sequence[int]],
    names: dict[int, tuple[str, str]],
    node: int,
) -> str:
    # The nearest labelled value or result that needs the node: breadth first along its uses.
    own = names[node][0] if node in names else f"v{node}"
    front, seen = [node], {node}
    while front:
        for i in front:
            if i in names:
                name, comment = names[i]
                place = f"{name} ({comment})" if comment else name
                return place if i == node else f"{own} in {place}"
            if i in final:
                return f"{own} in the result {final[i]}"
        front = sorted({u for i in front for u in users.get(i, ())} - seen)
        seen.update(front)
    return own


def branch_coverage(
    block: Block, streams: Iterable[Stream], library: HostLibrary | None = None
) -> Coverage:
    """Count which sides of a Block's decisions a set of streams takes."""
    fmt = FORMATS[library.real if library else "f64"]
    kernel, names = emitted_kernel(block, fmt)
    ports = (*block.state, *block.outputs)
    final = {i: p.name for p, r in zip(ports, kernel.results, strict=True) for i in r}
    users: dict[int, list[int]] = defaultdict(list)
    for i, n in enumerate(kernel.nodes):
        for a in n.args:
            users[a].append(i)
    decisions = [
        Decision(i, n.op, _where(final, users, names, i), dict.fromkeys(SIDES[n.op], 0))
        for i, n in enumerate(kernel.nodes)
        if n.op in SIDES
    ]
    tried, steps = [], 0
    for stream in streams:
        if library:
            _, trace = run_c(library.block(block.name), stream)
        else:
            _, trace = run_symbolic(block, stream)
        arguments = step_arguments(block, stream, trace, fmt)
        values = evaluate(kernel, fmt, arguments)
        for d in decisions:
            args = [values[a] for a in kernel.nodes[d.node].args]
            for side, mask in zip(d.seen, side_masks(d.op, args, values[d.node]), strict=True):
                d.seen[side] += int(np.count_nonzero(mask))
        tried.append(stream.name)
        steps += stream.steps
    _prove(block, kernel, fmt, decisions)
    return Coverage(block.name, fmt.name, tuple(tried), steps, decisions)


def _prove(block: Block, kernel: Kernel, fmt: Format, decisions: list[Decision]) -> None:
    open_ = [d for d in decisions if d.missing]
    if not open_:
        return
    ranges = guarded_ranges(block, kernel, fmt)
    for d in open_:
        for side in d.missing:
            proof = why_impossible(kernel, ranges, d.node, side)
            if proof:
                d.proofs[side] = proof
    for port in block.outputs:
        for bit, flag in enumerate(port.flags):
            if flag.only_by_fault:
                _set_aside(kernel, decisions, float(1 << bit), flag.only_by_fault)


def _set_aside(kernel: Kernel, decisions: list[Decision], bit: float, text: str) -> None:
    # The select that sets the bit, and the condition that sets it alone.
    by_node = {d.node: d for d in decisions}
    for i, n in enumerate(kernel.nodes):
        if n.op not in ("if_else_zero", "select") or kernel.nodes[n.args[1]].op != "const":
            continue
        if kernel.nodes[n.args[1]].value != bit or "true" not in by_node[i].missing:
            continue
        by_node[i].detectors["true"] = text
        condition = by_node.get(n.args[0])
        if condition and "both true" in condition.missing:
            condition.detectors["both true"] = text
