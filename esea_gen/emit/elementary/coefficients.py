"""Derive tables and polynomial coefficients of the single-precision elementary functions.

Everything in ``esea_f32_tables.h`` comes from here, computed to 110 digits, so that no constant in
the C has to be believed. The output is deterministic and a test renders it again and compares.

    python -m esea_gen.emit.elementary.coefficients --write

Notes
-----
``Qn`` means an integer that counts units of ``2**-n``. Polynomials are Chebyshev fits, at most a
factor of about two from the minimax error, which is below what the arithmetic itself loses. A right
shift truncates, which biases a result by half a unit; where that shows in the result, the
coefficient added after the last shift carries the opposite half unit, at no cost in instructions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import mpmath  # type: ignore[import-untyped,unused-ignore]
from mpmath import mp, mpf

TABLES_PATH = Path(__file__).with_name("esea_f32_tables.h")

LOG2_INTERVALS = 64
EXP2_INTERVALS = 32
RECIPROCAL_BITS = 11

Real: TypeAlias = Any  # mpmath.mpf, which carries no types


def fixed(value: Real, fraction_bits: int, bias: float = 0.0) -> int:
    return int(mpmath.nint(mpmath.ldexp(value, fraction_bits) + mpf(bias)))


def fit(
    function: Callable[[Real], Real], low: Real, high: Real, degree: int
) -> tuple[list[Real], Real]:
    coefficients, error = mpmath.chebyfit(function, [low, high], degree + 1, error=True)
    return list(reversed(coefficients)), error


def reciprocals() -> list[int]:
    """Choose one short reciprocal for each of the equal intervals of the significand.

    The first and the last interval use exactly 1 and 1/2, so that the tabulated logarithm of both
    is an integer and nothing cancels around ``x = 1``. Eleven fraction bits make
    ``significand * reciprocal - 1`` exact modulo ``2**32``.
    """
    chosen = []
    for index in range(LOG2_INTERVALS):
        middle = 1 + (mpf(index) + mpf(0.5)) / LOG2_INTERVALS
        chosen.append(fixed(1 / middle, RECIPROCAL_BITS))
    chosen[0] = 1 << RECIPROCAL_BITS
    chosen[-1] = 1 << (RECIPROCAL_BITS - 1)
    return chosen


def reduced_range() -> tuple[Real, Real]:
    """Return the range of ``significand * reciprocal - 1`` over all intervals."""
    low, high = mpf(0), mpf(0)
    for index, reciprocal in enumerate(reciprocals()):
        scale = mpmath.ldexp(mpf(reciprocal), -RECIPROCAL_BITS)
        low = min(low, (1 + mpf(index) / LOG2_INTERVALS) * scale - 1)
        high = max(high, (1 + mpf(index + 1) / LOG2_INTERVALS) * scale - 1)
    # The C keeps this argument as Q37 in 32 bits.
    if max(-low, high) > mpmath.ldexp(1, -6):
        raise ValueError(
            f"reduced argument {low} to {high} leaves +-2**-6; choose other reciprocals"
        )
    return low, high


def log2_table() -> list[int]:
    """Log2 of the tabulated significands as Q64, with the reciprocal in the low twelve bits."""
    rows = []
    for reciprocal in reciprocals():
        logarithm = -mpmath.log(mpmath.ldexp(mpf(reciprocal), -RECIPROCAL_BITS), 2)
        # log2 = 1 becomes 0: the sum is modulo one, and what follows is always negative there.
        word = int(mpmath.nint(mpmath.ldexp(logarithm, 52))) % (1 << 52)
        rows.append((word << 12) | reciprocal)
    return rows


def exp2_table() -> list[int]:
    """Return 2**t at the interval centres as Q31, with the truncations of the C centred."""
    # The fraction that arrives is truncated to Q32, on average 2**-33 too small.
    centred = 1 + mpmath.log(2) * mpmath.ldexp(1, -33)
    return [
        fixed(centred * mpf(2) ** ((index + mpf(0.5)) / EXP2_INTERVALS), 31, 0.5)
        for index in range(EXP2_INTERVALS)
    ]


def reciprocal_root_table() -> list[int]:
    """Return seeds of 1/sqrt(a) for a in [1, 4) as Q16."""
    return [fixed(1 / mpmath.sqrt((mpf(index) + mpf(0.5)) / 16), 16) for index in range(16, 64)]


def two_over_pi_words() -> list[int]:
    """Return 256 bits of 2/pi behind 64 zero bits, as words with the most significant first."""
    bits = int(mpmath.floor(mpmath.ldexp(2 / mp.pi, 256)))
    return [0, 0] + [(bits >> (32 * (7 - word))) & 0xFFFFFFFF for word in range(8)]


def near_zero(function: Callable[[Real], Real], limit: Real) -> Callable[[Real], Real]:
    return lambda t: limit if t == 0 else function(t)


def even(function: Callable[[Real], Real], limit: Real) -> Callable[[Real], Real]:
    """A function of x that depends on x^2 alone, as one of that, with its limit at zero."""
    return near_zero(lambda s: function(mpmath.sqrt(s)), limit)


def polynomial(
    name: str,
    meaning: str,
    function: Callable[[Real], Real],
    interval: tuple[Real, Real],
    formats: Sequence[int],
    *,
    bias: float = 0.0,
    alternating: bool = False,
) -> tuple[str, str, list[int]]:
    coefficients, error = fit(function, interval[0], interval[1], len(formats) - 1)
    integers = [
        fixed(-value if alternating and power % 2 else value, bits, 0.0 if power else bias)
        for power, (value, bits) in enumerate(zip(coefficients, formats, strict=True))
    ]
    same = len(set(formats)) == 1
    bits_text = f"all Q{formats[0]}" if same else ", ".join(f"Q{bits}" for bits in formats)
    error_text = f"fit error 2^{float(mpmath.log(error, 2)):.1f}"
    return name, f"{meaning};\n * {bits_text}; {error_text}", integers


def polynomials() -> list[tuple[str, str, list[int]]]:
    """Return every polynomial as name, meaning and integer coefficients."""
    ln2, half, turn = mpmath.log(2), mpf(0.5), mp.pi / 2
    reduced, quarter = reduced_range(), (mpf(0), mpf(0.25))
    return [
        polynomial(
            "LOG2",
            "log2(1 + r) / r",
            near_zero(lambda r: mpmath.log1p(r) / (r * ln2), 1 / ln2),
            reduced,
            (30, 28, 26, 24),
            bias=0.5,
        ),
        polynomial(
            "LOG",
            "(log(1 + r) - r) / r^2",
            near_zero(lambda r: (mpmath.log1p(r) - r) / r**2, -half),
            reduced,
            (31, 26, 21, 16),
        ),
        polynomial(
            "EXP2",
            "(2^t - 1) / t, |t| <= 1/64",
            near_zero(lambda t: mpmath.expm1(t * ln2) / t, ln2),
            (-mpf(1) / 64, mpf(1) / 64),
            (28, 23, 18),
        ),
        polynomial(
            "RECIPROCAL", "1 / (1 + r)", lambda r: 1 / (1 + r), reduced, (30, 25, 20, 15, 10)
        ),
        polynomial(
            "EXPM1",
            "(exp(x) - 1 - x) / x^2, |x| <= 1/2",
            near_zero(lambda x: (mpmath.expm1(x) - x) / x**2, half),
            (-half, half),
            (31,) * 7,
        ),
        polynomial(
            "TANH",
            "(1 - tanh(x) / x) / x^2 in s = x^2 <= 1/4, signs alternating",
            even(lambda x: (1 - mpmath.tanh(x) / x) / x**2, mpf(1) / 3),
            quarter,
            (32,) * 6,
            alternating=True,
        ),
        polynomial(
            "SIN",
            "sin(f pi/2) / f in s = f^2 <= 1/4, signs alternating",
            even(lambda f: mpmath.sin(f * turn) / f, turn),
            quarter,
            (31, 32, 32, 32, 32),
            bias=-0.5,
            alternating=True,
        ),
        polynomial(
            "COS",
            "(1 - cos(f pi/2)) / s in s = f^2 <= 1/4, signs alternating",
            even(lambda f: (1 - mpmath.cos(f * turn)) / f**2, turn**2 / 2),
            quarter,
            (31,) * 5,
            alternating=True,
        ),
        polynomial(
            "ATAN",
            "(1 - atan(t) / t) / s in s = t^2 <= 1, signs alternating",
            even(lambda t: (1 - mpmath.atan(t) / t) / t**2, mpf(1) / 3),
            (mpf(0), mpf(1)),
            (32,) * 12,
            alternating=True,
        ),
    ]


def table(
    meaning: str, declared: str, values: Sequence[int], pattern: str, per_line: int
) -> list[str]:
    texts = [pattern.format(value) for value in values]
    lines = [texts[at : at + per_line] for at in range(0, len(texts), per_line)]
    return [
        f"/* {meaning} */",
        f"static const {declared}[{len(values)}] = {{",
        *(f"    {', '.join(line)}," for line in lines),
        "};",
        "",
    ]


def render() -> str:
    with mp.workdps(110):
        lines = [
            "/* Constants of esea_f32.c, derived to 110 digits by coefficients.py, for it alone.",
            " * Regenerate: python -m esea_gen.emit.elementary.coefficients --write",
            " *",
            " * Qn counts units of 2^-n. Coefficients run from the constant upwards. */",
            "#ifndef ESEA_F32_TABLES_H",
            "#define ESEA_F32_TABLES_H",
            "",
            "#include <stdint.h>",
            "",
            *table(
                "log2 of the significand at the 64 reference points: Q64 with the low 12 bits\n"
                " * replaced by the reciprocal of the point, Q11.",
                "uint64_t LOG2_TABLE",
                log2_table(),
                "UINT64_C(0x{:016X})",
                3,
            ),
            *table("2^((i + 1/2) / 32), Q31.", "uint32_t EXP2_TABLE", exp2_table(), "0x{:08X}u", 6),
            *table(
                "1 / sqrt((i + 16 + 1/2) / 16), Q16.",
                "uint16_t ROOT_TABLE",
                reciprocal_root_table(),
                "0x{:04X}u",
                8,
            ),
            *table(
                "64 zero bits, then 2/pi, most significant word first.",
                "uint32_t TWO_OVER_PI",
                two_over_pi_words(),
                "0x{:08X}u",
                5,
            ),
            "/* log2(e), Q63, two halves. */",
            f"#define LOG2_E_HIGH 0x{fixed(1 / mpmath.log(2), 63) >> 32:08X}u",
            f"#define LOG2_E_LOW 0x{fixed(1 / mpmath.log(2), 63) & 0xFFFFFFFF:08X}u",
            f"#define LN_2_Q64 UINT64_C(0x{fixed(mpmath.log(2), 64):016X})",
            f"#define LN_2_Q56 INT64_C({fixed(mpmath.log(2), 56)})",
            f"#define PI_Q61 UINT64_C(0x{fixed(mp.pi, 61):016X})",
        ]
        for name, meaning, integers in polynomials():
            lines += ["", f"/* {meaning} */"]
            for power, value in enumerate(integers):
                text = f"{value}" if -(2**31) < value < 2**31 else f"0x{value:08X}u"
                lines.append(f"#define {name}_{power} {text if value >= 0 else f'({text})'}")
        lines += ["", "#endif"]
        return "\n".join(lines) + "\n"


if __name__ == "__main__":  # --write, which a test then compares with what is rendered
    TABLES_PATH.write_text(render(), encoding="ascii", newline="\n")
