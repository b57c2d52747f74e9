"""Texts by language: ``texts/<language>.toml``, and a study's own file over it."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from string import Formatter
from typing import Any

from esea_gen.errors import UserError, nearest
from esea_gen.toml_file import parse_toml

TEXTS = Path(__file__).parent / "texts"
ENGLISH = "en"
SEE = "docs/study-files.md"
# Tables to which a study's own tasks may add.
OPEN = ("scene", "task", "event", "gauge")
# Tables that the participant sees.
SEEN = ("format", "banner", "scene", "survey")
_SPEC = re.compile(r"(\.\d)?[dfg]?")


class KeyedText(str):
    """English for the record; :meth:`Words.of` gives the same text in another language."""

    __slots__ = ("key", "values")
    key: str
    values: Mapping[str, Any]


def keyed(key: str, **values: Any) -> KeyedText:
    made = KeyedText(words_of(ENGLISH)(key, **values))
    made.key, made.values = key, values
    return made


class Words(Formatter):
    """The texts of one language, by ``table.key``."""

    def __init__(self, language: str, texts: Mapping[str, str]) -> None:
        self.language, self.texts = language, texts

    def __call__(self, key: str, **values: Any) -> str:
        return self.vformat(self.texts[key], (), values)

    def of(self, text: str) -> str:
        """A keyed text in this language; any other one as it is."""
        return self(text.key, **text.values) if isinstance(text, KeyedText) else text

    def or_same(self, table: str, word: str) -> str:
        """The text of a word, or the word itself if it has no text."""
        return self.texts.get(f"{table}.{word}", word)

    def scene(self, key: str, values: Mapping[str, Any]) -> str:
        """A text of a scene; a key that is in no file is the text itself."""
        return self.vformat(self.or_same("scene", key), (), values)

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, str):
            return self.of(value)
        text = format(value, format_spec)
        numeric = isinstance(value, int | float)
        return text.replace(".", self.texts["format.decimal"]) if numeric else text


def language_of(path: Path) -> str:
    """Of a study's own file, such as own.de.toml."""
    return path.stem.rpartition(".")[2]


def languages() -> list[str]:
    return sorted(p.stem for p in TEXTS.glob("*.toml"))


@cache
def words_of(language: str, own: bytes = b"", origin: str = "") -> Words:
    """own: a study's file of this language; one not shipped needs all of SEEN."""
    path, texts = TEXTS / f"{language}.toml", dict[str, str]()
    if path in TEXTS.glob("*.toml"):
        texts = _read(path.read_text(encoding="utf-8"), path.name)
    elif not own:
        known = ", ".join(languages())
        fix = f"There are: {known}; a study may bring its own, see {SEE}."
        raise UserError(f"There are no texts in the language {language!r}.", fix)
    if own:
        try:
            given = own.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            fix = "Save it as UTF-8."
            raise UserError(f"{origin}: cannot be read as text ({error}).", fix) from None
        texts |= _checked(_read(given, origin), origin)
        english = words_of(ENGLISH).texts
        if lacking := sorted(english.keys() - texts.keys()):
            # What the participant reads is in one language.
            lacking.sort(key=lambda k: k.partition(".")[0] not in SEEN)
            what = f"{origin}: {len(lacking)} texts of the language {language!r} are missing, "
            if lacking[0].partition(".")[0] in SEEN:
                fix = f"Copy {TEXTS / ENGLISH}.toml, and translate {', '.join(SEEN)} at least."
                raise UserError(f"{what}such as {lacking[0]}.", fix)
            warnings.warn(f"{what}and shown in English, such as {lacking[0]}.", stacklevel=2)
            texts = {**english, **texts}
    return Words(language, texts)


def _read(text: str, origin: str) -> dict[str, str]:
    found = {}
    for table, entries in parse_toml(text, origin, SEE).items():
        for key, value in (entries if isinstance(entries, dict) else {"": entries}).items():
            if not key or not isinstance(value, str):
                where = f"{table}.{key}".rstrip(".")
                raise UserError(f"{origin}: {where} is not text.", f"Write [table], see {SEE}.")
            found[f"{table}.{key}"] = value
    return found


def _checked(texts: dict[str, str], origin: str) -> dict[str, str]:
    shipped = words_of(ENGLISH).texts
    for key, text in texts.items():
        if key not in shipped and key.partition(".")[0] not in OPEN:
            fix = f"{nearest(key, shipped)}New ones go into {', '.join(OPEN)}."
            raise UserError(f"{origin}: there is no text {key!r}.", fix)
        wanted, given = (_places(t, origin, key) for t in (shipped.get(key, text), text))
        if given != wanted:
            names = ", ".join(sorted(wanted)) or "nothing"
            raise UserError(
                f"{origin}: {key} has {', '.join(sorted(given)) or 'nothing'} in braces.",
                f"Put {names} there.",
            )
    return texts


def _places(text: str, origin: str, key: str) -> set[str]:
    # Names in braces; no attribute, index or width: the file may come from anybody.
    try:
        parts = [(n, s) for _, n, s, c in Formatter().parse(text) if n is not None and c is None]
    except ValueError as error:
        raise UserError(f"{origin}: {key}: {error}.", "Close every brace.") from None
    for name, spec in parts:
        if not name.isidentifier() or not _SPEC.fullmatch(spec or ""):
            raise UserError(
                f"{origin}: {key}: {{{name}:{spec}}} is not a placeholder.", "Write {name}."
            )
    return {name for name, _ in parts}
