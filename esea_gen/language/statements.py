"""Statements of a Program's body, the arrays they work on, and what indexes these."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca

Region = Literal["coeffs", "state", "in", "out", "work", "local", "table", "index"]
WORK_RANGE = 3.0e38
EPSILON = {"f64": 2.0**-53, "f32": 2.0**-24}


class ProgramError(ValueError):
    """A Program that is not well formed."""


@dataclass(frozen=True)
class Ix:
    """A whole-numbered expression: a constant, index variables times constants, table entries.

    terms: coefficient and index variable.
    lookups: coefficient, index table, and the place in it.
    """

    constant: int = 0
    terms: tuple[tuple[int, str], ...] = ()
    lookups: tuple[tuple[int, str, Ix], ...] = ()

    @staticmethod
    def of(value: Ix | int) -> Ix:
        """An expression from a number or an expression."""
        return value if isinstance(value, Ix) else Ix(int(value))

    def __add__(self, other: Ix | int) -> Ix:
        """Sum."""
        o = Ix.of(other)
        total: dict[str, int] = {}
        for c, v in self.terms + o.terms:
            total[v] = total.get(v, 0) + c
        terms = tuple((c, v) for v, c in total.items() if c)
        return Ix(self.constant + o.constant, terms, self.lookups + o.lookups)

    __radd__ = __add__

    def __mul__(self, factor: int) -> Ix:
        """Multiple."""
        return Ix(
            self.constant * factor,
            tuple((c * factor, v) for c, v in self.terms),
            tuple((c * factor, t, i) for c, t, i in self.lookups),
        )

    __rmul__ = __mul__

    def __sub__(self, other: Ix | int) -> Ix:
        """Difference."""
        return self + Ix.of(other) * -1

    def __rsub__(self, other: int) -> Ix:
        """Difference from a number."""
        return Ix.of(other) + self * -1

    def value(self, env: Mapping[str, int], tables: Mapping[str, Sequence[int]]) -> int:
        """Its value."""
        total = self.constant
        for c, v in self.terms:
            total += c * env[v]
        for c, t, i in self.lookups:
            total += c * int(tables[t][i.value(env, tables)])
        return total

    def fold(self, env: Mapping[str, int], tables: Mapping[str, Sequence[int]]) -> Ix:
        """With some index variables replaced by numbers."""
        out = Ix(self.constant)
        for c, v in self.terms:
            out = out + (Ix(c * env[v]) if v in env else Ix(0, ((c, v),)))
        for c, t, i in self.lookups:
            inner = i.fold(env, tables)
            known = not inner.terms and not inner.lookups and t in tables
            out = out + (
                Ix(c * tables[t][inner.constant]) if known else Ix(0, (), ((c, t, inner),))
            )
        return out


@dataclass(frozen=True)
class Ref:
    """A slice of an array."""

    array: str
    start: Ix
    length: int
    stride: int = 1


@dataclass(frozen=True)
class Memory:
    """An array of a Program.

    region: where it lives: a port's struct, ``work`` (in the state struct, carries nothing from one
        step to the next), ``local`` (on the stack of one part), ``table`` (constant) or ``index``
        (constant whole numbers).
    values: tables: content by number format; index tables: the numbers.
    """

    name: str
    size: int
    region: Region
    meaning: str = ""
    values: Any = None

    def __getitem__(self, place: Any) -> Ref:
        """A slice: ``a[i]``, ``a[:]``, ``a[i : n]`` (start, number of elements)."""
        if isinstance(place, slice):
            if place.start is None and place.stop is None:
                return Ref(self.name, Ix(0), self.size)
            return Ref(self.name, Ix.of(place.start), int(place.stop), int(place.step or 1))
        return Ref(self.name, Ix.of(place), 1)

    def at(self, place: Ix | int) -> Ix:
        """An entry as an index.

        place: which entry: of an index table, or of a work array that holds a whole number which
            the same step has put there.
        """
        return Ix(0, (), ((1, self.name, Ix.of(place)),))


@dataclass(frozen=True)
class Call:
    """A kernel on slices: reads all of them, then writes its results.

    args, results: one for each argument and result.
    """

    kernel: ca.Function
    args: tuple[Ref, ...]
    results: tuple[Ref, ...]
    note: str = ""


@dataclass(frozen=True)
class For:
    """A loop from ``start`` up to, not including, ``stop``.

    var: index variable, visible in the body only.
    most: largest number of passes for one entry; may read index tables.
    unroll: printed once for each pass; the range must be constant or that of unrolled loops around.
    total: largest number of passes of all entries in one step, where that is less than what the
        ranges allow: the executor holds every step against it.
    """

    var: str
    start: Ix
    stop: Ix
    most: Ix
    body: list[Statement]
    unroll: bool = False
    total: int | None = None


@dataclass(frozen=True)
class When:
    """One of two ways.

    flag: a real element that is not 0, or a comparison (``<``, ``==``) of whole numbers.
    """

    flag: Ref | tuple[Ix, str, Ix]
    then: list[Statement]
    otherwise: list[Statement]


@dataclass(frozen=True)
class Exit:
    """Exit the innermost loop when a real element is not 0."""

    flag: Ref


@dataclass(frozen=True)
class SetIndex:
    """Give an index variable a value."""

    var: str
    value: Ix


@dataclass(frozen=True)
class Invoke:
    """Run another part of the body.

    args: values of its index parameters.
    """

    part: str
    args: tuple[Ix, ...]


Statement = Call | For | When | Exit | SetIndex | Invoke


@dataclass(frozen=True)
class Part:
    """A named piece of the body: a static function in the C."""

    name: str
    params: tuple[str, ...]
    body: list[Statement]
    comment: str = ""


def walk_statements(body: Sequence[Statement]) -> Iterator[Statement]:
    """Every statement of a body, the inner ones too."""
    for s in body:
        yield s
        if isinstance(s, For):
            yield from walk_statements(s.body)
        elif isinstance(s, When):
            yield from walk_statements(s.then)
            yield from walk_statements(s.otherwise)
