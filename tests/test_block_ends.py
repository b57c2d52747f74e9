"""What the control's and the observers' Blocks decide just at an end, and a hair beyond it."""

from __future__ import annotations

from functools import cache
from math import exp, inf, nan, nextafter

import numpy as np
import pytest

from esea_gen.control.adaptation import adaptation
from esea_gen.control.ahead import ahead
from esea_gen.control.governor import smoothed_setpoint, torque_lead
from esea_gen.control.horizon import Horizon
from esea_gen.control.impairment import impairment
from esea_gen.control.law_switch import law_switch
from esea_gen.control.passivity import passivity
from esea_gen.control.redundancy import redundancy
from esea_gen.control.reference import reference
from esea_gen.control.setpoint import setpoint_rates
from esea_gen.control.sliding_mode import sliding_mode
from esea_gen.device import load_device
from esea_gen.language.ports import threshold
from esea_gen.observe.cable import cable_observer
from esea_gen.observe.disturbance import drive_observer
from esea_gen.observe.human import extended_state, lag_observer
from esea_gen.observe.rates import motor_rate
from esea_host.wrist.rig import impaired_device

from .test_linear_loop import variant

MOTOR_NM = threshold(0.221)


def above(x):
    return nextafter(x, inf)


@cache
def made(make, *more):
    """A Block of the shipped drive."""
    return make(load_device("elbow_drive"), *more)


class Step:
    """One step of a Block from a memory; inputs that are not given are as near to 0 as may be."""

    def __init__(self, block, state=None, tunables=None, **inputs):
        simulator = block.simulator(tunables or {})
        simulator.state = {k: np.atleast_1d(v) for k, v in (state or {}).items()}
        quiet = {
            p.name: np.full(p.size, np.clip(0.0, p.low, p.high)) if p.size > 1 else max(p.low, 0.0)
            for p in block.inputs
        }
        self.y = simulator.step(**(quiet | inputs))
        self.s = {k: float(np.ravel(v)[0]) for k, v in simulator.state.items()}
        flags = [f.name for p in block.outputs for f in p.flags]
        self.flags = {f for i, f in enumerate(flags) if int(self.y["status"]) >> i & 1}


def test_of_a_mode_that_is_between_the_lower_one_holds():
    block = made(reference)
    for mode, taken in ((0.5, 0), (above(0.5), 1), (1.5, 1), (above(1.5), 2)):
        assert Step(block, mode=mode).y["mode"] == taken
    block = made(torque_lead)
    for mode, acts in ((0.5, False), (above(0.5), True), (nextafter(1.5, 0), True), (1.5, False)):
        y = Step(block, mode=mode, trust=1.0, settled=1.0).y
        assert (y["governed"] > 0) == acts
    block = ahead(load_device("elbow_drive"), Horizon(2), given=False, one_layer=True)
    for mode, stiff in ((1.5, 0), (above(1.5), 2.0)):
        assert Step(block, mode=mode, Kp_Nm_rad=2.0).y["Kp_Nm_rad"] == stiff
    block = made(sliding_mode)
    for mode, flags in ((0.5, set()), (above(0.5), {"ACTIVE", "ENTERED"})):
        assert Step(block, mode=mode).flags == flags
    block = made(passivity)
    for mode, on in ((0.5, False), (above(0.5), True)):
        step = Step(block, mode=mode, sensing_ok=1.0)
        assert (step.y["damping_Nms_rad"] > 0, "DAMPED" in step.flags) == (on, on)
    # The wanted damping counts in impedance mode: of 2 Nm, 0.3 Nms/rad at 4 rad/s take 1.2.
    given = {"sensing_ok": 1.0, "tau_Nm": 2.0, "Kd_Nms_rad": 0.3, "omega_load_rad_s": 4.0}
    for mode, error in ((1.5, 2.0), (above(1.5), 0.8)):
        assert Step(block, mode=mode, **given).s["error_last_Nm"] == pytest.approx(error)
    # So does the stiffness: what it asks for behind the motor's lag is damped at 6 Nm/W.
    state, N = {"square_rad2_s2": 1.0, "damping_Nms_rad": 0.1}, exp(-0.001 / 0.4)
    for mode, least in ((1.5, 0.01), (above(1.5), 0.01 + 0.03488 * 2)):
        step = Step(block, state, mode=mode, sensing_ok=1.0, Kp_Nm_rad=2.0)
        change = 1e-3 * (6 * least * N + (0.35 - 0.1) * 0.04**2) / (N + 0.04**2)
        assert step.s["damping_Nms_rad"] == pytest.approx(0.1 + change, rel=1e-6)
    for mode, shown in ((nextafter(1.5, 0), 2), (1.5, 1.5)):
        step = Step(block, {"square_rad2_s2": 1.0}, mode=mode, sensing_ok=1.0)
        assert step.y["mode_ahead"] == shown
    block = made(cable_observer)
    usable = {"motor_usable": 1.0, "gear_usable": 1.0}
    for mode, gap in ((1.5, 0.006), (above(1.5), 0)):
        assert Step(block, mode=mode, **usable).y["gap_rad"] == pytest.approx(gap)


def test_what_is_true_by_half():
    for block, names in (
        (made(cable_observer), ("motor_usable", "gear_usable")),
        (made(redundancy), ("motor_usable", "gear_usable")),
    ):
        assert "NOT_COMPARED" not in Step(block, **dict.fromkeys(names, 0.5)).flags
        for name in names:
            less = dict.fromkeys(names, 0.5) | {name: nextafter(0.5, 0)}
            assert "NOT_COMPARED" in Step(block, **less).flags
    block = made(passivity)
    for sensed, seen in ((0.5, 0), (above(0.5), 1)):
        assert Step(block, sensing_ok=sensed).s["seen"] == seen
    # Only from a good sample to the next one does the error's power count.
    given = {"mode": 1.0, "sensing_ok": 1.0, "tau_Nm": 2.0, "theta_load_rad": 0.001}
    for before, counts in ((0.5, False), (above(0.5), True)):
        assert (Step(block, {"seen": before}, **given).s["power_W"] > 0) == counts
    block = made(adaptation)
    for sensed, weighed in ((nextafter(0.5, 0), 0), (0.5, 1)):
        step = Step(block, tunables={"mass_Nm": 1.0}, sensing_ok=sensed)
        assert step.s["weighed"] == weighed
    assert Step(block, tunables={"mass_Nm": 0.0}, sensing_ok=1.0).s["weighed"] == 0
    block = made(redundancy)
    given = {"motor_usable": 1.0, "gear_usable": 1.0, "theta_gear_rad": 0.25}
    for zeroed, apart in ((0.5, 0), (above(0.5), 0.25)):
        assert Step(block, {"zeroed": zeroed}, **given).y["apart_rad"] == apart
    block = impairment(impaired_device())
    for asked, on in ((0.5, 0), (above(0.5), 1)):
        assert Step(block, constrained=asked).y["acts"] == on
        moving = Step(block, {"on": asked}, omega_rad_s=0.2, constrained=1.0 - on)
        assert moving.y["acts"] == on


def test_a_law_that_was_hardly_off_goes_on_from_its_set_torque():
    state = {"mode_last": 0.5, "tau_set_Nm": 1.0}
    step = Step(made(reference), state, mode=1.0, tau_Nm=3.0)
    assert step.y["tau_set_Nm"] == pytest.approx(exp(-0.001 / 0.2))
    state["mode_last"] = nextafter(0.5, 0)
    assert Step(made(reference), state, mode=1.0, tau_Nm=3.0).y["tau_set_Nm"] == 3.0


@pytest.mark.parametrize("side", [1, -1])
def test_what_is_just_at_its_limit_is_not_clipped(side):
    """Torques and rates of the drive's numbers, from a memory that stands still there."""
    motor, most = side * MOTOR_NM, side * threshold(74 * 0.221 / 0.663)
    held = {"primed": 1.0, "d4_rad_s2": most}
    usual = {"bandwidth_1_s": 0.0}
    assert Step(made(drive_observer), held, usual).flags == set()
    held = {"primed": 1.0, "tau_h_Nm": side * 20.0}
    assert Step(made(lag_observer), held, usual).flags == set()
    assert Step(made(reference), {}, {"tau_range_Nm": 2.0}, tau_Nm=side * 2.0).flags == set()
    beyond = side * above(2.0)
    assert Step(made(reference), {}, {"tau_range_Nm": 2.0}, tau_Nm=beyond).flags == {"CLIPPED"}
    switch = made(law_switch, ("one", "other"))
    assert Step(switch, u_one_Nm=motor).flags == set()
    assert Step(switch, {"offset_Nm": side * 1e-9}, u_one_Nm=motor).flags == {"CLIPPED"}
    plain = made(setpoint_rates, "differences")
    assert Step(plain, {"primed": 1.0}, theta_set_rad=side * 0.025).flags == set()
    beyond = side * above(0.025)
    assert Step(plain, {"primed": 1.0}, theta_set_rad=beyond).flags == {"RATE_CLIPPED"}
    rate = made(motor_rate)
    assert Step(rate, {"omega_held_rad_s": side * 12.0}, theta_rad=nan).flags == {"INPUT_INVALID"}
    beyond = Step(rate, {"omega_held_rad_s": side * above(12.0)}, theta_rad=nan)
    assert beyond.flags == {"INPUT_INVALID", "RATE_CLIPPED"}
    (angle,) = rate.inputs
    reach = threshold(0.05 * (angle.high - angle.low) / 0.001)
    assert "STEP_CLIPPED" not in Step(rate, {"omega_held_rad_s": side * reach}).flags
    beyond = Step(rate, {"omega_held_rad_s": side * above(reach)})
    assert "STEP_CLIPPED" in beyond.flags


@pytest.mark.parametrize("side", [1, -1])
def test_the_persons_observer_at_its_limits(side):
    block = made(extended_state)
    high = {p.name: p.high for p in block.outputs}
    for state, limit, flag in (
        ("omega_rad_s", "omega_load_rad_s", "OMEGA_CLIPPED"),
        ("tau_h_Nm", "tau_h_Nm", "TORQUE_CLIPPED"),
        ("rate_Nm_s", "tau_h_rate_Nm_s", "TORQUE_RATE_CLIPPED"),
    ):
        at = side * high[limit]
        assert Step(block, {"primed": 1.0, state: at}).flags == set()
        if flag != "TORQUE_RATE_CLIPPED":  # memory has room beyond
            assert Step(block, {"primed": 1.0, state: at * (1 + 1e-12)}).flags == {flag}
    port = next(p for p in block.state if p.name == "theta_rad")
    end = port.high if side > 0 else port.low
    resting = {"primed": 1.0, "theta_rad": end}
    assert Step(block, resting, theta_load_rad=nan).flags == {"INPUT_INVALID"}
    going = resting | {"omega_rad_s": side * 1e-3}
    step = Step(block, going, theta_load_rad=nan)
    assert step.flags == {"INPUT_INVALID", "ANGLE_CLIPPED"}
    assert (step.s["theta_rad"], step.s["omega_rad_s"]) == (end, 0)
    # Away from the end the rate is kept: by a push that turns it round within the step.
    step = Step(block, going, theta_load_rad=nan, tau_Nm=-side * 0.3)
    assert step.s["omega_rad_s"] == pytest.approx(side * 1e-3 - side * 1e-3 * 0.3 / 0.22)


def test_the_smoothing_begins_above_a_hundredth():
    block = made(smoothed_setpoint)
    state = {"primed": 1.0, "first_rad": 0.1}
    for governed, first in ((0.01, 0.2), (above(0.01), 0.2 - 0.1 * exp(-0.003 / 0.07))):
        step = Step(block, state, theta_set_rad=0.2, governed=governed)
        assert step.s["first_rad"] == pytest.approx(first)


def test_a_drive_as_fast_as_the_bound_reckons_with_is_not_too_fast():
    block = made(passivity)
    most = next(c.value for c in block.constants if c.name == "omega_most_rad_s")
    assert most == pytest.approx((2 * 4 / 0.663) ** 0.5)
    for side in (1, -1):
        assert "FAST" not in Step(block, omega_motor_rad_s=side * most).flags
        assert "FAST" in Step(block, omega_motor_rad_s=side * above(most)).flags
    # As much wanted damping as may be added: none is.
    high = {p.name: p.high for p in block.inputs}["Kd_Nms_rad"]
    assert "DAMPED" not in Step(block, mode=2.0, sensing_ok=1.0, Kd_Nms_rad=high).flags


def test_a_mass_is_compared_up_to_the_horizontal_and_a_little_beyond():
    names = ("weighed", "weight_lag_Nm", "tau_lag_Nm", "stop_known_Nm", "square_Nm2")
    for angle, flags in ((1.6, {"LEARNS"}), (above(1.6), set())):
        step = Step(
            made(adaptation),
            dict.fromkeys(names, 1.0),
            {"mass_Nm": 1.0},
            theta_load_rad=angle,
            tau_Nm=1.0,
            sensing_ok=1.0,
        )
        assert step.flags == flags


def test_comparisons_of_encoders_and_torques_at_their_room():
    block = redundancy(variant(redundancy__torque_Nm=4 * 0.663))
    usable = {"motor_usable": 1.0, "gear_usable": 1.0}
    zeroed = {"zeroed": 1.0}
    for side in (1, -1):
        assert Step(block, zeroed, theta_gear_rad=side * 0.06, **usable).flags == set()
        beyond = Step(block, zeroed, theta_gear_rad=side * above(0.06), **usable)
        assert beyond.flags == {"ANGLES_PART"}
        assert Step(block, zeroed, d_gear_rad_s2=side * 4.0, **usable).flags == set()
        beyond = Step(block, zeroed, d_gear_rad_s2=side * 4.000001, **usable)
        assert beyond.flags == {"TORQUES_PART"}


def test_the_cable_is_at_an_end_above_the_torque_of_contact():
    block = cable_observer(variant(cable__contact_Nm=0.25))
    usable = {"motor_usable": 1.0, "gear_usable": 1.0}
    for tau, shown in ((0.25, (0, 0)), (above(0.25), (1, 0)), (-0.25, (0, 0))):
        step = Step(block, tau_Nm=tau, **usable)
        assert (step.s["high_shown"], step.s["low_shown"]) == shown
    step = Step(block, tau_Nm=-above(0.25), **usable)
    assert (step.s["high_shown"], step.s["low_shown"]) == (0, 1)


def test_a_wall_begins_behind_its_place_and_holds_the_allowed_torque():
    block = impairment(impaired_device())
    tunables = {"wall_rad": 0.25, "tau_max_Nm": 1.0, "Kv_Nms_rad": 2.0}
    on = {"on": 1.0}
    for angle, inside in ((0.25, set()), (above(0.25), {"IN_WALL"})):
        step = Step(block, on, tunables, theta_rad=angle, constrained=1.0)
        assert step.flags == inside
    for omega, held in ((0.5, set()), (above(0.5), {"SATURATED"})):
        for side in (1, -1):
            step = Step(block, on, tunables, omega_rad_s=side * omega, constrained=1.0)
            assert step.flags == held
    rest = threshold(0.1)
    for side in (1, -1):
        for omega, acts in ((rest, 1), (above(rest), 0)):
            step = Step(block, {}, tunables, omega_rad_s=side * omega, constrained=1.0)
            assert step.y["acts"] == acts


def test_the_sliding_mode_at_the_edge_of_its_layer_and_of_its_commands():
    block = made(sliding_mode)
    active = {"active": 1.0}
    for side in (1, -1):
        for surface, left in ((2.0, set()), (above(2.0), {"LAYER_LEFT"})):
            state = active | {"integral_rad_s": side * surface}
            step = Step(block, state, {"phi_rad_s": 2.0}, mode=1.0)
            assert step.flags & {"LAYER_LEFT"} == left
    for soft, flags in ((0.01, set()), (above(0.01), {"SOFTENED"})):
        step = Step(block, active | {"soft": soft}, mode=1.0)
        assert step.flags & {"SOFTENED"} == flags
    # Held back by no more than a thousandth of the motor's torque is not held back.
    small = threshold(1e-3 * MOTOR_NM)
    for side in (1, -1):
        for lacks, rests in ((small, set()), (above(small), {"INTEGRAL_RESTS"})):
            state = active | {"u_last_Nm": side * lacks, "u_before_Nm": side * 0.1}
            step = Step(block, state, mode=1.0, delta_set_rad=side * 1e-6)
            assert step.flags & {"INTEGRAL_RESTS"} == rests
        # Of two commands as near, the one before counts.
        state = active | {"u_last_Nm": -side * 0.1, "u_before_Nm": side * 0.1}
        step = Step(block, state, mode=1.0, delta_set_rad=side * 1e-6)
        assert "INTEGRAL_RESTS" in step.flags
