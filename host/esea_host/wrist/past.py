"""What earlier trials have found: neutral position, ranges, speeds, and the cursor map of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from esea_gen.errors import UserError
from esea_host.wrist.calibration import node_speeds
from esea_host.wrist.normalisation import (
    CursorMap,
    NodeSpeeds,
    linear_map,
    node_places,
    normalise,
    plain_map,
)

AXES = ("FE", "RU")
Row = Mapping[str, Any]
Method = Literal["none", "linear", "published", "rbf"]
METHODS: tuple[Method, ...] = ("none", "linear", "published", "rbf")


@dataclass(frozen=True)
class Calibrated:
    """The latest calibration in one state; traces: per axis (time_s, theta_deg)."""

    neutral: tuple[float, float]
    ends: Mapping[str, tuple[float, float]]
    traces: Mapping[str, tuple[tuple[Sequence[float], Sequence[float]], ...]]

    def range_of(self, axis: str) -> tuple[float, float]:
        if axis not in self.ends or not self.ends[axis][0] < self.ends[axis][1]:
            raise UserError(
                f"The range of {axis} has not been measured both ways.",
                "Put wrist.range for both ways of it before this trial.",
            )
        return self.ends[axis]

    def nodes(self, axis: str) -> list[float]:
        return node_places(*self.range_of(axis))

    def speeds(self, axis: str) -> NodeSpeeds:
        return node_speeds(*self.range_of(axis), self.traces.get(axis, ()))

    @property
    def complete(self) -> bool:
        return all(a in self.ends and self.traces.get(a) for a in AXES)

    def smallest_deg(self) -> float:
        return min(abs(end) for axis in AXES for end in self.range_of(axis))


def calibrated(past: Sequence[Row], impairment: bool) -> Calibrated:
    """The latest calibration in a state; a new neutral position begins a new one."""
    neutral = (0.0, 0.0)
    ends: dict[str, dict[int, float]] = {}
    traces: dict[str, list[tuple[Sequence[float], Sequence[float]]]] = {}
    for row in past:
        if row.get("impairment") != impairment:
            continue
        if row["task"] == "wrist.neutral":
            neutral = (row["neutral_fe_deg"], row["neutral_ru_deg"])
            ends, traces = {}, {}
        elif row["task"] == "wrist.range":
            ends.setdefault(row["axis"], {})[row["way"]] = row["end_deg"]
        elif row["task"] == "wrist.velocity":
            traces.setdefault(row["axis"], []).append((row["time_s"], row["theta_deg"]))
    found = {a: (e.get(-1, 0.0), e.get(1, 0.0)) for a, e in ends.items()}
    return Calibrated(neutral, found, {a: tuple(t) for a, t in traces.items()})


def cursor_maps(past: Sequence[Row], method: Method) -> dict[str, CursorMap]:
    healthy, constrained = calibrated(past, False), calibrated(past, True)
    found = {}
    for axis in AXES:
        a, b = healthy.speeds(axis), constrained.speeds(axis)
        if method == "none":
            found[axis] = plain_map(b)
        elif method == "linear":
            found[axis] = linear_map(a, b)
        else:
            ours = method == "rbf"
            found[axis] = normalise(a, b, slope=axis == "FE" and not ours, base=ours)
    return found
