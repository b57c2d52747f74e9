"""A scene, drawn by Qt."""

from __future__ import annotations

from collections.abc import Mapping

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from esea_host.study.scene import COLOURS, ON_WHITE, Scene, Shape
from esea_host.study.words import ENGLISH, Words, words_of

LEAST_PX = 2.0
LETTERS = 0.04  # height of letters over that of the picture
EDGE = 0.01  # of rings, over half of it
PATCH = 0.08


def square_in(width: float, height: float) -> tuple[QPointF, float]:
    """Middle and half side of the largest square: there the scene is."""
    return QPointF(width / 2, height / 2), min(width, height) / 2


def paint_scene(
    painter: QPainter,
    width: float,
    height: float,
    scene: Scene,
    words: Words,
    colours: Mapping[str, str],
) -> None:
    """Paint a scene into a rectangle: the same proportions whatever its size."""
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.fillRect(QRectF(0, 0, width, height), QColor(colours["background"]))
    middle, half = square_in(width, height)
    scale = half / scene.half_width
    for shape in scene.shapes:
        _paint_shape(painter, shape, middle, scale, colours)
    font = QFont()
    font.setPixelSize(max(8, round(LETTERS * 2 * half)))
    painter.setFont(font)
    painter.setPen(QColor(colours["text"]))
    top = 0.03 * 2 * half
    for text in scene.texts:
        flags = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop
        room = QRectF(middle.x() - half, top, 2 * half, 2 * half)
        wrapped = int(flags) | int(Qt.TextFlag.TextWordWrap)
        used = painter.drawText(room, wrapped, words.scene(text.key, text.values))
        top = used.bottom() + 0.01 * 2 * half if used is not None else top


def _paint_shape(
    painter: QPainter, s: Shape, middle: QPointF, scale: float, colours: Mapping[str, str]
) -> None:
    # A role that has no colour is drawn in that of texts rather than not at all.
    colour = QColor(colours.get(s.role, colours["text"]))
    at = QPointF(middle.x() + s.x * scale, middle.y() - s.y * scale)
    size = max(s.size * scale, LEAST_PX)
    if s.kind == "line":
        pen = QPen(colour, max(2 * s.size * scale, LEAST_PX))
        pen.setCapStyle(Qt.PenCapStyle.FlatCap)
        painter.setPen(pen)
        painter.drawLine(at, QPointF(middle.x() + s.to_x * scale, middle.y() - s.to_y * scale))
        return
    ring = s.kind == "ring"
    edge = max(EDGE * middle.y(), LEAST_PX)
    if ring:
        painter.setPen(QPen(colour, edge))
    elif s.role == "cursor":  # seen before whatever it stands on
        painter.setPen(QPen(QColor(colours["text"]), edge / 2))
    else:
        painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(Qt.BrushStyle.NoBrush if ring else colour)
    if s.kind == "square":
        painter.drawRect(QRectF(at.x() - size, at.y() - size, 2 * size, 2 * size))
    else:
        painter.drawEllipse(at, size, size)


class SceneView(QWidget):
    def __init__(self, words: Words | None = None, dark: bool = True) -> None:
        super().__init__()
        self.words, self.scene = words or words_of(ENGLISH), Scene()
        self.colours = COLOURS if dark else ON_WHITE
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)

    def show_scene(self, scene: Scene) -> None:
        self.scene = scene
        self.update()

    def set_dark(self, dark: bool) -> None:
        self.colours = COLOURS if dark else ON_WHITE
        self.update()

    def paintEvent(self, _: QPaintEvent) -> None:
        painter = QPainter(self)
        try:
            given = self.scene, self.words, self.colours
            paint_scene(painter, self.width(), self.height(), *given)
            self.painted(painter)
        finally:
            painter.end()

    def painted(self, painter: QPainter) -> None:
        return
