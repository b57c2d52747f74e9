"""Colours, dark and light; curves are distinguishable with common colour blindness."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the browser view takes the colours without Qt
    from PySide6.QtGui import QPalette
    from PySide6.QtWidgets import QLabel


def plain_label(text: str = "") -> QLabel:
    """Label for external text: tags are shown as text."""
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QLabel

    label = QLabel(text)
    label.setTextFormat(Qt.TextFormat.PlainText)
    return label


def plain_tip(text: str) -> str:
    return f"<p>{escape(text)}</p>"


@dataclass(frozen=True)
class Theme:
    name: str
    ground: str
    panel: str
    ink: str
    soft: str
    grid_alpha: float
    wanted: str
    measured: str
    limit: str
    alarm: str
    good: str
    curves: tuple[str, ...]

    def palette(self) -> QPalette:
        from PySide6.QtGui import QColor, QPalette

        made = QPalette()
        role = QPalette.ColorRole
        for place in (role.Window, role.Button):
            made.setColor(place, QColor(self.panel))
        for place in (role.Base, role.AlternateBase, role.ToolTipBase):
            made.setColor(place, QColor(self.ground))
        for place in (role.WindowText, role.Text, role.ButtonText, role.ToolTipText):
            made.setColor(place, QColor(self.ink))
        made.setColor(role.PlaceholderText, QColor(self.soft))
        made.setColor(role.Highlight, QColor(self.wanted))
        made.setColor(role.HighlightedText, QColor(self.ground))
        off = QPalette.ColorGroup.Disabled
        for place in (role.WindowText, role.Text, role.ButtonText):
            made.setColor(off, place, QColor(self.soft))
        return made


LIGHT = Theme(
    *("light", "#ffffff", "#f2f4f6", "#26303a", "#5f6b76", 0.25),
    *("#00558c", "#b5611b", "#9a3f78", "#b3261e", "#00775a"),
    ("#00775a", "#9a3f78", "#00558c", "#b5611b", "#5b4bb3", "#6b6b00", "#26303a", "#008a9e"),
)
DARK = Theme(
    *("dark", "#12171c", "#1c232a", "#e4e9ee", "#9aa6b1", 0.2),
    *("#56b4e9", "#f0a04b", "#e08cc0", "#ff6b5e", "#3fc79a"),
    ("#3fc79a", "#e08cc0", "#56b4e9", "#f0a04b", "#b3a6ff", "#e6df5a", "#e4e9ee", "#62d6e8"),
)
# White letters on it: 8.5 to 1; the participant sees it, too.
BANNER_GROUND = "#7a3b00"
BANNER_STYLE = (
    f"background: {BANNER_GROUND}; color: white; font-weight: bold; padding: 2px 8px;"
    " border-radius: 3px"
)
# Ground and letters of a state, in both themes; 4.5 to 1 or more.
STATE_STYLES = {
    "alarm": ("#b3261e", "#ffffff"),
    "caution": ("#ffbf00", "#000000"),
    "moving": ("#00558c", "#ffffff"),
    "good": ("#00775a", "#ffffff"),
    "rest": ("#5f6b76", "#ffffff"),
}
