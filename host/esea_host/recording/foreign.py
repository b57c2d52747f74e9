"""Logs of other machines, read by a mapping file; faults are reported, not corrected.

A mapping is TOML: meaning, unit and factor of each column, marks of broken values, time base.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from esea_gen.errors import UserError
from esea_gen.files import new_whole
from esea_gen.tables import FileTable, TableFormat, read_table
from esea_gen.toml_file import checked, parse_toml, read_text
from esea_host.recording.integrity import Gap
from esea_host.recording.layout import Array, StreamColumn, StreamLayout
from esea_host.recording.writer import Recorder

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
ROW = "sequence"
EVENTS = ("import", "gap", "note", "clock")  # other topics of a recording
MOST_NS = 366 * 86400 * 10**9


Name = Annotated[str, Field(pattern=r"^[A-Za-z_]\w*$", max_length=100)]


class ForeignColumn(BaseModel):
    model_config = _STRICT
    source: str | int  # its header, or its number from 0
    name: Name  # ours, with the unit at its end
    unit: str = ""
    meaning: str = ""
    scale: float = 1.0
    offset: float = 0.0
    wraps_at: float | None = None  # raw values from half of this on are this much less
    broken: list[float] = []  # raw values that mean that nothing was measured


class ForeignTime(BaseModel):
    model_config = _STRICT
    source: str | int | None = None  # column of the time; without it period_s counts
    scale: Annotated[float, Field(gt=0)] = 1.0  # seconds of its unit
    period_s: Annotated[float, Field(ge=1e-9, le=86400)]  # distance of two samples
    tolerance: Annotated[float, Field(gt=0, lt=10)] = 0.5


class ForeignMapping(BaseModel):
    model_config = _STRICT
    stream: Name = "foreign"  # name of the stream that is made
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    skip_lines: Annotated[int, Field(ge=0, lt=1000)] = 0
    header: bool = True  # whether there is one; without it columns are named by number
    fields: Annotated[int, Field(ge=1)] | None = None
    drop_first: Annotated[int, Field(ge=0)] = 0  # rows at the beginning that were not framed right
    format: TableFormat = TableFormat()
    time: ForeignTime
    columns: Annotated[list[ForeignColumn], Field(min_length=1)]

    def table_format(self) -> TableFormat:
        """How the file is written: ``format``, and the mapping's own keys."""
        first = self.skip_lines + 1 if self.skip_lines else None
        own = {
            "delimiter": self.delimiter,
            "header_line": first if self.header else 0,
            "first_data_line": None if self.header else first,
        }
        missing = {k: v for k, v in own.items() if k not in self.format.model_fields_set}
        return self.format.model_copy(update=missing)


@dataclass
class ImportReport:
    rows: int = 0  # written
    read: str = ""  # how the file was read and what was left out, with counts and lines
    left_out: tuple[str, ...] = ()  # the latter alone
    wrapped: int = 0
    broken: int = 0
    missing: int = 0  # cells that are empty or not finite; NaN
    backward_s: list[float] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)


def read_mapping(path: Path) -> ForeignMapping:
    text = read_text(path, "docs/import-log.md has a mapping file.")
    document = parse_toml(text, path.name, "docs/import-log.md")
    mapping = checked(ForeignMapping, document, path.name, lambda _: None, text)
    if nothing := [c.name for c in mapping.columns if c.scale == 0]:
        raise UserError(
            f"{path.name}: scale of {nothing[0]} is 0: no value is left.", "Correct it."
        )
    names = [ROW, *(c.name for c in mapping.columns)]
    twice = [n for n in names if names.count(n) > 1]
    if twice:
        raise UserError(f"{path.name}: '{twice[0]}' names two columns.", "Name each differently.")
    if mapping.stream in EVENTS:
        raise UserError(
            f"{path.name}: stream = '{mapping.stream}' is reserved for esea-host.", "Name another."
        )
    return mapping


def import_table(source: Path, mapping: ForeignMapping, target: Path) -> ImportReport:
    report = ImportReport()
    try:
        table = _table(source, mapping)
        columns = [table.numbers(_name(table, c.source), holes=True) for c in mapping.columns]
        board_ns = _times(mapping, table, report)
    except UserError as error:
        if mapping.fields is None and re.search(" cells for |is not a number", error.what):
            fix = f"{error.fix} Or set fields in the mapping: cells of a row; others are left out."
            raise UserError(error.what, fix) from None
        raise
    layout = StreamLayout(
        mapping.stream,
        (
            StreamColumn(ROW, "u4", "", "row of the file, from 0"),
            *(StreamColumn(c.name, "f8", c.unit, c.meaning) for c in mapping.columns),
        ),
    )
    rows = np.zeros(len(table), layout.dtype)
    rows[ROW] = np.arange(len(rows))
    for c, values in zip(mapping.columns, columns, strict=True):
        rows[c.name] = _converted(c, values, report)
    report.rows, report.read, report.left_out = len(rows), table.report(), table.left_out
    told = {k: v for k, v in vars(report).items() if k != "gaps"}
    attached = {"mapping.json": mapping.model_dump_json(indent=1).encode()}
    if table.simulated:
        facts = {"device": "imported", "board": source.name, "simulated": True}
        attached["facts.json"] = json.dumps(facts).encode()
    with new_whole(target) as part, Recorder(part, attached) as recorder:
        recorder.event("import", {"file": source.name, **told})
        recorder.rows(layout, rows, board_ns, board_ns)
        for gap in report.gaps:
            recorder.gap(gap)
    return report


def _name(table: FileTable, source: str | int) -> str:
    if isinstance(source, str):
        return source
    if not 0 <= source < len(table.names):
        raise UserError(
            f"{table.name}: there is no column {source}; it has {len(table.names)}, from 0.",
            "Correct the number in the mapping.",
        )
    return table.names[source]


def _table(source: Path, mapping: ForeignMapping) -> FileTable:
    # Rows with a time; what is no row is refused, or left out where the mapping expects it.
    every = mapping.time.source, *(c.source for c in mapping.columns)
    sources = [s for s in every if s is not None]
    named = [s for s in sources if isinstance(s, str)]
    table = read_table(
        source,
        named if len(named) == len(sources) else None,
        mapping.table_format(),
        settings="the mapping's [format]",
        fields=mapping.fields,
        drop_ragged=mapping.fields is not None,
    )
    if mapping.fields is not None:
        table = table.numeric([_name(table, s) for s in sources])
    if mapping.drop_first:
        table = table.kept(np.arange(len(table)) >= mapping.drop_first, "drop_first")
    if mapping.time.source is not None:
        table = table.timed(_name(table, mapping.time.source))
    if not len(table):
        raise UserError(f"{source} has no row of numbers. {table.report()}", "Check the mapping.")
    return table


def _converted(column: ForeignColumn, values: Array, report: ImportReport) -> Array:
    out = values.copy()
    broken = np.isin(values, column.broken)
    if column.wraps_at is not None:
        wrapped = (values >= column.wraps_at / 2) & ~broken
        out[wrapped] -= column.wraps_at
        report.wrapped += int(np.count_nonzero(wrapped))
    report.missing += int(np.count_nonzero(~np.isfinite(values)))
    out[~np.isfinite(values)] = np.nan
    out = out * column.scale + column.offset
    out[broken] = np.nan
    report.broken += int(np.count_nonzero(broken))
    return out


def _times(mapping: ForeignMapping, table: FileTable, report: ImportReport) -> Array:
    time = mapping.time
    period_ns = round(time.period_s * 1e9)
    if time.source is None:
        return np.arange(len(table), dtype=np.int64) * period_ns
    raw = table.numbers(_name(table, time.source))
    ns = np.round((raw - raw[0]) * time.scale * 1e9)
    far = np.flatnonzero(~(np.abs(ns) < MOST_NS))
    if len(far):
        raise UserError(
            f"{table.at(int(far[0]), str(time.source))}: {raw[far[0]]:g} is more than a year from "
            "the first time.",
            "Correct the cell, or time.scale in the mapping: seconds of its unit.",
        )
    ns = ns.astype(np.int64)
    steps = np.diff(ns)
    usual_s = float(np.median(np.abs(steps))) * 1e-9 if len(steps) else time.period_s
    if not 0.1 < usual_s / time.period_s < 20:  # beyond rows that are lost
        raise UserError(
            f"{table.name}: most rows are {usual_s:g} s apart, the mapping's time.period_s is "
            f"{time.period_s:g} s.",
            "Correct time.scale (seconds of the column's unit: 0.001 for ms) or time.period_s.",
        )
    for at in np.flatnonzero(steps < 0).tolist():
        report.backward_s.append(round(float(-steps[at]) * 1e-9, 6))
    # Behind a new start time goes on, one period later: how long it stood nobody knows.
    ns = np.concatenate([[0], np.cumsum(np.where(steps < 0, period_ns, steps))])
    for at in range(len(steps)):
        off = abs(int(steps[at]) - period_ns)
        if steps[at] < 0 or off > time.tolerance * period_ns:
            missing = -1 if steps[at] < 0 else max(0, round(int(steps[at]) / period_ns) - 1)
            where = int(ns[at])
            report.gaps.append(Gap(mapping.stream, at, at + 1, missing, "foreign", where))
    return np.asarray(ns, np.int64)
