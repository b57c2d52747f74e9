"""Pictures of searches and of friction, and loops of a specimen: every line, word and mark."""

from __future__ import annotations

from types import SimpleNamespace as Of

import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from esea_gen.identify.friction import SteadyRun
from esea_gen.identify.search_problem import PresentBest
from esea_gen.report import figures, friction_picture, identification, search_picture, specimen

from .drawn_figures import legend, line, lines, words

MEASURED, MODEL = "#d98b3a", "#00558c"
INK, RULE = "#26303a", "#c9d1d8"


def looked(axes):
    """Colours of edge and label, whether the top is open: the look of every plot."""
    open_top = not axes.spines["top"].get_visible()
    return to_hex(axes.spines["left"].get_edgecolor()), axes.xaxis.label.get_color(), open_top


def a_best(sets=2):
    made = tuple(
        (np.array([0.0, 0.1 * k]), np.array([1.0 * k, 2.0]), np.array([1.0 * k + 3, 2.0 - 4]))
        for k in range(1, sets + 1)
    )
    return PresentBest(0.0625, np.array([[10.0, 2.0], [40.0, 0.5], [70.0, 0.25]]), made)


def test_a_search_shows_how_far_it_has_come():
    figure = search_picture.search_picture(a_best())
    progress = figure.axes[0]
    steps, last = progress.lines
    assert line(steps) == (MODEL, [10.0, 40.0, 70.0], [2.0, 0.5, 0.25])
    # An error holds until the next improvement.
    assert (steps.get_drawstyle(), steps.get_linestyle()) == ("steps-post", "-")
    assert line(last) == (MODEL, [70.0], [0.25])
    assert (last.get_marker(), last.get_markersize()) == ("o", 4)
    assert (progress.get_xscale(), progress.get_yscale()) == ("linear", "log")
    assert words(progress) == {
        "title": "best so far: 0.25 N·m RMS",
        "x": "runs over all recordings",
        "y": "error, N·m",
        "texts": [],
    }
    assert legend(progress) == []


def test_a_search_shows_the_loops_of_its_best():
    figure = search_picture.search_picture(a_best())
    _, first, second = figure.axes
    assert [lines(a) for a in (first, second)] == [
        {
            "measured": (MEASURED, [0.0, 0.1 * k], [k, 2.0]),
            "best so far": (MODEL, [0.0, 0.1 * k], [k + 3.0, -2.0]),
        }
        for k in (1, 2)
    ]
    assert [a.get_linewidth() for a in first.lines] == [1.6, 0.8]
    # Off by 3 and by 4 Nm: the root of 12.5.
    assert [words(a) for a in (first, second)] == [
        {
            "title": f"data set {k} of 2: 3.54 N·m",
            "x": "deflection, rad",
            "y": y,
            "texts": [],
        }
        for k, y in ((1, "torque, N·m"), (2, ""))
    ]
    assert legend(first) == ["measured", "best so far"]
    assert legend(second) == []
    assert first.get_legend()._loc == 4  # lower right
    assert tuple(figure.get_size_inches()) == pytest.approx((9.6, 3.2))
    assert [looked(a) for a in figure.axes] == [(RULE, INK, True)] * 3
    assert first.xaxis.majorTicks[0].tick1line.get_markersize() == 3


@pytest.mark.parametrize(("sets", "shown"), [(1, 1), (5, 5), (7, 5)])
def test_a_search_shows_five_loops_at_the_most_side_by_side(sets, shown):
    figure = search_picture.search_picture(a_best(sets))
    loops = figure.axes[1:]
    titles = [words(a)["title"].partition(":")[0] for a in loops]
    assert titles == [f"data set {k} of {sets}" for k in range(1, shown + 1)]
    place = figure.axes[0].get_subplotspec().get_gridspec()
    assert (place.nrows, place.ncols) == (1, 1 + shown)


def test_friction_is_drawn_over_speed_both_ways():
    runs = [
        SteadyRun("a", np.array([19.0, 20.0, 21.0]), np.array([0.003, 0.004, 0.005])),
        SteadyRun("b", np.full(3, -80.0), np.full(3, -0.006)),
    ]
    found = Of(torque_Nm=lambda speed: 0.001 * np.sign(speed) + 1e-4 * speed)
    figure = friction_picture.friction_picture(runs, found)
    (axes,) = figure.axes
    marks, back, forth = axes.lines
    assert line(marks) == (MEASURED, [20.0, -80.0], pytest.approx([4.0, -6.0]))
    assert (marks.get_marker(), marks.get_linestyle(), marks.get_markersize()) == ("o", "None", 4)
    # From a four hundredth of the largest speed to it, by even steps of its logarithm.
    at = [0.2 * 400 ** (k / 199) for k in range(200)]
    assert line(back) == (
        MODEL,
        pytest.approx([-w for w in at]),
        pytest.approx([-1 - 0.1 * w for w in at]),
    )
    assert line(forth) == (MODEL, pytest.approx(at), pytest.approx([1 + 0.1 * w for w in at]))
    assert (forth.get_linestyle(), forth.get_marker()) == ("-", "None")
    assert words(axes) == {
        "title": "torque that the drive takes at steady speeds",
        "x": "speed of the motor shaft, rad/s",
        "y": "mN·m at the motor shaft",
        "texts": [],
    }
    assert legend(axes) == ["recorded, a run each", "model"]
    assert axes.get_legend()._loc == 2  # upper left
    assert not axes.get_legend().get_frame_on()
    assert looked(axes) == (RULE, INK, True)
    assert axes.xaxis.majorTicks[0].tick1line.get_markersize() == 3
    # The look is of this picture alone.
    assert rcParams["axes.spines.top"]


# -- curves of specimens ---------------------------------------------------------------------------


def a_set(label, amplitude_deg, training, held_out):
    rows = {"training": np.array(training, int), "held_out": np.array(held_out, int)}
    return Of(label=label, amplitude_rad=np.radians(amplitude_deg), **rows)


def a_recording(label, n, *sets):
    t = np.arange(n) * 0.5
    return Of(label=label, time_s=t, theta_rad=0.1 * t, tau_Nm=2.0 * t, sets=sets)


def test_loops_of_a_specimen_are_those_of_all_its_recordings(monkeypatch):
    given = []
    monkeypatch.setattr(figures, "loops", lambda *a: given.append(a) or "drawn")
    first = a_recording("a", 4, a_set("up", 12.5, [3, 0], [1]), a_set("none", 3, [], []))
    second = a_recording("b", 3, a_set("down", 7, [0], [2]), a_set("last", 8.25, [], [1]))
    torque = {"a": np.arange(4.0), "b": np.full(3, -5.0)}
    found = Of(recordings=(first, second), verdict=Of(torque_Nm=torque))
    shown = specimen.SECTIONS[1].shown(found)
    assert shown == {"loops": "drawn", "panels": 3, "most": 16}
    ((whole, name, points),) = given
    assert (name, points) == ("loops", 60_000)
    assert (whole.label, whole.model_name) == ("every recording", "model")
    assert whole.time_s.tolist() == [0.0, 0.5, 1.0, 1.5, 0.0, 0.5, 1.0]
    assert whole.theta_rad == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.0, 0.05, 0.1])
    assert whole.model_Nm.tolist() == [0.0, 1.0, 2.0, 3.0, -5.0, -5.0, -5.0]
    assert whole.measured_Nm.tolist() == [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0]
    assert whole.held_out.tolist() == [False, True, False, False, False, True, True]
    # A set without samples has no panel; the second recording's samples follow the first's.
    assert [(t, at.tolist()) for t, at in whole.parts] == [
        ("up, 12.5°", [0, 1, 3]),
        ("down, 7°", [4, 6]),
        ("last, 8.25°", [5]),
    ]


def test_curves_of_an_identification_have_what_was_held_out(monkeypatch):
    given = []
    monkeypatch.setattr(figures, "plots", lambda *a: given.append(a) or ["p"])
    roles = {"some": [1, 2, 0], "none": [1, 1, 0], "all": [2, 2, 2]}
    series = {
        label: {
            "role": np.array(role),
            "time_s": np.arange(3.0),
            "theta_rad": np.arange(3.0) / 4,
            "tau_model_Nm": np.array([5.0, 6.0, 7.0]),
            "tau_Nm": np.array([1.0, 2.0, 4.0]),
        }
        for label, role in roles.items()
    }
    recordings = [a_recording(k, 3, a_set(f"set of {k}", 10, [0, 1, 2], [])) for k in roles]
    result = Of(recordings=recordings[::-1], series=series, full_scale_Nm=8.0)
    shown = identification.SECTIONS[2].shown(result)
    assert shown == {"plots": ["p"]}
    ((traces, full_scale, roundings),) = given
    assert (full_scale, roundings) == (8.0, [None, None, None])
    assert [t.label for t in traces] == ["some", "none", "all"]
    some, none, every = traces
    assert some.held_out.tolist() == [False, True, False]
    assert none.held_out is every.held_out is None
    assert some.model_name == "identified model (C, float64)"
    assert [(t, at.tolist()) for t, at in none.parts] == [("set of none, amplitude 10°", [0, 1, 2])]
    assert some.time_s.tolist() == [0.0, 1.0, 2.0]
    assert some.theta_rad.tolist() == [0.0, 0.25, 0.5]
    assert some.model_Nm.tolist() == [5.0, 6.0, 7.0]
    assert some.measured_Nm.tolist() == [1.0, 2.0, 4.0]


# -- what the other tests of figures leave ---------------------------------------------------------


@pytest.fixture
def shown(monkeypatch) -> list[Figure]:
    kept: list[Figure] = []
    monkeypatch.setattr(figures, "svg", lambda f, *_: kept.append(f) or "")
    return kept


def a_curve(label="one", **changes):
    t = np.arange(6.0)
    made = {"parts": (("a set", np.arange(6)),), "measured_Nm": 2 * t} | changes
    return figures.Curve(label, t, 0.1 * t, t, **made)


def test_recordings_share_held_out_samples_where_all_have_them():
    held = np.array([True, False, False, False, False, True])
    both = figures.joined([a_curve(held_out=held), a_curve(held_out=~held, model_name="m")])
    assert both.held_out.tolist() == [*held.tolist(), *(~held).tolist()]
    assert both.model_name == "C, float32"
    assert figures.joined([a_curve(held_out=held), a_curve()]).held_out is None


@pytest.mark.parametrize("components", [(), (("spring", np.arange(6.0)),)])
def test_recordings_with_parts_of_their_torque_do_not_share(monkeypatch, components):
    monkeypatch.setattr(figures, "loops", lambda trace, *_: trace.label)
    monkeypatch.setattr(figures, "over_time", lambda *a: a[1:])
    held = np.arange(6) > 3
    traces = [a_curve("one", held_out=held), a_curve("two", components=components)]
    alone = bool(components)
    page = figures.plots(traces, 9.0, ["r1", "r2"])
    assert [p["loops"] for p in page] == (["one", "two"] if alone else ["every recording", ""])
    assert [p["label"] for p in page] == ["one", "two"]
    assert [p["held_out"] for p in page] == [True, False]
    assert [p["measured"] for p in page] == [True, True]
    assert [p["shared"] for p in page] == [not alone] * 2
    assert [p["time"] for p in page] == [
        ("time0", 15_000, 9.0, "r1"),
        ("time1", 15_000, 9.0, "r2"),
    ]


def test_no_panel_stands_empty_and_angles_are_under_the_last_of_each_column(shown):
    parts = tuple((str(k), np.arange(6)) for k in range(5))
    figures.loops(a_curve(parts=parts), "x", 1000)
    (figure,) = shown
    assert [a.get_visible() for a in figure.axes] == [True] * 5 + [False]
    seen = figure.axes[:5]
    assert [a.get_xlabel() for a in seen] == ["", "", *["deflection, deg"] * 3]
    # All of one scale; an upper panel above an empty place has its numbers too.
    assert {a.get_xlim() for a in seen} == {seen[0].get_xlim()}
    assert {a.get_ylim() for a in seen} == {seen[0].get_ylim()}
    assert seen[2].xaxis.get_tick_params()["labelbottom"] is True
    assert len(seen[0].xaxis.get_major_locator().tick_values(-10, 10)) <= 7


def test_axes_over_time_have_few_ticks_and_no_room_at_their_ends(shown):
    figures.over_time(a_curve(), "x", 1000, 9.0, (np.arange(6.0), 1e-6 * np.arange(6.0)))
    (figure,) = shown
    for axes in figure.axes:
        # Half a per cent of 5 s at both ends.
        assert axes.get_xlim() == pytest.approx((-0.025, 5.025))
        assert len(axes.yaxis.get_major_locator().tick_values(0, 10)) <= 6
    assert len(legend(figure)) == 2
