"""The participant's window: the scene only."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal

from PySide6.QtCore import QPoint, QRectF, Qt, QTimer
from PySide6.QtGui import QCloseEvent, QColor, QGuiApplication, QMouseEvent, QPainter

from esea_host.study.conductor import Conductor, FrameTimes
from esea_host.study.words import Words, keyed
from esea_host.windows.frame import FRAME_PX
from esea_host.windows.study.scene_view import PATCH, SceneView, square_in
from esea_host.windows.theme import BANNER_GROUND

Patch = Literal["off", "frame", "onset"]
SIDE_PX = 900  # without a second screen
BANNER = 0.035  # height of its letters over the smaller side


class ParticipantWindow(SceneView):
    """Full screen on a second monitor, if any; patch: the square for a photodiode."""

    def __init__(
        self, conductor: Conductor, words: Words, dark: bool = True, patch: Patch = "off"
    ) -> None:
        super().__init__(words, dark)
        self.conductor, self.patch = conductor, patch
        self.lit = False
        self.point: Callable[[tuple[float, float]], None] = lambda _: None
        screen = QGuiApplication.primaryScreen()
        refresh_Hz = screen.refreshRate() if screen is not None else 60.0
        self.frames = FrameTimes(refresh_Hz if refresh_Hz > 1 else 60.0)
        conductor.display = self.frames
        self._now = conductor.screen()
        self.setWindowTitle("esea-host")
        self.setMouseTracking(True)
        self.timer = QTimer(self)
        self.timer.setTimerType(Qt.TimerType.PreciseTimer)
        self.timer.timeout.connect(self.turn)
        self.timer.start(max(1, int(1000 / self.frames.refresh_Hz)))

    def place(self) -> None:
        primary = QGuiApplication.primaryScreen()
        others = [s for s in QGuiApplication.screens() if s is not primary]
        if others:
            self.frames.refresh_Hz = others[0].refreshRate() or self.frames.refresh_Hz
            self.timer.setInterval(max(1, int(1000 / self.frames.refresh_Hz)))
            self.setGeometry(others[0].geometry())
            self.showFullScreen()
            self.setCursor(Qt.CursorShape.BlankCursor)
        else:
            room, top = primary.geometry(), FRAME_PX[1]
            side = min(SIDE_PX, room.width(), room.height() - top)
            self.showNormal()
            self.unsetCursor()
            self.setGeometry(room.right() - side, room.top() + top, side, side)
        size_px = [self.width(), self.height()]
        self.frames.facts = {"patch": self.patch, "language": self.words.language}
        self.frames.facts["size_px"] = size_px

    def turn(self) -> None:
        self._now = self.conductor.screen()
        self.show_scene(self._now.scene)

    def painted(self, painter: QPainter) -> None:
        """Paint the mark of a simulation or rehearsal and the patch; note this frame's time."""
        if banner := self.conductor.banner:
            self._paint_banner(painter, self.words(f"banner.{banner}"))
        now = self._now
        new = self.frames.painted(time.monotonic(), now.onsets, now.made_s, now.tick_s)
        if self.patch == "off":
            return
        self.lit = self.lit != (new or self.patch == "frame")
        side = PATCH * min(self.width(), self.height())
        corner = QRectF(0, self.height() - side, side, side)
        painter.fillRect(corner, QColor("white" if self.lit else "black"))

    def _paint_banner(self, painter: QPainter, text: str) -> None:
        side = min(self.width(), self.height())
        font = painter.font()
        font.setPixelSize(max(12, round(BANNER * side)))
        font.setBold(True)
        painter.setFont(font)
        room = painter.fontMetrics().boundingRect(text).adjusted(-side // 50, 0, side // 50, 0)
        # In the corner: of a wide window that is beside the scene.
        room.moveBottomRight(QPoint(self.width() - side // 80, self.height() - side // 80))
        painter.fillRect(room, QColor(BANNER_GROUND))
        painter.setPen(QColor("white"))
        painter.drawText(room, Qt.AlignmentFlag.AlignCenter, text)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Where somebody points: 1 is the edge of the scene."""
        middle, half = square_in(self.width(), self.height())
        at = event.position()
        self.point(((at.x() - middle.x()) / half, (middle.y() - at.y()) / half))

    def closeEvent(self, event: QCloseEvent) -> None:
        """A participant's window that has gone ends the session."""
        self.timer.stop()
        self.conductor.stop(keyed("reason.participant_closed"))
        super().closeEvent(event)
