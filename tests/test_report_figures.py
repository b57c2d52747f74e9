"""Which curves a page draws, and which panels recordings share."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.report import figures
from esea_gen.report.figures import Curve, data_sets, plots


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
