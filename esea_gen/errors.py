"""Errors that a person can act on."""

from __future__ import annotations

import difflib
import textwrap
from collections.abc import Collection, Iterable
from importlib import import_module
from types import ModuleType


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


def from_extra(module: str, extra: str, what: str) -> ModuleType:
    """A module that an extra of the package brings.

    Parameters
    ----------
    module : str
        Its name.
    extra : str
        The extra, as pip takes it.
    what : str
        What it is needed for, as the start of a sentence.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        name = module.partition(".")[0]
        if error.name not in (module, name):
            raise
        raise UserError(
            f"{what} needs {name}, which is not installed.",
            f'Install it with: pip install "esea-gen[{extra}]"',
        ) from None


def paragraphs(text: str) -> str:
    """Text folded at blanks only: a name or a command with hyphens stays whole.

    Parameters
    ----------
    text : str
        Lines of any length.
    """
    fold = textwrap.TextWrapper(100, break_on_hyphens=False, break_long_words=False)
    return "\n".join(map(fold.fill, text.splitlines()))


def nearest(name: str, known: Iterable[str]) -> str:
    """``Did you mean ...? `` for a name that is near a known one, else nothing.

    Parameters
    ----------
    name, known : str
        What was given, and what there is.
    """
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"Did you mean {close[0]}? " if close else ""


def choose(what: str, given: str, known: Collection[str], otherwise: str = "") -> None:
    """Refuse a name that is not known; the error names the nearest one.

    Parameters
    ----------
    what : str
        What it is a name of.
    given, known : str
        The name, and those that there are.
    otherwise : str, optional
        What else may be given, as the end of a sentence.
    """
    if given not in known:
        raise UserError(
            f"Unknown {what} '{given}'.",
            f"{nearest(given, known)}Choose from {', '.join(known)}{otherwise}.",
        )
