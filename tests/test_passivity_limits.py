"""Energies, runs and linear loops at the ends of what is passive, stable or taken at all."""

from __future__ import annotations

import math
from types import SimpleNamespace as Of

import numpy as np
import pytest

from esea_gen.analysis.gain_region import GainRegion, gain_region, required_damping
from esea_gen.analysis.linear_loop import Controller, LinearPlant, Loop, close_loop
from esea_gen.analysis.passivity import (
    EnergyBalance,
    Hand,
    HandRun,
    PassivityMap,
    checked_gains,
    energy_balance,
    hand_family,
    passivity_map,
)
from esea_gen.errors import UserError

ONE = np.ones((1, 1))


def test_hands_are_every_combination_in_order():
    found = hand_family([0.0, 0.25], [0.5], [1.0, 2000.0])
    assert [(h.name, h.inertia_kgm2, h.damping_Nms_rad, h.stiffness_Nm_rad) for h in found] == [
        ("J 0, B 0.5, K 1", 0.0, 0.5, 1.0),
        ("J 0, B 0.5, K 2000", 0.0, 0.5, 2000.0),
        ("J 0.25, B 0.5, K 1", 0.25, 0.5, 1.0),
        ("J 0.25, B 0.5, K 2000", 0.25, 0.5, 2000.0),
    ]
    for key in ("inertia_kgm2", "damping_Nms_rad", "stiffness_Nm_rad"):
        for value in (-1e-9, math.inf, math.nan):
            with pytest.raises(UserError, match=f"Hand 'x': {key} is {value}. A passive hand"):
                Hand("x", **{key: value})


@pytest.mark.parametrize(
    ("absorbed", "stored", "exchanged", "generated", "index"),
    [
        ([0.0, 3.0, -1.0, 2.0], 0.0, 8.0, 1.0, 0.125),
        ([0.0, 3.0, -1.0, 2.0], 0.25, 8.0, 0.75, 0.09375),
        ([0.0, 3.0, -1.0, 2.0], 1.0, 8.0, 0.0, 0.0),
        ([0.0, 3.0, -1.0, 2.0], 9.0, 8.0, 0.0, 0.0),
        ([0.0, 1.0, 2.0, 5.0], 0.0, 5.0, 0.0, 0.0),
        ([0.0, 0.0], 0.0, 0.0, 0.0, 0.0),
    ],
)
def test_energy_given_out_beyond_what_was_put_in(absorbed, stored, exchanged, generated, index):
    found = EnergyBalance(np.array(absorbed), stored, exchanged)
    assert (found.generated_J, found.index) == (generated, index)


def test_energy_is_torque_on_the_hand_times_the_way():
    theta, tau = np.zeros(40), np.zeros(40)
    theta[1:4], tau[:4] = (2.0, 1.0, 5.0), (3.0, -1.0, 4.0, 8.0)
    # Ways 2, -1, 4 and -5; held torques 3, -1, 4, 8; means 1, 1.5, 6, 4.
    held = energy_balance(theta, tau, held=True, stored_J=0.5)
    assert held.absorbed_J[:6].tolist() == [0, -6, -7, -23, 17, 17]
    assert (held.exchanged_J, held.stored_J, held.generated_J) == (63, 0.5, 22.5)
    mean = energy_balance(theta, tau)
    assert mean.absorbed_J[:6].tolist() == [0, -2, -0.5, -24.5, -4.5, -4.5]
    assert (mean.exchanged_J, mean.stored_J) == (47.5, 0)
    with pytest.raises(UserError, match=r"stored_J: -0\.1 J\. Give 0 or more"):
        energy_balance(theta, tau, stored_J=-0.1)


def swinging(second, last, n=90):
    third = n // 3
    wave = np.where(np.arange(n) % 2, 1.0, -1.0)
    size = np.concatenate(
        [np.full(third, 5.0), np.full(third, second), np.full(n - 2 * third, last)]
    )
    return HandRun(wave * size, np.zeros(n))


@pytest.mark.parametrize(
    ("second", "last", "diverges"),
    [
        (1.0, 1.0999, False),
        (1.0, 1.1001, True),
        (2.0, 2.199, False),
        (2.0, 2.201, True),
        (2.0, 1.0, False),
        # What rests within a billionth of the largest angle, here 5 rad, rests.
        (0.0, 4.9e-9, False),
        (0.0, 5.1e-9, True),
    ],
)
def test_a_run_diverges_that_swings_a_tenth_more_in_its_last_third(second, last, diverges):
    assert swinging(second, last).diverges is diverges


def test_a_small_angle_rests_within_a_billionth_of_a_radian():
    wave = np.where(np.arange(90) % 2, 1.0, -1.0)
    for last, diverges in ((0.99e-9, False), (1.01e-9, True)):
        theta = np.where(np.arange(90) < 60, 0.0, last * wave)
        assert HandRun(theta, np.zeros(90)).diverges is diverges
    # Of 92 samples the thirds begin at 30 and 60.
    theta = np.zeros(92)
    theta[29], theta[30:60], theta[60:] = 9.0, wave[:30], 1.05 * np.tile([1.0, -1.0], 16)
    assert HandRun(theta, np.zeros(92)).diverges is False
    for bad in (math.nan, math.inf):
        assert HandRun(np.append(np.zeros(89), bad), np.zeros(90)).diverges is True
        assert HandRun(np.zeros(90), np.append(np.zeros(89), bad)).diverges is True


def test_gains_rise():
    assert checked_gains("kp", [0, 1, 5]).tolist() == [0.0, 1.0, 5.0]
    assert checked_gains("kp", [-2.0]).tolist() == [-2.0]
    for wrong, words in (
        ([], "Give a row of finite gains"),
        ([[1.0, 2.0]], "Give a row of finite gains"),
        ([1.0, math.inf], "Give a row of finite gains"),
        ([1.0, 2.0, 2.0], "does not rise. Sort the gains, each once"),
        ([1.0, 3.0, 2.0], "does not rise"),
    ):
        with pytest.raises(UserError, match=f"kp: .*{words}"):
            checked_gains("kp", wrong)


def test_a_map_has_each_run_at_its_gains_and_hand():
    hands = hand_family([0.0, 1.0], [0.0], [0.0])
    given, told = [], []

    def run(kp, kd, hand):
        given.append((kp, kd, hand))
        tau, theta = np.zeros(40), np.zeros(40)
        # Held for one sample: kp + kd joules out by 1 rad, twice that on the way.
        tau[0], theta[1:] = kp + kd + hand.inertia_kgm2, 1.0
        if hand.inertia_kgm2 and kd == 3.0:
            tau[-1] = math.nan
        return HandRun(theta, tau, held=kp < 20, stored_J=0.5)

    found = passivity_map(
        run, [10, 20], [1, 2, 3], hands, tolerance=0.1, progress=lambda *a: told.append(a)
    )
    wanted = [(kp, kd, h) for kp in (10.0, 20.0) for kd in (1.0, 2.0, 3.0) for h in hands]
    assert given == wanted
    assert told == [(k, 12) for k in range(1, 13)]
    inf = math.inf
    generated = [[[10.5, 11.5], [11.5, 12.5], [12.5, inf]], [[10, 10.5], [10.5, 11], [11, inf]]]
    assert found.generated_J.tolist() == generated
    assert found.index[0, 0].tolist() == pytest.approx([10.5 / 11, 11.5 / 12])
    assert found.index[1, 2].tolist() == [pytest.approx(11 / 11.5), inf]
    assert found.diverging.tolist() == [[[False] * 2, [False] * 2, [False, True]]] * 2
    assert found.tolerance == 0.1
    assert passivity_map(run, [10], [1], hands).tolerance == 1e-6


def test_a_map_is_passive_up_to_its_tolerance():
    index = np.array([[[0.01, 0.0], [0.01, 0.0101]], [[-1.0, 0.0], [0.0, 0.0]]])
    diverging = np.zeros((2, 2, 2), bool)
    diverging[1, 1, 0] = True
    hands = (Hand("a"), Hand("b", 0.5, 0.25, 8.0))
    kp, kd = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    found = PassivityMap(kp, kd, hands, 2 * index, index, diverging, 0.01)
    assert found.passive.tolist() == [[True, False], [True, False]]
    assert found.stable.tolist() == [[True, True], [True, False]]
    assert found.to_dict() == {
        "kp_Nm_rad": [1, 2],
        "kd_Nms_rad": [3, 4],
        "hands": [vars(h) for h in hands],
        "generated_J": (2 * index).tolist(),
        "index": index.tolist(),
        "diverging": diverging.tolist(),
        "stable": [[True, True], [True, False]],
        "passive": [[True, False], [True, False]],
        "tolerance": 0.01,
    }


# -- linear loops ----------------------------------------------------------------------------------

MASS = {
    "a": np.array([[0.0, 1.0], [-6.0, -3.0]]),
    "b_u": np.array([[0.0], [2.0]]),
    "b_tau": np.array([0.0, 2.0]),
    "c_y": np.eye(2),
    "c_theta": np.array([1.0, 0.0]),
    "c_omega": np.array([0.0, 1.0]),
}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"a": np.ones((2, 3))}, r"a: shape \(2, 3\), needs finite values of shape \(2, 2\)"),
        ({"b_u": np.ones((3, 1))}, r"b_u: shape \(3, 1\), needs finite values of shape \(2, 1\)"),
        (
            {"b_u": np.array([0.0, 2.0])},
            r"b_u: shape \(1, 2\), needs finite values of shape \(2, 2\)",
        ),
        ({"c_y": np.ones((1, 3))}, r"c_y: shape \(1, 3\), needs finite values of shape \(1, 2\)"),
        ({"c_y": np.full((1, 2), np.inf)}, "c_y: shape"),
        ({"b_tau": np.ones(3)}, r"b_tau: shape \(1, 3\), needs finite values of shape \(1, 2\)"),
        ({"c_theta": np.ones(1)}, r"c_theta: shape \(1, 1\)"),
        ({"c_omega": np.ones(1)}, r"c_omega: shape \(1, 1\)"),
        # The largest entry is 6: seven billionths are let pass.
        ({"c_omega": np.array([0.0, 1 + 7.1e-9])}, "c_omega is not the rate of c_theta"),
        ({"b_u": np.array([[1e-30], [2.0]])}, "c_omega is not the rate of c_theta"),
        ({"b_tau": np.array([1e-30, 2.0])}, "The driving point has no inertia"),
        ({"b_tau": np.array([0.0, 0.0])}, "The driving point has no inertia"),
        ({"b_tau": np.array([0.0, -2.0])}, "The driving point has no inertia"),
    ],
)
def test_plants_that_are_none_are_refused(change, words):
    LinearPlant(**MASS | {"c_omega": np.array([0.0, 1 + 6.9e-9])})
    with pytest.raises(UserError, match=words):
        LinearPlant(**MASS | change)


@pytest.mark.parametrize("name", ["a", "b", "c", "d"])
def test_controllers_that_are_none_are_refused(name):
    # Three states, two measurements, one output.
    given = {"a": np.eye(3), "b": np.ones((3, 2)), "c": np.ones((1, 3)), "d": np.ones((1, 2))}
    Controller(**given, period_s=0.1)
    for period in (0.0, -1.0, math.inf):
        with pytest.raises(UserError, match="Give a sample period above 0"):
            Controller(**given, period_s=period)
    shape = re_shape(given[name])
    with pytest.raises(UserError, match=rf"Controller\.{name}: shape {shape}, needs finite"):
        Controller(**given | {name: np.full_like(given[name], np.inf)}, period_s=0.1)
    if name != "d":
        with pytest.raises(UserError, match=rf"needs finite .{given[name].shape[0]}, .*without"):
            Controller(**given | {name: np.ones((given[name].shape[0], 5))}, period_s=0.1)


def re_shape(array):
    rows, columns = array.shape
    return rf"\({rows}, {columns}\)"


def a_loop(a):
    n = len(a)
    return Loop(np.array(a, float), np.zeros((n, 1)), np.zeros((1, n)), ONE, 0.1)


@pytest.mark.parametrize(
    ("a", "radius", "stable"),
    [
        ([[0.5, 0.0], [0.0, -0.75]], 0.75, True),
        ([[0.0, 0.6], [-0.6, 0.0]], 0.6, True),
        ([[-1.0]], 1.0, False),
        ([[1.25, 0.0], [0.0, 1.0]], 1.25, False),
        # Constants do not count, nor is anything left where there is nothing else.
        ([[1.0, 0.0], [0.0, 0.3]], 0.3, True),
        ([[1.0, 0.0], [0.0, 1.0]], 0.0, True),
        ([[1.0 + 0.9e-7, 0.0], [0.0, 0.5]], 0.5, True),
        ([[1.0 + 1.1e-7, 0.0], [0.0, 0.5]], 1.0 + 1.1e-7, False),
        # A drift of one constant by the other.
        ([[1.0, 0.25], [0.0, 1.0]], 1.0 + 1e-7, False),
        ([[1.0 - 5e-8, 0.25], [0.0, 1.0 - 5e-8]], 1.0 + 1e-7, False),
        ([[1.0, 0.25, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.5]], 1.5 * (1 + 1e-7), False),
    ],
)
def test_the_largest_eigenvalue_constants_apart(a, radius, stable):
    found = a_loop(a)
    assert found.radius == pytest.approx(radius, rel=1e-12)
    assert found.stable is stable


def test_the_admittance_of_a_loop_of_one_state():
    a, b, c, d, h = 0.5, 3.0, -2.0, 0.25, 0.1
    loop = Loop(a * ONE, b * ONE, c * ONE, d * ONE, h)
    f = np.array([0.5, 2.0, 5.0])
    z = np.array([complex(math.cos(x), math.sin(x)) for x in 2 * math.pi * f * h])
    y = d + c * b / (z - a)
    assert loop.admittance(f).ravel() == pytest.approx(y)
    assert loop.resistance(f) == pytest.approx(y.real / np.abs(y))
    # The second of two states drives the first.
    two = np.array([[0.5, 0.2], [0.0, -0.25]])
    loop = Loop(two, np.array([[0.0], [1.0]]), np.array([[3.0, 0.5]]), d * ONE, h)
    y = d + 0.6 / (z - 0.5) / (z + 0.25) + 0.5 / (z + 0.25)
    assert loop.admittance(f).ravel() == pytest.approx(y)


def test_resistance_is_the_least_of_two_parts():
    # A constant admittance: [[3, 1], [0, 1]]; Hermitian part's eigenvalues 2 -+ sqrt(1.25).
    loop = Loop(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0)), np.array([[3, 1], [0, 1]]), 1)
    assert loop.resistance(0.1) == pytest.approx([(2 - math.sqrt(1.25)) / math.sqrt(11)])
    none = Loop(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.zeros((1, 1)), 1)
    assert none.resistance(0.1).tolist() == [0.0]


@pytest.mark.parametrize(("at_Hz", "depth"), [(1.7, 0.5), (0.013, 1e-3), (4.31, 2.0)])
def test_the_least_resistance_is_found_between_the_first_frequencies(monkeypatch, at_Hz, depth):
    def resistance(self, f):
        return depth * np.log(np.asarray(f) / at_Hz) ** 2 - 0.125

    monkeypatch.setattr(Loop, "resistance", resistance)
    passive, least, found_Hz = a_loop([[0.5]]).passivity()
    assert passive is False
    assert least == pytest.approx(-0.125, abs=1e-6)
    assert found_Hz == pytest.approx(at_Hz, rel=1e-3)


def test_every_frequency_up_to_half_the_rate_is_looked_at(monkeypatch):
    seen = []
    monkeypatch.setattr(Loop, "resistance", lambda self, f: seen.append(f) or np.ones(len(f)))
    a_loop([[0.5]]).passivity()
    first, *finer = seen
    # Of 5 Hz: 200 from a ten thousandth to a tenth, by ratios, and 200 from there, by steps.
    assert len(first) in (399, 400)
    assert (first[0], first[-1]) == pytest.approx((5e-4, 5.0))
    assert first[1] / first[0] == pytest.approx(1000 ** (1 / 199))
    assert first[-1] - first[-2] == pytest.approx(4.5 / 199)
    assert [len(f) for f in finer] == [21, 21]
    assert (finer[0][0], finer[0][-1]) == (first[0], first[1])
    seen.clear()
    monkeypatch.setattr(Loop, "resistance", lambda self, f: seen.append(f) or -np.asarray(f))
    assert a_loop([[0.5]]).passivity() == (False, -5.0, 5.0)
    assert (seen[1][0], seen[1][-1]) == (first[-2], 5.0)


@pytest.mark.parametrize(
    ("a", "least", "passive"),
    [(0.5, -0.99e-9, True), (0.5, -1.01e-9, False), (0.5, 1.0, True), (-1.5, 1.0, False)],
)
def test_a_loop_is_passive_that_is_stable_and_takes_power(monkeypatch, a, least, passive):
    monkeypatch.setattr(Loop, "resistance", lambda self, f: np.full(len(f), least))
    assert a_loop([[a]]).passivity()[:2] == (passive, least)


def test_a_free_mass_over_two_parts_of_a_period():
    # Half a kg m2, 0.2 s: in 0.1 s the rate moves by 0.2, the angle by 0.01 of the torque held.
    plant = LinearPlant(
        np.array([[0.0, 1.0], [0.0, 0.0]]),
        np.array([[0.0, 0.0], [2.0, -1.0]]),
        np.array([0.0, 2.0]),
        np.eye(2),
        np.array([1.0, 0.0]),
        np.array([0.0, 1.0]),
    )
    # Less half of the second, the inputs are 5 s - 3 theta - 7 omega.
    controller = Controller(
        0.25 * ONE,
        np.array([[2.0, 4.0]]),
        np.array([[6.0], [2.0]]),
        np.array([[-2.0, -6.0], [2.0, 2.0]]),
        0.2,
    )
    loop = close_loop(plant, controller, parts=2)
    assert loop.a == pytest.approx(
        np.array([[1 - 0.12, 0.2 - 0.28, 0.2], [-1.2, 1 - 2.8, 2.0], [2.0, 4.0, 0.25]])
    )
    assert loop.b == pytest.approx(np.array([[0.03, 0.01], [0.2, 0.2], [0.0, 0.0]]))
    assert loop.c == pytest.approx(np.array([[-0.3, 1 - 0.7, 0.5], [-0.9, 1 - 2.1, 1.5]]))
    assert loop.d == pytest.approx(np.array([[0.1, 0.0], [0.2, 0.1]]))
    assert loop.period_s == 0.2


def test_parts_and_shapes_of_a_closed_loop():
    plant = LinearPlant(**MASS)
    shapes = {"a": np.eye(1) / 2, "b": np.ones((1, 2)), "c": ONE, "d": np.ones((1, 2))}
    loop = close_loop(plant, Controller(**shapes, period_s=0.1), parts=3)
    assert [x.shape for x in (loop.a, loop.b, loop.c, loop.d)] == [(3, 3), (3, 3), (3, 3), (3, 3)]
    assert close_loop(plant, Controller(**shapes, period_s=0.1)).d.shape == (8, 8)
    assert close_loop(plant, Controller(**shapes, period_s=0.1), parts=1).d.shape == (1, 1)
    # A torque moves its own part and those after it.
    assert np.all(np.triu(loop.d, 1) == 0)
    assert np.all(np.diag(loop.d) > 0)
    with pytest.raises(UserError, match=r"with 1 inputs and 2 measurements, 0 parts"):
        close_loop(plant, Controller(**shapes, period_s=0.1), parts=0)


def test_a_hand_takes_its_share_of_what_the_controller_pushes():
    held = LinearPlant(**MASS).holding(Hand("x", 0.75, 0.5, 4.0))
    # Half a kg m2 of its own (b = 2), 1.25 with the hand's; 3 + 4 Nm/rad and 1.5 + 0.5 Nms/rad.
    assert held.a == pytest.approx(np.array([[0, 1], [-7 / 1.25, -2 / 1.25]]))
    assert held.b_u == pytest.approx(np.array([[0], [1 / 1.25]]))
    assert held.b_tau == pytest.approx([0, 1 / 1.25])


# -- over gains ------------------------------------------------------------------------------------


def test_a_region_is_stable_below_one_with_every_hand():
    radius = np.array([[[0.5, 0.999], [1.0, 0.5]], [[0.5, 1.5], [0.0, 0.0]]])
    passive = np.array([[True, False], [True, False]])
    hands = (Hand("a"), Hand("b", 1.0))
    kp, kd = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    found = GainRegion(kp, kd, hands, radius, passive, radius[..., 0], radius[..., 1])
    assert found.stable.tolist() == [[True, False], [False, True]]
    assert found.to_dict() == {
        "kp_Nm_rad": [1, 2],
        "kd_Nms_rad": [3, 4],
        "radius": radius.tolist(),
        "passive": passive.tolist(),
        "least": radius[..., 0].tolist(),
        "least_Hz": radius[..., 1].tolist(),
        "hands": [vars(h) for h in hands],
        "stable": [[True, False], [False, True]],
    }


def test_a_region_has_each_loop_at_its_gains_and_hand(monkeypatch):
    told, asked = [], []

    class Plant:
        def __init__(self, kp, kd, hand=None):
            self.kp, self.kd, self.hand = kp, kd, hand

        def holding(self, hand):
            return Plant(self.kp, self.kd, hand)

    def closed(plant, controller, *, parts):
        asked.append((controller, plant.hand, parts))
        size = plant.kp + 10 * plant.kd
        if plant.hand is None:
            return Of(passivity=lambda: (plant.kd > 0.25, size + 0.1, size + 0.2))
        return Of(radius=size + 100 * plant.hand.inertia_kgm2)

    monkeypatch.setattr("esea_gen.analysis.gain_region.close_loop", closed)
    hands = (Hand("a"), Hand("b", 1.0))
    found = gain_region(
        lambda kp, kd: (Plant(kp, kd), f"{kp:g} {kd:g}"),
        [1, 2, 3],
        [0.2, 0.3],
        iter(hands),
        parts=5,
        progress=lambda *a: told.append(a),
    )
    sizes = np.array([[3.0, 4.0], [4.0, 5.0], [5.0, 6.0]])
    assert found.radius == pytest.approx(np.stack([sizes, sizes + 100], axis=2))
    assert found.passive.tolist() == [[False, True]] * 3
    assert found.least == pytest.approx(sizes + 0.1)
    assert found.least_Hz == pytest.approx(sizes + 0.2)
    assert found.hands == hands
    assert told == [(k, 6) for k in range(1, 7)]
    # A hand needs no parts of a period.
    assert asked[3:6] == [("1 0.3", hands[0], 1), ("1 0.3", hands[1], 1), ("1 0.3", None, 5)]
    with pytest.raises(UserError, match=r"hands: none\. Give at least one"):
        gain_region(lambda *_: None, [1], [1], [])


@pytest.mark.parametrize("points", [1, 3])
def test_damping_that_a_driving_point_needs(points):
    given = []

    def transfer(z):
        given.append(z)
        return 6.0 / z

    # T/2 / (1 - cos w) Re{(1 - 1/z) 6 / z} = 3 T (cos w - cos 2w) / (1 - cos w), at w up to pi.
    angles = [math.pi * (k + 1) / points for k in range(points)]
    wanted = [3 * 0.5 * (math.cos(w) - math.cos(2 * w)) / (1 - math.cos(w)) for w in angles]
    assert required_damping(transfer, 0.5, points=points) == pytest.approx(max(wanted))
    assert given[0] == pytest.approx(np.exp(1j * np.array(angles)))
    with pytest.raises(UserError, match="Give a sample period above 0"):
        required_damping(transfer, 0.0)
