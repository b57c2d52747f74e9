"""Telemetry out of a stream of bytes: whole arrays, not a message at a time.

Frames of runs, the thousands a second, go by their bytes into arrays; every other frame is handed
on as it came, for the session.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.generator import mavcrc

from esea_host.recording.layout import Array, StreamLayout, fits, layout_of
from esea_link.frames import CHECKSUM_BYTES, HEADER_BYTES, SIGNATURE_BYTES, SIGNED, START

_FAST: Any = getattr(mavcrc, "mcrf4xx", None)  # in C, where pymavlink found it
_CRC = struct.Struct("<H")
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
        self._buffer = bytearray()
        self._counted = 0
        self._next: dict[int, int] = {}
        # Per message id: its extra checksum byte, and the size of its whole payload.
        self._known: dict[int, tuple[bytes, int]] = {}
        self.layouts: dict[int, StreamLayout] = {}
        for number, message in dialect.mavlink_map.items():
            self._known[number] = bytes([message.crc_extra]), message.unpacker.size
            if is_run(message):
                name = message.msgname
                said = dict((units or {}).get(name, {})), dict((texts or {}).get(name, {}))
                self.layouts[number] = layout_of(message, stream_name(name), *said)
        self._late: dict[int, tuple[int, int]] = {}
        self._found: dict[int, tuple[list[bytes], list[int], list[int], list[bool]]] = {}

    def feed(self, data: bytes) -> tuple[list[Decoded], bytes]:
        """What these bytes complete: rows, and all other frames one after another."""
        buffer, known, layouts = self._buffer, self._known, self.layouts
        buffer += data
        at, size = 0, len(buffer)
        others: list[bytes] = []
        while True:
            start = buffer.find(START, at)
            at = self._skip(at, size if start < 0 else start)
            if size - at < HEADER_BYTES:
                # Unknown flags make it no frame, however little has come.
                if size - at >= 3 and buffer[at + 2] & ~SIGNED:
                    at = self._refuse(at, 3)
                    continue
                break
            if buffer[at + 2] & ~SIGNED:
                at = self._refuse(at, 3)
                continue
            number = int.from_bytes(buffer[at + 7 : at + 10], "little")
            whole = known.get(number)
            end = at + HEADER_BYTES + buffer[at + 1]
            if whole is None or buffer[at + 1] > whole[1]:
                at = self._refuse(at, end + CHECKSUM_BYTES - at, unknown=whole is None)
                continue
            last = end + CHECKSUM_BYTES + (SIGNATURE_BYTES if buffer[at + 2] & SIGNED else 0)
            if size < last:
                break
            if _checksum(buffer[at + 1 : end] + whole[0]) != _CRC.unpack_from(buffer, end)[0]:
                at = self._refuse(at, last - at)
                continue
            late = self._count(buffer[at + 4], buffer[at + 5] << 8 | buffer[at + 6])
            if number in layouts:
                self._keep(number, bytes(buffer[at + HEADER_BYTES : end]), whole[1], late)
            else:
                others.append(bytes(buffer[at:last]))
            self._counted = max(0, self._counted - (last - at))
            at = last
        del buffer[:at]
        return self._arrays(), b"".join(others)

    def forget(self) -> None:
        """The link was opened anew: half a frame, and what was expected next, mean nothing."""
        self.health.noise_bytes += len(self._buffer)
        self._buffer.clear()
        self._next.clear()
        self._counted = 0

    def _count(self, number: int, sender: int) -> bool:
        # Whether it comes again, or late.
        health = self.health
        health.frames += 1
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

    def _keep(self, number: int, payload: bytes, size: int, late: bool) -> None:
        kept = self._found.setdefault(number, ([], [], [], []))
        # Zeros at a payload's end are not sent.
        kept[0].append(payload if len(payload) == size else payload.ljust(size, b"\0"))
        kept[1].append(self.health.lost_frames)
        kept[2].append(self.health.bad_frames)
        kept[3].append(late)

    def _arrays(self) -> list[Decoded]:
        out = []
        for number, (payloads, lost, bad, late) in self._found.items():
            layout = self.layouts[number]
            rows = np.frombuffer(b"".join(payloads), layout.dtype)
            marks = np.array(lost, np.int64), np.array(bad, np.int64), np.array(late, bool)
            out.append(Decoded(layout, rows, *marks))
        self._found = {}
        return out

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


def _checksum(data: bytes | bytearray) -> int:
    return int(mavcrc.x25crc(bytes(data)).crc) if _FAST is None else int(_FAST(bytes(data)))


def is_run(message: Any) -> bool:
    """Whether a message's class tells of a task's run: all numbers, and the tick among them."""
    return TICK in message.fieldnames and fits(message)


def stream_name(message: str) -> str:
    """A stream's name from its message's: ``ESEA_SENSE_OUT`` is ``sense_out``."""
    return message.removeprefix("ESEA_").lower()
