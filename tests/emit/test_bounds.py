"""Derived error bounds of small Blocks, against sums and roundings worked out by hand."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from esea_gen.emit.error_bounds import block_bound, step_bound
from esea_gen.emit.fixed.errors import any_bound
from esea_gen.emit.fixed.kept import plan_block
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.spans import RangeError
from esea_gen.emit.step_errors import linear_bound
from esea_gen.language.block import Block
from esea_gen.language.ports import Port, Tunable
from tests.made_up import made, port

PARTS = 1.5
THIRD = 2 / 3
PRODUCTS = 8


def scaled(given: float = 0.0, least: float = 1.0, products: int = PRODUCTS) -> Block:
    """y = x (2/3)^products, product by product, with 2/3 computed or given."""

    def step(c, s, u, guard, label):
        y = u.x_rad
        for _ in range(products):
            y = y * c.third
        return {}, {"y_rad": y}

    tunable = ("third", given, 0.5, 1 / least) if given else ("parts", PARTS, least, 2.0)
    return made(
        step,
        tunables=(Tunable(*tunable, "what is prepared"),),
        coefficients=(Port("third", 0.4, 1.1 / least, "two thirds"),),
        prepare=lambda t: {"third": 1 * t.third if given else 1 / t.parts},
    )


def linear(matrix: np.ndarray) -> Block:
    """s' = A s + x in its first element; y is the first element."""
    n = len(matrix)

    def step(c, s, u, guard, label):
        after = ca.DM(matrix) @ s.s_rad + ca.vertcat(u.x_rad, *[0.0] * (n - 1))
        return {"s_rad": ca.vertsplit(after)}, {"y_rad": after[0]}

    return made(step, (port("s_rad", -1e4, 1e4, n),), most=1e4)


# -- coefficients are rounded too ------------------------------------------------------------------


def test_a_float32_bound_holds_what_its_coefficients_are_rounded_by():
    near = float(np.float32(THIRD))
    rounded, exact = (block_bound(scaled(x), FORMATS["f32"]).outputs["y_rad"] for x in (0.0, near))
    # Each product is rounded by half a unit in the last place at most, 2^-24 of it.
    assert exact <= 1.01 * PRODUCTS * 2.0**-24 * THIRD**PRODUCTS
    # d/dc of c^8 x, at x = 1: what rounding 2/3 to float32 does to the result, at most and here.
    slope = PRODUCTS * THIRD**7
    assert rounded >= exact + slope * abs(near - THIRD)
    assert rounded <= 1.01 * (exact + slope * 2.0**-24 * THIRD)


def test_a_q31_bound_holds_what_its_coefficients_are_rounded_by():
    # A coefficient that may be tuned up to 1000 has coarse units: as coarse as the product's.
    plan = plan_block(scaled(least=1e-3, products=1))
    (coefficient,) = plan.fields["coeffs"]
    unit = 2.0**-coefficient.fraction
    near = round(THIRD / unit) * unit
    exact = plan_block(scaled(near, least=1e-3, products=1))
    assert exact.fields["coeffs"][0].fraction == coefficient.fraction
    off = any_bound(plan).outputs["y_rad"] - any_bound(exact).outputs["y_rad"]
    assert abs(near - THIRD) > 0.3 * unit
    assert off == pytest.approx(abs(near - THIRD), rel=0.01)


# -- a linear Block's own errors, summed for all time ----------------------------------------------


@pytest.mark.parametrize("pole", [0.5, 0.99, -0.97, 0.999])
def test_errors_of_one_pole_sum_to_a_geometric_series(pole):
    (found,) = linear_bound(linear(np.array([[pole]])), [[3e-7]])
    assert found == pytest.approx([3e-7 / (1 - abs(pole))], rel=3e-6)
    assert found[0] >= 3e-7 / (1 - abs(pole))


@pytest.mark.parametrize("pole", [0.5, 0.97, 0.999])
def test_errors_of_a_double_pole_sum_to_its_derivative(pole):
    # A^k = [[p^k, k p^(k-1)], [0, p^k]]: the sums are 1/(1 - p) and 1/(1 - p)^2.
    d = np.array([1e-7, 4e-7])
    (found,) = linear_bound(linear(np.array([[pole, 1.0], [0.0, pole]])), [d.tolist()])
    once = 1 / (1 - pole)
    assert found == pytest.approx([once * d[0] + once**2 * d[1], once * d[1]], rel=3e-6)


@pytest.mark.parametrize(("radius", "turns"), [(0.9, 8), (0.995, 12), (0.99, 4)])
def test_errors_of_a_rotation_sum_over_its_turn(radius, turns):
    # After a whole turn all repeats, r^n smaller: the series of the turns, of one turn's sum.
    angle = 2 * math.pi / turns
    a = radius * np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    d = np.array([1e-7, 2e-7])
    k = np.arange(turns)
    c, s = (np.sum(radius**k * np.abs(f(k * angle))) for f in (np.cos, np.sin))
    turn = np.array([c * d[0] + s * d[1], s * d[0] + c * d[1]]) / (1 - radius**turns)
    (found,) = linear_bound(linear(a), [d.tolist()])
    assert found == pytest.approx(turn.tolist(), rel=3e-6)


def test_what_does_not_forget_has_no_sum():
    assert linear_bound(linear(np.array([[1.0]])), [[1e-7]]) is None
    assert linear_bound(linear(np.array([[-1.0]])), [[1e-7]]) is None


# -- what a bound assumes --------------------------------------------------------------------------


def float_bound(block: Block):
    try:
        return block_bound(block, FORMATS["f32"])
    except RangeError:
        return step_bound(block, FORMATS["f32"])


def test_a_states_error_is_that_of_its_worst_element():
    """The first element is an input, without error; the second a product, rounded once."""

    def step(c, s, u, guard, label):
        return {"s_rad": [u.x_rad, 0.7 * u.x_rad]}, {"y_rad": s.s_rad[1]}

    found = float_bound(made(step, (port("s_rad", -1, 1, 2),)))
    assert 0.7 * 2**-25 < found.states["s_rad"] < 4 * 2**-24


def test_a_bound_says_which_decisions_it_takes_for_equal():
    def step(c, s, u, guard, label):
        return {}, {"y_rad": ca.if_else(u.x_rad * 0.7 < 0.3, u.x_rad, -u.x_rad)}

    def told(c, s, u, guard, label):
        return {}, {"y_rad": ca.if_else(u.x_rad < 0.25, u.x_rad, -u.x_rad)}

    for bound in (float_bound, lambda b: any_bound(plan_block(b))):
        (said,) = bound(made(step, name="switching")).assumptions
        assert said.startswith("switching")
        assert said.endswith("= lt")
        # An input is the same number on both sides.
        assert bound(made(told)).assumptions == ()


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("turned", [False, True])
def test_what_only_rounding_can_bring_past_a_threshold_is_no_decision_for_sure(sign, turned):
    # 0.7 x is at most 0.7, in float32 at most 1.2e-7 of that more: above the near threshold, which
    # it does not reach without rounding, and below the far one.
    for beyond, unsure in ((3e-8, True), (3e-6, False)):
        threshold = sign * 0.7 * (1 + beyond)

        def step(c, s, u, guard, label, threshold=threshold):
            pair = (
                (u.x_rad * 0.7, threshold) if turned == (sign < 0) else (threshold, u.x_rad * 0.7)
            )
            return {}, {"y_rad": ca.if_else(pair[0] < pair[1], u.x_rad, -u.x_rad)}

        assert bool(float_bound(made(step)).assumptions) is unsure
