"""A live view, opened and closed."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication

from esea_host.windows.arm import add_arms
from esea_host.windows.feed import LiveFeed
from esea_host.windows.live import LiveWindow


def run_live(
    feed: LiveFeed,
    dark: bool | None = None,
    seconds: float | None = None,
    screenshot: Path | None = None,
    push: Callable[..., None] | None = None,
) -> None:
    """Open the view, and return when it is closed, or after some seconds."""
    application = QApplication.instance() or QApplication([])
    assert isinstance(application, QApplication)
    if dark is None:
        dark = QGuiApplication.styleHints().colorScheme() == Qt.ColorScheme.Dark
    window = LiveWindow(feed, dark)
    if push is not None:
        add_arms(window, feed, push)
    window.resize(1280, 860)
    window.show()
    if seconds is not None:
        QTimer.singleShot(int(seconds * 1000), window.close)
    if screenshot is not None:
        before_ms = max(0, int((seconds or 5.0) * 1000) - 300)
        QTimer.singleShot(before_ms, lambda: window.grab().save(str(screenshot)))
    # Ctrl+C closes the window, so that the recording is ended well.
    before = signal.signal(signal.SIGINT, lambda *_: window.close())
    try:
        application.exec()
    finally:
        signal.signal(signal.SIGINT, before)
