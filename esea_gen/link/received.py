"""Received text (from a board, a recording, a folder), made safe to print and to name files."""

from __future__ import annotations

import re
import unicodedata

MOST_LETTERS = 500
MOST_NAME = 100
_CONTROL = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")  # with ESC and what turns the direction round
_NOT_IN_NAMES = re.compile(r'[/\\:*?"<>|\s]+')
_WINDOWS = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)


def shown(text: str, most: int = MOST_LETTERS) -> str:
    """Text on one line, without what moves a terminal's cursor or hides letters."""
    return shown_lines(text[: most + 1].replace("\n", " ").replace("\t", " "), most)


def shown_lines(text: str, most: int | None = None) -> str:
    """As :func:`shown`, with the line ends and tabs of our own sentences left in."""
    if most is not None and len(text) > most:
        text = text[: most - 1] + "…"
    if text.isascii() and text.replace("\n", "").replace("\t", "").isprintable():
        return text
    return "".join(c if c in "\n\t" or not _hidden(c) else "\ufffd" for c in text)


def _hidden(letter: str) -> bool:
    return unicodedata.category(letter) in _CONTROL


def file_name(text: str, otherwise: str = "unnamed") -> str:
    """A name that stays within its folder, on every system."""
    name = _NOT_IN_NAMES.sub("_", shown(text).replace("\ufffd", "_"))
    name = name.lstrip(".-_ ")
    while len(name.encode()) > MOST_NAME:
        name = name[:-1]
    name = name.rstrip(". ")
    return f"_{name}" if _WINDOWS.fullmatch(name) else name or otherwise
