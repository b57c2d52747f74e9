"""A plant that is driven tick by tick: its C against the executor, along a path typed again."""

from __future__ import annotations

import math

import pytest

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.twin.people import real_plant
from esea_gen.twin.plant import plant_block, start_state
from esea_gen.twin.published import Person
from esea_gen.twin.stepped import EMPTY, SteppedPlant

from .conftest import require_tool

DEVICE = load_device("elbow_drive")
START_RAD, NOISE = 0.4, 1.7
SHOWN = ("tau_e_Nm", "theta_l_rad", "omega_l_rad_s", "theta_g_rad", "omega_g_rad_s")
PERSON = Person(
    Jh_kgm2=0.07,
    spring_Nm_rad=12.0,
    damping_Nms_rad=0.8,
    feedforward=True,
    own_damping_Nms_rad=0.1,
    gravity_Nm=1.1,
    torque_noise_Nm=0.3,
    torque_noise_Hz=2.5,
)
# Angle, speed and acceleration that the person intends from each tick on.
INTENDED = [(0.4, 0.5, 3.0), (0.41, 0.0, -5.0), (0.42, -0.7, 0.0), (0.43, 0.0, 0.0)]


@pytest.fixture(scope="module")
def variant():
    require_tool("gcc")
    return real_plant(DEVICE, seed=3)


def expected(variant, commands, person, clamped):
    """What the plant shows after each tick of five steps of 0.2 ms."""
    block = plant_block(DEVICE, variant.cable)
    values = {**variant.values, **person.values(), "clamped": float(clamped)}
    known = {t.name for t in block.tunables}
    simulator = block.simulator({k: v for k, v in values.items() if k in known})
    first, _ = start_state(block, START_RAD, {})
    simulator.state = {**simulator.state, **first}
    for (theta, omega, alpha), command in zip(INTENDED, commands, strict=True):
        for j, u in enumerate(command, 1):
            t = 2e-4 * j
            y = simulator.step(
                u_Nm=u,
                theta_p_rad=theta + omega * t + alpha * t * t / 2,
                omega_p_rad_s=omega + alpha * t,
                alpha_p_rad_s2=alpha,
                noise=NOISE,
            )
        yield {n: float(y[n]) for n in SHOWN}


def agrees(plant, y):
    truth = plant.truth()
    assert {n: truth[n] for n in SHOWN} == pytest.approx(y, rel=1e-9, abs=1e-12)
    assert plant.torque_and_speed() == (truth["tau_e_Nm"], truth["omega_l_rad_s"])


@pytest.mark.parametrize("clamped", [False, True])
def test_a_person_who_moves_within_the_tick(variant, clamped):
    plant = SteppedPlant(variant)
    plant.start(START_RAD, clamped=clamped, person=PERSON)
    u = [0.2, -0.1, 0.15, 0.05]
    wanted = expected(variant, [[x] * 5 for x in u], PERSON, clamped)
    for path, command, y in zip(INTENDED, u, wanted, strict=True):
        named = zip(("theta_p_rad", "omega_p_rad_s", "alpha_p_rad_s2"), path, strict=True)
        plant.intend({**dict(named), "noise": NOISE})
        plant.step(command)
        agrees(plant, y)
    if not clamped:
        assert abs(y["theta_l_rad"] - START_RAD) > 1e-5


def test_a_motor_of_another_gain_that_answers_late(variant, monkeypatch):
    """0.7 ms are four steps at most and three and a half are none: rounded to 0.6 or 0.8."""
    monkeypatch.setattr("tests.test_stepped_plant.INTENDED", [(START_RAD, 0.0, 0.0)] * 4)
    plant = SteppedPlant(variant, motor_gain=-0.8, delay_s=0.00059)
    assert (plant.delay_steps, plant.delay_s) == (3, pytest.approx(0.0006))
    plant.start(START_RAD, clamped=True)
    plant.intend(
        {"theta_p_rad": START_RAD, "omega_p_rad_s": 0, "alpha_p_rad_s2": 0, "noise": NOISE}
    )
    a, b, c, d = (-0.8 * x for x in (0.2, -0.1, 0.15, 0.05))
    late = [[0, 0, 0, a, a], [a, a, a, b, b], [b, b, b, c, c], [c, c, c, d, d]]
    wanted = expected(variant, late, EMPTY, True)
    for u, y in zip((0.2, -0.1, 0.15, 0.05), wanted, strict=True):
        plant.step(u)
        agrees(plant, y)
    assert abs(y["omega_g_rad_s"]) > 1e-3


def test_nobody_in_the_joint():
    assert (
        Person(
            Jh_kgm2=0.05,
            spring_Nm_rad=0.0,
            damping_Nms_rad=0.0,
            feedforward=False,
            own_damping_Nms_rad=0.05,
            gravity_Nm=0.3,
            torque_noise_Nm=0.0,
            torque_noise_Hz=2.0,
        )
        == EMPTY
    )


def test_counts_of_encoders_that_count_the_other_way(variant):
    there = SteppedPlant(variant).start(START_RAD, clamped=True)
    sides = ("motor", "load", "gear")
    full = [round(p.high) + 1 for p in SteppedPlant(variant).system.blocks["encoders"].outputs]
    for k, side in enumerate(sides):
        found = SteppedPlant(variant, reversed_encoders=[side]).start(START_RAD, clamped=True)
        turned = list(there)
        turned[k] = (full[k] - there[k]) % full[k]
        assert list(found) == turned
        assert found != there


def test_numbers_outside_are_refused_with_their_ends(variant):
    for gain in (10.0, -10.0, 1e-3):
        assert SteppedPlant(variant, motor_gain=gain).gain == gain
    for gain in (0.0, 10.01, -10.01, math.nan, math.inf):
        with pytest.raises(UserError, match=r"A motor gain of .*\n?.*Give -10 to 10, and not 0"):
            SteppedPlant(variant, motor_gain=gain)
    assert SteppedPlant(variant, delay_s=0.1).delay_steps == 500
    for delay_s in (-1e-6, 0.1002, math.nan):
        with pytest.raises(UserError, match=r"Give 0 to 0.1 s, in whole 0.2 ms"):
            SteppedPlant(variant, delay_s=delay_s)
    plant = SteppedPlant(variant)
    plant.start(START_RAD, clamped=True)
    with pytest.raises(UserError, match=r"plant\.cable_loss = 0\.95 is outside 0 to 0\.9"):
        plant.change(clamped=True, cable_loss=0.95)
