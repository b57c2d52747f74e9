"""A planned Block as pieces of C text, and the words of its header."""

from __future__ import annotations

from esea_gen.emit.fixed.expression import C_TYPES, Expr, bare_text, c_text
from esea_gen.emit.fixed.plan import FieldPlan
from esea_gen.emit.fixed.values import LoweredKernel
from esea_gen.emit.printed import PrintedKernel, Statement
from esea_gen.language.ports import Port


def _pointers(e: Expr) -> set[str]:
    if e.op == "read":
        return {e.name.removeprefix("(int32_t)").split("->")[0]}
    return {p for a in e.args for p in _pointers(a)}


def print_lowered(lowered: LoweredKernel) -> PrintedKernel:
    statements = tuple(
        Statement(C_TYPES[s.expr.bits], s.name, bare_text(s.expr), s.comment) for s in lowered.steps
    )
    used = {p for s in lowered.steps for p in _pointers(s.expr)}
    return PrintedKernel(
        statements,
        tuple(tuple(c_text(e) for e in r) for r in lowered.results),
        frozenset(range(len(used))),
    )


def quantity(value: float, unit: str) -> str:
    return f"{value:.3g}" + ("" if unit == "1" else f" {unit}")


def format_text(f: FieldPlan) -> str:
    """Format of a field, and what one unit of its raw numbers is."""
    form = "whole number" if f.fraction == 0 else f"Q{31 - f.fraction}.{f.fraction}"
    return f"{form}, one unit is {quantity(f.lsb, f.port.unit)}"


def field_text(f: FieldPlan, group: str) -> str:
    """What a header says of a field's numbers: raw range, unit, what happens outside."""
    if getattr(f.port, "flags", ()):
        return ""
    text = f"raw {f.low} to {f.high}, {format_text(f)}"
    behaviour = {
        "params": "outside: refused",
        "coeffs": "cut to it by prepare",
        "state": "cannot overflow",
        "in": "",
        "out": "cannot overflow",
    }[group]
    if f.checked:
        low, high = f.port_range
        behaviour += f"; outside {low} to {high}: found by the step"
    if group == "state" and isinstance(f.port, Port) and f.port.size == 1:
        behaviour += "; outside: corrupt"
    return text + (f"; {behaviour}" if behaviour else "")
