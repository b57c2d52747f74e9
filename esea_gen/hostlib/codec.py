"""How numbers cross between Python and the C: in units, or in q31 as raw numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.emit.naming import Naming
from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.system import External

Array = npt.NDArray[Any]

INVALID = -(2**31)
"""Raw number of what is not a number or does not fit: no port takes it as valid."""


def to_whole(values: Any, integer: npt.DTypeLike = np.uint32) -> Array:
    """Field content of a flag or count for numbers; integers unchanged."""
    column, ends = np.asarray(values), np.iinfo(np.dtype(integer))
    if column.dtype.kind in "iu":
        return column.astype(integer)
    valid = (column >= ends.min) & (column <= ends.max) & (np.ceil(column) == column)
    return np.where(valid, column, ends.min or ends.max).astype(np.int64).astype(integer)


def to_raw(values: Any, fraction: int) -> Array:
    """Raw numbers of values, as the macro ``ESEA_Q31_FROM`` gives them."""
    with np.errstate(all="ignore"):
        scaled = np.asarray(values, dtype=np.float64) * 2.0**fraction
        fits = (scaled < 2.0**31 - 1) & (scaled > -(2.0**31 - 1))
        rounded = np.trunc(np.where(fits, scaled, 0.0) + np.where(scaled < 0, -0.5, 0.5))
    return np.where(fits, rounded, float(INVALID)).astype(np.int64).astype(np.int32)


def _raw_number(value: float, fraction: int) -> int:
    # As to_raw, of one number: a board that is run step by step asks for some 10^5 of them.
    scaled = value * 2.0**fraction
    if not abs(scaled) < 2.0**31 - 1:
        return INVALID
    return int(scaled - 0.5 if scaled < 0 else scaled + 0.5)


def from_raw(raw: Array, fraction: int) -> Array:
    return np.asarray(raw, dtype=np.float64) * 2.0**-fraction


@dataclass(frozen=True)
class Field:
    name: str
    port: Port
    fraction: int | None = None  # of its raw numbers; None where the C holds numbers in units

    def encode(self, values: Any) -> Any:
        """Raw C values for numbers in units; integers are raw already."""
        if self.port.kind != "quantity":
            held = to_whole(values, self.port.integer)
            return int(held) if isinstance(values, float) else held
        if self.fraction is not None and isinstance(values, float):
            return _raw_number(values, self.fraction)
        column = np.asarray(values)
        if self.fraction is None or column.dtype.kind in "iu":
            return column
        return to_raw(column, self.fraction)

    def decode(self, held: Any) -> Any:
        """Numbers in units for raw C values, except a status word."""
        if self.fraction is None or self.port.whole:
            return held
        return held * 2.0**-self.fraction


def block_field(naming: Naming, block: Block, group: str, port: Port) -> Field:
    """A field of a Block's own struct: ``in``, ``out`` or ``state``."""
    return Field(port.name, port, naming.fraction(block, group, port.name))


def external_field(naming: Naming, external: External) -> Field:
    """A field of a task's struct."""
    return Field(external.name, external.port, naming.external_fraction(external))


@cache
def struct_dtype(ffi: Any, c_type: str) -> np.dtype[Any]:
    """numpy type of a C struct, field for field."""

    def converted(ctype: Any) -> np.dtype[Any]:
        if ctype.kind == "primitive":
            primitive = {"double": "f8", "float": "f4", "uint32_t": "u4", "int32_t": "i4"}
            return np.dtype(primitive[ctype.cname])
        if ctype.kind == "array":
            return np.dtype((converted(ctype.item), (ctype.length,)))
        fields = dict(ctype.fields)  # of a System without state there is none
        return np.dtype(
            {
                "names": list(fields),
                "formats": [converted(f.type) for f in fields.values()],
                "offsets": [f.offset for f in fields.values()],
                "itemsize": ffi.sizeof(ctype),
            }
        )

    return converted(ffi.typeof(c_type))
