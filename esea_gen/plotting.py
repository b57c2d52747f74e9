"""The look of every plot, and a plot as inline SVG: nothing fetched from anywhere."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.text import Annotation
from matplotlib.ticker import LogFormatter, ScalarFormatter

Array = npt.NDArray[np.float64]

# Okabe and Ito's colours, told apart by people with any common colour blindness; line width and
# order tell them apart in grey print as well.
MEASURED, MODEL, ROUNDING, BOUND = "#d98b3a", "#00558c", "#00775a", "#9a3f78"
HELD_OUT, INK, RULE = "#e9eef2", "#26303a", "#c9d1d8"
# Matplotlib types its keys one by one.
GRID = "#edf0f2"
# On a dark page the same hues, lighter; the figure's ground is the page's.
DARK = {
    "figure-back": ("#ffffff", "#14191d"),
    "figure-grid": (GRID, "#232b31"),
    "figure-rule": (RULE, "#4a555e"),
    "figure-ink": (INK, "#d7dee4"),
    "figure-held-out": (HELD_OUT, "#2a333a"),
    "figure-measured": (MEASURED, "#e5a35c"),
    "figure-model": (MODEL, "#6db3e3"),
    "figure-rounding": (ROUNDING, "#5fc3a1"),
    "figure-bound": (BOUND, "#d98bbb"),
}
STYLE: Any = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": RULE,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "xtick.color": RULE,
    "ytick.color": RULE,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "text.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.solid_joinstyle": "round",
    "path.simplify": False,
}


def svg(figure: Figure, name: str, alternative: str) -> Markup:
    """A figure as SVG for a page: the same bytes for the same figure."""
    buffer = io.StringIO()
    named = _name_parts(figure)
    with mpl.rc_context({**STYLE, "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'(<g|<image[^>]*?) id="zoom-(\d+)"', lambda m: _facts(m, named), text)
    for artist, _ in named:
        artist.set_gid(None)
    # Groups are numbered alike in every figure, and ids must be unique on a page; what is referred
    # to (clip paths, markers) has an id salted with the figure's name.
    text = re.sub(r'<g id="[^"]*">', "<g>", text)
    text = re.sub(r'<(path|defs|g) id="(?!m|p)[^"]*"', r"<\1", text)
    text = re.sub(r' d="([^"]*)"', lambda m: f' d="{_short(m.group(1))}"', text)
    text = re.sub(r"font: ([^;\"]*)px [^;\"]*", r"font-size: \1px", text)
    head, body = text.split(">", 1)
    head = re.sub(r' (width|height)="[^"]*"', "", head).replace(
        ' xmlns:xlink="http://www.w3.org/1999/xlink"', ""
    )
    body = body.replace("xlink:href", "href")
    for role, (light, _) in DARK.items():
        body = re.sub(rf"(fill|stroke): {light}", rf"\1: var(--{role}, {light})", body)
    # A narrow figure keeps the scale of the wide ones.
    width = round(figure.get_figwidth() * 105)
    head += f' style="max-width:{width}px"' if width < 960 else ""
    return Markup(f'{head} role="img" aria-label="{escape(alternative)}">{body}'.strip())


def _name_parts(figure: Figure) -> list[tuple[Artist, Callable[[], str]]]:
    """Ids for elements that move with zoom, and facts about each part for `zoom.js`.

    The facts are asked for after drawing: only then does the layout stand.
    """
    named: list[tuple[Artist, Callable[[], str]]] = []

    def name(artist: Artist, facts: str | Callable[[], str]) -> None:
        artist.set_gid(f"zoom-{len(named)}")
        named.append((artist, facts if callable(facts) else lambda: facts))

    for axes in figure.axes:
        if axes.name != "rectilinear" or not axes.get_visible():
            continue
        name(axes, partial(_axes_facts, axes, figure))
        for which, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
            name(axis, f'class="axis-{which}"')
            name(axis.offsetText, 'class="power"')
        for artist in (*axes.lines, *axes.patches, *axes.collections, *axes.images):
            kind, moved = "drawn", artist.get_transform()
            if isinstance(artist, PathCollection):
                kind, moved = "marks", artist.get_offset_transform()
            elif isinstance(artist, AxesImage):
                kind = "image"
            ways = zip("xy", moved.contains_branch_seperately(axes.transData), strict=True)
            if along := "".join(way for way, moves in ways if moves):
                name(artist, f'class="{kind}" data-along="{along}"')
        for text in axes.texts:
            about = text.xycoords if isinstance(text, Annotation) else text.get_transform()
            if about in ("data", axes.transData):
                place = text.xy if isinstance(text, Annotation) else text.get_position()
                name(text, partial(_text_facts, axes, place))
                if isinstance(text, Annotation) and text.arrow_patch is not None:
                    name(text.arrow_patch, partial(_text_facts, axes, place))
    return named


def _facts(found: re.Match[str], named: Sequence[tuple[Artist, Callable[[], str]]]) -> str:
    return f"{found.group(1)} {named[int(found.group(2))][1]()}"


def _point(axes: Axes, x: float, y: float) -> tuple[float, float]:
    # In the picture's own points, downward.
    figure = axes.get_figure(root=True)
    assert figure is not None
    per_dot = 72 / figure.dpi
    return x * per_dot, 72 * figure.get_figheight() - y * per_dot


def _axes_facts(axes: Axes, figure: Figure) -> str:
    box = axes.get_window_extent()
    left, top = _point(axes, box.x0, box.y1)
    size = 72 / figure.dpi * box.width, 72 / figure.dpi * box.height
    told = [f'class="axes" data-box="{left:.2f} {top:.2f} {size[0]:.2f} {size[1]:.2f}"']
    for which, axis, ends, shared in (
        ("x", axes.xaxis, axes.get_xlim(), axes.get_shared_x_axes()),
        ("y", axes.yaxis, axes.get_ylim(), axes.get_shared_y_axes()),
    ):
        # Twins lie on each other, so both ways go together, whatever their limits.
        family = [
            i
            for i, a in enumerate(figure.axes)
            if shared.joined(axes, a) or a.get_position().bounds == axes.get_position().bounds
        ]
        plain = isinstance(axis.get_major_formatter(), ScalarFormatter | LogFormatter)
        kind = axis.get_scale() if axis.get_scale() in ("linear", "log") and plain else "named"
        told.append(f'data-{which}="{ends[0]:.9g} {ends[1]:.9g} {kind} {min(family)}"')
    return " ".join(told)


def _text_facts(axes: Axes, place: Any) -> str:
    x, y = _point(axes, *axes.transData.transform(place))
    return f'class="at" data-at="{x:.2f} {y:.2f}"'


def _short(path: str) -> str:
    # A hundredth of a point is finer than any screen.
    def rounded(match: re.Match[str]) -> str:
        return f"{float(match.group()):.2f}".rstrip("0").rstrip(".")

    return " ".join(re.sub(r"-?\d+\.\d+", rounded, path).split())


def envelope(y: Array, most: int) -> npt.NDArray[np.intp]:
    """Samples of a time signal to draw: lowest and highest of each stretch, so no peak is lost."""
    n = len(y)
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, max(most // 2, 1) + 1).astype(int)
    picked: set[int] = {0, n - 1}
    for a, b in pairwise(edges):
        if b > a:
            picked |= {a + int(np.argmin(y[a:b])), a + int(np.argmax(y[a:b]))}
    return np.array(sorted(picked), dtype=np.intp)
