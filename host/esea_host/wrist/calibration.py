"""Calibrations: ranges, speeds at nodes, whether they are good enough, and their cursor maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_host.study.words import KeyedText, keyed
from esea_host.wrist.normalisation import (
    CursorMap,
    NodeSpeeds,
    linear_map,
    node_places,
    normalise,
    plain_map,
)

Array = npt.NDArray[np.float64]
AXES = ("FE", "RU")
Row = Mapping[str, Any]
Method = Literal["none", "linear", "published", "rbf"]
METHODS: tuple[Method, ...] = ("none", "linear", "published", "rbf")
LEAST_PASSES = 3
LEAST_SPEED_DEG_S = 5.0
LEAST_REACH = 0.8


Traces = Sequence[tuple[npt.ArrayLike, npt.ArrayLike]]  # time_s, theta_deg


def crossings(traces: Traces, node_deg: float) -> list[float]:
    """Speeds, deg/s, at all crossings of a node."""
    found: list[float] = []
    for time_s, theta_deg in traces:
        t, th = np.asarray(time_s, np.float64), np.asarray(theta_deg, np.float64)
        beyond = th >= node_deg
        k = np.flatnonzero(beyond[1:] != beyond[:-1])
        found += np.abs((th[k + 1] - th[k]) / (t[k + 1] - t[k])).tolist()
    return found


def node_speeds(low_deg: float, high_deg: float, traces: Traces) -> NodeSpeeds:
    if not high_deg > low_deg:
        raise UserError(
            f"The range of motion, {low_deg:.1f} to {high_deg:.1f} deg, is empty.",
            "Measure it again.",
        )
    nodes = node_places(low_deg, high_deg)
    passes = [crossings(traces, node) for node in nodes]
    speeds = tuple(float(np.mean(p)) if p else None for p in passes)
    return NodeSpeeds(low_deg, high_deg, tuple(nodes), speeds)


@dataclass(frozen=True)
class Complaint:
    """A defect of a calibration: key for the participant, words for the operator."""

    key: str
    words: KeyedText
    node_deg: float | None = None


def quality(
    low_deg: float, high_deg: float, traces: Traces, least_passes: int = LEAST_PASSES
) -> list[Complaint]:
    """Defects of the movements so far: too slow, too small, too few passes."""
    found: list[Complaint] = []
    width = high_deg - low_deg
    if traces:
        reached = max(float(np.ptp(np.asarray(th, np.float64))) for _, th in traces) / width
        if reached < LEAST_REACH:
            given = {"percent": 100 * reached, "least": 100 * LEAST_REACH}
            found.append(Complaint("further", keyed("advice.too_small", **given)))
    for node in node_places(low_deg, high_deg):
        passes = crossings(traces, node)
        if len(passes) < least_passes:
            few = keyed("advice.too_few", node_deg=node, passes=len(passes), least=least_passes)
            found.append(Complaint("more", few, node))
        elif (mean := float(np.mean(passes))) < LEAST_SPEED_DEG_S:
            given = {"node_deg": node, "speed_deg_s": mean, "least": LEAST_SPEED_DEG_S}
            found.append(Complaint("faster", keyed("advice.too_slow", **given), node))
    return found


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
