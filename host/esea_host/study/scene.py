"""A scene is data: shapes, roles of colour, texts.  Drawers turn it into a picture, or nothing."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Kind = Literal["disc", "ring", "square", "line"]
# Okabe and Ito's colours: told apart with any common colour blindness; shape and size tell too.
COLOURS = {
    "cursor": "#0072b2",
    "target": "#009e73",
    "failed": "#d55e00",
    "origin": "#f0e442",
    "boundary": "#d55e00",
    "guide": "#999999",
    "node": "#56b4e9",
    "text": "#f4f4f4",
    "background": "#1d1f21",
}
# On white at least 3 to 1, too (WCAG 2.2, 1.4.11), and darker where that asks for it.
ON_WHITE = COLOURS | {
    "origin": "#c08000",
    "failed": "#a33c00",
    "boundary": "#a33c00",
    "guide": "#777777",
    "node": "#0e86c8",
    "text": "#1d1f21",
    "background": "#ffffff",
}


@dataclass(frozen=True)
class Shape:
    """Lengths in the scene's unit; size: radius or half the side; to_x, to_y: a line's end."""

    kind: Kind
    role: str
    x: float
    y: float
    size: float = 1.0
    to_x: float = 0.0
    to_y: float = 0.0


@dataclass(frozen=True)
class Text:
    """A text by its key in the table ``scene`` of the texts, with the numbers that go into it."""

    key: str
    values: Mapping[str, str | float | int] = field(default_factory=dict)


@dataclass(frozen=True)
class Scene:
    """Content of the screen: from ``-half_width`` to ``half_width`` in both directions."""

    shapes: tuple[Shape, ...] = ()
    texts: tuple[Text, ...] = ()
    half_width: float = 40.0

    def digest(self) -> bytes:
        shapes = [(s.kind, s.role, s.x, s.y, s.size, s.to_x, s.to_y) for s in self.shapes]
        texts = [(t.key, sorted(t.values.items())) for t in self.texts]
        return hashlib.sha256(repr((shapes, texts, self.half_width)).encode()).digest()
