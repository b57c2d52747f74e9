"""Both windows of a session, from its start to their closing."""

from __future__ import annotations

import signal
from collections.abc import Callable

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication

from esea_host.connection import ConnectedDevice
from esea_host.study.conductor import Conductor
from esea_host.windows.study.operator import OperatorWindow
from esea_host.windows.study.participant import ParticipantWindow, Patch

LOOK_MS, SHOWN_AT_END_MS = 100, 1500


def run_windows(
    conductor: Conductor,
    board: ConnectedDevice | None = None,
    language: str = "en",
    dark: bool | None = None,
    patch: Patch = "off",
    close: bool = False,
    point: Callable[[tuple[float, float]], None] | None = None,
) -> None:
    """Show a session, and return when its windows are closed and it has ended."""
    application = QApplication.instance() or QApplication([])
    assert isinstance(application, QApplication)
    asked = dark
    if dark is None:
        dark = QGuiApplication.styleHints().colorScheme() == Qt.ColorScheme.Dark
    # Where nobody asks for a light ground the participant's is dark, whatever the desktop.
    participant = ParticipantWindow(conductor, language, asked is not False, patch)
    operator = OperatorWindow(conductor, board, language, dark)
    operator.resize(1240, 820)
    if point is not None:
        participant.point = point
    participant.place()
    operator.show()
    conductor.start()

    def look() -> None:
        # The operator's window is the session's: with it the other one goes.
        if not operator.isVisible():
            participant.close()
        elif close and conductor.over:
            timer.stop()
            QTimer.singleShot(SHOWN_AT_END_MS, operator.close)
            QTimer.singleShot(SHOWN_AT_END_MS, participant.close)

    timer = QTimer()
    timer.timeout.connect(look)
    timer.start(LOOK_MS)
    # Ctrl+C closes the windows, so that the session is ended well.
    before = signal.signal(signal.SIGINT, lambda *_: operator.close())
    try:
        application.exec()
    finally:
        signal.signal(signal.SIGINT, before)
        conductor.stop("the windows were closed")
        conductor.join(10.0)
