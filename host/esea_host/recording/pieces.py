"""Pieces of an MCAP file that may be cut off, damaged or hostile: read within limits.

Each is checked once, when the file is opened.
"""

from __future__ import annotations

import mmap
import stat
import zlib
from collections import OrderedDict
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.lib.stride_tricks import sliding_window_view

from esea_gen.errors import UserError
from esea_gen.link.received import shown
from esea_host.recording import records
from esea_host.recording.integrity import Damage
from esea_host.recording.layout import Array
from esea_host.recording.records import HEAD, Piece, PieceError, fields
from esea_host.recording.writer import END_KEY, MARK

MESSAGE = np.dtype("u1,<u8,<u2,<u4,<i8,<i8")
MESSAGE.names = ("op", "length", "channel", "number", "log_ns", "board_ns")
# Of a piece, one row a channel; times of its first and last messages.
_SPAN = np.dtype(
    [("channel", "u2"), ("count", "i8"), ("log_ns", "i8", 2), ("board_ns", "i8", 2)]
)  # fmt: skip
MAGIC_BYTES = len(MCAP0_MAGIC)
MOST_PIECES, MOST_CHANNELS = 1_000_000, 4096
MOST_WALKED = 2_000_000  # records one by one, where no index lists them; and one for 8 bytes
MOST_LOOSE_BYTES = 1 << 22  # of messages outside chunks that are one piece
MOST_ATTACHED_BYTES = 1 << 24
KEPT_BYTES = 1 << 25  # of unpacked pieces


class PieceFile:
    """An MCAP file, mapped into memory: its pieces, channels and attachments."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._map, self.size, changed = _mapped(self.path)
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.attachments: dict[str, bytes] = {}
        self.pieces: list[Piece] = []
        self.library = self._end_mark = ""
        self._damages: list[Damage] = []
        self.holes: list[int] = []  # bytes where messages may be missing
        self._walked = 0
        self._kept: OrderedDict[int, tuple[bytes, Array, Array]] = OrderedDict()
        self._kept_bytes = 0
        self._data_end: int | None = None
        self._indexed: dict[int, tuple[int, int]] = {}  # times of the chunks that the index names
        try:
            if changed:
                self._damage(0, MAGIC_BYTES, "the file's first bytes were changed")
            self._readable = self._scan()
            left = records.FREE_BYTES + records.MOST_RATIO * self.size
            for piece in self.pieces:
                left -= piece.size if piece.compression else 0
                if piece.compression and left < 0:
                    piece.problem = f"would unpack the file to over {records.MOST_RATIO} times"
                self._examine(piece)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._kept.clear()
        self._map.close()

    def _damage(self, start: int, end: int, what: str, piece: Piece | None = None) -> None:
        lost: dict[str, int] = {}
        for channel, first, last in self._indexes(piece) if piece else ():
            lost[str(channel)] = lost.get(str(channel), 0) + (last - first) // 16
        self._damages.append(Damage(start, end, what, lost=lost))

    # -- where the records are -------------------------------------------------------------------

    @property
    def _ended(self) -> bool:
        foot = self.size - MAGIC_BYTES - records.FOOTER_BYTES
        return (
            foot >= MAGIC_BYTES
            and self._map[-MAGIC_BYTES:] == MCAP0_MAGIC
            and HEAD.unpack_from(self._map, foot) == (Opcode.FOOTER, 20)
        )

    def _scan(self) -> int:
        at, last, loose = MAGIC_BYTES, self.size, None
        while at < last:
            try:
                opcode, end = records.record_end(self._map, at, self.size)
                if opcode == Opcode.DATA_END:
                    self._data_end = at
                    return at
                if opcode == Opcode.FOOTER:
                    return at
                loose = self._found(opcode, at, end, loose)
            except PieceError as error:
                following = self._following(at)
                if following is None:
                    if self._ended:
                        self._damage(at, self.size, f"what begins here {error}")
                        self.holes.append(at)
                    return at
                self._damage(at, following, f"what begins here {error}")
                self.holes.append(at)
                loose, at = None, following
                continue
            at = end
        return at

    def _following(self, at: int) -> int | None:
        # Where records go on behind a damage: a chunk or an attachment, else the end of the data.
        found = records.next_record(self._map, at + 1, self.size)
        if found is None and self._ended:
            summary = int.from_bytes(self._map[-MAGIC_BYTES - 20 : -MAGIC_BYTES - 12], "little")
            place = summary - HEAD.size - 4
            if at < place < self.size and self._map[place] == Opcode.DATA_END:
                return place
        return found

    def _found(self, opcode: int, at: int, end: int, loose: Piece | None) -> Piece | None:
        # A record outside chunks; returned is the piece that further loose messages belong to.
        if opcode == Opcode.MESSAGE:
            if loose is None or end - loose.offset > MOST_LOOSE_BYTES:
                loose = Piece(at, end, at)
                self._add(loose)
            loose.end, loose.size = end, end - loose.offset
            return loose
        if opcode == Opcode.CHUNK:
            self._add(records.chunk(self._map, at, end))
        elif opcode == Opcode.MESSAGE_INDEX and self.pieces:
            piece = self.pieces[-1]
            first = piece.indexes[0] or at
            if (piece.indexes[1] or piece.end) == at:  # one behind the other
                piece.indexes = first, end
        elif opcode == Opcode.ATTACHMENT:
            self._attach(at, end)
        elif opcode == Opcode.METADATA:
            found = fields(Metadata, self._map, at, end)
            if found.name == MARK:
                self._end_mark = found.metadata.get(END_KEY, "").strip()
        elif opcode == Opcode.HEADER:
            self.library = fields(Header, self._map, at, end).library
        elif self._learn(opcode, self._map, at, end):
            return loose
        return None

    def _add(self, piece: Piece) -> None:
        self._limit(len(self.pieces) + 1, MOST_PIECES, "pieces")
        self.pieces.append(piece)

    def _limit(self, count: int, most: int, what: str) -> None:
        if count > most:
            raise UserError(f"{self.path.name}: more than {most} {what}.", "Split the recording.")

    def _attach(self, at: int, end: int) -> None:
        name, start, stop = records.attachment(self._map, at, end)
        crc = int.from_bytes(self._map[stop:end], "little")
        if crc and zlib.crc32(memoryview(self._map)[at + HEAD.size : stop]) != crc:
            self._damage(at, end, f"the attached {name} has a wrong checksum")
        elif stop - start > MOST_ATTACHED_BYTES:
            self._damage(at, end, f"the attached {name} is too large to be read")
        else:
            self.attachments.setdefault(name, self._map[start:stop])

    def _learn(self, opcode: int, data: bytes | mmap.mmap, at: int, end: int) -> bool:
        # Whether the record describes a channel, or the schema of one.
        if opcode == Opcode.SCHEMA:
            schema = fields(Schema, data, at, end)
            schema.name = shown(schema.name)
            self.schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            channel = fields(Channel, data, at, end)
            channel.topic = shown(channel.topic).lstrip("/")
            channel.message_encoding = shown(channel.message_encoding)
            self.channels.setdefault(channel.id, channel)
        else:
            return False
        self._limit(max(len(self.channels), len(self.schemas)), MOST_CHANNELS, "channels")
        return True

    # -- what is in a piece ----------------------------------------------------------------------

    def _examine(self, piece: Piece) -> None:
        try:
            if piece.problem:
                raise PieceError(piece.problem)
            content = self._unpacked(piece)
            if piece.crc and zlib.crc32(content) != piece.crc:
                raise PieceError("has a wrong checksum")
            heads, offsets = self._heads(piece, content)
        except PieceError as error:
            piece.problem = str(error)
            self._damage(piece.offset, piece.end, f"the piece {error}", piece)
            self.holes.append(piece.offset)
            return
        self._keep(piece, content, heads, offsets)
        order = np.argsort(heads["channel"], kind="stable")
        channel = heads["channel"][order]
        first = np.flatnonzero(np.diff(channel, prepend=-1))
        last = np.append(first[1:], len(channel)) - 1
        piece.spans = np.zeros(len(first), _SPAN)
        if len(first):
            piece.spans["channel"], piece.spans["count"] = channel[first], last - first + 1
            for name in ("log_ns", "board_ns"):
                piece.spans[name][:, 0] = heads[name][order][first]
                piece.spans[name][:, 1] = heads[name][order][last]

    def _unpacked(self, piece: Piece) -> bytes:
        with memoryview(self._map) as data, data[piece.data : piece.end] as part:
            return records.unpack(piece.compression, part, piece.size)

    def _keep(self, piece: Piece, content: bytes, heads: Array, offsets: Array) -> None:
        self._kept[piece.offset] = content, heads, offsets
        self._kept_bytes += len(content)
        while self._kept_bytes > KEPT_BYTES and len(self._kept) > 1:
            _, (gone, *_) = self._kept.popitem(last=False)
            self._kept_bytes -= len(gone)

    def _content(self, piece: Piece) -> tuple[bytes, Array, Array]:
        # Records, heads of the messages and their places; of a damaged piece what can be found.
        kept = self._kept.get(piece.offset)
        if kept is None:
            content = self._unpacked(piece)
            kept = content, *self._heads(piece, content)
            self._keep(piece, *kept)
        return kept

    def _heads(self, piece: Piece, content: bytes) -> tuple[Array, Array]:
        listed = self._listed(piece, content)
        if listed is not None:
            return listed
        found = []
        for opcode, at, end in records.records(content):
            self._walked += 1
            if self._walked > MOST_WALKED + self.size // 8:
                raise PieceError("is one too many: the file has too many records without an index")
            if opcode == Opcode.MESSAGE:
                if end - at < MESSAGE.itemsize:
                    raise PieceError("has a message that is too short")
                found.append(at)
            else:
                self._learn(opcode, content, at, end)
        offsets = np.array(found, np.int64)
        return _gather(content, offsets), offsets

    def _listed(self, piece: Piece, content: bytes) -> tuple[Array, Array] | None:
        # By the indexes behind the piece; None where they are not exactly its messages.
        tables = [np.frombuffer(self._map[at:end], "<i8") for _, at, end in self._indexes(piece)]
        if not tables:
            return None
        offsets = np.sort(np.concatenate(tables)[1::2])
        if not len(offsets) or offsets[0] < 0 or offsets[-1] + MESSAGE.itemsize > len(content):
            return None
        heads = _gather(content, offsets)
        ends = offsets + HEAD.size + heads["length"].astype(np.int64)
        starts = np.append(offsets[1:], len(content))
        short = heads["length"] < MESSAGE.itemsize - HEAD.size
        if (heads["op"] != Opcode.MESSAGE).any() or short.any() or (ends > starts).any():
            return None
        holes = np.flatnonzero(ends != starts)
        between = [(0, int(offsets[0])), *((int(ends[i]), int(starts[i])) for i in holes.tolist())]
        beside = []
        for first, last in between:
            part = content[first:last]
            try:
                beside += [(o, a + first, e + first) for o, a, e in records.records(part)]
            except PieceError:
                return None
        if any(opcode == Opcode.MESSAGE for opcode, _, _ in beside):
            return None
        for opcode, first, last in beside:
            self._learn(opcode, content, first, last)
        return heads, offsets

    def _indexes(self, piece: Piece) -> list[tuple[int, int, int]]:
        # Of each message index: channel, and where its table is.
        found: list[tuple[int, int, int]] = []
        at, last = piece.indexes
        while at < last and len(found) <= MOST_CHANNELS:
            _, length = HEAD.unpack_from(self._map, at)
            end = at + HEAD.size + length
            if (length - 6) % 16 == 0:
                channel = int.from_bytes(self._map[at + 9 : at + 11], "little")
                found.append((channel, at + HEAD.size + 6, end))
            at = end
        return found if len(found) <= MOST_CHANNELS else []


def _mapped(path: Path) -> tuple[mmap.mmap, int, bool]:
    # The file, its size, and whether the first bytes are not quite those of MCAP.
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise UserError(f"{path} is not a file.", "Give a recording (.mcap).")
        with path.open("rb") as handle:
            start = handle.read(MAGIC_BYTES)
            found = mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ) if start else None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"{path} cannot be opened: {reason}.", "Check the path.") from None
    if found is not None and start == MCAP0_MAGIC:
        return found, len(found), False
    what = "is empty" if found is None else "is not an MCAP file"
    if found is not None:
        near = sum(a != b for a, b in zip(start, MCAP0_MAGIC, strict=False)) <= 2
        if len(found) > MAGIC_BYTES + HEAD.size and near and found[MAGIC_BYTES] == Opcode.HEADER:
            return found, len(found), True
        if MCAP0_MAGIC.startswith(start):
            what = "was cut off before anything was written"
        found.close()
    raise UserError(f"{path} {what}.", "Give a recording.")


def _gather(content: bytes, offsets: Array) -> Array:
    # Heads of the messages at these places.
    if not len(offsets):
        return np.empty(0, MESSAGE)
    raw = sliding_window_view(np.frombuffer(content, np.uint8), MESSAGE.itemsize)[offsets]
    return np.ascontiguousarray(raw).view(MESSAGE).ravel()
