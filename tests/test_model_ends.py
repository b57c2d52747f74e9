"""What the Blocks of the coupling and its encoders decide just at an end, and a hair beyond it."""

from __future__ import annotations

from math import ceil, inf, nan, nextafter, pi

import casadi as ca
import pytest

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.language.ports import threshold
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.encoder import encoder, step_max_counts
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.filters import tracking_observer
from esea_gen.model.gear_encoder import gear_encoder
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.joint import deflection
from esea_gen.model.temperature import TemperatureFactor
from esea_gen.model.velocity_properties import velocity_properties

from .test_block_ends import Step, above, made
from .test_linear_loop import variant

SIDES = (1, -1)


def below(x):
    return nextafter(x, -inf)


def drive():
    return load_device("elbow_drive")


def test_a_reference_may_stand_at_an_end_of_the_temperatures():
    for reference in (10.0, 25.0, 40.0):
        TemperatureFactor(reference, 0.001, 10.0, 40.0)
    for reference in (below(10.0), above(40.0), nan):
        with pytest.raises(ValueError, match="is not in the range 10 to 40"):
            TemperatureFactor(reference, 0.001, 10.0, 40.0)
    TemperatureFactor(10.0, 0.001, 10.0, above(10.0))
    with pytest.raises(ValueError, match="is not in the range 10 to 10"):
        TemperatureFactor(10.0, 0.001, 10.0, 10.0)
    TemperatureFactor(0.0, -0.79999, 0.0, 1.0)
    with pytest.raises(ValueError, match=r"falls to 0\.19999"):
        TemperatureFactor(0.0, -0.80001, 0.0, 1.0)


def test_one_sided_rises_have_their_slope_at_zero():
    x = ca.SX.sym("x")
    for side, sign in (("positive", 1), ("negative", -1)):
        slope = ca.Function("f", [x], [Rise("power", 1, side).slope(x)])
        for at, steep in ((0.0, 1), (sign * 5e-324, 1), (-sign * 5e-324, 0)):
            assert float(slope(at)) == steep


def test_a_softened_bend_is_flat_where_it_begins_to_fall():
    """Of x/(1 + x/8)/(1 + x/2): flat at 4, and -16/(sqrt 2 + sqrt 8)^4 at worst."""
    term = Term("spring", Rise("bend", 8.0), softening=Softening("strain", 2.0))
    fitted = FittedMember(Member("it", "It", (term,)), 1.0, (1.0,))
    for reach, least in ((4.0, 0.0), (4.0001, -16 / 324)):
        assert fitted.first_slope_Nm_rad(reach) == pytest.approx(least, abs=1e-15)


def test_the_deflection_is_usable_up_to_its_limit_and_by_half():
    block = made(deflection)
    (theta,) = (p.high for p in block.outputs if p.name == "theta_rad")
    halves = {p.name: 0.5 for p in block.inputs if not p.name.startswith("theta")}
    for side in SIDES:
        step = Step(block, theta_motor_rad=side * theta, **halves)
        assert (step.flags, step.y["sensing_ok"]) == (set(), 1)
        step = Step(block, theta_motor_rad=side * above(theta), **halves)
        assert (step.flags, step.y["sensing_ok"]) == ({"DEFLECTION_OUTSIDE"}, 0)
    for name in halves:
        step = Step(block, **halves | {name: below(0.5)})
        flag = "CONTRADICTED" if name == "agree" else "ENCODER_UNUSABLE"
        assert (step.flags, step.y["sensing_ok"]) == ({flag}, 0)


@pytest.mark.parametrize("side", SIDES)
def test_the_rate_at_its_limit_is_not_clipped(side):
    block = made(tracking_observer)
    (most,) = (p.high for p in block.outputs if p.name == "omega_rad_s")
    assert Step(block, {"v_rad_s": side * most}).flags == set()
    assert Step(block, {"v_rad_s": side * above(most)}).flags == {"RATE_CLIPPED"}
    # Slowing down, the rate is inside and only that of the step's middle beyond.
    slowing = {"v_rad_s": side * (most + 0.004), "a_rad_s2": -side * 10.0}
    middle = most + 0.004 - 0.005
    assert middle < most
    assert Step(block, slowing).flags == set()
    slowing["v_rad_s"] = side * (most + 0.006)
    assert Step(block, slowing).flags == {"RATE_CLIPPED"}


@pytest.mark.parametrize("side", SIDES)
def test_the_torque_sensor_at_the_ends_of_what_was_identified(side):
    block = made(torque_sensor)
    domain = drive().file.domain
    theta = threshold(domain.theta_max_rad.value)
    omega = threshold(domain.omega_max_rad_s.value)
    assert Step(block, theta_rad=side * theta).flags & {"THETA_OUTSIDE"} == set()
    assert "THETA_OUTSIDE" in Step(block, theta_rad=side * above(theta)).flags
    assert Step(block, omega_rad_s=side * omega).flags == set()
    assert Step(block, omega_rad_s=side * above(omega)).flags == {"RATE_OUTSIDE"}
    limits = drive().file.limits
    moved = threshold(threshold(limits.omega_rad_s.value) * 1e-3)
    known = {"primed": 1.0}
    assert "STEP_CLIPPED" not in Step(block, known, theta_rad=side * moved).flags
    assert "STEP_CLIPPED" in Step(block, known, theta_rad=side * above(moved)).flags


@pytest.mark.parametrize("side", SIDES)
def test_an_inverse_takes_a_request_of_full_scale(side):
    block = made(exact_inverse)
    domain = drive().file.domain
    tau = threshold(domain.tau_full_scale_Nm.value)
    known = {"primed": 1.0}
    assert "TORQUE_OUTSIDE" not in Step(block, known, tau_Nm=side * tau).flags
    assert "TORQUE_OUTSIDE" in Step(block, known, tau_Nm=side * above(tau)).flags
    limits = drive().file.limits
    most = threshold(limits.tau_Nm.value)
    assert "REQUEST_CLAMPED" in Step(block, known, tau_Nm=side * above(most)).flags


def test_velocity_properties_at_the_ends_of_the_bandwidth():
    device = drive()
    for hertz in (2.0, 100.0):
        assert velocity_properties(device, hertz).bandwidth_Hz == hertz
    for hertz in (below(2.0), 100.001):
        with pytest.raises(ValueError, match="is outside"):
            velocity_properties(device, hertz)


def settled(**more):
    return {"count_last": 2000.0, "settled": 4.0} | more


def test_an_encoder_takes_a_half_for_less():
    block = made(encoder, "load")
    zero = {"zeroed": 1.0}
    assert Step(block, settled(), zero, count=2000.0).flags == set()
    for word, flags in ((0.5, set()), (above(0.5), {"FRAME_ERROR"})):
        assert Step(block, settled(), zero, count=2000.0, frame_error=word).flags == flags
    for lost, flags in ((0.5, set()), (above(0.5), {"REFERENCE_LOST"})):
        assert Step(block, settled(lost=lost), zero, count=2000.0).flags == flags
    for calibrated, flags in ((0.5, set()), (0.4999, {"NOT_ZEROED"})):
        step = Step(block, settled(), {"zeroed": calibrated}, count=2000.0)
        assert step.flags == flags
    # Of frames that agree three and a half are enough, and more for a jump to be refused.
    for agreed, flags in ((3.5, set()), (below(3.5), {"SETTLING"})):
        step = Step(block, settled(settled=agreed), zero, count=2000.0, frame_error=1.0)
        assert step.flags == flags | {"FRAME_ERROR"}
    for agreed, taken in ((3.5, True), (above(3.5), False)):
        step = Step(block, settled(settled=agreed), zero, count=3000.0)
        assert (step.s["count_last"] == 3000) == taken
    for agreed, odd in ((0.5, False), (above(0.5), True)):
        step = Step(block, settled(settled=agreed), zero, count=3000.0)
        assert ("IMPLAUSIBLE_STEP" in step.flags) == odd
    # Counters snap to whole numbers, halves to the lower one.
    for agreed, now in ((1.5, 2.0), (1.501, 3.0)):
        assert Step(block, settled(settled=agreed), zero, count=2000.0).s["settled"] == now
    for turn, now in ((-3.5, -4), (0.5, 0), (above(0.5), 1), (3.5, 3)):
        assert Step(block, settled(turn=turn), zero, count=2000.0).s["turn"] == now
    for held, now in ((0.5, 1), (0.501, 2)):
        step = Step(block, settled(held=held), zero, count=2000.0, frame_error=1.0)
        assert step.s["held"] == now


def test_an_encoder_follows_as_far_as_the_joint_can_go():
    block = made(encoder, "load")
    step, zero = step_max_counts(drive(), "load"), {"zeroed": 1.0}
    for side in SIDES:
        for held in range(4):
            reach, state = step * (held + 1) + 0.5, settled(held=float(held))
            assert Step(block, state, zero, count=2000 + side * reach).flags == set()
            beyond = Step(block, state, zero, count=2000 + side * (reach + 1e-9)).flags
            assert "IMPLAUSIBLE_STEP" in beyond
            if held:  # not yet a bad frame more
                state = settled(held=held - 0.5)
                assert "IMPLAUSIBLE_STEP" in Step(block, state, zero, count=2000 + reach).flags


def test_half_a_turn_is_gone_without_a_wrap():
    block = made(encoder, "load")
    (count,) = (p for p in block.inputs if p.name == "count")
    half = (count.high + 1) / 2
    for side, last in ((1, 0.0), (-1, half)):
        state = settled(count_last=last)
        at = Step(block, state, {"zeroed": 1.0}, count=last + side * half)
        assert (at.flags, at.s["turn"]) == ({"IMPLAUSIBLE_STEP"}, 0)
    gear = made(gear_encoder)
    (count,) = (p for p in gear.inputs if p.name == "count")
    half = (count.high + 1) / 2
    for side, last in ((1, 0.0), (-1, half)):
        state = {"count_last": last, "started": 1.0}
        step = Step(gear, state, count=last + side * half)
        assert (step.flags, step.s["moved"]) == ({"IMPLAUSIBLE_STEP"}, 0)


def test_an_encoder_counts_turns_up_to_half_a_one_beyond_the_last():
    block = made(encoder, "load")
    last = next(p.high for p in block.inputs if p.name == "count")
    for side, before, now in ((1, last, 0.0), (-1, 0.0, last)):
        for turn, flags in ((3.5, set()), (3.501, {"REFERENCE_LOST"})):
            state = settled(turn=side * turn, count_last=before)
            assert Step(block, state, {"zeroed": 1.0}, count=now).flags == flags


def test_a_gear_encoder_takes_a_half_for_less():
    block = made(gear_encoder)
    state = {"count_last": 100.0, "started": 1.0}
    assert Step(block, state, count=101.0).s["moved"] == 1
    for word, flags in ((0.5, set()), (above(0.5), {"FRAME_ERROR"})):
        assert Step(block, state, count=101.0, frame_error=word).flags == flags
    for started, moved in ((0.5, 0), (above(0.5), 1)):
        step = Step(block, state | {"started": started}, count=101.0)
        assert step.s["moved"] == moved
    (moved,) = (p for p in block.state if p.name == "moved")
    (held,) = (p for p in block.state if p.name == "held")
    for side in SIDES:
        at = state | {"moved": side * moved.high}
        for counts, flags in ((0.5, set()), (0.5 + 1e-6, {"RANGE_LEFT", "NOT_USABLE"})):
            assert Step(block, at, count=100 + side * counts).flags == flags
    for bad, usable in ((held.high - 0.5, 1), (above(held.high - 0.5), 0)):
        step = Step(block, state | {"held": bad}, count=101.0, frame_error=1.0)
        assert step.y["gear_usable"] == usable


def test_a_gear_encoder_follows_as_far_as_the_drive_can_go():
    device = drive()
    a = device.file.actuator
    counts_rad = 2 ** int(a.encoder_bits.value) * a.gear_ratio.value / (2 * pi)
    step_max = ceil(a.omega_max_rad_s.value * 1e-3 * counts_rad) + 1
    block = made(gear_encoder)
    (held,) = (p for p in block.state if p.name == "held")
    (count,) = (p for p in block.inputs if p.name == "count")
    middle = (count.high + 1) / 2
    for side in SIDES:
        for bad in range(int(held.high) + 1):
            reach = step_max * (bad + 1) + 0.5
            state = {"count_last": middle, "started": 1.0, "held": float(bad)}
            step = Step(block, state, count=middle + side * reach)
            assert "IMPLAUSIBLE_STEP" not in step.flags
            assert step.s["moved"] == side * reach
            share = reach / (bad + 1) / counts_rad / 1e-3
            assert step.y["omega_gear_rad_s"] == pytest.approx(
                side * min(share, a.omega_max_rad_s.value * 1.01)
            )
            beyond = Step(block, state, count=middle + side * (reach + 1e-6))
            assert "IMPLAUSIBLE_STEP" in beyond.flags
            if bad:
                state["held"] = bad - 0.5
                step = Step(block, state, count=middle + side * reach)
                assert "IMPLAUSIBLE_STEP" in step.flags


def test_a_joint_of_exactly_a_turn_is_too_wide():
    encoder(variant(joint__theta_max_rad=2 * pi - 1.3001), "load")
    high = 2 * pi - 1.3
    assert high + 0.6 + 2 * 0.35 == 2 * pi
    with pytest.raises(UserError, match=r"spans 6\.28319 rad, not below one turn"):
        encoder(variant(joint__theta_max_rad=high), "load")


def test_steps_that_reach_half_a_turn_exactly_are_refused():
    turn = 2 * pi / 4096
    bits = {"encoder__resolution_bits": 12}
    encoder(variant(**bits, **{"encoder.load__step_max_rad": 511.5 * turn}), "load")
    with pytest.raises(UserError, match="512 counts"):
        encoder(variant(**bits, **{"encoder.load__step_max_rad": 512.5 * turn}), "load")
