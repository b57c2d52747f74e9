"""Parameters of a board, as its dialect describes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class BoardParameter:
    name: str  # full, velocity.bandwidth_Hz
    id: str  # on the wire, at most 16 characters
    index: int  # its number
    meaning: str  # what it does
    unit: str  # 1 where it has none
    low: float  # bounds; a value outside is refused
    high: float
    default: float  # as built
    fixed: bool  # whether only a calibration sets it

    def told(self, text: str) -> str:
        """A value with its unit, if it has one."""
        return text if self.unit == "1" else f"{text} {self.unit}"


def known_parameters(dialect: Any) -> list[BoardParameter]:
    entries = dialect.enums.get("ESEA_PARAM", {})
    found = []
    for index, entry in sorted(entries.items()):
        if entry.name.endswith("_ENUM_END"):
            continue
        name, own, unit, low, high, default, fixed = (entry.param[i] for i in range(1, 8))
        numbers = (float(low), float(high), float(default))
        found.append(
            BoardParameter(name, own, index, entry.description, unit, *numbers, fixed == "fixed")
        )
    return found


def find_parameter(known: list[BoardParameter], name: str) -> BoardParameter:
    for p in known:
        if name in (p.name, p.id):
            return p
    raise ValueError(f"there is no parameter {name}; there is {', '.join(p.name for p in known)}")
