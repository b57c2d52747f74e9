"""Values of kernels by number: two values with one number are the same bits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from esea_gen.emit.formats.base import Format
from esea_gen.emit.walker import BOOLEAN, COMMUTATIVE, Kernel, Node
from esea_gen.verify.intervals import Interval

LARGE = 2.0**20  # below, halves are numbers of every format
HALVES = 0.4  # what a sum of a whole number is compared with is this far from any, at least
# How many choices one comparison is taken into, and how deep in its operands they may stand.
CHOICES, DEEP = 64, 4


@dataclass(frozen=True)
class Form:
    """How a value is made of others, by their numbers."""

    op: str
    args: tuple[int, ...] = ()
    value: str = ""


class Numbering:
    """Numbers of the values of a kernel and of its mutants."""

    def __init__(
        self, kernel: Kernel, fmt: Format, ranges: Mapping[int, Interval], whole: frozenset[int]
    ) -> None:
        self.fmt, self.kernel = fmt, kernel
        self.forms: list[Form] = []
        self.known: dict[Form, int] = {}
        self.ranges: dict[int, Interval] = {}
        self.whole: set[int] = set()
        self.reasons: dict[int, dict[str, None]] = {}
        self.why: dict[str, None] = {}
        self.left = CHOICES
        self.numbers: list[int] = []
        for i, n in enumerate(kernel.nodes):
            number = self.number(kernel.nodes, i, self.numbers, self.reasons.setdefault(i, {}))
            known = ranges.get(i)
            if n.boolean and known is not None and known.settled:
                number = self.constant(known.low)
                self.reasons[i] = {f"a condition is always {str(bool(known.low)).lower()}": None}
            elif known is not None and self.forms[number].op != "const":
                self.ranges.setdefault(number, known)
            if i in whole:
                self.whole.add(number)
            self.numbers.append(number)

    def constant(self, value: float) -> int:
        """Number of a constant."""
        return self._put("const", (), float(self.fmt.dtype.type(value)).hex())

    def _put(self, op: str, args: tuple[int, ...], value: str = "") -> int:
        form = Form(op, args, value)
        if form not in self.known:
            self.known[form] = len(self.forms)
            self.forms.append(form)
        return self.known[form]

    def _value(self, i: int) -> float | None:
        form = self.forms[i]
        return float.fromhex(form.value) if form.op == "const" else None

    def number(
        self, nodes: Sequence[Node], i: int, numbers: Sequence[int], why: dict[str, None]
    ) -> int:
        """Number of a node whose operands have numbers; ``why`` is told what settled it."""
        self.why, n = why, nodes[i]
        if n.op == "const":
            return self.constant(n.value)
        if n.op == "input":
            return self._put("input", (), f"{n.source[0]}[{n.source[1]}]")
        args = tuple(numbers[a] for a in n.args)
        if n.op == "pow" and nodes[n.args[1]].op == "const":  # not rounded to the format
            return self._put("pow", args[:1], nodes[n.args[1]].value.hex())
        return self.make(n.op, *args)

    def make(self, op: str, *args: int) -> int:
        """Number of an operation on numbered values."""
        if op in ("lt", "le", "eq", "ne"):
            self.left = CHOICES
            return self._compare(op, *args)
        if op in ("and", "or", "not"):
            return self._logic(op, args)
        if op in ("if_else_zero", "select"):
            other = args[2] if op == "select" else self.constant(0.0)
            return self._select(args[0], args[1], other)
        if op in ("fmin", "fmax"):
            return self._clip(op, *args)
        return self._arithmetic(op, args)

    # -- logic and choices -----------------------------------------------------------------------

    def _logic(self, op: str, args: tuple[int, ...]) -> int:
        args = tuple(map(self._truth, args))
        values = [self._value(a) for a in args]
        if op == "not":
            if values[0] is not None:
                return self.constant(float(values[0] == 0))
            inner = self.forms[args[0]]
            if inner.op == "not" and self.forms[inner.args[0]].op in BOOLEAN:
                return inner.args[0]
            return self._put("not", args)
        strong = op == "or"
        for value, other in ((values[0], args[1]), (values[1], args[0])):
            if value is not None and bool(value) == strong:
                return self.constant(float(strong))
            if value is not None and self.forms[other].op in BOOLEAN:
                return other
        if args[0] == args[1] and self.forms[args[0]].op in BOOLEAN:
            return args[0]
        return self._put(op, tuple(sorted(args)))

    def _select(self, condition: int, first: int, second: int, kind: str = "select") -> int:
        condition = self._truth(condition)
        settled = self._value(condition)
        if settled is not None:
            return first if settled else second
        if first == second and kind == "select":
            return first
        form = self.forms[condition]
        if form.op == "not":
            return self._select(form.args[0], second, first, kind)
        inner = self.forms[first]
        if inner.op == kind and inner.args[0] == condition:
            first = inner.args[1]
        inner = self.forms[second]
        if inner.op == kind and inner.args[0] == condition:
            second = inner.args[2]
        return self._put(kind, (condition, first, second))

    def _truth(self, i: int) -> int:
        # Of what is only told apart from zero, the sign says nothing.
        while self.forms[i].op in ("neg", "fabs"):
            self.why["only whether it is zero is looked at"] = None
            i = self.forms[i].args[0]
        return i

    def _clip(self, op: str, x: int, y: int) -> int:
        if x == y:
            return x
        known, limit = self._range(x), self._value(y)
        if known is not None and not known.nan and limit is not None:
            never = known.high < limit or (known.high == limit and limit != 0)
            if op == "fmax":
                never = known.low > limit or (known.low == limit and limit != 0)
            if never:
                text = f"[{known.low:.6g}, {known.high:.6g}]"
                self.why[f"the clip at {limit:.6g} never acts: its operand lies in {text}"] = None
                return x
        return self._put(op, (x, y))

    def _range(self, i: int) -> Interval | None:
        value = self._value(i)
        return self.ranges.get(i) if value is None else Interval(value, value)

    # -- arithmetic ------------------------------------------------------------------------------

    def _negated(self, i: int) -> int:
        form = self.forms[i]
        if form.op == "neg":
            return form.args[0]
        value = self._value(i)
        return self._put("neg", (i,)) if value is None else self.constant(-value)

    def _arithmetic(self, op: str, args: tuple[int, ...]) -> int:
        first = self.forms[args[0]]
        if op == "neg":
            return self._negated(args[0])
        if op == "fabs":
            if first.op in ("neg", "fabs"):
                self.why["only the magnitude is used"] = None
                return self._arithmetic("fabs", first.args)
            return self._put(op, args)
        if op == "sq":
            return self._arithmetic("mul", (args[0], args[0]))
        if op == "twice":
            return self._arithmetic("mul", (self.constant(2.0), args[0]))
        if op == "inv":
            return self._arithmetic("div", (self.constant(1.0), args[0]))
        if op == "sub":
            return self._arithmetic("add", (args[0], self._negated(args[1])))
        if op in ("mul", "div"):
            turned = [self.forms[a].op == "neg" for a in args]
            if any(turned):
                bare = tuple(
                    self._negated(a) if t else a for a, t in zip(args, turned, strict=True)
                )
                product = self._arithmetic(op, bare)
                return product if all(turned) else self._negated(product)
            one = self.constant(1.0)
            if one in args[1:] or (op == "mul" and one in args):
                return args[0] if args[1] == one else args[1]
        if op == "add":
            pair = self._either(*args)
            if pair is not None:
                return pair
        return self._put(op, tuple(sorted(args)) if op in COMMUTATIVE else args)

    def _either(self, x: int, y: int) -> int | None:
        # (c ? a : 0) + (c ? 0 : b) is a or b, but for the sign of a zero.
        zero = self.constant(0.0)
        for p, q in ((self.forms[x], self.forms[y]), (self.forms[y], self.forms[x])):
            alike = p.op == q.op == "select" and p.args[0] == q.args[0]
            if alike and p.args[2] == q.args[1] == zero:
                return self._select(p.args[0], p.args[1], q.args[2], "either")
        return None

    # -- comparisons -----------------------------------------------------------------------------

    def _compare(self, op: str, x: int, y: int) -> int:
        a, b = self._value(x), self._value(y)
        if a is not None and b is not None:
            made = {"lt": a < b, "le": a <= b, "eq": a == b, "ne": a != b}[op]
            return self.constant(float(made))
        settled = self._apart(op, x, y)
        if settled is not None:
            return settled
        lifted = self._into_choices(op, x, y)
        if lifted is not None:
            return lifted
        if a is not None or b is not None:
            found = self._with_constant(op, x, y)
            if found is not None:
                return found
        return self._put(op, tuple(sorted((x, y))) if op in COMMUTATIVE else (x, y))

    def _apart(self, op: str, x: int, y: int) -> int | None:
        p, q = self._range(x), self._range(y)
        if p is None or q is None or p.nan or q.nan:
            return None
        if p.high < q.low or q.high < p.low:
            first = p.high < q.low
            true = {"lt": first, "le": first, "eq": False, "ne": True}[op]
            text = f"[{p.low:.6g}, {p.high:.6g}] and [{q.low:.6g}, {q.high:.6g}]"
            self.why[f"the values compared lie in {text}"] = None
            return self.constant(float(true))
        return None

    def _into_choices(self, op: str, x: int, y: int) -> int | None:
        # A comparison with a choice that has a constant arm is a choice of comparisons.
        for k, i in enumerate((x, y)):
            split = self._split(i, DEEP) if self.left else None
            if split is None:
                continue
            self.left -= 1
            condition, first, second = split
            first, second = (
                self._compare(op, *((arm, y) if k == 0 else (x, arm))) for arm in (first, second)
            )
            return self._select(condition, first, second)
        return None

    def _split(self, i: int, deep: int) -> tuple[int, int, int] | None:
        # A choice, or a sign, a magnitude, a sum or a product of one, as a choice.
        if not deep:
            return None
        form = self.forms[i]
        if form.op in ("select", "either"):
            condition, first, second = form.args
            constant = any(self._value(a) is not None for a in (first, second))
            if constant or any(self._split(a, deep - 1) for a in (first, second)):
                return condition, first, second
            return None
        inner = form.args if form.op in ("neg", "fabs", "add", "mul") else ()
        # Choices before sums that hold some: the order must not hang on a constant.
        for k, a in sorted(enumerate(inner), key=lambda x: self.forms[x[1]].op != "select"):
            found = self._split(a, deep - 1)
            if found is not None:
                rest = form.args
                first, second = (
                    self.make(form.op, *rest[:k], arm, *rest[k + 1 :]) for arm in found[1:]
                )
                return found[0], first, second
        return None

    def _with_constant(self, op: str, x: int, y: int) -> int | None:
        left = self._value(x) is None  # value op constant; else constant op value
        value, c = (x, self._value(y)) if left else (y, self._value(x))
        assert c is not None
        form = self.forms[value]
        if form.op == "neg":
            minus = self.constant(-c)
            pair = (minus, form.args[0]) if left else (form.args[0], minus)
            return self._compare(op, *pair)
        if c == 0:
            if form.op == "fabs" and op in ("eq", "ne"):
                return self._compare(op, form.args[0], self.constant(0.0))
            factors = [self._value(a) for a in form.args] if form.op == "mul" else []
            for factor, other in zip(factors, form.args[::-1], strict=False):
                # A factor of at least 1 underflows nothing.
                if factor is not None and abs(factor) >= 1:
                    self.why["only its sign, or whether it is zero, is looked at"] = None
                    zero = self.constant(0.0)
                    first = left == (factor > 0)
                    return self._compare(op, *((other, zero) if first else (zero, other)))
        if value in self.whole and abs(c) < LARGE:
            return self._whole(op, value, c, left)
        if form.op == "add":
            return self._whole_sum(op, form, c, left)
        return None

    def _whole_sum(self, op: str, form: Form, c: float, left: bool) -> int | None:
        # A whole number and a constant, compared with a constant: no rounding reaches so far.
        for k, a in enumerate(form.args):
            addend = self._value(a)
            other = form.args[1 - k]
            if addend is None or other not in self.whole or op not in ("lt", "le"):
                continue
            limit = c - addend
            if abs(limit - round(limit)) > HALVES and max(abs(c), abs(addend)) < LARGE:
                return self._whole(op, other, limit, left)
        return None

    def _whole(self, op: str, value: int, c: float, left: bool) -> int | None:
        # Of a limit, only between which whole numbers it lies.
        self.why["a whole number is compared"] = None
        if op in ("eq", "ne"):
            return self.constant(float(op == "ne")) if c != math.floor(c) else None
        if left:
            below = math.ceil(c) if op == "lt" else math.floor(c) + 1
        else:
            below = math.floor(c) + 1 if op == "lt" else math.ceil(c)
        limit = self._put("lt", (value, self.constant(below - 0.5)))
        return limit if left else self._logic("not", (limit,))
