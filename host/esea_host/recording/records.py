"""MCAP records in bytes of any origin: every length is checked before it is used."""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.opcode import Opcode

from esea_gen.link.received import shown

HEAD = struct.Struct("<BQ")
FOOTER_BYTES = HEAD.size + 20
MOST_PIECE_BYTES = 1 << 26
FREE_BYTES, MOST_RATIO = 1 << 26, 64  # unpacked altogether: this, and so many times the file
_KNOWN = frozenset(int(o) for o in Opcode)
_PRIVATE = 0x80
_CHUNK = struct.Struct("<QQQII")  # times, size, checksum, length of the compression's name
# A chunk's fixed fields, wherever they lie; three bytes of each length are 0.
_CHUNK_BYTES = re.compile(
    rb"(?=\x06.{5}\0\0\0.{16}.{5}\0\0\0.{4}(?:\0\0\0\0|\x03\0\0\0lz4|\x04\0\0\0zstd).{5}\0\0\0"
    rb"|\x09.{5}\0\0\0.{16}.{2}\0\0)",
    re.DOTALL,
)
MOST_CANDIDATES = 100_000


class PieceError(ValueError):
    """Bytes that cannot be read as what they should be."""


class Fields:
    """A record's fields, one after another, each within the record."""

    def __init__(self, data: bytes | mmap.mmap | memoryview, at: int, end: int) -> None:
        self.data, self.at, self.end = data, at, end

    def bytes(self, count: int) -> bytes:
        start, self.at = self.at, self.at + count
        if not start <= self.at <= self.end:
            raise PieceError("has a length that goes beyond its end")
        return bytes(self.data[start : self.at])

    def skip(self, count: int) -> None:
        if not 0 <= count <= self.end - self.at:
            raise PieceError("has a length that goes beyond its end")
        self.at += count

    def number(self, size: int) -> int:
        return int.from_bytes(self.bytes(size), "little")

    def text(self) -> str:
        return self.bytes(self.number(4)).decode("utf-8", "replace")

    def pairs(self) -> dict[str, str]:
        size = self.number(4)
        inner = type(self)(self.data, self.at, self.at + size)
        self.skip(size)
        found: dict[str, str] = {}
        while inner.at < inner.end:
            key = inner.text()
            found[key] = inner.text()
        return found


@dataclass(frozen=True)
class Schema:
    number: int
    name: str
    encoding: str

    @classmethod
    def read(cls, fields: Fields) -> Self:
        return cls(fields.number(2), shown(fields.text()), shown(fields.text()))


@dataclass(frozen=True)
class Channel:
    number: int
    schema: int
    topic: str
    encoding: str
    metadata: dict[str, str]

    @classmethod
    def read(cls, fields: Fields) -> Self:
        number, schema = fields.number(2), fields.number(2)
        topic, encoding = shown(fields.text()), shown(fields.text())
        return cls(number, schema, topic, encoding, fields.pairs())


@dataclass(frozen=True)
class AttachmentPlace:
    """An attachment: its name, and the bytes of the file from ``start`` to ``end``."""

    name: str
    body: int  # start of what its checksum covers
    start: int
    end: int


def attachment(data: mmap.mmap, at: int, end: int) -> AttachmentPlace:
    fields = Fields(data, at + HEAD.size, end)
    fields.skip(16)
    name = shown(fields.text())
    fields.text()
    size = fields.number(8)
    start = fields.at
    fields.skip(size)
    if fields.end - fields.at != 4:
        raise PieceError("is an attachment whose lengths contradict each other")
    return AttachmentPlace(name, at + HEAD.size, start, start + size)


@dataclass(frozen=True)
class ChunkHead:
    """A chunk's own fields; ``data`` is where its records begin."""

    start_ns: int
    end_ns: int
    size: int  # of its records when unpacked
    crc: int
    compression: str
    data: int


def chunk(data: mmap.mmap, at: int, end: int) -> ChunkHead:
    """The fields of a chunk; refused when its lengths contradict each other."""
    place = at + HEAD.size
    if place + _CHUNK.size > end:
        raise PieceError("is a chunk that is too short")
    start_ns, end_ns, size, crc, length = _CHUNK.unpack_from(data, place)
    fields = Fields(data, place + _CHUNK.size, end)
    if length > 32:
        raise PieceError("is a chunk with an impossible name of its compression")
    name = fields.bytes(length).decode("ascii", "replace")
    if fields.number(8) != end - fields.at:
        raise PieceError("is a chunk whose lengths contradict each other")
    return ChunkHead(start_ns, end_ns, size, crc, shown(name), fields.at)


def record_end(data: mmap.mmap, at: int, size: int) -> tuple[int, int]:
    """Kind and end of the record at a byte; refused when it cannot be one."""
    if at + HEAD.size > size:
        raise PieceError("ends in the middle of a record")
    opcode, length = HEAD.unpack_from(data, at)
    end = at + HEAD.size + length
    if opcode not in _KNOWN and opcode < _PRIVATE:
        raise PieceError("is no record")
    if end > size:
        raise PieceError("goes beyond the end of the file")
    if opcode == Opcode.CHUNK:
        chunk(data, at, end)
    elif opcode == Opcode.ATTACHMENT:
        attachment(data, at, end)
    elif opcode == Opcode.MESSAGE_INDEX:
        if length < 6 or int.from_bytes(data[at + 11 : at + 15], "little") != length - 6:
            raise PieceError("is an index whose lengths contradict each other")
    elif (opcode == Opcode.MESSAGE and length < 22) or (opcode == Opcode.DATA_END and length < 4):
        raise PieceError("is too short")
    return opcode, end


def next_record(data: mmap.mmap, at: int, size: int) -> int | None:
    """Where the next chunk or attachment begins whose lengths agree with each other."""
    for number, found in enumerate(_CHUNK_BYTES.finditer(data, at, size)):
        if number == MOST_CANDIDATES:
            break
        try:
            record_end(data, found.start(), size)
        except PieceError:
            continue
        return found.start()
    return None


def unpack(kind: str, data: memoryview, size: int) -> bytes:
    """A chunk's records, which may be no more and no fewer bytes than it says."""
    if size > MOST_PIECE_BYTES:
        raise PieceError(f"unpacks to {size} bytes, and {MOST_PIECE_BYTES} are the most")
    try:
        if kind == "zstd":
            unpacker = zstandard.ZstdDecompressor(max_window_size=MOST_PIECE_BYTES)
            with unpacker.stream_reader(data) as stream:
                found = stream.read(size + 1)
        elif kind == "lz4":
            found = LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        elif kind:
            raise PieceError(f"is packed as {kind}; read are zstd and lz4")
        else:
            found = bytes(data)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise PieceError(f"cannot be unpacked ({shown(str(error))})") from None
    if len(found) != size:
        raise PieceError("unpacks to another number of bytes than it says")
    return found


def records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Kind, start and end of every record of a chunk; refused where one is cut."""
    at, size = 0, len(data)
    while at < size:
        if at + HEAD.size > size:
            raise PieceError("ends in the middle of a record")
        opcode, length = HEAD.unpack_from(data, at)
        end = at + HEAD.size + length
        if opcode not in _KNOWN and opcode < _PRIVATE:
            raise PieceError("has something that is no record")
        if end > size:
            raise PieceError("has a record that goes beyond its end")
        yield opcode, at, end
        at = end
