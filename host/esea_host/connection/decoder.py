"""Telemetry out of a stream of bytes: whole arrays, not a message at a time.

Frames of runs, the thousands a second, go by their bytes into arrays; every other frame is handed
on as it came, for the session.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pymavlink.generator import mavcrc

from esea_gen.link.frames import CHECKSUM_BYTES, HEADER_BYTES, SIGNATURE_BYTES, SIGNED, START
from esea_host.recording.layout import Array, StreamLayout, fits, layout_of

_FAST: Any = getattr(mavcrc, "mcrf4xx", None)  # in C, where pymavlink found it
# Start, length; flags, sequence, sender and message in one number.
_HEAD = struct.Struct("<BBQ")
_SEQUENCE, _ONE, _SENDER, _NUMBER = 0xFF0000, 0x010000, 24, 40
# By a payload's length: what the checksum covers but the message's own byte, and the checksum.
BEFORE_BYTES = HEADER_BYTES - 1
_WHOLE = [struct.Struct(f"<{BEFORE_BYTES + n}sH").unpack_from for n in range(256)]
TICK = "sequence"
# So many frames that came again or late are told from a board that started again.
WINDOW, LATE_ROW = 128, 32


@dataclass
class LinkHealth:
    frames: int = 0  # good ones
    bad_frames: int = 0  # those with a wrong checksum, a length that cannot be, or unknown flags
    unknown_frames: int = 0  # those of a message that the dialect does not have
    noise_bytes: int = 0  # all bytes outside good frames
    lost_frames: int = 0  # missing by their sequence numbers
    repeated_frames: int = 0  # of runs, those that came again or after a later one; not taken


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
        """What the next frame comes with."""
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


_NOBODY: tuple[bytes, int, _Kept | None] = b"", -1, None


class TelemetryDecoder:
    def __init__(
        self,
        dialect: Any,
        units: Mapping[str, Mapping[str, str]] | None = None,
        texts: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        self.health = LinkHealth()
        self._buffer = b""
        self._counted = 0
        self._next: dict[int, int] = {}
        # Per message id: its extra checksum byte, the size of its payload, and, where it tells of a
        # run, what came.
        self._known: dict[int, tuple[bytes, int, _Kept | None]] = {}
        self.layouts: dict[int, StreamLayout] = {}
        for number, message in dialect.mavlink_map.items():
            size = message.unpacker.size
            kept = _Kept(size) if is_run(message) else None
            self._known[number] = bytes([message.crc_extra]), size, kept
            if kept is not None:
                name = message.msgname
                said = dict((units or {}).get(name, {})), dict((texts or {}).get(name, {}))
                self.layouts[number] = layout_of(message, stream_name(name), *said)
        self._rows = [(k, self.layouts[n]) for n, (_, _, k) in self._known.items() if k is not None]
        self._kept_back: _Kept | None = None
        self._late: dict[int, tuple[int, int]] = {}
        # Who spoke last; of its runs, by the header's number without the sequence: extra byte, size
        # of the payload, size as it is kept, bytes round the payload, and who keeps it.
        self._sender = -1
        self._runs: dict[int, tuple[bytes, int, int, int, Callable[[bytes], None]]] = {}

    def feed(self, data: bytes) -> tuple[list[Decoded], bytes]:
        """What these bytes complete: rows, and all other frames one after another."""
        buffer, at, whole = self._buffer + data if self._buffer else data, 0, True
        others: list[bytes] = []
        while whole:
            if not self._counted:
                at = self._in_order(buffer, at)
            at, whole = self._any_frame(buffer, at, others)
        self._buffer = buffer[at:]
        return [k.decoded(layout) for k, layout in self._rows if k.frames], b"".join(others)

    def _in_order(self, buffer: bytes, at: int) -> int:
        # Nearly all that comes: runs of who spoke last, one behind the other.
        # Written for speed; whatever else comes is for _any_frame.
        if not self._runs:
            return at
        head, body_of, checksum, runs = _HEAD.unpack_from, _WHOLE, _checksum, self._runs
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
                expected = expected + _ONE & _SEQUENCE
                frames += 1
                at = end
        self._next[self._sender] = expected >> 16
        self.health.frames += frames
        return at

    def _any_frame(self, buffer: bytes, at: int, others: list[bytes]) -> tuple[int, bool]:
        # One frame, or what is none: where it goes on, and whether it does without more bytes.
        at, whole = self._to_start(buffer, at)
        if not whole:
            return at, False
        _, length, rest = _HEAD.unpack_from(buffer, at)
        flags, sender, number = rest & 0xFF, rest >> _SENDER & 0xFFFF, rest >> _NUMBER
        extra, full, kept = self._known.get(number, _NOBODY)
        end = at + HEADER_BYTES + length
        last = end + CHECKSUM_BYTES + (SIGNATURE_BYTES if flags & SIGNED else 0)
        if length > full or flags & ~SIGNED:
            size_told = flags <= SIGNED
            return self._refuse(at, last - at if size_told else 3, full < 0 and size_told), True
        if len(buffer) < last:
            return at, False
        body = buffer[at + 1 : end]
        if _checksum(body + extra) != int.from_bytes(buffer[end : end + 2], "little"):
            return self._refuse(at, last - at), True
        self.health.frames += 1
        late = self._count((rest & _SEQUENCE) >> 16, sender)
        if kept is None:
            others.append(buffer[at:last])
        else:
            kept.take(body, late)
        self._counted = max(0, self._counted - (last - at))
        self._listen_to(sender)
        return last, True

    def _listen_to(self, sender: int) -> None:
        # Whose runs come next; -1: not known.
        if sender != self._sender:
            self._sender = sender
            self._runs = {}
            for number, (extra, size, kept) in self._known.items():
                for flags, signature in ((0, 0), (SIGNED, SIGNATURE_BYTES)):
                    if kept is not None and sender >= 0:
                        key = number << _NUMBER | sender << _SENDER | flags
                        more = HEADER_BYTES + CHECKSUM_BYTES + signature
                        self._runs[key] = extra, size, kept.size, more, kept.frames.append

    def _to_start(self, buffer: bytes, at: int) -> tuple[int, bool]:
        # Where the next frame may begin, and whether its whole header is there.
        size = len(buffer)
        while True:
            start = buffer.find(START, at)
            at = self._skip(at, size if start < 0 else start)
            if size - at >= HEADER_BYTES:
                return at, True
            # Unknown flags make it no frame, however little has come.
            if size - at < 3 or not buffer[at + 2] & ~SIGNED:
                return at, False
            at = self._refuse(at, 3)

    def keep_back(self, number: int) -> None:
        """From now on a message's payloads are for :meth:`kept_back`, and not among the others."""
        extra, size, kept = self._known[number]
        self._kept_back = kept or _Kept(size)
        self._kept_back.mark(self.health)
        self._known[number] = extra, size, self._kept_back
        self._listen_to(-1)

    def kept_back(self) -> list[tuple[bytes, int, int]]:
        """Whole payloads since the last time, and what was counted as lost and bad by then."""
        kept = self._kept_back
        if kept is None or not kept.frames:
            return []
        payloads = [frame[BEFORE_BYTES:] for frame in kept.frames]
        changes, _ = kept.begin_anew()
        ends = [row for row, _, _ in changes[1:]] + [len(payloads)]
        parts = zip(changes, ends, strict=True)
        return [(p, lost, bad) for (a, lost, bad), b in parts for p in payloads[a:b]]

    def forget(self) -> None:
        """The link was opened anew: half a frame, and what was expected next, mean nothing."""
        self.health.noise_bytes += len(self._buffer)
        self._buffer = b""
        self._next.clear()
        self._listen_to(-1)
        self._counted = 0

    def _count(self, number: int, sender: int) -> bool:
        # Whether it comes again, or late.
        health = self.health
        ahead = (number - self._next.get(sender, number)) % 256
        if ahead >= WINDOW:
            expected, row = self._late.get(sender, (number, 0))
            self._late[sender] = (number + 1) % 256, row + 1 if number == expected else 0
            # So long a row in order is not late: more were lost than the numbers can tell.
            if row < LATE_ROW:
                return True
        if ahead:
            health.lost_frames += ahead
            self._mark()
            self._late.pop(sender, None)
        self._next[sender] = (number + 1) % 256
        return False

    def _mark(self) -> None:
        for _, _, kept in self._known.values():
            if kept is not None:
                kept.mark(self.health)

    def _refuse(self, at: int, length: int, unknown: bool = False) -> int:
        # Start bytes inside of what was counted are no further frames.
        if not self._counted:
            self.health.unknown_frames += unknown
            self.health.bad_frames += not unknown
            self._counted = length
            self._mark()
        return self._skip(at, at + 1)

    def _skip(self, at: int, to: int) -> int:
        self.health.noise_bytes += to - at
        self._counted = max(0, self._counted - (to - at))
        return to


def _slow_checksum(data: bytes) -> int:
    return int(mavcrc.x25crc(data).crc)


_checksum: Callable[[bytes], int] = _FAST or _slow_checksum


def is_run(message: Any) -> bool:
    """Whether a message's class tells of a task's run: all numbers, and the tick among them."""
    return TICK in message.fieldnames and fits(message)


def stream_name(message: str) -> str:
    """A stream's name from its message's: ``ESEA_SENSE_OUT`` is ``sense_out``."""
    return message.removeprefix("ESEA_").lower()
