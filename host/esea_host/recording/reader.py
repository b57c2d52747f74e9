"""Whether an MCAP file is all that was written, and the messages in it.

The index at a file's end is never trusted: it only says what should be there.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.lib.stride_tricks import sliding_window_view

from esea_gen.errors import UserError
from esea_host.recording import records
from esea_host.recording.integrity import Damage, Integrity, RecordingState
from esea_host.recording.layout import Array, StreamLayout
from esea_host.recording.pieces import KEPT_BYTES, MAGIC_BYTES, MESSAGE, Piece, PieceFile
from esea_host.recording.records import HEAD, Fields, PieceError
from esea_host.recording.writer import COLUMNS_KEY, DISK_FULL, LIBRARY

MOST_EVENTS = 500_000


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
    """A recording's file; ``integrity`` says what is missing of it."""

    def _finish(self) -> None:
        self.integrity = self._judge()
        super()._finish()

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
        place = Fields(self._map, foot + HEAD.size, self.size - MAGIC_BYTES)
        start, _, crc = place.number(8), place.number(8), place.number(4)
        behind = None if self._data_end is None else records.record_end(
            self._map, self._data_end, self.size
        )[1]  # fmt: skip
        if start == 0 and crc == 0 and behind in (None, foot):
            return None
        with memoryview(self._map) as data:
            wrong = crc and zlib.crc32(data[start : foot + HEAD.size + 16]) != crc
        if not MAGIC_BYTES <= start <= foot or wrong or behind not in (None, start):
            self._damage(min(start, foot), self.size, "the index at the end was changed")
            return None
        counts, at = None, start
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
                    times = fields.number(8), fields.number(8)
                    self._indexed[fields.number(8)] = times
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
                self._beside(opcode, content, at, end)
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
        return known.topic.lstrip("/") if known else f"channel {channel}"

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

    def topics(self) -> dict[str, list[int]]:
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
        numbers = self.topics()[topic]
        if piece.problem and (not damaged or piece.compression):
            raise PieceError(f"{self.path.name}: the piece at byte {piece.offset} {piece.problem}")
        if piece.spans is not None and not np.isin(piece.spans["channel"], numbers).any():
            return None
        content, heads, offsets = self._content(piece)
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
