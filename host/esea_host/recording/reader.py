"""What is in an MCAP file that may be cut off, damaged or hostile: every piece is checked once.

The index at a file's end is never trusted: it only says what should be there.
"""

from __future__ import annotations

import json
import mmap
import stat
import zlib
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from numpy.lib.stride_tricks import sliding_window_view

from esea_gen.errors import UserError
from esea_host.recording import records
from esea_host.recording.integrity import Damage, Integrity, RecordingState
from esea_host.recording.layout import Array, StreamLayout
from esea_host.recording.records import HEAD, Channel, Fields, PieceError, Schema
from esea_host.recording.writer import COLUMNS_KEY, DISK_FULL, END_KEY, MARK

_MESSAGE = np.dtype(
    [("op", "u1"), ("length", "<u8"), ("channel", "<u2"), ("number", "<u4")]
    + [("log_ns", "<i8"), ("board_ns", "<i8")]
)
# Of a piece, one row a channel; times of its first and last messages.
_SPAN = np.dtype(
    [("channel", "u2"), ("count", "i8"), ("log_ns", "i8", 2), ("board_ns", "i8", 2)]
)  # fmt: skip
_MAGIC_BYTES = len(MCAP0_MAGIC)
MOST_PIECES, MOST_CHANNELS, MOST_WALKED = 1_000_000, 4096, 20_000_000
MOST_LOOSE_BYTES = 1 << 22  # of messages outside chunks that are one piece
MOST_ATTACHED_BYTES = 1 << 24
MOST_EVENTS = 500_000
KEPT_BYTES = 1 << 25  # of unpacked pieces


@dataclass(slots=True, eq=False)
class Piece:
    """A chunk, or messages that stand outside one.

    offset, end: of the whole in the file; data: where its records begin.
    size, crc, compression: of its records; crc 0: without one.
    indexes: bytes of the file with its message indexes.
    problem: why it cannot be used; empty where it can.
    spans: of its messages, one row a channel.
    """

    offset: int
    end: int
    data: int
    size: int = 0
    crc: int = 0
    compression: str = ""
    times_ns: tuple[int, int] | None = None
    indexes: tuple[int, int] = (0, 0)
    problem: str = ""
    spans: Array | None = None


@dataclass(frozen=True)
class Rows:
    """Messages of a topic, of a piece.

    data: their contents, one after another.
    lengths: of each.
    """

    log_ns: Array
    board_ns: Array
    data: bytes
    lengths: Array


class LogFile:
    """An MCAP file, mapped into memory; ``integrity`` says what is missing of it."""

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
        try:
            if changed:
                self._damage(0, _MAGIC_BYTES, "the file's first bytes were changed")
            self._readable = self._scan()
            self._limit_unpacking()
            for piece in self.pieces:
                self._examine(piece)
            self.integrity = self._judge()
            self.holes.sort()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let go of the file."""
        self._kept.clear()
        self._map.close()

    def _damage(self, start: int, end: int, what: str, piece: Piece | None = None) -> None:
        self._damages.append(Damage(start, end, what, lost=self._promised(piece) if piece else {}))

    # -- where the records are -------------------------------------------------------------------

    @property
    def _ended(self) -> bool:
        foot = self.size - _MAGIC_BYTES - records.FOOTER_BYTES
        return (
            foot >= _MAGIC_BYTES
            and self._map[-_MAGIC_BYTES:] == MCAP0_MAGIC
            and HEAD.unpack_from(self._map, foot) == (Opcode.FOOTER, 20)
        )

    def _scan(self) -> int:
        at, last, loose = _MAGIC_BYTES, self.size, None
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
            summary = int.from_bytes(self._map[-_MAGIC_BYTES - 20 : -_MAGIC_BYTES - 12], "little")
            place = summary - HEAD.size - 4
            if at < place < self.size and self._map[place] == Opcode.DATA_END:
                return place
        return found

    def _found(self, opcode: int, at: int, end: int, loose: Piece | None) -> Piece | None:
        # A record outside chunks; returned is the piece that further loose messages belong to.
        fields = Fields(self._map, at + HEAD.size, end)
        if opcode == Opcode.MESSAGE:
            if loose is None or end - loose.offset > MOST_LOOSE_BYTES:
                loose = Piece(at, end, at)
                self._add(loose)
            loose.end, loose.size = end, end - loose.offset
            return loose
        if opcode == Opcode.CHUNK:
            head = records.chunk(self._map, at, end)
            times = head.start_ns, head.end_ns
            self._add(Piece(at, end, head.data, head.size, head.crc, head.compression, times))
        elif opcode == Opcode.MESSAGE_INDEX and self.pieces:
            piece = self.pieces[-1]
            first = piece.indexes[0] or at
            if (piece.indexes[1] or piece.end) == at:  # one behind the other
                piece.indexes = first, end
        elif opcode == Opcode.ATTACHMENT:
            self._attach(records.attachment(self._map, at, end), at, end)
        elif opcode == Opcode.METADATA:
            if fields.text() == MARK:
                self._end_mark = fields.pairs().get(END_KEY, "").strip()
        elif opcode == Opcode.HEADER:
            fields.text()
            self.library = fields.text()
        elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
            self._learn(opcode, fields)
            return loose
        return None

    def _add(self, piece: Piece) -> None:
        if len(self.pieces) == MOST_PIECES:
            raise UserError(
                f"{self.path.name}: has more than {MOST_PIECES} pieces.", "Split the recording."
            )
        self.pieces.append(piece)

    def _attach(self, found: records.AttachmentPlace, at: int, end: int) -> None:
        crc = int.from_bytes(self._map[end - 4 : end], "little")
        if crc and zlib.crc32(memoryview(self._map)[found.body : end - 4]) != crc:
            self._damage(at, end, f"the attached {found.name} has a wrong checksum")
        elif found.end - found.start > MOST_ATTACHED_BYTES:
            self._damage(at, end, f"the attached {found.name} is too large to be read")
        else:
            self.attachments.setdefault(found.name, self._map[found.start : found.end])

    def _learn(self, opcode: int, fields: Fields) -> None:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(fields)
            self.schemas.setdefault(schema.number, schema)
        else:
            channel = Channel.read(fields)
            self.channels.setdefault(channel.number, channel)
        if max(len(self.channels), len(self.schemas)) > MOST_CHANNELS:
            raise UserError(
                f"{self.path.name}: has more than {MOST_CHANNELS} channels.", "Split the recording."
            )

    # -- what is in a piece ----------------------------------------------------------------------

    def _limit_unpacking(self) -> None:
        left = records.FREE_BYTES + records.MOST_RATIO * self.size
        for piece in self.pieces:
            if piece.compression:
                left -= piece.size
                if left < 0:
                    piece.problem = f"would unpack the file to over {records.MOST_RATIO} times"

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
            if self._walked > MOST_WALKED:
                raise PieceError("is one too many: the file has too many records without an index")
            if opcode == Opcode.MESSAGE:
                if end - at < _MESSAGE.itemsize:
                    raise PieceError("has a message that is too short")
                found.append(at)
            else:
                self._beside(opcode, content, at, end)
        offsets = np.array(found, np.int64)
        return _gather(content, offsets), offsets

    def _beside(self, opcode: int, content: bytes, at: int, end: int) -> None:
        if opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
            self._learn(opcode, Fields(content, at + HEAD.size, end))

    def _listed(self, piece: Piece, content: bytes) -> tuple[Array, Array] | None:
        # By the indexes behind the piece; None where they are not exactly its messages.
        tables = [np.frombuffer(self._map[at:end], "<i8") for _, at, end in self._indexes(piece)]
        if not tables:
            return None
        offsets = np.sort(np.concatenate(tables)[1::2])
        if not len(offsets) or offsets[0] < 0 or offsets[-1] + _MESSAGE.itemsize > len(content):
            return None
        heads = _gather(content, offsets)
        ends = offsets + HEAD.size + heads["length"].astype(np.int64)
        starts = np.append(offsets[1:], len(content))
        short = heads["length"] < _MESSAGE.itemsize - HEAD.size
        if (heads["op"] != Opcode.MESSAGE).any() or short.any() or (ends > starts).any():
            return None
        holes = np.flatnonzero(ends != starts)
        between = [(0, int(offsets[0])), *((int(ends[i]), int(starts[i])) for i in holes.tolist())]
        beside = []
        for first, last in between:
            try:
                part = [(o, a + first, e + first) for o, a, e in records.records(content[first:last])]
            except PieceError:
                return None
            beside += part
        if any(opcode == Opcode.MESSAGE for opcode, _, _ in beside):
            return None
        for record in beside:
            self._beside(record[0], content, *record[1:])
        return heads, offsets

    def _indexes(self, piece: Piece) -> list[tuple[int, int, int]]:
        # Of each message index: channel, and where its table is.
        found = []
        at, last = piece.indexes
        while at < last and len(found) <= MOST_CHANNELS:
            opcode, length = HEAD.unpack_from(self._map, at)
            end = at + HEAD.size + length
            if (length - 6) % 16 == 0:
                channel = int.from_bytes(self._map[at + 9 : at + 11], "little")
                found.append((channel, at + HEAD.size + 6, end))
            at = end
        return found if len(found) <= MOST_CHANNELS else []

    def _promised(self, piece: Piece) -> dict[str, int]:
        found: dict[str, int] = {}
        for channel, start, end in self._indexes(piece):
            found[str(channel)] = found.get(str(channel), 0) + (end - start) // 16
        return found

    # -- whether it is complete ------------------------------------------------------------------

    def _judge(self) -> Integrity:
        statistics = self._judge_summary() if self._ended else None
        for piece in self.pieces:  # the last resort for what a damaged one alone describes
            if piece.problem and not piece.compression:
                self._learn_from_damaged(piece)
        if self._ended and self._data_end is None and not self._damages:
            self._damage(self._readable, self.size, "the record that ends the data is missing")
        covered = self._judge_bytes()
        lost = self._missing(statistics)
        if any(n < 0 for n in lost.values()) or (lost and not self._damages):
            self._damage(0, self.size, "there are other messages than its index counts")
        states = [
            state
            for state, applies in (
                (RecordingState.DAMAGED, bool(self._damages)),
                (RecordingState.DISK_FULL, not self._ended and self._end_mark == DISK_FULL),
                (RecordingState.TRUNCATED, not self._ended and self._end_mark != DISK_FULL),
            )
            if applies
        ]
        checked = covered or all(p.crc for p in self.pieces)
        damages = tuple(self._placed(d) for d in sorted(self._damages, key=lambda d: d.offset))
        if statistics is None:
            for damage in damages:
                for topic, count in damage.lost.items():
                    lost[topic] = lost.get(topic, 0) + count
        return Integrity(
            tuple(states) or (RecordingState.COMPLETE,),
            damages,
            self._readable if not self._ended else self.size,
            self.size,
            checked,
            {topic: n for topic, n in lost.items() if n > 0},
        )

    def _judge_summary(self) -> dict[int, int] | None:
        # Learns what the index at the end repeats; returns how many messages a channel should have.
        foot = self.size - _MAGIC_BYTES - records.FOOTER_BYTES
        place = Fields(self._map, foot + HEAD.size, self.size - _MAGIC_BYTES)
        start, _, crc = place.number(8), place.number(8), place.number(4)
        behind = None if self._data_end is None else records.record_end(
            self._map, self._data_end, self.size
        )[1]  # fmt: skip
        if start == 0 and crc == 0 and behind in (None, foot):
            return None
        with memoryview(self._map) as data:
            wrong = crc and zlib.crc32(data[start : foot + HEAD.size + 16]) != crc
        if not _MAGIC_BYTES <= start <= foot or wrong or behind not in (None, start):
            self._damage(min(start, foot), self.size, "the index at the end was changed")
            return None
        counts, at, chunks = None, start, set()
        try:
            while at < foot:
                opcode, end = records.record_end(self._map, at, foot)
                fields = Fields(self._map, at + HEAD.size, end)
                self._beside(opcode, self._map[at:end] if opcode in (3, 4) else b"", 0, end - at)
                if opcode == Opcode.STATISTICS:
                    fields.skip(42)
                    size = fields.number(4)
                    pairs = Fields(self._map, fields.at, min(fields.at + size, end))
                    counts = {}
                    while pairs.at < pairs.end:
                        channel = pairs.number(2)
                        counts[channel] = pairs.number(8)
                elif opcode == Opcode.CHUNK_INDEX:
                    fields.skip(16)
                    chunks.add(fields.number(8))
                at = end
        except PieceError as error:
            self._damage(at, self.size, f"the index at the end {error}")
            return None
        unknown = chunks.difference(p.offset for p in self.pieces)
        if unknown and not self._damages:
            self._damage(min(unknown), self.size, "a piece that the index names is missing")
        return counts

    def _learn_from_damaged(self, piece: Piece) -> None:
        content = self._unpacked(piece)
        try:
            for opcode, at, end in records.records(content[: 1 << 20]):
                if opcode == Opcode.MESSAGE:
                    return
                self._beside(opcode, content, at, end)
        except PieceError:
            return

    def _judge_bytes(self) -> bool:
        # The checksum over all data, where there is one: whether it covers everything.
        if self._data_end is None:
            return False
        crc = int.from_bytes(self._map[self._data_end + 9 : self._data_end + 13], "little")
        if not crc:
            return False
        found = 0
        with memoryview(self._map) as data:
            for at in range(0, self._data_end, KEPT_BYTES):
                found = zlib.crc32(data[at : min(at + KEPT_BYTES, self._data_end)], found)
        if found != crc and not self._damages:
            self._damage(0, self._data_end, "bytes beside the messages were changed")
        return found == crc

    def _missing(self, counts: dict[int, int] | None) -> dict[str, int]:
        if counts is None:
            return {}
        found = dict.fromkeys(counts, 0)
        for piece in self.pieces:
            if piece.spans is not None:
                for channel, count in piece.spans[["channel", "count"]].tolist():
                    found[channel] = found.get(channel, 0) + count
        left = {self._topic(c): counts.get(c, 0) - n for c, n in found.items()}
        return {topic: n for topic, n in left.items() if n}

    def _topic(self, channel: int) -> str:
        known = self.channels.get(channel)
        return known.topic.lstrip("/") if known else f"channel {channel}"

    def _placed(self, damage: Damage) -> Damage:
        # With names of its topics, and its times where they can be those of this recording.
        lost = {self._topic(int(channel)): count for channel, count in damage.lost.items()}
        spans = [p.spans["log_ns"] for p in self.pieces if p.spans is not None and len(p.spans)]
        times = next((p.times_ns for p in self.pieces if p.offset == damage.offset), None)
        if times is None or not spans:
            return Damage(damage.offset, damage.end, damage.what, lost=lost)
        first, last = min(int(s.min()) for s in spans), max(int(s.max()) for s in spans)
        room = 10**9 + last - first
        if not first - room <= times[0] <= times[1] <= last + room:
            return Damage(damage.offset, damage.end, damage.what, lost=lost)
        seconds = [(ns - first) * 1e-9 for ns in times]
        return Damage(damage.offset, damage.end, damage.what, *seconds, lost)

    # -- reading ---------------------------------------------------------------------------------

    def topics(self) -> dict[str, list[int]]:
        """Channels of every topic, without the slash before it."""
        found: dict[str, list[int]] = {}
        for number in self.channels:
            found.setdefault(self._topic(number), []).append(number)
        return found

    def layout(self, topic: str) -> StreamLayout | None:
        """A stream's layout; None for events, and for what is not ours."""
        return self._layouts.get(topic)

    def kind(self, topic: str) -> str:
        """How a topic's messages are written, in words; empty for an unknown topic."""
        found = self.channels.get(self.topics().get(topic, [-1])[0])
        if found is None:
            return ""
        schema = self.schemas.get(found.schema)
        return f"{found.encoding or 'unnamed'} ({schema.name})" if schema else found.encoding

    @cached_property
    def _layouts(self) -> dict[str, StreamLayout]:
        found = {}
        for topic, numbers in self.topics().items():
            text = self.channels[numbers[0]].metadata.get(COLUMNS_KEY)
            try:
                if text is not None:
                    found[topic] = StreamLayout.from_json(topic, text)
            except UserError:
                continue
        return found

    def read(self, piece: Piece, topic: str, damaged: bool = False) -> Rows | None:
        """Messages of a topic in a piece.

        damaged: of a damaged piece too, as far as its records can be told apart.
        """
        numbers = self.topics()[topic]
        if piece.problem and (not damaged or piece.compression):
            raise PieceError(f"{self.path.name}: the piece at byte {piece.offset} {piece.problem}")
        if piece.spans is not None and not np.isin(piece.spans["channel"], numbers).any():
            return None
        content, heads, offsets = self._content(piece)
        mine = np.isin(heads["channel"], numbers)
        if not mine.any():
            return None
        heads, starts = heads[mine], offsets[mine] + _MESSAGE.itemsize
        lengths = heads["length"].astype(np.int64) - (_MESSAGE.itemsize - HEAD.size)
        if (lengths == lengths[0]).all() and lengths[0] > 0:
            data = sliding_window_view(np.frombuffer(content, np.uint8), lengths[0])[starts]
            joined = data.tobytes()
        else:
            pairs = zip(starts.tolist(), lengths.tolist(), strict=True)
            joined = b"".join(content[s : s + n] for s, n in pairs)
        return Rows(heads["log_ns"], heads["board_ns"], joined, lengths)

    def rows(self, piece: Piece, topic: str) -> Iterator[tuple[int, bytes]]:
        """Time and content of each message of a topic in a piece."""
        found = None if piece.problem or topic not in self.topics() else self.read(piece, topic)
        place = 0
        if found is not None:
            for ns, length in zip(found.log_ns.tolist(), found.lengths.tolist(), strict=True):
                yield ns, found.data[place : place + length]
                place += length

    def events(self, topic: str) -> Iterator[tuple[int, dict[str, Any]]]:
        """Time and content of a topic's JSON messages, damaged pieces left out."""
        count = 0
        for piece in self.pieces:
            for ns, data in self.rows(piece, topic):
                count += 1
                if count > MOST_EVENTS:
                    what = f"{self.path.name}: more than {MOST_EVENTS} events of {topic}."
                    raise UserError(what, "Split the recording.")
                yield ns, json_object(data, f"{self.path.name}: event {count} of {topic}")


def json_object(data: bytes, what: str) -> dict[str, Any]:
    """A JSON object that somebody wrote."""
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise UserError(f"{what} is not a JSON object.", "Give a recording of esea-host.")
    return found


def _mapped(path: Path) -> tuple[mmap.mmap, int, bool]:
    # The file, its size, and whether the first bytes are not quite those of MCAP.
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise UserError(f"{path} is not a file.", "Give a recording (.mcap).")
        with path.open("rb") as handle:
            start = handle.read(_MAGIC_BYTES)
            found = mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ) if start else None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"{path} cannot be opened: {reason}.", "Check the path.") from None
    if found is not None and start == MCAP0_MAGIC:
        return found, len(found), False
    what = "is empty" if found is None else "is no MCAP file"
    if found is not None:
        near = sum(a != b for a, b in zip(start, MCAP0_MAGIC, strict=False)) <= 2
        if len(found) > _MAGIC_BYTES + HEAD.size and near and found[_MAGIC_BYTES] == Opcode.HEADER:
            return found, len(found), True
        if MCAP0_MAGIC.startswith(start):
            what = "was cut off before anything was written"
        found.close()
    raise UserError(f"{path} {what}.", "Give a recording.")


def _gather(content: bytes, offsets: Array) -> Array:
    # Heads of the messages at these places.
    if not len(offsets):
        return np.empty(0, _MESSAGE)
    raw = sliding_window_view(np.frombuffer(content, np.uint8), _MESSAGE.itemsize)[offsets]
    return np.ascontiguousarray(raw).view(_MESSAGE).ravel()
