"""Tables of MATLAB, HDF5, Parquet and JSON files: named arrays, those in structs by ``s.t``."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, Literal

import numpy as np
import scipy  # its parts are read on first use

from esea_gen.errors import UserError, from_extra
from esea_gen.portability import limit_memory
from esea_gen.tables.table import (
    FileTable,
    TableFormat,
    check_unique,
    listed,
    missing_columns,
    shortened,
)

DEEPEST = 8  # levels of structs and groups
MOST_NAMES = 10_000  # variables or data sets of a file
MOST_VALUES = 10**8  # of a file's columns together
MOST_BYTES = 8 * MOST_VALUES  # of a file's columns, unpacked
MOST_TEXT_BYTES = 10**8  # of the texts in them
MOST_MEMORY_BYTES = 1 << 32  # of the process that reads a MATLAB file
BLOCK_BYTES = 1 << 16  # unpacked at once, to at most a thousand times as many
COMPRESSED = 15  # type of a variable in a MATLAB file
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
    """Equally long vectors of a file's content as a table, the requested ones or all."""
    sizes = {k: np.size(v) for k, v in content.items() if not isinstance(v, str)}
    # Beside vectors a single value is a setting; alone, single values are a table of one row.
    least = min(2, max(sizes.values(), default=0))
    single = {k for k, size in sizes.items() if size < least}
    known = [k for k in sizes if k not in single and _is_column(_vector(content[k]))]
    cells: dict[str, Any] = {}
    for w in known if wanted is None else [*wanted, *(o for o in optional if o in known)]:
        value = content.get(w)
        if isinstance(value, str):
            raise UserError(f"{name}: '{w}' is {value}.", f"Name a column: {listed(known)}.")
        if value is None:
            missing = [w for w in wanted or () if content.get(w) is None]
            raise missing_columns(name, missing, known, "Correct the name.")
        if w in single:
            raise UserError(
                f"{name}: '{w}' has {sizes[w]} values, the columns have more.",
                f"Name a column: {listed(known)}.",
            )
        column = _vector(value)
        if not _is_column(column):
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
    table = FileTable(name, tuple(known), cells, rows, form, digest)
    above = {k[: m.start()] for k in known for m in re.finditer(r"[./]", k)}
    gone = [k for k in content if k not in {*known, *above}] if wanted is None else []
    if wanted is None and not known:
        raise UserError(f"{name}: has no columns; it has {listed(gone)}.", "Write vectors.")
    return table.noting(f"{listed(gone)}, not columns") if gone else table


def _vector(value: Any) -> Any:
    return np.ravel(value) if np.size(value) == 1 else np.squeeze(value)


def _is_column(vector: Any) -> bool:
    return vector.ndim == 1 and vector.dtype.kind not in "cbSV"


def read_mat(raw: bytes, name: str, wanted: Sequence[str] | None) -> Content:
    """Variables of a MATLAB file, and the fields of its structs; version 7.3 is HDF5."""
    if raw.startswith((b"MATLAB 7.3 MAT-file", b"\x89HDF")):
        return read_hdf5(raw, name, wanted)
    with _damage_named(name, "a MATLAB"):
        _unpacked(raw, name)
        return apart(raw, name)


def apart(raw: bytes, name: str) -> Content:
    """A MATLAB file's content, read in a process of its own, which sends arrays and texts back."""
    # SciPy's reader may end its process where a file is damaged, and unpacks without a bound.
    code = "import sys; from esea_gen.tables.structured import send_mat; send_mat(sys.argv[1])"
    try:
        done = subprocess.run(
            [sys.executable, "-c", code, name],
            input=raw,
            capture_output=True,
            check=False,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
            timeout=LONGEST_S,
        )
    except subprocess.TimeoutExpired:
        raise UserError(
            f"{name}: is not read within the limit of {LONGEST_S:g} s.", "Split the file."
        ) from None
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
    with suppress(ValueError, OSError):
        limit_memory(MOST_MEMORY_BYTES)
    try:
        content = mat_content(sys.stdin.buffer.read(), name)
    except UserError as error:
        print(f"{error.what}\n{error.fix}", file=sys.stderr)
        raise SystemExit(2) from None
    texts = {k: v for k, v in content.items() if isinstance(v, str)}
    arrays = {f"_{k}": v for k, v in content.items() if not isinstance(v, str)}
    out = io.BytesIO()
    np.savez(out, allow_pickle=False, texts=np.array(json.dumps(texts)), **arrays)
    sys.stdout.buffer.write(out.getvalue())


def mat_content(raw: bytes, name: str) -> Content:
    with _damage_named(name, "a MATLAB"):
        kinds = scipy.io.whosmat(io.BytesIO(raw))
        check_unique(name, "", (k for k, *_ in kinds), "Give every variable a name of its own.")
        _bounded(name, len(kinds), sum(np.prod(shape, dtype=float) for _, shape, _ in kinds))
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            # Only so is a logical array one of bool; a complex one then loses its imaginary part,
            # with a warning.
            out = _flat_mat(name, scipy.io.loadmat(io.BytesIO(raw), mat_dtype=True))
            if said:
                plain = _flat_mat(name, scipy.io.loadmat(io.BytesIO(raw)))
                out |= {k: v for k, v in plain.items() if np.iscomplexobj(v)}
        arrays = [v for v in out.values() if not isinstance(v, str)]
        _bounded(name, len(out), sum(max(v.size, v.nbytes / 8) for v in arrays))
    return out


def _unpacked(raw: bytes, name: str) -> None:
    # Refuse a file of version 5 whose variables unpack to too much, before they are unpacked.
    if 0 in raw[:4]:
        return  # version 4 is not compressed
    order: Literal["little", "big"] = "little" if raw[126:128] == b"IM" else "big"
    at, size = 128, 0
    while at + 8 <= len(raw):
        kind, length = (int.from_bytes(raw[k : k + 4], order) for k in (at, at + 4))
        at += 8 + length
        unpack = zlib.decompressobj()
        for k in range(at - length, min(at, len(raw)), BLOCK_BYTES):
            block = raw[k : min(k + BLOCK_BYTES, at)]
            size += len(unpack.decompress(block) if kind == COMPRESSED else block)
            if size > MOST_BYTES:
                raise _too_long(name, MOST_BYTES)
            if unpack.eof:
                break


def _flat_mat(name: str, content: Mapping[str, Any]) -> Content:
    out: Content = {}
    for k, v in content.items():
        if not k.startswith("__"):
            _struct(name, k, v, out)
    return out


def _struct(name: str, path: str, value: Any, out: Content, depth: int = 0) -> None:
    # A struct is an array with named fields; one of 1 x 1 has columns.
    names = getattr(getattr(value, "dtype", None), "names", None)
    if path in out:
        check_unique(name, "", (path, path), "Give every variable and field a path of its own.")
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
    seen: list[str] = []

    def meant(path: str) -> list[str]:
        # The path, and what the caller calls it.
        seen.append(path.replace("/", "."))
        asked = [w for w in wanted or () if w.replace("/", ".").strip(".") == seen[-1]]
        return [path, *asked] if wanted is None or asked else []

    def take(path: str, item: Any) -> None:
        nonlocal size
        keys = meant(path)
        if not isinstance(item, h5py.Dataset):
            found: Any = f"a group with {listed([f'{path}/{k}' for k in item])}"
        elif item.attrs.get("MATLAB_class", b"") in (b"char", b"logical", b"cell", b"struct"):
            found = f"of the MATLAB class {item.attrs['MATLAB_class'].decode()}, not numbers"
        elif item.attrs.get("MATLAB_empty", 0) or item.shape is None:
            found = "an empty array"
        elif item.dtype.names:
            found = f"a compound with {listed([f'{path}.{n}' for n in item.dtype.names])}"
            for n in item.dtype.names:
                out[f"{path}.{n}"] = "texts or a matrix in a compound, not a column"
                inner, kind = meant(f"{path}.{n}"), item.dtype[n]
                if kind.hasobject or item.ndim != 1:
                    continue
                if inner:
                    size += item.size * max(1, kind.itemsize / 8)
                    _bounded(name, len(out), size)
                value = item.fields(n)[()] if inner else np.broadcast_to(0.0, item.shape)
                out.update(dict.fromkeys([f"{path}.{n}", *inner], value))
        elif keys:
            size += item.size * max(1, item.dtype.itemsize / 8)
            _bounded(name, len(out), size)
            found = _texts(name, item, len(raw)) if item.dtype.hasobject else np.asarray(item[()])
        else:
            found = np.broadcast_to(0.0, item.shape)  # only its name is needed
        out.update(dict.fromkeys([path, *keys], found))
        _bounded(name, len(out), size)

    with _damage_named(name, "an HDF5"), h5py.File(io.BytesIO(raw), "r") as file:
        file.visititems(take)
        check_unique(name, "", seen, "Give every group and data set a path of its own.")
    return out


def _texts(name: str, item: Any, most_bytes: int) -> Any:
    # Every row may point to the same text, which is no longer than the file: some rows at once.
    if item.ndim != 1 or (item.dtype.metadata or {}).get("vlen") not in (str, bytes):
        return "neither numbers nor a vector of texts"
    rows: list[str] = []
    step = max(1, 4 * MOST_TEXT_BYTES // most_bytes)
    size = 0
    for k in range(0, len(item), step):
        rows.extend(item.asstr()[k : k + step])
        size += sum(map(len, rows[k:]))
        if size > MOST_TEXT_BYTES:
            raise _too_long(name, MOST_TEXT_BYTES, " in texts")
    return _objects(rows)


def read_parquet(raw: bytes, name: str, wanted: Sequence[str] | None) -> Content:
    """Columns of a Parquet file, those of structs by ``s.t``."""
    pa = from_extra("pyarrow", "files", f"{name}: a Parquet file")
    parquet = from_extra("pyarrow.parquet", "files", f"{name}: a Parquet file")
    with _damage_named(name, "a Parquet"):
        source = pa.BufferReader(raw)
        file = parquet.ParquetFile(source)
        leaves = [file.schema.column(k) for k in range(len(file.schema))]
        paths = [c.path for c in leaves]
        check_unique(name, "", paths, "Give every column a name of its own.")
        # Lists and bytes are not columns, and may unpack to any size.
        kinds = {
            k: c.logical_type.type
            for k, c in enumerate(leaves)
            if not c.max_repetition_level
            and (
                "BYTE_ARRAY" not in c.physical_type or c.logical_type.type in ("STRING", "DECIMAL")
            )
        }
        taken = [
            k
            for k in kinds
            if wanted is None or any(paths[k] == w or paths[k].startswith(f"{w}.") for w in wanted)
        ]
        groups = [file.metadata.row_group(g) for g in range(file.metadata.num_row_groups)]
        _bounded(name, len(leaves), file.metadata.num_rows * len(taken))
        if sum(g.column(k).total_uncompressed_size for g in groups for k in taken) > MOST_BYTES:
            raise _too_long(name, MOST_BYTES)
        # Texts as dictionaries: one that occurs in every row is stored, and read, once.
        texts = [paths[k] for k in taken if kinds[k] == "STRING"]
        file = parquet.ParquetFile(source, read_dictionary=texts)
        table = file.read(columns=[paths[k] for k in taken])
        unread = np.broadcast_to(0.0, file.metadata.num_rows)  # only the name is needed
        out: Content = {
            f.name: f"of the type {f.type}, neither numbers nor texts" for f in file.schema_arrow
        }
        out |= {paths[k]: unread for k in kinds}
        for _ in range(DEEPEST):
            structs = [f for f in table.schema if pa.types.is_struct(f.type)]
            if not structs:
                break
            for f in structs:
                inner = listed([f"{f.name}.{c.name}" for c in f.type])
                out[f.name] = f"a struct with the fields {inner}"
            table = table.flatten()
        if sum(_text_bytes(pa, c) for c in table.columns) > MOST_TEXT_BYTES:
            raise _too_long(name, MOST_TEXT_BYTES, " in texts")
        for field, column in zip(table.schema, table.columns, strict=True):
            out[field.name] = _arrow(pa, field.type, column)
    return out


def _text_bytes(pa: Any, column: Any) -> int:
    # Of a column's texts once each row has its own.
    if not pa.types.is_dictionary(column.type) or pa.types.is_primitive(column.type.value_type):
        return 0
    lengths = [
        (np.asarray(pa.compute.binary_length(c.dictionary)), c.indices.drop_null().to_numpy())
        for c in column.chunks
    ]
    return sum(int(length[which].sum()) for length, which in lengths if len(which))


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
            keys = _named(name, (k for row in rows for k in row))
            _bounded(name, len(keys), len(keys) * len(rows))
            return {n: _objects([row.get(k) for row in rows]) for k, n in keys.items()}
        flat = _flat(content) if isinstance(content, dict) else {}
        keys = _named(name, flat)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{name}: is not JSON ({error}).", "Check the file.") from None
    columns = {keys[k]: _objects(v) for k, v in flat.items() if isinstance(v, list)}
    if not columns:
        raise UserError(
            f"{name}: holds neither columns by name nor a list of rows.",
            'Write {"time": [...], "torque": [...]} or [{"time": 0.0, "torque": 0.0}, ...].',
        )
    return {k: columns.get(k, "a single value") for k in keys.values()}


def _named(name: str, paths: Iterable[tuple[str, ...]]) -> dict[tuple[str, ...], str]:
    # Names of paths; the key "a.b" and "b" in "a" have the same.
    names = {k: ".".join(k) for k in dict.fromkeys(paths)}
    check_unique(name, "", names.values(), "Give every column a name of its own.")
    return names


def _flat(content: Mapping[str, Any], before: tuple[str, ...] = ()) -> dict[tuple[str, ...], Any]:
    out: dict[tuple[str, ...], Any] = {}
    for k, v in content.items():
        if isinstance(v, dict) and len(before) < DEEPEST:
            out.update(_flat(v, (*before, k)))
        else:
            out[*before, k] = v
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
    except MemoryError:
        raise UserError(
            f"{name}: needs more memory than there is to read.", "Split the file."
        ) from None
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


def _too_long(name: str, most: int, what: str = "") -> UserError:
    return UserError(
        f"{name}: unpacks to more than the limit of {most:.0e} bytes{what}.",
        "Give only the columns that are needed, in parts.",
    )
