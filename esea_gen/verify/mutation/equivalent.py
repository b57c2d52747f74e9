"""Proofs that a mutant of a kernel computes the same, from the place that was changed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from esea_gen.emit.error_bounds import whole_nodes
from esea_gen.emit.formats.base import Format
from esea_gen.emit.walker import SELECTING, Kernel, Node
from esea_gen.language.block import Block
from esea_gen.verify.intervals import Interval, node_interval
from esea_gen.verify.mutation.edits import Edit
from esea_gen.verify.unreachable import guarded_ranges, imply

LARGE = 2.0**20  # below, halves are numbers of every format
HALVES = 0.4  # what a sum of a whole number is compared with is this far from any, at least


@dataclass(frozen=True)
class _Threshold:
    """``value op c``, or ``c op value``."""

    op: str
    left: bool  # whether the value stands there
    c: float

    def holds(self, x: float) -> bool:
        a, b = (x, self.c) if self.left else (self.c, x)
        return a < b if self.op == "lt" else a <= b


class Prover:
    def __init__(self, kernel: Kernel, fmt: Format, block: Block | None = None) -> None:
        self.kernel, self.fmt = kernel, fmt
        self.ranges: Mapping[int, Interval] = guarded_ranges(block, kernel, fmt) if block else {}
        self.whole = whole_nodes(block, kernel, fmt) if block else frozenset()
        self.settled = {
            i: known.low
            for i, known in self.ranges.items()
            if known.settled and kernel.nodes[i].boolean
        }
        self.results = {k for r in kernel.results for k in r}
        self.users: list[list[int]] = [[] for _ in kernel.nodes]
        for u, user in enumerate(kernel.nodes):
            for a in set(user.args):
                self.users[a].append(u)

    def __call__(self, edit: Edit) -> str:
        if edit.result is not None:
            return ""
        old = self.kernel.nodes[edit.site]
        return (
            self._by_range(old, edit)
            or self._by_comparison(old, edit)
            or self._by_sign(old, edit)
            or self._masked(edit)
        )

    def _constant(self, i: int, helpers: Sequence[Node] = ()) -> float | None:
        n = helpers[~i] if i < 0 else self.kernel.nodes[i]
        return float(self.fmt.dtype.type(n.value)) if n.op == "const" else None

    def _range(self, i: int, helpers: Sequence[Node] = ()) -> Interval | None:
        c = self._constant(i, helpers)
        if c is None:
            return self.ranges.get(i) if i >= 0 else None
        return Interval(c, c)

    # -- what ranges settle ----------------------------------------------------------------------

    def _by_range(self, old: Node, edit: Edit) -> str:
        if old.op in ("fmin", "fmax"):
            still = edit.now == old.args[0] or (
                isinstance(edit.now, Node)
                and edit.now.op == old.op
                and edit.now.args[0] == old.args[0]
                and self._never_acts(edit.now, edit.helpers)
            )
            known = self._never_acts(old) if still else None
            return f"the clip never acts: its operand lies in {known}" if known else ""
        if edit.site not in self.settled or not isinstance(edit.now, Node):
            return ""
        operands = [self._range(a, edit.helpers) for a in edit.now.args]
        known_ones = [x for x in operands if x is not None]
        if not edit.now.boolean or len(known_ones) < len(operands):
            return ""
        now = node_interval(self.kernel, self.fmt, edit.now, known_ones)
        if not now.settled or now.low != self.settled[edit.site]:
            return ""
        return (
            f"the condition is always {str(bool(now.low)).lower()}, by the ranges of its operands"
        )

    def _never_acts(self, n: Node, helpers: Sequence[Node] = ()) -> str:
        # The range of what is clipped, where the limit lies outside of it.
        known, limit = self._range(n.args[0]), self._constant(n.args[1], helpers)
        if known is None or known.nan or limit is None:
            return ""
        beyond = limit - known.high if n.op == "fmin" else known.low - limit
        outside = beyond > 0 or (beyond == 0 and limit != 0)
        return f"[{known.low:.6g}, {known.high:.6g}]" if outside else ""

    # -- comparisons with a constant ---------------------------------------------------------------

    def _by_comparison(self, old: Node, edit: Edit) -> str:
        if not isinstance(edit.now, Node):
            return ""
        (i, before), (k, after) = self._against(old), self._against(edit.now, edit.helpers)
        if before is None or after is None or i != k:
            return ""
        return "; ".join(sorted(self._alike(i, before, after) or ()))

    def _against(self, n: Node, helpers: Sequence[Node] = ()) -> tuple[int, _Threshold | None]:
        # What is compared with a constant, and how.
        if n.op in ("lt", "le"):
            for k, left in ((1, True), (0, False)):
                c, i = self._constant(n.args[k], helpers), n.args[1 - k]
                if c is not None and i >= 0 and self._constant(i) is None:
                    return i, _Threshold(n.op, left, c)
        return -1, None

    def _alike(self, i: int, before: _Threshold, after: _Threshold) -> set[str] | None:
        # Why two thresholds decide alike of a value; None where they may not.
        n, known = self.kernel.nodes[i], self.ranges.get(i)
        if before.left != after.left:
            return None
        c = self._constant(i)
        if c is not None:
            return {"a constant is compared"} if before.holds(c) == after.holds(c) else None
        if self._whole_step(i, before) == self._whole_step(i, after) is not None:
            return {"a whole number is compared"}
        if known is not None and not known.nan:
            ends = {t.holds(x) for t in (before, after) for x in (known.low, known.high)}
            if len(ends) == 1:
                return {f"the value compared lies in [{known.low:.6g}, {known.high:.6g}]"}
        if n.op not in SELECTING or (n.op != "select" and before.holds(0.0) != after.holds(0.0)):
            return None
        arms = [self._alike(a, before, after) for a in n.args[1:]]
        return None if None in arms else {why for arm in arms for why in arm or ()}

    def _whole_step(self, i: int, t: _Threshold) -> tuple[int, int] | None:
        # Of a threshold only counts between which whole numbers it lies: of which value, and where.
        n, c = self.kernel.nodes[i], t.c
        if i not in self.whole and n.op == "add":
            # Of a whole number and a constant: no rounding reaches so far.
            for a, other in (n.args, n.args[::-1]):
                addend = self._constant(a)
                if addend is None or other not in self.whole:
                    continue
                i, c = other, c - addend
                if abs(c - round(c)) <= HALVES or abs(addend) >= LARGE:
                    return None
                break
        if i not in self.whole or not abs(c) < LARGE:
            return None
        return i, math.ceil(c) if (t.op == "lt") == t.left else math.floor(c) + 1

    # -- signs -----------------------------------------------------------------------------------

    def _by_sign(self, old: Node, edit: Edit) -> str:
        now = edit.now
        negated = isinstance(now, Node) and now.op == "neg" and edit.helpers == (old,)
        dropped = old.op in ("neg", "fabs") and now == old.args[0]
        blind = (negated or dropped) and self._sign_unread(edit.site)
        return "only the magnitude is used, or whether it is zero" if blind else ""

    def _sign_unread(self, i: int) -> bool:
        # Whether a value may change its sign without a result's changing.
        return i not in self.results and all(self._blind(u, i) for u in self.users[i])

    def _blind(self, u: int, i: int) -> bool:
        n = self.kernel.nodes[u]
        if n.op in ("fabs", "sq", "not", "and", "or"):
            return True
        if n.op in SELECTING:
            return i not in n.args[1:] or self._sign_unread(u)
        if n.op in ("eq", "ne"):
            return any(a != i and self._constant(a) == 0 for a in n.args)
        if n.op in ("mul", "div") and n.args[0] == n.args[1]:
            return True
        return n.op in ("neg", "twice", "inv", "mul", "div") and self._sign_unread(u)

    # -- what nobody looks at --------------------------------------------------------------------

    def _masked(self, edit: Edit) -> str:
        # Where the values differ, no result looks at them.
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
        reached, front = {i}, [i]
        while front:
            at = front.pop()
            if at in self.results:
                return True
            for u in self.users[at]:
                user = self.kernel.nodes[u]
                if u in reached or u in known:
                    continue
                if user.op in SELECTING and user.args[0] in known:
                    looked = 1 if known[user.args[0]] else 2
                    if user.args[looked : looked + 1] != (at,):
                        continue
                reached.add(u)
                front.append(u)
        return False
