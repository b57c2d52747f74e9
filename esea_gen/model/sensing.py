"""The measuring System: velocity estimate and torque sensor of every axis."""

from __future__ import annotations

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block
from esea_gen.language.ports import UNIT_SUFFIXES
from esea_gen.language.system import System, Task


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
    device: DeviceData,
    velocity: Block,
    sensor: Block,
    impaired: tuple[Block, Block, Block] | None = None,
) -> System:
    """The measuring System: velocity estimate and torque sensor in one task.

    A device with several axes has an instance of both Blocks for each, all in the same task; the
    names of instances, inputs and outputs then carry the axis (``sensor_flexion``,
    ``theta_flexion_rad``, ``sensor_flexion_status``).

    Parameters
    ----------
    device : DeviceData
        What to build for.
    velocity, sensor : Block
        Velocity estimate and torque sensor.
    impaired : tuple of Block, optional
        What is asked of the impairments, the rate of a joint, and the impairment; the first stands
        once for all axes, so that they are asked for together.

    Returns
    -------
    System
        Task ``sense``: deflection in; torque, its parts, rates and status words out.  With
        impairments also the joint's angle in, ``theta_load_rad``, and the torque that they want
        out.
    """
    blocks: dict[str, Block] = {}
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
        if impaired is None:
            continue
        request, joint, wall = impaired
        turning, limb = (f"{b.name}_{axis}" if axis else b.name for b in (joint, wall))
        blocks |= {request.name: request, turning: joint, limb: wall}
        wires[f"{limb}.constrained"] = f"{request.name}.constrained"
        wires[f"{limb}.omega_rad_s"] = f"{turning}.omega_rad_s"
        inputs[of_axis("theta_load_rad", axis)] = (f"{turning}.theta_rad", f"{limb}.theta_rad")
        outputs[of_axis("omega_load_rad_s", axis)] = f"{turning}.omega_rad_s"
        outputs[of_axis("tau_set_Nm", axis)] = f"{limb}.tau_set_Nm"
        outputs[of_axis("acts", axis)] = f"{limb}.acts"
        outputs |= {f"{x}_status": f"{x}.status" for x in (turning, limb)}
    return System(
        device.name,
        device.period_s,
        blocks,
        (Task("sense", tuple(blocks)),),
        wires,
        inputs,
        outputs,
    )
