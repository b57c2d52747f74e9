"""Decode telemetry from bytes, in arrays rather than message by message.

Frames of runs, thousands a second, are copied into arrays; other frames go to the session.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from pymavlink.generator import mavcrc

from esea_gen.link.frames import (
    CHECKSUM_BYTES,
    HEAD,
    HEADER_BYTES,
    NUMBER,
    SENDER,
    SEQUENCE,
    SIGNATURE_BYTES,
    SIGNED,
    START,
    FrameScanner,
    LinkHealth,
)
from esea_host.recording.layout import Array, StreamLayout, fits, layout_of

# By a payload's length: what the checksum covers but the message's own byte, and the checksum.
BEFORE_BYTES = HEADER_BYTES - 1
_WHOLE = [struct.Struct(f"<{BEFORE_BYTES + n}sH").unpack_from for n in range(256)]
_ONE = 0x010000  # one more in the sequence
TICK = "sequence"
# In C, where pymavlink found it.
checksum: Callable[[bytes], int] = getattr(mavcrc, "mcrf4xx", lambda data: mavcrc.x25crc(data).crc)


class Decoded(NamedTuple):
    """Rows of a stream, as they came."""

    layout: StreamLayout
    rows: Array
    changes: list[tuple[int, int, int]]
    late_rows: list[int]  # those that came again, or after a later one

    def counted(self) -> tuple[Array, Array]:
        """Counted as lost, and as bad, when each row came; each of shape (n,)."""
        first, lost, bad = np.array(self.changes, np.int64).T
        counts = np.diff(first, append=len(self.rows))
        return np.repeat(lost, counts), np.repeat(bad, counts)


class _Kept:
    # Frames of a message since the last time they were asked for, from the header's second byte to
    # the whole payload's end, and what was counted when.

    def __init__(self, size: int) -> None:
        self.size = BEFORE_BYTES + size
        self.frames: list[bytes] = []
        self.changes = [(0, 0, 0)]
        self.late: list[int] = []

    def mark(self, health: LinkHealth) -> None:
        """Mark of the next frame."""
        now = len(self.frames), health.lost_frames, health.bad_frames
        before = self.changes if self.changes[-1][0] < now[0] else self.changes[:-1]
        self.changes = [*before, now]

    def take(self, body: bytes, late: bool) -> None:
        """Keep a frame; zeros at a payload's end are not sent."""
        if late:
            self.late.append(len(self.frames))
        self.frames.append(body.ljust(self.size, b"\0"))

    def decoded(self, layout: StreamLayout) -> Decoded:
        count, data = len(self.frames), b"".join(self.frames)
        rows = np.ndarray(count, layout.dtype, data, BEFORE_BYTES, (self.size,))
        return Decoded(layout, rows, *self.begin_anew())

    def begin_anew(self) -> tuple[list[tuple[int, int, int]], list[int]]:
        told = self.changes, self.late
        if len(self.changes) > 1:
            # What was counted behind the last frame is for the next.
            told = [c for c in self.changes if c[0] < len(self.frames)], self.late
            self.changes = [(0, *self.changes[-1][1:])]
        if self.late:
            self.late = []
        self.frames.clear()
        return told


class TelemetryDecoder(FrameScanner):
    def __init__(
        self,
        dialect: Any,
        units: Mapping[str, Mapping[str, str]] | None = None,
        texts: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        super().__init__(dialect)
        self.layouts: dict[int, StreamLayout] = {}
        self._kept: dict[int, _Kept] = {}  # of each message that tells of a run
        for number, message in dialect.mavlink_map.items():
            # All numbers, and the tick among them: a task's run.
            if TICK in message.fieldnames and fits(message):
                name = message.msgname
                said = dict((units or {}).get(name, {})), dict((texts or {}).get(name, {}))
                stream = name.removeprefix("ESEA_").lower()
                self.layouts[number] = layout_of(message, stream, *said)
                self._kept[number] = _Kept(message.unpacker.size)
        self._rows = [(self._kept[n], layout) for n, layout in self.layouts.items()]
        self._kept_back: _Kept | None = None
        # Who spoke last; of its runs, by the header's number without the sequence: extra byte, size
        # of the payload, size as it is kept, bytes round the payload, and who keeps it.
        self._sender = -1
        self._runs: dict[int, tuple[bytes, int, int, int, Callable[[bytes], None]]] = {}

    def feed(self, data: bytes) -> tuple[list[Decoded], bytes]:
        """Data that these bytes complete: rows, and all other frames one after another."""
        buffer, at, whole = self._buffer + data if self._buffer else data, 0, True
        others: list[bytes] = []
        while whole:
            if not self._counted:
                at = self._in_order(buffer, at)
            at, whole, frame = self._frame_at(buffer, at)
            if frame is None:
                continue
            kept = self._kept.get(frame.number)
            if kept is None:
                others.append(frame.whole)
            else:
                kept.take(frame.body, frame.late)
            self._listen_to(frame.sender)
        self._buffer = buffer[at:]
        return [k.decoded(layout) for k, layout in self._rows if k.frames], b"".join(others)

    def _in_order(self, buffer: bytes, at: int) -> int:
        # Nearly all that comes: runs of who spoke last, one behind the other.
        # Written for speed; whatever else comes is for _frame_at.
        if not self._runs:
            return at
        head, body_of, runs = HEAD.unpack_from, _WHOLE, self._runs
        expected, frames, there = self._next[self._sender] << 16, 0, len(buffer)
        with suppress(struct.error, KeyError):  # the bytes end, or another message
            while True:
                start, length, rest = head(buffer, at)
                extra, full, size, more, keep = runs[rest - expected]
                body, told = body_of[length](buffer, at + 1)
                end = at + length + more
                if start != START or length > full or end > there:
                    break
                if checksum(body + extra) != told:
                    break
                keep(body.ljust(size, b"\0"))
                expected = expected + _ONE & SEQUENCE
                frames += 1
                at = end
        self._next[self._sender] = expected >> 16
        self.health.frames += frames
        return at

    def _listen_to(self, sender: int) -> None:
        # Whose runs come next; -1: not known.
        if sender != self._sender:
            self._sender = sender
            self._runs = {}
            for number, kept in self._kept.items() if sender >= 0 else ():
                extra, size = self._sizes[number]
                for flags, signature in ((0, 0), (SIGNED, SIGNATURE_BYTES)):
                    key = number << NUMBER | sender << SENDER | flags
                    more = HEADER_BYTES + CHECKSUM_BYTES + signature
                    self._runs[key] = extra, size, kept.size, more, kept.frames.append

    def keep_back(self, number: int) -> None:
        """From now on a message's payloads are for :meth:`kept_back`, and not among the others."""
        self._kept_back = self._kept.setdefault(number, _Kept(self._sizes[number][1]))
        self._kept_back.mark(self.health)
        self._listen_to(-1)

    def kept_back(self) -> list[tuple[bytes, int, int]]:
        """Complete payloads since the last call, and the lost and bad counts by then."""
        kept = self._kept_back
        if kept is None or not kept.frames:
            return []
        payloads = [frame[BEFORE_BYTES:] for frame in kept.frames]
        changes, _ = kept.begin_anew()
        ends = [row for row, _, _ in changes[1:]] + [len(payloads)]
        parts = zip(changes, ends, strict=True)
        return [(p, lost, bad) for (a, lost, bad), b in parts for p in payloads[a:b]]

    def forget(self) -> None:
        """Reset after the link was reopened: drop half a frame and expected sequence numbers."""
        self.health.noise_bytes += len(self._buffer)
        self._buffer = b""
        self._next.clear()
        self._listen_to(-1)
        self._counted = 0

    def _mark(self) -> None:
        for kept in self._kept.values():
            kept.mark(self.health)
