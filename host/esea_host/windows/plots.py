"""The plots of the live view: curves over time, which limit acts, and torque over deflection."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt

from esea_host.windows.history import Floats, Stretch, curve, spans
from esea_host.windows.meanings import LimitFlag
from esea_host.windows.theme import Theme

MOST_POINTS = 1400  # of a curve: two for each column of pixels
MOST_BANDS, AXIS_PX, BANDS_PX = 6, 140, 150
DEG = 180 / math.pi
Shown = Mapping[str, Stretch]


@dataclass(frozen=True)
class ShownSignal:
    stream: str
    column: str
    label: str
    unit: str
    scale: float = 1.0

    @property
    def name(self) -> str:
        return f"{self.stream}.{self.column}"

    def values(self, shown: Shown) -> Floats:
        return np.asarray(shown[self.stream].rows[self.column], np.float64) * self.scale


def signal_of(stream: str, column: str, unit: str, label: str = "") -> ShownSignal:
    """A signal; angles in degrees."""
    if unit.startswith("rad"):
        name = (label or column).replace("_rad", "_deg")
        return ShownSignal(stream, column, name, unit.replace("rad", "deg", 1), DEG)
    return ShownSignal(stream, column, label or column, "" if unit == "1" else unit)


class TimePlot:
    def __init__(self, area: Any, row: int, title: str, unit: str) -> None:
        self.item = area.addPlot(row=row, col=0)
        self.title, self.unit = title, unit
        self.item.setMenuEnabled(False)
        self.item.hideButtons()
        self.item.getAxis("bottom").setStyle(showValues=False)
        self.item.getAxis("left").setWidth(AXIS_PX)
        self.signals: list[ShownSignal] = []
        self._curves: list[Any] = []
        self.cursors = [pg.InfiniteLine(angle=90, movable=True) for _ in range(2)]
        for line in self.cursors:
            line.setVisible(False)
            self.item.addItem(line, ignoreBounds=True)

    def show(self, signals: list[ShownSignal], theme: Theme, colours: list[str]) -> None:
        for drawn in self._curves:
            self.item.removeItem(drawn)
        self.signals = signals
        # The lowest of several is wider: where two agree, both are seen.  Wide lines are slow.
        widths = [3.0 if i == 0 and len(signals) > 1 else 1.0 for i in range(len(signals))]
        self._curves = [
            self.item.plot(pen=pg.mkPen(c, width=w), connect="finite", antialias=True)
            for c, w in zip(colours, widths, strict=True)
        ]
        said = " &nbsp; ".join(
            f'<span style="color:{c}">&#9473; {escape(s.label)}</span>'
            for s, c in zip(signals, colours, strict=True)
        )
        self.item.setTitle(f"<b>{self.title}</b> &nbsp; {said}", color=theme.ink, size="9pt")
        self.item.setLabel("left", escape(self.unit), color=theme.ink)
        dress(self.item, theme)
        for line in self.cursors:
            line.setPen(pg.mkPen(theme.ink, style=Qt.PenStyle.DashLine))

    def draw(self, shown: Shown) -> None:
        for signal, drawn in zip(self.signals, self._curves, strict=True):
            time_s, values = curve(shown[signal.stream], signal.values(shown), MOST_POINTS)
            drawn.setData(time_s, values)

    def at(self, time_s: float, shown: Shown) -> list[str]:
        found = []
        for signal in self.signals:
            times = shown[signal.stream].time_s
            if len(times) and times[0] <= time_s <= times[-1] + 0.01:
                i = min(int(np.searchsorted(times, time_s)), len(times) - 1)
                found.append(f"{signal.label} {signal.values(shown)[i]:.4g} {signal.unit}")
        return found


class LimitBands:
    """When which limit acted: a row each, of those that did."""

    def __init__(self, area: Any, row: int, flags: list[tuple[str, LimitFlag]], title: str) -> None:
        self.item = area.addPlot(row=row, col=0)
        self.item.setMenuEnabled(False)
        self.item.hideButtons()
        self.item.getAxis("left").setWidth(AXIS_PX)
        self.item.setMouseEnabled(y=False)
        self.item.setYRange(-0.6, MOST_BANDS - 0.4, padding=0)
        self.item.invertY(True)
        area.ci.layout.setRowMinimumHeight(row, BANDS_PX)  # so that the names stay apart
        self.flags, self.title = flags, title
        self._bands = self.item.plot(connect="pairs")
        self._names: list[tuple[int, str]] = []
        self.item.getAxis("left").setTicks([[]])

    def show(self, theme: Theme) -> None:
        pen = pg.mkPen(theme.limit, width=9)
        pen.setCapStyle(Qt.PenCapStyle.FlatCap)
        self._bands.setPen(pen)
        self.item.setTitle(f"<b>{self.title}</b>", color=theme.ink, size="9pt")
        self.item.setLabel("bottom", "time on the board's clock [s]", color=theme.ink)
        dress(self.item, theme)

    def acting(self, shown: Shown) -> list[LimitFlag]:
        return [f for s, f in self.flags if len(shown[s].rows) and f.held(shown[s].rows[-1:])[0]]

    def draw(self, shown: Shown, left_s: float, right_s: float) -> None:
        """Draw those that acted between two times; the latest to begin come first."""
        x: list[float] = []
        y: list[float] = []
        found = []
        for stream, flag in self.flags:
            part = shown[stream]
            seen = flag.held(part.rows) & (part.time_s >= left_s) & (part.time_s <= right_s)
            if seen.any():
                joined_s = (right_s - left_s) / 500
                found.append((spans(part.time_s, seen, joined_s), flag))
        found.sort(key=lambda one: -one[0][-1][1])
        least_s = (right_s - left_s) / 300
        del found[MOST_BANDS:]
        for row, (stretches, _) in enumerate(found):
            for start_s, end_s in stretches:
                x += [start_s, max(end_s, start_s + least_s)]
                y += [row, row]
        names = [(row, flag.name) for row, (_, flag) in enumerate(found)]
        if names != self._names:
            self._names = names
            self.item.getAxis("left").setTicks([names])
        self._bands.setData(np.array(x), np.array(y))


class LoopPlot:
    def __init__(self, area: Any, x: ShownSignal, y: ShownSignal) -> None:
        self.item = area.addPlot(row=0, col=0)
        self.item.setMenuEnabled(False)
        self.item.hideButtons()
        self.x, self.y = x, y
        self._past, self._now = self.item.plot(antialias=True), self.item.plot()

    def show(self, theme: Theme) -> None:
        self._past.setPen(pg.mkPen(theme.measured, width=1))
        self._now.setSymbol("o")
        self._now.setSymbolBrush(theme.measured)
        self._now.setSymbolPen(theme.ink)
        self.item.setTitle("<b>Torque over deflection</b>", color=theme.ink, size="9pt")
        self.item.setLabel("bottom", escape(f"{self.x.label} [{self.x.unit}]"), color=theme.ink)
        self.item.setLabel("left", escape(f"{self.y.label} [{self.y.unit}]"), color=theme.ink)
        dress(self.item, theme)

    def draw(self, shown: Shown) -> None:
        """Draw what has come; here rows are thinned, for a peak has two values."""
        part = shown[self.x.stream]
        step = max(1, len(part.rows) // MOST_POINTS)
        x, y = self.x.values(shown)[::step], self.y.values(shown)[::step]
        self._past.setData(x, y)
        self._now.setData(x[-1:], y[-1:])


def dress(item: Any, theme: Theme) -> None:
    for side in ("top", "right"):
        # Not seen, but they would write their label anew whenever the range moves.
        item.getAxis(side).enableAutoSIPrefix(False)
    for side in ("left", "bottom"):
        axis = item.getAxis(side)
        axis.setPen(theme.soft)
        axis.setTextPen(theme.ink)
        # Numbers in the unit that stands there, whatever their size: the switch alone does not do.
        axis.setSIPrefixEnableRanges(())
        axis.enableAutoSIPrefix(False)
        # Half the time of a picture went into finer lines.
        axis.setStyle(maxTickLevel=0)
    item.showGrid(x=True, y=True, alpha=theme.grid_alpha)
