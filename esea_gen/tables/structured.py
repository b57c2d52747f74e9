"""Tables of MATLAB, HDF5, Parquet and JSON files: named arrays, those in structs by ``s.t``."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.errors import UserError, from_extra
from esea_gen.tables.form import TableFormat, check_unique, listed, missing_column, shortened
from esea_gen.tables.table import FileTable

DEEPEST = 8  # levels of structs and groups
MOST_NAMES = 10_000  # variables or data sets of a file
MOST_VALUES = 10**8  # of a file's columns together
MOST_UNPACKED_BYTES = 1 << 32  # of a MATLAB file
LONGEST_S = 120.0
# What a file has: an array, or a text that says why a name is no column.
Content = dict[str, "np.ndarray[Any, Any] | str"]


def table_of(
    content: Content,
    name: str,
    wanted: Sequence[str] | None,
    optional: Sequence[str],
    form: TableFormat,
    digest: str,
) -> FileTable:
    """Equally long vectors of a file's content as a table, the wanted ones or all."""
    known = [k for k, v in content.items() if not isinstance(v, str) and np.size(v) > 1]
    cells: dict[str, Any] = {}
    for w in known if wanted is None else [*wanted, *(o for o in optional if o in content)]:
        value = content.get(w)
        if isinstance(value, str):
            raise UserError(f"{name}: '{w}' is {value}.", f"Name a column: {listed(known)}.")
        if value is None or w not in known:
            raise missing_column(name, w, known, "Correct the column's name.")
        column = np.squeeze(value)
        if column.ndim != 1 or column.dtype.kind in "cbSV":
            raise UserError(
                f"{name}: '{w}' has shape {value.shape} and type {value.dtype}, it is not a vector "
                "of real numbers or texts.",
                f"Name one that is: {listed([k for k in known if k != w])}.",
            )
        cells[w] = column
    lengths = {w: len(v) for w, v in cells.items()}
    if len(set(lengths.values())) > 1:
        raise UserError(
            f"{name}: the columns have different lengths {lengths}.", "Name equally long ones."
        )
    rows = np.arange(1, max(lengths.values(), default=0) + 1, dtype=np.intp)
    return FileTable(name, tuple(known), cells, rows, form, digest)


def read_mat(raw: bytes, name: str, wanted: Sequence[str] | None) -> Content:
    """Variables of a MATLAB file, and the fields of its structs; version 7.3 is HDF5."""
    if raw.startswith((b"MATLAB 7.3 MAT-file", b"\x89HDF")):
        return read_hdf5(raw, name, wanted)
    with _damage_named(name, "a MATLAB"):
        return _apart(raw, name)


def _apart(raw: bytes, name: str) -> Content:
    # SciPy's reader may end its process where a file is damaged, and unpacks without a bound: it
    # runs in a process of its own, which sends arrays and texts back.
    code = "import sys; from esea_gen.tables.structured import send_mat; send_mat(sys.argv[1])"
    done = subprocess.run(
        [sys.executable, "-c", code, name],
        input=raw,
        capture_output=True,
        check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        timeout=LONGEST_S,
    )
    if done.returncode == 2:
        what, _, fix = done.stderr.decode("utf-8", "replace").partition("\n")
        raise UserError(what, fix.strip())
    if done.returncode:
        raise ValueError("it is damaged, or needs more than 4 GiB")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as sent:
        texts: dict[str, str] = json.loads(str(sent["texts"]))
        return texts | {k[1:]: sent[k] for k in sent.files if k != "texts"}


def send_mat(name: str) -> None:
    """Write a MATLAB file's content, from standard input, to standard output as ``.npz``."""
    with suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MOST_UNPACKED_BYTES, MOST_UNPACKED_BYTES))
    try:
        content = _mat(sys.stdin.buffer.read(), name)
    except UserError as error:
        print(f"{error.what}\n{error.fix}", file=sys.stderr)
        raise SystemExit(2) from None
    texts = {k: v for k, v in content.items() if isinstance(v, str)}
    arrays = {f"_{k}": v for k, v in content.items() if not isinstance(v, str)}
    out = io.BytesIO()
    np.savez(out, allow_pickle=False, texts=np.array(json.dumps(texts)), **arrays)
    sys.stdout.buffer.write(out.getvalue())


def _mat(raw: bytes, name: str) -> Content:
    with _damage_named(name, "a MATLAB"):
        kinds = scipy.io.whosmat(io.BytesIO(raw))
        _bounded(name, len(kinds), sum(np.prod(shape, dtype=float) for _, shape, _ in kinds))
        out = _flat_mat(name, scipy.io.loadmat(io.BytesIO(raw)))
        # Only so is a logical array one of bool; a complex one then loses its imaginary part.
        with warnings.catch_warnings(action="ignore"):
            typed = _flat_mat(name, scipy.io.loadmat(io.BytesIO(raw), mat_dtype=True))
    for k, v in typed.items():
        if isinstance(v, np.ndarray) and v.dtype.kind == "b":
            out[k] = "a logical array, not a vector of numbers"
    return out


def _flat_mat(name: str, content: Mapping[str, Any]) -> Content:
    out: Content = {}
    for k, v in content.items():
        if not k.startswith("__"):
            _struct(name, k, v, out)
    return out


def _struct(name: str, path: str, value: Any, out: Content, depth: int = 0) -> None:
    # A struct is an array with named fields; one of 1 x 1 has columns.
    names = getattr(getattr(value, "dtype", None), "names", None)
    if not names:
        plain = isinstance(value, np.ndarray) and not value.dtype.hasobject
        out[path] = value if plain else "a cell array, or of a class that is not read"
        return
    fields = listed([f"{path}.{n}" for n in names])
    if np.size(value) != 1:
        out[path] = f"an array of {np.size(value)} structs with the fields {fields}"
    elif depth == DEEPEST:
        out[path] = f"a struct {DEEPEST} levels deep"
    else:
        out[path] = f"a struct with the fields {fields}"
        for n in names:
            _struct(name, f"{path}.{n}", np.ravel(value)[0][n], out, depth + 1)


def read_hdf5(raw: bytes, name: str, wanted: Sequence[str] | None) -> Content:
    """Data sets of an HDF5 file by path, groups divided by ``/`` or ``.``."""
    h5py = from_extra("h5py", "files", f"{name}: an HDF5 file, as MATLAB 7.3 writes too,")
    out: Content = {}
    size = 0.0
    pick = None if wanted is None else {w.replace(".", "/").strip("/") for w in wanted}

    def take(path: str, item: Any) -> None:
        nonlocal size
        keys = [path, path.replace("/", ".")] if wanted and path not in wanted else [path]
        if not isinstance(item, h5py.Dataset):
            found: Any = f"a group with {listed([f'{path}/{k}' for k in item])}"
        elif item.attrs.get("MATLAB_class", b"") in (b"char", b"logical", b"cell", b"struct"):
            found = f"of the MATLAB class {item.attrs['MATLAB_class'].decode()}, not numbers"
        elif item.attrs.get("MATLAB_empty", 0):
            found = "an empty array"
        elif item.dtype.names:
            found = f"a compound with {listed([f'{path}.{n}' for n in item.dtype.names])}"
            inner = item.dtype.names
            if item.ndim == 1 and (pick is None or any(f"{path}/{n}" in pick for n in inner)):
                size += item.size * len(inner)
                _bounded(name, len(out), size)
                rows = item[()]
                out.update({f"{path}.{n}": rows[n] for n in inner})
        elif pick is None or path in pick:
            size += item.size or 0
            _bounded(name, len(out), size)
            found = np.asarray(
                item.asstr()[()] if h5py.check_string_dtype(item.dtype) else item[()]
            )
        else:
            found = np.empty(2)  # only its name is needed
        out.update(dict.fromkeys(keys, found))
        _bounded(name, len(out), size)

    with _damage_named(name, "an HDF5"), h5py.File(io.BytesIO(raw), "r") as file:
        file.visititems(take)
    return out


def read_parquet(raw: bytes, name: str, wanted: Sequence[str] | None) -> Content:
    """Columns of a Parquet file, those of structs by ``s.t``."""
    pa = from_extra("pyarrow", "files", f"{name}: a Parquet file")
    parquet = from_extra("pyarrow.parquet", "files", f"{name}: a Parquet file")
    with _damage_named(name, "a Parquet"):
        file = parquet.ParquetFile(pa.BufferReader(raw))
        roots = file.schema_arrow.names
        check_unique(name, "", roots, "Give every column a name of its own.")
        used = [
            r
            for r in roots
            if wanted is None or any(w == r or w.startswith(f"{r}.") for w in wanted)
        ]
        _bounded(name, len(roots), file.metadata.num_rows * len(used))
        table = file.read(columns=used)
        out: Content = {r: np.empty(2) for r in roots if r not in used}
        for _ in range(DEEPEST):
            structs = [f for f in table.schema if pa.types.is_struct(f.type)]
            if not structs:
                break
            for f in structs:
                inner = listed([f"{f.name}.{c.name}" for c in f.type])
                out[f.name] = f"a struct with the fields {inner}"
            table = table.flatten()
        check_unique(name, "", table.column_names, "Give every column a name of its own.")
        for field, column in zip(table.schema, table.columns, strict=True):
            out[field.name] = _arrow(pa, field.type, column)
    return out


def _arrow(pa: Any, kind: Any, column: Any) -> Any:
    types = pa.types
    if types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if types.is_decimal(kind):
        column, kind = column.cast(pa.float64()), pa.float64()
    if types.is_floating(kind) or (types.is_integer(kind) and not column.null_count):
        return column.to_numpy()
    if types.is_integer(kind) or types.is_string(kind) or types.is_large_string(kind):
        return _objects(column.to_pylist())  # whole numbers stay so: a float has 53 bits
    return f"of the type {kind}, neither numbers nor texts"


def read_json(text: str, name: str) -> Content:
    """Columns by name, or a list of rows; objects in them by ``s.t``; null is an empty cell."""

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        check_unique(name, "", (k for k, _ in pairs), "Give every key once.")
        return dict(pairs)

    try:
        content = json.loads(text, object_pairs_hook=unique)
        if isinstance(content, list) and content and all(isinstance(r, dict) for r in content):
            rows = [_flat(r) for r in content]
            keys = dict.fromkeys(k for row in rows for k in row)
            _bounded(name, len(keys), len(keys) * len(rows))
            return {k: _objects([row.get(k) for row in rows]) for k in keys}
        flat = _flat(content) if isinstance(content, dict) else {}
    except (ValueError, RecursionError) as error:
        raise UserError(f"{name}: is not JSON ({error}).", "Check the file.") from None
    columns = {k: _objects(v) for k, v in flat.items() if isinstance(v, list)}
    if not columns:
        raise UserError(
            f"{name}: holds neither columns by name nor a list of rows.",
            'Write {"time": [...], "torque": [...]} or [{"time": 0.0, "torque": 0.0}, ...].',
        )
    return {k: columns.get(k, "a single value") for k in flat}


def _flat(content: Mapping[str, Any], before: str = "", depth: int = 0) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for k, v in content.items():
        path = f"{before}{k}"
        if isinstance(v, dict) and depth < DEEPEST:
            out.update(_flat(v, f"{path}.", depth + 1))
        else:
            out[path] = v
    return out


def _objects(values: list[Any]) -> np.ndarray[Any, Any]:
    out = np.empty(len(values), dtype=object)
    for k, v in enumerate(values):  # a list stays one, whatever its length
        out[k] = v
    return out


@contextmanager
def _damage_named(name: str, kind: str) -> Iterator[None]:
    # What a damaged file makes a library raise is not in its manual.
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        why = shortened(str(error)) or type(error).__name__
        raise UserError(
            f"{name}: is not {kind} file ({why}).", "Check the file, or export CSV."
        ) from None


def _bounded(name: str, names: int, values: float) -> None:
    if names > MOST_NAMES or values > MOST_VALUES:
        raise UserError(
            f"{name}: has {names} variables and {values:.3g} values, above the limits of "
            f"{MOST_NAMES} and {MOST_VALUES:.0e}.",
            "Give only the columns that are needed, in parts.",
        )
