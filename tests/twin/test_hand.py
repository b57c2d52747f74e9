"""A hand between two drives: energy balance, limits of its matrices, and against single axes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.device import load_device
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.model.sensing import of_axis
from esea_gen.twin.hand import HANDS, CoupledHand, hand_variant, random_hand, wrist
from esea_gen.twin.mechanics import WORKS
from esea_gen.twin.parameters import plant_tunables
from esea_gen.twin.people import PlantVariant
from esea_gen.twin.stepped import SteppedTwin

DEVICE = load_device("wrist_drive")
AXES = DEVICE.axes


def commands(tick, size=0.1):
    return [size * math.sin(0.013 * tick), size * math.cos(0.007 * tick)]


def paths(tick):
    return [
        {
            "theta_p_rad": 0.4 * math.sin(w * tick * 1e-3),
            "omega_p_rad_s": 0.4 * w * math.cos(w * tick * 1e-3),
            "alpha_p_rad_s2": -0.4 * w * w * math.sin(w * tick * 1e-3),
            "noise": math.sin(3 * w * tick),
        }
        for w in (5.0, 3.0)
    ]


@pytest.mark.parametrize("plant", ["ideal", "real"])
@pytest.mark.parametrize("hand", [HANDS["stiff"], HANDS["limp"], random_hand(3)])
def test_the_energy_balance_closes(plant, hand):
    moved = SteppedTwin(hand_variant(DEVICE, plant, "uncertain", 1))
    moved.start([0.0, 0.0], person=hand)
    largest = 0.0
    for tick in range(3000):
        push = [{**p, "tau_Nm": 1.5 * math.sin(0.01 * tick + i)} for i, p in enumerate(paths(tick))]
        moved.intend(push)
        moved.step(commands(tick))
        truth = moved.truth()
        works = {k: sum(truth[of_axis(f"work_{k}_J", a)] for a in AXES) for k in WORKS}
        put = works["motor"] + works["person"] + works["disturbance"]
        missing = put - works["loss"] - works["elastomer"] - truth["stored_J"]
        size = sum(abs(x) for x in works.values()) + truth["stored_J"]
        largest = max(largest, abs(missing) / max(size, 0.5))
    assert size > 0.5
    assert largest < 0.01


def test_without_coupling_it_is_two_single_axes():
    people = random_hand(5).people
    bare = CoupledHand(people, ends_rad=((-3.0, 3.0), (-0.2, 0.3)))
    two = SteppedTwin(hand_variant(DEVICE, "real", "uncertain", 2).having(**bare.values(AXES)))
    alone = DeviceData(DEVICE.file.model_copy(update={"axes": ()}), DEVICE.origin)
    known = {t.name for t in plant_tunables(alone, True)}
    for i, axis in enumerate(AXES):
        own = {
            n: two.variant.values[of_axis(n, axis)]
            for n in known
            if of_axis(n, axis) in two.variant.values
        }
        one = SteppedTwin(PlantVariant(alone, True, own))
        one.start([0.0], clamped=False, person=people[i])
        two.start([0.0, 0.0])
        for tick in range(1500):
            two.intend(paths(tick))
            one.intend([paths(tick)[i]])
            counts = two.step(commands(tick))
            same = one.step([commands(tick)[i]])
        read = [counts[of_axis(f"count_{side}", axis)] for side in ("motor", "load", "gear")]
        assert read == list(same.values())
        for name in ("theta_l_rad", "theta_m_rad", "tau_e_Nm", "omega_l_rad_s"):
            assert two.truth()[of_axis(name, axis)] == pytest.approx(one.truth()[name], abs=1e-9)


@settings(max_examples=200, deadline=None)
@given(st.floats(0.0, 60.0), st.floats(0.0, 2.0), st.floats(0.001, 0.1), st.floats(0.1, 5.0))
def test_matrices_are_positive_definite(stiffness, damping, inertia, scale):
    made = wrist(stiffness, damping, Jh_kgm2=inertia, passive_scale=scale)
    for matrix in made.matrices().values():
        assert np.all(np.linalg.eigvalsh(matrix) > 0)
    values, vectors = np.linalg.eigh(made.matrices()["stiffness"])
    # Softest between extension with radial deviation and flexion with ulnar deviation.
    assert math.degrees(math.atan2(*vectors[::-1, 0])) % 180 == pytest.approx(20.0)
    assert values[1] > values[0]


@pytest.mark.parametrize(
    "wrong",
    [{"inertia_cross_kgm2": 0.01}, {"damping_cross_Nms_rad": 1.0}, {"passive_cross_Nm_rad": -5.0}],
)
def test_a_matrix_that_is_not_positive_definite_is_rejected(wrong):
    with pytest.raises(UserError, match="not positive definite"):
        replace(HANDS["ideal"], **wrong)


def test_stiffness_couples_the_axes():
    # A muscle torque of flexion alone turns the other axis as well, as the matrix says.
    hand = replace(HANDS["limp"], ends_rad=((-3.0, 3.0), (-3.0, 3.0)))
    moved = SteppedTwin(hand_variant(DEVICE, "ideal", "limp", 0))
    moved.start([0.0, 0.0], person=hand)
    moved.intend([{"theta_p_rad": 0.0, "tau_Nm": 1.0}, {"theta_p_rad": 0.0}])
    for _ in range(8000):
        moved.step([0.0, 0.0])
    truth = moved.truth()
    angles = [truth[of_axis("theta_l_rad", a)] for a in AXES]
    torques = [1.0 + truth["tau_e_flexion_Nm"], truth["tau_e_deviation_Nm"]]
    assert np.array(hand.matrices()["stiffness"]) @ angles == pytest.approx(torques, abs=2e-2)
    assert abs(angles[1]) > 0.05


def test_a_clamped_axis_stays_and_the_other_moves():
    moved = SteppedTwin(hand_variant(DEVICE, "ideal", "limp", 0))
    moved.start([0.1, -0.1], clamped=[True, False])
    for _ in range(500):
        moved.step([0.1, 0.1])
    truth = moved.truth()
    assert truth["theta_l_flexion_rad"] == 0.1
    assert truth["theta_l_deviation_rad"] != -0.1
