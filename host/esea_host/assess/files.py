"""Recordings of a moved leg: text tables, and what ``esea-host record`` and ``import`` write."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from esea_gen.errors import UserError
from esea_host.assess.database import RECORDINGS, LocationGrid, ResponseDataBase
from esea_host.assess.patients import DEG, MEAN_HEIGHT_M, MEAN_MASS_KG, RELAXED, Array
from esea_host.assess.responses import LegRecording, passage
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
HOLE = 5.0  # times the usual step: a longer one has lost samples


def read_columns(path: Path) -> dict[str, Array]:
    """Columns by name, ``time_s`` among them: of a CSV with a header, or of an MCAP recording."""
    return _from_log(path) if path.suffix == ".mcap" else _from_text(path)


def _from_log(path: Path) -> dict[str, Array]:
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
        table = log[stream].between(0.0, np.inf)  # refuses a recording with holes
        found = {"time_s": table.time_s}
        return found | {n: table[n].astype(np.float64) for n in table.names if table[n].ndim == 1}


def _from_text(path: Path) -> dict[str, Array]:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [r for r in csv.reader(file) if r and not r[0].startswith("#")]
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read ({error}).", "Give a CSV file.") from error
    if len(rows) < 2:
        raise UserError(f"{path}: no rows.", "The first line names the columns.")
    head = [x.strip() for x in rows[0]]
    for n, row in enumerate(rows[1:], 2):
        if len(row) != len(head):
            raise UserError(
                f"{path}, line {n}: {len(row)} values, the header has {len(head)}.",
                "Give every line as many.",
            )
    try:
        values = np.array([[float(x) for x in row] for row in rows[1:]])
    except ValueError as error:
        raise UserError(f"{path}: {error}.", "All values are numbers.") from error
    if len(set(head)) < len(head):
        raise UserError(f"{path}: a column comes twice in {', '.join(head)}.", "Name each once.")
    found = {name: values[:, i] for i, name in enumerate(head)}
    _refuse_holes(path, found)
    return found


def _refuse_holes(path: Path, found: dict[str, Array]) -> None:
    # Whatever bridges a hole makes a movement that was not: a swing longer, a loop open.
    for name in {"time_s", *ANGLES, *TORQUES} & set(found):
        bad = np.flatnonzero(~np.isfinite(found[name]))
        if len(bad):
            raise UserError(
                f"{path}, row {bad[0] + 1}: {name} is {found[name][bad[0]]:g}.",
                "Cut the recording there, or record again.",
            )
    steps = np.diff(found.get("time_s", np.zeros(0)))
    if not len(steps):
        return
    usual = float(np.median(steps))
    wrong = np.flatnonzero((steps <= 0) | (steps > HOLE * usual))
    if len(wrong):
        k = wrong[0]
        raise UserError(
            f"{path}, row {k + 2}: time_s goes from {found['time_s'][k]:g} to "
            f"{found['time_s'][k + 1]:g} s, usually by {usual:g} s: at most {HOLE:g} times that.",
            "Cut the recording at the hole, or record again.",
        )


def angle_columns(path: Path) -> tuple[Array, Array, dict[str, Array]]:
    """Time and knee angle (flexion from full extension) of a recording, and all its columns."""
    found = read_columns(path)
    name = next((n for n in ANGLES if n in found), None)
    if name is None or "time_s" not in found:
        raise UserError(
            f"{path}: columns {', '.join(found)}.",
            "Needs time_s and angle_rad or angle_deg (bending from the straight knee).",
        )
    angle = found[name] * ANGLES[name]
    most = float(np.max(np.abs(angle), initial=0.0))
    if most > np.pi:
        raise UserError(
            f"{path}: {name} goes to {most / DEG:.0f} deg, further than a knee bends.",
            "Check its unit: degrees are angle_deg, radians angle_rad.",
        )
    return found["time_s"], angle, found


def read_recording(
    path: Path, height_m: float = MEAN_HEIGHT_M, mass_kg: float = MEAN_MASS_KG
) -> LegRecording:
    """A moved leg: time_s, angle_rad or angle_deg, torque_Nm or tau_Nm; of a CSV or MCAP file."""
    time_s, angle, found = angle_columns(path)
    torque = next((n for n in TORQUES if n in found), None)
    if torque is None:
        raise UserError(
            f"{path}: no torque among {', '.join(found)}.",
            "Needs torque_Nm, of the hands on the leg, positive towards bending.",
        )
    most = float(np.max(np.abs(found[torque]), initial=0.0))
    if most > STRONGEST_NM:
        raise UserError(
            f"{path}: {torque} goes to {most:.3g} Nm, more than hands do ({STRONGEST_NM:.0f} Nm).",
            "Check its unit.",
        )
    return LegRecording(time_s, angle, found[torque], height_m, mass_kg)


def from_recordings(folder: Path) -> ResponseDataBase:
    """A data base from recordings: a folder for each category, CSV or MCAP files of people in it.

    A line ``# height_m=1.7 mass_kg=70`` at the top of a CSV gives its body's size; a note of the
    same words does in an MCAP file.
    """
    people = []
    found = [*folder.glob("*/*.csv"), *folder.glob("*/*.mcap")] if folder.is_dir() else []
    for path in sorted(found):
        size = _body(path)
        people.append((path.parent.name, passage(read_recording(path, *size))))
    if not people:
        raise UserError(
            f"{folder}: no recordings.", "Put CSV or MCAP files in a folder for each category."
        )
    low = min(float(np.min(p.angle_rad)) for _, p in people)
    high = max(float(np.max(p.angle_rad)) for _, p in people)
    fast = max(float(np.quantile(np.abs(p.rate_rad_s), 0.995)) for _, p in people)
    shape = (max(3, round((high - low) / (10 * DEG))), max(4, 2 * round(fast / (20 * DEG))))
    grid = LocationGrid.spanning((low, high), (-fast, fast), shape)
    names = {name for name, _ in people}
    provenance = {"source": RECORDINGS, "people": len(people)}
    return ResponseDataBase.of(people, grid, provenance, RELAXED if RELAXED in names else None)


def _body(path: Path) -> tuple[float, float]:
    if path.suffix == ".mcap":
        with open_log(path) as log:
            notes = [str(e.get("text", "")) for e in log.events("note")]
        first = next((n for n in notes if "height_m=" in n or "mass_kg=" in n), "")
    else:
        first = path.read_text(encoding="utf-8").split("\n", 1)[0]
    found = dict(x.split("=", 1) for x in first.lstrip("# ").split() if "=" in x)
    try:
        height = float(found.get("height_m", MEAN_HEIGHT_M))
        return height, float(found.get("mass_kg", MEAN_MASS_KG))
    except ValueError as error:
        raise UserError(
            f"{path}: body's size: {error}.", "Write height_m=1.7 mass_kg=70."
        ) from error
