"""An adverse event in the operator's window: the trial is stopped first, if asked, then written."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

from PySide6.QtWidgets import QFrame, QLabel, QLineEdit

from esea_host.study.conductor import Conductor
from esea_host.study.records import RELATIONS, SEVERITIES
from esea_host.study.words import Words
from esea_host.windows.frame import column_of, labelled, push_button, row_of
from esea_host.windows.number_field import Choice
from esea_host.windows.theme import Theme

# What is recorded is the key.
CHOICES = {
    "severity": SEVERITIES,
    "relation": RELATIONS,
    "action": (
        *("none", "trial-stopped", "session-stopped", "device-changed", "treated"),
        "withdrawn",
    ),
}


class AdversePanel(QFrame):
    """A part of the window, so that nothing ever covers the stop."""

    def __init__(self, conductor: Conductor, words: Words) -> None:
        super().__init__()
        self.conductor, self.words = conductor, words
        self.setFrameShape(QFrame.Shape.StyledPanel)
        self._writer = ThreadPoolExecutor(1)
        self.writing: Future[None] | None = None
        self.choices = {name: Choice() for name in CHOICES}
        columns = []
        for name, choice in self.choices.items():
            choice.addItem(words("adverse.choose"), "")
            for key in CHOICES[name]:
                choice.addItem(words(f"adverse.{key}"), key)
            columns.append((column_of(labelled(words(f"adverse.{name}"), choice), choice), 1))
        self.text, self.told = QLineEdit(), QLabel()
        self.text.setPlaceholderText(words("adverse.write_here"))
        self.told.setWordWrap(True)
        self.stop_trial = push_button(words("adverse.stop_trial"), conductor.hold_now, focus=False)
        record = push_button(words("adverse.record"), self.record, focus=False)
        cancel = push_button(words("adverse.cancel"), self.leave, focus=False)
        title = QLabel(f"<b>{words('adverse.title')}</b>")
        upper = row_of((title, 1), self.stop_trial)
        lower = row_of((self.text, 1), record, cancel)
        self.setLayout(column_of(upper, row_of(*columns), lower, self.told))
        self.told.hide()
        self.hide()

    def open(self) -> None:
        self.show()
        self.choices["severity"].setFocus()

    def leave(self) -> None:
        """Leave without a record; the entries are discarded."""
        for choice in self.choices.values():
            choice.setCurrentIndex(0)
        self.text.clear()
        self._tell("")
        self.hide()

    def record(self) -> None:
        chosen = {name: str(c.currentData()) for name, c in self.choices.items()}
        text = self.text.text().strip()
        if not text or not all(chosen.values()):
            self._tell(self.words("adverse.lacking"))
            return
        # Beside the window: another program may hold the record, and the stop must not wait for it.
        if self.writing is None:
            self.writing = self._writer.submit(self.conductor.adverse, **chosen, text=text)

    def look(self) -> None:
        """Whether it is written; if it could not be, the fields keep it."""
        if self.writing is None or not self.writing.done():
            return
        error, self.writing = self.writing.exception(), None
        if error is None:
            self.leave()
        else:
            self._tell(self.words("adverse.not_recorded", problem=str(error)))

    def show_theme(self, theme: Theme) -> None:
        self.told.setStyleSheet(f"color: {theme.alarm}")

    def _tell(self, text: str) -> None:
        self.told.setText(text)
        self.told.setVisible(bool(text))
