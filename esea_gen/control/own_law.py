"""Laws from files outside the package: loaded, trusted, and what is wrong in them, line by line."""

from __future__ import annotations

import ast
import math
import re
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.control.law import Base, Law, Parts
from esea_gen.errors import UserError, nearest
from esea_gen.files import read_whole
from esea_gen.python_file import MOST_BYTES, import_file
from esea_gen.trust import TaskCode, must_be_trusted

# What CasADi has and the firmware's C has not.
NOT_IN_C = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "asinh", "acosh"),
    *("atanh", "floor", "ceil", "fmod", "erf"),
)
IN_C = "sqrt, exp, log, tanh, pow, fabs, fmin, fmax, sign and if_else"
CHOOSE = (
    "A step is one straight line of symbols: choose with casadi.if_else(condition, a, b), join "
    "conditions with casadi.logic_and and logic_or, and take casadi.fmax for max."
)


def outside_law(text: str, folder: Path | None = None, content: bytes | None = None) -> Law:
    """A law by ``FILE.py:name``.

    With the folder of a device file, one that is named there: such a file came with data, and runs
    once its content is trusted.  ``content``: of the file, where it is at hand.
    """
    given, _, name = text.rpartition(":")
    path = Path(given) if folder is None else folder / given
    if content is None:
        if not path.is_file():
            raise UserError(f"{text}: there is no file {path}.", "Write FILE.py:law.")
        content = read_whole(path, "Check the path.", MOST_BYTES)
    code = TaskCode.of(path, content)
    if folder is not None:
        must_be_trusted([code], "type: esea-gen")
    return _law(path, content, name, code.sha256)


@lru_cache(maxsize=16)
def _law(path: Path, content: bytes, name: str, digest: str) -> Law:
    module = import_file(path, content)
    found = {k: v for k, v in vars(module).items() if isinstance(v, Law)}
    if name not in found:
        raise UserError(
            f"{path.name}: no law '{name}' in it.",
            f"{nearest(name, found)}Laws there: {', '.join(found) or 'none'}.",
        )
    law = found[name]

    def parts(base: Base) -> Parts:
        try:
            with _symbols_are_no_numbers():
                made = law.parts(base)
            if not isinstance(made, Parts):
                raise TypeError(f"{law.parts.__name__} gives {type(made).__name__}, not Parts")
        except UserError:
            raise
        except Exception as error:
            raise explained(path, error, f"law {law.name}") from error
        _check_kernels(path, law.name, made)
        return made

    return Law(law.name, law.title, parts, law.section, digest, path, content)


def wrong_wire(laws: Iterable[Law], error: ValueError) -> UserError | None:
    """What is wrong in a law whose Blocks cannot be wired; None where no own law is concerned."""
    for law in laws:
        if law.path is not None and (line := _quoted(law.path, str(error))):
            return explained(law.path, error, f"law {law.name}", line)
    return None


def explained(path: Path, error: Exception, what: str, line: int = 0) -> UserError:
    """An error of somebody's file: its line, and a remedy where one is known."""
    inside = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
    text = re.sub(r"^\S*\.cpp:\d+: ", "", str(error))
    if not line and inside:
        line = inside[-1].lineno or 0
        words = set(re.findall(r"\w+", text))
        if not words & set(re.findall(r"\w+", inside[-1].line or "")):
            line = _quoted(path, text) or line  # of a call over many lines the argument's own
    fix = "Correct the file."
    if isinstance(error, AttributeError) and isinstance(error.obj, SimpleNamespace):
        known = sorted(vars(error.obj))
        text = f"there is no '{error.name}'"
        fix = f"{nearest(str(error.name), known)}There are: {', '.join(known)}."
    elif "truth value" in text:
        fix = CHOOSE
    elif isinstance(error, NotANumberError):
        called = re.search(r"\bmath\.(\w+)", inside[-1].line or "") if inside else None
        fix = _instead(called[1]) if called else "Use casadi's functions on symbols."
    elif found := re.search(r"no wire for \w+\.(\w+); signals are (.*)", text):
        known = re.findall(r"'(\w+)'", found[2])
        text = f"no signal has the name of input '{found[1]}'"
        fix = f"{nearest(found[1], known)}Signals: {', '.join(known)}; or name one in Parts.wires."
    elif found := re.search(r"(?:no such port|unknown) \W*(?:\w+\.)?(\w+)\W.*?(\[.*\])", text):
        fix = nearest(found[1], re.findall(r"'(\w+)'", found[2])) + fix
    at = f", line {line}" if line else ""
    return UserError(f"{path.name}{at}: {what}: {text} ({type(error).__name__}).", fix)


class NotANumberError(TypeError):
    """A symbol stands where Python computes with numbers."""


@contextmanager
def _symbols_are_no_numbers() -> Iterator[None]:
    # CasADi makes NaN of a symbol that is asked for its number, as math.sin does.
    whole = ca.SX.__float__

    def number(x: ca.SX, *more: Any) -> float:
        if not x.is_constant():
            raise NotANumberError("Python asks for a number, and this is a symbol")
        return float(whole(x, *more))

    ca.SX.__float__ = number
    try:
        yield
    finally:
        ca.SX.__float__ = whole


def _instead(function: str) -> str:
    if function not in NOT_IN_C:
        return f"Use casadi.{function}."
    return (
        f"On symbols it is casadi.{function}, but the firmware's C has no {function}: write it as "
        f"a polynomial over the range of its input. The C has {IN_C}."
    )


def _check_kernels(path: Path, law: str, made: Parts) -> None:
    # What no C can be made of: numbers that are none, functions that it has not.
    missing = {getattr(ca, f"OP_{n.upper()}"): n for n in NOT_IN_C}
    for block in {**made.replaced, **made.own}.values():
        for function in (block.prepare, *block.kernels.values()):
            for k in range(function.n_instructions()):
                code = function.instruction_id(k)
                if code in missing:
                    name = missing[code]
                    raise UserError(
                        f"{_place(path, name)}: law {law}: {name} in Block {block.name}.",
                        _instead(name),
                    )
                if code == ca.OP_CONST and not math.isfinite(function.instruction_constant(k)):
                    raise UserError(
                        f"{_place(path, 'nan', 'inf')}: law {law}: Block {block.name} computes "
                        f"with the constant {function.instruction_constant(k)}.",
                        "Give a finite number.",
                    )


def _place(path: Path, *names: str) -> str:
    # File and first line on which a name is used or stands in quotes.
    for node in _nodes(path):
        used = getattr(node, "attr", None) or getattr(node, "id", None)
        text = node.value if isinstance(node, ast.Constant) else used
        if isinstance(text, str) and text.lower() in names:
            return f"{path.name}, line {getattr(node, 'lineno', 0)}"
    return path.name


def _quoted(path: Path, text: str) -> int:
    # Line on which a name of the message stands in quotes: the last of them that does.
    nodes = _nodes(path)
    keys = [k for n in nodes if isinstance(n, ast.Dict) for k in n.keys]
    lines = {n.value: n.lineno for n in (*nodes, *keys) if isinstance(n, ast.Constant)}
    return next((lines[w] for w in reversed(re.findall(r"\w+", text)) if w in lines), 0)


def _nodes(path: Path) -> Sequence[ast.AST]:
    with suppress(OSError, SyntaxError, ValueError):
        return list(ast.walk(ast.parse(path.read_bytes())))
    return ()
