"""Figures of closed-loop experiments: curves and units, read back from them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.analysis import plots
from esea_gen.analysis.frequency import FrequencyResponse, OutputImpedance
from esea_gen.errors import UserError
from esea_gen.plotting import INK, MEASURED, MODEL
from tests.drawn_figures import bands, legend, line, lines, words

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
    figure = plots.torque_tracking(*CURVES, title="case")
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
        plots.save(figure, tmp_path / f"x.{ending}")
        assert (tmp_path / f"x.{ending}").stat().st_size > 5000
    with pytest.raises(UserError, match="cannot be written"):
        plots.save(figure, tmp_path / "x.png" / "y.png")
    with pytest.raises(UserError, match=r"x.abc: cannot be drawn .*Format 'abc'"):
        plots.save(figure, tmp_path / "x.abc")


def response(gain, phase_deg=0.0, **more) -> FrequencyResponse:
    value = gain * np.exp(1j * np.radians(phase_deg)) * np.ones(len(F))
    told = {"coherence": None, "sigma": None} | more
    return FrequencyResponse(F, value, method="exact", **told)


def test_gain_phase_and_coherence_in_their_units():
    sigma = np.array([0.0, 0.05, 0.1, 0.2, 5.0])
    r = response(2.0 / np.array([1, 1, 1, 4, 8]), -30.0 * F, coherence=F / 5, sigma=sigma)
    figure = plots.bode(
        [("smc", r, r.bandwidth()), ("mpc", *[response(1.0), response(1.0).bandwidth()])]
    )
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
        assert legend(plots.bode([("x", low, low.bandwidth())]))[1].endswith(text)


def test_impedance_per_angle_and_its_phase_per_rate_whose_line_ends_where_it_goes_round():
    found = OutputImpedance.of(response(-2.0, [260, 269, 272, 280, 290]))
    above, below = plots.impedance_panels("smc", found).axes
    assert line(above.lines[0])[2] == near(2 + 0 * F)
    assert line(below.lines[0])[2] == near([170, 179, np.nan, -170, -160])


def test_cases_that_ended_badly_are_crossed_wherever_they_stand():
    figure = plots.rms_by_case(["a", "b\nlong"], "mpc", np.array([1.0, 2.0]))
    figure.axes[0].set_title("smc: a: 3", loc="left")
    figure.axes[0].set_title("ab", loc="center")
    assert plots.crossed(figure, {}) is figure
    assert figure.get_supxlabel() == ""
    done = plots.crossed(figure, {"a": "tripped", "long": "failed"})
    (axes,) = done.axes
    assert [t.get_text() for t in axes.get_xticklabels()] == ["✗ a", "✗ b\nlong"]
    assert (axes.get_title("left"), axes.get_title("center")) == ("✗ smc: a: 3", "ab")
    assert done.get_supxlabel() == "✗ a: tripped\n✗ long: failed"
    many = plots.crossed(figure, {str(k): "off" for k in range(9)}).get_supxlabel()
    assert many.endswith("\nand 3 more cases")
