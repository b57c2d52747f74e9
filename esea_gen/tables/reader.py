"""Read a table of any kind: the kind by its content, the size bounded."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from esea_gen.errors import UserError
from esea_gen.tables.structured import read_hdf5, read_json, read_mat, read_parquet, table_of
from esea_gen.tables.table import SIMULATED, FileTable, Kind, TableFormat
from esea_gen.tables.text import TextReader, decoded

MOST_BYTES = 512 * 2**20
# How files that are not text begin: MATLAB of version 5 and 7.3, HDF5, Parquet.
MAGIC: dict[bytes, Kind] = {
    b"MATLAB 5.0 MAT-file": "mat",
    b"MATLAB 7.3 MAT-file": "mat",
    b"\x89HDF\r\n": "hdf5",
    b"PAR1": "parquet",
}
# How others begin that a laboratory has, and what to do.
OTHERS = {b"PK\x03\x04": "a spreadsheet or ZIP archive", b"\x1f\x8b": "compressed (gzip)"}
BY_NAME: dict[str, Kind] = {".json": "json", ".mat": "mat"}  # MATLAB's version 4 has no mark
MOST_JSON = 128 * 2**20
BINARY = {"mat": read_mat, "hdf5": read_hdf5, "parquet": read_parquet}


def read_table(
    source: Path,
    wanted: Sequence[str] | None = None,
    form: TableFormat | None = None,
    *,
    optional: Sequence[str] = (),
    name: str | None = None,
    raw: bytes | None = None,
    settings: str = "",
    fields: int | None = None,
    drop_ragged: bool = False,
) -> FileTable:
    """Read a table completely, or refuse it with file, line, column and remedy."""
    form, name = form or TableFormat(), name or str(source)
    optional = (*optional, SIMULATED)
    raw = _content(source, name) if raw is None else raw
    digest = hashlib.sha256(raw).hexdigest()[:16]
    found: Kind | None = next((k for start, k in MAGIC.items() if raw.startswith(start)), None)
    if raw.startswith(b"\x89MCAP"):
        raise UserError(
            f"{name}: is a recording (MCAP), not a table.",
            "Export a stream of it: esea-host export RECORDING.mcap TABLE.csv.",
        )
    kind: Kind = form.kind or found or BY_NAME.get(source.suffix.lower(), "csv")
    if found and kind != found and (kind, found) != ("mat", "hdf5"):
        raise UserError(
            f"{name}: is a {found} file, but it is read as {kind}.",
            f"Set kind = '{found}'" + (f" in {settings}." if settings else "."),
        )
    if kind in BINARY:
        names = None if wanted is None else [*wanted, *optional]
        content = BINARY[kind](raw, name, names)
        form = form.model_copy(update={"kind": kind})
        return table_of(content, name, wanted, optional, form, digest)
    for start, what in OTHERS.items():
        if raw.startswith(start):
            raise UserError(f"{name}: is {what}.", "Unpack it, or export CSV.")
    text, encoding = decoded(raw, name, form, settings)
    form = form.model_copy(update={"kind": kind, "encoding": encoding})
    if kind == "json":
        if len(raw) > MOST_JSON:
            raise _too_large(name, len(raw), MOST_JSON)
        return table_of(read_json(text, name), name, wanted, optional, form, digest)
    reader = TextReader(
        name, text, form, settings, wanted, optional, fields, drop_ragged=drop_ragged
    )
    return reader.read(digest)


def _content(path: Path, name: str) -> bytes:
    try:
        if path.exists() and not path.is_file():
            raise UserError(f"{name}: is not a file.", "Give a file.")
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise _too_large(name, size, MOST_BYTES)
        return path.read_bytes()
    except OSError as error:
        raise UserError(
            f"{name}: cannot be read ({error.strerror or error}).", "Check the file."
        ) from None


def _too_large(name: str, size: int, most: int) -> UserError:
    return UserError(
        f"{name}: has {size} bytes, above the limit of {most}.", "Split it, or keep fewer samples."
    )
