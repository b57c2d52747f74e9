"""Frames out of a stream of bytes, whatever else is in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# MAVLink 2: start, payload length, incompatibility flags, ..., message id in three bytes.
START = 0xFD
HEADER_BYTES = 10
CHECKSUM_BYTES = 2
SIGNATURE_BYTES = 13
SIGNED = 0x01


@dataclass
class Counters:
    frames: int = 0  # good ones
    bad_frames: int = 0  # those with a wrong checksum, or with flags that nobody knows
    unknown_frames: int = 0  # those of a message that the dialect does not have
    noise_bytes: int = 0  # all bytes outside good frames
    lost_frames: int = 0


class FrameReader:
    """Takes bytes in pieces of any size and gives the messages in them."""

    # After a bad frame it goes on one byte behind that frame's start: a stray start byte hides no
    # frame that follows it, as it does in MAVLink's own parsers.

    def __init__(self, dialect: Any) -> None:
        self.counters = Counters()
        self._decoder = dialect.MAVLink(None)
        self._known: frozenset[int] = frozenset(dialect.mavlink_map)
        self._refused: type[Exception] = dialect.MAVError
        self._buffer = bytearray()
        # So many of the buffer's first bytes lie in a bad frame that is counted already.
        self._counted = 0
        self._next: dict[tuple[int, int], int] = {}

    def feed(self, data: bytes) -> list[Any]:
        self._buffer += data
        messages: list[Any] = []
        while True:
            start = self._buffer.find(START)
            self._skip(len(self._buffer) if start < 0 else start)
            head = self._buffer[:HEADER_BYTES]
            if len(head) >= 3 and head[2] & ~SIGNED:
                self._refuse(3)
                continue
            if len(head) < HEADER_BYTES:
                return messages
            length = HEADER_BYTES + head[1] + CHECKSUM_BYTES
            length += SIGNATURE_BYTES if head[2] & SIGNED else 0
            known = int.from_bytes(head[7:10], "little") in self._known
            if known and len(self._buffer) < length:
                return messages
            try:
                message = self._decoder.decode(self._buffer[:length]) if known else None
            except self._refused:
                self._refuse(length)
                continue
            if message is None:
                self._refuse(length, unknown=True)
                continue
            del self._buffer[:length]
            self._counted = max(0, self._counted - length)
            self._count(message)
            messages.append(message)

    def _refuse(self, length: int, unknown: bool = False) -> None:
        # Start bytes inside of what was counted are no further frames.
        if not self._counted:
            self.counters.unknown_frames += unknown
            self.counters.bad_frames += not unknown
            self._counted = length
        self._skip(1)

    def _skip(self, count: int) -> None:
        del self._buffer[:count]
        self.counters.noise_bytes += count
        self._counted = max(0, self._counted - count)

    def _count(self, message: Any) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        sequence = message.get_seq()
        self.counters.frames += 1
        self.counters.lost_frames += (sequence - self._next.get(sender, sequence)) % 256
        self._next[sender] = (sequence + 1) % 256
