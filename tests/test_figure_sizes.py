"""Sizes of figures in inches, how their panels stand, widths of lines, and where ticks are."""

from __future__ import annotations

from types import SimpleNamespace as Of

import numpy as np
import pytest

from esea_gen.analysis.frequency import FrequencyResponse
from esea_gen.analysis.plots import (
    bode,
    cell_edges,
    gain_map,
    percentile_bars,
    rms_by_case,
    torque_cases,
    torque_tracking,
)
from esea_gen.report import figures

N = 6
T = np.arange(float(N))


def drawn(draw, *args):
    """The figure that a function of the reports draws."""
    kept = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "svg", lambda figure, *_: kept.append(figure) or "")
        draw(*args)
    return kept[0]


def size(figure):
    return tuple(figure.get_size_inches())


def inches(width, height):
    return pytest.approx((width, height), abs=1e-9)


def grid_of(figure):
    grid = figure.axes[0].get_subplotspec().get_gridspec()
    return grid.nrows, grid.ncols


def heights(figure):
    return figure.axes[0].get_subplotspec().get_gridspec().get_height_ratios()


def looks(axes):
    return [(a.get_linewidth(), a.get_alpha(), a.get_linestyle()) for a in axes.lines]


def box(figure):
    """Of the figure's legend: columns, corner, whether it stands outside of the axes."""
    (found,) = figure.legends
    return found._ncols, found._loc, found._outside_loc


def columns_of(most, names):
    """Columns of a legend: a single name has one."""
    return most if names > 1 else 1


UPPER_RIGHT, LOWER_CENTER = 1, 8


def a_curve(parts=1, measured=True, n=N, **more):
    t = np.arange(float(n))
    sets = tuple((str(k), np.arange(n)) for k in range(parts))
    return figures.Curve("one", t, 0.1 * t, 2 * t, t if measured else None, sets, **more)


@pytest.mark.parametrize(
    ("panels", "grid", "width", "height"),
    [
        (1, (1, 1), 5.2, 3.7),
        (2, (1, 2), 9.6, 3.7),
        (3, (1, 3), 9.6, 3.22),
        (4, (1, 4), 9.6, 3.0),
        (5, (2, 3), 9.6, 5.94),
        (8, (2, 4), 9.6, 5.5),
    ],
)
def test_loops_are_as_high_as_their_rows(panels, grid, width, height):
    figure = drawn(figures.loops, a_curve(panels), "x", 1000)
    assert (grid_of(figure), size(figure)) == (grid, inches(width, height))
    seen = [a for a in figure.axes if a.get_visible()]
    assert len(seen) == min(panels, 16)
    for axes in seen:
        assert [w for w, *_ in looks(axes)] == [2.2, 0.9]
        # Four steps of 2.25 are more than five of 1.8 are allowed to be.
        assert axes.xaxis.get_major_locator().tick_values(0, 9).tolist() == [0, 2, 4, 6, 8, 10]
        assert axes.xaxis.get_tick_params()["length"] == 3
        assert axes.xaxis.get_tick_params()["labelbottom"]
    assert box(figure) == (5, UPPER_RIGHT, "upper")


def test_parts_of_the_torque_count_as_a_panel():
    parts = tuple((name, T) for name in ("a", "b", "c"))
    figure = drawn(figures.loops, a_curve(2, components=parts), "x", 1000)
    assert (grid_of(figure), size(figure)) == ((1, 3), inches(9.6, 3.22))
    assert [w for w, *_ in looks(figure.axes[2])] == [1.4, 1.0, 1.0]
    assert [a.get_xlabel() for a in figure.axes] == ["deflection, deg"] * 3


@pytest.mark.parametrize(
    ("measured", "parts", "of_loop", "of_components"),
    # 4000 samples of 400 points: every tenth and the last, every 20th, every 31st (a third).
    [(False, 1, 401, 201), (True, 1, 201, 101), (False, 2, 201, 130)],
)
def test_points_are_shared_by_lines_and_panels(measured, parts, of_loop, of_components):
    curve = a_curve(parts, measured, 4000, components=(("a", np.arange(4000.0)),))
    figure = drawn(figures.loops, curve, "x", 400)
    counts = [len(a.get_xdata()) for axes in figure.axes for a in axes.lines]
    assert counts == [of_loop] * (parts * (1 + measured)) + [of_components]


def test_a_pen_is_lifted_past_three_usual_steps():
    # Steps of 2: a gap of 6 is drawn through, one of 7 is not.
    at = np.array([0, 2, 4, 10, 12, 14, 21])
    curve = figures.Curve("one", *[np.arange(22.0)] * 3, None, (("", at),))
    figure = drawn(figures.loops, curve, "x", 1000)
    (only,) = figure.axes[0].lines
    assert np.flatnonzero(np.isnan(only.get_xdata())).tolist() == [6]
    assert np.flatnonzero(np.isnan(only.get_ydata())).tolist() == [6]


@pytest.mark.parametrize(
    ("measured", "rounding", "height", "ratios", "widths", "share"),
    [
        (False, False, 2.3, [2], [[0.8]], 4500),
        (True, False, 3.55, [2, 1], [[2.0, 0.8], [0.7]], 3000),
        (False, True, 3.55, [2, 1], [[0.8], [0.6]], 3000),
        (True, True, 4.8, [2, 1, 1], [[2.0, 0.8], [0.7], [0.6]], 2250),
    ],
)
def test_every_panel_over_time_makes_a_figure_higher(
    measured, rounding, height, ratios, widths, share
):
    given = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "envelope", lambda y, most: given.append(most) or np.arange(len(y)))
        rounded = (T, T) if rounding else None
        figure = drawn(figures.over_time, a_curve(1, measured), "x", 9000, 9.0, rounded)
    assert size(figure) == inches(9.6, height)
    assert heights(figure) == ratios
    assert [[w for w, *_ in looks(a)] for a in figure.axes] == widths
    assert set(given) == {share}
    assert box(figure) == (columns_of(3, 1 + measured), UPPER_RIGHT, "upper")
    for axes in figure.axes:
        assert axes.yaxis.get_major_locator().tick_values(0, 10).tolist() == [0, 2.5, 5, 7.5, 10]
        assert axes.xaxis.get_tick_params()["length"] == 3


def test_what_was_held_out_lies_below_every_curve():
    held = np.array([False, True, True, False, False, True])
    figure = drawn(figures.over_time, a_curve(1, held_out=held), "x", 9000, 9.0, (T, T))
    bands = [[(p.get_linewidth(), p.get_zorder()) for p in a.patches] for a in figure.axes]
    assert bands == [[(0, 0)] * 2, [(0, 0)] * 2, []]


@pytest.mark.parametrize(("rows", "height"), [(0, 1.0), (1, 1.27), (3, 1.81), (5, 2.35)])
def test_an_overview_is_as_high_as_its_rows(rows, height):
    errors = [(str(k), 2e-13, 3e-5, 4e-3) for k in range(rows)]
    figure = drawn(figures.error_overview, errors, 5.0, "x")
    assert size(figure) == inches(9.6, height)
    assert box(figure) == (4, UPPER_RIGHT, "upper")
    (axes,) = figure.axes
    assert [(a.get_markersize(), a.get_markeredgewidth()) for a in axes.lines[:3]] == [
        *[(5.5, 1.2)] * 2,
        (11, 2.2),
    ]
    assert [a.get_zorder() for a in axes.lines[:3]] == [3] * 3
    assert not any(a.get_clip_on() for a in axes.lines[:3])
    assert axes.lines[3].get_linewidth() == 2
    assert axes.get_ylim() == pytest.approx((-0.6, max(rows, 1) - 0.4))
    assert axes.yaxis.get_tick_params()["length"] == 3
    # From the odd decade two below the least, each second one up to the largest.
    low = -15 if rows else -2
    assert axes.get_xlim() == pytest.approx((10.0**low, 10**1.5))
    assert axes.get_xticks() == pytest.approx([10.0**k for k in range(low, 2, 2)])
    assert axes.get_xscale() == "log"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1e-9, "0"),
        (1.0009e-9, "0"),
        (1.005e-9, "10⁻⁹"),
        (1e-4, "10⁻⁴"),
        (1e-3, "0.001"),
        (1.0, "1"),
        (100.0, "100"),
        (1e3, "10³"),
        (1e12, "10¹²"),
    ],
)
def test_decades_are_named_plainly_where_they_are_short(value, text):
    assert figures._decade(value, 1e-9) == text


@pytest.mark.parametrize(("rows", "height"), [(0, 1.02), (1, 1.02), (3, 1.56), (5, 2.1)])
def test_deviations_are_as_high_as_their_rows(rows, height):
    given = [(str(k), 10.0, 0.5 * (k + 1)) for k in range(rows)]
    figure = drawn(figures.spread, given, "x")
    assert size(figure) == inches(9.6, height)
    (axes,) = figure.axes
    assert looks(axes)[::2] == [(5, 0.55, "-")] * rows
    assert [a.get_solid_capstyle() for a in axes.lines[::2]] == ["butt"] * rows
    marks = [
        (a.get_marker(), a.get_markersize(), a.get_markeredgewidth()) for a in axes.lines[1::2]
    ]
    assert marks == [("|", 11, 2)] * rows
    # A tenth and more of the value stands without a decimal.
    texts = ["±5.0 %", *(f"±{k} %" for k in (10, 15, 20, 25, 30, 35, 40))]
    assert [t.get_text() for t in axes.texts] == texts[:rows]
    assert {(t.get_fontsize(), t.get_va()) for t in axes.texts} <= {(9, "center")}
    (band,) = axes.patches
    assert (band.get_linewidth(), band.get_zorder()) == (0, 0)
    assert axes.get_ylim() == pytest.approx((-0.6, max(rows, 1) - 0.4))


# -- pictures of experiments -----------------------------------------------------------------------


def test_a_tracked_torque_has_its_errors_below():
    figure = torque_tracking(T, T, T + 1, T - 1)
    above, below = figure.axes
    assert size(figure) == inches(9.6, 4.4)
    assert heights(figure) == [1.6, 1.0]
    assert [(w, a) for w, a, _ in looks(above)] == [(2.6, 0.45), (1.3, None), (0.9, None)]
    assert [(w, a) for w, a, _ in looks(below)] == [(0.8, 0.55), (1.4, 1.0), (0.8, None)]
    assert [a.get_zorder() for a in below.lines] == [2, 2, 0]
    assert above.lines[2].is_dashed()
    assert not above.lines[1].is_dashed()
    for axes in figure.axes:
        assert axes.get_xlim() == pytest.approx((-0.025, 5.025))
        assert axes.yaxis.get_major_locator().tick_values(0, 9).tolist() == [0, 2, 4, 6, 8, 10]
        legend = axes.get_legend()
        assert (legend._ncols, legend._loc, legend.borderaxespad) == (3, 4, 0.1)
        at = axes.transAxes.inverted().transform(legend.get_bbox_to_anchor().p0)
        assert at == pytest.approx([1, 1])


@pytest.mark.parametrize(("cases", "height"), [(1, 2.3), (2, 4.0), (5, 9.1)])
def test_cases_stand_below_each_other(cases, height):
    panels = [(str(k), T, T, T + 1, T - 1) for k in range(cases)]
    figure = torque_cases(panels, title="t")
    assert (grid_of(figure), size(figure)) == ((cases, 1), inches(9.6, height))
    assert [a.get_xlabel() for a in figure.axes] == [""] * (cases - 1) + ["time, s"]
    for axes in figure.axes:
        assert [(w, a) for w, a, _ in looks(axes)] == [(1.0, 0.5), (1.3, None), (0.9, None)]
        assert [a.is_dashed() for a in axes.lines] == [False, False, True]
        assert axes.get_xlim() == pytest.approx((-0.025, 5.025))
        assert axes.yaxis.get_major_locator().tick_values(0, 9).tolist() == [0, 2, 4, 6, 8, 10]
    assert box(figure) == (3, UPPER_RIGHT, "upper")


@pytest.mark.parametrize(
    ("cases", "kinds", "width"),
    [
        (5, 1, 6.0),
        (8, 1, 5.98),
        (9, 1, 6.54),
        (11, 3, 13.82),
        (12, 3, 14),
    ],
)
def test_bars_have_room_between_six_and_fourteen_inches(cases, kinds, width):
    ours = {str(k): np.ones(cases) for k in range(kinds)}
    figure = rms_by_case([str(k) for k in range(cases)], ours)
    assert size(figure) == inches(max(6.0, width), 3.4)
    (axes,) = figure.axes
    assert axes.get_xlim() == pytest.approx((-0.6, cases - 0.4))
    found = [p for c in axes.containers for p in c]
    assert {round(p.get_width(), 9) for p in found} == {round(0.72 / kinds, 9)}
    assert {p.get_linewidth() for p in found} == {1.2}
    assert axes.xaxis.get_tick_params()["length"] == 3
    assert box(figure) == (columns_of(4, kinds), UPPER_RIGHT, "upper")


def test_a_sixth_name_has_the_first_colour_again():
    ours = {str(k): [1.0] for k in range(7)}
    (axes,) = rms_by_case(["a"], ours).axes
    faces = [c[0].get_facecolor() for c in axes.containers]
    assert faces[5:] == faces[:2]
    assert len(set(faces)) == 5
    (axes,) = rms_by_case(["a"], {"x": [np.nan]}).axes
    assert [(a.get_markersize(), a.get_clip_on()) for a in axes.lines] == [(6, False)]


@pytest.mark.parametrize("coherent", [True, False])
def test_a_response_has_a_third_panel_for_its_coherence(coherent):
    f = np.array([1.0, 2.0, 4.0])
    c = np.array([1.0, 0.9, 0.8]) if coherent else None
    r = FrequencyResponse(f, np.array([1.0, 0.5, -0.5j]), c, np.full(3, 0.01), "m")
    figure = bode([("one", r), ("two", r)])
    assert size(figure) == inches(9.6, 6.2 if coherent else 4.8)
    assert heights(figure) == ([1.5, 1.2, 0.7] if coherent else [1.5, 1.2])
    widths = [[w for w, *_ in looks(a)] for a in figure.axes]
    assert widths == [[1.4] * 2, [1.4] * 2, [1.2] * 2][: 2 + coherent]
    shades = [(s.get_alpha(), s.get_linewidth()) for a in figure.axes for s in a.collections]
    assert [(a, np.ravel(w).tolist()) for a, w in shades] == [(0.2, [0])] * 4
    ticks = figure.axes[1].yaxis.get_major_locator().tick_values
    # Six steps at the most, of a twelfth, an eighth, a quarter of a turn.
    for most, step in ((6, 1), (9, 1.5), (180, 30), (200, 45), (270, 45), (540, 90), (600, 100)):
        found = ticks(0, most)
        assert np.diff(found) == pytest.approx(step)
    assert box(figure) == (4, UPPER_RIGHT, "upper")
    assert figure.axes[-1].get_xlim() == pytest.approx((1, 4))


def test_a_map_of_gains_has_its_names_below():
    all_passive = np.ones((2, 2), bool)
    gains = {"kp_Nm_rad": np.array([1.0, 2.0]), "kd_Nms_rad": np.array([1.0, 3.0])}
    region = Of(stable=all_passive, passive=all_passive, **gains)
    # At the middle a name still stands right of its mark.
    figure = gain_map(region, [("a", 1.5, 2.0)])
    assert size(figure) == inches(6.4, 4.6)
    assert box(figure) == (3, LOWER_CENTER, "lower")
    (axes,) = figure.axes
    (mark,) = axes.lines
    assert (mark.get_markersize(), mark.get_markeredgewidth(), mark.get_zorder()) == (6, 1.5, 3)
    (text,) = axes.texts
    assert (text.get_ha(), text.xyann) == ("left", (8, 4))
    (mesh,) = axes.collections
    assert np.ravel(mesh.get_linewidth()).tolist() == [0.4]


@pytest.mark.parametrize(
    ("values", "edges"),
    [([3], [2.5, 3.5]), ([1, 4], [-0.5, 2.5, 5.5]), ([1, 2, 4, 9], [0.5, 1.5, 3, 6.5, 11.5])],
)
def test_edges_of_cells(values, edges):
    assert cell_edges(np.array(values, float)).tolist() == edges


@pytest.mark.parametrize(("rows", "height"), [(1, 1.54), (3, 2.22), (5, 2.9)])
def test_percentiles_are_as_high_as_their_rows(rows, height):
    five = dict(zip((5.0, 25.0, 50.0, 75.0, 95.0), (1, 2, 3, 4, 5), strict=True))
    ends = {"low": {95.0: 4.5}, "high": {95.0: 5.5}}
    bars = Of(values=five, **ends, largest=6, failed=0, count=9)
    figure = percentile_bars([(str(k), bars) for k in range(rows)])
    assert size(figure) == inches(9.6, height)
    (axes,) = figure.axes
    assert axes.get_ylim() == pytest.approx((-0.6, rows - 0.4))
    assert box(figure) == (5, UPPER_RIGHT, "upper")
    # Each name once, however many the rows.
    assert len(figure.legends[0].get_texts()) == 4
