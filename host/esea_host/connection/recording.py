"""A recording of a connected board, while it runs."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection
from types import TracebackType
from typing import Any, Self

import numpy as np

from esea_host.connection.receiver import Receiver
from esea_host.recording.writer import Recorder

MOST_ROWS = 120_000
CLOCK_S = 1.0


class LiveRecording:
    """Writes what comes, in a thread of its own.

    Time in the file is the board's, put onto the host's clock once, at the first row; every
    second an event ``clock`` tells both, and by how much the wall clock has been set since.

    health: of link and board, told with the clocks.
    ended: called once the file is closed.
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
        for layout in receiver.decoder.layouts.values():
            if streams is None or layout.name in streams:
                self.recorder.declare(layout)
        self.subscription = receiver.subscribe(streams, MOST_ROWS)
        self.rows, self.gaps = 0, 0
        self.error: Exception | None = None
        self._lock = threading.Lock()
        self._start: tuple[int, int] | None = None
        self._clock_s = 0.0
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(target=self._run, name="esea-recorder", daemon=True)
            self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def note(self, text: str, **facts: Any) -> None:
        """Write down what somebody saw or did."""
        with self._lock:
            self.recorder.note(text, **facts)

    def event(self, topic: str, **content: Any) -> None:
        """Write an event."""
        with self._lock:
            self.recorder.event(topic, content)

    def drain(self, timeout_s: float) -> None:
        """Write what waits."""
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
            self.rows += len(batch.rows)
            self.gaps += len(batch.gaps)

    def _run(self) -> None:
        try:
            while not self._stopped.is_set():
                self.drain(0.1)
        except Exception as error:
            # A full disk, or a link that has gone: who holds the recording sees it.
            self.error = error

    def close(self) -> None:
        """End the file; more than once does no harm."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join(5.0)
        try:
            if self.error is None:
                self.drain(0.0)
        except Exception as error:
            self.error = error
        self._receiver.unsubscribe(self.subscription)
        self._ended(self)
        with self._lock:
            self.recorder.close()
