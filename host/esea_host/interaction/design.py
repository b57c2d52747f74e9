"""The cross-over's words: groups, elements, blocks; what the rest of the room shares."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError

SPRING, ELASTOMER = "spring", "elastomer"
ELEMENTS = (SPRING, ELASTOMER)
# Group A has the spring first.
FIRST = {"A": SPRING, "B": ELASTOMER}


def element_of(group: str, block: int) -> str:
    """Which element a group has in block 1 or 2."""
    return FIRST[group] if block == 1 else ELEMENTS[1 - ELEMENTS.index(FIRST[group])]


def read_table(path: Path, needed: Sequence[str]) -> list[dict[str, str]]:
    """Rows of a CSV file that has these columns; other columns are kept, lines with # left out."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = [line for line in csv.reader(file) if line and not line[0].startswith("#")]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path.name}: {error}.", "Give a CSV file in UTF-8.") from None
    columns, rows = [name.strip() for name in lines[0]] if lines else [], lines[1:]
    if len(set(columns)) < len(columns):
        raise UserError(
            f"{path.name}: a column comes twice in {', '.join(columns)}.", "Name each once."
        )
    missing = [c for c in needed if c not in columns]
    if missing:
        raise UserError(
            f"{path.name}: no column {', '.join(missing)}, only {', '.join(columns) or 'none'}.",
            f"It needs {', '.join(needed)}.",
        )
    if not rows:
        raise UserError(f"{path.name}: no rows.", "Give one row an entry.")
    for number, row in enumerate(rows, 2):
        if len(row) != len(columns):
            raise UserError(
                f"{path.name}, row {number}: {len(row)} values, the header has {len(columns)}.",
                "Give every row as many; put text with a comma in quotes.",
            )
    return [dict(zip(columns, (v.strip() for v in row), strict=True)) for row in rows]


def read_numbers(path: Path, needed: Sequence[str]) -> list[npt.NDArray[np.float64]]:
    """These columns of a CSV file as numbers, NaN where nothing stands."""
    rows = read_table(path, needed)
    try:
        return [np.array([float(row[c] or "nan") for row in rows]) for c in needed]
    except ValueError as error:
        raise UserError(f"{path.name}: {error}.", "Give numbers.") from None


def checked_group(group: str, where: str) -> str:
    """A or B."""
    if group not in FIRST:
        raise UserError(f"{where}: group {group!r}.", "A has the spring first, B the elastomer.")
    return group
