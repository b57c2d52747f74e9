"""Streams by name and rate (ESEA_DATA): some values of a task, as rows like all others."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from esea_gen.errors import UserError
from esea_host.connection.identity import column_texts
from esea_host.recording.layout import Array, StreamColumn, StreamLayout
from esea_link.streams import BoardStream

if TYPE_CHECKING:
    from esea_host.connection.device import ConnectedDevice

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
        """By which its messages are known."""
        return self.board.number, self.board.choice


def named_streams(
    made: Iterable[BoardStream], name: str, units: Texts, meanings: Texts
) -> list[NamedStream]:
    """Layouts of what a board has agreed to send.

    name: of the streams; with several, their task and a number behind it.
    units, meanings: of whole messages, by message and field.
    """
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


def listen_named(
    device: ConnectedDevice, signals: Iterable[str], rate_Hz: float = 0.0, name: str = "chosen"
) -> list[str]:
    """Have a board send some values of its tasks, and make rows of them.

    Parameters
    ----------
    device : ConnectedDevice
        The board.
    signals : iterable of str
        ``tau_Nm``, ``sense.tau_Nm``, ``sense.*``.
    rate_Hz : float
        Rows a second; 0: every run.
    name : str
        Of the stream; with several, their task and a number stand behind it.

    Returns
    -------
    list of str
        Names of the streams; what is recorded or subscribed to by them.
    """
    try:
        with device._lock:
            made = device.session.stream(signals, rate_Hz)
    except ValueError as error:
        raise UserError(f"{error}.", "Name signals of one task, such as sense.tau_Nm.") from None
    found = named_streams(made, name, *column_texts(device.identity.device))
    number = device.session.dialect.MAVLINK_MSG_ID_ESEA_DATA
    for stream in found:
        device.receiver.add_named(stream, number)
    return [s.layout.name for s in found]


def data_key(payload: bytes) -> tuple[int, int]:
    """Which stream a message is of."""
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
