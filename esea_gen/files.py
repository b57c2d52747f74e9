"""Atomic file access: an old file stays until the new one is complete."""

from __future__ import annotations

import errno
import getpass
import hashlib
import json
import os
import secrets
import socket
import stat
import tempfile
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

from pydantic_core import to_jsonable_python

from esea_gen.errors import UserError, choose
from esea_gen.portability import BINARY, in_use, replace, try_lock
from esea_gen.version import __version__


@cache
def template_folder() -> Path:
    """Folder of the Jinja templates: inside the wheel, or at the top of a checkout."""
    packaged = Path(__file__).parent / "_templates"
    return packaged if packaged.is_dir() else Path(__file__).parents[1] / "templates"


def unused(begin: Path, end: str) -> Path:
    """The first of ``<begin>1<end>``, ``<begin>2<end>`` ... that is not there."""
    return next(p for k in count(1) if not os.path.lexists(p := Path(f"{begin}{k}{end}")))


def sample_folder() -> Path:
    """Folder of the recordings that come along: in the wheel, or in the tests of a checkout."""
    packaged = Path(__file__).parent / "_samples"
    return packaged if packaged.is_dir() else Path(__file__).parents[1] / "tests" / "data"


MOST_BYTES = 1 << 30
PIECE_BYTES = 1 << 24


def read_whole(path: Path, fix: str, most_bytes: int = MOST_BYTES) -> bytes:
    """Content of a file that a person named; devices and files without end are refused."""
    try:
        with path.open("rb") as file:
            kind = os.fstat(file.fileno()).st_mode
            if not (stat.S_ISREG(kind) or stat.S_ISFIFO(kind)):
                raise UserError(f"{path} is not a regular file.", fix)
            # In pieces: what is asked for at once is set aside at once.
            data, left = b"", most_bytes + 1
            while left > 0 and (part := file.read(min(left, PIECE_BYTES))):
                data += part
                left -= len(part)
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror or error}).", fix) from None
    if len(data) > most_bytes:
        raise UserError(f"{path}: more than {most_bytes >> 20} MiB.", fix)
    return data


def refuse_copies(paths: Iterable[Path]) -> None:
    """Refuse a file that is also there by another name: it would count as two measurements."""
    seen: dict[bytes, Path] = {}
    for path in filter(Path.is_file, paths):
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").digest()
        if (other := seen.setdefault(digest, path)) is not path:
            raise UserError(f"{path}: the same recording as {other}.", "Give each recording once.")


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A scratch file that takes the place of a file at the end."""
    path = Path(os.path.realpath(path))  # a link stays one
    scratch, kept = path.with_name(f".esea-{secrets.token_hex(4)}{path.suffix}"), False
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file() and not path.is_dir():
            yield path  # a device or a pipe: there is nothing to keep, and it must not be replaced
            return
        yield scratch
        scratch.chmod(0o644)
        replace(scratch, path)
    except OSError as error:
        if kept := in_use(error) and scratch.is_file():
            raise UserError(
                f"{path}: cannot be replaced; another program has it open.",
                f"Close it there. The new content is in {scratch}.",
            ) from error
        raise UserError(
            f"{path}: cannot be written ({error.strerror or error}).",
            "Free disk space, or give another file.",
        ) from error
    finally:
        if not kept and scratch.is_file():
            scratch.unlink()


def write_whole(path: Path, content: str | bytes) -> None:
    with written_whole(path) as scratch:
        scratch.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def new_whole(path: Path) -> Iterator[Path]:
    """Where to write a new file or folder, which becomes ``path`` unless the body fails."""
    if os.path.lexists(path) and not (path.is_dir() and not any(path.iterdir())):
        there = "is not empty" if path.is_dir() else "already exists"
        raise UserError(f"{path} {there}.", "Give another name; nothing is overwritten.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".esea-") as scratch:
            part = Path(scratch) / path.name
            yield part
            replace(part, path)
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written ({error.strerror or error}).",
            "Free disk space, or give another name.",
        ) from error


# -- locks ----------------------------------------------------------------------------------------

_WITHOUT_LOCKS = {errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS, errno.EINVAL}


def utc_now() -> str:
    """The host's time, ISO 8601 in UTC with milliseconds."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


@contextmanager
def locked(
    path: Path, person: str = "", wait_s: float = 0.0, of_any_host: bool = False
) -> Iterator[dict[str, Any]]:
    """Lock with a file that names its owner; returns the content left by a dead owner.

    Which holder on this host is alive, the system knows.  A holder on another one counts as alive
    until it has let go, or until of_any_host says that it is dead.
    """
    file, until_s = os.open(path, os.O_RDWR | os.O_CREAT | BINARY, 0o644), time.monotonic() + wait_s
    try:
        while not _lock(file, path):
            if time.monotonic() >= until_s:
                raise _held(path, _holder(file), "Wait until it has ended, or end it there.")
            time.sleep(0.01)
        left, host = _holder(file), socket.gethostname()
        if left and left.get("host", host) != host and not of_any_host:
            fix = "If that computer is off or no longer runs it: esea-host study repair FOLDER."
            raise _held(path, left, f"Whether it still runs cannot be determined from here. {fix}")
        try:
            _write_holder(file, path, person, host)
            yield left
        finally:
            with suppress(OSError):
                os.ftruncate(file, 0)
    finally:
        os.close(file)


def _lock(file: int, path: Path) -> bool:
    try:
        return try_lock(file)
    except OSError as error:
        if error.errno not in _WITHOUT_LOCKS:
            raise
        raise UserError(
            f"{path}: the file system has no locks ({error.strerror}).", "Use a local disk."
        ) from None


def _write_holder(file: int, path: Path, person: str, host: str) -> None:
    if not person:
        with suppress(OSError, KeyError, ImportError):  # a login without a name
            person = getpass.getuser()
    holder = {"pid": os.getpid(), "host": host, "person": person, "since": utc_now()}
    os.ftruncate(file, 0)
    os.lseek(file, 0, os.SEEK_SET)
    try:
        os.write(file, json.dumps(holder).encode() + b"\n")
    except OSError as error:
        error.filename = str(path)
        raise


def _holder(file: int) -> dict[str, Any]:
    os.lseek(file, 0, os.SEEK_SET)
    text = os.read(file, 4096)
    try:
        found = json.loads(text) if text else {}
    except ValueError:
        found = None
    return found if isinstance(found, dict) else {"person": "somebody"}


def _held(path: Path, holder: Mapping[str, Any], fix: str) -> UserError:
    who, pid, host, since = (holder.get(k, "?") for k in ("person", "pid", "host", "since"))
    text = f"{path}: in use by {who} (process {pid} on {host}, since {since})."
    return UserError(text, fix)


# -- results --------------------------------------------------------------------------------------

# Of every result's JSON; it grows when a key goes or means something else, not when one comes.
SCHEMA_VERSION = 1


def plain(result: object, *, null: bool = False) -> Any:
    """A result as JSON's own types: dataclasses by field, arrays and tuples as lists.

    ``null`` stands for a number that is not finite; else it stays, and JSON refuses it.
    """
    mode: Any = "null" if null else "constants"
    return to_jsonable_python(result, fallback=lambda v: v.tolist(), inf_nan_mode=mode)


def stamped(what: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """A result with its head: the schema that it follows, that one's version, and the tool's."""
    body: dict[str, Any] = plain(content)
    head: dict[str, Any] = {
        "schema": what,
        "schema_version": SCHEMA_VERSION,
        "tool_version": __version__,
    }
    taken = head.keys() & body.keys()
    if taken:
        raise ValueError(f"{what}: the content has {', '.join(sorted(taken))} itself")
    return head | body


def result_schemas() -> dict[str, Path]:
    folder = Path(__file__).parent / "schemas"
    return {p.stem: p for p in sorted(folder.glob("*.json"))}


def result_schema(name: str) -> str:
    known = result_schemas()
    choose("result", name, known)
    return known[name].read_text(encoding="utf-8")


def read_json(path: Path, fix: str) -> Any:
    data = read_whole(path, fix)
    try:
        return json.loads(data, object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path}: cannot be read as JSON ({error}).", fix) from None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError(f"a name twice among {', '.join(n for n, _ in pairs[:9])}")
    return found


def read_result(path: Path, kinds: Collection[str]) -> dict[str, Any]:
    """A result that :func:`write_json` wrote."""
    known, make = " or ".join(kinds), "Give the file that --json wrote."
    content = read_json(path, make)
    kind = content.get("schema") if isinstance(content, dict) else None
    if kind not in kinds:
        holds = "no result of this program" if kind is None else f"a result of '{kind}'"
        raise UserError(f"{path} holds {holds}; expected: {known}.", make)
    if content.get("schema_version") != SCHEMA_VERSION:
        raise UserError(
            f"{path}: has schema version {content.get('schema_version')}; this program reads "
            f"{SCHEMA_VERSION}.",
            "Write it again with this version.",
        )
    return dict(content)


def write_json(
    path: Path | None, what: str, content: Mapping[str, Any], simulated: bool | None = None
) -> None:
    """Write a result, and whether its recordings are simulated, if a file was named."""
    if path is not None:
        mark = {} if simulated is None else {"simulated": simulated}
        text = json.dumps(stamped(what, mark | dict(content)), indent=2, allow_nan=False)
        write_whole(path, text + "\n")
