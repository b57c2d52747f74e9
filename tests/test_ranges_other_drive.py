"""Ranges of a drive of which no two numbers are alike, worked out by hand: which one goes where."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.control.adaptation import adaptation
from esea_gen.control.law import Base
from esea_gen.control.law_switch import law_switch
from esea_gen.control.limits import command_stamp, limits
from esea_gen.control.passivity import passivity
from esea_gen.control.redundancy import redundancy
from esea_gen.control.reference import largest_gains, reference
from esea_gen.control.safety import LimitNumbers, command_range
from esea_gen.control.sliding_mode import sliding_mode
from esea_gen.control.trend import motion_limits
from esea_gen.device import parse_device
from esea_gen.devices.fields import field_facts
from esea_gen.errors import UserError
from esea_gen.observe import drive_of, has_drive, human
from esea_gen.observe.cable import cable_observer
from esea_gen.observe.disturbance import (
    bandwidth_limit_1_s,
    drive_observer,
    drive_observer_by_gear,
    gear_observer,
)
from esea_gen.observe.extrapolation import parabola, parabola_weights
from esea_gen.observe.human import error_matrix, extended_state, lag_observer
from esea_gen.observe.rates import cutoff_range, filter_delay_s, load_rate, motor_rate

from .conftest import without
from .test_linear_loop import variant
from .test_passive_block import SHIPPED

H, N, J, FV, FC, JH = 1e-3, 74, 0.663, 0.5551, 0.4688, 0.22
DELTA, RATE, TAU = 0.4, 23.0, 17.0  # plausible, of the coupling
LOW, HIGH = -0.5, 2.9  # of the joint
MOTOR_SPEED, JOINT_SPEED = 13.0, 11.0
PERSON_NM, MOTOR_NM, ALLOWED_NM, FULL_NM = 15.0, 0.25, 0.2, 4.47
PUSH = N * MOTOR_NM / J
CHANGES = {
    "limits__theta_rad": DELTA,
    "limits__omega_rad_s": RATE,
    "limits__tau_Nm": TAU,
    "timing__control_rate_Hz": 250.0,
    "actuator__omega_max_rad_s": MOTOR_SPEED,
    "actuator__u_max_Nm": MOTOR_NM,
    "joint__theta_min_rad": LOW,
    "joint__theta_max_rad": HIGH,
    "joint__omega_max_rad_s": JOINT_SPEED,
    "joint__tau_human_max_Nm": PERSON_NM,
    "joint__motor_velocity_Hz": 40.0,
    "joint__load_velocity_Hz": 35.0,
    "disturbance__decay_s": 0.4,
    "disturbance__human_1_s": 0.75,
    "sliding_mode__fv_share": 0.2,
    "sliding_mode__fc_share": 0.3,
    "sliding_mode__J_unc_kgm2": 0.06,
    "sliding_mode__k1_unc_Nm_rad": 1.4,
    "sliding_mode__k3_unc_Nm_rad3": 1.6,
    "sliding_mode__eta_rad_s2": 0.9,
    "safety__u_max_Nm": ALLOWED_NM,
    "safety__u_rate_Nm_s": 45.0,
    "safety__tau_max_Nm": 7.0,
    "safety__theta_max_rad": 0.29,
    "safety__rom_min_rad": -0.1,
    "safety__rom_max_rad": 2.4,
    "safety__rom_margin_rad": 0.25,
    "safety__omega_max_rad_s": 9.0,
    "safety__energy_J": 12.0,
    "safety__energy_window_s": 0.695,
    "passivity__damping_Nms_rad": 0.32,
    "passivity__energy_J": 3.5,
    "passivity__Kp_max_Nm_rad": 2.5,
    "passivity__Kd_max_Nms_rad": 0.3,
}
A_LOW, A_HIGH = LOW - DELTA, HIGH + DELTA
GEAR_RAD = 1.01 * (A_HIGH - A_LOW)
TURNED_RAD = 1.01 * (GEAR_RAD + A_HIGH)
CABLE_RAD = 1.01 * (1.01 * (TURNED_RAD + TAU / 80) + 0.03)
BLOW = H * (TAU + PERSON_NM) / JH
DECAY_LOW_S, DECAY_HIGH_S = 0.08, 2.0
PERSON_RATE = 2 * PERSON_NM / DECAY_LOW_S
ROOM_RAD = 1.01 * H * (MOTOR_SPEED + BLOW / 2) / 0.179
ERROR_NM = 1.01 * (TAU + FULL_NM + 0.3 * MOTOR_SPEED)
WIDEST_NM = 1.01 * (2 * TAU + 2.5 * (A_HIGH - A_LOW) + 2 * 0.3 * MOTOR_SPEED)
SLOT_J = 1.01 * 0.07 * TAU * JOINT_SPEED
E_RATE, E = RATE + 2 * MOTOR_SPEED, 2 * DELTA
INTEGRAL = E_RATE + 2 * 25 * E
WANTED = 3 * PUSH + (TAU + PERSON_NM) / JH + 2 * 25 * E_RATE + 25**2 * E
EQUIVALENT = 1.01 / N * (J * (WANTED + PUSH) + FV * MOTOR_SPEED + FC + TAU)
UNSURE = 0.2 * FV * MOTOR_SPEED + 0.3 * FC + 1.4 * DELTA + 1.6 * DELTA**3
SWITCHING = 1.01 * 5 / N * (0.06 * (WANTED + PUSH) + UNSURE + (J + 0.06) * 0.9)
FITS = np.linalg.pinv(np.vander(-0.05 * np.arange(11), 3, increasing=True))


def around(most):
    return -most, most


MADE = {
    motor_rate: {
        "theta_rad theta_last_rad": (A_LOW, A_HIGH),
        "omega_rad_s": around(MOTOR_SPEED),
        "omega_held_rad_s first_rad_s second_rad_s": around(0.25 * (A_HIGH - A_LOW) / H),
    },
    lag_observer: {
        "omega_load_rad_s omega_last_rad_s": around(MOTOR_SPEED),
        "tau_Nm tau_last_Nm": around(TAU),
        "tau_h_Nm": around(PERSON_NM),
    },
    extended_state: {
        "theta_load_rad": (A_LOW, A_HIGH),
        "theta_rad theta_load_est_rad": (A_LOW - ROOM_RAD, A_HIGH + ROOM_RAD),
        "tau_Nm tau_last_Nm": around(TAU),
        "tau_h_Nm": around(PERSON_NM),
        "tau_h_Nm.state": around(1.001 * (PERSON_NM + H * PERSON_RATE)),
        "tau_h_rate_Nm_s rate_Nm_s": around(PERSON_RATE),
        "omega_load_rad_s": around(MOTOR_SPEED),
        "omega_rad_s": around(1.001 * (MOTOR_SPEED + BLOW)),
    },
    parabola: {
        "tau_h_Nm last_Nm past_Nm tau_h_fit_Nm": around(PERSON_NM),
        "tau_h_rate_Nm_s": around(1.01 * PERSON_NM * np.abs(FITS[1]).sum()),
        "tau_h_curve_Nm_s2": around(2.02 * PERSON_NM * np.abs(FITS[2]).sum()),
    },
    cable_observer: {
        "theta_gear_rad": around(GEAR_RAD),
        "theta_motor_rad": (A_LOW, A_HIGH),
        "tau_Nm mean_Nm": around(TAU),
        "mean_rad": around(TURNED_RAD),
        "high_rad low_rad": around(CABLE_RAD),
        "wound_rad": around(1.01 * (0.015 + TAU / 80)),
    },
    reference: {
        "tau_desired_Nm tau_Nm": around(TAU),
        "theta_desired_rad theta_load_rad": (A_LOW, A_HIGH),
        "omega_desired_rad_s omega_load_rad_s": around(MOTOR_SPEED),
        "tau_set_Nm": around(FULL_NM),
        "offset_Nm": around(WIDEST_NM),
        "Kp_Nm_rad": (0, 2.5),
        "Kd_Nms_rad": (0, 0.3),
    },
    passivity: {
        "tau_set_Nm": around(FULL_NM),
        "Kp_Nm_rad": (0, 2.5),
        "Kd_Nms_rad": (0, 0.3),
        "tau_Nm tau_last_Nm": around(TAU),
        "theta_load_rad theta_motor_rad": (A_LOW, A_HIGH),
        "omega_load_rad_s omega_motor_rad_s": around(MOTOR_SPEED),
        "u_command_Nm": around(4 * MOTOR_NM),
        "error_last_Nm": around(ERROR_NM),
        "power_W": around(1.01 * ERROR_NM * MOTOR_SPEED),
        "square_rad2_s2": (0, 1.01 * MOTOR_SPEED**2),
        "damping_Nms_rad": (0, 1.001 * 0.32),
        "given_J": (0, 1.001 * 30 * 3.5),
        "moving_J": (0, 0.51 * J * MOTOR_SPEED**2),
        "v_Nm most_Nm": (0, 1.001 * ALLOWED_NM),
    },
    limits: {
        "u_command_Nm": around(4 * MOTOR_NM),
        "theta_rad": around(DELTA),
        "theta_motor_rad": (A_LOW, A_HIGH),
        "omega_motor_rad_s": around(MOTOR_SPEED),
        "theta_load_rad": (LOW, HIGH),
        "omega_load_rad_s": around(JOINT_SPEED),
        "tau_Nm": around(TAU),
        "u_Nm u_cut_Nm u_last_Nm u_mirror_Nm": around(ALLOWED_NM),
        "u_lag_Nm": around(2 * ALLOWED_NM),
        "age": (0, 5 * 4),
        "ticks": (0, 70),
        "slot_J slots_J": (0, SLOT_J),
        "energy_J": (0, 1.01 * 11 * SLOT_J),
        "u_step_Nm": (0.0099 * 45 * H, 1.01 * 45 * H),
        "rom_min_rad rom_max_rad": (-0.1, 2.4),
        "trip_low_rad": (-0.35, 2.4),
        "trip_high_rad": (-0.1, 2.65),
        "rom_gain_Nm_rad": (0.0099 * ALLOWED_NM / 0.25, 1.01 * ALLOWED_NM / 0.25),
        "brake_rad_s": (0.99 * 0.9 * 0.05 * 9, 1.01 * 0.9 * 9),
        "speed_gain_Nms_rad": (0.0099 * ALLOWED_NM / 0.9, 1.01 * ALLOWED_NM / 0.045),
        "u_max_Nm": (0.01 * ALLOWED_NM, ALLOWED_NM),
        "tau_max_Nm": (0.05 * 7, 7),
        "theta_max_rad": (0.05 * 0.29, 0.29),
        "omega_max_rad_s": (0.05 * 9, 9),
        "energy_max_J": (0.12, 12),
    },
    command_stamp: {"u_command_Nm": around(4 * MOTOR_NM)},
    sliding_mode: {
        "delta_set_rad theta_rad": around(DELTA),
        "delta_rate_rad_s": around(RATE),
        "delta_acc_rad_s2": around(3 * PUSH),
        "omega_motor_rad_s omega_load_rad_s": around(MOTOR_SPEED),
        "tau_Nm": around(TAU),
        "tau_h_Nm": around(PERSON_NM),
        "d4_rad_s2": around(PUSH),
        "u_a_Nm u_applied_Nm u_command_Nm u_last_Nm u_before_Nm": around(MOTOR_NM),
        "integral_rad_s": around(INTEGRAL),
        "s_rad_s": around(2.002 * INTEGRAL),
        "u_eq_Nm": around(EQUIVALENT),
        "k_smc_Nm": (0, SWITCHING),
        "u_wanted_Nm": around(1.01 * 4 * (EQUIVALENT + SWITCHING + MOTOR_NM)),
        "slow_rad": around(1.01 * 2 * DELTA),
        "middle_rad": around(2.02 * 2 * DELTA),
    },
}
for _make, _omega, _d, _carried in (
    (drive_observer, "omega_motor_rad_s", "d4_rad_s2", TAU),
    (gear_observer, "omega_gear_rad_s", "d_gear_rad_s2 d4_rad_s2", TAU),
    (drive_observer_by_gear, "omega_gear_rad_s", "d4_rad_s2", 1.1 * TAU),
):
    MADE[_make] = {
        "u_Nm u_held_Nm u_a_Nm": around(MOTOR_NM),
        f"{_omega} omega_last_rad_s": around(MOTOR_SPEED),
        "tau_Nm": around(TAU),
        _d: around(PUSH),
        "passive_rad_s2": around(1.001 * (PUSH + (FV * MOTOR_SPEED + FC + _carried) / J)),
    }


@pytest.fixture(scope="module")
def other():
    return variant(**CHANGES)


@pytest.fixture(scope="module")
def bare():
    """The shipped drive, not kept passive."""
    text = without(SHIPPED.read_text(encoding="utf-8"), "passivity")
    return parse_device(text, "bare.toml")


@pytest.mark.parametrize("make", MADE, ids=lambda make: make.__name__)
def test_every_range_comes_from_its_own_numbers(other, make):
    # A parabola takes whole periods of 5 ms.
    slower = {"timing__control_rate_Hz": 200.0}
    block = make(variant(**CHANGES | slower) if make is parabola else other)
    found = {p.name: p for p in (*block.coefficients, *block.state, *block.inputs, *block.outputs)}
    found |= {f"{p.name}.state": p for p in block.state}
    for names, ends in MADE[make].items():
        for name in names.split():
            p = found[name]
            assert (p.low, p.high) == pytest.approx(ends, rel=3e-5), name


def test_the_numbers_of_the_drive(other):
    d = drive_of(other)
    found = (d.delta_rad, d.omega_rad_s, d.rate_rad_s, d.tau_Nm, d.tau_h_Nm, d.u_Nm, d.d4_rad_s2)
    expected = (DELTA, MOTOR_SPEED, RATE, TAU, PERSON_NM, MOTOR_NM, PUSH)
    assert found == pytest.approx(expected, rel=1e-6)
    assert (d.theta_low_rad, d.theta_high_rad) == pytest.approx((A_LOW, A_HIGH), rel=1e-6)
    assert d.control_period_s == pytest.approx(0.004)
    assert d.actuator is other.file.actuator
    assert (d.joint, d.disturbance, d.impedance) == (
        *(other.file.joint, other.file.disturbance),
        other.file.impedance,
    )
    # A joint that does not turn to both sides of 0 has room there all the same.
    joint = d.joint.model_copy(
        update={
            "theta_min_rad": d.joint.theta_min_rad.model_copy(update={"value": 0.2}),
            "omega_max_rad_s": d.joint.omega_max_rad_s.model_copy(update={"value": 14.0}),
        }
    )
    moved = variant(**CHANGES)
    object.__setattr__(moved, "file", moved.file.model_copy(update={"joint": joint}))
    assert drive_of(moved).theta_low_rad == pytest.approx(-DELTA)
    assert drive_of(moved).omega_rad_s == 14
    high = d.joint.theta_max_rad.model_copy(update={"value": -0.3})
    joint = d.joint.model_copy(update={"theta_max_rad": high})
    object.__setattr__(moved, "file", moved.file.model_copy(update={"joint": joint}))
    assert drive_of(moved).theta_high_rad == pytest.approx(DELTA)


@pytest.mark.parametrize("missing", ["actuator", "joint", "disturbance", "impedance", "safety"])
def test_a_drive_needs_every_section(missing):
    device = variant()
    assert has_drive(device)
    object.__setattr__(device, "file", device.file.model_copy(update={missing: None}))
    assert not has_drive(device)
    if missing == "safety":
        assert drive_of(device).u_Nm > 0
        return
    with pytest.raises(UserError, match="the device has no drive"):
        drive_of(device)


def test_a_drive_needs_a_control_rate():
    device = variant()
    timing = device.file.timing.model_copy(update={"control_rate_Hz": None})
    object.__setattr__(device, "file", device.file.model_copy(update={"timing": timing}))
    assert not has_drive(device)
    with pytest.raises(UserError, match=r"and timing\.control_rate_Hz"):
        drive_of(device)


@pytest.mark.parametrize(
    ("make", "section"),
    [
        (gear_observer, "redundancy"),
        (drive_observer_by_gear, "cable"),
        (cable_observer, "cable"),
        (cable_observer, "redundancy"),
        (redundancy, "redundancy"),
        (adaptation, "adaptation"),
        (passivity, "passivity"),
        (passivity, "safety"),
        (sliding_mode, "sliding_mode"),
    ],
)
def test_a_section_that_is_missing_is_named(make, section):
    device = variant()
    object.__setattr__(device, "file", device.file.model_copy(update={section: None}))
    with pytest.raises(UserError, match=rf"mine\.toml: section \[{section}\] is missing"):
        make(device)


@pytest.mark.parametrize("laws", [1, 9])
def test_a_switch_has_two_to_eight_laws(other, laws):
    with pytest.raises(ValueError, match=f"{laws} laws to switch between; 2 to 8"):
        law_switch(other, [f"law_{k}" for k in range(laws)])
    for fine in (2, 8):
        block = law_switch(other, [f"law_{k}" for k in range(fine)])
        ends = {p.name: p.high for p in (*block.inputs, *block.outputs)}
        assert (ends["law"], ends["law_held"], len(block.inputs)) == (fine - 1, fine - 1, fine + 1)


def test_a_bandwidth_above_what_the_filter_allows_is_refused_with_both_ways_out():
    """Half the delay of 15 Hz: 18.03 1/s; 20 1/s take a cut-off of 33.3 Hz."""
    with pytest.raises(UserError) as refused:
        drive_observer(variant(disturbance__drive_1_s=20.0))
    for word in (
        "disturbance.drive_1_s = 20 1/s is above its limit 18 1/s",
        "joint.motor_velocity_Hz = 30 Hz may be tuned down to 15 Hz",
        "Lower it to 18.03 or raise joint.motor_velocity_Hz to 33.3 Hz.",
    ):
        assert word in str(refused.value)


@pytest.mark.parametrize(("slowest", "refused"), [(0.9999, False), (0.99991, True)])
def test_an_error_of_the_persons_observer_must_die_away(monkeypatch, slowest, refused):
    asked = []

    def known(device, decay_s):
        asked.append(decay_s)
        return np.diag([0.5, -slowest, 0.1, 0.2])

    monkeypatch.setattr(human, "error_matrix", known)
    device = variant()
    if refused:
        with pytest.raises(UserError, match=r"decay of 0\.06 s an error .* by 0\.99991 a step"):
            extended_state(device)
    else:
        extended_state(device)
        assert asked == pytest.approx([0.06, 0.3, 1.5])


def test_the_numbers_of_the_limits(other, bare):
    n = LimitNumbers(other)
    assert (n.h, n.stale_ticks, n.slot_ticks, n.least_rate_share) == (H, 20, 70, 0.1)
    found = (n.u_max, n.tau_max, n.theta_max, n.omega_max, n.energy_max, n.margin)
    assert found == pytest.approx((0.2, 7, 0.29, 9, 12, 0.25), rel=1e-6)
    assert (n.u_rate, n.step_max) == pytest.approx((45, 0.045), rel=1e-6)
    ends = (n.rom_min, n.rom_max, n.trip_low, n.trip_high, n.load_low, n.load_high)
    assert ends == pytest.approx((-0.1, 2.4, -0.35, 2.65, LOW, HIGH), rel=1e-6)
    assert (n.omega_load_lim, n.omega_motor_lim) == (JOINT_SPEED, MOTOR_SPEED)
    assert command_range(other) == pytest.approx(1.0)
    assert LimitNumbers(bare).least_rate_share == 0.01
    # Whole tenths of the window, up to rounding.
    for window_s, ticks in ((1.0, 100), (0.7, 70), (0.701, 71), (0.3, 30), (0.01, 1), (0.0101, 2)):
        assert LimitNumbers(variant(safety__energy_window_s=window_s)).slot_ticks == ticks


def test_gains_that_are_rendered_at_most(other, bare):
    assert largest_gains(other) == pytest.approx((2.5, 0.3))
    facts = [field_facts(f"impedance.{k}")["high"] for k in ("Kp_Nm_rad", "Kd_Nms_rad")]
    assert largest_gains(bare) == tuple(facts) == (20, 5)


def test_velocity_filters_and_what_their_delay_allows(other):
    """Two sections of fourth order; half of the least cut-off's delay."""
    q = 2 * (np.cos(np.pi / 8) + np.cos(3 * np.pi / 8))
    assert filter_delay_s(40.0) == pytest.approx(q / (2 * np.pi * 40))
    joint = other.file.joint
    for make, cutoff in ((motor_rate, 40.0), (load_rate, 35.0)):
        (t,) = make(other).tunables
        assert (t.default, t.low, t.high) == (cutoff, cutoff / 2, cutoff * 2)
    quick = joint.load_velocity_Hz.model_copy(update={"value": 250.0})
    assert cutoff_range(other, quick) == pytest.approx((125, 400))
    at_most = quick.model_copy(update={"value": 400.0})
    assert cutoff_range(other, at_most) == pytest.approx((200, 400))
    with pytest.raises(UserError, match="401 Hz is above 400 Hz"):
        cutoff_range(other, quick.model_copy(update={"value": 401.0}))
    limit = 0.5 * 2 * np.pi * 20 / q
    assert bandwidth_limit_1_s(other, joint.motor_velocity_Hz) == pytest.approx(limit)
    tunables = {make: make(other).tunables[0] for make in (drive_observer, lag_observer)}
    t = tunables[drive_observer]
    assert (t.default, t.low, t.high) == pytest.approx((5, 0, limit))
    t = tunables[lag_observer]
    assert (t.default, t.low, t.high) == pytest.approx((0.75, 0, limit * 35 / 40))
    (t,) = drive_observer_by_gear(other).tunables
    assert (t.default, t.low, t.high) == pytest.approx((100, 0, 500))
    (t,) = extended_state(other).tunables
    assert (t.default, t.low, t.high) == pytest.approx((0.4, DECAY_LOW_S, DECAY_HIGH_S))


def test_the_persons_error_goes_on_as_predicted_and_corrected(other):
    keep = np.exp(-H / 0.4)
    model = np.array(
        [
            [1, H, H**2 / 2 / JH, 0],
            [0, 1, H / JH, 0],
            [0, 0, 1, 0.4 * (1 - keep)],
            [0, 0, 0, keep],
        ]
    )
    gains = np.array([0.179, 17.7, 209, 3234])
    corrected = np.eye(4) - np.outer(gains, [1, 0, 0, 0])
    assert error_matrix(other) == pytest.approx(corrected @ model, rel=1e-12)
    assert error_matrix(other, 0.7)[3, 3] == pytest.approx(np.exp(-H / 0.7))


@pytest.mark.parametrize(("rate_Hz", "kept"), [(20.0, 9), (40.0, 19), (200.0, 99), (1000.0, 499)])
def test_the_parabola_keeps_what_ten_times_50_ms_take(rate_Hz, kept):
    device = variant()
    rate = device.file.timing.control_rate_Hz.model_copy(update={"value": rate_Hz})
    timing = device.file.timing.model_copy(update={"control_rate_Hz": rate})
    object.__setattr__(device, "file", device.file.model_copy(update={"timing": timing}))
    (past,) = (p for p in parabola(device).state if p.name == "past_Nm")
    assert past.size == kept


def test_the_parabolas_weights_are_those_of_least_squares():
    assert parabola_weights() == pytest.approx(FITS)


def test_the_fastest_wanted_torque_that_is_believed(other):
    assert motion_limits(other) == pytest.approx(
        (FULL_NM * 6 * np.pi, FULL_NM * (6 * np.pi) ** 2), rel=1e-6
    )


def test_a_law_knows_the_control_tasks_period(other):
    blocks = {"stamp": command_stamp(other)}
    assert Base(other, blocks, lambda: None).control_period_s == pytest.approx(0.004)
