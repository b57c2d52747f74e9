"""MCAP records in bytes of any origin: every length is checked before it is used."""

from __future__ import annotations

import io
import mmap
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode

from esea_gen.link.received import shown
from esea_host.recording.layout import Array

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
    """Bytes that cannot be read in the expected form."""


@dataclass(slots=True, eq=False)
class Piece:
    """A chunk, or messages outside a chunk."""

    offset: int
    end: int
    data: int  # where its records begin
    size: int = 0  # of its records when unpacked
    crc: int = 0
    compression: str = ""
    times_ns: tuple[int, int] | None = None
    indexes: tuple[int, int] = (0, 0)  # bytes of the file with its message indexes
    problem: str = ""  # why it cannot be used; empty where it can
    spans: Array | None = None  # of its messages, one row a channel


def fields(kind: Any, data: bytes | mmap.mmap, at: int, end: int) -> Any:
    """A record without a payload, read by MCAP's library from its own bytes alone."""
    try:
        return kind.read(ReadDataStream(io.BytesIO(data[at + HEAD.size : end])))
    except (EndOfFile, struct.error, UnicodeDecodeError):
        raise PieceError("has fields that cannot be read") from None


def _text(data: mmap.mmap | bytes, at: int, end: int) -> tuple[bytes, int]:
    # A text with its length before it, and where it ends.
    start = at + 4
    stop = start + int.from_bytes(data[at:start], "little")
    if stop > end:
        raise PieceError("has a length that goes beyond its end")
    return data[start:stop], stop


def attachment(data: mmap.mmap | bytes, at: int, end: int) -> tuple[str, int, int]:
    """An attachment's name, and from where to where its content is."""
    name, place = _text(data, at + HEAD.size + 16, end)
    _, place = _text(data, place, end)
    start = place + 8
    stop = start + int.from_bytes(data[place:start], "little")
    if stop + 4 != end:
        raise PieceError("is an attachment whose lengths contradict each other")
    return shown(name.decode("utf-8", "replace")), start, stop


def chunk(data: mmap.mmap | bytes, at: int, end: int) -> Piece:
    """A chunk by its own fields; refused when its lengths contradict each other."""
    place = at + HEAD.size
    if place + _CHUNK.size > end:
        raise PieceError("is a chunk that is too short")
    start_ns, end_ns, size, crc, length = _CHUNK.unpack_from(data, place)
    if length > 32:
        raise PieceError("is a chunk with an impossible name of its compression")
    name, place = _text(data, place + _CHUNK.size - 4, end)
    if int.from_bytes(data[place : place + 8], "little") != end - place - 8:
        raise PieceError("is a chunk whose lengths contradict each other")
    compression = shown(name.decode("ascii", "replace"))
    return Piece(at, end, place + 8, size, crc, compression, (start_ns, end_ns))


def record_end(data: mmap.mmap | bytes, at: int, size: int) -> tuple[int, int]:
    """Kind and end of the record at a byte; refused when it cannot be one."""
    if at + HEAD.size > size:
        raise PieceError("ends in the middle of a record")
    opcode, length = HEAD.unpack_from(data, at)
    end = at + HEAD.size + length
    if opcode not in _KNOWN and opcode < _PRIVATE:
        raise PieceError("is not a record")
    if end > size:
        raise PieceError("goes beyond the end of the file or chunk")
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
        raise PieceError("unpacks to a number of bytes other than stated")
    return found


def records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Kind, start and end of every record of a chunk; refused where one is cut."""
    at = 0
    while at < len(data):
        opcode, end = record_end(data, at, len(data))
        yield opcode, at, end
        at = end
