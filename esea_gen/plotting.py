"""The look of every plot, and a plot as inline SVG: nothing fetched from anywhere."""

from __future__ import annotations

import io
import re
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from markupsafe import Markup, escape
from matplotlib.figure import Figure

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
    """A figure as it stands in a page: the same bytes for the same figure.

    Parameters
    ----------
    figure : Figure
        The figure.
    name : str
        Its own on the page: ids inside are salted with it.
    alternative : str
        What it shows, for those who cannot see it.

    Returns
    -------
    Markup
        An ``<svg>`` element.
    """
    buffer = io.StringIO()
    with mpl.rc_context({**STYLE, "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
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


def _short(path: str) -> str:
    # A hundredth of a point is finer than any screen.
    def rounded(match: re.Match[str]) -> str:
        return f"{float(match.group()):.2f}".rstrip("0").rstrip(".")

    return " ".join(re.sub(r"-?\d+\.\d+", rounded, path).split())


def envelope(y: Array, most: int) -> npt.NDArray[np.intp]:
    """Samples of a time signal to draw: lowest and highest of each stretch, so no peak is lost.

    Parameters
    ----------
    y : ndarray
        The signal, shape (n,).
    most : int
        Most samples to draw.

    Returns
    -------
    ndarray
        Indices, rising.
    """
    n = len(y)
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, max(most // 2, 1) + 1).astype(int)
    picked: set[int] = {0, n - 1}
    for a, b in pairwise(edges):
        if b > a:
            picked |= {a + int(np.argmin(y[a:b])), a + int(np.argmax(y[a:b]))}
    return np.array(sorted(picked), dtype=np.intp)
