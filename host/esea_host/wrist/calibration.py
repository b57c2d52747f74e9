"""Calibrations: ranges, speeds at nodes, whether they are good enough, cursor maps, their file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import chain, count
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from esea_gen.errors import UserError
from esea_gen.files import read_whole, write_whole
from esea_gen.toml_file import checked, parse_toml
from esea_host.study.words import KeyedText, keyed
from esea_host.wrist.normalisation import (
    Angle_deg,
    CursorMap,
    NodeSpeeds,
    check_nodes,
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
        low, high = self.ends.get(axis, (0.0, 0.0))
        if not low < high:
            raise UserError(
                f"The range of {axis} is {low:.1f} to {high:.1f} deg, or not measured both ways.",
                "Put wrist.range both ways before this; a left wrist's deviation is mirrored.",
            )
        return low, high

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


SEE = "docs/calibrate-wrist.md"
MAKE = "Give a file that esea-host wrist saved, or calibrate again."
MOST_BYTES = 1 << 20


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class StoredState(_Table):
    neutral_fe_deg: Angle_deg
    neutral_ru_deg: Angle_deg
    FE: NodeSpeeds
    RU: NodeSpeeds

    def axis(self, name: str) -> NodeSpeeds:
        return self.FE if name == "FE" else self.RU


class WristCalibration(_Table):
    """Both states; sha256 detects accidental edits, not deliberate fraud."""

    schema_: Literal["esea-wrist-calibration-1"] = Field(
        "esea-wrist-calibration-1", alias="schema", description="of this file"
    )
    made: str = Field(max_length=40, description="when, UTC")
    device: str = Field(max_length=80, description="name of the device")
    content_hash: str = Field(max_length=80, description="of the device's firmware")
    simulated: bool = Field(description="whether hand or board were simulated")
    sha256: str = Field("", max_length=64, description="of all other values")
    healthy: StoredState
    constrained: StoredState | None = None

    def state(self, constrained: bool) -> StoredState | None:
        return self.constrained if constrained else self.healthy

    def maps(self) -> dict[str, CursorMap] | None:
        if self.constrained is None:
            return None
        return {a: normalise(self.healthy.axis(a), self.constrained.axis(a)) for a in AXES}

    def digest(self) -> str:
        content = self.model_dump(mode="json", by_alias=True, exclude={"sha256"})
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def text(self) -> str:
        content = self.model_dump(mode="json", by_alias=True, exclude_none=True)
        mark = "SIMULATED: " if self.simulated else ""
        lines = [f"# {mark}calibration of a wrist by esea-host wrist."]
        for name, value in content.items():
            lines += _table(name, value) if isinstance(value, dict) else [_line(name, value)]
        return "\n".join(lines) + "\n"


def _line(name: str, value: Any) -> str:
    return f"{name} = {json.dumps(value, ensure_ascii=False)}"


def _table(name: str, content: Mapping[str, Any]) -> list[str]:
    lines = ["", f"[{name}]"]
    lines += [_line(k, v) for k, v in content.items() if not isinstance(v, dict)]
    for k, v in content.items():
        lines += _table(f"{name}.{k}", v) if isinstance(v, dict) else []
    return lines


def calibration_of(
    past: Sequence[Mapping[str, Any]], device: str, content_hash: str, simulated: bool
) -> WristCalibration:
    healthy, constrained = calibrated(past, False), calibrated(past, True)
    if constrained.complete:
        constrained = replace(constrained, ends=_within(constrained, healthy))
    made = WristCalibration(
        made=datetime.now(UTC).isoformat(timespec="seconds"),
        device=device,
        content_hash=content_hash,
        simulated=simulated,
        healthy=_state("healthy", healthy),
        constrained=_state("constrained", constrained) if constrained.complete else None,
    )
    made.maps()
    return made.model_copy(update={"sha256": made.digest()})


def _within(constrained: Calibrated, healthy: Calibrated) -> dict[str, tuple[float, float]]:
    # An axis that the constraint leaves free may come out a little wider than healthy.
    ends = {}
    for axis in AXES:
        (low, high), (a, b) = constrained.range_of(axis), healthy.range_of(axis)
        middle, half = (low + high) / 2, min(high - low, b - a) / 2
        ends[axis] = middle - half, middle + half
    return ends


def _state(name: str, found: Calibrated) -> StoredState:
    axes = {}
    for axis in AXES:
        axes[axis] = found.speeds(axis)
        check_nodes(f"{name} {axis}", axes[axis])
    fe, ru = found.neutral
    return StoredState(neutral_fe_deg=fe, neutral_ru_deg=ru, **axes)


def save_calibration(path: Path, calibration: WristCalibration) -> Path:
    """Write a calibration file, completely or not at all."""
    names = (path.with_stem(f"{path.stem}-{n}") for n in count(2))
    free = next(p for p in chain([path], names) if not p.exists())
    write_whole(free, calibration.text())
    return free


def load_calibration(path: Path) -> WristCalibration:
    data = read_whole(path, MAKE, MOST_BYTES)
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise UserError(f"{path}: cannot be read as text ({error}).", MAKE) from None
    document = parse_toml(text, str(path), SEE)
    found = checked(WristCalibration, document, str(path), lambda _: MAKE, text)
    if found.digest() != found.sha256:
        raise UserError(
            f"{path}: the values do not match the file's sha256: it was edited or damaged.", MAKE
        )
    try:
        for name, state in (("healthy", found.healthy), ("constrained", found.constrained)):
            if state is not None:
                for axis in AXES:
                    _check_axis(f"{name}.{axis}", state.axis(axis))
        found.maps()
    except UserError as error:
        raise UserError(f"{path}: {error.what}", MAKE) from None
    return found


def _check_axis(where: str, axis: NodeSpeeds) -> None:
    # What the fit takes for granted.
    if not axis.low_deg < axis.high_deg:
        raise UserError(f"{where}: low_deg is not below high_deg.", "")
    if [*axis.nodes_deg] != node_places(axis.low_deg, axis.high_deg):
        raise UserError(f"{where}: nodes_deg are not the nodes of its range.", "")
    if len(axis.nodes_deg) != len(axis.speeds_deg_s):
        raise UserError(f"{where}: nodes_deg and speeds_deg_s differ in number.", "")
    check_nodes(where, axis)
