"""What is in an MCAP file, whole, cut off or damaged: every piece is found and checked by itself.

The index at a file's end is not used: a file that was cut has none, and the pieces say it all.
"""

from __future__ import annotations

import io
import json
import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Schema
from mcap.writer import MCAP0_MAGIC

from esea_gen.errors import UserError
from esea_host.recording.layout import Array, StreamLayout
from esea_host.recording.writer import COLUMNS_KEY

_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")  # times, size, crc, length of the compression's name
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_DTYPE = [("op", "u1"), ("length", "<u8"), ("channel", "<u2"), ("number", "<u4")]
_MESSAGE_DTYPE += [("log_ns", "<u8"), ("board_ns", "<u8")]
_MAGIC_BYTES = len(MCAP0_MAGIC)


@dataclass(frozen=True)
class Piece:
    """A chunk: where it is, when it is, and how long its content is.

    offset, end: of the whole record in the file.
    """

    offset: int
    end: int
    start_ns: int
    end_ns: int
    crc: int
    compression: str
    data: int
    index: dict[int, tuple[int, int]] = field(default_factory=dict)


@dataclass(frozen=True)
class Rows:
    """Messages of a channel, of a piece.

    data: their contents, one after another.
    lengths: of each.
    """

    log_ns: Array
    board_ns: Array
    data: bytes
    lengths: Array


class PieceError(ValueError):
    """A piece's checksum is wrong, or it cannot be read at all."""


class LogFile:
    """An MCAP file, mapped into memory.

    whole: whether it was finished; else everything up to ``readable_bytes`` could be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        try:
            self._handle = self.path.open("rb")
        except OSError as error:
            raise UserError(f"{path} cannot be opened: {error.strerror}.", "") from None
        size = self.path.stat().st_size
        start = self._handle.read(_MAGIC_BYTES)
        if start != MCAP0_MAGIC:
            self._handle.close()
            what = "is empty" if not start else "is no MCAP file"
            if MCAP0_MAGIC.startswith(start) and start:
                what = "was cut off before anything was written"
            raise UserError(f"{path} {what}.", "Give a recording.")
        self._map = mmap.mmap(self._handle.fileno(), size, access=mmap.ACCESS_READ)
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.attachments: dict[str, bytes] = {}
        self.damaged_attachments: list[str] = []
        self.pieces: list[Piece] = []
        self.damaged: list[str] = []
        self.readable_bytes, self.whole = self._scan(size)

    def close(self) -> None:
        """Let go of the file."""
        self._map.close()
        self._handle.close()

    def _scan(self, size: int) -> tuple[int, bool]:
        at = _MAGIC_BYTES
        while at + _RECORD.size <= size:
            opcode, length = _RECORD.unpack_from(self._map, at)
            end = at + _RECORD.size + length
            if end > size:
                return at, False
            if opcode == Opcode.CHUNK:
                self._found_piece(at, end)
            elif opcode == Opcode.MESSAGE_INDEX and self.pieces:
                (channel, count) = struct.unpack_from("<HI", self._map, at + _RECORD.size)
                place = at + _RECORD.size + 6, count // 16
                self.pieces[-1].index.setdefault(channel, place)
            elif opcode == Opcode.ATTACHMENT:
                self._found_attachment(at, end)
            elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
                self._learn(self._map[at:end])
            elif opcode == Opcode.DATA_END:
                tail = self._map[size - _MAGIC_BYTES : size]
                return at, tail == MCAP0_MAGIC and size > end
            at = end
        return at, False

    def _found_attachment(self, at: int, end: int) -> None:
        data = self._map[at:end]
        stream = ReadDataStream(io.BytesIO(data[_RECORD.size :]))
        (crc,) = struct.unpack_from("<I", data, len(data) - 4)
        try:
            found = Attachment.read(stream)
        except Exception:
            self.damaged_attachments.append("?")
            return
        if crc and zlib.crc32(data[_RECORD.size : -4]) != crc:
            self.damaged_attachments.append(found.name)
            return
        self.attachments[found.name] = found.data

    def _found_piece(self, at: int, end: int) -> None:
        place = at + _RECORD.size
        start, stop, _, crc, length = _CHUNK.unpack_from(self._map, place)
        place += _CHUNK.size
        name = bytes(self._map[place : place + length]).decode("ascii", "replace")
        piece = Piece(at, end, start, stop, crc, name, place + length + 8)
        self.pieces.append(piece)
        try:
            self._learn_from(piece)
        except PieceError as error:
            self.damaged.append(str(error))

    def _learn_from(self, piece: Piece) -> None:
        # Channels stand at a piece's beginning, and only in the first that has them.
        content = memoryview(self._map)[piece.data : piece.end]
        try:
            first = content[0] if not piece.compression else self.content(piece, True)[0]
        except IndexError:
            return
        finally:
            content.release()
        if first in (Opcode.CHANNEL, Opcode.SCHEMA):
            data = self.content(piece, checked=False)
            for op, at, end in _records(data):
                if op in (Opcode.CHANNEL, Opcode.SCHEMA):
                    self._learn(data[at:end])

    def _learn(self, record: bytes) -> None:
        stream = ReadDataStream(io.BytesIO(record[_RECORD.size :]))
        if record[0] == Opcode.CHANNEL:
            channel = Channel.read(stream)
            self.channels.setdefault(channel.id, channel)
        else:
            schema = Schema.read(stream)
            self.schemas.setdefault(schema.id, schema)

    def content(self, piece: Piece, checked: bool = True) -> bytes:
        """A piece's records.

        checked: refuse it when its checksum is wrong.
        """
        data = self._map[piece.data : piece.end]
        if piece.compression == "zstd":
            try:
                data = zstandard.ZstdDecompressor().decompress(data)
            except zstandard.ZstdError as error:
                raise PieceError(self._where(piece, f"cannot be unpacked ({error})")) from None
        elif piece.compression:
            raise PieceError(self._where(piece, f"is packed as {piece.compression}"))
        if checked and zlib.crc32(data) != piece.crc:
            raise PieceError(self._where(piece, "has a wrong checksum"))
        return bytes(data)

    def _where(self, piece: Piece, what: str) -> str:
        return f"{self.path.name}: the piece at byte {piece.offset} {what}"

    def topics(self) -> dict[str, int]:
        """Channel of every topic, without the slash before it."""
        return {c.topic.lstrip("/"): i for i, c in self.channels.items()}

    def layout(self, topic: str) -> StreamLayout | None:
        """A stream's layout; None for events."""
        channel = self.channels[self.topics()[topic]]
        text = channel.metadata.get(COLUMNS_KEY)
        return None if text is None else StreamLayout.from_json(topic, text)

    def read(self, piece: Piece, topic: str, checked: bool = True) -> Rows | None:
        """Messages of a topic in a piece."""
        channel = self.topics()[topic]
        data = self.content(piece, checked)
        offsets = self._indexed(piece, channel, data)
        if offsets is None:
            # Cut right behind the piece, or its index is another's.
            found = [
                at
                for op, at, _ in _records(data)
                if op == Opcode.MESSAGE and _MESSAGE.unpack_from(data, at)[2] == channel
            ]
            offsets = np.array(found, np.int64)
        return _gather(data, offsets) if len(offsets) else None

    def _indexed(self, piece: Piece, channel: int, data: bytes) -> Array | None:
        if not piece.index:
            return None
        at, count = piece.index.get(channel, (0, 0))
        table = np.frombuffer(self._map[at : at + 16 * count], "<u8").reshape(-1, 2)
        offsets = table[:, 1].astype(np.int64)
        if not len(offsets):
            return offsets
        raw = np.frombuffer(data, np.uint8)
        if offsets.max() + _MESSAGE.size > len(raw) or (raw[offsets] != Opcode.MESSAGE).any():
            return None
        low, high = raw[offsets + _RECORD.size], raw[offsets + _RECORD.size + 1]
        return offsets if (low.astype(int) | high.astype(int) << 8 == channel).all() else None

    def events(self, topic: str) -> Iterator[tuple[int, dict[str, Any]]]:
        """Time and content of a topic's JSON messages, damaged pieces left out."""
        if topic not in self.topics():
            return
        for piece in self.pieces:
            try:
                rows = self.read(piece, topic)
            except PieceError:
                continue
            if rows is None:
                continue
            place = 0
            for ns, length in zip(rows.log_ns.tolist(), rows.lengths.tolist(), strict=True):
                yield ns, json.loads(rows.data[place : place + length])
                place += length


def _records(data: bytes) -> Iterator[tuple[int, int, int]]:
    at = 0
    while at + _RECORD.size <= len(data):
        opcode, length = _RECORD.unpack_from(data, at)
        end = at + _RECORD.size + length
        if end > len(data):
            return
        yield opcode, at, end
        at = end


def _gather(data: bytes, offsets: Array) -> Rows:
    raw = np.frombuffer(data, np.uint8)
    head = raw[offsets[:, None] + np.arange(_MESSAGE.size)]
    heads = np.ascontiguousarray(head).view(np.dtype(_MESSAGE_DTYPE)).ravel()
    lengths = heads["length"].astype(np.int64) - (_MESSAGE.size - _RECORD.size)
    starts = offsets + _MESSAGE.size
    if len(set(lengths.tolist())) == 1:
        content = raw[starts[:, None] + np.arange(lengths[0])].tobytes()
    else:
        pairs = zip(starts.tolist(), lengths.tolist(), strict=True)
        content = b"".join(data[s : s + n] for s, n in pairs)
    times = heads["log_ns"].astype(np.int64), heads["board_ns"].astype(np.int64)
    return Rows(*times, content, lengths)
