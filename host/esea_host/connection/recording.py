"""A recording of a connected board, while it runs."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, Self

import numpy as np

from esea_gen.errors import UserError
from esea_gen.portability import uninterrupted
from esea_host.connection.decoder import TICK
from esea_host.connection.receiver import Receiver
from esea_host.recording.integrity import Gap
from esea_host.recording.writer import Recorder

MOST_ROWS = 120_000
CLOCK_S, CLOSE_S = 1.0, 60.0


class LiveRecording:
    """Writes received data in its own thread; ``error`` has the reason of an early end.

    A board that goes away for good leaves a gap ``disconnected`` in every stream; a full disk the
    last complete piece.  Time in the file is the board's, put onto the host's clock once, at the
    first row; every second an event ``clock`` tells both, and how far the wall clock was set.
    """

    def __init__(
        self,
        recorder: Recorder,
        receiver: Receiver,
        streams: Collection[str] | None,
        health: Callable[[], dict[str, Any]],
        ended: Callable[[LiveRecording], None],
        threaded: bool,
    ) -> None:
        self.recorder, self._receiver = recorder, receiver
        self._health, self._ended = health, ended
        known = receiver.decoder.layouts.values()
        layouts = [x for x in known if streams is None or x.name in streams]
        for layout in layouts:
            self.recorder.declare(layout)
        self.subscription = receiver.subscribe(streams, MOST_ROWS)
        self.rows, self.gaps = 0, 0
        self.error: Exception | None = None
        self._lock = threading.Lock()
        self._start: tuple[int, int] | None = None
        self._last = {x.name: (-1, -1) for x in layouts}  # tick, and the board's time
        self._clock_s = 0.0
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(target=self._run, name="esea-recorder", daemon=True)
            self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def beginning(self) -> Iterator[None]:
        """A recording that cannot begin leaves no file without rows in the way of the next."""
        try:
            yield
        except Exception:
            self.close()
            if not self.rows:
                self.recorder.path.unlink(missing_ok=True)
            raise

    def note(self, text: str, **facts: Any) -> None:
        with self._lock:
            self.recorder.note(text, **facts)

    def event(self, topic: str, **content: Any) -> None:
        with self._lock:
            self.recorder.event(topic, content)

    @uninterrupted()  # what has been taken is written
    def drain(self, timeout_s: float) -> None:
        for batch in self.subscription.take(timeout_s):
            if self._start is None:
                self._start = batch.arrived_ns, int(batch.board_ns[0])
            log_ns = batch.board_ns - self._start[1] + self._start[0]
            with self._lock:
                for gap in batch.gaps:
                    self.recorder.gap(gap)
                self.recorder.rows(batch.layout, batch.rows, log_ns, batch.board_ns)
                if time.monotonic() - self._clock_s >= CLOCK_S:
                    self._clock_s = time.monotonic()
                    board_ns = int(np.max(batch.board_ns))
                    told = {"host_ns": batch.arrived_ns, "board_ns": board_ns}
                    told["wall_ahead_ns"] = self._receiver.wall_ahead_ns()
                    self.recorder.event("clock", told | self._health())
            self._last[batch.layout.name] = int(batch.rows[TICK][-1]), int(batch.board_ns[-1])
            self.rows += len(batch.rows)
            self.gaps += len(batch.gaps)

    def _run(self) -> None:
        try:
            while not self._stopped.is_set():
                self.drain(0.1)
        except Exception as error:
            self.error = error  # who holds the recording sees it

    @uninterrupted()
    def close(self) -> None:
        self._receiver.unsubscribe(self.subscription)  # else a slow disk is never done
        self._stopped.set()
        if self._thread is not None:
            self._thread.join(CLOSE_S)
            if self._thread.is_alive():
                self.error = UserError(
                    f"{self.recorder.path}: not written to its end within {CLOSE_S:g} s.",
                    "Record onto a faster disk, or fewer streams.",
                )
        away = self._receiver.away and not self.recorder.closed
        try:
            if self.error is None:
                self.drain(0.0)
        except Exception as error:
            self.error = error
        self._ended(self)
        try:
            with self._lock:
                for stream, (tick, ns) in self._last.items() if away else ():
                    self.recorder.gap(Gap(stream, tick, -1, -1, "disconnected", ns))
                    self.gaps += 1
                for gap in () if self.recorder.closed else self.subscription.lost():
                    self.recorder.gap(gap)
                    self.gaps += 1
                self.recorder.close()
        except UserError as error:
            self.error = self.error or error
