"""Read an MCAP file: completeness and messages.

The index at a file's end is never trusted: it only lists what the file should contain.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, Statistics
from numpy.lib.stride_tricks import sliding_window_view

from esea_gen.errors import UserError
from esea_host.recording import records
from esea_host.recording.integrity import Damage, Integrity, RecordingState
from esea_host.recording.layout import Array, StreamLayout
from esea_host.recording.pieces import KEPT_BYTES, MAGIC_BYTES, MESSAGE, PieceFile
from esea_host.recording.records import HEAD, Piece, PieceError, fields
from esea_host.recording.writer import COLUMNS_KEY, DISK_FULL, LIBRARY


@dataclass(frozen=True)
class Rows:
    """Messages of a topic, of a piece."""

    log_ns: Array
    board_ns: Array
    data: bytes  # their contents, one after another
    lengths: Array  # of each

    def of(self, layout: StreamLayout) -> Array:
        """Rows of a stream; refused when the messages are not of its layout."""
        if (self.lengths != layout.record_dtype.itemsize).any():
            what = f"Messages of {layout.name} have another size than its columns."
            raise UserError(what, "Record with esea-host.")
        return layout.rows(self.data)


class LogFile(PieceFile):
    """A recording's file; ``judged`` lists its missing parts."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        try:
            self.judged = self._judge()
        except BaseException:
            self.close()
            raise
        self.holes.sort()

    # -- whether it is complete ------------------------------------------------------------------

    def _judge(self) -> Integrity:
        statistics = self._judge_summary() if self._ended else None
        for piece in self.pieces:  # the last resort for what a damaged one alone describes
            if statistics is None and piece.problem and not piece.compression:
                self._learn_from_damaged(piece)
        if self._ended and self._data_end is None and not self._damages:
            self._damage(self._readable, self.size, "the record that ends the data is missing")
        covered = self._judge_bytes()
        self._doubt_unchecked(covered)
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
        foot = self.size - MAGIC_BYTES - records.FOOTER_BYTES
        footer = fields(Footer, self._map, foot, self.size - MAGIC_BYTES)
        start, crc, behind = footer.summary_start, footer.summary_crc, None
        if self._data_end is not None:
            behind = records.record_end(self._map, self._data_end, self.size)[1]
        if start == 0 and crc == 0 and behind in (None, foot):
            return None
        with memoryview(self._map) as data:
            wrong = crc and zlib.crc32(data[start : foot + HEAD.size + 16]) != crc
        if not MAGIC_BYTES <= start <= foot or wrong or behind not in (None, start):
            self._damage(min(start, foot), self.size, "the index at the end was changed")
            return None
        counts: dict[int, int] | None = None
        at = start
        try:
            while at < foot:
                opcode, end = records.record_end(self._map, at, foot)
                self._learn(opcode, self._map, at, end)
                if opcode == Opcode.STATISTICS:
                    counts = fields(Statistics, self._map, at, end).channel_message_counts
                elif opcode == Opcode.CHUNK_INDEX:
                    index = fields(ChunkIndex, self._map, at, end)
                    times = index.message_start_time, index.message_end_time
                    self._indexed[index.chunk_start_offset] = times
                at = end
        except PieceError as error:
            self._damage(at, self.size, f"the index at the end {error}")
            return None
        unknown = self._indexed.keys() - {p.offset for p in self.pieces}
        if unknown and not self._damages:
            self._damage(min(unknown), self.size, "a piece that the index names is missing")
        return counts

    def _learn_from_damaged(self, piece: Piece) -> None:
        try:
            content = self._unpacked(piece)
            for opcode, at, end in records.records(content[: 1 << 20]):
                if opcode == Opcode.MESSAGE:
                    return
                self._learn(opcode, content, at, end)
        except PieceError:
            return

    @property
    def _checksum(self) -> int:
        # Over all data; 0: the file has none.
        at = self._data_end
        return 0 if at is None else int.from_bytes(self._map[at + 9 : at + 13], "little")

    def _judge_bytes(self) -> bool:
        # The checksum over all data, where there is one: whether it covers everything.
        if self._data_end is None:
            return False
        crc = self._checksum
        if not crc:
            return False
        found = 0
        with memoryview(self._map) as data:
            for at in range(0, self._data_end, KEPT_BYTES):
                found = zlib.crc32(data[at : min(at + KEPT_BYTES, self._data_end)], found)
        if found != crc and not self._damages:
            self._damage(0, self._data_end, "bytes beside the messages were changed")
        return found == crc

    def _doubt_unchecked(self, covered: bool) -> None:
        # Ours have checksums; of others, one over all bytes may say that some were changed.
        for piece in self.pieces:
            if not (piece.crc or piece.problem) and (
                self.library == LIBRARY or (not covered and self._checksum)
            ):
                piece.problem, piece.spans = "has no checksum that is right", None
                self._damage(piece.offset, piece.end, f"the piece {piece.problem}")
                self.holes.append(piece.offset)

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
        return str(known.topic) if known else f"channel {channel}"

    def _placed(self, damage: Damage) -> Damage:
        # With names of its topics, and its times where they can be those of this recording.
        lost = {self._topic(int(channel)): count for channel, count in damage.lost.items()}
        spans = [p.spans["log_ns"] for p in self.pieces if p.spans is not None and len(p.spans)]
        own = (p.times_ns for p in self.pieces if p.offset == damage.offset)
        times = self._indexed.get(damage.offset) or next(own, None)
        if times is None or not spans:
            return Damage(damage.offset, damage.end, damage.what, lost=lost)
        first, last = min(int(s.min()) for s in spans), max(int(s.max()) for s in spans)
        room = 10**9 + last - first
        if not first - room <= times[0] <= times[1] <= last + room:
            return Damage(damage.offset, damage.end, damage.what, lost=lost)
        start_s, end_s = ((ns - first) * 1e-9 for ns in times)
        return Damage(damage.offset, damage.end, damage.what, start_s, end_s, lost)

    # -- reading ---------------------------------------------------------------------------------

    @cached_property
    def topics(self) -> dict[str, list[int]]:
        """Streams and events, each with the numbers of its channels."""
        found: dict[str, list[int]] = {}
        for number, channel in self.channels.items():
            found.setdefault(channel.topic, []).append(number)
        return found

    @cached_property
    def layouts(self) -> dict[str, StreamLayout]:
        """Layout of each stream; events and foreign topics have no layout."""
        found = {}
        for topic, numbers in self.topics.items():
            text = self.channels[numbers[0]].metadata.get(COLUMNS_KEY)
            try:
                if text is not None:
                    found[topic] = StreamLayout.from_json(topic, text)
            except UserError:
                continue
        return found

    def kind(self, topic: str) -> str:
        """How a topic's messages are written, in words; empty for an unknown topic."""
        if topic not in self.topics:
            return ""
        found = self.channels[self.topics[topic][0]]
        schema = self.schemas.get(found.schema_id)
        encoding = str(found.message_encoding)
        return f"{encoding or 'unnamed'} ({schema.name})" if schema else encoding

    def rows_of(self, piece: Piece, topic: str) -> Rows | None:
        """Messages of a topic in a piece; None where it has none, or is damaged."""
        numbers = self.topics.get(topic, [])
        if piece.problem:
            return None
        if piece.spans is not None and not np.isin(piece.spans["channel"], numbers).any():
            return None
        try:
            content, heads, offsets = self._content(piece)
        except PieceError:
            return None
        mine = np.isin(heads["channel"], numbers)
        if not mine.any():
            return None
        heads, starts = heads[mine], offsets[mine] + MESSAGE.itemsize
        lengths = heads["length"].astype(np.int64) - (MESSAGE.itemsize - HEAD.size)
        if (lengths == lengths[0]).all() and lengths[0] > 0:
            data = sliding_window_view(np.frombuffer(content, np.uint8), lengths[0])[starts]
            joined = data.tobytes()
        else:
            pairs = zip(starts.tolist(), lengths.tolist(), strict=True)
            joined = b"".join(content[s : s + n] for s, n in pairs)
        return Rows(heads["log_ns"], heads["board_ns"], joined, lengths)

    def contents(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Time and content of each message of a topic, damaged pieces left out."""
        for piece in self.pieces:
            found, place = self.rows_of(piece, topic), 0
            if found is not None:
                for ns, length in zip(found.log_ns.tolist(), found.lengths.tolist(), strict=True):
                    yield ns, found.data[place : place + length]
                    place += length
