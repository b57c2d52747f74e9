"""Elementary functions of the q31 format in Python integers, equal to ``esea_q31.c``.

Every function here gives the same whole number as the C of the same name, whatever its arguments.
The error constants are measured over every argument of the two cores that all functions use
(``tests/test_fixed_functions.py`` repeats that), and rounded up.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Final

from esea_gen.emit.elementary import source_paths

LOG2_ERROR: Final = 2.0**-34.2
"""Largest |log2_fraction - log2(significand)|, over all 2^31 significands."""

EXP2_ERROR: Final = 2.0**-30.1
"""Largest relative error of exp2_fraction, over all 2^32 fractions, the cut below them included."""

DIVIDE_ERROR: Final = 2.0**-30
"""Largest relative error of ``divide``: dividend cut and reciprocal rounded to 32 bits."""

INT32_MAX: Final = 2**31 - 1
_U32: Final = 0xFFFFFFFF
_U64: Final = 0xFFFFFFFFFFFFFFFF


def source_files() -> tuple[Path, ...]:
    here = Path(__file__).parent
    tables = next(p for p in source_paths() if p.name == "esea_f32_tables.h")
    return here / "esea_q31.h", here / "esea_q31.c", tables, here / "esea_q31_units.h"


@cache
def _constants() -> tuple[dict[str, int], dict[str, tuple[int, ...]]]:
    # Read from the header that the C includes: one home for every number.
    _, _, shared, _ = source_files()
    text = shared.read_text(encoding="ascii")
    numbers = {}
    for name, value in re.findall(r"#define (\w+) (.+)", text):
        numbers[name] = _integer(value)
    tables = {}
    for name, body in re.findall(r"(\w+)\[\d+\] = \{(.*?)\};", text, flags=re.DOTALL):
        tables[name] = tuple(_integer(v) for v in body.split(",") if v.strip())
    return numbers, tables


def _integer(text: str) -> int:
    digits = re.search(r"-?(0x[0-9A-Fa-f]+|\d+)", re.sub(r"U?INT64_C", "", text))
    if digits is None:
        raise ValueError(f"no number in {text!r}")
    return int(digits.group(), 0)


def _signed(u: int) -> int:
    return ((u + 0x80000000) & _U32) - 0x80000000


def log2_fraction(significand: int) -> int:
    numbers, tables = _constants()
    row = tables["LOG2_TABLE"][(significand >> 25) & 63]
    r = _signed((significand * (row & 0xFFF) + 128) >> 8)
    p = numbers["LOG2_3"]
    for k in (2, 1, 0):
        p = numbers[f"LOG2_{k}"] + (r * p >> 32)
    return (row + r * p) & _U64


def exp2_fraction(fraction: int) -> int:
    numbers, tables = _constants()
    t = _signed(((fraction << 5) & _U32) ^ 0x80000000)
    middle = tables["EXP2_TABLE"][fraction >> 27]
    p = numbers["EXP2_2"]
    for k in (1, 0):
        p = numbers[f"EXP2_{k}"] + (t * p >> 32)
    p = t * p >> 32
    return (middle + ((middle >> 1) * p >> 32)) & _U32


def _place(m: int, shift: int, top: int) -> int:
    if shift > 32:
        return 0
    if shift < -30:
        return top
    value = (m + (1 << (shift - 1))) >> shift if shift > 0 else m << -shift
    return min(value, top)


def power(x: int, x_fraction: int, y_q27: int, fraction: int, top: int) -> int:
    if x <= 0:
        return 0
    bits = x.bit_length()
    significand = x << (32 - bits) if bits <= 32 else x >> (bits - 32)
    z_fraction = log2_fraction(significand)
    high = ((z_fraction >> 32) + ((z_fraction & _U32) >> 31)) & _U32
    total = y_q27 * _signed(high) + (y_q27 * _signed(z_fraction & _U32) >> 32)
    z = (total >> 32) + y_q27 * (bits - 1 - x_fraction + (high >> 31))
    whole = z >> 27
    cut = ((z << 5) & _U32) | ((total & _U32) >> 27)
    return _place(exp2_fraction(cut), 31 - fraction - whole, top)


def exponential(x: int, x_fraction: int, fraction: int, top: int) -> int:
    numbers, _ = _constants()
    z = x * numbers["LOG2_E_HIGH"] + (x * numbers["LOG2_E_LOW"] >> 32) >> (x_fraction - 1)
    whole = z >> 32
    if whole < -100:
        return 0
    if whole > 100:
        return top
    return _place(exp2_fraction(z & _U32), 31 - fraction - whole, top)


def logarithm(x: int, x_fraction: int, fraction: int) -> int:
    x = max(x, 1)
    bits = x.bit_length()
    significand = x << (32 - bits) if bits <= 32 else x >> (bits - 32)
    ln2 = 0xB17217F8
    z = ((bits - 1 - x_fraction) << 54) + (log2_fraction(significand) >> 10)
    z = (z >> 32) * ln2 + ((z & _U32) * (ln2 >> 1) >> 31)
    shift = 54 - fraction
    return (z + (1 << (shift - 1))) >> shift


def root(x: int, k: int) -> int:
    """Square root of ``x 2**k``, rounded down."""
    import math

    if x <= 0:
        return 0
    return min(math.isqrt(x << k if k >= 0 else x >> -k), INT32_MAX)


def tangent(x: int, x_fraction: int) -> int:
    one = 1 << 31
    t = exponential(-abs(x), x_fraction - 1, 31, one)
    y = ((one - t) * (1 << 30) + one // 2) // (one + t)
    return -y if x < 0 else y


def _reciprocal(d: int) -> int:
    # 2^33 / d in units of 2^-49, d from 2^33 to below 2^34.
    numbers, tables = _constants()
    c = tables["LOG2_TABLE"][(d >> 27) & 63] & 0xFFF
    r = _signed(d * c >> 7)
    p = numbers["RECIPROCAL_4"]
    for k in (3, 2, 1, 0):
        p = numbers[f"RECIPROCAL_{k}"] + (r * p >> 32)
    w = ((1 << 63) - r * p) & _U64
    return ((w >> 29) - (1 << 34) + (1 << 38)) * c


def divide(n: int, d: int, k: int, low: int, high: int) -> int:
    """n 2^k / d with 31 significant bits, cut to a range."""
    value = 0
    if n and d:
        u, v = abs(n), abs(d)
        un, vn = 64 - u.bit_length(), 64 - v.bit_length()
        q = ((u << un) >> 32) * ((_reciprocal((v << vn) >> 30) + 0x10000) >> 17)
        shift = 63 + un - vn - k
        if shift < 2:
            value = 2**63 - 1
        elif shift < 64:
            value = (q >> shift) + ((q >> (shift - 1)) & 1)
        elif shift == 64:
            value = q >> 63
    if (n < 0) != (d < 0):
        value = -value
    return min(max(value, low), high)
