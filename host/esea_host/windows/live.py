"""The live view of a board."""

from __future__ import annotations

import math
import time
from functools import partial
from html import escape
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QAction, QCloseEvent, QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QApplication,
    QDockWidget,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QMainWindow,
    QPushButton,
    QSplitter,
    QVBoxLayout,
    QWidget,
)

from esea_host.connection import PlayedBoard
from esea_host.windows.columns import LOOP, AxisColumns
from esea_host.windows.counting import take_many
from esea_host.windows.cursors import Cursors
from esea_host.windows.feed import LiveFeed
from esea_host.windows.history import Stretch
from esea_host.windows.meanings import link_text, state_text
from esea_host.windows.number_field import Choice
from esea_host.windows.parameters import ParameterEditor
from esea_host.windows.plots import LimitBands, LoopPlot, ShownSignal, TimePlot, signal_of
from esea_host.windows.spectrum import SpectrumPlot
from esea_host.windows.theme import DARK, LIGHT, STOP_STYLE, Theme, plain_label, plain_tip
from esea_host.windows.trigger import NORMAL, OFF, Trigger
from esea_host.windows.trigger_bar import TriggerBar

take_many()
FRAME_MS = 50
WINDOWS_S = (1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 120.0)
UNCONFIRMED_S = 1.0
ALARMING = ("FAULT", "STOPPED")
MOVING = ("ARMED", "ACTIVE", "LETTING_GO")


class LiveWindow(QMainWindow):
    """A window on a :class:`LiveFeed`; it only reads, and what it asks for is done beside it."""

    def __init__(self, feed: LiveFeed, dark: bool = False) -> None:
        super().__init__()
        self.feed, self.theme = feed, DARK if dark else LIGHT
        device = feed.device.identity.device
        self.columns = AxisColumns(feed)
        self.axis, self._drives = self.columns.axes[0], self.columns.drives
        self.window_s, self._frozen = 10.0, dict[str, Stretch]()
        self._stop_asked_s = 0.0
        self.played = feed.device if isinstance(feed.device, PlayedBoard) else None
        self.trigger = Trigger()
        self.drawn_frames = 0
        kind = "SIMULATED " if feed.device.simulated else ""
        self._who = f"{kind}{device.name} on {feed.device.identity.board}"
        self.setWindowTitle(f"{self._who} - esea-host")
        self._build()
        self._actions()
        self.set_theme(self.theme)
        application = QApplication.instance()
        assert application is not None
        application.installEventFilter(self)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self._turn)
        self._timer.start(FRAME_MS)

    # -- what there is -----------------------------------------------------------------------------

    def _build(self) -> None:
        self.state, self.link, self.fault = QLabel(), QLabel(), QLabel()
        self.readout, self.said = QLabel(), plain_label()
        self.fault.setWordWrap(True)
        for label in (self.state, self.link, self.fault, self.readout):
            label.setTextFormat(Qt.TextFormat.RichText)
        self.stop_button = QPushButton("STOP  (Space)")
        self.stop_button.setStyleSheet(STOP_STYLE)
        self.stop_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        # When it goes down, not when it comes up again.
        self.stop_button.pressed.connect(self.stop)
        self.stop_button.setVisible(self.played is None and self._drives)
        words = QVBoxLayout()
        for label in (self.state, self.fault, self.link):
            words.addWidget(label)
        top = QHBoxLayout()
        top.addLayout(words, 1)
        self.axis_box = Choice()
        self.axis_box.addItems(list(self.columns.axes))
        self.axis_box.currentIndexChanged.connect(self.choose_axis)
        self.axis_box.setVisible(len(self.columns.axes) > 1)
        self.axis_box.setToolTip("A: the next axis")
        top.addWidget(self.axis_box)
        top.addWidget(self.stop_button)
        self.note = QLineEdit()
        recorded = self.feed.recording is not None
        self.note.setPlaceholderText(
            "N: a note into the recording, then Return"
            if recorded
            else "not recorded: start with --record FILE to keep notes"
        )
        self.note.setEnabled(recorded)
        self.note.setVisible(self.played is None)
        self.note.returnPressed.connect(self._noted)
        self._build_plots()
        column = QVBoxLayout()
        for part in (top, self.trigger_bar, self._split, self.readout, self.note, self.said):
            if isinstance(part, QHBoxLayout):
                column.addLayout(part)
            else:
                column.addWidget(part, 1 if part is self._split else 0)
        middle = QWidget()
        middle.setLayout(column)
        self.setCentralWidget(middle)
        self.readout.setVisible(False)
        self._build_docks()

    def _build_plots(self) -> None:
        self._area = pg.GraphicsLayoutWidget()
        self.panels: list[TimePlot] = []
        self._signals: list[list[ShownSignal]] = []
        for (title, unit), signals in self.columns.panels(self.axis):
            self.panels.append(TimePlot(self._area, len(self.panels), title, unit))
            self._signals.append(signals)
        self.chosen = TimePlot(self._area, len(self.panels), "Chosen", "")
        self.chosen.item.setVisible(False)
        title = "Which limit acts" if self._drives else "What the sensing reports"
        self.bands = LimitBands(
            self._area, len(self.panels) + 1, self.columns.flags(self.axis), title
        )
        for panel in (*self.panels, self.chosen):
            panel.item.setXLink(self.bands.item)
        for plot in (*(p.item for p in (*self.panels, self.chosen)), self.bands.item):
            # Who zooms wants to look: the picture stands still.
            plot.vb.sigRangeChangedManually.connect(partial(self.pause, True))
        plots = [*self.panels, self.chosen]
        self.cursors = Cursors(plots, self.readout, lambda: self.bands.item.viewRange()[0])
        self._loop_area = pg.GraphicsLayoutWidget()
        self.loop: LoopPlot | None = None
        if len(pair := self.columns.signals(LOOP, self.axis)) == len(LOOP):
            self.loop = LoopPlot(self._loop_area, *pair)
        self.spectrum = SpectrumPlot(self._loop_area, 1)
        everything = [s for signals in self._signals for s in signals]
        self.trigger_bar = TriggerBar(self.trigger, everything, self.feed.now_s)
        self.trigger_bar.setVisible(False)
        self._split = QSplitter()
        self._split.addWidget(self._area)
        self._split.addWidget(self._loop_area)
        self._split.setSizes([760, 340])

    def choose_axis(self, place: int) -> None:
        self.axis = self.columns.axes[place]
        self._signals = [signals for _, signals in self.columns.panels(self.axis)]
        self.bands.flags = self.columns.flags(self.axis)
        if self.loop is not None:
            self.loop.x, self.loop.y = self.columns.signals(LOOP, self.axis)
        self.set_theme(self.theme)

    def _next_axis(self) -> None:
        self.axis_box.setCurrentIndex((self.axis_box.currentIndex() + 1) % self.axis_box.count())

    def _build_docks(self) -> None:
        self.channels = QListWidget()
        for (stream, name), c in self.columns.all.items():
            if c.kind == "f4" and c.size == 1:
                item = QListWidgetItem(f"{stream}.{name}")
                item.setToolTip(plain_tip(f"{c.meaning} [{c.unit}]"))
                item.setCheckState(Qt.CheckState.Unchecked)
                self.channels.addItem(item)
        self.channels.itemChanged.connect(self._choose)
        self.channels.itemActivated.connect(_toggle)
        self.parameters = ParameterEditor(self.feed)
        areas = Qt.DockWidgetArea
        self._docks: dict[str, QDockWidget] = {}
        for title, widget, area in (
            ("Channels", self.channels, areas.LeftDockWidgetArea),
            ("Parameters", self.parameters, areas.BottomDockWidgetArea),
        ):
            dock = QDockWidget(title)
            dock.setWidget(widget)
            # In this window always: so the stop keeps its key and its place.
            dock.setFeatures(QDockWidget.DockWidgetFeature.DockWidgetClosable)
            self.addDockWidget(area, dock)
            dock.hide()
            self._docks[title] = dock

    def _actions(self) -> None:
        device = self.feed.device
        look = self.menuBar().addMenu("&Look")
        for name, keys, job in (
            ("Pause, go on", "P", self.pause),
            ("Shorter time", "+", partial(self.zoom, -1)),
            ("Longer time", "-", partial(self.zoom, 1)),
            ("Cursors", "C", self.toggle_cursors),
            ("Cursor to the left", "Left", partial(self.cursors.move, -0.01)),
            ("Cursor to the right", "Right", partial(self.cursors.move, 0.01)),
            ("The other cursor", "Tab", self.cursors.other),
            ("Torque over deflection", "X", self.toggle_loop),
            ("Spectrum", "F", self.toggle_spectrum),
            ("Trigger", "G", self.toggle_trigger),
            ("Channels (Return chooses)", "K", partial(self.toggle_dock, "Channels")),
            ("Parameters", "E", partial(self.toggle_dock, "Parameters")),
            ("Note", "N", self.note.setFocus),
            ("Dark, light", "T", self.toggle_theme),
            *([("The next axis", "A", self._next_axis)] if len(self.columns.axes) > 1 else []),
        ):
            self._action(look, name, keys, job)
        if self.played is not None:
            return
        board = self.menuBar().addMenu("&Board")
        if self._drives:
            self._action(board, "STOP: Space or Escape", "F12", self.stop)
        for name, keys, job, of_drive in (
            ("Release the stop", "Ctrl+R", device.release, True),
            ("Zero", "Ctrl+0", device.zero, False),
            ("Arm: the motor may move", "Ctrl+Shift+A", device.arm, True),
            ("Disarm", "Ctrl+D", device.disarm, True),
            ("Fault has been seen to", "Ctrl+L", device.clear, False),
        ):
            if self._drives or not of_drive:
                self._action(board, name, keys, partial(self.feed.do, name, job))

    def _action(self, menu: Any, name: str, keys: str, job: Any) -> None:
        action = QAction(name, self)
        action.setShortcut(QKeySequence(keys))
        action.triggered.connect(lambda _checked=False: job())
        menu.addAction(action)

    # -- stop ------------------------------------------------------------------------------------

    def stop(self) -> None:
        """Stop the motor; of a recording, or where there is no motor, the picture."""
        if self.played is not None or not self._drives:
            self.pause()
            return
        self.feed.stop()
        self._stop_asked_s = time.monotonic()

    def eventFilter(self, _: QObject, event: QEvent) -> bool:
        """Space and Escape stop, whatever has the focus; only into text a space is typed."""
        if event.type() == QEvent.Type.KeyPress and isinstance(event, QKeyEvent):
            if event.key() == Qt.Key.Key_Escape:
                self.stop()
            if event.key() == Qt.Key.Key_Space and not _typing():
                self.stop()
                return True
        return False

    # -- looking ---------------------------------------------------------------------------------

    @property
    def paused(self) -> bool:
        return bool(self._frozen)

    def pause(self, on: bool | None = None, *_: Any) -> None:
        """Hold the picture, or go on; rows are kept and recorded meanwhile."""
        hold = not self.paused if on is None else on
        if hold != self.paused:
            self._frozen = {n: r.last() for n, r in self.feed.rings.items()} if hold else {}
            if self.played is not None:
                self.played.held = hold

    def zoom(self, step: int) -> None:
        place = min(range(len(WINDOWS_S)), key=lambda i: abs(WINDOWS_S[i] - self.window_s))
        self.window_s = WINDOWS_S[min(max(place + step, 0), len(WINDOWS_S) - 1)]
        if self.paused:
            left_s, right_s = self.bands.item.viewRange()[0]
            middle_s, half_s = (left_s + right_s) / 2, self.window_s / 2
            self.bands.item.setXRange(middle_s - half_s, middle_s + half_s, padding=0)

    def _shown(self) -> dict[str, Stretch]:
        if self.paused:
            return self._frozen
        found = {}
        back_s = self.window_s
        if self.trigger.on:
            # Its crossing may be as old as a picture, and the one that is shown older still.
            first_s = self.trigger.shown_s(self.window_s)[0]
            back_s = np.fmax(2 * self.window_s, self.feed.now_s() - first_s)
        for name, ring in self.feed.rings.items():
            found[name] = ring.last(int(back_s / self.feed.period_s[name]) + 1)
        return found

    def _turn(self) -> None:
        started_s = time.monotonic()
        try:
            self.draw()
        finally:
            # At least as long for keys and buttons as for drawing.
            spent_ms = (time.monotonic() - started_s) * 1e3
            self._timer.start(max(FRAME_MS, int(2 * spent_ms)))

    def draw(self) -> None:
        shown = self._shown()
        now_s = max((float(s.time_s[-1]) for s in shown.values() if len(s.time_s)), default=0.0)
        if not self.paused:
            span = self._triggered(shown) if self.trigger.on else (now_s - self.window_s, now_s)
            self.bands.item.setXRange(*span, padding=0)
        # Who zooms into a still picture sees every row there.
        left_s, right_s = self.bands.item.viewRange()[0]
        shown = {n: s.between(left_s, right_s) for n, s in shown.items()}
        for panel in (*self.panels, self.chosen):
            panel.draw(shown)
        self.bands.draw(shown, left_s, right_s)
        if self.loop is not None and self._loop_area.isVisible():
            self.loop.draw(shown)
        if self.spectrum.item.isVisible():
            self.spectrum.draw(shown)
        if self.cursors.on:
            self.cursors.read(shown)
        self._tell(shown)
        for area in (self._area, self._loop_area):
            if area.isVisible():
                # Ranges now: in the middle of a painting they ask for another one.
                area.scene().prepareForPaint()
        self.drawn_frames += 1

    def _triggered(self, shown: dict[str, Stretch]) -> tuple[float, float]:
        # What is seen now stays until there is another whole picture.
        signal = self.trigger_bar.signal
        self.trigger.look(shown[signal.stream], signal.values(shown), self.window_s)
        if math.isnan(self.trigger.last_s):
            left_s, right_s = self.bands.item.viewRange()[0]
            return left_s, right_s
        return self.trigger.shown_s(self.window_s)

    def _tell(self, shown: dict[str, Stretch]) -> None:
        news, theme = self.feed.news, self.theme
        dialect = self.feed.device.session.dialect
        mode = self.columns.mode(self.axis)
        acts = ", ".join(f.name for f in self.bands.acting(shown))
        colour = theme.alarm if news.state in ALARMING else theme.good
        colour = theme.measured if news.state in MOVING else colour
        state = f'<b style="color:{colour}; font-size:16px">{escape(news.state)}</b>'
        parts = [f"{state} &nbsp; {escape(self._who)}"]
        parts += [f"mode: {escape(mode)}"] if mode else []
        parts += [f"{'acts' if self._drives else 'reports'}: {escape(acts)}"] if acts else []
        parts += ["PAUSED (P)"] if self.paused else []
        parts += [escape(self.trigger.said())] if self.trigger.on else []
        self.state.setText(" &nbsp;|&nbsp; ".join(parts))
        measures = news.state == "READY" and not self._drives
        meaning = "Measures; it has no motor." if measures else state_text(dialect, news.state)
        self.fault.setText(self._alarm() or escape(meaning))
        self.link.setText(self._health())
        self.said.setText(news.said)

    def _alarm(self) -> str:
        news = self.feed.news
        lines = []
        waited_s = time.monotonic() - self._stop_asked_s
        if self._stop_asked_s and news.state == "STOPPED":
            self._stop_asked_s = 0.0
        elif self._stop_asked_s and waited_s > UNCONFIRMED_S:
            lines.append("STOP was sent, and the board has not confirmed it: switch its power off.")
        if news.error:
            lines.append(news.error)
        if self.feed.silent and self.played is None:
            lines.append("Nothing comes from the board: what is shown is old.")
        if news.fault is not None:
            f = news.fault
            lines.append(f"Fault {f.number} {f.name}: {f.meaning}. What to do: {f.cure}.")
        said = "<br>".join(map(escape, lines))
        return f'<b style="color:{self.theme.alarm}">{said}</b>' if said else ""

    def _health(self) -> str:
        news, recording = self.feed.news, self.feed.recording
        parts = [link_text(news.health)]
        if self.played is not None:
            parts.append(f"played at {self.played.speed:g} times its speed")
        elif recording is None:
            parts.append("not recorded")
        elif recording.error is not None:
            said = escape(f"RECORDING ENDED: {recording.error}")
            parts.append(f'<b style="color:{self.theme.alarm}">{said}</b>')
        else:
            parts.append(f"recording: {recording.rows} rows, {recording.gaps} gaps")
        return " &nbsp;|&nbsp; ".join(parts)

    # -- choosing --------------------------------------------------------------------------------

    def _choose(self) -> None:
        signals = []
        for i in range(self.channels.count()):
            item = self.channels.item(i)
            if item.checkState() == Qt.CheckState.Checked:
                stream, _, name = item.text().partition(".")
                signals.append(signal_of(stream, name, self.columns.all[stream, name].unit))
        units = {s.unit for s in signals}
        self.chosen.unit = units.pop() if len(units) == 1 else ""
        colours = self.theme.curves
        self.chosen.show(signals, self.theme, [colours[i % 8] for i in range(len(signals))])
        self.chosen.item.setVisible(bool(signals))
        self.trigger_bar.offer([s for own in self._signals for s in own] + signals)
        first, own = self._signals[0][-1], self.theme.measured
        drawn = [(first, own), *((s, colours[i % 8]) for i, s in enumerate(signals))]
        self.spectrum.show([s for s, _ in drawn], self.theme, [c for _, c in drawn])

    def toggle_dock(self, title: str) -> None:
        dock = self._docks[title]
        dock.setVisible(not dock.isVisible())
        widget = dock.widget()
        if dock.isVisible():
            widget.setFocus()
            if widget is self.parameters:
                self.parameters.read()

    def toggle_loop(self) -> None:
        self._loop_area.setVisible(not self._loop_area.isVisible())

    def toggle_spectrum(self) -> None:
        self.spectrum.toggle()
        self._loop_area.setVisible(True)

    def toggle_trigger(self) -> None:
        on = not self.trigger_bar.isVisible()
        self.trigger_bar.setVisible(on)
        self.trigger_bar.mode.setCurrentText(NORMAL if on else OFF)
        (self.trigger_bar.level if on else self._area).setFocus()

    def toggle_cursors(self) -> None:
        if self.cursors.toggle():
            self.pause(True)

    def toggle_theme(self) -> None:
        self.set_theme(LIGHT if self.theme is DARK else DARK)

    def set_theme(self, theme: Theme) -> None:
        self.theme = theme
        self.setPalette(theme.palette())
        for area in (self._area, self._loop_area):
            area.setBackground(theme.ground)
        for panel, signals in zip(self.panels, self._signals, strict=True):
            own = {"wanted": theme.wanted, "set": theme.good}
            panel.show(signals, theme, [own.get(s.label, theme.measured) for s in signals])
        self._choose()
        self.bands.show(theme)
        if self.loop is not None:
            self.loop.show(theme)

    def _noted(self) -> None:
        if self.note.text().strip():
            self.feed.note(self.note.text().strip())
        self.note.clear()
        self._area.setFocus()

    def closeEvent(self, event: QCloseEvent) -> None:
        """The connection and the recording are not the window's to end."""
        self._timer.stop()
        application = QApplication.instance()
        if application is not None:
            application.removeEventFilter(self)
        super().closeEvent(event)


def _toggle(item: QListWidgetItem) -> None:
    checked = item.checkState() == Qt.CheckState.Checked
    item.setCheckState(Qt.CheckState.Unchecked if checked else Qt.CheckState.Checked)


def _typing() -> bool:
    return isinstance(QApplication.focusWidget(), QLineEdit)
