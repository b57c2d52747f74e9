"""Figures of a page: what they draw and in which unit, and which panels recordings share."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.report import figures
from esea_gen.report.figures import Curve, loops, over_time, plots
from tests.drawn_figures import legend, line, lines, spans

FULL_SCALE_NM = 4.47


@pytest.fixture
def shown(monkeypatch):
    """The figures that are drawn, before they become text."""
    kept = []
    monkeypatch.setattr(figures, "svg", lambda f, *names: kept.append(f) or "")
    return kept


def curve(label="a", n=400, parts=None, **changes):
    t = np.arange(n) * 4.0 / n
    tau = 3.0 * np.sin(t)
    whole = parts or ((f"loop of {label}", np.arange(n)),)
    held = np.zeros(n, dtype=bool)
    made = Curve(label, t, np.radians(10.0) * np.sin(t), tau, tau - 0.447, whole, held)
    return replace(made, **changes)


def test_every_data_set_has_a_panel_and_nothing_is_hidden():
    def recording(*sets):
        sets = [
            SimpleNamespace(label=a, amplitude_rad=0.1, training=np.array(b), held_out=np.array(c))
            for a, b, c in sets
        ]
        zeros = np.zeros(10)
        return SimpleNamespace(label="r", time_s=zeros, theta_rad=zeros, tau_Nm=zeros, sets=sets)

    found = figures.recorded(recording(("a", [4, 5, 2], [3]), ("b", [6], [7, 8])), np.zeros(10))
    assert [s.tolist() for _, s in found.parts] == [[2, 3, 4, 5], [6, 7, 8], list(range(10))]
    assert np.flatnonzero(found.held_out).tolist() == [3, 7, 8]
    whole = recording(("a", list(range(6)), list(range(6, 10))))
    assert len(figures.recorded(whole, np.zeros(10)).parts) == 1


def test_recordings_of_one_loop_each_share_a_figure(shown):
    one, other = curve(), curve("b", model_Nm=-2.0 * np.ones(400))
    assert [p["shared"] for p in plots([one], FULL_SCALE_NM, [None])] == [False]
    shown.clear()
    pair = plots([one, other], FULL_SCALE_NM, [None, None])
    assert [(p["shared"], p["parts"]) for p in pair] == [(True, 2)] * 2
    # Both loops in the first figure, each from its own samples; then each over time.
    assert len(shown) == 3
    model = [lines(a)["C, float32"][2] for a in shown[0].axes if a.get_visible()]
    assert max(model[0]) == pytest.approx(3.0, abs=0.001)
    assert set(model[1]) == {-2.0}
    halves = (("up", np.arange(200)), ("down", np.arange(200, 400)))
    apart = plots([one, replace(other, parts=halves)], FULL_SCALE_NM, [None, None])
    assert [(p["shared"], p["parts"]) for p in apart] == [(False, 1), (False, 2)]
    many = curve(parts=tuple((str(k), np.arange(40)) for k in range(20)))
    (row,) = plots([many], FULL_SCALE_NM, [None])
    assert row["drawn"] < row["parts"] == 20


def test_a_loop_lifts_its_pen_between_cycles_and_at_what_was_held_out():
    at = np.concatenate([np.arange(4), np.arange(40, 44)])  # two cycles, far apart
    figure = loops(curve(n=60, parts=(("a set", at),), held_out=np.arange(60) >= 42), 1000)
    drawn = lines(figure.axes[0])
    assert list(drawn) == ["measured", "C, float32", "C, float32, held out"] == legend(figure)
    gaps = {k: np.flatnonzero(np.isnan(y)).tolist() for k, (_, _, y) in drawn.items()}
    assert list(gaps.values()) == [[4], [4, 7, 8], [0, 1, 2, 3, 4, 5, 6]]


def test_loops_are_in_degrees_with_the_parts_of_the_torque_beside():
    loop, parts = loops(curve(components=(("spring", 2.0 * np.ones(400)),)), 10_000).axes
    for axes, name in ((loop, "C, float32"), (parts, "spring")):
        assert max(lines(axes)[name][1]) == pytest.approx(10.0, rel=1e-3)
    assert set(lines(parts)["spring"][2]) == {2.0}


@pytest.mark.parametrize("n", [4000, 40_000])
def test_a_page_stays_small_and_keeps_peaks(n):
    spike = curve(n=n)
    spike.model_Nm[n // 3] = 99.0
    in_time = over_time(spike, 400, FULL_SCALE_NM, None)
    for axes in (*loops(spike, 400).axes, *in_time.axes):
        assert all(len(x) <= 402 for _, x, _ in map(line, axes.lines))
    assert max(lines(in_time.axes[0])["C, float32"][2]) == 99.0


def test_torque_its_error_and_its_rounding_stand_in_the_unit_of_their_axis():
    c = curve(held_out=np.isin(np.arange(400), [5, 6, 7, 20]))
    rounding_Nm = 2.5e-6 * np.cos(c.time_s)
    figure = over_time(c, 10_000, FULL_SCALE_NM, (c.time_s, rounding_Nm))
    torque, error, rounding = figure.axes
    assert max(lines(torque)["C, float32"][2]) == pytest.approx(3.0, abs=0.001)
    # A torque that is 0.447 Nm too high everywhere, of 4.47 Nm: 10 per cent.
    assert error.get_ylabel().endswith("% full scale")
    np.testing.assert_allclose(line(error.lines[0])[2], 10.0, rtol=1e-12)
    assert rounding.get_ylabel().endswith("µN·m")
    assert max(line(rounding.lines[0])[2]) == pytest.approx(2.5, rel=1e-3)
    t = c.time_s
    assert spans(torque) == spans(error) == pytest.approx(np.array([(t[5], t[7]), (t[20], t[20])]))
    assert spans(rounding) == []


def test_largest_errors_by_stream_with_0_at_the_left_edge():
    rows = [("a", 0.0, 2e-5, 4e-3), ("b", 3e-14, None, None), ("c", None, 1e-4, 20.0)]
    (axes,) = figures.error_overview(rows, 3.7).axes
    left, right = axes.get_xlim()
    assert left < 3e-14
    assert right > 20
    drawn = {k: v[1:] for k, v in lines(axes).items()}
    assert drawn["float64 C"] == (pytest.approx([left, 3e-14]), [2.0, 1.0])
    assert drawn["float32 C"] == (pytest.approx([2e-5, 1e-4]), [2.0, 0.0])
    assert drawn["derived float32 bound"] == (pytest.approx([4e-3, 20]), [2.0, 0.0])
    assert drawn["fit to the measured torque, RMS"][0] == [3.7, 3.7]
    look = axes.xaxis.get_major_formatter()
    ticks = axes.get_xticks()
    assert look(ticks[0], 0) == "0"
    numbers = dict(zip(map(float, ("0.01", "1", "100")), ("0.01", "1", "100"), strict=True))
    assert all(look(at, 0) == text for at, text in numbers.items())


def test_a_parameters_bar_is_its_deviation_in_per_cent_of_its_value():
    rows = [("k1", 9.39, 0.0939), ("k3", -200.0, 50.0), ("n", 1.0, 3.0), ("z", 0.0, 1.0)]
    (axes,) = figures.spread([*rows, ("m", 2.0, None)]).axes
    bars = [x for _, x, _ in map(line, axes.lines) if len(x) == 2]
    np.testing.assert_allclose(bars, [[-1.0, 1.0], [-25.0, 25.0], [-200.0, 200.0]])
    assert [t.get_text() for t in axes.texts] == ["±1.0 %", "±25 %", "±300 %"]
