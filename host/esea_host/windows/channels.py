"""Channels in a folding group for each stream, with units; searched by name, unit or meaning."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QLineEdit, QTreeWidget, QTreeWidgetItem, QWidget

from esea_host.recording.layout import StreamColumn
from esea_host.windows.frame import column_of
from esea_host.windows.theme import Theme, plain_tip


class ChannelTree(QWidget):
    """columns: by stream and name; changed: is called when the choice has changed."""

    def __init__(
        self, columns: Mapping[tuple[str, str], StreamColumn], changed: Callable[[], None]
    ) -> None:
        super().__init__()
        self.search, self.tree = QLineEdit(), QTreeWidget()
        self.search.setPlaceholderText("search: name, unit or meaning")
        self.search.textChanged.connect(self._sift)
        self.tree.setHeaderLabels(["channel", "unit"])
        self.tree.setMinimumHeight(40)
        self.setFocusProxy(self.tree)
        self.items: dict[tuple[str, str], QTreeWidgetItem] = {}
        self._groups = groups = dict[str, QTreeWidgetItem]()
        for (stream, name), c in columns.items():
            if c.kind != "f4" or c.size != 1:
                continue
            if stream not in groups:
                groups[stream] = QTreeWidgetItem(self.tree, [stream])
                groups[stream].setExpanded(len(groups) == 1)
            item = QTreeWidgetItem(groups[stream], [name, "" if c.unit == "1" else c.unit])
            item.setToolTip(0, plain_tip(f"{c.meaning} [{c.unit}]"))
            item.setCheckState(0, Qt.CheckState.Unchecked)
            self.items[stream, name] = item
        self.tree.resizeColumnToContents(0)
        self.tree.itemChanged.connect(lambda *_: changed())
        self.tree.itemActivated.connect(_toggle)
        self.setLayout(column_of(self.search, self.tree))

    def show_theme(self, theme: Theme) -> None:
        """Edges of boxes are darker than the window: its colour here is one that is seen."""
        palette = theme.palette()
        palette.setColor(QPalette.ColorRole.Window, QColor(theme.soft))
        self.tree.setPalette(palette)

    def _sift(self, text: str) -> None:
        # Every word somewhere; groups open where something is found.
        wanted = text.lower().split()
        found: set[str] = set()
        for (stream, name), item in self.items.items():
            told = f"{stream}.{name} {item.toolTip(0)}".lower()
            item.setHidden(not all(word in told for word in wanted))
            found |= set() if item.isHidden() else {stream}
        for stream, group in self._groups.items():
            group.setHidden(stream not in found)
            group.setExpanded(group.isExpanded() or bool(wanted))

    def chosen(self) -> list[tuple[str, str]]:
        return [k for k, i in self.items.items() if i.checkState(0) == Qt.CheckState.Checked]


def _toggle(item: QTreeWidgetItem) -> None:
    if item.childCount() == 0:
        checked = item.checkState(0) == Qt.CheckState.Checked
        item.setCheckState(0, Qt.CheckState.Unchecked if checked else Qt.CheckState.Checked)
