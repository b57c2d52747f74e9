"""Numbers of the limits' fields in formulas: compared exactly, whatever their format."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from .c_values import literal
from .smt import TRUE, every, negated, whole

WIDE = 96  # bits in which numbers of different scale are compared; nothing here needs as many


def _single(x: np.float32) -> str:
    return literal(int(x.view(np.uint32)))


def _ends(value: Fraction) -> tuple[np.float32, np.float32]:
    """The float32 numbers next to a number, not above and not below it."""
    low = high = np.float32(float(value))
    while Fraction(float(low)) > value:
        low = np.nextafter(low, np.float32(-np.inf))
    while Fraction(float(high)) < value:
        high = np.nextafter(high, np.float32(np.inf))
    return low, high


@dataclass(frozen=True)
class Number:
    """A field's number."""

    term: str
    fraction: int | None

    def _than(self, other: Number | Fraction | int, op: str) -> str:
        if isinstance(other, Number):
            return self._ordered(op, other)
        value = Fraction(other)
        if self.fraction is None:
            low, high = _ends(value)
            end = low if op in ("leq", "gt") else high
            return f"(fp.{op} {self.term} {_single(end)})"
        scaled = value * 2**self.fraction
        floor = scaled.numerator // scaled.denominator
        end_raw = floor if op in ("leq", "gt") or floor == scaled else floor + 1
        return f"(bvs{op[:2]} {self.term} {whole(end_raw, WIDE)})"

    def _ordered(self, op: str, other: Number) -> str:
        a, b = self._aligned(other)
        if self.fraction is None:
            return f"(fp.{op} {a} {b})"
        return f"(bvs{op[:2]} {a} {b})"

    def _aligned(self, other: Number) -> tuple[str, str]:
        """Both in one format; whole numbers in units of the finer."""
        if self.fraction is None or other.fraction is None:
            assert self.fraction is other.fraction
            return self.term, other.term
        most = max(self.fraction, other.fraction)
        return self.moved(most), other.moved(most)

    def moved(self, fraction: int) -> str:
        """The same in a finer unit."""
        assert self.fraction is not None
        if fraction == self.fraction:
            return self.term
        return f"(bvshl {self.term} {whole(fraction - self.fraction, WIDE)})"

    def __le__(self, other: Number | Fraction | int) -> str:
        return self._than(other, "leq")

    def __lt__(self, other: Number | Fraction | int) -> str:
        return self._than(other, "lt")

    def __ge__(self, other: Number | Fraction | int) -> str:
        return self._than(other, "geq")

    def __gt__(self, other: Number | Fraction | int) -> str:
        return self._than(other, "gt")

    def equals(self, other: Number | Fraction | int) -> str:
        """The same number; NaN is none."""
        return every(self <= other, self >= other)

    def differs(self, other: Number | Fraction | int) -> str:
        """Another number, or NaN."""
        return negated(self.equals(other))

    def inside(self, low: Fraction | int, high: Fraction | int) -> str:
        """Within a range, the ends included; NaN is in none."""
        return every(self >= low, self <= high)

    def __neg__(self) -> Number:
        how = "fp.neg" if self.fraction is None else "bvneg"
        return Number(f"({how} {self.term})", self.fraction)

    def __abs__(self) -> Number:
        if self.fraction is None:
            return Number(f"(fp.abs {self.term})", None)
        return Number(f"(ite {self < 0} {(-self).term} {self.term})", self.fraction)

    def _combined(self, other: Number, single: str, exact: str) -> Number:
        a, b = self._aligned(other)
        if self.fraction is None or other.fraction is None:
            return Number(f"({single} RNE {a} {b})", None)
        return Number(f"({exact} {a} {b})", max(self.fraction, other.fraction))

    def __add__(self, other: Number) -> Number:
        return self._combined(other, "fp.add", "bvadd")

    def __sub__(self, other: Number) -> Number:
        return self._combined(other, "fp.sub", "bvsub")

    def least(self, other: Number) -> Number:
        """The smaller of two."""
        assert self.fraction == other.fraction
        return Number(f"(ite {other < self} {other.term} {self.term})", self.fraction)

    def next_unit(self) -> Number:
        """A whole number one unit larger; a float as it is."""
        return self if self.fraction is None else self.plus(Fraction(1, 2**self.fraction))

    def plus(self, value: Fraction) -> Number:
        """A constant more: rounded as the format does, a float's constant downwards."""
        return self + self.constant(value)

    def constant(self, value: Fraction) -> Number:
        """The largest number of this format that is not above a value."""
        if self.fraction is None:
            return Number(_single(_ends(value)[0]), None)
        scaled = value * 2**self.fraction
        return Number(whole(scaled.numerator // scaled.denominator, WIDE), self.fraction)

    def finite(self) -> str:
        """Neither NaN nor infinite."""
        if self.fraction is not None:
            return TRUE
        return negated(f"(or (fp.isNaN {self.term}) (fp.isInfinite {self.term}))")


def snapped(value: Fraction) -> Fraction:
    """The largest float32 number not above a value: what all formats compare with."""
    return Fraction(float(_ends(value)[0]))


def of_field(term: str, fraction: int | None, unsigned: bool = False) -> Number:
    """Number of a C field: a float, or raw, in 32 bits."""
    if fraction is None:
        return Number(term, None)
    how = "zero_extend" if unsigned else "sign_extend"
    return Number(f"((_ {how} {WIDE - 32}) {term})", fraction)
