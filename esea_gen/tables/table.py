"""A loaded table, its file format, and shared text of its messages."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, field_validator

from esea_gen.errors import UserError, nearest

LONGEST_SHOWN = 40  # characters of a cell in a message
MOST_SHOWN = 20  # names of columns in a message
MOST_LINES = 5  # line numbers in a message
SIMULATED, MARK = "simulated", "; SIMULATED"  # column of an export; what a text ends with
Kind = Literal["csv", "mat", "hdf5", "parquet", "json"]


class TableFormat(BaseModel):
    """Format of a file; omitted settings are detected."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    kind: Kind | None = Field(
        default=None,
        description="csv: text table; mat: MATLAB; json: columns by name, or a list of rows. By "
        "the file's content if left out.",
    )
    delimiter: str | None = Field(
        default=None,
        pattern=r"^(?:[^\w\s.+\-#\"']|[\t ])$",
        description="Between cells; a comma, semicolon, tab, bar or blanks are detected.",
    )
    quote: str = Field(
        default='"', pattern=r"^[^\w\s.,;+\-#]?$", description='Round a cell; "": no quoting.'
    )
    decimal: Literal[".", ","] | None = Field(
        default=None, description="Decimal mark; detected if left out."
    )
    encoding: str | None = Field(
        default=None,
        description="Text encoding, such as latin-1, utf-16 or gb18030; by the byte order mark, or "
        "utf-8, if left out.",
    )
    header_line: int | None = Field(
        default=None,
        ge=0,
        le=1000,
        description="Line with the column names; 0: none, named 1, 2, ... The first line that is "
        "neither blank nor a comment (#) if left out.",
    )
    first_data_line: int | None = Field(
        default=None, ge=1, le=1000, description="First line of numbers; the one after the header."
    )

    @field_validator("encoding")
    @classmethod
    def _known(cls, encoding: str | None) -> str | None:
        try:
            # Codecs that are not text encodings (base64) fail only when they are used.
            "a".encode(encoding or "utf-8")
        except (LookupError, UnicodeError):
            raise ValueError("not a known text encoding") from None
        return encoding


def shortened(text: str) -> str:
    """A cell for a message: one short line."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_SHOWN else f"{line[:LONGEST_SHOWN]}..."


def listed(names: Sequence[str]) -> str:
    shown = ", ".join(f"'{shortened(n)}'" for n in names[:MOST_SHOWN] if n) or "none"
    return shown + (f" and {len(names) - MOST_SHOWN} more" if len(names) > MOST_SHOWN else "")


def numbered(what: str, lines: Sequence[int]) -> str:
    """``line 3`` or ``lines 3, 4 and 10 more``."""
    shown = ", ".join(str(n) for n in lines[:MOST_LINES])
    more = f" and {len(lines) - MOST_LINES} more" if len(lines) > MOST_LINES else ""
    return f"{what}{'s' if len(lines) > 1 else ''} {shown}{more}"


def remedy(settings: str, key: str, otherwise: str) -> str:
    """Remedy, and the key of the format that helps if the user can set one."""
    return f"{otherwise}, or set {key} in {settings}." if settings else f"{otherwise}."


def missing_columns(name: str, missing: Sequence[str], known: Sequence[str], fix: str) -> UserError:
    """The error for columns that are not in a table."""
    hint = "".join(nearest(m, [n for n in known if n]) for m in missing)
    which = " or ".join(f"'{m}'" for m in missing)
    return UserError(
        f"{name}: there is no column {which}; the columns are {listed(known)}.", hint + fix
    )


def check_unique(name: str, where: str, names: Iterable[str], fix: str) -> None:
    """Reject a column name that occurs twice; empty names name nothing."""
    places: dict[str, list[int]] = {}
    for place, n in enumerate(names, 1):
        places.setdefault(n, []).append(place)
    for n, at in places.items():
        if n and len(at) > 1:
            raise UserError(
                f"{name}{where}: the column name '{shortened(n)}' occurs {len(at)} times "
                f"({numbered('column', at)}).",
                fix,
            )


Array = npt.NDArray[np.float64]
# Only what every reader of numbers takes alike: neither 1_234 nor 0x10 nor other scripts' digits.
NUMBER = {
    mark: re.compile(rf"[+-]?(?:\d+(?:{mark}\d*)?|{mark}\d+)(?:[eE][+-]?\d+)?", re.ASCII)
    for mark in (r"\.", ",")
}
POINT, COMMA = NUMBER[r"\."], NUMBER[","]
NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE | re.ASCII)
GROUPED = re.compile(r"[+-]?\d{1,3}(?:([,.'\u2019\u00a0\u202f ])\d{3})(?:\1\d{3})*(?:[.,]\d*)?")
LONG_INTEGER = re.compile(r"[+-]?\d{16,}", re.ASCII)
PLAIN = frozenset("0123456789+-eE \t\n")  # of these and a decimal mark float takes only numbers
# A channel of a lower rate than the rows': so many values at least, this share of them for the same
# number of rows within one; of more rows it is a test in steps.
LEAST_UPDATES, REGULAR, MOST_HELD = 20, 0.95, 100
EXACT = 2**53  # whole numbers up to here are doubles


def held_rows(values: Array) -> int:
    """Rows for which a sampled channel repeats each of its values; 1: it has one a row."""
    # A quantised one repeats values in slow motion, for changing numbers of rows, and moves on by
    # its resolution.
    at = np.flatnonzero(moves := np.diff(values))
    rows = np.diff(at)
    usual = int(np.median(rows)) if len(rows) >= LEAST_UPDATES else 1
    if not 1 < usual <= MOST_HELD or np.mean((rows > 1) & (abs(rows - usual) <= 1)) < REGULAR:
        return 1
    resolution = np.percentile(np.diff(np.unique(values)), 10)
    return usual if np.median(np.abs(moves[at])) > 2 * resolution else 1


@dataclass(frozen=True)
class FileTable:
    name: str  # the file, for messages
    names: tuple[str, ...]  # all columns of the file, in its order
    cells: dict[str, Sequence[str] | npt.NDArray[Any]]  # texts of a CSV, else arrays
    lines: npt.NDArray[np.intp]  # of each row, as an editor counts
    form: TableFormat  # how the file is written, as given or as detected
    digest: str  # First 16 digits of the file's SHA-256
    left_out: tuple[str, ...] = ()  # what was left out, with counts and lines
    settings: str = ""  # where users set the format, if anywhere
    marked: bool = False  # as simulated, by its first line
    held: dict[str, int] = field(default_factory=dict)  # rows, of those read that repeat values

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def unit_of_rows(self) -> Literal["line", "row"]:
        return "line" if self.form.kind == "csv" else "row"

    @property
    def simulated(self) -> bool:
        """Whether first line or a column marks the rows so; one in words is somebody else's."""
        with suppress(UserError):
            if SIMULATED in self.cells and self.numbers(SIMULATED, holes=True).any():
                return True
        return self.marked

    def at(self, row: int, column: str = "") -> str:
        """The place of a cell or row for a message, beginning with the file."""
        place = f"{self.name}: {self.unit_of_rows} {self.lines[row]}"
        return place + (f", column '{column}'" if column else "")

    def numbers(self, column: str, holes: bool = False) -> Array:
        """Return a column of numbers."""
        cells = self._column(column)
        values = self._parsed(column, cells) if isinstance(cells, list) else self._cast(column)
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad) and not holes:
            k = int(bad[0])
            text = self._text(cells[k])
            raise UserError(
                f"{self.at(k, column)} is {text or 'empty'} ({len(bad)} such "
                f"value{'s' if len(bad) > 1 else ''} in the column).",
                "Cut these rows out of the file or repair them.",
            )
        if (rows := held_rows(values)) > 1:
            self.held[column] = rows
        return values

    def texts(self, column: str) -> tuple[str, ...]:
        """Return a column as text, blanks at either end taken off."""
        return tuple(self._text(c) for c in self._column(column))

    def timed(self, column: str) -> FileTable:
        """Return the rows that have a finite time; the others are counted in ``left_out``."""
        return self.kept(np.isfinite(self.numbers(column, holes=True)), f"no '{column}'")

    def numeric(self, columns: Sequence[str]) -> FileTable:
        """Return the rows whose cells are numbers, NaN or empty; the others are counted."""
        # For logs with messages between the numbers.
        good = np.ones(len(self), dtype=bool)
        for column in columns:
            cells = self._column(column)
            good &= np.fromiter((self._is_number(self._text(c)) for c in cells), bool, len(self))
        return self.kept(good, "no number in " + ", ".join(f"'{c}'" for c in columns))

    def kept(self, rows: npt.ArrayLike, why: str) -> FileTable:
        """Return the rows of a mask; the others are counted under ``why``."""
        mask = np.asarray(rows, dtype=bool)
        gone = self.lines[~mask].tolist()
        if not gone:
            return self
        count = f"{len(gone)} row{'s' if len(gone) > 1 else ''}"
        said = f"{count} with {why} ({numbered(self.unit_of_rows, gone)})"
        cells: dict[str, Sequence[str] | npt.NDArray[Any]] = {
            k: v[mask]
            if isinstance(v, np.ndarray)
            else [c for c, keep in zip(v, mask, strict=True) if keep]
            for k, v in self.cells.items()
        }
        return replace(self, cells=cells, lines=self.lines[mask]).noting(said)

    def noting(self, left_out: str) -> FileTable:
        return replace(self, left_out=(*self.left_out, left_out))

    @property
    def usual(self) -> bool:
        """Whether there is nothing to say: plain CSV, or no text at all, and nothing left out."""
        f = self.form
        how = (f.encoding, f.delimiter, f.decimal, f.quote, f.header_line)
        plain = f.kind not in ("csv", None) or how == ("utf-8", ",", ".", '"', 1)
        return plain and not self.left_out

    def how(self) -> str:
        """Format of the file, and omitted data."""
        f = self.form
        how = str(f.kind)
        if f.kind == "csv":
            mark = {"\t": "tab", " ": "blanks"}.get(f.delimiter or "", f"'{f.delimiter}'")
            header = f"header in line {f.header_line}" if f.header_line else "no header"
            quote = f"quote '{f.quote}'" if f.quote else "no quoting"
            how += f", {f.encoding}, delimiter {mark}, decimal mark '{f.decimal or '.'}'"
            how += f", {quote}, {header}"
        return f"{how}; left out: {'; '.join(self.left_out) or 'nothing'}"

    def report(self) -> str:
        """One line: rows, format of the file, omitted data, whether simulated."""
        rows = f"{len(self)} row{'s' * (len(self) != 1)}"
        for column, n in self.held.items():
            rows += f", column '{column}' with a new value in every {n}. only (keep those, or "
            rows += "record it at the rows' rate)"
        return f"{self.name}: {rows}, {self.how()}{MARK * self.simulated}"

    def fix(self, key: str, otherwise: str) -> str:
        """A remedy by a key of the format, where the user can set one."""
        return remedy(self.settings, key, otherwise)

    def _column(self, column: str) -> Sequence[str] | npt.NDArray[Any]:
        if column not in self.cells:
            raise missing_columns(self.name, [column], self.names, "Correct the name.")
        return self.cells[column]

    def _text(self, cell: Any) -> str:
        return "" if cell is None else str(cell).strip()

    def _is_number(self, text: str) -> bool:
        pattern = COMMA if self.form.decimal == "," else POINT
        return not text or bool(pattern.fullmatch(text) or NOT_FINITE.fullmatch(text))

    def _parsed(self, column: str, cells: Sequence[str]) -> Array:
        comma = self.form.decimal == ","
        text = "\n".join(cells)
        if PLAIN | {"," if comma else "."} >= set(text):
            try:
                values = np.array([float(c) for c in text.replace(",", ".").split("\n")])
                if len(values) == len(cells) and np.all(np.abs(values) < EXACT):
                    return values
            except ValueError:
                pass  # which cell it is, below
        match = (COMMA if comma else POINT).fullmatch
        out = np.empty(len(cells))
        for k, cell in enumerate(cells):
            text = cell.strip()
            if match(text):
                value = float(text.replace(",", ".") if comma else text)
                if math.isinf(value) or (LONG_INTEGER.fullmatch(text) and Decimal(text) != value):
                    raise self._too_large(k, column, text)
            elif not text or NOT_FINITE.fullmatch(text):
                value = float(text or "nan")
            else:
                raise self._no_number(k, column, text)
            out[k] = value
        return out

    def _cast(self, column: str) -> Array:
        values = np.asarray(self.cells[column])
        if values.dtype.kind == "O":  # JSON: None is an empty cell; true and false are not numbers
            for k, v in enumerate(values):
                if v is not None and type(v) not in (int, float):
                    raise self._no_number(k, column, str(v))
                if type(v) is int and not _exact(v):
                    raise self._too_large(k, column, str(v))
            return np.array([math.nan if v is None else v for v in values], dtype=np.float64)
        if values.dtype.kind not in "fiu":
            raise UserError(
                f"{self.name}: column '{column}' has the type {values.dtype}, it is not a vector "
                "of real numbers.",
                "Name another column, or convert this one.",
            )
        if values.dtype.kind in "iu":
            for k in np.flatnonzero((values > EXACT) | (values < -EXACT)).tolist():
                if not _exact(int(values[k])):
                    raise self._too_large(k, column, str(values[k]))
        return np.asarray(values, dtype=np.float64)

    def _too_large(self, row: int, column: str, text: str) -> UserError:
        return UserError(
            f"{self.at(row, column)}: {shortened(text)} has no exact double: whole numbers are "
            f"exact to 2^53 = {EXACT}, numbers end at 1.8e308.",
            "Subtract an offset from the column, the first value for example.",
        )

    def _no_number(self, row: int, column: str, text: str) -> UserError:
        comma = self.form.decimal == ","
        settings = self.settings if row == 0 else ""  # a line of units, perhaps
        fix = remedy(settings, "first_data_line", "Correct the cell")
        if "_" in text and POINT.fullmatch(text.replace("_", "")):
            fix = f"Write {text.replace('_', '')}."
        elif GROUPED.fullmatch(text):
            fix = self.fix(
                "decimal",
                "Write numbers without grouping of thousands, with one decimal mark "
                f"(here '{self.form.decimal or '.'}')",
            )
        elif (POINT if comma else COMMA).fullmatch(text):
            fix = self.fix(
                "decimal", f"Write the decimal mark '{self.form.decimal or '.'}' in every cell"
            )
        return UserError(f"{self.at(row, column)}: '{shortened(text)}' is not a number.", fix)


def _exact(value: int) -> bool:
    try:
        return int(float(value)) == value
    except OverflowError:
        return False
