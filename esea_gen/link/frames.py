"""MAVLink frames in a stream of bytes."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, NamedTuple

# MAVLink 2: start, payload length, incompatibility flags, ..., message id in three bytes.
START = 0xFD
HEADER_BYTES = 10
CHECKSUM_BYTES = 2
SIGNATURE_BYTES = 13
SIGNED = 0x01
# Start, length; flags, sequence, sender and message in one number.
HEAD = struct.Struct("<BBQ")
SEQUENCE, SENDER, NUMBER = 0xFF0000, 24, 40
# So many frames that came again or late are told from a board that started again.
WINDOW, LATE_ROW = 128, 32


@dataclass
class LinkHealth:
    """Counters of a link's received data."""

    frames: int = 0  # good ones
    bad_frames: int = 0  # those with a wrong checksum, a length that cannot be, or unknown flags
    unknown_frames: int = 0  # those of a message that the dialect does not have
    noise_bytes: int = 0  # all bytes outside good frames
    lost_frames: int = 0  # missing by their sequence numbers, 8 bits for each sender
    repeated_frames: int = 0  # of runs, those that came again or after a later one; not taken


class Frame(NamedTuple):
    """A good frame; ``body`` lasts from the header's second byte to the payload's end."""

    number: int
    sender: int
    late: bool  # it came again, or after a later one
    body: bytes
    whole: bytes


class FrameScanner:
    """Finds frames in bytes that come in pieces of any size."""

    # After a bad frame it goes on one byte behind that frame's start: a stray start byte hides no
    # frame that follows it, as it does in MAVLink's own parsers.

    def __init__(self, dialect: Any) -> None:
        self.health = LinkHealth()
        # Per message id: its extra checksum byte, and the size of its payload.
        self._sizes = {
            n: (bytes([m.crc_extra]), m.unpacker.size) for n, m in dialect.mavlink_map.items()
        }
        self._crc = dialect.x25crc
        self._buffer = b""
        # So many of the next bytes lie in a bad frame that is counted already.
        self._counted = 0
        self._next: dict[int, int] = {}
        self._late: dict[int, tuple[int, int]] = {}

    def _frame_at(self, buffer: bytes, at: int) -> tuple[int, bool, Frame | None]:
        # Where it goes on, whether it does without more bytes, and the frame there if it is one.
        at, whole = self._to_start(buffer, at)
        if not whole:
            return at, False, None
        _, length, rest = HEAD.unpack_from(buffer, at)
        flags, sender, number = rest & 0xFF, rest >> SENDER & 0xFFFF, rest >> NUMBER
        extra, full = self._sizes.get(number, (b"", -1))
        end = at + HEADER_BYTES + length
        last = end + CHECKSUM_BYTES + (SIGNATURE_BYTES if flags & SIGNED else 0)
        if length > full:
            return self._refuse(at, last - at, full < 0), True, None
        if len(buffer) < last:
            return at, False, None
        body = buffer[at + 1 : end]
        if self._crc(body + extra).crc != int.from_bytes(buffer[end : end + 2], "little"):
            return self._refuse(at, last - at), True, None
        self.health.frames += 1
        late = self._count((rest & SEQUENCE) >> 16, sender)
        self._counted = max(0, self._counted - (last - at))
        return last, True, Frame(number, sender, late, body, buffer[at:last])

    def _to_start(self, buffer: bytes, at: int) -> tuple[int, bool]:
        # Where the next frame may begin, and whether its whole header is there.
        size = len(buffer)
        while True:
            start = buffer.find(START, at)
            at = self._skip(at, size if start < 0 else start)
            # Unknown flags make it no frame, however little has come.
            if size - at < 3 or not buffer[at + 2] & ~SIGNED:
                return at, size - at >= HEADER_BYTES
            at = self._refuse(at, 3)

    def _count(self, number: int, sender: int) -> bool:
        # Whether it comes again, or late.
        ahead = (number - self._next.get(sender, number)) % 256
        if ahead >= WINDOW:
            expected, row = self._late.get(sender, (number, 0))
            self._late[sender] = (number + 1) % 256, row + 1 if number == expected else 0
            # So long a row in order is not late: more were lost than the numbers can tell.
            if row < LATE_ROW:
                return True
        if ahead:
            self.health.lost_frames += ahead
            self._mark()
            self._late.pop(sender, None)
        self._next[sender] = (number + 1) % 256
        return False

    def _mark(self) -> None:
        """More was counted as lost or bad."""

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


class FrameReader(FrameScanner):
    """Gives the messages in the bytes, decoded by the dialect's module."""

    def __init__(self, dialect: Any) -> None:
        super().__init__(dialect)
        self._decoder = dialect.MAVLink(None)

    def feed(self, data: bytes) -> list[Any]:
        buffer, at, more = self._buffer + data, 0, True
        messages: list[Any] = []
        while more:
            at, more, frame = self._frame_at(buffer, at)
            if frame is not None:
                messages.append(self._decoder.decode(bytearray(frame.whole)))
        self._buffer = buffer[at:]
        return messages
