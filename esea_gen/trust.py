"""Which Python files may run: those that somebody has trusted by their SHA-256, and no others.

A study's folder, a protocol and a device file may come from anybody.  A file that is named on the
command line (``--task FILE.py``, ``--controller FILE.py:LAW``) was chosen by who names it; any
other one is first shown with its hash.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from esea_gen.errors import UserError
from esea_gen.files import read_whole, write_whole
from esea_gen.portability import user_folder

MOST_BYTES = 1 << 20
_allowed: set[str] = set()


@dataclass(frozen=True)
class TaskCode:
    """A file with tasks or laws: the bytes that were hashed are the bytes that run."""

    path: Path
    content: bytes
    sha256: str

    @classmethod
    def of(cls, path: Path, content: bytes) -> TaskCode:
        return cls(path, content, hashlib.sha256(content).hexdigest())

    @property
    def trusted(self) -> bool:
        return self.sha256 in _allowed or self.sha256 in _kept()


def read_code(path: Path) -> TaskCode:
    content = read_whole(path, "Name a Python file with tasks.", MOST_BYTES)
    return TaskCode.of(path, content)


def inside(folder: Path, path: Path, where: str) -> Path:
    """A path below a folder; an error for one that leaves it, by a link too."""
    try:
        leaves = not (folder / path).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a link to itself, a null character
        leaves = True
    if leaves or path.is_absolute():
        raise UserError(
            f"{where}: {str(path)!r} leads out of {folder.resolve()}.",
            "Put the file itself into that folder.",
        )
    return folder / path


def must_be_trusted(codes: Iterable[TaskCode], how: str = "add:") -> None:
    """Refuse code that nobody has trusted, with each hash."""
    new = [c for c in codes if not c.trusted]
    if new:
        listed = "; ".join(f"{c.path}, SHA-256 {c.sha256}" for c in new)
        options = " ".join(f"--trust {c.sha256}" for c in new)
        raise UserError(
            f"Untrusted code was not run: {listed}.",
            f"Review it. To run it from now on, {how} {options}",
        )


def allow(hashes: Iterable[str]) -> None:
    """Trust files by their SHA-256 in this process."""
    _allowed.update(hashes)


def trust(hashes: Iterable[str]) -> None:
    """Trust files by their SHA-256 from now on, as this user; a changed file is another one."""
    new = {h.lower() for h in hashes}
    for text in sorted(new):
        if not re.fullmatch("[0-9a-f]{64}", text):
            raise UserError(f"--trust {text} is not a SHA-256.", "Give the 64 digits shown.")
    if not new <= (kept := _kept()):
        write_whole(_file(), "".join(f"{h}\n" for h in sorted(kept | new)))


def _file() -> Path:
    return user_folder("config", "esea-host") / "trusted-code"


def _kept() -> set[str]:
    try:
        return set(_file().read_text(encoding="utf-8").split())
    except (OSError, ValueError):
        return set()
