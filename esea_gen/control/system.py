"""Torque and impedance control: encoders in, motor torque out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from esea_gen.control.limits import command_stamp, limits
from esea_gen.control.reference import reference
from esea_gen.control.setpoint import setpoint_rates
from esea_gen.control.sliding_mode import sliding_mode
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block
from esea_gen.language.system import System, Task
from esea_gen.model.encoder import encoder
from esea_gen.model.joint import deflection
from esea_gen.observe.disturbance import drive_observer
from esea_gen.observe.human import extended_state, lag_observer
from esea_gen.observe.rates import butterworth_rate, load_rate, motor_rate


@dataclass(frozen=True)
class Parts:
    """What a controlling System is wired from.

    Parameters
    ----------
    blocks : mapping of str to Block
        Instances by name.
    sense : tuple of str
        Those of the sensing task, in order.
    control : Task
        Period, phase and release of the control task, and its instances.
    wires, inputs, outputs : mapping
        As in :class:`esea_gen.language.system.System`.
    """

    blocks: Mapping[str, Block]
    sense: tuple[str, ...]
    control: Task
    wires: Mapping[str, str]
    inputs: Mapping[str, tuple[str, ...]]
    outputs: Mapping[str, str]


def torque_control_system(
    device: DeviceData, velocity: Block, sensor: Block, inverse: Block
) -> System:
    """The controlling System: sensing, observers and limits in one task, the controller in another.

    Task ``sense`` runs at the sensing rate: encoders, deflection, torque, rates, set torque with
    its inverse, limits, observers.  Task ``control`` runs at the control rate and gives a stamped
    command, which the limits take up from a latch.  So nothing reaches the motor that has not
    passed the limits, in the very period in which it is sent.

    Parameters
    ----------
    device : DeviceData
        A device with a drive.
    velocity, sensor, inverse : Block
        Deflection rate, torque sensor and its inverse.

    Returns
    -------
    System
        External inputs: counts and frame errors of both encoders, ``mode``, ``stop``, ``rearm``,
        the wanted torque, angle and rate.  External outputs: ``u_Nm`` for the motor, what was
        measured and estimated, and every status word.

    Raises
    ------
    UserError
        When the device lacks a section that torque control needs.
    """
    parts = torque_control_parts(device, velocity, sensor, inverse, sliding_mode)
    return System(
        device.name,
        device.period_s,
        parts.blocks,
        (Task("sense", parts.sense), parts.control),
        parts.wires,
        parts.inputs,
        parts.outputs,
    )


def torque_control_parts(
    device: DeviceData,
    velocity: Block,
    sensor: Block,
    inverse: Block,
    law: Callable[[DeviceData], Block] | None,
) -> Parts:
    """What :func:`torque_control_system` is wired from.

    Parameters
    ----------
    device, velocity, sensor, inverse
        As there.
    law : callable or None
        Makes the sliding mode; None for another law, which then feeds the stamp itself.

    Returns
    -------
    Parts
        Blocks, wires and tasks.

    Raises
    ------
    UserError
        When the device lacks a section that torque control needs.
    """
    published = device.file.sliding_mode is not None and (
        device.file.sliding_mode.setpoint_acceleration == "zero"
    )
    blocks: dict[str, Block] = {
        "encoder_motor": encoder(device, "motor"),
        "encoder_load": encoder(device, "load"),
        "joint": deflection(device),
        "velocity": velocity,
        "sensor": sensor,
        "motor_rate": motor_rate(device),
        "load_rate": load_rate(device),
        "reference": reference(device),
        "inverse": inverse,
        "setpoint": setpoint_rates(device, "differences" if published else "observer"),
        "limits": limits(device),
        "drive": drive_observer(device),
        "human": lag_observer(device) if published else extended_state(device),
    }
    # A derivative is of a filtered signal, as printed, where the device file names its cut-off.
    cutoff = device.file.sliding_mode.setpoint_filter_Hz if device.file.sliding_mode else None
    if cutoff is not None:
        blocks["set_rate"] = butterworth_rate(device, "set_rate", cutoff)
    sense = tuple(blocks)
    # Last: what an observer refuses by itself is clearer than a loop that swings because of it.
    blocks |= ({"smc": law(device)} if law else {}) | {"stamp": command_stamp(device)}

    angle = {"motor": "encoder_motor.theta_rad", "load": "encoder_load.theta_rad"}
    rate = {"motor": "motor_rate.omega_rad_s", "load": "load_rate.omega_rad_s"}
    sources = {
        "theta_motor_rad": angle["motor"],
        "theta_load_rad": angle["load"],
        "motor_usable": "encoder_motor.usable",
        "load_usable": "encoder_load.usable",
        "omega_motor_rad_s": rate["motor"],
        "omega_load_rad_s": rate["load"],
        "theta_rad": "joint.theta_rad",
        "sensing_ok": "joint.sensing_ok",
        "tau_Nm": "sensor.tau_Nm",
        "tau_h_Nm": "human.tau_h_Nm",
        "d4_rad_s2": "drive.d4_rad_s2",
        "u_a_Nm": "drive.u_a_Nm",
        "u_Nm": "limits.u_Nm",
        "u_applied_Nm": "limits.u_Nm",
        "mode": "reference.mode",
        "request_ok": "reference.request_ok",
        "theta_set_rad": "inverse.theta_rad",
        "delta_set_rad": "setpoint.delta_set_rad",
        "delta_rate_rad_s": "set_rate.omega_rad_s" if cutoff else "setpoint.delta_rate_rad_s",
        "delta_acc_rad_s2": "setpoint.delta_acc_rad_s2",
        "control_beat": "stamp.control_beat",
    }
    special = {
        "velocity.theta_rad": "joint.theta_rad",
        "sensor.omega_rad_s": "velocity.omega_mid_rad_s",
        "motor_rate.theta_rad": angle["motor"],
        "load_rate.theta_rad": angle["load"],
        "set_rate.theta_rad": "inverse.theta_rad",
        "inverse.tau_Nm": "reference.tau_set_Nm",
        "limits.u_command_Nm": "stamp.u_command_Nm",
    }
    external = {
        "count_motor": ("encoder_motor.count",),
        "frame_error_motor": ("encoder_motor.frame_error",),
        "count_load": ("encoder_load.count",),
        "frame_error_load": ("encoder_load.frame_error",),
        # The limits see the mode itself: what the reference makes of an invalid one is off, which
        # would be no fault.
        "mode": ("reference.mode", "limits.mode"),
        "stop": ("limits.stop",),
        "rearm": ("limits.rearm",),
        "tau_desired_Nm": ("reference.tau_desired_Nm",),
        "theta_desired_rad": ("reference.theta_desired_rad",),
        "omega_desired_rad_s": ("reference.omega_desired_rad_s",),
    }
    from_outside = {sink for sinks in external.values() for sink in sinks}
    wires = {k: v for k, v in special.items() if k.partition(".")[0] in blocks}
    for name, block in blocks.items():
        for port in block.inputs:
            sink = f"{name}.{port.name}"
            if sink == "stamp.u_command_Nm":
                continue  # the law's
            if sink not in wires and sink not in from_outside:
                wires[sink] = sources[port.name]
    if law:
        wires["stamp.u_command_Nm"] = "smc.u_command_Nm"
    outputs = {
        "u_Nm": "limits.u_Nm",
        "tau_Nm": "sensor.tau_Nm",
        "tau_set_Nm": "reference.tau_set_Nm",
        "theta_rad": "joint.theta_rad",
        "theta_motor_rad": angle["motor"],
        "theta_load_rad": angle["load"],
        "omega_motor_rad_s": rate["motor"],
        "omega_load_rad_s": rate["load"],
        "delta_set_rad": "setpoint.delta_set_rad",
        "tau_h_Nm": "human.tau_h_Nm",
        "d4_rad_s2": "drive.d4_rad_s2",
        "energy_J": "limits.energy_J",
        "fault": "limits.fault",
        "mode_held": "reference.mode",
        "u_command_Nm": "smc.u_command_Nm",
        "surface_rad_s": "smc.s_rad_s",
        "u_eq_Nm": "smc.u_eq_Nm",
        "k_smc_Nm": "smc.k_smc_Nm",
    }
    outputs |= {f"{n}_status": f"{n}.status" for n, b in blocks.items() if b.status_port}
    timing = device.file.timing
    assert timing.control_rate_Hz is not None
    every = round(timing.sense_rate_Hz.value / timing.control_rate_Hz.value)
    release_s = timing.control_release_s
    release = round(release_s.value / device.period_s) if release_s else None
    control = Task("control", ("smc", "stamp") if law else ("stamp",), every=every, release=release)
    return Parts(blocks, sense, control, wires, external, outputs)
