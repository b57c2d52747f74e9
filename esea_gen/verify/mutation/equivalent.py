"""Proofs that a mutant of a kernel computes the same."""

from __future__ import annotations

from collections.abc import Mapping

from esea_gen.emit.error_bounds import whole_nodes
from esea_gen.emit.formats.base import Format
from esea_gen.emit.formats.floating import SELECTING
from esea_gen.emit.walker import Kernel, Node
from esea_gen.language.block import Block
from esea_gen.verify.intervals import Interval
from esea_gen.verify.mutation.edits import Edit
from esea_gen.verify.mutation.normal import Numbering
from esea_gen.verify.unreachable import guarded_ranges, imply


class Prover:
    """Proofs for the mutants of one kernel."""

    def __init__(self, kernel: Kernel, fmt: Format, block: Block | None = None) -> None:
        self.kernel = kernel
        ranges: Mapping[int, Interval] = guarded_ranges(block, kernel, fmt) if block else {}
        whole = whole_nodes(block, kernel, fmt) if block else frozenset()
        self.numbering = Numbering(kernel, fmt, ranges, whole)
        self.settled = {
            i: known.low for i, known in ranges.items() if known.settled and kernel.nodes[i].boolean
        }

    def __call__(self, edit: Edit) -> str:
        """The proof, or nothing."""
        return self._same_numbers(edit) or self._masked(edit)

    def _same_numbers(self, edit: Edit) -> str:
        # Every result has the number that it has in the kernel.
        own, changed = self.numbering, edit.apply(self.kernel)
        kernel, place = changed
        back = {new: old for old, new in reversed(list(enumerate(place)))}
        numbers: list[int] = []
        why: list[dict[str, None]] = []
        for i, n in enumerate(kernel.nodes):
            why.append({})
            old = back.get(i)
            if old is not None and old != edit.site and self._untouched(n, old, numbers):
                numbers.append(own.numbers[old])
            else:
                numbers.append(own.number(kernel.nodes, i, numbers, why[i]))
        results = zip(self.kernel.results, kernel.results, strict=True)
        if any([own.numbers[i] for i in a] != [numbers[j] for j in b] for a, b in results):
            return ""
        # What settled the values that differ, and those at which they stop to.
        told: dict[str, None] = {}
        differ = [i for i, j in enumerate(place) if numbers[j] != own.numbers[i]]
        ends = {k for k, n in enumerate(self.kernel.nodes) if set(n.args) & set(differ)}
        for i in sorted({edit.site, *differ, *ends}):
            told |= own.reasons[i] | why[place[i]]
        return "; ".join(told) or "another form of the same value"

    def _untouched(self, n: Node, old: int, numbers: list[int]) -> bool:
        was = self.kernel.nodes[old]
        return n.op == was.op and [numbers[a] for a in n.args] == [
            self.numbering.numbers[a] for a in was.args
        ]

    def _masked(self, edit: Edit) -> str:
        # Where the values differ, no result looks at them.
        if edit.result is not None:
            return ""
        changed = {edit.site}  # what ranges settle there may be otherwise now
        for i, n in enumerate(self.kernel.nodes):
            changed |= {i} if changed & set(n.args) else set()
        settled = {i: value for i, value in self.settled.items() if i not in changed}
        found = []
        for case in self._cases(edit):
            known = dict(settled)
            for i, truth in case:
                known |= imply(self.kernel, i, truth, without=edit.site)
            if any(known[i] != truth for i, truth in case):
                continue  # both cannot be
            if self._reaches_a_result(edit.site, known):
                return ""
            found.append(" and ".join(f"v{i} is {str(t).lower()}" for i, t in case))
        when = ", nor when ".join(x for x in found if x)
        if when:
            return f"when {when}, no result looks at the value"
        return "conditions that its ranges settle leave the value without a reader"

    def _cases(self, edit: Edit) -> list[list[tuple[int, bool]]]:
        # What holds when the values differ; a case without conditions: they may at any time.
        n, now = self.kernel.nodes[edit.site], edit.now
        if n.op in SELECTING:
            condition, first = n.args[:2]
            if now == first:
                return [[(condition, False)]]
            if edit.kind == "select always second":
                return [[(condition, True)]]
            if isinstance(now, Node) and now.op == n.op:
                if now.args[0] >= 0 and now.args[0] != condition:
                    other = now.args[0]
                    return [[(condition, t), (other, not t)] for t in (True, False)]
                if now.args[0] == condition and sorted(now.args) != sorted(n.args):
                    return [[(condition, now.args[1] != first)]]
        if n.op in ("and", "or") and isinstance(now, Node) and now.op in ("and", "or"):
            x, y = n.args
            return [[(x, t), (y, not t)] for t in (True, False)]
        return [[]]

    def _reaches_a_result(self, i: int, known: Mapping[int, float]) -> bool:
        # Whether a change of a value can change a result, given some values.
        results = {k for r in self.kernel.results for k in r}
        reached, front = {i}, [i]
        while front:
            at = front.pop()
            if at in results:
                return True
            for u, user in enumerate(self.kernel.nodes):
                if at not in user.args or u in reached or u in known:
                    continue
                if user.op in SELECTING and user.args[0] in known:
                    looked = 1 if known[user.args[0]] else 2
                    if user.args[looked : looked + 1] != (at,):
                        continue
                reached.add(u)
                front.append(u)
        return False
