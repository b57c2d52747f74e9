"""What the drive's Blocks declare besides ranges: flags, starts, substitutes, sizes, constants."""

from __future__ import annotations

import pytest

from esea_gen.control.impaired import impairment_request, motor_side
from esea_gen.control.impairment import impairment
from esea_gen.observe.human import lag_observer
from esea_host.wrist.rig import impaired_device

from .test_declared_ranges import blocks_of_the_drive

# A plus: how often it came is counted.  Behind a slash: what it compares with a threshold.
FLAGS = {
    "sensor": "THETA_OUTSIDE RATE_OUTSIDE TORQUE_OUTSIDE/tau_Nm STEP_CLIPPED+"
    " RATE_TORQUE_CLIPPED+/tau_rate_Nm",
    "velocity": "RATE_CLIPPED+/omega_rad_s,omega_mid_rad_s",
    "inverse": "THETA_OUTSIDE/theta_rad RATE_OUTSIDE/omega_mid_rad_s TORQUE_OUTSIDE"
    " REQUEST_CLAMPED+/theta_rad STEP_CLIPPED+/step_rad NOT_CONVERGED+/residual_Nm",
    "joint": "ENCODER_UNUSABLE+ DEFLECTION_OUTSIDE+/theta_rad CONTRADICTED+",
    "encoder": "FRAME_ERROR+ IMPLAUSIBLE_STEP+ HELD_TOO_LONG+ SETTLING NOT_ZEROED REFERENCE_LOST",
    "encoder_gear": "FRAME_ERROR+ IMPLAUSIBLE_STEP+ NOT_USABLE+ RANGE_LEFT+",
    "rate": "STEP_CLIPPED+ RATE_CLIPPED+/omega_rad_s",
    "drive_observer": "CLIPPED+/d4_rad_s2",
    "drive_by_gear": "CLIPPED+/d4_rad_s2",
    "gear_observer": "CLIPPED+/d_gear_rad_s2",
    "human_eso": "OMEGA_CLIPPED+/omega_load_rad_s TORQUE_CLIPPED+/tau_h_Nm"
    " TORQUE_RATE_CLIPPED+/tau_h_rate_Nm_s ANGLE_CLIPPED+",
    "human_lag": "CLIPPED+/tau_h_Nm",
    "parabola": "CLIPPED+/tau_h_fit_Nm",
    "cable": "NOT_COMPARED",
    "redundancy": "NOT_COMPARED ANGLES_PART TORQUES_PART",
    "adaptation": "LEARNS AT_BOUND IMPLAUSIBLE",
    "reference": "CLIPPED+/tau_set_Nm ENTERED",
    "smoothed_setpoint": "",
    "torque_lead": "",
    "set_trend": "CLIPPED+",
    "trend": "CLIPPED+",
    "setpoint_rates": "RATE_CLIPPED+/delta_rate_rad_s ACCELERATION_CLIPPED+/delta_acc_rad_s2",
    "sliding_mode": "SATURATED+/u_command_Nm LAYER_LEFT/s_rad_s INTEGRAL_RESTS+ ACTIVE ENTERED"
    " SOFTENED",
    "predictive": "NOT_CONVEX+ CAP_REACHED+ NOT_OPTIMAL+",
    "law": "LAW_UNKNOWN+ CLIPPED+/u_command_Nm",
    "stamp": "",
    "passivity": "DAMPED COMMAND_CLOSED FAST",
    "limits": "TUNABLE_INVALID STOPPED SENSING_LOST+ CONTROL_STALE DEFLECTION INTERACTION_TORQUE"
    " SPEED RANGE_OF_MOTION ENERGY/energy_J TORQUE_CLIPPED+ RATE_LIMITED+/u_lag_Nm"
    " ROM_LOW+/u_cut_Nm ROM_HIGH+/u_cut_Nm SPEED_LIMITED+/u_cut_Nm REARM_REFUSED+ FAULT_LATCHED"
    " CLOCK+ LATE+ COEFFICIENTS",
}
STATELESS = {"joint": "INPUT_INVALID+", "ahead": "INPUT_INVALID+"}


@pytest.fixture(scope="module")
def blocks(drive):
    return [*blocks_of_the_drive(), lag_observer(drive)]


def test_flags_in_their_order_and_which_are_counted(blocks):
    shown = {}
    for block in blocks:
        for p in block.outputs:
            words = [
                f"{f.name}{'+' * f.counted}{'/' * bool(f.compares)}{','.join(f.compares)}"
                for f in p.flags
            ]
            if words:
                assert all(" " in f.meaning for f in p.flags), block.name
                shown[block.name] = " ".join(words)
    first = "INPUT_INVALID+ STATE_REPAIRED+"
    typed = {k: f"{STATELESS.get(k, first)} {v}".strip() for k, v in FLAGS.items()}
    assert shown == STATELESS | typed


# Of memory: what it begins with, where that is not 0.
STARTS = {
    "cable.give_rad_Nm": 1 / 150,
    "limits.fault_stored": 1,  # not armed
    "limits.fault_mirror": -1,
    "limits.rearm_last": -1,
    "limits.rearm_mirror": 1,
    "limits.age": 25,
    "passivity.damping_Nms_rad": 0.35,
    "adaptation.wish_gain": 1,
}
# Of inputs: what stands in for an invalid one, where that is not 0.
SUBSTITUTES = {
    "sensor.theta_rad": "theta_prev_rad",
    "velocity.theta_rad": "theta_hat_rad",
    "rate.theta_rad": "theta_last_rad",
    "drive_observer.omega_motor_rad_s": "omega_last_rad_s",
    "drive_by_gear.omega_gear_rad_s": "omega_last_rad_s",
    "gear_observer.omega_gear_rad_s": "omega_last_rad_s",
    "human_eso.theta_load_rad": "theta_rad",
    "human_eso.tau_Nm": "tau_last_Nm",
    "human_lag.omega_load_rad_s": "omega_last_rad_s",
    "human_lag.tau_Nm": "tau_last_Nm",
    "parabola.tau_h_Nm": "last_Nm",
    "limits.control_beat": "beat_last",
    "limits.stop": 1,
    "limits.rearm": "rearm_last",
    "limits.late_level": 255,
    "setpoint_rates.theta_set_rad": "held_rad",
    "smoothed_setpoint.theta_set_rad": "third_rad",
    "torque_lead.tau_set_Nm": "tau_set_Nm",
    "law.law": "law_held",
    "reference.wish_gain": 1,
    "set_trend.tau_wanted_Nm": "last_Nm",
    "trend.tau_wanted_Nm": "last_Nm",
    "ahead.tau_range_Nm": 4.47,
}
SIZES = {
    "sensor.play_rad inverse.play_rad limits.slots_J": 10,
    "parabola.past_Nm": 99,
    "rate.first_rad_s rate.second_rad_s": 2,
    "rate.gain_1 rate.gain_2": 3,
    "set_trend.raw_Nm set_trend.grown_Nm trend.raw_Nm trend.grown_Nm": 2,
    "trend.tau_ahead_Nm ahead.tau_preview_Nm ahead.tau_d_Nm ahead.theta_d_rad": 10,
    "ahead.omega_d_rad_s": 10,
}
# The slower task: 200 Hz.
CONTROL = "law parabola redundancy sliding_mode set_trend stamp trend ahead predictive"


def nearly(found):
    return {k: v if isinstance(v, str) else pytest.approx(v, rel=1e-6) for k, v in found.items()}


def test_what_memory_begins_with_and_what_stands_in_for_an_invalid_input(blocks):
    starts = {f"{b.name}.{p.name}": p.init for b in blocks for p in b.state if p.init}
    assert starts == nearly(STARTS)
    stand_in = {f"{b.name}.{p.name}": p.on_invalid for b in blocks for p in b.inputs}
    assert {k: v for k, v in stand_in.items() if v != 0} == nearly(SUBSTITUTES)


def test_sizes_and_periods(blocks):
    found = {}
    for b in blocks:
        if b.name != "predictive":
            ports = (*b.state, *b.inputs, *b.outputs, *b.coefficients)
            found |= {f"{b.name}.{p.name}": p.size for p in ports if p.size != 1}
        assert b.period_s == (0.005 if b.name in CONTROL.split() else 0.001), b.name
    assert found == {k: size for names, size in SIZES.items() for k in names.split()}
    impaired = impaired_device()
    for make in (motor_side, impairment):
        assert make(impaired).period_s == impaired.period_s
    assert impairment_request(impaired).period_s == pytest.approx(5 * impaired.period_s)


ACTUATOR = {
    "gear_ratio": 74,
    "J_kgm2": 0.663,
    "fv_Nms_rad": 0.5551,
    "fc_Nm": 0.4688,
    "coulomb_width_rad_s": 0.05,
    "tau_c_s": 0.03488,
    "u_max_Nm": 0.221,
    "omega_max_rad_s": 12,
    "encoder_bits": 17,
}
# Beside whole sections: what comes of them, or is taken of others.
CONSTANTS = {
    "cable": {
        "backlash_rad": 0.006,
        "backlash_most_rad": 0.03,
        "contact_Nm": 0.2,
        "rate_1_s": 20,
        "cable_Nm_rad": 150,
    },
    "drive_observer": ACTUATOR,
    "gear_observer": ACTUATOR,
    "drive_by_gear": ACTUATOR | {"loss": 0.1, "drive_1_s": 100},
    "human_eso": {
        "Jh_kgm2": 0.22,
        "theta_min_rad": -0.6,
        "theta_max_rad": 3,
        "omega_max_rad_s": 12,
        "tau_human_max_Nm": 20,
        "motor_velocity_Hz": 30,
        "load_velocity_Hz": 30,
        "gain_theta": 0.179,
        "gain_omega_1_s": 17.7,
        "gain_tau_Nm_rad": 209,
        "gain_rate_Nm_s_rad": 3234,
    },
    "redundancy": {
        "cable_Nm_rad": 150,
        "cable_least_Nm_rad": 80,
        "apart_rad": 0.06,
        "torque_Nm": 2.2,
        "torque_share": 0.25,
        "inertia_share": 0.35,
        "rate_1_s": 20,
        "J_kgm2": 0.663,
    },
    "limits": {
        "u_max_Nm": 0.221,
        "u_rate_Nm_s": 50,
        "tau_max_Nm": 8,
        "theta_max_rad": 0.3,
        "rom_min_rad": -0.15,
        "rom_max_rad": 2.5,
        "rom_margin_rad": 0.2,
        "omega_max_rad_s": 10,
        "energy_J": 15,
        "energy_window_s": 1,
        "stale_ticks": 25,
        "slot_ticks": 100,
        "fade": 0.8,
        "brake": 0.9,
    },
    "adaptation": {
        "scale_least": 0.7,
        "scale_most": 1.3,
        "loss_most": 0.4,
        "offset_Nm": 0.3,
        "rate_1_s": 0.5,
    },
}


def test_constants_of_the_drives_blocks(blocks):
    found = {b.name: {c.name: c.value for c in b.constants} for b in blocks if b.name in CONSTANTS}
    assert found == {name: nearly(typed) for name, typed in CONSTANTS.items()}
