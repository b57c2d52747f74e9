"""The virtual arm of a simulated board, to be pushed with the mouse."""

from __future__ import annotations

import math
from collections.abc import Callable

from PySide6.QtCore import QPointF, Qt, QTimer
from PySide6.QtGui import QColor, QKeySequence, QMouseEvent, QPainter, QPaintEvent, QPen, QShortcut
from PySide6.QtWidgets import QDockWidget, QMainWindow, QWidget

from esea_host.windows.feed import LiveFeed
from esea_host.windows.signals import AxisColumns

MOST_RAD, STEP_RAD = 0.6, 0.1
DRAWN_MS = 50


class VirtualArm(QWidget):
    def __init__(self, feed: LiveFeed, push: Callable[[], None], axis: str = "") -> None:
        super().__init__()
        (self._shown,) = AxisColumns(feed).signals((("theta_load_rad", "1", ""),), axis)
        self._feed, self._push = feed, push
        self.push_rad = 0.0
        self._taken_rad: float | None = None
        self.setMinimumSize(150, 64)
        self.setToolTip("Drag the forearm; [ and ] push it by keys, = lets go.")
        timer = QTimer(self)
        timer.timeout.connect(self.update)
        timer.start(DRAWN_MS)

    @property
    def angle_rad(self) -> float:
        """Last reported angle of the joint; 0 is a forearm that hangs straight down."""
        row = self._feed.rings[self._shown.stream].newest()
        return 0.0 if row is None else float(row[self._shown.column])

    def set_push(self, push_rad: float) -> None:
        self.push_rad = min(max(push_rad, -MOST_RAD), MOST_RAD)
        self._push()
        self.update()

    def elbow(self) -> QPointF:
        return QPointF(0.4 * self.width(), 0.45 * self.height())

    def _reach_px(self) -> float:
        return 0.42 * min(self.width(), self.height())

    def at(self, angle_rad: float) -> QPointF:
        # Flexion lifts the forearm forward, to the right.
        reach = self._reach_px()
        return self.elbow() + QPointF(reach * math.sin(angle_rad), reach * math.cos(angle_rad))

    def _angle_of(self, place: QPointF) -> float:
        off = place - self.elbow()
        return math.atan2(off.x(), off.y())

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._taken_rad = self._angle_of(event.position())

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._taken_rad is not None:
            turn = self._angle_of(event.position()) - self._taken_rad
            self.set_push(math.remainder(turn, 2 * math.pi))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        self._taken_rad = None
        self.set_push(0.0)

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        ink = self.palette().windowText().color()
        elbow, angle = self.elbow(), self.angle_rad
        shoulder = elbow - QPointF(0, self._reach_px())

        def limb(colour: QColor, width: float, first: QPointF, last: QPointF) -> None:
            pen = QPen(colour, width)
            pen.setCapStyle(Qt.PenCapStyle.RoundCap)
            painter.setPen(pen)
            painter.drawLine(first, last)

        soft = QColor(ink)
        soft.setAlpha(70)
        limb(soft, 26, shoulder, elbow)
        if self.push_rad:
            pushed = QColor("#b5611b")
            pushed.setAlpha(120)
            limb(pushed, 12, elbow, self.at(angle + self.push_rad))
        limb(QColor("#00558c"), 20, elbow, self.at(angle))
        painter.setPen(ink)
        said = f"{math.degrees(angle):.0f} deg"
        said += f", pushed by {math.degrees(self.push_rad):+.0f} deg" if self.push_rad else ""
        painter.drawText(10, self.height() - 28, "SIMULATED: drag it")
        painter.drawText(10, self.height() - 10, said)


def add_arms(window: QMainWindow, feed: LiveFeed, push: Callable[..., None]) -> list[VirtualArm]:
    """An arm for each axis; push is called with how far each axis is pushed, rad."""
    arms: list[VirtualArm] = []

    def pushed() -> None:
        push(*(arm.push_rad for arm in arms))

    for axis in feed.device.identity.device.axes:
        arms.append(VirtualArm(feed, pushed, axis))
        dock = QDockWidget(f"Virtual arm {axis}".rstrip(), window)
        dock.setFeatures(QDockWidget.DockWidgetFeature.DockWidgetClosable)
        dock.setWidget(arms[-1])
        window.addDockWidget(Qt.DockWidgetArea.RightDockWidgetArea, dock)
    arm = arms[0]
    for key, job in (
        ("]", lambda: arm.set_push(arm.push_rad + STEP_RAD)),
        ("[", lambda: arm.set_push(arm.push_rad - STEP_RAD)),
        ("=", lambda: arm.set_push(0.0)),
    ):
        QShortcut(QKeySequence(key), window, job)
    return arms
