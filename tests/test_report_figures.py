"""Which curves a page draws, and which panels recordings share."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.report import figures
from esea_gen.report.figures import Curve, data_sets, plots

from .drawn_figures import legend, line, lines, spans, words


def a_set(label, amplitude_deg, training, held_out):
    return SimpleNamespace(
        label=label,
        amplitude_rad=np.radians(amplitude_deg),
        training=np.array(training, int),
        held_out=np.array(held_out, int),
    )


def test_every_data_set_has_a_panel_and_nothing_is_hidden():
    one, two = a_set("a", 5, [4, 5, 2], [3]), a_set("b", 12.34, [6], [7, 8])
    found = data_sets(SimpleNamespace(sets=(one, two)), 10)
    assert [t for t, _ in found] == ["a, amplitude 5°", "b, amplitude 12.3°", "whole recording"]
    assert [s.tolist() for _, s in found] == [[2, 3, 4, 5], [6, 7, 8], list(range(10))]
    # The whole once more, but where one set has it all already.
    every = a_set("a", 5, range(6), range(6, 10))
    assert [t for t, _ in data_sets(SimpleNamespace(sets=(every,)), 10)] == ["a, amplitude 5°"]
    assert len(data_sets(SimpleNamespace(sets=(every,)), 11)) == 2


def curve(label, n=40, parts=None, measured=True, **more):
    turn = np.linspace(0, 2 * np.pi, n)
    tau = np.sin(turn)
    whole = (f"loop of {label}", np.arange(n))
    return Curve(
        label, turn, 0.1 * tau, tau, 1.1 * tau if measured else None, parts or (whole,), **more
    )


@pytest.fixture
def drawn(monkeypatch):
    """What is given to be drawn as loops."""
    given = []

    def loops(trace, name, points):
        given.append((trace, name))
        return f"<svg>{trace.label}</svg>"

    monkeypatch.setattr(figures, "loops", loops)
    monkeypatch.setattr(figures, "over_time", lambda trace, *rest: trace.label)
    return given


@pytest.mark.parametrize("measured", [True, False])
def test_recordings_of_one_loop_each_share_a_figure(drawn, measured):
    traces = [curve("one", 40), curve("two", 30, measured=measured), curve("three", 20)]
    page = plots(traces, 2.0, [None] * 3)
    ((shared, name),) = drawn
    assert (shared.label, name) == ("every recording", "loops0")
    assert [p["shared"] for p in page] == [True] * 3
    assert [bool(p["loops"]) for p in page] == [True, False, False]
    assert [p["time"] for p in page] == ["one", "two", "three"]
    assert {(p["parts"], p["drawn"]) for p in page} == {(3, 3)}
    # Each panel has its own recording's samples.
    assert [t for t, _ in shared.parts] == ["loop of one", "loop of two", "loop of three"]
    for (_, at), t in zip(shared.parts, traces, strict=True):
        np.testing.assert_array_equal(shared.time_s[at], t.time_s)
        np.testing.assert_array_equal(shared.theta_rad[at], t.theta_rad)
        np.testing.assert_array_equal(shared.model_Nm[at], t.model_Nm)
        if measured:
            np.testing.assert_array_equal(shared.measured_Nm[at], t.measured_Nm)
    assert measured or shared.measured_Nm is None


def test_one_recording_or_several_loops_of_one_have_figures_of_their_own(drawn):
    several = curve("two", 40, (("a", np.arange(20)), ("b", np.arange(20, 40))))
    for traces in ([curve("one")], [curve("one"), several]):
        drawn.clear()
        page = plots(traces, 2.0, [None] * len(traces))
        assert [t.label for t, _ in drawn] == [t.label for t in traces]
        assert [p["shared"] for p in page] == [False] * len(traces)
        assert [p["parts"] for p in page] == [len(t.parts) for t in traces]
    many = curve("many", 40, tuple((str(k), np.arange(40)) for k in range(20)))
    (row,) = plots([many], 2.0, [None])
    assert (row["parts"], row["drawn"]) == (20, 16)


def test_a_figure_has_a_panel_for_every_part_and_says_what_it_is():
    several = curve("two", 40, (("first part", np.arange(20)), ("second part", np.arange(20, 40))))
    svg = figures.loops(several, "loops0", 1000)
    assert "Torque over deflection, two" in svg
    assert svg.count("first part") >= 1 <= svg.count("second part")


# -- what stands in a figure ----------------------------------------------------------------------

MEASURED, MODEL, BOUND, ROUNDING, INK = "#d98b3a", "#00558c", "#9a3f78", "#00775a", "#26303a"


@pytest.fixture
def shown(monkeypatch):
    """The figures that are drawn, with the names that they are given."""
    kept = []
    monkeypatch.setattr(figures, "svg", lambda f, *names: kept.append((f, *names)) or "")
    return kept


def degrees(*values):
    return pytest.approx(np.degrees(values), nan_ok=True)


def test_a_loop_lifts_its_pen_between_cycles_and_at_what_was_held_out(shown):
    n = 60
    at = np.concatenate([np.arange(4), np.arange(40, 44)])  # two cycles, far apart
    held = np.arange(n) >= 42
    c = curve("one", n, (("a set", at),), held_out=held)
    figures.loops(c, "loops7", 1000)
    ((figure, name, about),) = shown
    assert (name, about) == ("loops7", "Torque over deflection, one")
    (axes,) = figure.axes
    drawn = lines(axes)
    nan = np.nan
    x = [0.1 * np.sin(2 * np.pi * k / 59) for k in at]
    x.insert(4, nan)
    tau = [10 * v for v in x]
    assert list(drawn) == ["measured", "C, float32", "C, float32, held out"]
    for label, colour, y in (
        ("measured", MEASURED, [1.1 * v for v in tau]),
        ("C, float32", MODEL, [*tau[:7], nan, nan]),
        ("C, float32, held out", BOUND, [nan] * 7 + tau[7:]),
    ):
        assert drawn[label][0] == colour
        assert drawn[label][1] == degrees(*x)
        assert drawn[label][2] == pytest.approx(y, nan_ok=True)
    assert words(axes) == {
        "title": "a set",
        "x": "deflection, deg",
        "y": "torque, N·m",
        "texts": [],
    }
    assert legend(figure) == list(drawn)


def test_cycles_that_are_near_are_one_stroke(shown):
    # Three times the usual step is near enough; four are not.
    at = np.array([0, 1, 2, 5, 6, 10, 11])
    figures.loops(curve("one", 20, (("", at),), measured=False), "x", 1000)
    ((figure, *_),) = shown
    (drawn,) = lines(figure.axes[0]).values()
    assert np.flatnonzero(np.isnan(drawn[1])).tolist() == [5]
    assert len(drawn[1]) == 8


@pytest.mark.parametrize(
    ("sets", "grid"),
    [(1, (1, 1)), (4, (1, 4)), (5, (2, 3)), (6, (2, 3)), (7, (2, 4)), (17, (4, 4))],
)
def test_panels_stand_in_a_grid(shown, sets, grid):
    parts = tuple((f"set {k}", np.arange(10)) for k in range(sets))
    figures.loops(curve("one", 10, parts), "x", 10_000)
    ((figure, *_),) = shown
    place = figure.axes[0].get_subplotspec().get_gridspec()
    assert (place.nrows, place.ncols) == grid
    seen = [a for a in figure.axes if a.get_visible()]
    assert [a.get_title(loc="left") for a in seen] == [f"set {k}" for k in range(min(sets, 16))]
    # Angles are named below the last panel of each column, torques left of each row.
    below = [bool(a.get_xlabel()) for a in seen]
    assert below == [k + grid[1] >= len(seen) for k in range(len(seen))]
    assert [k for k, a in enumerate(seen) if a.get_ylabel()] == list(range(0, len(seen), grid[1]))
    assert len(legend(figure)) == 2


def test_parts_of_the_torque_have_a_panel_of_their_own(shown):
    several = tuple((w, k * np.ones(10)) for k, w in enumerate(("spring", "play", "rate")))
    figures.loops(curve("one", 10, measured=False, components=several), "x", 10_000)
    ((figure, *_),) = shown
    loop, parts = figure.axes
    assert words(parts)["title"] == "its parts"
    found = {k: (v[0], v[2]) for k, v in lines(parts).items()}
    colours = (INK, BOUND, ROUNDING)
    assert found == {
        w: (c, [float(k)] * 10)
        for k, (w, c) in enumerate(zip(("spring", "play", "rate"), colours, strict=True))
    }
    assert lines(parts)["play"][1] == degrees(*(0.1 * np.sin(np.linspace(0, 2 * np.pi, 10))))
    assert list(lines(loop)) == ["C, float32"]
    assert legend(figure) == ["C, float32", "spring", "play", "rate"]


@pytest.mark.parametrize(
    ("n", "most", "expected"),
    [
        (0, 5, []),
        (5, 5, [0, 1, 2, 3, 4]),
        (6, 5, [0, 2, 4, 5]),
        (7, 4, [0, 2, 4, 6]),
        (9, 1, [0, 5, 8]),  # two at least
    ],
)
def test_every_kth_sample_and_the_last(n, most, expected):
    assert figures._thin(n, most).tolist() == expected


def test_points_of_a_page_are_shared_among_its_figures(monkeypatch):
    given = []
    monkeypatch.setattr(figures, "loops", lambda trace, name, points: given.append(points))
    monkeypatch.setattr(figures, "over_time", lambda trace, name, points, *_: given.append(points))
    for curves in (1, 4, 6):
        plots([curve(str(k)) for k in range(curves)], 2.0, [None] * curves)
        # Half for loops and half for time, of 120 000; one recording gets no more than of four.
        assert set(given) == {120_000 // (2 * max(curves, 4))}
        given.clear()


def test_a_loop_of_many_samples_keeps_its_share_of_the_points(shown):
    parts = tuple((str(k), np.arange(4000)) for k in range(2))
    figures.loops(curve("one", 4000, parts), "x", 400)
    ((figure, *_),) = shown
    # 400 points, two lines in each of two panels.
    assert {len(v[1]) for a in figure.axes for v in lines(a).values()} == {101}


def test_torque_over_time_and_what_was_held_out(shown):
    n = 40
    held = np.zeros(n, bool)
    held[[5, 6, 7, 20, 39]] = True
    c = curve("one", n, held_out=held)
    at = np.array([0.0, 1.0])
    figures.over_time(c, "time1", 10_000, 2.0, (at, np.array([1e-6, -3e-6])))
    ((figure, name, about),) = shown
    assert (name, about) == ("time1", "Torque over time, one")
    torque, error, rounding = figure.axes
    t, tau = c.time_s.tolist(), c.model_Nm
    drawn = lines(torque)
    assert drawn["measured"] == (MEASURED, t, pytest.approx(1.1 * tau))
    assert drawn["C, float32"] == (MODEL, t, pytest.approx(tau))
    (of_error,) = (line(a) for a in error.lines)
    assert of_error == (INK, t, pytest.approx(-5.0 * tau))  # -0.1 tau of 2 Nm, in per cent
    (of_rounding,) = (line(a) for a in rounding.lines)
    assert of_rounding == (ROUNDING, [0.0, 1.0], pytest.approx([1.0, -3.0]))
    stretches = [(t[5], t[7]), (t[20], t[20]), (t[39], t[39])]
    assert spans(torque) == spans(error) == pytest.approx(np.array(stretches))
    assert spans(rounding) == []
    assert [words(a)["y"] for a in figure.axes] == [
        "torque, N·m",
        "C − measured,\n% full scale",
        "float32 −\nfloat64, µN·m",
    ]
    assert [words(a)["x"] for a in figure.axes] == ["", "", "time, s"]
    assert legend(figure) == ["measured", "C, float32", "held out from training"]


def test_torque_over_time_alone(shown):
    figures.over_time(curve("one", measured=False), "x", 10_000, 2.0, None)
    ((figure, *_),) = shown
    (axes,) = figure.axes
    assert list(lines(axes)) == ["C, float32"] == legend(figure)
    assert words(axes)["x"] == "time, s"


@pytest.mark.parametrize(("points", "kept"), [(10_000, 2500), (100, 200)])
def test_long_signals_keep_their_peaks_in_their_share(shown, points, kept):
    n = 40_000
    figures.over_time(curve("one", n), "x", points, 2.0, (np.arange(n), np.ones(n)))
    ((figure, *_),) = shown
    count = len(lines(figure.axes[0])["C, float32"][1])
    assert 0.5 * kept <= count <= kept + 2


@pytest.mark.parametrize(
    ("mask", "expected"),
    [([], []), ([1, 1], [(0, 1)]), ([0, 1, 0, 0, 1, 1], [(1, 1), (4, 5)]), ([0, 0], [])],
)
def test_stretches_of_what_holds(mask, expected):
    assert figures._stretches(np.array(mask, bool)) == expected


def test_largest_errors_by_stream(shown):
    rows = [("a", 0.0, 2e-5, 4e-3), ("b", 3e-14, None, None), ("c", None, 1e-4, 20.0)]
    figures.error_overview(rows, None, "overview")
    ((figure, name, about),) = shown
    assert (name, about) == ("overview", "Largest torque errors by stream and number format")
    (axes,) = figure.axes
    # Two decades below the least of them, half a one above the largest; 0 on the left edge.
    left = 1e-16
    assert axes.get_xlim() == pytest.approx((left, 10**2.5))
    drawn = {k: v[1:] for k, v in lines(axes).items()}
    assert drawn == {
        "float64 C": (pytest.approx([left, 3e-14]), [2.0, 1.0]),
        "float32 C": (pytest.approx([2e-5, 1e-4]), [2.0, 0.0]),
        "derived float32 bound": (pytest.approx([4e-3, 20]), [2.0, 0.0]),
    }
    assert [t.get_text() for t in axes.get_yticklabels()] == ["a", "b", "c"]
    assert axes.get_yticks().tolist() == [2, 1, 0]
    assert axes.get_ylim() == pytest.approx((-0.6, 2.6))
    ticks = [10.0**k for k in range(-16, 3, 2)]
    assert axes.get_xticks() == pytest.approx(ticks)
    look = axes.xaxis.get_major_formatter()
    assert [look(v, 0) for v in ticks] == [
        *("0", "10⁻¹⁴", "10⁻¹²", "10⁻¹⁰", "10⁻⁸", "10⁻⁶", "10⁻⁴", "0.01", "1", "100")
    ]
    marks = [(a.get_marker(), a.get_markerfacecolor()) for a in axes.lines]
    assert marks == [("o", "white"), ("o", MODEL), ("|", BOUND)]
    assert figures._decade(1e-3, 1e-9) == "0.001"
    assert figures._decade(1e3, 1e-9) == "10³"


def test_the_fit_s_own_error_widens_the_scale(shown):
    figures.error_overview([("a", 1e-9, 1e-5, 1e-4)], 40.0, "x")
    figures.error_overview([], None, "x")
    (one, *_), (none, *_) = shown
    assert one.axes[0].get_xlim() == pytest.approx((1e-11, 10**2.5))
    assert lines(one.axes[0])["fit to the measured torque, RMS"][1] == [40.0, 40.0]
    # With nothing to show: a millionth to one per cent.
    assert none.axes[0].get_xlim() == pytest.approx((1e-8, 10**0.5))
    assert none.axes[0].get_ylim() == pytest.approx((-0.6, 0.6))


def test_deviations_of_parameters(shown):
    rows = [("k", 2.0, 0.196), ("m", 4.0, 0.4), ("z", 0.0, 1.0), ("w", 1.0, None), ("n", -1.0, 3.0)]
    figures.spread(rows, "spread")
    ((figure, name, about),) = shown
    assert (name, about) == ("spread", "Standard deviations of the parameters")
    (axes,) = figure.axes
    found = [line(a) for a in axes.lines]
    bars = [(9.8, 2), (10.0, 1), (200.0, 0)]  # no wider than the page
    for (half, row), bar, mark in zip(bars, found[::2], found[1::2], strict=True):
        assert bar == (MODEL, pytest.approx([-half, half]), [row, row])
        assert mark == (MODEL, [0.0], [row])
    assert words(axes)["texts"] == ["±9.8 %", "±10 %", "±300 %"]
    assert [t.xy for t in axes.texts] == [(205, 2), (205, 1), (205, 0)]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["k", "m", "n"]
    assert axes.get_xlim() == (-200, 200)
    assert spans(axes) == [(-50, 50)]
