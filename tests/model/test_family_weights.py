"""Weights of a family's member, against normal equations written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from esea_gen.identify.family.fit import UnitTerms, fit_member, misfits_of, trained_scale
from esea_gen.identify.recording.cycles import DataSet
from esea_gen.identify.recording.recorded import Recording
from esea_gen.model.family import Member, Rise, Term

LINEAR, CUBIC = Term("spring"), Term("spring", Rise("power", 3))
OFFSET = Term("offset")


def recorded(theta, tau, trains=slice(None), judges=slice(0), label="a", **more) -> Recording:
    """A recording of one data set, a sample each 10 ms."""
    theta, rows = np.asarray(theta, float), np.arange(len(theta))
    data = DataSet(label, 0.1, rows[trains], rows[judges], more.pop("cycles", {}), None, None, None)
    t = rows / 100
    return Recording(
        label, f"{label}.csv", "", t, theta, np.asarray(tau, float), True, 0, (), (data,), **more
    )


class Known:
    """Springs of powers and an offset in closed form, where the program runs its C."""

    def __init__(self, member: Member, recordings) -> None:
        self.member, self.recordings = member, tuple(recordings)

    def over(self, scale_rad):
        def column(x, t):
            return np.ones_like(x) if t.kind == "offset" else x**t.rise.number

        return [
            np.stack([column(r.theta_rad / scale_rad, t) for t in self.member.terms], axis=1)
            for r in self.recordings
        ]

    def having(self, recordings):
        return Known(self.member, recordings)


def member(*terms: Term) -> Member:
    return Member("m", "M", terms)


def two_files():
    """Of unequal length and torque, the longer one wider where it does not train."""
    long = 0.1 * np.sin(np.arange(240) / 9)
    long[200:] *= 3
    short = 0.12 * np.sin(np.arange(60) / 7 + 0.3)
    return [
        recorded(long, 40 * long + 0.3 + 0.1 * np.cos(np.arange(240)), slice(200), slice(200, 240)),
        recorded(short, 55 * short - 0.1 + 900 * short**3, label="b"),
        recorded(2 * short, 0 * short, slice(0), slice(None), label="c"),
    ]


def normal_equations(known: Known, scale: float, factors=(1.0, 1.0, 1.0)):
    """Least mean over data sets of the mean square error."""
    left, right = 0.0, 0.0
    for r, c, g in zip(known.recordings, known.over(scale), factors, strict=True):
        (s,) = r.sets
        if len(s.training):
            b = (c * np.where([t.kind != "offset" for t in known.member.terms], g, 1.0))[s.training]
            left = left + b.T @ b / len(b)
            right = right + b.T @ r.tau_Nm[s.training] / len(b)
    return np.linalg.solve(left, right)


def test_weights_solve_the_mean_over_data_sets_of_the_mean_square():
    recordings = two_files()
    known = Known(member(LINEAR, CUBIC, OFFSET), recordings)
    assert trained_scale(recordings) == np.abs(recordings[1].theta_rad).max()
    found = fit_member(known, recordings, 5.0)
    assert found.scale_rad == trained_scale(recordings)
    assert found.temperature is None
    assert found.member is known.member
    expected = normal_equations(known, found.scale_rad)
    assert found.weights_Nm == pytest.approx(expected, rel=1e-6)
    # Upside down the offset follows.
    down = [replace(r, theta_rad=-r.theta_rad, tau_Nm=-r.tau_Nm) for r in recordings]
    turned = fit_member(Known(known.member, down), down, 5.0)
    assert turned.weights_Nm == pytest.approx(expected * [1, 1, -1], rel=1e-6)


def warmed():
    """Three files of a spring and an offset at three temperatures, the factor known."""
    out = []
    for label, at_C in (("a", 10.0), ("b", 20.0), ("c", 40.0)):
        x = 0.1 * np.sin(np.arange(150) / 11 + at_C)
        tau = (1 - 0.01 * (at_C - 20)) * 30 * x + 0.2
        out.append(recorded(x, tau, slice(100), slice(100, 150), label, temperature_C=at_C))
    return out


def test_a_change_by_temperature_is_found_and_leaves_the_offset():
    recordings = warmed()
    known = Known(member(LINEAR, OFFSET), recordings)
    found = fit_member(known, recordings, 3.0)
    assert found.temperature.reference_C == pytest.approx(23.3)  # the mean, to a tenth
    # Linear round 20 degC by 1 %/K is round 23.3 degC linear by 0.01 over what is left there.
    g = 1 - 0.01 * 3.3
    assert found.temperature.per_K == pytest.approx(-0.01 / g, rel=1e-4)
    assert (found.temperature.low_C, found.temperature.high_C) == (10.0, 40.0)
    assert found.weights_Nm == pytest.approx([30 * g * found.scale_rad, 0.2], rel=1e-4)
    for s, trained, held in misfits_of(known, recordings, found).sets:
        assert max(trained.rms, held.rms) < 1e-4
        assert s.label in "abc"


def test_terms_run_over_recordings_on_a_grid_only_where_time_counts():
    t = np.array([0.0, 0.031, 0.094, 0.2, 0.43, 0.5, 0.7777])
    ramp = replace(recorded(0.05 * t, 0 * t), time_s=t)
    timed = UnitTerms(member(LINEAR, Term("maxwell", numbers=(0.3,))), [ramp], 200.0)
    (out,) = timed.over(0.1)
    # A ramp of 0.5/s: the spring follows, the branch keeps what its rate makes in 0.3 s.
    # The grid ends one step behind the last sample, where the recording's last value is held.
    grid = np.arange(157) / 200
    spring = np.interp(t, grid, 0.5 * np.minimum(grid, t[-1]))
    np.testing.assert_allclose(out[:, 0], spring, atol=1e-12)
    np.testing.assert_allclose(out[:, 1], 0.5 * 0.3 * (1 - np.exp(-t / 0.3)), atol=2e-3)
    assert timed.over(0.1)[0] is out
    np.testing.assert_allclose(timed.over(0.05)[0], 2 * out, rtol=1e-9)
    # Other recordings, begun afresh; nothing of the first is kept.
    other = timed.having([replace(ramp, theta_rad=2 * ramp.theta_rad)])
    np.testing.assert_allclose(other.over(0.1)[0], 2 * out, rtol=1e-9)
    assert timed.over(0.1)[0] is out
    # Without time it is each sample's own step, to the end.
    steps = UnitTerms(member(LINEAR, Term("stop", numbers=(0.2,))), [ramp], 200.0).over(0.1)[0]
    np.testing.assert_allclose(steps, np.stack([0.5 * t, np.minimum(0.5 * t, 0.2)], axis=1))
