"""How well a fit's numbers are known: plants in closed form; the play operators' fit by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.identify import plays
from esea_gen.identify.cycles import DataSet
from esea_gen.identify.parameters import (
    EPS2_DEFAULT,
    at_bound,
    bounds_of,
    with_parameters,
    with_values,
)
from esea_gen.identify.plays import (
    PlayPlant,
    phi_range,
    play_at_bound,
    play_bounds,
    play_space,
    play_spread,
)
from esea_gen.identify.recorded import Recording
from esea_gen.identify.resampling import FitRows, resampled
from esea_gen.identify.uncertainty import free_keys, uncertainty

# The forward model.


def linear(values: dict[str, float], seed: int = 4, unit: float = 1.0) -> SimpleNamespace:
    """A torque that is linear in every number; rows of other weights, neighbours alike."""
    rng = np.random.default_rng(seed)
    basis = {k: unit * rng.normal(size=240) / v for k, v in values.items()}
    noise = np.convolve(rng.normal(0, 0.5 * unit, 244), np.ones(5) / 2, "valid")
    weight = np.repeat([0.5, 2.0, 1.0, 0.7], 60)
    weight = weight / math.sqrt(float(weight @ weight))
    j = np.column_stack([basis[k] * values[k] for k in basis]) * weight[:, None]
    noise = noise - np.column_stack([*basis.values()]) @ (
        np.array([*values.values()]) * np.linalg.lstsq(j, noise * weight, rcond=None)[0]
    )

    def torque(v):
        return sum(basis[k] * v[k] for k in basis)

    return SimpleNamespace(
        basis=basis,
        noise=noise,
        torque=torque,
        measured=torque(values) + noise,
        weight=weight,
        rows=FitRows.of([(i, 4, np.zeros(60)) for i in range(4)]),
        whole=True,
    )


VALUES = {"k1_Nm_rad": 10.0, "k3_Nm_rad3": 240.0, "beta_1_rad": 0.5, "m": 3.9, "n": 0.95}


@pytest.mark.parametrize("unit", [1.0, 30.0])
def test_deviations_are_those_of_blocks_left_out_inside_the_parameters_bounds(unit):
    plant = linear(VALUES, unit=unit)
    told = uncertainty(plant, VALUES)
    # Unit weight on average; parameters as shares of their values.
    scale = plant.weight * math.sqrt(240)
    j = np.column_stack([plant.basis[k] * v for k, v in VALUES.items()])
    ends = {"m": (0.0, 4.0), "n": (0.0, 1.0), "k3_Nm_rad3": (0.0, 2500.0)}
    ends = [ends.get(k, (0.0, 1000.0)) for k in VALUES]
    low, high = (
        np.array([e[i] / v - 1 for e, v in zip(ends, VALUES.values(), strict=True)]) for i in (0, 1)
    )
    found = resampled(j, plant.noise, scale, plant.rows, True, (low, high))
    free = resampled(j, plant.noise, scale, plant.rows, True)
    assert np.abs(found.outside_Nm - free.outside_Nm).max() > 1e-3 * unit  # a bound was met
    np.testing.assert_allclose(told.resampled.outside_Nm, found.outside_Nm, atol=1e-9 * unit)
    np.testing.assert_allclose(told.resampled.covariance, found.covariance, rtol=1e-7)
    np.testing.assert_allclose(told.resampled.weight, scale, rtol=1e-12)
    expected = found.sigma * [*VALUES.values()]
    assert [told.sigma[k] for k in VALUES] == pytest.approx(expected, rel=1e-7)
    r = plant.noise * scale
    rho = float(r[1:] @ r[:-1] / (r @ r))
    assert 0.5 < rho < 0.9
    assert told.correlation_factor == pytest.approx(math.sqrt((1 + rho) / (1 - rho)), rel=1e-9)
    _, s, v = np.linalg.svd(j * scale[:, None], full_matrices=False)
    assert told.weakest["rms_change_Nm"] == pytest.approx(0.1 * s[-1] / math.sqrt(240), rel=1e-7)
    direction = np.array([*told.weakest["direction"].values()])
    assert np.abs(direction @ v[-1]) == pytest.approx(1, abs=2e-3)
    assert all(x == round(x, 3) for x in direction)


def test_in_a_direction_without_effect_those_are_infinite_that_take_part():
    plant = linear(VALUES)
    # Of two that do the same, as shares of their values, neither is known; the others are.
    plant.basis["m"] = plant.basis["beta_1_rad"] * 0.5 / 3.9
    plant.measured = plant.torque(VALUES) + plant.noise
    told = uncertainty(plant, VALUES)
    infinite = {k for k, s in told.sigma.items() if s == math.inf}
    assert infinite == {"beta_1_rad", "m"}
    assert told.weakest["rms_change_Nm"] == pytest.approx(0, abs=1e-9)
    # One without any effect, all alone.
    plant = linear(VALUES)
    plant.basis["k1_Nm_rad"] = np.zeros(240)
    plant.measured = plant.torque(VALUES) + plant.noise
    infinite = {k for k, s in uncertainty(plant, VALUES).sigma.items() if s == math.inf}
    assert infinite == {"k1_Nm_rad"}


@pytest.mark.parametrize("unit", [1e4, 1e-4])
@pytest.mark.parametrize(("share", "lost"), [(5e-10, True), (2e-9, False)])
def test_an_effect_counts_from_a_thousand_millionth_of_the_strongest_on(unit, share, lost):
    values = {"k1_Nm_rad": 10.0, "k3_Nm_rad3": 240.0}
    plant = linear(values)
    plant.weight = np.full(240, 1 / math.sqrt(240))
    columns = np.linalg.qr(np.random.default_rng(3).normal(size=(240, 3)))[0]
    for k, column, size in zip(values, columns.T, (1.0, share), strict=False):
        plant.basis[k] = unit * size * column / values[k]
    plant.measured = plant.torque(values) + 1e-3 * unit * share * columns[:, 2]
    asked = []
    plant_torque = plant.torque
    plant.torque = lambda v: asked.append(dict(v)) or plant_torque(v)
    told = uncertainty(plant, values)
    assert [told.sigma[k] == math.inf for k in values] == [False, lost]
    # By a thousandth of each number, either way.
    moved = [v["k3_Nm_rad3"] for v in asked if v["k3_Nm_rad3"] != 240.0]
    assert moved == pytest.approx([240.24, 239.76], rel=1e-12)


def test_what_is_fixed_or_at_a_bound_is_not_free():
    values = VALUES | {"eps2": 0.013, "alpha_Nm_rad": 0.0, "B": 1000.0, "kv_Nm_rad": 0.5, "odd": 1}
    assert free_keys(values) == ["k1_Nm_rad", "k3_Nm_rad3", "beta_1_rad", "kv_Nm_rad", "m", "n"]
    own = VALUES | {"eps2": 0.013, "B": 1000.0}
    plant = linear(VALUES)
    told = uncertainty(plant, own)
    # In the order of the model; what is not free has none.
    assert list(told.sigma) == ["k1_Nm_rad", "k3_Nm_rad3", "beta_1_rad", "m", "B", "n", "eps2"]
    assert {k for k, s in told.sigma.items() if s is None} == {"B", "eps2"}
    none = uncertainty(plant, dict.fromkeys(VALUES, 0.0) | {"eps2": 1.0})
    assert none.resampled is None
    assert set(none.sigma.values()) == {None}


# Parameters.


def test_the_number_that_is_fixed_is_the_published_elbows(elbow):
    assert elbow.file.elastomer.maxwell.eps2.value == EPS2_DEFAULT == 0.013


@pytest.mark.parametrize(
    ("key", "ends"),
    [
        ("k1_Nm_rad", (0, 1000)),
        ("k3_Nm_rad3", (0, 2500)),
        ("omega_rad", (1e-6, 0.1)),
        ("m", (0, 4)),
        ("n", (0, 1)),
        ("eps1_Nms_rad", (1e-6, 1)),
    ],
)
def test_bounds_are_those_of_the_device_file_and_a_millionth_is_at_them(key, ends):
    low, high = bounds_of(key)
    assert (low, high) == ends
    assert at_bound(key, high * (1 - 0.99e-6)) == at_bound(key, 2 * high) == "upper"
    assert at_bound(key, high * (1 - 1.01e-6)) is None
    assert at_bound(key, low) == at_bound(key, -1.0) == "lower"
    assert at_bound(key, low * (1 + 0.99e-6)) == "lower"
    assert at_bound(key, low * (1 + 1.01e-6) + 1e-300) is None


def test_other_numbers_go_where_their_key_is(elbow):
    before = dict(elbow.quantities())
    device = with_values(elbow, {"k1_Nm_rad": 9, "B": 3}, limits={"tau_Nm": 7, "nowhere": 1})
    after = dict(device.quantities())
    changed = {k: after[k].value for k in after if after[k] != before[k]}
    keys = "elastomer.k1_Nm_rad", "elastomer.maxwell.B", "limits.tau_Nm"
    assert changed == dict(zip(keys, (9.0, 3.0, 7.0), strict=True))
    assert {(after[k].status, after[k].source) for k in keys} == {("identified", "trial")}
    assert set(after) == set(before)
    bare = elbow.elastomer.model_copy(update={"maxwell": None})
    put = with_parameters(bare, {"k1_Nm_rad": after[keys[0]], "B": after[keys[1]]})
    assert (put.maxwell, put.k1_Nm_rad.value) == (None, 9.0)


# The play operators.


class Runner:
    """Stands for the compiled operators: kappa (torque + phi) / chi."""

    def __init__(self) -> None:
        self.asked, self.values = [], {}

    def prepare(self, values):
        self.values = values

    def run(self, inputs, trace=True):
        assert not trace
        v = self.values
        self.asked.append(v)
        y = v["kappa_rad"] * (inputs["tau_Nm"] + v["phi_1_rad"]) / v["chi_rad"]
        return {"theta_rad": y}, None


def recording(label: str, *training: range, count: int = 60) -> Recording:
    rng = np.random.default_rng(len(label))
    t, theta, tau = np.arange(count) * 0.01, rng.normal(size=count), rng.normal(size=count)
    sets = tuple(
        DataSet(f"{label}{i}", 0.1, np.array(r, dtype=np.intp), np.arange(0), {}, None, None, None)
        for i, r in enumerate(training)
    )
    return Recording(label, f"{label}.csv", "", t, theta, tau, True, 0, (), sets)


@pytest.fixture
def compiled(monkeypatch):
    """The runner, and the device that it is of; no compiler is needed."""
    runner, devices = Runner(), []
    block = SimpleNamespace(name="plays")

    def inverse_system(device, given):
        assert given is block
        devices.append(device)
        return "system"

    def compile_system(system, number):
        assert (system, number) == ("system", "f64")
        return SimpleNamespace(block=lambda name: {"plays": runner}[name])

    monkeypatch.setattr(plays, "published_inverse", lambda _, tunable: block if tunable else None)
    monkeypatch.setattr(plays, "inverse_system", inverse_system)
    monkeypatch.setattr(plays, "compile_system", compile_system)
    return runner, devices


def test_play_operators_are_fitted_at_the_rows_that_train(elbow, compiled):
    runner, devices = compiled
    a, b, c = (
        recording("a", range(5, 15), range(30, 50)),
        recording("bb"),
        recording("ccc", range(40)),
    )
    plant = PlayPlant(elbow, [a, b, c])
    assert devices[0].file.limits.theta_rad.value == 1000.0
    rows = [a.theta_rad[5:15], a.theta_rad[30:50], c.theta_rad[:40]]
    np.testing.assert_array_equal(plant.measured, np.concatenate(rows))
    # A third of the weight for each data set.
    expected = np.sqrt(np.repeat([1 / 30, 1 / 60, 1 / 120], [10, 20, 40]))
    np.testing.assert_allclose(plant.weight, expected, rtol=1e-12)
    tau = np.concatenate([a.tau_Nm[5:15], a.tau_Nm[30:50], c.tau_Nm[:40]])
    assert plant.evaluations == 0
    np.testing.assert_allclose(plant.set_point(0.5, 2.0, 4.0), 0.5 * (tau + 2) / 4, rtol=1e-12)
    assert plant.evaluations == 1
    assert runner.asked == [{"kappa_rad": 0.5, "phi_1_rad": 2.0, "chi_rad": 4.0}] * 2
    # Of fewer rows: every third of twenty, so that there are seven at most.
    thin = PlayPlant(elbow, [a], rows=7)
    np.testing.assert_array_equal(
        thin.measured, np.concatenate([a.theta_rad[5:15:2], a.theta_rad[30:50:3]])
    )


def test_the_weight_of_the_play_operators_is_a_closed_form(elbow, compiled):
    a, c = recording("a", range(5, 15), range(30, 50)), recording("ccc", range(40))
    plant = PlayPlant(elbow, [a, c])
    unit = plant.set_point(1.0, 2.0, 4.0)
    plant.measured = 0.7 * unit + 0.1
    squares = plant.weight**2
    kappa, error = plant.solve(2.0, 4.0)
    assert kappa == pytest.approx(0.7 + 0.1 * (squares @ unit) / (squares @ unit**2), rel=1e-9)
    np.testing.assert_allclose(error, plant.weight * (kappa * unit - plant.measured), atol=1e-12)
    # From 0 to 5 rad.
    for wanted, kept in ((-0.3, 0.0), (6.0, 5.0)):
        plant.measured = wanted * unit
        assert plant.solve(2.0, 4.0)[0] == kept
    plant.set_point = lambda *_: np.zeros(70)
    assert plant.solve(2.0, 4.0)[0] == 0.0


def spread_plant(basis: np.ndarray, measured: np.ndarray, weight: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(
        measured=measured, weight=weight, set_point=lambda *v: basis @ np.array(v)
    )


def test_the_play_operators_deviations_are_of_weighted_rows():
    rng = np.random.default_rng(6)
    basis, weight = rng.normal(size=(60, 3)), np.repeat([0.5, 1.5], 30)
    weight = weight / math.sqrt(float(weight @ weight))
    values = {"kappa_rad": 0.4, "phi_1_rad": 2.5, "chi_rad": 0.3}
    noise = np.convolve(rng.normal(size=64), np.ones(5), "valid")
    w = basis * weight[:, None]
    noise -= basis @ np.linalg.lstsq(w, noise * weight, rcond=None)[0]
    plant = spread_plant(basis, basis @ [*values.values()] + noise, weight)
    sigma, correlation = play_spread(plant, values)
    r = noise * weight
    rho = float(r[1:] @ r[:-1] / (r @ r))
    covariance = np.linalg.inv(w.T @ w) * float(r @ r) / 57 * (1 + rho) / (1 - rho)
    deviation = np.sqrt(np.diag(covariance))
    assert [sigma[k] for k in values] == pytest.approx(deviation, rel=1e-5)
    # By a ten-thousandth of each number, either way.
    asked, given = [], plant.set_point
    plant.set_point = lambda *v: asked.append(v[0]) or given(*v)
    play_spread(plant, values)
    assert [v for v in asked if v != 0.4] == pytest.approx([0.40004, 0.39996], rel=1e-12)
    expected = covariance[1, 0] / deviation[0] / deviation[1]
    assert correlation["phi_1_rad kappa_rad"] == pytest.approx(expected, rel=1e-5)


def test_what_tells_no_deviation_of_the_play_operators():
    values = {"kappa_rad": 0.4, "phi_1_rad": 2.5, "chi_rad": 0.3}
    none = (dict.fromkeys(values), {})
    rng = np.random.default_rng(6)
    basis, weight = rng.normal(size=(60, 3)), np.full(60, 1 / math.sqrt(60))
    noise = rng.normal(size=60)
    exact = basis @ [*values.values()]
    # No error at all; two that do the same; all at a bound.
    assert play_spread(spread_plant(np.zeros((60, 3)), np.zeros(60), weight), values) == none
    basis[:, 2] = 0.5 * basis[:, 0]
    assert play_spread(spread_plant(basis, exact + noise, weight), values) == none
    ends = {"kappa_rad": 0.0, "phi_1_rad": 5.0, "chi_rad": 1e-6}
    assert play_spread(spread_plant(basis, exact + noise, weight), ends) == none
    # As many rows as numbers: one is counted as left.
    few = spread_plant(np.eye(3), np.array([0.5, 2.6, 0.3]), np.full(3, 1 / math.sqrt(3)))
    sigma, _ = play_spread(few, values)
    # Errors 0.1, 0.1 and 0: alike by a half, of which a third at most may count: 2 at most.
    assert sigma["kappa_rad"] == pytest.approx(
        math.sqrt(0.02 * (1 + 1 / 3) / (1 - 1 / 3)), rel=1e-4
    )


@pytest.mark.parametrize(("third", "known"), [(5e-9, False), (2e-8, True)])
@pytest.mark.parametrize("unit", [1.0, 1e-10])
def test_a_direction_is_known_from_a_thousand_millionth_of_the_strongest_on(third, known, unit):
    values = {"kappa_rad": 1.0, "phi_1_rad": 1.0, "chi_rad": 0.5}
    rng = np.random.default_rng(2)
    columns = np.linalg.qr(rng.normal(size=(60, 3)))[0] * unit * [10.0, 1.0, third]
    basis = columns / [*values.values()]
    measured = basis @ [*values.values()] + 1e-3 * unit * rng.normal(size=60)
    sigma, _ = play_spread(spread_plant(basis, measured, np.full(60, 1 / math.sqrt(60))), values)
    assert (sigma["kappa_rad"] is not None) == known


@pytest.mark.parametrize("k3", [0.5, 3.0])
def test_play_operators_reach_as_far_as_the_cubic_spring(k3):
    rubber = SimpleNamespace(
        k1_Nm_rad=SimpleNamespace(value=1.0), k3_Nm_rad3=SimpleNamespace(value=k3)
    )
    torque = np.array([0.1, -(0.5 + k3 * 0.5**3)])  # at 0.5 rad
    low, high = play_space(SimpleNamespace(elastomer=rubber), [SimpleNamespace(tau_Nm=torque)])
    assert np.exp([low[1], high[1]]) == pytest.approx([1e-4, 0.5], rel=1e-9)
    assert (low[0], high[0]) == (0.0, 5.0)


def test_ends_of_the_play_operators_numbers():
    for key, ends in (("kappa_rad", (0, 5)), ("phi_1_rad", (0, 5)), ("chi_rad", (1e-6, 1))):
        assert play_bounds(key) == ends
        near = 1e-4 * ends[1] if key != "chi_rad" else 1e-9
        assert play_at_bound(key, ends[1] - 0.99 * near) == "upper"
        assert play_at_bound(key, ends[1] - 1.01 * near) is None
        assert play_at_bound(key, ends[0] + 0.99 * near) == "lower"
        assert play_at_bound(key, ends[0] + 1.01 * near) is None


def test_the_range_of_phi_is_by_a_hundredth_of_the_least_error_whatever_that_is():
    low, high = np.array([0.0, -8.0]), np.array([10.0, -2.0])
    for floor in (0.01, 50.0):

        def solve(phi, chi, floor=floor):
            # 1 % more is reached 2.5 away from phi = 4; where chi is off by 1.4 it is refitted.
            rise = floor * (1 + 0.01 * ((phi - 4) / 2.5) ** 2)
            return 0.0, np.array([rise, 3 * floor * (math.log(chi) + 5 + 0.56 * (phi - 4))])

        plant = SimpleNamespace(solve=solve)
        # Refitted up to 1.5 in the logarithm: 2.68 from phi = 4.
        assert phi_range(plant, np.array([4.0, -5.0]), low, high) == (2.0, 6.0)
        far = np.array([4.3, -5.17])
        assert phi_range(plant, far, low, high)[0] == 2.0

    # Just below and just above a hundredth: at 2 and at 6.
    rises = {2.0: 0.00995, 6.0: 0.01005}
    plant = SimpleNamespace(
        solve=lambda phi, chi: (0.0, np.array([7 * (1 + rises.get(phi, 0.0)), math.log(chi) + 5]))
    )
    rises |= {p: 1.0 for p in np.linspace(0, 10, 11).tolist() if p not in (2.0, 4.0, 6.0)}
    assert phi_range(plant, np.array([4.0, -5.0]), low, high) == (2.0, 4.0)
