"""Clinician's controls beside the plots: steps, judgements, limits, the board."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QApplication, QGridLayout, QGroupBox, QLabel, QLineEdit, QWidget

from esea_host.assess.board import KneeBoard
from esea_host.assess.desk import long_name
from esea_host.assess.patients import DEG
from esea_host.assess.probing import Comfort
from esea_host.assess.segments import MovementEvent, MovementVerdict
from esea_host.assess.session import WORDS
from esea_host.windows.assess_plots import MovementLoop
from esea_host.windows.bar import restyle
from esea_host.windows.frame import column_of, labelled, push_button, row_of
from esea_host.windows.number_field import Choice, NumberField
from esea_host.windows.theme import Theme, plain_label


class ClinicControls(QWidget):
    """Buttons and fields; signals carry their requests."""

    moved = Signal()
    torque_read = Signal(float)
    felt = Signal(str)
    skipped = Signal(str)
    another = Signal()
    undone = Signal()
    judged = Signal(dict, str)
    limited = Signal(float, float, float)

    def __init__(self, names: Sequence[str], comfort: Comfort, simulated: bool) -> None:
        super().__init__()
        boxes = self._seen(simulated), self._judgement(names), self._limits(comfort)
        column = column_of(*boxes)
        column.setContentsMargins(4, 4, 4, 4)
        column.addStretch(1)
        self.setLayout(column)

    def _seen(self, simulated: bool) -> QGroupBox:
        box, grid = _titled("This movement: what was seen")
        if simulated:
            self.move_button = push_button("Move the simulated leg  (Ctrl+M)", self.moved.emit)
            grid.addWidget(self.move_button, 0, 0, 1, 3)
        self.torque = NumberField(-100, 100, 0.5, "Nm")
        self.torque.setToolTip("Torque of your hands at that moment, bending positive")
        self.words = {w: push_button(w, partial(self.felt.emit, w)) for w in WORDS}
        words = QGridLayout()
        for i, word in enumerate(self.words.values()):
            words.addWidget(word, i // 3, i % 3)
        self.why_skip = QLineEdit()
        self.why_skip.setPlaceholderText("why, such as pain")
        grid.addWidget(labelled("Sensor shows", self.torque), 1, 0)
        grid.addWidget(QLabel("Resistance felt"), 2, 0)
        grid.addWidget(labelled("No result", self.why_skip), 3, 0)
        grid.addWidget(self.torque.box, 1, 1)
        grid.addWidget(push_button("Take", self._take_torque), 1, 2)
        grid.addLayout(words, 2, 1, 1, 2)
        grid.addWidget(self.why_skip, 3, 1)
        skip = push_button("Skip", lambda: self.skipped.emit(self.why_skip.text().strip()))
        grid.addWidget(skip, 3, 2)
        another = push_button("Another movement  (Ctrl+N)", self.another.emit)
        back = push_button("Take back  (Ctrl+Z)", self.undone.emit)
        grid.addLayout(row_of(another, back), 4, 0, 1, 3)
        return box

    def _take_torque(self) -> None:
        torque_Nm = self.torque.take()
        if torque_Nm is not None:
            self.torque_read.emit(torque_Nm)

    def _judgement(self, names: Sequence[str]) -> QGroupBox:
        box, grid = _titled("Your own judgement (kept in the steps)")
        self.name, self.percent, self.why = Choice(), NumberField(0, 100, 5, "%"), QLineEdit()
        for name in names:
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
            self.judged.emit(share, self.why.text().strip())

    def _limits(self, comfort: Comfort) -> QGroupBox:
        box, grid = _titled("Reach and comfort")
        self.low, self.high = NumberField(0, 160, 5, "°"), NumberField(0, 160, 5, "°")
        self.fastest = NumberField(5, 300, 5, "°/s")
        self.show_limits(comfort)
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
        self.limited.emit(self.low.value(), self.high.value(), self.fastest.value())


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
        over = (
            now[1] < limits.low_rad or now[1] > limits.high_rad,
            abs(now[2]) > limits.rate_rad_s,
            False,
        )
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
