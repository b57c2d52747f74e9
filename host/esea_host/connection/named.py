"""Streams by name and rate (ESEA_DATA): some values of a task, as rows like all others."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from esea_gen.link.streams import BoardStream
from esea_host.recording.layout import Array, StreamColumn, StreamLayout

TICK = "sequence"
Texts = Mapping[str, Mapping[str, str]]
_HEAD = struct.Struct("<QIHBBB")  # device clock, tick, interval, stream, choice, samples


@dataclass(frozen=True)
class NamedStream:
    """A stream that the board was asked for, and its rows' layout."""

    layout: StreamLayout
    board: BoardStream

    @property
    def key(self) -> tuple[int, int]:
        return self.board.number, self.board.choice


def named_streams(
    made: Iterable[BoardStream], name: str, units: Texts, meanings: Texts
) -> list[NamedStream]:
    """Layouts of what a board has agreed to send."""
    found = []
    boards = list(made)
    for i, board in enumerate(boards):
        columns = [StreamColumn(TICK, "u4")]
        for s in board.signals:
            plain = s.name.replace("[", "_").replace("]", "")
            kind = "u4" if s.whole else "f4"
            unit, meaning = (
                next(
                    (m[s.array] for k, m in t.items() if s.array in m and board.task in k.lower()),
                    "",
                )
                for t in (units, meanings)
            )
            columns.append(StreamColumn(plain, kind, unit, meaning))
        own = name if len(boards) == 1 else f"{name}_{board.task}_{i}"
        found.append(NamedStream(StreamLayout(own, tuple(columns)), board))
    return found


def data_key(payload: bytes) -> tuple[int, int]:
    return payload[14], payload[15]


def data_rows(stream: NamedStream, payload: bytes) -> Array:
    """Rows of one message, by their bits."""
    _, tick, interval, _, _, count = _HEAD.unpack_from(payload)
    width = len(stream.layout.columns) - 1
    words = np.frombuffer(payload, "<u4", count * width, _HEAD.size).reshape(count, width)
    packed = np.empty((count, width + 1), "<u4")
    packed[:, 0] = (tick + interval * np.arange(count, dtype=np.int64)) & 0xFFFFFFFF
    packed[:, 1:] = words
    return packed.view(stream.layout.dtype).reshape(count)
