"""Design of the cross-over: groups, elements, blocks; shared helpers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from esea_gen.errors import UserError
from esea_gen.tables import FileTable, read_table

SPRING, ELASTOMER = "spring", "elastomer"
ELEMENTS = (SPRING, ELASTOMER)
# Group A has the spring first.
FIRST = {"A": SPRING, "B": ELASTOMER}


def element_of(group: str, block: int) -> str:
    return FIRST[group] if block == 1 else ELEMENTS[1 - ELEMENTS.index(FIRST[group])]


def read_rows(
    path: Path, needed: Sequence[str]
) -> tuple[FileTable, list[tuple[str, dict[str, str]]]]:
    """A table of texts that has these columns, and each row with its place for messages."""
    table = read_table(path, needed, name=path.name)
    if not len(table):
        raise UserError(f"{path.name}: no rows.", "Give one row an entry.")
    columns = zip(*(table.texts(n) for n in needed), strict=True)
    rows = [dict(zip(needed, cells, strict=True)) for cells in columns]
    return table, [(table.at(k), row) for k, row in enumerate(rows)]


def checked_group(group: str, where: str) -> str:
    if group not in FIRST:
        raise UserError(f"{where}: group {group!r}.", "A has the spring first, B the elastomer.")
    return group
