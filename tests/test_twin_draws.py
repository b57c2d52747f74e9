"""What the virtual exoskeleton's seeds draw, and what each family of plants is off by.

Every draw is made a second time from the streams that a seed has: 0 plant, 1 gear, 2 person, 4 what
is off, 5 runs that are missed.  Numbers are those of the standard plants' description.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.device import Device, load_device
from esea_gen.errors import UserError
from esea_gen.twin.off import chosen_families, deviation, off_families, refuse_unknown
from esea_gen.twin.people import (
    gear_disturbance,
    ideal_plant,
    random_person,
    random_plant,
    real_plant,
)
from esea_gen.twin.published import PEOPLE, PLANTS

TURN = 2 * math.pi


@pytest.fixture(scope="module")
def device() -> Device:
    return load_device("elbow_drive")


SEEDS = (0, 7, 123456)


def between(rng, low, high):
    return low + (high - low) * rng.random()


@pytest.mark.parametrize("seed", SEEDS)
def test_what_the_seeds_draw(device, seed):
    # A seed in a published result gives the same plant.
    gear = gear_disturbance(0.7, seed)
    rng = np.random.default_rng([seed, 1])
    bands = [(8, 12), (17, 21), (26, 30), (30, 70), (30, 70), (30, 70)]
    expected = {"gear_disturbance_rms_rad_s2": 0.7}
    for i, (low, high) in enumerate(bands, 1):
        expected[f"wave_{i}_1_rad"] = between(rng, low, high)
        expected[f"phase_{i}_rad"] = between(rng, 0, TURN)
    assert gear == pytest.approx(expected)

    rng = np.random.default_rng([seed, 2])
    person = {
        "Jh_kgm2": between(rng, 0.10, 0.25),
        "spring_Nm_rad": between(rng, 5, 40),
        "damping_Nms_rad": between(rng, 0.5, 3),
        "gravity_Nm": between(rng, 0, 2.5),
        "torque_noise_Nm": between(rng, 0.1, 0.5),
    }
    kept = {"feedforward": 1.0, "own_damping_Nms_rad": 0.1, "torque_noise_Hz": 2.0, "clamped": 0.0}
    assert random_person(seed).values() == pytest.approx(person | kept)

    rng = np.random.default_rng([seed, 0])
    drawn = {
        "fv_Nms_rad": 0.5551 * between(rng, 0.75, 1.25),
        "fc_Nm": 0.4688 * between(rng, 0.75, 1.25),
        "J_kgm2": 0.663 * between(rng, 0.9, 1.1),
        "tau_c_s": 0.03488 * between(rng, 0.8, 1.2),
        "cable_stiffness_Nm_rad": between(rng, 80, 400),
        "cable_backlash_rad": between(rng, 0, 0.02),
        "cable_loss": between(rng, 0.03, 0.20),
    }
    rms = between(rng, 0.3, 0.6)
    rest = {
        "cable_damping_Nms_rad": 1.0,
        "cable_loss_width_rad_s": 0.03,
        "motor_side_inertia_kgm2": 0.003,
        "motor_side_damping_Nms_rad": 0.02,
        "joint_encoder_bits": 12,
        "motor_encoder_bits": 17,
    }
    plant = random_plant(device, seed)
    assert plant.cable
    whole = rest | person | kept | drawn | expected | {"gear_disturbance_rms_rad_s2": rms}
    assert dict(plant.values) == pytest.approx(whole)


def test_the_standard_plants(device):
    real = real_plant(device, "uncertain", 3)
    own = {
        "cable_stiffness_Nm_rad": 150,
        "cable_damping_Nms_rad": 1,
        "cable_backlash_rad": 0.01,
        "cable_loss": 0.1,
        "cable_loss_width_rad_s": 0.03,
        "motor_side_inertia_kgm2": 0.003,
        "motor_side_damping_Nms_rad": 0.02,
        "joint_encoder_bits": 12,
        "motor_encoder_bits": 17,
        "fv_Nms_rad": 1.25 * 0.5551,
        "fc_Nm": 1.25 * 0.4688,
    }
    assert dict(real.values) == pytest.approx(
        own | gear_disturbance(0.45, 3) | PEOPLE["uncertain"].values()
    )
    ideal = ideal_plant(device)
    assert (ideal.cable, dict(ideal.values)) == (False, PEOPLE["ideal"].values())
    assert (real.cable, real.step_s, ideal.step_s) == (True, 2e-4, 2e-4)
    # An encoder of the file that is coarser stays as coarse as it is.
    bits = device.file.encoder.resolution_bits.model_copy(update={"value": 10})
    encoder = device.file.encoder.model_copy(update={"resolution_bits": bits})
    coarse = Device(device.file.model_copy(update={"encoder": encoder}), "x")
    assert real_plant(coarse).values["joint_encoder_bits"] == 10


# What each family of what is off gives, beside the random ones.
OFF = {
    "none": {},
    "rubber-20": {"elastomer_scale": 0.8},
    "rubber-10": {"elastomer_scale": 0.9},
    "rubber+10": {"elastomer_scale": 1.1},
    "rubber+20": {"elastomer_scale": 1.2},
    "hysteresis-x2": {"hysteresis_scale": 2.0},
    "relaxation": {"relaxation_Nm_rad": 3.0, "relaxation_s": 5.0},
    "encoder-0.26deg": 0.26,
    "encoder-1deg": 1.0,
    "friction-x0.5": {"fv_Nms_rad": 0.5 * 0.5551, "fc_Nm": 0.5 * 0.4688},
    "friction-x2": {"fv_Nms_rad": 2 * 0.5551, "fc_Nm": 2 * 0.4688},
    "inertia-30": {"J_kgm2": 0.7 * 0.663},
    "inertia+30": {"J_kgm2": 1.3 * 0.663},
    "lag-x0.5": {"tau_c_s": 0.5 * 0.03488},
    "lag-x2": {"tau_c_s": 2 * 0.03488},
    "delay+1ms": 1,
    "delay+2ms": 2,
    "delay+5ms": 5,
    "delay+10ms": 10,
    "backlash-30mrad": {"cable_backlash_rad": 0.03},
    "missed-1%": 0.01,
    "missed-5%": 0.05,
    "missed-10%": 0.1,
}
RANDOM = ("random", "random-half", "random-missed")


def test_what_each_family_is_off_by(device):
    assert list(off_families()) == [*OFF, *RANDOM]
    for name, wanted in OFF.items():
        found = deviation(name, device, 5)
        values, late, missed = dict(found.values), found.delay_ticks, found.missed_share
        if name.startswith("encoder"):
            rng = np.random.default_rng([5, 4])
            expected = {}
            for side in ("motor", "load"):
                expected[f"{side}_wave_1_rad"] = math.radians(wanted)
                expected[f"{side}_phase_1_rad"] = between(rng, 0, TURN)
        else:
            expected = wanted if isinstance(wanted, dict) else {}
        assert values == pytest.approx(expected)
        assert late == (wanted if name.startswith("delay") else 0)
        assert missed == (wanted if name.startswith("missed") else 0)
    shown = {n: f.meaning for n, f in off_families().items()}
    assert shown["rubber-20"].endswith("rubber -20 %")
    assert shown["inertia+30"].endswith("drive +30 % of the model's")
    assert shown["backlash-30mrad"].endswith("cable 30 mrad")
    assert shown["missed-5%"].startswith("5 % of the control runs")


@pytest.mark.parametrize(("name", "part"), [("random", 1), ("random-half", 0.5)])
@pytest.mark.parametrize("seed", SEEDS)
def test_everything_off_at_once(device, name, part, seed):
    rng = np.random.default_rng([seed, 4])

    def drawn(low, high, model):
        return model + part * (between(rng, low, high) - model)

    def ratio(low, high):
        return math.exp(drawn(math.log(low), math.log(high), 0))

    expected = {
        "elastomer_scale": drawn(0.8, 1.2, 1),
        "hysteresis_scale": drawn(1, 2, 1),
        "relaxation_Nm_rad": drawn(0, 3, 0),
        "fv_Nms_rad": 0.5551 * ratio(0.5, 2),
        "fc_Nm": 0.4688 * ratio(0.5, 2),
        "J_kgm2": 0.663 * drawn(0.7, 1.3, 1),
        "tau_c_s": 0.03488 * ratio(0.5, 2),
        "cable_backlash_rad": drawn(0, 0.03, 0),
    }
    for side in ("motor", "load"):
        expected[f"{side}_wave_1_rad"] = math.radians(drawn(0, 0.26, 0))
        expected[f"{side}_phase_1_rad"] = between(rng, 0, TURN)
    found = deviation(name, device, seed)
    assert dict(found.values) == pytest.approx(expected)
    assert found.delay_ticks == round(part * rng.integers(0, 11))
    assert found.missed_share == 0
    if part == 1:
        missing = deviation("random-missed", device, seed)
        assert dict(missing.values) == pytest.approx(expected)
        assert missing.missed_share == pytest.approx(between(rng, 0, 0.1))


def test_runs_are_missed_at_their_share_but_not_at_the_start(device):
    found = deviation("missed-5%", device, 0)
    missed = found.missed(40_000, 9)
    expected = np.random.default_rng([9, 5]).random(40_000) < 0.05
    assert np.array_equal(missed[100:], expected[100:])
    assert not missed[:100].any()
    assert expected[:100].any()
    assert deviation("none", device, 0).missed(100, 0) is None


def test_lists_of_families(device):
    every = [n for n in OFF if not n.startswith("random")]
    assert chosen_families("all") == every
    assert chosen_families("all", rigid=True) == [n for n in every if "backlash" not in n]
    assert chosen_families("rubber") == [n for n in every if n.startswith("rubber")]
    assert chosen_families("lag-x2, delay, lag") == [
        "lag-x2",
        *(f"delay+{ms}ms" for ms in (1, 2, 5, 10)),
        "lag-x0.5",
    ]
    assert chosen_families("backlash", rigid=True) == ["backlash-30mrad"]
    with pytest.raises(UserError, match="unknown family 'lagg'") as refused:
        chosen_families("lagg")
    said = str(refused.value)
    assert "Did you mean lag?" in said
    assert ". rubber, encoder, friction, inertia, lag, delay, missed stand for all" in said
    with pytest.raises(UserError, match="it is empty"):
        chosen_families(" ")
    off = deviation("backlash", device, 0)
    refuse_unknown("backlash", off, {"cable_backlash_rad"})
    with pytest.raises(UserError, match="no cable_backlash_rad: its cable is rigid"):
        refuse_unknown("backlash", off, {"fc_Nm"})


def test_numbers_of_the_file_that_nothing_above_has():
    assert {k: (v.cable_loss, v.cable_stiffness_Nm_rad) for k, v in PLANTS.twist.items()} == {
        "180": (0.10, 150.0),
        "0": (0.06, 170.0),
        "270": (0.14, 135.0),
    }
    assert PEOPLE["uncertain"].load_velocity_filter_Hz == 10.0
    assert PLANTS.trajectory.backdriven.frequencies_Hz == (0.1, 0.15, 0.2, 0.25)
    limits = PLANTS.unstable
    assert (limits.max_true_error_Nm, limits.max_gear_speed_rad_s) == (3.0, 12.0)
