"""Energy and positive-realness against closed-form boundaries of sampled walls."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import brentq

from esea_gen.analysis.gain_region import gain_region, required_damping
from esea_gen.analysis.linear_loop import Controller, LinearPlant, close_loop, linearise
from esea_gen.analysis.passivity import (
    Hand,
    HandRun,
    energy_balance,
    hand_family,
    passivity_map,
)
from esea_gen.analysis.plots import gain_map
from esea_gen.errors import UserError

T = 1e-3
NONE = np.zeros((0, 0))


def mass(m, b, *, rate=False):
    """A mass with friction; the controller sees its angle, and its rate on request."""
    c = np.eye(2) if rate else np.array([[1.0, 0.0]])
    return LinearPlant(
        np.array([[0, 1], [0, -b / m]]),
        np.array([[0], [1 / m]]),
        np.array([0, 1 / m]),
        c,
        np.array([1.0, 0]),
        np.array([0, 1.0]),
    )


def difference_wall(kp, kd, period=T):
    """u = -kp theta - kd (theta - last theta) / T."""
    one = np.ones((1, 1))
    return Controller(0 * one, one, kd / period * one, (-kp - kd / period) * one, period)


def rate_wall(kp, kd, period=T):
    return Controller(NONE, np.zeros((0, 2)), np.zeros((1, 0)), np.array([[-kp, -kd]]), period)


# -- energy ---------------------------------------------------------------------------------------


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), k=st.floats(0, 100), b=st.just(0.0) | st.floats(1e-3, 5))
def test_a_spring_and_damper_take_in_what_they_must(seed, k, b):
    theta = np.cumsum(np.random.default_rng(seed).normal(0, 0.01, 500))
    # The trapezoidal rule is exact for a spring; a damper on the step's own rate takes in
    # b (move)^2 / h, held or not.
    spring = energy_balance(theta, -k * theta, stored_J=0.5 * k * theta[0] ** 2)
    assert spring.absorbed_J == pytest.approx(
        0.5 * k * (theta**2 - theta[0] ** 2), abs=1e-9 * (1 + k)
    )
    assert spring.generated_J == pytest.approx(0, abs=1e-9)
    move = np.diff(theta)
    damper = energy_balance(theta, np.append(-b * move / T, 0.0), held=True)
    assert damper.absorbed_J[-1] == pytest.approx(b * np.sum(move**2) / T)
    assert damper.index == 0
    active = energy_balance(theta, np.append(b * move / T, 0.0), held=True)
    assert active.generated_J == pytest.approx(b * np.sum(move**2) / T)
    assert active.index == pytest.approx(float(b > 0))


def test_energy_refuses_what_is_no_number():
    good = np.zeros(50)
    with pytest.raises(UserError, match="tau_Nm: sample 3"):
        energy_balance(good, np.where(np.arange(50) == 3, np.inf, 0))
    with pytest.raises(UserError, match="49 samples"):
        energy_balance(good, good[:-1])
    with pytest.raises(UserError, match="stored_J"):
        energy_balance(good, good, stored_J=math.nan)
    with pytest.raises(UserError, match="passive hand"):
        Hand("x", damping_Nms_rad=-1.0)


def wall_run(kp, kd, hand, m=0.1, b=0.05, steps=3000, period=5e-3):
    """Mass, hand and sampled wall, stepped exactly; kicked to 1 rad/s."""
    a = np.array(
        [[0, 1], [-hand.stiffness_Nm_rad, -b - hand.damping_Nms_rad]], dtype=float
    ) / np.array([[1], [m + hand.inertia_kgm2]])
    joint = np.zeros((3, 3))
    joint[:2, :2], joint[1, 2] = a, 1 / (m + hand.inertia_kgm2)
    step = expm(joint * period)
    x, theta, tau = np.array([0.0, 1.0]), np.zeros(steps), np.zeros(steps)
    for k in range(steps):
        theta[k] = x[0]
        tau[k] = -kp * x[0] - kd * x[1]
        x = step[:2, :2] @ x + step[:2, 2] * tau[k]
        if abs(x[0]) > 1e6:
            return HandRun(np.full(steps, np.nan), tau)
    return HandRun(theta, tau, held=True)


def test_a_held_spring_gives_out_energy():
    # Held for T, a spring acts half a period late: as a damper of -K T / 2.
    told = []
    result = passivity_map(
        wall_run,
        [1.0, 10.0, 60.0],
        [0.0, 0.05, 0.3],
        hand_family([0.0, 0.2], [0.0], [0.0, 5.0]),
        progress=lambda *x: told.append(x),
    )
    assert told == [(k, 36) for k in range(1, 37)]
    assert result.generated_J.shape == (3, 3, 4)
    assert np.all(result.index[:, 0] > 0)  # no damping in the wall: active whatever the spring
    assert not result.passive[:, 0].any()
    assert result.passive[0].tolist() == [False, True, True]
    # Growth rate (K T/2 - b - B) / 2m: the 0.15 of 60 Nm/rad outweigh 0.05 + 0.05, not 0.05 + 0.3.
    assert result.table()[-1].split() == ["60", ".", ".", "P"]
    assert result.stable[0].all()
    json.dumps(result.to_dict(), allow_nan=False)
    with pytest.raises(UserError, match="does not rise"):
        passivity_map(wall_run, [2.0, 1.0], [0.0], [Hand("none")])
    with pytest.raises(UserError, match="hands: none"):
        passivity_map(wall_run, [1.0], [0.0], [])


def test_runs_that_end_early_count_as_diverging():
    lost = HandRun(np.full(100, np.nan), np.zeros(100))
    result = passivity_map(lambda *_: lost, [1.0], [0.0], [Hand("none")])
    assert result.diverging.all()
    assert np.isinf(result.generated_J).all()
    assert not result.passive.any()


# -- linear: closed-form boundaries ---------------------------------------------------------------


@pytest.mark.parametrize(("kp", "kd"), [(1000.0, 0.0), (500.0, 1.0), (0.0, 0.7), (200.0, 0.3)])
def test_colgates_condition(kp, kd):
    closed_form = kp * T / 2 + kd

    def transfer(z):
        return kp + kd * (z - 1) / (T * z)

    assert required_damping(transfer, T) == pytest.approx(closed_form, rel=1e-6)


def boundary(kp, kd, parts, m=0.1):
    def least(b):
        return close_loop(mass(m, b), difference_wall(kp, kd), parts=parts).passivity()[1] + 1e-9

    full = kp * T / 2 + kd
    return brentq(least, 0.2 * full, 1.5 * full, xtol=1e-5 * full) / full


def test_positive_realness_finds_colgates_boundary():
    # A held spring alone: exact for any number of parts.
    assert boundary(1000.0, 0.0, 1) == pytest.approx(1, abs=2e-4)
    assert boundary(1000.0, 0.0, 3) == pytest.approx(1, abs=2e-4)
    # With a damper the parts' error falls as 1 / parts, so two numbers of parts give the limit.
    coarse, fine = boundary(500.0, 1.0, 4), boundary(500.0, 1.0, 8)
    assert coarse == pytest.approx(1 - 0.578 / 4, abs=0.005)
    assert fine == pytest.approx(1 - 0.578 / 8, abs=0.005)
    assert 2 * fine - coarse == pytest.approx(1, abs=0.005)


@settings(max_examples=60)
@given(
    m=st.floats(0.01, 1.0),
    kp_share=st.floats(0.05, 3.0),
    kd_share=st.floats(0.05, 1.3),
    period=st.sampled_from([1e-3, 5e-3]),
)
def test_stability_of_a_sampled_wall(m, kp_share, kd_share, period):
    # u = -K theta - B omega on a free mass: z^2 - (2 - K T^2/2m - B T/m) z + 1 - B T/m + K T^2/2m.
    # Jury: K T / 2 < B and B < 2 m / T.
    kd = kd_share * 2 * m / period
    kp = kp_share * 2 * kd / period
    if min(abs(kp_share - 1), abs(kd_share - 1)) < 1e-3:
        return
    loop = close_loop(mass(m, 0.0, rate=True), rate_wall(kp, kd, period), parts=1)
    assert loop.stable == (kp_share < 1 and kd_share < 1)
    trace, product = 2 - kp * period**2 / 2 / m - kd * period / m, 1 - kd * period / m
    product += kp * period**2 / 2 / m
    assert loop.radius == pytest.approx(np.max(np.abs(np.roots([1, -trace, product]))), rel=1e-6)


def test_gain_region_is_the_closed_form_triangle():
    # Stable with every hand of inertia 0 or more: the free mass is worst for B, any for K.
    m, period = 0.1, 5e-3
    kp, kd = np.linspace(0.5, 20_000, 12), np.linspace(0.5, 50, 9)
    region = gain_region(
        lambda p, d: (mass(m, 0.0, rate=True), rate_wall(p, d, period)),
        kp,
        kd,
        [Hand("free"), Hand("heavy", 0.3)],
        parts=1,
    )
    expected = (kp[:, None] * period / 2 < kd) & (kd < 2 * m / period)
    assert np.array_equal(region.stable, expected)
    assert expected.any()
    assert not expected.all()
    assert not region.passive[~region.stable].any()
    json.dumps(region.to_dict(), allow_nan=False)
    assert region.table()[-1].startswith("unstable first with:")
    picture = gain_map(region, [("here", 10.0, 1.0)], title="wall")
    cells = picture.axes[0].collections[0].get_array()
    assert np.array_equal(np.asarray(cells).reshape(12, 9) > 0, expected)


def test_map_over_gains_follows_colgate():
    b, m, seen = 1.0, 0.1, []
    kp, kd = np.linspace(0, 2400, 7), np.linspace(0, 1.2, 5)
    region = gain_region(
        lambda p, d: (mass(m, b), difference_wall(p, d)),
        kp,
        kd,
        [Hand("free")],
        parts=8,
        progress=lambda *a: seen.append(a),
    )
    needed = kp[:, None] * T / 2 + kd
    # Certain where the parts' 7 % do not reach.
    clear = (needed < 0.999 * b) | (0.92 * needed > b)
    assert np.array_equal(region.passive[clear], (needed < b)[clear])
    assert seen[-1] == (35, 35)
    # Nyquist is where a damper by differences turns into a spring.
    assert region.least_Hz[0, -1] == pytest.approx(500, rel=0.01)


def test_a_passive_driving_point_is_stable_with_every_hand():
    rng = np.random.default_rng(1)
    plant, controller = mass(0.2, 1.0), difference_wall(600.0, 0.5)
    assert close_loop(plant, controller, parts=8).passivity()[0]
    for _ in range(60):
        j, b, k = 10 ** rng.uniform([-4, -4, -2], [1, 1, 4])
        assert close_loop(plant.holding(Hand("any", j, b, k)), controller).stable
    # An active one is not; here a hand with 10 Nm/rad and its own inertia.
    active = difference_wall(6000.0, 0.0)
    assert not close_loop(plant, active, parts=8).passivity()[0]
    assert not close_loop(plant.holding(Hand("x", 0.01, 0.0, 10.0)), active).stable


def test_a_hand_is_added_in_continuous_time():
    held = mass(0.2, 0.3).holding(Hand("x", 0.5, 1.0, 7.0))
    assert held.a == pytest.approx(np.array([[0, 1], [-7 / 0.7, -1.3 / 0.7]]))
    assert held.b_u.ravel() == pytest.approx([0, 1 / 0.7])
    assert held.b_tau == pytest.approx([0, 1 / 0.7])
    twice = mass(0.2, 0.3).holding(Hand("a", 0.5, 0.0, 7.0)).holding(Hand("b", 0.0, 1.0, 0.0))
    assert twice.a == pytest.approx(held.a)


def test_two_masses_with_an_elastomer_between():
    # Motor 0.663, elastomer 9.39, load 0.22: without controller passive, and its resonance right.
    j, jh, k = 0.663, 0.22, 9.39
    a = np.array(
        [[0, 1, 0, 0], [-k / j, -0.55 / j, k / j, 0], [0, 0, 0, 1], [k / jh, 0, -k / jh, 0]]
    )
    plant = LinearPlant(
        a,
        np.array([[0], [1 / j], [0], [0]]),
        np.array([0, 0, 0, 1 / jh]),
        np.eye(4),
        np.array([0, 0, 1.0, 0]),
        np.array([0, 0, 0, 1.0]),
    )

    def controller(gain, feed=0.0):
        row = gain * np.array([[-1.0, 0, 0, 0]]) + feed * np.array([[k, 0, -k, 0]])
        return Controller(NONE, np.zeros((0, 4)), np.zeros((1, 0)), row, T)

    loop = close_loop(plant, controller(0.0), parts=4)
    passive, least, _ = loop.passivity()
    assert passive
    assert least > -1e-9
    # Low frequencies: both masses move as one.
    y = loop.admittance(0.02)[0, 0]
    s = 2j * np.pi * 0.02
    stiff = k / (1 + k / (j * s * s + 0.55 * s))  # elastomer in series with the motor side
    assert y.sum() == pytest.approx(s / (jh * s * s + stiff), rel=1e-3)
    # Positive feedback of the elastomer's torque beyond the motor's inertia: negative stiffness.
    assert not close_loop(plant, controller(-1.0), parts=4).passivity()[0]


def test_a_constant_is_stable_and_a_drift_is_not():
    idle = Controller(NONE, np.zeros((0, 1)), np.zeros((1, 0)), np.zeros((1, 1)), T)
    assert close_loop(mass(0.1, 0.5), idle).stable  # stays where it was put
    assert not close_loop(mass(0.1, 0.0), idle).stable  # runs away from a push


def test_linearise_recovers_a_linear_step_and_refuses_kinks():
    rng = np.random.default_rng(0)
    a, b, c, d = (rng.normal(size=s) for s in ((3, 3), (3, 2), (1, 3), (1, 2)))

    def step(x, y):
        return a @ x + b @ y, np.tanh(c @ x + d @ y)

    found = linearise(step, np.zeros(3), np.zeros(2), T)
    for got, want in zip((found.a, found.b, found.c, found.d), (a, b, c, d), strict=True):
        assert got == pytest.approx(want, abs=1e-6)
    with pytest.raises(UserError, match="kink"):
        linearise(lambda x, y: (x, np.maximum(y, 0)), np.zeros(1), np.zeros(1), T)
    with pytest.raises(UserError, match="moves from 1"):
        linearise(lambda x, y: (0.5 * x, y), np.ones(1), np.zeros(1), T)


def test_a_step_is_linearised_where_it_rests():
    at, given = np.array([2.0, -3.0]), np.array([5.0, -0.5])
    a, b = np.array([[0.5, 0.25], [-0.125, 0.75]]), np.array([[1.0, -2.0], [3.0, 0.5]])

    def step(x, y, apart=(0.0, 0.0), bend=(0.0, 0.0)):
        bent = bend[0] * abs(x[1] - at[1]) + bend[1] * abs(y[1] - given[1])
        return at + a @ (x - at) + b @ (y - given) + apart, np.array(
            [x[0] * x[1] + y[0] ** 2 + bent]
        )

    found = linearise(step, at, given, T, move=np.array([1e-3, 2e-3, 3e-3, 4e-3]))
    for got, want in ((found.a, a), (found.b, b), (found.c, [[-3, 2]]), (found.d, [[10, 0]])):
        assert got == pytest.approx(np.array(want), abs=1e-9)
    # A billionth of one more than the state's size is rest.
    linearise(lambda x, y: step(x, y, (0.0, 3.9e-9)), at, given, T)
    with pytest.raises(UserError, match=r"state\[1\] moves from -3 to -2\.5 in"):
        linearise(lambda x, y: step(x, y, (0.0, 0.5)), at, given, T)
    with pytest.raises(UserError, match=r"state\[0\] moves"):
        linearise(lambda x, y: step(x, y, (3.2e-9, 0.0)), at, given, T)
    for bend, where in (((1.0, 0.0), "0.002 of state 1"), ((0.0, 1.0), "0.004 of input 1")):
        with pytest.raises(UserError, match=f"kink within {where}"):
            linearise(
                lambda x, y, bend=bend: step(x, y, bend=bend),
                at,
                given,
                T,
                move=np.array([1e-3, 2e-3, 3e-3, 4e-3]),
            )


def test_matrices_that_do_not_fit_are_refused():
    with pytest.raises(UserError, match="Controller of shape"):
        close_loop(mass(0.1, 0.1), rate_wall(1.0, 1.0))
    with pytest.raises(UserError, match=r"Controller\.b"):
        Controller(np.eye(1), np.zeros((2, 1)), np.eye(1), np.eye(1), T)
    good = mass(0.1, 0.1)
    with pytest.raises(UserError, match="no inertia"):
        LinearPlant(good.a, good.b_u, 0 * good.b_tau, good.c_y, good.c_theta, good.c_omega)
    with pytest.raises(UserError, match="not the rate"):
        LinearPlant(good.a, good.b_u, good.b_tau, good.c_y, good.c_theta, 2 * good.c_omega)
    with pytest.raises(UserError, match="finite"):
        LinearPlant(good.a * np.nan, good.b_u, good.b_tau, good.c_y, good.c_theta, good.c_omega)
