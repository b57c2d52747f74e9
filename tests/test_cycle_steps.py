"""Cycles of a recording and their roles, counted by hand; what a data set says of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from esea_gen.identify.cycles import Cycle, DataSet, data_sets, divide, loop_work_J, reversals
from esea_gen.identify.tables import Cycles

C, T, H, X = "conditioning", "training", "held_out", "transition"


def waves(*sizes: float, low: float | None = None) -> np.ndarray:
    """Triangles from 0: up, down and back, 40 samples each; low: the other side's share."""
    ends = [0.0]
    for a in sizes:
        ends += [a, -a if low is None else low * a, 0.0] if low != 0 else [a, 0.0]
    steps = np.concatenate([np.linspace(a, b, 20, endpoint=False) for a, b in pairwise(ends)])
    return np.append(steps, 0.0)


def roles(theta: np.ndarray, use: str = "cycles", **changed) -> list[str]:
    return [c.role for c in divide(theta, Cycles(**changed), use)]


def test_of_a_flat_turn_the_first_sample_is_the_reversal():
    assert reversals(np.array([0.0, 1, 1, 0]), 0.5) == [0, 1, 3]
    assert reversals(np.array([0.0, 0, 1, 1, 0, 0, 1]), 0.5) == [0, 2, 4, 6]
    assert reversals(np.array([1.0, 1, 0, 0, 1, 1]), 0.5) == [0, 2, 5]
    # A rest before the first motion is of the lead-in.
    assert reversals(np.array([0.5, 0, 0, 1, 0.0]), 0.6) == [0, 1, 3, 4]
    assert reversals(np.array([0.5, 1, 1, 0, 1.0]), 0.6) == [0, 1, 3, 4]
    assert reversals(np.array([3.0]), 0.5) == [0]


def test_cycles_go_from_a_reversal_to_the_next_of_its_kind():
    theta = waves(1.0, 1.0, 1.0)
    # Up at 20, 80 and 140: three samples' stretches of 20 each.
    found = divide(theta, Cycles(), "cycles")
    assert [(c.start, c.stop) for c in found] == [(20, 80), (80, 140)]
    assert [c.amplitude_rad for c in found] == [1.0, 1.0]
    assert [c.block for c in found] == [0, 0]
    down = divide(-theta, Cycles(), "cycles")
    assert [(c.start, c.stop) for c in down] == [(20, 80), (80, 140)]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("low", "first"), [(-0.09, 0), (-0.0995, 0), (-0.1005, 20), (-0.11, 20)])
def test_loaded_to_one_side_a_cycle_starts_at_rest(sign, low, first):
    theta = sign * waves(1.0, 1.0, 1.0, low=low)
    found = divide(theta, Cycles(hysteresis=0.2), "cycles")
    assert found[0].start == first
    # From rest by way of the lower end, where one side is a tenth of the other or less.
    assert len(found) == (3 if first == 0 else 2)


def test_blocks_are_numbered_from_0_and_told_apart_by_a_tenth():
    theta = waves(1, 1, 1, 1, 1.08, 1.08, 2, 2, 2, 2)
    found = divide(theta, Cycles(), "cycles")
    assert [c.block for c in found] == [0, 0, 0, 0, 0, 1, 2, 2, 2]
    # The way from 1.08 up to 2 has half of both ranges, 1.54: no neighbour equals it.
    assert [c.role for c in found] == [C, T, T, T, H, X, C, T, H]
    assert found[5].amplitude_rad == pytest.approx(1.54)
    # Of the first one's amplitude: a slow drift ends a block, too.
    drift = waves(1.0, 1.0, 1.06, 1.06, 1.11, 1.11, 1.11)
    assert [c.block for c in divide(drift, Cycles(), "cycles")] == [0, 0, 0, 0, 1, 1]
    assert {c.block for c in divide(drift, Cycles(block_tolerance=0.12), "cycles")} == {0}


def test_roles_by_how_many_condition_and_judge():
    theta = waves(*[1.0] * 8)  # seven cycles
    assert roles(theta) == [C, T, T, T, T, T, H]
    assert roles(theta, skip_first=0, hold_out_last=2) == [T, T, T, T, T, H, H]
    assert roles(theta, skip_first=3, hold_out_last=1) == [C, C, C, T, T, T, H]
    assert roles(theta, skip_first=5, hold_out_last=9) == [C] * 5 + [H] * 2
    assert roles(theta, "train") == [T] * 7
    assert roles(theta, "held_out") == [H] * 7


def test_a_cycle_alone_is_a_way_from_one_block_to_the_next_unless_it_is_the_only_one():
    assert roles(waves(1.0, 1.0)) == [C]
    assert roles(waves(1.0, 1.0), skip_first=0) == [H]
    assert roles(waves(1.0, 1.0, 2.0)) == [X, X]
    assert roles(waves(1, 1, 1, 2, 2, 2)) == [C, H, X, C, H]


def test_a_way_down_ends_its_block_and_takes_no_ones_place():
    # From the last 2 down to 1: as wide as a 2, and it ends lower than it began.
    assert roles(waves(2, 2, 2, 2, 1, 1, 1, 1)) == [C, T, H, X, C, T, H]
    assert roles(waves(2, 2, 2, 2, 1, 1, 1, 1), hold_out_last=2) == [C, H, H, X, C, H, H]


def test_asymmetry_is_of_the_cycles_that_train_or_judge():
    theta = waves(*[1.0] * 6)
    cycles = divide(theta, Cycles(), "cycles")
    stiff = np.where(theta > 0, 12.0, 8.0)
    # The first cycle, which conditions, is stiffer to the other side; the last by 14 to 6.
    stiff[:80] = np.where(theta[:80] > 0, 5.0, 15.0)
    stiff[260:] = np.where(theta[260:] > 0, 14.0, 6.0)
    (found,) = data_sets("rig", theta, stiff * theta, cycles, "cycles")
    assert [c.role for c in cycles] == [C, T, T, T, H]
    assert found.asymmetry == pytest.approx((3 * 0.4 + 0.8) / 4)


def test_a_side_counts_from_a_fifth_of_the_other_on():
    theta = waves(*[1.0] * 5)
    for share, known in ((0.2015, True), (0.1985, False)):
        for side in (1, -1):
            bent = np.where(side * theta > 0, 1.0, share) * theta
            (found,) = data_sets("rig", bent, 3 * bent, divide(bent, Cycles(), "cycles"), "cycles")
            assert (found.asymmetry is not None) == known


def test_loss_is_told_from_a_thousandth_of_the_loops_box():
    # Of the torque a parallelogram round the spring: 4 by 2 h, less 0.2 h at the turns, where the
    # torque steps between two samples; the box is 4 by 10.
    theta = 2 * waves(*[1.0] * 6)
    up = np.gradient(theta) > 0
    cycles = divide(theta, Cycles(), "cycles")
    for scale, known in ((1.01, True), (0.985, False)):
        h = scale * 1e-3 * 40 / 7.8
        tau = 2.5 * theta + np.where(up, h, -h)
        (found,) = data_sets("rig", theta, tau, cycles, "cycles")
        work = [loop_work_J(theta, tau, c) for c in cycles]
        box = np.ptp(theta) * np.ptp(tau)
        assert (found.work_first_J is not None) == known == (work[0] > 1e-3 * box)
        assert abs(work[0] / (1e-3 * box) - 1) < 0.05
    # Of a single cycle, or of a whole file, there is no first and last.
    tau = 2.5 * theta + np.where(up, 0.5, -0.5)
    (whole,) = data_sets("rig", theta, tau, cycles, "train")
    (one,) = data_sets("rig", theta, tau, cycles[1:2], "cycles")
    assert whole.work_first_J is whole.work_last_J is one.work_first_J is one.work_last_J is None


def test_the_area_of_a_loop_has_its_last_sample():
    theta, tau = np.array([0.0, 1, 1, 0, 0]), np.array([0.0, 0, 2, 2, 0])
    # A rectangle of 1 by 2, run through the other way round: it gives 2 J.
    assert loop_work_J(theta, tau, Cycle(0, 4, 0.5, 0, T)) == -2.0
    assert loop_work_J(theta, tau, Cycle(1, 3, 0.5, 0, T)) == -2.0
    assert loop_work_J(theta, tau, Cycle(0, 1, 0.5, 0, T)) == 0.0


def test_softening_is_what_the_last_loop_no_longer_has():
    def softening(first, last):
        none = np.zeros(0, dtype=np.intp)
        return DataSet("a", 0.1, none, none, {}, None, first, last).softening

    assert softening(4.0, 3.0) == 0.25
    assert softening(4.0, 5.0) == -0.25
    assert softening(0.0, 1.0) is softening(-1.0, 1.0) is None
    assert softening(None, 1.0) is softening(1.0, None) is None
    assert softening(0.5, 0.25) == 0.5


@pytest.mark.parametrize("unit", [0.03, 40.0])
def test_the_unit_of_the_deflection_is_of_no_matter(unit):
    for theta in (
        waves(2, 2, 2, 2, 1, 1, 1, 1),
        waves(1, 1, 1, 1, 1.08, 1.08, 1.3, 1.3, 1.3),
        waves(1, 1, 1, low=-0.09),
        waves(1, 1, 1, low=-0.11),
        -waves(1, 1, 1, low=-0.09),
    ):
        found = divide(unit * theta, Cycles(), "cycles")
        plain = divide(theta, Cycles(), "cycles")
        assert [(c.start, c.stop, c.block, c.role) for c in found] == [
            (c.start, c.stop, c.block, c.role) for c in plain
        ]
    theta = unit * waves(*[1.0] * 6)
    tau = np.where(theta > 0, 12.0, 8.0) * theta
    (s,) = data_sets("rig", theta, tau, divide(theta, Cycles(), "cycles"), "cycles")
    assert s.asymmetry == pytest.approx(0.4)


def test_samples_of_each_role_without_those_that_are_spoilt():
    theta = waves(*[1.0] * 5, *[2.0] * 5)
    cycles = divide(theta, Cycles(), "cycles")
    assert [c.role for c in cycles] == [C, T, T, H, X, C, T, T, H]
    spoilt = np.zeros(len(theta), dtype=bool)
    spoilt[[90, 205, 500]] = True
    small, large = data_sets("rig", theta, theta, cycles, "cycles", spoilt)
    assert small.training.tolist() == [k for k in range(80, 200) if k != 90]
    assert small.held_out.tolist() == [k for k in range(200, 260) if k != 205]
    assert large.training.tolist() == [k for k in range(380, 500) if k != 500]
    assert large.held_out.tolist() == list(range(501, 560))
    assert (small.label, large.label) == ("rig block 1", "rig block 2")
    assert (small.amplitude_rad, large.amplitude_rad) == (1.0, 2.0)
    assert small.cycles == large.cycles == {C: 1, T: 2, H: 1}
    (whole,) = data_sets("rig", theta, theta, cycles, "held_out", spoilt)
    assert whole.held_out.tolist() == np.flatnonzero(~spoilt).tolist()
    assert len(whole.training) == 0
    # A block of which nothing trains or judges is none.
    (only,) = data_sets("rig", theta, theta, cycles[:5] + cycles[5:6], "cycles")
    assert only.label == "rig"
