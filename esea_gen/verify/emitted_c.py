"""Reads emitted C and says, as formulas, what one call of a function computes.

The text is run through the preprocessor, parsed, and executed on symbols: every field of the
structs that are passed may hold any bits.  Understood is what a Block's kernel is printed as:
constants and stores, integers of 32 and 64 bits, truth values, single-precision numbers, choices,
calls of small functions.  Anything else, a loop or a double, is refused: nothing is guessed.

The meaning is C's (C99, promotions and conversions included) as the supported compilers have it:
two's complement, a right shift that keeps the sign, floats rounded to nearest and not contracted.
Signed overflow wraps here; that there is none is the value analysis' matter
(:mod:`esea_gen.verify.proof`).  The structs do not overlap.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pycparser import c_ast, c_parser

from esea_gen.errors import UserError
from esea_gen.verify.smt import FALSE, FLOAT, TRUE, Script, every, implied, negated, some, whole, word


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


class Refused(RuntimeError):
    """C that is not understood."""

    def __init__(self, node: Any, why: str) -> None:
        super().__init__(f"{getattr(node, 'coord', None)}: {why}")


@dataclass(frozen=True)
class Value:
    """A number: one of a constant, a truth value (of any integer type) or a term."""

    type: CType
    constant: int | None = None
    truth: str | None = None
    term: str = ""


@dataclass(frozen=True)
class Pointer:
    """The name of what is pointed to."""

    target: str


Memory = dict[str, Value]
Names = dict[str, "str | Pointer"]


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


def preprocessed(path: Path) -> str:
    """The text that the compiler reads."""
    gcc = shutil.which("gcc")
    if gcc is None:
        raise UserError("The tool 'gcc' is not installed.", "Install it with: apt-get install gcc")
    done = subprocess.run(
        # Its own <stdint.h>, which has types and no more.
        [gcc, "-E", "-std=c99", "-ffreestanding", f"-I{path.parent}", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"the preprocessor refused {path.name}:\n{done.stderr[-2000:]}")
    return done.stdout


class Reader:
    """One emitted file.

    exact: whether a product of two unknown numbers is computed; else it is any number of its type
        (the same for the same operands), which allows more than the C does.
    """

    def __init__(self, path: Path, script: Script, exact: bool = True) -> None:
        self.script, self.exact = script, exact
        tree = c_parser.CParser().parse(preprocessed(path), str(path))
        self.types = {n.name: n.type for n in tree.ext if isinstance(n, c_ast.Typedef)}
        self.functions = {n.decl.name: n for n in tree.ext if isinstance(n, c_ast.FuncDef)}
        self.fields: dict[str, CType] = {}
        self.free: set[str] = set()
        self.calls = 0

    # Types.

    def _plain(self, node: Any) -> Any:
        """The type behind typedefs and qualifiers."""
        while True:
            if isinstance(node, c_ast.TypeDecl | c_ast.Typename):
                node = node.type
            elif isinstance(node, c_ast.IdentifierType) and node.names[-1] in self.types:
                node = self.types[node.names[-1]]
            else:
                return node

    def _number(self, node: Any) -> CType:
        plain = self._plain(node)
        name = " ".join(getattr(plain, "names", ["?"]))
        if name not in BASIC:
            raise Refused(node, f"type '{name}'")
        return BASIC[name]

    def _layout(self, path: str, node: Any) -> None:
        """Notes the type of everything inside an object."""
        plain = self._plain(node)
        if isinstance(plain, c_ast.Struct):
            for part in plain.decls or ():
                self._layout(f"{path}.{part.name}", part.type)
        elif isinstance(plain, c_ast.ArrayDecl):
            size = self._value(plain.dim, {}, {}).constant
            for i in range(size or 0):
                self._layout(f"{path}[{i}]", plain.type)
        else:
            self.fields[path] = self._number(plain)

    # Values.

    def _name(self, kind: CType, text: str) -> Value:
        if kind.kind == "bool":
            return Value(kind, truth=self.script.define("Bool", text))
        return Value(kind, term=self.script.define(kind.sort, text))

    def truth(self, value: Value) -> str:
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

    def term(self, value: Value) -> str:
        """A value as a term of its type's sort."""
        if value.type.kind == "bool":
            return self.truth(value)
        if value.constant is not None:
            return whole(value.constant, value.type.bits)
        if value.truth is not None:
            one, none = whole(1, value.type.bits), whole(0, value.type.bits)
            return self.script.define(value.type.sort, f"(ite {value.truth} {one} {none})")
        return value.term

    def convert(self, value: Value, kind: CType, node: Any = None) -> Value:
        """A value in another type."""
        if value.type == kind:
            return value
        if kind.kind == "bool":
            return Value(kind, truth=self.truth(value))
        if kind.kind == "float":
            if value.constant is not None:
                return self._name(kind, literal(single(Fraction(value.constant))))
            wide = self.convert(value, INT) if value.type.kind == "bool" else value
            how = "to_fp" if wide.type.signed else "to_fp_unsigned"
            return self._name(kind, f"((_ {how} 8 24) RNE {self.term(wide)})")
        if value.type.kind == "float":
            raise Refused(node, "a float becomes an integer")
        if value.constant is not None:
            held = value.constant % 2**kind.bits
            return Value(kind, held - 2**kind.bits if kind.signed and held >> kind.bits - 1 else held)
        if value.truth is not None:
            return Value(kind, truth=value.truth)
        more = kind.bits - value.type.bits
        if more > 0:
            how = "sign_extend" if value.type.signed else "zero_extend"
            return self._name(kind, f"((_ {how} {more}) {value.term})")
        if more < 0:
            return self._name(kind, f"((_ extract {kind.bits - 1} 0) {value.term})")
        return Value(kind, term=value.term)

    def _promoted(self, value: Value) -> Value:
        return self.convert(value, INT) if value.type.kind == "bool" else value

    def _common(self, a: Value, b: Value, node: Any) -> tuple[Value, Value]:
        """Both operands in the type in which C computes."""
        a, b = self._promoted(a), self._promoted(b)
        if REAL in (a.type, b.type):
            kind = REAL
        else:
            kind = max(a.type, b.type, key=lambda t: (t.bits, not t.signed))
        return self.convert(a, kind, node), self.convert(b, kind, node)

    def choose(self, condition: str, a: Value, b: Value, node: Any = None) -> Value:
        """One of two values."""
        if condition in (TRUE, FALSE):
            picked = a if condition == TRUE else b
            return self.convert(picked, self._common(a, b, node)[0].type)
        if a == b:
            return a
        if a.type != b.type:
            a, b = self._common(a, b, node)
        if all(v.truth is not None or v.constant in (0, 1) for v in (a, b)):
            text = f"(ite {condition} {self.truth(a)} {self.truth(b)})"
            return Value(a.type, truth=self.script.define("Bool", text))
        return self._name(a.type, f"(ite {condition} {self.term(a)} {self.term(b)})")

    def _constant(self, node: Any) -> Value:
        text = node.value.rstrip("uUlLfF") if "x" not in node.value else node.value.rstrip("uUlL")
        if node.type == "float":
            if "x" in text or node.value[-1] not in "fF":
                raise Refused(node, f"the number {node.value}")
            return self._name(REAL, literal(single(Fraction(text))))
        if "int" not in node.type:
            raise Refused(node, f"the constant {node.value}")
        value = int(text, 8 if text != "0" and text.isdigit() and text[0] == "0" else 0)
        end = node.value[len(text) :].lower()
        for kind in (INT, UINT, LONG, ULONG):
            low, high = (1 - kind.signed, 2 ** (kind.bits - kind.signed))
            fits = value < high and ("l" not in end or kind.bits == 64)
            if fits and ("u" not in end or low) and (kind.signed or "u" in end or "x" in text):
                return Value(kind, value)
        raise Refused(node, f"the number {node.value}")

    # Operations.

    def _binary(self, node: Any, names: Names, memory: Memory) -> Value:
        op = node.op
        a, b = self._value(node.left, names, memory), self._value(node.right, names, memory)
        if op in ("&&", "||"):
            text = (every if op == "&&" else some)(self.truth(a), self.truth(b))
            if FALSE in text.split(" ") and op == "&&":
                text = FALSE
            return Value(INT, truth=self.script.define("Bool", text))
        if op in ("<<", ">>"):
            return self._shift(op, self._promoted(a), self._promoted(b), node)
        a, b = self._common(a, b, node)
        if op in ("<", "<=", ">", ">=", "==", "!="):
            return self._compare(op, a, b)
        if a.type.kind == "float":
            if op not in FLOATING:
                raise Refused(node, f"'{op}' of floats")
            x, y = self.term(a), self.term(b)
            if op in "*/" and not self.exact:
                return Value(REAL, term=self._any(op, x, y, REAL))
            return self._name(REAL, f"({FLOATING[op]} {x} {y})")
        if op not in INTEGER:
            raise Refused(node, f"'{op}' of integers")
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
            return self.convert(Value(CType("int", 999, True), found), a.type)
        x, y = self.term(a), self.term(b)
        if op == "*" and not self.exact and a.constant is None and b.constant is None:
            return Value(a.type, term=self._any(op, *sorted((x, y)), a.type))
        return self._name(a.type, f"({INTEGER[op]} {x} {y})")

    def _any(self, op: str, x: str, y: str, kind: CType) -> str:
        """Stands for a product: any number, but for its sign and its being finite."""
        name = f"{op} {x} {y}".replace("|", "'")
        if f"|{name}|" in self.script.declared:
            return f"|{name}|"
        result = self.script.unknown(name, kind.sort)
        if op == "*" and kind.kind == "float":
            zero, most = "(_ +zero 8 24)", literal(single(Fraction(2**60)))
            small = every(*(f"(fp.leq (fp.abs {v}) {most})" for v in (x, y)))
            self.script.fact(implied(small, f"(fp.leq (fp.abs {result}) {literal(0x7F7FFFFF)})"))
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

    def _compare(self, op: str, a: Value, b: Value) -> Value:
        if op == "!=":
            return Value(INT, truth=negated(self.truth(self._compare("==", a, b))))
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
        return Value(INT, truth=self.script.define("Bool", text))

    def _shift(self, op: str, a: Value, b: Value, node: Any) -> Value:
        if a.type.kind == "float" or b.type.kind == "float":
            raise Refused(node, "a shift of floats")
        if b.constant is None or not 0 <= b.constant < a.type.bits:
            raise Refused(node, "a shift that is no constant of the type's width")
        if a.constant is not None:
            moved = a.constant << b.constant if op == "<<" else a.constant >> b.constant
            return self.convert(Value(CType("int", 999, True), moved), a.type)
        how = "bvshl" if op == "<<" else "bvashr" if a.type.signed else "bvlshr"
        return self._name(a.type, f"({how} {self.term(a)} {whole(b.constant, a.type.bits)})")

    def _unary(self, node: Any, names: Names, memory: Memory) -> Any:
        if node.op == "&":
            return Pointer(self._place(node.expr, names, memory))
        if node.op == "*":
            return self._load(self._place(node, names, memory), node, memory)
        a = self._value(node.expr, names, memory)
        if node.op == "!":
            return Value(INT, truth=negated(self.truth(a)))
        a = self._promoted(a)
        if node.op == "+":
            return a
        if node.op == "-":
            if a.type.kind == "float":
                return self._name(REAL, f"(fp.neg {self.term(a)})")
            if a.constant is not None:
                return self.convert(Value(CType("int", 999, True), -a.constant), a.type)
            return self._name(a.type, f"(bvneg {self.term(a)})")
        if node.op == "~" and a.type.kind == "int":
            return self._name(a.type, f"(bvnot {self.term(a)})")
        raise Refused(node, f"the operator '{node.op}'")

    # Places in memory.

    def _place(self, node: Any, names: Names, memory: Memory) -> str:
        if isinstance(node, c_ast.ID):
            found = names.get(node.name)
            if isinstance(found, str):
                return found
        elif isinstance(node, c_ast.StructRef):
            if node.type == ".":
                return f"{self._place(node.name, names, memory)}.{node.field.name}"
            return f"{self._pointer(node.name, names, memory).target}.{node.field.name}"
        elif isinstance(node, c_ast.ArrayRef):
            index = self._value(node.subscript, names, memory).constant
            if index is not None:
                return f"{self._place(node.name, names, memory)}[{index}]"
        elif isinstance(node, c_ast.UnaryOp) and node.op == "*":
            return self._pointer(node.expr, names, memory).target
        raise Refused(node, "a place in memory that is not understood")

    def _pointer(self, node: Any, names: Names, memory: Memory) -> Pointer:
        found = names.get(node.name) if isinstance(node, c_ast.ID) else None
        if isinstance(node, c_ast.UnaryOp) and node.op == "&":
            found = Pointer(self._place(node.expr, names, memory))
        if not isinstance(found, Pointer):
            raise Refused(node, "a pointer that is not understood")
        return found

    def _load(self, place: str, node: Any, memory: Memory) -> Value:
        if place in memory:
            return memory[place]
        if place.split(".", maxsplit=1)[0] not in self.free or place not in self.fields:
            raise Refused(node, f"{place} is read before it is written")
        kind = self.fields[place]
        term = self.script.unknown(place, kind.sort)
        found = Value(kind, truth=term) if kind.kind == "bool" else Value(kind, term=term)
        return memory.setdefault(place, found)

    # Expressions, statements, calls.

    def _value(self, node: Any, names: Names, memory: Memory) -> Any:
        if isinstance(node, c_ast.Constant):
            return self._constant(node)
        if isinstance(node, c_ast.BinaryOp):
            return self._binary(node, names, memory)
        if isinstance(node, c_ast.UnaryOp):
            return self._unary(node, names, memory)
        if isinstance(node, c_ast.Cast):
            return self.convert(
                self._value(node.expr, names, memory), self._number(node.to_type), node
            )
        if isinstance(node, c_ast.TernaryOp):
            parts = (node.cond, node.iftrue, node.iffalse)
            when, a, b = (self._value(n, names, memory) for n in parts)
            return self.choose(self.truth(when), a, b, node)
        if isinstance(node, c_ast.FuncCall):
            return self._call(node, names, memory)
        if isinstance(node, c_ast.ID) and isinstance(names.get(node.name), Pointer):
            return names[node.name]
        return self._load(self._place(node, names, memory), node, memory)

    def _call(self, node: Any, names: Names, memory: Memory) -> Value | None:
        name = getattr(node.name, "name", "?")
        given = [self._value(a, names, memory) for a in (node.args.exprs if node.args else ())]
        if name == "__builtin_fabsf":
            return self._name(REAL, f"(fp.abs {self.term(self.convert(given[0], REAL))})")
        if name not in self.functions:
            raise Refused(node, f"the function '{name}', whose body is not in the text")
        return self._run(self.functions[name], given, memory)

    def _run(self, function: Any, given: list[Any], memory: Memory) -> Value | None:
        self.calls += 1
        names: Names = {"": f"{function.decl.name}#{self.calls}"}
        for parameter, value in zip(function.decl.type.args.params, given, strict=True):
            if isinstance(value, Pointer):
                names[parameter.name] = value
            else:
                self._declare(parameter, names, memory, value)
        result = self._execute(list(function.body.block_items or ()), names, memory)
        plain = self._plain(function.decl.type.type)
        if result is None or getattr(plain, "names", None) == ["void"]:
            return None
        return self.convert(result, self._number(plain))

    def _declare(self, node: Any, names: Names, memory: Memory, value: Value | None) -> None:
        place = f"{names['']}.{node.name}"
        names[node.name] = place
        self._layout(place, node.type)
        if value is not None:
            memory[place] = self.convert(value, self.fields[place], node)

    def _execute(self, nodes: list[Any], names: Names, memory: Memory) -> Value | None:
        """Run statements; the value that is returned."""
        for k, node in enumerate(nodes):
            if isinstance(node, c_ast.Compound):
                return self._execute([*(node.block_items or ()), *nodes[k + 1 :]], names, memory)
            if isinstance(node, c_ast.Return):
                return self._value(node.expr, names, memory) if node.expr else None
            if isinstance(node, c_ast.If):
                return self._branch(node, nodes[k + 1 :], names, memory)
            self._statement(node, names, memory)
        return None

    def _branch(self, node: Any, rest: list[Any], names: Names, memory: Memory) -> Value | None:
        condition = self.truth(self._value(node.cond, names, memory))
        ways = [[n, *rest] if n else rest for n in (node.iftrue, node.iffalse)]
        if condition in (TRUE, FALSE):
            return self._execute(ways[condition == FALSE], names, memory)
        ends = [dict(memory), dict(memory)]
        values = [
            self._execute(w, dict(names), m) for w, m in zip(ways, ends, strict=True)
        ]
        for place in {**ends[0], **ends[1]}:
            if all(place in m or place.split(".")[0] in self.free for m in ends):
                a, b = (self._load(place, node, m) for m in ends)
                memory[place] = self.choose(condition, a, b, node)
        if values[0] is None or values[1] is None:
            if values[0] is not values[1]:
                raise Refused(node, "a value is returned on one way only")
            return None
        return self.choose(condition, values[0], values[1], node)

    def _statement(self, node: Any, names: Names, memory: Memory) -> None:
        if isinstance(node, c_ast.Decl):
            value = self._value(node.init, names, memory) if node.init else None
            self._declare(node, names, memory, value)
        elif isinstance(node, c_ast.Assignment):
            place = self._place(node.lvalue, names, memory)
            value = self._value(node.rvalue, names, memory)
            if node.op != "=":
                changed = c_ast.BinaryOp(node.op[:-1], node.lvalue, node.rvalue, node.coord)
                value = self._binary(changed, names, memory)
            if place not in self.fields:
                raise Refused(node, f"{place} is no field")
            memory[place] = self.convert(value, self.fields[place], node)
        elif isinstance(node, c_ast.FuncCall):
            self._call(node, names, memory)
        elif isinstance(node, c_ast.Cast) and self._plain(node.to_type).names == ["void"]:
            pass
        elif not isinstance(node, c_ast.EmptyStatement):
            raise Refused(node, f"a {type(node).__name__}")

    def call(self, name: str, free: frozenset[str], memory: Memory | None = None) -> Memory:
        """Run a function whose parameters are pointers to structs, each named as the parameter.

        free: parameters whose structs may hold any bits; of the others nothing may be read before
            it is written.
        return: what was read or written, by place.
        """
        if name not in self.functions:
            raise Refused(None, f"the function '{name}' is not in the text")
        function, held = self.functions[name], dict(memory or {})
        names: Names = {"": name}
        self.free = set(free)
        for parameter in function.decl.type.args.params:
            if not isinstance(parameter.type, c_ast.PtrDecl):
                raise Refused(parameter, "a parameter that is no pointer")
            names[parameter.name] = Pointer(parameter.name)
            self._layout(parameter.name, parameter.type.type)
        self._execute(list(function.body.block_items or ()), names, held)
        return held

    def terms(self, memory: Mapping[str, Value]) -> dict[str, str]:
        """Values as terms, by place."""
        return {place: self.term(value) for place, value in memory.items() if "#" not in place}


__all__ = ["CType", "Memory", "Reader", "Refused", "Value", "literal", "single"]
