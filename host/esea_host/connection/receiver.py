"""Receiver thread: read, decode and distribute without waiting for readers.

Each subscriber has a bounded queue; a full queue drops new rows and reports it.  Missing rows
become a :class:`Gap`, with the reason from the counters.
"""

from __future__ import annotations

import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace

import numpy as np

from esea_gen.link.frames import LinkHealth
from esea_gen.link.streams import BoardStream
from esea_gen.link.transport import LinkError, Transport
from esea_host.connection.decoder import TICK, Decoded, TelemetryDecoder
from esea_host.recording.integrity import Gap
from esea_host.recording.layout import Array, StreamLayout

MOST_ROWS = 60_000  # a minute at 1 kHz
READ_S = 0.05
KEY = "key"  # a stream whose rows are parts of a frame
_DATA = struct.Struct("<QIHBBB")  # device clock, tick, interval, stream, choice, samples


@dataclass(frozen=True)
class Batch:
    """Rows of a stream that came together, and the holes before and between them."""

    layout: StreamLayout
    rows: Array
    board_ns: Array  # on the board's clock; it goes on where the board's ticks start again at 0
    arrived_ns: int  # since 1970, as :meth:`Receiver.now_ns`
    gaps: tuple[Gap, ...] = ()


class Subscription:
    """A queue of batches for one reader; filling it never waits."""

    def __init__(self, streams: Collection[str] | None = None, most_rows: int = MOST_ROWS) -> None:
        self.streams = None if streams is None else frozenset(streams)
        self.most_rows, self.dropped_rows = most_rows, 0
        self._held, self._full = 0, False
        self._batches: deque[Batch] = deque()
        self._lost: dict[str, Gap] = {}
        self._last: dict[str, tuple[int, int]] = {}
        self._changed = threading.Condition()
        self._error: Exception | None = None

    def put(self, batch: Batch) -> None:
        name = batch.layout.name
        if self.streams is not None and name not in self.streams:
            return
        with self._changed:
            last = int(batch.rows[TICK][-1]), int(batch.board_ns[-1])
            self._full = self._full or self._held + len(batch.rows) > self.most_rows
            if self._full:
                self.dropped_rows += len(batch.rows)
                tick, ns = self._last.get(name, (-1, -1))
                lost = self._lost.get(name) or Gap(name, tick, -1, 0, "host", ns)
                self._lost[name] = replace(lost, missing=lost.missing + len(batch.rows))
                return
            if name in self._lost:
                gap = replace(self._lost.pop(name), before_tick=int(batch.rows[TICK][0]))
                batch = replace(batch, gaps=(gap, *batch.gaps))
            self._last[name] = last
            self._held += len(batch.rows)
            self._batches.append(batch)
            self._changed.notify()

    def lost(self) -> tuple[Gap, ...]:
        """Rows dropped since then, of streams without newer rows."""
        with self._changed:
            found = tuple(self._lost.values())
            self._lost.clear()
            return found

    def fail(self, error: Exception) -> None:
        """Nothing more will come: the reader hears why."""
        with self._changed:
            self._error = error
            self._changed.notify_all()

    def take(self, timeout_s: float) -> list[Batch]:
        with self._changed:
            if not self._batches and self._error is None and timeout_s > 0:
                self._changed.wait(timeout_s)
            if not self._batches and self._error is not None:
                raise self._error
            found = list(self._batches)
            self._batches.clear()
            self._held, self._full = 0, False
            return found


@dataclass(frozen=True)
class NamedStream:
    """Values that a board was asked for by name and rate (ESEA_DATA), and their rows' layout."""

    layout: StreamLayout
    board: BoardStream

    def rows(self, payload: bytes) -> Array:
        """Rows of one message, by their bits."""
        _, tick, interval, _, _, count = _DATA.unpack_from(payload)
        width = len(self.layout.columns) - 1
        words = np.frombuffer(payload, "<u4", count * width, _DATA.size).reshape(count, width)
        packed = np.empty((count, width + 1), "<u4")
        packed[:, 0] = (tick + interval * np.arange(count, dtype=np.int64)) & 0xFFFFFFFF
        packed[:, 1:] = words
        return packed.view(self.layout.dtype).reshape(count)


class Receiver(Transport):
    """Reads a link in a thread of its own; to a session it is the link, less the telemetry."""

    def __init__(
        self,
        transport: Transport,
        decoder: TelemetryDecoder,
        tick_ns: int,
        reopen: Callable[[], Transport] | None = None,
    ) -> None:
        self.transport, self.decoder, self.tick_ns = transport, decoder, tick_ns
        self._reopen = reopen
        self.reconnects = 0
        self.on_reconnect: Callable[[], None] | None = None
        self.keep_alive: Callable[[], bytes] | None = None
        self.keep_alive_s = 0.25
        self.error: Exception | None = None
        # Since when the link is broken, and why it still is; whether the board has started since.
        self.away, self.away_since_ns, self.away_why, self.restarted = False, 0, "", False
        self.breaks = 0
        self.asked_by: tuple[int, int] | None = None
        self.gap_count = 0
        self._subscriptions: list[Subscription] = []
        self._others = bytearray()
        self._changed = threading.Condition()
        self._writing = threading.Lock()
        self._thread: threading.Thread | None = None
        self._stopped = threading.Event()
        self.clock = _StreamClocks(tick_ns)
        self._told_s = 0.0
        self.named: dict[tuple[int, int], NamedStream] = {}
        self._epoch_ns = _wall_ahead_ns()

    def now_ns(self) -> int:
        """The wall clock at the connection, carried on by the monotonic clock: nobody sets it."""
        return self._epoch_ns + time.monotonic_ns()

    def wall_ahead_ns(self) -> int:
        """By how much the wall clock is ahead of :meth:`now_ns`: 0 until somebody sets it."""
        return _wall_ahead_ns() - self._epoch_ns

    @property
    def health(self) -> LinkHealth:
        return self.decoder.health

    def subscribe(
        self, streams: Collection[str] | None = None, most_rows: int = MOST_ROWS
    ) -> Subscription:
        """A queue of its own; None: every stream."""
        made = Subscription(streams, most_rows)
        if self.error is not None:
            made.fail(self.error)
        self._subscriptions = [*self._subscriptions, made]
        return made

    def unsubscribe(self, subscription: Subscription) -> None:
        self._subscriptions = [s for s in self._subscriptions if s is not subscription]

    def start(self) -> None:
        # A terminal holds 4 kB, some 10 ms of two axes: whatever else is computed, it is read soon.
        sys.setswitchinterval(5e-4)
        self._thread = threading.Thread(target=self._run, name="esea-receiver", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stopped.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(2.0)
        self.transport.close()
        self._fail(LinkError("the connection was closed"))

    def away_text(self) -> str:
        """Since when the link is broken, and why."""
        seconds = (self.now_ns() - self.away_since_ns) * 1e-9
        since = time.strftime("%H:%M:%S", time.localtime(time.time() - seconds))
        return f"No link since {since} ({seconds:.0f} s): {self.away_why}"

    @contextmanager
    def asking(self) -> Iterator[None]:
        """Make this thread's requests to the board fail if the link breaks meanwhile.

        No command that was meant for the time before is sent after a reconnection.
        """
        before = self.asked_by
        self.asked_by = before or (threading.get_ident(), self.breaks)
        try:
            yield
        finally:
            self.asked_by = before

    def _cut(self) -> bool:
        asking, me = self.asked_by, threading.get_ident()
        return asking is not None and asking[0] == me and asking[1] != self.breaks

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send bytes; whole frames do not mix."""
        with self._writing:
            try:
                if not (self.away or self._cut()):
                    self.transport.write(data, timeout_s)
                    return
            except LinkError:
                if not self.away:
                    raise
        raise LinkError(self.away_text(), "Try again when the link is back.")

    def said(self) -> str:
        return self.transport.said()

    def read(self, timeout_s: float) -> bytes:
        """Frames that are no telemetry."""
        if self._thread is None:
            deadline_s = time.monotonic() + timeout_s
            while not self._others:
                self.pump(timeout_s)
                if time.monotonic() >= deadline_s:
                    break
        with self._changed:
            if not self._others and timeout_s > 0 and self._thread is not None:
                self._changed.wait_for(lambda: self._others or self.error or self._cut(), timeout_s)
            if self._cut() and self.error is None:
                raise LinkError(self.away_text(), "No answer came. Check the board's state.")
            if not self._others and self.error is not None:
                raise self.error
            data = bytes(self._others)
            self._others.clear()
        return data

    def pump(self, timeout_s: float) -> bool:
        """Read once and hand out; whether anything came."""
        data = self.transport.read(timeout_s)
        if data:
            self.take(data)
        return bool(data)

    def take(self, data: bytes) -> None:
        decoded, others = self.decoder.feed(data)
        now = self.now_ns()
        if self.named:
            decoded += self._of_named()
        for found in decoded:
            batch = self.clock.batch(found, now, self.health)
            if batch is not None:
                self.hand_out(batch)
        if others:
            with self._changed:
                self._others += others
                self._changed.notify_all()

    def hand_out(self, batch: Batch) -> None:
        self.gap_count += len(batch.gaps)
        for subscription in self._subscriptions:
            subscription.put(batch)

    def add_named(self, stream: NamedStream, number: int) -> None:
        """Make rows of a stream that the board was asked for by names."""
        self.decoder.keep_back(number)
        self.clock.expect(stream.layout.name, stream.board.interval)
        self.named = {**self.named, (stream.board.number, stream.board.choice): stream}

    def _of_named(self) -> list[Decoded]:
        found: dict[tuple[int, int], tuple[list[Array], list[tuple[int, int, int]]]] = {}
        for payload, lost, bad in self.decoder.kept_back():
            key = payload[14], payload[15]
            if key in self.named:
                rows, counted = found.setdefault(key, ([], []))
                counted.append((sum(map(len, rows)), lost, bad))
                rows.append(self.named[key].rows(payload))
        return [
            Decoded(self.named[key].layout, np.concatenate(rows), counted, [])
            for key, (rows, counted) in found.items()
        ]

    def _run(self) -> None:
        while not self._stopped.is_set():
            try:
                self.pump(READ_S)
                now_s = time.monotonic()
                if self.keep_alive is not None and now_s - self._told_s >= self.keep_alive_s:
                    self._told_s = now_s
                    self.write(self.keep_alive(), 1.0)
            except LinkError as error:
                if self._stopped.is_set() or not self._open_again(error):
                    return
            except Exception as error:
                self.away = True
                self._fail(error)
                return

    def _open_again(self, error: LinkError) -> bool:
        self.away_since_ns, self.away_why = self.now_ns(), error.what
        self.breaks += 1
        self.away = True
        with self._changed:
            self._changed.notify_all()
        if self._reopen is None:
            self._fail(error)
            return False
        try:
            with suppress(OSError):  # what is broken may not close either
                self.transport.close()
            self.transport = self._reopen()
        except Exception as final:
            self._fail(final)
            return False
        self.away = False
        self.reconnects += 1
        self.decoder.forget()
        with self._changed:
            self._others.clear()  # the board's state of before
        self.clock.broken(self.now_ns() - self.away_since_ns, self.restarted)
        if self.on_reconnect is not None:
            self.on_reconnect()
        return True

    def _fail(self, error: Exception) -> None:
        if self.error is None:
            self.error = error
        with self._changed:
            self._changed.notify_all()
        for subscription in self._subscriptions:
            subscription.fail(self.error)


def _wall_ahead_ns() -> int:
    # Of the monotonic clock; of several readings the one with the least time between.
    readings = [(time.monotonic_ns(), time.time_ns(), time.monotonic_ns()) for _ in range(5)]
    before, wall, after = min(readings, key=lambda r: r[2] - r[0])
    return wall - (before + after) // 2


class _StreamClocks:
    # Where each stream is: its last tick, its period, and how far the board's clock has been moved.

    def __init__(self, tick_ns: int) -> None:
        self.tick_ns = tick_ns
        self._last: dict[str, int] = {}
        # Ticks between runs: as requested, else learnt; 0: no run is missed.
        self._every: dict[str, int] = {}
        self._requested: dict[str, int] = {}  # from the next run on
        self._lost: dict[str, tuple[int, int]] = {}
        # Of every start of the board's clock: ticks of all before it, and its last one so far.
        self._moved, self._last_tick = [0], [-1]
        self._epochs: dict[str, int] = {}
        self._broken: set[str] = set()
        self._restarted: set[str] = set()
        self._away_ticks = 0

    def broken(self, away_ns: int, restarted: bool) -> None:
        """restarted: the board's clock has started again, even if it is ahead of the last tick."""
        self._broken = set(self._last)
        self._restarted = set(self._last) if restarted else set()
        self._away_ticks = away_ns // self.tick_ns

    def expect(self, name: str, every: int) -> None:
        """Base ticks between a stream's runs from the next one on; 0: they are about to change."""
        self._every[name] = 0
        if every:
            self._requested[name] = every

    def batch(self, found: Decoded, arrived_ns: int, health: LinkHealth) -> Batch | None:
        name = found.layout.name
        ticks = found.rows[TICK].astype(np.int64)
        last = self._last.get(name)
        if name == KEY:
            return self._parts(found, arrived_ns)
        self._epochs.setdefault(name, len(self._moved) - 1)
        steps = np.diff(ticks, prepend=ticks[0] - 1 if last is None else last)
        every = self._every.get(name)
        if every is None and (every := _period(steps if last is not None else steps[1:])):
            self._every[name] = every
        going_on = last is not None and every and name not in self._broken
        if going_on and not found.late_rows and (steps == every).all():
            self._last[name], self._lost[name] = int(ticks[-1]), found.changes[-1][1:]
            return Batch(found.layout, found.rows, self._board_ns(name, ticks), arrived_ns)
        return self._one_by_one(found, arrived_ns, health)

    def _board_ns(self, name: str, ticks: Array) -> Array:
        epoch = self._epochs[name]
        self._last_tick[epoch] = max(self._last_tick[epoch], int(ticks[-1]))
        return np.asarray((ticks + self._moved[epoch]) * self.tick_ns)

    def _parts(self, found: Decoded, arrived_ns: int) -> Batch:
        # Several rows of a tick, at no even distance.
        self._epochs.setdefault(KEY, len(self._moved) - 1)
        times = []
        firsts = found.rows["first"].tolist()
        for tick, first in zip(found.rows[TICK].tolist(), firsts, strict=True):
            # A tick has one frame: another one is of a clock that started again.
            again = tick < self._last.get(KEY, tick) or KEY in self._restarted
            if again or (first == 0 and tick == self._last.get(KEY)):
                self._start_again(KEY)
            self._last[KEY] = tick
            times.append(int(self._board_ns(KEY, np.array([tick]))[0]))
        return Batch(found.layout, found.rows, np.array(times, np.int64), arrived_ns)

    def _one_by_one(self, found: Decoded, arrived_ns: int, health: LinkHealth) -> Batch | None:
        name = found.layout.name
        kept: list[int] = []
        times: list[int] = []
        gaps: list[Gap] = []
        late, (losts, bads) = set(found.late_rows), (c.tolist() for c in found.counted())
        for i, tick in enumerate(found.rows[TICK].tolist()):
            last = self._last.get(name)
            again = name in self._restarted
            if last is not None and (tick <= last or again):
                if not again and (i in late or tick == last):
                    health.repeated_frames += 1
                    continue
                if name in self._broken:
                    ns = (last + self._moved[self._epochs[name]]) * self.tick_ns
                    gaps.append(Gap(name, last, tick, -1, "disconnected", ns))
                self._start_again(name)
                last = None
            lost, bad = losts[i], bads[i]
            every = self._every.get(name, 0)
            if last is not None and every and tick - last > every:
                before = self._lost.get(name, (0, 0))
                gaps.append(self._gap(name, last, tick, lost - before[0], bad - before[1]))
            self._last[name], self._lost[name] = tick, (lost, bad)
            if name in self._requested:
                self._every[name] = self._requested.pop(name)
            if name in self._broken:
                self._broken.discard(name)
                self._away_ticks = 0  # the first stream has moved the clock, or it goes on
            kept.append(i)
            times.append(int(self._board_ns(name, np.array([tick]))[0]))
        if not kept:
            return None
        times_ns = np.array(times, np.int64)
        return Batch(found.layout, found.rows[kept], times_ns, arrived_ns, tuple(gaps))

    def _start_again(self, name: str) -> None:
        # The first stream that shows it moves the clock; the others follow as they show it.
        self._restarted.discard(name)
        self._epochs[name] += 1
        if self._epochs[name] == len(self._moved):
            self._moved.append(self._moved[-1] + self._last_tick[-1] + 1 + self._away_ticks)
            self._last_tick.append(-1)

    def _gap(self, name: str, last: int, tick: int, lost: int, bad: int) -> Gap:
        reason = "disconnected" if name in self._broken else "board"
        if reason == "board" and lost:
            reason = "checksum" if bad else "link"
        missing = (tick - last) // self._every[name] - 1
        board_ns = (last + self._moved[self._epochs[name]]) * self.tick_ns
        return Gap(name, last, tick, missing, reason, board_ns)


def _period(steps: Array) -> int:
    # Most frequent distance; a stream's rate may be any.
    ahead = steps[steps > 0]
    return int(np.bincount(ahead).argmax()) if len(ahead) > 1 and ahead.max() < 1 << 20 else 0
