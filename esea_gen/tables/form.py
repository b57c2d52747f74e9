"""How a table is written, and what its messages share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from esea_gen.errors import UserError, nearest

LONGEST_SHOWN = 40  # characters of a cell in a message
MOST_SHOWN = 20  # names of columns in a message
MOST_LINES = 5  # line numbers in a message
Kind = Literal["csv", "mat", "hdf5", "parquet", "json"]


class TableFormat(BaseModel):
    """How a file is written; what is left out is detected."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    kind: Kind | None = Field(
        default=None,
        description="csv: text table; mat: MATLAB; json: columns by name, or a list of rows. By "
        "the file's content if left out.",
    )
    delimiter: str | None = Field(
        default=None,
        pattern=r"^(?:[^\w\s.+\-#\"']|[\t ])$",
        description="Between cells; a comma, semicolon, tab, bar or blanks are detected.",
    )
    quote: str = Field(
        default='"', pattern=r"^[^\w\s.,;+\-#]?$", description='Round a cell; "": no quoting.'
    )
    decimal: Literal[".", ","] | None = Field(
        default=None, description="Decimal mark; detected if left out."
    )
    encoding: str | None = Field(
        default=None,
        description="Text encoding, such as latin-1, utf-16 or gb18030; by the byte order mark, or "
        "utf-8, if left out.",
    )
    header_line: int | None = Field(
        default=None,
        ge=0,
        le=1000,
        description="Line with the column names; 0: none, named 1, 2, ... The first line that is "
        "neither blank nor a comment (#) if left out.",
    )
    first_data_line: int | None = Field(
        default=None, ge=1, le=1000, description="First line of numbers; the one after the header."
    )

    @field_validator("encoding")
    @classmethod
    def _known(cls, encoding: str | None) -> str | None:
        try:
            # Codecs that are no text encodings (base64) fail only when they are used.
            "a".encode(encoding or "utf-8")
        except (LookupError, UnicodeError):
            raise ValueError("not a known text encoding") from None
        return encoding


def shortened(text: str) -> str:
    """A cell for a message: one short line."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_SHOWN else f"{line[:LONGEST_SHOWN]}..."


def listed(names: Sequence[str]) -> str:
    shown = ", ".join(f"'{shortened(n)}'" for n in names[:MOST_SHOWN] if n) or "none"
    return shown + (f" and {len(names) - MOST_SHOWN} more" if len(names) > MOST_SHOWN else "")


def numbered(what: str, lines: Sequence[int]) -> str:
    """``line 3`` or ``lines 3, 4 and 10 more``."""
    shown = ", ".join(str(n) for n in lines[:MOST_LINES])
    more = f" and {len(lines) - MOST_LINES} more" if len(lines) > MOST_LINES else ""
    return f"{what}{'s' if len(lines) > 1 else ''} {shown}{more}"


def remedy(settings: str, key: str, otherwise: str) -> str:
    """What to do, and which key of the format helps as well where the user can set one."""
    return f"{otherwise}, or set {key} in {settings}." if settings else f"{otherwise}."


def missing_column(name: str, wanted: str, known: Sequence[str], fix: str) -> UserError:
    """The error for a column that is not in a table."""
    hint = nearest(wanted, [n for n in known if n])
    return UserError(
        f"{name}: there is no column '{wanted}'; the columns are {listed(known)}.", hint + fix
    )


def check_unique(name: str, where: str, names: Iterable[str], fix: str) -> None:
    """Reject a column name that occurs twice; empty names name nothing."""
    places: dict[str, list[int]] = {}
    for place, n in enumerate(names, 1):
        places.setdefault(n, []).append(place)
    for n, at in places.items():
        if n and len(at) > 1:
            raise UserError(
                f"{name}{where}: the column name '{shortened(n)}' occurs {len(at)} times "
                f"({numbered('column', at)}).",
                fix,
            )
