"""Mapping file: what the columns of a recording mean.

A recording comes as its rig wrote it: in centimetres and tons, in a foreign encoding, without a
time column.  The mapping file (TOML) says which columns hold deflection, torque and time, in what
units, by what scale they become radians and newton-metres, how they were sampled, and which cycles
train the model, which are held out and which are conditioning.  Every number that is a choice is
marked ``assumed`` and appears as such in the device file.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from collections.abc import Mapping as Numbers
from dataclasses import dataclass, replace
from pathlib import Path

from esea_gen.devices.numbers import Quantity, beyond, numbers_of
from esea_gen.errors import UserError
from esea_gen.identify.recording.tables import (
    ANGLE,
    BANDWIDTH_SHARE,
    FORCE,
    LENGTH,
    TIME,
    TORQUE,
    Mapping,
    RecordingTable,
)
from esea_gen.toml_file import Problem, checked, parse_toml, read_text, table_type

# What says how the channels lie to each other, and may be left to the fit.
FITTABLE = ("torque.lag_s", "deflection.backlash_rad", "deflection.dead_zone_rad")


@dataclass(frozen=True)
class MappingFile:
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

    def fittable(self) -> dict[str, Quantity | None]:
        found = {}
        for name in FITTABLE:
            table, key = name.split(".")
            found[name] = getattr(getattr(self.mapping, table), key)
        return found

    def settled(self, numbers: Numbers[str, Quantity | None]) -> MappingFile:
        mapping = self.mapping
        for name, q in numbers.items():
            table, key = name.split(".")
            changed = getattr(mapping, table).model_copy(update={key: q})
            mapping = mapping.model_copy(update={table: changed})
        return replace(self, mapping=mapping)

    def paths(self) -> Iterator[tuple[Path, str, RecordingTable]]:
        """Every file as (path, name as given, its table), patterns expanded and sorted."""
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
    document = parse_toml(text, origin, "docs/identify.md")
    mapping = checked(Mapping, document, origin, _fix, text)
    for key, q, facts in numbers_of(mapping):
        assert isinstance(q, Quantity)
        problem = beyond(key, q.value, facts)
        if problem is not None:
            raise UserError(f"{origin}: {problem.what}", problem.fix)
    _check_units(origin, mapping)
    _check_sampling(origin, mapping)
    _check_temperature(origin, mapping)
    _check_text(origin, mapping)
    return mapping


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
    more = [s.time_column, mapping.temperature and mapping.temperature.column]
    columns = [d.column, t.column, *(c for c in more if c)]
    twice = sorted({c for c in columns if columns.count(c) > 1})
    if twice:
        raise UserError(
            f"{origin}: column '{twice[0]}' is named twice, for different quantities.",
            "Each of them has a column of its own.",
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
    rate, bandwidth = mapping.device.sense_rate_Hz.value, mapping.device.bandwidth.value
    if s.fit_rate_Hz is not None and s.fit_rate_Hz > rate:
        raise UserError(
            f"{origin}: sampling.fit_rate_Hz = {s.fit_rate_Hz:g} Hz is above its limit, "
            f"device.sense_rate_Hz = {rate:g} Hz.",
            "Lower it, or leave it out.",
        )
    if bandwidth > BANDWIDTH_SHARE * rate:
        raise UserError(
            f"{origin}: device.bandwidth_Hz = {bandwidth:g} Hz is above its limit, a tenth of "
            f"device.sense_rate_Hz ({BANDWIDTH_SHARE * rate:g} Hz).",
            "Lower the bandwidth or raise the rate.",
        )


def _check_temperature(origin: str, mapping: Mapping) -> None:
    given = [r.temperature_C is not None for r in mapping.recording]
    if any(given) and mapping.temperature is not None:
        raise UserError(
            f"{origin}: recording[{given.index(True)}].temperature_C and [temperature] are both "
            "given.",
            "Take one of them out.",
        )
    if any(given) and not all(given):
        raise UserError(
            f"{origin}: key recording[{given.index(False)}].temperature_C is missing: other "
            "recordings have one.",
            "Give every recording's, or none: one that is not known cannot be told from another.",
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
        header = 1 if f.header_line is None else f.header_line
        if f.first_data_line is not None and f.first_data_line <= header:
            raise UserError(
                f"{origin}: {key}.first_data_line = {f.first_data_line} is not below the header "
                f"(header_line = {header}).",
                f"Give {header + 1} or more, or leave it out.",
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
        fit = ' or "fit"' if problem.key in FITTABLE else ""
        return f'Write {{ value = 1.0, status = "assumed", source = "why" }}{fit}.'
    if problem.kind == "missing":
        return "Add it; see docs/identify.md."
    return problem.text or "Correct it; see docs/identify.md."
