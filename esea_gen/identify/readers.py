"""Readers by kind of file: text, MATLAB, HDF5, Parquet, JSON."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.errors import UserError
from esea_gen.identify.columns import Columns, vectors
from esea_gen.identify.reading import read_csv
from esea_gen.identify.tables import FileFormat


def read_mat(raw: bytes, name: str, form: FileFormat, wanted: Sequence[str]) -> Columns:
    """Variables of a MATLAB file; of version 7.3, which is HDF5, with h5py."""
    if raw.startswith(b"MATLAB 7.3 MAT-file"):
        return read_hdf5(raw, name, form, wanted)
    try:
        content = scipy.io.loadmat(io.BytesIO(raw))
    except Exception as error:
        raise UserError(
            f"{name}: is not a MATLAB file ({error}).", "Check the file, or set kind = 'csv'."
        ) from None
    own = {k: v for k, v in content.items() if not k.startswith("__")}
    return vectors(name, own, wanted, "variable")


def read_hdf5(raw: bytes, name: str, form: FileFormat, wanted: Sequence[str]) -> Columns:
    """Data sets of an HDF5 file, by path."""
    try:
        import h5py
    except ImportError:
        raise UserError(
            f"{name}: is an HDF5 file, as MATLAB 7.3 writes too; the package h5py, which reads "
            "it, is not installed.",
            "Install it (pip install 'esea-gen[files]'), save with save(..., '-v7') in MATLAB, or "
            "export CSV.",
        ) from None
    found: dict[str, Any] = {}
    try:
        with h5py.File(io.BytesIO(raw), "r") as file:

            def take(path: str, item: Any) -> None:
                if isinstance(item, h5py.Dataset):
                    found[path] = item[()]

            file.visititems(take)
    except OSError as error:
        raise UserError(f"{name}: is not an HDF5 file ({error}).", "Check the file.") from None
    return vectors(name, found, wanted, "data set")


def read_parquet(raw: bytes, name: str, form: FileFormat, wanted: Sequence[str]) -> Columns:
    """Columns of a Parquet file; an empty cell is no number."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise UserError(
            f"{name}: the package pyarrow, which reads Parquet, is not installed.",
            "Install it (pip install 'esea-gen[files]'), or export CSV.",
        ) from None
    try:
        table = pyarrow.parquet.read_table(pyarrow.BufferReader(raw))
    except (pyarrow.ArrowException, OSError) as error:
        raise UserError(f"{name}: is not a Parquet file ({error}).", "Check the file.") from None
    columns = {c: table.column(c).to_numpy() for c in table.column_names}
    return vectors(name, columns, wanted, "column")


def read_json(raw: bytes, name: str, form: FileFormat, wanted: Sequence[str]) -> Columns:
    """Columns by name, or a list of rows; null is no number."""
    try:
        content = json.loads(raw.decode(form.encoding))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise UserError(f"{name}: is not JSON ({error}).", "Check the file and encoding.") from None
    if isinstance(content, list) and content and all(isinstance(r, dict) for r in content):
        keys = dict.fromkeys(k for row in content for k in row)
        content = {k: [row.get(k) for row in content] for k in keys}
    if not isinstance(content, dict) or not all(isinstance(v, list) for v in content.values()):
        raise UserError(
            f"{name}: holds neither columns by name nor a list of rows.",
            'Write {"time": [...], "torque": [...]} or [{"time": 0.0, "torque": 0.0}, ...].',
        )
    return vectors(name, {k: _numbers(v) for k, v in content.items()}, wanted, "column")


def _numbers(values: list[Any]) -> Any:
    # To Python true and false are integers; of a file they are no numbers.
    plain = all(v is None or type(v) in (int, float) for v in values)
    return np.array(values, dtype=np.float64 if plain else object)


Reader = Callable[[bytes, str, FileFormat, Sequence[str]], Columns]
READERS: dict[str, Reader] = {
    "csv": read_csv,
    "mat": read_mat,
    "hdf5": read_hdf5,
    "parquet": read_parquet,
    "json": read_json,
}

__all__ = ["READERS"]
