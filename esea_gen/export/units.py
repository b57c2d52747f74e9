"""Units of ports as exponents of SI base units, which is how FMI defines them."""

from __future__ import annotations

import math
import re

# Exponents of kg, m, s, rad, K; hertz, bits and counts have no dimension of their own here.
_BASE: dict[str, dict[str, int]] = {
    "rad": {"rad": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "kg": {"kg": 1},
    "Hz": {"s": -1},
    "Nm": {"kg": 1, "m": 2, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "bit": {},
    "K": {"K": 1},
    "degC": {"K": 1},
    "1": {},
}
DEGREES = {"rad": "deg", "rad/s": "deg/s"}
"""Units that people read in degrees, and what those are called."""
PER_RADIAN = 180 / math.pi


def exponents(unit: str) -> dict[str, int]:
    """Exponents of the SI base units of a unit as ports write it: ``Nm s/rad``, ``1/(rad s)``."""
    over, _, under = unit.partition("/")
    total: dict[str, int] = {}
    for part, sign in ((over, 1), (under.strip("()"), -1)):
        for name, power in re.findall(r"([A-Za-z]+|1)(?:\^(\d))?", part):
            for base, n in _BASE[name].items():
                total[base] = total.get(base, 0) + sign * n * int(power or 1)
    return {k: n for k, n in total.items() if n}
