"""What the figures of closed-loop experiments draw, and in which unit: read back from them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.analysis.frequency import FrequencyResponse, OutputImpedance
from esea_gen.analysis.monte_carlo import Percentiles
from esea_gen.analysis.plots import (
    Panel,
    bode,
    cell_edges,
    crossed,
    impedance_panels,
    panels,
    percentile_bars,
    rms_by_case,
    save,
    torque_cases,
    torque_tracking,
)
from esea_gen.errors import UserError
from esea_gen.identify.drive.friction import Friction, SteadyRun
from esea_gen.identify.drive.regression import Estimate
from esea_gen.plotting import BOUND, INK, MEASURED, MODEL
from esea_gen.report.figures import friction_picture
from esea_gen.studies.tuning_sweep import tuning_trade
from tests.drawn_figures import bands, legend, line, lines, spans, words

T = np.arange(500) * 0.01
DESIRED = 1.7 * np.sin(T)
CURVES = T, DESIRED, DESIRED + 0.25, DESIRED - 0.5
F = np.array([0.2, 0.5, 1.0, 2.0, 5.0])


def near(values) -> object:
    return pytest.approx(np.asarray(values, dtype=float).tolist(), nan_ok=True)


def torques_are_drawn(axes) -> None:
    drawn = lines(axes)
    # The noisy one first: the others lie on it.
    assert list(drawn) == ["modelled", "true", "desired"]
    for name, colour, torque in (
        ("modelled", MODEL, DESIRED - 0.5),
        ("true", MEASURED, DESIRED + 0.25),
        ("desired", INK, DESIRED),
    ):
        assert drawn[name] == (colour, near(T), near(torque))
    assert words(axes)["y"] == "torque, N·m"


def test_torque_over_time_with_its_errors_below(tmp_path):
    figure = torque_tracking(*CURVES, title="case")
    above, below = figure.axes
    torques_are_drawn(above)
    assert words(above)["title"] == "case"
    assert lines(below) == {
        "modelled: RMS 0.5 N·m": (MODEL, near(T), near(T * 0 - 0.5)),
        "true: RMS 0.25 N·m": (MEASURED, near(T), near(T * 0 + 0.25)),
    }
    assert line(below.lines[-1])[2] == [0, 0]
    assert (words(below)["x"], words(below)["y"]) == ("time, s", "error, N·m")
    assert legend(above) == ["modelled", "true", "desired"]
    for ending in ("png", "SVG"):
        save(figure, tmp_path / f"x.{ending}")
        assert (tmp_path / f"x.{ending}").stat().st_size > 5000
    with pytest.raises(UserError, match="cannot be written"):
        save(figure, tmp_path / "x.png" / "y.png")
    with pytest.raises(UserError, match=r"x.abc: cannot be drawn .*Format 'abc'"):
        save(figure, tmp_path / "x.abc")


def test_every_case_has_a_panel():
    figure = torque_cases([("a", *CURVES), ("b", *CURVES)], title="smc")
    for name, axes in zip("ab", figure.axes, strict=True):
        torques_are_drawn(axes)
        said = f"smc: {name}: RMS of the true error shown 0.25 N·m"
        assert words(axes)["title"] == said
    assert [words(a)["x"] for a in figure.axes] == ["", "time, s"]
    assert legend(figure) == ["modelled", "true", "desired"]


def test_bars_by_case_and_a_cross_for_a_failure():
    figure = rms_by_case(["a", "b"], "MPC", np.array([0.1, np.nan]), np.array([0.3, 0.4]))
    (axes,) = figure.axes
    bars = [(p.get_center()[0], p.get_height()) for c in axes.containers for p in c]
    assert bars == [near([-0.2, 0.3]), near([0.8, 0.4]), near([0.2, 0.1])]
    assert line(axes.lines[0])[1:] == (near([1.2]), [0.0])
    assert legend(figure) == ["MPC, thesis", "MPC, ours"]
    assert [t.get_text() for t in axes.get_xticklabels()] == ["a", "b"]
    assert (axes.get_xlim(), axes.get_ylim()[0]) == ((-0.6, 1.6), 0)
    assert words(axes)["y"] == "RMS error, N·m"
    alone = rms_by_case(["a long name"], "MPC", np.array([0.1])).axes[0]
    assert [p.get_center()[0] for p in alone.patches] == near([0.0])
    assert [(t.get_rotation(), t.get_ha()) for t in alone.get_xticklabels()] == [(35, "right")]


def response(gain, phase_deg=0.0, **more) -> FrequencyResponse:
    value = gain * np.exp(1j * np.radians(phase_deg)) * np.ones(len(F))
    told = {"coherence": None, "sigma": None} | more
    return FrequencyResponse(F, value, method="exact", **told)


def test_gain_phase_and_coherence_in_their_units():
    sigma = np.array([0.0, 0.05, 0.1, 0.2, 5.0])
    r = response(2.0 / np.array([1, 1, 1, 4, 8]), -30.0 * F, coherence=F / 5, sigma=sigma)
    figure = bode([("smc", r, r.bandwidth()), ("mpc", *[response(1.0), response(1.0).bandwidth()])])
    gain, phase, coherence = figure.axes
    dB, part = 20 * np.log10(r.gain), np.minimum(2 * sigma, 0.9)
    assert lines(gain)["smc"] == (MODEL, near(F), near(dB))
    assert lines(gain)["mpc"] == (MEASURED, near(F), near(F * 0))
    assert line(phase.lines[0])[2] == near(-30 * F)
    assert line(coherence.lines[0])[2] == near(F / 5)
    assert bands(gain) == [
        (near(F), near(dB + 20 * np.log10(1 - part)), near(dB + 20 * np.log10(1 + part)))
    ]
    turn = np.degrees(part)
    assert bands(phase) == [(near(F), near(-30 * F - turn), near(-30 * F + turn))]
    (dot,) = [a for a in gain.lines if a.get_marker() == "o"]
    # What the drop is from: the dot stands that far below it, not below 0 dB.
    at = r.bandwidth().bandwidth_Hz
    assert line(dot)[1:] == (near([at]), near([20 * math.log10(2 / math.sqrt(2))]))
    said = f"−3.01 dB at {at:.3g} Hz, from the\ngain at 0.2 Hz, +6.02 dB"
    assert legend(figure) == ["smc", said, "mpc"]
    assert [words(a)["y"] for a in figure.axes] == ["gain, dB", "phase, deg", "coherence"]
    assert words(coherence)["x"] == "frequency, Hz"
    assert (coherence.get_ylim(), coherence.get_xlim()) == ((0, 1.05), (0.2, 5.0))
    assert coherence.get_xscale() == "log"
    assert coherence.xaxis.get_major_formatter()(0.5, 0) == "0.5"
    for start, text in ((0.5, "−6.02 dB"), (1.0, "0 dB")):
        low = response(start * np.array([1, 1, 1, 0.1, 0.1]))
        assert legend(bode([("x", low, low.bandwidth())]))[1].endswith(text)


def test_impedance_per_angle_and_its_phase_per_rate():
    found = OutputImpedance.of(response(-2.0, [0, 100, 170, 190, 260]))
    figure = impedance_panels("smc", found)
    above, below = figure.axes
    assert lines(above) == {"smc": (MODEL, near(F), near(2 + 0 * F))}
    assert above.get_yscale() == "log"
    # 90 deg less than per angle; the pen is lifted where it goes round.
    wrapped = (np.array([0, 100, 170, 190, 260]) - 90 + 180) % 360 - 180
    assert line(below.lines[0])[2] == near(wrapped)
    round_ = OutputImpedance.of(response(-1.0, [260, 269, 272, 280, 290]))
    assert line(impedance_panels("x", round_).axes[1].lines[0])[2] == near(
        [170, 179, np.nan, -170, -160]
    )
    (band,) = [p for p in below.patches if p.get_height() == 180]
    assert band.get_y() == -90
    assert list(below.get_yticks()) == [-180, -90, 0, 90, 180]
    assert words(above)["y"] == "torque per angle,\nN·m/rad"
    assert words(below)["x"] == "frequency, Hz (grey: passive)"
    assert below.get_xlim() == (0.2, 5.0)
    table = found.table(5, 0.2, 5.0)
    assert table[-5] == "fit from 0.2 to 5 Hz, torque that the moving needs:"
    assert table[-1].endswith("above 0.2: not one mass, damper and spring")


def test_percentiles_of_a_case_on_one_line():
    levels = (5.0, 25.0, 50.0, 75.0, 95.0)
    values = dict(zip(levels, (0.1, 0.2, 0.3, 0.4, 0.5), strict=True))
    low, high = ({k: v + by for k, v in values.items()} for by in (-0.01, 0.02))
    p = Percentiles("rms", 8, 0, values, low, high, 0.9)
    q = Percentiles("rms", 7, 2, values, low, high, 0.8)
    figure = percentile_bars([("a", p), ("b", q)])
    (axes,) = figure.axes
    drawn = [line(a)[1:] for a in axes.lines]
    one = [([0.1, 0.5], 0), ([0.2, 0.4], 0), ([0.49, 0.52], -0.26), ([0.3], 0)]
    for at, most, got in ((1, 0.9, drawn[:5]), (0, 0.8, drawn[5:])):
        for (x, shift), (gx, gy) in zip([*one, ([most], 0)], got, strict=True):
            assert (gx, gy) == (near(x), near([at + shift] * len(x)))
    names = axes.get_yticklabels()
    assert [t.get_text() for t in names] == ["a", "b\n2 of 9 failed"]
    assert [t.get_color() for t in names] == [INK, BOUND]
    said = ["5 to 95 %", "25 to 75 %", "95 % interval of the 95 %", "largest"]
    assert legend(figure) == said
    assert (axes.get_ylim(), axes.get_xlim()[0]) == ((-0.6, 1.6), 0)


def test_panels_beside_each_other():
    figure = panels([Panel([(F, 2 * F, "a", {"ls": "--"})], "x", "y", {"xscale": "log"})], 4, 3)
    (axes,) = figure.axes
    assert lines(axes)["a"][1:] == (near(F), near(2 * F))
    assert (words(axes)["x"], words(axes)["y"], axes.get_xscale()) == ("x", "y", "log")
    assert axes.lines[0].get_linestyle() == "--"
    assert cell_edges(np.array([3.0])) == near([2.5, 3.5])
    assert cell_edges(np.array([1.0, 2.0, 4.0])) == near([0.5, 1.5, 3.0, 5.0])


def test_what_a_tunable_trades_with_what_is_unusable_shaded():
    x = np.array([1.0, 2.0, 3.0])
    rows = np.array([[0.1, np.nan, 0.3], [1.0, np.nan, 3.0], [5.0, np.nan, 7.0]])
    figure = tuning_trade(x, rows, parameter="smc.phi", chosen=3.0)
    for axes, y in zip(figure.axes, rows, strict=True):
        assert line(axes.lines[0])[1:] == (near(x), near(y))
        assert line(axes.lines[1])[1] == [3.0, 3.0]
        assert spans(axes) == [(1.5, 2.5)]
    assert words(figure.axes[-1])["x"] == "smc.phi"
    assert legend(figure) == ["chosen: 3", "unusable"]


def test_friction_in_mNm_over_speed():
    runs = [SteadyRun("a", np.full(9, w), np.full(9, y)) for w, y in ((-2.0, -0.5), (4.0, 0.7))]
    one = Estimate(0.1, 0.0, 0.2)
    found = Friction(one, one, None, None, one, 0.0, 1.0, 2, 18, 0)
    (axes,) = friction_picture(runs, found).axes
    assert lines(axes)["recorded, a run each"] == (MEASURED, [-2.0, 4.0], [-500.0, 700.0])
    back, forth = axes.lines[1:]
    assert line(back)[1][-1] == -4.0
    assert line(forth)[2][-1] == pytest.approx(1e3 * (0.1 + 0.1 + 0.1 * 4.0))
    assert words(axes)["y"] == "mN·m at the motor shaft"


def test_cases_that_ended_badly_are_crossed_wherever_they_stand():
    figure = rms_by_case(["a", "b\nlong"], "mpc", np.array([1.0, 2.0]))
    figure.axes[0].set_title("smc: a: 3", loc="left")
    figure.axes[0].set_title("ab", loc="center")
    assert crossed(figure, {}) is figure
    assert figure.get_supxlabel() == ""
    done = crossed(figure, {"a": "tripped", "long": "failed"})
    (axes,) = done.axes
    assert [t.get_text() for t in axes.get_xticklabels()] == ["✗ a", "✗ b\nlong"]
    assert (axes.get_title("left"), axes.get_title("center")) == ("✗ smc: a: 3", "ab")
    assert done.get_supxlabel() == "✗ a: tripped\n✗ long: failed"
    many = crossed(figure, {str(k): "off" for k in range(9)}).get_supxlabel()
    assert many.endswith("\nand 3 more cases")
