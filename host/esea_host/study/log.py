"""The event log: append-only, every event on disk at once, chained so that an edit shows.

One JSON object a line.  ``hash`` is SHA-256 over the line without it, which holds ``before``, the
hash of the line above.  A line that was cut by a crash is set aside on opening, never lost.
What a chain cannot show is a whole tail cut off: that is why the study's audit log holds the last
hash of every session.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_gen.link.received import shown

DEEPEST = 20
START = "0" * 64


@dataclass(frozen=True)
class LoggedEvent:
    number: int
    time_s: float
    kind: str
    data: Mapping[str, Any]
    hash: str


@dataclass(frozen=True)
class LogFound:
    """torn: bytes of a last line that a crash has cut; breaks: where the chain does not hold."""

    entries: tuple[LoggedEvent, ...]
    torn: bytes
    breaks: tuple[str, ...]

    def sound(self, path: Path) -> LogFound:
        """Itself, or an error that names the breaks."""
        if self.breaks:
            raise UserError(
                f"{path}: the log has been changed: {'; '.join(self.breaks)}.",
                "Restore the file from a copy; the study goes on only from a sound log.",
            )
        return self


@contextmanager
def well_formed(path: Path) -> Iterator[None]:
    """Errors of missing fields name the file: who can write it can forge a chain that holds."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise UserError(
            f"{path}: an event lacks what a session's log holds "
            f"({type(error).__name__}: {shown(str(error))}).",
            "Restore the file from a copy.",
        ) from None


def plain(value: Any, where: str, depth: int = 0) -> Any:
    """A value as JSON holds it: NumPy's scalars and arrays are numbers and lists."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, int) and -(2**63) <= value < 2**64:
        return value
    if value is None or (isinstance(value, float) and math.isfinite(value)):
        return value
    if _is_unicode(value):
        return value
    if isinstance(value, Mapping | list | tuple) and depth == DEEPEST:
        fault = f"is nested more than {DEEPEST} times, or contains itself"
    elif isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str) or not _is_unicode(key):
                raise UserError(f"{where}: the key {key!r} is no text.", "Write a text.")
        return {k: plain(v, f"{where}.{k}", depth + 1) for k, v in value.items()}
    elif isinstance(value, list | tuple):
        return [plain(v, f"{where}[{i}]", depth + 1) for i, v in enumerate(value)]
    elif isinstance(value, int | float | str):
        fault = f"is {str(value) if isinstance(value, float) else 'out of range'}"
    else:
        fault = f"is {type(value).__name__}"
    fix = "Write finite numbers, texts, lists and mappings."
    raise UserError(f"{where} {fault}, which no log can hold.", fix)


def _is_unicode(value: Any) -> bool:
    # A lone surrogate would end every later export.
    try:
        return isinstance(value, str) and bool(value.encode() or True)
    except UnicodeEncodeError:
        return False


def _canonical(fields: Mapping[str, Any]) -> str:
    return json.dumps(fields, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _hash(fields: Mapping[str, Any]) -> str:
    return hashlib.sha256(_canonical(fields).encode()).hexdigest()


def read_log(path: Path) -> LogFound:
    raw = path.read_bytes()
    whole, _, torn = raw.rpartition(b"\n")
    entries: list[LoggedEvent] = []
    breaks: list[str] = []
    before = START
    for k, line in enumerate(whole.split(b"\n") if whole else []):
        try:
            fields = json.loads(line)
            own = fields.pop("hash")
            entry = LoggedEvent(fields["n"], fields["t"], fields["kind"], {**fields["data"]}, own)
            if not isinstance(entry.kind, str) or not isinstance(entry.time_s, int | float):
                raise TypeError
            wrong = "its content was edited" if _hash(fields) != own else ""
            if not wrong and fields["before"] != before:
                wrong = "a line before it was removed, added or replaced"
            if not wrong and entry.number != k:
                wrong = f"it is numbered {entry.number}"
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            breaks.append(f"line {k + 1}: no event")
            continue
        if wrong:
            breaks.append(f"line {k + 1}: {wrong}")
        entries.append(entry)
        before = own
    return LogFound(tuple(entries), torn, tuple(breaks))


class EventLog:
    """A log for appending; durable: each event waits for the disk (not for simulated people)."""

    def __init__(self, path: Path, durable: bool = True) -> None:
        self.path, self.durable = path, durable
        self.found = LogFound((), b"", ())
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            self.found = read_log(path).sound(path)
        self._count = len(self.found.entries)
        self._before = self.found.entries[-1].hash if self._count else START
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        if not self._count:
            _sync(path.parent)
        if self.found.torn:
            self._set_aside(self.found.torn)

    def _set_aside(self, torn: bytes) -> None:
        # On disk beside the log before it leaves the log.
        with self.path.with_suffix(".torn").open("ab") as file:
            file.write(torn + b"\n")
            file.flush()
            os.fsync(file.fileno())
        os.ftruncate(self._file, self.path.stat().st_size - len(torn))
        os.fsync(self._file)

    @property
    def head(self) -> str:
        return self._before

    def append(self, time_s: float, kind: str, data: Mapping[str, Any]) -> None:
        held = plain({"t": time_s, "data": data}, kind)
        fields = {"n": self._count, "kind": kind, "before": self._before, **held}
        # As read back: tuples are lists, and the hash is that of what is on disk.
        own = _hash(fields)
        self._write(_canonical({**fields, "hash": own}).encode() + b"\n")
        self._count, self._before = self._count + 1, own

    def _write(self, line: bytes) -> None:
        rest = memoryview(line)
        while rest:
            rest = rest[os.write(self._file, rest) :]
        if self.durable:
            os.fsync(self._file)

    def close(self) -> None:
        os.close(self._file)


def _sync(folder: Path) -> None:
    # So that the name of a new file is on disk as well.
    file = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)
