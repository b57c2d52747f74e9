"""The wrist display: both cursors, ranges and scaling factors, a guided calibration."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Signal
from PySide6.QtGui import QCloseEvent, QMouseEvent
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QLabel, QPushButton, QSizePolicy

from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_host.windows.feed import LiveFeed, link_text
from esea_host.windows.frame import Job, StopWindow, column_of, push_button, row_of
from esea_host.windows.operator import WORKING, ConstraintKeeper
from esea_host.windows.plots import PlotPanel
from esea_host.windows.study.scene_view import SceneView, square_in
from esea_host.windows.theme import DARK, LIGHT, Theme, plain_label
from esea_host.wrist.calibration import AXES, WristCalibration, calibration_of, save_calibration
from esea_host.wrist.display import (
    AxisView,
    CalibrationGuide,
    DisplayPicture,
    WanderingHand,
    WristDisplay,
)

LEAST_HEIGHT_PX = 230  # of the plots
FRAME_MS, TOLD_EVERY = 16, 6  # words change every so many frames
SAVED = Path("wrist-calibration.toml")
UNZEROED = ("UNKNOWN", "UNREFERENCED", "ZEROING")
NAMES = {"FE": "flexion -, extension +", "RU": "ulnar -, radial +"}


class _Pane(SceneView):
    # A scene in which a mouse may drag the simulated hand.

    dragged = Signal(object)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        middle, half = square_in(self.width(), self.height())
        off, scale = event.position() - middle, self.scene.half_width / half
        self.dragged.emit((off.x() * scale, -off.y() * scale))

    mousePressEvent = mouseMoveEvent

    def mouseReleaseEvent(self, _: QMouseEvent) -> None:
        self.dragged.emit(None)


class _FactorPlot(PlotPanel):
    # Scaling factor over the angle of one axis, with its nodes and the present angle.

    def __init__(self, area: Any, row: int, axis: str) -> None:
        super().__init__(area.addPlot(row=row, col=0), axis, left="scaling factor")
        self.item.setMouseEnabled(x=False, y=False)
        self.item.getAxis("left").setWidth(48)
        self._range = pg.LinearRegionItem(movable=False)
        self._curve = self.item.plot(antialias=True)
        self._nodes = self.item.plot(pen=None, symbol="o", symbolSize=9)
        self._now = pg.InfiniteLine(angle=90)
        self._here = self.item.plot(pen=None, symbol="o", symbolSize=15)
        self.item.addItem(self._range)
        self.item.addItem(self._now)

    def show(self, display: WristDisplay, theme: Theme) -> None:
        found, stored = (display.maps or {}).get(self.title), display.calibration
        for part in (self._range, self._curve, self._nodes):
            part.setVisible(found is not None)
        half, top = display.half_width_deg, 2.0
        if found is not None and stored is not None and stored.constrained is not None:
            theta = np.linspace(found.low_deg, found.high_deg, 201)
            factor, nodes = found.scaling(theta), stored.constrained.axis(self.title).nodes_deg
            self._curve.setData(theta, factor)
            self._nodes.setData(np.array(nodes), found.scaling(nodes))
            self._range.setRegion((found.low_deg, found.high_deg))
            top = max(top, 1.15 * float(factor.max()))
        self.item.setXRange(-half, half, padding=0)
        self.item.setYRange(0, top, padding=0)
        self._curve.setPen(pg.mkPen(theme.wanted, width=3))
        self._nodes.setSymbolBrush(theme.ground)
        self._nodes.setSymbolPen(pg.mkPen(theme.wanted, width=2))
        shade = pg.mkColor(theme.wanted)
        shade.setAlpha(28)
        self._range.setBrush(shade)
        for line in self._range.lines:
            line.setPen(pg.mkPen(theme.limit, width=2))
        self._now.setPen(pg.mkPen(theme.measured, width=2))
        self._here.setSymbolBrush(theme.measured)
        self._here.setSymbolPen(pg.mkPen(theme.ink, width=1))
        self.dress(theme, f": {NAMES[self.title]} [deg]")

    def draw(self, now: AxisView) -> None:
        self._now.setValue(now.theta_deg)
        self._here.setData([now.theta_deg], [now.factor])


class WristWindow(StopWindow):
    """lead: leads a simulated hand, deg; save_to: a complete calibration, never overwritten."""

    def __init__(
        self,
        feed: LiveFeed,
        display: WristDisplay,
        keeper: ConstraintKeeper,
        dark: bool = False,
        lead: Callable[[float, float], None] | None = None,
        save_to: Path = SAVED,
        guide: Callable[[bool], CalibrationGuide] = CalibrationGuide,
    ) -> None:
        super().__init__()
        self.feed, self.display, self.keeper = feed, display, keeper
        self._lead, self._save_to, self._guide = lead, save_to, guide
        self.hand = WanderingHand()
        self.said, self._frames = "", 0
        self._rows = feed.device.subscribe(list(display.streams))
        identity = feed.device.identity
        mark = "SIMULATED" if feed.device.simulated else ""
        # A motor without an impairment has no constraint to switch, and is stopped all the same.
        self._who, self._drives = identity.who, bool(identity.device.laws)
        self.setWindowTitle(f"{mark} {self._who}: wrist display - esea-host".strip())
        self.bar.mark(mark, self._who)
        self._build()
        self._actions()
        self.set_theme(DARK if dark else LIGHT)
        self.timer.timeout.connect(self.turn)
        self.draw()

    def start(self) -> None:
        self.timer.start(FRAME_MS)

    # -- what there is -----------------------------------------------------------------------------

    def _build(self) -> None:
        self.note = plain_label()
        self.note.setWordWrap(True)
        self.note.setMinimumHeight(40)
        raw = _Pane()
        self.panes: dict[str, SceneView] = {"raw": raw, "normalised": SceneView()}
        self.heads = {n: QLabel() for n in self.panes}
        for label in self.heads.values():
            # No text widens its column.
            label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        grid = QGridLayout()
        for column, name in enumerate(self.panes):
            grid.addWidget(self.heads[name], 0, column)
            grid.addWidget(self.panes[name], 1, column)
            grid.setColumnStretch(column, 5)
        self._area = pg.GraphicsLayoutWidget()
        self._area.setMinimumHeight(LEAST_HEIGHT_PX)
        self._plots = [_FactorPlot(self._area, row, axis) for row, axis in enumerate(AXES)]
        grid.addWidget(self._area, 0, 2, 2, 1)
        grid.setColumnStretch(2, 5)
        grid.setRowStretch(1, 1)
        self.fill(column_of(self._bar(), (grid, 1), self.note))
        if self._lead is not None:
            raw.dragged.connect(self._dragged)

    def _bar(self) -> QHBoxLayout:
        self.buttons: dict[str, QPushButton] = {}
        jobs: dict[str, Job] = {
            "Healthy": partial(self.constrain, False),
            "Constrained": partial(self.constrain, True),
            "Calibrate": self.calibrate,
            "Repeat step": self.back,
        }
        for name, job in jobs.items():
            made = self.buttons[name] = push_button(name, job, focus=False)
            made.setCheckable(name in ("Healthy", "Constrained"))
            needs_motor = name in ("Healthy", "Constrained")
            made.setVisible(self.keeper.there or not needs_motor)
        self.confirmed = QLabel()
        return row_of(*self.buttons.values(), (self.confirmed, 1))

    def _actions(self) -> None:
        self.add_menu("&View", [("Dark, light", "T", self.toggle_theme)])
        if not self._drives:
            self.bar.without_stop()
        self.add_board_steps(self.feed, self.keeper.there, self._rest)

    # -- asking ------------------------------------------------------------------------------------

    def stop(self) -> None:
        """Stop the motors, if there are any, and end a calibration."""
        if self._drives:
            self.feed.stop()
            self.keeper.wanted = False
            self.stop_asked_s = time.monotonic()
        self._end_guide("The calibration was stopped.")

    def _rest(self) -> None:
        self.keeper.arms = False

    def constrain(self, wanted: bool) -> None:
        if self.display.guide is None:
            self.keeper.wanted = wanted

    def calibrate(self) -> None:
        if self.display.guide is not None:
            self._end_guide("The calibration was ended.")
        elif self._off:
            self.said = "Arm the motors first: a healthy wrist is one that they follow with 0 Nm."
        else:
            self.display.guide, self.said = self._guide(self.display.can_constrain), ""

    @property
    def _off(self) -> bool:
        # No state in which a calibration means anything.
        state = self.feed.news.state
        armed = self.keeper.arms or state in WORKING  # one that arms itself soon is again
        return state in ("FAULT", "STOPPED") or (self.keeper.there and not armed)

    def back(self) -> None:
        if self.display.guide is not None:
            self.display.guide.back()

    def _end_guide(self, said: str) -> None:
        if self.display.guide is not None:
            self.display.guide, self.said = None, said
            self.keeper.wanted = False

    def _complete(self, guide: CalibrationGuide) -> None:
        identity = self.feed.device.identity
        self._end_guide("")
        try:
            made = calibration_of(
                guide.past, identity.device.name, identity.content_hash, self.feed.device.simulated
            )
            self.use(made)
            self.said = f"Saved to {save_calibration(self._save_to, made)}."
        except UserError as error:
            self.said = f"No calibration: {error}"

    def use(self, calibration: WristCalibration) -> None:
        self.display.calibrate(calibration)
        self.set_theme(self.theme)

    def _dragged(self, place: tuple[float, float] | None) -> None:
        self.hand.dragged_deg = place

    # -- looking -----------------------------------------------------------------------------------

    def turn(self) -> None:
        self.take()
        self.draw()

    def take(self) -> None:
        with contextlib.suppress(LinkError):  # the feed has it, and shows it
            self.display.receive(self._rows.take(0.0))
            self._go_on()

    def _go_on(self) -> None:
        guide = self.display.guide
        if guide is not None and guide.current is None:
            self._complete(guide)
        elif guide is not None and self._off:
            self._end_guide(f"The board is {self.feed.news.state}: the calibration was ended.")
        elif guide is not None and guide.current is not None:
            self.keeper.wanted = guide.current.constrained
        guide = self.display.guide
        # A simulated hand rests at its zero until the board knows where that is.
        if self._lead is not None and self.feed.news.state not in UNZEROED:
            scene = None if guide is None else guide.scene
            given = self.display.time_s, scene, self.display.angles_deg
            self._lead(*self.hand.aim(*given))

    def draw(self) -> None:
        picture, guide = self.display.picture(), self.display.guide
        self.panes["raw"].show_scene(picture.raw if guide is None else guide.scene)
        self.panes["normalised"].show_scene(picture.normalised)
        for plot, axis in zip(self._plots, picture.axes, strict=True):
            plot.draw(axis)
        self._frames += 1
        if self._frames % TOLD_EVERY == 1:
            self._tell(picture)

    def _tell(self, picture: DisplayPicture) -> None:
        guide = self.display.guide
        self.tell_board(self.feed, [self.keeper.said])
        self.bar.who.setText(f"{self._who}  |  {link_text(self.feed)}")
        self.confirmed.setText(self._constraint(picture.acts))
        for name, wanted in (("Healthy", False), ("Constrained", True)):
            self.buttons[name].setChecked(self.keeper.wanted is wanted)
            self.buttons[name].setEnabled(guide is None)
        self.buttons["Calibrate"].setText("Calibrate" if guide is None else "End calibration")
        self.buttons["Repeat step"].setVisible(guide is not None)
        self._heads(picture)
        self.note.setText(self._note())

    def _heads(self, picture: DisplayPicture) -> None:
        guide = self.display.guide
        left, right = "Raw: the wrist's angle", "Normalised"
        px = min(max(self.width() // 60, 12), 17)
        if guide is not None and guide.current is not None:
            left = f"Step {len(guide.past) + 1} of {len(guide.steps)}, {guide.current.title}"
        if self.display.maps is None:
            right += ": not calibrated" if self.display.can_constrain else ": healthy only"
        elif not picture.applied:
            right += ": healthy, factor 1"
        for name, text in (("raw", left), ("normalised", right)):
            self.heads[name].setText(f'<span style="font-size:{px}px"><b>{text}</b></span>')
        for name, values in (
            ("raw", [a.theta_deg for a in picture.axes]),
            ("normalised", [a.cursor_deg for a in picture.axes]),
        ):
            for axis, value in zip(AXES, values, strict=True):
                told = "\u2013" if self.feed.silent else f"{round(value) + 0.0:+.0f}"
                self.bar.show_value(f"{name} {axis} [deg]", told)

    def _constraint(self, acts: bool | None) -> str:
        if acts is None:
            return "This board has no constraint."
        if acts == self.keeper.wanted:
            return "Constraint confirmed: " + ("acts on both axes" if acts else "off")
        why = "" if self.feed.news.state in WORKING else " (arm the motors first)"
        return f"Constraint {'requested' if self.keeper.wanted else 'ending'}, not confirmed{why}"

    def _note(self) -> str:
        guide, used = self.display.guide, self.display.calibration
        if guide is not None:
            return guide.advice
        parts = [self.said] if self.said else []
        if used is not None:
            mark = "SIMULATED calibration" if used.simulated else "Calibration"
            parts.append(f"{mark} of {used.made}, {used.device}, sha256 {used.sha256[:12]}")
        else:
            parts.append("Calibration takes about five minutes.")
        if self._lead is not None:
            parts.append("Drag the raw cursor to move the simulated hand.")
        news = self.feed.news
        parts += [news.said] if news.said and news.state not in WORKING else []
        return "  |  ".join(parts)

    def set_theme(self, theme: Theme) -> None:
        super().set_theme(theme)
        self._area.setBackground(theme.ground)
        style = (
            f"QPushButton {{background: {theme.ground}; color: {theme.ink};"
            f" border: 1px solid {theme.soft}; border-radius: 4px; padding: 4px 14px;}}"
            f"QPushButton:checked {{background: {theme.wanted}; color: {theme.ground};}}"
            f"QPushButton:disabled:!checked {{color: {theme.soft};}}"
        )
        for button in self.buttons.values():
            button.setStyleSheet(style)
        for pane in self.panes.values():
            pane.set_dark(theme is DARK)
        for plot in self._plots:
            plot.show(self.display, theme)

    def closeEvent(self, event: QCloseEvent) -> None:
        """The connection is not the window's to end."""
        self.feed.device.receiver.unsubscribe(self._rows)
        super().closeEvent(event)
