"""Recordings for other programs: CSV with units, Parquet, BIDS-Motion, rows as JSON."""

from __future__ import annotations

import csv
import json
import re
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import new_whole, plain, write_whole
from esea_gen.tables import SIMULATED, FileTable
from esea_gen.toml_file import read_text
from esea_host.recording.layout import Array
from esea_host.recording.log import TICK, Log, Table

if TYPE_CHECKING:
    import pyarrow

SENSED = "sensing_ok"  # 0: the angles beside it are of no encoder that answers and is zeroed
LONGEST_S = 3600.0  # without a row
BIDS_VERSION = "1.10.0"
_LABEL = re.compile(r"[0-9a-zA-Z]+")
# What BIDS calls a channel's kind: https://bids-specification.readthedocs.io, Motion.
_BIDS_TYPES = {"rad": "JNTANG", "rad/s": "VEL", "rad/s^2": "ANGACCEL"}


def _about(log: Log, table: Table) -> dict[str, Any]:
    gaps = [asdict(g) for g in table.gaps]
    return {"facts": log.facts, "integrity": log.integrity.to_dict(), "gaps": gaps}


def column_of(table: FileTable, name: str) -> str:
    """A column of a table by its name, without the unit that an export has in brackets."""
    return next((n for n in table.names if n.partition(" [")[0] == name), name)


def longest_stretch(name: str, tick: Array, sensed: Array) -> tuple[int, int]:
    """First row, and row behind the last, of the longest run in which a board measured."""
    sensed = np.asarray(sensed, bool)
    cuts = np.flatnonzero((np.diff(tick.astype(float)) <= 0) | np.diff(sensed)) + 1
    runs = [p for p in pairwise([0, *cuts.tolist(), len(tick)]) if sensed[p[0]]]
    if not runs:
        raise UserError(f"{name}: {SENSED} is 0 in every row.", "Zero the board, record again.")
    return max(runs, key=lambda p: p[1] - p[0])


def longest_run(table: FileTable) -> FileTable:
    """The longest run of the board in an exported table; any other table as it is."""
    if TICK not in table.cells or not len(table):
        return table
    rows, sensed = np.arange(len(table)), column_of(table, SENSED)
    known = table.numbers(sensed) if sensed in table.cells else np.ones(len(table))
    start, stop = longest_stretch(table.name, table.numbers(TICK), known)
    why = f"'{TICK}' of another run or {SENSED} = 0; the longest run is analysed"
    return table.kept((start <= rows) & (rows < stop), why)


def _columns(table: Table, simulated: bool = False) -> list[tuple[str, str, Array]]:
    # With the time before them; whether simulated in every row.
    marks = [(SIMULATED, "1", np.ones(len(table), np.uint8))] if simulated else []
    return [("time_s", "s", table.time_s), *table.flat(), *marks]


def to_csv(log: Log, stream: str, path: Path) -> int:
    """A stream as CSV."""
    table, simulated = log[stream], bool(log.facts.get("simulated"))
    with (
        new_whole(path) as target,
        new_whole(path.with_name(f"{path.name}.json")) as side,
        target.open("w", newline="", encoding="utf-8") as file,
    ):
        text = json.dumps(_about(log, table), indent=1)
        side.write_text(f"{text}\n", encoding="utf-8", newline="\n")
        writer = csv.writer(file)
        columns = _columns(table, simulated)
        writer.writerow([f"{n} [{u}]" if u and u != "1" else n for n, u, _ in columns])
        for i, part in enumerate(table.pieces()):
            if i:
                writer.writerow([""] * len(columns))
            texts = [[_text(v) for v in values] for _, _, values in _columns(part, simulated)]
            writer.writerows(zip(*texts, strict=True))
    return len(table)


def _text(value: object) -> str:
    if isinstance(value, np.float32):
        return np.format_float_positional(value, unique=True, trim="-")
    return repr(value.item()) if isinstance(value, np.generic) else str(value)


def to_parquet(log: Log, stream: str, path: Path) -> int:
    """A stream as Parquet."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = log[stream]
    meanings = {c.name: c.meaning for c in table.layout.columns}
    fields: list[pyarrow.Field] = []
    arrays = []
    for name, unit, values in _columns(table, bool(log.facts.get("simulated"))):
        array = pa.array(np.ascontiguousarray(values))
        about = {"unit": unit, "meaning": meanings.get(name.partition("[")[0], "")}
        fields.append(pa.field(name, array.type, metadata=about))
        arrays.append(array)
    about = {f"esea.{name}": json.dumps(found) for name, found in _about(log, table).items()}
    with new_whole(path) as target:
        pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields, about)), target)
    return len(table)


def to_bids(log: Log, folder: Path, subject: str, task: str, stream: str = "sense_out") -> Path:
    """A stream as a BIDS data set with motion data."""
    for what, label in (("subject", subject), ("task", task)):
        if not _LABEL.fullmatch(label):
            raise UserError(f"The {what} '{label}' is not a BIDS label.", "Use letters and digits.")
    whole = log[stream]
    table = longest(whole)
    if left_out := len(whole) - len(table):
        print(f"{folder}: {left_out} rows of other runs of the board left out", file=sys.stderr)
    beside = "" if stream == log.first_output else stream  # another axis: a system of its own
    track = "".join(_LABEL.findall(f"{log.facts.get('device', 'device')}{beside}"))
    stem = f"sub-{subject}_task-{task}_tracksys-{track}"
    place = folder / f"sub-{subject}" / "motion"
    names = [place / f"{stem}_{end}" for end in ("motion.tsv", "channels.tsv", "motion.json")]
    with ExitStack() as held:
        scratch = [held.enter_context(new_whole(n)) for n in names]
        _write_motion(log, table, task, track, scratch)
        _data_set(folder, subject)
    return names[0]


def _write_motion(log: Log, table: Table, task: str, track: str, names: Sequence[Path]) -> None:
    samples, rows, side = names
    columns = [c for c in _columns(table) if c[0] not in ("time_s", TICK)]
    steps = np.diff(table.time_s)
    step_s = float(np.median(steps)) if len(steps) else 0.0
    if step_s <= 0:
        raise UserError(f"{table.layout.name}: its times do not ascend.", "Record for longer.")
    rate_Hz = round(1.0 / step_s, 6)
    with samples.open("w", encoding="utf-8", newline="\n") as file:
        texts = [[_text(v) if np.isfinite(v) else "n/a" for v in c[2]] for c in columns]
        file.writelines("\t".join(row) + "\n" for row in zip(*texts, strict=True))
    channels = ["name\tcomponent\ttype\ttracked_point\tunits\tsampling_frequency"]
    for name, unit, _ in columns:
        kind = _BIDS_TYPES.get(unit, "MISC")
        row = [name, "n/a", kind, "n/a", unit if unit and unit != "1" else "n/a", f"{rate_Hz:g}"]
        channels.append("\t".join(row))
    rows.write_text("\n".join(channels) + "\n", encoding="utf-8", newline="\n")
    kinds = [_BIDS_TYPES.get(unit, "MISC") for _, unit, _ in columns]
    about = {
        "TaskName": task,
        "TaskDescription": "Recorded with esea-host"
        + (" from a simulated board" if log.facts.get("simulated") else ""),
        "SamplingFrequency": rate_Hz,
        "SamplingFrequencyEffective": rate_Hz,
        "TrackingSystemName": track,
        "Manufacturer": "n/a",
        "ManufacturersModelName": str(log.facts.get("device", "n/a")),
        "SoftwareVersions": str(log.facts.get("content_hash", "n/a")),
        "RecordingDuration": float(len(table) / rate_Hz),
        "RecordingType": "continuous",
        "MotionChannelCount": len(columns),
        "MissingValues": "n/a",
        "RecordingState": log.state.value,
        "RecordingIntegrity": log.integrity.to_dict(),
    } | {f"{k}ChannelCount": kinds.count(k) for k in sorted(set(kinds))}
    side.write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8", newline="\n")


def longest(table: Table) -> Table:
    """The longest run of the board, in one piece; refused when a gap is in it."""
    starts = np.flatnonzero(np.diff(table.tick.astype(np.int64)) < 0) + 1
    first, end = max(pairwise([0, *starts, len(table)]), key=lambda p: p[1] - p[0])
    if end == 0:
        raise UserError(f"{table.layout.name} has no rows.", "Record for longer.")
    return table.between(float(table.time_s[first]), float(table.time_s[end - 1]) + 1e-9)


def _data_set(folder: Path, subject: str) -> None:
    about = folder / "dataset_description.json"
    if not about.exists():
        content = {
            "Name": "Recordings of esea-host",
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "raw",
            "License": "n/a",
            "Authors": ["n/a"],
            "GeneratedBy": [{"Name": "esea-host"}],
        }
        write_whole(about, json.dumps(content, indent=2) + "\n")
    people = folder / "participants.tsv"
    known = read_text(people, "Save it as UTF-8.").splitlines() if people.exists() else []
    known = known or ["participant_id"]
    if f"sub-{subject}" not in (line.partition("\t")[0] for line in known):
        empty = "\tn/a" * known[0].count("\t")
        known.append(f"sub-{subject}{empty}")
    write_whole(people, "\n".join(known) + "\n")
    readme = folder / "README"
    if not readme.exists():
        text = "Recordings of an elastomeric series elastic actuator, exported by esea-host.\n"
        write_whole(readme, text)


def play(log: Log, stream: str, speed: float) -> Iterator[str]:
    started_s = time.monotonic()
    table = log[stream]
    marks = {"simulated": True} if log.facts.get("simulated") else {}
    due = defaultdict[int, list[str]](list)
    for behind, gap in table.holes():
        due[behind].append(json.dumps({"gap": asdict(gap)}))
    columns = [table[n].tolist() for n in table.names]
    for i, (at_s, *values) in enumerate(zip(table.time_s.tolist(), *columns, strict=True)):
        yield from due[i]
        wait_s = at_s / speed - (time.monotonic() - started_s) if speed else 0.0
        started_s -= max(0.0, wait_s - LONGEST_S)  # a clock that jumps
        time.sleep(min(max(0.0, wait_s), LONGEST_S))
        row = dict(zip(table.names, values, strict=True))
        yield json.dumps(plain({"time_s": round(at_s, 6)} | marks | row, null=True))
    yield from due[len(table)]
