"""What the pictures of experiments draw: curves, bars and bands, with numbers and names."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from esea_gen.analysis.frequency import Bandwidth, FrequencyResponse
from esea_gen.analysis.plots import (
    bode,
    crossed,
    gain_map,
    percentile_bars,
    rms_by_case,
    save,
    torque_cases,
    torque_tracking,
)
from esea_gen.errors import UserError

from .drawn_figures import bands, legend, line, lines, words

MEASURED, MODEL, BOUND, ROUNDING, INK = "#d98b3a", "#00558c", "#9a3f78", "#00775a", "#26303a"
N = 50
T = np.linspace(0, 2, N)
DESIRED = np.sin(T)


def test_torque_over_time_with_its_errors():
    true, modelled = DESIRED + 0.25, DESIRED - 0.5 * np.cos(T)
    figure = torque_tracking(T, DESIRED, true, modelled, title="a case")
    above, below = figure.axes
    assert words(above) == {"title": "a case", "x": "", "y": "torque, N·m", "texts": []}
    assert words(below) == {"title": "", "x": "time, s", "y": "error, N·m", "texts": []}
    t = T.tolist()
    assert lines(above) == {
        "modelled": (MODEL, t, modelled.tolist()),
        "true": (MEASURED, t, true.tolist()),
        "desired": (INK, t, DESIRED.tolist()),
    }
    rms = np.sqrt(np.mean((0.5 * np.cos(T)) ** 2))
    errors = lines(below)
    assert list(errors) == [f"modelled: RMS {rms:.3g} N·m", "true: RMS 0.25 N·m"]
    first, second = errors.values()
    assert first == (MODEL, t, pytest.approx((-0.5 * np.cos(T)).tolist()))
    assert second == (MEASURED, t, pytest.approx([0.25] * N))
    (level,) = [line(a) for a in below.lines if str(a.get_label()).startswith("_")]
    assert level[2] == [0, 0]
    # One time axis, so that a reader's zoom moves both.
    assert above.get_shared_x_axes().joined(above, below)
    assert [legend(a) for a in figure.axes] == [["modelled", "true", "desired"], list(errors)]
    alone = torque_tracking(T, DESIRED, true)
    assert [list(lines(a)) for a in alone.axes] == [["true", "desired"], ["true: RMS 0.25 N·m"]]
    assert alone.axes[0].get_title() == ""


def test_a_panel_for_every_case():
    given = [("one", T, DESIRED, DESIRED + 0.1, DESIRED - 0.2)]
    given += [("two", T + 1, 2 * DESIRED, 2 * DESIRED - 0.3, DESIRED)]
    figure = torque_cases(given, title="smc")
    for axes, (name, t, desired, true, modelled), rms in zip(
        figure.axes, given, ("0.1", "0.3"), strict=True
    ):
        assert words(axes)["title"] == f"smc: {name}: RMS of the true error shown {rms} N·m"
        assert words(axes)["y"] == "torque, N·m"
        assert lines(axes) == {
            "modelled": (MODEL, t.tolist(), modelled.tolist()),
            "true": (MEASURED, t.tolist(), true.tolist()),
            "desired": (INK, t.tolist(), desired.tolist()),
        }
    assert [words(a)["x"] for a in figure.axes] == ["", "time, s"]
    assert legend(figure) == ["modelled", "true", "desired"]


def bars_of(axes):
    """Label, and of each bar its middle, height, face and edge."""
    return [
        (
            c.get_label(),
            [p.get_x() + 0.5 * p.get_width() for p in c],
            [p.get_height() for p in c],
            {to_hex(p.get_facecolor()) for p in c},
            {to_hex(p.get_edgecolor()) for p in c},
        )
        for c in axes.containers
    ]


def test_bars_stand_side_by_side_published_ones_first():
    figure = rms_by_case(
        ["a", "b"],
        {"mpc": [0.1, np.nan], "own": [0.7, 0.8]},
        {"smc": [0.5, np.nan], "mpc": [0.3, 0.4]},
        unit="mN·m",
    )
    (axes,) = figure.axes
    # Four kinds of bars in 0.8 of a case: 0.2 each, from -0.3 to 0.3 about it.
    white = "#ffffff"
    assert bars_of(axes) == [
        ("mpc, thesis", pytest.approx([-0.3, 0.7]), [0.3, 0.4], {white}, {MODEL}),
        ("mpc, ours", pytest.approx([-0.1]), [0.1], {MODEL}, {MODEL}),
        ("own, ours", pytest.approx([0.1, 1.1]), [0.7, 0.8], {MEASURED}, {MEASURED}),
        ("smc, thesis", pytest.approx([0.3]), [0.5], {white}, {ROUNDING}),
    ]
    assert {round(p.get_width(), 9) for c in axes.containers for p in c} == {0.18}
    # What has no number of ours is a cross at the foot.
    (cross,) = axes.lines
    assert (cross.get_marker(), line(cross)) == ("x", (MODEL, pytest.approx([0.9]), [0.0]))
    assert [t.get_text() for t in axes.get_xticklabels()] == ["a", "b"]
    assert axes.get_xticks().tolist() == [0, 1]
    assert axes.get_xlim() == (-0.6, 1.6)
    assert axes.get_ylim()[0] == 0
    assert not any(g.get_visible() for g in axes.xaxis.get_gridlines())
    assert axes.get_ylabel() == "RMS error, mN·m"
    assert legend(figure) == ["mpc, thesis", "mpc, ours", "own, ours", "smc, thesis"]


@pytest.mark.parametrize(("names", "turned"), [(["a" * 8] * 2, False), (["a" * 9] * 2, True)])
def test_long_names_are_turned(names, turned):
    # One kind of bars: room for 4 (1 + 1) letters; a name on two lines is as long as its longer.
    for cases in (names, [f"x\n{n}" for n in names]):
        (axes,) = rms_by_case(cases, {"mpc": [1.0, 2.0]}).figure.axes
        assert {t.get_rotation() for t in axes.get_xticklabels()} == {35.0 if turned else 0.0}


def test_as_many_numbers_as_cases():
    for given in ([0.1], [0.1, 0.2, 0.3], [[0.1, 0.2]]):
        with pytest.raises(UserError, match="for 2 cases"):
            rms_by_case(["a", "b"], {"mpc": given})
        with pytest.raises(UserError, match="for 2 cases"):
            rms_by_case(["a", "b"], {}, {"mpc": given})


def response(sigma=True, coherence=True):
    f = np.array([1.0, 2.0, 4.0, 8.0])
    h = np.array([1.0, 0.9 - 0.3j, -0.5j, -0.1 - 0.1j])
    return FrequencyResponse(
        f,
        h,
        np.array([1.0, 0.9, 0.8, 0.7]) if coherence else None,
        np.array([0.01, 0.02, 0.3, 0.6]) if sigma else None,
        "a method",
    )


def test_gain_phase_and_coherence():
    r = response()
    other = FrequencyResponse(r.frequency_Hz[1:] * 5, r.response[1:], None, None, "")
    marks = [
        ("other", Bandwidth(12.0, 0.5, "given gain", 3.0, 0.0, 1.0, False)),
        ("none", Bandwidth(3.0, 2.0, "gain at 1 Hz", 6.0, 0.0, 1.0, False)),
        ("one", Bandwidth(None, 1.0, "given gain", 3.0, 0.0, 1.0, False)),
    ]
    figure = bode([("one", r), ("other", other)], marks)
    gain, phase, coherence = figure.axes
    f, gains = r.frequency_Hz.tolist(), (20 * np.log10(np.abs(r.response))).tolist()
    # Angles by hand: 0, atan(0.3/0.9), a quarter, and past it (unwrapped).
    angles = [0.0, -np.degrees(np.arctan2(0.3, 0.9)), -90.0, -135.0]
    drawn = lines(gain)
    assert drawn["one"] == (MODEL, f, pytest.approx(gains))
    assert drawn["other"][0] == MEASURED
    assert [line(a) for a in phase.lines] == [
        (MODEL, f, pytest.approx(angles)),
        (MEASURED, [10.0, 20.0, 40.0], pytest.approx(angles[1:])),
    ]
    assert [line(a) for a in coherence.lines] == [(MODEL, f, [1.0, 0.9, 0.8, 0.7])]
    # Two deviations either way, 0.9 of the gain at most.
    part = np.array([0.02, 0.04, 0.6, 0.9])
    ((x, low, high),) = bands(gain)
    assert x == f
    assert low == pytest.approx(gains + 20 * np.log10(1 - part))
    assert high == pytest.approx(gains + 20 * np.log10(1 + part))
    ((x, low, high),) = bands(phase)
    assert low == pytest.approx(angles - np.degrees(part))
    assert high == pytest.approx(angles + np.degrees(part))
    # The dot stands the fall below the gain that it counts from; what has no figure has no dot.
    dots = {k: v for k, v in drawn.items() if k not in ("one", "other")}
    assert dots == {
        "−3 dB at 12 Hz, from the\ngiven gain, −6.02 dB": (
            MEASURED,
            [12.0],
            pytest.approx([20 * np.log10(0.5) - 3.0]),
        ),
        "−6 dB at 3 Hz, from the\ngain at 1 Hz, +6.02 dB": (
            INK,
            [3.0],
            pytest.approx([20 * np.log10(2.0) - 6.0]),
        ),
    }
    assert [words(a)["y"] for a in figure.axes] == ["gain, dB", "phase, deg", "coherence"]
    assert [words(a)["x"] for a in figure.axes] == ["", "", "frequency, Hz"]
    assert coherence.get_xlim() == gain.get_xlim() == pytest.approx((1.0, 40.0))
    assert coherence.get_ylim() == (0, 1.05)
    assert coherence.get_xscale() == "log"
    shown = [v for v in coherence.get_xticks() if 1 <= v <= 40]
    assert shown == pytest.approx([1, 2, 5, 10, 20])
    assert [coherence.xaxis.get_major_formatter()(v, 0) for v in (0.5, 20)] == ["0.5", "20"]
    assert legend(figure) == list(drawn)


def test_without_a_coherence_two_panels():
    figure = bode([("one", response(sigma=False, coherence=False))])
    assert len(figure.axes) == 2
    assert [bands(a) for a in figure.axes] == [[], []]
    assert figure.axes[1].get_xlabel() == "frequency, Hz"
    level = [("one", Bandwidth(2.0, 1.0, "given gain", 3.0103, 0, 1, False))]
    (label,) = [w for w in legend(bode([("one", response())], level)) if w != "one"]
    assert label == "−3.01 dB at 2 Hz, from the\ngiven gain, 0 dB"


def test_where_the_gains_are_passive():
    stable = np.array([[True, True, True], [True, False, False]])
    passive = np.array([[True, False, True], [False, True, False]])
    region = SimpleNamespace(
        stable=stable,
        passive=passive,
        kp_Nm_rad=np.array([10.0, 20.0]),
        kd_Nms_rad=np.array([0.5, 1.0, 4.5]),
    )
    figure = gain_map(region, [("left", 12.0, 2.4), ("right", 18.0, 2.51)], title="a loop")
    (axes,) = figure.axes
    (mesh,) = [c for c in axes.collections if isinstance(c, QuadMesh)]
    # 0 unstable (whatever its energy), 1 stable, 2 passive too.
    assert np.asarray(mesh.get_array()).tolist() == [[2, 1, 2], [1, 0, 0]]
    assert mesh.get_clim() == (0, 2)
    assert not any(g.get_visible() for g in axes.xaxis.get_gridlines())
    edges = np.asarray(mesh.get_coordinates())
    assert edges[0, :, 0].tolist() == [0.25, 0.75, 2.75, 6.25]
    assert edges[:, 0, 1].tolist() == [5.0, 15.0, 25.0]
    colours = ["#efc9b0", "#cfdde8", MODEL]
    assert [to_hex(mesh.cmap(k)) for k in range(3)] == colours
    (box,) = figure.legends
    assert [to_hex(p.get_facecolor()) for p in box.get_patches()] == colours
    assert legend(figure) == ["unstable with a hand", "stable with every hand", "passive"]
    assert [line(a)[1:] for a in axes.lines] == [([2.4], [12.0]), ([2.51], [18.0])]
    # Right of the middle (2.5) a name stands left of its mark.
    assert [(t.get_text(), t.xy, t.get_ha(), t.xyann) for t in axes.texts] == [
        ("left", (2.4, 12.0), "left", (8, 4)),
        ("right", (2.51, 18.0), "right", (-8, 4)),
    ]
    assert words(axes)["title"] == "a loop"
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        "damping Kd, N·m·s/rad",
        "stiffness Kp, N·m/rad",
    )


def percentiles(scale, failed=0):
    return SimpleNamespace(
        values={q: scale * v for q, v in ((5.0, 1), (25.0, 2), (50.0, 3), (75.0, 4), (95.0, 5))},
        low={95.0: scale * 4.5},
        high={95.0: scale * 6.5},
        largest=scale * 7,
        failed=failed,
        count=20,
    )


def test_percentiles_of_many_runs():
    rows = [("one", percentiles(1.0)), ("two", percentiles(-1.0, failed=5))]
    figure = percentile_bars(rows, {"two": 2.5, "elsewhere": 9.0}, xlabel="a label")
    (axes,) = figure.axes
    drawn = [(a.get_linewidth(), a.get_marker(), *line(a)) for a in axes.lines]
    for k, s in ((1, 1.0), (0, -1.0)):
        at = slice(0, 5) if k else slice(5, 10)
        assert drawn[at] == [
            (1.6, "None", MODEL, [s, 5 * s], [k, k]),
            (7, "None", MODEL, [2 * s, 4 * s], [k, k]),
            (2, "None", ROUNDING, [4.5 * s, 6.5 * s], [k - 0.26] * 2),
            (1.5, "|", "#ffffff", [3 * s], [k]),
            (1.5, "o", MEASURED, [7 * s], [k]),
        ]
    assert drawn[10] == (2, "None", BOUND, [2.5, 2.5], [-0.38, 0.38])
    assert legend(figure) == [
        *("5 to 95 %", "25 to 75 %", "95 % interval of the 95 %", "largest", "limit")
    ]
    names = axes.get_yticklabels()
    assert [t.get_text() for t in names] == ["one", "two\n5 of 25 failed"]
    assert [to_hex(t.get_color()) == BOUND for t in names] == [False, True]
    assert axes.get_yticks().tolist() == [1, 0]
    assert axes.get_ylim() == (-0.6, 1.6)
    assert axes.get_xlim()[0] == -1.0
    assert axes.get_xlabel() == "a label"
    (all_above,) = percentile_bars(rows[:1], {"one": 1.0}).axes
    assert all_above.get_xlim()[0] == 0.0
    assert all_above.get_xlabel() == "RMS error, N·m"
    both = percentile_bars(rows, {"one": 1.0, "two": 2.0})
    assert legend(both).count("limit") == 1


def test_cases_that_ended_badly_are_crossed_wherever_they_stand():
    figure = rms_by_case(["a", "b\nlong"], {"mpc": [1.0, 2.0]})
    figure.axes[0].set_title("smc: a: 3", loc="left")
    figure.axes[0].set_title("ab", loc="center")
    assert crossed(figure, {}) is figure
    assert figure.get_supxlabel() == ""
    done = crossed(figure, {"a": "tripped", "long": "failed"})
    (axes,) = done.axes
    assert [t.get_text() for t in axes.get_xticklabels()] == ["✗ a", "✗ b\nlong"]
    assert axes.get_xticks().tolist() == [0, 1]
    assert (axes.get_title("left"), axes.get_title("center")) == ("✗ smc: a: 3", "ab")
    assert done.get_supxlabel() == "✗ a: tripped\n✗ long: failed"
    assert to_hex(done._supxlabel.get_color()) == BOUND
    for count, last in ((6, "✗ 5: off"), (7, "and 1 more cases"), (9, "and 3 more cases")):
        said = crossed(Figure(), {str(k): "off" for k in range(count)}).get_supxlabel()
        assert said.split("\n")[5:] == ["✗ 5: off", *([last] if count > 6 else [])]


def test_a_picture_of_an_unknown_kind_is_refused(tmp_path):
    figure = torque_tracking(T, DESIRED, DESIRED)
    with pytest.raises(UserError, match=r"x.abc: cannot be drawn .*Format 'abc'"):
        save(figure, tmp_path / "x.abc")
    save(figure, tmp_path / "X.SVG")
    assert (tmp_path / "X.SVG").read_text(encoding="utf-8").lstrip().startswith("<?xml")
    assert figure.get_dpi() == 130
