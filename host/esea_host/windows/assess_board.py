"""The board in the clinician's window: what it measures now, the limits, and what came of a try."""

from __future__ import annotations

import time

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QApplication, QGridLayout, QLabel, QWidget

from esea_host.assess.board import KneeBoard
from esea_host.assess.patients import DEG
from esea_host.assess.segments import MovementEvent, MovementVerdict
from esea_host.windows.assess_plots import MovementLoop
from esea_host.windows.frame import column_of, push_button, row_of
from esea_host.windows.theme import Theme, plain_label

WARNED_S = 2.0
STATES = {"UNREFERENCED": "not zeroed", "READY": "ready", "FAULT": "fault", "STOPPED": "stopped"}


class BoardPanel(QWidget):
    """Angle, speed and torque as they come, torque over angle, and what to do with a movement."""

    kept = Signal()
    repeated = Signal()
    zeroed = Signal()

    def __init__(self, board: KneeBoard) -> None:
        super().__init__()
        self.board, self.loop = board, MovementLoop()
        self.warning, self.verdict = QLabel(), plain_label()
        self.numbers = [QLabel() for _ in range(4)]
        self._warned_s = -WARNED_S
        self._from_s, self._to_s = 0.0, float("inf")
        self.verdict.setWordWrap(True)
        words = QGridLayout()
        for i, (text, label) in enumerate(
            zip(("Bending", "Speed", "Torque", "Board"), self.numbers, strict=True)
        ):
            words.addWidget(QLabel(text), i, 0)
            words.addWidget(label, i, 1)
        words.setColumnMinimumWidth(1, 84)
        zero = push_button("Zero the board", self.zeroed.emit)
        zero.setToolTip("The leg straight and resting, hands off the coupling, keep still")
        words.addWidget(zero, 4, 0, 1, 2)
        words.setRowStretch(5, 1)
        self.keep = push_button("Keep  (Space)", self.kept.emit)
        self.repeat = push_button("Repeat  (R)", self.repeated.emit)
        middle, both = row_of((self.loop.view, 1), words), row_of(self.keep, self.repeat)
        column = column_of(self.warning, (middle, 1), self.verdict, both)
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
        rows = np.array([r for r in board.rows if self._from_s <= r[0] <= self._to_s])
        rows = rows[::10] if len(rows) else np.zeros((0, 4))
        now = board.rows[-1] if board.rows else (0.0, np.nan, np.nan, np.nan)
        self.loop.draw(rows[:, 1] / DEG, rows[:, 3], (now[1] / DEG, now[3]), limits)
        trouble = board.trouble()
        shown = ["–"] * 3
        if not trouble and board.rows:
            shown = [f"{now[1] / DEG:.0f}°", f"{now[2] / DEG:.0f}°/s", f"{now[3]:.1f} Nm"]
        state = board.state()
        shown.append(STATES.get(state, state.lower()))
        over = (
            now[1] < limits.low_rad or now[1] > limits.high_rad,
            abs(now[2]) > limits.rate_rad_s,
            False,
            bool(trouble),
        )
        for label, text, alarming in zip(self.numbers, shown, over, strict=True):
            label.setText(f"<b>{text}</b>")
            label.setStyleSheet(f"color: {self.theme.alarm if alarming else self.theme.ink}")
        warned = time.monotonic() - self._warned_s < WARNED_S
        ground = self.theme.alarm if warned else "transparent"
        self.warning.setStyleSheet(
            f"background: {ground}; color: {'white' if warned else 'transparent'};"
            " font-size: 15px; font-weight: bold; padding: 3px; border-radius: 4px"
        )
        ready = "Make the movement shown; it is judged when the leg is at rest again."
        self.verdict.setText(trouble or (attempt.text if attempt else ready))
        alarming = bool(trouble) or (attempt is not None and not attempt.passed)
        good = self.theme.good if attempt is not None else self.theme.soft
        self.verdict.setStyleSheet(f"color: {self.theme.alarm if alarming else good}")
        for button in (self.keep, self.repeat):
            button.setEnabled(attempt is not None)
