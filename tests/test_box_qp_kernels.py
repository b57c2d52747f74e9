"""The small steps of the box QP's solver, each by numbers worked out by hand."""

from __future__ import annotations

from math import inf, nan

import casadi as ca
import numpy as np
import pytest

from esea_gen.control import box_qp, kernels
from esea_gen.control.predictive.box_qp import iteration_cap, packed
from esea_gen.control.predictive.box_qp_program import box_qp as program
from esea_gen.errors import UserError


def values(function, *given):
    """What a kernel makes of numbers, flat."""
    out = function(*(ca.SX(ca.DM(g)) for g in given))
    parts = out if isinstance(out, tuple) else (out,)
    return [float(v) for p in parts for v in np.array(ca.evalf(ca.SX(p))).ravel()]


def test_places_in_the_lower_triangle_row_by_row():
    places = iter(range(100))
    for i in range(5):
        for j in range(i + 1):
            assert packed(i, j) == packed(j, i) == next(places)
    assert [iteration_cap(n) for n in (1, 7)] == [3, 21]


TINY = 1e-3


@pytest.mark.parametrize(
    ("given", "found"),
    [
        # Freed: by minus the gradient over the curvature, from x; the pivot is turned round.
        ((4.0, 5.0, 1.0, 2.0, 3.0), [1 / 4, -3 / 4, 1, 2 - 3 / 4, -1 / 4, -1, 1]),
        # Tied at x: from the free value there; a free one's diagonal is minus its inverse.
        ((-4.0, 5.0, -1.0, 2.0, 3.0), [-1 / 4, -1 / 4, -1, -1 / 4, 1 / 4, 1, 1]),
        # No more than a thousandth of its own curvature is left: as if 0.
        ((0.005, 5.0, 1.0, 2.0, 3.0), [0, 0, 1, 2, 0, -1, 0]),
        ((0.0051, 5.0, 1.0, 2.0, 0.0051), [1 / 0.0051, -1, 1, 1, -1 / 0.0051, -1, 1]),
        ((-4.0, 5.0, 1.0, 2.0, 3.0), [0, 0, 1, 2, 0, -1, 0]),
        # Leaving, any share of the own curvature will do, but the sign must be right.
        ((-0.001, 5.0, -1.0, 2.0, 3.0), [-1000, -1000, -1, -1000, 1000, 1, 1]),
        ((0.001, 5.0, -1.0, 2.0, 3.0), [0, 0, -1, 0, 0, 1, 0]),
        ((nan, 5.0, 1.0, 2.0, 3.0), [0, 0, 1, 2, 0, -1, 0]),
    ],
)
def test_a_pivot_frees_a_variable_or_ties_it(given, found):
    """Of d, h, side, x, y: inverse, step, side; new y, new d, new side, sound."""
    step = values(box_qp._pivot, *given, TINY, 1.0)
    assert [x + 0.0 for x in step] == pytest.approx(found)
    # After one that was not sound, none is.
    after = values(box_qp._pivot, *given, TINY, 0.0)
    assert (after[0], after[1], after[6]) == (0, 0, 0)
    assert after[5] == -given[2]


def test_what_a_sweep_makes_of_the_others():
    scale = [0.5, 3.0, -1.0]  # inverse, step, side
    # y rises by the column times the step where tied, falls where free; the share is c / d.
    assert values(box_qp._shift, 2.0, 1.0, 0.7, scale) == pytest.approx([2 + 2.1, 0.35])
    assert values(box_qp._shift, 2.0, -1.0, 0.7, scale) == pytest.approx([2 - 2.1, 0.35])
    assert values(box_qp._rank, 5.0, 0.35, 0.6) == pytest.approx([5 - 0.21])
    assert values(box_qp._edge, 0.7, scale) == pytest.approx([-0.35])
    assert values(box_qp._own, 3.0, 5.0, 7.0) == [22]
    assert values(box_qp._both, 2.0, 3.0, 5.0, 7.0, 11.0) == [7 + 2 * 5, 11 + 2 * 3]
    assert values(box_qp._same_two, 3.0, 5.0) == [3, 5]
    assert values(box_qp._free_only, -1.0, 3.0) == [3]
    assert values(box_qp._free_only, 1.0, 3.0) == [0]


LOW, HIGH = -1.0, 2.0


@pytest.mark.parametrize(
    ("side", "x", "y", "best", "found"),
    [
        (-1, 0.5, 3.5, 1.0, [1, 0.5]),  # 1.5 of 3 on the way up
        (-1, 0.5, -2.5, 1.0, [1, 0.5]),  # and down
        (-1, 0.5, 3.5, 0.5, [0, 0.5]),  # another one as near
        (-1, 0.5, 3.5, 0.51, [1, 0.5]),
        (-1, 0.5, 2.0, 1.0, [0, 1.0]),  # ends at a bound, inside
        (-1, 0.5, -1.0, 1.0, [0, 1.0]),
        (1, 0.5, 3.5, 1.0, [0, 1.0]),  # tied: y is a gradient
        (-1, 2.0, 3.5, 1.0, [1, 0.0]),  # there already
    ],
)
def test_the_first_bound_in_the_way(side, x, y, best, found):
    assert values(box_qp._reach, side, x, y, LOW, HIGH, best) == found


def test_the_way_that_is_gone():
    def advance(*given):
        return values(box_qp._advance, *given)

    assert advance(-1, 0.5, 3.5, LOW, HIGH, 0.25) == [0.5 + 0.25 * 3]
    assert advance(-1, 0.5, 1.7, LOW, HIGH, 1.0) == [1.7]
    # Clipped, for rounding; what is tied stays.
    assert advance(-1, 0.5, 3.5, LOW, HIGH, 0.75) == [HIGH]
    assert advance(-1, 0.5, -3.5, LOW, HIGH, 0.75) == [LOW]
    assert advance(1, 0.5, 3.5, LOW, HIGH, 0.25) == [0.5]
    assert values(box_qp._tie, 0.5, -1.1, LOW, HIGH) == [LOW]
    assert values(box_qp._tie, 0.5, 2.1, LOW, HIGH) == [HIGH]
    assert values(box_qp._inside, 2.5, LOW, HIGH) == [HIGH, 1]
    assert values(box_qp._inside, 0.7, LOW, HIGH) == [0.7, 1]
    assert values(box_qp._refine, -1, 0.5, 0.25, LOW, HIGH) == [0.75]
    assert values(box_qp._refine, -1, 0.5, 2.5, LOW, HIGH) == [HIGH]
    assert values(box_qp._refine, 1, 0.5, 0.25, LOW, HIGH) == [0.5]


@pytest.mark.parametrize(
    ("x", "g", "low", "high", "h", "worst", "found"),
    [
        (0.5, 2.0, -1.0, 3.0, 4.0, 0.0, 0.125),  # a step of half, of a box of four
        (0.5, -2.0, -1.0, 3.0, 4.0, 0.0, 0.125),
        (0.5, 2.0, -1.0, 3.0, 4.0, 0.2, 0.2),  # another one is worse
        (0.5, 100.0, -1.0, 3.0, 4.0, 0.0, 0.375),  # to the end
        (-1.0, 5.0, -1.0, 3.0, 4.0, 0.0, 0.0),  # at the end, and pulled there
        (0.5, 2.0, -1.0, 3.0, 0.0, 0.0, 0.375),  # without a curvature as if of 1
        (0.5, 2.0, 0.5, 0.5, 4.0, 0.0, 0.0),  # a box without width
        (0.7, 0.0, 0.5, 0.5, 4.0, 0.0, 0.2),
        (nan, 0.0, -1.0, 3.0, 4.0, 0.0, 2.0),
        (7.6, 0.0, -1.0, 3.0, 4.0, 0.0, 1.15),
        (9.6, 0.0, -1.0, 3.0, 4.0, 0.0, 2.0),  # nothing inside is that far
        (9.0, 0.0, -1.0, 3.0, 4.0, 0.0, 1.5),
    ],
)
def test_the_projected_gradient_step_in_widths_of_the_box(x, g, low, high, h, worst, found):
    assert values(box_qp._residual, x, g, low, high, h, worst) == [pytest.approx(found)]


def test_only_a_minimum_that_rounding_has_left_is_refined():
    assert values(box_qp._rough, 0.3, 0.0, 0.2) == [1]
    assert values(box_qp._rough, 0.2, 0.0, 0.2) == [0]
    assert values(box_qp._rough, 0.3, 1.0, 0.2) == [0]
    assert [values(box_qp._is_zero, x)[0] for x in (0.0, 1.0, 0.5, -1.0, nan)] == [1, 0, 0, 1, 1]


def test_kernels_that_several_call():
    for module in (kernels, box_qp):
        assert values(module.zero) == [0]
        assert values(module.one) == [1]
        assert values(module.same, 3.0) == [3]
    assert values(kernels.plus, 2.0, 3.0, 5.0) == [17]
    assert values(kernels.take_from, 2.0, 3.0, 5.0) == [-13]
    assert values(kernels.flags_of, 1.0, 0.0, 1.0, 1.0) == [13]


def test_what_is_no_problem_leaves_nothing_of_the_one_before():
    """Solved by hand: x = (2/3, -1/3) free; with x_2 held at 0, x_1 = 1/2."""
    simulator = program(2).simulator()
    given = {"H": [2.0, 1.0, 2.0], "f": [-1.0, 0.0], "start": [9.0, -9.0]}
    out = simulator.step(**given, low=[-5.0, -5.0], high=[5.0, 5.0])
    assert out["x"] == pytest.approx([2 / 3, -1 / 3])
    assert (out["status"], out["iterations"]) == (0, 0)
    out = simulator.step(**given, low=[-5.0, 0.0], high=[5.0, 5.0])
    assert out["x"] == pytest.approx([0.5, 0.0])
    assert (out["status"], out["iterations"]) == (0, 1)
    for wrong in ({"f": [-1.0, nan]}, {"low": [-5.0, 5.1]}, {"H": [2.0, 1.1e12, inf]}):
        out = simulator.step(**(given | {"low": [-5.0, 0.0], "high": [5.0, 5.0]} | wrong))
        assert out["x"] == pytest.approx([0.0, 0.0], abs=0)
        assert (out["status"], out["residual"], out["iterations"]) == (1, 0, 0)
    out = simulator.step(**given, low=[-5.0, 0.0], high=[5.0, 5.0])
    assert (out["status"], out["iterations"]) == (0, 1)


def test_what_is_left_at_the_cap_is_in_widths_of_the_box():
    """x goes 28/73 of its way, to where the first one meets its end; a step of 405/292 is left."""
    given = {"H": [2.0, 1.0, 4.0], "f": [-20.0, 0.0], "start": [1.0, 2.0]}
    out = program(2, cap=0).simulator().step(**given, low=[-5.0, -5.0], high=[5.0, 5.0])
    assert out["x"] == pytest.approx([5, 10 / 73])
    assert out["residual"] == pytest.approx(405 / 2920)
    assert (out["status"], out["iterations"]) == (4 + 8, 1)


def test_nothing_goes_on_after_a_pivot_that_was_not_sound():
    given = {"H": [2.0, 3.0, 2.0], "f": [-20.0, 1.0], "start": [1.0, 2.0]}
    out = program(2).simulator().step(**given, low=[-5.0, 1.0], high=[5.0, 5.0])
    assert list(out["x"]) == [0, 1]
    assert (out["status"], out["iterations"]) == (2 + 8, 1)


def test_sums_of_magnitudes_up_to_the_largest_are_taken():
    simulator = program(2, largest=10.0).simulator()
    given = {"H": [2.0, 0.0, 2.0], "f": [-12.0, 8.0], "start": [0.0, 0.0]}
    box = {"low": [-9.0, -11.0], "high": [9.0, 11.0]}
    out = simulator.step(**given, **box)
    assert (out["status"], list(out["x"])) == (0, pytest.approx([6.0, -4.0]))
    for wrong in (
        *({"f": [-12.0, 8.01]}, {"f": [12.0, -8.01]}),
        *({"H": [11.0, 0.0, 19.01]}, {"start": [-20.01, 0.0]}, {"low": [-9.1, -11.0]}),
    ):
        assert simulator.step(**(given | box | wrong))["status"] == 1, wrong
    assert simulator.step(**(given | box | {"H": [11.0, 0.0, 19.0]}))["status"] == 0
    # Ends that meet are in order.
    pinned = {"low": [3.0, -11.0], "high": [3.0, 11.0]}
    assert list(simulator.step(**given, **pinned)["x"]) == pytest.approx([3.0, -4.0])


def test_the_ports_of_the_program():
    ports = {p.name: (p.low, p.high, p.size) for p in program(3, largest=50.0).inputs}
    assert ports == {
        "H": (-50, 50, 6),
        **dict.fromkeys(("f", "low", "high", "start"), (-50, 50, 3)),
    }
    block = program(3, largest=50.0, period_s=0.02)
    ports = {p.name: (p.low, p.high, p.size) for p in block.outputs}
    assert ports == {
        "x": (-50, 50, 3),
        "residual": (0, 50, 1),
        "iterations": (0, 1000, 1),
        "status": (0, 15, 1),
    }
    assert [f.counted for p in block.outputs for f in p.flags] == [True] * 4
    assert (block.period_s, program(3).period_s) == (0.02, 0.005)
    assert max(p.high for p in program(3).inputs) == pytest.approx(1e12)


def test_sizes_and_caps_up_to_their_ends():
    assert program(1).inputs[0].size == 1
    assert program(2, cap=1000) is not None
    with pytest.raises(UserError, match="cap is 1001"):
        program(2, cap=1001)
    with pytest.raises(UserError, match="101 variables; 1 to 100"):
        program(101)
