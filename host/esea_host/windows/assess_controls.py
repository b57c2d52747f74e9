"""What a clinician does in the window: hand in what was seen, judge, limit, take back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from PySide6.QtCore import Signal
from PySide6.QtWidgets import (
    QGridLayout,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from esea_host.assess.desk import long_name
from esea_host.assess.patients import DEG
from esea_host.assess.probing import Comfort
from esea_host.assess.session import WORDS
from esea_host.windows.number_field import Choice, NumberField


class ClinicControls(QWidget):
    """Buttons and fields; what they ask for is told by signals."""

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
        column = QVBoxLayout(self)
        column.setContentsMargins(4, 4, 4, 4)
        column.addWidget(self._seen(simulated))
        column.addWidget(self._judgement(names))
        column.addWidget(self._limits(comfort))
        column.addStretch(1)

    def _seen(self, simulated: bool) -> QGroupBox:
        box, grid = _titled("This movement: what was seen")
        row = 0
        if simulated:
            self.move_button = _button("Move the simulated leg  (Ctrl+M)", self.moved.emit)
            grid.addWidget(self.move_button, row, 0, 1, 3)
            row += 1
        self.torque = NumberField(-100, 100, 0.5, "Nm")
        self.torque.setToolTip("Torque of your hands at that moment, bending positive")
        grid.addWidget(QLabel("Sensor shows"), row, 0)
        grid.addWidget(self.torque.box, row, 1)
        grid.addWidget(_button("Take", self._take_torque), row, 2)
        grid.addWidget(QLabel("Resistance felt"), row + 1, 0)
        words = QGridLayout()
        self.words = {w: _button(w, partial(self.felt.emit, w)) for w in WORDS}
        for i, button in enumerate(self.words.values()):
            words.addWidget(button, i // 3, i % 3)
        grid.addLayout(words, row + 1, 1, 1, 2)
        self.why_skip = QLineEdit()
        self.why_skip.setPlaceholderText("why, such as pain")
        grid.addWidget(QLabel("No result"), row + 2, 0)
        grid.addWidget(self.why_skip, row + 2, 1)
        skip = _button("Skip", lambda: self.skipped.emit(self.why_skip.text().strip()))
        grid.addWidget(skip, row + 2, 2)
        both = QHBoxLayout()
        both.addWidget(_button("Another movement  (Ctrl+N)", self.another.emit))
        both.addWidget(_button("Take back  (Ctrl+Z)", self.undone.emit))
        grid.addLayout(both, row + 3, 0, 1, 3)
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
        grid.addWidget(_button("Set", self._judge), 1, 1)
        return box

    def _judge(self) -> None:
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
            grid.addWidget(QLabel(text), 0, 2 * i)
            grid.addWidget(field.box, 0, 2 * i + 1)
            grid.addWidget(field.reason, i + 1, 0, 1, 6)
            field.taken.connect(self._limit)
        return box

    def show_limits(self, comfort: Comfort) -> None:
        self.low.setValue(comfort.low_rad / DEG)
        self.high.setValue(comfort.high_rad / DEG)
        self.fastest.setValue(comfort.rate_rad_s / DEG)

    def _limit(self) -> None:
        self.limited.emit(self.low.value(), self.high.value(), self.fastest.value())


def _titled(title: str) -> tuple[QGroupBox, QGridLayout]:
    box = QGroupBox(title)
    grid = QGridLayout(box)
    grid.setContentsMargins(8, 6, 8, 6)
    grid.setVerticalSpacing(4)
    return box, grid


def _button(text: str, job: Callable[[], object]) -> QPushButton:
    button = QPushButton(text)
    button.clicked.connect(lambda _checked=False: job())
    return button
