"""A name from a list, or an error that says which names there are."""

from __future__ import annotations

import difflib
from collections.abc import Collection

from esea_gen.errors import UserError


def choose(what: str, given: str, known: Collection[str], otherwise: str = "") -> None:
    """Refuse a name that is not known; the error names the nearest one.

    otherwise: what else may be given, as the end of a sentence.
    """
    if given not in known:
        near = difflib.get_close_matches(given, list(known), n=1)
        meant = f"Did you mean {near[0]}? " if near else ""
        raise UserError(
            f"Unknown {what} '{given}'.", f"{meant}Choose from {', '.join(known)}{otherwise}."
        )
