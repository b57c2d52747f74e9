"""The predictive controller among the other Blocks: sensing, observers and limits as they are."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import casadi as ca

from esea_gen.block import Block, Port
from esea_gen.control.horizon import Horizon
from esea_gen.control.predictive_drive import predictive_controller
from esea_gen.control.system import torque_control_system
from esea_gen.observe import drive_of
from esea_gen.observe.human import extended_state
from esea_gen.system import System, Task

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

REPLACED = ("smc", "inverse", "setpoint", "set_rate", "human")


def with_state_as_output(block: Block, name: str, meaning: str) -> Block:
    """A Block that also gives one of its new states as an output.

    Parameters
    ----------
    block : Block
        Any Block.
    name : str
        The state.
    meaning : str
        What the output means.

    Returns
    -------
    Block
        The same Block with one more output of the state's name; no operation is added.

    Raises
    ------
    ValueError
        When there is no such state, or an output has that name already.
    """
    index = next((i for i, p in enumerate(block.state) if p.name == name), None)
    if index is None or name in [p.name for p in block.outputs]:
        raise ValueError(f"block {block.name}: no state {name}, or an output has that name")
    port = block.state[index]
    more = Port(name, port.low, port.high, meaning, port.size, port.equation)

    def widened(f: ca.Function) -> ca.Function:
        arguments = f.sx_in()
        results = f.call(arguments)
        names = f.name_out()
        at = len(block.state) + len(block.outputs)
        results.insert(at, results[index])
        names.insert(at, f"y_{name}")
        return ca.Function(f.name(), arguments, results, f.name_in(), names)

    return replace(
        block,
        outputs=(*block.outputs, more),
        step=widened(block.step),
        labelled_step=widened(block.labelled_step),
    )


def predictive_delay_s(device: DeviceData) -> float:
    """From a measurement to the moment at which a command that rests on it takes effect.

    Parameters
    ----------
    device : DeviceData
        A device with a drive.

    Returns
    -------
    float
        One sensing period, after which the measurement is released, and the control task's own
        release (its period where the file gives none).
    """
    release = device.file.timing.control_release_s
    control = drive_of(device).control_period_s if release is None else release.value
    return device.period_s + control


def predictive_system(
    device: DeviceData,
    velocity: Block,
    sensor: Block,
    inverse: Block,
    *,
    horizon: Horizon | None = None,
    preview: bool = False,
) -> System:
    """The controlling System with predictive control in place of sliding mode.

    Parameters
    ----------
    device : DeviceData
        A device with a drive.
    velocity, sensor, inverse : Block
        As for :func:`esea_gen.control.system.torque_control_system`, whose wiring is kept; the
        inverse drops out with the sliding mode.
    horizon : Horizon, optional
        Grid of the prediction; 10 intervals of 20 ms, 4 substeps and
        :func:`predictive_delay_s` when not given.
    preview : bool
        Whether the control task has an external input ``tau_preview_Nm`` with the wanted torque at
        the end of every interval; without, the set torque holds over the horizon.

    Returns
    -------
    System
        External inputs and outputs as the sliding mode's, less those of Blocks that dropped out;
        ``predictive_status`` and ``iterations`` among the outputs.

    Raises
    ------
    UserError
        When the device lacks a section that torque control needs.
    """
    base = torque_control_system(device, velocity, sensor, inverse)
    grid = horizon or Horizon(delay_s=predictive_delay_s(device))
    program = predictive_controller(device, horizon=grid, preview=preview)
    blocks: dict[str, Any] = {n: b for n, b in base.blocks.items() if n not in REPLACED}
    blocks["sensor"] = with_state_as_output(
        sensor, "play_rad", "play states of the stop operators, for predictive control"
    )
    blocks |= {"human": extended_state(device), "predictive": program}
    sense = [n for n in base.task("sense").blocks if n in blocks]
    wires = {
        str_of(sink): str_of(source)
        for sink, source in base.wires.items()
        if sink.instance in blocks and source.instance in blocks and sink.instance != "human"
    }
    angle = {"theta_load_rad": "encoder_load.theta_rad", "tau_Nm": "sensor.tau_Nm"}
    wires |= {f"human.{p.name}": angle[p.name] for p in blocks["human"].inputs}
    sources = {
        "delta_rad": "joint.theta_rad",
        "omega_rad_s": "velocity.omega_rad_s",
        "omega_l_rad_s": "human.omega_load_rad_s",
        "u_a_Nm": "drive.u_a_Nm",
        "u_in_force_Nm": "limits.u_Nm",
        "tau_rate_Nm": "sensor.tau_rate_Nm",
        "play_rad": "sensor.play_rad",
        "d4_rad_s2": "drive.d4_rad_s2",
        "tau_h_Nm": "human.tau_h_Nm",
        "tau_h_rate_Nm_s": "human.tau_h_rate_Nm_s",
        "mode": "reference.mode",
        "tau_d_Nm": "reference.tau_set_Nm",
    }
    wires |= {
        f"predictive.{p.name}": sources[p.name]
        for p in program.inputs
        if not (preview and p.name == "tau_d_Nm")
    }
    wires["stamp.u_command_Nm"] = "predictive.u_Nm"
    inputs = {x.name: tuple(str_of(s) for s in x.signals) for x in base.inputs}
    inputs = {
        n: tuple(s for s in sinks if s.partition(".")[0] in blocks) for n, sinks in inputs.items()
    }
    inputs = {n: sinks for n, sinks in inputs.items() if sinks}
    if preview:
        inputs["tau_preview_Nm"] = ("predictive.tau_d_Nm",)
    outputs = {
        x.name: str_of(x.signals[0])
        for x in base.outputs
        if x.signals[0].instance in blocks and x.signals[0].instance != "human"
    }
    outputs |= {
        "tau_h_Nm": "human.tau_h_Nm",
        "human_status": "human.status",
        "u_command_Nm": "predictive.u_Nm",
        "iterations": "predictive.iterations",
        "predictive_status": "predictive.status",
    }
    control = base.task("control")
    # Observers read what the limits have let through.
    order = [n for n in sense if n != "human"] + ["human"]
    return System(
        base.name,
        base.base_period_s,
        blocks,
        (
            Task("sense", tuple(order)),
            Task("control", ("predictive", "stamp"), control.every, control.phase, control.release),
        ),
        wires,
        inputs,
        outputs,
    )


def str_of(signal: Any) -> str:
    """``instance.port`` of a signal.

    Parameters
    ----------
    signal : Signal
        Any signal.

    Returns
    -------
    str
        What :meth:`esea_gen.system.Signal.parse` reads.
    """
    return f"{signal.instance}.{signal.port}"
