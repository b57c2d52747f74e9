"""Faults of Python sources: one small edit of the syntax tree at a time."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

_SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
_DELETED = "deleted statement"
# Where a Block's own inputs for its verification are made.
_STREAM, _STREAMS = "_events", ("_stream.py", "_streams.py")
SHOWN = 90  # letters of an edit, at most
# Keywords of any call, or of one, that no result hangs on: looks, guards of lengths, a repr.
_LOOKS = """
    alpha borderaxespad capsize dpi figsize fontsize height_ratios labelpad linewidth linewidths
    lw mew ms pad rotation width_ratios zorder
"""
_NO_RESULT = {("zip", "strict"), ("field", "repr"), ("Field", "repr")}
# All that these are given by place is a size on paper.
_SIZES = frozenset({"new_figure", "_new"})
# Of two arguments of these either may come first.
_EITHER_FIRST = frozenset(
    {"logic_and", "logic_or", "logical_and", "logical_or", "minimum", "maximum", "hypot"}
)
_EITHER_BUT_NAN = frozenset({"min", "max", "fmin", "fmax"})
# From here on a power of ten is an order of magnitude: nothing hangs on 1 % of it.
_LARGE, _SMALL = 1e6, 1e-6
_TERMS = (ast.Add, ast.Sub, ast.Mult, ast.Div)


def _deletable(x: Any) -> bool:
    # Without the first assignment of a name what follows fails at once: no fault to look for.
    if isinstance(x, ast.Assign):
        return not any(isinstance(t, ast.Name | ast.Tuple) for t in x.targets)
    return isinstance(x, ast.AugAssign | ast.Expr)


@dataclass(frozen=True)
class PythonMutant:
    """One file with one fault."""

    path: str
    function: str  # that it stands in, as its code object is named; empty outside of all
    line: int
    kind: str
    edit: str
    suspect: str
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.kind}: {self.edit}"


def _silent(tree: ast.AST) -> tuple[set[ast.AST], set[ast.AST]]:
    """What gives no wrong result, and what of that is left out by a rule for what runs."""
    hidden: set[ast.AST] = set()
    by_rule: set[ast.AST] = set()
    for node in ast.walk(tree):
        parts = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        parts += getattr(node, "decorator_list", [])
        docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if docstring or isinstance(node, ast.Raise) or _only_for_types(node):
            parts.append(node)
        for part in filter(None, parts):
            hidden.update(ast.walk(part))
        for part in _without_result(node):
            by_rule.update(ast.walk(part))
    return hidden | by_rule, by_rule - hidden


def _called(node: ast.AST) -> str:
    called = getattr(node, "func", None)
    return str(getattr(called, "attr", getattr(called, "id", "")))


def _without_result(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.Assert):
        yield node
    elif isinstance(node, ast.Call):
        called = _called(node)
        yield from node.args if called in _SIZES else ()
        for k in node.keywords:
            if k.arg in _LOOKS.split() or (called, k.arg) in _NO_RESULT:
                yield k


def _only_for_types(node: ast.AST) -> bool:
    test = getattr(node, "test", None)
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"


# What kind, how to do it, how to undo it, and the statement that goes with it.
Change = tuple[str, Callable[[], None], Callable[[], None], ast.AST | None]


def _set(node: Any, name: str, value: Any, kind: str, gone: ast.AST | None = None) -> Change:
    before = getattr(node, name)
    return kind, lambda: setattr(node, name, value), lambda: setattr(node, name, before), gone


def _swapped(operator: ast.AST) -> Any:
    other = _SWAPS.get(type(operator))
    return None if other is None else other()


def _order_of_magnitude(v: object) -> bool:
    if not isinstance(v, float):
        return False
    return float(f"{v:.15e}".partition("e")[0]) == 1 and not _SMALL < v < _LARGE


def _constants(node: ast.Constant) -> Iterator[Change]:
    v = node.value
    if isinstance(v, bool):
        yield _set(node, "value", not v, "constant")
    elif isinstance(v, int):
        yield _set(node, "value", v + 1, "off by one")
        if v:
            yield _set(node, "value", -v, "sign")
    elif isinstance(v, float) and v:
        if not _order_of_magnitude(v):
            yield _set(node, "value", v * 1.01, "constant")
        yield _set(node, "value", -v, "sign")


def _changes(node: ast.AST, silent: set[ast.AST]) -> Iterator[Change]:
    """Every edit of one node."""
    if isinstance(node, ast.BinOp | ast.AugAssign | ast.BoolOp):
        if (other := _swapped(node.op)) is not None:
            yield _set(node, "op", other, "operator")
    elif isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            other = _swapped(op)
            ops = [*node.ops[:k], other, *node.ops[k + 1 :]]
            if other is not None:
                yield _set(node, "ops", ops, "comparison")
    elif isinstance(node, ast.Constant):
        yield from _constants(node)
    elif isinstance(node, ast.Call):
        plain = [a for a in node.args if not isinstance(a, ast.Starred)]
        if len(plain) == len(node.args) >= 2:
            first, second, *rest = node.args
            either = len(node.args) == 2 and _called(node) in _EITHER_FIRST
            if ast.dump(first) != ast.dump(second) and not either:
                yield _set(node, "args", [second, first, *rest], "swapped argument")
    if isinstance(node, ast.If | ast.While | ast.IfExp):
        yield _set(node, "test", ast.UnaryOp(ast.Not(), node.test), "not")
    for name, value in ast.iter_fields(node):
        for k, x in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(x, ast.AST) and x in silent:
                continue
            for kind, to in _replacements(x):
                put = [*value[:k], to, *value[k + 1 :]] if isinstance(value, list) else to
                yield _set(node, name, put, kind, x if kind == _DELETED else None)


def _replacements(x: Any) -> Iterator[tuple[str, ast.AST]]:
    """What stands in place of a child: a term less, no sign, no statement."""
    if isinstance(x, ast.BinOp) and isinstance(x.op, _TERMS):
        yield "dropped term", x.left
        if isinstance(x.op, ast.Add | ast.Mult):
            yield "dropped term", x.right
    elif isinstance(x, ast.UnaryOp) and isinstance(x.op, ast.USub):
        yield "sign", x.operand
    elif isinstance(x, ast.UnaryOp) and isinstance(x.op, ast.Not):
        yield "not", x.operand
    elif _deletable(x):
        yield _DELETED, ast.Pass()


def _pair(before: str, after: str) -> tuple[str, str]:
    """Both texts, cut to what is round the place where they part."""
    alike = next((k for k, (a, b) in enumerate(zip(before, after, strict=False)) if a != b), 0)
    start = max(0, alike - SHOWN // 2) if max(len(before), len(after)) > SHOWN else 0

    def cut(text: str) -> str:
        end = "..." if len(text) > start + SHOWN else ""
        return "..." * bool(start) + text[start : start + SHOWN] + end

    return cut(before), cut(after)


def _suspicion(node: ast.AST, kind: str, in_text: bool, in_stream: bool) -> str:
    if in_text:
        return "in a text for people"
    if in_stream:
        return "in an input of a verification, whose reach its coverage tells"
    if kind == "swapped argument" and _called(node) in _EITHER_BUT_NAN:
        return "differs only where an argument is not a number"
    if kind == "comparison" and isinstance(node, ast.Compare):
        edges = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
        if all(isinstance(op, edges) for op in node.ops):
            return "differs only where both sides are equal"
    return ""


class PythonFaults:
    """Every fault of a file, found by its place, and made when it is asked for."""

    def __init__(self, path: str, text: str) -> None:
        self.path = path
        self.tree = ast.parse(text)
        self.whole = ast.unparse(self.tree)
        self.silent, by_rule = _silent(self.tree)
        self.left_out = sum(1 for x in by_rule for _ in _changes(x, set()))
        self.left_out += sum(
            isinstance(x, ast.Constant) and _order_of_magnitude(x.value)
            for x in ast.walk(self.tree)
            if x not in self.silent
        )
        self.places: list[tuple[ast.AST, ast.AST, Change, str, str]] = []
        self._visit(self.tree, self.tree, ("", ""), False, path.endswith(_STREAMS))

    def __len__(self) -> int:
        return len(self.places)

    def _visit(
        self,
        node: ast.AST,
        statement: ast.AST,
        scope: tuple[str, str],
        in_text: bool,
        in_stream: bool,
    ) -> None:
        if node in self.silent:
            return
        function, before = scope  # and what a name of its own has in front
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            function = before + node.name
            before = f"{function}.<locals>."
        elif isinstance(node, ast.ClassDef):
            before += f"{node.name}."
        if isinstance(node, ast.stmt):
            statement = node
        in_text = in_text or isinstance(node, ast.JoinedStr)
        in_stream = in_stream or getattr(node, "name", "") == _STREAM
        # A statement's own body is too long to show: the part that changes is enough.
        shown = node if hasattr(statement, "body") else statement
        for change in _changes(node, self.silent):
            why = _suspicion(node, change[0], in_text, in_stream)
            gone = change[3]
            here = (node, shown) if gone is None else (gone, gone)
            self.places.append((*here, change, why, function))
        for child in ast.iter_child_nodes(node):
            self._visit(child, statement, (function, before), in_text, in_stream)

    def make(self, k: int) -> PythonMutant | None:
        """The fault number k; None where it changes nothing that Python sees."""
        node, shown, (kind, do, undo, _), suspect, function = self.places[k]
        before = _line_of(node, shown), _edited(shown)
        do()
        try:
            text, after = ast.unparse(ast.fix_missing_locations(self.tree)), _edited(shown)
        finally:
            undo()
        if text == self.whole:
            return None
        old, new = _pair(before[1], after)
        edit = _pair(before[1], "")[0] if kind == _DELETED else f"{old}  ->  {new}"
        return PythonMutant(self.path, function, before[0], kind, edit, suspect, text)


def _line_of(node: ast.AST, shown: ast.AST) -> int:
    return int(getattr(node, "lineno", getattr(shown, "lineno", 1)))


def _edited(node: ast.AST) -> str:
    test = getattr(node, "test", None)
    if test is not None and hasattr(node, "body") and isinstance(node, ast.stmt):
        node = test
    return " ".join(ast.unparse(node).split()) if not isinstance(node, ast.Module) else "file"
