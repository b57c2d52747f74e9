"""Start-up of a drive: requirements, motion paths, recordings, checks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.language.ports import Array


@dataclass(frozen=True)
class DriveRecording:
    """Recording of one procedure, a row a tick; ``u_Nm[k]`` applies from tick k to k + 1."""

    tick_s: float
    u_Nm: Array
    gear_rad: Array  # at the joint, whole turns of the shaft found by the joint's encoder
    motor_rad: Array
    load_rad: Array

    def __len__(self) -> int:
        return len(self.load_rad)


MARGIN_RAD, LEAST_SPAN_RAD = 0.1, 1.0


def travel(device: Device) -> tuple[float, float]:
    """Range in which the joint is turned, ends included."""
    s = device.file.safety
    assert s is not None
    low, high = s.rom_min_rad.value + MARGIN_RAD, s.rom_max_rad.value - MARGIN_RAD
    if high - low < LEAST_SPAN_RAD:
        raise UserError(
            f"{device.origin}: the joint may turn by {high - low:.2f} rad between "
            f"safety.rom_min_rad and rom_max_rad less {MARGIN_RAD:g} rad at either end; "
            f"{LEAST_SPAN_RAD:g} rad are needed to tell friction from the gear's disturbance.",
            "Widen the range for the start-up, with the joint empty.",
        )
    return low, high


REST_S = 0.3


@dataclass(frozen=True)
class GearPath:
    """Where the gear is to be, from the start of a procedure on; one row a tick."""

    theta_rad: Array
    omega_rad_s: Array
    alpha_rad_s2: Array

    @classmethod
    def through(
        cls, legs: Sequence[tuple[float, float]], tick_s: float, accel_rad_s2: float = 4.0
    ) -> GearPath:
        """From 0 through ends: each leg an end and the speed on the way, with a rest behind it."""
        rates: list[Array] = []
        at = 0.0
        for end, speed in legs:
            span = end - at
            ramp = min(speed / accel_rad_s2, math.sqrt(abs(span) / accel_rad_s2))
            ramp = max(round(ramp / tick_s), 1) * tick_s
            cruise = max(round((abs(span) / speed - ramp) / tick_s), 0) * tick_s
            top = span / (ramp + cruise)
            n, m = round(ramp / tick_s), round(cruise / tick_s)
            up = top * np.arange(1, n + 1) / n
            rates += [up, np.full(m, top), top - up, np.zeros(round(REST_S / tick_s))]
            at = end
        omega = np.concatenate(rates)
        theta = np.cumsum(omega) * tick_s
        return cls(theta, omega, np.gradient(omega, tick_s))

    def __len__(self) -> int:
        return len(self.theta_rad)


RATIO_OFF = 0.03
FRICTION_SHARE = 0.5


@dataclass(frozen=True)
class StartupCheck:
    """One comparison with a limit."""

    procedure: str
    what: str
    value: float  # in unit; the value must not be above
    limit: float
    unit: str
    fix: str  # what to do otherwise

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return self.value <= self.limit

    def line(self) -> str:
        """For people."""
        word = "within" if self.passed else "ABOVE"
        value, limit = (f"{x:.3g} {self.unit}".rstrip() for x in (self.value, self.limit))
        return f"{self.what}: {value}, {word} {limit}"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready, units in the keys."""
        unit = (self.unit or "1").replace("%", "pct")
        finite = math.isfinite(self.value)
        return {
            "procedure": self.procedure,
            "what": self.what,
            f"value_{unit}": self.value if finite else None,
            f"limit_{unit}": self.limit,
            "passed": self.passed,
            "fix": "" if self.passed else self.fix,
        }
