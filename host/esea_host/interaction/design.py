"""The cross-over's words: groups, elements, blocks; what the rest of the room shares."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from esea_gen.errors import UserError

SPRING, ELASTOMER = "spring", "elastomer"
ELEMENTS = (SPRING, ELASTOMER)
# Group A has the spring first.
FIRST = {"A": SPRING, "B": ELASTOMER}


def element_of(group: str, block: int) -> str:
    """Which element a group has in block 1 or 2."""
    return FIRST[group] if block == 1 else ELEMENTS[1 - ELEMENTS.index(FIRST[group])]


def read_table(path: Path, needed: Sequence[str]) -> list[dict[str, str]]:
    """Rows of a CSV file that has these columns; other columns are kept."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            rows = [{k: (v or "").strip() for k, v in row.items() if k} for row in reader]
            columns = list(reader.fieldnames or ())
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path.name}: {error}.", "Give a CSV file in UTF-8.") from None
    missing = [c for c in needed if c not in columns]
    if missing:
        raise UserError(
            f"{path.name}: no column {', '.join(missing)}, only {', '.join(columns) or 'none'}.",
            f"It needs {', '.join(needed)}.",
        )
    if not rows:
        raise UserError(f"{path.name}: no rows.", "Give one row an entry.")
    return rows


def checked_group(group: str, where: str) -> str:
    """A or B."""
    if group not in FIRST:
        raise UserError(f"{where}: group {group!r}.", "A has the spring first, B the elastomer.")
    return group
