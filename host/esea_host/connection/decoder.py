"""Telemetry out of a stream of bytes: whole arrays, not a message at a time.

Frames of runs, the thousands a second, go by their bytes into arrays; every other frame is handed
on as it came, for the session.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.generator import mavcrc

from esea_host.recording.layout import Array, StreamLayout, fits, layout_of
from esea_link.frames import CHECKSUM_BYTES, HEADER_BYTES, SIGNATURE_BYTES, SIGNED, START

_FAST: Any = getattr(mavcrc, "mcrf4xx", None)  # in C, where pymavlink found it
# Start, length, flags (those that matter and those that do not), sequence, sender, message.
_HEAD = struct.Struct("<BBBBBHHB")
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


@dataclass(frozen=True)
class Decoded:
    """Rows of a stream, as they came.

    lost, bad: what :class:`LinkHealth` had counted when each came.
    late: those that came again, or after a later one.
    """

    layout: StreamLayout
    rows: Array
    lost: Array
    bad: Array
    late: Array


class _Kept:
    # Payloads of a message since the last time they were asked for, and what was counted when.

    def __init__(self) -> None:
        self.payloads: list[bytes] = []
        self.changes: list[tuple[int, int, int]] = []
        self.late: list[int] = []
        self._lost = self._bad = -1

    def add(self, payload: bytes, health: LinkHealth, late: bool) -> None:
        if health.lost_frames != self._lost or health.bad_frames != self._bad or not self.payloads:
            self._lost, self._bad = health.lost_frames, health.bad_frames
            self.changes.append((len(self.payloads), self._lost, self._bad))
        if late:
            self.late.append(len(self.payloads))
        self.payloads.append(payload)

    def decoded(self, layout: StreamLayout) -> Decoded:
        rows = np.frombuffer(b"".join(self.payloads), layout.dtype)
        first, lost, bad = np.array(self.changes, np.int64).T
        counts = np.diff(first, append=len(rows))
        late = np.zeros(len(rows), bool)
        late[self.late] = True
        self.payloads, self.changes, self.late = [], [], []
        return Decoded(layout, rows, np.repeat(lost, counts), np.repeat(bad, counts), late)


_NOBODY = b"", -1, _Kept()


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
        # Per message id: its extra checksum byte, the size of its whole payload, and what came.
        self._known: dict[int, tuple[bytes, int, _Kept]] = {}
        self.layouts: dict[int, StreamLayout] = {}
        for number, message in dialect.mavlink_map.items():
            size = message.unpacker.size
            self._known[number] = bytes([message.crc_extra]), size, _Kept()
            if is_run(message):
                name = message.msgname
                said = dict((units or {}).get(name, {})), dict((texts or {}).get(name, {}))
                self.layouts[number] = layout_of(message, stream_name(name), *said)
        self._late: dict[int, tuple[int, int]] = {}

    def feed(self, data: bytes) -> tuple[list[Decoded], bytes]:
        """What these bytes complete: rows, and all other frames one after another."""
        known, layouts, following = self._known, self.layouts, self._next
        buffer, at = self._buffer + data, 0
        size, find, head = len(buffer), buffer.find, _HEAD.unpack_from
        others: list[bytes] = []
        health, frames = self.health, 0
        while True:
            if size - at < HEADER_BYTES or buffer[at] != START:
                start = find(START, at)
                at = self._skip(at, size if start < 0 else start)
                if size - at < HEADER_BYTES:
                    # Unknown flags make it no frame, however little has come.
                    if size - at >= 3 and buffer[at + 2] & ~SIGNED:
                        at = self._refuse(at, 3)
                        continue
                    break
            _, length, flags, _, sequence, sender, low, high = head(buffer, at)
            if flags & ~SIGNED:
                at = self._refuse(at, 3)
                continue
            number = high << 16 | low
            extra, full, kept = known.get(number, _NOBODY)
            end = at + HEADER_BYTES + length
            if length > full:
                at = self._refuse(at, end + CHECKSUM_BYTES - at, unknown=full < 0)
                continue
            last = end + CHECKSUM_BYTES + (SIGNATURE_BYTES if flags else 0)
            if size < last:
                break
            told = buffer[end] | buffer[end + 1] << 8
            if _checksum(buffer[at + 1 : end] + extra) != told:
                at = self._refuse(at, last - at)
                continue
            frames += 1
            late = False
            if following.get(sender) == sequence:
                following[sender] = (sequence + 1) & 0xFF
            else:
                late = self._count(sequence, sender)
            if number in layouts:
                payload = buffer[at + HEADER_BYTES : end]
                # Zeros at a payload's end are not sent.
                kept.add(payload if length == full else payload.ljust(full, b"\0"), health, late)
            else:
                others.append(buffer[at:last])
            if self._counted:
                self._counted = max(0, self._counted - (last - at))
            at = last
        health.frames += frames
        self._buffer = buffer[at:]
        return self._arrays(), b"".join(others)

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
        return [
            kept.decoded(self.layouts[number])
            for number, (_, _, kept) in self._known.items()
            if kept.payloads
        ]

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
