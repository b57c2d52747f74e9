"""Motor's encoder, and the comparison of all encoders and the motor's torque."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.control.limits.redundancy import redundancy
from esea_gen.device import parse_device
from esea_gen.errors import UserError
from esea_gen.model.gear_encoder import gear_encoder
from esea_gen.observe.disturbance import gear_observer
from tests.conftest import without
from tests.own_device import own_device

FULL, RATIO, H = 2**17, 74, 1e-3
RAD = 2 * math.pi / (FULL * RATIO)  # of the joint, a count of the shaft
FASTEST = 18526  # counts a tick at 12 rad/s of the joint, by hand: 12e-3 / RAD, rounded up, and one
SPAN = (0.6 + 3.0 + 2 * 0.35) / RAD


# -- the motor's encoder ---------------------------------------------------------------------------


def turned(drive, travelled, bad=()):
    """Run the Block on a shaft that has travelled so many counts, some frames bad."""
    word = np.zeros(len(travelled))
    word[list(bad)] = 4.0
    inputs = {"count": np.asarray(travelled) % FULL, "frame_error": word}
    y, _ = gear_encoder(drive).simulator().run({k: v.astype(float) for k, v in inputs.items()})
    return y


def path(seed: int, steps: int = 400) -> np.ndarray:
    rng = np.random.default_rng(seed)
    moves = np.round(FASTEST * np.sin(np.cumsum(rng.normal(0, 0.2, steps)))).astype(int)
    return 51234 + np.clip(np.cumsum(moves), -0.9 * SPAN, 0.9 * SPAN).astype(int)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_angle_is_that_of_the_counts_over_many_turns(drive, seed):
    p = path(seed)
    assert np.ptp(p) > 5 * FULL
    y = turned(drive, p)
    assert y["theta_gear_rad"] == pytest.approx((p - p[0]) * RAD, abs=1e-12)
    rate = np.concatenate([[0.0], np.diff(p)]) * RAD / H
    assert y["omega_gear_rad_s"] == pytest.approx(rate, abs=1e-9)
    assert y["gear_usable"].tolist() == [0.0] + [1.0] * (len(p) - 1)
    assert not (y["status"].astype(int) & 0b101111).any()


def test_bad_frames_are_bridged_as_far_as_the_way_round_is_known(drive):
    # Half a turn is 65536 counts: after two bad frames the third may be 3 * 18526 = 55578 away, a
    # fourth would be 74104.
    p = 1000 + 15000 * np.arange(40)
    y = turned(drive, p, bad=(20, 21))
    assert np.all(y["gear_usable"][1:] == 1)
    held = y["theta_gear_rad"]
    assert held[20] == held[21] == held[19]
    assert held[22:] == pytest.approx((p[22:] - p[0]) * RAD, abs=1e-12)
    # The mean of the three: no spike in what is made of it.
    assert y["omega_gear_rad_s"][19:] == pytest.approx(15000 * RAD / H, rel=1e-9)
    assert np.flatnonzero(y["status"].astype(int) & 4).tolist() == [20, 21]
    y = turned(drive, p, bad=(20, 21, 22))
    assert np.flatnonzero(y["gear_usable"] == 0).tolist() == [0, 22, 23]
    lost = 4 * 15000  # moved from frame 19 to 23, which starts again
    assert y["theta_gear_rad"][23:] == pytest.approx((p[23:] - lost - p[0]) * RAD, abs=1e-12)


def test_a_jump_is_held_and_then_starts_again(drive):
    p = np.full(30, 70000)
    p[10:] += FASTEST + 1
    y = turned(drive, p)
    assert y["status"].astype(int)[10] & 8
    assert y["theta_gear_rad"][10] == 0
    # One tick later so much is possible: it is taken.
    assert y["theta_gear_rad"][11:] == pytest.approx((FASTEST + 1) * RAD, abs=1e-12)
    far = np.full(30, 70000)
    far[10:] += 60000  # farther than in three ticks
    y = turned(drive, far)
    assert np.flatnonzero(y["gear_usable"] == 0).tolist() == [0, 12]
    assert np.all(y["theta_gear_rad"] == 0)
    assert np.all(y["omega_gear_rad_s"] == 0)


def test_encoders_whose_turns_cannot_be_counted_are_refused():
    with pytest.raises(UserError, match=r"counts 5\.31e\+07, too many .* 24 bits") as e:
        gear_encoder(own_device(actuator={"encoder_bits": 20}))
    assert "upper 18 bits" in str(e.value)
    with pytest.raises(UserError, match="half a turn"):
        gear_encoder(own_device(actuator={"omega_max_rad_s": 25.0}))


# -- the comparison --------------------------------------------------------------------------------


# -- the device file -------------------------------------------------------------------------------


def test_a_device_without_the_section_has_two_encoders_and_a_drive_with_it_three(drive):
    bare = parse_device(without(drive.toml(), "redundancy", "cable"), "bare.toml")
    names = {x.name for x in bare.system.inputs}
    assert "count_gear" not in names
    assert {"redundancy", "gear", "encoder_gear"} & set(bare.system.blocks) == set()
    assert {x.name for x in drive.system.inputs} - names == {"count_gear", "frame_error_gear"}
    for make in (redundancy, gear_observer):
        with pytest.raises(UserError, match=r"\[redundancy\] is missing"):
            make(bare)


def test_a_softest_cable_that_is_stiffer_is_refused():
    with pytest.raises(UserError, match=r"cable_least_Nm_rad = 200 is above .*cable_Nm_rad = 150"):
        own_device(redundancy={"cable_least_Nm_rad": 200.0})


@pytest.mark.parametrize(("speed", "taken"), [(20.5, True), (21.3, False)])
def test_with_one_frame_lost_the_way_must_still_be_told(speed, taken):
    """Two periods of 1 ms may turn the shaft by 65535 counts at most: 21.2 rad/s of the joint."""
    counts = math.ceil(speed * H / RAD) + 1
    assert (2 * counts < FULL / 2) is taken
    device = own_device(actuator={"omega_max_rad_s": speed})
    if taken:
        assert {c.name: c.value for c in gear_encoder(device).constants}["held_max"] == 1
    else:
        with pytest.raises(UserError, match="the direction would be ambiguous"):
            gear_encoder(device)
