"""Passive range of motion: slow bending and straightening, and the loop of torque over angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esea_gen.errors import UserError
from esea_host.assess.patients import DEG, Array
from esea_host.assess.responses import LATENCY_S, LegRecording, Passage, passage

SLOW_rad_s = 30 * DEG  # above it a reflex may answer: the test is no passive one


@dataclass(frozen=True)
class MotionRange:
    """Figures of one test.

    loop_J: work lost in a whole cycle; stiffness_Nm_rad: of the middle third, mean of both ways.
    bending_Nm, straightening_Nm: torque over ``angle_rad``, NaN where not passed.
    """

    low_rad: float
    high_rad: float
    fastest_rad_s: float
    cycles: int
    loop_J: float
    stiffness_Nm_rad: float
    angle_rad: Array
    bending_Nm: Array
    straightening_Nm: Array

    @property
    def slow(self) -> bool:
        return self.fastest_rad_s <= SLOW_rad_s

    def sentences(self) -> list[str]:
        """In words."""
        out = [
            f"The knee moved from {self.low_rad / DEG:.0f}° to {self.high_rad / DEG:.0f}° of "
            f"bending ({(self.high_rad - self.low_rad) / DEG:.0f}° in all), {self.cycles} times "
            "there and back.",
            f"In the middle of its range it resists with {self.stiffness_Nm_rad * DEG:.2f} Nm per "
            f"degree; {self.loop_J:.1f} J are lost in each cycle.",
        ]
        if not self.slow:
            out.append(
                f"Moved at up to {self.fastest_rad_s / DEG:.0f}°/s: too fast for a passive test "
                f"(at most {SLOW_rad_s / DEG:.0f}°/s); reflexes may have answered."
            )
        return out


def motion_range(recording: LegRecording, bins: int = 40) -> MotionRange:
    """Range, stiffness and loop from a recording of slow cycles; leg's weight taken off."""
    p = passage(recording)
    # Torque at its own time again: a passage pairs it with where the leg was 60 ms before.
    late = round(LATENCY_S / float(p.time_s[1] - p.time_s[0]))
    n = len(p.time_s) - late
    response = p.response_Nm[:n]
    p = Passage(
        p.time_s[late:], p.angle_rad[late:], p.rate_rad_s[late:], response, p.strained[:n], 0.0
    )
    low, high = (float(x) for x in np.quantile(p.angle_rad, [0.002, 0.998]))
    span = high - low
    if span < 5 * DEG:
        raise UserError(
            f"range of motion: the knee moved by {span / DEG:.1f} deg.",
            "Move it by at least 5 deg.",
        )
    turns = _turns(p.angle_rad, low + 0.15 * span, high - 0.15 * span)
    cycles = max(0, (len(turns) - 1) // 2)
    if cycles < 1:
        raise UserError("range of motion: no whole cycle.", "Bend and straighten at least once.")
    a, b = turns[0], turns[2 * cycles]
    loop = float(np.trapezoid(p.response_Nm[a : b + 1], p.angle_rad[a : b + 1])) / cycles
    edges = np.linspace(low, high, bins + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    at = np.clip(np.digitize(p.angle_rad, edges) - 1, 0, bins - 1)
    ways = []
    for going in (p.rate_rad_s > 0, p.rate_rad_s < 0):
        count = np.bincount(at[going], minlength=bins)
        total = np.bincount(at[going], p.response_Nm[going], bins)
        ways.append(np.where(count > 0, total / np.maximum(count, 1), np.nan))
    mean = 0.5 * (ways[0] + ways[1])
    third = np.isfinite(mean) & (np.abs(middle - 0.5 * (low + high)) < span / 6)
    slope = float(np.polyfit(middle[third], mean[third], 1)[0]) if third.sum() > 2 else float("nan")
    fastest = float(np.quantile(np.abs(p.rate_rad_s), 0.99))
    return MotionRange(low, high, fastest, cycles, loop, slope, middle, ways[0], ways[1])


def _turns(angle: Array, low: float, high: float) -> list[int]:
    """Where the movement turns: extremes beyond two thresholds, in turns."""
    out: list[int] = []
    side = 0
    best = 0
    for k, x in enumerate(angle):
        now = 1 if x > high else -1 if x < low else 0
        if now and now != side:
            if side:
                out.append(best)
            side, best = now, k
        elif now == side and side * x > side * angle[best]:
            best = k
    if side:
        out.append(best)
    return out
