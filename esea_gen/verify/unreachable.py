"""Sides of a decision that no input can reach, proven by the guard's ranges or by logic."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence

from esea_gen.emit.checks import range_checks, vector_total
from esea_gen.emit.formats.base import Format
from esea_gen.emit.walker import Kernel, Node
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.verify.intervals import ANYTHING, Interval, computed_intervals


def guarded_ranges(block: Block, kernel: Kernel, fmt: Format) -> dict[int, Interval]:
    """Ranges for any inputs and states, which the guard enforces."""

    def passed(p: Port) -> Interval:
        # What the guard lets pass: of a vector, it looks at the sum of magnitudes.
        if p.size == 1:
            return Interval(p.low, p.high)
        return Interval(-vector_total(p), vector_total(p))

    arguments = [[Interval(p.low, p.high)] * p.size for p in block.coefficients]
    arguments += [[passed(p)] * p.size for p in (*block.state, *block.inputs)]
    raw = _unguarded(block, kernel)
    # The guard's own comparisons, and any other of an unguarded value, may go either way.
    open_ = {i for i, n in enumerate(kernel.nodes) if n.boolean and raw[i]}
    ranges = computed_intervals(kernel, fmt, arguments, open_)
    found = {i: v for i, v in enumerate(ranges) if not raw[i]}
    # Whatever comes in, a boolean is 0 or 1, and a choice between two constants is one of them.
    free = [[ANYTHING] * len(a) for a in arguments]
    for i, v in enumerate(computed_intervals(kernel, fmt, free)):
        if i not in found and v != ANYTHING:
            found[i] = v
    return found


def _unguarded(block: Block, kernel: Kernel) -> list[frozenset[int]]:
    # Per node, the arguments that reach it without having passed their guard.
    start = len(block.coefficients)
    ports = dict(enumerate((*block.coefficients, *block.state, *block.inputs)))
    checks = range_checks(kernel, ports)
    # A coefficient that the step itself checks may be anything before; others are as prepared.
    checks = {k: sides for k, sides in checks.items() if k >= start or all(sides)}
    raw: list[frozenset[int]] = []
    arms: dict[tuple[int, bool], frozenset[int]] = {}

    def passed(condition: int, truth: bool) -> frozenset[int]:
        if (condition, truth) not in arms:
            known = imply(kernel, condition, truth)
            arms[condition, truth] = frozenset(
                k
                for k, sides in checks.items()
                if all(any(known.get(i) == 1.0 for i in side) for side in sides)
            )
        return arms[condition, truth]

    for n in kernel.nodes:
        if n.op == "input":
            raw.append(frozenset({n.source[0]} & checks.keys()))
        elif n.op in ("if_else_zero", "select"):
            reached = raw[n.args[1]] - passed(n.args[0], True)
            if n.op == "select":
                reached |= raw[n.args[2]] - passed(n.args[0], False)
            raw.append(reached)
        else:
            raw.append(frozenset().union(*(raw[a] for a in n.args)))
    return raw


def why_impossible(kernel: Kernel, ranges: Mapping[int, Interval], node: int, side: str) -> str:
    """Why a side of a decision is never taken; empty without a proof."""
    n = kernel.nodes[node]
    if n.op in ("and", "or"):
        for name, a, wanted in zip(("first", "second"), n.args, _OPERANDS[side], strict=True):
            if a in ranges and ranges[a].settled and (ranges[a].low != 0) != wanted:
                return f"the {name} operand is always {str(not wanted).lower()}"
        return _impossible(kernel, n.args, side)
    if all(a in ranges for a in n.args):
        return _by_range(n.op, [ranges[a] for a in n.args], side)
    return ""


def _by_range(op: str, v: Sequence[Interval], side: str) -> str:
    low, high = v[0].low, v[0].high
    text = f"[{low:.6g}, {high:.6g}]"
    if op in ("fabs", "sign"):
        impossible = low >= 0 if side == "negative" else high <= 0
        return f"the value lies in {text}" if impossible else ""
    if op in ("if_else_zero", "select"):
        known = v[0].settled and (v[0].low != 0) != (side == "true")
        return f"the condition is always {str(side != 'true').lower()}" if known else ""
    if op == "not":
        known = v[0].settled and (v[0].low == 0) != (side == "true")
        return f"the operand is always {str(side == 'true').lower()}" if known else ""
    if op not in ("fmin", "fmax", "lt", "le"):
        return ""
    # What may be NaN is neither less nor not: it decides for "false".
    if side == "false" and (v[0].nan or v[1].nan):
        return ""
    other_low, other_high = v[1].low, v[1].high
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


# What each side of a logical operation says of both operands.
_OPERANDS = {
    "both true": (True, True),
    "both false": (False, False),
    "only first false": (False, True),
    "only second false": (True, False),
    "only first true": (True, False),
    "only second true": (False, True),
}


def _impossible(kernel: Kernel, args: tuple[int, ...], side: str) -> str:
    # Assume the operand that is to decide alone, and see whether the other one follows from it.
    wanted = _OPERANDS[side]
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
    """Values that follow from a boolean node's being true or false."""
    # A flag in memory that is true may hold any other number than 0.
    known = {node: float(truth)} if kernel.nodes[node].boolean or not truth else {}
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
        back += _choices(kernel, n, value)
        for a, v in back:
            if kernel.nodes[a].boolean:
                known[a] = float(v)
            front.append((a, v))
    same = list(range(len(kernel.nodes)))  # the arm that a decided choice takes
    comparisons = {(n.op, n.args): i for i, n in enumerate(kernel.nodes) if n.op in _RELATIONS}
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
            if got[0] or n.op == "select":
                same[i] = same[n.args[1 if got[0] else 2]]
            if chosen is not None:
                known[i] = chosen
        elif n.op in _RELATIONS and got[0] is not None and got[1] is not None:
            known[i] = float(_RELATIONS[n.op](got[0], got[1]))
        elif n.op in _RELATIONS:
            alike = comparisons.get((n.op, tuple(same[a] for a in n.args)), -1)
            if alike in known:
                known[i] = known[alike]
        elif n.op == "add" and 0.0 in got and None not in got:
            known[i] = float(sum(x for x in got if x))
    return known


_RELATIONS: dict[str, Callable[[float, float], bool]] = {
    "lt": operator.lt,
    "le": operator.le,
    "eq": operator.eq,
    "ne": operator.ne,
}


def _choices(kernel: Kernel, comparison: Node, truth: bool) -> Iterator[tuple[int, bool]]:
    # A comparison of a constant with a choice that has a constant arm: where that arm contradicts
    # the outcome, the other one was taken.
    for place in (0, 1) if comparison.op in _RELATIONS else ():
        other = kernel.nodes[comparison.args[1 - place]]
        choice = kernel.nodes[comparison.args[place]]
        if other.op != "const" or choice.op not in ("if_else_zero", "select"):
            continue
        arms: list[float | None] = [
            kernel.nodes[a].value if kernel.nodes[a].op == "const" else None
            for a in choice.args[1:]
        ]
        arms += [0.0] if choice.op == "if_else_zero" else []
        for taken, value in zip((True, False), arms, strict=True):
            if value is None:
                continue
            sides = (value, other.value) if place == 0 else (other.value, value)
            if _RELATIONS[comparison.op](*sides) != truth:
                yield choice.args[0], not taken
