"""Names of a kernel's local values in C: from labels, and from the ports that they come from."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from functools import cache
from typing import Any

from esea_gen.emit.walker import Kernel, both_arms, status_words, use_counts
from esea_gen.language.block import Block
from esea_gen.language.names import KEYWORDS
from esea_gen.language.ports import UNIT_SUFFIXES

# The functions' own arguments among them.
_RESERVED = KEYWORDS | {"coeffs", "in", "out", "params", "state"}
_MACRO = re.compile(r"[A-Z][A-Z0-9_]*")


def unused(name: str, taken: Collection[str]) -> str:
    """The name, with a suffix if it is used, a keyword or a macro."""
    if _MACRO.fullmatch(name):
        name += "_value"
    while name in taken or name in _RESERVED:
        name += "_"
    return name


def namer(
    taken: Collection[str], labels: Mapping[int, tuple[str, str]], others: Mapping[int, str]
) -> Callable[[int], str]:
    """Gives each of one function's values its name: a label's, else a port's, else a number."""
    used = set(taken)

    def new(name: str) -> str:
        name = unused(name, used)
        used.add(name)
        return name

    labelled = {i: new(name) for i, (name, _) in labels.items()}
    return lambda i: labelled.get(i) or new(others.get(i, f"v{i}"))


@cache
def stem(name: str) -> str:
    """A quantity's name without its unit."""
    suffix = max((s for s in UNIT_SUFFIXES if name.endswith(s)), key=len, default="")
    return name[: -len(suffix)] if suffix and suffix != name else name


def parts(kernel: Kernel, named: Mapping[int, str]) -> dict[int, str]:
    """Names of values that one other is made of, and nothing else: by that one's."""
    uses, root = use_counts(kernel), dict(named)
    user = {a: i for i, n in enumerate(kernel.nodes) for a in n.args}
    results = {i for r in kernel.results for i in r}
    for i in reversed(range(len(kernel.nodes))):
        single = uses[i] == 1 and i in user and i not in results
        if i not in named and single and kernel.nodes[i].op not in ("input", "const"):
            root[i] = root.get(user[i], "")
    count: Counter[str] = Counter()
    found = dict(named)
    for i, name in sorted(root.items()):
        if name and i not in named:
            of = stem(name)
            count[of] += 1
            found[i] = f"{of}_part_{count[of]}"
    return found


def meanings(
    block: Any, function: str, kernel: Kernel, base: Callable[[str], str] = str
) -> dict[int, str]:
    """Names of values that no label names but a port does.

    Whether a state is in its range is ``<state>_ok``, a state that a condition selects is
    ``<state>_used``.  A condition has its flag's name, and what a function writes is named by where
    it goes; a new state is ``<state>_next``.
    """
    if function == "prepare":
        return _results(kernel, 0, block.coefficients, base, "")
    if function == "init":
        return _results(kernel, 0, block.state, base, "")
    after = _results(kernel, 0, block.state, base, "_next")
    out = _results(kernel, len(block.state), block.outputs, base, "_out")
    return after | out | _flags(block, kernel) | _states(block, kernel, base)


def _element(name: str, ending: str, size: int, element: int) -> str:
    return f"{name}{ending}" + ("" if size == 1 else f"_{element}")


def _results(
    kernel: Kernel, start: int, ports: tuple[Any, ...], base: Callable[[str], str], ending: str
) -> dict[int, str]:
    found: dict[int, str] = {}
    for p, nodes in zip(ports, kernel.results[start:], strict=False):
        name, end = (p.name, "") if getattr(p, "flags", ()) else (base(p.name), ending)
        for element, i in enumerate(nodes):
            found.setdefault(i, _element(name, end, len(nodes), element))
    return found


def _flags(block: Block, kernel: Kernel) -> dict[int, str]:
    uses = use_counts(kernel)
    found: dict[int, str] = {}
    flags = [p.flags for p in block.outputs if p.flags]
    for result, names in zip(block.flag_results, flags, strict=True):
        for word in status_words(kernel, (result,), uses).values():
            for i, bit in word.flags:
                if bit < len(names):
                    found.setdefault(i, names[bit].name.lower())
    return found


def _states(block: Block, kernel: Kernel, base: Callable[[str], str]) -> dict[int, str]:
    first = len(block.coefficients)
    found: dict[int, str] = {}

    def state(i: int, ending: str) -> str:
        n = kernel.nodes[i]
        argument = n.source[0] - first
        if n.op != "input" or not 0 <= argument < len(block.state):
            return ""
        p = block.state[argument]
        return _element(base(p.name), ending, p.size, n.source[1])

    sums: dict[int, str] = {}  # of the magnitudes of a vector's elements: their names
    for i, n in enumerate(kernel.nodes):
        if n.op == "fabs" and (name := state(n.args[0], "_sum")):
            sums[i] = name
        elif n.op == "add" and all(a in sums for a in n.args):
            found[i] = sums[i] = sums[n.args[1]]
        elif n.op == "le" and n.args[0] in sums:
            found[i] = sums[n.args[0]].rpartition("_sum")[0] + "_ok"
        chosen = n.op in ("select", "if_else_zero", "and", "or")
        if chosen and (name := state(n.args[1], "_used")):
            found[i] = name
        elif n.op == "and" and all(kernel.nodes[a].op == "le" for a in n.args):
            ends = [a for side in n.args for a in kernel.nodes[side].args]
            names = {name for a in ends if (name := state(a, "_ok"))}
            if len(names) == 1:
                found[i] = names.pop()
        elif arms := both_arms(kernel.nodes, n):  # (ok ? state : 0) + (!ok ? start : 0)
            named = [a for a in n.args if a in found]
            if len(named) == 1 and kernel.nodes[named[0]].args == arms[:2]:
                found[i] = found.pop(named[0])
    return found
