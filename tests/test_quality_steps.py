"""Each rule by which a recording's samples are doubted, at its limits; filters typed again."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from esea_gen.identify import quality


def around(x: np.ndarray, reach: int, what) -> np.ndarray:
    """Of every sample and so many to either side; the ends are mirrored."""
    return what(sliding_window_view(np.pad(x, reach, mode="symmetric"), 2 * reach + 1), axis=1)


def off(x: np.ndarray, width: int = 3) -> np.ndarray:
    """By how much a sample is beside every window of one more than the width that it is in."""
    size = width + 1
    w = sliding_window_view(np.pad(x, 4 * size, mode="edge"), size)
    above, below = (sliding_window_view(v, size) for v in (w.min(axis=1), w.max(axis=1)))
    inner = slice(3 * size + 1, 3 * size + 1 + len(x))
    return np.maximum(x - above.max(axis=1)[inner], below.min(axis=1)[inner] - x)


def bumps(sizes: np.ndarray, width: int, every: int) -> np.ndarray:
    """A signal of 0 with bumps of these sizes, one every so many samples."""
    out = np.zeros(every * (len(sizes) + 1))
    for k, s in enumerate(sizes, 1):
        out[k * every : k * every + width] = s
    return out


# Filters.


def test_what_is_narrower_than_a_window_stands_off():
    x = np.zeros(30)
    x[5:8], x[15:19], x[23] = 2.0, 7.0, -1.5
    expected = np.zeros(30)
    expected[5:8], expected[23] = 2.0, 1.5
    assert quality._standing_off(x).tolist() == expected.tolist()
    expected[15:19] = 7.0
    assert quality._standing_off(x, 4).tolist() == expected.tolist()
    # Along a ramp of one a sample a bump of five stands off by four, a dip by four, too.
    for size in (5.0, -5.0):
        ramp = np.arange(30.0)
        ramp[12] += size
        assert quality._standing_off(ramp)[12] == 4.0
    # Where a signal begins or ends high, nothing says that it is a bump.
    assert quality._standing_off(np.where(np.arange(30) < 3, 1.0, 0.0)).max() == 0


def test_a_median_of_seven_takes_three_samples_for_a_bump_and_four_for_none():
    x = bumps(np.array([1.0, -1.0]), 3, 12)
    assert not np.any(quality._calm(x))
    x = bumps(np.array([1.0, -1.0]), 4, 12)
    np.testing.assert_array_equal(quality._calm(x), x)
    rng = np.random.default_rng(1)
    x = rng.normal(size=99)
    np.testing.assert_array_equal(quality._calm(x), around(x, 3, np.median))
    # Of 1, 2, 3, 4 and 10 off the median is 3.
    assert quality._noise(np.array([1, -2, 3, -4, 10.0]), np.zeros(5)) == 18.0
    assert quality._noise(np.array([1, -2, 3, -4, 10.0]), np.full(5, -1.0)) == 18.0


def test_the_range_leaves_out_half_a_per_cent_at_either_end():
    assert quality._range(np.arange(1001.0)) == 990.0
    assert quality._range(-(np.arange(1001.0) ** 2)) == 995.0**2 - 25


def test_masked_samples_are_bridged_by_a_straight_line():
    x = np.array([9.0, 1.0, 50.0, 60.0, 7.0, 70.0])
    mask = np.array([1, 0, 1, 1, 0, 1], dtype=bool)
    assert quality.bridged(x, mask).tolist() == [1.0, 1.0, 3.0, 5.0, 7.0, 7.0]


def test_stretches_of_a_mask():
    assert quality.runs(np.array([1, 1, 0, 1, 0, 0, 1], dtype=bool)) == [(0, 2), (3, 4), (6, 7)]
    assert quality.runs(np.zeros(4, dtype=bool)) == []


def test_of_six_half_cycles_none_is_twice_as_stiff_as_the_median():
    turns = [0, 10, 20, 30, 40, 50, 60]
    theta = np.interp(np.arange(71), [*turns, 70], [0, 0.5, 0, 0.5, 0, 0.5, 0, 0])
    slope = np.array([1.0, 2.0, 3.0, 4.0, 9.0, 50.0])
    # A turn's own sample belongs to both half cycles: there the torque is largest.
    tau = np.zeros(71)
    for (a, b), s in zip(pairwise(turns), slope, strict=True):
        tau[a + 1 : b] = -s * 5
        tau[b] = max(tau[b], 0.0)
    tau[turns] = 5 * np.array([1, 1, 3, 3, 9, 9, 90.0])
    spans = [tau[a : b + 1] for a, b in pairwise(turns)]
    by_hand = np.median([(max(s) - min(s)) / 0.5 for s in spans])
    assert quality._stiffest(theta, tau, turns) == pytest.approx(2 * by_hand, rel=1e-12)
    # One in which the deflection does not move says nothing; five say nothing either.
    assert quality._stiffest(theta, tau, [*turns, 70]) == pytest.approx(2 * by_hand, rel=1e-12)
    assert quality._stiffest(theta, tau, turns[:-1]) == np.inf
    assert quality._stiffest(theta, tau, [*turns[:-1], 70, 70]) < np.inf
    # Both channels are taken over the same samples.
    ramp = np.arange(71) / 20
    assert quality._stiffest(ramp, 7 * ramp, turns) == pytest.approx(14.0, rel=1e-12)


# Spikes.


def spikes_typed(theta: np.ndarray, tau: np.ndarray, wide: np.ndarray) -> np.ndarray:
    calm = np.interp(np.arange(len(tau)), np.flatnonzero(~wide), tau[~wide])
    high, low = np.percentile(calm, 99.5), np.percentile(calm, 0.5)
    turns = around(off(theta), 3, np.max) / (theta.max() - theta.min())
    return wide | (off(calm) > (high - low) * (0.08 + 5 * turns))


def test_narrow_spikes_are_those_by_the_rule_typed_again():
    """Bumps of many sizes: eight per cent of the range where the deflection does not turn."""
    sizes = np.linspace(0.5, 1.1, 61) * 0.8
    for width in (1, 3, 4):
        tau = bumps(sizes, width, 30)
        tau[-25:] = 10.0  # the range: 1.3 % of the samples
        theta = np.linspace(0.0, 1.0, len(tau))
        found = quality.spikes(theta, tau)
        assert np.array_equal(found, spikes_typed(theta, tau, np.zeros(len(tau), dtype=bool)))
        starts = 30 * np.arange(1, 62)
        assert found[starts].tolist() == ((sizes > 0.8) & (width < 4)).tolist()
    # Beside a turn of the deflection, so many samples off, what it allows goes by its size.
    for apart in range(5):
        bend = 0.02 * np.linspace(0.0, 1.0, 61)
        theta = 3 * (np.linspace(0.0, 1.0, len(tau)) + bumps(bend, 1, 30))
        moved = bumps(np.full(61, 1.5), 1, 30)
        tau = np.where(np.arange(len(theta)) >= len(theta) - 25, 10.0, np.roll(moved, apart))
        expected = spikes_typed(theta, tau, np.zeros(len(tau), dtype=bool))
        found = quality.spikes(theta, tau)
        assert np.array_equal(found, expected)
        assert (
            20 < np.count_nonzero(found[30 * np.arange(1, 62) + apart]) < (62 if apart > 3 else 50)
        )


def wide_typed(theta: np.ndarray, tau: np.ndarray, turns: list[int]) -> np.ndarray:
    """The rule for wide spikes, with the deflection's turns given."""
    reach, found = theta.max() - theta.min(), np.zeros(len(tau), dtype=bool)
    widths = [4]
    while 1.4 * widths[-1] <= 0.2 * np.median(np.diff(turns)):
        widths.append(int(1.4 * widths[-1]))
    before = None
    while before is None or found.sum() > before:
        before = found.sum()
        for w in widths:
            rest = np.interp(np.arange(len(tau)), np.flatnonzero(~found), tau[~found])
            calm = around(rest, 3, np.median)
            noise = 6 * np.median(np.abs(rest - calm))
            moved = around(theta, w, np.max) - around(theta, w, np.min)
            most = np.percentile(calm, 99.5) - np.percentile(calm, 0.5)
            if len(turns) > 6:
                each = [np.ptp(calm[a : b + 1]) for a, b in pairwise(turns)]
                most = min(most, 2 * np.median(each))  # each of them moves all the way
            allowed = most * (0.08 + 2 * moved / reach) + noise
            size = off(calm, w)
            size[:w] = size[len(size) - w :] = 0
            # From a sample that is over, as far as an eighth of what is allowed is passed.
            for a, b in quality.runs(size > allowed / 8):
                found[a:b] |= np.any(size[a:b] > allowed[a:b])
    return found


@pytest.mark.parametrize("cycles", [2, 3, 6])
@pytest.mark.parametrize(("per", "noise"), [(400, 0.0), (400, 0.5), (686, 0.2), (1000, 0.0)])
def test_wide_spikes_are_those_by_the_rule_typed_again(cycles, per, noise):
    """Bumps of many sizes, three samples wide to wider than any; six half cycles and fewer."""
    rng = np.random.default_rng(per + cycles)
    seen = 0
    for width in (4, 9, 20, 36):
        k = np.arange(cycles * per + 1)
        # Of a half cycle two fifths are held.
        theta = np.interp(k % per, [0, 0.2 * per, 0.5 * per, 0.7 * per, per], [0.0, 0, 1, 1, 0])
        turns = [0, *turned(theta), len(k) - 1]
        tau = 10 * theta + noise * rng.normal(size=len(k))
        for at in range(60, len(k) - 60, 97):
            size = rng.uniform(0.3, 12.0) * rng.choice([-1, 1])
            tau[at : at + width] += size * np.hanning(width + 2)[1:-1]
        expected = wide_typed(0.3 * theta, tau, turns)
        assert np.array_equal(quality._wide_spikes(0.3 * theta, tau), expected)
        seen += np.count_nonzero(expected)
    assert seen > 20


def turned(theta: np.ndarray) -> list[int]:
    """The first sample of each hold, at which the deflection turned."""
    ends = np.flatnonzero((np.diff(theta, prepend=0.5) != 0) & np.isin(theta, (0.0, 1.0)))
    return [int(v) for v in ends if 0 < v < len(theta) - 1]


@pytest.mark.parametrize(("half", "found"), [(153, False), (155, True)])
def test_a_spike_is_no_wider_than_a_tenth_of_a_cycle(half, found):
    # Widths grow by 1.4, to whole samples: 4, 5, 7, 9, 12, 16, 22; 30.8 is a tenth of 308 samples.
    theta = np.interp(np.arange(10 * half + 1) % (2 * half), [0, half, 2 * half], [0.0, 1, 0])
    tau = 10 * theta
    tau[700:728] += 100.0
    assert np.any(quality._wide_spikes(theta, tau)) == found


@pytest.mark.parametrize(("back", "found"), [(0.0502, False), (0.0498, True)])
def test_a_deflection_turns_by_a_twentieth_of_its_range(back, found):
    # Half way it goes back for 20 samples: a turn makes half cycles of 140 of those of 310, of
    # which a spike of 28 samples is no tenth of a cycle.
    up = np.interp(np.arange(310), [0, 145, 165, 310], [0.0, 0.5, 0.5 - back, 1.0])
    theta = np.concatenate([up, 1 - up, up, [1.0]])
    tau = 10 * theta
    tau[700:728] += 100.0
    assert np.any(quality._wide_spikes(theta, tau)) == found


def jumps_typed(theta: np.ndarray) -> np.ndarray:
    calm = around(theta, 3, np.median)
    steps = np.abs(calm[4:] - calm[:-4]) / 4
    steps = around(np.concatenate([steps[:1]] * 2 + [steps] + [steps[-1:]] * 2), 4, np.max)
    found = off(theta) > np.maximum(2.1 * steps, 0.004 * (theta.max() - theta.min()))
    found[:4] = found[-4:] = False
    return found if found.sum() <= 0.01 * len(theta) else np.zeros(len(theta), dtype=bool)


def test_jumps_are_those_by_the_rule_typed_again():
    """Bumps from half to thrice what is allowed, where the deflection stands and where it moves."""
    k = np.arange(1210)
    motions = (
        (np.where(k > 1200, 1.0, 0.0), 0.004),  # of its range
        (0.2 * np.sin(k / 40), 2.1 * 0.005),  # steps of 0.005 at most
        (np.interp(k % 40, [0, 20, 40], [0.0, 0.4, 0.0]), 2.1 * 0.02),
    )
    for x, allowed in motions:
        seen = 0
        for width in (1, 2, 3):
            for sizes in np.linspace(0.5, 3.5, 60).reshape(20, 3):
                moved = 3 * (x + np.pad(bumps(allowed * sizes, width, 300), (0, 10)))
                found = quality.jumps(moved)
                assert np.array_equal(found, jumps_typed(moved))
                seen += np.count_nonzero(found[300:-300:300])
        assert 20 < seen < 170
    # As much as is allowed is none: 0.004 of 250.
    for size, found in ((1.0, []), (1.001, [100])):
        x = np.where(np.arange(300) > 250, 250.0, 0.0)
        x[100] = size
        assert np.flatnonzero(quality.jumps(x)).tolist() == found
    # Of 400 samples four may be, and none at an end, where nothing is beside it.
    for places, expected in (
        ([100, 150, 200, 250], [100, 150, 200, 250]),
        ([100, 150, 200, 250, 300], []),
        ([3, 100, 396], [100]),
        ([4, 100, 395], [4, 100, 395]),
    ):
        x = np.zeros(400)
        x[places] = 1.0
        assert np.flatnonzero(quality.jumps(x)).tolist() == expected


# Gaps.


@pytest.mark.parametrize(
    ("length", "speed", "place", "found"),
    [
        (20, 0.1001, 5, True),  # 20 steps at 0.1 a step: a fiftieth of the range of 100
        (20, 0.0999, 5, False),
        (20, -0.1003, -5, True),
        (20, 0.5, 6, False),  # so far off says nothing of the speed in the gap
        (20, 0.5, -6, False),
        (10, 0.5, 1, False),
        (10.01, 0.5, 1, True),
    ],
)
def test_a_gap_is_ten_steps_long_and_the_deflection_moves_in_it(length, speed, place, found):
    steps, moves = np.ones(400), np.zeros(400)
    steps[100], moves[100 + place] = length, speed
    moves[250:350] = 1.0
    moves[250] -= speed
    time, theta = (np.concatenate([[0.0], np.cumsum(v)]) for v in (steps, moves))
    assert quality.gaps(0.25 * time, theta) == ([100] if found else [])


def test_what_the_deflection_moves_across_a_gap_counts_and_is_no_speed():
    for move, found in ((2.01, [100]), (1.99, [])):
        time = np.arange(401.0) + np.where(np.arange(401) > 100, 19, 0)
        theta = np.interp(np.arange(401), [100, 101, 250, 350], [0, move, move, 100.0])
        assert quality.gaps(time, theta) == found
    # Beside it a longer one: at the first one's mean speed it would have moved by 3.8.
    time[104:] += 39
    assert quality.gaps(time, theta) == []
    # Steps of another length: ten usual ones are meant.
    assert quality.gaps(0.25 * time, theta) == []
    theta[104:] += 2.5
    assert quality.gaps(0.25 * time, theta) == [103]


# What stands still.


def flat_typed(x: np.ndarray, band: float) -> list[tuple[int, int]]:
    """Every start and as far as it goes, unless an earlier one went as far."""
    out = []
    for a in range(len(x)):
        b = a + 1
        while b < len(x) and np.ptp(x[a : b + 1]) <= band:
            b += 1
        if not out or b > out[-1][1]:
            out.append((a, b))
    return out


def still_typed(moving: np.ndarray, standing: np.ndarray) -> list[tuple[int, int]]:
    calm = around(moving, 3, np.median)
    least = 0.04 * (moving.max() - moving.min()) + 6 * np.median(np.abs(moving - calm))
    found: list[tuple[int, int]] = []
    for a, b in flat_typed(standing, 2e-4 * (standing.max() - standing.min())):
        if b - a >= 8 and np.ptp(calm[a:b]) > least:
            if found and a < found[-1][1]:
                found[-1] = found[-1][0], b
            else:
                found.append((a, b))
    return found


@pytest.mark.parametrize("band", [0.0, 1.0, 2.0, 5.0])
def test_the_longest_stretches_within_a_band(band):
    rng = np.random.default_rng(8)
    for n in (1, 2, 40, 150):
        x = np.round(np.cumsum(rng.integers(-2, 3, n)))
        assert list(quality._flat(x, band)) == flat_typed(x, band)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_channel_stands_still_by_the_rule_typed_again(noise):
    """Stretches of five to thirty samples, beside motions of none to a tenth of the range."""
    rng = np.random.default_rng(9)
    seen = 0
    for _ in range(12):
        standing, moving = rng.normal(size=900), np.zeros(900)
        moving[850:] = 1.0
        for at in range(20, 800, 40):
            n = int(rng.integers(5, 31))
            size = rng.choice([0.0, 0.6e-4, 0.99e-4, 1.01e-4]) * np.ptp(standing)
            standing[at : at + n] = standing[at] + size * rng.choice([-1.0, 1.0, 1.0], n)
            if n > 20:  # and on, at another place in the band
                standing[at + n : at + n + 6] = standing[at] + 1.9 * size
            moving[at : at + n] += np.linspace(0, rng.uniform(0.02, 0.07), n)
        moving += noise * rng.normal(size=900)
        expected = still_typed(moving, standing)
        assert list(quality.still(moving, standing)) == expected
        seen += len(expected)
    assert seen > 40


def test_a_channel_may_stand_still_from_the_first_sample_and_to_the_last():
    k = np.arange(1001)
    y = np.where(k < 60, 0.06, np.where(k > 940, 0.94, k / 1000))
    assert list(quality.still(k / 1000, y)) == [(0, 61), (940, 1001)]


def stands(by: float, back: float = 0.0, start: int = 2300) -> tuple[np.ndarray, np.ndarray]:
    """Six cycles of a spring of 10; the deflection stops for 60 samples, the torque goes on.

    by: how far the torque goes on; back: by how much less it was just before.
    """
    x = np.interp(np.arange(6001) % 1000, [0, 250, 750, 1000], [0.0, 1.0, -1.0, 0.0])
    y = 10 * x
    x[start : start + 60] = x[start]
    y[start : start + 60] = y[start] + np.linspace(0.0, by, 60)
    return x, y - back


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("start", [2300, 2100, 4, 2600])
def test_a_stuck_deflection_by_how_far_the_torque_goes_on(sign, start):
    seen = []
    for by in np.concatenate([np.linspace(1.5, 4.0, 26), np.linspace(5, 12, 8)]):
        x, y = stands(by, start=start)
        # Where the deflection is the same to a fiftieth of its range of 2, the torque is 0.4 more
        # at most; eight samples before it was 0.032 less: 0.016 of the range.
        at = x[start]
        elsewhere = np.abs(x - at) <= 0.04
        elsewhere[start + 1 : start + 60] = False
        calm = around(y, 3, np.median)
        most = (0.1 + 2 * abs(at - x[max(start - 8, 0)]) / 2) * (
            np.percentile(y, 99.5) - np.percentile(y, 0.5)
        )
        beyond = calm[start : start + 60].max() - max(0.0, calm[elsewhere].max())
        found = list(quality.stuck(sign * x, sign * y))
        assert found == ([(start, start + 60)] if beyond > most else []), by
        seen.append(len(found))
    assert 0 < sum(seen) < len(seen)


def test_a_place_that_is_nowhere_else_may_be_held():
    """There and back by a jump: nothing is known of the torque elsewhere but where it arrived."""
    x = np.interp(np.arange(2001) % 1000, [0, 500, 1000], [0.0, 0.5, 0.0])
    y = 10 * x
    x[400:460], y[400:460] = 0.9, np.linspace(9.0, 10.0, 60)
    assert list(quality.stuck(x, y)) == []
