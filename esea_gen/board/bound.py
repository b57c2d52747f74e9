"""A bound on the instructions of one step that holds for every input, from the object code.

How often basic blocks can run at most, together, is a linear program (implicit path enumeration, Li
and Malik, DAC 1995). A loop that cannot be attributed, a jump through a table or a register, or
recursion, is an error, never a guess.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array

from esea_gen.emit.program_c import LoopBound
from esea_gen.hostlib.compiler import find_compiler, run_tool
from esea_gen.targets import ARM_GCC

_CONDITIONS = "eq|ne|cs|hs|cc|lo|mi|pl|vs|vc|hi|ls|ge|lt|gt|le"
_BRANCH = re.compile(rf"b({_CONDITIONS})?(\.n|\.w)?$")
_CALL = re.compile(rf"blx?({_CONDITIONS})?(\.n|\.w)?$")
_CONDITIONAL = re.compile(rf".*({_CONDITIONS})(\.n|\.w)?$")


Node = tuple[str, int]  # function and address of a basic block
Row = tuple[Counter[int], float]  # coefficients by unknown, and the right-hand side


class BoundError(Exception):
    """The object code has something without a time bound."""


@dataclass(frozen=True)
class Instruction:
    """One instruction."""

    address: int
    name: str
    operands: str
    file: str
    line: int


@dataclass
class CodeBlock:
    """A basic block."""

    code: list[Instruction]
    to: list[int] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    returns: bool = False


@dataclass(frozen=True)
class InstructionBound:
    """The bound and where it comes from."""

    instructions: int
    by_function: dict[str, tuple[int, int]]


def disassemble(elf: Path) -> dict[str, list[Instruction]]:
    """Every function of a linked program."""
    command = [find_compiler(*ARM_GCC.tool("objdump")), "-dl", "--no-show-raw-insn", elf]
    said = run_tool(command, failed="the disassembler failed").stdout
    functions: dict[str, list[Instruction]] = {}
    code: list[Instruction] = []
    file, line = "", 0
    for text in said.splitlines():
        if head := re.match(r"[0-9a-f]+ <(.+)>:$", text):
            code = functions.setdefault(head[1], [])
            file, line = "", 0
        elif place := re.match(r"(/?\S.*):(\d+)( \(discriminator \d+\))?$", text):
            file, line = Path(place[1]).name, int(place[2])
        elif (found := re.match(r"\s+([0-9a-f]+):\t(\S+)\s*(.*)$", text)) and not found[
            2
        ].startswith("."):
            operands = found[3].split(";")[0].split("@")[0].strip()
            code.append(Instruction(int(found[1], 16), found[2], operands, file, line))
    return functions


def _is_return(i: Instruction) -> bool:
    if i.name.startswith("bx") and "lr" in i.operands:
        return True
    if i.name.startswith(("pop", "ldm")) and re.search(r"\bpc\b", i.operands):
        return True
    return i.name.startswith(("mov", "ldr")) and i.operands.startswith("pc,")


def blocks_of(name: str, functions: Mapping[str, list[Instruction]]) -> dict[int, CodeBlock]:
    """Control-flow graph of a function."""
    code = functions[name]
    starts_of = {c[0].address: n for n, c in functions.items() if c}
    inside = {i.address for i in code}
    leaders = {code[0].address}
    target: dict[int, int] = {}
    for k, i in enumerate(code):
        is_branch = _BRANCH.match(i.name) or i.name in ("cbz", "cbnz")
        if i.name.startswith(("tbb", "tbh")) or (
            i.name.startswith(("mov", "ldr", "add")) and re.match(r"pc,(?!.*\[sp)", i.operands)
        ):
            raise BoundError(f"{name}: jump through a table or register at {i.address:#x}")
        if i.name.startswith("bx") and "lr" not in i.operands:
            raise BoundError(f"{name}: jump through a register at {i.address:#x}")
        if _CALL.match(i.name) and not re.search(r"[0-9a-f]+ <", i.operands):
            raise BoundError(f"{name}: call through a register at {i.address:#x}")
        if is_branch:
            found = re.search(r"\b([0-9a-f]+) <", i.operands)
            if found is None:
                raise BoundError(f"{name}: no target for {i.name} {i.operands}")
            target[i.address] = int(found[1], 16)
            if target[i.address] in inside:
                leaders.add(target[i.address])
        if (is_branch or _is_return(i)) and k + 1 < len(code):
            leaders.add(code[k + 1].address)
    blocks: dict[int, CodeBlock] = {}
    block = CodeBlock([])
    for k, i in enumerate(code):
        if i.address in leaders:
            block = blocks.setdefault(i.address, CodeBlock([]))
        block.code.append(i)
        following = code[k + 1].address if k + 1 < len(code) else None
        ends = following is None or following in leaders
        if _CALL.match(i.name):
            to = int(re.search(r"([0-9a-f]+) <", i.operands)[1], 16)  # type: ignore[index]
            if to not in starts_of:
                raise BoundError(f"{name}: call of an unknown function at {i.address:#x}")
            block.calls.append(starts_of[to])
        if i.address in target:
            goal = target[i.address]
            conditional = i.name.startswith("cb") or _CONDITIONAL.match(i.name.split(".")[0][1:])
            if goal in inside:
                block.to.append(goal)
            elif goal in starts_of:  # a tail call
                block.calls.append(starts_of[goal])
                block.returns = True
            else:
                raise BoundError(f"{name}: branch into the middle of a function")
            if conditional and following is not None:
                block.to.append(following)
        elif _is_return(i):
            block.returns = True
            if _CONDITIONAL.match(i.name.split(".")[0]) and following is not None:
                block.to.append(following)
        elif ends and following is not None:
            block.to.append(following)
    return blocks


def _reached(blocks: Mapping[int, CodeBlock], entry: int, without: int = -1) -> set[int]:
    seen: set[int] = set()
    todo = [entry]
    while todo:
        n = todo.pop()
        if n not in seen and n != without:
            seen.add(n)
            todo += blocks[n].to
    return seen


def _loops(blocks: Mapping[int, CodeBlock], entry: int) -> dict[int, set[int]]:
    # Natural loops by header: every way to the source of a back edge passes its target.  Where a
    # cycle is left without the back edges, the graph is irreducible.
    before: dict[int, set[int]] = {n: set() for n in _reached(blocks, entry)}
    for n in before:
        for m in blocks[n].to:
            before[m].add(n)
    back = {m: sources - _reached(blocks, entry, m) for m, sources in before.items()}
    try:
        TopologicalSorter({m: before[m] - back[m] for m in before}).prepare()
    except CycleError as error:
        raise BoundError(f"a loop with two entries at {error.args[1][0]:#x}") from None
    loops: dict[int, set[int]] = {}
    for header, sources in back.items():
        todo = list(sources)
        body = loops.setdefault(header, {header}) if todo else set()
        while todo:
            x = todo.pop()
            if x not in body:
                body.add(x)
                todo += before[x]
    return loops


def _attribute(
    loops: Mapping[int, set[int]],
    blocks: Mapping[int, CodeBlock],
    source: str,
    ranges: Mapping[str, tuple[int, int]],
    limits: Mapping[str, LoopBound],
    elsewhere: Mapping[str, str],
) -> dict[int, str]:
    # The smallest source loop that holds every line of a machine loop; where a loop inside has
    # taken that one already, the next larger.  A compiler may turn one loop into two, one in the
    # other, or share code between loops: then the machine loop gets, of the source loops that any
    # of its lines is in, the one with the most passes, which can only be too many.
    found: dict[int, str] = {}
    for header in sorted(loops, key=lambda h: len(loops[h])):
        code = [i for b in loops[header] for i in blocks[b].code if i.line]
        known = {source, *elsewhere.values()}
        lines = {(i.file, i.line) for i in code if i.file in known}

        def inside(var: str, place: tuple[str, int]) -> bool:
            first, last = ranges[var]
            return place[0] == elsewhere.get(var, source) and first <= place[1] <= last

        taken = {found[h] for h in found if loops[h] < loops[header]}
        fits = [
            (last - first, var)
            for var, (first, last) in ranges.items()
            if lines and all(inside(var, x) for x in lines) and var not in taken
        ]
        touched = [
            (limits[var].passes, var) for var in ranges if any(inside(var, x) for x in lines)
        ]
        if not touched:
            raise BoundError(
                f"the loop at {header:#x} (lines {sorted(lines)}) is not one of the Program's loops"
            )
        found[header] = min(fits)[1] if fits else max(touched)[1]
    return found


def graphs_of(elf: Path, function: str) -> dict[str, dict[int, CodeBlock]]:
    """Control-flow graphs of a function and of all that it calls."""
    functions = disassemble(elf)
    graphs: dict[str, dict[int, CodeBlock]] = {}
    todo = [function]
    while todo:
        name = todo.pop()
        if name not in graphs:
            graphs[name] = blocks_of(name, functions)
            todo += [c for b in graphs[name].values() for c in b.calls]
    return graphs


def step_bound(
    elf: Path,
    function: str,
    source: str,
    ranges: Mapping[str, tuple[int, int]],
    loops: Sequence[LoopBound],
    elsewhere: Mapping[str, str] | None = None,
) -> InstructionBound:
    """Largest number of instructions from entry to return of a step."""
    graphs = graphs_of(elf, function)
    called = {f: {c for b in g.values() for c in b.calls} for f, g in graphs.items()}
    try:
        TopologicalSorter(called).prepare()
    except CycleError:
        raise BoundError("recursion") from None
    limits = {x.var: x for x in loops}
    index = {n: i for i, n in enumerate((f, a) for f, g in graphs.items() for a in g)}
    # What flows into each block and out of it, less how often it runs: edges, calls, returns.
    into: dict[Node, Counter[int]] = {n: Counter({i: -1}) for n, i in index.items()}
    out: dict[Node, Counter[int]] = {n: Counter({i: -1}) for n, i in index.items()}
    count = len(index)
    for (f, a), i in index.items():
        for b in graphs[f][a].to:
            into[f, b][count] = out[f, a][count] = 1
            count += 1
        if graphs[f][a].returns:
            out[f, a][count] = 1
            count += 1
        for callee in graphs[f][a].calls:
            into[callee, next(iter(graphs[callee]))][i] += 1
    start = function, next(iter(graphs[function]))
    equal = [(row, -1.0 if n == start else 0.0) for n, row in into.items()]
    equal += [(row, 0.0) for row in out.values()]
    most: list[Row] = []
    for f, g in graphs.items():
        machine = _loops(g, next(iter(g)))
        for header, var in _attribute(machine, g, source, ranges, limits, elsewhere or {}).items():
            # Where the head can leave the loop it runs once more than the body, unless it is the
            # whole loop.
            leaves = any(b not in machine[header] for b in g[header].to)
            more = limits[var].entries if leaves and header not in g[header].to else 0
            most.append((Counter({index[(f, header)]: 1}), float(limits[var].passes + more)))
    cost = np.zeros(count)
    for (f, a), i in index.items():
        cost[i] = len(graphs[f][a].code)
    solved = linprog(
        -cost,
        A_ub=_sparse(most, count),
        b_ub=[r for _, r in most] or None,
        A_eq=_sparse(equal, count),
        b_eq=[r for _, r in equal],
        method="highs",
    )
    if solved.status != 0:
        raise BoundError(f"no bound: {solved.message}")
    by_function = {
        f: (
            round(sum(cost[index[(f, a)]] * solved.x[index[(f, a)]] for a in g)),
            round(solved.x[index[(f, next(iter(g)))]]),
        )
        for f, g in graphs.items()
    }
    return InstructionBound(int(np.ceil(-solved.fun - 1e-6)), by_function)


def _sparse(rows: Sequence[Row], count: int) -> csr_array | None:
    if not rows:
        return None
    i = [k for k, (row, _) in enumerate(rows) for _ in row]
    j = [c for row, _ in rows for c in row]
    v = [x for row, _ in rows for x in row.values()]
    return csr_array((v, (i, j)), shape=(len(rows), count))
