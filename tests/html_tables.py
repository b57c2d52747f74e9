"""Tables and figures of a page as a reader sees them: every number under its label."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import numpy as np
from matplotlib.axes import Axes

RAISED = str.maketrans("−", "-")


class _Tables(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: list[list[list[tuple[str, int, int]]]] = []
        self.cell: list[str] | None = None
        self.spans = (1, 1)
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            given = {k: int(v or 1) for k, v in attrs if k in ("rowspan", "colspan")}
            self.cell, self.spans = [], (given.get("rowspan", 1), given.get("colspan", 1))
        elif tag == "sup" and self.cell is not None:
            self.cell.append("^")

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th") and self.cell is not None:
            self.tables[-1][-1].append((" ".join("".join(self.cell).split()), *self.spans))
            self.cell = None

    def handle_data(self, data: str) -> None:
        if self.cell is not None:
            self.cell.append(data)


def _grid(rows: list[list[tuple[str, int, int]]]) -> list[list[str]]:
    """Cells by row and column, those that span several repeated."""
    filled: dict[tuple[int, int], str] = {}
    for i, row in enumerate(rows):
        j = 0
        for text, high, wide in row:
            while (i, j) in filled:
                j += 1
            for a in range(high):
                for b in range(wide):
                    filled[i + a, j + b] = text
            j += wide
    width = 1 + max((j for _, j in filled), default=-1)
    return [[filled.get((i, j), "") for j in range(width)] for i in range(len(rows))]


def tables(html: str) -> list[list[list[str]]]:
    """Every table of a page as rows of cells, heads first."""
    return [_grid(rows) for rows in _Tables(html).tables]


def table_of(html: str, *heads: str) -> list[list[str]]:
    """The rows below the head of the one table that has these words in its last head row."""
    found = []
    for grid in tables(html):
        for i, row in enumerate(grid):
            if all(h in row for h in heads):
                found.append(grid[i:])
                break
    assert found, f"no table has the columns {heads}"
    return [row for grid in found for row in grid]


def figure(text: str) -> float | None:
    """A number as it is written for people; None where there is none."""
    text = text.replace("\u202f", "").translate(RAISED)
    match = re.match(r"(-?[\d.]+)(?:·10\^(-?\d+))?", text)
    return None if match is None else float(match[1]) * 10.0 ** int(match[2] or 0)


def drawn(axes: Axes) -> np.ndarray:
    """Every finite ordinate of an axis' curves."""
    values = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in axes.lines])
    return values[np.isfinite(values)]
