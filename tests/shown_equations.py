"""Equations as a reader sees them, put to work: presentation MathML read back as numbers."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping

from scipy.integrate import quad

from esea_gen.language.ports import Equation

GREEK = {
    "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "η": "eta", "θ": "theta",
    "κ": "kappa", "λ": "lambda", "ν": "nu", "π": "pi", "ρ": "rho", "σ": "sigma", "τ": "tau",
    "φ": "phi", "ω": "omega", "χ": "chi", "Δ": "Delta", "Ω": "Omega", "ε": "epsilon",
}  # fmt: skip
SIGNS = {"−": "-", "\u2062": "*", "=": "=", "<": "<", ">": ">"}
FUNCTIONS = {
    "exp": math.exp,
    "sin": math.sin,
    "cos": math.cos,
    "tanh": math.tanh,
    "max": max,
    "min": min,
    "abs": abs,
    "sqrt": math.sqrt,
    "cbrt": math.cbrt,
    "sign": lambda x: math.copysign(1.0, x) if x else 0.0,
    # Of one term: what it stands over is not in the formula.
    "sum": lambda x: x,
    "pi": math.pi,
    "True": True,
    "piecewise": lambda *pairs: next(x for x, holds in pairs if holds),
    "total": lambda of, low, high: math.fsum(map(of, range(round(low), round(high) + 1))),
    "integral": lambda of, low, high: quad(of, low, high)[0],
}


def _text(node: ET.Element) -> str:
    words = "".join(node.itertext()).replace("−", "-").strip()
    return "".join(GREEK.get(c, c) for c in words)


class _Reader:
    """One formula as text for ``eval``: every symbol becomes ``given["its name"]``."""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self.bound: list[str] = []

    def symbol(self, name: str) -> str:
        if name in FUNCTIONS or name in self.bound:
            return name
        self.names.add(name)
        return f"given[{name!r}]"

    def read(self, node: ET.Element) -> str:
        parts = list(node)
        if node.tag == "mi":
            return self.symbol(_text(node))
        if node.tag == "mn":
            return _text(node)
        if node.tag == "mo":
            text = (node.text or "").strip()
            return SIGNS.get(text, text)
        if node.tag == "msub":
            return self.symbol("_".join(map(_text, parts)))
        if node.tag == "mfrac":
            return "(({})/({}))".format(*map(self.read, parts))
        if node.tag == "msup":
            return "(({})**({}))".format(*map(self.read, parts))
        if node.tag == "msqrt":
            return f"sqrt({''.join(map(self.read, parts))})"
        if node.tag == "mroot":
            assert _text(parts[1]) == "3"
            return f"cbrt({self.read(parts[0])})"
        assert node.tag in ("mrow", "math"), node.tag
        if parts and parts[0].tag in ("munderover", "msubsup"):
            return self.summed(parts)
        bars = [k for k, p in enumerate(parts) if p.tag == "mo" and p.text == "|"]
        if bars:
            assert bars == [0, len(parts) - 1]
            return f"abs({''.join(map(self.read, parts[1:-1]))})"
        return "".join(map(self.read, parts))

    def summed(self, parts: list[ET.Element]) -> str:
        """A sum over an index, or an integral: its sign with both ends, then what it is of."""
        _, low, high = parts[0]
        of = parts[1:]
        if parts[0].tag == "munderover":
            index, _, low = low
        else:
            *of, differential, index = of
            assert _text(differential) == "d"
        low_text, high_text = self.read(low), self.read(high)
        self.bound.append(_text(index))
        body = "".join(map(self.read, of))
        name = self.bound.pop()
        how = "total" if parts[0].tag == "munderover" else "integral"
        return f"{how}(lambda {name}: {body}, {low_text}, {high_text})"


def names(equation: Equation) -> set[str]:
    """The symbols that its right side shows."""
    return _read(equation)[1]


def _read(equation: Equation) -> tuple[str, set[str]]:
    text = equation.mathml.replace("&InvisibleTimes;", "\u2062").replace("&pi;", "π")
    (whole,) = ET.fromstring(re.sub(r"<mo><</mo>", "<mo>&lt;</mo>", text).replace("&dd;", "d"))
    at = [p.tag == "mo" and p.text == "=" for p in whole].index(True)
    reader = _Reader()
    return "".join(map(reader.read, list(whole)[at + 1 :])), reader.names


def value(equation: Equation, values: Mapping[str, float]) -> float:
    """The right side of an equation, for values of just the symbols that it shows."""
    formula, shown = _read(equation)
    assert shown == set(values), formula
    return float(eval(formula, {"__builtins__": {}, **FUNCTIONS, "given": dict(values)}))
