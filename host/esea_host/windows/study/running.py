"""Both windows of a session, from its start to their closing."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QGuiApplication

from esea_host.connection import ConnectedDevice
from esea_host.study.conductor import Conductor
from esea_host.study.words import keyed
from esea_host.windows.frame import qt_application, run_until_closed
from esea_host.windows.study.operator import OperatorWindow
from esea_host.windows.study.participant import ParticipantWindow, Patch

LOOK_MS, SHOWN_AT_END_MS = 100, 1500


def run_windows(
    conductor: Conductor,
    board: ConnectedDevice | None = None,
    language: str = "",
    dark: bool | None = None,
    patch: Patch = "off",
    close: bool = False,
    point: Callable[[tuple[float, float]], None] | None = None,
) -> None:
    """Show a session, and return when its windows are closed and it has ended.

    language: empty for the protocol's.
    """
    words = conductor.study.protocol.words(language)
    # Where nobody asks for a light ground the participant's is dark, whatever the desktop.
    of_operator, of_participant = qt_application(dark), dark is not False
    participant = ParticipantWindow(conductor, words, of_participant, patch)
    operator = OperatorWindow(conductor, words, board, of_operator)
    if point is not None:
        participant.point = point

    top = Qt.WindowType.WindowStaysOnTopHint

    def place() -> None:
        # On a single screen, also where the other one was unplugged, nothing covers STOP.
        operator.setWindowFlag(top, len(QGuiApplication.screens()) == 1)
        participant.place()

    place()
    conductor.start()

    def look() -> None:
        # The operator's window is the session's: with it the other one goes.
        if not operator.isVisible():
            participant.close()
        elif (len(QGuiApplication.screens()) == 1) != bool(operator.windowFlags() & top):
            place()
            operator.show()
        elif close and conductor.over:
            timer.stop()
            QTimer.singleShot(SHOWN_AT_END_MS, operator.close)
            QTimer.singleShot(SHOWN_AT_END_MS, participant.close)

    timer = QTimer()
    timer.timeout.connect(look)
    timer.start(LOOK_MS)
    try:
        run_until_closed(operator, size_px=(1240, 820))
    finally:
        conductor.stop(keyed("reason.windows_closed"))
        conductor.join(10.0)
