"""Results stored between processes, and the digest of the code that computed them."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

from esea_gen.portability import user_folder

_STARTED_S = time.time()


def cache_folder() -> Path:
    """The user's folder of reproducible results, created if missing; else a scratch folder."""
    folder = user_folder("cache", "esea-gen")
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    return Path(scratch_folder())


def scratch_folder() -> str:
    """A folder that lasts as long as this process."""
    return _scratch().name


@cache
def _scratch() -> tempfile.TemporaryDirectory[str]:
    # Compiled C is loaded from there: no folder of a name that others can make beforehand.
    return tempfile.TemporaryDirectory(prefix="esea-gen-")


@cache
def code_digest(rooms: tuple[str, ...] = ("",)) -> str | None:
    """Digest of every file of some rooms, by default of the whole package, and of Python."""
    root = Path(__file__).parent
    digest = hashlib.sha256(sys.version.encode())
    files = (p for room in rooms for p in (root / room).rglob("*"))
    for path in sorted(p for p in files if p.is_file() and p.suffix != ".pyc"):
        if path.stat().st_mtime >= _STARTED_S:
            return None
        content = path.read_bytes()
        digest.update(f"\0{path.relative_to(root).as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()
