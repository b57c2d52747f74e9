"""Reading TOML into a typed table: what is wrong, where, with which value, and the fix."""

from __future__ import annotations

import dataclasses
import difflib
import json
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import tomlkit
import tomlkit.exceptions
from pydantic import BaseModel, TypeAdapter, ValidationError

from esea_gen.errors import UserError

T = TypeVar("T")


@dataclass(frozen=True)
class Problem:
    """The first thing that is wrong in a document.

    kind: pydantic's word for it; ``extra_forbidden`` and ``missing`` among others.
    known: names of the keys that may stand there.
    within, wanted: type of the table the key stands in, and of the key itself; None if unknown.
    text: what the model says of the key.
    """

    kind: str
    loc: tuple[str | int, ...]
    given: Any
    known: tuple[str, ...]
    within: Any
    wanted: Any
    text: str

    @property
    def key(self) -> str:
        """The dotted key, elements of rows in brackets."""
        parts = (f"[{p}]" if isinstance(p, int) else f".{p}" for p in self.loc)
        return "".join(parts).removeprefix(".")


def read_text(path: Path, fix: str) -> str:
    """Text of a file that a person wrote."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path.name}: cannot be read as text ({error}).", fix) from None


def parse_toml(text: str, origin: str, see: str) -> dict[str, Any]:
    """The document as plain values; ``see`` names where the form is shown."""
    try:
        return dict(tomlkit.parse(text).unwrap())  # its errors name a key that occurs twice
    except tomlkit.exceptions.TOMLKitError as error:
        raise UserError(
            f"{origin}: not valid TOML ({error}).", f"Correct that line; see {see}."
        ) from None


def checked(
    kind: type[T],
    document: Mapping[str, Any],
    origin: str,
    fix: Callable[[Problem], str | UserError | None],
) -> T:
    """A document as ``kind``, a pydantic model or dataclass.

    fix: what to do about a problem, or the whole message; None where the text says it.
    """
    try:
        # As JSON, so that a strict model takes a row of numbers for a tuple.
        return TypeAdapter(kind).validate_json(json.dumps(document, default=str))
    except ValidationError as error:
        raise _explained(error, kind, origin, fix) from None


def nearest(name: str, known: typing.Iterable[str]) -> str:
    """``Did you mean ...? `` for a name that is near a known one."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"Did you mean {close[0]}? " if close else ""


def _explained(
    error: ValidationError, kind: Any, origin: str, fix: Callable[[Problem], str | UserError | None]
) -> UserError:
    # A misspelt key shows as one unknown and one missing key: tell of the unknown first.
    items = sorted(error.errors(), key=lambda e: e["type"] not in UNKNOWN)
    first, more = items[0], len(items) - 1
    tail = f" ({more} more problem{'s' if more > 1 else ''} in this file.)" if more else ""
    within = _type_at(kind, first["loc"][:-1])
    keys = _keys(within)
    wanted, text = keys.get(str(first["loc"][-1]), (None, "")) if first["loc"] else (kind, "")
    word = "extra_forbidden" if first["type"] in UNKNOWN else first["type"]
    problem = Problem(word, first["loc"], first.get("input"), tuple(keys), within, wanted, text)
    said = fix(problem)
    if isinstance(said, UserError):
        return UserError(f"{origin}: {said.what}", said.fix + tail)
    if word == "extra_forbidden":
        return UserError(
            f"{origin}: unknown key {problem.key} = {problem.given!r}.",
            f"{nearest(str(problem.loc[-1]), keys)}Known keys here: {', '.join(keys)}.{tail}",
        )
    if word in MISSING:
        about = f" ({text.rstrip('.')})" if text else ""
        return UserError(
            f"{origin}: key {problem.key} is missing{about}.", (said or "Add it.") + tail
        )
    reason = first["msg"][0].lower() + first["msg"][1:]
    return UserError(
        f"{origin}: {problem.key} = {problem.given!r}: {reason}.",
        (said or text or "Correct it.") + tail,
    )


UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
MISSING = ("missing", "missing_argument")


def _keys(kind: Any) -> dict[str, tuple[Any, str]]:
    # Keys of a table with type and text.
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        fields = kind.model_fields.items()
        return {f.alias or k: (f.annotation, f.description or "") for k, f in fields}
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        hints = typing.get_type_hints(kind)
        return {f.name: (hints[f.name], "") for f in dataclasses.fields(kind)}
    return {}


def table_type(kind: Any) -> Any:
    """The table in a type such as ``Table | None``; the type itself where there is none."""
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return next((k for k in map(table_type, typing.get_args(kind)) if _keys(k)), kind)
    return kind


def _type_at(kind: Any, loc: tuple[str | int, ...]) -> Any:
    # Type of what stands at a place of the document.
    for part in loc:
        kind = table_type(kind)
        if _keys(kind):
            kind = _keys(kind).get(str(part), (None, ""))[0]
        else:  # a row or a table of named things
            inner = [k for k in typing.get_args(kind) if k is not Ellipsis]
            kind = inner[-1] if inner else None
    return table_type(kind)
