"""Read TOML into a typed table; errors state place, value and remedy."""

from __future__ import annotations

import dataclasses
import json
import re
import reprlib
import tomllib
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError

from esea_gen.errors import UserError, nearest
from esea_gen.files import read_whole

T = TypeVar("T")
Located = tuple[Sequence[str | int], UserError]  # an error and its place
DEEPEST = 32


@dataclass(frozen=True)
class Problem:
    kind: str
    loc: tuple[str | int, ...]
    given: Any
    known: tuple[str, ...]
    within: Any
    wanted: Any
    text: str
    reason: str

    @property
    def key(self) -> str:
        """The dotted key, elements of rows in brackets."""
        parts = (f"[{p}]" if isinstance(p, int) else f".{p}" for p in self.loc)
        return "".join(parts).removeprefix(".")


def read_text(path: Path, fix: str) -> str:
    """A file's text; with Windows' ends of lines it is the same text, with the same digest."""
    try:
        return read_whole(path, fix).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise UserError(f"{path.name}: cannot be read as text ({error}).", fix) from None


def parse_toml(text: str, origin: str, see: str) -> dict[str, Any]:
    """The document as plain values; ``see`` names where the form is shown."""
    try:
        document = tomllib.loads(text)
        _check_depth(document)
        return document
    except tomllib.TOMLDecodeError as error:
        where = re.search(r"\(at line (\d+), column \d+\)$", str(error))
        line = int(where[1]) if where else 0
        stands = f": {text.splitlines()[line - 1].strip()}" if line else ""
        raise UserError(
            f"{origin}: not valid TOML ({error}){stands}", f"Correct that line; see {see}."
        ) from None
    except (ValueError, RecursionError) as error:  # a number of thousands of digits, or too nested
        raise UserError(f"{origin}: not valid TOML ({error}).", f"See {see}.") from None


def _check_depth(document: dict[str, Any]) -> None:
    # What reads it on goes down by recursion.
    level: list[Any] = [document]
    for _ in range(DEEPEST):
        tables = (v.values() if isinstance(v, dict) else v for v in level)
        level = [x for inner in tables for x in inner if isinstance(x, dict | list)]
        if not level:
            return
    raise ValueError(f"tables are nested more than {DEEPEST} deep")


_HEADER = re.compile(r"^\s*(\[\[?)\s*([\w.\"-]+)\s*\]\]?")


def line_of(text: str, loc: Sequence[str | int]) -> int:
    """Line of a key, or of the nearest table around it; 0 where it is not found."""
    wanted = [str(p) for p in loc]
    here: list[str] = []
    rows: dict[tuple[str, ...], int] = {}
    best, depth = 0, 0
    for number, line in enumerate(text.splitlines(), 1):
        header = _HEADER.match(line)
        if header:
            here = []
            parts = header[2].split(".")
            for k, part in enumerate(parts):
                here.append(part)
                if header[1] == "[[" and k == len(parts) - 1:
                    rows[tuple(here)] = rows.get(tuple(here), -1) + 1
                if tuple(here) in rows:
                    here.append(str(rows[tuple(here)]))
            path = here
        else:
            key = re.match(r"^\s*([\w\"-]+)\s*=", line)
            if not key:
                continue
            path = [*here, *key[1].strip('"').split(".")]
        if wanted[: len(path)] == path and len(path) > depth:
            best, depth = number, len(path)
    return best


def together(problems: Iterable[Located], origin: str, text: str) -> None:
    """Raise all errors in a file as one message, each with the line of its key."""
    placed = sorted(((line_of(text, loc), p) for loc, p in problems), key=lambda s: s[0])
    said = [(f"{origin}, line {line}" if line else origin, p) for line, p in placed]
    if len(said) == 1:
        raise UserError(f"{said[0][0]}: {said[0][1].what}", said[0][1].fix)
    if said:
        rows = [f"- {at}: {problem}" for at, problem in said]
        more = [f"and {len(rows) - MOST} more."] if len(rows) > MOST else []
        raise UserError(f"{origin}: {len(rows)} problems.", "\n".join(["", *rows[:MOST], *more]))


def checked(
    kind: type[T],
    document: Mapping[str, Any],
    origin: str,
    fix: Callable[[Problem], str | UserError | None],
    text: str = "",
) -> T:
    """A document as ``kind``, a pydantic model or dataclass."""
    value, problems = judged(kind, document, fix)
    together(problems, origin, text)
    assert value is not None
    return value


def judged(
    kind: type[T], document: Any, fix: Callable[[Problem], str | UserError | None]
) -> tuple[T | None, list[Located]]:
    """A document as ``kind``, or None and what is wrong with it, each with its place."""
    try:
        # As JSON, so that a strict model takes a row of numbers for a tuple.
        return TypeAdapter(kind).validate_json(json.dumps(document, default=str)), []
    except ValidationError as error:
        return None, [(p.loc, _explained(p, fix(p))) for p in _problems(error, kind)]


def _problems(error: ValidationError, kind: Any) -> list[Problem]:
    found: list[Problem] = []
    places = {e["loc"] for e in error.errors()}
    # A misspelt key shows as one unknown and one missing key: the unknown one tells of both.
    for e in sorted(error.errors(), key=lambda e: e["type"] not in UNKNOWN):
        loc, word = e["loc"], "extra_forbidden" if e["type"] in UNKNOWN else e["type"]
        beside = [
            str(p.loc[-1]) for p in found if p.kind == "extra_forbidden" and p.loc[:-1] == loc[:-1]
        ]
        if word in MISSING and nearest(str(loc[-1]), beside):
            continue
        # A list that has too few items since one of them is wrong: that one is told.
        if word == "too_short" and any(p != loc and p[: len(loc)] == loc for p in places):
            continue
        within = _type_at(kind, loc[:-1])
        keys = _keys(within)
        wanted, text = keys.get(str(loc[-1]), (None, "")) if loc else (kind, "")
        reason = e["msg"].removeprefix("Value error, ")
        reason = (reason[0].lower() + reason[1:]).replace("input should", "it must")
        reason = reason.replace("be an object", "be a table").replace("tuple should", "it must")
        found.append(Problem(word, loc, e.get("input"), tuple(keys), within, wanted, text, reason))
    return found


def _explained(problem: Problem, said: str | UserError | None) -> UserError:
    if isinstance(said, UserError):
        return said
    key, known, given = problem.key, problem.known, reprlib.repr(problem.given)
    about = f" ({problem.text.rstrip('.')})" if problem.text else ""
    if problem.kind == "extra_forbidden":
        return UserError(
            f"unknown key {key} = {given}.",
            f"{nearest(str(problem.loc[-1]), known)}Known keys here: {', '.join(known)}.",
        )
    if problem.kind in MISSING:
        return UserError(f"key {key} is missing{about}.", said or "Add it.")
    return UserError(f"{key} = {given}: {problem.reason}{about}.", said or "Correct it.")


UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
MOST = 20  # problems of a file told at once
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
