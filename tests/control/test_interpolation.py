"""Set-points between messages: smooth, late by a stated time; unchanged where a tick brings one."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.control.interpolation import DESIRED, interpolation

H, LONGEST = 1e-3, 125
TAU, THETA, OMEGA = DESIRED


def run(drive, tau_Nm, **more):
    block = interpolation(drive)
    ticks = np.shape(tau_Nm)
    given = {"mode": 1.0, TAU: tau_Nm, THETA: 0.3, OMEGA: 0.0} | more
    y, _ = block.simulator().run({k: np.broadcast_to(v, ticks).copy() for k, v in given.items()})
    return y


def sent(every: int, ticks: int = 3000):
    """A sine as messages give it, and the last change that each tick has seen."""
    t = np.arange(ticks)
    return 1.5 * np.sin(2 * np.pi * 0.64 * H * t), t - t % every


def test_changes_in_each_tick_pass_to_the_bit(drive):
    """So does whatever follows a rest, a step or a change of mode: nothing is added to it."""
    sine, _ = sent(1)
    assert np.array_equal(run(drive, sine)[TAU], sine)
    step = np.where(np.arange(600) < 300, 0.0, 2.0)
    assert np.array_equal(run(drive, step)[TAU], step)
    modes = np.where(np.arange(3000) < 1500, 2.0, 1.0)
    held = sine[sent(20)[1]]
    y = run(drive, held, mode=modes)[TAU]
    assert (y[1500], y[1499]) == (held[1500], pytest.approx(y[1498], abs=0.01))


@pytest.mark.parametrize("every", [2, 5, 20, 50, 100, LONGEST])
def test_messages_become_a_line_that_is_late_by_their_interval(drive, every):
    sine, at = sent(every)
    y = run(drive, sine[at], **{THETA: 0.1 + 0.1 * sine[at], OMEGA: sine[at]})
    late = slice(3 * every, None)
    between = np.interp(np.arange(3000) - every + 1, np.arange(0, 3000, every), sine[::every])
    for name, scale, zero in ((TAU, 1, 0), (THETA, 0.1, 0.1), (OMEGA, 1, 0)):
        assert np.allclose(y[name][late], (zero + scale * between)[late], atol=1e-9), name


def test_late_and_lost_messages_make_no_steps(drive):
    """No tick moves by more than a fifth of what the largest change of a message did."""
    rng, (sine, _) = np.random.default_rng(3), sent(1, 20000)
    for late, lost in ((10, 0.0), (19, 0.0), (0, 0.2), (10, 0.1)):
        at = np.arange(0, 20000, 20)
        arrives = (at + rng.integers(0, late + 1, len(at)))[kept := rng.random(len(at)) >= lost]
        newest = np.searchsorted(arrives, np.arange(20000), side="right") - 1
        held = sine[at[kept][np.maximum(newest, 0)]]
        y = run(drive, held)[TAU]
        assert np.max(np.abs(np.diff(y[200:]))) < 0.2 * np.max(np.abs(np.diff(held[200:])))
        assert y.min() >= held.min()
        assert y.max() <= held.max()


def test_what_was_desired_before_never_comes_back(drive):
    sine, at = sent(20)
    off = (np.arange(3000) > 1000) & (np.arange(3000) < 1010)
    held = np.where(np.arange(3000) < 1010, sine[at], -0.4)
    assert np.all(run(drive, held, mode=np.where(off, 0.0, 1.0))[TAU][1010:] == -0.4)


@pytest.mark.parametrize("name", [*DESIRED, "mode"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1e6])
def test_what_is_no_number_is_no_wish(drive, name, value):
    bad = np.where(np.arange(60) == 40, value, 1.0 if name == "mode" else 0.2)
    y = run(drive, 0.1 * np.ones(60), **{name: bad}) if name != TAU else run(drive, bad)
    assert np.array_equal(y["wish_ok"] == 0, np.arange(60) == 40)
    assert np.all(np.isfinite(y[TAU]))
