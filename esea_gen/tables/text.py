"""Delimited text: :mod:`csv` in strict mode, a row a line, its structure verified.

pyarrow takes an open quote to the file's end and 0x10 for a number, and keeps one of two columns of
one name; pandas moves the columns of rows that are longer than the header; neither names lines.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice

import numpy as np

from esea_gen.errors import UserError
from esea_gen.tables.table import (
    COMMA,
    GROUPED,
    NOT_FINITE,
    POINT,
    SIMULATED,
    FileTable,
    TableFormat,
    check_unique,
    listed,
    missing_columns,
    numbered,
    remedy,
    shortened,
)

MARKS = {  # The longer ones first: UTF-32 begins as UTF-16 does.
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
# What a spreadsheet writes in place of a value it cannot compute: #N/A, #NV, #DIV/0!, #WERT!
FAULT = r"#(?:N/[AD]|NV|[^\W_]+(?:/0)?[!?])"
# A cell that names nothing: no letter but in a number, a time or one of these.
NO_NAME = re.compile(
    rf"(?:[\W\d_]|(?<=\d)[eEdDxT](?=[+\-\d]))*|{NOT_FINITE.pattern}|{FAULT}|n/a|null", re.IGNORECASE
)
# str.strip takes these off a number as if they were blanks.
CONTROLS = "".join(chr(k) for k in range(1, 32) if k not in b"\t\n\r") + "\x7f\x85\u2028\u2029"
CONTROL = re.compile(f"[{CONTROLS}]")
BLANKS = " \t\r\n"
DELIMITERS = (",", ";", "\t", "|")
SAMPLE = 20  # rows that the delimiter is detected by
DECIMALS = 1000  # rows that the decimal mark is detected by
MOST_HEADER = 1000  # lines that are searched for a header to propose


@dataclass
class TextReader:
    name: str
    text: str
    form: TableFormat
    settings: str
    wanted: Sequence[str] | None = None  # all if None
    optional: Sequence[str] = ()
    fields: int | None = None  # cells of a row; default: the header's
    drop_ragged: bool = False  # leave out and count
    left_out: list[str] = field(default_factory=list)

    def fix(self, key: str, otherwise: str) -> str:
        return remedy(self.settings, key, otherwise)

    def read(self, digest: str) -> FileTable:
        """Read the file; digest: of its bytes."""
        if self.form.delimiter is None:
            self.form = self.form.model_copy(update={"delimiter": self._delimiter()})
        header_line, names, first, rows = self._header()
        width = self.fields or len(names)
        if header_line == 0:
            names = [str(k) for k in range(1, width + 1)]
        elif width != len(names):
            raise UserError(
                f"{self.name}: line {header_line} has {len(names)} names, but rows have {width} "
                "cells.",
                "Name every column, or number them: a file without a header.",
            )
        self._check_names(header_line, names)
        chosen = [n for n in names if n]
        if self.wanted is not None:
            chosen = [n for n in chosen if n in {*self.wanted, *self.optional}]
        places = [names.index(n) for n in chosen]
        columns: list[list[str]] = [[] for _ in places]
        self._check_cells(header_line, names, names)
        control = any(c in self.text for c in CONTROLS)
        lines: list[int] = []
        empty: list[int] = []
        ragged: list[int] = []
        for line, row in rows:
            if line < first:
                continue
            if len(row) != width:
                if not self.drop_ragged:
                    raise self._ragged(line, len(row), header_line, width)
                ragged.append(line)
                continue
            if control:
                self._check_cells(line, row, names)
            if not any(map(str.strip, row)):
                empty.append(line)
            else:
                lines.append(line)
                for column, place in zip(columns, places, strict=True):
                    column.append(row[place])
        for why, gone in (("without a value", empty), (f"of other than {width} cells", ragged)):
            if gone:
                rows_word = "row" if len(gone) == 1 else "rows"
                self.left_out.append(f"{len(gone)} {rows_word} {why} ({numbered('line', gone)})")
        decimal = self.form.decimal or self._decimal(columns)
        update = {"kind": "csv", "header_line": header_line, "decimal": decimal}
        return FileTable(
            self.name,
            tuple(names),
            dict(zip(chosen, columns, strict=True)),
            np.array(lines, dtype=np.intp),
            self.form.model_copy(update=update),
            digest,
            tuple(self.left_out),
            self.settings,
            re.match(rf"#[ \t]*{SIMULATED}[ \t]*[\r\n]", self.text) is not None,
        )

    def _header(self) -> tuple[int, list[str], int, Iterator[tuple[int, list[str]]]]:
        # Line and names of the header, first line of numbers, and the rows that follow.
        given = self.form.header_line
        first = self.form.first_data_line or (given or 0) + 1
        start = given or (first if given == 0 else 1)
        rows = self._rows(self.form.delimiter or ",", skip=start)
        line, row = next(rows, (0, []))
        if start > 1:
            self.left_out.append(
                f"{start - 1} line{'s' * (start > 2)} before the "
                + ("header" if given else "first data line")
            )
        if given == 0:
            return 0, row, first, chain([(line, row)], rows) if line else rows
        if not line or (given and line != given):
            raise UserError(
                f"{self.name}: has no line {given or 1} with column names.",
                self.fix("header_line", "The first line names the columns"),
            )
        names = [n.strip(BLANKS) for n in row]
        if given and names[0].startswith("#"):
            names[0] = names[0].lstrip("# ")
        if given is None and all(map(NO_NAME.fullmatch, names)):
            better = self._better_header(line)
            fix = self.fix("header_line = 0", "Write a line with the column names")
            raise UserError(
                f"{self.name}: line {line} has numbers, no column names: "
                f"{shortened(', '.join(row))}.",
                self._names_at(better) if better else fix,
            )
        first = max(first, line + 1)
        if first > line + 1:
            self.left_out.append(f"lines {line + 1} to {first - 1}, by first_data_line")
        return line, names, first, rows

    def _rows(self, delimiter: str, skip: int = 1) -> Iterator[tuple[int, list[str]]]:
        # Line and cells of each row from line ``skip`` on, without blank and comment lines.
        comments: list[int] = []
        fault = re.compile(rf"{FAULT} *(?:{re.escape(delimiter)}|$)")
        for line, raw in enumerate(io.StringIO(self.text, newline=""), 1):
            if line < skip or not raw.strip(BLANKS):
                continue
            explicit = line == self.form.header_line
            if raw.startswith("#") and not explicit and not fault.match(raw):
                comments.append(line)
                continue
            yield line, self._cells(line, raw.rstrip("\r\n"), delimiter)
        if comments:
            lines = f"{len(comments)} comment line{'s' if len(comments) > 1 else ''}"
            self.left_out.insert(0, f"{lines} ({numbered('line', comments)})")

    def _cells(self, line: int, raw: str, delimiter: str) -> list[str]:
        quote = self.form.quote
        if delimiter == " ":
            raw = raw.strip(" ")
        elif not (quote and quote in raw) and len(raw) < csv.field_size_limit():
            return raw.split(delimiter)  # as csv does it, in a fifth of the time
        try:
            # One line at a time: a quote that is not closed ends with its line.
            (row,) = csv.reader(
                [raw],
                delimiter=delimiter,
                quotechar=quote or None,
                quoting=csv.QUOTE_MINIMAL if quote else csv.QUOTE_NONE,
                skipinitialspace=True,
                strict=True,
            )
            return row
        except csv.Error as error:
            raise self._broken(line, raw, delimiter, str(error)) from None

    def _broken(self, line: int, raw: str, delimiter: str, said: str) -> UserError:
        if "field limit" in said:
            return UserError(
                f"{self.name}: line {line} has a cell of more than {csv.field_size_limit()} "
                "characters.",
                "Shorten it, or check that the file is a table.",
            )
        quote = self.form.quote
        column, opens = _broken_quote(raw, delimiter, quote)
        what = "opens and is not closed in the line" if opens else "closes within the cell's text"
        return UserError(
            f"{self.name}: line {line}, character {column}: a quote ({quote}) {what}, "
            f"before: {shortened(raw[column:])}.",
            self.fix(
                'quote = "" (quoting off)',
                "Close the quote, or double it if it is text in a quoted cell",
            ),
        )

    def _check_cells(self, line: int, row: list[str], names: list[str]) -> None:
        for cell, column in zip(row, names, strict=True):
            if found := CONTROL.search(cell):
                raise UserError(
                    f"{self.name}: line {line}, column '{shortened(column)}' has the control "
                    f"character U+{ord(found[0]):04X}.",
                    "Remove it, or check that the file is a table.",
                )

    def _ragged(self, line: int, found: int, header_line: int, width: int) -> UserError:
        names = "names in the header" if header_line else "cells in the first row"
        what = f"{self.name}: line {line} has {found} cells for {width} {names}."
        better = self._better_header(header_line)
        if better:
            fix = self._names_at(better)
        else:
            fix = self.fix(
                "delimiter, decimal or header_line",
                "Give every row as many cells as the header (the delimiter is "
                f"{self.form.delimiter!r}; a decimal comma among commas, and a delimiter at the "
                "end of the line, make one more)",
            )
        return UserError(what, fix)

    def _check_names(self, header_line: int, names: list[str]) -> None:
        where = f", line {header_line}" if header_line else ""
        check_unique(
            self.name,
            where,
            names,
            self.fix(
                f"header_line = 0 and first_data_line = {header_line + 1} (columns '1', '2', ...)",
                "Give every column a name of its own",
            ),
        )
        if missing := [w for w in self.wanted or () if w not in names]:
            better = self._better_header(header_line)
            fix = self._names_at(better) if better else "Correct the name."
            raise missing_columns(f"{self.name}{where}", missing, names, fix)

    def _names_at(self, line: int) -> str:
        return self.fix(
            f"header_line = {line}", f"Line {line} has the names: make it the first one, without #"
        )

    def _better_header(self, header_line: int) -> int:
        # A line that has all names, behind a preamble or in a comment; 0: there is none.
        if not self.wanted:
            return 0
        lines = islice(io.StringIO(self.text, newline=""), MOST_HEADER)
        for line, raw in enumerate(lines, 1):
            cells = {c.strip(' \r\n"') for c in re.split(r"[,;\t|]", raw.lstrip("# "))}
            if line != header_line and cells >= set(self.wanted):
                return line
        return 0

    def _delimiter(self) -> str:
        # The one by which the header and the rows behind it have equally many cells.
        counts: dict[str, list[int]] = {}
        first = self.form.header_line or 1
        if self.form.header_line == 0:
            first = self.form.first_data_line or 1
        before, self.left_out = self.left_out, []
        for d in (*DELIMITERS, " "):
            try:
                counts[d] = [len(r) for _, r in islice(self._rows(d, first), SAMPLE + 1)]
            except UserError:
                continue
        self.left_out = before
        several = {d: c for d, c in counts.items() if c and c[0] > 1}
        even = [d for d, c in several.items() if len(set(c)) == 1]
        even = [d for d in even if d != " "] or even
        if len(even) > 1:
            raise UserError(
                f"{self.name}: both {listed(even)} divide the lines into equally many cells.",
                self.fix("delimiter", "Write the file with one of them only"),
            )
        if even:
            return even[0]
        several.pop(" ", None)
        return max(several, key=lambda d: several[d][0]) if several else ","

    def _decimal(self, columns: list[list[str]]) -> str | None:
        # None: every comma could be a decimal mark or group thousands.
        sample = [c.strip() for column in columns for c in column[:DECIMALS]]
        commas = [c for c in sample if "," in c and COMMA.fullmatch(c)]
        if not commas or any("." in c and POINT.fullmatch(c) for c in sample):
            return "."
        clear = any(not GROUPED.fullmatch(c) or c.lstrip("+-").startswith("0") for c in commas)
        return "," if clear else None


def _broken_quote(raw: str, delimiter: str, quote: str) -> tuple[int, bool]:
    # Character of the quote that breaks a line, from 1, and whether it is an opening one.
    start, inside, at = True, 0, 0
    while at < len(raw):
        c = raw[at]
        if inside:
            if c == quote and raw[at + 1 : at + 2] == quote:
                at += 1
            elif c == quote:
                if raw[at + 1 : at + 2] not in ("", delimiter):
                    return at + 1, False
                inside = 0
        elif c == quote and start:
            inside = at + 1
        start = c == delimiter or (start and c == " ")
        at += 1
    return inside, True


def decoded(raw: bytes, name: str, form: TableFormat, settings: str) -> tuple[str, str]:
    """Text of a file and its encoding; a byte order mark is taken off."""
    mark = next((m for m in MARKS if raw.startswith(m)), b"")
    encoding = form.encoding or MARKS.get(mark, "utf-8")
    fix = "Repair the file, or convert it to UTF-8."
    if settings:
        fix = f"Set encoding in {settings} (latin-1, utf-16-le or gb18030, for example)."
    if mark == codecs.BOM_UTF8 and codecs.lookup(encoding).name not in ("utf-8", "utf-8-sig"):
        raise UserError(
            f"{name}: begins with the byte order mark of UTF-8, its encoding is given as "
            f"'{encoding}'.",
            "Leave encoding out.",
        )
    try:
        text = raw.decode(encoding)
    except UnicodeError as error:
        before = raw[: getattr(error, "start", 0)].split(b"\n")
        raise UserError(
            f"{name}: line {len(before)}, byte {len(before[-1]) + 1}: not text in the encoding "
            f"'{encoding}' ({getattr(error, 'reason', error)}).",
            fix,
        ) from None
    if "\0" in text:
        lines = text[: text.index("\0")].split("\n")
        raise UserError(
            f"{name}: line {len(lines)}, character {len(lines[-1]) + 1} is a NUL: the file is "
            f"damaged or not text in the encoding '{encoding}'.",
            fix,
        )
    return text.lstrip("\ufeff"), encoding
