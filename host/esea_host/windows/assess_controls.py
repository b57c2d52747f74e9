"""Parts of the clinician's window: steps, judgements, limits, the board, and the plots."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt
import pyqtgraph as pg
from PySide6.QtCore import QRectF, Qt
from PySide6.QtWidgets import QApplication, QGridLayout, QGroupBox, QLabel, QLineEdit, QWidget

from esea_host.assess.board import KneeBoard
from esea_host.assess.database import LocationGrid
from esea_host.assess.desk import ClinicDesk, long_name
from esea_host.assess.patients import DEG
from esea_host.assess.probing import Comfort, ProbingMovement
from esea_host.assess.segments import MovementEvent, MovementVerdict
from esea_host.assess.session import WORDS
from esea_host.windows.bar import restyle
from esea_host.windows.frame import Job, coloured, column_of, labelled, push_button, row_of
from esea_host.windows.number_field import Choice, NumberField
from esea_host.windows.plots import PlotPanel, legend
from esea_host.windows.theme import Theme, plain_label


class ClinicControls(QWidget):
    """Buttons and fields; step: does a job of the desk, and shows what came of it."""

    def __init__(
        self,
        desk: ClinicDesk,
        step: Callable[[Job], None],
        move: Job,
        undo: Job,
        limit: Callable[[float, float, float], None],
    ) -> None:
        super().__init__()
        self._desk, self._step, self._limited = desk, step, limit
        column = column_of(self._seen(move, undo), self._judgement(), self._limits())
        column.setContentsMargins(4, 4, 4, 4)
        column.addStretch(1)
        self.setLayout(column)

    def _seen(self, move: Job, undo: Job) -> QGroupBox:
        box, grid = _titled("Result of this movement")
        desk, step = self._desk, self._step
        if desk.patient is not None:
            self.move_button = push_button("Move the simulated leg  (Ctrl+M)", move)
            grid.addWidget(self.move_button, 0, 0, 1, 3)
        self.torque = NumberField(-100, 100, 0.5, "Nm")
        self.torque.setToolTip("Torque of your hands at that moment, bending positive")
        self.words = {w: push_button(w, partial(step, partial(desk.word, w))) for w in WORDS}
        words = QGridLayout()
        for i, word in enumerate(self.words.values()):
            words.addWidget(word, i // 3, i % 3)
        self.why_skip = QLineEdit()
        self.why_skip.setPlaceholderText("why, such as pain")
        grid.addWidget(labelled("Sensor shows", self.torque), 1, 0)
        grid.addWidget(QLabel("Resistance felt"), 2, 0)
        grid.addWidget(labelled("No result", self.why_skip), 3, 0)
        grid.addWidget(self.torque.box, 1, 1)
        grid.addWidget(push_button("Take", self.take_torque), 1, 2)
        grid.addLayout(words, 2, 1, 1, 2)
        grid.addWidget(self.why_skip, 3, 1)
        self.skip = push_button(
            "Skip", lambda: step(partial(desk.skip, self.why_skip.text().strip()))
        )
        grid.addWidget(self.skip, 3, 2)
        self.another = push_button("Another movement  (Ctrl+N)", partial(step, desk.leave_out))
        back = push_button("Take back  (Ctrl+Z)", undo)
        grid.addLayout(row_of(self.another, back), 4, 0, 1, 3)
        return box

    def take_torque(self) -> None:
        torque_Nm = self.torque.take()
        if torque_Nm is not None:
            self._step(partial(self._desk.torque, torque_Nm))

    def _judgement(self) -> QGroupBox:
        box, grid = _titled("Your own judgement (kept in the steps)")
        self.name, self.percent, self.why = Choice(), NumberField(0, 100, 5, "%"), QLineEdit()
        for name in self._desk.session.names:
            self.name.addItem(long_name(name), name)
        self.percent.setValue(50)
        self.why.setPlaceholderText("why, such as the history")
        grid.addWidget(self.name, 0, 0)
        grid.addWidget(self.percent.box, 0, 1)
        grid.addWidget(self.percent.reason, 2, 0, 1, 2)
        grid.setColumnStretch(0, 1)
        grid.addWidget(self.why, 1, 0)
        grid.addWidget(push_button("Set", self.judge), 1, 1)
        return box

    def judge(self) -> None:
        percent = self.percent.take()
        if percent is not None:
            share = {str(self.name.currentData()): percent / 100}
            self._step(partial(self._desk.override, share, self.why.text().strip()))

    def _limits(self) -> QGroupBox:
        box, grid = _titled("Reach and comfort")
        self.low, self.high = NumberField(0, 160, 5, "°"), NumberField(0, 160, 5, "°")
        self.fastest = NumberField(5, 300, 5, "°/s")
        self.show_limits(self._desk.comfort)
        for i, (text, field) in enumerate(
            (("from", self.low), ("to", self.high), ("at most", self.fastest))
        ):
            grid.addWidget(labelled(text, field), 0, 2 * i)
            grid.addWidget(field.box, 0, 2 * i + 1)
            grid.addWidget(field.reason, i + 1, 0, 1, 6)
            field.taken.connect(self.limit)
        return box

    def show_limits(self, comfort: Comfort) -> None:
        self.low.setValue(comfort.low_rad / DEG)
        self.high.setValue(comfort.high_rad / DEG)
        self.fastest.setValue(comfort.rate_rad_s / DEG)

    def limit(self) -> None:
        self._limited(self.low.value(), self.high.value(), self.fastest.value())


def _titled(title: str) -> tuple[QGroupBox, QGridLayout]:
    box = QGroupBox(title)
    grid = QGridLayout(box)
    grid.setContentsMargins(8, 6, 8, 6)
    grid.setVerticalSpacing(4)
    return box, grid


WARNED_S = 2.0


class BoardPanel(QWidget):
    """Angle, speed and torque as they come, torque over angle, and the verdict on a movement."""

    def __init__(self, board: KneeBoard) -> None:
        super().__init__()
        self.board, self.loop = board, MovementLoop()
        self.warning, self.verdict = QLabel(), plain_label()
        self.numbers = [QLabel() for _ in range(3)]
        self._warned_s = -WARNED_S
        self._from_s, self._to_s = 0.0, float("inf")
        self.verdict.setWordWrap(True)
        words = QGridLayout()
        for i, (text, label) in enumerate(
            zip(("Bending", "Speed", "Torque"), self.numbers, strict=True)
        ):
            words.addWidget(QLabel(text), i, 0)
            words.addWidget(label, i, 1)
        words.setColumnMinimumWidth(1, 84)
        words.setRowStretch(5, 1)
        column = column_of(self.warning, (row_of((self.loop.view, 1), words), 1), self.verdict)
        column.setContentsMargins(4, 4, 4, 4)
        column.setSpacing(3)
        self.setLayout(column)

    def show_theme(self, theme: Theme) -> None:
        self.theme = theme
        self.loop.show(theme)

    def take(self, event: MovementEvent) -> None:
        if event.kind in ("warning", "broken"):
            self._warned_s = time.monotonic()
            self.warning.setText(event.text)
            QApplication.beep()
        elif event.kind == "started":
            self._from_s, self._to_s = event.time_s, float("inf")
        elif event.segment is not None:
            self._to_s = event.segment.end_s

    def draw(self, attempt: MovementVerdict | None) -> None:
        board = self.board
        limits = board.watch.comfort
        seen = [r for r in board.rows if self._from_s <= r[0] <= self._to_s]
        rows = np.array(seen[::10]).reshape(-1, 4)
        now = board.rows[-1] if board.rows else (0.0, np.nan, np.nan, np.nan)
        self.loop.draw(rows[:, 1] / DEG, rows[:, 3], (now[1] / DEG, now[3]), limits)
        trouble = board.trouble()
        shown = ["–"] * 3
        if not trouble and board.rows:
            shown = [f"{now[1] / DEG:.0f}°", f"{now[2] / DEG:.0f}°/s", f"{now[3]:.1f} Nm"]
        beyond = now[1] < limits.low_rad or now[1] > limits.high_rad
        over = beyond, abs(now[2]) > limits.rate_rad_s, False
        for label, text, alarming in zip(self.numbers, shown, over, strict=True):
            label.setText(f"<b>{text}</b>")
            restyle(label, f"color: {self.theme.alarm if alarming else self.theme.ink}")
        warned = time.monotonic() - self._warned_s < WARNED_S
        ground = self.theme.alarm if warned else "transparent"
        restyle(
            self.warning,
            f"background: {ground}; color: {'white' if warned else 'transparent'};"
            " font-size: 15px; font-weight: bold; padding: 3px; border-radius: 4px",
        )
        ready = "Make the movement shown; it is judged when the leg is at rest again."
        self.verdict.setText(trouble or (attempt.text if attempt else ready))
        alarming = bool(trouble) or (attempt is not None and not attempt.passed)
        good = self.theme.good if attempt is not None else self.theme.soft
        restyle(self.verdict, f"color: {self.theme.alarm if alarming else good}")


Floats = npt.NDArray[np.float64]
MOST_LINES, TITLE_PX = 5, 46
MARKS = ("o", "s", "t", "d", "+")


class _Plot(PlotPanel):
    # One plot in a widget of its own, with limits: upright at 90 deg, level at 0.
    def __init__(self, title: str, x: str, y: str, limits: Sequence[float] = ()) -> None:
        self.view = pg.PlotWidget()
        super().__init__(self.view.getPlotItem(), title, x, y)
        self.item.layout.setContentsMargins(1, 1, 8, 1)
        self.limits = [pg.InfiniteLine(angle=a) for a in limits]
        for line in self.limits:
            self.item.addItem(line, ignoreBounds=True)

    def show(self, theme: Theme) -> None:
        self.theme = theme
        self.view.setBackground(theme.ground)
        self.dress(theme)
        for line in self.limits:
            line.setPen(pg.mkPen(theme.limit, width=2, style=Qt.PenStyle.DashLine))

    def place_limits(self, *ends: float) -> None:
        for line, at in zip(self.limits, ends, strict=True):
            line.setValue(at)


class InformationMap(_Plot):
    """Angle x rate: expected information of a movement, limits, passed cells, the next one."""

    def __init__(self, grid: LocationGrid) -> None:
        labels = "bending of the knee [°]", "speed [°/s], + bending"
        super().__init__("Most informative movement", *labels, (90, 90, 0, 0))
        self._grid = grid
        self.image = pg.ImageItem()
        self.item.addItem(self.image)
        self._been = self.item.plot(pen=None, symbol="o", symbolSize=4, symbolPen=None)
        self._way, self._best = self.item.plot(), self.item.plot(pen=None, symbol="star")
        self._best.setSymbolSize(18)
        steps = np.diff(grid.angle_rad)[0] / DEG, np.diff(grid.rate_rad_s)[0] / DEG
        low = grid.angle_rad[0] / DEG - steps[0] / 2, grid.rate_rad_s[0] / DEG - steps[1] / 2
        size = steps[0] * len(grid.angle_rad), steps[1] * len(grid.rate_rad_s)
        self._place = QRectF(low[0], low[1], size[0], size[1])
        self.item.setXRange(low[0], low[0] + size[0], padding=0.02)
        self.item.setYRange(low[1], low[1] + size[1], padding=0.05)

    def show(self, theme: Theme) -> None:
        super().show(theme)
        colours = ((28, 40, 56), (32, 120, 150), (240, 228, 66))
        if theme.name == "light":
            colours = ((247, 250, 220), (65, 160, 190), (8, 29, 88))
        self._colours = pg.ColorMap((0.0, 0.5, 1.0), colours)
        self._been.setSymbolBrush(theme.limit)
        self._way.setPen(pg.mkPen(theme.measured, width=2))
        self._best.setSymbolBrush(theme.measured)
        self._best.setSymbolPen(theme.ink)

    def draw(
        self, value: Floats, passed_deg: Floats, move: ProbingMovement, comfort: Comfort, unit: str
    ) -> None:
        shape = len(self._grid.angle_rad), len(self._grid.rate_rad_s)
        most = max(float(np.nanmax(value)), 1e-12)
        share = np.nan_to_num(value / most).reshape(shape)
        picture = self._colours.map(share, mode="byte").reshape(*shape, 4)
        picture[np.isnan(value).reshape(shape), 3] = 0
        self.image.setImage(picture, axisOrder="col-major")
        self.image.setRect(self._place)
        rate = comfort.rate_rad_s / DEG
        self.place_limits(comfort.low_rad / DEG, comfort.high_rad / DEG, -rate, rate)
        self._been.setData(passed_deg[:, 0], passed_deg[:, 1])
        angle, speed = move.at(np.linspace(0, move.duration_s, 80))
        self._way.setData(angle / DEG, speed / DEG)
        where = move.location
        self._best.setData([where.angle_rad / DEG], [where.rate_rad_s / DEG])
        strong = "yellow" if self.theme.name == "dark" else "dark"
        about = f"{strong}: most, {most:.2f} {unit}; empty: out of reach, comfort or data"
        title = f"<b>{self.title}</b> &nbsp; {coloured(about, self.theme.soft)}"
        self.item.setTitle(title, color=self.theme.ink, size="9pt")


class MovementLoop(_Plot):
    """Torque over angle of the movement under way, or of the last one, and the comfort range."""

    def __init__(self) -> None:
        super().__init__("This movement", "bending of the knee [°]", "torque [Nm]", (90, 90))
        self._curve = self.item.plot()
        self._now = self.item.plot(pen=None, symbol="o", symbolSize=9)
        self.item.setMouseEnabled(x=False, y=False)

    def show(self, theme: Theme) -> None:
        super().show(theme)
        self._curve.setPen(pg.mkPen(theme.measured, width=2))
        self._now.setSymbolBrush(theme.ink)
        self._now.setSymbolPen(None)

    def draw(
        self, angle_deg: Floats, torque_Nm: Floats, now: tuple[float, float], comfort: Comfort
    ) -> None:
        ends = comfort.low_rad / DEG, comfort.high_rad / DEG
        self.place_limits(*ends)
        self._curve.setData(angle_deg, torque_Nm)
        self._now.setData(*([x] if np.isfinite(x) else [] for x in now))
        self.item.setXRange(ends[0] - 10, ends[1] + 10, padding=0)
        most = float(np.max(np.abs(torque_Nm), initial=15.0))
        self.item.setYRange(-most, most, padding=0.05)


class ProbabilityBars(_Plot):
    def __init__(self, names: list[str]) -> None:
        super().__init__("Probabilities now", "probability [%]", "")
        self._names = names
        self._bars = pg.BarGraphItem(x0=0, y=[0], height=0.7, width=[0])
        self.item.addItem(self._bars)
        self.item.setMouseEnabled(x=False, y=False)
        self.item.setXRange(0, 100, padding=0.06)
        self.item.invertY(True)
        self.item.getAxis("left").setWidth(165)

    def show(self, theme: Theme) -> None:
        super().show(theme)
        self._bars.setOpts(brush=theme.wanted, pen=theme.wanted)

    def draw(self, probabilities: Floats) -> None:
        """Of mixtures, which are many, the likeliest are enough."""
        order = np.argsort(-probabilities, kind="stable")[:14]
        shown = np.sort(order) if len(probabilities) <= 14 else order
        rows = np.arange(len(shown))
        self._bars.setOpts(y=rows, width=100 * probabilities[shown])
        ticks = [(int(r), self._names[i]) for r, i in zip(rows, shown, strict=True)]
        self.item.getAxis("left").setTicks([ticks])
        self.item.setYRange(-0.6, len(shown) - 0.4, padding=0)


class HistoryPlot(_Plot):
    def __init__(self, names: list[str]) -> None:
        super().__init__("Probability history", "step", "probability [%]")
        self._names = names
        self._lines = [self.item.plot(symbol=m) for m in MARKS]
        self.item.setYRange(0, 100, padding=0.04)
        self.item.setMouseEnabled(y=False)

    def show(self, theme: Theme) -> None:
        super().show(theme)
        for line, colour in zip(self._lines, theme.curves, strict=False):
            line.setPen(pg.mkPen(colour, width=2))
            line.setSymbolBrush(colour)
            line.setSymbolPen(None)
            line.setSymbolSize(6)

    def draw(self, steps: Floats) -> None:
        """The likeliest of all steps, shape (steps, hypotheses), with their names."""
        top = np.argsort(-steps.max(axis=0), kind="stable")[:MOST_LINES]
        top = top[np.argsort(-steps[-1, top], kind="stable")]
        parts = []
        for i, line, colour in zip(top, self._lines, self.theme.curves, strict=False):
            line.setData(np.arange(len(steps)), 100 * steps[:, i])
            parts.append((self._names[i], colour))
        self.item.setXRange(0, max(5, len(steps) - 1), padding=0.03)
        names = "<br>".join(legend(parts[k : k + 3]) for k in (0, 3))
        title = f"<b>{self.title}</b><br>{names}"
        self.item.setTitle(title, color=self.theme.ink, size="8pt")
        # Three lines; a title is set to the height of one.
        self.item.titleLabel.setMaximumHeight(TITLE_PX)
        self.item.layout.setRowFixedHeight(0, TITLE_PX)
