"""Telemetry out of a stream of bytes: whole arrays, not a message at a time.

Frames of runs, the thousands a second, go by their bytes into arrays; every other frame is handed
on as it came, for the session.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pymavlink.generator import mavcrc

from esea_host.recording.layout import Array, StreamLayout, fits, layout_of
from esea_link.frames import CHECKSUM_BYTES, HEADER_BYTES, SIGNATURE_BYTES, SIGNED, START

_FAST: Any = getattr(mavcrc, "mcrf4xx", None)  # in C, where pymavlink found it
# Length, flags that matter, sequence, sender, message.
_HEAD, _TOLD = struct.Struct("<xBBxBHHB"), struct.Struct("<H")
TICK = "sequence"
# So many frames that came again or late are told from a board that started again.
WINDOW, LATE_ROW = 128, 32


@dataclass
class LinkHealth:
    """What came over a link.

    frames: good ones.
    bad_frames: those with a wrong checksum, a length that cannot be, or unknown flags.
    unknown_frames: those of a message that the dialect does not have.
    noise_bytes: all bytes outside good frames.
    lost_frames: missing by their sequence numbers.
    repeated_frames: of runs, those that came again or after a later one; not taken.
    """

    frames: int = 0
    bad_frames: int = 0
    unknown_frames: int = 0
    noise_bytes: int = 0
    lost_frames: int = 0
    repeated_frames: int = 0


class Decoded(NamedTuple):
    """Rows of a stream, as they came.

    changes: from which row on, what :class:`LinkHealth` had counted as lost and as bad by then.
    late_rows: those that came again, or after a later one.
    """

    layout: StreamLayout
    rows: Array
    changes: list[tuple[int, int, int]]
    late_rows: list[int]

    def counted(self) -> tuple[Array, Array]:
        """Counted as lost, and as bad, when each row came; each of shape (n,)."""
        first, lost, bad = np.array(self.changes, np.int64).T
        counts = np.diff(first, append=len(self.rows))
        return np.repeat(lost, counts), np.repeat(bad, counts)


class _Kept:
    # Payloads of a message since the last time they were asked for, and what was counted when.

    def __init__(self) -> None:
        self.payloads: list[bytes] = []
        self.changes = [(0, 0, 0)]
        self.late: list[int] = []
        self.told = 0  # sum of what was counted at the last change

    def mark(self, health: LinkHealth) -> None:
        """What the next payload comes with."""
        self.told = health.lost_frames + health.bad_frames
        before = self.changes if self.payloads else []
        now = len(self.payloads), health.lost_frames, health.bad_frames
        self.changes = [*before, now]

    def decoded(self, layout: StreamLayout) -> Decoded:
        payloads, changes, late = self.taken()
        return Decoded(layout, np.frombuffer(b"".join(payloads), layout.dtype), changes, late)

    def taken(self) -> tuple[list[bytes], list[tuple[int, int, int]], list[int]]:
        """What came, and begin anew."""
        made = self.payloads.copy(), self.changes, self.late
        if len(self.changes) > 1:
            self.changes = [(0, *self.changes[-1][1:])]
        self.late = []
        self.payloads.clear()
        return made


_NOBODY: tuple[bytes, int, _Kept, list[bytes] | None] = b"", -1, _Kept(), None


class TelemetryDecoder:
    """Takes bytes in pieces of any size.

    Parameters
    ----------
    dialect : module
        The device's generated MAVLink module.
    units, texts : mapping of str to mapping, optional
        By message, by field.
    """

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
        # Per message id: its extra checksum byte, the size of its whole payload, what came, and,
        # where it tells of a run, the payloads in there.
        self._known: dict[int, tuple[bytes, int, _Kept, list[bytes] | None]] = {}
        self.layouts: dict[int, StreamLayout] = {}
        for number, message in dialect.mavlink_map.items():
            size = message.unpacker.size
            extra, kept = bytes([message.crc_extra]), _Kept()
            payloads = kept.payloads if is_run(message) else None
            self._known[number] = extra, size, kept, payloads
            if is_run(message):
                name = message.msgname
                said = dict((units or {}).get(name, {})), dict((texts or {}).get(name, {}))
                self.layouts[number] = layout_of(message, stream_name(name), *said)
        self._rows = [(n, self._known[n][2]) for n in self.layouts]
        self._kept_back: _Kept | None = None
        self._late: dict[int, tuple[int, int]] = {}

    def feed(self, data: bytes) -> tuple[list[Decoded], bytes]:
        """What these bytes complete: rows, and all other frames one after another."""
        known, following, checksum = self._known.get, self._next, _checksum
        buffer, at = self._buffer + data if self._buffer else data, 0
        size, head, told = len(buffer), _HEAD.unpack_from, _TOLD.unpack_from
        most = size - HEADER_BYTES
        others: list[bytes] = []
        health, frames = self.health, 0
        counted, inside = health.lost_frames + health.bad_frames, self._counted
        expected = following.get
        while True:
            if at > most or buffer[at] != START:
                at, whole = self._to_start(buffer, at)
                counted, inside = health.lost_frames + health.bad_frames, self._counted
                if not whole:
                    break
            length, flags, sequence, sender, low, high = head(buffer, at)
            extra, full, kept, payloads = known(high << 16 | low, _NOBODY)
            body = at + HEADER_BYTES
            end = body + length
            last = end + CHECKSUM_BYTES
            if length > full or flags:
                if length > full or flags & ~SIGNED:
                    unknown, size_told = full < 0 and flags <= SIGNED, flags <= SIGNED
                    at = self._refuse(at, last - at if size_told else 3, unknown)
                    counted, inside = health.lost_frames + health.bad_frames, self._counted
                    continue
                last += SIGNATURE_BYTES
            if size < last:
                break
            if checksum(buffer[at + 1 : end] + extra) != told(buffer, end)[0]:
                at = self._refuse(at, last - at)
                counted, inside = health.lost_frames + health.bad_frames, self._counted
                continue
            frames += 1
            late = False
            if expected(sender) == sequence:
                following[sender] = (sequence + 1) & 0xFF
            else:
                late = self._count(sequence, sender)
                counted = health.lost_frames + health.bad_frames
            if payloads is not None:
                if kept.told != counted:
                    kept.mark(health)
                if late:
                    kept.late.append(len(payloads))
                payload = buffer[body:end]
                # Zeros at a payload's end are not sent.
                payloads.append(payload if length == full else payload.ljust(full, b"\0"))
            else:
                others.append(buffer[at:last])
            if inside:
                inside = self._counted = max(0, inside - (last - at))
            at = last
        health.frames += frames
        self._buffer = buffer[at:]
        return self._arrays(), b"".join(others)

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
        extra, size, kept, _ = self._known[number]
        self._known[number] = extra, size, kept, kept.payloads
        self._kept_back = kept

    def kept_back(self) -> list[tuple[bytes, int, int]]:
        """Whole payloads since the last time, and what was counted as lost and bad by then."""
        kept = self._kept_back
        if kept is None or not kept.payloads:
            return []
        payloads, changes, _ = kept.taken()
        ends = [row for row, _, _ in changes[1:]] + [len(payloads)]
        parts = zip(changes, ends, strict=True)
        return [(p, lost, bad) for (a, lost, bad), b in parts for p in payloads[a:b]]

    def forget(self) -> None:
        """The link was opened anew: half a frame, and what was expected next, mean nothing."""
        self.health.noise_bytes += len(self._buffer)
        self._buffer = b""
        self._next.clear()
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
        health.lost_frames += ahead
        self._late.pop(sender, None)
        self._next[sender] = (number + 1) % 256
        return False

    def _arrays(self) -> list[Decoded]:
        return [kept.decoded(self.layouts[number]) for number, kept in self._rows if kept.payloads]

    def _refuse(self, at: int, length: int, unknown: bool = False) -> int:
        # Start bytes inside of what was counted are no further frames.
        if not self._counted:
            self.health.unknown_frames += unknown
            self.health.bad_frames += not unknown
            self._counted = length
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
