"""Weights of a family's member, against normal equations written out; terms in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from esea_gen.identify.family.fit import (
    UnitTerms,
    alike,
    fit_member,
    misfits_of,
    trained_scale,
)
from esea_gen.identify.recording.cycles import DataSet
from esea_gen.identify.recording.recorded import Recording
from esea_gen.model.family import Member, Rise, Softening, Term
from esea_gen.model.temperature import TemperatureFactor
from tests.conftest import require_tool

LINEAR, CUBIC = Term("spring"), Term("spring", Rise("power", 3))
OFFSET = Term("offset")
SOFT = Term("spring", softening=Softening("strain", 0.3))


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


def test_a_term_below_a_thousandth_of_full_scale_is_left_out_and_the_rest_solved_again():
    x = np.linspace(-1, 1, 201)
    known = Known(member(LINEAR, CUBIC, OFFSET), [recorded(0.1 * x, 2 * x + 0.5 * x**3)])
    rms = 0.5 * np.sqrt(np.mean(x**6))
    kept = fit_member(known, known.recordings, rms / 1e-3 * (1 - 1e-3)).weights_Nm
    assert kept == pytest.approx([2, 0.5, 0], abs=1e-6)
    line = float(x @ (2 * x + 0.5 * x**3) / (x @ x))
    left = fit_member(known, known.recordings, rms / 1e-3 * (1 + 1e-3)).weights_Nm
    # The linear spring's floor is a hundredth of full scale, which is nearly as much here.
    assert left == pytest.approx([line, 0, 0], abs=1e-9)
    assert rms / 1e-3 * 0.01 < line
    # Of another share; of none all stay.
    for share, stays in ((2e-3, False), (0.5e-3, True), (0.0, True)):
        found = fit_member(known, known.recordings, rms / 1e-3, share).weights_Nm
        assert (found[1] > 0) == stays
    # A stiffness of the wrong sign: the plain linear spring keeps a hundredth, no other term does.
    wrong = Known(member(CUBIC, LINEAR), [recorded(0.1 * x, -x - x**3)])
    assert fit_member(wrong, wrong.recordings, 3.0).weights_Nm == (0.0, pytest.approx(0.03))
    soft = Known(member(SOFT, CUBIC), [recorded(0.1 * x, -x - x**3)])
    assert fit_member(soft, soft.recordings, 3.0).weights_Nm == (0.0, 0.0)


def test_what_is_alike_is_carried_by_the_simplest():
    n = 4096
    wave = 2 * np.pi * np.arange(n) / n
    unit, other = np.sin(wave), np.cos(wave)  # orthogonal, of equal size
    stop, soft_stop = Term("stop", numbers=(0.1,)), replace(SOFT, kind="stop", numbers=(0.1,))
    terms = (stop, soft_stop, SOFT, LINEAR, CUBIC, OFFSET, Term("slip", numbers=(1.0,)))
    columns = [3 * unit, unit, 5 * unit, 0.1 * unit, -unit, 0 * unit, unit + 2 * other]
    # The plain spring stands for all of its direction; of the other sign is another torque.
    assert alike(member(*terms), np.stack(columns, axis=1)) == {0: 3, 1: 3, 2: 3}
    # Without a plain spring the stop does, and of softened ones the spring.
    assert alike(member(*terms[:3]), np.stack(columns[:3], axis=1)) == {1: 0, 2: 0}
    assert alike(member(*terms[1:3]), np.stack(columns[1:3], axis=1)) == {0: 1}
    # Apart by a thousandth of their size; in either of two terms.
    for apart, same in ((0.98e-3, {1: 0}), (1.02e-3, {})):
        basis = np.stack([unit, 7 * (unit + apart * other)], axis=1)
        assert alike(member(LINEAR, CUBIC), basis) == same


FACTOR = TemperatureFactor(20.0, -0.01, 0.0, 40.0)


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
    require_tool("gcc")
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
