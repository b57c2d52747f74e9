"""Blocks left out, step by step: which blocks, what is not determined, against fits anew."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from esea_gen.identify.cycles import DataSet
from esea_gen.identify.recorded import Recording
from esea_gen.identify.resampling import (
    FitRows,
    LeftOut,
    autocorrelation,
    covered,
    half_width_Nm,
    resampled,
    rests_on_one,
    rows_of,
    whole_conditions,
)

NONE = np.zeros(0, dtype=np.intp)


def data(label: str, training: list[int], held_out=(), count: int | None = None) -> DataSet:
    at, out = (np.array(v, dtype=np.intp) for v in (training, held_out))
    cycles = {} if count is None else {"training": count}
    return DataSet(label, 0.1, at, out, cycles, None, None, None)


def recording(*sets: DataSet, conditions: tuple[str, ...] = ()) -> Recording:
    x = np.zeros(9)
    return Recording("r", "r.csv", "", x, x, x, True, 0, (), sets, conditions)


# Which blocks.


@pytest.mark.parametrize(
    ("sets", "blocks"), [(1, [6]), (2, [3] * 2), (4, [2] * 4), (5, [2] * 5), (6, [1] * 6)]
)
def test_six_blocks_at_least(sets, blocks):
    rows = FitRows.of([(k, 1, np.full(12, k % 2 - 0.5)) for k in range(sets)])
    expected = np.concatenate(
        [sum(blocks[:k]) + np.repeat(np.arange(n), 12 // n) for k, n in enumerate(blocks)]
    )
    assert rows.cycle.tolist() == expected.tolist()
    assert rows.condition.tolist() == np.repeat(np.arange(sets), 12).tolist()
    assert rows.way.tolist() == np.repeat(np.arange(sets) % 2 - 0.5, 12).tolist()
    assert not rows.alone
    assert rows.cycles_alone == replace(rows, alone=True)


def test_more_cycles_than_that_are_blocks_of_their_own():
    rows = FitRows.of([(7, 4, np.zeros(10)), (3, 0, np.zeros(0)), (7, 2, np.zeros(4))])
    # Ten rows of four cycles: three, two, three, two; at least two each, also of an empty set.
    assert rows.cycle.tolist() == [0, 0, 0, 1, 1, 2, 2, 2, 3, 3, 6, 6, 7, 7]
    assert rows.condition.tolist() == [7] * 14
    assert rows.cycle.dtype == rows.condition.dtype == np.intp


def test_rows_of_data_sets_by_their_first_condition():
    a, b, c = data("a", [0], (), 4), data("b", [0]), data("c", [0], (), 3)
    slow, own = recording(a, b, conditions=("slow", "odd")), recording(c)
    ways = [np.zeros(8), np.ones(6), np.zeros(6)]
    rows = rows_of([(own, c), (slow, a), (slow, b)], ways)
    assert rows.condition.tolist() == [0] * 8 + [1] * 12
    # Two blocks at least of three sets, also where no cycle was counted.
    expected = [0, 0, 0, 1, 1, 1, 2, 2, *np.repeat([3, 4, 5, 6], [2, 1, 2, 1]), *[7] * 3, *[8] * 3]
    assert rows.cycle.tolist() == expected
    many = [(own, c)] * 5 + [(slow, b)]
    rows = rows_of(many, [np.zeros(6)] * 6)
    assert rows.cycle.tolist() == [*np.repeat(np.arange(15), 2), *[15] * 6]


def test_whether_all_rests_on_one_condition():
    a, b = data("a", [0, 1]), data("b", [2])
    first, second = recording(a, b), recording(data("c", [3]), conditions=("slow", "b"))
    judge = recording(data("d", [], [4]))
    asked = []

    def lost(left: list[Recording]) -> bool:
        asked.append([s.training.tolist() for r in left for s in r.sets])
        return False

    assert not rests_on_one([first, second, judge], lost)
    # Each of a, b and slow is left out once; d does not train.
    assert sorted(asked) == sorted(
        [[[], [2], [3], []], [[0, 1], [], [3], []], [[0, 1], [2], [], []]]
    )
    assert rests_on_one([first, second], lambda left: not len(left[1].sets[0].training))
    assert not rests_on_one([first, second], lambda left: len(left) != 2)
    assert whole_conditions([first, judge])
    assert not whole_conditions([first, recording(data("e", [1], [2]))])


# Deviations.


def jackknife(j: np.ndarray, y: np.ndarray, blocks: np.ndarray, weight=None) -> np.ndarray:
    """Covariance of fits without each block in turn."""
    w = np.ones(len(y)) if weight is None else weight
    fits = []
    for b in np.unique(blocks):
        rest = blocks != b
        fits.append(np.linalg.lstsq((j * w[:, None])[rest], (y * w)[rest], rcond=None)[0])
    apart = np.array(fits) - np.mean(fits, axis=0)
    return (len(fits) - 1) / len(fits) * apart.T @ apart


def case(conditions: int, cycles: int, columns: int, seed: int = 3, each: int = 12):
    """Columns, noise less its fit, and rows of so many conditions and cycles."""
    rng = np.random.default_rng(seed)
    n = conditions * cycles * each
    j, noise = rng.normal(size=(n, columns)), rng.normal(0, 0.1, n)
    noise -= j @ np.linalg.lstsq(j, noise, rcond=None)[0]
    way = np.where(rng.random(n) < 0.5, -1.0, 1.0)
    ways = np.split(way, conditions)
    return j, noise, FitRows.of([(i, cycles, w) for i, w in enumerate(ways)])


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize("conditions", [2, 3, 4])
def test_conditions_speak_from_three_on_and_only_where_they_are_asked(conditions, alone):
    j, noise, rows = case(conditions, 5, 2)
    rows = rows.cycles_alone if alone else rows
    found = resampled(j, noise, np.ones(len(noise)), rows, True)
    fine, coarse = (jackknife(j, noise, b) for b in (rows.cycle, rows.condition))
    expected = fine if alone or conditions < 3 else 0.5 * (fine + coarse)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-9)
    np.testing.assert_allclose(found.sigma, np.sqrt(np.diag(expected)), rtol=1e-9)
    assert (found.conditions, found.friction_Nm) == (conditions, None)
    # What judges the torque's band are conditions, where there are three and whole ones do.
    for whole in (True, False):
        told = resampled(j, noise, np.ones(len(noise)), rows, whole)
        by = rows.condition if whole and conditions > 2 else rows.cycle
        outside = noise.copy()
        for b in np.unique(by):
            fit = np.linalg.lstsq(j[by != b], noise[by != b], rcond=None)[0]
            outside[by == b] -= j[by == b] @ fit
        np.testing.assert_allclose(told.outside_Nm, outside, atol=1e-12)
    json = found.to_dict()
    assert (json["band_Nm"], json["band_share"]) == (found.band_Nm, 0.95)
    assert (json["unmodelled_friction_Nm"], json["conditions"]) == (None, conditions)


def plain(j: np.ndarray, residual: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Covariance of autoregressive noise, the inverse of the normal equations."""
    r, w = residual * weight, j * weight[:, None]
    rho = min(max(float(r[1:] @ r[:-1] / (r @ r)), 0.0), 1 - 2 / len(r))
    noise = float(r @ r) / (len(r) - j.shape[1])
    return np.linalg.inv(w.T @ w) * noise * (1 + rho) / (1 - rho)


@pytest.mark.parametrize(("columns", "more"), [(7, False), (8, True), (9, True)])
def test_as_few_blocks_as_parameters_have_the_plain_covariance_beside(columns, more):
    j, noise, rows = case(2, 4, columns)
    noise = np.convolve(noise, [0.6, 0.8, 0.5], "same")  # neighbours are alike
    noise -= j @ np.linalg.lstsq(j, noise, rcond=None)[0]
    weight = np.full(len(noise), 2.0)
    found = resampled(j, noise, weight, rows, False)
    expected = jackknife(j, noise, rows.cycle) + (plain(j, noise, weight) if more else 0)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-8)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("clear", "seen"), [(3.99, False), (4.01, True)])
def test_friction_counts_from_four_deviations_on(clear, seen, sign):
    j, noise, rows = case(4, 3, 2)
    more = np.column_stack([j, rows.way])
    beside = np.linalg.lstsq(more, noise, rcond=None)[0]
    own = 0.5 * sum(
        jackknife(more, noise - more @ beside, b)[-1, -1] for b in (rows.cycle, rows.condition)
    )
    residual = noise + (sign * clear * math.sqrt(own) - beside[-1]) * rows.way
    residual -= j @ np.linalg.lstsq(j, residual, rcond=None)[0]
    found = resampled(j, residual, np.ones(len(noise)), rows, True)
    expected = 0.5 * sum(jackknife(j, residual, b) for b in (rows.cycle, rows.condition))
    if seen:
        assert found.friction_Nm == pytest.approx(sign * clear * math.sqrt(own), rel=1e-9)
        # What it moves the parameters by, where it is fitted beside them, is added.
        by = np.linalg.lstsq(more, residual, rcond=None)[0][:-1]
        expected = expected + np.outer(by, by)
    else:
        assert found.friction_Nm is None
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-8)


def test_a_way_that_is_the_parameters_own_is_no_friction():
    j, noise, rows = case(4, 3, 2)
    found = resampled(
        np.column_stack([j, rows.way]), noise + 9 * rows.way, np.ones(144), rows, True
    )
    assert found.friction_Nm is None


# What is not determined.


def orthonormal(n: int, columns: int, seed: int = 5) -> np.ndarray:
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(n, columns)))[0]


@pytest.mark.parametrize(("share", "lost"), [(1.405e-3, False), (1.42e-3, True)])
def test_a_parameter_is_lost_that_has_a_thousandth_of_a_lost_direction(share, lost):
    # x and x + share z are told apart by z alone; that direction has share / sqrt(2) of z.
    x, z, w = orthonormal(240, 3).T
    _, _, rows = case(4, 5, 1)
    noise = np.random.default_rng(1).normal(0, 0.1, 240)
    found = resampled(np.column_stack([x, z, x + share * z, w]), noise, np.ones(240), rows, True)
    assert found.unknown.tolist() == [True, lost, True, False]
    assert np.isinf(found.sigma).tolist() == [True, lost, True, False]


@pytest.mark.parametrize(("apart", "lost"), [(1.8e-6, True), (2.2e-6, False)])
def test_what_is_told_apart_by_less_than_a_millionth_is_lost(apart, lost):
    # Of x and x + apart z the singular values are sqrt(2) and apart over sqrt(2).
    x, z, w = orthonormal(240, 3).T
    _, _, rows = case(4, 5, 1)
    noise = np.random.default_rng(1).normal(0, 0.1, 240)
    found = resampled(np.column_stack([x, x + apart * z, w]), noise, np.ones(240), rows, True)
    assert found.unknown.tolist() == [lost, lost, False]


def test_what_one_condition_alone_determines_has_the_deviation_of_its_cycles():
    j, noise, rows = case(4, 5, 2)
    here = rows.condition == 0
    j[~here, 1] = 0.0
    # In no cycle the two share anything.
    for b in np.unique(rows.cycle):
        own = rows.cycle == b
        a = j[own, 0]
        j[own, 1] -= a * float(a @ j[own, 1]) / float(a @ a)
    noise -= j @ np.linalg.lstsq(j, noise, rcond=None)[0]
    found = resampled(j, noise, np.ones(len(noise)), rows, True)
    fine = jackknife(j, noise, rows.cycle)
    coarse = jackknife(j[:, :1], noise, rows.condition)[0, 0]
    assert found.covariance[0, 0] == pytest.approx(0.5 * (fine[0, 0] + coarse), rel=1e-9)
    assert found.covariance[1, 1] == pytest.approx(fine[1, 1], rel=1e-9)


def test_what_one_cycle_alone_determines_has_the_plain_deviation():
    j, noise, rows = case(4, 5, 2)
    j[rows.cycle != 7, 1] = 0.0
    own = rows.cycle == 7
    j[own, 1] -= j[own, 0] * float(j[own, 0] @ j[own, 1]) / float(j[own, 0] @ j[own, 0])
    noise -= j @ np.linalg.lstsq(j, noise, rcond=None)[0]
    found = resampled(j, noise, np.ones(len(noise)), rows, True)
    expected = plain(j, noise, np.ones(len(noise)))
    assert found.covariance[1, 1] == pytest.approx(expected[1, 1], rel=1e-9)
    fine, coarse = (jackknife(j[:, :1], noise, b)[0, 0] for b in (rows.cycle, rows.condition))
    assert found.covariance[0, 0] == pytest.approx(0.5 * (fine + coarse), rel=1e-9)


@pytest.mark.parametrize(("elsewhere", "plainly"), [(0.99e-4, True), (1.005e-4, False)])
def test_a_block_alone_determines_what_has_a_ten_thousandth_elsewhere(elsewhere, plainly):
    j, noise, rows = case(2, 5, 1)
    own = rows.cycle == 7
    z = np.random.default_rng(8).normal(size=len(noise))
    for b in np.unique(rows.cycle):  # nothing shared with the first column
        a = j[rows.cycle == b, 0]
        z[rows.cycle == b] -= a * float(a @ z[rows.cycle == b]) / float(a @ a)
    z[own] *= math.sqrt((1 - elsewhere) / float(z[own] @ z[own]))
    z[~own] *= math.sqrt(elsewhere / float(z[~own] @ z[~own]))
    j = np.column_stack([j, z])
    noise -= j @ np.linalg.lstsq(j, noise, rcond=None)[0]
    found = resampled(j, noise, np.ones(len(noise)), rows, True)
    fine, flat = jackknife(j, noise, rows.cycle), plain(j, noise, np.ones(len(noise)))
    assert fine[1, 1] > 100 * flat[1, 1]
    expected = flat if plainly else fine
    assert found.covariance[1, 1] == pytest.approx(expected[1, 1], rel=1e-3)


def test_inside_bounds_what_the_other_rows_do_not_tell_stays():
    """A column of one condition alone, and bounds that the move without it would pass."""
    j, noise, rows = case(3, 4, 2)
    here = rows.condition == 0
    j[~here, 1] = 0.0
    j[here, 1] += 0.7 * j[here, 0]
    noise += np.where(here, 0.2, -0.1) * j[:, 0]
    noise -= j @ np.linalg.lstsq(j, noise, rcond=None)[0]
    room = np.array([-0.02, -0.005]), np.array([0.02, 0.03])
    found = resampled(j, noise, np.ones(len(noise)), rows, True, room)
    outside, ends = noise.copy(), 0
    for c in range(3):
        out = rows.condition == c
        left, wanted = j[~out], noise[~out]
        if c == 0:
            # In what all rows tell, the direction that only these have is their own column.
            alone = j[:, 1] / np.linalg.norm(j[:, 1])
            left, wanted = np.vstack([left, alone @ j]), np.append(wanted, 0.0)
        done = lsq_linear(left, wanted, room, method="trf", tol=1e-15)
        outside[out] -= j[out] @ done.x
        ends += np.sum(
            np.isclose(done.x, room[0], atol=1e-6) | np.isclose(done.x, room[1], atol=1e-6)
        )
    assert ends >= 2
    np.testing.assert_allclose(found.outside_Nm, outside, atol=1e-6)


# The band.


def test_the_band_holds_nineteen_of_twenty_by_their_weights():
    for squares, width in (((1, 8, 1), 3), ((1, 17, 3), 2), ((1, 96, 3), 1), ((96, 1, 3), 3)):
        assert half_width_Nm(np.array([3.0, -1, 2]), np.sqrt(squares)) == width
    # Of a thousand alike: the least that 95 % are within, to one of them.
    errors = np.random.default_rng(1).permutation(np.arange(1, 1001)) * np.tile([1.0, -1], 500)
    assert half_width_Nm(errors, np.full(1000, 0.3)) == pytest.approx(950, abs=1)
    assert half_width_Nm(np.array([2.0]), np.ones(1)) == 2.0


def test_covered_is_the_share_inside_ends_included():
    assert covered(np.array([1.0, -2.0, 2.5, 0.0]), 2.0) == 0.75
    assert math.isnan(covered(np.zeros(0), 2.0))


def test_neighbours_are_alike_from_nothing_to_just_below_one():
    assert autocorrelation(np.array([1.0, 2, 1, 0, 0, 0, 0, 0])) == pytest.approx(4 / 6)
    assert autocorrelation(np.array([1.0, 1, 1, 1, 2, 2, 2, 2])) == 0.75  # not 17 / 20
    assert autocorrelation(np.array([1.0, -1, 1])) == 0.0


def test_a_deviation_is_infinite_where_a_parameter_is_unknown():
    told = LeftOut(np.diag([4.0, 9.0]), 0.5, 0.25, 3, NONE, NONE, np.array([False, True]))
    assert told.sigma.tolist() == [2.0, math.inf]
    assert told.to_dict()["unmodelled_friction_Nm"] == 0.25
