"""Shapes impossible for rubber: a torque that leaves and returns, a constant channel."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from esea_gen.identify import load_mapping, load_recordings
from esea_gen.identify.family.identification import identify_member
from esea_gen.identify.recording.cycles import Cycle
from esea_gen.identify.recording.quality import backlash_rad, offset_Nm, runs, spikes, stuck
from tests.identify.test_quality import DATA, found, held_out
from tests.rigs import rig, written

ENDS = 310, 555, 900, 1100, 1333


@pytest.mark.parametrize("width", [5, 10])
def test_five_wide_spikes_change_nothing(tmp_path, width):
    """Full scale from 2.9 to 15 Nm, and a held-out error that seemed better for it."""
    t, x, y = rig()
    clean = identify_member(written(tmp_path, t, x, y), "stops")
    for at, size in zip(ENDS, (15, -9, 12, 12, -15), strict=True):
        y[at : at + width] += size
    result = identify_member(written(tmp_path, t, x, y), "stops")
    assert result.full_scale_Nm == pytest.approx(clean.full_scale_Nm, rel=1e-3)
    assert held_out(result) == pytest.approx(held_out(clean), abs=0.1)
    assert f"5 spikes ({5 * width} samples) in the torque, up to 1" in "\n".join(result.notes)
    assert {q.status for k, q in result.device.quantities() if "weight" in k} == {"identified"}


def held(back: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A ramp of 100 samples up and some back, held for 300; the torque relaxes by 0.4 of itself."""
    down = np.linspace(1, 0, 101)
    at = 100 + round(100 * back)
    x = np.concatenate([np.linspace(0, 1, 101)[:100], down])
    x = np.insert(x, at, np.full(300, x[at]))
    y = 10 * x
    y[at : at + 300] *= 0.6 + 0.4 * np.exp(-np.arange(300) / 20)
    y[at + 300 :] *= 0.6
    return x, y


def test_where_the_deflection_is_held_a_wide_spike_is_found_and_relaxation_is_none():
    x, y = held()
    assert not np.any(spikes(x, y))
    # Half a cycle is 250 samples or so; a tenth of a cycle, and the share of the range: 8 % of 10.
    for a, b, size in ((250, 290, 1.5), (300, 312, -1.0), (200, 204, 9.0)):
        spoilt = y.copy()
        spoilt[a:b] += size
        assert runs(spikes(x, spoilt)) == [(a, b)]
    for a, b, size in ((250, 290, 0.6), (250, 400, 1.5), (200, 300, 1.5)):
        spoilt = y.copy()
        spoilt[a:b] += size
        assert not np.any(spikes(x, spoilt)), (a, b, size)


def test_a_torque_that_comes_back_with_the_deflection_is_no_spike():
    x, _ = held()
    for width in (10, 20, 40):
        moved = x.copy()
        moved[250 : 250 + width] -= 0.3 * np.sin(np.pi * np.arange(width) / width)
        assert not np.any(spikes(moved, 10 * moved))
        assert runs(spikes(x, 10 * moved)) != []


def test_spikes_in_real_rubber_are_found_whole(tmp_path):
    """Five of 18.5 Nm, six samples wide, beside 4.5 Nm; the bearing alone has none."""
    (real,) = load_recordings(load_mapping(DATA / "hdrb.toml"))
    x, y = real.theta_rad, real.tau_Nm
    assert not np.any(spikes(x, y))
    spoilt = y.copy()
    for at in (500, 1717, 2500, 4001, 6002):
        spoilt[at : at + 6] += 18.5
    mask = spikes(x, spoilt)
    assert [a for a, _ in runs(mask)] == [500, 1717, 2500, 4001, 6002]
    assert np.count_nonzero(mask) <= 30 + 10  # a sample beside each end may go with it
    assert np.abs(spoilt[~mask]).max() == np.abs(y).max()


def test_a_large_spike_hides_no_small_one():
    _, x, y = rig()
    assert not np.any(spikes(x, y))
    y[900:912] += 500.0
    y[1050:1056] += 2.5
    y[1400] += 1.5
    assert runs(spikes(x, y)) == [(900, 912), (1050, 1056), (1400, 1401)]


@pytest.mark.parametrize("dither", [0.0, 1e-5, 2e-4])
def test_a_force_that_stands_still_but_for_its_last_digit_is_frozen(tmp_path, dither):
    t, x, y = rig()
    y[700:760] = y[700] + dither * np.sin(np.arange(60) ** 2)
    told = found(written(tmp_path, t, x, y))
    assert list(told) == ["frozen"]
    assert "for 60 samples from sample 700" in told["frozen"]


def test_an_encoder_that_is_stuck_is_named_and_its_cycles_left_out(tmp_path):
    t, x, y = rig()
    x[700:760] = x[700]
    told = found(written(tmp_path, t, x, y))
    assert list(told) == ["deflection frozen"]
    assert "frozen for 60 samples from sample 700" in told["deflection frozen"]


def test_a_deflection_that_is_held_is_not_stuck():
    """Relaxation after a load, after an overshoot, and recovery after a partial unload."""
    for back in (0.0, 0.02, 0.2):
        assert list(stuck(*held(back))) == []
    x, y = held(0.5)
    grows = 1 - np.exp(-np.arange(300) / 20)
    y[150:450] = 1 + 3 * grows
    assert list(stuck(x, y)) == []
    # To the other side, where no torque is at this deflection, and by more than it came: 8 samples.
    y[150:450] = 1 - 6 * grows
    assert [b - a for a, b in stuck(x, y)] == [301]
    # A coarse encoder stands still, too; the torque goes on by a step of it.
    x = np.sin(2 * np.pi * np.arange(8001) / 2000)
    assert list(stuck(np.round(x / 0.2) * 0.2, 10 * x)) == []


def test_what_is_spoilt_makes_no_offset():
    """A force frozen for 60 of 1601 samples was told as an offset, too."""
    _, x, y = rig()
    spoilt = np.zeros(len(x), dtype=bool)
    spoilt[700:760] = True
    stands = np.where(spoilt, 40.0, y)
    assert abs(offset_Nm(x, stands)) > 0.5
    assert offset_Nm(x, stands, spoilt) == pytest.approx(offset_Nm(x, y), abs=2e-3)
    assert offset_Nm(x, y, np.arange(len(x)) >= 49) is None


# A joint with play: no torque inside, a spring outside.  60 samples a quarter of a cycle.
QUARTER, REACH, STIFF = 60, 0.2, 20.0


def loose(play_rad: float, start: int = 0) -> tuple[np.ndarray, np.ndarray, list[Cycle]]:
    turn = np.arange(start, start + 8 * QUARTER + 1) * 0.5 * np.pi / QUARTER
    theta = REACH * 2 / np.pi * np.arcsin(np.sin(turn))  # a triangle
    tau = STIFF * np.sign(theta) * np.maximum(np.abs(theta) - play_rad / 2, 0)
    marks = [4 * QUARTER * k for k in range(3)]
    return theta, tau, [Cycle(a, b, REACH, 0, "training") for a, b in pairwise(marks)]


@pytest.mark.parametrize("start", [0, 7, QUARTER, 2 * QUARTER + 20])
def test_play_is_measured_wherever_a_cycle_starts(start):
    step = REACH / QUARTER
    for play in (0.04, 0.08):
        theta, tau, cycles = loose(play, start)
        found = backlash_rad(theta, tau, float(np.abs(tau).max()), cycles)
        assert found == pytest.approx(play, abs=2 * step)
    theta, tau, cycles = loose(0.0, start)
    assert backlash_rad(theta, tau, float(np.abs(tau).max()), cycles) == 0


@pytest.mark.parametrize("offset", [-0.3, 0.0, 0.7])
def test_an_offset_is_found_beside_a_lossy_and_uneven_spring(offset):
    turn = np.linspace(0, 6 * np.pi, 1801)
    theta = 0.2 * np.sin(turn)
    tau = 8 * theta + 90 * theta**3 + 3 * theta * np.abs(theta) + 0.5 * np.cos(turn) + offset
    # The direction of the deflection is taken over five samples: at the turns it lags a little.
    assert offset_Nm(theta, tau) == pytest.approx(offset, abs=2e-3)
    # Of a side that is hardly reached there is no middle: a fifth of the other is the least.
    assert offset_Nm(theta + 0.13, tau) is not None
    assert offset_Nm(theta + 0.137, tau) is None
    assert offset_Nm(np.abs(theta), tau) is None
