"""Recordings as text tables, and files written whole or not at all."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from esea_gen.errors import UserError
from esea_host.assess.database import LocationGrid, ResponseDataBase
from esea_host.assess.patients import DEG, MEAN_HEIGHT_M, MEAN_MASS_KG, RELAXED, Array
from esea_host.assess.responses import LegRecording, passage

ANGLES = {"angle_rad": 1.0, "angle_deg": DEG, "knee_rad": 1.0, "knee_deg": DEG}
TORQUES = ("torque_Nm", "tau_Nm")


def read_columns(path: Path) -> dict[str, Array]:
    """A CSV with a header, all numbers."""
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
    return {name: values[:, i] for i, name in enumerate(head)}


def angle_columns(path: Path) -> tuple[Array, Array, dict[str, Array]]:
    """Time and knee angle (flexion from full extension) of a CSV, and all its columns."""
    found = read_columns(path)
    name = next((n for n in ANGLES if n in found), None)
    if name is None or "time_s" not in found:
        raise UserError(
            f"{path}: columns {', '.join(found)}.",
            "Needs time_s and angle_rad or angle_deg (bending from the straight knee).",
        )
    return found["time_s"], found[name] * ANGLES[name], found


def read_recording(
    path: Path, height_m: float = MEAN_HEIGHT_M, mass_kg: float = MEAN_MASS_KG
) -> LegRecording:
    """A moved leg from a CSV: time_s, angle_rad or angle_deg, torque_Nm or tau_Nm."""
    time_s, angle, found = angle_columns(path)
    torque = next((n for n in TORQUES if n in found), None)
    if torque is None:
        raise UserError(
            f"{path}: no torque among {', '.join(found)}.",
            "Needs torque_Nm, of the hands on the leg, positive towards bending.",
        )
    return LegRecording(time_s, angle, found[torque], height_m, mass_kg)


def from_recordings(folder: Path) -> ResponseDataBase:
    """A data base from recordings: a folder for each category, CSV files of people in it.

    A line ``# height_m=1.7 mass_kg=70`` at the top of a file gives its body's size.
    """
    people = []
    for path in sorted(folder.glob("*/*.csv")) if folder.is_dir() else ():
        size = _body(path)
        people.append((path.parent.name, passage(read_recording(path, *size))))
    if not people:
        raise UserError(f"{folder}: no recordings.", "Put CSV files in a folder for each category.")
    low = min(float(np.min(p.angle_rad)) for _, p in people)
    high = max(float(np.max(p.angle_rad)) for _, p in people)
    fast = max(float(np.quantile(np.abs(p.rate_rad_s), 0.995)) for _, p in people)
    shape = (max(3, round((high - low) / (10 * DEG))), max(4, 2 * round(fast / (20 * DEG))))
    grid = LocationGrid.spanning((low, high), (-fast, fast), shape)
    names = {name for name, _ in people}
    provenance = {"source": "recordings", "people": len(people)}
    return ResponseDataBase.of(people, grid, provenance, RELAXED if RELAXED in names else None)


def _body(path: Path) -> tuple[float, float]:
    first = path.read_text(encoding="utf-8").split("\n", 1)[0]
    found = dict(x.split("=", 1) for x in first.lstrip("# ").split() if "=" in x)
    try:
        height = float(found.get("height_m", MEAN_HEIGHT_M))
        return height, float(found.get("mass_kg", MEAN_MASS_KG))
    except ValueError as error:
        raise UserError(f"{path}, line 1: {error}.", "Write # height_m=1.7 mass_kg=70.") from error
