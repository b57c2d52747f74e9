"""Mapping file: what the columns of a recording mean.

A recording comes as its rig wrote it: in centimetres and tons, in a foreign encoding, without a
time column.  The mapping file (TOML) says which columns hold deflection, torque and time, in what
units, by what scale they become radians and newton-metres, how they were sampled, and which cycles
train the model, which are held out and which are conditioning.  Every number that is a choice is
marked ``assumed`` and appears as such in the device file.
"""

from __future__ import annotations

import difflib
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from esea_gen.devices.numbers import Quantity
from esea_gen.errors import UserError
from esea_gen.toml_file import Problem, checked, parse_toml, read_text, table_type

LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
ANGLE = {"rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295}
FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "tonf": 9806.65, "lbf": 4.4482216152605}
TORQUE = {"Nm": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}

Use = Literal["cycles", "train", "held_out"]


def _assumed(value: float, why: str) -> Quantity:
    return Quantity(value=value, status="assumed", source=why)


def _limits(low: float, high: float, text: str, **more: Any) -> Any:
    return Field(description=text, json_schema_extra={"low": low, "high": high}, **more)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class DeviceTable(_Table):
    """The device file to write."""

    name: str = Field(
        pattern=r"^[a-z][a-z0-9_]{0,14}$",
        description="Name of the device: a lower case letter, then at most 14 of a-z, 0-9 and _.",
    )
    title: str = Field(min_length=1, description="One line for reports.")
    rate_terms: bool = Field(description="Whether to identify the Maxwell element; needs time.")
    stops: Quantity = _limits(
        1, 32, "Number of stop operators.", default=_assumed(10, "default: as many as published")
    )
    sense_rate_Hz: Quantity = _limits(
        50, 10000, "Rate of the sensing task.", default=_assumed(1000.0, "default of identify")
    )
    bandwidth_Hz: Quantity = _limits(
        2, 100, "Bandwidth of the velocity estimate.", default=_assumed(15.0, "default of identify")
    )
    resolution_bits: Quantity = _limits(
        8, 24, "Encoder counts per turn.", default=_assumed(14, "default of identify")
    )
    limit_factor: float = Field(
        default=1.5, ge=1.0, le=10.0, description="Ports' physical ranges over the identified ones."
    )


class Deflection(_Table):
    """Column of the deflection."""

    column: str = Field(min_length=1, description="Column or variable name.")
    unit: str = Field(description="Unit of the recorded number.")
    sign: Literal[-1, 1] = Field(default=1, description="-1 turns the recording's direction round.")
    scale_rad_per_m: Quantity | None = _limits(
        1e-6, 1e6, "Radians of coupling per metre of specimen (lengths only).", default=None
    )
    zero: Literal["none", "first", "mean", "middle"] = Field(
        default="none", description="What is subtracted: nothing, first value, mean, or mid-range."
    )


class Torque(_Table):
    """Column of the torque."""

    column: str = Field(min_length=1, description="Column or variable name.")
    unit: str = Field(description="Unit of the recorded number.")
    sign: Literal[-1, 1, "fit"] = Field(
        default=1,
        description="-1 turns the recording's direction round; fit: where the stiffness wants it.",
    )
    lag_s: Quantity | None = _limits(
        -1.0, 1.0, "By how much the torque was recorded later than the deflection.", default=None
    )
    scale_Nm_per_N: Quantity | None = _limits(
        1e-9, 1e6, "Newton-metres of coupling per newton on the specimen (forces only).",
        default=None,
    )  # fmt: skip
    zero: Literal["none", "first", "mean", "middle"] = Field(
        default="none", description="What is subtracted: nothing, first value, mean, or mid-range."
    )


class Sampling(_Table):
    """Time: a column, or a nominal period."""

    time_column: str | None = Field(default=None, description="Column or variable of time.")
    time_unit: str = Field(default="s", description="Unit of that column.")
    period_s: Quantity | None = _limits(
        1e-6, 100, "Sampling period, where there is no time column.", default=None
    )
    min_step_s: float | None = Field(
        default=None,
        gt=0,
        le=10,
        description="Glitch rule: a sample less than this after the last kept one is dropped, "
        "counted and reported.",
    )
    fit_rate_Hz: float | None = Field(
        default=None,
        ge=50,
        le=10000,
        description="Rate of the search (the result is refined and judged at the device's rate).",
    )


class Cycles(_Table):
    """Which cycles condition, train and judge, in every block of equal amplitude."""

    skip_first: int = Field(default=1, ge=0, le=1000, description="Conditioning cycles per block.")
    hold_out: str | None = Field(
        default=None,
        min_length=1,
        description="Condition that judges as a whole: a [[condition]], a block of equal "
        "amplitude or a file. Where there are three or more, and neither this nor hold_out_last "
        "is given, the one of middle amplitude.",
    )
    hold_out_last: int | None = Field(
        default=None, ge=1, le=1000, description="Held-out cycles per block, 1 where it counts."
    )
    hysteresis: float = Field(
        default=0.05, gt=0, lt=0.5, description="Reversal threshold over the deflection's range."
    )
    block_tolerance: float = Field(
        default=0.1, gt=0, lt=1, description="Amplitude change that starts a new block."
    )

    @property
    def held_out_last(self) -> int:
        """Last cycles of each block that judge, where no whole condition does."""
        return 1 if self.hold_out_last is None else self.hold_out_last


class Search(_Table):
    """The search for parameters; the same numbers give the same result."""

    seed: int = Field(default=20240229, ge=0, description="Seed of the starting population.")
    population: int | None = Field(
        default=None, ge=16, le=65536, description="Starting population, a power of two."
    )


class FileFormat(_Table):
    """How a file is written."""

    kind: Literal["csv", "mat", "hdf5", "parquet", "json"] = Field(
        default="csv",
        description="csv: text table; mat: MATLAB; json: columns by name, or a list of rows.",
    )
    delimiter: str = Field(default=",", min_length=1, max_length=1, description="Between cells.")
    quote: str = Field(default='"', min_length=1, max_length=1, description="Round a cell.")
    decimal: Literal[".", ","] = Field(default=".", description="Decimal mark.")
    encoding: str = Field(default="utf-8", description="Text encoding, such as gb18030.")
    header_line: int = Field(
        default=1, ge=0, le=1000, description="Line with the column names; 0: none, named 1, 2, ..."
    )
    first_data_line: int | None = Field(
        default=None, ge=1, le=1000, description="First line of numbers; the one after the header."
    )


class RecordingTable(_Table):
    """One or several files of one kind."""

    files: list[str] = Field(min_length=1, description="Paths or patterns, relative to the folder.")
    use: Use = Field(
        default="cycles",
        description="cycles: by the rules of [cycles]; train or held_out: the whole file.",
    )
    label: str | None = Field(default=None, description="Name in reports; the file's by default.")
    format: FileFormat | None = Field(default=None, description="Where it differs from [format].")


class ConditionTable(_Table):
    """What several files have in common: a rate, an amplitude, a specimen."""

    name: str = Field(min_length=1, description="Name in reports.")
    files: list[str] = Field(min_length=1, description="Names or patterns, as in [[recording]].")


class Mapping(_Table):
    """A mapping file, as written."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this format.")
    device: DeviceTable
    deflection: Deflection
    torque: Torque
    sampling: Sampling
    cycles: Cycles = Field(default=Cycles())
    search: Search = Field(default=Search())
    format: FileFormat = Field(default=FileFormat())
    full_scale_Nm: Quantity | None = _limits(
        1e-3, 1000, "100 % of errors; the largest recorded |torque| by default.", default=None
    )
    recording: list[RecordingTable] = Field(min_length=1)
    condition: list[ConditionTable] = Field(
        default=[], description="What a comparison of models leaves out as a whole."
    )


@dataclass(frozen=True)
class MappingFile:
    """A validated mapping with its origin.

    Parameters
    ----------
    mapping : Mapping
        Content.
    origin : str
        File name, for messages.
    folder : Path
        Folder that the recordings' paths are relative to.
    """

    mapping: Mapping
    origin: str
    folder: Path

    @property
    def rad_per_unit(self) -> float:
        """Radians per recorded number, sign included."""
        d = self.mapping.deflection
        si = {**LENGTH, **ANGLE}[d.unit]
        return d.sign * si * (d.scale_rad_per_m.value if d.scale_rad_per_m else 1.0)

    @property
    def Nm_per_unit(self) -> float:
        """Newton-metres per recorded number, sign included."""
        t = self.mapping.torque
        si = {**FORCE, **TORQUE}[t.unit]
        sign = 1 if t.sign == "fit" else t.sign
        return sign * si * (t.scale_Nm_per_N.value if t.scale_Nm_per_N else 1.0)

    def paths(self) -> Iterator[tuple[Path, str, RecordingTable]]:
        """Every file as (path, name as given, its table), patterns expanded and sorted.

        Yields
        ------
        tuple
            Path, name relative to the folder, table.

        Raises
        ------
        UserError
            When a file is missing, a pattern matches nothing, or a file is named twice.
        """
        seen: set[Path] = set()
        for i, table in enumerate(self.mapping.recording):
            for name in table.files:
                pattern = any(c in name for c in "*?[")
                found = sorted(self.folder.glob(name)) if pattern else [self.folder / name]
                found = [p for p in found if p.is_file()]
                if not found:
                    what = "matches no file" if pattern else "does not exist"
                    raise UserError(
                        f"{self.origin}: recording[{i}].files: '{name}' {what} in '{self.folder}'.",
                        _suggest(name, _neighbours(self.folder / name))
                        + "Correct the path, or give the folder of the data with --data.",
                    )
                for path in found:
                    if path in seen:
                        raise UserError(
                            f"{self.origin}: recording[{i}].files names '{path.name}' a second "
                            "time: it would count twice.",
                            "Name every file once.",
                        )
                    seen.add(path)
                    yield path, path.relative_to(self.folder).as_posix() if pattern else name, table


def _neighbours(path: Path) -> list[str]:
    try:
        return sorted(p.name for p in path.parent.iterdir())
    except OSError:
        return []


def _suggest(name: str, known: list[str]) -> str:
    close = difflib.get_close_matches(Path(name).name, known, n=1)
    return f"Did you mean {close[0]}? " if close else ""


def load_mapping(path: str | Path, data_folder: str | Path | None = None) -> MappingFile:
    """Read and validate a mapping file.

    Parameters
    ----------
    path : str or Path
        The TOML file.
    data_folder : str or Path, optional
        Folder of the recordings; the mapping file's own when not given.

    Returns
    -------
    MappingFile
        Validated.

    Raises
    ------
    UserError
        When the file is missing or not TOML, or a key, unit, value or relation is wrong; the
        message names file, key, value, limit and fix.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError(
            f"There is no mapping file '{path}'.",
            _suggest(path.name, _neighbours(path)) + "Give the path of a TOML file.",
        )
    folder = Path(data_folder) if data_folder is not None else path.parent
    if not folder.is_dir():
        raise UserError(f"There is no data folder '{folder}'.", "Give an existing folder.")
    text = read_text(path, "Save it as UTF-8.")
    return MappingFile(parse_mapping(text, path.name), path.name, folder)


def parse_mapping(text: str, origin: str) -> Mapping:
    """Validate the text of a mapping file.

    Parameters
    ----------
    text : str
        TOML.
    origin : str
        File name for messages.

    Returns
    -------
    Mapping
        Validated.

    Raises
    ------
    UserError
        As :func:`load_mapping`.
    """
    document = parse_toml(text, origin, "docs/identify.md")
    mapping = checked(Mapping, document, origin, _fix, text)
    for key, q, extra in _quantities(mapping):
        if not extra["low"] <= q.value <= extra["high"]:
            below = q.value < extra["low"]
            raise UserError(
                f"{origin}: {key} = {q.value:g} is {'below' if below else 'above'} its limit "
                f"{extra['low'] if below else extra['high']:g} ({extra['text']})",
                f"Give a value from {extra['low']:g} to {extra['high']:g}.",
            )
    _check_units(origin, mapping)
    _check_sampling(origin, mapping)
    _check_text(origin, mapping)
    return mapping


def _quantities(
    table: BaseModel, prefix: str = ""
) -> Iterator[tuple[str, Quantity, dict[str, Any]]]:
    for key, field in type(table).model_fields.items():
        value = getattr(table, key)
        if isinstance(value, Quantity):
            extra = typing.cast(dict[str, Any], field.json_schema_extra)
            yield prefix + key, value, {**extra, "text": field.description}
        elif isinstance(value, BaseModel):
            yield from _quantities(value, f"{prefix}{key}.")


def _check_units(origin: str, mapping: Mapping) -> None:
    d, t, s = mapping.deflection, mapping.torque, mapping.sampling
    for key, unit, direct, scaled, scale, scale_key, form in (
        ("deflection", d.unit, ANGLE, LENGTH, d.scale_rad_per_m, "scale_rad_per_m", "an angle"),
        ("torque", t.unit, TORQUE, FORCE, t.scale_Nm_per_N, "scale_Nm_per_N", "a torque"),
    ):
        if unit not in direct and unit not in scaled:
            raise UserError(
                f"{origin}: {key}.unit = '{unit}' is not a unit of {key}.",
                f"Known: {', '.join(direct)} and {', '.join(scaled)}.",
            )
        if unit in scaled and scale is None:
            raise UserError(
                f"{origin}: key {key}.{scale_key} is missing: the unit '{unit}' is not {form}.",
                f'Write {scale_key} = {{ value = 1.0, status = "assumed", source = "why" }}.',
            )
        if unit in direct and scale is not None:
            raise UserError(
                f"{origin}: {key}.{scale_key} = {scale.value:g} has no meaning: the unit '{unit}' "
                f"is {form} already.",
                "Take it out.",
            )
    if s.time_unit not in TIME:
        raise UserError(
            f"{origin}: sampling.time_unit = '{s.time_unit}' is not a unit of time.",
            f"Known: {', '.join(TIME)}.",
        )
    columns = [d.column, t.column] + ([s.time_column] if s.time_column else [])
    twice = sorted({c for c in columns if columns.count(c) > 1})
    if twice:
        raise UserError(
            f"{origin}: column '{twice[0]}' is named twice, for different quantities.",
            "Deflection, torque and time are three columns.",
        )


def _check_sampling(origin: str, mapping: Mapping) -> None:
    s = mapping.sampling
    if (s.time_column is None) == (s.period_s is None):
        raise UserError(
            f"{origin}: [sampling] has {'both' if s.period_s else 'neither'} time_column and "
            "period_s.",
            "Give time_column; or, where no time was recorded, period_s = { value = 0.01, "
            'status = "assumed", source = "why" }.',
        )
    if s.min_step_s is not None and s.time_column is None:
        raise UserError(
            f"{origin}: sampling.min_step_s = {s.min_step_s:g} needs a time column.", "Take it out."
        )
    rate, bandwidth = mapping.device.sense_rate_Hz.value, mapping.device.bandwidth_Hz.value
    if s.fit_rate_Hz is not None and s.fit_rate_Hz > rate:
        raise UserError(
            f"{origin}: sampling.fit_rate_Hz = {s.fit_rate_Hz:g} Hz is above its limit, "
            f"device.sense_rate_Hz = {rate:g} Hz.",
            "Lower it, or leave it out.",
        )
    if bandwidth > 0.1 * rate:
        raise UserError(
            f"{origin}: device.bandwidth_Hz = {bandwidth:g} Hz is above its limit, a tenth of "
            f"device.sense_rate_Hz ({0.1 * rate:g} Hz).",
            "Lower the bandwidth or raise the rate.",
        )


def _check_text(origin: str, mapping: Mapping) -> None:
    size = mapping.search.population
    if size is not None and size & (size - 1):
        raise UserError(
            f"{origin}: search.population = {size} is not a power of two.",
            f"Give {1 << size.bit_length()}, for example.",
        )
    formats = [("format", mapping.format)]
    formats += [
        (f"recording[{i}].format", r.format) for i, r in enumerate(mapping.recording) if r.format
    ]
    for key, f in formats:
        try:
            # Codecs that are no text encodings (base64) fail only when they are used.
            "a".encode(f.encoding)
        except LookupError:
            raise UserError(
                f"{origin}: {key}.encoding = '{f.encoding}' is not a known text encoding.",
                "Try utf-8, latin-1, utf-16 or gb18030.",
            ) from None
        if f.first_data_line is not None and f.first_data_line <= f.header_line:
            raise UserError(
                f"{origin}: {key}.first_data_line = {f.first_data_line} is not below the header "
                f"(header_line = {f.header_line}).",
                f"Give {f.header_line + 1} or more, or leave it out.",
            )
    if all(r.use == "train" for r in mapping.recording):
        raise UserError(
            f"{origin}: every recording has use = 'train': nothing is held out to judge the fit.",
            "Set use = 'held_out' for one, or use = 'cycles' to hold out the last cycles.",
        )
    if all(r.use == "held_out" for r in mapping.recording):
        raise UserError(
            f"{origin}: every recording has use = 'held_out': nothing is left to fit.",
            "Set use = 'train' or 'cycles' for one.",
        )


def _fix(problem: Problem) -> str:
    if Quantity in (problem.within, table_type(problem.wanted)):
        return 'Write { value = 1.0, status = "assumed", source = "why" }.'
    if problem.kind == "missing":
        return "Add it; see docs/identify.md."
    return problem.text or "Correct it; see docs/identify.md."
