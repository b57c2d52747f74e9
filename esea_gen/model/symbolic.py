"""The one bridge from SymPy (derivation, printing) to CasADi (evaluation, code)."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache, partial
from keyword import iskeyword
from typing import Any

import casadi as ca
import sympy as sp
from sympy.parsing.sympy_parser import auto_number, parse_expr
from sympy.printing.mathml import MathMLPresentationPrinter

from esea_gen.language.ports import Equation

_CASADI = {
    "Abs": ca.fabs,
    "exp": ca.exp,
    "log": ca.log,
    "sqrt": ca.sqrt,
    "tanh": ca.tanh,
    "sign": ca.sign,
    "Min": ca.fmin,
    "Max": ca.fmax,
}


def to_casadi(expression: sp.Expr, values: Mapping[sp.Symbol, Any]) -> ca.SX:
    """Carry a SymPy expression across to CasADi."""
    missing = sorted(str(s) for s in expression.free_symbols if s not in values)
    if missing:
        raise ValueError(f"no value for the symbols {missing} of {expression}")
    symbols, function = _lambdified(expression)
    return ca.SX(function(*[values[s] for s in symbols]))


@cache
def _lambdified(expression: sp.Expr) -> tuple[list[sp.Symbol], Callable[..., Any]]:
    # Its symbols, and a function of them.
    symbols = sorted(expression.free_symbols, key=str)
    # A name that is none in Python, such as lambda or e', lambdify replaces by one with the number
    # of a counter of the process, and sorts products by it: the C would depend on what ran before.
    plain = {
        s: s if s.name.isidentifier() and not iskeyword(s.name) else sp.Symbol(f"Dummy_{k:02d}")
        for k, s in enumerate(reversed(symbols))
    }
    arguments = [plain[s] for s in symbols]
    function = sp.lambdify(arguments, expression.xreplace(plain), modules=[_CASADI], cse=False)
    return symbols, function


_NAME = re.compile(r"[A-Za-z]\w*(?:\{[^}]*\})?'*")
_WORDS = "exp tanh sin cos sqrt cbrt sign Abs Max Min Sum Integral Piecewise pi true Integer Float"
_KNOWN = {word: getattr(sp, word) for word in _WORDS.split()} | {"sum": sp.Function("sum")}


def _formula(text: str) -> sp.Expr:
    # Every word that is no function is a symbol: F{i,k-1} is F_i,k-1, and e' is e'.
    symbols: dict[str, sp.Symbol] = {}

    def plain(found: re.Match[str]) -> str:
        word = found.group()
        if word in _KNOWN:
            return word
        place = f"_{len(symbols)}"
        symbols[place] = sp.Symbol(word.replace("{", "_").replace("}", ""))
        return place

    return parse_expr(_NAME.sub(plain, text), symbols, (auto_number,), _KNOWN)


def equation(number: str, left: sp.Expr | str, right: sp.Expr | str, text: str) -> Equation:
    """An equation for documents, printed when one asks from the expression that is evaluated."""
    return Equation(number, partial(_mathml, left, right), text)


def _mathml(left: sp.Expr | str, right: sp.Expr | str) -> str:
    lhs = _formula(str(left)) if str(left).startswith("Abs(") else sp.Symbol(str(left))
    # An undefined function named exp: SymPy would print exp(-x) as a fraction.
    rhs = (_formula(right) if isinstance(right, str) else right).replace(sp.exp, sp.Function("exp"))
    body = MathMLPresentationPrinter().doprint(sp.Eq(lhs, rhs, evaluate=False))
    # A minus sign where SymPy's printer puts a hyphen, inside names such as k-1 too.
    body = re.sub(r"(?<=>)([^<]*)(?=<)", lambda m: m.group().replace("-", "\u2212"), body)
    return f'<math display="block">{body}</math>'


def equations(rows: str, **known: sp.Expr) -> tuple[Equation, ...]:
    """Equations, one a line: ``number | left side | formula | meaning``.

    A formula that is a name in ``known`` is that expression: the one that is evaluated.
    """
    found = []
    for row in filter(str.strip, rows.splitlines()):
        number, left, right, text = (" ".join(x.split()) for x in f"{row} ".split(" | "))
        found.append(equation(number, left, known.get(right, right), text))
    return tuple(found)
