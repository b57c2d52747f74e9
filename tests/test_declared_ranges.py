"""What the Blocks declare: tunables as their pages state them, ranges from the drive's numbers."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from esea_gen.control.governor import smoothed_setpoint, torque_lead
from esea_gen.control.law_switch import law_switch
from esea_gen.control.limits import limits
from esea_gen.control.passivity import passivity
from esea_gen.control.redundancy import redundancy
from esea_gen.control.setpoint import setpoint_rates
from esea_gen.control.sliding_mode import sliding_mode
from esea_gen.device import load_device
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.filters import tracking_observer
from esea_gen.model.gear_encoder import gear_encoder
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.joint import deflection
from esea_gen.observe.cable import cable_observer
from esea_gen.observe.disturbance import drive_observer
from esea_gen.observe.extrapolation import parabola
from esea_gen.observe.human import extended_state
from esea_gen.twin.encoders import encoder_block
from esea_gen.twin.parameters import plant_tunables
from esea_gen.twin.plant import plant_block

DOCS = Path(__file__).parents[1] / "docs"


def rows_of(page, heading):
    """Cells of the first table below a heading."""
    text = (DOCS / page).read_text(encoding="utf-8").split(f"# {heading}\n")[1]
    table = re.search(r"(?:^\|.*\n)+", text, re.MULTILINE)[0].splitlines()[2:]
    return [[c.strip() for c in line.strip("|").split("|")] for line in table]


ALONE = (
    *(torque_sensor, tracking_observer, exact_inverse, deflection, gear_encoder),
    *(cable_observer, drive_observer, extended_state, parabola),
    *(limits, passivity, redundancy, setpoint_rates, sliding_mode, smoothed_setpoint, torque_lead),
)


@cache
def blocks_of_the_drive():
    """Every Block of the shipped drive, and of its other law."""
    device = load_device("elbow_drive")
    alone = [make(device) for make in ALONE] + [law_switch(device, ["one", "other", "third"])]
    names = {b.name for b in alone}
    systems = [device.system, load_device("elbow_drive", "predictive").system]
    return alone + [b for s in systems for b in s.kinds if b.name not in names]


@pytest.fixture(scope="module")
def drive_blocks():
    return blocks_of_the_drive()


def test_the_drives_are_those_of_the_page(drive_blocks):
    page = {}
    for blocks, name, *numbers in rows_of("control.md", "All tunables of the drive"):
        for block in blocks.split(", "):
            page[block, name.strip("`")] = pytest.approx([float(x) for x in numbers], rel=2e-6)
    found = {(b.name, t.name): [t.default, t.low, t.high] for b in drive_blocks for t in b.tunables}
    assert found == page


def test_the_virtual_exoskeletons_are_those_of_the_page():
    device = load_device("elbow_drive")
    bits = {"joint_encoder_bits": 12, "motor_encoder_bits": 17}
    page = {}
    for low, high, names in rows_of("twin.md", "What may be set"):
        head, _, sides = names.partition(" encoder ")
        named = re.findall(r"`(\w+)`", head)
        errors = re.findall(r"`(\w+)`", sides)
        named += [side + e for side in errors[:2] for e in errors[2:]]
        for name in named:
            assert name not in page
            most = bits[name] if name in bits else float(high)
            page[name] = pytest.approx([float(low), most], rel=2e-7)
    tunables = (*plant_tunables(device, True), *encoder_block(device).tunables)
    assert {t.name: [t.low, t.high] for t in tunables} == page


# Names of ports that are 1 or 0, or a share of 1.
UNIT_PORTS = """
    active agree soft clock_ok coeffs_ok gear_usable governed high_shown keep load_usable lost
    low_shown
    motor_usable primed request_ok seen sensing_ok settled share slow started stepped stop taut
    trust usable weighed wished zeroed
"""
# Inputs and outputs of the elbow's drive: torque and deflection that the sensor spans; the joint's
# ends and a deflection more; 12 rad/s and a motor torque of 0.221 Nm are most.
SENSOR_NM, DEFLECTION_RAD, SPEED, MOTOR_NM, FULL_NM = 20, 0.35, 12, 0.221, 4.47
JOINT_RAD = (-0.6 - DEFLECTION_RAD, 3.0 + DEFLECTION_RAD)
ALIKE = {
    "tau_Nm tau_desired_Nm tau_h_Nm tau_wanted_Nm tau_d_Nm": SENSOR_NM,
    "tau_preview_Nm tau_ahead_Nm tau_model_Nm": SENSOR_NM,
    "tau_spring_Nm tau_rate_Nm tau_hysteresis_Nm": SENSOR_NM,
    "tau_set_Nm tau_led_Nm": FULL_NM,
    "theta_motor_rad theta_load_rad theta_desired_rad": JOINT_RAD,
    "theta_wanted_rad theta_d_rad": JOINT_RAD,
    "theta_rad theta_set_rad delta_set_rad theta_smooth_rad": 0.35,
    "omega_motor_rad_s omega_load_rad_s omega_desired_rad_s": SPEED,
    "omega_wanted_rad_s omega_d_rad_s omega_gear_rad_s": SPEED,
    "omega_rad_s omega_mid_rad_s delta_rate_rad_s": 25,
    "u_Nm u_a_Nm u_cut_Nm u_applied_Nm": MOTOR_NM,
    "u_command_Nm": 4 * MOTOR_NM,
    "u_lag_Nm": 2 * MOTOR_NM,
    "mode": (0, 2),
    "mode_ahead": (0, 2),
    "rearm": (0, 7),
    "fault": (0, 15),
    "control_beat": (0, 255),
    "late_level": (0, 255),
    "frame_error": (0, 127),
    "tau_curve_Nm_s2": FULL_NM * (6 * np.pi) ** 2,  # full torque to and fro at 3 Hz
    "gap_rad": (0, 0.03),
    "reference.stiffness_Nm_rad": (0, 3),
    "reference.damping_Nms_rad": (0, 0.35),
    "reference.Kp_Nm_rad": (0, 3),
    "passivity.Kp_Nm_rad": (0, 3),
    "ahead.Kp_Nm_rad": (0, 20),
    "reference.Kd_Nms_rad": (0, 0.35),
    "passivity.Kd_Nms_rad": (0, 0.35),
    "ahead.Kd_Nms_rad": (0, 5),
    "ahead.damping_Nms_rad": (0, 5),
    # Two angles of the joint before they are known to agree; the whole turns of one encoder.
    "joint.theta_motor_rad": JOINT_RAD[1],
    "joint.theta_load_rad": JOINT_RAD[1],
    "limits.theta_load_rad": (-0.6, 3.0),
    "encoder.theta_rad": 35,
    "encoder.count": (0, 2**12 - 1),
    "encoder_gear.count": (0, 2**17 - 1),
    "encoder_gear.omega_gear_rad_s": 1.01 * SPEED,
    "rate.theta_rad": JOINT_RAD,
    "rate.omega_rad_s": SPEED,
    "inverse.tau_Nm": 10 * SENSOR_NM,
    "inverse.residual_Nm": 20 * SENSOR_NM,
    "torque_lead.tau_set_Nm": SENSOR_NM,
    "sliding_mode.u_command_Nm law.u_command_Nm": MOTOR_NM,
}
RANGES = {name: most for names, most in ALIKE.items() for name in names.split()}


def test_truths_and_status_words_have_their_range_and_no_other(drive_blocks):
    device = load_device("elbow_drive")
    unit = set(UNIT_PORTS.split())
    met = set()
    for block in [*drive_blocks, plant_block(device, True), encoder_block(device)]:
        for p in (*block.state, *block.inputs, *block.outputs):
            where = block.name, p.name
            if p.flags:
                assert (p.low, p.high) == (0, 2 ** len(p.flags) - 1), where
            elif where == ("encoder", "settled"):
                assert (p.low, p.high) == (0, 4)  # turns
            else:
                assert ((p.low, p.high) == (0, 1)) == (p.name in unit), where
                met |= {p.name} & unit
        assert all((p.low, p.high) == (0, 1) for p in block.coefficients if p.name in unit)
    assert met >= unit - {"share"}


def test_what_comes_in_and_goes_out_has_the_drives_range(drive_blocks):
    met = set()
    for block in drive_blocks:
        for p in (*block.inputs, *block.outputs):
            key = next((k for k in (f"{block.name}.{p.name}", p.name) if k in RANGES), None)
            if key:
                most = RANGES[key]
                ends = most if isinstance(most, tuple) else (-most, most)
                assert (p.low, p.high) == pytest.approx(ends, rel=1e-6), (block.name, p)
                met.add(key)
    assert met == set(RANGES)


# Memories and derived outputs: from the numbers of elbow_drive.toml, with the hundredth
# or thousandth more that keeps what is clipped inside.
N, J_KGM2, FV, FC = 74, 0.663, 0.5551, 0.4688
LIMB_KGM2, TICK_S, CONTROL_S = 0.22, 0.001, 0.005
TRAVEL_RAD = JOINT_RAD[1] - JOINT_RAD[0]
GEAR_RAD, SIDE_RAD = 1.01 * TRAVEL_RAD, JOINT_RAD[1]
PUSH = N * MOTOR_NM / J_KGM2  # what the motor alone gives the drive, rad/s^2
BLOW = 2 * SENSOR_NM / LIMB_KGM2 * TICK_S  # what two full torques give the limb in a tick, rad/s
ANGLE_ROOM_RAD = 1.01 * TICK_S * (SPEED + BLOW / 2) / 0.179
TURNED_RAD = 1.01 * (GEAR_RAD + SIDE_RAD)
ERROR_NM = 1.01 * (SENSOR_NM + FULL_NM + 0.35 * SPEED)
SHIFT_NM = 1.01 * (0.4 * 0.8 + 0.3)
ANGLE_RATE, ANGLE_ERROR, SLOPE = 25 + 2 * SPEED, 2 * DEFLECTION_RAD, 25
SLOT_J = 1.01 * SENSOR_NM * SPEED * 0.1
FASTEST_NM_S = FULL_NM * 6 * np.pi
WANTED = 3 * PUSH + 2 * SENSOR_NM / LIMB_KGM2 + 2 * SLOPE * ANGLE_RATE + SLOPE**2 * ANGLE_ERROR
EQUIVALENT_NM = 1.01 / N * (J_KGM2 * (WANTED + PUSH) + FV * SPEED + FC + SENSOR_NM)
UNSURE_NM = 0.25 * FV * SPEED + 0.25 * FC + 1.5 * DEFLECTION_RAD + 1.5 * DEFLECTION_RAD**3
SWITCHING_NM = 1.01 * 5 / N * (0.05 * (WANTED + PUSH) + UNSURE_NM + (J_KGM2 + 0.05) * 0.001)
# What a hand may still be given: 30 times the bound, the drive's motion, and the motor's lag, the
# filter of its speed and the rate of the command on the way to nothing, at the drive's fastest.
FAST = np.sqrt(2 * 4 / J_KGM2)
LATE_S = 2 * (np.sin(np.pi / 8) + np.sin(3 * np.pi / 8)) / (2 * np.pi * 30) + TICK_S / 2
LAG_TICK_S = TICK_S / (1 - np.exp(-TICK_S / 0.03488))
FALLS_S = (1 + LATE_S / LAG_TICK_S) * MOTOR_NM / 50
MOVING_J = 0.51 * J_KGM2 * SPEED**2
HELD_J = 1.01 * (120 + MOVING_J + FAST * N * MOTOR_NM * (0.03488 + LATE_S + FALLS_S))
# A parabola through eleven values, 50 ms apart, by least squares: what each takes of them.
PARABOLA = np.linalg.pinv(np.vander(-0.05 * np.arange(11), 3, increasing=True))
ROOM = {
    "velocity.theta_hat_rad": 2 * DEFLECTION_RAD,
    "velocity.v_rad_s inverse.v_rad_s setpoint_rates.rate_rad_s": 4 * 25,
    "velocity.a_rad_s2 inverse.a_rad_s2 setpoint_rates.acc_rad_s2": 4 * 25 / TICK_S,
    "sensor.play_rad inverse.play_rad inverse.step_rad": 2 * DEFLECTION_RAD,
    "sensor.theta_prev_rad setpoint_rates.held_rad smoothed_setpoint.third_rad": DEFLECTION_RAD,
    "sensor.tau_r_Nm human_eso.tau_last_Nm passivity.tau_last_Nm set_trend.last_Nm": SENSOR_NM,
    "setpoint_rates.delta_rad": 2 * DEFLECTION_RAD,
    "setpoint_rates.delta_acc_rad_s2 smoothed_setpoint.delta_acc_rad_s2": 3 * PUSH,
    "rate.theta_last_rad": JOINT_RAD,
    # A twentieth of the joint's travel from one tick to the next, five times as room.
    "rate.omega_held_rad_s rate.first_rad_s rate.second_rad_s": 5 * 0.05 * TRAVEL_RAD / TICK_S,
    "encoder_gear.omega_rad_s": 1.01 * SPEED,
    "encoder_gear.theta_gear_rad": TRAVEL_RAD,
    "encoder_gear.moved": TRAVEL_RAD * N * 2**17 / (2 * np.pi),
    "reference.offset_Nm": 1.01 * (2 * SENSOR_NM + 3 * TRAVEL_RAD + 2 * 0.35 * SPEED),
    "adaptation.wish_gain reference.wish_gain": (0.99 / 1.3, 1.01 / 0.7),
    "adaptation.wish_shift_Nm reference.wish_shift_Nm": SHIFT_NM,
    "adaptation.gain": (1 / 1.3, 1 / 0.7),
    "adaptation.loss": 0.4,
    "adaptation.wish_loss": 1.01 * 0.4,
    "adaptation.offset_Nm": 0.3,
    "adaptation.wish_offset_Nm": 1.01 * 0.3,
    "adaptation.missed_Nm": 1.01 * (SENSOR_NM + FULL_NM / 0.7 + SHIFT_NM),
    "adaptation.weight_lag_Nm adaptation.mean_Nm": 1.01 * FULL_NM,
    "adaptation.stop_known_Nm": 1.01 * (FULL_NM + 0.8),
    "adaptation.stop_wish_Nm": 1.01 * (SENSOR_NM + 0.8),
    "adaptation.square_Nm2": (0, 4.1 * FULL_NM**2),
    "adaptation.omega_lag_rad_s": 1.01 * SPEED,
    "adaptation.tau_lag_Nm": 1.01 * SENSOR_NM,
    "adaptation.more_gain": 1.01 * (1 / 0.7 - 1 / 1.3),
    "adaptation.more_loss": 1.01 * 2 * 0.4,
    "adaptation.more_offset_Nm": 1.01 * 2 * 0.3,
    "passivity.error_last_Nm": ERROR_NM,
    "passivity.power_W": 1.01 * ERROR_NM * SPEED,
    "passivity.square_rad2_s2": (0, 1.01 * SPEED**2),
    "passivity.damping_Nms_rad": (0, 1.001 * 0.35),
    "passivity.given_J": (0, 1.001 * 30 * 4),
    "passivity.moving_J": (0, MOVING_J),
    "passivity.v_Nm passivity.most_Nm": (0, 1.001 * MOTOR_NM),
    "drive_observer.passive_rad_s2 gear_observer.passive_rad_s2": 1.001
    * (PUSH + (FV * SPEED + FC + SENSOR_NM) / J_KGM2),
    # The cable's friction takes a tenth of the torque more.
    "drive_by_gear.passive_rad_s2": 1.001 * (PUSH + (FV * SPEED + FC + 22) / J_KGM2),
    "drive_observer.d4_rad_s2 gear_observer.d_gear_rad_s2 redundancy.d_gear_rad_s2": PUSH,
    "gear_observer.a_rad_s2": 4 * PUSH,
    "gear_observer.moves_rad_s2 gear_observer.moved_rad_s2": (0, 4 * PUSH),
    "human_eso.theta_rad human_eso.theta_load_est_rad": (
        JOINT_RAD[0] - ANGLE_ROOM_RAD,
        JOINT_RAD[1] + ANGLE_ROOM_RAD,
    ),
    "human_eso.omega_rad_s": 1.001 * (SPEED + BLOW),
    "human_eso.rate_Nm_s human_eso.tau_h_rate_Nm_s": 2 * SENSOR_NM / 0.06,
    "human_eso.tau_h_Nm.state": 1.001 * SENSOR_NM * (1 + 2 * TICK_S / 0.06),
    "set_trend.raw_Nm set_trend.grown_Nm": 2 * SENSOR_NM,
    "set_trend.noise_Nm": (0, 4.04 * 2 * SENSOR_NM),
    "set_trend.miss_Nm": 4 * SENSOR_NM,
    "set_trend.rate_Nm_s set_trend.tau_rate_Nm_s torque_lead.tau_rate_Nm_s": FASTEST_NM_S,
    "set_trend.acc_Nm_s2": FASTEST_NM_S * 6 * np.pi,
    "sliding_mode.integral_rad_s": ANGLE_RATE + 2 * SLOPE * ANGLE_ERROR,
    "sliding_mode.s_rad_s": 2.002 * (ANGLE_RATE + 2 * SLOPE * ANGLE_ERROR),
    "sliding_mode.offset_Nm": 2.01 * MOTOR_NM,
    "sliding_mode.u_last_Nm sliding_mode.u_before_Nm": MOTOR_NM,
    "sliding_mode.u_eq_Nm": EQUIVALENT_NM,
    "sliding_mode.k_smc_Nm": (0, SWITCHING_NM),
    "sliding_mode.u_wanted_Nm": 1.01 * 4 * (EQUIVALENT_NM + SWITCHING_NM + MOTOR_NM),
    "redundancy.zero_rad": 1.01 * (GEAR_RAD + SIDE_RAD + SENSOR_NM / 150),
    "redundancy.apart_rad": 2.02 * (GEAR_RAD + SIDE_RAD + SENSOR_NM / 150),
    "redundancy.apart_Nm": 1.001 * J_KGM2 * PUSH,
    "redundancy.room_Nm": (0, 1.001 * (2.2 + 0.25 * SENSOR_NM + 0.35 * J_KGM2 * 4 * PUSH)),
    "redundancy.theta_gear_rad cable.theta_gear_rad": GEAR_RAD,
    "cable.mean_rad": TURNED_RAD,
    "cable.mean_Nm": SENSOR_NM,
    "cable.high_rad cable.low_rad": 1.01 * (1.01 * (TURNED_RAD + SENSOR_NM / 80) + 0.03),
    "cable.give_rad_Nm": (0, 1 / 80),
    "cable.wound_rad": 1.01 * (0.03 / 2 + SENSOR_NM / 80),
    "limits.slot_J limits.slots_J": (0, SLOT_J),
    "limits.energy_J": (0, 1.01 * 11 * SLOT_J),
    "limits.u_last_Nm limits.u_mirror_Nm": MOTOR_NM,
    "limits.rearm_last": (-1, 7),
    "limits.rearm_mirror": (-7, 1),
    "limits.fault_stored": (0, 15),
    "limits.fault_mirror": (-15, 0),
    "limits.age": (0, 25),
    "limits.ticks": (0, 100),
    "stamp.beats limits.beat_last": (0, 255),
    "law.offset_Nm": 2 * MOTOR_NM,
    "law.u_last_Nm law.u_one_Nm law.u_other_Nm law.u_third_Nm": MOTOR_NM,
    "law.law_held law.law": (0, 2),
    "ahead.offset_Nm": 1.01 * (2 * SENSOR_NM + 20 * TRAVEL_RAD + 2 * 5 * SPEED),
    "ahead.tau_range_Nm": (0.009 * FULL_NM, FULL_NM),
    "drive_observer.omega_last_rad_s gear_observer.omega_last_rad_s": SPEED,
    "drive_observer.u_held_Nm drive_observer.u_a_Nm gear_observer.u_held_Nm": MOTOR_NM,
    "sliding_mode.d4_rad_s2 predictive.d4_rad_s2 drive_by_gear.d4_rad_s2": PUSH,
    "sliding_mode.delta_acc_rad_s2": 3 * PUSH,
    "redundancy.moves_rad_s2": (0, 4 * PUSH),
    "encoder.turn": 4,
    "encoder.held": (0, 4),
    "encoder_gear.held": (0, 2),
    "encoder.count_last": (0, 2**12 - 1),
    "encoder_gear.count_last": (0, 2**17 - 1),
    "passivity.theta_load_last_rad passivity.theta_motor_last_rad": JOINT_RAD,
    "smoothed_setpoint.first_rad smoothed_setpoint.second_rad": DEFLECTION_RAD,
    "inverse.theta_hat_rad": 2 * DEFLECTION_RAD,
    "inverse.theta_prev_rad predictive.delta_rad": DEFLECTION_RAD,
    "inverse.tau_r_Nm torque_lead.tau_set_Nm.state": SENSOR_NM,
    "parabola.tau_h_rate_Nm_s": 1.01 * SENSOR_NM * np.abs(PARABOLA[1]).sum(),
    "parabola.tau_h_curve_Nm_s2": 2.02 * SENSOR_NM * np.abs(PARABOLA[2]).sum(),
    "passivity.held_J": (0, HELD_J),
    "sliding_mode.slow_rad": 1.01 * ANGLE_ERROR,
    "sliding_mode.middle_rad": 2.02 * ANGLE_ERROR,
    "sliding_mode.square": (0, 1.001),
    "gear_observer.d4_rad_s2": PUSH,
    "drive_by_gear.omega_last_rad_s": SPEED,
    "drive_by_gear.u_held_Nm predictive.u_in_force_Nm": MOTOR_NM,
    "parabola.last_Nm parabola.past_Nm parabola.tau_h_fit_Nm trend.last_Nm": SENSOR_NM,
    "trend.raw_Nm trend.grown_Nm": 2 * SENSOR_NM,
    "trend.noise_Nm": (0, 4.04 * 2 * SENSOR_NM),
    "trend.miss_Nm": 4 * SENSOR_NM,
    "trend.rate_Nm_s trend.tau_rate_Nm_s": FASTEST_NM_S,
    "trend.acc_Nm_s2": FASTEST_NM_S * 6 * np.pi,
    "reference.mode_last": (0, 2),
    "reference.tau_range_Nm": (0, FULL_NM),
    "limits.key": (0, 0x555555 + 0.5),
    # Along the horizon.
    "predictive.plan": 1,
    "predictive.wound_rad": 1.01 * (0.03 / 2 + SENSOR_NM / 80),
    "predictive.give_rad_Nm": (0, 1 / 80),
    "predictive.theta_l_rad": JOINT_RAD,
    "predictive.omega_l_rad_s": SPEED,
    "predictive.play_rad": 2 * DEFLECTION_RAD,
    "predictive.tau_h_rate_Nm_s": 1e4,
    "predictive.Kp_Nm_rad": (0, 20),
    "predictive.Kd_Nms_rad": (0, 5),
    "predictive.residual": (0, 2),
    "predictive.iterations": (0, 1000),
    "predictive.root_q": (0, 1e3),
    "predictive.root_r": (0, 1e6),
    "predictive.load_1_kgm2": (0, 1e4),
    # Coefficients of the least and the largest tunables.
    "velocity.alpha inverse.alpha setpoint_rates.alpha rate.gain_1 rate.gain_2": (0, 1),
    "velocity.beta_1_s inverse.beta_1_s setpoint_rates.beta_1_s": (0, 3 / TICK_S),
    "velocity.gamma_1_s2 inverse.gamma_1_s2 setpoint_rates.gamma_1_s2": (0, 1 / TICK_S**2),
    "human_eso.reach_s": (0, TICK_S),
    "encoder.offset_rad": np.pi,
    "set_trend.quick trend.quick": (0, 1),
    "trend.noises_1_Nm": (0, 1.01 / 0.001),
    "limits.u_step_Nm": (0.99 * 0.5 * TICK_S, 1.01 * 50 * TICK_S),
    "sliding_mode.lambda_1_s": (0, SLOPE),
    "sliding_mode.lead": (0, 4 - 1),  # of the law, beside the law
    "sliding_mode.lambda2_1_s2": (0, 1.01 * SLOPE**2),
    "sliding_mode.integral_gain_1_s": (0, 1.01 * SLOPE**2 * CONTROL_S),
    "sliding_mode.layer_s_rad set_trend.noises_1_Nm": (0, 1.01 / 0.001),
    "limits.trip_low_rad": (-0.35, 2.5),
    "limits.trip_high_rad": (-0.15, 2.7),
    "limits.rom_gain_Nm_rad": (0.99 * 0.01 * MOTOR_NM / 0.2, 1.01 * MOTOR_NM / 0.2),
    "limits.brake_rad_s": (0.99 * 0.9 * 0.5, 1.01 * 0.9 * 10),
    "limits.speed_gain_Nms_rad": (0.99 * 0.01 * MOTOR_NM / 1, 1.01 * MOTOR_NM / 0.05),
}


def test_memories_and_derived_outputs_have_room_for_what_the_drive_can_do_and_little_more(
    drive_blocks,
):
    found = {}
    for block in drive_blocks:
        given = (*block.coefficients, *block.inputs, *block.outputs)
        found |= {f"{block.name}.{p.name}": p for p in given}
        found |= {f"{block.name}.{p.name}.state": p for p in block.state}
    for names, most in ROOM.items():
        ends = most if isinstance(most, tuple) else (-most, most)
        for name in names.split():
            p = found.get(f"{name}.state", found.get(name))
            assert (p.low, p.high) == pytest.approx(ends, rel=3e-5), name
    # Nothing is left: coefficients that a tunable bounds, and what a Program works in, apart.
    named = {n.removesuffix(".state") for names in ROOM for n in names.split()}
    for block in drive_blocks:
        tunables = {t.name: (t.low, t.high) for t in block.tunables}
        for p in (*block.coefficients, *block.state, *block.inputs, *block.outputs):
            name, ends = f"{block.name}.{p.name}", (p.low, p.high)
            if p.flags or {name, p.name} & {*named, *RANGES, *UNIT_PORTS.split()}:
                continue
            if p in block.coefficients and p.name in tunables:
                assert ends == pytest.approx(tunables[p.name], rel=1e-6), name
            else:
                assert block.name == "predictive", name
                assert ends == pytest.approx((-3e38, 3e38)), name


# What a flag compares its value with, from the numbers of the drive's file: the motor's torque,
# gear and inertia, the sensing period, the identified domain, least decay of the person's torque.
ACCELERATION = 0.221 * 74 / 0.663
THRESHOLDS = {
    "velocity.RATE_CLIPPED setpoint.RATE_CLIPPED": 25,
    "motor_rate.RATE_CLIPPED load_rate.RATE_CLIPPED set_rate.RATE_CLIPPED": SPEED,
    "sensor.TORQUE_OUTSIDE reference.CLIPPED": FULL_NM,
    "sensor.RATE_TORQUE_CLIPPED human.TORQUE_CLIPPED": SENSOR_NM,
    "joint.DEFLECTION_OUTSIDE inverse.REQUEST_CLAMPED": DEFLECTION_RAD,
    "inverse.THETA_OUTSIDE": np.deg2rad(11.5),
    "inverse.RATE_OUTSIDE": np.deg2rad(61.6),
    "inverse.STEP_CLIPPED": 25 * 1e-3,
    "inverse.NOT_CONVERGED": 5e-6 * SENSOR_NM,
    "setpoint.ACCELERATION_CLIPPED": 3 * ACCELERATION,
    "drive.CLIPPED gear.CLIPPED drive_by_gear.CLIPPED": ACCELERATION,
    "human.OMEGA_CLIPPED": SPEED,
    "human.TORQUE_RATE_CLIPPED": 2 * SENSOR_NM / 0.06,
    "limits.ENERGY": 15,
    "smc.SATURATED": MOTOR_NM,
    "smc.LAYER_LEFT": 1.5,
}


def test_every_flag_that_compares_has_its_threshold():
    found = {}
    for device in (load_device("elbow_drive"), load_device("elbow_mpc")):
        for name, block in device.system.blocks.items():
            port = getattr(block, "status_port", None)
            for flag in port.flags if port else ():
                if flag.threshold:
                    found[f"{name}.{flag.name}"] = flag.threshold
    wanted = {name: most for names, most in THRESHOLDS.items() for name in names.split()}
    assert found == {name: pytest.approx(most, rel=1e-6) for name, most in wanted.items()}
