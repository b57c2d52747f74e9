"""Equations as a reader sees them, put to work: presentation MathML read back as numbers."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping

from esea_gen.language.ports import Equation

GREEK = {
    "α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "η": "eta", "θ": "theta",
    "κ": "kappa", "λ": "lambda", "ν": "nu", "π": "pi", "ρ": "rho", "σ": "sigma", "τ": "tau",
    "φ": "phi", "ω": "omega",
}  # fmt: skip
SIGNS = {"−": "-", "\u2062": "*", "=": "=", "<": "<", ">": ">"}
FUNCTIONS = {
    "exp": math.exp,
    "tanh": math.tanh,
    "max": max,
    "min": min,
    "abs": abs,
    "sqrt": math.sqrt,
    "pi": math.pi,
}


def _text(node: ET.Element) -> str:
    words = "".join(node.itertext()).replace("−", "-").strip()
    return "".join(GREEK.get(c, c) for c in words)


class _Reader:
    """One formula as text for ``eval``: every symbol becomes ``x["its name"]``."""

    def __init__(self) -> None:
        self.names: set[str] = set()

    def symbol(self, name: str) -> str:
        if name in FUNCTIONS:
            return name
        self.names.add(name)
        return f"x[{name!r}]"

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
        assert node.tag in ("mrow", "math"), node.tag
        bars = [k for k, p in enumerate(parts) if p.tag == "mo" and p.text == "|"]
        if bars:
            assert bars == [0, len(parts) - 1]
            return f"abs({''.join(map(self.read, parts[1:-1]))})"
        return "".join(map(self.read, parts))


def value(equation: Equation, values: Mapping[str, float]) -> float:
    """The right side of an equation, for values of just the symbols that it shows."""
    text = equation.mathml.replace("&InvisibleTimes;", "\u2062").replace("&pi;", "π")
    text = re.sub(r"<mo><</mo>", "<mo>&lt;</mo>", text)
    (whole,) = ET.fromstring(text)
    at = [p.tag == "mo" and p.text == "=" for p in whole].index(True)
    reader = _Reader()
    formula = "".join(map(reader.read, list(whole)[at + 1 :]))
    assert reader.names == set(values), formula
    return float(eval(formula, {"__builtins__": {}, **FUNCTIONS, "x": dict(values)}))
