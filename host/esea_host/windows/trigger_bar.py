"""Level, edge, source and mode of the trigger, as a line of small fields."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QWidget

from esea_host.windows.number_field import Choice, NumberField
from esea_host.windows.plots import ShownSignal
from esea_host.windows.trigger import MODES, OFF, SINGLE, Trigger


class TriggerBar(QWidget):
    def __init__(
        self, trigger: Trigger, signals: list[ShownSignal], now: Callable[[], float]
    ) -> None:
        super().__init__()
        self.trigger, self._now = trigger, now
        self.source, self.mode, self.edge = Choice(), Choice(), Choice()
        self.level = NumberField(-1e6, 1e6, 0.1)
        self.mode.addItems(list(MODES))
        self.edge.addItems(["rises", "falls"])
        self.again = QPushButton("Again")
        self.again.clicked.connect(self.apply)
        row = QHBoxLayout(self)
        row.setContentsMargins(4, 0, 4, 0)
        for text, widget in (
            ("Trigger", self.mode),
            ("when", self.source),
            ("", self.edge),
            ("through", self.level.box),
            ("", self.again),
        ):
            if text:
                row.addWidget(QLabel(text))
            row.addWidget(widget)
        row.addStretch(1)
        self.offer(signals)
        self.source.currentIndexChanged.connect(self._unit)
        for signal in (self.mode.currentIndexChanged, self.edge.currentIndexChanged):
            signal.connect(self.apply)
        self.source.currentIndexChanged.connect(self.apply)
        self.level.valueChanged.connect(self.apply)

    def offer(self, signals: list[ShownSignal]) -> None:
        """Signals to choose from; the chosen one stays where it still is there."""
        self._signals, before = signals, self.source.currentText()
        self.source.blockSignals(True)
        self.source.clear()
        self.source.addItems([s.name for s in signals])
        self.source.setCurrentIndex(max(0, self.source.findText(before)))
        self.source.blockSignals(False)
        self._unit()

    def _unit(self, *_: object) -> None:
        self.level.setSuffix(f" {self.signal.unit}")

    @property
    def signal(self) -> ShownSignal:
        return self._signals[max(0, self.source.currentIndex())]

    def apply(self, *_: object) -> None:
        t = self.trigger
        t.mode, t.level = self.mode.currentText() or OFF, self.level.value()
        t.rising = self.edge.currentIndex() == 0
        self.again.setEnabled(t.mode == SINGLE)
        t.arm(self._now())
