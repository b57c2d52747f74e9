"""What a live view shows, gathered beside it: rows, state, fault, health.  No window needed."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from esea_gen.link.transport import LinkError
from esea_host.connection import Batch, ConnectedDevice
from esea_host.connection.receiver import KEY
from esea_host.connection.recording import LiveRecording
from esea_host.windows.history import LAST_S, RowRing
from esea_host.windows.meanings import FaultText, fault_text

TAKE_S, ASK_S = 0.05, 0.2
SILENT_S = 1.0
COMPONENT = 192  # a stop's frames are counted apart from the session's
EVERY_S, FOR_S = 0.05, 2.0


class StopSender:
    """Sends stop onto the link for two seconds or until confirmed; waits for no lock."""

    def __init__(self, device: ConnectedDevice) -> None:
        self._device = device
        self._dialect = device.session.dialect
        self._encoder = self._dialect.MAVLink(None, 255, COMPONENT)
        self._wanted, self._closed = threading.Event(), False
        self.sent = 0
        self._thread = threading.Thread(target=self._run, name="esea-stop", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._wanted.set()

    def close(self) -> None:
        self._closed = True
        self._wanted.set()
        self._thread.join(1.0)

    def send(self) -> None:
        command = self._dialect.MAV_CMD_USER_4
        message = self._dialect.MAVLink_command_long_message(1, 1, command, 0, *[0.0] * 7)
        frame = bytes(message.pack(self._encoder))
        self._encoder.seq = (self._encoder.seq + 1) % 256
        self._device.receiver.write(frame, 1.0)
        self.sent += 1

    def _stopped(self) -> bool:
        # Without the lock: the heartbeat that somebody has read last.
        session = self._device.session
        return session.heartbeat is not None and session.state() == "STOPPED"

    def _run(self) -> None:
        while True:
            self._wanted.wait()
            if self._closed:
                return
            self._wanted.clear()
            end_s = time.monotonic() + FOR_S
            # Once at least: what the heartbeat says may be old.
            while not self._closed:
                with contextlib.suppress(LinkError):
                    self.send()
                time.sleep(EVERY_S)
                if self._stopped() or time.monotonic() >= end_s:
                    break


@dataclass
class BoardNews:
    state: str = "UNKNOWN"
    fault: FaultText | None = None
    health: dict[str, int] = field(default_factory=dict)
    said: str = ""
    error: str = ""


class LiveFeed:
    """Fills rings from a connected board, and asks it what one sees."""

    def __init__(
        self,
        device: ConnectedDevice,
        recording: LiveRecording | None = None,
        kept_s: float = LAST_S,
        threaded: bool = True,
    ) -> None:
        self.device, self.recording = device, recording
        layouts = [x for x in device.receiver.decoder.layouts.values() if x.name != KEY]
        system = device.identity.device.system
        tasks_s = {t.name: t.every * system.base_period_s for t in system.tasks}
        self.period_s = {x.name: tasks_s[x.name.rpartition("_")[0]] for x in layouts}
        self.rings = {x.name: RowRing(x, round(kept_s / self.period_s[x.name])) for x in layouts}
        self._queue = device.subscribe(list(self.rings))
        device.listen(list(self.rings))
        self.news = BoardNews()
        self.stopper = StopSender(device)
        self.came_s = time.monotonic()
        self._jobs: queue.SimpleQueue[tuple[str, Callable[[], Any]]] = queue.SimpleQueue()
        self._closed = threading.Event()
        self._threads: list[threading.Thread] = []
        for name, turn in (("esea-view-rows", self._take), ("esea-view-asks", self._asks)):
            if threaded:
                self._threads.append(threading.Thread(target=turn, name=name, daemon=True))
                self._threads[-1].start()

    @property
    def dropped_rows(self) -> int:
        return self._queue.dropped_rows

    @property
    def silent(self) -> bool:
        return time.monotonic() - self.came_s > SILENT_S

    def gather(self, timeout_s: float = 0.0) -> None:
        for batch in self._queue.take(timeout_s):
            self.receive(batch)

    def receive(self, batch: Batch) -> None:
        self.came_s = time.monotonic()
        self.rings[batch.layout.name].extend(batch)

    def ask(self) -> None:
        """Do what was asked for, then look at state, fault and health."""
        while not self._jobs.empty():
            what, job = self._jobs.get()
            try:
                answer = job()
                self.news.said = what if answer is None else f"{what}: {answer}"
            except Exception as error:
                self.news.said = f"{what}: {error}"
        self.news.state = self.device.state()
        while self.device.texts:
            self.news.said = f"the board says: {self.device.texts.popleft()}"
        number = self._fault_now()
        self.news.fault = fault_text(self.device.session.dialect, number) if number else None
        self.news.health = self.device.health() | {"not_shown": self.dropped_rows}

    def _fault_now(self) -> int:
        if self.news.state not in ("FAULT", "STOPPED"):
            return 0
        return self.device.fault()

    def do(self, what: str, job: Callable[[], Any]) -> None:
        """Have something done that may wait for the board or for the disk; returns at once."""
        self._jobs.put((what, job))

    def stop(self) -> None:
        """Stop the motor: past everything that waits; returns at once."""
        self.stopper.stop()

    def note(self, text: str) -> None:
        recording = self.recording
        if recording is None:
            self.news.said = "not recorded: start with --record FILE to keep notes"
            return
        facts = {"board_s": self.now_s()}
        self.do(f"noted '{text}'", lambda: recording.note(text, **facts))

    def now_s(self) -> float:
        newest = (ring.last(1).time_s for ring in self.rings.values())
        return max((float(t[0]) for t in newest if len(t)), default=0.0)

    def _take(self) -> None:
        try:
            while not self._closed.is_set():
                self.gather(TAKE_S)
        except Exception as error:
            self.news.error = str(error)

    def _asks(self) -> None:
        while not self._closed.is_set():
            try:
                self.ask()
            except Exception as error:
                self.news.error = str(error)
                if self.device.receiver.error is not None:
                    return
            self._closed.wait(ASK_S)

    def close(self) -> None:
        """Let go; the connection and its recording go on."""
        self._closed.set()
        self.stopper.close()
        for thread in self._threads:
            thread.join(2.0)
        self.device.receiver.unsubscribe(self._queue)
