"""Read recordings of a moved leg: tables, and files of ``esea-host record`` and ``import``."""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import refuse_copies
from esea_gen.tables import FileTable, read_table
from esea_host.assess.database import RECORDINGS, LocationGrid, ResponseDataBase, answered
from esea_host.assess.patients import DEG, MEAN_HEIGHT_M, MEAN_MASS_KG, RELAXED, Array
from esea_host.assess.responses import LegRecording, passage
from esea_host.recording import export
from esea_host.recording.integrity import warn_unless_complete
from esea_host.recording.log import open_log

# ``theta_load_rad`` is what boards call the joint's angle.
ANGLES = {
    "angle_rad": 1.0,
    "angle_deg": DEG,
    "knee_rad": 1.0,
    "knee_deg": DEG,
    "theta_load_rad": 1.0,
}
TORQUES = ("torque_Nm", "tau_Nm")
STRONGEST_NM = 300.0  # six times the sensor's full scale
KINDS = (".csv", ".mcap", ".parquet", ".mat", ".h5", ".hdf5", ".json")
HOLE = 5.0  # times the usual step: a longer one has lost samples


@dataclass(frozen=True)
class LegTable:
    """Columns by name, ``time_s`` among them; read: how a table was read and what was left out."""

    columns: dict[str, Array]
    read: str = ""
    simulated: bool = False


def read_columns(path: Path) -> LegTable:
    """Time, angle and torque of a table with a header, or the columns of an MCAP recording."""
    if path.suffix == ".mcap":
        return _from_log(path)
    table = export.longest_run(read_table(path))
    known = {n: export.column_of(table, n) for n in ("time_s", *ANGLES, *TORQUES)}
    found = {n: table.numbers(c) for n, c in known.items() if c in table.names}
    _refuse_holes(table, found)
    found = found or dict.fromkeys(table.names, np.zeros(0))
    return LegTable(found, table.report(), table.simulated)


def _from_log(path: Path) -> LegTable:
    with open_log(path) as log:
        warn_unless_complete(path, log.integrity)
        with_angle = [s for s in log.streams if set(ANGLES) & set(log[s].names)]
        if not with_angle:
            raise UserError(
                f"{path}: no stream has an angle; it has {', '.join(log.streams) or 'none'}.",
                f"Needs a column {', '.join(ANGLES)}.",
            )
        # One with a torque, where there is one.
        stream = max(with_angle, key=lambda s: bool(set(TORQUES) & set(log[s].names)))
        rows = log[stream]
        sensed = rows[export.SENSED] if export.SENSED in rows.names else np.ones(len(rows))
        first, last = export.longest_stretch(str(path), rows.tick, sensed)
        table = rows.between(rows.time_s[first], rows.time_s[last - 1] + 1e-9)  # refuses holes
        found = {"time_s": table.time_s}
        found |= {n: table[n].astype(np.float64) for n in table.names if table[n].ndim == 1}
        simulated = bool(log.facts.get("simulated"))
        gone = len(rows) - len(table)
        why = f"{gone} rows of another run or with {export.SENSED} = 0" if gone else "nothing"
        read = f"{path}: {len(table)} rows; left out: {why}" + "; SIMULATED" * simulated
        return LegTable(found, read, simulated)


def _refuse_holes(table: FileTable, found: dict[str, Array]) -> None:
    # Whatever bridges a hole makes a movement that was not: a swing longer, a loop open.
    steps = np.diff(found.get("time_s", np.zeros(0)))
    if not len(steps):
        return
    usual = float(np.median(steps))
    wrong = np.flatnonzero((steps <= 0) | (steps > HOLE * usual))
    if len(wrong):
        k = int(wrong[0])
        raise UserError(
            f"{table.at(k + 1)}: time_s goes from {found['time_s'][k]:g} to "
            f"{found['time_s'][k + 1]:g} s, usually by {usual:g} s: at most {HOLE:g} times that.",
            "Cut the recording at the hole, or record again.",
        )


def angle_columns(path: Path) -> tuple[Array, Array, LegTable]:
    """Time and knee angle (flexion from full extension) of a recording, and all its columns."""
    table = read_columns(path)
    found = table.columns
    if len(names := [n for n in ANGLES if n in found]) != 1 or "time_s" not in found:
        raise UserError(
            f"{path}: columns {', '.join(found)}.",
            "Needs time_s, and either angle_rad or angle_deg (bending from the straight knee).",
        )
    name = names[0]
    angle = found[name] * ANGLES[name]
    most = float(np.max(np.abs(angle), initial=0.0))
    if most > np.pi:
        raise UserError(
            f"{path}: {name} goes to {most / DEG:.0f} deg, more than a knee bends.",
            "Check its unit: degrees are angle_deg, radians angle_rad.",
        )
    return found["time_s"], angle, table


def read_recording(
    path: Path, height_m: float = MEAN_HEIGHT_M, mass_kg: float = MEAN_MASS_KG
) -> LegRecording:
    """A moved leg: time_s, angle_rad or angle_deg, torque_Nm or tau_Nm; a table or MCAP file."""
    time_s, angle, table = angle_columns(path)
    found = table.columns
    if len(torques := [n for n in TORQUES if n in found]) != 1:
        raise UserError(
            f"{path}: {len(torques) or 'no'} torques among {', '.join(found)}.",
            "Needs torque_Nm, of the hands on the leg, positive towards bending.",
        )
    torque = torques[0]
    most = float(np.max(np.abs(found[torque]), initial=0.0))
    if most > STRONGEST_NM:
        raise UserError(
            f"{path}: {torque} goes to {most:.3g} Nm, too much for hands ({STRONGEST_NM:.0f} Nm).",
            "Check its unit.",
        )
    for name, value in _body(path).items():
        if (taken := {"height_m": height_m, "mass_kg": mass_kg}[name]) != value:
            fix = f"Give --{name.replace('_', '-')} {value:g}, or correct the file."
            raise UserError(f"{path}: {name} is {value:g} by the file, {taken:g} here.", fix)
    leg = time_s, angle, found[torque], height_m, mass_kg
    return LegRecording(*leg, read=table.read, simulated=table.simulated)


def from_recordings(folder: Path, told: Callable[[str], None] = lambda _: None) -> ResponseDataBase:
    """A database from recordings: a folder for each category, files of people in it."""
    people = []
    found = [p for p in folder.glob("*/*") if p.suffix.lower() in KINDS] if folder.is_dir() else []
    refuse_copies(found)
    for path in sorted(found):
        leg = read_recording(path, **_body(path))
        people.append((path.parent.name, passage(leg)))
        if leg.read:
            told(leg.read)
    if not people:
        raise UserError(
            f"{folder}: no recordings.",
            f"Put files in a folder for each category: {', '.join(KINDS)}.",
        )
    low = min(float(np.min(p.angle_rad)) for _, p in people)
    high = max(float(np.max(p.angle_rad)) for _, p in people)
    fast = max(float(np.quantile(np.abs(p.rate_rad_s), 0.995)) for _, p in people)
    shape = (max(3, round((high - low) / (10 * DEG))), max(4, 2 * round(fast / (20 * DEG))))
    grid = LocationGrid.spanning((low, high), (-fast, fast), shape)
    names = {name for name, _ in people}
    provenance = {"source": RECORDINGS, "people": len(people)}
    reference = RELAXED if RELAXED in names else None
    return ResponseDataBase.of(answered(people, grid), grid, provenance, reference)


def _body(path: Path) -> dict[str, float]:
    if path.suffix == ".mcap":
        with open_log(path) as log:
            notes = [str(e.get("text", "")) for e in log.events("note")]
        first = next((n for n in notes if "height_m=" in n or "mass_kg=" in n), "")
    else:
        with path.open("rb") as file:
            start = file.readline(200).removeprefix(BOM_UTF8).decode(errors="replace")
        first = start if start.startswith("#") else ""
    found = dict(x.split("=", 1) for x in first.lstrip("# ").split() if "=" in x)
    try:
        return {name: float(found[name]) for name in ("height_m", "mass_kg") if name in found}
    except ValueError as error:
        raise UserError(f"{path}: body size: {error}.", "Write height_m=1.7 mass_kg=70.") from error
