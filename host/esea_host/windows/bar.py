"""The bar on top of every window: state, next steps, active limits, and STOP.  It never scrolls."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from html import escape

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QFont, QFontMetrics, QResizeEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QSizePolicy, QVBoxLayout, QWidget

from esea_host.windows.theme import BANNER_STYLE, STATE_STYLES, Theme, plain_label, plain_tip

STOP_PX = QSize(150, 92)  # the same in every window
# 46 px are 16 minutes of arc at 2 m on a screen of 92 dpi, the least of ISO 9241-303.
LEAST_PX, NARROW_PX, MOST_PX, WIDTHS = 20, 26, 46, 28
STEP_PX, WORDS_PX, INDICATORS_PX = QSize(98, 42), 34, 34
MARGIN_PX, NOTICE_S = 8, 5.0
STOP_LETTERS_PX = 22, 9  # of STOP, and of a longer word of another language
STOP_STYLE = (
    "QPushButton {background: #b3261e; color: white; font-size: %dpx; font-weight: bold;"
    " border-radius: 6px; padding: 4px;}"
    "QPushButton:pressed {background: #7d1410;}"
    "QPushButton:disabled {background: transparent; color: #808890; font-size: 13px;"
    " font-weight: normal; border: 1px dashed #808890;}"
)


def stop_style(text: str) -> str:
    """In the largest letters with which the text is complete."""
    most, least = STOP_LETTERS_PX
    font, room = QFont(), STOP_PX - QSize(16, 12)
    font.setBold(True)
    for px in range(most, least - 1, -1):
        font.setPixelSize(px)
        needed = QFontMetrics(font).size(0, text)
        if needed.expandedTo(room) == room:
            break
    return STOP_STYLE % px


def restyle(widget: QWidget, style: str) -> None:
    """Set a style only if it changed: Qt recomputes it otherwise."""
    if widget.styleSheet() != style:
        widget.setStyleSheet(style)


class StepButton(QPushButton):
    """A possible next step; if it would be refused, the reason is below its name."""

    def __init__(self, name: str, keys: str, job: Callable[[], object]) -> None:
        super().__init__()
        self.name, self.keys, self.refusal = name, keys, ""
        needed = self.fontMetrics().horizontalAdvance(name) + 16
        self.setMinimumSize(STEP_PX.expandedTo(QSize(needed, 0)))
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.clicked.connect(lambda *_: job())
        self.refuse("")

    def refuse(self, reason: str, name: str = "") -> None:
        """Empty: it may be pressed; name: another one from now on."""
        self.name, self.refusal = name or self.name, reason
        text = f"{self.name}\n{reason or self.keys}".rstrip()
        if text != self.text():
            self.setText(text)
        self.setEnabled(not reason)


class IndicatorRow(QLabel):
    """Each limit at its place, lit while it acts; where not all have room, those only that act."""

    def __init__(self) -> None:
        super().__init__()
        self.meanings: dict[str, str] = {}
        self._drawn: tuple[object, ...] = ()
        self.setTextFormat(Qt.TextFormat.RichText)
        self.setFixedHeight(INDICATORS_PX)
        self.hide()

    def offer(self, meanings: Mapping[str, str]) -> None:
        self.meanings = dict(meanings)
        self.setVisible(bool(meanings))

    def light(self, acting: Mapping[str, str], theme: Theme) -> None:
        """acting: names and meanings, also of such that are shown only while they act."""
        if (drawn := (acting, theme, self.width())) == self._drawn:
            return
        self._drawn, (ground, ink) = drawn, STATE_STYLES["caution"]
        lit, soft = f"background:{ground}; color:{ink}; font-weight:bold", f"color:{theme.soft}"
        chips = {
            name: f'<span style="{lit if name in acting else soft}">&nbsp;'
            + escape(name).replace(" ", "&nbsp;")
            + "&nbsp;</span>"
            for name in self.meanings | dict(acting)
        }
        self.setText(" ".join(chips.values()))
        if self.heightForWidth(self.width()) > INDICATORS_PX:
            self.setText(" ".join(chips[name] for name in acting))
        self.setToolTip("".join(plain_tip(f"{n}: {m}") for n, m in acting.items()))
        self.setAccessibleDescription(", ".join(acting))


class BoardBar(QWidget):
    """Bar with the state of a window's board or session, and its next steps."""

    def __init__(self, stop_text: str) -> None:
        super().__init__()
        self.state, self.who = plain_label(), plain_label()
        self.badge, self.words, self.said = plain_label(), plain_label(), plain_label()
        self.badge.setStyleSheet(BANNER_STYLE)
        self.badge.hide()
        self.indicators = IndicatorRow()
        self.steps: dict[str, StepButton] = {}
        self.readouts: dict[str, QLabel] = {}
        self._told: dict[str, tuple[str, str, str]] = {}
        self.stop_button = QPushButton(stop_text)
        self.stop_button.setStyleSheet(stop_style(stop_text))
        self.stop_button.setFixedSize(STOP_PX)
        self.stop_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        for label in (self.who, self.words, self.said, self.indicators):
            label.setWordWrap(True)
            # No text widens the window, or moves what stands beside it.
            label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self._shown, self._notice, self._until_s = ("", "rest"), "", 0.0
        self._values, self._steps = QHBoxLayout(), QHBoxLayout()
        self._values.addWidget(self.state)
        self._values.addStretch(1)
        self._steps.addStretch(1)
        whose, lines, left, beside = QHBoxLayout(), QVBoxLayout(), QVBoxLayout(), QWidget()
        whose.addWidget(self.badge)
        whose.addWidget(self.who, 1)
        told = QWidget()
        told.setMinimumHeight(WORDS_PX)
        told.setLayout(lines)
        lines.setContentsMargins(0, 0, 0, 0)
        lines.setSpacing(0)
        for label in (self.words, self.said):
            lines.addWidget(label)
        lines.addStretch(1)
        left.setSpacing(3)
        left.setContentsMargins(0, 0, 0, 0)
        beside.setLayout(left)
        beside.setMinimumWidth(1)  # what has no room is cut, and STOP stays in its place
        for part in (whose, self._values, told, self._steps, self.indicators):
            left.addWidget(part) if isinstance(part, QWidget) else left.addLayout(part)
        whole = QHBoxLayout(self)
        whole.setContentsMargins(MARGIN_PX, 4, MARGIN_PX, 4)
        whole.addWidget(beside, 1)
        whole.addWidget(self.stop_button, 0, Qt.AlignmentFlag.AlignTop)

    def add_step(self, name: str, button: StepButton) -> None:
        self.steps[name] = button
        self._steps.insertWidget(len(self.steps) - 1, button)

    def show_value(self, name: str, text: str, caption: str = "", colour: str = "") -> None:
        """A value to be read from afar; caption: instead of its name."""
        self._told[name] = text, caption, colour
        px, caption = self._px(), caption or name
        if name not in self.readouts:
            self.readouts[name] = QLabel()
            self.readouts[name].setAccessibleDescription(name)
            self._values.addWidget(self.readouts[name])
        first, _, more = caption.partition("\n")
        if px < NARROW_PX:  # long ones have no room beside each other
            first = first.replace(" ", "\n", 1)
        caption = escape(f"{first}\n{more}".rstrip()).replace("\n", "<br>")
        small = f"<span style='font-size:{max(11, px // 3)}px'>{caption}</span>"
        style = f"font-size:{px}px" + (f"; color:{colour}" if colour else "")
        self.readouts[name].setText(f"{small}<br><b style='{style}'>{text}</b>")
        self.readouts[name].setMinimumWidth(3 * px)
        self.readouts[name].setAccessibleName(text)

    def _px(self) -> int:
        return min(max(self.width() // WIDTHS, LEAST_PX), MOST_PX)

    def show_state(self, word: str, role: str) -> None:
        """role: one of theme.STATE_STYLES."""
        self._shown = word, role
        ground, ink = STATE_STYLES[role]
        self.state.setText(word)
        self._values.setSpacing(self._px() // 3)
        restyle(
            self.state,
            f"background: {ground}; color: {ink}; font-size: {self._px()}px; font-weight: bold;"
            " padding: 0px 8px; border-radius: 6px",
        )
        # Complete, but where it would stand on the values.
        apart = self._values.spacing()
        taken = sum(r.minimumWidth() + apart for r in self.readouts.values())
        room = self.width() - STOP_PX.width() - 3 * MARGIN_PX - taken
        self.state.ensurePolished()
        needed = self.state.fontMetrics().horizontalAdvance(word) + 3 * MARGIN_PX
        self.state.setMinimumWidth(max(1, min(needed, room)))

    def tell(self, words: str, theme: Theme, *, alarm: bool = False, said: str = "") -> None:
        """words: of the state, or an alarm; said: the last answer."""
        self.words.setText(words)
        colour, weight = (theme.alarm, "bold") if alarm else (theme.ink, "normal")
        restyle(self.words, f"color: {colour}; font-weight: {weight}; font-size: 11pt")
        self.said.setText(self._notice if time.monotonic() < self._until_s else said)

    def notice(self, text: str) -> None:
        """Show a text for some time, in place of the last answer."""
        self._notice, self._until_s = text, time.monotonic() + NOTICE_S
        self.said.setText(text)

    def mark(self, badge: str, who: str) -> None:
        """badge: that it is simulated, or a rehearsal."""
        self.badge.setText(badge)
        self.badge.setVisible(bool(badge))
        self.who.setText(who)

    def without_stop(self, why: str = "No motor:\nnothing to stop") -> None:
        """Nothing is there to be stopped: the place says so."""
        self.stop_button.setText(why)
        self.stop_button.setEnabled(False)

    def refuse(self, reasons: Mapping[str, str]) -> None:
        for name, button in self.steps.items():
            button.refuse(reasons.get(name, ""))

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        for name, given in self._told.items():
            self.show_value(name, *given)
        self.show_state(*self._shown)
