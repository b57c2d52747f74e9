"""The newest rows of several streams of a board, brought to one time."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable

import numpy as np

from esea_host.connection import ConnectedDevice
from esea_host.connection.decoder import TICK
from esea_host.connection.receiver import Batch
from esea_host.recording.layout import Array
from esea_host.study.fitting import Tap

ASKED = 8  # for the tick, before each trial


class LatestRows:
    """What a board told last, in whichever of its streams a signal is."""

    def __init__(self, device: ConnectedDevice, always: Iterable[Tap]) -> None:
        self._device, self._always = device, {tap.stream for tap in always}
        self._needed = set(self._always)
        self._queue = device.subscribe([s for s in device.streams if s.endswith("_out")])
        self._waiting: dict[str, list[Batch]] = {}
        self._last_tick: dict[str, int] = {}
        self._new: dict[str, Array] = {}
        self._tick_s, self._zero_s = device.receiver.tick_ns * 1e-9, math.nan
        self.board_ns = self.tick = 0
        self.taken_s: float | None = None
        self.began_again = False

    @property
    def streams(self) -> list[str]:
        return sorted(self._needed)

    def need(self, taps: Iterable[Tap]) -> None:
        self._needed = self._always | {tap.stream for tap in taps}
        self._device.listen(sorted(self._needed))
        if self._device.address is not None:  # else somebody moves its clock by hand
            self._compare_clocks()

    def _compare_clocks(self) -> None:
        # Of several answers the fastest: halfway it was that tick.
        found = []
        for _ in range(ASKED):
            asked_s = time.monotonic()
            tick = self._device.clock()["tick"]
            answered_s = time.monotonic()
            middle_s = (asked_s + answered_s) / 2
            found.append((answered_s - asked_s, middle_s - tick * self._tick_s))
        self._zero_s = min(found)[1]

    def start(self) -> None:
        self._queue.take(0.0)
        self._waiting, self._last_tick, self.began_again = {}, {}, False

    def take(self, timeout_s: float, due_ns: int) -> None:
        """Take in what has come, and go on to its end where that is at or after a time."""
        for batch in self._queue.take(timeout_s):
            name, ticks = batch.layout.name, batch.rows[TICK]
            if int(ticks[0]) <= self._last_tick.get(name, -1) or (ticks[1:] < ticks[:-1]).any():
                self.began_again = True
            self._last_tick[name] = int(ticks[-1])
            self._waiting.setdefault(name, []).append(batch)
        ends = [int(b[-1].board_ns[-1]) if (b := self._waiting.get(s)) else 0 for s in self._needed]
        if (now_ns := min(ends, default=0)) >= due_ns:
            self._go_on(now_ns)

    def _go_on(self, now_ns: int) -> None:
        for name, batches in self._waiting.items():
            if not batches:  # a stream beside those that are needed
                continue
            rows = np.concatenate([b.rows for b in batches])
            times = np.concatenate([b.board_ns for b in batches])
            count = int(np.searchsorted(times, now_ns, "right"))
            self._waiting[name] = []
            if count:
                self._new[name] = rows[:count]
            if count < len(rows):
                left = Batch(
                    batches[-1].layout, rows[count:], times[count:], batches[-1].arrived_ns
                )
                self._waiting[name] = [left]
        self.board_ns = now_ns
        self.tick = max(int(self._new[s][TICK][-1]) for s in self._needed)
        if self._device.address is None:
            self.taken_s = time.monotonic()
        elif math.isfinite(self._zero_s):
            self.taken_s = self._zero_s + self.tick * self._tick_s

    def value(self, tap: Tap) -> float:
        rows = self._new.get(tap.stream)
        return 0.0 if rows is None else tap.factor * float(rows[tap.column][-1])

    def differ(self, tap: Tap, value: float) -> bool:
        """Whether it was another one at any time since the moment before."""
        return bool(np.any(self._new[tap.stream][tap.column] != value))

    def close(self) -> None:
        self._device.receiver.unsubscribe(self._queue)
