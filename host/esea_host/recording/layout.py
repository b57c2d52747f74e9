"""How a stream's rows lie in memory, on the wire and in a recording.

A recorded row is a protobuf message whose every field has a fixed width and is always there, zeros
too: any protobuf reader takes it, and numpy reads a million of them without looking at one.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from pydantic import TypeAdapter, ValidationError

from esea_gen.errors import UserError
from esea_gen.link.received import shown

PACKAGE = "esea"
MOST_COLUMNS = 4096
Array = npt.NDArray[Any]

# numpy kind: protobuf's wire type, its field type, and the name in a schema's text.
_KINDS = {"f4": (5, 2), "u4": (5, 7), "i4": (5, 15), "f8": (1, 1), "u8": (1, 6), "i8": (1, 16)}


@dataclass(frozen=True)
class StreamColumn:
    name: str
    kind: str = "f4"  # f4, u4, i4, f8, u8 or i8
    unit: str = ""
    meaning: str = ""
    size: int = 1  # elements; above 1 the column is a vector


@dataclass(frozen=True)
class StreamLayout:
    """A stream: its name, and its columns in the order of the wire."""

    name: str
    columns: tuple[StreamColumn, ...]

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """A row, packed, as on the wire."""
        return np.dtype([_field(c.name, c) for c in self.columns])

    @cached_property
    def record_dtype(self) -> np.dtype[Any]:
        """A row as a protobuf message, with its tags between the values."""
        fields: list[Any] = []
        for number, column in enumerate(self.columns, 1):
            fields.append((f"tag {number}", "u1", (len(_tag(number, column)),)))
            if column.size > 1:
                fields.append((f"length {number}", "u1", (len(_length(column)),)))
            fields.append(_field(column.name, column))
        return np.dtype(fields)

    @property
    def shape(self) -> list[tuple[str, str, int]]:
        return [(c.name, c.kind, c.size) for c in self.columns]

    @property
    def units(self) -> dict[str, str]:
        return {c.name: c.unit for c in self.columns if c.unit}

    @cached_property
    def _tagged(self) -> Array:
        out = np.zeros((), self.record_dtype)
        for number, column in enumerate(self.columns, 1):
            out[f"tag {number}"] = list(_tag(number, column))
            if column.size > 1:
                out[f"length {number}"] = list(_length(column))
        return out

    def record(self, rows: Array) -> Array:
        out = np.repeat(self._tagged, len(rows))
        out[list(rows.dtype.names or ())] = rows
        return out

    def rows(self, data: bytes) -> Array:
        """Rows of protobuf messages, one after another."""
        out = np.empty(len(data) // self.record_dtype.itemsize, self.dtype)
        out[...] = np.frombuffer(data, self.record_dtype)[list(self.dtype.names or ())]
        return out

    def descriptor(self) -> bytes:
        """The protobuf ``FileDescriptorSet`` that says so to everybody else."""
        fields = b""
        for number, column in enumerate(self.columns, 1):
            label = 3 if column.size > 1 else 1
            kind = _KINDS[column.kind][1]
            text = _text(1, column.name) + _number(3, number) + _number(4, label) + _number(5, kind)
            fields += _text(2, text)
        message = _text(4, _text(1, self.name) + fields)
        file = _text(1, f"{PACKAGE}/{self.name}.proto") + _text(2, PACKAGE) + message
        return _text(1, file + _text(12, "proto3"))

    def to_json(self) -> str:
        return json.dumps([asdict(c) for c in self.columns])

    @classmethod
    def from_json(cls, name: str, text: str) -> Self:
        """Inverse of :meth:`to_json`; rejects other content."""
        try:
            columns = TypeAdapter(tuple[StreamColumn, ...]).validate_json(text, strict=True)
        except ValidationError:
            columns = ()
        names = [c.name for c in columns]
        sound = (
            0 < len(columns) <= MOST_COLUMNS
            and len(set(names)) == len(names)
            and all(shown(n) == n and n and not n.startswith(("tag ", "length ")) for n in names)
            and all(c.kind in _KINDS and 0 < c.size <= MOST_COLUMNS for c in columns)
            and sum(c.size for c in columns) <= 2 * MOST_COLUMNS
            and any((c.name, c.kind, c.size) == ("sequence", "u4", 1) for c in columns)
        )
        if not sound:
            raise UserError(f"The columns of {name} cannot be read.", "Record with esea-host.")
        texts = [(shown(c.unit), shown(c.meaning)) for c in columns]
        pairs = zip(columns, texts, strict=True)
        return cls(name, tuple(replace(c, unit=u, meaning=m) for c, (u, m) in pairs))


def _field(name: str, column: StreamColumn) -> Any:
    kind = f"<{column.kind}"
    return (name, kind, (column.size,)) if column.size > 1 else (name, kind)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def _tag(number: int, column: StreamColumn) -> bytes:
    return _varint(number << 3 | (2 if column.size > 1 else _KINDS[column.kind][0]))


def _length(column: StreamColumn) -> bytes:
    return _varint(column.size * int(column.kind[1]))


def _text(number: int, value: str | bytes) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _number(number: int, value: int) -> bytes:
    return _varint(number << 3) + _varint(value)


def layout_of(
    message: Any, name: str, units: dict[str, str], texts: dict[str, str]
) -> StreamLayout:
    """Layout of a message of a generated dialect."""
    letters = bytes(message.native_format).decode().lstrip("<")
    kinds = {"f": "f4", "I": "u4", "i": "i4", "d": "f8", "Q": "u8", "q": "i8"}
    columns = [
        StreamColumn(field, kinds[letter], units.get(field, ""), texts.get(field, ""), max(1, size))
        for field, letter, size in zip(
            message.ordered_fieldnames, letters, message.array_lengths, strict=True
        )
    ]
    return StreamLayout(name, tuple(columns))


def fits(message: Any) -> bool:
    """Whether all fields of a message are numbers of four or eight bytes."""
    letters: Sequence[str] = bytes(message.native_format).decode().lstrip("<")
    return all(letter in "fIidQq" for letter in letters)
