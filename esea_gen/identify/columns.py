"""What readers of recorded files share."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_gen.language.ports import Array

LONGEST_SHOWN = 40  # characters of a cell in a message
MOST_SHOWN = 20  # names of columns in a message

Columns = tuple[dict[str, Array], npt.NDArray[np.intp]]


def shortened(text: str) -> str:
    """A cell for a message: one line, and not the file that a stray quote made of it."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_SHOWN else f"{line[:LONGEST_SHOWN]}..."


def missing_column(name: str, wanted: str, known: Sequence[str], kind: str) -> UserError:
    """The error for a column that is not there."""
    close = difflib.get_close_matches(wanted, known, n=1)
    hint = f"Did you mean '{shortened(close[0])}'? " if close else ""
    there = ", ".join(f"'{shortened(k)}'" for k in known[:MOST_SHOWN]) or "none"
    more = f" and {len(known) - MOST_SHOWN} more" if len(known) > MOST_SHOWN else ""
    return UserError(
        f"{name}: there is no {kind} '{wanted}'; there are {there}{more}.",
        f"{hint}Correct the column in the mapping file.",
    )


def vectors(name: str, content: Mapping[str, Any], wanted: Sequence[str], kind: str) -> Columns:
    """Named arrays as columns: real numbers, one dimension, equally long.

    content: arrays by name; kind: what one is called in messages.
    """
    known = [k for k in content if np.size(content[k]) > 1]
    out: dict[str, Array] = {}
    for w in wanted:
        if w not in known:
            raise missing_column(name, w, known, kind)
        value = np.asarray(content[w])
        if value.dtype.kind not in "fiu" or np.squeeze(value).ndim != 1:
            raise UserError(
                f"{name}: {kind} '{w}' has shape {value.shape} and type {value.dtype}, it is not "
                "a vector of real numbers.",
                f"Name a {kind} that is one.",
            )
        out[w] = np.asarray(np.squeeze(value), dtype=np.float64)
    lengths = {w: len(v) for w, v in out.items()}
    if len(set(lengths.values())) > 1:
        raise UserError(
            f"{name}: the {kind}s have different lengths {lengths}.", "Name equally long ones."
        )
    return out, np.arange(1, min(lengths.values()) + 1, dtype=np.intp)


__all__ = ["LONGEST_SHOWN", "Columns", "missing_column", "shortened", "vectors"]
