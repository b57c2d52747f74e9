"""The recorder: MCAP in small pieces, each complete on the disk within a second.

A file that is cut off anywhere keeps every piece before the cut; :func:`esea_host.open_log` reads
it without being asked to repair anything.  When the disk is full, the file ends with its last
complete piece, and a record at its beginning, which takes no further room, reports it.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Self

from mcap.writer import CompressionType, Writer

from esea_gen.errors import UserError
from esea_gen.portability import uninterrupted
from esea_host.recording.integrity import Gap
from esea_host.recording.layout import PACKAGE, Array, StreamLayout

PIECE_BYTES = 1 << 18
PIECE_S = 0.5
LIBRARY = "esea-host"
COLUMNS_KEY = "esea.columns"
MARK, END_KEY, OPEN, DISK_FULL = "esea.recording", "end", "open     ", "disk full"
FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
EVENT_SCHEMA: dict[str, Any] = {"type": "object", "properties": {}, "additionalProperties": True}


class Recorder:
    """A recording that is being written; ``piece_s``: after how long a piece is, at the latest.

    Nothing is overwritten.
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
            self._file = self.path.open("x+b")
        except FileExistsError:
            raise UserError(f"{path} already exists.", "Give another name.") from None
        except OSError as error:
            raise UserError(f"{path} cannot be written: {error.strerror}.", "") from None
        kind = CompressionType.ZSTD if compress else CompressionType.NONE
        # Any: much of the library has no types.
        self._writer: Any = Writer(self._file, PIECE_BYTES, kind, enable_data_crcs=True)
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self.closed, self._good_bytes, self._mark_at = False, 0, 0
        self._ended = f"{path}: the recording has ended.", "Begin another one."
        self._guarded(self._begin, dict(attachments or {}))

    def _begin(self, attachments: dict[str, bytes]) -> None:
        self._writer.start(profile="", library=LIBRARY)
        self._file.flush()
        self._mark_at = self._file.tell()
        self._writer.add_metadata(MARK, {END_KEY: OPEN})
        now = time.time_ns()
        for name, data in attachments.items():
            media = "application/json" if name.endswith(".json") else "text/plain"
            self._writer.add_attachment(now, now, name, media, data)
        self._sync()

    @uninterrupted()
    def _guarded(self, act: Callable[..., None], *given: Any) -> None:
        # A disk that is full ends the recording; what had been written complete stays.
        if self.closed:
            raise UserError(*self._ended)
        try:
            act(*given)
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self.closed = True
        # What is still in the buffer must not come behind the last complete piece; and by now
        # another file may have this one's name.
        own, nowhere = os.dup(self._file.fileno()), os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._file.fileno())
        os.close(nowhere)
        self._file.close()
        with contextlib.suppress(OSError), os.fdopen(own, "r+b", buffering=0) as file:
            file.truncate(self._good_bytes)
            file.seek(self._mark_at)
            at = file.read(200).find(OPEN.encode())
            if error.errno in FULL and at >= 0:
                file.seek(self._mark_at + at)
                file.write(DISK_FULL.encode())
            os.fsync(file.fileno())
        fix = f"The {self._good_bytes} bytes written before are kept and can be read."
        if error.errno == errno.ENOENT:
            fix = "Nothing of it is left: record again."
        elif not self._channels:
            fix = "Make room, or give another folder."
            self.path.unlink(missing_ok=True)
        full = "the disk is full" if error.errno in FULL else error.strerror or str(error)
        self._ended = f"{self.path}: recording ended, {full}.", fix  # for who comes later, too
        raise UserError(*self._ended) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def declare(self, layout: StreamLayout) -> None:
        """Say that a stream will come; so its description does not hang on its first piece."""
        if layout.name not in self._channels:
            self._guarded(self._declare, layout)

    def _declare(self, layout: StreamLayout) -> None:
        StreamLayout.from_json(layout.name, layout.to_json())  # what cannot be read is not written
        self._sync()  # so that what describes a channel stands first in its piece
        described = f"{PACKAGE}.{layout.name}", "protobuf", layout.descriptor()
        schema = self._writer.register_schema(*described)
        known = {COLUMNS_KEY: layout.to_json(), "units": json.dumps(layout.units)}
        channel = self._writer.register_channel(f"/{layout.name}", "protobuf", schema, known)
        self._channels[layout.name] = channel

    def rows(self, layout: StreamLayout, rows: Array, log_ns: Array, board_ns: Array) -> None:
        """Write rows of a stream; times in ns since 1970, and of the board's clock."""
        self.declare(layout)
        self._guarded(self._rows, layout, rows, log_ns, board_ns)

    def _rows(self, layout: StreamLayout, rows: Array, log_ns: Array, board_ns: Array) -> None:
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
        """Write an event: JSON, on a topic of its own."""
        self._guarded(self._event, topic, content, log_ns)

    def _event(self, topic: str, content: Mapping[str, Any], log_ns: int | None) -> None:
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
        self.event("gap", asdict(gap))

    def note(self, text: str, **facts: Any) -> None:
        """Record an observation or action of a person."""
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
        if not os.fstat(self._file.fileno()).st_nlink:
            raise FileNotFoundError(errno.ENOENT, "the file was deleted")
        self._good_bytes = self._file.tell()
        self._synced_s = time.monotonic()

    def close(self) -> None:
        """End the file with its index; more than once does no harm."""
        if not self.closed:
            self._guarded(self._finish)

    def _finish(self) -> None:
        self._sync()
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        self.closed = True
