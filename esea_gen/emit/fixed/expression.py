"""Integer expressions of the q31 format: typed, with a proven range, printable, executable.

An expression knows the C type it is computed in and the interval of whole numbers it can have.  The
builders refuse one that could overflow its type, so that a kernel that could be built cannot
overflow.  The same tree is printed as C and evaluated by the executor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from esea_gen.emit.fixed import functions

INT32 = (-(2**31), 2**31 - 1)
INT64 = (-(2**63), 2**63 - 1)
UINT32 = (0, 2**32 - 1)
C_TYPES = {1: "bool", 32: "int32_t", 64: "int64_t", -32: "uint32_t"}
LIMITS = {1: (0, 1), 32: INT32, 64: INT64, -32: UINT32}
_COMPARE = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}


class OverflowProofError(Exception):
    """An expression whose interval does not fit the type that it is computed in."""


class Expr(NamedTuple):  # quickly made, for some 10^5 are
    """One whole-number expression."""

    op: str
    args: tuple[Expr, ...]
    bits: int  # type: 1 (``bool``, 0 or 1), 32, 64, or -32 (``uint32_t``)
    low: int
    high: int
    data: tuple[int, ...] = ()  # numbers that belong to the operation: a shift, a literal's value
    name: str = ""  # of a named value or a constant: its C name; of a read: the place in memory


def _make(
    op: str, args: tuple[Expr, ...], bits: int, low: int, high: int, data: tuple[int, ...] = ()
) -> Expr:
    least, most = LIMITS[bits]
    if low < least or high > most:
        raise OverflowProofError(f"{op}: [{low}, {high}] does not fit {C_TYPES[bits]}")
    return Expr(op, args, bits, low, high, data)


def read(place: str, bits: int, low: int, high: int) -> Expr:
    """A value read from memory."""
    return Expr("read", (), bits, low, high, (), place)


def named(name: str, value: Expr) -> Expr:
    return Expr("ref", (), value.bits, value.low, value.high, (), name)


def within(x: Expr, low: int, high: int) -> Expr:
    """A named value where a condition has shown that it is in a range."""
    return x._replace(low=low, high=high)


def literal(value: int, bits: int = 32) -> Expr:
    return _make("literal", (), bits, value, value, (value,))


def called(x: Expr, name: str) -> Expr:
    """A literal that C writes by the name of a constant, where there is one."""
    return x._replace(name=name) if x.op == "literal" and name else x


def cast(x: Expr, bits: int) -> Expr:
    if x.bits == bits:
        return x
    if x.op == "literal":
        return called(literal(x.data[0], bits), x.name)
    if x.op == "cast" and x.args[0].bits == bits:  # it fits both types
        return x.args[0]
    return _make("cast", (x,), bits, x.low, x.high)


def _pair(op: str, ends: Callable[[Expr, Expr], tuple[int, int]]) -> Callable[..., Expr]:
    def build(x: Expr, y: Expr, bits: int) -> Expr:
        return _make(op, (cast(x, bits), cast(y, bits)), bits, *ends(x, y))

    return build


add = _pair("add", lambda x, y: (x.low + y.low, x.high + y.high))
sub = _pair("sub", lambda x, y: (x.low - y.high, x.high - y.low))
minimum = _pair("min", lambda x, y: (min(x.low, y.low), min(x.high, y.high)))
maximum = _pair("max", lambda x, y: (max(x.low, y.low), max(x.high, y.high)))


def neg(x: Expr) -> Expr:
    return _make("neg", (x,), x.bits, -x.high, -x.low)


def absolute(x: Expr) -> Expr:
    return _make("abs", (x,), x.bits, max(x.low, -x.high, 0), max(-x.low, x.high))


def scale(x: Expr, shift: int, bits: int) -> Expr:
    """``x 2**shift``, exact."""
    if shift == 0:
        return cast(x, bits)
    if x.op == "literal":
        return literal(x.data[0] << shift, bits)
    if shift > bits - 2:
        raise OverflowProofError(f"scale by 2^{shift} in {C_TYPES[bits]}")
    return _make("scale", (cast(x, bits),), bits, x.low << shift, x.high << shift, (shift,))


def _rounded(value: int, shift: int) -> int:
    return (value + (1 << (shift - 1))) >> shift


def round_shift(x: Expr, shift: int, bits: int = 0) -> Expr:
    """``x / 2**shift`` rounded, half a unit upwards."""
    bits = bits or x.bits
    if shift == 0:
        return cast(x, bits)
    if shift > x.bits - 1 - (x.bits == 64):
        x = cast(x, 64)
        if shift > 62:
            raise OverflowProofError(f"shift by {shift}")
    if x.bits == 64:
        if x.high + (1 << (shift - 1)) > INT64[1]:
            raise OverflowProofError(f"no room to round {x.high}")
        low, high = _rounded(x.low, shift), _rounded(x.high, shift)
    else:
        # As the C computes it: the interval is a unit wider than the exact one.
        low, high = x.low >> shift, (x.high >> shift) + 1
    return cast(_make("round", (x,), x.bits, low, high, (shift,)), bits)


def _corners(x: Expr, y: Expr) -> tuple[int, int]:
    products = [p * q for p in (x.low, x.high) for q in (y.low, y.high)]
    if x == y:
        return (0 if x.low <= 0 <= x.high else min(products)), max(products)
    return min(products), max(products)


def mul(x: Expr, y: Expr, shift: int, bits: int) -> Expr:
    """``x y / 2**shift`` rounded, half a unit upwards."""
    if x.bits < y.bits:
        x, y = y, x
    low, high = _corners(x, y)
    if (x.bits, y.bits) == (32, 32):
        if not 0 <= shift <= 62:
            raise OverflowProofError(f"product shifted by {shift}")
        if shift:
            if bits == 32:
                # An analyser multiplies intervals without knowing that x is y.
                return _make(
                    "mul", (x, y), 32, _rounded(low, shift), _rounded(high, shift), (shift,)
                )
            return round_shift(_make("wide_mul", (x, y), 64, low, high), shift, bits)
        return _make("wide_mul" if bits == 64 else "times", (x, y), bits, low, high)
    # As the C computes it, from two or three partial products: the high one, a unit to either
    # side, in steps of 2^unit, and where that is above 1 the rest below a step.
    edge = 32 if y.bits == 32 else 64
    if not (1 if y.bits == 32 else 33) <= shift <= edge + 62 or shift == 64 == edge:
        raise OverflowProofError(f"64-bit product shifted by {shift}")
    if y.bits == 64 and max(abs(v) for v in (x.low, x.high, y.low, y.high)) >= 2**62:
        raise OverflowProofError("64-bit factor above 2^62")
    least = 0 if x.low >= 0 and y.low >= 0 else -INT64[1]
    bottom, top = max((low >> edge) - 2, least), (high >> edge) + 3
    if shift <= edge:
        low, high = bottom << (edge - shift), (top + 1) << (edge - shift)
    else:
        if max(abs(bottom), abs(top)) > INT64[1] >> 1:
            raise OverflowProofError("no room to round a 64-bit product")
        low, high = max(_rounded(low, shift) - 1, least), _rounded(high, shift) + 1
    return cast(_make("mul64", (x, y), 64, low, high, (shift,)), bits)


def clamp(x: Expr, low: int, high: int) -> Expr:
    if x.high > high:
        x = minimum(x, literal(high, x.bits), x.bits)
    if x.low < low:
        x = maximum(x, literal(low, x.bits), x.bits)
    return x


def saturate(x: Expr) -> Expr:
    if x.bits == 64 and x.low < INT32[0] and x.high > INT32[1]:
        return Expr("saturate", (x,), 32, *INT32)
    return cast(clamp(x, *INT32), 32)


def choose(condition: Expr, x: Expr, y: Expr, bits: int) -> Expr:
    args = condition, cast(x, bits), cast(y, bits)
    return _make("choose", args, bits, min(x.low, y.low), max(x.high, y.high))


def compare(op: str, x: Expr, y: Expr) -> Expr:
    always = {
        "lt": x.high < y.low,
        "le": x.high <= y.low,
        "eq": x.low == x.high == y.low == y.high,
        "ne": x.high < y.low or y.high < x.low,
    }[op]
    never = {
        "lt": x.low >= y.high,
        "le": x.low > y.high,
        "eq": x.high < y.low or y.high < x.low,
        "ne": x.low == x.high == y.low == y.high,
    }[op]
    if always or never:
        return literal(int(always), 1)
    bits = x.bits if x.bits == y.bits else max(x.bits, y.bits, 32)
    return Expr(op, (cast(x, bits), cast(y, bits)), 1, 0, 1)


def logic(op: str, *args: Expr) -> Expr:
    fixed = [a.data[0] if a.op == "literal" else None for a in args]
    if op == "not":
        return literal(1 - fixed[0], 1) if fixed[0] is not None else Expr("not", args, 1, 0, 1)
    strong = 0 if op == "and" else 1
    if strong in fixed:
        return literal(strong, 1)
    rest = [a for a, f in zip(args, fixed, strict=True) if f is None]
    if not rest:
        return literal(1 - strong, 1)
    return rest[0] if len(rest) == 1 else Expr(op, tuple(rest), 1, 0, 1)


def truth(x: Expr) -> Expr:
    return x if x.bits == 1 else compare("ne", x, literal(0, x.bits))


def call(name: str, args: tuple[Expr, ...], bits: int, low: int, high: int, *data: int) -> Expr:
    return _make(name, args, bits, low, high, data)


def flags(bits: tuple[tuple[Expr, int], ...]) -> Expr:
    args = tuple(c for c, _ in bits)
    numbers = tuple(k for _, k in bits)
    return _make("flags", args, -32, 0, sum(1 << k for k in numbers), numbers)


# -- as C ------------------------------------------------------------------------------------------


def _literal_text(value: int, bits: int) -> str:
    if bits == 1:
        return "true" if value else "false"
    if bits == 64:
        return f"INT64_C({value})" if value > INT64[0] else "INT64_MIN"
    if bits == -32:
        return f"{value}u"
    if value == INT32[0]:
        return "INT32_MIN"
    return f"({value})" if value < 0 else str(value)


def c_text(x: Expr) -> str:
    if x.op in ("read", "ref"):
        return x.name
    if x.op == "literal":
        named = x.name and (x.name if x.bits == -32 else f"({C_TYPES[x.bits]}){x.name}")
        return named or _literal_text(x.data[0], x.bits)
    text = bare_text(x)
    return text if _is_call(x) or (x.op == "cast" and x.args[0].bits != 1) else f"({text})"


def _is_call(x: Expr) -> bool:
    return x.op not in (*_C, "and", "or", "flags", "cast", "scale", "read", "ref", "literal")


def _widened(x: Expr) -> Expr:
    # C widens a value by itself where the other operand, a parameter or what it becomes is wide; of
    # a sum or a choice it is written, for the operation must not be taken for a wide one.
    (y,) = x.args if x.op == "cast" and x.bits == 64 else (x,)
    return y if y.bits == 32 and (y.op in ("read", "ref", "cast") or _is_call(y)) else x


_C = {
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "times": "{0} * {1}",
    "neg": "-{0}",
    "sign": "({0} > 0) ? 1 : (({0} < 0) ? -1 : 0)",
    "choose": "{0} ? {1} : {2}",
    "not": "!{0}",
    **{op: f"{{0}} {sign} {{1}}" for op, sign in _COMPARE.items()},
}


def bare_text(x: Expr) -> str:
    if x.op in ("read", "ref", "literal"):
        return c_text(x)
    if x.op in ("and", "or"):
        return {"and": " && ", "or": " || "}[x.op].join(_chain(x))
    if x.op == "flags":
        parts = (f"esea_bit({bare_text(t)}, {k}u)" for t, k in zip(x.args, x.data, strict=True))
        return " | ".join(parts)
    args = x.args
    if x.op in ("add", "sub", "choose", *_COMPARE):  # one wide operand is enough
        *test, first, second = args
        plain = _widened(second) is second
        args = (*test, *((_widened(first), second) if plain else (first, _widened(second))))
    a = [c_text(y) for y in args]
    if x.op in _C:
        return _C[x.op].format(*a)
    if x.op == "cast":
        if x.args[0].bits == 1:
            return f"{a[0]} ? {_literal_text(1, x.bits)} : {_literal_text(0, x.bits)}"
        return f"({C_TYPES[x.bits]}){a[0]}"
    if x.op == "scale":
        return f"{c_text(_widened(args[0]))} * {_literal_text(1 << x.data[0], x.bits)}"
    name, extra = _function(x)
    return f"{name}({', '.join([*(bare_text(_widened(y)) for y in x.args), *extra])})"


def _chain(x: Expr) -> list[str]:
    # Read from the left, brackets or none.
    return [t for y in x.args for t in (_chain(y) if y.op == x.op else [c_text(y)])]


def _function(x: Expr) -> tuple[str, list[str]]:
    # Name of the function of esea_q31.c, and its arguments behind the operands.
    width, d = "q63" if x.bits == 64 else "q31", [str(n) for n in x.data]
    wide_top = [_literal_text(x.data[-1], 64)] if d else []
    if x.op in ("min", "max", "abs", "round"):
        return f"esea_{width}_{x.op}", d
    if x.op == "mul64":
        return "esea_q63_mul" if x.args[1].bits == 64 else "esea_q63_mul_q31", d
    if x.op == "divide":
        return "esea_q63_divide", [d[0], _literal_text(x.data[1], 64), *wide_top]
    if x.op == "pow":
        numbers = [d[0], f"INT32_C({d[1]})", d[2]]
        if x.args[0].bits == 64 or x.bits == 64:
            return "esea_q63_pow", [*numbers, *wide_top]
        return "esea_q31_pow", [*numbers, d[3]]
    if x.op == "exp":
        return "esea_q63_exp", [*d[:2], *wide_top]
    others = {"mul": "q31_mul", "wide_mul": "q31_wide", "log": "q63_log"}
    return f"esea_{others.get(x.op, f'q31_{x.op}')}", d


# -- as Python -------------------------------------------------------------------------------------

Array = np.ndarray[Any, np.dtype[Any]]


def _each(function: Callable[..., int], *arrays: Array) -> Array:
    return np.asarray(np.frompyfunc(function, len(arrays), 1)(*arrays))


def _rounded_off(d: tuple[int, ...], x: Array) -> Array:
    return (x + (1 << (d[0] - 1))) >> d[0]


def _truth(x: Array) -> Array:
    return x.astype(object) * 1


_RULES: dict[str, Callable[..., Array]] = {
    "cast": lambda d, x: x,
    "add": lambda d, x, y: x + y,
    "sub": lambda d, x, y: x - y,
    "neg": lambda d, x: -x,
    "abs": lambda d, x: np.abs(x),
    "scale": lambda d, x: x << d[0],
    "round": _rounded_off,
    "mul": lambda d, x, y: _rounded_off(d, x * y),
    "mul64": lambda d, x, y: _rounded_off(d, x * y),
    "wide_mul": lambda d, x, y: x * y,
    "times": lambda d, x, y: x * y,
    "saturate": lambda d, x: np.minimum(np.maximum(x, INT32[0]), INT32[1]),
    "min": lambda d, x, y: np.minimum(x, y),
    "max": lambda d, x, y: np.maximum(x, y),
    "lt": lambda d, x, y: _truth(x < y),
    "le": lambda d, x, y: _truth(x <= y),
    "eq": lambda d, x, y: _truth(x == y),
    "ne": lambda d, x, y: _truth(x != y),
    "sign": lambda d, x: _truth(x > 0) - _truth(x < 0),
    "not": lambda d, x: 1 - x,
    "and": lambda d, x, y: x * y,
    "or": lambda d, x, y: _truth(x + y > 0),
    "flags": lambda d, *bits: sum(b * (1 << k) for b, k in zip(bits, d, strict=True)),
    "divide": lambda d, x, y: _each(lambda n, v: functions.divide(n, v, *d), x, y),
    **{
        name: lambda d, x, f=f: _each(lambda v: f(v, *d), x)
        for name, f in {
            "pow": functions.power,
            "exp": functions.exponential,
            "log": functions.logarithm,
            "sqrt": functions.root,
            "tanh": functions.tangent,
        }.items()
    },
}


def names(x: Expr) -> frozenset[str]:
    if x.op in ("read", "ref"):
        return frozenset((x.name,))
    return frozenset().union(*map(names, x.args)) if x.args else frozenset()


def evaluate(x: Expr, values: Mapping[str, Array], count: int) -> Array:
    """Value of an expression over many argument sets at once."""
    if x.op in ("read", "ref"):
        return values[x.name]
    if x.op == "literal":
        return np.full(count, x.data[0], dtype=object)
    if x.op == "choose":
        # An arm is evaluated where it is taken alone, as in C: its interval may hold only there.
        taken = evaluate(x.args[0], values, count) != 0
        result = np.empty(count, dtype=object)
        for arm, rows in ((x.args[1], taken), (x.args[2], ~taken)):
            part = {n: values[n][rows] for n in names(arm)}
            result[rows] = evaluate(arm, part, int(rows.sum()))
        return _checked(x, result)
    return _checked(x, _RULES[x.op](x.data, *(evaluate(a, values, count) for a in x.args)))


def _checked(x: Expr, result: Array) -> Array:
    if len(result) and not (x.low <= min(result) and max(result) <= x.high):
        raise OverflowProofError(f"{x.op} left its proven interval [{x.low}, {x.high}]")
    return result
