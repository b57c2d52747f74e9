"""Content of a Matplotlib figure, as plain values for tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.text import Text


def line(artist: Line2D) -> tuple[str, list[float], list[float]]:
    """Colour and points of a line, NaN where the pen is lifted."""
    x, y = (np.asarray(v, dtype=float).tolist() for v in artist.get_data())
    return to_hex(artist.get_color()), x, y


def lines(axes: Axes) -> dict[str, tuple[str, list[float], list[float]]]:
    """Lines that have a label of their own, by it."""
    return {str(a.get_label()): line(a) for a in axes.lines if str(a.get_label())[0] != "_"}


def spans(axes: Axes) -> list[tuple[float, float]]:
    """Ends of the vertical bands, along x."""
    bands = [p for p in axes.patches if isinstance(p, Rectangle)]
    return [(p.get_x(), p.get_x() + p.get_width()) for p in bands]


def bands(axes: Axes) -> list[tuple[list[float], list[float], list[float]]]:
    """Filled bands: x, lower and upper edge."""
    found = []
    for c in axes.collections:
        if isinstance(c, FillBetweenPolyCollection):
            points = c.get_paths()[0].vertices
            x = np.unique(points[:, 0])
            ys = [points[points[:, 0] == at, 1] for at in x]
            found.append((x.tolist(), [float(y.min()) for y in ys], [float(y.max()) for y in ys]))
    return found


def words(axes: Axes) -> dict[str, Any]:
    """Title, labels and free texts of axes."""
    return {
        "title": axes.get_title(loc="left") or axes.get_title(),
        "x": axes.get_xlabel(),
        "y": axes.get_ylabel(),
        "texts": [t.get_text() for t in axes.texts if isinstance(t, Text)],
    }


def legend(holder: Any) -> list[str]:
    """Words of the legends of a figure or of axes, in order."""
    found = holder.legends if hasattr(holder, "legends") else [holder.get_legend()]
    return [t.get_text() for one in found if one is not None for t in one.get_texts()]
