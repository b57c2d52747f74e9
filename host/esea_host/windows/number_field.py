"""Fields of forms: typed numbers, the same in every locale or refused with the reason; lists."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QColor, QKeyEvent, QPalette, QWheelEvent
from PySide6.QtWidgets import QComboBox, QGridLayout, QLabel, QLineEdit, QWidget

from esea_gen.errors import UserError
from esea_gen.typed import read_number, shown_number

_REFUSED = QColor("#d55e00")


class Choice(QComboBox):
    """A list to choose from; a wheel that scrolls past it changes nothing."""

    def wheelEvent(self, event: QWheelEvent) -> None:
        event.ignore()


class NumberField(QLineEdit):
    """Enter or leaving takes the number; refused text stays, with reason and value in force."""

    taken = Signal(float)
    valueChanged = Signal(float)

    def __init__(self, low: float, high: float, step: float, suffix: str = "") -> None:
        super().__init__()
        self.low, self.high, self._step, self._value = low, high, step, min(max(0.0, low), high)
        self.box, self._unit, self.reason = QWidget(), QLabel(suffix), QLabel()
        self.reason.setWordWrap(True)
        self.reason.setTextFormat(Qt.TextFormat.PlainText)
        grid = QGridLayout(self.box)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(3)
        grid.addWidget(self, 0, 0)
        grid.addWidget(self._unit, 0, 1)
        grid.addWidget(self.reason, 1, 0, 1, 2)
        self.setMinimumWidth(60)
        self.editingFinished.connect(self.take)
        self.textEdited.connect(lambda _: self._explain(""))
        self._show()

    def value(self) -> float:
        return self._value

    def setValue(self, value: float) -> None:
        """Put a number in force; a refused text stays where the number is the same."""
        # From radians and back: 120, not 119.99999999999999.
        value = float(f"{value:.10g}")
        if value != self._value:
            self._value = value
            self._show()
            self.valueChanged.emit(value)

    def suffix(self) -> str:
        return self._unit.text()

    def setSuffix(self, suffix: str) -> None:
        self._unit.setText(suffix)

    def take(self) -> float | None:
        """Put the text in force and return its number; None, with the reason shown, for others."""
        unit = self.suffix().strip()
        try:
            value = read_number(self.text(), self.low, self.high, unit)
        except UserError as error:
            self._explain(f"{error} Still {shown_number(self._value)} {unit}".rstrip() + ".")
            return None
        before, self._value = self._value, value
        self._show()
        if value != before:
            self.valueChanged.emit(value)
            self.taken.emit(value)
        return value

    def keyPressEvent(self, event: QKeyEvent) -> None:
        way = {Qt.Key.Key_Up: 1, Qt.Key.Key_Down: -1}.get(Qt.Key(event.key()))
        if way is None:
            super().keyPressEvent(event)
            return
        try:
            start = read_number(self.text(), self.low, self.high)
        except UserError:
            start = self._value
        self.setText(shown_number(float(f"{start + way * self._step:.10g}")))
        self._explain("")

    def _show(self) -> None:
        self.setText(shown_number(self._value))
        self._explain("")

    def _explain(self, reason: str) -> None:
        self.reason.setText(reason)
        self.reason.setVisible(bool(reason))
        self.setAccessibleDescription(reason)
        palette = QPalette()
        if reason:
            palette.setColor(QPalette.ColorRole.Text, _REFUSED)
        self.setPalette(palette)
