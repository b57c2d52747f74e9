"""Received text (from a board, a recording, a folder), made safe to print."""

from __future__ import annotations

import unicodedata

MOST_LETTERS = 500
_CONTROL = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")  # with ESC and what turns the direction round


def shown(text: str, most: int = MOST_LETTERS) -> str:
    """Text on one line, without characters that move the cursor or hide letters."""
    return shown_lines(text[: most + 1].replace("\n", " ").replace("\t", " "), most)


def shown_lines(text: str, most: int | None = None) -> str:
    """As :func:`shown`, with the line ends and tabs of our own sentences left in."""
    if most is not None and len(text) > most:
        text = text[: most - 1] + "…"
    if text.isascii() and text.replace("\n", "").replace("\t", "").isprintable():
        return text
    hidden = {c for c in set(text) - set("\n\t") if unicodedata.category(c) in _CONTROL}
    return "".join("\ufffd" if c in hidden else c for c in text)
