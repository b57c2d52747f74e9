"""Figures of a page: curves, units, and shared panels of recordings."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.report import figures
from esea_gen.report.figures import Curve, loops, over_time
from tests.drawn_figures import line, lines, spans

FULL_SCALE_NM = 4.47


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
    torque, error, rounding = over_time(c, 10_000, FULL_SCALE_NM, (c.time_s, rounding_Nm)).axes
    assert max(lines(torque)["C, float32"][2]) == pytest.approx(3.0, abs=0.001)
    # A torque that is 0.447 Nm too high everywhere, of 4.47 Nm: 10 per cent.
    assert error.get_ylabel().endswith("% full scale")
    np.testing.assert_allclose(line(error.lines[0])[2], 10.0, rtol=1e-12)
    assert rounding.get_ylabel().endswith("µN·m")
    assert max(line(rounding.lines[0])[2]) == pytest.approx(2.5, rel=1e-3)
    t = c.time_s
    assert spans(torque) == spans(error) == pytest.approx(np.array([(t[5], t[7]), (t[20], t[20])]))
    assert spans(rounding) == []
