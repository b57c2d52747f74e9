"""The measuring System: rate, smoothed deflection and torque of every axis."""

from __future__ import annotations

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block
from esea_gen.language.component import Component
from esea_gen.language.ports import UNIT_SUFFIXES
from esea_gen.language.system import System, Task
from esea_gen.model.smoothing import smoothed_deflection


def of_axis(name: str, axis: str) -> str:
    """A name with its axis, before the unit, which stays last: ``tau_flexion_Nm``.

    Parameters
    ----------
    name, axis : str
        A quantity's name and an axis; empty for a single axis without a name.

    Returns
    -------
    str
        The name of that axis' quantity.
    """
    if not axis:
        return name
    unit = max((u for u in UNIT_SUFFIXES if name.endswith(u)), key=len, default="")
    return f"{name.removesuffix(unit)}_{axis}{unit}"


def sensing_system(
    device: DeviceData, velocity: Block, sensor: Block, *, counts: bool = True
) -> System:
    """The measuring System: velocity estimate, smoothed deflection and torque sensor in one task.

    A device with several axes has an instance of each Block for each axis, all in the same task;
    the names of instances, inputs and outputs then carry the axis (``sensor_flexion``,
    ``theta_flexion_rad``, ``sensor_flexion_status``).

    Parameters
    ----------
    device : DeviceData
        What to build for.
    velocity, sensor : Block
        Velocity estimate and torque sensor.
    counts : bool
        Whether the deflection comes in counts of encoders; else there is nothing to smooth.

    Returns
    -------
    System
        Task ``sense``: deflection in; torque, its parts, rates and status words out.
    """
    blocks, wires, inputs, outputs = sensing_parts(device, velocity, sensor)
    order = list(blocks)
    # Not where a loop closes over the torque: it gains nothing, and limp hands were driven into a
    # swing by the filter within a count (docs/sensor.md).
    smoothing = smoothed_deflection(device)
    for axis in device.axes if counts and device.file.joint is None else ():
        rate, smooth, torque = (
            f"{b.name}_{axis}" if axis else b.name for b in (velocity, smoothing, sensor)
        )
        blocks[smooth] = smoothing
        order.insert(order.index(torque), smooth)
        wires[f"{smooth}.omega_rad_s"] = f"{rate}.omega_mid_rad_s"
        wires[f"{torque}.theta_rad"] = f"{smooth}.theta_smooth_rad"
        inputs[of_axis("theta_rad", axis)] = (f"{rate}.theta_rad", f"{smooth}.theta_rad")
        outputs[f"{smooth}_status"] = f"{smooth}.status"
    blocks = {n: blocks[n] for n in order}
    task = Task("sense", tuple(order))
    return System(device.name, device.period_s, blocks, (task,), wires, inputs, outputs)


def sensing_parts(
    device: DeviceData, velocity: Block, sensor: Block
) -> tuple[dict[str, Component], dict[str, str], dict[str, tuple[str, ...]], dict[str, str]]:
    """Blocks, wires, inputs and outputs of the measuring System, to which others may add theirs.

    Parameters
    ----------
    device, velocity, sensor
        As for :func:`sensing_system`.

    Returns
    -------
    tuple of dict
        In the order and form of :class:`~esea_gen.language.system.System`.
    """
    blocks: dict[str, Component] = {}
    wires: dict[str, str] = {}
    inputs: dict[str, tuple[str, ...]] = {}
    outputs: dict[str, str] = {}
    for axis in device.axes:
        rate, torque = (f"{b.name}_{axis}" if axis else b.name for b in (velocity, sensor))
        blocks |= {rate: velocity, torque: sensor}
        wires[f"{torque}.omega_rad_s"] = f"{rate}.omega_mid_rad_s"
        inputs[of_axis("theta_rad", axis)] = (f"{rate}.theta_rad", f"{torque}.theta_rad")
        for port in ("tau_Nm", "tau_spring_Nm", "tau_rate_Nm", "tau_hysteresis_Nm"):
            outputs[of_axis(port, axis)] = f"{torque}.{port}"
        outputs[of_axis("omega_rad_s", axis)] = f"{rate}.omega_rad_s"
        outputs[f"{torque}_status"] = f"{torque}.status"
        outputs[f"{rate}_status"] = f"{rate}.status"
    return blocks, wires, inputs, outputs
