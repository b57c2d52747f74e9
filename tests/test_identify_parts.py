"""The parts of an identification one by one: search, how well it is known, cycles, what is told."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

from esea_gen.identify.cycles import data_sets, divide, reversals
from esea_gen.identify.misfit import Misfit
from esea_gen.identify.parameters import at_bound, bounds_of, with_values
from esea_gen.identify.peers import bouc_wen, maxwell_coulomb
from esea_gen.identify.plant import equal_weights, thinned
from esea_gen.identify.plays import phi_range, play_at_bound, play_bounds, play_space, play_spread
from esea_gen.identify.population import finalists, polished, runner_up, sobol_population
from esea_gen.identify.resampling import FitRows, autocorrelation
from esea_gen.identify.space import GAIN, Space, edges_of
from esea_gen.identify.tables import Cycles
from esea_gen.identify.uncertainty import relative_jacobian, uncertainty

# Search.


def test_a_population_fills_the_box_and_tells_the_best_so_far():
    low, high = np.array([-1.0, 10.0]), np.array([3.0, 12.0])
    told = []
    points, costs = sobol_population(
        lambda x: np.array([x[0], 2.0]), low, high, 64, 5, lambda i, best: told.append((i, best))
    )
    assert points.shape == (64, 2)
    np.testing.assert_allclose(costs, points[:, 0] ** 2 + 4)
    assert told == [(i, pytest.approx(costs[: i + 1].min())) for i in range(64)]
    # Every eighth of each side has its share.
    for column, a, b in zip(points.T, low, high, strict=True):
        assert np.histogram(column, 8, (a, b))[0].tolist() == [8] * 8


def test_finalists_are_the_best_that_are_apart():
    low, high = np.array([0.0, 100.0]), np.array([10.0, 300.0])
    # In tenths of the box: 0.9 beside the best, 1.1 beside it in either number, and far off.
    points = np.array([[5, 200], [5.9, 200], [5, 222], [6.1, 200], [0, 100], [9, 290]], float)
    costs = np.array([1.0, 2.0, 4.0, 3.0, 6.0, 5.0])
    found = [x.tolist() for x in finalists(points, costs, low, high, 4)]
    assert found == [[5, 200], [6.1, 200], [5, 222], [9, 290]]
    assert len(finalists(points, costs, low, high, 9)) == 5
    assert len(finalists(points, costs, low, high, 1)) == 1


def test_a_minimum_is_found_inside_and_at_a_bound_and_in_few_steps():
    low, high = np.array([0.0, -1e3]), np.array([1.0, 1e3])
    asked = []

    def residual(x):
        asked.append(x.copy())
        assert np.all((x >= low) & (x <= high))
        return np.array([x[0] - 0.25, (x[1] - 300) / 100, 0.5 * x[0] * x[1] / 1e4])

    cost, x = polished(residual, low, low, high, ftol=1e-12, xtol=1e-12)

    # The normal equations, solved by hand.
    def slope(a):
        b = 300 / (1 + (0.5 * a / 100) ** 2)
        return (a - 0.25) + (0.5 * b / 1e4) ** 2 * a

    a = brentq(slope, 0, 1)
    assert x[0] == pytest.approx(a, rel=1e-6)
    assert cost == pytest.approx(float(np.sum(residual(x) ** 2)), rel=1e-9)
    # From a corner it starts a millionth inside.
    assert asked[0] == pytest.approx([1e-6, -1e3 + 2e-3], rel=1e-6)
    outside, at = polished(lambda x: np.array([x[0] - 2.0, 0.0]), high, low, high)
    assert (outside, at[0]) == (pytest.approx(1.0, rel=1e-4), pytest.approx(1.0, abs=1e-4))


def test_the_runner_up():
    assert runner_up([2.0, 3.0, 7.0]) == 1.5
    assert runner_up([2.0]) == runner_up([0.0, 1.0]) == math.inf


# How well it is known.


def test_the_jacobian_is_by_a_relative_change_from_both_sides():
    seen = []

    def run(v):
        seen.append(v)
        return np.array([v["a"] ** 3, v["a"] * v["b"], 7.0])

    found = relative_jacobian(run, {"a": 2.0, "b": -5.0}, ("a", "b"), 0.01)
    # d/d ln a of a^3 is 3 a^3, and central differences add a^3 s^2.
    np.testing.assert_allclose(found[:, 0], [8 * (3 + 1e-4), -10.0, 0.0], rtol=1e-12)
    np.testing.assert_allclose(found[:, 1], [0.0, -10.0, 0.0], rtol=1e-12)
    assert [v["a"] for v in seen] == pytest.approx([2.02, 1.98, 2, 2])


def test_autocorrelation_of_known_sequences_and_its_ends():
    n = 400
    assert autocorrelation(np.ones(n)) == 1 - 2 / n
    assert autocorrelation((-1.0) ** np.arange(n)) == 0
    assert autocorrelation(np.array([1.0, 1.0, 0.0, 0.0])) == 0.5
    # Of a long sine the neighbours are alike by the cosine of the step.
    assert autocorrelation(np.sin(0.3 * np.arange(20000))) == pytest.approx(math.cos(0.3), abs=1e-3)


def line(values, unit=1.0):
    """A plant of springs in closed form, of which the noise is known."""
    theta = np.linspace(-0.2, 0.2, 9)
    keys = [k for k in ("k1_Nm_rad", "k3_Nm_rad3", "alpha_Nm_rad") if k in values]
    basis = np.stack([theta, theta**3, theta**2][: len(keys)], axis=1)
    noise = 0.01 * np.array([1, -1, 1, -1, 1, -1, 1, -1, 1.0])
    measured = basis @ [values[k] for k in keys] + noise
    return SimpleNamespace(
        measured=measured,
        weight=np.full(9, 1 / 3),
        torque=lambda v: basis @ [v.get(k, 0.0) for k in keys],
        basis=basis,
        rows=FitRows.of([(0, 9, np.zeros(9))]),
        whole=False,
    )


@pytest.mark.parametrize("third", [{}, {"alpha_Nm_rad": 3.0}])
def test_the_weakest_direction_and_what_a_tenth_along_it_does(third):
    springs = {"k1_Nm_rad": 10.0, "k3_Nm_rad3": 200.0} | third
    values = springs | {"eps2": 0.013}
    plant = line(values)
    told = uncertainty(plant, values)
    scaled = plant.basis * list(springs.values())
    squares, vectors = np.linalg.eigh(scaled.T @ scaled)
    weakest = told.weakest["direction"]
    assert abs(np.dot(list(weakest.values()), vectors[:, 0])) == pytest.approx(1, abs=1e-3)
    assert list(weakest) == list(springs)
    change = 0.1 * math.sqrt(squares[0] / 9)
    assert told.weakest["rms_change_Nm"] == pytest.approx(change, rel=1e-6)
    assert told.sigma["eps2"] is None


def test_a_parameter_at_its_bound_has_no_deviation_and_takes_none():
    values = {"k1_Nm_rad": 10.0, "k3_Nm_rad3": 200.0, "alpha_Nm_rad": 0.0}
    told = uncertainty(line(values), values)
    assert told.sigma["alpha_Nm_rad"] is None
    assert list(told.weakest["direction"]) == ["k1_Nm_rad", "k3_Nm_rad3"]
    none = uncertainty(line(values), {"k1_Nm_rad": 0.0, "k3_Nm_rad3": 0.0})
    assert (none.weakest, set(none.sigma.values())) == ({}, {None})
    low, high = bounds_of("k1_Nm_rad")
    assert at_bound("k1_Nm_rad", high) == at_bound("k1_Nm_rad", high * (1 - 1e-7)) == "upper"
    assert at_bound("k1_Nm_rad", high * (1 - 1e-5)) is None
    assert (low, at_bound("k1_Nm_rad", low), at_bound("k1_Nm_rad", 1e-9)) == (0, "lower", None)


# Play operators.


def test_bounds_of_the_play_operators():
    for key in ("kappa_rad", "phi_1_rad", "chi_rad"):
        low, high = play_bounds(key)
        width = high - low
        assert play_at_bound(key, low) == "lower"
        assert play_at_bound(key, high) == "upper"
        assert play_at_bound(key, 0.5 * (low + high)) is None
        # Within a ten-thousandth of the range; the thresholds, of no scale, only at the end.
        near = {True: "lower", False: None}
        assert play_at_bound(key, low + 0.9e-4 * width) == near[key != "chi_rad"]
        assert play_at_bound(key, low + 1.1e-4 * width) is None
        assert play_at_bound(key, high - 1.1e-4 * width) is None
    assert play_at_bound("chi_rad", play_bounds("chi_rad")[0] + 0.5e-9) == "lower"
    assert play_at_bound("chi_rad", play_bounds("chi_rad")[0] + 2e-9) is None


@pytest.mark.parametrize("k3", [200.0, 0.0])
def test_thresholds_are_searched_up_to_the_largest_deflection(elbow, k3):
    device = with_values(elbow, {"k1_Nm_rad": 10.0, "k3_Nm_rad3": k3})
    theta = 0.2
    torque = np.array([0.3, -(10 * theta + k3 * theta**3), 0.1])
    low, high = play_space(device, [SimpleNamespace(tau_Nm=x) for x in (torque, 0.5 * torque)])
    phi, chi = play_bounds("phi_1_rad"), play_bounds("chi_rad")
    assert (low[0], high[0]) == phi
    least = max(chi[0], theta / 5000)
    assert math.exp(low[1]) == pytest.approx(least, rel=1e-9)
    assert math.exp(high[1]) == pytest.approx(min(chi[1], theta), rel=1e-6)
    # A torque of next to nothing: there is still something to search, twice the least.
    tiny = [SimpleNamespace(tau_Nm=1e-9 * torque)]
    low, high = play_space(device, tiny)
    assert np.exp([low[1], high[1]]) == pytest.approx([chi[0], 2 * chi[0]])


class Ripple:
    """The error over phi, chi in closed form: a valley in chi whose floor rises with phi."""

    def __init__(self, best_phi, rise, chi_of):
        self.best, self.rise, self.chi_of, self.asked = best_phi, rise, chi_of, []

    def solve(self, phi, chi):
        self.asked.append((phi, chi))
        floor = 1 + self.rise * (phi - self.best) ** 2
        away = math.log(chi) - self.chi_of(phi)
        return 0.0, np.array([floor, 2.0 * away])


def test_the_range_of_phi_over_which_the_error_hardly_rises():
    low, high = np.array([0.0, -8.0]), np.array([100.0, -2.0])
    # The error is 1 + rise (phi - 40)^2 with chi refitted, which moves along with phi: 1 % more
    # is reached 10 away; the grid of eleven has 30, 40 and 50 within.
    plant = Ripple(40.0, 0.0101 / 11**2, lambda phi: -5 + 0.01 * (phi - 40))
    assert phi_range(plant, np.array([40.0, -5.0]), low, high) == (30.0, 50.0)
    # Not refitted, hardly any phi would do; nor further than 1.5 in the logarithm.
    chis = [math.log(c) for _, c in plant.asked]
    assert -6.5 - 1e-9 <= min(chis) < -5.75
    assert -4.25 < max(chis) <= -3.5 + 1e-9
    # Each phi with few runs, yet to a ten-thousandth.
    assert len(plant.asked) < 11 * 30
    # The best itself counts, on the grid or not.
    steep = Ripple(43.0, 1.0, lambda phi: -5.0)
    assert phi_range(steep, np.array([43.0, -5.0]), low, high) == (43.0, 43.0)
    # Near an end of the thresholds' range the search stays inside.
    edge = Ripple(40.0, 1.0, lambda phi: -8.0)
    phi_range(edge, np.array([40.0, -7.9]), low, high)
    assert min(math.log(c) for _, c in edge.asked) >= -8.0 - 1e-9


def test_correlation_of_the_play_operators_numbers_in_closed_form():
    rng = np.random.default_rng(4)
    basis = rng.normal(size=(50, 3)) @ np.array([[1, 0.8, 0], [0, 1, 0.3], [0, 0, 1.0]])
    values = {"kappa_rad": 0.1, "phi_1_rad": 2.5, "chi_rad": 0.02}
    noise = rng.normal(size=50)
    noise -= basis @ np.linalg.lstsq(basis, noise, rcond=None)[0]
    measured = basis @ list(values.values()) + noise
    plant = SimpleNamespace(
        measured=measured,
        weight=np.full(50, 1 / math.sqrt(50)),
        set_point=lambda *v: basis @ v,
    )
    sigma, correlation = play_spread(plant, values)
    rho = max(0.0, float(noise[1:] @ noise[:-1] / (noise @ noise)))
    covariance = np.linalg.inv(basis.T @ basis) * float(noise @ noise) / 47
    covariance *= (1 + rho) / (1 - rho)
    expected = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose([sigma[k] for k in values], expected, rtol=1e-5)
    for i, a in enumerate(values):
        for j, b in list(enumerate(values))[:i]:
            share = covariance[i, j] / expected[i] / expected[j]
            assert correlation[f"{a} {b}"] == pytest.approx(share, rel=1e-5)
    assert len(correlation) == 3
    # One at its bound is not free: no deviation, and none of its pairs.
    held = values | {"phi_1_rad": play_bounds("phi_1_rad")[0]}
    sigma, correlation = play_spread(plant, held)
    assert sigma["phi_1_rad"] is None
    assert list(correlation) == ["chi_rad kappa_rad"]


# What is searched of the forward model, and its edges.


def test_edges_of_the_searched_space_are_named():
    space = Space(True, 0.2, 1.0, 10.0)
    # Stops from a five-hundredth of the deflection to twice it or the file's bound; a decay up to
    # the file's; time constants from a millisecond to ten records.
    assert np.exp([space.low[0], space.high[0]]) == pytest.approx([0.2 / 500, 0.1])
    near = Space(False, 0.04, 1.0, 10.0)
    assert math.exp(near.high[0]) == pytest.approx(2 * 0.04)
    beta = bounds_of("beta_1_rad")[1]
    assert [space.low[1], math.expm1(space.high[1])] == pytest.approx([0, beta * 0.2])
    assert np.exp([space.low[2], space.high[2]]) == pytest.approx([1e-3, 100.0])
    assert np.exp(space.low[[3, 5]]) == pytest.approx([GAIN[0]] * 2)
    assert np.exp(space.high[[3, 5]]) == pytest.approx([GAIN[1]] * 2)
    assert (space.low[[4, 6]].tolist(), space.high[[4, 6]].tolist()) == ([0, 0], [4, 1])
    long = Space(True, 0.2, 1.0, 1e6)
    assert math.exp(long.high[2]) == pytest.approx(1e4)
    middle = 0.5 * (space.low + space.high)
    assert edges_of(space, middle) == ()
    words = (
        "stops are",
        "stops' weight",
        "time constant",
        "deflection",
        "exponent m",
        "rate",
        "exponent n",
    )
    said = []
    for k, word in enumerate(words):
        for end, other in ((space.low, space.high), (space.high, space.low)):
            x = middle.copy()
            x[k] = end[k] + 0.9e-3 * (other[k] - end[k])
            (text,) = edges_of(space, x)
            said.append(text)
            if word != "deflection" or "zero" not in text:
                assert word in text
            x[k] = end[k] + 1.1e-3 * (other[k] - end[k])
            assert edges_of(space, x) == ()
    assert len(set(said)) == 14
    assert all(
        ("close" in t or "short" in t or "lower" in t or "not" in t or "small" in t)
        for t in said[:6:2] + said[8::4]
    )


def test_a_shape_means_what_it_says():
    space = Space(True, 0.2, 3.0, 10.0)
    x = np.array([math.log(0.01), 0.7, math.log(0.5), math.log(20.0), 1.5, math.log(4.0), 0.6])
    p = space.shape(x)
    assert p["omega_rad"] == pytest.approx(0.01)
    # The weight of a stop as far off as the deflection: exp(-beta theta).
    assert 1 + p["beta_1_rad"] * 0.2 == pytest.approx(math.exp(0.7))

    def eta(theta, rate):
        over = p["A_Nms_rad"] * theta ** p["m"] + p["eps1_Nms_rad"]
        return over / (p["B"] * rate ** p["n"] + p["eps2"])

    # Time constant at rest, how much more at the largest deflection, how much less at the fastest.
    assert eta(0, 0) == pytest.approx(0.5)
    assert eta(0.2, 0) / eta(0, 0) == pytest.approx(1 + 20)
    assert eta(0, 3.0) / eta(0, 0) == pytest.approx(1 / (1 + 4))
    assert eta(0.1, 0) / eta(0, 0) == pytest.approx(1 + 20 * 0.5**1.5)
    assert eta(0, 1.5) / eta(0, 0) == pytest.approx(1 / (1 + 4 * 0.5**0.6))


# Rows, weights, errors.


def test_rows_are_thinned_evenly_and_sets_weigh_the_same():
    rows = np.arange(100, 1100)
    assert thinned(rows, None) is rows
    assert thinned(rows, 1000).tolist() == rows.tolist()
    assert thinned(rows, 999).tolist() == rows[::2].tolist()
    assert thinned(rows, 300).tolist() == rows[::4].tolist()
    weights = equal_weights([np.zeros(10), np.zeros(40)])
    assert float(weights @ weights) == pytest.approx(1)
    assert np.sum(weights[:10] ** 2) == pytest.approx(0.5)
    assert weights[0] == pytest.approx(2 * weights[-1])


def test_errors_with_unit_and_in_per_cent():
    found = Misfit.of(np.array([3.0, -4.0, 0.0, 0.0]))
    assert found.to_dict("Nm", 50.0) == pytest.approx(
        {"rms_Nm": 2.5, "rms_percent": 5.0, "max_Nm": 4.0, "max_percent": 8.0}
    )
    assert Misfit.of(np.zeros(0)) is None


# Cycles.


def rules(**changed) -> Cycles:
    return Cycles(**{"skip_first": 1, "hold_out_last": 1} | changed)


def test_a_reversal_counts_only_beyond_the_noise():
    theta = np.array([0.0, 0.4, 1.0, 0.95, 1.2, 0.2, 0.25, -1.0, 0.0])
    assert reversals(theta, 0.3) == [0, 4, 7, 8]
    # By as much as the threshold it does not count, by a hair more it does.
    assert reversals(theta, 0.04) == [0, 2, 3, 4, 5, 6, 7, 8]
    assert reversals(np.array([0.0, -1.0, 0.0, -0.5]), 0.5 - 1e-9) == [0, 1, 2, 3]
    assert reversals(np.array([0.0, -1.0, 0.0, -0.5]), 0.5) == [0, 1, 3]
    assert reversals(np.array([1.0, 0.0, 1.0]), 0.1) == [0, 1, 2]
    assert reversals(np.array([0.0, -0.2, 1.0, 0.0]), 0.5) == [0, 1, 2, 3]
    assert reversals(np.array([0.0, 0.2, -1.0, 0.0]), 0.5) == [0, 1, 2, 3]


def waves(*amplitudes: float, per: int = 40) -> np.ndarray:
    angle = 2 * np.pi * np.arange(per) / per
    return np.concatenate([a * np.sin(angle) for a in amplitudes] + [np.zeros(1)])


def sets_of(theta, tau, **changed):
    r = rules(**changed)
    cycles = divide(theta, r, "cycles")
    return cycles, data_sets("rig", theta, tau, cycles, "cycles")


def test_one_block_keeps_the_recordings_label_and_several_are_numbered():
    one = waves(*[0.1] * 6)
    _, (only,) = sets_of(one, 10 * one)
    assert only.label == "rig"
    assert only.amplitude_rad == pytest.approx(0.1, rel=1e-9)
    two = waves(*[0.1] * 6, *[0.2] * 6)
    _, both = sets_of(two, 10 * two)
    assert [s.label for s in both] == ["rig block 1", "rig block 2"]
    assert [s.amplitude_rad for s in both] == pytest.approx([0.1, 0.2], rel=1e-9)
    whole = data_sets("rig", one, one, divide(one, rules(), "train"), "train")
    assert [(s.label, len(s.training), len(s.held_out)) for s in whole] == [("rig", len(one), 0)]
    whole = data_sets("rig", one, one, divide(one, rules(), "held_out"), "held_out")
    assert [(len(s.training), len(s.held_out)) for s in whole] == [(0, len(one))]


@pytest.mark.parametrize("amplitudes", [(0.1, 0.05), (0.05, 0.1), (0.1, 0.05, 0.02)])
def test_a_cycle_that_ends_elsewhere_than_it_began_is_no_loop(amplitudes):
    # A spring and a friction that never changes: no cycle loses less than another of its amplitude.
    theta = waves(*[a for a in amplitudes for _ in range(5)], per=400)
    tau = 20 * theta + 0.1 * np.sign(np.gradient(theta))
    cycles, sets = sets_of(theta, tau)
    assert [s.amplitude_rad for s in sets] == pytest.approx(list(amplitudes), rel=1e-3)
    for s, a in zip(sets, amplitudes, strict=True):
        assert s.work_first_J == pytest.approx(4 * a * 0.1, rel=0.02)
        assert s.work_last_J == pytest.approx(4 * a * 0.1, rel=0.02)
        assert abs(s.softening) < 0.02
        # Four closed cycles: one conditions, two train, the last judges; in the last block too.
        assert s.cycles == {"conditioning": 1, "training": 2, "held_out": 1}
    used = [c for c in cycles if c.role != "transition"]
    assert len(cycles) - len(used) == len(amplitudes) - 1
    assert max(abs(theta[c.stop] - theta[c.start]) for c in used) < 1e-3
    # Two closed cycles and the way down: it takes neither's place.
    short, (first, _) = sets_of(w := waves(*[0.1] * 3, *[0.05] * 5, per=400), 20 * w)
    assert [c.role for c in short][:3] == ["conditioning", "held_out", "transition"]
    assert first.cycles == {"conditioning": 1, "held_out": 1}


def test_stiffer_to_one_side_is_told_as_a_share_of_the_mean():
    theta = waves(*[0.1] * 6)
    tau = np.where(theta > 0, 12.0, 8.0) * theta
    _, (s,) = sets_of(theta, tau)
    assert s.asymmetry == pytest.approx((12 - 8) / 10)
    _, (same,) = sets_of(theta, 9 * theta)
    assert same.asymmetry == pytest.approx(0, abs=1e-12)
    # A side that is hardly reached says nothing: a fifth of the other is the least.
    for share, known in ((0.21, True), (0.19, False)):
        bent = np.where(theta > 0, 1.0, share) * theta
        _, (s,) = sets_of(bent, 5 * bent)
        assert (s.asymmetry is not None) == known
    up = np.abs(theta)
    _, sets = sets_of(up, 5 * up)
    assert {s.asymmetry for s in sets} == {None}


def test_loss_of_the_first_and_last_cycle_is_the_area_of_its_loop():
    n, per = 6, 400
    angle = 2 * np.pi * np.arange(n * per + 1) / per
    theta = 0.1 * np.sin(angle)
    # An ellipse of half axis b has the area pi a b; each cycle loses a tenth less than the one
    # before.
    b = 0.5 * 0.9 ** np.maximum(0, np.floor((angle + 1e-9) / (2 * np.pi) - 0.25))
    tau = 20 * theta + b * np.cos(angle)
    cycles, (s,) = sets_of(theta, tau)
    assert len(cycles) == 5
    first = math.pi * 0.1 * 0.5
    assert s.work_first_J == pytest.approx(first, rel=2e-3)
    assert s.work_last_J == pytest.approx(first * 0.9**4, rel=2e-3)
    assert s.softening == pytest.approx(1 - 0.9**4, rel=1e-2)
    # Of one cycle, or without a loss, there is no share.
    _, (spring,) = sets_of(theta, 20 * theta)
    assert (spring.work_first_J, spring.work_last_J, spring.softening) == (None, None, None)
    assert s.cycles == {"conditioning": 1, "training": 3, "held_out": 1}


def test_cycles_of_another_amplitude_make_a_block_of_their_own():
    for share, blocks in ((1.09, 1), (1.12, 2)):
        theta = waves(*[0.1] * 5, *[0.1 * share] * 5)
        cycles, _ = sets_of(theta, theta, block_tolerance=0.1)
        assert len({c.block for c in cycles}) == blocks
    theta = waves(*[0.1] * 5, 0.15, *[0.2] * 5)
    cycles, _ = sets_of(theta, theta, block_tolerance=0.1)
    assert [c.role for c in cycles].count("transition") >= 1


# Peers.


def test_bouc_wen_yields_at_its_yield_and_comes_back_the_other_way():
    # Exponent 1, all of it against the path: du/dx = (1 - |u|) / y going out, so u = 1 - e^(-x/y).
    x = np.concatenate([np.linspace(0, 1, 4001), np.linspace(1, 0.9, 401)[1:]])
    y, n = 0.25, 1.0
    columns = bouc_wen(np.array([math.log(y), n, 1.0]), x, x)
    np.testing.assert_array_equal(columns[:, 0], x)
    np.testing.assert_allclose(columns[:, 1], x**3)
    u = columns[:, 2]
    np.testing.assert_allclose(u[:4001], 1 - np.exp(-x[:4001] / y), atol=1e-3)
    # Turned round, with beta 1: du/dx = (1 + |u|)/y.
    top = u[4000]
    np.testing.assert_allclose(u[4001:], (1 + top) * np.exp(-(1 - x[4001:]) / y) - 1, atol=1e-3)
    # With beta a half it unloads with the slope 1/y.
    half = bouc_wen(np.array([math.log(y), n, 0.5]), x, x)[:, 2]
    assert (half[4000] - half[4100]) / (x[4000] - x[4100]) == pytest.approx(1 / y, rel=1e-6)
    # A long step does not go beyond what it can carry.
    assert (
        np.max(np.abs(bouc_wen(np.array([math.log(0.01), 2.0, 0.5]), x, np.sin(40 * x))[:, 2])) == 1
    )


def test_maxwell_branches_and_coulomb_friction_in_closed_form():
    t = 0.01 * np.arange(400)
    speed = 0.5
    x = speed * t
    times = np.array([0.05, 0.5, 5.0])
    columns = maxwell_coulomb(np.log(times), t + 3.0, x)
    np.testing.assert_allclose(columns[:, 1], x**3)
    for k, time in enumerate(times):
        np.testing.assert_allclose(
            columns[:, 2 + k], speed * time * (1 - np.exp(-t / time)), atol=1e-9
        )
    # Friction: follows for a hundredth, then carries that much; turned round, twice as far.
    there_and_back = np.concatenate([x, x[::-1]])
    friction = maxwell_coulomb(np.log(times), np.arange(800) * 0.01, there_and_back)[:, 5]
    np.testing.assert_allclose(friction[:400], np.minimum(x, 0.01), atol=1e-12)
    np.testing.assert_allclose(
        friction[400:], np.maximum(0.01 - (x[-1] - x[::-1]), -0.01), atol=1e-12
    )
