"""What all windows share: opening and closing, menus, the stop, dark and light."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterable
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QAction, QCloseEvent, QGuiApplication, QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QApplication,
    QBoxLayout,
    QHBoxLayout,
    QLayout,
    QLineEdit,
    QMainWindow,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from esea_gen.files import written_whole
from esea_host.connection import PlayedBoard
from esea_host.windows.feed import LiveFeed
from esea_host.windows.theme import DARK, LIGHT, STOP_STYLE, Theme

Job = Callable[[], object]
UNCONFIRMED_S = 1.0
PICTURE_BEFORE_MS, PICTURE_S = 300, 5.0  # before the window closes; where it is not to close


def qt_application(dark: bool | None = None) -> bool:
    """Make Qt's application; whether its windows are to be dark: None: as the desktop has it."""
    QApplication.instance() or QApplication([])
    scheme = QGuiApplication.styleHints().colorScheme()
    return scheme == Qt.ColorScheme.Dark if dark is None else dark


def save_picture(window: QWidget, path: Path) -> None:
    with written_whole(path) as scratch:
        window.grab().save(str(scratch))


def run_until_closed(
    window: QWidget, seconds: float | None = None, screenshot: Path | None = None
) -> None:
    """Show a window and return when it is closed, by itself after some seconds, or by Ctrl+C."""
    window.show()
    if seconds is not None:
        QTimer.singleShot(int(seconds * 1000), window.close)
    if screenshot is not None:
        before_ms = max(0, int((seconds or PICTURE_S) * 1000) - PICTURE_BEFORE_MS)
        QTimer.singleShot(before_ms, partial(save_picture, window, screenshot))
    # Closed well, so that a recording or a session is ended well.
    before = signal.signal(signal.SIGINT, lambda *_: window.close())
    try:
        QApplication.exec()
    finally:
        signal.signal(signal.SIGINT, before)


def called(job: Job) -> Callable[..., None]:
    """A slot that leaves out what Qt's signal tells."""

    def slot(*_: object) -> None:
        job()

    return slot


def push_button(text: str, job: Job, *, focus: bool = True) -> QPushButton:
    made = QPushButton(text)
    made.clicked.connect(called(job))
    if not focus:
        made.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    return made


def _filled(layout: QBoxLayout, parts: Iterable[QWidget | QLayout | tuple[Any, int]]) -> Any:
    for part in parts:
        item, stretch = part if isinstance(part, tuple) else (part, 0)
        if isinstance(item, QLayout):
            layout.addLayout(item, stretch)
        else:
            layout.addWidget(item, stretch)
    return layout


def row_of(*parts: QWidget | QLayout | tuple[Any, int]) -> QHBoxLayout:
    """Widgets and layouts side by side, each alone or with its stretch."""
    made: QHBoxLayout = _filled(QHBoxLayout(), parts)
    return made


def column_of(*parts: QWidget | QLayout | tuple[Any, int]) -> QVBoxLayout:
    """As :func:`row_of`, one below the other."""
    made: QVBoxLayout = _filled(QVBoxLayout(), parts)
    return made


class ThemedWindow(QMainWindow):
    theme: Theme = LIGHT

    def fill(self, layout: QLayout) -> None:
        middle = QWidget()
        middle.setLayout(layout)
        self.setCentralWidget(middle)

    def add_menu(self, title: str, jobs: Iterable[tuple[str, str, Job]]) -> None:
        """A menu of jobs, each with its keys."""
        menu = self.menuBar().addMenu(title)
        for name, keys, job in jobs:
            action = QAction(name, self)
            action.setShortcut(QKeySequence(keys))
            action.triggered.connect(called(job))
            menu.addAction(action)

    def toggle_theme(self) -> None:
        self.set_theme(LIGHT if self.theme is DARK else DARK)

    def set_theme(self, theme: Theme) -> None:
        self.theme = theme
        self.setPalette(theme.palette())


class StopWindow(ThemedWindow):
    """Space and Escape stop, whatever has the focus; only a text field takes a space."""

    def __init__(self) -> None:
        super().__init__()
        self.stop_asked_s = 0.0
        self.stop_button = QPushButton("STOP  (Space)")
        self.stop_button.setStyleSheet(STOP_STYLE)
        self.stop_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        # When it goes down, not when it comes up again.
        self.stop_button.pressed.connect(called(self.stop))
        self.timer = QTimer(self)
        application = QApplication.instance()
        assert application is not None
        application.installEventFilter(self)

    def stop(self) -> None:
        raise NotImplementedError

    def stop_unconfirmed(self, state: str) -> bool:
        """Whether a stop was sent, and a board in this state has not confirmed it in time."""
        if state == "STOPPED":
            self.stop_asked_s = 0.0
        waited_s = time.monotonic() - self.stop_asked_s
        return self.stop_asked_s > 0 and waited_s > UNCONFIRMED_S

    def alarms(self, feed: LiveFeed) -> list[str]:
        """What somebody has to know of a board at once."""
        news, lines = feed.news, []
        if self.stop_unconfirmed(news.state):
            lines.append("STOP was sent, and the board has not confirmed it: switch its power off.")
        lines += [news.error] if news.error else []
        if feed.silent and not isinstance(feed.device, PlayedBoard):
            lines.append("Nothing comes from the board: what is shown is old.")
        if news.fault is not None:
            f = news.fault
            lines.append(f"Fault {f.number} {f.name}: {f.meaning}. What to do: {f.cure}.")
        return lines

    def eventFilter(self, _: QObject, event: QEvent) -> bool:
        if event.type() != QEvent.Type.KeyPress or not isinstance(event, QKeyEvent):
            return False
        if event.key() == Qt.Key.Key_Escape:
            self.stop()
        typing = isinstance(QApplication.focusWidget(), QLineEdit)
        if event.key() == Qt.Key.Key_Space and not typing:
            self.stop()
            return True
        return False

    def closeEvent(self, event: QCloseEvent) -> None:
        self.timer.stop()
        application = QApplication.instance()
        if application is not None:
            application.removeEventFilter(self)
        super().closeEvent(event)


def state_colour(theme: Theme, state: str) -> str:
    """Of a board's state: alarm, moving, or at rest."""
    if state in ("FAULT", "STOPPING", "STOPPED"):
        return theme.alarm
    return theme.measured if state in ("ARMED", "ACTIVE", "LETTING_GO") else theme.good


def coloured(text: str, colour: str) -> str:
    """A text, escaped, in a colour."""
    return f'<span style="color:{colour}">{escape(text)}</span>'
