"""The live view of a board."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDockWidget, QLabel, QLineEdit, QSplitter

from esea_host.connection import PlayedBoard
from esea_host.windows.arm import add_arms
from esea_host.windows.channels import ChannelTree
from esea_host.windows.feed import LiveFeed, Stretch, link_text
from esea_host.windows.frame import Job, StopWindow, column_of, qt_application, run_until_closed
from esea_host.windows.meanings import GENERAL, MOTOR_OFF
from esea_host.windows.number_field import Choice
from esea_host.windows.parameters import ParameterEditor
from esea_host.windows.plots import (
    BANDS_PX,
    LOOP,
    PANEL_PX,
    Cursors,
    LimitBands,
    LoopPlot,
    SpectrumPlot,
    TimePlot,
)
from esea_host.windows.signals import LIT_S, AxisColumns, Head, ShownSignal, signal_of
from esea_host.windows.theme import DARK, LIGHT, Theme
from esea_host.windows.trigger import NORMAL, OFF, Trigger, TriggerBar

FRAME_MS = 50
TWO_DOCKS_PX = 560  # height of a window with room for both
WINDOWS_S = (1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 120.0)


class LiveWindow(StopWindow):
    """A window on a :class:`LiveFeed`; it only reads, and commands run beside it."""

    def __init__(self, feed: LiveFeed, dark: bool = False) -> None:
        super().__init__()
        self.feed = feed
        self.columns = AxisColumns(feed)
        self.axis, self._drives = self.columns.axes[0], self.columns.drives
        self.window_s, self._frozen = 10.0, dict[str, Stretch]()
        self.played = feed.device if isinstance(feed.device, PlayedBoard) else None
        self.trigger = Trigger()
        self.drawn_frames = 0
        self._who = feed.device.identity.who
        kind = "SIMULATED" if feed.device.simulated else ""
        self.setWindowTitle(f"{kind} {self._who} - esea-host".strip())
        self.bar.mark(kind, self._who)
        feed.do("", feed.read_parameters)
        self._build()
        self._actions()
        self.set_theme(DARK if dark else LIGHT)
        self.timer.setSingleShot(True)
        self.timer.timeout.connect(self.turn)
        self.timer.start(FRAME_MS)

    # -- what there is -----------------------------------------------------------------------------

    def _build(self) -> None:
        self.readout = QLabel()
        self.readout.setTextFormat(Qt.TextFormat.RichText)
        if self.played is not None or not self._drives:
            self.bar.without_stop(*(["Recording"] if self.played else []))
        self.axis_box = Choice()
        self.axis_box.addItems(list(self.columns.axes))
        self.axis_box.currentIndexChanged.connect(self.choose_axis)
        self.axis_box.setVisible(len(self.columns.axes) > 1)
        self.axis_box.setToolTip("A: the next axis")
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
        parts = self.axis_box, self.trigger_bar, (self._split, 1), self.readout, self.note
        self.fill(column_of(*parts))
        self.readout.setVisible(False)
        self._build_docks()

    def _build_plots(self) -> None:
        self.area = pg.GraphicsLayoutWidget()
        self.panels: list[TimePlot] = []
        self._signals: list[list[ShownSignal]] = []
        self._heads: list[Head] = []
        for head, signals in self.columns.panels(self.axis):
            self.panels.append(TimePlot(self.area, len(self.panels), head[0], head[1]))
            self._signals.append(signals)
            self._heads.append(head)
        self.area.setMinimumHeight(PANEL_PX * len(self.panels) + BANDS_PX)
        self.chosen = TimePlot(self.area, len(self.panels), "Chosen", "")
        self.chosen.item.setVisible(False)
        title = "Which limit acts" if self._drives else "What the sensing reports"
        flags = self.columns.flags(self.axis)
        self.bands = LimitBands(self.area, len(self.panels) + 1, flags, title)
        self._offer()
        for item in (self.bands.item, *(p.item for p in (*self.panels, self.chosen))):
            item.getAxis("left").setWidth(self.bands.axis_px())
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
        self._split.addWidget(self.area)
        self._split.addWidget(self._loop_area)
        self._split.setSizes([760, 340])

    def choose_axis(self, place: int) -> None:
        self.axis = self.columns.axes[place]
        self._signals = [signals for _, signals in self.columns.panels(self.axis)]
        self.bands.flags = self.columns.flags(self.axis)
        self._offer()
        if self.loop is not None:
            self.loop.x, self.loop.y = self.columns.signals(LOOP, self.axis)
        self.set_theme(self.theme)

    def _offer(self) -> None:
        # Bad inputs and repairs, which every block reports, are shown only while they act.
        # That the motor is off is the state's to say: no limit acts.
        own = (f for _, f in self.bands.flags if f.bit > GENERAL and f.name != MOTOR_OFF)
        self.bar.indicators.offer({f.name: f.meaning for f in own})

    def _next_axis(self) -> None:
        self.axis_box.setCurrentIndex((self.axis_box.currentIndex() + 1) % self.axis_box.count())

    def _build_docks(self) -> None:
        self.channels = ChannelTree(self.columns.all, self._choose)
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
        look: list[tuple[str, str, Job]] = [
            ("Pause, continue", "P", self.pause),
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
        ]
        if len(self.columns.axes) > 1:
            look.append(("The next axis", "A", self._next_axis))
        self.add_menu("&View", look)
        if self.played is None:
            self.add_board_steps(self.feed, self._drives)

    # -- stop ------------------------------------------------------------------------------------

    def stop(self) -> None:
        """Stop the motor; of a recording, or where there is no motor, the picture."""
        if self.played is not None or not self._drives:
            self.pause()
            return
        self.feed.stop()
        self.stop_asked_s = time.monotonic()

    # -- looking ---------------------------------------------------------------------------------

    @property
    def paused(self) -> bool:
        return bool(self._frozen)

    def pause(self, on: bool | None = None, *_: object) -> None:
        """Freeze or resume the picture; rows are stored and recorded meanwhile."""
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

    def turn(self) -> None:
        started_s = time.monotonic()
        try:
            self.draw()
        finally:
            # At least as long for keys and buttons as for drawing.
            spent_ms = (time.monotonic() - started_s) * 1e3
            self.timer.start(max(FRAME_MS, int(2 * spent_ms)))

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
        for panel, head in zip(self.panels, self._heads, strict=True):
            panel.place_limits(self.columns.limits(head, self.axis))
        self.bands.draw(shown, left_s, right_s)
        if self.loop is not None and self._loop_area.isVisible():
            self.loop.draw(shown)
        if self.spectrum.item.isVisible():
            self.spectrum.draw(shown)
        if self.cursors.on:
            self.cursors.read(shown)
        self._tell()
        for area in (self.area, self._loop_area):
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

    def _tell(self) -> None:
        recording = self.feed.recording
        ended = [] if recording is None or recording.error is None else [str(recording.error)]
        self.tell_board(self.feed, [f"RECORDING ENDED: {error}" for error in ended])
        mode = self.columns.mode(self.axis)
        told = [self._who, f"mode: {mode}" if mode else "", link_text(self.feed)]
        if self.played is not None:
            told.append(f"played at {self.played.speed:g} times its speed")
        elif recording is None:
            told.append("not recorded")
        elif not ended:
            told.append(f"recording: {recording.rows} rows, {recording.gaps} gaps")
        told += ["PAUSED (P)" if self.paused else "", self.trigger.said()]
        self.bar.who.setText("  |  ".join(filter(None, told)))
        newest = self.feed.latest(LIT_S)  # also while the picture stands still
        acts = () if self.feed.silent else self.bands.acting(newest)
        acting = {f.name: f.meaning for f in acts if f.name != MOTOR_OFF} | self.feed.unzeroed
        self.bar.indicators.light(acting, self.theme)
        for caption, number in self.columns.readouts(self.axis, newest):
            self.bar.show_value(caption, number)

    # -- choosing --------------------------------------------------------------------------------

    def _choose(self) -> None:
        found = self.channels.chosen()
        signals = [signal_of(s, n, self.columns.all[s, n].unit) for s, n in found]
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
        on = not dock.isVisible()
        for other in self._docks.values() if self.height() < TWO_DOCKS_PX else ():
            other.hide()
        dock.setVisible(on)
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
        (self.trigger_bar.level if on else self.area).setFocus()

    def toggle_cursors(self) -> None:
        if self.cursors.toggle():
            self.pause(True)

    def set_theme(self, theme: Theme) -> None:
        super().set_theme(theme)
        for area in (self.area, self._loop_area):
            area.setBackground(theme.ground)
        for panel, signals in zip(self.panels, self._signals, strict=True):
            own = {"wanted": theme.wanted, "set": theme.good}
            panel.show(signals, theme, [own.get(s.label, theme.measured) for s in signals])
        self.channels.show_theme(theme)
        self._choose()
        self.bands.show(theme)
        if self.loop is not None:
            self.loop.show(theme)

    def _noted(self) -> None:
        if self.note.text().strip():
            self.feed.note(self.note.text().strip())
        self.note.clear()
        self.area.setFocus()


def run_live(
    feed: LiveFeed,
    dark: bool | None = None,
    seconds: float | None = None,
    screenshot: Path | None = None,
    push: Callable[..., None] | None = None,
) -> None:
    """Open the view until it is closed; push: pushes a simulated board's axes, each so far, rad."""
    window = LiveWindow(feed, qt_application(dark))
    if push is not None:
        add_arms(window, feed, push)
    run_until_closed(window, seconds, screenshot)
