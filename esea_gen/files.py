"""Files written whole or not at all: what was there before stays until the new one is complete."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from esea_gen import __version__
from esea_gen.errors import UserError, choose


@cache
def template_folder() -> Path:
    """Folder of the Jinja templates: inside the wheel, or at the top of a checkout."""
    packaged = Path(__file__).parent / "_templates"
    return packaged if packaged.is_dir() else Path(__file__).parents[1] / "templates"


def sample_folder() -> Path:
    """Folder of the recordings that come along: inside the wheel, or in the tests of a checkout."""
    packaged = Path(__file__).parent / "_samples"
    return packaged if packaged.is_dir() else Path(__file__).parents[1] / "tests" / "data"


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, and the folders that it stands in."""
    data = content.encode() if isinstance(content, str) else content
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".esea-", delete=False) as scratch:
            try:
                scratch.write(data)
                scratch.flush()
                os.chmod(scratch.name, 0o644)
                Path(scratch.name).replace(path)
            except OSError:
                Path(scratch.name).unlink(missing_ok=True)
                raise
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written ({error.strerror or error}).",
            "Make room, or give another file.",
        ) from error


@contextmanager
def new_whole(path: Path) -> Iterator[Path]:
    """Where to write a new file or folder, which becomes ``path`` unless the body fails."""
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        there = "is not empty" if path.is_dir() else "is there already"
        raise UserError(f"{path} {there}.", "Give another name; nothing is overwritten.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".esea-") as scratch:
            part = Path(scratch) / path.name
            yield part
            part.replace(path)
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written ({error.strerror or error}).",
            "Make room, or give another name.",
        ) from error


# Of every result's JSON; it grows when a key goes or means something else, not when one comes.
SCHEMA_VERSION = 1


def stamped(what: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """A result with its head: the schema that it follows, that one's version, and the tool's.

    what: name of the schema, a file in ``esea_gen/schemas``.
    """
    head = {"schema": what, "schema_version": SCHEMA_VERSION, "tool_version": __version__}
    taken = head.keys() & content.keys()
    if taken:
        raise ValueError(f"{what}: the content has {', '.join(sorted(taken))} itself")
    return head | dict(content)


def result_schemas() -> dict[str, Path]:
    """JSON schemas of results, by name."""
    folder = Path(__file__).parent / "schemas"
    return {p.stem: p for p in sorted(folder.glob("*.json"))}


def result_schema(name: str) -> str:
    """The JSON schema of a result."""
    known = result_schemas()
    choose("result", name, known)
    return known[name].read_text(encoding="utf-8")


def read_result(path: Path, kinds: Collection[str]) -> dict[str, Any]:
    """A result that :func:`write_json` wrote.

    kinds: schemas that will do.
    """
    known, make = " or ".join(kinds), "Give the file that --json wrote."
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"{path}: cannot be read as JSON ({reason}).", make) from None
    kind = content.get("schema") if isinstance(content, dict) else None
    if kind not in kinds:
        holds = "no result of this program" if kind is None else f"a result of '{kind}'"
        raise UserError(f"{path}: holds {holds}; wanted is {known}.", make)
    if content.get("schema_version") != SCHEMA_VERSION:
        raise UserError(
            f"{path}: is of version {content.get('schema_version')} of its schema; read is "
            f"{SCHEMA_VERSION}.",
            "Make it again with this version.",
        )
    return dict(content)


def write_json(path: Path | None, what: str, content: Mapping[str, Any]) -> None:
    """Write a result as JSON, if a file was named; what: as :func:`stamped`."""
    if path is not None:
        text = json.dumps(stamped(what, content), indent=2, allow_nan=False)
        write_whole(path, text + "\n")
