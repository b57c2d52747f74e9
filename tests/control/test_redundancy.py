"""Motor's encoder, and the comparison of all encoders and the motor's torque."""

from __future__ import annotations

import math

import numpy as np
import pytest

import esea_gen
from esea_gen.control.limits.redundancy import redundancy
from esea_gen.device import Device, parse_device
from esea_gen.errors import UserError
from esea_gen.model.gear_encoder import gear_encoder
from esea_gen.observe.disturbance import gear_observer
from tests.conftest import without
from tests.observe.test_observers import commands, drive_motion, torque

FULL, RATIO, H = 2**17, 74, 1e-3
RAD = 2 * math.pi / (FULL * RATIO)  # of the joint, a count of the shaft
FASTEST = 18526  # counts a tick at 12 rad/s of the joint, by hand: 12e-3 / RAD, rounded up, and one
SPAN = (0.6 + 3.0 + 2 * 0.35) / RAD


def mine(text: str) -> Device:
    head = 'schema = 1\nextends = "elbow_drive"\nname = "mine"\ntitle = "mine"\n'
    return parse_device(head + text, "mine.toml")


def q(value: float) -> str:
    return f'{{ value = {value}, status = "assumed", source = "a test" }}'


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
        gear_encoder(mine(f"[actuator]\nencoder_bits = {q(20)}\n"))
    assert "upper 18 bits" in str(e.value)
    with pytest.raises(UserError, match="half a turn"):
        gear_encoder(mine(f"[actuator]\nomega_max_rad_s = {q(25.0)}\n"))


# -- what the motion leaves unexplained ------------------------------------------------------------


def test_the_unexplained_torque_is_followed_by_a_lag_of_its_rate(drive):
    t, x = drive_motion(0.45, 0.8)
    y, _ = (
        gear_observer(drive)
        .simulator()
        .run({"u_Nm": commands(t), "omega_gear_rad_s": x[:, 0], "tau_Nm": torque(t)})
    )
    assert y["d_gear_rad_s2"] == pytest.approx(0.45 * (1 - np.exp(-20.0 * t)), abs=6e-3)
    # A torque shown by 1 Nm too small: 1 / 0.663 rad/s^2 less than what is there.
    y, _ = (
        gear_observer(drive)
        .simulator()
        .run({"u_Nm": commands(t), "omega_gear_rad_s": x[:, 0], "tau_Nm": torque(t) - 1.0})
    )
    assert y["d_gear_rad_s2"][-1] == pytest.approx(0.45 - 1 / 0.663, abs=6e-3)


# -- the comparison --------------------------------------------------------------------------------


def compared(drive, **given):
    usual = {
        "theta_motor_rad": 1.0,
        "motor_usable": 1.0,
        "theta_gear_rad": 0.0,
        "gear_usable": 1.0,
        "d_gear_rad_s2": 0.0,
        "tau_Nm": 0.0,
        "moves_rad_s2": 0.0,
    }
    steps = max(np.size(v) for v in given.values())
    inputs = {k: np.broadcast_to(given.get(k, v), steps).astype(float) for k, v in usual.items()}
    y, _ = redundancy(drive).simulator().run(inputs)
    return y


@pytest.mark.parametrize("tau", [0.0, 2.0, -6.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_angles_may_be_as_far_apart_as_backlash_and_a_soft_cable_explain(drive, tau, sign):
    # At rest the cable of 150 Nm/rad is wound up by tau/150; 80 Nm/rad is the softest.
    room = 0.06 + abs(tau) * (1 / 80 - 1 / 150)
    taus = np.array([0.0, tau, tau, tau])
    apart = tau / 150 + sign * np.array([0.0, 0.0, room - 1e-5, room + 1e-5])
    y = compared(
        drive, tau_Nm=taus, theta_gear_rad=np.where(taus == 0, 0.0, apart) if tau else apart
    )
    assert y["agree"].tolist() == [1.0, 1.0, 1.0, 0.0]
    assert (y["status"].astype(int) & 8 > 0).tolist() == [False, False, False, True]
    assert y["apart_rad"][3] == pytest.approx(sign * (room + 1e-5), abs=1e-6)


@pytest.mark.parametrize("tau", [0.0, 2.0, -6.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_torques_may_be_as_far_apart_as_friction_and_the_rubbers_model_explain(drive, tau, sign):
    room = 2.2 + 0.25 * abs(tau)
    d = sign * (room + np.array([-1e-4, 1e-4, -1e-4])) / 0.663
    # The cable's torque alone would part the angles: the gear winds it up.
    y = compared(drive, d_gear_rad_s2=d, tau_Nm=tau, theta_gear_rad=tau / 150)
    assert y["agree"].tolist() == [1.0, 0.0, 1.0]  # they may agree again
    assert (y["status"].astype(int) & 16 > 0).tolist() == [False, True, False]
    assert y["apart_Nm"][1] == pytest.approx(sign * room, abs=2e-4)


def test_the_zero_is_set_once_and_angles_stay_parted(drive):
    theta = np.array([0.3, 0.3, 0.35, 0.37, 0.37, 0.3])
    y = compared(drive, theta_gear_rad=theta)
    assert y["apart_rad"] == pytest.approx([0.0, 0.0, 0.05, 0.07, 0.07, 0.0])
    assert y["agree"].tolist() == [1.0, 1.0, 1.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("who", ["motor_usable", "gear_usable"])
def test_without_an_encoder_nothing_is_vouched_for_and_the_zero_is_set_again(drive, who):
    y = compared(
        drive,
        theta_gear_rad=np.array([0.0, 0.2, 0.2, 0.2, 0.2]),
        **{who: np.array([1.0, 1.0, 0.0, 1.0, 1.0])},
    )
    assert y["agree"].tolist() == [1.0, 0.0, 0.0, 1.0, 1.0]
    assert (y["status"].astype(int) & 4 > 0).tolist() == [False, False, True, False, False]
    y = compared(drive, tau_Nm=np.array([0.0, np.nan, 0.0]))
    assert y["agree"].tolist() == [1.0, 0.0, 1.0]


def test_a_corrupt_memory_vouches_for_nothing(drive):
    """Angles 0.3 rad apart: a zero that is lost may not be taken anew over a fault unseen."""
    board = redundancy(drive).simulator()
    sound = {p.name: 0.0 for p in redundancy(drive).inputs} | {"motor_usable": 1, "gear_usable": 1}
    board.step(**sound)
    assert board.step(**sound)["agree"] == 1
    apart = sound | {"theta_gear_rad": 0.3}
    assert board.step(**apart)["agree"] == 0
    board.state = {"zero_rad": np.nan}
    y = board.step(**apart)
    assert y["agree"] == 0
    assert int(y["status"]) & 0b110 == 0b110


# -- the device file -------------------------------------------------------------------------------


def test_a_device_without_the_section_has_two_encoders_and_a_drive_with_it_three(drive):
    text = drive.toml()
    bare = parse_device(without(text, "redundancy", "cable"), "bare.toml")
    names = {x.name for x in bare.system.inputs}
    assert "count_gear" not in names
    assert {"redundancy", "gear", "encoder_gear"} & set(bare.system.blocks) == set()
    assert {x.name for x in drive.system.inputs} - names == {"count_gear", "frame_error_gear"}
    for make in (redundancy, gear_observer):
        with pytest.raises(UserError, match=r"\[redundancy\] is missing"):
            make(bare)


def test_a_softest_cable_that_is_stiffer_is_refused():
    with pytest.raises(UserError, match=r"cable_least_Nm_rad = 200 is above .*cable_Nm_rad = 150"):
        mine(f"[redundancy]\ncable_least_Nm_rad = {q(200.0)}\n")


def test_without_a_drive_there_is_nothing_to_compare():
    elbow = esea_gen.load_device("elbow").toml()
    drive = esea_gen.load_device("elbow_drive").toml()
    with pytest.raises(UserError, match=r"\[redundancy\] compares the drive with the joint"):
        parse_device(
            elbow + without(drive[drive.index("[redundancy]") :], "passivity", "cable"), "m"
        )


@pytest.mark.parametrize(("speed", "taken"), [(20.5, True), (21.3, False)])
def test_with_one_frame_lost_the_way_must_still_be_told(speed, taken):
    """Two periods of 1 ms may turn the shaft by 65535 counts at most: 21.2 rad/s of the joint."""
    counts = math.ceil(speed * H / RAD) + 1
    assert (2 * counts < FULL / 2) is taken
    device = mine(f"[actuator]\nomega_max_rad_s = {q(speed)}\n")
    if taken:
        block = gear_encoder(device)
        assert {c.name: c.value for c in block.constants}["held_max"] == 1
    else:
        with pytest.raises(UserError, match="which way it went could not be told"):
            gear_encoder(device)
