"""The recorder: MCAP in small pieces, each whole on the disk within a second.

A file that is cut off anywhere keeps every piece before the cut; :func:`esea_host.open_log` reads
it without being asked to repair anything.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from mcap.writer import CompressionType, Writer

from esea_gen.errors import UserError
from esea_host.recording.gaps import Gap
from esea_host.recording.layout import PACKAGE, Array, StreamLayout

PIECE_BYTES = 1 << 18
PIECE_S = 0.5
LIBRARY = "esea-host"
COLUMNS_KEY = "esea.columns"
EVENT_SCHEMA: dict[str, Any] = {"type": "object", "properties": {}, "additionalProperties": True}


class Recorder:
    """A recording that is being written.

    Parameters
    ----------
    path : Path
        Must not exist: nothing is overwritten.
    attachments : mapping of str to bytes
        What belongs to it: device file, dialect, facts; by file name.
    compress : bool
        With zstandard.  Without, a damaged bit costs one number and not a piece.
    piece_s : float
        After how long a piece is written, at the latest.

    Raises
    ------
    UserError
        When the file exists or cannot be written.
    """

    def __init__(
        self,
        path: Path,
        attachments: Mapping[str, bytes] | None = None,
        compress: bool = False,
        piece_s: float = PIECE_S,
    ) -> None:
        self.path, self.piece_s = Path(path), piece_s
        try:
            self._file = self.path.open("xb")
        except FileExistsError:
            raise UserError(f"{path} is there already.", "Give another name.") from None
        except OSError as error:
            raise UserError(f"{path} cannot be written: {error.strerror}.", "") from None
        kind = CompressionType.ZSTD if compress else CompressionType.NONE
        # Any: much of the library has no types.
        self._writer: Any = Writer(self._file, PIECE_BYTES, kind)
        self._writer.start(profile="", library=LIBRARY)
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._closed = False
        now = time.time_ns()
        for name, data in (attachments or {}).items():
            media = "application/json" if name.endswith(".json") else "text/plain"
            self._writer.add_attachment(now, now, name, media, data)
        self._sync()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def declare(self, layout: StreamLayout) -> None:
        """Say that a stream will come; so its description does not hang on its first piece.

        Parameters
        ----------
        layout : StreamLayout
            Of the stream.
        """
        if layout.name in self._channels:
            return
        self._sync()  # so that what describes a channel stands first in its piece
        schema = self._writer.register_schema(
            f"{PACKAGE}.{layout.name}", "protobuf", layout.descriptor()
        )
        known = {COLUMNS_KEY: layout.to_json(), "units": json.dumps(layout.units)}
        channel = self._writer.register_channel(f"/{layout.name}", "protobuf", schema, known)
        self._channels[layout.name] = channel

    def rows(self, layout: StreamLayout, rows: Array, log_ns: Array, board_ns: Array) -> None:
        """Write rows of a stream.

        Parameters
        ----------
        layout : StreamLayout
            Of the stream; the same at every call.
        rows : ndarray
            Structured, shape (n,), of ``layout.dtype``.
        log_ns, board_ns : ndarray of int
            Shape (n,): nanoseconds since 1970 and of the board's clock.
        """
        self.declare(layout)
        channel = self._channels[layout.name]
        data, size = layout.record(rows).tobytes(), layout.record_dtype.itemsize
        first = self._counts.get(layout.name, 0)
        add = self._writer.add_message
        times = zip(log_ns.tolist(), board_ns.tolist(), strict=True)
        for i, (log, board) in enumerate(times):
            # MCAP's counter has 32 bits.
            number = (first + i) & 0xFFFFFFFF
            add(channel, log, data[i * size : (i + 1) * size], board, number)
        self._counts[layout.name] = first + len(rows)
        self._maybe_sync()

    def event(self, topic: str, content: Mapping[str, Any], log_ns: int | None = None) -> None:
        """Write an event: JSON, on a topic of its own.

        Parameters
        ----------
        topic : str
            ``gap``, ``note``, ``clock`` ...
        content : mapping
            What JSON can hold.
        log_ns : int, optional
            When, in nanoseconds since 1970; default: now.
        """
        channel = self._channels.get(topic)
        if channel is None:
            self._sync()
            text = json.dumps(EVENT_SCHEMA | {"title": topic}).encode()
            schema = self._writer.register_schema(f"{PACKAGE}.{topic}", "jsonschema", text)
            channel = self._writer.register_channel(f"/{topic}", "json", schema)
            self._channels[topic] = channel
        now = time.time_ns() if log_ns is None else log_ns
        number = self._counts.get(topic, 0)
        self._writer.add_message(channel, now, json.dumps(content).encode(), now, number)
        self._counts[topic] = number + 1
        self._maybe_sync()

    def gap(self, gap: Gap) -> None:
        """Mark a hole.

        Parameters
        ----------
        gap : Gap
            Where, and whose fault.
        """
        self.event("gap", gap.to_dict())

    def note(self, text: str, **facts: Any) -> None:
        """Write down what somebody saw or did.

        Parameters
        ----------
        text : str
            In words.
        **facts : object
            What JSON can hold, such as the tick.
        """
        self.event("note", {"text": text, **facts})

    def _maybe_sync(self) -> None:
        if time.monotonic() - self._synced_s >= self.piece_s:
            self._sync()

    def _sync(self) -> None:
        # The library ends a chunk only by its size; a slow stream would stay in memory for minutes.
        # It has no public call for it; without this one a recording does not even begin.
        self._writer._Writer__finalize_chunk()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._synced_s = time.monotonic()

    def close(self) -> None:
        """End the file with its index; more than once does no harm."""
        if not self._closed:
            self._closed = True
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()


def spread(first_ns: int, step_ns: int, count: int) -> Array:
    """Times of so many runs."""
    return np.asarray(first_ns + step_ns * np.arange(count, dtype=np.int64))
