"""Columns of recorded files: delimited text and MATLAB."""

from __future__ import annotations

import csv
import difflib
import io
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import scipy.io

from esea_gen.errors import UserError
from esea_gen.identify.mapping import FileFormat
from esea_gen.language.ports import Array

# How MATLAB files of version 5 and 7.3 begin.
MAT_MAGIC = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file", b"\x89HDF\r\n")


def _missing_column(name: str, wanted: str, known: Sequence[str], kind: str) -> UserError:
    close = difflib.get_close_matches(wanted, known, n=1)
    hint = f"Did you mean '{close[0]}'? " if close else ""
    there = ", ".join(f"'{k}'" for k in known) or "none"
    return UserError(
        f"{name}: there is no {kind} '{wanted}'; there are {there}.",
        f"{hint}Correct the column in the mapping file.",
    )


def read_csv(
    raw: bytes, name: str, form: FileFormat, wanted: Sequence[str]
) -> tuple[dict[str, Array], npt.NDArray[np.intp]]:
    if raw.startswith(MAT_MAGIC):
        raise UserError(
            f"{name}: is a MATLAB file, but the mapping reads it as text.",
            "Set kind = 'mat' in the mapping's format.",
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
            f"{name}: line {last + 1} is not a row of cells ({error}).",
            "Check delimiter and quote in the mapping's format.",
        ) from None
    if form.header_line and header is None:
        raise UserError(
            f"{name}: has no line {form.header_line} with column names.",
            "Correct header_line in the mapping's format.",
        )
    table = np.array(values, dtype=np.float64).reshape(len(values), len(wanted))
    return {w: table[:, i] for i, w in enumerate(wanted)}, np.array(rows, dtype=np.intp)


def _columns(name: str, header: list[str], wanted: Sequence[str]) -> list[int]:
    for w in wanted:
        if w not in header:
            raise _missing_column(name, w, header, "column")
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
                f"{name}: line {line}, column '{w}': '{cell}' is not a number.",
                "Correct the cell, or check first_data_line and decimal in the mapping's format.",
            ) from None
    return out


def read_mat(
    raw: bytes, name: str, form: FileFormat, wanted: Sequence[str]
) -> tuple[dict[str, Array], npt.NDArray[np.intp]]:
    try:
        content = scipy.io.loadmat(io.BytesIO(raw))
    except NotImplementedError:
        raise UserError(
            f"{name}: is a MATLAB 7.3 file (HDF5), which is not read.",
            "Save it again with save(..., '-v7'), or export CSV.",
        ) from None
    except Exception as error:
        raise UserError(
            f"{name}: is not a MATLAB file ({error}).", "Check the file, or set kind = 'csv'."
        ) from None
    known = [k for k, v in content.items() if not k.startswith("__") and np.size(v) > 1]
    out: dict[str, Array] = {}
    for w in wanted:
        if w not in known:
            raise _missing_column(name, w, known, "variable")
        value = content[w]
        if value.dtype.kind not in "fiu" or np.squeeze(value).ndim != 1:
            raise UserError(
                f"{name}: variable '{w}' has shape {value.shape} and type {value.dtype}, it is not "
                "a vector of real numbers.",
                "Name a variable that is one.",
            )
        out[w] = np.asarray(np.squeeze(value), dtype=np.float64)
    lengths = {w: len(v) for w, v in out.items()}
    if len(set(lengths.values())) > 1:
        raise UserError(
            f"{name}: the variables have different lengths {lengths}.", "Name equally long ones."
        )
    return out, np.arange(1, min(lengths.values()) + 1, dtype=np.intp)
