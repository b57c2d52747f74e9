"""Laws from files outside the package: loading, trust, and errors with their line."""

from __future__ import annotations

import ast
import math
import re
import traceback
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from esea_gen.control.law import Base, Law, Parts
from esea_gen.errors import UserError, nearest
from esea_gen.files import read_whole
from esea_gen.language.block import Block
from esea_gen.python_file import MOST_BYTES, import_file
from esea_gen.trust import TaskCode, allow, must_be_trusted

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


WHOLE = "The C has no rounding or remainder: divide with / and choose with casadi.if_else."
_ROUNDING = (
    *("floordiv", "rfloordiv", "mod", "rmod", "divmod", "rdivmod"),
    *("round", "floor", "ceil", "trunc", "int"),
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
    else:  # named on the command line; to be met again in what this process records
        allow([code.sha256])
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
        except (Exception, SystemExit) as error:
            raise explained(path, error, f"law {law.name}") from error
        _check_kernels(path, law.name, made)
        return made

    return Law(law.name, law.title, parts, law.section, digest, path, content)


def wrong_wire(laws: Iterable[Law], error: ValueError) -> UserError | None:
    """Error in a law whose Blocks cannot be wired; None if no own law is concerned."""
    for law in laws:
        if law.path is not None and (line := _line(law.path, str(error))):
            return explained(law.path, error, f"law {law.name}", line)
    return None


def explained(path: Path, error: Exception | SystemExit, what: str, line: int = 0) -> UserError:
    """Error in a user's file: its line, and a remedy if known."""
    text = re.sub(r"^\S*\.cpp:\d+: ", "", str(error))
    inside = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
    code = (inside[-1].line or "") if inside else ""
    if not line and inside:
        line = inside[-1].lineno or 0
        told = set(_WORD.findall(text)) & set(_WORD.findall(code))
        if isinstance(error, ValueError) and not told:
            line = _line(path, text) or line  # of a call over many lines the argument's own
    fix = "Correct the file."
    if isinstance(error, AttributeError) and isinstance(error.obj, SimpleNamespace):
        text, known = f"there is no '{error.name}'", sorted(vars(error.obj))
        fix = f"{nearest(str(error.name), known)}There are: {', '.join(known)}."
    elif "truth value" in text or re.search(r"operand type.* [&|~]: ", text):
        fix = CHOOSE
    elif "whole part" in text or "as an integer" in text:
        fix = WHOLE
    elif isinstance(error, NotANumberError):
        called = re.search(r"\bmath\.(\w+)", code)
        fix = _instead(called[1]) if called else "Use casadi's functions on symbols."
    elif found := re.search(r"(no wire for|no such port) \w+\.(\w+); (.*)", text):
        known = re.findall(r"'(\w+)'", found[3])
        fix = f"{nearest(found[2], known)}An input is fed by the signal of its name or Parts.wires."
    at = f", line {line}" if line else ""
    return UserError(f"{path.name}{at}: {what}: {text} ({type(error).__name__}).", fix)


class NotANumberError(TypeError):
    """A symbol is used where Python needs a number."""


@contextmanager
def _symbols_are_no_numbers() -> Iterator[None]:
    # CasADi makes NaN where math.sin asks for a symbol's number, and rounds by what no C has.
    sx: Any = ca.SX
    asks = dict.fromkeys((f"__{n}__" for n in _ROUNDING), "a symbol has no whole part or remainder")
    asks["__float__"] = "Python needs a number here, but this is a symbol"
    usual = {name: getattr(sx, name) for name in asks}

    def refusing(name: str) -> Any:
        def number(x: ca.SX, *more: Any) -> Any:
            if not x.is_constant():
                raise NotANumberError(asks[name])
            return usual[name](x, *more)

        return number

    for name in asks:
        setattr(sx, name, refusing(name))
    try:
        yield
    finally:
        for name, method in usual.items():
            setattr(sx, name, method)


def _instead(function: str) -> str:
    if function not in NOT_IN_C:
        return f"Use casadi.{function}."
    if function in ("floor", "ceil", "fmod"):
        return WHOLE
    return (
        f"On symbols it is casadi.{function}, but the firmware's C has no {function}: write it as "
        f"a polynomial over the range of its input. The C has {IN_C}."
    )


def _check_kernels(path: Path, law: str, made: Parts) -> None:
    # What no C can be made of: numbers that are none, functions that it has not.
    missing = {getattr(ca, f"OP_{n.upper()}"): n for n in NOT_IN_C}
    for block in {**made.replaced, **made.own}.values():
        if isinstance(block, Block):
            _tell_of_rest(path, law, block)
        for function in (block.prepare, *block.kernels.values()):
            for k in range(function.n_instructions()):
                code = function.instruction_id(k)
                name, fix = missing.get(code, ""), "Give a finite number."
                if code == ca.OP_CONST and not math.isfinite(function.instruction_constant(k)):
                    name = str(function.instruction_constant(k))
                if name:
                    fix = _instead(name) if code in missing else fix
                    line = _line(path, f"inf nan {name}")
                    at = f", line {line}" if line else ""  # a result of division is nowhere written
                    raise UserError(
                        f"{path.name}{at}: law {law}: {name} in Block {block.name}.", fix
                    )


def _tell_of_rest(path: Path, law: str, block: Block) -> None:
    # At rest 0 / 0 may be, of which a clip makes its upper end: full torque.
    symbols, seen, divisors = block.step.sx_in(), set[int](), list[ca.SX]()
    results = block.step.call(symbols)
    left = [x for y in results for x in ca.vertsplit(ca.densify(y))]
    while left:
        x = left.pop()
        if x.element_hash() not in seen and (parts := [x.dep(k) for k in range(x.n_dep())]):
            seen.add(x.element_hash())
            left += parts
            if x.is_op(ca.OP_DIV) or x.is_op(ca.OP_INV):
                divisors.append(parts[-1])
    by, answers = ca.vertcat(*divisors), list[dict[str, Any]]()
    rng = np.random.default_rng(0)
    for size in (0.0, *[1e-9] * 20):  # the same, unless it is chosen between two
        simulator, inputs = block.simulator(), dict[str, float]()
        for p in block.inputs:
            near = float(p.whole) or size * p.high * rng.uniform(-1, 1)
            inputs[p.name] = min(max(near, p.low), p.high)
        own = [*simulator.coefficients.values(), *simulator.state.values()]
        given = [*map(ca.DM, own), *map(ca.DM, inputs.values())]
        if not size and np.all(np.asarray(ca.Function("d", symbols, [by]).call(given)[0])):
            return
        answers.append(simulator.step(**inputs))
    for p in (p for p in block.outputs if not p.whole):
        if np.any(np.ptp([a[p.name] for a in answers], axis=0) > 0.01 * (p.high - p.low)):
            warnings.warn(
                f"{path.name}: law {law}: Block {block.name} divides by 0 at rest, which decides "
                f"its {p.name}; 0 / 0 clipped is the upper end. Keep the divisor away from 0, as "
                "by casadi.fmax.",
                stacklevel=2,
            )


_WORD = re.compile(r"\w+")


def _line(path: Path, text: str) -> int:
    # Line on which the last word of a message stands that is used or quoted there; what comes
    # behind a semicolon is what there is.  As a key it counts most, then in quotes.
    lines: dict[str, int] = {}
    with suppress(OSError, SyntaxError, ValueError):
        nodes = list(ast.walk(ast.parse(path.read_bytes())))
        names = [(getattr(n, "attr", None) or getattr(n, "id", None), n) for n in nodes]
        quoted = [n for n in nodes if isinstance(n, ast.Constant)]
        keys = [k for n in nodes if isinstance(n, ast.Dict) for k in n.keys]
        for word, n in (*names, *((getattr(n, "value", None), n) for n in (*quoted, *keys))):
            if isinstance(word, str) and " " not in word:
                lines |= dict.fromkeys(word.split("."), getattr(n, "lineno", 0))
    words = _WORD.findall(text.partition(";")[0])
    return next((lines[w] for w in reversed(words) if w in lines), 0)
