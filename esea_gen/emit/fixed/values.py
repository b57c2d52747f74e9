"""Values, targets and helpers shared by all lowering rules."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from fractions import Fraction
from functools import cache, cached_property

from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed.expression import Expr, OverflowProofError
from esea_gen.emit.integers import UNSIGNED, chosen_nodes, integer_nodes
from esea_gen.emit.local_names import stem
from esea_gen.emit.printed import number_name
from esea_gen.emit.spans import COMPARES
from esea_gen.emit.walker import Kernel, UnsupportedOperationError, status_words, use_counts
from esea_gen.language.ports import Port, Tunable

NARROW_LIMIT = 2**31 - 1
WIDE_LIMIT = 2**61 - 1  # leaves room for rounding and for the sum of two
MOST_FRACTION_BITS = 90
ZERO = -1  # stands for the missing arm of a select with zero
EXACT = frozenset({"add", "sub", "neg", "fabs", "fmin", "fmax", "twice"})


class LoweringError(UnsupportedOperationError):
    """An operation that q31 cannot represent, with place, reason and remedy."""


@dataclass(frozen=True)
class Source:
    name: str
    place: str
    fraction: int
    low: int
    high: int
    port: str  # port and element, for messages
    declared: Port | Tunable | None = None
    # Memory may hold any number: the check sees it as it is, all else sees it cut to the range.
    checked: bool = False
    bits: int = 32


@dataclass(frozen=True)
class Value:
    expr: Expr  # how it is written where it is used
    fraction: int
    local: float = 0.0  # largest absolute error that its own operation adds
    relative: float = 0.0  # largest error that it adds relative to its result
    # By operand position: the error of a constant as it is stored for this operation.
    constants: Mapping[int, float] = field(default_factory=dict)

    @cached_property
    def low(self) -> Fraction:
        return Fraction(self.expr.low) * two(-self.fraction)

    @cached_property
    def high(self) -> Fraction:
        return Fraction(self.expr.high) * two(-self.fraction)

    @cached_property
    def reach(self) -> tuple[float, float]:
        return float(self.low), float(self.high)

    @cached_property
    def rounding(self) -> Hashable:
        """All of it that the errors of a result depend on."""
        return self.local, self.relative, tuple(self.constants.items()), self.reach

    @cached_property
    def _called(self) -> dict[str, Value]:
        return {}

    def called(self, name: str) -> Value:
        """Cached object of a name, which stores its derived results."""
        if name not in self._called:
            self._called[name] = replace(self, expr=ex.named(name, self.expr))
        return self._called[name]


@dataclass(frozen=True)
class LoweredStep:
    name: str
    expr: Expr
    comment: str = ""
    node: int = -1


@dataclass(frozen=True)
class LoweredKernel:
    kernel: Kernel
    steps: tuple[LoweredStep, ...]
    values: tuple[Value | None, ...]  # per node; None for constants
    results: tuple[tuple[Expr, ...], ...]  # per result and element, in its port's format
    # Largest error of each conversion to its port's format.
    conversions: tuple[tuple[float, ...], ...]
    saturations: tuple[str, ...]  # conversions to a port that saturate


@dataclass(frozen=True)
class FieldPlan:
    port: Port | Tunable
    fraction: int
    low: int  # raw numbers of its range; of a coefficient, what prepare makes
    high: int
    checked: bool = False  # whether the step itself holds the coefficient against its port's range

    @property
    def name(self) -> str:
        """C name of the field: the port's alone, for the format goes with the range."""
        return str(self.port.name)

    @property
    def lsb(self) -> float:
        return float(2.0**-self.fraction)

    @property
    def word(self) -> bool:
        """Whether it is a status word."""
        return bool(getattr(self.port, "flags", ()))

    @property
    def whole(self) -> bool:
        """Whether C holds a ``uint32_t``: a status word, a flag or a count from 0 on."""
        return bool(getattr(self.port, "whole", False) and self.port.low >= 0)

    @property
    def port_range(self) -> tuple[int, int]:
        scale = Fraction(2) ** self.fraction
        low, high = Fraction(self.port.low) * scale, Fraction(self.port.high) * scale
        return max(math.ceil(low), ex.INT32[0]), min(math.floor(high), ex.INT32[1])

    def raw(self, value: float) -> int:
        exact = math.floor(Fraction(value) * Fraction(2) ** self.fraction + Fraction(1, 2))
        return min(max(exact, self.low), self.high)


@cache
def two(power: int) -> Fraction:
    return Fraction(1 << power) if power >= 0 else Fraction(1, 1 << -power)


@cache
def _exact(value: float) -> Fraction:
    return Fraction(value)


def _fits(x: Fraction, f: int, most: int) -> bool:
    # x 2**f <= most, in whole numbers alone: asked some 10^5 times in a search.
    n, d = x.numerator, x.denominator
    return (n << f) <= most * d if f >= 0 else n <= (most * d) << -f


def best_fraction(low: Fraction, high: Fraction, limit: int = NARROW_LIMIT) -> int:
    """Largest number of fraction bits that a range leaves room for."""
    most = max(abs(low), abs(high))
    if most == 0:
        return 30
    f = limit.bit_length() - (most.numerator.bit_length() - most.denominator.bit_length())
    # Two's complement holds one more below zero.
    while not (_fits(high, f, limit) and _fits(-low, f, limit + 1)):
        f -= 1
    return min(f, MOST_FRACTION_BITS)


@cache
def local_name(name: str, fraction: int) -> str:
    base = stem(name.removesuffix("_used")) + ("_used" if name.endswith("_used") else "")
    return f"{base}_q{fraction}" if fraction >= 0 else f"{base}_qm{-fraction}"


@dataclass(eq=False)
class LoweringBase:
    """Shared part of all rules: operands in a format, ranges, messages."""

    kernel: Kernel
    source: Callable[[int, int], Source]  # of an argument's element
    labels: Mapping[int, tuple[str, str]] = field(default_factory=dict)  # name, comment
    facts: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    wide: Collection[int] = ()  # values that are held in 64 bits
    words: Sequence[int] = ()  # results that are status words
    checks: Collection[int] = ()  # nodes by which the step checks its own coefficients
    block: str = ""  # for messages
    others: Mapping[int, str] = field(default_factory=dict)  # names of values without a label
    ports: Sequence[Port] = ()  # of its results

    def __post_init__(self) -> None:
        self.unchecked, self.checking = dict[int, Value](), False
        self.steps: list[LoweredStep] = []
        self.values: list[Value | None] = []
        self.names: set[str] = set()
        self.uses = use_counts(self.kernel)
        # A minimum whose maximum is taken is printed within it.
        nodes = self.kernel.nodes
        ends = {a for n in nodes if n.op == "fmax" for a in n.args}
        self.clips = {a for a in ends if nodes[a].op == "fmin"}
        for r in self.kernel.results:
            for i in r:
                self.uses[i] += 1
        self.status = status_words(self.kernel, self.words, self.uses)
        self.parts = {i for w in self.status.values() for i in w.parts}
        self.compared = self._only_compared()
        arguments = {n.source[0]: n.source for n in nodes if n.op == "input"}

        def declared(argument: int) -> Port | Tunable | None:
            return self.source(*arguments[argument]).declared

        integers = integer_nodes(self.kernel, declared, self.ports)
        self.whole = {i for i, c_type in integers.items() if c_type == UNSIGNED}
        self.caps = dict.fromkeys(integers.keys() - self.whole, 0)  # of fraction bits
        self.choices = chosen_nodes(self.kernel, declared, self.ports)

    def _only_compared(self) -> set[int]:
        # Values that end in comparisons alone: kept exact, so that they decide as they should.
        results = {i for r in self.kernel.results for i in r}
        free = set(range(len(self.kernel.nodes))) - results
        for i in reversed(range(len(self.kernel.nodes))):
            n = self.kernel.nodes[i]
            passes = n.op in COMPARES or (i in free and n.op in EXACT)
            if not passes:
                free -= set(n.args)
        return free

    # -- small helpers ---------------------------------------------------------------------------

    def _fail(self, i: int, why: str, remedy: str) -> LoweringError:
        n = self.kernel.nodes[i]
        near = self._nearest_label(i)
        return LoweringError(
            f"block {self.block}: operation '{n.op}' (value v{i}{near}) cannot be lowered to q31: "
            f"{why}.",
            f"{remedy} Or try --real f32.",
        )

    def _nearest_label(self, i: int) -> str:
        if i in self.labels:
            return f", {self.labels[i][0]}"
        todo, seen = list(self.kernel.nodes[i].args), set[int]()
        inputs = []
        while todo:
            k = todo.pop()
            if k in seen:
                continue
            seen.add(k)
            if k in self.labels:
                inputs.append(self.labels[k][0])
            elif self.kernel.nodes[k].op == "input":
                inputs.append(self.source(*self.kernel.nodes[k].source).port)
            else:
                todo += self.kernel.nodes[k].args
        return f", of {', '.join(sorted(set(inputs)))}" if inputs else ""

    def _constant(self, i: int) -> Fraction | None:
        if i == ZERO:
            return Fraction(0)
        n = self.kernel.nodes[i]
        return _exact(n.value) if n.op == "const" else None

    def _value(self, i: int) -> Value:
        v = self._held(i)
        if v.expr.bits != -32:
            return v
        e, n = v.expr, self.kernel.nodes[i]
        port = self.source(*n.source).declared if n.op == "input" else None
        if port is None or e.high <= port.high:
            return Value(ex.cast(e, 32), 0)
        # Memory may hold any number: cut to the port's range.
        most = int(port.high)
        inside = ex.cast(ex.within(e, 0, most), 32)
        fits = ex.compare("le", e, ex.literal(most, -32))
        return Value(ex.choose(fits, inside, ex.literal(most), 32), 0)

    def _unsigned(self, i: int, choices: type[IntEnum] | None) -> Expr:
        # A constant by its name.
        c, v = self._constant(i), self.values[i] if i != ZERO else None
        if c is not None or v is None:
            return ex.called(ex.literal(int(c or 0), -32), number_name(c, choices))
        return ex.cast(ex.clamp(v.expr, 0, ex.LIMITS[v.expr.bits][1]), -32)

    def _held(self, i: int) -> Value:
        v = self.unchecked.get(i) if self.checking else None
        v = v or self.values[i]
        assert v is not None
        if v.expr.bits == 1:
            return Value(ex.cast(v.expr, 32), 0)
        return v

    def _ends(self, i: int) -> tuple[Fraction, Fraction]:
        c = self._constant(i)
        if c is not None:
            return c, c
        v = self._value(i)
        return v.low, v.high

    def _fraction(self, i: int) -> int:
        # What the operand can fill; a constant fills anything.
        return MOST_FRACTION_BITS if self._constant(i) is not None else self._value(i).fraction

    def align(
        self, i: int, fraction: int, bits: int, inwards: bool = False
    ) -> tuple[Expr, float, float]:
        c = self._constant(i)
        if c is not None:
            scaled = c * two(fraction)
            raw = int(scaled) if inwards else math.floor(scaled + Fraction(1, 2))
            error = float(abs(Fraction(raw) * two(-fraction) - c))
            return ex.literal(raw, bits), 0.0, error
        v = self._value(i)
        if v.fraction <= fraction:
            return ex.scale(v.expr, fraction - v.fraction, bits), 0.0, 0.0
        rounded = ex.round_shift(v.expr, v.fraction - fraction)
        return ex.cast(rounded, bits), 0.5 * 2.0**-fraction, 0.0

    def _settle(self, i: int, fraction: int, build: Callable[[int], Value]) -> Value:
        """The first format, from ``fraction`` down, in which nothing can overflow."""
        reason = ""
        for f in range(fraction, fraction - 8, -1):
            try:
                return build(f)
            except OverflowProofError as error:
                reason = reason or str(error)
        raise self._fail(i, reason, "Narrow the ranges of the ports it comes from.")

    def _bits(self, i: int) -> int:
        return 64 if i in self.wide else 32

    def _limit(self, i: int) -> int:
        return WIDE_LIMIT if i in self.wide else NARROW_LIMIT

    def _cut(self, i: int, low: Fraction, high: Fraction) -> tuple[Fraction, Fraction]:
        fact = self.facts.get(i)
        if fact is None:
            return low, high
        return max(low, Fraction(fact[0])), min(high, Fraction(fact[1]))

    def _within(self, i: int, expr: Expr, fraction: int) -> Expr:
        # A fact of algebra: cutting to it moves the value towards the exact one, never away.
        fact = self.facts.get(i)
        if fact is None:
            return expr
        low, high = (Fraction(x) * two(fraction) for x in fact)
        return ex.clamp(expr, math.floor(low), math.ceil(high))


def stored(*errors: float) -> dict[int, float]:
    """Errors of stored constants by operand position, those that are none left out."""
    return {k: e for k, e in enumerate(errors) if e}


def is_power(c: Fraction) -> bool:
    m = abs(c)
    return m != 0 and (m.numerator & (m.numerator - 1)) == 0 == (
        m.denominator & (m.denominator - 1)
    )


def last_raw(c: Fraction, fraction: int, strict: bool, upper: bool) -> int:
    """The last raw number for which a comparison with a constant holds."""
    scaled = c * two(fraction)
    if upper:
        return math.ceil(scaled) - 1 if strict else math.floor(scaled)
    return math.floor(scaled) + 1 if strict else math.ceil(scaled)


def threshold(raw: int, like: Expr) -> Expr:
    """A threshold as a literal; one beyond the type decides at once, by its interval."""
    low, high = ex.LIMITS[like.bits]
    if low <= raw <= high:
        return ex.literal(raw, like.bits)
    return Expr("literal", (), 64, raw, raw, (raw,))
