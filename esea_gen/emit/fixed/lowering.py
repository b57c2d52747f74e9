"""Lower a kernel to integers: one format a value, from its range; every rounding recorded.

A value ``v`` is stored as the integer nearest to ``v 2**f``; ``f`` is the largest that its range
leaves room for, but no more than its operands can fill.  The range is that of the *computed* value
over every bit pattern of the inputs and states, so that nothing can overflow, corrupt or not.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed.elementary import Elementary
from esea_gen.emit.fixed.expression import Expr, OverflowProofError
from esea_gen.emit.fixed.values import (
    FieldPlan,
    LoweredKernel,
    LoweredStep,
    LoweringError,
    Source,
    Value,
    local_name,
)
from esea_gen.emit.local_names import unused
from esea_gen.emit.spans import COMPARES
from esea_gen.emit.walker import Kernel, Node


@dataclass
class Kept:
    """Lowered nodes of one kernel, for different sets of wide values."""

    values: dict[tuple[int, ...], Value | None] = field(default_factory=dict)
    marks: dict[Hashable, int] = field(default_factory=dict)


@dataclass(eq=False)
class Lowering(Elementary):
    """The lowering of one kernel to whole numbers."""

    # Of earlier ones that differ from this one in ``wide`` alone.
    kept: Kept | None = None
    marks: list[int] = field(default_factory=list)

    def _lower(self, i: int) -> Value | None:
        n = self.kernel.nodes[i]
        if i in self.status:
            bits = tuple((self._condition(c), k) for c, k in self.status[i].flags)
            return Value(ex.flags(bits), 0)
        if n.op == "const" or i in self.parts:
            return None
        if n.op == "input":
            return self._read(i, self.source(*n.source))
        if n.op not in _RULES:
            raise self._fail(i, "no rule has it", "Express it with the walker's operations.")
        return _RULES[n.op](self, i, n)

    def _read(self, i: int, s: Source) -> Value:
        if not s.checked:
            return Value(ex.read(s.place, s.bits, s.low, s.high), s.fraction)
        held = ex.read(s.place, 32, *ex.INT32)
        name = self._unused(local_name(f"{s.name}_held", s.fraction))
        self.steps.append(LoweredStep(name, held))
        self.unchecked[i] = Value(ex.named(name, held), s.fraction)
        return Value(ex.clamp(self.unchecked[i].expr, s.low, s.high), s.fraction)

    def _unused(self, name: str) -> str:
        name = unused(name, self.names)
        self.names.add(name)
        return name

    def run(self, fields: Sequence[FieldPlan], cut: bool = False) -> LoweredKernel:
        """Lower every node and its conversion to the field that it fills, ``cut`` to its range."""
        self._cap(fields)
        for i in range(len(self.kernel.nodes)):
            self.checking = i in self.checks
            self.values.append(self._once(i))
        self.checking = False
        saturations: list[str] = []
        results, errors = [], []
        for r, f in zip(self.kernel.results, fields, strict=True):
            pairs = [self._convert(i, f, cut, saturations) for i in r]
            results.append(tuple(p[0] for p in pairs))
            errors.append(tuple(p[1] for p in pairs))
        return LoweredKernel(
            self.kernel,
            _needed(self.steps, results),
            tuple(self.values),
            tuple(results),
            tuple(errors),
            tuple(saturations),
        )

    def _once(self, i: int) -> Value | None:
        # A search lowers one kernel again and again.  What a node was lowered to comes out the same
        # while it has the same width and its operands look the same: a number by its name, range
        # and format; a condition, through which a choice sees what it compares, by all it is of.
        n = self.kernel.nodes[i]
        if self.kept is None or i in self.status or n.op in ("input", "const") or i in self.parts:
            v = self._named(i, self._lower(i))
            held = self.unchecked.get(i)
            key: Hashable = (i, v and v.expr, held and held.expr)
        else:
            made = (i, i in self.wide, *(self.marks[a] for a in n.args))
            if made not in self.kept.values:
                self.kept.values[made] = self._lower(i)
            v = self._named(i, self.kept.values[made])
            seen = v is not None and v.expr.op == "ref" and v.expr.bits != 1
            key = (i, v.expr, v.fraction) if v and seen else (made, v and v.expr.name)
        if self.kept is not None:
            self.marks.append(self.kept.marks.setdefault(key, len(self.kept.marks)))
        return v

    def _cap(self, fields: Sequence[FieldPlan]) -> None:
        # A state that is only chosen or clipped passes through unrounded: nothing on its way is
        # finer than its port, so that it comes back as the very number that it was.
        for r, f in zip(self.kernel.results, fields, strict=True):
            for i in r:
                self.caps[i] = min(f.fraction, self.caps.get(i, f.fraction))
        for i in reversed(range(len(self.kernel.nodes))):
            n = self.kernel.nodes[i]
            if i in self.caps and n.op in ("fmin", "fmax", "select", "if_else_zero"):
                for a in n.args[n.op in ("select", "if_else_zero") :]:
                    self.caps[a] = min(self.caps[i], self.caps.get(a, self.caps[i]))

    def _named(self, i: int, v: Value | None) -> Value | None:
        if v is None or v.expr.op in ("ref", "literal"):
            return v
        label = self.labels.get(i)
        inline = v.expr.bits == 1 or i in self.clips
        if label is None and self.uses[i] == 1 and inline:
            return v
        n = self.kernel.nodes[i]
        if n.op == "input":
            name, comment = self.source(*n.source).name, ""
        else:
            name, comment = label or (self.others.get(i, f"v{i}"), "")
        if v.expr.bits > 1:
            name = local_name(name, v.fraction)
        name = self._unused(name)
        self.steps.append(LoweredStep(name, v.expr, comment, i))
        return v.called(name)

    def _convert(
        self, i: int, f: FieldPlan, cut: bool, saturations: list[str]
    ) -> tuple[Expr, float]:
        v = self.values[i]
        if f.port.kind == "flag":
            return ex.cast(self._condition(i), -32), 0.0
        if f.port.kind == "count" and f.whole:
            if i in self.whole or self._constant(i) is not None:
                return self._unsigned(i, getattr(f.port, "choices", None)), 0.0
            e, _, _ = self.align(i, 0, 32)
            return ex.cast(ex.clamp(e, 0, ex.INT32[1]), -32), 0.0
        if f.word:
            if v is None or v.expr.bits != -32:
                raise LoweringError(
                    f"block {self.block}: status word {f.name} is not built by flag_word"
                )
            return v.expr, 0.0
        try:
            e, rounding, constant = self.align(i, f.fraction, 32)
        except OverflowProofError:
            e, rounding, constant = self.align(i, f.fraction, 64)
            saturations.append(f.name)
        if cut and (f.low, f.high) != ex.INT32:
            # Cut whether needed or not: what reads it is promised this range.
            saturations.append(f.name)
            e = ex.minimum(e, ex.literal(f.high, e.bits), e.bits)
            e = ex.maximum(e, ex.literal(f.low, e.bits), e.bits)
        return ex.saturate(e), rounding + constant


_RULES: dict[str, Callable[[Lowering, int, Node], Value]] = {
    **dict.fromkeys(COMPARES, Lowering.comparison),
    **dict.fromkeys(("and", "or", "not"), Lowering.logic),
    **dict.fromkeys(("add", "sub"), Lowering.sum),
    **dict.fromkeys(("mul", "sq"), Lowering.product),
    **dict.fromkeys(("fmin", "fmax"), Lowering.extreme),
    **dict.fromkeys(("select", "if_else_zero"), Lowering.select),
    **dict.fromkeys(("pow", "exp", "log", "sqrt", "tanh"), Lowering.function),
    "div": Lowering.quotient,
    "fabs": Lowering.magnitude,
    "twice": lambda lowering, i, n: lowering.shifted(n.args[0], Fraction(2)),
    "neg": lambda lowering, i, n: lowering.shifted(n.args[0], Fraction(-1)),
    "sign": Lowering.sign,
}


def _needed(
    steps: Sequence[LoweredStep], results: Sequence[Sequence[Expr]]
) -> tuple[LoweredStep, ...]:
    wanted = {n for r in results for e in r for n in ex.names(e)}
    kept = []
    for s in reversed(steps):
        if s.name in wanted:
            kept.append(s)
            wanted |= ex.names(s.expr)
    return tuple(reversed(kept))


def rewrite(kernel: Kernel) -> Kernel:
    """Write 1/x as the quotient that it is."""
    nodes: list[Node] = []
    place: list[int] = []

    def add(node: Node) -> int:
        nodes.append(node)
        return len(nodes) - 1

    for n in kernel.nodes:
        args = tuple(place[a] for a in n.args)
        if n.op == "inv":
            one = add(Node("const", value=1.0))
            place.append(add(Node("div", (one, *args))))
        else:
            place.append(add(Node(n.op, args, n.value, n.source)))
    results = tuple(tuple(place[i] for i in r) for r in kernel.results)
    return Kernel(kernel.name, tuple(nodes), results)
