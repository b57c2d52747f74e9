"""A signal between its limits, as a bar."""

from __future__ import annotations

import math

from PySide6.QtCore import QRectF, QSize
from PySide6.QtGui import QColor, QPainter, QPaintEvent
from PySide6.QtWidgets import QWidget

from esea_host.study.source import Gauge
from esea_host.windows.theme import Theme

NEAR = 0.85  # of the way to a limit


class GaugeBar(QWidget):
    """Name, value, unit; under them a bar from limit to limit with a mark where the value is."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.gauge, self.theme = Gauge("", 0.0, -1.0, 1.0, ""), theme
        self.setMinimumSize(180, 44)

    def sizeHint(self) -> QSize:
        return QSize(260, 44)

    @property
    def near(self) -> bool:
        g = self.gauge
        middle, half = (g.low + g.high) / 2, (g.high - g.low) / 2
        return not abs(g.value - middle) <= NEAR * half

    def paintEvent(self, _: QPaintEvent) -> None:
        painter, g, theme = QPainter(self), self.gauge, self.theme
        painter.setPen(QColor(theme.alarm if self.near else theme.ink))
        painter.drawText(0, 14, f"{g.name}: {round(g.value, 2) + 0.0:.2f} {g.unit}")
        painter.setPen(QColor(theme.soft))
        painter.drawText(0, 42, f"{g.low:.2f}")
        width = float(self.width() - 2)
        high = f"{g.high:.2f}"
        painter.drawText(int(width) - painter.fontMetrics().horizontalAdvance(high), 42, high)
        painter.fillRect(QRectF(0, 19, width, 8), QColor(theme.ground))
        if math.isfinite(g.value) and g.high > g.low:
            share = min(max((g.value - g.low) / (g.high - g.low), 0.0), 1.0)
            colour = QColor(theme.alarm if self.near else theme.measured)
            painter.fillRect(QRectF(share * (width - 6), 17, 6, 12), colour)
        painter.end()
