"""CSV logs of other machines, read by a mapping file, with their faults told and not smoothed over.

A mapping is TOML: which column is what, in which unit, times which factor; what a broken value
looks like; and how time runs.
"""

from __future__ import annotations

import csv
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from esea_gen.errors import UserError
from esea_gen.toml_file import read_text
from esea_host.recording.gaps import Gap
from esea_host.recording.layout import Array, StreamColumn, StreamLayout
from esea_host.recording.writer import Recorder

_STRICT = ConfigDict(extra="forbid", frozen=True)


class ForeignColumn(BaseModel):
    """A column of the file.

    source: its header, or its number from 0.
    name: ours, with the unit at its end.
    scale, offset: value = raw * scale + offset.
    wraps_at: a raw value of half of this or more is this much less: unsigned numbers that were
        meant to have a sign.
    broken: raw values that mean that nothing was measured.
    """

    model_config = _STRICT
    source: str | int
    name: str
    unit: str = ""
    meaning: str = ""
    scale: float = 1.0
    offset: float = 0.0
    wraps_at: float | None = None
    broken: list[float] = []


class ForeignTime(BaseModel):
    """How time runs.

    source: column of the time; without it ``period_s`` counts.
    scale: seconds of its unit.
    period_s: distance of two samples.
    tolerance: a distance that is off by more than this share of the period is a gap.
    """

    model_config = _STRICT
    source: str | int | None = None
    scale: float = 1.0
    period_s: Annotated[float, Field(gt=0)]
    tolerance: Annotated[float, Field(gt=0, lt=10)] = 0.5


class ForeignMapping(BaseModel):
    """A mapping file.

    stream: name of the stream that is made.
    delimiter, skip_lines: of the file; the header, if it has one, stands behind the skipped lines.
    header: whether there is one; without it columns are named by number.
    fields: of a row; without it as many as the header has.
    drop_first: rows at the beginning that were not framed right.
    """

    model_config = _STRICT
    stream: str = "foreign"
    delimiter: str = ","
    skip_lines: int = 0
    header: bool = True
    fields: Annotated[int, Field(ge=1)] | None = None
    drop_first: int = 0
    time: ForeignTime
    columns: Annotated[list[ForeignColumn], Field(min_length=1)]


@dataclass
class ImportReport:
    """What was found in a foreign log.

    rows: taken; dropped_first: as the mapping says.
    ragged: lines with another number of fields, or that hold no number; left out.
    wrapped, broken: values that were unwrapped, or became NaN.
    backward_s: by how much time went backward, each time: the machine started again.
    """

    rows: int = 0
    dropped_first: int = 0
    ragged: int = 0
    wrapped: int = 0
    broken: int = 0
    backward_s: list[float] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)


def read_mapping(path: Path) -> ForeignMapping:
    """Read a mapping file.

    Parameters
    ----------
    path : Path
        TOML.

    Returns
    -------
    ForeignMapping
        Checked.

    Raises
    ------
    UserError
        With file and key of what is wrong.
    """
    try:
        return ForeignMapping(**tomllib.loads(read_text(path, "docs/host.md has one.")))
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{path} is no mapping file ({error}).", "docs/host.md has one.") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(x) for x in first["loc"])
        raise UserError(f"{path}, {where}: {first['msg']}.", "docs/host.md has the keys.") from None


def import_csv(source: Path, mapping: ForeignMapping, target: Path) -> ImportReport:
    """Make a recording of a foreign log.

    Parameters
    ----------
    source : Path
        The CSV file.
    mapping : ForeignMapping
        What its columns are.
    target : Path
        Must not exist.

    Returns
    -------
    ImportReport
        Its faults, which are in the recording as well.

    Raises
    ------
    UserError
        When a column is missing, or there is no row with numbers.
    """
    report = ImportReport()
    raw = _table(source, mapping, report)
    layout = StreamLayout(
        mapping.stream,
        (
            StreamColumn("sequence", "u4", "", "row of the file, from 0"),
            *(StreamColumn(c.name, "f8", c.unit, c.meaning) for c in mapping.columns),
        ),
    )
    rows = np.zeros(len(raw[0]), layout.dtype)
    rows["sequence"] = np.arange(len(rows))
    for c, values in zip(mapping.columns, raw[1:], strict=True):
        rows[c.name] = _converted(c, values, report)
    board_ns = _times(mapping, raw[0], report)
    report.rows = len(rows)
    told = {k: v for k, v in vars(report).items() if k != "gaps"}
    with Recorder(target, {"mapping.json": mapping.model_dump_json(indent=1).encode()}) as recorder:
        recorder.event("import", {"file": source.name, **told})
        recorder.rows(layout, rows, board_ns, board_ns)
        for gap in report.gaps:
            recorder.gap(gap)
    return report


def _place(header: list[str], wanted: str | int, source: Path) -> int:
    if isinstance(wanted, int):
        return wanted
    names = [h.strip() for h in header]
    if wanted not in names:
        known = ", ".join(names)[:300]
        raise UserError(f"{source} has no column '{wanted}'.", f"Its header is: {known}.")
    return names.index(wanted)


def _table(source: Path, mapping: ForeignMapping, report: ImportReport) -> list[Array]:
    # Time, then every column, raw; lines that are no row are counted.
    try:
        with source.open(newline="", encoding="utf-8", errors="replace") as file:
            lines = list(csv.reader(file, delimiter=mapping.delimiter))[mapping.skip_lines :]
    except OSError as error:
        raise UserError(f"{source} cannot be read: {error.strerror}.", "") from None
    header = lines[0] if lines and mapping.header else []
    width = mapping.fields or len(header)
    wanted = [mapping.time.source, *(c.source for c in mapping.columns)]
    places = [None if w is None else _place(header, w, source) for w in wanted]
    found = []
    for line in lines[int(mapping.header) :]:
        try:
            row = [float("nan") if p is None else float(line[p]) for p in places]
        except (ValueError, IndexError):
            row = []
        if row and len(line) == width:
            found.append(row)
        else:
            report.ragged += 1
    report.dropped_first = min(mapping.drop_first, len(found))
    found = found[mapping.drop_first :]
    if not found:
        raise UserError(f"{source} has no row of numbers under its header.", "Check the mapping.")
    return list(np.array(found).T)


def _converted(column: ForeignColumn, values: Array, report: ImportReport) -> Array:
    out = values.copy()
    broken = np.isin(values, column.broken)
    if column.wraps_at is not None:
        wrapped = (values >= column.wraps_at / 2) & ~broken
        out[wrapped] -= column.wraps_at
        report.wrapped += int(np.count_nonzero(wrapped))
    out = out * column.scale + column.offset
    out[broken] = np.nan
    report.broken += int(np.count_nonzero(broken))
    return out


def _times(mapping: ForeignMapping, raw: Array, report: ImportReport) -> Array:
    time = mapping.time
    period_ns = round(time.period_s * 1e9)
    if time.source is None:
        return np.arange(len(raw), dtype=np.int64) * period_ns
    ns = np.round((raw - raw[0]) * time.scale * 1e9).astype(np.int64)
    steps = np.diff(ns)
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
