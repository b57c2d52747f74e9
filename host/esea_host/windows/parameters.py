"""The parameter editor: values in force, bounds, units; a change is shown before it is sent."""

from __future__ import annotations

import math
from functools import partial

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QPushButton, QTableWidget, QTableWidgetItem, QWidget

from esea_gen.errors import UserError
from esea_gen.typed import read_number, shown_number
from esea_host.windows.feed import LiveFeed
from esea_host.windows.frame import column_of, row_of
from esea_host.windows.theme import plain_label, plain_tip

HEADS = ("parameter", "in force", "new", "unit", "bounds", "effect")
NEW, MOST_HEIGHT_PX = 2, 210


class ParameterEditor(QWidget):
    answered = Signal(dict)  # from the thread that asks the board to the one that draws

    def __init__(self, feed: LiveFeed) -> None:
        super().__init__()
        self._feed = feed
        self.known = [p for p in feed.device.session.known_parameters() if not p.fixed]
        self._values: dict[str, float] = {}
        self.answered.connect(self._show)
        self.table = QTableWidget(len(self.known), len(HEADS))
        self.table.setHorizontalHeaderLabels(HEADS)
        self.table.setAccessibleName("Parameters")
        self.table.verticalHeader().hide()
        self.table.horizontalHeader().setStretchLastSection(True)
        self.table.cellChanged.connect(self._compared)
        self.changes = plain_label("Nothing is changed.")
        self.changes.setWordWrap(True)
        self.write_button = QPushButton("Write changes (Ctrl+Return)")
        self.write_button.setEnabled(False)
        self.write_button.clicked.connect(self.write)
        QShortcut(QKeySequence("Ctrl+Return"), self).activated.connect(self.write)
        self.setMaximumHeight(MOST_HEIGHT_PX)  # the plots need the rest
        self.setLayout(column_of(self.table, row_of((self.changes, 1), self.write_button)))

    def read(self) -> None:
        def job() -> str:
            values = self._feed.read_parameters()
            self.answered.emit(values)
            return f"{len(values)} parameters"

        self._feed.do("read", job)

    def _show(self, values: dict[str, float]) -> None:
        self._values = {p.name: values.get(p.name, math.nan) for p in self.known}
        self.table.blockSignals(True)
        for row, p in enumerate(self.known):
            value = f"{self._values[p.name]:.7g}"
            cells = (p.name, value, value, p.unit, f"{p.low:g} to {p.high:g}", p.meaning)
            for place, text in enumerate(cells):
                item = QTableWidgetItem(text)
                item.setToolTip(plain_tip(p.meaning))
                if place != NEW:
                    item.setFlags(item.flags() & ~Qt.ItemFlag.ItemIsEditable)
                self.table.setItem(row, place, item)
        self.table.blockSignals(False)
        self.table.resizeColumnsToContents()
        self._compared()

    def differences(self) -> tuple[dict[str, float], list[str]]:
        """Changes that would be written, and errors in the others."""
        wanted, faults = {}, []
        for row, p in enumerate(self.known):
            new, held = self.table.item(row, NEW), self.table.item(row, NEW - 1)
            if new is None or held is None or new.text() == held.text():
                continue
            try:
                wanted[p.name] = read_number(new.text(), p.low, p.high, p.unit)
            except UserError as error:
                faults.append(f"{p.name}: {error}")
        return wanted, faults

    def _compared(self) -> None:
        wanted, faults = self.differences()
        units = {p.name: p.unit for p in self.known}
        lines = [
            f"{n}: {self._values[n]:g} -> {shown_number(v)} {units[n]}" for n, v in wanted.items()
        ]
        self.changes.setText("; ".join(faults or lines) or "Nothing is changed.")
        self.write_button.setEnabled(bool(wanted) and not faults)

    def write(self) -> None:
        """Send the displayed changes; the board refuses while the motor is on."""
        wanted, faults = self.differences()
        if faults:
            return
        for name, value in wanted.items():
            self._feed.do(f"set {name}", partial(self._feed.device.set, name, value))
        if wanted:
            self.read()
