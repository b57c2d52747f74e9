"""C's numbers as formulas, evaluated for many numbers: what the C gives, worked out in Python."""

from __future__ import annotations

import itertools
import math
import operator
from fractions import Fraction

import numpy as np
import pytest

from esea_gen.verify.c_values import (
    BASIC,
    BOOL,
    INT,
    LONG,
    REAL,
    UINT,
    ULONG,
    COperators,
    CType,
    CValue,
    RefusedError,
    literal,
    single,
)
from esea_gen.verify.limits_numbers import WIDE, Number, of_field, snapped
from esea_gen.verify.smt import FALSE, TRUE, Script, every, implied, negated, some, whole

from .smt_terms import Terms

WHOLE = (INT, UINT, LONG, ULONG)
NAMES = {INT: "int", UINT: "unsigned", LONG: "long", ULONG: "unsigned long", BOOL: "bool"}
MATH = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "&": operator.and_,
    "|": operator.or_,
    "^": operator.xor,
}
ORDER = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
FLOATS = [0.0, -0.0, 1.5, -2.25, 3e38, 1e-40, -1e-45, math.inf, -math.inf, math.nan]


def values_of(kind: CType) -> list[int]:
    some_ = [0, 1, 2, 7, 2 ** (kind.bits - 1) - 1, 123456789]
    more = [-1, -2, -7, -(2 ** (kind.bits - 1))] if kind.signed else [2**kind.bits - 1]
    return some_ + more


def wrapped(value: int, kind: CType) -> int:
    held = value % 2**kind.bits
    return held - 2**kind.bits if kind.signed and held >= 2 ** (kind.bits - 1) else held


class Bench:
    """Operators on unknown numbers a and b."""

    def __init__(self, free: str = "") -> None:
        self.script = Script()
        self.c = COperators(self.script, free)
        self.last: tuple[int, str] = (-1, "")
        self.terms = Terms([], {})

    def unknown(self, name: str, kind: CType) -> CValue:
        return CValue(kind, term=self.script.unknown(name, kind.sort))

    def at(self, made: CValue, **given):
        """A value for given numbers, as Python has it."""
        term = self.c.term(made)
        key = (len(self.script.lines), repr(given))
        if key != self.last:
            words = {n: as_term(v, k) for n, (v, k) in given.items()}
            self.last, self.terms = key, Terms(self.script.lines, words)
            assert all(self.terms.facts)
        return as_number(self.terms(term), made.type)


def as_term(value, kind: CType):
    return np.float32(value) if kind == REAL else (value % 2**kind.bits, kind.bits)


def as_number(found, kind: CType):
    if kind == REAL:
        return float(found)
    if kind == BOOL:
        return found
    value, bits = found
    assert bits == kind.bits
    return wrapped(value, kind)


def test_types_by_their_names():
    assert BASIC["int"] == INT == CType("int", 32, True)
    assert BASIC["unsigned int"] == UINT == CType("int", 32, False)
    assert BASIC["float"] == REAL == CType("float", 32, True)
    assert BASIC["_Bool"] == BOOL
    for name in ("long", "long int", "long long", "long long int"):
        assert BASIC[name] == LONG == CType("int", 64, True)
        assert BASIC[f"unsigned {name}"] == ULONG == CType("int", 64, False)
    assert len(BASIC) == 12
    assert [t.sort for t in (BOOL, INT, ULONG, REAL)] == [
        *("Bool", "(_ BitVec 32)", "(_ BitVec 64)", "(_ FloatingPoint 8 24)")
    ]


@pytest.mark.parametrize("kind", WHOLE, ids=NAMES.get)
def test_operators_on_whole_numbers(kind):
    bench = Bench()
    a, b = bench.unknown("a", kind), bench.unknown("b", kind)
    made = {op: bench.c.combine(op, a, b) for op in MATH}
    asked = {op: bench.c.compare(op, a, b) for op in ORDER}
    half = CValue(kind, 7)
    mixed = {op: bench.c.combine(op, a, half) for op in MATH}
    beside = {op: bench.c.compare(op, half, b) for op in ORDER}
    left = {n: bench.c.shift("<<", a, CValue(INT, n), None) for n in (0, 3, kind.bits - 1)}
    right = {n: bench.c.shift(">>", a, CValue(INT, n), None) for n in (0, 3, kind.bits - 1)}
    far = bench.c.shift(">>", a, bench.unknown("n", UINT), None)
    assert all(v.type == kind for v in (*made.values(), *left.values(), far))
    assert all(v.type == INT for v in asked.values())
    for x, y in itertools.product(values_of(kind), repeat=2):
        given = {"a": (x, kind), "b": (y, kind), "n": (5, UINT)}
        for op, by in MATH.items():
            assert bench.at(made[op], **given) == wrapped(by(x, y), kind), (op, x, y)
            assert bench.at(mixed[op], **given) == wrapped(by(x, 7), kind)
            folded = bench.c.combine(op, CValue(kind, x), CValue(kind, y))
            assert folded.constant == wrapped(by(x, y), kind)
        for op, by in ORDER.items():
            assert bench.at(asked[op], **given) == by(x, y), (op, x, y)
            assert bench.at(beside[op], **given) == by(7, y)
            constant = bench.c.compare(op, CValue(kind, x), CValue(kind, y))
            assert bench.c.truth(constant) == (TRUE if by(x, y) else FALSE)
    for x in values_of(kind):
        given = {"a": (x, kind), "b": (0, kind), "n": (5, UINT)}
        for n, up in left.items():
            assert bench.at(up, **given) == wrapped(x << n, kind)
            assert bench.at(right[n], **given) == wrapped(x >> n, kind)
            for op, by in (("<<", x << n), (">>", x >> n)):
                constant = bench.c.shift(op, CValue(kind, x), CValue(INT, n), None)
                assert constant == CValue(kind, wrapped(by, kind))
        assert bench.at(far, **given) == x >> 5
    for n in (-1, kind.bits):
        with pytest.raises(RefusedError, match="a shift beyond the type's width"):
            bench.c.shift("<<", a, CValue(INT, n), None)


def test_operators_on_floats():
    bench = Bench()
    a, b = bench.unknown("a", REAL), bench.unknown("b", REAL)
    math_ = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}
    made = {op: bench.c.combine(op, a, b) for op in math_}
    asked = {op: bench.c.compare(op, a, b) for op in ORDER}
    true = CValue(BOOL, truth=bench.c.truth(a))
    for x, y in itertools.product(FLOATS, repeat=2):
        given = {"a": (x, REAL), "b": (y, REAL)}
        with np.errstate(all="ignore"):
            for op, by in math_.items():
                expected = by(np.float32(x), np.float32(y))
                found = np.float32(bench.at(made[op], **given))
                assert found.tobytes() == expected.tobytes() or np.isnan([found, expected]).all()
        for op, by in ORDER.items():
            assert bench.at(asked[op], **given) == by(np.float32(x), np.float32(y)), (op, x, y)
        assert bench.at(true, **given) == (np.float32(x) != 0)
    for op in ("%", "&"):
        with pytest.raises(RefusedError, match=f"'{op}' of floats"):
            bench.c.combine(op, a, b, None)
    with pytest.raises(RefusedError, match="'/' of integers"):
        bench.c.combine("/", CValue(INT, 1), CValue(INT, 2), None)
    for pair in ((a, CValue(INT, 1)), (CValue(INT, 1), a)):
        with pytest.raises(RefusedError, match="a shift of floats"):
            bench.c.shift("<<", *pair, None)


@pytest.mark.parametrize("kind", [*WHOLE, BOOL], ids=NAMES.get)
@pytest.mark.parametrize("into", [*WHOLE, BOOL, REAL], ids=lambda k: NAMES.get(k, "float"))
def test_conversions(kind, into):
    bench = Bench()
    if kind == BOOL:
        held = CValue(BOOL, truth=bench.c.truth(bench.unknown("a", INT)))
        values, of = [0, 5], INT
    else:
        held, values, of = bench.unknown("a", kind), values_of(kind), kind
    made = bench.c.convert(held, into)
    assert made.type == into
    for x in values:
        value = int(x != 0) if kind == BOOL else x
        if into == BOOL:
            expected = value != 0
        elif into == REAL:
            expected = float(np.uint32(single(Fraction(value))).view(np.float32))
        else:
            expected = wrapped(value, into)
        assert bench.at(made, a=(x, of)) == expected
        if kind != BOOL:
            constant = bench.c.convert(CValue(kind, x), into)
            assert bench.at(constant, a=(x, of)) == expected
            assert constant.constant == (x if kind == into else expected) or into in (BOOL, REAL)
    assert bench.c.convert(held, held.type) is held
    with pytest.raises(RefusedError, match="a float becomes an integer"):
        bench.c.convert(bench.unknown("f", REAL), INT)


def test_in_which_type_two_numbers_meet():
    bench = Bench()
    kinds = {k: bench.unknown(str(k), k) for k in WHOLE}
    kinds |= {REAL: bench.unknown("f", REAL), BOOL: CValue(BOOL, truth="|t|")}
    meet = {
        (INT, UINT): UINT,
        (INT, LONG): LONG,
        (UINT, LONG): LONG,
        (UINT, ULONG): ULONG,
        (INT, ULONG): ULONG,
        (LONG, ULONG): ULONG,
        (BOOL, UINT): UINT,
        (BOOL, BOOL): INT,
        (BOOL, LONG): LONG,
        (INT, INT): INT,
        **{(k, REAL): REAL for k in (*WHOLE, BOOL)},
    }
    for (one, other), kind in meet.items():
        for pair in ((one, other), (other, one)):
            found = bench.c.common(*(kinds[k] for k in pair), None)
            assert [v.type for v in found] == [kind, kind], pair


def test_one_of_two_values():
    bench = Bench()
    c = bench.c
    a, b = bench.unknown("a", INT), bench.unknown("b", UINT)
    flag = c.truth(bench.unknown("t", INT))
    assert c.choose(TRUE, a, b).type == c.choose(FALSE, a, b).type == UINT
    assert c.choose(flag, a, a) is a
    made = {
        "mixed": c.choose(flag, a, b),
        "true": c.choose(TRUE, a, b),
        "false": c.choose(FALSE, a, b),
        "truths": c.choose(flag, c.compare("<", a, CValue(INT, 3)), CValue(INT, 1)),
        "whole": c.choose(flag, c.compare("<", a, CValue(INT, 3)), CValue(INT, 2)),
    }
    assert made["truths"].truth is not None
    assert made["whole"].truth is None
    for t, x, y in itertools.product((0, 4), (-5, 2, 9), (0, 2**32 - 1)):
        given = {"t": (t, INT), "a": (x, INT), "b": (y, UINT)}
        assert bench.at(made["mixed"], **given) == (x % 2**32 if t else y)
        assert bench.at(made["true"], **given) == x % 2**32
        assert bench.at(made["false"], **given) == y
        assert bench.at(made["truths"], **given) == (int(x < 3) if t else 1)
        assert bench.at(made["whole"], **given) == (int(x < 3) if t else 2)


def facts(free: str, kind: CType, op: str, x, y, result) -> bool:
    """Whether what is stated of a free operator's result holds of a number."""
    bench = Bench(free)
    a, b = bench.unknown("a", kind), bench.unknown("b", kind)
    made = bench.c.combine(op, a, b)
    assert made.term in bench.script.declared
    again = bench.c.combine(op, a, b)
    assert again.term == made.term
    other = bench.c.combine(op, b, a)
    assert (other.term == made.term) == (kind != REAL and op == "*")
    words = {"a": as_term(x, kind), "b": as_term(y, kind)}
    words |= {
        n.strip("|"): as_term(result, kind)
        for n in bench.script.declared
        if n not in ("|a|", "|b|")
    }
    if kind != REAL:
        assert bench.c.products[0] == (a, b, made)
    return all(Terms(bench.script.lines, words).facts)


@pytest.mark.ci
def test_what_is_stated_of_free_operators_holds_and_says_something():
    numbers = [0.0, -2.0, 300.0, -70000.0, 1e18]
    for x, y in itertools.product(numbers, repeat=2):
        with np.errstate(all="ignore"):
            for op, by in (("+", np.add), ("-", np.subtract), ("*", np.multiply)):
                # b after a and a after b share the facts: what holds of one only is left out.
                if op == "-" and x != y:
                    continue
                result = float(by(np.float32(x), np.float32(y)))
                assert facts(op, REAL, op, x, y, result), (op, x, y)
    # A sum of positive numbers is not below either; a product has its sign; both their size.
    for op, x, y, wrong in (
        ("+", 3.0, 4.0, 3.5),
        ("+", 100.0, 200.0, 600.0),
        ("-", 200.0, 200.0, -513.0),
        ("*", 3.0, 4.0, -12.0),
        ("*", -3.0, 4.0, 12.0),
        ("*", 3.0, -4.0, 12.0),
        ("*", -3.0, -4.0, -12.0),
        ("*", 3.0, 4.0, 2.0**61),
        ("*", 2.0**40, 1.0, math.inf),
    ):
        assert not facts(op, REAL, op, x, y, wrong), (op, x, y, wrong)
    # What is within 2^8 gives sums within 2^9; beyond 2^23 nothing is said.
    assert facts("+", REAL, "+", 100.0, -200.0, -512.0)
    assert facts("-", REAL, "-", 2.0**25, 2.0**25, -(2.0**30))
    # Operators that are not free are exact, and so are products with a constant.
    bench = Bench("*")
    a = bench.unknown("a", INT)
    assert bench.at(bench.c.combine("*", a, CValue(INT, 7)), a=(6, INT)) == 42
    assert bench.at(bench.c.combine("+", a, a), a=(6, INT)) == 12


def test_products_of_short_numbers_have_their_sign():
    def stated(result: int, x: int, y: int) -> bool:
        bench = Bench("*")
        wide = [bench.c.convert(bench.unknown(n, INT), LONG) for n in "ab"]
        made = bench.c.combine("*", *wide)
        words = {"a": as_term(x, INT), "b": as_term(y, INT)}
        words[made.term.strip("|")] = as_term(result, LONG)
        return all(Terms(bench.script.lines, words).facts)

    for x, y in itertools.product((-3, 0, 5), repeat=2):
        assert stated(x * y, x, y)
        assert stated(-x * y, x, y) == (x * y == 0)
    # A cast to fewer bits fits, where products alone are free.
    bench = Bench("*")
    long = bench.unknown("a", LONG)
    bench.c.convert(long, INT)
    for x, fits in ((2**31 - 1, True), (2**31, False), (-(2**31), True), (-(2**31) - 1, False)):
        assert Terms(bench.script.lines, {"a": as_term(x, LONG)}).facts == [fits]
    exact = Bench()
    exact.c.convert(exact.unknown("a", LONG), INT)
    assert Terms(exact.script.lines, {"a": as_term(2**40, LONG)}).facts == []


def test_the_nearest_float32_number():
    for x in (0.1, -0.1, 1 / 3, 1e-44, 3e38, 2.0**24 + 1):
        assert single(Fraction(x)) == int(np.float32(x).view(np.uint32))
    one, more = (int(np.float32(v).view(np.uint32)) for v in (1, 1 + 2.0**-23))
    tie = 1 + Fraction(1, 2**24)
    assert single(tie) == one  # to even
    assert single(tie + Fraction(1, 2**70)) == more  # which a double does not tell from the tie
    assert single(tie - Fraction(1, 2**70)) == one
    assert single(1 + 3 * Fraction(1, 2**24)) == more + 1
    terms = Terms([], {})
    for x in (0.0, -1.5, 3e38, 1e-45):
        assert terms(literal(single(Fraction(float(np.float32(x)))))) == np.float32(x)


def test_formulas_are_written_once_and_as_short_as_they_are():
    assert [every(), every("a"), every("a", TRUE), every("a", "b", FALSE), every("a", "b")] == [
        *(TRUE, "a", "a", FALSE, "(and a b)")
    ]
    assert [some(), some("a"), some("a", FALSE), some("a", "b", TRUE), some("a", "b")] == [
        *(FALSE, "a", "a", TRUE, "(or a b)")
    ]
    assert [negated(x) for x in (TRUE, FALSE, "a")] == [FALSE, TRUE, "(not a)"]
    assert implied("a", "b") == "(=> a b)"
    assert whole(-1, 8) == "(_ bv255 8)"
    script = Script()
    assert script.unknown("a", "Bool") == script.unknown("a", "Bool") == "|a|"
    assert script.define("Bool", "(not |a|)") == script.define("Bool", "(not |a|)") == "n0"
    assert script.define("Bool", "|a|") == "|a|"
    assert script.define("Bool", "(and |a| n0)") == "n1"
    script.fact("n1")
    assert script.lines == [
        "(declare-const |a| Bool)",
        "(define-fun n0 () Bool (not |a|))",
        "(define-fun n1 () Bool (and |a| n0))",
        "(assert n1)",
    ]
    assert script.texts == {"n0": "(not |a|)", "n1": "(and |a| n0)"}


# -- numbers of fields, compared exactly -----------------------------------------------------------

BOUNDS = [Fraction(0), Fraction(1, 10), Fraction(-1, 3), Fraction(5, 4), Fraction(-7, 2)]
COMPARE = {"<=": operator.le, "<": operator.lt, ">=": operator.ge, ">": operator.gt}


def field_values(fraction: int | None) -> list[tuple[Fraction | None, object]]:
    """Numbers of a field, and as its memory has them."""
    if fraction is None:
        near = [np.float32(float(b)) for b in BOUNDS]
        near += [np.nextafter(x, np.float32(s * 9)) for x in near for s in (-1, 1)]
        values = [(Fraction(float(x)), x) for x in near]
        return [*values, (None, np.float32(np.nan))]
    raw = {math.floor(b * 2**fraction) + k for b in BOUNDS for k in (-1, 0, 1)}
    return [(Fraction(r, 2**fraction), (r % 2**32, 32)) for r in sorted(raw)]


@pytest.mark.parametrize("fraction", [None, 0, 2, 20])
def test_a_field_against_a_bound(fraction):
    x = of_field("|x|", fraction)
    for value, memory in field_values(fraction):
        terms = Terms([], {"x": memory})
        for bound in BOUNDS:
            for name, by in COMPARE.items():
                found = terms(by(x, bound))
                assert found == (value is not None and by(value, bound)), (name, value, bound)
            assert terms(x.equals(bound)) == (value == bound)
            assert terms(x.differs(bound)) == (value != bound)
            inside = value is not None and bound <= value <= Fraction(5, 4)
            assert terms(x.inside(bound, Fraction(5, 4))) == inside
        assert terms(x.finite()) == (value is not None)


@pytest.mark.parametrize(("fraction", "other"), [(0, 0), (2, 20), (20, 0)])
def test_fields_of_different_scale(fraction, other):
    x, y = of_field("|x|", fraction), of_field("|y|", other)

    def number(made: Number, terms: Terms) -> Fraction:
        value, bits = terms(made.term)
        assert bits == WIDE
        return Fraction(value - 2**bits if value >> bits - 1 else value, 2**made.fraction)

    pairs = itertools.product(field_values(fraction)[::2], field_values(other)[::2])
    for (a, raw_a), (b, raw_b) in pairs:
        terms = Terms([], {"x": raw_a, "y": raw_b})
        for by in COMPARE.values():
            assert terms(by(x, y)) == by(a, b)
        assert number(x + y, terms) == a + b
        assert number(x - y, terms) == a - b
        assert number(-x, terms) == -a
        assert number(abs(x), terms) == abs(a)
        assert number(x.next_unit(), terms) == a + Fraction(1, 2**fraction)
        for bound in BOUNDS:
            down = Fraction(math.floor(bound * 2**fraction), 2**fraction)
            assert number(x.constant(bound), terms) == down
            assert number(x.plus(bound), terms) == a + down
        if fraction == other:
            assert number(x.least(y), terms) == min(a, b)


def test_fields_that_are_floats():
    x, y = of_field("|x|", None), of_field("|y|", None)
    assert x.next_unit() is x
    for (a, raw_a), (b, raw_b) in itertools.product(field_values(None)[:-1], repeat=2):
        terms = Terms([], {"x": raw_a, "y": raw_b})
        for by in COMPARE.values():
            assert terms(by(x, y)) == by(a, b)
        assert terms((x + y).term) == raw_a + raw_b
        assert terms((x - y).term) == raw_a - raw_b
        assert terms((-x).term) == -raw_a
        assert terms(abs(x).term) == abs(raw_a)
        assert terms(x.least(y).term) == min(raw_a, raw_b)
        assert terms(x.plus(Fraction(1, 10)).term) == raw_a + np.float32(snapped(Fraction(1, 10)))
    for value in (np.inf, -np.inf, np.nan):
        assert not Terms([], {"x": np.float32(value)})(x.finite())


def test_bounds_are_snapped_downwards():
    for bound in BOUNDS:
        found = snapped(bound)
        assert found <= bound
        above = float(np.nextafter(np.float32(float(found)), np.float32(np.inf)))
        assert Fraction(above) > bound
        assert Fraction(float(np.float32(float(found)))) == found
