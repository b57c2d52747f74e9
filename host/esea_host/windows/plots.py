"""The plots of the live view: curves, cursors, acting limits, torque over deflection, spectrum."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import partial
from html import escape
from typing import Any, ClassVar

import numpy as np
import pyqtgraph as pg
import scipy  # its parts are read on first use
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel

from esea_host.windows.feed import Floats, Stretch, curve, spans
from esea_host.windows.frame import coloured
from esea_host.windows.meanings import LimitFlag
from esea_host.windows.signals import Shown, ShownSignal
from esea_host.windows.theme import Theme

MOST_POINTS = 1400  # of a curve: two for each column of pixels
MOST_ROWS, LEAST_ROWS, LEAST_PX = 8192, 64, 230  # of a spectrum, and its height
MOST_BANDS, LEAST_AXIS_PX, BANDS_PX, PANEL_PX = 4, 60, 112, 66
NUMBER_PX, MOST_TICKS = 12, 6  # from number to number of an axis, above each other
LEAST_SPAN = {"Nm": 0.1, "deg": 0.5}  # of an axis, that noise at rest does not fill it
FADES, MEAN_ROWS = 8, 100  # steps in which the past fades; of the line, beside the encoders' steps
LOOP = (("theta_rad", "rad", "deflection"), ("tau_Nm", "Nm", "measured torque"))


def legend(named: Iterable[tuple[str, str]]) -> str:
    """Names with their colours, for a title."""
    return " &nbsp; ".join(coloured(f"\u2501 {name}", colour) for name, colour in named)


def _apart(low: float, high: float, size_px: float) -> list[tuple[float, float]]:
    # No two numbers on each other; steps of one digit, for numbers are rounded to it.
    least = (high - low) * max(NUMBER_PX / max(size_px, 1), 1 / MOST_TICKS)
    if not 0 < least < math.inf:
        return []
    digit = 10.0 ** math.floor(math.log10(least))
    at = [k * digit for k in (1, 2, 4, 5, 8, 10, 20) if k * digit >= least]
    usual = next(x for x in at if round(x / digit) not in (4, 8))
    return [(usual if 2 * usual <= high - low else at[0], 0.0)]


class PlotPanel:
    """A plot without menus, in the colours of a theme."""

    def __init__(self, item: Any, title: str, bottom: str = "", left: str = "") -> None:
        self.item, self.title, self.bottom, self.left = item, title, bottom, left
        item.setMenuEnabled(False)
        item.hideButtons()
        # A long title is cut at its end; it would widen the plot beyond its view.
        item.titleLabel.setAttr("justify", "left")
        item.titleLabel.updateMin = lambda: None
        item.getAxis("left").tickSpacing = _apart

    def dress(self, theme: Theme, more: str = "") -> None:
        """Title with its suffix, labels, axes and grid."""
        self.item.setTitle(f"<b>{self.title}</b>{more}", color=theme.ink, size="9pt")
        view = self.item.getViewWidget()
        if self.title not in (names := view.accessibleName()):
            view.setAccessibleName(f"{names}, {self.title}".removeprefix(", "))
        # As high as its letters: the curves need the rest.
        height_px = self.item.titleLabel.itemRect().height()
        self.item.layout.setRowFixedHeight(0, height_px)
        for side, label in (("bottom", self.bottom), ("left", self.left)):
            axis = self.item.getAxis(side)
            if label or axis.labelText:
                self.item.setLabel(side, escape(label), color=theme.ink)
            axis.setPen(theme.soft)
            axis.setTextPen(theme.ink)
            # Numbers in the unit that stands there, whatever their size: the switch alone does not.
            axis.setSIPrefixEnableRanges(())
            axis.enableAutoSIPrefix(False)
            # Half the time of a picture went into finer lines.
            axis.setStyle(maxTickLevel=0)
        for side in ("top", "right"):
            # Not seen, but they would write their label anew whenever the range moves.
            self.item.getAxis(side).enableAutoSIPrefix(False)
        self.item.showGrid(x=True, y=True, alpha=theme.grid_alpha)


class SignalPlot(PlotPanel):
    # The lowest of several is wider: where two agree, both are seen.  Wide lines are slow.
    LOWEST_WIDTH = 3.0
    CURVE: ClassVar[Mapping[str, Any]] = {"connect": "finite", "antialias": True}

    def __init__(self, item: Any, title: str, bottom: str = "", left: str = "") -> None:
        super().__init__(item, title, bottom, left)
        self.unit = ""  # beside the title: the numbers' axis is wide
        self.signals: list[ShownSignal] = []
        self.curves: list[Any] = []

    def show(self, signals: list[ShownSignal], theme: Theme, colours: list[str]) -> None:
        """Draw these from now on, the last on top."""
        for drawn in self.curves:
            self.item.removeItem(drawn)
        self.signals = signals
        widths = [self.LOWEST_WIDTH if len(signals) > 1 else 1.0] + [1.0] * len(signals)
        self.curves = [
            self.item.plot(pen=pg.mkPen(c, width=w), **self.CURVE)
            for c, w in zip(colours, widths, strict=False)
        ]
        labels = [s.label for s in signals]
        unit = f" [{self.unit}]" if self.unit else ""
        self.dress(theme, f"{escape(unit)} &nbsp; {legend(zip(labels, colours, strict=True))}")


class TimePlot(SignalPlot):
    """Signals over time, in one plot of a column of them."""

    def __init__(self, area: Any, row: int, title: str, unit: str) -> None:
        super().__init__(area.addPlot(row=row, col=0), title)
        self.unit = unit
        self.item.getAxis("bottom").setStyle(showValues=False)
        self.limit_lines = [pg.InfiniteLine(angle=0) for _ in range(2)]
        for line in self.limit_lines:
            line.setVisible(False)
            # Where the curve comes near, and not to make it small.
            self.item.addItem(line, ignoreBounds=True)
        self.item.vb.setLimits(minYRange=LEAST_SPAN.get(unit))
        self.cursors = [pg.InfiniteLine(angle=90, movable=True) for _ in range(2)]
        for line in self.cursors:
            line.setVisible(False)
            self.item.addItem(line, ignoreBounds=True)

    def show(self, signals: list[ShownSignal], theme: Theme, colours: list[str]) -> None:
        super().show(signals, theme, colours)
        for line in self.cursors:
            line.setPen(pg.mkPen(theme.ink, style=Qt.PenStyle.DashLine))
        for line in self.limit_lines:
            line.setPen(pg.mkPen(theme.alarm, width=2, style=Qt.PenStyle.DashDotLine))

    def place_limits(self, ends: tuple[float, float]) -> None:
        for line, at in zip(self.limit_lines, ends, strict=True):
            line.setVisible(math.isfinite(at))
            if math.isfinite(at) and line.value() != at:
                line.setValue(at)

    def draw(self, shown: Shown) -> None:
        for signal, drawn in zip(self.signals, self.curves, strict=True):
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


class Cursors:
    """Two lines across all time plots, moved together; span: gives the first and last time seen."""

    def __init__(self, plots: list[TimePlot], readout: QLabel, span: Any) -> None:
        self._plots, self.readout, self._span = plots, readout, span
        self._active = 0
        for plot in plots:
            for which, line in enumerate(plot.cursors):
                line.sigPositionChanged.connect(partial(self._moved, which))

    @property
    def on(self) -> bool:
        return bool(self._plots[0].cursors[0].isVisible())

    def toggle(self) -> bool:
        on = not self.on
        left_s, right_s = self._span()
        for plot in self._plots:
            for i, line in enumerate(plot.cursors):
                line.setVisible(on)
                line.setValue(left_s + (right_s - left_s) * (0.4 + 0.2 * i))
        self.readout.setVisible(on)
        return on

    def _moved(self, which: int, line: Any) -> None:
        for plot in self._plots:
            if plot.cursors[which].value() != line.value():
                plot.cursors[which].setValue(line.value())

    def move(self, part: float) -> None:
        """Move the selected cursor by a part of the visible range."""
        left_s, right_s = self._span()
        line = self._plots[0].cursors[self._active]
        line.setValue(line.value() + part * (right_s - left_s))

    def other(self) -> None:
        self._active = 1 - self._active

    def read(self, shown: Shown) -> None:
        first_s, second_s = (line.value() for line in self._plots[0].cursors)
        lines = []
        for i, at_s in enumerate((first_s, second_s)):
            values = [v for p in self._plots for v in p.at(at_s, shown)]
            mark = "&#9656; " if i == self._active else ""
            lines.append(f"{mark}<b>{at_s:.3f} s</b>: {escape(', '.join(values))}")
        self.readout.setText("<br>".join(lines) + f"<br>apart: {second_s - first_s:.3f} s")


class LimitBands(PlotPanel):
    """When which limit acted: a row each, of those that did; flags: each with its stream."""

    def __init__(self, area: Any, row: int, flags: list[tuple[str, LimitFlag]], title: str) -> None:
        super().__init__(area.addPlot(row=row, col=0), title, "time on the board's clock [s]")
        self.item.setMouseEnabled(y=False)
        self.item.setYRange(-0.6, MOST_BANDS - 0.4, padding=0)
        self.item.invertY(True)
        area.ci.layout.setRowMinimumHeight(row, BANDS_PX)  # so that the names stay apart
        self.flags = flags
        self._bands = self.item.plot(connect="pairs")
        self.names: list[tuple[int, str]] = []
        self.item.getAxis("left").setTicks([[]])

    def show(self, theme: Theme) -> None:
        pen = pg.mkPen(theme.limit, width=9)
        pen.setCapStyle(Qt.PenCapStyle.FlatCap)
        self._bands.setPen(pen)
        self.dress(theme)

    def axis_px(self) -> int:
        """The width that its names need: one that does not fit is left out."""
        letters = self.item.getViewWidget().fontMetrics()
        wide = [int(letters.horizontalAdvance(f.name)) for _, f in self.flags]
        return max(LEAST_AXIS_PX, *wide) + 2 * NUMBER_PX

    def acting(self, shown: Shown) -> list[LimitFlag]:
        return [f for s, f in self.flags if f.held(shown[s].rows).any()]

    def draw(self, shown: Shown, left_s: float, right_s: float) -> None:
        """Draw those that acted between two times; the latest to begin come first."""
        found = []
        for stream, flag in self.flags:
            part = shown[stream]
            seen = flag.held(part.rows) & (part.time_s >= left_s) & (part.time_s <= right_s)
            if seen.any():
                found.append((spans(part.time_s, seen, (right_s - left_s) / 500), flag.name))
        found.sort(key=lambda one: -one[0][-1][1])
        del found[MOST_BANDS:]
        least_s = (right_s - left_s) / 300
        ends = [
            (row, start_s, max(end_s, start_s + least_s))
            for row, (stretches, _) in enumerate(found)
            for start_s, end_s in stretches
        ]
        names = [(row, name) for row, (_, name) in enumerate(found)]
        if names != self.names:
            self.names = names
            self.item.getAxis("left").setTicks([names])
        table = np.array(ends, np.float64).reshape(-1, 3)
        self._bands.setData(table[:, 1:].ravel(), np.repeat(table[:, 0], 2))


class LoopPlot(PlotPanel):
    """Torque over deflection: the hysteresis of the elastomer, a line that fades with its age."""

    def __init__(self, area: Any, x: ShownSignal, y: ShownSignal) -> None:
        super().__init__(area.addPlot(row=0, col=0), "Torque over deflection (mean)")
        self.x, self.y = x, y
        self._past = [self.item.plot(antialias=True) for _ in range(FADES)]
        self._now = self.item.plot(symbol="o")
        self.item.vb.setLimits(minXRange=LEAST_SPAN["deg"], minYRange=LEAST_SPAN["Nm"])

    def show(self, theme: Theme) -> None:
        for age, part in enumerate(reversed(self._past)):
            colour = pg.mkColor(theme.measured)
            colour.setAlpha(round(255 * (1 - age / FADES)))
            part.setPen(pg.mkPen(colour, width=1))
        self._now.setSymbolBrush(theme.measured)
        self._now.setSymbolPen(theme.ink)
        self.bottom, self.left = (f"{s.label} [{s.unit}]" for s in (self.x, self.y))
        self.dress(theme)

    def draw(self, shown: Shown) -> None:
        """Moving means: single rows are a sawtooth of the encoders' steps."""
        stretch = shown[self.x.stream]
        if len(stretch.rows) < MEAN_ROWS:
            return
        step = -(-len(stretch.rows) // MOST_POINTS)
        same = slice(-stretch.first % step, None, step)  # rows of the picture before
        box = np.full(MEAN_ROWS, 1 / MEAN_ROWS)
        x, y = (np.convolve(s.values(shown), box, "valid")[same] for s in (self.x, self.y))
        ends = np.linspace(0, len(x), FADES + 1).astype(int)
        for part, a, b in zip(self._past, ends, ends[1:], strict=False):
            part.setData(x[a : b + 1], y[a : b + 1])
        self._now.setData(x[-1:], y[-1:])


def amplitudes(stretch: Stretch, values: Floats) -> tuple[Floats, Floats]:
    """Frequencies in Hz and the amplitude of the sine at each, of the newest rows without a gap."""
    holes = np.flatnonzero(stretch.after_gap)
    first = int(holes[-1]) if len(holes) else 0
    y, time_s = values[first:], stretch.time_s[first:]
    if len(y) < LEAST_ROWS or not np.isfinite(y).all():
        return np.zeros(0), np.zeros(0)
    # Welch's estimate with a Hann window: a sine of amplitude a shows as a, whatever the window.
    fs_Hz = (len(y) - 1) / (time_s[-1] - time_s[0])
    f_Hz, power = scipy.signal.welch(y, fs_Hz, "hann", min(len(y), MOST_ROWS), scaling="spectrum")
    return f_Hz[1:], np.sqrt(2 * power[1:])


class SpectrumPlot(SignalPlot):
    """Spectra of some signals, both axes logarithmic."""

    LOWEST_WIDTH, CURVE = 1.0, {}

    def __init__(self, area: Any, row: int) -> None:
        super().__init__(area.addPlot(row=row, col=0), "Spectrum", "Hz")
        self.item.setLogMode(x=True, y=True)
        # Whole decades: others have no number.
        upright = self.item.getAxis("left")
        upright.tickSpacing = lambda *given: [(max(1.0, step), 0.0) for step, _ in _apart(*given)]
        self.item.setVisible(False)
        self._layout, self._row = area.ci.layout, row

    def toggle(self) -> None:
        on = not self.item.isVisible()
        self.item.setVisible(on)
        self._layout.setRowMinimumHeight(self._row, LEAST_PX if on else 0)

    def show(self, signals: list[ShownSignal], theme: Theme, colours: list[str]) -> None:
        self.left = f"amplitude [{', '.join(sorted({s.unit for s in signals}))}]"
        super().show(signals, theme, colours)

    def draw(self, shown: Shown) -> None:
        for signal, drawn in zip(self.signals, self.curves, strict=True):
            f_Hz, size = amplitudes(shown[signal.stream], signal.values(shown))
            drawn.setData(f_Hz, np.maximum(size, 1e-12))
