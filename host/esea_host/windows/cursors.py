"""Two lines across all time plots, and the values there."""

from __future__ import annotations

from functools import partial
from html import escape
from typing import Any

from PySide6.QtWidgets import QLabel

from esea_host.windows.plots import Shown, TimePlot


class Cursors:
    """Moves both lines of every plot together."""

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
