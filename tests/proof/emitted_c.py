"""Translate a function of the emitted C into formulas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from pycparser import c_ast, c_parser

from esea_gen.hostlib.compiler import find_compiler, run_tool

from .c_values import (
    BASIC,
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
from .smt import FALSE, TRUE, Script, every, negated, some


@dataclass(frozen=True)
class Pointer:
    """The name of what is pointed to."""

    target: str


Memory = dict[str, CValue]
Names = dict[str, "str | Pointer"]


def preprocessed(path: Path, defines: Sequence[str] = ()) -> str:
    """The text that the compiler reads."""
    # Its own <stdint.h>, which has types and no more.
    flags = ["-E", "-std=c99", "-ffreestanding", f"-I{path.parent}", *(f"-D{n}" for n in defines)]
    command = [find_compiler("gcc", "gcc"), *flags, path]
    return run_tool(command, failed=f"the preprocessor refused {path.name}").stdout


class Reader(COperators):
    """One emitted file."""

    def __init__(
        self, path: Path, script: Script, free: str = "", defines: Sequence[str] = ()
    ) -> None:
        super().__init__(script, free)
        tree = c_parser.CParser().parse(preprocessed(path, defines), str(path))
        self.types = {n.name: n.type for n in tree.ext if isinstance(n, c_ast.Typedef)}
        self.functions = {n.decl.name: n for n in tree.ext if isinstance(n, c_ast.FuncDef)}
        self.fields: dict[str, CType] = {}
        self.unknown: set[str] = set()
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
        name = " ".join(getattr(self._plain(node), "names", ["?"]))
        if name not in BASIC:
            raise RefusedError(node, f"type '{name}'")
        return BASIC[name]

    def _layout(self, path: str, node: Any) -> None:
        """Notes the type of everything inside an object."""
        plain = self._plain(node)
        if isinstance(plain, c_ast.Struct):
            for part in plain.decls or ():
                self._layout(f"{path}.{part.name}", part.type)
        elif isinstance(plain, c_ast.ArrayDecl):
            for i in range(self._value(plain.dim, {}, {}).constant or 0):
                self._layout(f"{path}[{i}]", plain.type)
        else:
            self.fields[path] = self._number(plain)

    # Operations.

    def _constant(self, node: Any) -> CValue:
        text = node.value.rstrip("uUlLfF") if "x" not in node.value else node.value.rstrip("uUlL")
        if node.type == "float":
            if "x" in text or node.value[-1] not in "fF":
                raise RefusedError(node, f"the number {node.value}")
            return self.name(REAL, literal(single(Fraction(text))))
        if "int" not in node.type:
            raise RefusedError(node, f"the constant {node.value}")
        value = int(text, 8 if text != "0" and text.isdigit() and text[0] == "0" else 0)
        end = node.value[len(text) :].lower()
        for kind in (INT, UINT, LONG, ULONG):
            low, high = (1 - kind.signed, 2 ** (kind.bits - kind.signed))
            fits = value < high and ("l" not in end or kind.bits == 64)
            if fits and ("u" not in end or low) and (kind.signed or "u" in end or "x" in text):
                return CValue(kind, value)
        raise RefusedError(node, f"the number {node.value}")

    def _binary(self, node: Any, names: Names, memory: Memory) -> CValue:
        op = node.op
        a = self._value(node.left, names, memory)
        if op not in ("&&", "||"):
            b = self._value(node.right, names, memory)
        else:
            (b,) = self._perhaps([node.right], names, memory)
            text = (every if op == "&&" else some)(self.truth(a), self.truth(b))
            return CValue(INT, truth=self.script.define("Bool", text))
        if op in ("<<", ">>"):
            return self.shift(op, self.promoted(a), self.promoted(b), node)
        a, b = self.common(a, b, node)
        if op in ("<", "<=", ">", ">=", "==", "!="):
            return self.compare(op, a, b)
        return self.combine(op, a, b, node)

    def _unary(self, node: Any, names: Names, memory: Memory) -> Any:
        if node.op == "&":
            return Pointer(self._place(node.expr, names, memory))
        if node.op == "*":
            return self._load(self._place(node, names, memory), node, memory)
        a = self._value(node.expr, names, memory)
        if node.op == "!":
            return CValue(INT, truth=negated(self.truth(a)))
        a = self.promoted(a)
        if node.op == "+":
            return a
        if node.op == "-":
            if a.type.kind == "float":
                return self.name(REAL, f"(fp.neg {self.term(a)})")
            if a.constant is not None:
                return self.convert(CValue(CType("int", 999, True), -a.constant), a.type)
            return self.name(a.type, f"(bvneg {self.term(a)})")
        if node.op == "~" and a.type.kind == "int":
            return self.name(a.type, f"(bvnot {self.term(a)})")
        raise RefusedError(node, f"the operator '{node.op}'")

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
        raise RefusedError(node, "a place in memory that is not understood")

    def _pointer(self, node: Any, names: Names, memory: Memory) -> Pointer:
        found = names.get(node.name) if isinstance(node, c_ast.ID) else None
        if isinstance(node, c_ast.UnaryOp) and node.op == "&":
            found = Pointer(self._place(node.expr, names, memory))
        if not isinstance(found, Pointer):
            raise RefusedError(node, "a pointer that is not understood")
        return found

    def _load(self, place: str, node: Any, memory: Memory) -> CValue:
        if place in memory:
            return memory[place]
        if place.split(".", maxsplit=1)[0] not in self.unknown or place not in self.fields:
            raise RefusedError(node, f"{place} is read before it is written")
        kind = self.fields[place]
        term = self.script.unknown(place, kind.sort)
        found = CValue(kind, truth=term) if kind.kind == "bool" else CValue(kind, term=term)
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
            when = self._value(node.cond, names, memory)
            a, b = self._perhaps([node.iftrue, node.iffalse], names, memory)
            return self.choose(self.truth(when), a, b, node)
        if isinstance(node, c_ast.FuncCall):
            return self._call(node, names, memory)
        if isinstance(node, c_ast.ID) and isinstance(names.get(node.name), Pointer):
            return names[node.name]
        return self._load(self._place(node, names, memory), node, memory)

    def _perhaps(self, nodes: list[Any], names: Names, memory: Memory) -> list[CValue]:
        """Expressions that may be left out."""
        before, self.certain = self.certain, False
        found = [self._value(n, names, memory) for n in nodes]
        self.certain = before
        return found

    def _call(self, node: Any, names: Names, memory: Memory) -> CValue | None:
        name = getattr(node.name, "name", "?")
        given = [self._value(a, names, memory) for a in (node.args.exprs if node.args else ())]
        if name == "__builtin_fabsf":
            return self.name(REAL, f"(fp.abs {self.term(self.convert(given[0], REAL))})")
        if name not in self.functions:
            raise RefusedError(node, f"the function '{name}', whose body is not in the text")
        return self._run(self.functions[name], given, memory)

    def _run(self, function: Any, given: list[Any], memory: Memory) -> CValue | None:
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

    def _declare(self, node: Any, names: Names, memory: Memory, value: CValue | None) -> None:
        place = f"{names['']}.{node.name}"
        names[node.name] = place
        self._layout(place, node.type)
        if value is not None:
            memory[place] = self.convert(value, self.fields[place], node)

    def _execute(self, nodes: list[Any], names: Names, memory: Memory) -> CValue | None:
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

    def _branch(self, node: Any, rest: list[Any], names: Names, memory: Memory) -> CValue | None:
        condition = self.truth(self._value(node.cond, names, memory))
        ways = [[n, *rest] if n else rest for n in (node.iftrue, node.iffalse)]
        if condition in (TRUE, FALSE):
            return self._execute(ways[condition == FALSE], names, memory)
        ends = [dict(memory), dict(memory)]
        before, self.certain = self.certain, False
        values = [self._execute(w, dict(names), m) for w, m in zip(ways, ends, strict=True)]
        self.certain = before
        for place in {**ends[0], **ends[1]}:
            if all(place in m or place.split(".")[0] in self.unknown for m in ends):
                a, b = (self._load(place, node, m) for m in ends)
                memory[place] = self.choose(condition, a, b, node)
        if values[0] is None or values[1] is None:
            if values[0] is not values[1]:
                raise RefusedError(node, "a value is returned on one way only")
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
                raise RefusedError(node, f"{place} is no field")
            memory[place] = self.convert(value, self.fields[place], node)
        elif isinstance(node, c_ast.FuncCall):
            self._call(node, names, memory)
        elif isinstance(node, c_ast.Cast) and self._plain(node.to_type).names == ["void"]:
            pass
        elif not isinstance(node, c_ast.EmptyStatement):
            raise RefusedError(node, f"a {type(node).__name__}")

    def call(self, name: str, free: frozenset[str], memory: Memory | None = None) -> Memory:
        """Run a function whose parameters are pointers to structs, each named as the parameter."""
        if name not in self.functions:
            raise RefusedError(None, f"the function '{name}' is not in the text")
        function, held = self.functions[name], dict(memory or {})
        names: Names = {"": name}
        self.unknown = set(free)
        for parameter in function.decl.type.args.params:
            if not isinstance(parameter.type, c_ast.PtrDecl):
                raise RefusedError(parameter, "a parameter that is no pointer")
            names[parameter.name] = Pointer(parameter.name)
            self._layout(parameter.name, parameter.type.type)
        self._execute(list(function.body.block_items or ()), names, held)
        return held

    def result(self, name: str) -> tuple[dict[str, str], dict[str, CValue]]:
        """Run a function of numbers on any numbers."""
        if name not in self.functions:
            raise RefusedError(None, f"the function '{name}' is not in the text")
        memory: Memory = {}
        given: list[Any] = []
        made: list[str] = []
        unknown = {}
        for p in self.functions[name].decl.type.args.params:
            if isinstance(p.type, c_ast.PtrDecl):
                self._layout(p.name, p.type.type)
                given.append(Pointer(p.name))
                made.append(p.name)
            else:
                kind = self._number(p.type)
                unknown[p.name] = self.script.unknown(p.name, kind.sort)
                given.append(CValue(kind, term=unknown[p.name]))
        value = self._run(self.functions[name], given, memory)
        values = {p: memory[p] for p in made} | ({"return": value} if value else {})
        return unknown, values

    def terms(self, memory: Mapping[str, CValue]) -> dict[str, str]:
        """Values as terms, by place."""
        return {place: self.term(value) for place, value in memory.items() if "#" not in place}
