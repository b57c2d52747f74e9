"""Elementary functions of the emitted single-precision C: the same bits on every target.

They compute in integers and round once. ``esea_f32.h`` is the manual, ``esea_f32.c`` the code,
``coefficients.py`` the derivation of ``esea_f32_tables.h``. This module holds what the generator
needs to know: where the files are, how far a result may be from the exact one, and how a constant
exponent is written.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

EXPONENT_FRACTION_BITS: Final = 27

ACCURACY_ULP: Final[dict[str, float]] = {
    "powk": 0.51,
    "pow": 0.51,
    "exp": 0.51,
    "expm1": 0.52,
    "log": 0.51,
    "log1p": 0.51,
    "tanh": 0.52,
    "cbrt": 0.51,
    "sqrt": 0.5,
    "sin": 0.51,
    "cos": 0.51,
    "atan2": 0.52,
}
"""Largest error of each function in units in the last place, subnormal results included.

Measured exhaustively where there is one argument, on samples otherwise, then rounded up. The header
says the same numbers and a test holds both to the measurement.
"""


def source_paths() -> tuple[Path, ...]:
    here = Path(__file__).parent
    return here / "esea_f32.h", here / "esea_f32.c", here / "esea_f32_tables.h"


def exponent_q27(exponent: float) -> int:
    if -16.0 <= exponent <= 16.0:
        scaled = round(exponent * (1 << EXPONENT_FRACTION_BITS))
        if scaled < 1 << 31:
            return scaled
    raise ValueError(
        f"exponent {exponent} does not fit Q4.27, which holds -16 to below 16; "
        "use exp and log, or scale the base so that a smaller exponent does"
    )
