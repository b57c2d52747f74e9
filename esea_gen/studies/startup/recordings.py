"""Recordings of the procedures in files: the numbers again, without the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.studies.startup.watch import DriveRecording
from esea_gen.tables import read_table

COLUMNS = ("time_s", "u_Nm", "gear_rad", "motor_rad", "load_rad")


def write_recordings(folder: Path, recordings: Mapping[str, DriveRecording]) -> None:
    """A CSV for each procedure, a row a tick, every digit."""
    for name, r in recordings.items():
        time_s = r.tick_s * np.arange(len(r))
        columns = [time_s.round(9), *(getattr(r, n) for n in COLUMNS[1:])]
        rows = zip(*(c.tolist() for c in columns), strict=True)
        lines = [",".join(COLUMNS), *(",".join(map(repr, row)) for row in rows)]
        write_whole(folder / f"{name}.csv", "\n".join(lines) + "\n")


def read_recordings(folder: Path, names: Sequence[str], tick_s: float) -> dict[str, DriveRecording]:
    """Recordings of these procedures, with a row for each tick."""
    return {n: _read(folder / f"{n}.csv", tick_s) for n in names}


def _read(path: Path, tick_s: float) -> DriveRecording:
    table = read_table(path, COLUMNS)
    time_s, *signals = (table.numbers(c) for c in COLUMNS)
    wrong = np.flatnonzero(np.abs(np.diff(time_s) - tick_s) > 1e-3 * tick_s)
    if len(wrong) or len(time_s) < 2:
        at = table.at(wrong[0] + 1) if len(wrong) else f"{path}: at its end"
        raise UserError(
            f"{at}: the time does not go on by a tick of {1e3 * tick_s:g} ms.",
            "A recording with gaps cannot be used: record it again.",
        )
    return DriveRecording(tick_s, *(np.ascontiguousarray(c) for c in signals))


__all__ = ["COLUMNS", "read_recordings", "write_recordings"]
