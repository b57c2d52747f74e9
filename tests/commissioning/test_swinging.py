"""Adaptation: a wrong statement fails in the check that names it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.studies.torque_check.procedure import KnownLoad
from esea_host.commissioning import SimulatedHands, StepOptions, run_step, simulated_bench, steps_of
from esea_host.commissioning.startup import DriveRecording
from esea_host.commissioning.swinging import (
    SwungMass,
    hangs_within,
    judged_swings,
    require_masses,
    wanted_Nm,
)

H, HANGS_RAD, LOSS = 0.001, 1.2, -0.05
MASSES = KnownLoad(1.2, 0.3), KnownLoad(0.6, 0.3)


def stop_operator(x: np.ndarray, r: float = 0.8) -> np.ndarray:
    """By its definition (3.5 to 3.7): sums of increments, clipped."""
    e, out, last = 0.0, np.zeros_like(x), x[0]
    for k, value in enumerate(x.tolist()):
        e = min(max(value - last + e, -r), r)
        out[k], last = e, value
    return out


def swung(
    drive,
    stated_Nm: float,
    *,
    gain: float = 1.1,
    motor: float = 1.0,
    weight_Nm: float = 0.0,
    load: float = 1.0,
    tilt_rad: float = 0.0,
    damping: float = 0.02,
    offset_Nm: float = 0.0,
    touch_Nm: float = 0.0,
) -> SwungMass:
    """A swing by the equations of motion, without a plant: an arm moves, torques follow."""
    rng = np.random.default_rng(7)
    t = np.arange(40_000) * H
    slow = t > 20
    phase = 2 * math.pi * np.where(slow, 0.125 * t + 2.5, 0.25 * t)
    angle = 0.6 * (0.7 + 0.3 * np.cos(0.2 * math.pi * t)) * np.sin(phase)
    rate = np.gradient(angle, H)
    torque = (load * stated_Nm + weight_Nm) * np.sin(angle)
    torque += 0.06 * stated_Nm * np.gradient(rate, H) + damping * rate
    # A hand that trembles slowly.
    torque += touch_Nm * np.sin(2 * math.pi * 0.9 * t + 3 * np.sin(0.7 * t))
    shown = gain * torque + LOSS * stop_operator(torque) + offset_Nm
    a = drive.file.actuator
    gear = angle + torque / 40
    turning = np.gradient(gear, H)
    asked = torque + a.J_kgm2.value * np.gradient(turning, H) + a.fv_Nms_rad.value * turning
    asked += a.fc_Nm.value * np.tanh(turning / a.coulomb_width_rad_s.value)
    decay = math.exp(-H / a.tau_c_s.value)  # the command behind the motor's lag (5.1)
    late = np.append(asked[1:], asked[-1]) - decay * asked
    u = motor * late / (1 - decay) / a.gear_ratio.value
    angle = angle + HANGS_RAD + tilt_rad
    noise = rng.normal(0, 0.01, len(t))
    return SwungMass(stated_Nm, DriveRecording(H, u, gear, angle, angle), shown + noise)


def judged(drive, **wrong):
    return judged_swings(drive, [swung(drive, m.weight_Nm, **wrong) for m in MASSES], HANGS_RAD)


def failing(found) -> list[str]:
    return [c.what for c in found.checks if not c.passed]


@pytest.mark.parametrize("gain", [0.8, 1.0, 1.3])
def test_gain_loss_and_offset_of_a_rubber_that_is_off(drive, gain):
    found = judged(drive, gain=gain, offset_Nm=0.05, damping=0.15)
    assert not failing(found), failing(found)
    assert found.tunables["gain"] == pytest.approx(gain, rel=0.003)
    # The filter rounds the stop operator's corners.
    assert found.tunables["loss"] == pytest.approx(LOSS, abs=0.015)
    assert found.tunables["offset_Nm"] == pytest.approx(0.05, abs=0.01)
    assert found.found["damping_Nms_rad"] == pytest.approx(0.15, abs=0.01)
    assert found.found["motor_over_known"] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("wrong", "what", "fix"),
    [
        ({"weight_Nm": 0.2}, "weight not stated", "The arm's own weight is missing or wrong"),
        ({"tilt_rad": math.radians(15)}, "angle at which it hangs", "The device is tilted"),
        ({"load": 0.15}, "error of the motor's torque", "agree with each other and not with"),
        ({"motor": 0.2}, "error of the motor's torque", "The sensor agrees with the load"),
        ({"gain": 0.2, "motor": -0.2}, "error of the motor's torque", "with a fixed motor"),
        ({"offset_Nm": 0.15}, "offset", "no hand or cable touches the arm"),
    ],
)
def test_what_was_stated_wrongly_is_named_and_rejected(drive, wrong, what, fix, sign):
    one = ("load", "motor", "gain")
    found = judged(drive, **{"gain": 1.0, **{k: (k in one) + sign * v for k, v in wrong.items()}})
    (first,) = [c for c in found.checks if not c.passed]
    assert first.what.startswith(what)
    assert fix in first.fix
    if "weight_Nm" in wrong:
        assert found.found["weight_not_stated_Nm"] == pytest.approx(sign * 0.2, abs=0.02)
        assert f"(add {'+' if sign > 0 else '-'}0." in first.fix


@pytest.mark.parametrize(
    ("wrong", "what"),
    [
        ({"touch_Nm": 0.1}, "torque that no hanging mass explains"),
        ({"damping": 0.4}, "damping of the joint"),
        ({"gain": 1.5}, "gain, of its bound"),
        ({"gain": 0.7}, "gain, of its bound"),
    ],
)
def test_a_hand_or_another_rubber_is_rejected(drive, wrong, what):
    assert any(w.startswith(what) for w in failing(judged(drive, **wrong)))


def test_a_hand_in_one_swing_only_is_rejected(drive):
    first, second = (m.weight_Nm for m in MASSES)
    swings = [swung(drive, first, weight_Nm=0.4), swung(drive, second)]
    assert "weight not stated" in failing(judged_swings(drive, swings, HANGS_RAD))[0]


def test_masses_and_angles_that_tell_too_little_are_refused(drive):
    for first, second, words in (
        (KnownLoad(0.5, 0.2), KnownLoad(0.25, 0.2), "the adaptation needs 1.6 to 4.47 Nm"),
        (MASSES[0], KnownLoad(1.1, 0.3), "second mass gives 3.24 Nm"),
        (MASSES[0], KnownLoad(0.1, 0.3), "Take about 0.6 kg there"),
    ):
        with pytest.raises(UserError, match=words):
            require_masses(drive, first, second)
    with pytest.raises(UserError, match="against the end of the travel"):
        hangs_within(drive, 0.2)
    still = swung(drive, MASSES[0].weight_Nm)
    still.recording.load_rad[:] = HANGS_RAD
    with pytest.raises(UserError, match=r"swung by 0\.00 rad"):
        judged_swings(drive, [still, still], HANGS_RAD)
    assert abs(wanted_Nm(0.0, 3.5)) == wanted_Nm(40.0, 3.5) == 0.0


@pytest.mark.ci
@pytest.mark.parametrize("arm_Nm", [0.0, 0.6])
def test_on_a_board(simulated_elbow, arm_Nm):
    """Healthy: set on the board. With the arm's weight left out: rejected, nothing is set."""
    simulated_elbow.restart()
    bench = simulated_bench(simulated_elbow)
    bench.change_hands(SimulatedHands(simulated_elbow, arm_Nm=arm_Nm))
    steps = {s.name: s for s in steps_of(bench.board)}
    options = StepOptions(MASSES[0], second=MASSES[1])
    assert run_step(bench, steps["zero"], options).passed
    result = run_step(bench, steps["adaptation"], options)
    assert result.passed == (arm_Nm == 0.0), result.lines()
    values = bench.device.parameters()
    if result.passed:
        assert result.found["gain"] == pytest.approx(1.0, abs=0.01)
        assert values["adaptation.gain"] == pytest.approx(result.found["gain"])
        assert values["adaptation.share"] == 1.0
        return
    assert values["adaptation.gain"] == 1.0
    assert values["adaptation.share"] == 0.0
    assert result.found["weight_not_stated_Nm"] == pytest.approx(arm_Nm, abs=0.03)
    assert "nothing was set" in result.lines()[1]
