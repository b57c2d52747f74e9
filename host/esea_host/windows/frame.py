"""Shared parts of all windows: opening and closing, menus, STOP and its keys, themes."""

from __future__ import annotations

import gc
import signal
import time
from collections.abc import Callable, Iterable
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from PySide6.QtCore import QEvent, QObject, QSize, Qt, QTimer
from PySide6.QtGui import (
    QAction,
    QCloseEvent,
    QGuiApplication,
    QKeyEvent,
    QKeySequence,
    QMouseEvent,
    QPixmap,
    QShowEvent,
)
from PySide6.QtWidgets import (
    QAbstractButton,
    QApplication,
    QBoxLayout,
    QDialog,
    QFileDialog,
    QFrame,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QLayout,
    QLineEdit,
    QMainWindow,
    QMenuBar,
    QPushButton,
    QScrollArea,
    QTableWidget,
    QVBoxLayout,
    QWidget,
)

from esea_gen.errors import UserError
from esea_gen.files import written_whole
from esea_host.windows.bar import BoardBar, StepButton
from esea_host.windows.feed import LiveFeed, board_alarms
from esea_host.windows.meanings import (
    ARM,
    CLEAR,
    DISARM,
    NEXT,
    RELEASE,
    ROLES,
    ZERO,
    refusals,
    state_text,
)
from esea_host.windows.number_field import NumberField
from esea_host.windows.theme import DARK, LIGHT, Theme

Job = Callable[[], object]
UNCONFIRMED_S = 1.0
NOT_CONFIRMED = "STOP was sent, and the board has not confirmed it: switch its power off."
ESCAPED = "Escape closed a menu or dialog, and stopped nothing. Press it again to stop."
STOP_NAME = "STOP: Space, Escape or F12"  # no keys of the menu: an open dialog would take them
LEAST_PX = 600, 300  # of a window: 1280 x 720 at twice the size leaves 640 x 360
FRAME_PX = 8, 40  # around a window, for its title
PICTURE_BEFORE_MS, PICTURE_S = 300, 5.0  # before the window closes; where it is not to close


def qt_application(dark: bool | None = None) -> bool:
    """Make Qt's application; whether its windows are to be dark: None: as the desktop has it."""
    # A dialog of the desktop's own would take the keys of the stop.
    QApplication.setAttribute(Qt.ApplicationAttribute.AA_DontUseNativeDialogs)
    QApplication.instance() or QApplication([])
    scheme = QGuiApplication.styleHints().colorScheme()
    return scheme == Qt.ColorScheme.Dark if dark is None else dark


def save_picture(picture: QPixmap, path: Path) -> None:
    with written_whole(path) as scratch:
        if not picture.save(str(scratch)):
            what = f"{path}: the picture cannot be written."
            raise UserError(what, "Make room, or end its name in .png.")


def fit_to_screen(window: QWidget, width: int, height: int) -> None:
    """As large as asked for, where the screen is: no part of a window is beside it."""
    room = window.screen().availableGeometry().adjusted(0, 0, -FRAME_PX[0], -FRAME_PX[1])
    if QGuiApplication.platformName() == "offscreen":  # its screen is nobody's
        room.setSize(QSize(width, height))
    window.resize(QSize(width, height).boundedTo(room.size()))
    window.move(room.topLeft())


def run_until_closed(
    window: QWidget,
    seconds: float | None = None,
    screenshot: Path | None = None,
    size_px: tuple[int, int] = (1280, 860),
) -> None:
    """Show a window and return when it is closed, by itself after some seconds, or by Ctrl+C."""
    fit_to_screen(window, *size_px)
    window.show()
    if seconds is not None:
        QTimer.singleShot(int(seconds * 1000), window.close)
    taken: list[QPixmap] = []
    if screenshot is not None:
        before_ms = max(0, int((seconds or PICTURE_S) * 1000) - PICTURE_BEFORE_MS)
        QTimer.singleShot(before_ms, lambda: taken.append(window.grab()))
    # What is there by now stays: to search it for garbage took 0.1 s, six frames of a participant.
    gc.collect()
    gc.freeze()
    # Closed well, so that a recording or a session is ended well.
    before = signal.signal(signal.SIGINT, lambda *_: window.close())
    try:
        QApplication.exec()
    finally:
        signal.signal(signal.SIGINT, before)
        gc.unfreeze()
    if screenshot is not None and taken:  # an error while Qt runs would only be printed
        save_picture(taken[0], screenshot)


def called(job: Job) -> Callable[..., None]:
    """A slot that ignores the arguments of Qt's signal."""

    def slot(*_: object) -> None:
        job()

    return slot


def takes_letters(widget: QWidget | None) -> bool:
    """Whether a widget accepts spaces as text; number fields, also in a table, do not."""
    parent = widget and widget.parentWidget()
    over = parent and parent.parentWidget()
    number = isinstance(widget, NumberField) or isinstance(over, QTableWidget)
    return isinstance(widget, QLineEdit) and not number


def ask_for_file(
    window: QWidget, title: str, kinds: str, job: Callable[[str], object], new: str = ""
) -> QFileDialog:
    """Beside the window, not over it: a modal dialog would take STOP; new: the name to write."""
    dialog = QFileDialog(window, title, "", kinds)
    if new:
        dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
        dialog.selectFile(new)
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    dialog.fileSelected.connect(job)
    dialog.show()
    return dialog


def push_button(text: str, job: Job, *, focus: bool = True) -> QPushButton:
    made = QPushButton(text)
    made.clicked.connect(called(job))
    if not focus:
        made.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    return made


def labelled(text: str, field: QWidget) -> QLabel:
    """A label that names its field for a screen reader, too."""
    made = QLabel(text)
    made.setBuddy(field)
    field.setAccessibleName(text)
    return made


def name_fields(window: QWidget) -> None:
    """Name unlabelled focusable widgets for a screen reader, by words in or around them."""
    for field in window.findChildren(QWidget):
        place, words = field.parentWidget(), field.accessibleName()
        words = words or getattr(field, "placeholderText", str)() or field.toolTip()
        while not words and place is not None and place is not window:
            title = place.title() if isinstance(place, QGroupBox) else place.windowTitle()
            words, place = place.accessibleName() or title, place.parentWidget()
        if field.focusPolicy() & Qt.FocusPolicy.TabFocus and not isinstance(field, QAbstractButton):
            field.setAccessibleName(words)


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


class _Shrinking(QVBoxLayout):
    # To the least heights: a scrolled text asks for the height of all its lines.
    def __init__(self, inner: QLayout) -> None:
        super().__init__()
        self.addLayout(inner)

    def hasHeightForWidth(self) -> bool:
        return False


class StopWindow(QMainWindow):
    """A window with STOP in a bar on top and scrolling content below.

    Space, Escape and F12 stop, whatever has the focus, also in menus and dialogs; but a space that
    is typed is a space, and Escape closes an open menu, list or dialog first: held down, or pressed
    again, it stops.
    """

    theme: Theme = LIGHT

    def __init__(self, stop_text: str = "STOP\n(Space)", escape_text: str = ESCAPED) -> None:
        super().__init__()
        self.stop_asked_s, self._escape_text, self._closes = 0.0, escape_text, False
        self.bar = BoardBar(stop_text)
        self.stop_button = self.bar.stop_button
        # When it goes down, not when it comes up again.
        self.stop_button.pressed.connect(called(self.stop))
        self.menus, top = QMenuBar(), QWidget()
        upper = column_of(self.menus, self.bar)
        upper.setContentsMargins(0, 0, 0, 0)
        upper.setSpacing(0)
        top.setLayout(upper)
        # Above the docks, too: its place is the same whatever is open.
        self.setMenuWidget(top)
        self.setMinimumSize(*LEAST_PX)
        self.timer = QTimer(self)
        application = QApplication.instance()
        assert application is not None
        application.installEventFilter(self)

    def fill(self, layout: QLayout, *, reads: bool = False) -> None:
        """Set the content below the bar; it scrolls if it does not fit.

        reads: a long text makes it scroll; else plots give way to it.
        """
        inner, scrolled = QWidget(), QScrollArea()
        inner.setLayout(layout if reads else _Shrinking(layout))
        scrolled.setWidget(inner)
        scrolled.setWidgetResizable(True)
        scrolled.setFrameShape(QFrame.Shape.NoFrame)
        scrolled.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        scrolled.setMinimumHeight(1)  # docks have their least height first
        self.setCentralWidget(scrolled)

    def add_menu(self, title: str, jobs: Iterable[tuple[str, str, Job]]) -> None:
        """A menu of jobs, each with its keys."""
        menu = self.menus.addMenu(title)
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

    # -- the board ---------------------------------------------------------------------------------

    def add_board_steps(
        self, feed: LiveFeed, drives: bool, before_disarm: Job = lambda: None
    ) -> None:
        """Add Zero, Arm and so on to bar and keys; commands that would be refused are not sent."""
        device = feed.device

        def disarm() -> None:
            before_disarm()
            feed.do(DISARM, device.disarm)

        jobs: list[tuple[str, str, Job]] = [(ZERO, "Ctrl+0", feed.zero)]
        if drives:
            jobs += [
                (ARM, "Ctrl+Shift+A", partial(feed.do, ARM, device.arm)),
                (DISARM, "Ctrl+D", disarm),
                (RELEASE, "Ctrl+R", partial(feed.do, RELEASE, device.release)),
            ]
        jobs.append((CLEAR, "Ctrl+L", partial(feed.do, CLEAR, device.clear)))
        for name, keys, job in jobs:
            self.bar.add_step(name, StepButton(name, keys, partial(self._ask, feed, name, job)))
        asked: list[tuple[str, str, Job]] = [(STOP_NAME, "", self.stop)] if drives else []
        asked += [(n, k, partial(self._ask, feed, n, job)) for n, k, job in jobs]
        self.add_menu("&Board", asked)

    def _ask(self, feed: LiveFeed, name: str, job: Job) -> None:
        reason = self.bar.steps[name].refusal
        if reason:
            feed.news.said = f"{name} refused: {reason}."
        else:
            job()

    def tell_board(self, feed: LiveFeed, more: Iterable[str] = ()) -> None:
        """State, next step, refusals and alarms of a board; more: further alarms."""
        news, drives = feed.news, ARM in self.bar.steps
        word, _, rest = news.state.partition(": ")
        lost = "NO LINK" if feed.silent else ""
        self.bar.show_state(lost or word, "alarm" if lost else ROLES.get(word, "rest"))
        alarms = [*self.alarms(feed), *filter(None, more)]
        words = [state_text(feed.device.session.dialect, word), NEXT.get(word, "")]
        if word == "READY" and not drives:
            words = ["Measures; it has no motor."]
        told = rest or " ".join(filter(None, words))
        self.bar.tell("\n".join(alarms) or told, self.theme, alarm=bool(alarms), said=news.said)
        fault = 0 if news.fault is None else news.fault.number
        reasons = refusals(news.state, feed.moves, fault)
        if lost:
            reasons = dict.fromkeys(reasons, "no link") | {DISARM: ""}
        self.bar.refuse(reasons)

    def stop(self) -> None:
        raise NotImplementedError

    def stop_unconfirmed(self, state: str) -> bool:
        """Whether a stop was sent, and a board in this state has not confirmed it in time."""
        if state in ("STOPPING", "STOPPED"):
            self.stop_asked_s = 0.0
        waited_s = time.monotonic() - self.stop_asked_s
        return self.stop_asked_s > 0 and waited_s > UNCONFIRMED_S

    def alarms(self, feed: LiveFeed) -> list[str]:
        """Alarms of a board."""
        unconfirmed = self.stop_unconfirmed(feed.news.state)
        return [NOT_CONFIRMED, *board_alarms(feed)] if unconfirmed else board_alarms(feed)

    # -- keys --------------------------------------------------------------------------------------

    def eventFilter(self, _: QObject, event: QEvent) -> bool:
        popup = QApplication.activePopupWidget()
        if event.type() == QEvent.Type.MouseButtonPress and isinstance(event, QMouseEvent):
            button = self.stop_button
            at = button.mapFromGlobal(event.globalPosition().toPoint())
            if popup is not None and button.isVisible() and button.rect().contains(at):
                self.stop()  # an open menu takes the first press
            return False
        if event.type() != QEvent.Type.KeyPress or not isinstance(event, QKeyEvent):
            return False
        # A key held down is one stop: the second one switches the motor off at once.
        key, again = event.key(), event.isAutoRepeat()
        if key == Qt.Key.Key_Escape:
            dialog = isinstance(QApplication.activeWindow(), QDialog)
            opened = popup is not None or dialog
            if opened and not again:
                self._closes = True
                self.bar.notice(self._escape_text)
                return False
            if self._closes or not again:
                self._closes = False
                self.stop()
            return True
        typing = popup is None and takes_letters(QApplication.focusWidget())
        if key == Qt.Key.Key_F12 or (key == Qt.Key.Key_Space and not typing):
            if not again:
                self.stop()
            return True
        return False

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        name_fields(self)

    def closeEvent(self, event: QCloseEvent) -> None:
        self.timer.stop()
        application = QApplication.instance()
        if application is not None:
            application.removeEventFilter(self)
        super().closeEvent(event)


def coloured(text: str, colour: str) -> str:
    """A text, escaped, in a colour."""
    return f'<span style="color:{colour}">{escape(text)}</span>'
