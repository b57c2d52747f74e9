"""Columns of recorded files: delimited text; of others see READERS."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_gen.identify.columns import LONGEST_SHOWN, missing_column, shortened
from esea_gen.identify.tables import FileFormat
from esea_gen.language.ports import Array

# How files that are no text begin: MATLAB of version 5 and 7.3, HDF5, Parquet.
MAGIC = {
    b"MATLAB 5.0 MAT-file": "mat",
    b"MATLAB 7.3 MAT-file": "mat",
    b"\x89HDF\r\n": "hdf5",
    b"PAR1": "parquet",
}


def read_csv(
    raw: bytes, name: str, form: FileFormat, wanted: Sequence[str]
) -> tuple[dict[str, Array], npt.NDArray[np.intp]]:
    for start, kind in MAGIC.items():
        if raw.startswith(start):
            title = "MATLAB" if kind == "mat" else kind
            raise UserError(
                f"{name}: is a {title} file, but it is read as text.",
                f"Set kind = '{kind}' in the mapping's format.",
            )
    try:
        text = raw.decode(form.encoding)
    except (UnicodeDecodeError, UnicodeError) as error:
        raise UserError(
            f"{name}: is not text in the encoding '{form.encoding}' ({error}).",
            "Set encoding in the mapping's format: latin-1, utf-16 or gb18030, for example.",
        ) from None
    reader = csv.reader(
        io.StringIO(text.removeprefix("\ufeff"), newline=""),
        delimiter=form.delimiter,
        quotechar=form.quote,
    )
    first = form.first_data_line or form.header_line + 1
    header: list[str] | None = None
    index: list[int] = []
    values: list[list[float]] = []
    rows: list[int] = []
    last = 0
    try:
        for cells in reader:
            line, last = last + 1, reader.line_num
            if line == form.header_line:
                header = [c.strip() for c in cells]
                index = _columns(name, header, wanted)
            if line < first or not any(c.strip() for c in cells):
                continue
            if not index:
                header = [str(i + 1) for i in range(len(cells))]
                index = _columns(name, header, wanted)
            if header is not None and any(c.strip() for c in cells[len(header) :]):
                raise UserError(
                    f"{name}: line {line} has {len(cells)} cells, but there are {len(header)} "
                    "columns.",
                    "Mend the line; a decimal comma among comma-separated cells does this: set "
                    "delimiter in the mapping's format.",
                )
            values.append(_numbers(name, line, cells, wanted, index, form))
            rows.append(line)
    except csv.Error as error:
        raise UserError(
            f"{name}: line {last + 1} is not a row of cells ({shortened(str(error))}).",
            "Check delimiter and quote in the mapping's format.",
        ) from None
    if form.header_line and header is None:
        raise UserError(
            f"{name}: has no line {form.header_line} with column names.",
            "Correct header_line in the mapping's format.",
        )
    table = np.array(values, dtype=np.float64).reshape(len(values), len(wanted))
    return {w: table[:, i] for i, w in enumerate(wanted)}, np.array(rows, dtype=np.intp)


def read_table(
    path: Path, text: str, wanted: Sequence[str], advice: str, form: FileFormat | None = None
) -> dict[str, Array]:
    """Columns of finite numbers of a text that no mapping file describes.

    advice: what to do where something is wrong.
    form: names in the first line, commas and decimal points by default.
    """
    try:
        found, lines = read_csv(text.encode(), str(path), form or FileFormat(), wanted)
    except UserError as error:
        raise UserError(error.what, advice) from None
    for name, values in found.items():
        for k in np.flatnonzero(~np.isfinite(values)):
            text = f"{path}: line {lines[k]}, column '{name}': {values[k]:g} is not finite."
            raise UserError(text, advice)
    return found


def _columns(name: str, header: list[str], wanted: Sequence[str]) -> list[int]:
    for w in wanted:
        if w not in header:
            raise missing_column(name, w, header, "column")
        if header.count(w) > 1:
            raise UserError(
                f"{name}: the column name '{w}' occurs {header.count(w)} times.",
                "Use header_line = 0 and number the columns '1', '2', ... in the mapping file.",
            )
    return [header.index(w) for w in wanted]


def _numbers(
    name: str,
    line: int,
    cells: list[str],
    wanted: Sequence[str],
    index: list[int],
    form: FileFormat,
) -> list[float]:
    try:
        return [float(cells[i]) for i in index]
    except (ValueError, IndexError):
        pass  # a decimal comma, or which cell it is, below
    out = []
    for w, i in zip(wanted, index, strict=True):
        if i >= len(cells):
            raise UserError(
                f"{name}: line {line} has {len(cells)} cells, too few for column '{w}' "
                f"(cell {i + 1}).",
                "Complete the row, or check delimiter and first_data_line in the mapping's format.",
            )
        cell = cells[i].strip()
        try:
            out.append(float(cell.replace(",", ".") if form.decimal == "," else cell))
        except ValueError:
            raise UserError(
                f"{name}: line {line}, column '{w}': '{shortened(cell)}' is not a number.",
                "A quote that is not closed swallows the lines behind it: mend it, or set quote in "
                "the mapping's format."
                if "\n" in cell or len(cell) > LONGEST_SHOWN
                else "Correct the cell, or check first_data_line and decimal in the mapping's "
                "format.",
            ) from None
    return out
