"""Journal of finished cases: an interrupted run continues without repeating them.

A journal has one line a finished case, on the disk before the next case starts; its name is a hash
of everything that the numbers depend on.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from esea_gen import __version__
from esea_gen.errors import UserError
from esea_gen.portability import try_lock


def canonical(content: Any) -> str:
    """JSON of one form: sorted keys, shortest numbers, nothing that is not finite."""
    try:
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise UserError(
            f"Not JSON-ready: {error}.", "Use text, finite numbers, lists and dicts with text keys."
        ) from None


def files_digest(files: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps(sorted(files.items())).encode()).hexdigest()


def rooms_digest() -> str:
    """SHA-256 of everything but the C that a study's figures depend on."""
    top = Path(__file__).parents[1]
    found = [p for room in ("twin", "analysis", "studies") for p in (top / room).rglob("*")]
    return files_digest(
        {
            p.relative_to(top).as_posix(): p.read_text(encoding="utf-8")
            for p in sorted(found)
            if p.suffix in (".py", ".toml")
        }
    )


def file_digest(path: Path | str) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}).", "Check the path.") from None


def versions() -> dict[str, str]:
    """Versions that results depend on: this package, Python, numpy, scipy, casadi, the machine."""
    from importlib.metadata import version

    found = {name: version(name) for name in ("numpy", "scipy", "casadi")}
    return found | {
        "esea_gen": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
    }


@dataclass(frozen=True)
class Configuration:
    parts: dict[str, Any]

    @property
    def key(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of parts and versions."""
        text = canonical({"parts": self.parts, "versions": versions()})
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Result:
    case: dict[str, Any]
    values: dict[str, float] | None  # None: it failed
    failure: str = ""


# -- journal --------------------------------------------------------------------------------------


class Journal:
    """Finished cases of one configuration, one JSON line each, in a file that survives kill -9."""

    def __init__(self, folder: Path | str, configuration: Configuration) -> None:
        self.configuration = configuration
        self.path = Path(folder) / f"{configuration.key}.jsonl"

    @contextlib.contextmanager
    def opened(self) -> Iterator[tuple[dict[str, Result], Callable[[Result], None]]]:
        """The finished cases by key, and a function that adds one; for one process at a time."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            stream = self.path.open("a+b")
        except OSError as error:
            raise UserError(
                f"{self.path}: cannot be written ({error.strerror}).", "Give another folder."
            ) from None
        with stream:
            if not try_lock(stream.fileno()):
                raise UserError(
                    f"{self.path}: another run is writing it.", "Wait for that run, or end it."
                )
            finished = self._read(stream)

            def add(result: Result) -> None:
                _append(stream, canonical(vars(result) | {"check": _check(result)}))

            yield finished, add

    def _read(self, stream: IO[bytes]) -> dict[str, Result]:
        stream.seek(0)
        content = stream.read()
        # A line is written at once and ends in a newline: what follows the last one is torn.
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            stream.truncate(whole)
            os.fsync(stream.fileno())
        lines = content[:whole].splitlines()
        head = canonical({"parts": self.configuration.parts, "versions": versions()})
        if not lines:
            _append(stream, head)
            return {}
        if lines[0].decode("utf-8", "replace") != head:
            raise UserError(
                f"{self.path}, line 1: not the head of this configuration.",
                "Move the file away; the run then starts from the beginning.",
            )
        finished: dict[str, Result] = {}
        for number, line in enumerate(lines[1:], 2):
            try:
                entry = json.loads(line)
                result = Result(entry["case"], entry["values"], entry["failure"])
                if entry["check"] != _check(result):
                    raise ValueError("its check sum is wrong")
            except (ValueError, KeyError, TypeError) as error:
                raise UserError(
                    f"{self.path}, line {number}: damaged ({error}).",
                    "Delete this line; its case runs again.",
                ) from None
            finished[canonical(result.case)] = result
        return finished


def _append(stream: IO[bytes], line: str) -> None:
    stream.write(line.encode() + b"\n")
    stream.flush()
    os.fsync(stream.fileno())


def _check(result: Result) -> str:
    return hashlib.sha256(canonical(vars(result)).encode()).hexdigest()[:8]
