"""Event log: append-only, one writer, on disk at once, with a hash chain.

One JSON object a line, with the host's UTC time, whether its clock is synchronised, and the named
operator.  ``hash`` is SHA-256 over the line without it, which includes ``before``, the hash of the
line above.  A line that was cut by a crash is set aside on opening, never lost. A chain cannot show
that its end was cut off: therefore the study's audit log has the last hash of every session.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_gen.files import locked, unused, utc_now
from esea_gen.link.received import shown
from esea_gen.portability import BINARY, sync_folder
from esea_host.study.privacy import SEALED, key_above, sealed, unsealed

DEEPEST = 20
START = "0" * 64
UNSYNCHRONISED = 5  # TIME_ERROR of adjtimex(2)


@dataclass(frozen=True)
class LoggedEvent:
    """time_s: by the session's own clock; clock: state of the host's, which gave utc."""

    number: int
    time_s: float
    kind: str
    data: Mapping[str, Any]
    hash: str
    utc: str = ""
    clock: str = ""
    by: str = ""


@dataclass(frozen=True)
class LogFound:
    """torn: bytes of a last line that a crash has cut; breaks: where the chain does not hold.

    Before sound_bytes nothing is broken; last_line is the last one there.
    """

    entries: tuple[LoggedEvent, ...] = ()
    torn: bytes = b""
    breaks: tuple[str, ...] = ()
    sound_bytes: int = 0
    last_line: bytes = b""

    def sound(self, path: Path) -> LogFound:
        """Itself, or an error that names the breaks."""
        if self.breaks:
            raise UserError(
                f"{path}: the log has been changed: {'; '.join(self.breaks)}.",
                "Restore the file from a copy, or move the part after the break aside: "
                "esea-host study repair FOLDER.",
            )
        return self


@dataclass(frozen=True)
class MovedAside:
    """Lines that a repair removed from a log: the file that has them, and the intact lines."""

    file: str
    sha256: str
    breaks: tuple[str, ...]
    lines: tuple[LoggedEvent, ...]


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
                raise UserError(f"{where}: the key {key!r} is not text.", "Write a text.")
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


def clock_state() -> str:
    """Whether the host's clock is synchronised, as far as its system tells."""
    try:
        system = ctypes.CDLL(None)
        ask = system.ntp_adjtime if sys.platform == "darwin" else system.adjtimex
        found = ask(ctypes.create_string_buffer(512))  # modes 0: nothing is set
    except (AttributeError, OSError, TypeError):
        found = -1
    if found < 0:
        return "synchronisation unknown"
    return "not synchronised" if found == UNSYNCHRONISED else "synchronised"


def _behind_s(utc: str, before: str) -> float:
    try:
        return (datetime.fromisoformat(before) - datetime.fromisoformat(utc)).total_seconds()
    except (TypeError, ValueError):
        return 0.0


def read_log(path: Path, known: LogFound | None = None) -> LogFound:
    """Content of a log; known: an earlier read, of which only the end is checked."""
    with path.open("rb") as file:
        if known is not None and known.entries and not known.breaks:
            file.seek(known.sound_bytes - len(known.last_line))
            raw = file.read()
            if raw == known.last_line and not known.torn:
                return known
            if raw.startswith(known.last_line):
                return _read(raw[len(known.last_line) :], known, path)
            file.seek(0)
        return _read(file.read(), LogFound(), path)


def _read(raw: bytes, known: LogFound, path: Path) -> LogFound:
    key = cache(partial(key_above, path))
    whole, _, torn = raw.rpartition(b"\n")
    entries, breaks, before = list(known.entries), list[str](), START
    sound_bytes, last_line = known.sound_bytes, known.last_line
    if entries:
        before = entries[-1].hash
    for k, line in enumerate(whole.split(b"\n") if whole else [], len(entries)):
        try:
            entry, fields = _entry(line, key)
            wrong = "its content was edited" if _hash(fields) != entry.hash else ""
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
        before = entry.hash
        if not breaks:
            sound_bytes, last_line = sound_bytes + len(line) + 1, line + b"\n"
    return LogFound(tuple(entries), torn, tuple(breaks), sound_bytes, last_line)


def _entry(line: bytes, key: Callable[[], bytes]) -> tuple[LoggedEvent, dict[str, Any]]:
    fields = json.loads(line)
    own = fields.pop("hash")
    kind, time_s, data = fields["kind"], fields.get("t", 0.0), {**fields["data"]}
    if kind == SEALED:
        kind, data = unsealed(key(), data[SEALED])
    words = [fields.get(k, "") for k in ("utc", "clock", "by")]
    texts = kind, own, *words
    if not isinstance(time_s, int | float) or not all(isinstance(x, str) for x in texts):
        raise TypeError
    return LoggedEvent(fields["n"], time_s, kind, data, own, *words), fields


class EventLog:
    """A log for appending; a lock beside it excludes other writers until it is closed.

    durable: each event waits for the disk (not for simulated people).  mend: whatever is behind a
    break is moved into a file beside the log, and a lock of another host counts as that of a dead
    holder; taken_over: what a holder that died had left in the lock.  known: as of read_log. seal:
    a key, by which kind and data of every event are written so that nobody reads them by looking:
    the group of a blinded study follows from them.
    """

    seal: bytes | None = None
    moved_aside: MovedAside | None = None

    def __init__(
        self,
        path: Path,
        durable: bool = True,
        by: str = "",
        wait_s: float = 0.0,
        mend: bool = False,
        known: LogFound | None = None,
    ) -> None:
        self.path, self.durable, self.by = path, durable, by
        path.parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as held:
            lock = locked(path.with_suffix(".lock"), by, wait_s, mend)
            self.taken_over = held.enter_context(lock)
            new = not path.exists()
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | BINARY, 0o644)
            held.callback(os.close, self._file)
            if new:
                sync_folder(path.parent)
            self.found = read_log(path, known)
            if mend and self.found.breaks:
                self.moved_aside = self._move_aside()
                self.found = read_log(path)
            self.found.sound(path)
            if self.found.torn:
                self._set_aside(self.found.torn)
            self._held = held.pop_all()
        last = self.found.entries[-1] if self.found.entries else None
        self._count, self._before = len(self.found.entries), last.hash if last else START
        self._utc = last.utc if last else ""
        self._size, self._line = self.found.sound_bytes, self.found.last_line

    def __enter__(self) -> EventLog:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _move_aside(self) -> MovedAside:
        rest = self.path.read_bytes()[self.found.sound_bytes :]
        aside = unused(self.path.with_suffix(".aside-"), ".jsonl")
        with aside.open("xb") as file:
            file.write(rest)
            file.flush()
            os.fsync(file.fileno())
        sync_folder(aside.parent)
        os.ftruncate(self._file, self.found.sound_bytes)
        os.fsync(self._file)
        lines = []
        for line in rest.split(b"\n"):
            with suppress(ValueError, KeyError, TypeError, AttributeError, RecursionError):
                entry, fields = _entry(line, partial(key_above, self.path))
                lines += [entry] if _hash(fields) == entry.hash else []
        digest = hashlib.sha256(rest).hexdigest()
        return MovedAside(aside.name, digest, self.found.breaks, tuple(lines))

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

    def append(self, time_s: float | None, kind: str, data: Mapping[str, Any]) -> None:
        """Write an event; time_s: by the session's clock, where there is one."""
        held = plain({"data": data} if time_s is None else {"t": time_s, "data": data}, kind)
        if self.seal is not None:
            kind, held["data"] = SEALED, {SEALED: sealed(self.seal, [kind, held["data"]])}
        utc, clock = utc_now(), clock_state()
        if (behind_s := _behind_s(utc, self._utc)) > 0:
            clock += f", {behind_s:g} s behind the event before"
        stamp = {"utc": utc, "clock": clock, "by": self.by}
        fields = {"n": self._count, "kind": kind, "before": self._before, **stamp, **held}
        # As read back: tuples are lists, and the hash is that of what is on disk.
        own = _hash(fields)
        line = _canonical({**fields, "hash": own}).encode() + b"\n"
        self._check_end()
        try:
            self._write(line)
        except BaseException as error:  # a full disk, an interrupt: nothing is left half written
            with suppress(OSError):
                os.ftruncate(self._file, self._size)
            if isinstance(error, OSError):
                error.filename = str(self.path)
            raise
        self._size, self._line = self._size + len(line), line
        self._count, self._before, self._utc = self._count + 1, own, utc

    def _check_end(self) -> None:
        # The lock keeps our own programs out, not an editor, nor one that synchronises folders.
        try:
            there = self.path.stat()
            same = os.path.samestat(there, os.fstat(self._file)) and there.st_size == self._size
            if same and self._line:
                os.lseek(self._file, self._size - len(self._line), os.SEEK_SET)
                same = os.read(self._file, len(self._line)) == self._line
        except FileNotFoundError:
            same = False
        if not same:
            raise UserError(
                f"{self.path}: another program has changed it since its line {self._count}; "
                "nothing more was written into it.",
                "Keep other programs off the folder; then: esea-host study repair FOLDER.",
            )

    def _write(self, line: bytes) -> None:
        rest = memoryview(line)
        while rest:
            rest = rest[os.write(self._file, rest) :]
        if self.durable:
            os.fsync(self._file)

    def close(self) -> None:
        self._held.close()
