"""What a search has computed, kept in a file: a search that was cut off goes on from it.

Every search is the same computation each time, so it is simply begun again, and takes from the
file what is there: the answer is that of a run in one piece, bit for bit.  Lines are found by a
digest of the C, the data and the point asked for; what belongs to another recording is never taken.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from esea_gen.errors import UserError
from esea_gen.language.ports import Array

HEAD = "esea-gen search 1"


class SearchMemo:
    """Numbers by digest, in memory and, where a file is named, one line each on the disk."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        self._known: dict[str, tuple[float, ...]] = {}
        if path is not None:
            self._open(path)

    def _open(self, path: Path) -> None:
        fix = "Name another file for --resume."
        try:
            raw = path.read_bytes() if path.exists() else b""
            # A line that the end of the last run cut off is written anew.
            whole = raw[: raw.rfind(b"\n") + 1]
            head, *lines = whole.split(b"\n")
            if raw and head.decode(errors="replace") != HEAD:
                if not f"{HEAD}\n".encode().startswith(raw):
                    raise UserError(f"{path}: is no record of a search.", fix)
                whole, lines = b"", []
            if len(whole) != len(raw) or not whole:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(whole or f"{HEAD}\n".encode())
        except OSError as error:
            raise UserError(f"{path}: cannot be used ({error.strerror or error}).", fix) from None
        for number, line in enumerate(filter(None, lines), 2):
            try:
                name, *values = json.loads(line)
                self._known[str(name)] = tuple(float(v) for v in values)
            except (ValueError, TypeError):
                raise UserError(f"{path}, line {number}: is damaged.", fix) from None

    def name(self, *parts: str | bytes) -> str:
        """Digest under which something is kept."""
        joined = b"\0".join(p if isinstance(p, bytes) else p.encode() for p in parts)
        return hashlib.sha256(joined).hexdigest()[:32]

    def get(self, name: str) -> tuple[float, ...] | None:
        """What is kept under a name."""
        return self._known.get(name)

    def put(self, found: Iterable[tuple[str, Sequence[float] | Array]]) -> None:
        """Keep some, on the disk before this returns."""
        rows = [(n, tuple(float(v) for v in np.atleast_1d(values))) for n, values in found]
        self._known |= dict(rows)
        if self.path is not None and rows:
            with self.path.open("a", encoding="utf-8") as file:
                file.write("".join(json.dumps([n, *values]) + "\n" for n, values in rows))
