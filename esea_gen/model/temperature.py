"""Effect of temperature on a rubber: one factor on its stiffness and its losses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from esea_gen.devices.rubber import LEAST_FACTOR


@dataclass(frozen=True)
class TemperatureFactor:
    """Factor on every term but the offset: 1 + per_K (T - reference)."""

    reference_C: float
    per_K: float
    low_C: float
    high_C: float

    def __post_init__(self) -> None:
        if not self.low_C <= self.reference_C <= self.high_C or not self.low_C < self.high_C:
            raise ValueError(
                f"{self.reference_C:g} degC is not in the range {self.low_C:g} to {self.high_C:g}"
            )
        if self.ends[0] < LEAST_FACTOR:
            raise ValueError(f"a factor of temperature falls to {self.ends[0]:g}")

    def at(self, temperature_C: Any) -> Any:
        return 1 + self.per_K * (temperature_C - self.reference_C)

    @property
    def ends(self) -> tuple[float, float]:
        low, high = sorted((self.at(self.low_C), self.at(self.high_C)))
        return low, high
