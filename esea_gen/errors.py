"""Errors that a person can act on."""

from __future__ import annotations

import textwrap


class UserError(Exception):
    """Bad input: the command line prints it as one paragraph and exits with code 2.

    Parameters
    ----------
    what : str
        What is wrong and where: file, key or column, the value against its limit.
    fix : str
        What to do about it.
    """

    def __init__(self, what: str, fix: str) -> None:
        super().__init__(f"{what} {fix}".strip())
        self.what = what
        self.fix = fix


def paragraphs(text: str) -> str:
    """Text folded at blanks only: a name or a command with hyphens stays whole."""
    fold = textwrap.TextWrapper(100, break_on_hyphens=False, break_long_words=False)
    return "\n".join(map(fold.fill, text.splitlines()))
