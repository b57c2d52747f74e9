"""Zoomed figures on pages: the same data on the same axes."""

from __future__ import annotations

import re

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from esea_gen.pages import plain_page
from esea_gen.plotting import STYLE, svg
from tests.browser import browser, dragged, readable

X = np.linspace(0.0, 10.0, 41)
# What a reader drags, in shares of the axes, x from the left, y from the bottom.
SPAN_X, SPAN_Y = (0.25, 0.5), (0.5, 0.75)

# What the panel writes once beside its axis.
POWER = {(panel, way): 1.0 for panel in range(4) for way in "xy"} | {(1, "y"): 1e-5}


def drawn() -> Figure:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7, 5), layout="constrained")
        (top, low), (log, more) = figure.subplots(2, 2)
        low.sharex(top)
        top.plot(X, np.sin(X), marker="o", ms=3)
        top.axvspan(2, 4, alpha=0.2)
        top.fill_between(X, -0.5, 0.5, alpha=0.3)
        top.text(3.0, 0.2, "inside")
        top.text(9.0, 0.2, "beside")
        low.scatter(X, 1e-7 * X**2, s=10 + X)
        log.loglog([1e-3, 1e3], [1.0, 1e4])
        more.bar([0, 1, 2], [1, 2, 3])
        more.set_xticks([0, 1, 2], ["smc", "mpc", "pid"])
    return figure


def page(figure: Figure) -> str:
    drawing = svg(figure, "zoom", "Four panels")
    return plain_page("Zoom", f"<figure>{drawing}</figure>")


@pytest.fixture(scope="module")
def figure() -> Figure:
    return drawn()


@pytest.fixture(scope="module")
def text(figure) -> str:
    return page(figure)


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile") / "profile") as b:
        yield b


def opened(tab, text, folder):
    file = folder / "page.html"
    file.write_text(text, encoding="utf-8")
    assert tab.opened(file, 900, "light") == []
    return tab


def zoomed(tab, panel: int) -> None:
    box = tab.evaluate(
        f"(r => [r.x, r.y, r.width, r.height])(document.querySelectorAll('.cover')[{panel}]"
        ".getBoundingClientRect())"
    )
    start, end = (SPAN_X[0], 1 - SPAN_Y[1]), (SPAN_X[1], 1 - SPAN_Y[0])
    dragged(tab, box, start, end)


def ticks(tab, panel: int, way: str) -> list[tuple[str, float]]:
    """Shown labels and where they stand, as shares of the axes."""
    centre = {
        "x": "(t.x + t.width / 2 - r.x) / r.width",
        "y": "(r.bottom - t.y - t.height / 2) / r.height",
    }[way]
    found = tab.evaluate(
        f"(a => {{ const r = document.querySelectorAll('.cover')[{panel}].getBoundingClientRect();"
        f"return [...a.querySelectorAll('.axis-{way} > g')].filter(g => g.querySelector('use') &&"
        "g.style.display !== 'none').map(g => { const t = g.querySelector('use')"
        f".getBoundingClientRect(); return [g.textContent.trim(), {centre}]; }}); }})"
        f"(document.querySelectorAll('.axes')[{panel}])"
    )
    return [(label.replace("−", "-"), share) for label, share in found]


def check_ticks(tab, figure, panel: int, way: str, span: tuple[float, float]) -> None:
    axes = figure.axes[panel]
    low, high = axes.get_xlim() if way == "x" else axes.get_ylim()
    log = (axes.get_xscale() if way == "x" else axes.get_yscale()) == "log"
    shown = ticks(tab, panel, way)
    assert len(shown) >= 2
    for label, share in shown:
        at = span[0] + share * (span[1] - span[0])
        value = low * (high / low) ** at if log else low + at * (high - low)
        if log:
            assert float(label) == pytest.approx(value, rel=0.05)
        else:
            near = 0.004 * (span[1] - span[0]) * (high - low)
            assert POWER[panel, way] * float(label) == pytest.approx(value, abs=near)


def test_ticks_tell_the_values_that_are_drawn(tab, text, figure, tmp_path):
    opened(tab, text, tmp_path)
    zoomed(tab, 0)
    check_ticks(tab, figure, 0, "x", SPAN_X)
    check_ticks(tab, figure, 0, "y", SPAN_Y)
    tab.evaluate("document.querySelector('.zoom button').click()")
    for panel in (1, 2):
        zoomed(tab, panel)
        check_ticks(tab, figure, panel, "x", SPAN_X)
        check_ticks(tab, figure, panel, "y", SPAN_Y)


def test_lines_and_words_stand_where_their_numbers_are(tab, text, figure, tmp_path):
    opened(tab, text, tmp_path)
    axes = figure.axes[0]
    low, high = np.array(axes.get_xlim()), np.array(axes.get_ylim())
    zoomed(tab, 0)
    left, bottom = (e[0] + s[0] * (e[1] - e[0]) for e, s in ((low, SPAN_X), (high, SPAN_Y)))
    wide, tall = (np.ptp(e) * (s[1] - s[0]) for e, s in ((low, SPAN_X), (high, SPAN_Y)))
    path, box = tab.evaluate(
        "(a => [a.querySelector('.drawn > path:not([style*=opacity])').getAttribute('d'),"
        "a.dataset.box])"
        "(document.querySelector('.axes'))"
    )
    x0, y0, width, height = map(float, box.split())
    points = np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", path), dtype=float)
    assert len(points) == len(X)
    np.testing.assert_allclose((points[:, 0] - x0) / width, (X - left) / wide, atol=2e-3)
    up = (y0 + height - points[:, 1]) / height
    np.testing.assert_allclose(up, (np.sin(X) - bottom) / tall, atol=2e-3)
    # Marks outside are gone, those inside keep their size; of the words, the one outside is gone.
    seen = tab.evaluate(
        "[...document.querySelector('.axes').querySelectorAll('.drawn > g > use')]"
        ".filter(u => u.style.display !== 'none').map(u => u.getBBox().width)"
    )
    inside = (abs((X - left) / wide - 0.5) < 0.5) & (abs((np.sin(X) - bottom) / tall - 0.5) < 0.5)
    assert len(seen) == inside.sum() > 0
    words = tab.evaluate(
        "[...document.querySelectorAll('.at')].filter(g => g.style.display !== 'none')"
        ".map(g => g.textContent.trim())"
    )
    assert words == ["inside"]


def test_panels_that_share_an_axis_go_together_and_others_stay(tab, text, figure, tmp_path):
    opened(tab, text, tmp_path)
    before = {(k, w): ticks(tab, k, w) for k in range(4) for w in "xy"}
    zoomed(tab, 0)
    after = {(k, w): ticks(tab, k, w) for k in range(4) for w in "xy"}
    assert {key for key in before if before[key] != after[key]} == {(0, "x"), (0, "y"), (1, "x")}
    check_ticks(tab, figure, 1, "x", SPAN_X)


def test_names_of_bars_go_with_their_bars(tab, text, figure, tmp_path):
    opened(tab, text, tmp_path)
    low, high = figure.axes[3].get_xlim()
    zoomed(tab, 3)
    for label, share in ticks(tab, 3, "x"):
        at = low + (SPAN_X[0] + share * (SPAN_X[1] - SPAN_X[0])) * (high - low)
        assert at == pytest.approx(["smc", "mpc", "pid"].index(label), abs=0.02)


def test_the_whole_figure_comes_back_as_it_was_drawn(tab, text, tmp_path):
    opened(tab, text, tmp_path)
    (shot, first, second) = (tmp_path / f"{k}.png" for k in ("whole", "zoomed", "again"))
    tab.picture(shot)
    for panel in range(4):
        zoomed(tab, panel)
    tab.picture(first)
    assert tab.evaluate("document.querySelector('.zoom button').hidden") is False
    tab.evaluate("document.querySelector('.zoom button').click()")
    tab.evaluate("document.activeElement.blur()")
    tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=1, y=1)
    tab.picture(second)
    assert first.read_bytes() != shot.read_bytes()
    assert second.read_bytes() == shot.read_bytes()


def test_keys_zoom_move_and_bring_back(tab, text, figure, tmp_path):
    opened(tab, text, tmp_path)

    def pressed(key: str) -> None:
        event = f"new KeyboardEvent('keydown', {{key: '{key}', cancelable: true}})"
        tab.evaluate(f"document.querySelector('figure svg').dispatchEvent({event})")

    whole = ticks(tab, 0, "x")
    pressed("+")
    check_ticks(tab, figure, 0, "x", (0.15, 0.85))
    pressed("ArrowRight")
    check_ticks(tab, figure, 0, "x", (0.22, 0.92))
    pressed("0")
    assert ticks(tab, 0, "x") == whole


def test_the_page_is_read_on_a_telephone_and_fetches_nothing(tab, text, tmp_path):
    readable(tab, text, tmp_path)
    assert not re.findall(r'(?:src|href)="(?!#)', text)
    assert "http" not in text.replace("http://www.w3.org", "")
