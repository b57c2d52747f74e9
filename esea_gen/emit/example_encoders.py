"""Which count an encoder of the example gives at an angle: asked of its Block."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from esea_gen.language.block import Block

SETTLE_TICKS = 20  # encoders and rates have settled


@dataclass(frozen=True)
class ExampleEncoder:
    at_zero_rad: float
    sign: float
    full: int

    def count(self, angle_rad: float) -> float:
        turns = self.sign * (angle_rad - self.at_zero_rad) / (2 * math.pi)
        return float(round(turns * self.full) % self.full)


def encoder_of(block: Block, tunables: Mapping[str, float]) -> ExampleEncoder:
    full = int(next(p for p in block.inputs if p.name == "count").high) + 1

    def angle(count: int) -> float:
        simulator = block.simulator(tunables)
        for _ in range(SETTLE_TICKS):
            out = simulator.step(count=float(count), frame_error=0.0)
        return float(out["theta_rad"])

    if block.name == "encoder_gear":  # counts on from wherever it starts
        return ExampleEncoder(0.0, 1.0, full)

    # A hundredth of a turn on, the short way round.
    rise = math.remainder(angle(full // 100) - angle(0), 2 * math.pi)
    return ExampleEncoder(angle(0), math.copysign(1.0, rise), full)
