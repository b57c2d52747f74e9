"""Branch coverage of emitted arithmetic: both sides of every minimum, maximum, comparison, select.

The kernel that a format prints is evaluated over the recorded steps of the streams
(:mod:`esea_gen.verify.executor`), and each decision's sides are counted.  A side that no input can
reach may be set aside, only with a proof by the range analysis or by logic, and is listed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from esea_gen.block import Block
from esea_gen.emit.formats import FORMATS, Format
from esea_gen.emit.ranges import RangeError, Value, analyse
from esea_gen.emit.walker import Kernel
from esea_gen.hostlib.library import Array, HostLibrary
from esea_gen.verify.equivalence import run_c, run_symbolic
from esea_gen.verify.executor import (
    coefficients_of,
    emitted_kernel,
    evaluate,
    initial_state,
    step_arguments,
)
from esea_gen.verify.streams import Stream

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


def _masks(op: str, args: Sequence[Array], value: Array) -> tuple[Array, ...]:
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
    """One decision of a kernel, with how often each side was taken.

    Parameters
    ----------
    node : int
        Its node in the printed kernel.
    op : str
        Operation.
    where : str
        What a reader looks for in the C: the name and comment of the nearest labelled value that
        uses it, and its own variable.
    seen : dict of str to int
        Steps per side.
    proofs : dict of str to str
        Sides that cannot be taken, and why.
    """

    node: int
    op: str
    where: str
    seen: dict[str, int]
    proofs: dict[str, str] = field(default_factory=dict)

    @property
    def missing(self) -> list[str]:
        """Sides neither seen nor proven impossible."""
        return [s for s, n in self.seen.items() if not n and s not in self.proofs]


@dataclass
class Coverage:
    """Branch coverage of a Block's step in one number format.

    Parameters
    ----------
    block, real : str
        What was covered.
    streams : tuple of str
        By which streams.
    steps : int
        How many steps.
    decisions : list of Decision
        In the kernel's order.
    """

    block: str
    real: str
    streams: tuple[str, ...]
    steps: int
    decisions: list[Decision]

    @property
    def sides(self) -> int:
        """Number of sides that can be taken."""
        return sum(len(d.seen) - len(d.proofs) for d in self.decisions)

    @property
    def excluded(self) -> list[str]:
        """Sides proven impossible, each with its proof."""
        return [
            f"{d.where}: {d.op}, {side}: {proof}"
            for d in self.decisions
            for side, proof in d.proofs.items()
        ]

    @property
    def uncovered(self) -> list[str]:
        """Sides that the streams miss, each with where it stands."""
        return [f"{d.where}: {d.op} never '{s}'" for d in self.decisions for s in d.missing]

    @property
    def ratio(self) -> float:
        """Share of the possible sides that were taken."""
        return 1.0 - len(self.uncovered) / self.sides if self.sides else 1.0

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content."""
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
        }


def _where(block: Block, kernel: Kernel, names: dict[int, tuple[str, str]], node: int) -> str:
    # The nearest labelled value or result that needs the node: breadth first along its uses.
    ports = (*block.state, *block.outputs)
    final = {i: p.name for p, r in zip(ports, kernel.results, strict=True) for i in r}
    users: dict[int, list[int]] = {}
    for i, n in enumerate(kernel.nodes):
        for a in n.args:
            users.setdefault(a, []).append(i)
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
    """Count which sides of a Block's decisions a set of streams takes.

    Parameters
    ----------
    block : Block
        The Block, at its default tunables.
    streams : iterable of Stream
        What to run.
    library : HostLibrary, optional
        Cover the kernel that this C was printed from, over the states that the C itself recorded;
        without it, the f64 kernel over the symbolic Block's states.

    Returns
    -------
    Coverage
        Per decision and side.
    """
    fmt = FORMATS[library.real if library else "f64"]
    kernel, names = emitted_kernel(block, fmt)
    coefficients = coefficients_of(block, fmt, {})
    initial = initial_state(block, fmt, coefficients)
    decisions = [
        Decision(i, n.op, _where(block, kernel, names, i), dict.fromkeys(SIDES[n.op], 0))
        for i, n in enumerate(kernel.nodes)
        if n.op in SIDES
    ]
    tried, steps = [], 0
    for stream in streams:
        if library:
            _, trace = run_c(library.block(block.name), stream)
        else:
            _, trace = run_symbolic(block, stream)
        arguments = step_arguments(block, stream, trace, initial, coefficients, fmt)
        values = evaluate(kernel, fmt, arguments)
        for d in decisions:
            args = [values[a] for a in kernel.nodes[d.node].args]
            for side, mask in zip(d.seen, _masks(d.op, args, values[d.node]), strict=True):
                d.seen[side] += int(np.count_nonzero(mask))
        tried.append(stream.name)
        steps += stream.steps
    _prove(block, kernel, names, fmt, coefficients, decisions)
    return Coverage(block.name, fmt.name, tuple(tried), steps, decisions)


def guarded_ranges(
    block: Block,
    kernel: Kernel,
    names: Mapping[int, tuple[str, str]],
    fmt: Format,
    coefficients: Sequence[Array],
) -> dict[int, Value]:
    """Ranges that hold whatever stands in inputs and states, because the guard stands before.

    Parameters
    ----------
    block : Block
        The Block.
    kernel : Kernel
        Its step kernel as printed.
    names : mapping of int to (str, str)
        Its labelled nodes, the guard's among them.
    fmt : Format
        Number format.
    coefficients : sequence of ndarray
        Per coefficient port.

    Returns
    -------
    dict of int to Value
        Per node that no unguarded input or state reaches; empty when the range analysis has no rule
        for a node, or finds no finite range.
    """

    def wide(low: float, high: float) -> Value:
        # A little more than the port's range: the guard's own comparisons stay undecided, so that
        # both arms of everything that hangs on them count.
        room = 1e-6 * (high - low)
        return Value(low - room, high + room, 0.0, 0.0)

    arguments = [[Value(float(x), float(x)) for x in c] for c in coefficients]
    arguments += [[wide(p.low, p.high)] * p.size for p in (*block.state, *block.inputs)]
    everything = Kernel(kernel.name, kernel.nodes, (tuple(range(len(kernel.nodes))),))
    try:
        ranges = analyse(everything, fmt, arguments).results[0]
    except RangeError:
        return {}
    raw = _unguarded(block, kernel, names)
    for n in kernel.nodes:
        if n.op in ("if_else_zero", "select") and raw[n.args[0]]:
            condition = ranges[n.args[0]]
            if condition.low == condition.high:
                return {}  # decided by a range that an unguarded value need not keep
    return {i: v for i, v in enumerate(ranges) if not raw[i]}


def _unguarded(
    block: Block, kernel: Kernel, names: Mapping[int, tuple[str, str]]
) -> list[frozenset[int]]:
    # Per node, the arguments that reach it without having passed their guard.
    start = len(block.coefficients)
    states = frozenset(range(start, start + len(block.state)))
    first = start + len(block.state)
    guards = {"state_ok": states, "inputs_ok": frozenset(range(first, first + len(block.inputs)))}
    guards |= {f"{p.name}_ok": frozenset({first + k}) for k, p in enumerate(block.inputs)}
    own = {i: guards[name] for i, (name, _) in names.items() if name in guards}
    raw: list[frozenset[int]] = []

    def arm(condition: int, truth: bool, node: int) -> frozenset[int]:
        known = imply(kernel, condition, truth)
        passed = (ports for i, ports in own.items() if known.get(i) == 1.0)
        return raw[node].difference(*passed)

    for n in kernel.nodes:
        if n.op == "input":
            raw.append(frozenset({n.source[0]} if n.source[0] >= start else ()))
        elif n.op in ("if_else_zero", "select"):
            reached = arm(n.args[0], True, n.args[1])
            if n.op == "select":
                reached |= arm(n.args[0], False, n.args[2])
            raw.append(reached)
        else:
            raw.append(frozenset().union(*(raw[a] for a in n.args)))
    return raw


def _prove(
    block: Block,
    kernel: Kernel,
    names: Mapping[int, tuple[str, str]],
    fmt: Format,
    coefficients: Sequence[Array],
    decisions: list[Decision],
) -> None:
    open_ = [d for d in decisions if d.missing]
    if not open_:
        return
    ranges = guarded_ranges(block, kernel, names, fmt, coefficients)
    for d in open_:
        args = kernel.nodes[d.node].args
        for side in d.missing:
            proof = ""
            if d.op in ("and", "or"):
                proof = _impossible(kernel, args, side)
            elif all(a in ranges for a in args):
                proof = _by_range(d.op, [ranges[a] for a in args], side)
            if proof:
                d.proofs[side] = proof


def span(v: Value) -> tuple[float, float]:
    """Interval of a value, exact and computed alike.

    Parameters
    ----------
    v : Value
        From the range analysis.

    Returns
    -------
    tuple of float
        Its ends.
    """
    return min(v.low, v.computed_low), max(v.high, v.computed_high)


def _by_range(op: str, v: Sequence[Value], side: str) -> str:
    low, high = span(v[0])
    text = f"[{low:.6g}, {high:.6g}]"
    if op in ("fabs", "sign"):
        impossible = low >= 0 if side == "negative" else high <= 0
        return f"the value lies in {text}" if impossible else ""
    if op not in ("fmin", "fmax", "lt", "le"):
        return ""
    other_low, other_high = span(v[1])
    text = f"the first lies in {text}, the second in [{other_low:.6g}, {other_high:.6g}]"
    impossible = {
        "first is less": low >= other_high,
        "second is less": high <= other_low,
        "first is greater": high <= other_low,
        "second is greater": low >= other_high,
        "true": low >= other_high if op == "lt" else low > other_high,
        "false": high < other_low if op == "lt" else high <= other_low,
    }[side]
    return text if impossible else ""


def _impossible(kernel: Kernel, args: tuple[int, ...], side: str) -> str:
    # Assume the operand that is to decide alone, and see whether the other one follows from it.
    wanted = {
        "both true": (True, True),
        "both false": (False, False),
        "only first false": (False, True),
        "only second false": (True, False),
        "only first true": (True, False),
        "only second true": (False, True),
    }[side]
    for assumed, implied in ((0, 1), (1, 0)):
        known = imply(kernel, args[assumed], wanted[assumed])
        got = known.get(args[implied])
        if got is not None and bool(got) != wanted[implied]:
            names = ("first", "second")
            return (
                f"the {names[assumed]} operand being {str(wanted[assumed]).lower()} makes the "
                f"{names[implied]} {str(bool(got)).lower()}"
            )
    return ""


def imply(kernel: Kernel, node: int, truth: bool, without: int | None = None) -> dict[int, float]:
    """Values that follow from a boolean node's being true or false.

    Parameters
    ----------
    kernel : Kernel
        The kernel.
    node : int
        The node.
    truth : bool
        Its assumed value.
    without : int, optional
        A node that nothing is to be concluded about, nor from.

    Returns
    -------
    dict of int to float
        Nodes with a known value.
    """
    known: dict[int, float] = {node: float(truth)}
    front = [(node, truth)]
    while front:  # what must have been so
        i, value = front.pop()
        n = kernel.nodes[i]
        back: list[tuple[int, bool]] = []
        if n.op == "not":
            back = [(n.args[0], not value)]
        elif (n.op == "and" and value) or (n.op == "or" and not value):
            back = [(a, value) for a in n.args]
        elif value and n.op in ("if_else_zero", "select"):
            other = kernel.nodes[n.args[2]] if n.op == "select" else None
            if other is None or (other.op == "const" and other.value == 0):
                back = [(n.args[0], True)]
        for a, v in back:
            if kernel.nodes[a].boolean:
                known[a] = float(v)
            front.append((a, v))
    for i, n in enumerate(kernel.nodes):  # and what follows
        if i in known or i == without:
            continue
        got = [known.get(a) for a in n.args]
        if n.op == "const":
            known[i] = n.value
        elif n.op == "not" and got[0] is not None:
            known[i] = float(not got[0])
        elif n.op in ("and", "or"):
            strong = n.op == "or"
            if any(x is not None and bool(x) == strong for x in got):
                known[i] = float(strong)
            elif all(x is not None for x in got):
                known[i] = float(not strong)
        elif n.op in ("if_else_zero", "select") and got[0] is not None:
            arms = [got[1], got[2] if n.op == "select" else 0.0]
            chosen = arms[0] if got[0] else arms[1]
            if chosen is not None:
                known[i] = chosen
    return known
