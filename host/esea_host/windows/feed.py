"""Data of a live view: rows, state, fault, health.  No window needed."""

from __future__ import annotations

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.link.transport import LinkError
from esea_host.connection import Batch, ConnectedDevice, PlayedBoard
from esea_host.connection.receiver import KEY
from esea_host.connection.recording import LiveRecording
from esea_host.recording.layout import Array, StreamLayout
from esea_host.windows.meanings import MOTOR_ON, FaultText, fault_text, lacks_zero

Floats = npt.NDArray[np.float64]
LAST_S, SAME_S = 120.0, 1e-6
TAKE_S, ASK_S = 0.05, 0.2
SILENT_S = 1.0
# A zero is taken of angles that stay within half a degree for 0.2 s.
ANGLES = ("theta_motor", "theta_load")
STILL_RAD, STILL_S, ZEROED_S = math.radians(0.5), 0.2, 0.5
COMPONENT = 192  # a stop's frames are counted apart from the session's
EVERY_S, FOR_S = 0.05, 2.0
# What the health of a link counts, as it is shown.
COUNTED = {
    "gaps": "gaps",
    "lost_frames": "frames lost",
    "bad_frames": "damaged",
    "reconnects": "reconnects",
    "dropped_rows": "rows not recorded",
    "not_shown": "rows not shown",
}


class StopSender:
    """Sends stop onto the link for two seconds or until confirmed; waits for no lock."""

    def __init__(self, device: ConnectedDevice) -> None:
        self._device = device
        self._dialect = device.session.dialect
        self._encoder = self._dialect.MAVLink(None, 255, COMPONENT)
        self._asks: queue.SimpleQueue[bool] = queue.SimpleQueue()  # False: closed
        self.sent = 0
        self._thread = threading.Thread(target=self._run, name="esea-stop", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._asks.put(True)

    def close(self) -> None:
        """Send pending requests, then close."""
        self._asks.put(False)
        self._thread.join(1.0)

    def send(self, repeats: int = 0) -> None:
        """One frame; a repeated one is not the second stop, which switches off at once."""
        command, again = self._dialect.MAV_CMD_USER_4, min(repeats, 255)
        message = self._dialect.MAVLink_command_long_message(1, 1, command, again, *[0.0] * 7)
        frame = bytes(message.pack(self._encoder))
        self._encoder.seq = (self._encoder.seq + 1) % 256
        self._device.receiver.write(frame, 1.0)
        self.sent += 1

    def _stopped(self) -> bool:
        # Without the lock: the heartbeat that somebody has read last.
        session = self._device.session
        return session.heartbeat is not None and session.state() == "STOPPED"

    def _run(self) -> None:
        while self._asks.get():
            end_s, repeats = time.monotonic() + FOR_S, 0
            # Once at least: what the heartbeat says may be old.
            while repeats == 0 or not (self._stopped() or time.monotonic() >= end_s):
                with contextlib.suppress(LinkError):
                    self.send(repeats)
                repeats += 1
                with contextlib.suppress(queue.Empty):
                    if not self._asks.get(timeout=EVERY_S):
                        return
                    repeats = 0


@dataclass
class BoardNews:
    state: str = "UNKNOWN"
    fault: FaultText | None = None
    health: dict[str, int] = field(default_factory=dict)
    said: str = ""
    error: str = ""


class LiveFeed:
    """Fills rings from a connected board, and requests the streams in view."""

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
        device.most_away_s, self._back = math.inf, device.receiver.reconnects
        self.came_s, self.zero_s = time.monotonic(), math.inf
        self.values: dict[str, float] = {}  # of parameters, when they were read last
        self._jobs: queue.SimpleQueue[tuple[str, Callable[[], Any], int]] = queue.SimpleQueue()
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
        """Whether the last data of the board is old."""
        receiver = self.device.receiver
        if isinstance(self.device, PlayedBoard):
            return False
        gone = receiver.away or receiver.reconnects != self._back
        return gone or time.monotonic() - self.came_s > SILENT_S

    @property
    def unzeroed(self) -> dict[str, str]:
        """Name and meaning of the indicator that an encoder has no zero, while one has none."""
        newest = {n: row for n, r in self.rings.items() if (row := r.newest()) is not None}
        return lacks_zero(self.device.identity.device, newest)

    def lost_text(self) -> str:
        """Start and cause of the silence, and the last known state."""
        receiver, seconds = self.device.receiver, time.monotonic() - self.came_s
        text, next_step = receiver.away_text(), "Reconnecting."
        if not receiver.away:
            since = time.strftime("%H:%M:%S", time.localtime(time.time() - seconds))
            text = f"Nothing came from the board since {since} ({seconds:.0f} s)"
            next_step = "The link is open, but the values shown are old."
            if receiver.reconnects != self._back:
                text, next_step = "The link is back", "Waiting for the board's heartbeat."
        if receiver.error is not None:
            next_step = "Close this window and connect again."
        return f"{text}. Last state: {self.news.state}. {next_step}"

    def gather(self, timeout_s: float = 0.0) -> None:
        for batch in self._queue.take(timeout_s):
            self.receive(batch)

    def receive(self, batch: Batch) -> None:
        self.came_s = time.monotonic()
        self.rings[batch.layout.name].extend(batch)

    def ask(self) -> None:
        """Execute requests, then read state, fault and health."""
        while not self._jobs.empty():
            what, job, breaks = self._jobs.get()
            if breaks != self.device.receiver.breaks:
                self.news.said = f"{what}: not sent, as the link broke. Try again."
                continue
            try:
                answer = job()
                if what:
                    self.news.said = what if answer is None else f"{what}: {answer}"
            except Exception as error:
                self.news.said = f"{what}: {error}".removeprefix(": ")
        self.news.state = self.device.state()
        self._tell_zero()
        self._tell_back()
        while self.device.texts:
            self.news.said = f"the board says: {self.device.texts.popleft()}"
        number = self.device.fault() if self.news.state in ("FAULT", "STOPPED") else 0
        self.news.fault = fault_text(self.device.session.dialect, number) if number else None
        self.news.health = self.device.health() | {"not_shown": self.dropped_rows}

    def read_parameters(self) -> dict[str, float]:
        self.values = self.device.parameters()
        return self.values

    def zero(self) -> None:
        """Request a zero and report its result, which the board itself does not show."""
        self.zero_s = time.monotonic()
        self.do("Zero", self.device.zero)

    def _tell_zero(self) -> None:
        if time.monotonic() - self.zero_s < ZEROED_S or self.news.state == "ZEROING":
            return
        self.zero_s = math.inf
        if self.news.state == "UNREFERENCED":
            self.news.said = (
                "Zero failed: the joint moved, or an encoder cannot be read. "
                "Hold it still, unloaded, then Zero again."
            )
        elif self.news.state == "READY":
            self.news.said = "Zero: taken."

    def _tell_back(self) -> None:
        # Somebody has to arm it again who sees where it is now.
        reconnects = self.device.receiver.reconnects
        if reconnects == self._back or self.news.state == "UNKNOWN":
            return
        self._back = reconnects
        again = "; the board has started again" if self.device.receiver.restarted else ""
        self.news.said = f"The link is back since {time.strftime('%H:%M:%S')}{again}."
        if self.news.state in MOTOR_ON:
            self.device.disarm()
            self.news.said += " The motor was still on, and was disarmed."

    @property
    def moves(self) -> bool:
        """Whether the joint moves too much to be zeroed."""
        for name, ring in self.rings.items():
            columns = [c.name for c in ring.layout.columns if c.name.startswith(ANGLES)]
            rows = ring.last(round(STILL_S / self.period_s[name]) if columns else 0).rows
            if len(rows) and any(float(np.ptp(rows[c])) > STILL_RAD for c in columns):
                return True
        return False

    def do(self, what: str, job: Callable[[], Any]) -> None:
        """Have something done that may wait for the board or for the disk; returns at once.

        what: told when it is done; empty: only what goes wrong is.
        """
        self._jobs.put((what, job, self.device.receiver.breaks))

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

    def latest(self, span_s: float) -> dict[str, Stretch]:
        """Rows of the last so many seconds, whatever a picture shows."""
        now_s = self.now_s()
        rows = {n: r.last(int(span_s / self.period_s[n]) + 2) for n, r in self.rings.items()}
        return {n: s.between(now_s - span_s, now_s) for n, s in rows.items()}

    def _take(self) -> None:
        try:
            while not self._closed.is_set():
                self.gather(TAKE_S)
        except Exception as error:
            self.news.error = str(error)

    def _asks(self) -> None:
        receiver, told = self.device.receiver, ""
        while not self._closed.is_set():
            failed = ""
            try:
                self.ask()
            except Exception as error:
                if not receiver.away or receiver.error is not None:  # else lost_text tells
                    failed = str(error)
            if self.news.error == told:  # what has ended the rows stays
                self.news.error = told = failed
            if receiver.error is not None:
                return
            self._closed.wait(ASK_S)

    def close(self) -> None:
        """Let go; the connection and its recording go on."""
        self._closed.set()
        self.stopper.close()
        for thread in self._threads:
            thread.join(2.0)
        self.device.receiver.unsubscribe(self._queue)


def board_alarms(feed: LiveFeed) -> list[str]:
    """An error, a lost link and a latched fault, each in words."""
    news = feed.news
    lines = [news.error] if news.error else []
    if feed.silent:
        lines.append(feed.lost_text())
    if news.fault is not None:
        f = news.fault
        lines.append(f"Fault {f.number} {f.name}: {f.meaning}. What to do: {f.cure}.")
    return lines


def link_text(feed: LiveFeed) -> str:
    health = feed.news.health
    lost = [f"{health[k]} {said}" for k, said in COUNTED.items() if health.get(k)]
    return f"Link: {'none' if feed.silent else ', '.join(lost) or '0 messages lost'}"


@dataclass(frozen=True)
class Stretch:
    """Rows of a stream, oldest first; ``first`` rows had come before them."""

    first: int
    time_s: Floats
    rows: Array
    after_gap: npt.NDArray[np.bool_]

    def between(self, start_s: float, end_s: float) -> Stretch:
        """The part between two times, both included; no copy."""
        a = int(np.searchsorted(self.time_s, start_s - SAME_S, "left"))
        b = max(a, int(np.searchsorted(self.time_s, end_s + SAME_S, "right")))
        rows = self.rows[a:b]
        return Stretch(self.first + a, self.time_s[a:b], rows, self.after_gap[a:b])


class RowRing:
    """Keeps the newest rows of a stream; its memory is taken once and never grows."""

    def __init__(self, layout: StreamLayout, most_rows: int) -> None:
        self.layout, self.most_rows = layout, most_rows
        # Ones are written; zeros are only promised, and taken page by page until the ring is full.
        self._rows = np.ones(most_rows * layout.dtype.itemsize, np.uint8).view(layout.dtype)
        # Rows whole, not column by column: thirty times as fast.
        self._whole = self._rows.view(f"V{layout.dtype.itemsize}")
        self._time_s = np.ones(most_rows)
        self._after_gap = np.ones(most_rows, bool)
        self._lock = threading.Lock()
        self.total = 0

    @property
    def nbytes(self) -> int:
        return self._rows.nbytes + self._time_s.nbytes + self._after_gap.nbytes

    def extend(self, batch: Batch) -> None:
        after_gap = np.zeros(len(batch.rows), bool)
        for gap in batch.gaps:
            after_gap |= batch.rows["sequence"] == gap.before_tick
        kept = slice(max(0, len(batch.rows) - self.most_rows), None)
        with self._lock:
            self.total += len(batch.rows)
            count = len(batch.rows[kept])
            places = np.arange(self.total - count, self.total) % self.most_rows
            self._whole[places] = batch.rows[kept].view(self._whole.dtype)
            self._time_s[places] = batch.board_ns[kept] * 1e-9
            self._after_gap[places] = after_gap[kept]

    def last(self, rows: int | None = None) -> Stretch:
        with self._lock:
            held = min(self.total, self.most_rows)
            count = held if rows is None else min(rows, held)
            first = self.total - count
            start = first % self.most_rows
            parts = slice(start, start + count), slice(0, max(0, start + count - self.most_rows))
            held_in = self._time_s, self._whole, self._after_gap
            time_s, whole, gaps = (np.concatenate([a[p] for p in parts]) for a in held_in)
            return Stretch(first, time_s, whole.view(self.layout.dtype), gaps)

    def newest(self) -> Array | None:
        with self._lock:
            return self._rows[(self.total - 1) % self.most_rows].copy() if self.total else None


def curve(stretch: Stretch, values: Floats, most_points: int) -> tuple[Floats, Floats]:
    """A curve of at most so many points that shows every peak, and every gap as a hole."""
    broken = np.flatnonzero(stretch.after_gap[1:]) + 1
    group = -(-len(values) * 2 // most_points) if len(values) else 1
    if group <= 2:
        holes = np.full(len(broken), np.nan)
        return np.insert(stretch.time_s, broken, holes), np.insert(values, broken, holes)
    start = -stretch.first % group
    count = (len(values) - start) // group
    part = slice(start, start + count * group)
    folded = values[part].reshape(count, group)
    time_s = stretch.time_s[part].reshape(count, group)
    drawn = np.stack([folded.min(1), folded.max(1)], axis=1)
    # The group that a gap falls into is left out: it would be bridged.
    drawn[stretch.after_gap[part].reshape(count, group).any(1)] = np.nan
    return np.stack([time_s[:, 0], time_s[:, -1]], axis=1).ravel(), drawn.ravel()


def spans(time_s: Floats, held: Array, joined_s: float) -> list[tuple[float, float]]:
    """Intervals in which something was true; gaps below ``joined_s`` are closed."""
    edges = np.flatnonzero(np.diff(held.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    if not len(edges):
        return []
    starts, ends = time_s[edges[:, 0]], time_s[edges[:, 1] - 1]
    apart = starts[1:] - ends[:-1] > joined_s
    firsts, lasts = starts[np.r_[True, apart]], np.maximum(ends, starts)[np.r_[apart, True]]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))
