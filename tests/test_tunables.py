"""Every tunable of the drive and of the virtual exoskeleton has the bounds that its page states.

And every port that is a truth value or a status word has the range of one.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.twin.encoders import encoder_block
from esea_gen.twin.parameters import plant_tunables
from esea_gen.twin.plant import plant_block

DOCS = Path(__file__).parents[1] / "docs"


def rows_of(page, heading):
    """Cells of the first table below a heading."""
    text = (DOCS / page).read_text(encoding="utf-8").split(f"# {heading}\n")[1]
    table = re.search(r"(?:^\|.*\n)+", text, re.MULTILINE)[0].splitlines()[2:]
    return [[c.strip() for c in line.strip("|").split("|")] for line in table]


@cache
def drive_blocks():
    """Every Block of the shipped drive, and of its other law."""
    systems = [load_device("elbow_drive", c).system for c in (None, "predictive")]
    return [b for s in systems for b in s.kinds]


def test_the_drives_are_those_of_the_page():
    page = {}
    for blocks, name, *numbers in rows_of("control.md", "All tunables of the drive"):
        for block in blocks.split(", "):
            page[block, name.strip("`")] = pytest.approx([float(x) for x in numbers], rel=2e-6)
    found = {
        (b.name, t.name): [t.default, t.low, t.high] for b in drive_blocks() for t in b.tunables
    }
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
    active agree clock_ok coeffs_ok gear_usable governed high_shown keep load_usable lost low_shown
    motor_usable primed request_ok seen sensing_ok settled share slow started stepped stop taut
    trust usable zeroed
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
    "sliding_mode.u_command_Nm": MOTOR_NM,
}
RANGES = {name: most for names, most in ALIKE.items() for name in names.split()}


def test_truths_and_status_words_have_their_range_and_no_other():
    device = load_device("elbow_drive")
    unit = set(UNIT_PORTS.split())
    met = set()
    for block in [*drive_blocks(), plant_block(device, True), encoder_block(device)]:
        for p in (*block.state, *block.inputs, *block.outputs):
            where = block.name, p.name
            if p.flags:
                assert (p.low, p.high) == (0, 2 ** len(p.flags) - 1), where
            elif where == ("encoder", "settled"):
                assert (p.low, p.high) == (0, 4)  # turns
            else:
                assert ((p.low, p.high) == (0, 1)) == (p.name in unit), where
                met |= {p.name} & unit
    assert met >= unit - {"share"}


def test_what_comes_in_and_goes_out_has_the_drives_range():
    met = set()
    for block in drive_blocks():
        for p in (*block.inputs, *block.outputs):
            key = next((k for k in (f"{block.name}.{p.name}", p.name) if k in RANGES), None)
            if key:
                most = RANGES[key]
                ends = most if isinstance(most, tuple) else (-most, most)
                assert (p.low, p.high) == pytest.approx(ends, rel=1e-6), (block.name, p)
                met.add(key)
    assert met == set(RANGES)
