"""Numbers between the two channels, step by step: what is asked, where, and what is taken of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from esea_gen.identify import channels
from esea_gen.identify.channels import BACKLASH, DEAD_ZONE, LAG, ChannelNumber, settled
from esea_gen.identify.cycles import Cycle, DataSet
from esea_gen.identify.mapping import load_mapping
from esea_gen.identify.recorded import Recording
from esea_gen.identify.resampling import FitRows, resampled

PHASE = "share of a cycle"


def recording(
    time: np.ndarray, theta: np.ndarray, cycles=(), training=(), label: str = "rig"
) -> Recording:
    at = np.array(training, dtype=np.intp)
    data = DataSet(label, 0.1, at, at[:0], {"training": 2}, None, None, None)
    parts = tuple(Cycle(a, b, 0.1, 0, "training") for a, b in cycles)
    numbers = np.asarray(time, float), np.asarray(theta, float), np.zeros(len(time))
    return Recording(label, f"{label}.csv", "0" * 16, *numbers, True, 0, parts, (data,))


# What moves.


def test_a_lag_moves_the_deflection_and_nothing_else():
    t = np.arange(10) * 0.5 + 3
    r = recording(t, t**2, [(2, 6)], [3, 4])
    for lag, expected in ((0.5, [9.0, *(t[:-1] ** 2)]), (-1.0, [*(t[2:] ** 2), 56.25, 56.25])):
        found = channels.moved(r, {LAG: lag})
        assert found.theta_rad.tolist() == expected
        assert replace(found, theta_rad=r.theta_rad) == r
    assert channels.moved(r, {}).theta_rad is r.theta_rad
    assert channels.moved(r, {LAG: 0.0, BACKLASH: 0.0, DEAD_ZONE: 0.0}).theta_rad is r.theta_rad


def test_of_all_three_the_lag_is_first_and_the_dead_zone_last():
    x = np.array([0.0, 1, 3, 2, 1, 0, -4, -4])
    r = recording(np.arange(8.0), x)
    # Behind a gap of 2, half of it either way; beyond a dead zone of 0.5.
    gap, both = [0.0, 0, 2, 2, 2, 1, -3, -3], [0.0, 0, 1.5, 1.5, 1.5, 0.5, -2.5, -2.5]
    assert channels.moved(r, {BACKLASH: 2.0}).theta_rad.tolist() == gap
    assert channels.moved(r, {DEAD_ZONE: 0.5}).theta_rad.tolist() == [
        0.0, 0.5, 2.5, 1.5, 0.5, 0.0, -3.5, -3.5]  # fmt: skip
    assert channels.moved(r, {BACKLASH: 2.0, DEAD_ZONE: 0.5}).theta_rad.tolist() == both
    every = {DEAD_ZONE: 0.5, BACKLASH: 2.0, LAG: 1.0}
    assert channels.moved(r, every).theta_rad.tolist() == [0.0, *both[:-1]]


def test_a_share_of_a_cycle_is_of_the_cycle_that_a_sample_is_in():
    t = np.array([0.0, 1, 2, 4, 6, 7, 8, 9, 12, 13])
    r = recording(t, t, [(1, 4), (4, 7)])
    # From 1 to 6 s and to 9 s; before and after, those that are beside.
    assert channels._durations_s(r).tolist() == [5.0] * 4 + [3.0] * 6
    assert channels._durations_s(recording(t, t)).tolist() == [13.0] * 10
    found = channels.moved(r, {PHASE: 0.1, LAG: 0.25}).theta_rad
    late = np.where(np.arange(10) < 4, 0.75, 0.55)
    assert found == pytest.approx(np.maximum(t - late, 0), abs=1e-12)


# What is known of the cycles.


def test_cycles_train_by_most_of_their_samples():
    t, x = np.arange(40) * 0.5, np.arange(40.0) ** 2
    cycles = [(2, 12), (12, 22), (22, 33)]
    # Of the first all samples, of the second half of them, of the third six of eleven.
    training = [*range(2, 12), *range(12, 17), *range(22, 28)]
    found = channels._trained([recording(t, x, cycles, training)])
    assert found.tolist() == [[5.0, 144 - 4], [5.5, 33**2 - 22**2]]
    # Without a cycle, the whole of it, once.
    found = channels._trained([recording(t, x, (), range(25)), recording(t, -x, (), range(19))])
    assert found.tolist() == [[19.5, 39.0**2]]
    assert channels._trained([recording(t, x, (), range(20))]).shape == (1, 2)
    assert channels._trained([recording(t, x, (), range(19))]).shape == (0, 2)


def test_bounds_go_by_the_shortest_and_the_smallest_cycle():
    t = np.arange(40) * 0.1
    slow = recording(t, 0.2 * np.sin(t), [(0, 39)], range(39))
    quick = recording(t, np.where(np.arange(40) % 10 < 5, 0.05, -0.07), [(5, 25)], range(5, 25))
    found = channels._bounds([slow, quick])
    # An eighth of 2 s; two fifths of half of 0.12 rad.
    assert found[LAG] == pytest.approx((-0.25, 0.25))
    assert found[BACKLASH] == pytest.approx((0.0, 0.024))
    assert found[DEAD_ZONE] == pytest.approx((0.0, 0.024))
    # At most half a second; a dead zone of 6 degrees, a gap of 1 rad.
    wide = recording(t * 10, np.where(t > 2, 4.0, 0.0), [(0, 39)], range(39))
    found = channels._bounds([wide])
    assert found[LAG] == (-0.5, 0.5)
    assert found[BACKLASH] == pytest.approx((0.0, 0.8))
    assert found[DEAD_ZONE] == pytest.approx((0.0, math.radians(6)))
    wider = replace(wide, theta_rad=2 * wide.theta_rad)
    assert channels._bounds([wider])[BACKLASH] == (0.0, 1.0)
    assert channels._bounds([recording(t, t)])[LAG] == (-0.5, 0.5)


def test_within_one_rate_lag_and_loss_are_one():
    # Durations in s and ranges in rad; the speed is twice the range over the duration.
    for rows, said in (
        ([[1.0, 0.2]], "not known: fewer than two cycles train"),
        ([[1.0, 0.2], [1.99, 0.2]], "train last 1 to 1.99 s, below a factor of 2"),
        ([[1.0, 0.2], [2.0, 0.21]], "train move at 0.21 to 0.4 rad/s, below a factor of 2"),
        ([[4.0, 0.2], [2.0, 0.2], [3.0, 0.1]], None),
        ([[1.0, 0.2], [2.0, 0.2]], None),
    ):
        found = channels._one_rate(np.array(rows))
        assert (found is None) == (said is None)
        assert said is None or said in found


def test_inside_are_samples_of_which_every_candidate_is_recorded():
    t = np.arange(40) * 0.25 + 7
    r = recording(t, t, (), [0, 1, 2, 3, 20, 36, 37, 38, 39])
    (found,) = channels._inside([r], 0.5)
    assert found.sets[0].training.tolist() == [2, 3, 20, 36, 37]
    assert found.sets[0].held_out.tolist() == []
    assert r.sets[0].training[0] == 0


def test_a_lag_is_asked_where_time_two_rates_and_fifty_samples_are_there():
    t = np.arange(300) * 0.01
    slow = recording(2 * t, 0.1 * np.sin(t), [(0, 30)], range(0, 40), "a")
    quick = recording(t, 0.1 * np.sin(t), [(0, 30)], range(0, 30), "b")
    # Inside 0.2 s of the ends 30 samples of the one and 10 of the other are left.
    assert channels._not_asked([slow, quick], 0.2) == "not known: 40 samples are left to train on"
    # From 0.13 s on 33 and 17, from 0.14 s on 33 and 16.
    assert channels._not_asked([slow, quick], 0.1299) is None
    assert "not known: 49 samples" in channels._not_asked([slow, quick], 0.1399)
    nobody = [slow, replace(quick, timed=False)]
    assert channels._not_asked(nobody, 0.1) == "not known: no time was recorded"
    assert "fewer than two cycles" in channels._not_asked([slow], 0.1)


# What is taken.


@pytest.mark.parametrize(
    ("key", "found", "sigma", "bounds", "why"),
    [
        (LAG, 0.012, 0.005, (-0.1, 0.1), None),
        (LAG, -0.012, 0.005, (-0.1, 0.1), None),
        (LAG, 0.010, 0.005, (-0.1, 0.1), "not seen beyond two deviations"),
        (LAG, 0.01, 0.00499, (-0.1, 0.1), None),
        (LAG, 0.012, math.inf, (-0.1, 0.1), "not seen beyond two deviations"),
        (LAG, 0.0981, 0.001, (-0.1, 0.1), "not known: it ends at the bound of the search, 100 ms"),
        (LAG, 0.0979, 0.001, (-0.1, 0.1), None),
        (
            LAG,
            -0.0981,
            0.001,
            (-0.1, 0.1),
            "not known: it ends at the bound of the search, -100 ms",
        ),
        (LAG, -0.0979, 0.001, (-0.1, 0.1), None),
        (
            BACKLASH,
            0.0991,
            0.001,
            (0.0, 0.1),
            "not known: it ends at the bound of the search, 100 m",
        ),
        (BACKLASH, 0.09895, 0.001, (0.0, 0.1), None),
        (DEAD_ZONE, 0.0004, 0.0001, (0.0, 0.1), None),
    ],
)
def test_a_number_is_taken_beyond_two_deviations_and_off_the_bounds(key, found, sigma, bounds, why):
    n = channels._judged(key, found, sigma, bounds)
    assert (n.key, n.found, n.sigma) == (key, found, sigma)
    assert n.value == (0.0 if why else found)
    assert (n.why is None) == (why is None)
    assert why is None or n.why.startswith(why)
    assert n.to_dict()["status"] == ("assumed" if why else "identified")
    assert (n.quantity is None) == (why is not None)


def test_what_is_told_of_a_number():
    n = ChannelNumber(LAG, 0.01234, 0.01234, 0.000567, None)
    assert n.quantity.value == 0.01234
    assert n.quantity.status == "identified"
    assert n.quantity.source == "fitted with the model; standard deviation 0.00057"
    head = "torque.lag_s = 'fit': the lag of the torque behind the deflection is "
    assert n.note.startswith(
        f"{head}12.3 ms, standard deviation 0.57 ms, and is taken out. A visco"
    )
    assert 'For other commands write lag_s = { value = 0.01234, status = "identified"' in n.note
    gap = ChannelNumber(BACKLASH, 0.0035, 0.0035, 0.0002, None)
    assert "the backlash is 3.5 mrad, standard deviation 0.2 mrad, and is taken out of" in gap.note
    zone = ChannelNumber(DEAD_ZONE, 0.02, 0.02, 0.001, None)
    assert "the dead zone is 20 mrad, standard deviation 1 mrad, and is the device's" in zone.note
    assert "dead_zone_rad. For other commands write dead_zone_rad" in zone.note
    no = ChannelNumber(LAG, 0.0, 0.001, 0.002, "not seen")
    assert no.note == f"{head}not seen (found: 1 ms, standard deviation 2 ms); 0 is taken."
    assert ChannelNumber(LAG, 0.0, None, None, "not known").note == f"{head}not known; 0 is taken."
    assert ChannelNumber(LAG, 0.0, 0.1, None, "no").note == f"{head}no; 0 is taken."


# The search.


def test_the_least_cost_is_looked_for_on_a_grid_and_then_between_neighbours():
    asked = []

    def cost(v: float) -> float:
        asked.append(v)
        return (v - 0.37) ** 2 * (1 + 0.3 * math.sin(40 * v))

    found = channels._least(cost, -2.0, 2.0, 9)
    assert asked[:9] == pytest.approx(np.linspace(-2, 2, 9))
    assert found == pytest.approx(0.37, abs=4e-3)  # a thousandth of the range
    assert all(0.0 <= v <= 1.0 for v in asked[9:])
    assert 5 < len(asked) - 9 < 25
    # Not much finer than that: what is asked last is a thousandth apart.
    assert abs(asked[-1] - asked[-2]) > 1e-4
    # Over a narrow range as fine as that, too.
    narrow = channels._least(lambda v: (v - 37e-5) ** 2 + abs(v - 37e-5), -2e-3, 2e-3, 9)
    assert narrow == pytest.approx(37e-5, abs=4e-6)
    # At an end, and where nothing between is better than a point of the grid.
    assert channels._least(lambda v: v, -2.0, 2.0, 5) == -2.0
    assert channels._least(lambda v: -v, -2.0, 2.0, 5) == 2.0
    assert channels._least(lambda v: 0.0 if v == 1.0 else 1.0 + v**2, -2.0, 2.0, 5) == 1.0
    near_end = channels._least(lambda v: (v - 1.9) ** 2, -2.0, 2.0, 5)
    assert near_end == pytest.approx(1.9, abs=4e-3)


class Known:
    """A model of which the cost is known; its recordings are the numbers themselves."""

    def __init__(self, best: dict[str, float], curve: dict[str, float]) -> None:
        self.best, self.curve = best, curve
        self.started: list[dict[str, float]] = []
        self.asked: list[dict[str, float]] = []
        self.marks: list[int] = []
        rng = np.random.default_rng(3)
        self.jacobian = rng.normal(size=(240, 2))
        self.columns = {k: rng.normal(size=240) for k in (*best, PHASE)}
        self.weight = rng.uniform(0.5, 2.0, 240)
        self.residual = rng.normal(0, 1e-3, 240)
        self.rows = FitRows.of([(i, 4, np.zeros(60)) for i in range(4)])

    def start(self, recordings: list) -> None:
        self.started.append(recordings[0])
        self.marks.append(len(self.asked))

    def solve(self, recordings: list) -> float:
        self.asked.append(recordings[0])
        return sum(c * (recordings[0][k] - self.best[k]) ** 2 for k, c in self.curve.items())

    def torque_Nm(self, recordings: list) -> np.ndarray:
        # Curved, so that one-sided differences are others.
        n = recordings[0]
        return sum(c * (n.get(k, 0.0) + 3 * n.get(k, 0.0) ** 2) for k, c in self.columns.items())

    def linearised(self):
        return self.jacobian, self.residual, self.weight, self.rows


BOUNDS = {LAG: (-0.1, 0.1), BACKLASH: (0.0, 0.04), DEAD_ZONE: (0.0, 0.02)}


@pytest.fixture
def plain(monkeypatch):
    monkeypatch.setattr(channels, "moved", lambda _, numbers: dict(numbers))
    monkeypatch.setattr(channels, "_bounds", lambda _: BOUNDS)
    monkeypatch.setattr(channels, "_not_asked", lambda *_: None)
    monkeypatch.setattr(channels, "_inside", lambda recordings, most: [(*recordings, most)])
    monkeypatch.setattr(channels, "rests_on_one", lambda *_: False)
    monkeypatch.setattr(channels, "whole_conditions", lambda _: True)


def sharpened_typed(model: Known, numbers: dict[str, float], one: bool = False):
    """Deviations by blocks left out, and the numbers freed of what loss is lacking."""
    keys = [*numbers, *([PHASE] if LAG in numbers else [])]
    columns = []
    for k in keys:
        low, high = BOUNDS.get(k, (-0.25, 0.25))
        v, step = numbers.get(k, 0.0), (high - low) / 200
        a, b = max(low, v - step), min(high, v + step)
        columns.append(model.columns[k] * ((b + 3 * b * b) - (a + 3 * a * a)) / (b - a))
    whole = np.column_stack([model.jacobian, *columns])
    rows = model.rows.cycles_alone if one else model.rows
    found = resampled(whole, model.residual, model.weight, rows, True)
    sigma = dict(zip(keys, found.sigma[2:], strict=True))
    fixed = dict(numbers)
    if LAG in numbers:
        w = model.weight[:, None]
        square = (whole * w).T @ (whole * w)
        change = np.linalg.solve(square, (whole * w).T @ (model.residual * model.weight))[2:]
        for (k, v), c in zip(numbers.items(), change, strict=False):
            fixed[k] = min(max(v + c, BOUNDS[k][0]), BOUNDS[k][1])
    return {k: sigma[k] for k in numbers}, fixed


@pytest.mark.parametrize("one", [False, True])
@pytest.mark.parametrize(
    "numbers",
    [
        {LAG: 0.031},
        {LAG: 0.0998, BACKLASH: 0.0},
        {BACKLASH: 0.04},
        {LAG: -0.1, DEAD_ZONE: 0.0103, BACKLASH: 0.01},
    ],
)
def test_deviations_and_what_the_loss_takes_back(plain, monkeypatch, numbers, one):
    monkeypatch.setattr(channels, "rests_on_one", lambda *_: one)
    model = Known(numbers, dict.fromkeys(numbers, 1.0))
    changed = dict(numbers)
    sigma = channels._sharpened(model, ["rig"], changed, BOUNDS)
    expected, fixed = sharpened_typed(model, numbers, one and LAG in numbers)
    assert sigma == pytest.approx(expected, rel=1e-9)
    assert changed == pytest.approx(fixed, rel=1e-9)
    assert (changed == numbers) == (LAG not in numbers)
    # Solved at the numbers themselves before anything is asked of it.
    assert model.asked == [numbers]


def test_a_number_without_effect_is_left_where_it_is(plain):
    model = Known({LAG: 0.02, BACKLASH: 0.01}, {})
    model.columns[BACKLASH] = np.zeros(240)
    changed = {LAG: 0.02, BACKLASH: 0.01}
    sigma = channels._sharpened(model, ["rig"], changed, BOUNDS)
    assert changed[BACKLASH] == 0.01
    assert changed[LAG] != 0.02
    assert sigma[LAG] > 0


def test_each_number_is_looked_for_alone_and_again_nearby(plain):
    best = {LAG: 0.0137, BACKLASH: 0.0262, DEAD_ZONE: 0.0031}
    model = Known(best, dict.fromkeys(best, 1.0))
    found = channels._found(["rig"], [DEAD_ZONE, LAG, BACKLASH], lambda: model)
    assert [n.key for n in found] == [DEAD_ZONE, LAG, BACKLASH]
    # Started once everywhere and, of three numbers, three times more from where it was.
    assert len(model.started) == 4
    assert model.started[0] == {DEAD_ZONE: 0.0, LAG: 0.0, BACKLASH: 0.0}
    for k, v in best.items():
        width = BOUNDS[k][1] - BOUNDS[k][0]
        assert model.started[1][k] == pytest.approx(v, abs=1e-3 * width)
        tried = [a[k] for a in model.asked]
        assert min(tried) == BOUNDS[k][0]
        assert max(tried) == BOUNDS[k][1]
    # The first look of the first number: nine points over its range, the others at 0.
    first = model.asked[:9]
    assert [a[DEAD_ZONE] for a in first] == pytest.approx(np.linspace(0, 0.02, 9))
    assert {a[LAG] for a in first} == {a[BACKLASH] for a in first} == {0.0}
    # The second: five points, from an eighth of the range below to one above.
    grid = [a[DEAD_ZONE] for a in model.asked[model.marks[1] :]]
    at = model.started[1][DEAD_ZONE]
    assert grid[:5] == pytest.approx(np.linspace(at - 0.0025, at + 0.0025, 5))
    # Of the lag, whose range goes to both sides, from an eighth of the whole range, too.
    at = model.started[1][LAG]
    grid = [a[LAG] for a in model.asked[model.marks[1] :] if a[LAG] != at]
    assert grid[:2] == pytest.approx([at - 0.025, at - 0.0125])
    # What was found is what the last step makes of it.
    sharp, fixed = sharpened_typed(model, model.asked[-1])
    assert [n.found for n in found] == pytest.approx([fixed[n.key] for n in found], rel=1e-9)
    assert [n.sigma for n in found] == pytest.approx([sharp[n.key] for n in found], rel=1e-9)


def test_near_a_bound_it_is_looked_for_inside(plain):
    model = Known({DEAD_ZONE: 0.0001, BACKLASH: 0.0399}, {DEAD_ZONE: 1.0, BACKLASH: 1.0})
    channels._found(["rig"], [DEAD_ZONE, BACKLASH], lambda: model)
    assert len(model.started) == 3
    assert min(a[DEAD_ZONE] for a in model.asked) == 0.0
    assert max(a[BACKLASH] for a in model.asked) == 0.04


def test_a_lag_that_cannot_be_told_is_not_looked_for(plain, monkeypatch):
    most = []
    monkeypatch.setattr(channels, "_not_asked", lambda _, lag: most.append(lag) or "no time")
    model = Known({BACKLASH: 0.02}, {BACKLASH: 1.0})
    lag, gap = channels._found(["rig"], [LAG, BACKLASH], lambda: model)
    assert lag == ChannelNumber(LAG, 0.0, None, None, "no time")
    assert most == [0.1]
    assert gap.found == pytest.approx(0.02, abs=1e-3 * 0.04)
    assert set(model.asked[0]) == {BACKLASH}
    assert len(model.started) == 2
    only = channels._found(["rig"], [LAG], lambda: pytest.fail("no model is asked for"))
    assert only == [lag]


# A whole one.

MAPPING = """\
schema = 1
[device]
name = "rig"
title = "Rig"
rate_terms = false
[deflection]
column = "x"
unit = "rad"
[torque]
column = "y"
unit = "Nm"
lag_s = "fit"
[sampling]
time_column = "t"
[cycles]
hold_out_last = 1
[[recording]]
files = ["*.csv"]
"""


class Spring:
    """A spring, in closed form, at every training sample."""

    def __init__(self, recordings: list[Recording]) -> None:
        self.at = [np.concatenate([s.training for s in r.sets]) for r in recordings]
        self.solve(recordings)

    def _rows(self, recordings: list[Recording], name: str) -> np.ndarray:
        return np.concatenate(
            [getattr(r, name)[a] for r, a in zip(recordings, self.at, strict=True)]
        )

    def start(self, recordings: list[Recording]) -> None:
        self.at = [np.concatenate([s.training for s in r.sets]) for r in recordings]

    def solve(self, recordings: list[Recording]) -> float:
        x, y = (self._rows(recordings, n) for n in ("theta_rad", "tau_Nm"))
        self.k = float(x @ y / (x @ x))
        self.x, self.left = x, y - self.k * x
        return float(np.mean(self.left**2))

    def torque_Nm(self, recordings: list[Recording]) -> np.ndarray:
        return self.k * self._rows(recordings, "theta_rad")

    def linearised(self):
        sets = [(i, 4, np.zeros(len(a))) for i, a in enumerate(self.at)]
        return self.x[:, None], self.left, np.ones(len(self.x)), FitRows.of(sets)


def made(folder: Path, lag_s: float, key: str = "") -> Path:
    rng = np.random.default_rng(2)
    for name, hz in (("quick", 1.0), ("slow", 0.25)):
        t = np.arange(601) / (100 * hz)
        x, y = (np.sin(2 * np.pi * hz * (t - late)) for late in (0.0, lag_s))
        rows = zip(t, 0.1 * x, 2 * y + rng.normal(0, 1e-3, len(t)), strict=True)
        text = "\n".join(["t,x,y", *(",".join(f"{v:.12g}" for v in r) for r in rows)])
        (folder / f"{name}.csv").write_text(text)
    (folder / "map.toml").write_text(MAPPING.replace('lag_s = "fit"', key or 'lag_s = "fit"'))
    return folder / "map.toml"


@pytest.mark.parametrize("lag_s", [0.012, -0.02])
def test_a_springs_lag_is_found_and_taken_out_of_every_recording(tmp_path, lag_s):
    source = load_mapping(made(tmp_path, lag_s))
    given = []

    def model_of(bare, recordings):
        given.append(bare.mapping.torque.lag_s)
        return Spring(recordings)

    done, recordings, (n,) = settled(source, model_of)
    assert given == [None]
    assert n.key == LAG
    assert n.found == pytest.approx(lag_s, abs=2e-4)
    assert n.value == n.found
    # Noise of 1 mNm: over 1200 samples of a slope of 2 w that is far below a millisecond.
    assert 0 < n.sigma < 2e-4
    assert done.mapping.torque.lag_s == n.quantity
    for r in recordings:
        assert np.abs(r.tau_Nm - 20 * r.theta_rad).max() < 0.01
    plain = load_mapping(made(tmp_path, 0.0, "# none"))
    same, loaded, none = settled(plain, lambda *_: pytest.fail("nothing is left to the fit"))
    assert (same, none) == (plain, ())
    assert len(loaded) == 2
