"""Numbers of C as formulas: types, conversions and operators as C99 has them."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from .smt import FALSE, FLOAT, TRUE, Script, every, implied, negated, whole, word


class CType(NamedTuple):
    """A number's type in C."""

    kind: str  # bool, int or float
    bits: int
    signed: bool

    @property
    def sort(self) -> str:
        """What a formula holds it in."""
        return {"bool": "Bool", "float": FLOAT}.get(self.kind, word(self.bits))


BOOL, INT, UINT = CType("bool", 1, False), CType("int", 32, True), CType("int", 32, False)
LONG, ULONG, REAL = CType("int", 64, True), CType("int", 64, False), CType("float", 32, True)
# As gcc names them for x86-64; the widths of the <stdint.h> types are those of every target.
BASIC = {"_Bool": BOOL, "int": INT, "unsigned int": UINT, "float": REAL} | {
    f"{sign}{name}{end}": kind
    for name in ("long", "long long")
    for end in ("", " int")
    for sign, kind in (("", LONG), ("unsigned ", ULONG))
}
INTEGER = {"+": "bvadd", "-": "bvsub", "*": "bvmul", "&": "bvand", "|": "bvor", "^": "bvxor"}
FLOATING = {"+": "fp.add RNE", "-": "fp.sub RNE", "*": "fp.mul RNE", "/": "fp.div RNE"}
COMPARED = {"<": "fp.lt", "<=": "fp.leq", ">": "fp.gt", ">=": "fp.geq", "==": "fp.eq"}
ORDER = {"<": "lt", "<=": "le", ">": "gt", ">=": "ge"}


class RefusedError(RuntimeError):
    """C that is not understood."""

    def __init__(self, node: Any, why: str) -> None:
        super().__init__(f"{getattr(node, 'coord', None)}: {why}")


@dataclass(frozen=True)
class CValue:
    """A number: one of a constant, a truth value (of any integer type) or a term."""

    type: CType
    constant: int | None = None
    truth: str | None = None
    term: str = ""


def single(value: Fraction) -> int:
    """Bits of the nearest float32 number, ties to even."""
    near = np.float32(float(value))
    around = (np.nextafter(near, np.float32(-np.inf)), near, np.nextafter(near, np.float32(np.inf)))
    best = min(
        (x for x in around if np.isfinite(x)),
        key=lambda x: (abs(Fraction(float(x)) - value), int(x.view(np.uint32)) & 1),
    )
    return int(best.view(np.uint32))


def literal(bits: int) -> str:
    """A float32 number of the given bits."""
    return f"(fp #b{bits >> 31:01b} #b{bits >> 23 & 255:08b} #b{bits & 0x7FFFFF:023b})"


def _power(exponent: int) -> str:
    return literal(single(Fraction(2**exponent)))


class COperators:
    """What C's operators make of values."""

    def __init__(self, script: Script, free: str = "") -> None:
        self.script, self.free = script, free
        self.certain = True  # whether what is evaluated is evaluated in every run
        self.products: list[tuple[CValue, CValue, CValue]] = []

    def name(self, kind: CType, text: str) -> CValue:
        if kind.kind == "bool":
            return CValue(kind, truth=self.script.define("Bool", text))
        return CValue(kind, term=self.script.define(kind.sort, text))

    def truth(self, value: CValue) -> str:
        """Whether a value is not 0."""
        if value.constant is not None:
            return TRUE if value.constant else FALSE
        if value.truth is not None:
            return value.truth
        if value.type.kind == "float":
            text = f"(not (fp.isZero {value.term}))"
        else:
            text = f"(not (= {value.term} {whole(0, value.type.bits)}))"
        return self.script.define("Bool", text)

    def term(self, value: CValue) -> str:
        """A value as a term of its type's sort."""
        if value.type.kind == "bool":
            return self.truth(value)
        if value.constant is not None:
            return whole(value.constant, value.type.bits)
        if value.truth is not None:
            one, none = whole(1, value.type.bits), whole(0, value.type.bits)
            return self.script.define(value.type.sort, f"(ite {value.truth} {one} {none})")
        return value.term

    def convert(self, value: CValue, kind: CType, node: Any = None) -> CValue:
        """A value in another type."""
        if value.type == kind:
            return value
        if kind.kind == "bool":
            return CValue(kind, truth=self.truth(value))
        if kind.kind == "float":
            if value.constant is not None:
                return self.name(kind, literal(single(Fraction(value.constant))))
            wide = self.convert(value, INT) if value.type.kind == "bool" else value
            how = "to_fp" if wide.type.signed else "to_fp_unsigned"
            return self.name(kind, f"((_ {how} 8 24) RNE {self.term(wide)})")
        if value.type.kind == "float":
            raise RefusedError(node, "a float becomes an integer")
        if value.constant is not None:
            held = value.constant % 2**kind.bits
            return CValue(
                kind, held - 2**kind.bits if kind.signed and held >> kind.bits - 1 else held
            )
        if value.truth is not None:
            return CValue(kind, truth=value.truth)
        more = kind.bits - value.type.bits
        if more > 0:
            how = "sign_extend" if value.type.signed else "zero_extend"
            return self.name(kind, f"((_ {how} {more}) {value.term})")
        if more < 0:
            if self.free and self.certain and kind.signed and value.type.signed:
                # That no cast loses bits is the value analysis' result, and true of products alone.
                held = f"((_ extract {kind.bits - 1} 0) {value.term})"
                self.script.fact(f"(= ((_ sign_extend {-more}) {held}) {value.term})")
            return self.name(kind, f"((_ extract {kind.bits - 1} 0) {value.term})")
        return CValue(kind, term=value.term)

    def promoted(self, value: CValue) -> CValue:
        return self.convert(value, INT) if value.type.kind == "bool" else value

    def common(self, a: CValue, b: CValue, node: Any) -> tuple[CValue, CValue]:
        """Both operands in the type in which C computes."""
        a, b = self.promoted(a), self.promoted(b)
        if REAL in (a.type, b.type):
            kind = REAL
        else:
            kind = max(a.type, b.type, key=lambda t: (t.bits, not t.signed))
        return self.convert(a, kind, node), self.convert(b, kind, node)

    def choose(self, condition: str, a: CValue, b: CValue, node: Any = None) -> CValue:
        """One of two values."""
        if condition in (TRUE, FALSE):
            picked = a if condition == TRUE else b
            return self.convert(picked, self.common(a, b, node)[0].type)
        if a == b:
            return a
        if a.type != b.type:
            a, b = self.common(a, b, node)
        if all(v.truth is not None or v.constant in (0, 1) for v in (a, b)):
            text = f"(ite {condition} {self.truth(a)} {self.truth(b)})"
            return CValue(a.type, truth=self.script.define("Bool", text))
        return self.name(a.type, f"(ite {condition} {self.term(a)} {self.term(b)})")

    def combine(self, op: str, a: CValue, b: CValue, node: Any = None) -> CValue:
        """COperators on two numbers of one type."""
        if a.type.kind == "float":
            if op not in FLOATING:
                raise RefusedError(node, f"'{op}' of floats")
            x, y = self.term(a), self.term(b)
            if op in self.free:
                return CValue(REAL, term=self._any(op, x, y, REAL))
            return self.name(REAL, f"({FLOATING[op]} {x} {y})")
        if op not in INTEGER:
            raise RefusedError(node, f"'{op}' of integers")
        if a.constant is not None and b.constant is not None:
            found = {
                "+": a.constant + b.constant,
                "-": a.constant - b.constant,
                "*": a.constant * b.constant,
                "&": a.constant & b.constant,
                "|": a.constant | b.constant,
                "^": a.constant ^ b.constant,
            }[op]
            # In the type, modulo its size.
            return self.convert(CValue(CType("int", 999, True), found), a.type)
        x, y = self.term(a), self.term(b)
        if op == "*" and op in self.free and a.constant is None and b.constant is None:
            first, second = sorted((x, y))
            made = CValue(a.type, term=self._any(op, first, second, a.type))
            self.products.append((a, b, made))
            return made
        return self.name(a.type, f"({INTEGER[op]} {x} {y})")

    def _any(self, op: str, x: str, y: str, kind: CType) -> str:
        """Stands for a product: any number, but for its sign and its being finite."""
        name = f"{op} {x} {y}".replace("|", "'")
        if f"|{name}|" in self.script.declared:
            return f"|{name}|"
        result = self.script.unknown(name, kind.sort)

        def within(bound: int, *values: str) -> str:
            return every(*(f"(fp.leq (fp.abs {v}) {_power(bound)})" for v in values))

        if op in "+-":
            # Twice the larger one can be written down, so nothing rounds beyond it.
            for bound in range(8, 24):
                self.script.fact(implied(within(bound, x, y), within(bound + 1, result)))
            if op == "+":
                zero = "(_ +zero 8 24)"
                positive = every(*(f"(fp.geq {v} {zero})" for v in (x, y)))
                grown = every(*(f"(fp.geq {result} {v})" for v in (x, y)))
                self.script.fact(implied(positive, grown))
            return result
        if op == "*" and kind.kind == "float":
            zero = "(_ +zero 8 24)"
            for bound in (30, 60):
                self.script.fact(implied(within(bound, x, y), within(2 * bound, result)))
            small = within(60, x, y)
            above, below = "fp.geq", "fp.leq"
        elif op == "*" and all(self._short(v) for v in (x, y)):
            # 32 bits by 32 to 64: nothing wraps.
            zero, small, above, below = whole(0, kind.bits), TRUE, "bvsge", "bvsle"
        else:
            return result
        for a, b, sign in (
            (above, above, above),
            (above, below, below),
            (below, above, below),
            (below, below, above),
        ):
            operands = every(small, f"({a} {x} {zero})", f"({b} {y} {zero})")
            self.script.fact(implied(operands, f"({sign} {result} {zero})"))
        return result

    def _short(self, term: str) -> bool:
        return self.script.texts.get(term, "").startswith("((_ sign_extend 32) ")

    def compare(self, op: str, a: CValue, b: CValue) -> CValue:
        if op == "!=":
            return CValue(INT, truth=negated(self.truth(self.compare("==", a, b))))
        x, y = self.term(a), self.term(b)
        if a.type.kind == "float":
            text = f"({COMPARED[op]} {x} {y})"
        elif op == "==":
            text = f"(= {x} {y})"
        elif a.constant is not None and b.constant is not None:
            order = {"<": a.constant < b.constant, ">": a.constant > b.constant}
            order |= {"<=": a.constant <= b.constant, ">=": a.constant >= b.constant}
            text = TRUE if order[op] else FALSE
        else:
            text = f"(bv{'s' if a.type.signed else 'u'}{ORDER[op]} {x} {y})"
        if op == "==" and a.constant is not None and b.constant is not None:
            text = TRUE if a.constant == b.constant else FALSE
        return CValue(INT, truth=self.script.define("Bool", text))

    def shift(self, op: str, a: CValue, b: CValue, node: Any) -> CValue:
        """A shift by a number inside the width: another is undefined, and not looked at here."""
        if a.type.kind == "float" or b.type.kind == "float":
            raise RefusedError(node, "a shift of floats")
        if b.constant is not None and not 0 <= b.constant < a.type.bits:
            raise RefusedError(node, "a shift beyond the type's width")
        if a.constant is not None and b.constant is not None:
            moved = a.constant << b.constant if op == "<<" else a.constant >> b.constant
            return self.convert(CValue(CType("int", 999, True), moved), a.type)
        how = "bvshl" if op == "<<" else "bvashr" if a.type.signed else "bvlshr"
        count = self.term(self.convert(b, CType("int", a.type.bits, b.type.signed)))
        return self.name(a.type, f"({how} {self.term(a)} {count})")
