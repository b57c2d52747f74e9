"""Share of a coupling's life that its cycles have used, by the device file's fatigue curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from esea_gen.devices.fields import Fatigue


@dataclass(frozen=True)
class LifeUsed:
    """Miner's sum, 1 at the end of life: with the least and the largest range of each class."""

    least: float
    most: float


def life_used(curve: Fatigue, halves: Sequence[int], width_rad: float) -> LifeUsed:
    """Miner's sum of half cycles by class of range (Miner 1945, J. Appl. Mech. 12, A159)."""
    at, n, slope = curve.range_rad.value, curve.cycles.value, curve.exponent.value

    def total(beyond: int) -> float:
        ranges = [(k + beyond) * width_rad / at for k in range(len(halves))]
        return float(sum(0.5 * h * r**slope / n for h, r in zip(halves, ranges, strict=True)))

    return LifeUsed(total(0), total(1))
