"""Every wire, input and output of a device with impaired axes, typed again."""

from __future__ import annotations

import pytest

from esea_gen.language.system import Task
from esea_host.wrist.rig import impaired_device

AXES = ("flexion", "deviation")
# Of one axis, writer to readers.
WIRED = {
    "velocity.omega_mid_rad_s": "sensor.omega_rad_s",
    "velocity.omega_rad_s": "side.omega_rad_s",
    "joint.omega_rad_s": "impairment.omega_rad_s side.omega_load_rad_s limits.omega_load_rad_s",
    "impairment.tau_set_Nm": "limits.u_command_Nm",
    "impairment.acts": "limits.mode",
    "impairment.usable": "limits.sensing_ok",
    "side.theta_motor_rad": "limits.theta_motor_rad",
    "side.omega_motor_rad_s": "limits.omega_motor_rad_s",
    "sensor.tau_Nm": "limits.tau_Nm",
}
SHARED = {
    "request.constrained": "impairment.constrained",
    "request.control_beat": "limits.control_beat",
    "request.rearm": "limits.rearm",
    "request.request_ok": "limits.request_ok",
    "watch.clock_ok": "limits.clock_ok",
    "watch.late_level": "limits.late_level",
    "watch.coeffs_ok": "limits.coeffs_ok",
}
# A star stands for the axis.
FED = {
    "theta_*_rad": "velocity.theta_rad sensor.theta_rad side.theta_rad limits.theta_rad",
    "theta_load_*_rad": "joint.theta_rad impairment.theta_rad side.theta_load_rad"
    " limits.theta_load_rad",
}
GIVEN = {
    "tau_*_Nm": "sensor.tau_Nm",
    "tau_spring_*_Nm": "sensor.tau_spring_Nm",
    "tau_rate_*_Nm": "sensor.tau_rate_Nm",
    "tau_hysteresis_*_Nm": "sensor.tau_hysteresis_Nm",
    "omega_*_rad_s": "velocity.omega_rad_s",
    "sensor_*_status": "sensor.status",
    "velocity_*_status": "velocity.status",
    "omega_load_*_rad_s": "joint.omega_rad_s",
    "tau_set_*_Nm": "impairment.tau_set_Nm",
    "acts_*": "impairment.acts",
    "u_*_Nm": "limits.u_Nm",
    "energy_*_J": "limits.energy_J",
    "fault_*": "limits.fault",
    "joint_*_status": "joint.status",
    "impairment_*_status": "impairment.status",
    "limits_*_status": "limits.status",
}


@pytest.fixture(scope="module")
def system():
    return impaired_device().system


def of(signal: str, axis: str) -> str:
    name, _, port = signal.partition(".")
    return f"{name}_{axis}.{port}"


def text(signal) -> str:
    return f"{signal.instance}.{signal.port}"


def test_wires(system):
    expected = {}
    for axis in AXES:
        for writer, readers in WIRED.items():
            expected |= {of(r, axis): of(writer, axis) for r in readers.split()}
        expected |= {of(r, axis): w for w, r in SHARED.items()}
    assert {text(r): text(w) for r, w in system.wires.items()} == expected


def test_inputs_and_outputs(system):
    fed = {
        name.replace("*", axis): {of(s, axis) for s in sinks.split()}
        for name, sinks in FED.items()
        for axis in AXES
    }
    fed["stop"] = {f"limits_{axis}.stop" for axis in AXES}
    assert {e.name: {text(s) for s in e.signals} for e in system.inputs} == fed
    given = {n.replace("*", axis): {of(s, axis)} for n, s in GIVEN.items() for axis in AXES}
    given["constrained"] = {"request.constrained"}
    assert {e.name: {text(s) for s in e.signals} for e in system.outputs} == given


def test_all_but_the_request_is_sensed_and_limited_in_one_task(system):
    of_axis = ("joint", "impairment", "side", "limits")
    sensed = [f"{n}_{axis}" for axis in AXES for n in ("velocity", "sensor")]
    sensed += [f"{n}_{axis}" for axis in AXES for n in of_axis]
    assert system.tasks == (
        Task("sense", tuple(sensed)),
        Task("control", ("request",), every=5),
    )
    joint = system.blocks["joint_flexion"]
    asked = impaired_device().file.impairment.bandwidth_Hz.value
    assert next(t.default for t in joint.tunables if t.name == "bandwidth_Hz") == asked
    (angle,) = joint.inputs
    assert (angle.low, angle.high) == pytest.approx((-3.1415926, 3.1415926))
    # Each axis has the same Blocks.
    for name in of_axis:
        assert system.blocks[f"{name}_flexion"] is system.blocks[f"{name}_deviation"]
