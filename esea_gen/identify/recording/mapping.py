"""Mapping file: the meaning of a recording's columns.

A recording comes as its rig wrote it: in centimetres and tons, in a foreign encoding, without a
time column.  The mapping file (TOML) says which columns hold deflection, torque and time, in what
units, by what scale they become radians and newton-metres, how they were sampled, and which cycles
train the model, which are held out and which are conditioning.  Every number that is a choice is
marked ``assumed`` and appears as such in the device file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterator
from collections.abc import Mapping as Numbers
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from esea_gen.devices.numbers import Quantity, beyond, numbers_of
from esea_gen.errors import UserError, nearest
from esea_gen.identify.recording.tables import (
    ANGLE,
    BANDWIDTH_SHARE,
    FORCE,
    LENGTH,
    TIME,
    TORQUE,
    VOLTAGE,
    Mapping,
    RecordingTable,
)
from esea_gen.toml_file import Located, Problem, judged, parse_toml, read_text, table_type, together

RECORDINGS = (".csv", ".txt", ".tsv", ".dat", ".mat", ".h5", ".hdf5", ".parquet", ".json")
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
        cell = t.sensitivity_mV_per_N
        si = {**FORCE, **TORQUE}.get(t.unit) or VOLTAGE[t.unit] / (cell.value if cell else 1.0)
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

    def paths(self) -> list[tuple[Path, str, RecordingTable]]:
        """Every file as (path, name as given, its table), patterns expanded and sorted."""
        seen: set[Path] = set()
        missing: list[Located] = []
        given: list[tuple[Path, str, RecordingTable]] = []
        for i, table in enumerate(self.mapping.recording):
            for name in table.files:
                pattern = any(c in name for c in "*?[") and not (self.folder / name).is_file()
                found = sorted(self.folder.glob(name)) if pattern else [self.folder / name]
                found = [p for p in found if p.is_file()]
                if not found:
                    what = "matches no file" if pattern else "does not exist"
                    error = UserError(
                        f"recording[{i}].files: '{name}' {what} in '{self.folder}'.",
                        nearest(Path(name).name, _neighbours(self.folder / name))
                        + "Correct the path, or give the folder of the data with --data.",
                    )
                    missing.append(((), error))
                for path in found:
                    if path in seen:
                        raise UserError(
                            f"{self.origin}: recording[{i}].files names '{path.name}' a second "
                            "time: it would count twice.",
                            "Name every file once.",
                        )
                    seen.add(path)
                    shown = path.relative_to(self.folder).as_posix() if pattern else name
                    given.append((path, shown, table))
        together(missing, self.origin, "")
        return given


def _neighbours(path: Path) -> list[str]:
    try:
        return sorted(p.name for p in path.parent.iterdir())
    except OSError:
        return []


def load_mapping(path: str | Path, data_folder: str | Path | None = None) -> MappingFile:
    path = Path(path)
    if path.suffix.lower() in RECORDINGS and path.is_file():
        raise UserError(
            f"'{path}' is a recording, not a mapping file.",
            f"Let esea-gen identify {path} propose its mapping, then give that.",
        )
    if path.is_dir():
        raise UserError(f"'{path}' is a folder.", "Give the path of a TOML file.")
    if not path.is_file():
        raise UserError(
            f"There is no mapping file '{path}'.",
            nearest(path.name, _neighbours(path)) + "Give a TOML file or a recording.",
        )
    folder = Path(data_folder) if data_folder is not None else path.parent
    if not folder.is_dir():
        raise UserError(f"There is no data folder '{folder}'.", "Give an existing folder.")
    text = read_text(path, "Save it as UTF-8.")
    return MappingFile(parse_mapping(text, path.name), path.name, folder)


def parse_mapping(text: str, origin: str) -> Mapping:
    document = parse_toml(text, origin, "docs/identify.md")
    mapping, problems = judged(Mapping, document, _fix)
    wrong = {tuple(loc[:2]) for loc, _ in problems}
    found = mapping or _sound_tables(document, wrong)
    for key, q, facts in numbers_of(found):
        assert isinstance(q, Quantity)
        if problem := beyond(key, q.value, facts):
            problems.append(_wrong(key, problem.what, problem.fix))
    for check in (_units, _columns, _sampling, _temperatures, _text):
        for loc, error in check(found):
            # A wrong key was left out; that it is missing is no second problem.
            if not any((loc[0], word) in wrong for word in re.findall(r"\w+", error.what)):
                problems.append((loc, error))
    together(problems, origin, text)
    assert isinstance(mapping, Mapping)
    return mapping


def _sound_tables(document: dict[str, Any], wrong: Container[tuple[str | int, ...]]) -> Any:
    # Of a mapping with errors, so that contradictions are reported with them: without its wrong
    # keys; a table that is then incomplete, or missing, is None.
    found: dict[str, Any] = {}
    for name, field in Mapping.model_fields.items():
        key, kind = field.alias or name, cast("type[Any]", field.annotation)
        found[name] = None if field.is_required() else field.get_default()
        if key in document:
            table = document[key]
            if isinstance(table, dict):
                table = {k: v for k, v in table.items() if (key, k) not in wrong}
            found[name] = judged(kind, table, _fix)[0]
    return Mapping.model_construct(**found)


def _wrong(key: str, what: str, fix: str) -> Located:
    return re.findall(r"\w+", key), UserError(what, fix)


def _units(m: Any) -> Iterator[Located]:
    # Per table: which units are a quantity of what kind, and the scales that such a unit needs.
    lever = "scale_Nm_per_N"
    kinds: dict[str, list[tuple[dict[str, float], str, tuple[str, ...]]]] = {
        "deflection": [(ANGLE, "an angle", ()), (LENGTH, "a length", ("scale_rad_per_m",))],
        "torque": [
            (TORQUE, "a torque", ()),
            (FORCE, "a force", (lever,)),
            (VOLTAGE, "a voltage", (lever, "sensitivity_mV_per_N")),
        ],
    }
    for name, forms in kinds.items():
        table = getattr(m, name)
        if table is None:
            continue
        form = next((f for f in forms if table.unit in f[0]), None)
        if form is None:
            yield _wrong(
                f"{name}.unit",
                f"{name}.unit = '{table.unit}' is not a unit of {name}.",
                f"Known: {' and '.join(', '.join(f[0]) for f in forms)}.",
            )
            continue
        _, kind, needed = form
        for key in forms[-1][2]:
            scale = getattr(table, key)
            if key in needed and scale is None:
                yield _wrong(
                    name,
                    f"key {name}.{key} is missing: the unit '{table.unit}' is not {forms[0][1]}.",
                    f'Write {key} = {{ value = 1.0, status = "assumed", source = "why" }}.',
                )
            elif key not in needed and scale is not None:
                yield _wrong(
                    f"{name}.{key}",
                    f"{name}.{key} = {scale.value:g} has no meaning: the unit '{table.unit}' is "
                    f"{kind} already.",
                    "Remove it.",
                )


def _columns(m: Any) -> Iterator[Located]:
    tables = ("deflection", "torque", "temperature")
    keys = [*((t, "column") for t in tables), ("sampling", "time_column")]
    named = [c for table, key in keys if (c := getattr(getattr(m, table), key, None))]
    for twice in sorted({c for c in named if named.count(c) > 1}):
        yield _wrong(
            "torque.column",
            f"column '{twice}' is named twice, for different quantities.",
            "Give each quantity its own column.",
        )


def _sampling(m: Any) -> Iterator[Located]:
    s, device = m.sampling, m.device
    rate = device.sense_rate_Hz.value if device else math.inf
    if device and device.bandwidth.value > BANDWIDTH_SHARE * rate:
        yield _wrong(
            "device.bandwidth_Hz",
            f"device.bandwidth_Hz = {device.bandwidth.value:g} Hz is above its limit, a tenth of "
            f"device.sense_rate_Hz ({BANDWIDTH_SHARE * rate:g} Hz).",
            "Lower the bandwidth or raise the rate.",
        )
    if s is None:
        return
    if s.time_unit not in TIME:
        yield _wrong(
            "sampling.time_unit",
            f"sampling.time_unit = '{s.time_unit}' is not a unit of time.",
            f"Known: {', '.join(TIME)}.",
        )
    if (s.time_column is None) == (s.period_s is None):
        yield _wrong(
            "sampling",
            f"[sampling] has {'both' if s.period_s else 'neither'} time_column and period_s.",
            "Give time_column; or, where no time was recorded, period_s = { value = 0.01, "
            'status = "assumed", source = "why" }.',
        )
    if s.min_step_s is not None and s.time_column is None:
        yield _wrong(
            "sampling.min_step_s",
            f"sampling.min_step_s = {s.min_step_s:g} needs a time column.",
            "Remove it.",
        )
    if s.fit_rate_Hz is not None and s.fit_rate_Hz > rate:
        yield _wrong(
            "sampling.fit_rate_Hz",
            f"sampling.fit_rate_Hz = {s.fit_rate_Hz:g} Hz is above its limit, "
            f"device.sense_rate_Hz = {rate:g} Hz.",
            "Lower it, or leave it out.",
        )


def _temperatures(m: Any) -> Iterator[Located]:
    given = [r.temperature_C is not None for r in m.recording or ()]
    if any(given) and m.temperature is not None:
        key = f"recording[{given.index(True)}].temperature_C"
        yield _wrong(key, f"{key} and [temperature] are both given.", "Take one of them out.")
    if any(given) and not all(given):
        key = f"recording[{given.index(False)}].temperature_C"
        yield _wrong(
            key,
            f"key {key} is missing: other recordings have one.",
            "Give it for every recording or for no recording.",
        )


def _text(m: Any) -> Iterator[Located]:
    size = m.search and m.search.population
    if size and size & (size - 1):
        yield _wrong(
            "search.population",
            f"search.population = {size} is not a power of two.",
            f"Give {1 << size.bit_length()}, for example.",
        )
    formats = [("format", m.format)]
    formats += [(f"recording[{i}].format", r.format) for i, r in enumerate(m.recording or ())]
    for key, f in formats:
        header = 1 if f is None or f.header_line is None else f.header_line
        if f is not None and f.first_data_line is not None and f.first_data_line <= header:
            yield _wrong(
                f"{key}.first_data_line",
                f"{key}.first_data_line = {f.first_data_line} is not below the header "
                f"(header_line = {header}).",
                f"Give {header + 1} or more, or leave it out.",
            )
    uses = {r.use for r in m.recording or ()}
    if uses == {"train"}:
        yield _wrong(
            "recording[0].use",
            "every recording has use = 'train': nothing is held out to judge the fit.",
            "Set use = 'held_out' for one, or use = 'cycles' to hold out the last cycles.",
        )
    if uses == {"held_out"}:
        yield _wrong(
            "recording[0].use",
            "every recording has use = 'held_out': nothing is left to fit.",
            "Set use = 'train' or 'cycles' for one.",
        )


def _fix(problem: Problem) -> str:
    if Quantity in (problem.within, table_type(problem.wanted)):
        fit = ' or "fit"' if problem.key in FITTABLE else ""
        return f'Write {{ value = 1.0, status = "assumed", source = "why" }}{fit}.'
    if problem.kind == "missing":
        return "Add it; see docs/identify.md."
    return problem.text or "Correct it; see docs/identify.md."
