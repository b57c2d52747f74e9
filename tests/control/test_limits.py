"""Limits before the motor: semantics and invariants."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.control.limits.block import command_stamp, limits
from esea_gen.control.limits.faults import FAULT_TEXT, OPTIONAL, Fault
from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import CRunner
from esea_gen.language.stream import SPECIAL, single
from tests.limits_model import (
    AT,
    BIT,
    BRISK,
    DELIVER,
    ERRORS,
    EVENT,
    FLAGS,
    REALS,
    SHIPPED,
    STEPS,
    TIES,
    above,
    against_plain_limits,
    calm,
    changed,
    compiled,
    down,
    invariants,
    ran,
    recover,
    stream_of,
    with_value,
)


@pytest.fixture(scope="module")
def brisk(drive) -> Device:
    return changed(drive, energy_J=1.0, energy_window_s=0.05)


@pytest.fixture(scope="module")
def runners(drive) -> dict[str, CRunner]:
    return {real: compiled(drive, real) for real in REALS}


@pytest.fixture(scope="module")
def brisk_runners(brisk) -> dict[str, CRunner]:
    return {real: compiled(brisk, real) for real in REALS}


@pytest.mark.parametrize("real", REALS)
@settings(max_examples=40)
@given(st.lists(EVENT, max_size=9))
def test_any_stream_against_a_plain_state_machine(brisk_runners, real, events):
    against_plain_limits(brisk_runners[real], stream_of(events), BRISK, TIES[real], ERRORS[real])


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_random_bits_on_every_input(runners, seed):
    rng = np.random.default_rng(seed)
    x = {k: rng.integers(0, 2**32, 50, dtype=np.uint32).view(np.float32) for k in SHIPPED.ranges}
    with np.errstate(all="ignore"):
        x = {k: v.astype(float) for k, v in x.items()}
    for runner in runners.values():
        runner.reset()
        y, _ = runner.run(x)
        invariants(y, x, SHIPPED)
        assert np.all(y["u_Nm"] == 0)


# -- each limit alone ------------------------------------------------------------------------------

TRIPS = [
    ("theta_rad", SHIPPED.theta, Fault.DEFLECTION, "DEFLECTION"),
    ("theta_rad", -SHIPPED.theta, Fault.DEFLECTION, "DEFLECTION"),
    ("tau_Nm", 8.0, Fault.TORQUE, "INTERACTION_TORQUE"),
    ("tau_Nm", -8.0, Fault.TORQUE, "INTERACTION_TORQUE"),
    ("omega_load_rad_s", 10.0, Fault.SPEED, "SPEED"),
    ("omega_load_rad_s", -10.0, Fault.SPEED, "SPEED"),
    ("omega_motor_rad_s", 10.0, Fault.SPEED, "SPEED"),
    ("omega_motor_rad_s", -10.0, Fault.SPEED, "SPEED"),
]


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize(("name", "limit", "fault", "flag"), TRIPS)
def test_a_trip_is_one_float_beyond_its_limit(runners, real, name, limit, fault, flag):
    assert not np.any(ran(runners[real], with_value(name, limit))["fault"][3:])
    y = ran(runners[real], with_value(name, above(limit)))
    assert np.flatnonzero(y["status"] & BIT[flag]).tolist() == [AT]
    assert y["u_Nm"][AT - 1] != 0
    assert np.all(y["u_Nm"][AT:] == 0)  # in the very step that saw it, and for good
    assert np.all(y["fault"][AT:] == fault)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize(("end", "sign"), [(SHIPPED.high, 1), (SHIPPED.low, -1)])
def test_range_of_motion(runners, real, end, sign):
    trip = end + sign * SHIPPED.margin
    last = sign * down(abs(trip))  # the last float32 that passes, in both formats
    side, flag = ("high", "ROM_HIGH") if sign > 0 else ("low", "ROM_LOW")
    for inside, fault in ((last, 0), (above(last), Fault.RANGE_OF_MOTION)):
        x = with_value("theta_load_rad", inside)
        x["theta_motor_rad"] = single(x["theta_load_rad"] + 0.05)
        y = ran(runners[real], x)
        assert np.all(y["fault"][AT:] == fault), side
        assert bool(y["status"][AT] & BIT["RANGE_OF_MOTION"]) == bool(fault)
    for push in (0.15, -0.15):
        for share, most in ((2.0, 1.0), (0.5, 0.5), (0.1, 0.1), (0.0, 0.0), (-0.5, 0.0)):
            x = calm()
            x["theta_load_rad"][:] = single(end - sign * share * SHIPPED.margin)
            x["theta_motor_rad"] = single(x["theta_load_rad"] + 0.05)
            x["u_command_Nm"][6:] = single(push)
            y = ran(runners[real], x)
            outward = push * sign > 0
            expected = min(0.15, most * SHIPPED.u) if outward else 0.15
            assert abs(y["u_Nm"][-1]) == pytest.approx(expected, abs=1e-6)
            held = y["status"][-1] & (BIT["ROM_LOW"] | BIT["ROM_HIGH"])
            assert held == (BIT[flag] if outward and expected < 0.15 else 0)
            # No further push within the rate limit's time from anywhere: 0.221/0.05 periods.
            assert y["u_cut_Nm"][-1] == pytest.approx(np.sign(push) * (0.15 - expected), abs=1e-6)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("name", ["omega_load_rad_s", "omega_motor_rad_s"])
@pytest.mark.parametrize("sign", [1, -1])
def test_speed_lets_only_braking_by(runners, real, name, sign):
    for speed, most in ((7.9, 1.0), (8.0, 1.0), (8.5, 0.5), (9.0, 0.0), (9.9, 0.0)):
        for push in (0.221, -0.221):
            x = calm()
            x["tau_Nm"][:] = 0
            x[name][:] = single(sign * speed)
            x["u_command_Nm"][6:] = single(push)
            y = ran(runners[real], x)
            expected = most * SHIPPED.u if push * sign > 0 else SHIPPED.u
            assert abs(y["u_Nm"][-1]) == pytest.approx(expected, abs=1e-6)
            assert bool(y["status"][-1] & BIT["SPEED_LIMITED"]) == (push * sign > 0 and most < 1)
            assert y["fault"][-1] == 0


@pytest.mark.parametrize("real", REALS)
def test_torque_and_rate(runners, real):
    x = calm()
    x["u_command_Nm"][6:] = single(np.where((np.arange(STEPS - 6) // 20) % 2, -0.5, 0.5))
    y = ran(runners[real], x)
    assert np.max(y["u_Nm"]) == np.float32(SHIPPED.u)
    assert np.min(y["u_Nm"]) == -np.float32(SHIPPED.u)
    assert y["u_Nm"][6:11] == pytest.approx([0.05, 0.1, 0.15, 0.2, 0.221])
    assert np.all(y["status"][6:] & BIT["TORQUE_CLIPPED"])
    assert np.flatnonzero(y["status"] & BIT["RATE_LIMITED"])[:5].tolist() == [6, 7, 8, 9, 26]
    assert y["u_lag_Nm"][6] == pytest.approx(0.171)
    # Off: to zero, at the rate limit.
    x["mode"][200:] = 0
    y = ran(runners[real], x)
    assert abs(y["u_Nm"][199:205]) == pytest.approx([0.221, 0.171, 0.121, 0.071, 0.021, 0])


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("sign", [1, -1])
def test_energy_in_the_window(runners, real, sign):
    # 7.5 Nm at 7 rad/s is 52.5 W: 15 J are exceeded in the 286th period.
    x = {k: np.resize(v, 3000) for k, v in calm(3000).items()}
    x["tau_Nm"][1000:1500] = 7.5 * sign
    x["omega_load_rad_s"][1000:1500] = 7.0 * sign
    y = ran(runners[real], x)
    assert np.flatnonzero(y["fault"] == Fault.ENERGY)[0] == 1000 + 285
    assert y["energy_J"][1284] == pytest.approx(285 * 0.0525, rel=1e-5)
    # What was given before the last eleven slots is forgotten, not before the last ten.
    assert y["energy_J"][1599] == pytest.approx(500 * 0.0525, rel=1e-5)
    assert y["energy_J"][2000] == pytest.approx(500 * 0.0525, rel=1e-5)
    assert np.flatnonzero(y["energy_J"][2000:] < 1e-6)[0] == 500
    # Taking energy from the limb gives no credit.
    x["omega_load_rad_s"][500:999] = -7.0 * sign
    x["tau_Nm"][500:999] = 7.5 * sign
    assert np.flatnonzero(ran(runners[real], x)["fault"] == Fault.ENERGY)[0] == 1000 + 285


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 55))
def test_energy_covers_every_interval_up_to_the_window(brisk_runners, seed, length):
    # Any net energy over any interval within the window is at most what the Block holds.
    rng = np.random.default_rng(seed)
    x = calm()
    x["tau_Nm"] = single(rng.uniform(-3, 3, STEPS))
    x["omega_load_rad_s"] = single(rng.uniform(-3, 3, STEPS))
    y = ran(brisk_runners["f64"], x)
    gain = 1e-3 * x["tau_Nm"] * x["omega_load_rad_s"]
    positive = np.maximum(gain, 0)
    sums = np.convolve(gain, np.ones(length))[:STEPS]
    longest = np.convolve(positive, np.ones(55))[:STEPS]
    if length <= 50:
        assert np.all(sums <= y["energy_J"] + 1e-12)
    assert np.all(y["energy_J"] <= longest + 1e-12)


OTHER_CAUSES = [
    ("stop", 1.0, Fault.STOP, "STOPPED"),
    ("stop", 0.3, Fault.STOP, "STOPPED"),
    ("stop", np.nan, Fault.STOP, "STOPPED"),
    ("request_ok", 0.0, Fault.INPUT_INVALID, "INPUT_INVALID"),
    ("request_ok", 0.999, Fault.INPUT_INVALID, "INPUT_INVALID"),
    ("sensing_ok", 0.0, Fault.SENSING, "SENSING_LOST"),
    ("clock_ok", 0.0, Fault.CLOCK, "CLOCK"),
    ("late_level", 129.0, Fault.LATE, "LATE"),
    ("coeffs_ok", 0.0, Fault.COEFFICIENTS, "COEFFICIENTS"),
    *(("doubt", float(k), Fault(15 + k), Fault(15 + k).name) for k in (1, 2, 3)),
    ("doubt", 0.5, Fault.INPUT_INVALID, "INPUT_INVALID"),
    ("mode", 1.5, Fault.INPUT_INVALID, "INPUT_INVALID"),
    ("rearm", 1.5, Fault.INPUT_INVALID, "INPUT_INVALID"),
    ("u_command_Nm", 0.9, Fault.INPUT_INVALID, "INPUT_INVALID"),
    ("control_beat", 0.0, Fault.CONTROL_STALE, "CONTROL_STALE"),
    ("theta_motor_rad", 1.31, Fault.DEFLECTION, "DEFLECTION"),
    *(
        (name, bad, Fault.INPUT_INVALID, "INPUT_INVALID")
        for name in SHIPPED.ranges
        if name != "stop"
        for bad in SPECIAL
    ),
]


@pytest.mark.parametrize("real", REALS)
def test_every_other_cause_zeroes_in_its_own_step(runners, real):
    for name, bad, fault, flag in OTHER_CAUSES:
        x = calm()
        x[name][AT] = bad
        y = ran(runners[real], x)
        assert y["u_Nm"][AT - 1] != 0
        assert np.all(y["u_Nm"][AT:] == 0), (name, bad)
        assert np.all(y["fault"][AT:] == fault), (name, bad)
        # No flag of a limit that only the stand-in for an invalid value is beyond.
        stands = {
            "stop": ["INPUT_INVALID"],
            "sensing_ok": ["SENSING_LOST"],
            "clock_ok": ["CLOCK"],
            "late_level": ["LATE"],
            "coeffs_ok": ["COEFFICIENTS"],
        }.get(name, [])
        causes = sum(BIT[f] for f in FLAGS[:11] + FLAGS[18:] if f not in stands or f == flag)
        assert y["status"][AT] & causes == BIT[flag], (name, bad)


@pytest.mark.parametrize("real", REALS)
def test_a_silent_control_task(runners, real):
    x = calm()
    last = 99 // DELIVER * DELIVER  # ticks 95 to 99 hold the last delivery
    x["control_beat"][95:] = x["control_beat"][last]
    assert np.flatnonzero(ran(runners[real], x)["fault"] == Fault.CONTROL_STALE)[0] == 95 + 25
    # Four deliveries missing are let pass, five not.
    for missing, latches in ((4, False), (5, True)):
        x = calm()
        x["control_beat"][100 : 100 + 5 * missing] = x["control_beat"][99]
        assert np.any(ran(runners[real], x)["fault"][3:]) == latches


# -- the latch -------------------------------------------------------------------------------------


@pytest.mark.parametrize("real", REALS)
def test_it_starts_latched_and_needs_a_request_it_has_not_seen(runners, real):
    x = calm()
    x["rearm"][:] = 5  # a counter that stands anywhere is no request
    assert np.all(ran(runners[real], x)["fault"] == Fault.NOT_ARMED)
    x["rearm"][3:] = 6
    assert np.flatnonzero(ran(runners[real], x)["fault"] == 0)[0] == 3


@pytest.mark.parametrize("real", REALS)
def test_release_needs_everything_at_once_and_restores_nothing(runners, real):
    def after(**at_request) -> dict:
        x = with_value("tau_Nm", 9.0)
        for name in ("mode", "u_command_Nm"):
            x[name][120:130] = 0
        x["rearm"][125:] = 2
        for name, v in at_request.items():
            x[name][125] = single(v)
        y = ran(runners[real], x)
        return {
            "fault": y["fault"][125],
            "u": y["u_Nm"],
            "refused": y["status"] & BIT["REARM_REFUSED"],
        }

    good = after()
    assert good["fault"] == 0
    assert np.all(good["u"][100:130] == 0)
    assert 0 < abs(good["u"][130]) <= 0.05 + 1e-7
    for refused in (
        {"mode": 1}, {"u_command_Nm": 1e-6}, {"stop": 1}, {"tau_Nm": 8.01}, {"sensing_ok": 0},
        {"theta_rad": 0.31}, {"theta_load_rad": 2.9, "theta_motor_rad": 2.9},
        {"omega_load_rad_s": 11}, {"control_beat": 0}, {"tau_Nm": np.nan},
    ):  # fmt: skip
        y = after(**refused)
        assert y["fault"] == Fault.TORQUE, refused
        assert y["refused"][125], refused
        assert np.all(y["u"][100:] == 0), refused  # the request is spent: it does not wait
    assert after(rearm=1)["fault"] == Fault.TORQUE
    jump = with_value("tau_Nm", 9.0)
    jump["mode"][120:] = 0
    jump["u_command_Nm"][120:] = 0
    jump["rearm"][125:] = 3  # not one more
    y = ran(runners[real], jump)
    assert np.all(y["fault"][125:] == Fault.TORQUE)
    assert y["status"][125] & BIT["REARM_REFUSED"]


@pytest.mark.parametrize("real", REALS)
def test_stop_wins_over_a_request_in_the_same_tick(runners, real):
    x = calm()
    x["stop"][3] = 1
    assert np.all(ran(runners[real], x)["fault"] == Fault.NOT_ARMED)
    x = calm()
    x["stop"][AT:] = 1
    recover(x, 120)
    x["stop"][AT:] = 1
    assert np.all(ran(runners[real], x)["fault"][AT:] == Fault.STOP)
    # While released a request changes nothing, and a stop is taken in any mode.
    x = calm()
    x["rearm"][50:] = 2
    x["mode"][60:] = 0
    x["stop"][70] = 1
    y = ran(runners[real], x)
    assert not np.any(y["fault"][3:70])
    assert np.all(y["fault"][70:] == Fault.STOP)


@pytest.mark.parametrize("real", REALS)
def test_the_first_reason_stays(runners, real):
    x = calm()
    x["tau_Nm"][AT] = 9.0
    x["stop"][AT + 1 :] = 1
    x["theta_rad"][AT + 2 :] = np.nan
    assert np.all(ran(runners[real], x)["fault"][AT:] == Fault.TORQUE)
    x = calm()
    x["tau_Nm"][AT], x["omega_load_rad_s"][AT], x["theta_rad"][AT] = 9.0, 11.0, 0.32
    assert ran(runners[real], x)["fault"][AT] == Fault.DEFLECTION  # the smallest number


# -- each limit is armed: raise its maximum, and the same stream passes ----------------------------


def test_every_flag_and_every_fault_is_reached(drive, brisk_runners):
    runner = brisk_runners["f32"]
    reached, faults = 0, set()
    cases = [
        with_value("tau_Nm", 9.0), with_value("theta_rad", 0.32), with_value("stop", 1),
        with_value("omega_load_rad_s", 11), with_value("theta_load_rad", 2.9),
        with_value("sensing_ok", 0), with_value("control_beat", 0), with_value("mode", np.nan),
        stream_of([("drive", AT, 90), ("command", 3), ("rearm", 200, 1)]),
        with_value("clock_ok", 0), with_value("late_level", 255), with_value("coeffs_ok", 0),
        with_value("omega_motor_rad_s", 9.5, 60), with_value("omega_motor_rad_s", -9.5, 60),
        *(with_value("doubt", k) for k in (1, 2, 3)),
    ]  # fmt: skip
    for end in (2.49, -0.14):
        x = calm()
        x["theta_load_rad"][:], x["theta_motor_rad"][:] = single(end), single(end)
        cases.append(x)
    cases[4]["theta_motor_rad"][:] = cases[4]["theta_load_rad"]
    for x in cases:
        runner.prepare({})
        y, _ = runner.run(x)
        reached |= int(np.bitwise_or.reduce(y["status"]))
        faults |= set(y["fault"].astype(int))
    runner.prepare({"tau_max_Nm": np.nan})
    y, _ = runner.run(calm())
    reached |= int(np.bitwise_or.reduce(y["status"]))
    runner.prepare({})
    runner.run({k: v[:AT] for k, v in calm().items()})
    saved = runner.state
    state = saved.copy()
    state["key"] = 1.0
    for disturbed, coefficient in ((state, None), (saved, np.nan)):
        runner.state = disturbed
        if coefficient is not None:
            np.frombuffer(runner.coefficient_memory, saved.dtype["u_last_Nm"])[0] = coefficient
        y, _ = runner.run({k: v[AT:] for k, v in calm().items()})
        reached |= int(np.bitwise_or.reduce(y["status"]))
        faults |= set(y["fault"].astype(int))
    runner.prepare({})
    assert reached == sum(BIT.values())
    assert faults == {int(f) for f in Fault if f not in OPTIONAL}
    assert set(FAULT_TEXT) == set(Fault)
    assert [f.name for f in limits(drive).status_port.flags] == FLAGS


# -- bad devices -----------------------------------------------------------------------------------


def test_devices_that_cannot_be_limited_are_refused(drive, elbow):
    with pytest.raises(UserError, match="safety is missing"):
        limits(elbow)
    with pytest.raises(UserError, match="safety is missing"):
        command_stamp(elbow)
    for safety, message in (
        ({"omega_max_rad_s": 13.0}, "omega_max_rad_s = 13 is not below joint.omega_max_rad_s = 12"),
        ({"rom_margin_rad": 0.6}, "joint.theta_min_rad = -0.6 is not below safety.rom_min_rad"),
        ({"rom_max_rad": 2.9}, "safety.rom_max_rad = 2.9 is not below joint.theta_max_rad = 3"),
        ({"rom_min_rad": 2.5}, "safety.rom_min_rad = 2.5 is not below safety.rom_max_rad = 2.5"),
    ):
        with pytest.raises(UserError, match=message):
            limits(changed(drive, **safety))
