"""Trigger as on an oscilloscope: freeze the picture where a signal crosses a level."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from PySide6.QtWidgets import QWidget

from esea_host.windows.feed import Floats, Stretch
from esea_host.windows.frame import labelled, push_button, row_of
from esea_host.windows.number_field import Choice, NumberField
from esea_host.windows.signals import ShownSignal

BEFORE = 0.2  # of the time that is shown, before the crossing
OFF, NORMAL, SINGLE = "off", "normal", "single"
MODES = (OFF, NORMAL, SINGLE)


def crossings(stretch: Stretch, values: Floats, level: float, rising: bool) -> Floats:
    """When a signal crosses a level in one direction, between its samples; never across a gap."""
    above = values >= level
    after = above[1:] & ~above[:-1] if rising else above[:-1] & ~above[1:]
    after &= ~stretch.after_gap[1:] & np.isfinite(values[1:]) & np.isfinite(values[:-1])
    at = np.flatnonzero(after)
    share = (level - values[at]) / (values[at + 1] - values[at])
    time_s = stretch.time_s
    return np.asarray(time_s[at] + share * (time_s[at + 1] - time_s[at]))


@dataclass
class Trigger:
    """normal: each crossing with a complete picture; single: the next; last_s: NaN before."""

    mode: str = OFF
    level: float = 0.0
    rising: bool = True
    last_s: float = math.nan
    done: bool = False

    @property
    def on(self) -> bool:
        return self.mode != OFF

    def arm(self, now_s: float) -> None:
        self.done, self.last_s, self._from_s = False, math.nan, now_s

    _from_s: float = -math.inf

    def look(self, stretch: Stretch, values: Floats, window_s: float) -> float:
        """Crossing to show now: the newest with a complete picture."""
        if self.done or not len(values):
            return self.last_s
        whole_s = stretch.time_s[-1] - (1 - BEFORE) * window_s
        found = crossings(stretch, values, self.level, self.rising)
        found = found[(found > self._from_s) & (found <= whole_s)]
        if len(found):
            self.last_s = float(found[0] if self.mode == SINGLE else found[-1])
            # A picture is not begun again before it has been seen to its end.
            self._from_s = self.last_s + (1 - BEFORE) * window_s
            self.done = self.mode == SINGLE
        return self.last_s

    def shown_s(self, window_s: float) -> tuple[float, float]:
        return self.last_s - BEFORE * window_s, self.last_s + (1 - BEFORE) * window_s

    def said(self) -> str:
        edge = "rises" if self.rising else "falls"
        if not self.on:
            return ""
        if math.isnan(self.last_s):
            return f"TRIGGER waits: {edge} through {self.level:g}"
        return f"trigger at {self.last_s:.3f} s{', held' if self.done else ''}"


class TriggerBar(QWidget):
    def __init__(
        self, trigger: Trigger, signals: list[ShownSignal], now: Callable[[], float]
    ) -> None:
        super().__init__()
        self.trigger, self._now = trigger, now
        self.source, self.mode, self.edge = Choice(), Choice(), Choice()
        self.level = NumberField(-1e6, 1e6, 0.1)
        self.mode.addItems(list(MODES))
        self.edge.setAccessibleName("edge")
        self.edge.addItems(["rises", "falls"])
        self.again = push_button("Again", self.apply)
        fields = self.mode, self.source, self.level
        mode, when, through = map(labelled, ("Trigger", "when", "through"), fields)
        ends = (self.level.box, self.again, (QWidget(), 1))
        row = row_of(mode, self.mode, when, self.source, self.edge, through, *ends)
        row.setContentsMargins(4, 0, 4, 0)
        self.setLayout(row)
        self.offer(signals)
        for signal in (self.mode.currentIndexChanged, self.edge.currentIndexChanged):
            signal.connect(self.apply)
        self.source.currentIndexChanged.connect(self.apply)
        self.level.valueChanged.connect(self.apply)

    def offer(self, signals: list[ShownSignal]) -> None:
        """Signals to choose from; the chosen one stays where it still is there."""
        self._signals, before = signals, self.source.currentText()
        place = max(0, self.source.currentIndex())
        self.source.blockSignals(True)
        self.source.clear()
        self.source.addItems([s.name for s in signals])
        found = self.source.findText(before)
        self.source.setCurrentIndex(min(place, len(signals) - 1) if found < 0 else found)
        self.source.blockSignals(False)
        if found < 0:  # another axis' in its place
            self.apply()

    @property
    def signal(self) -> ShownSignal:
        return self._signals[max(0, self.source.currentIndex())]

    def apply(self, *_: object) -> None:
        t = self.trigger
        self.level.setSuffix(f" {self.signal.unit}")
        t.mode, t.level = self.mode.currentText() or OFF, self.level.value()
        t.rising = self.edge.currentIndex() == 0
        self.again.setEnabled(t.mode == SINGLE)
        t.arm(self._now())
