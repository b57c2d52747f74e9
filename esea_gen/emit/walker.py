"""Walk a CasADi function's instruction list into a typed, single-assignment kernel.

Everything that reads a kernel reads this form: the printers of the number formats, the range and
error analysis, the cost count and the content hash.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import casadi as ca

from esea_gen.errors import UserError
from esea_gen.language.block import Block

# Operations by the name used here: CasADi's number, and the C of a floating-point format, where a
# format has no function of its own for it.  What is not here cannot be emitted, and the walker says
# so; ``select`` (condition, value if true, value if false) is only made by a format's own pass.
# {f} is i for whole numbers.  Rules of ranges and errors: emit.spans; of whole numbers: emit.fixed.
OPERATIONS: dict[str, tuple[int | None, str]] = {
    "neg": (ca.OP_NEG, "-{0}"),
    "sq": (ca.OP_SQ, "{0} * {0}"),
    "twice": (ca.OP_TWICE, "{two} * {0}"),
    "inv": (ca.OP_INV, "{one} / {0}"),
    "sqrt": (ca.OP_SQRT, ""),
    "exp": (ca.OP_EXP, ""),
    "log": (ca.OP_LOG, ""),
    "tanh": (ca.OP_TANH, ""),
    "fabs": (ca.OP_FABS, "esea_{f}abs({0})"),
    "sign": (ca.OP_SIGN, "esea_sign({0})"),
    "not": (ca.OP_NOT, "!{0}"),
    "add": (ca.OP_ADD, "{0} + {1}"),
    "sub": (ca.OP_SUB, "{0} - {1}"),
    "mul": (ca.OP_MUL, "{0} * {1}"),
    "div": (ca.OP_DIV, "{0} / {1}"),
    "fmin": (ca.OP_FMIN, "esea_{f}min({0}, {1})"),
    "fmax": (ca.OP_FMAX, "esea_{f}max({0}, {1})"),
    "pow": (ca.OP_POW, ""),
    "lt": (ca.OP_LT, "{0} < {1}"),
    "le": (ca.OP_LE, "{0} <= {1}"),
    "eq": (ca.OP_EQ, "{0} == {1}"),
    "ne": (ca.OP_NE, "{0} != {1}"),
    "and": (ca.OP_AND, "{0} && {1}"),
    "or": (ca.OP_OR, "{0} || {1}"),
    "if_else_zero": (ca.OP_IF_ELSE_ZERO, "{0} ? {1} : {zero}"),
    "select": (None, "{0} ? {1} : {2}"),
}
_BY_CODE = {code: name for name, (code, _) in OPERATIONS.items()} | {ca.OP_CONSTPOW: "pow"}
COMPARING = frozenset({"lt", "le", "eq", "ne"})
SELECTING = frozenset({"if_else_zero", "select"})
BOOLEAN = frozenset({"not", "lt", "le", "eq", "ne", "and", "or"})


class UnsupportedOperationError(UserError):
    def __init__(self, what: str, fix: str = "Try another number format with --real.") -> None:
        super().__init__(f"{what.removesuffix('.')}.", fix)


class Node(NamedTuple):  # quickly made, for some 10^5 are
    # `input`, `const`, an operation of the table, or `select`, which only a format's pass makes.
    op: str
    args: tuple[int, ...] = ()
    value: float = 0.0
    source: tuple[int, int] = (0, 0)  # of an input: argument and element

    @property
    def boolean(self) -> bool:
        return self.op in BOOLEAN


@dataclass(frozen=True)
class Kernel:
    name: str
    nodes: tuple[Node, ...]  # in an order in which every operand stands before its use
    results: tuple[tuple[int, ...], ...]  # per result, per element, the index of its node

    def cost(self) -> Counter[str]:
        return Counter(n.op for n in self.nodes if n.op not in ("input", "const"))


_WALKED: WeakKeyDictionary[ca.Function, Kernel] = WeakKeyDictionary()


def walk(function: ca.Function) -> Kernel:
    """Turn a CasADi function into a kernel, once for every number format."""
    found = _WALKED.get(function)
    if found is None:
        found = _WALKED[function] = _walked(function)
    return found


def _walked(function: ca.Function) -> Kernel:
    nodes: list[Node] = []
    known: dict[Node, int] = {}

    def add(node: Node) -> int:
        # Equal nodes are one value: this changes no bit, and gives constants and inputs one name.
        if node not in known:
            known[node] = len(nodes)
            nodes.append(node)
        return known[node]

    work: dict[int, int] = {}
    results = [[-1] * function.numel_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        i, o = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_CONST:
            work[o[0]] = add(Node("const", value=float(function.instruction_constant(k))))
        elif op == ca.OP_INPUT:
            argument, element = i
            work[o[0]] = add(Node("input", source=(argument, element)))
        elif op == ca.OP_OUTPUT:
            result, element = o
            results[result][element] = work[i[0]]
        elif op == ca.OP_ASSIGN:
            work[o[0]] = work[i[0]]
        elif op in _BY_CODE:
            args = tuple(work[a] for a in i)
            if op == ca.OP_AND:  # a check that a condition is in a port's range always holds
                args = tuple(a for a in args if not _holds(nodes, a)) or args[:1]
            work[o[0]] = add(Node(_BY_CODE[op], args)) if len(args) == len(i) else args[0]
        else:
            raise UnsupportedOperationError(
                f"{function.name()}: CasADi operation number {op} at instruction {k} cannot be "
                "emitted; express it with the operations that esea_gen.emit.walker lists"
            )
    return prune(Kernel(function.name(), tuple(nodes), tuple(map(tuple, results))))


def _holds(nodes: Sequence[Node], i: int) -> bool:
    # A condition is at most 1; that it is at least 0 CasADi folds.
    n = nodes[i]
    if n.op != "le":
        return n.op == "const" and n.value != 0
    condition, limit = (nodes[a] for a in n.args)
    return condition.boolean and limit.op == "const" and limit.value >= 1


def needed_nodes(kernel: Kernel) -> list[int]:
    needed = {i for r in kernel.results for i in r}
    for i in reversed(range(len(kernel.nodes))):
        if i in needed:
            needed.update(kernel.nodes[i].args)
    return sorted(needed)


def labelled_kernel(
    block: Block, passes: Callable[[Kernel], Kernel]
) -> tuple[Kernel, list[tuple[int, str, str]]]:
    """A Block's step kernel after ``passes``, and (node, name, comment) of its labelled values.

    Values that no result needs, inputs and constants have no entry.
    """
    labelled = passes(walk(block.labelled_step))
    count = block.step.n_out()
    kernel = Kernel(labelled.name, labelled.nodes, labelled.results[:count])
    position = {old: new for new, old in enumerate(needed_nodes(kernel))}
    labels = [
        (position[node], name, comment)
        for (name, comment), (node, *_) in zip(block.labels, labelled.results[count:], strict=True)
        if node in position and kernel.nodes[node].op not in ("input", "const")
    ]
    return prune(kernel), labels


def checked_from_zero(kernel: Kernel, n: Node) -> int:
    """The input of which a node checks that it is from 0 on, as ``port_ok`` does; else -1."""
    sides = [kernel.nodes[a] for a in n.args] if n.op == "and" else []
    if [s.op for s in sides] != ["le", "le"]:
        return -1
    (x, _), (low, y) = (s.args for s in sides)
    zero = kernel.nodes[low]
    within = x == y and (zero.op, zero.value) == ("const", 0.0)
    return x if within and kernel.nodes[x].op == "input" else -1


def use_counts(kernel: Kernel) -> list[int]:
    uses = [0] * len(kernel.nodes)
    for n in kernel.nodes:
        for a in n.args:
            uses[a] += 1
    return uses


def prune(kernel: Kernel) -> Kernel:
    needed = needed_nodes(kernel)
    return kernel if len(needed) == len(kernel.nodes) else _ordered(kernel, needed)


def _ordered(kernel: Kernel, order: Sequence[int]) -> Kernel:
    # Some of the nodes, in another order.
    position = {old: new for new, old in enumerate(order)}
    nodes = tuple(
        Node(n.op, tuple(position[a] for a in n.args), n.value, n.source)
        for n in (kernel.nodes[i] for i in order)
    )
    results = tuple(tuple(position[i] for i in r) for r in kernel.results)
    return Kernel(kernel.name, nodes, results)


def both_arms(nodes: Sequence[Node], n: Node) -> tuple[int, ...]:
    """Condition, value if true and value if false of CasADi's two-armed select; else nothing."""
    for a, b in (n.args, n.args[::-1]) if n.op == "add" else ():
        x, y = nodes[a], nodes[b]
        if x.op == y.op == "if_else_zero":
            (condition, yes), (inverse, no) = x.args, y.args
            if nodes[inverse] == Node("not", (condition,)):
                return condition, yes, no
    return ()


def fuse_selects(kernel: Kernel) -> Kernel:
    """Turn CasADi's two-armed select, (c ? a : 0) + (!c ? b : 0), into one select.

    Saves an addition and a test.  The value is the same but for the sign of a zero, so the f64
    format, which must equal CasADi's own C bit for bit, does not use it.
    """
    arms = (both_arms(kernel.nodes, n) for n in kernel.nodes)
    nodes = (Node("select", a) if a else n for a, n in zip(arms, kernel.nodes, strict=True))
    return prune(Kernel(kernel.name, tuple(nodes), kernel.results))


LONG = frozenset({"pow", "exp", "log", "tanh"})


def calls_first(kernel: Kernel) -> Kernel:
    """Put the long operations first, then operations independent of them, then the others.

    A processor that works ahead does the second while the first are under way.  Within each third
    the order is depth first, so that few values are alive at a time.  No operation changes, so no
    bit does.
    """
    nodes = kernel.nodes
    leads = [n.op in LONG for n in nodes]
    follows = list(leads)
    for i in reversed(range(len(nodes))):
        if leads[i]:
            for a in nodes[i].args:
                leads[a] = True
    for i, n in enumerate(nodes):
        follows[i] = follows[i] or any(follows[a] for a in n.args)
    third = [0 if leads[i] else 2 if follows[i] else 1 for i in range(len(nodes))]
    order: list[int] = []
    placed = [False] * len(nodes)
    for part in range(3):
        members = [i for i in range(len(nodes)) if third[i] == part]
        used = {a for i in members for a in nodes[i].args}
        for root in (i for i in members if i not in used):
            stack = [root]
            while stack:
                i = stack[-1]
                waiting = [a for a in nodes[i].args if not placed[a]]
                if waiting:
                    stack.append(waiting[0])
                    continue
                stack.pop()
                if not placed[i]:
                    placed[i] = True
                    order.append(i)
    return _ordered(kernel, order)


@dataclass(frozen=True)
class StatusWord:
    flags: tuple[tuple[int, int], ...]  # node of the condition, and its bit
    parts: frozenset[int]


def status_words(
    kernel: Kernel, words: Sequence[int], uses: Sequence[int]
) -> dict[int, StatusWord]:
    """Find the status words that ``flag_word`` built."""
    # A sum of (condition ? power of two : 0), each power once, as flag_word builds it.
    found = {}
    for word in words:
        (root,) = kernel.results[word]
        flags, parts, todo = [], set(), [root]
        while todo:
            i = todo.pop()
            n = kernel.nodes[i]
            if i != root and uses[i] != 1:
                break
            if n.op == "add":
                todo += n.args[::-1]
            elif n.op == "if_else_zero" and kernel.nodes[n.args[0]].boolean:
                value = kernel.nodes[n.args[1]]
                power = value.value.hex().startswith("0x1.0000000000000p+")
                if value.op != "const" or not power:
                    break
                flags.append((n.args[0], int(value.value).bit_length() - 1))
            else:
                break
            parts.add(i)
        else:
            if len({k for _, k in flags}) == len(flags):
                found[root] = StatusWord(tuple(flags), frozenset(parts - {root}))
    return found
