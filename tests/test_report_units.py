"""Pages and their figures: each number is in the unit, or the per cent, that its label says."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from esea_gen.report import figures, sensing
from esea_gen.report.identification import identification_page
from esea_gen.report.page import number

from .html_tables import drawn, figure, table_of

# Fixtures of the pages.
from .test_report import chirped, chirped_page, identification, mapping  # noqa: F401

pytestmark = pytest.mark.ci

FULL_SCALE_NM = 4.47


@pytest.fixture
def shown(monkeypatch) -> list[Figure]:
    """The figures that are drawn, before they become text."""
    kept: list[Figure] = []
    monkeypatch.setattr(figures, "svg", lambda f, *_: kept.append(f) or "")
    return kept


def curve(**changes: object) -> figures.Curve:
    t = np.arange(400) * 1e-2
    theta = np.radians(10.0) * np.sin(t)
    whole = (("a set", np.arange(400)),)
    made = figures.Curve("a", t, theta, 3.0 * np.sin(t), 3.0 * np.sin(t) - 0.447, whole)
    return replace(made, **changes)


def test_torque_its_error_and_its_rounding_stand_in_the_unit_of_their_axis(shown):
    c = curve()
    rounding = (c.time_s, 2.5e-6 * np.cos(c.time_s))
    figures.over_time(c, "x", 10_000, FULL_SCALE_NM, rounding)
    torque, error, difference = shown[0].axes
    assert torque.get_ylabel() == "torque, N·m"
    assert drawn(torque).max() == pytest.approx(3.0, abs=0.001)
    # A torque that is 0.447 Nm too high everywhere, of 4.47 Nm: 10 per cent.
    assert error.get_ylabel().endswith("% full scale")
    np.testing.assert_allclose(drawn(error), 10.0, rtol=1e-12)
    # Two and a half millionths of a newton-metre.
    assert difference.get_ylabel().endswith("µN·m")
    assert drawn(difference).max() == pytest.approx(2.5, rel=1e-3)
    assert difference.get_xlabel() == "time, s"
    assert difference.lines[0].get_xdata().max() == pytest.approx(3.99)


def test_loops_are_in_degrees_and_newton_metres(shown):
    figures.loops(curve(components=(("spring", 2.0 * np.ones(400)),)), "x", 10_000)
    loop, parts = shown[0].axes
    for axes in (loop, parts):
        assert axes.get_xlabel() == "deflection, deg"
        x = np.concatenate([np.asarray(line.get_xdata(), dtype=float) for line in axes.lines])
        assert np.nanmax(x) == pytest.approx(10.0, rel=1e-3)
    assert loop.get_ylabel() == "torque, N·m"
    np.testing.assert_allclose(drawn(parts), 2.0)


def test_the_overview_draws_the_per_cent_that_it_is_given(shown):
    figures.error_overview([("a stream", 1e-9, 1e-5, 1e-3)], 3.7, "x")
    (axes,) = shown[0].axes
    assert "% of full scale" in axes.get_xlabel()
    x = {line.get_label(): np.asarray(line.get_xdata(), dtype=float) for line in axes.lines}
    assert [x[k][0] for k in ("float64 C", "float32 C")] == pytest.approx([1e-9, 1e-5])
    assert x["derived float32 bound"][0] == pytest.approx(1e-3)
    assert x["fit to the measured torque, RMS"][0] == pytest.approx(3.7)
    # And its ticks say so too: "0.1" stands at a tenth of a per cent.
    said = {t: axes.xaxis.get_major_formatter()(t, 0) for t in axes.get_xticks()}
    for at, text in said.items():
        if re.fullmatch(r"[\d.]+", text) and float(text) > 0:
            assert float(text) == pytest.approx(at)


def test_a_parameters_bar_is_its_deviation_in_per_cent_of_its_value(shown):
    figures.spread([("k1", 9.39, 0.0939), ("k3", -200.0, 50.0), ("m", 2.0, None)], "x")
    (axes,) = shown[0].axes
    assert "% of the value" in axes.get_xlabel()
    bars = [line.get_xdata() for line in axes.lines if len(line.get_xdata()) == 2]
    np.testing.assert_allclose(bars, [[-1.0, 1.0], [-25.0, 25.0]])
    assert [t.get_text() for t in axes.texts] == ["±1.0 %", "±25 %"]


def test_every_axis_runs_from_small_to_large_and_holds_what_is_drawn(shown):
    c = curve(held_out=np.arange(400) > 300)
    figures.loops(c, "x", 10_000)
    figures.over_time(c, "x", 10_000, FULL_SCALE_NM, (c.time_s, 1e-6 * np.cos(c.time_s)))
    figures.error_overview([("a", 1e-9, 1e-5, 1e-3), ("b", 0.0, 2e-5, 30.0)], 3.7, "x")
    figures.spread([("k1", 9.39, 0.0939), ("k3", -200.0, 50.0)], "x")
    axes = [a for f in shown for a in f.axes if a.get_visible()]
    assert len(axes) == 1 + 3 + 1 + 1
    for a in axes:
        for (low, high), values in (
            (a.get_xlim(), [line.get_xdata() for line in a.lines]),
            (a.get_ylim(), [line.get_ydata() for line in a.lines]),
        ):
            assert low < high
            every = np.concatenate([np.asarray(v, dtype=float) for v in values])
            every = every[np.isfinite(every)]
            assert low <= every.min()
            assert every.max() <= high
    # The first stream stands uppermost, beside its name.
    overview = axes[4]
    names = dict(
        zip((t.get_text() for t in overview.get_yticklabels()), overview.get_yticks(), strict=True)
    )
    (bound,) = [x for x in overview.lines if x.get_label() == "derived float32 bound"]
    assert dict(zip(bound.get_ydata(), bound.get_xdata(), strict=True)) == {
        names["a"]: 1e-3,
        names["b"]: 30.0,
    }
    assert names["a"] > names["b"]


def test_a_loop_tells_what_was_held_out_from_what_was_trained(shown):
    held = np.arange(400) > 300
    figures.loops(curve(held_out=held, parts=(("all", np.arange(400)),)), "x", 10_000)
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in shown[0].axes[0].lines}
    assert set(lines) == {"measured", "C, float32", "C, float32, held out"}
    np.testing.assert_array_equal(np.isnan(lines["C, float32"]), held)
    np.testing.assert_array_equal(np.isnan(lines["C, float32, held out"]), ~held)
    assert not np.isnan(lines["measured"]).any()


def test_two_recordings_of_one_loop_share_a_figure_and_one_stands_alone(shown):
    one, other = curve(), curve(label="b", model_Nm=-2.0 * np.ones(400))
    (alone,) = figures.plots([one], FULL_SCALE_NM, [None])
    assert (alone["shared"], alone["parts"]) == (False, 1)
    assert len(shown) == 2  # its loop, and its torque over time
    shown.clear()
    pair = figures.plots([one, other], FULL_SCALE_NM, [None, None])
    assert [(d["shared"], d["parts"]) for d in pair] == [(True, 2)] * 2
    # Both loops in the first figure, each from its own samples; the second draws none.
    assert len(shown) == 3
    first, second = (a for a in shown[0].axes if a.get_visible())
    assert drawn(first).max() == pytest.approx(3.0, abs=0.001)
    model = {line.get_label(): line for line in second.lines}["C, float32"]
    np.testing.assert_array_equal(model.get_ydata(), -2.0)
    shown.clear()
    # With data sets of its own a recording keeps its figure.
    halves = (("up", np.arange(200)), ("down", np.arange(200, 400)))
    apart = figures.plots([one, replace(other, parts=halves)], FULL_SCALE_NM, [None, None])
    assert [(d["shared"], d["parts"]) for d in apart] == [(False, 1), (False, 2)]
    assert len(shown) == 4


def close(text: str, expected: float, digits: int = 2) -> None:
    """A cell says this, to the digits that cells have."""
    assert figure(text) == pytest.approx(expected, rel=0.6 * 10.0 ** (1 - digits)), text


def test_errors_of_a_recording_and_their_shares_of_full_scale():
    # Off by 0.1 and -0.3 Nm in turn where trained, by 0.2 Nm of the other sign where held out.
    n = 40
    r = SimpleNamespace(time_s=np.arange(n) / 100, tau_Nm=np.sin(np.arange(n) / 3))
    off = np.where(np.arange(n) % 2 == 0, 0.1, -0.3)
    off[30:] = -0.2
    cycles = {"training": 3, "held_out": 1}
    one = SimpleNamespace(label="up", amplitude_rad=0.2, cycles=cycles)
    one.training, one.held_out = np.arange(30), np.arange(30, n)
    other = SimpleNamespace(label="down", amplitude_rad=0.1, cycles={"training": 2})
    other.training, other.held_out = np.arange(0, 30, 2), np.array([], dtype=int)
    r.sets = [one, other]
    run = SimpleNamespace(label="file", recording=r)
    run.torque_at = lambda real, t: r.tau_Nm + off + (1e-6 if real == "f64" else 0.0)
    without = SimpleNamespace(label="virtual", recording=None)
    device = SimpleNamespace(tau_full_scale_Nm=FULL_SCALE_NM)
    found = SimpleNamespace(same_specimen=True, device=device, runs=[without, run])
    told = sensing._fit(found)
    share = 100 / FULL_SCALE_NM
    rms = math.sqrt((0.01 + 0.09) / 2)

    def figures_of(rms_Nm, max_Nm):
        numbers = {"rms_Nm": rms_Nm, "rms_percent": share * rms_Nm}
        return pytest.approx(numbers | {"max_Nm": max_Nm, "max_percent": share * max_Nm})

    first, second = told["sets"]
    assert (first["recording"], first["label"], first["cycles"]) == ("file", "up", cycles)
    assert first["training"] == figures_of(rms, 0.3)
    assert first["held_out"] == figures_of(0.2, 0.2)
    assert second["training"] == figures_of(0.1, 0.1)
    assert second["held_out"] is None
    means = {"training": share * (rms + 0.1) / 2, "held_out": share * 0.2}
    assert told["mean_rms_percent"] == pytest.approx(means)
    assert told["f32_minus_f64_max_Nm"] == pytest.approx(1e-6)
    found.same_specimen = False
    assert sensing._fit(found) is None


def test_per_cent_of_the_identifications_tables(identification):  # noqa: F811
    html = identification_page(identification)
    content = identification.to_dict()
    full = content["full_scale_Nm"]
    specimen = table_of(html, "asymmetry, %", "softening, %")
    head, rows = specimen[0], specimen[1:]
    at = {name: head.index(name) for name in head}
    assert len(rows) == len(content["sets"])
    for row, s in zip(rows, content["sets"], strict=True):
        first, last = (figure(row[at[k]]) for k in ("loss of first cycle, J", "of last cycle, J"))
        # The per cent follow from the columns beside them: 100 less what is left of the loss.
        assert figure(row[at["softening, %"]]) == pytest.approx(100 - 100 * last / first, abs=1)
        assert 10 < figure(row[at["softening, %"]]) < 30
        close(row[at["asymmetry, %"]], 100 * s["asymmetry"])
    errors = table_of(html, "RMS, N·m", "RMS, %", "largest, %")
    columns = [i for i, name in enumerate(errors[0]) if name == "RMS, N·m"]
    assert len(columns) == 2
    named = {s["label"] for s in content["sets"]}
    told = [row for row in errors[1:] if row[0] in named]
    assert len(told) == len(named)
    for row in told:
        for i in columns:
            close(row[i + 1], 100 * figure(row[i]) / full)
            assert figure(row[i + 1]) < figure(row[i + 2]) < 100
    parameters = table_of(html, "parameter", "± standard deviation")
    shares = 0
    for row in parameters[1:]:
        share = re.search(r"\((.*) %\)", row[2])
        if share:
            shares += 1
            close(share[1], 100 * abs(figure(row[2]) / figure(row[1])))
    assert shares >= 3


def test_per_cent_of_full_scale_of_the_sensing_page(chirped, chirped_page):  # noqa: F811
    full = chirped.verification.full_scale
    # Full scales are the device's own: the torque's is that of its identified domain.
    assert full["tau_Nm"] == pytest.approx(chirped.device.tau_full_scale_Nm)
    whole = table_of(chirped_page, "largest error", "% FS", "output")
    rows = [dict(zip(whole[0], row, strict=True)) for row in whole[1:]]
    tau = [r for r in rows if r["output"] == "tau_Nm"]
    assert tau
    for r in rows:
        if figure(r["largest error"]):
            close(r["% FS"], 100 * figure(r["largest error"]) / full[r["output"]])
    bounds = table_of(chirped_page, "bound", "% FS", "worst seen")
    said = [dict(zip(bounds[0], row, strict=True)) for row in bounds[1:]]
    assert len(said) >= 4
    for r in said:
        close(r["% FS"], 100 * figure(r["bound"]) / full[r["output"]])
    for name, w in chirped.to_dict()["worst"].items():
        by_stream = [
            100 * c.errors[k] / full[k]
            for c in chirped.verification.comparisons
            for k in c.errors
            if c.real == name and k == w["output"]
        ]
        assert w["percent"] == pytest.approx(max(by_stream))
        assert f"{number(w['percent'])} % FS" in chirped_page
        assert w["percent"] == pytest.approx(100 * w["error"] / full[w["output"]])
        torque = [
            c.errors["tau_Nm"]
            for c in chirped.verification.comparisons
            if c.real == name and c.block == "sensor"
        ]
        assert w["torque_percent"] == pytest.approx(100 * max(torque) / full["tau_Nm"])
