"""Calibration file: results of a wrist calibration, with its hash."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import chain, count
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from esea_gen.errors import UserError
from esea_gen.files import read_whole, write_whole
from esea_gen.toml_file import checked, parse_toml
from esea_host.wrist.calibration import AXES, Calibrated, calibrated
from esea_host.wrist.normalisation import (
    Angle_deg,
    CursorMap,
    NodeSpeeds,
    check_nodes,
    node_places,
    normalise,
)

SEE = "docs/wrist-display.md"
MAKE = "Give a file that esea-host wrist saved, or calibrate again."
MOST_BYTES = 1 << 20


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class StoredState(_Table):
    neutral_fe_deg: Angle_deg
    neutral_ru_deg: Angle_deg
    FE: NodeSpeeds
    RU: NodeSpeeds

    @property
    def neutral_deg(self) -> tuple[float, float]:
        return self.neutral_fe_deg, self.neutral_ru_deg

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
