"""Statements of a Program's body, the arrays they work on, and index expressions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca

from esea_gen.language.ports import Port

Region = Literal["coeffs", "state", "in", "out", "work", "local", "table", "index"]
WORK_RANGE = 3.0e38
EPSILON = {"f64": 2.0**-53, "f32": 2.0**-24}


class ProgramError(ValueError):
    """A Program that is not well formed."""


@dataclass(frozen=True)
class Ix:
    """A whole-numbered expression: a constant, index variables times constants, table entries."""

    constant: int = 0
    terms: tuple[tuple[int, str], ...] = ()  # coefficient and index variable
    lookups: tuple[tuple[int, str, Ix], ...] = ()  # coefficient, index table, and the place in it

    @staticmethod
    def of(value: Ix | int) -> Ix:
        return value if isinstance(value, Ix) else Ix(int(value))

    def __add__(self, other: Ix | int) -> Ix:
        o = Ix.of(other)
        total: dict[str, int] = {}
        for c, v in self.terms + o.terms:
            total[v] = total.get(v, 0) + c
        terms = tuple((c, v) for v, c in total.items() if c)
        return Ix(self.constant + o.constant, terms, self.lookups + o.lookups)

    __radd__ = __add__

    def __mul__(self, factor: int) -> Ix:
        return Ix(
            self.constant * factor,
            tuple((c * factor, v) for c, v in self.terms),
            tuple((c * factor, t, i) for c, t, i in self.lookups),
        )

    __rmul__ = __mul__

    def __sub__(self, other: Ix | int) -> Ix:
        return self + Ix.of(other) * -1

    def __rsub__(self, other: int) -> Ix:
        return Ix.of(other) + self * -1

    def value(self, env: Mapping[str, int], tables: Mapping[str, Sequence[int]]) -> int:
        total = self.constant
        for c, v in self.terms:
            total += c * env[v]
        for c, t, i in self.lookups:
            total += c * int(tables[t][i.value(env, tables)])
        return total

    def fold(self, env: Mapping[str, int], tables: Mapping[str, Sequence[int]]) -> Ix:
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
    array: str
    start: Ix
    length: int
    stride: int = 1


@dataclass(frozen=True)
class Memory:
    name: str
    size: int
    region: Region
    port: Port  # what stands in it
    values: Any = None  # tables: content by number format; index tables: the numbers

    def __getitem__(self, place: Any) -> Ref:
        """A slice: ``a[i]``, ``a[:]``, ``a[i : n]`` (start, number of elements)."""
        if isinstance(place, slice):
            if place.start is None and place.stop is None:
                return Ref(self.name, Ix(0), self.size)
            return Ref(self.name, Ix.of(place.start), int(place.stop), int(place.step or 1))
        return Ref(self.name, Ix.of(place), 1)

    def at(self, place: Ix | int) -> Ix:
        """An entry as an index."""
        return Ix(0, (), ((1, self.name, Ix.of(place)),))


@dataclass(frozen=True)
class Call:
    """A kernel on slices: reads all of them, then writes its results."""

    kernel: ca.Function
    args: tuple[Ref, ...]
    results: tuple[Ref, ...]
    note: str = ""


@dataclass(frozen=True)
class For:
    """A loop from ``start`` up to, not including, ``stop``."""

    var: str  # index variable, visible in the body only
    start: Ix
    stop: Ix
    most: Ix  # largest number of passes for one entry; may read index tables
    body: list[Statement]
    unroll: bool = False  # printed once for each pass
    # Largest number of passes of all entries in a step, where the ranges allow more; checked.
    total: int | None = None


@dataclass(frozen=True)
class When:
    # A real element that is not 0, or a comparison (`<`, `==`) of whole numbers.
    flag: Ref | tuple[Ix, str, Ix]
    then: list[Statement]
    otherwise: list[Statement]


@dataclass(frozen=True)
class Exit:
    flag: Ref


@dataclass(frozen=True)
class SetIndex:
    var: str
    value: Ix


@dataclass(frozen=True)
class Invoke:
    """Run another part of the body."""

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


def reads_of(s: Statement) -> tuple[list[Ref], list[Ix]]:
    """Slices that a statement itself reads or writes, and its index expressions beside theirs."""
    if isinstance(s, Call):
        return [*s.args, *s.results], []
    if isinstance(s, For):
        return [], [s.start, s.stop]
    if isinstance(s, When):
        return ([s.flag], []) if isinstance(s.flag, Ref) else ([], [s.flag[0], s.flag[2]])
    if isinstance(s, Exit):
        return [s.flag], []
    return [], [s.value] if isinstance(s, SetIndex) else list(s.args)


def walk_statements(body: Sequence[Statement]) -> Iterator[Statement]:
    """Every statement of a body, the inner ones too."""
    for s in body:
        yield s
        if isinstance(s, For):
            yield from walk_statements(s.body)
        elif isinstance(s, When):
            yield from walk_statements(s.then)
            yield from walk_statements(s.otherwise)
