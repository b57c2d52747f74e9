"""The measuring System: rate, smoothed deflection and torque of every axis."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block
from esea_gen.language.ports import UNIT_SUFFIXES
from esea_gen.language.system import System, Task
from esea_gen.language.watch import WATCH
from esea_gen.model.encoder import encoder
from esea_gen.model.filters import tracking_observer
from esea_gen.model.joint import deflection
from esea_gen.model.sections import section_of
from esea_gen.model.smoothing import smoothed_deflection

# Of one axis, from both encoders' counts: what a device that only measures makes of them.
ENCODER_WIRES = {
    "joint.theta_motor_rad": "encoder_motor.theta_rad",
    "joint.theta_load_rad": "encoder_load.theta_rad",
    "joint.motor_usable": "encoder_motor.usable",
    "joint.load_usable": "encoder_load.usable",
    "load_rate.theta_rad": "encoder_load.theta_rad",
    "velocity.theta_rad": "joint.theta_rad",
    "smooth.theta_rad": "joint.theta_rad",
    "smooth.omega_rad_s": "velocity.omega_mid_rad_s",
    "sensor.theta_rad": "smooth.theta_smooth_rad",
    "sensor.omega_rad_s": "velocity.omega_mid_rad_s",
}
ENCODER_INPUTS: dict[str, tuple[str, ...]] = {
    f"{name}_{side}": (f"encoder_{side}.{name}",)
    for side in ("motor", "load")
    for name in ("count", "frame_error")
}
ENCODER_OUTPUTS = {
    "tau_Nm": "sensor.tau_Nm",
    "theta_rad": "joint.theta_rad",
    "omega_rad_s": "velocity.omega_rad_s",
    "theta_motor_rad": "encoder_motor.theta_rad",
    "theta_load_rad": "encoder_load.theta_rad",
    "omega_load_rad_s": "load_rate.omega_rad_s",
    "sensing_ok": "joint.sensing_ok",
}


def of_axis(name: str, axis: str) -> str:
    """A name with its axis, before the unit, which stays last: ``tau_flexion_Nm``."""
    if not axis:
        return name
    unit = max((u for u in UNIT_SUFFIXES if name.endswith(u)), key=len, default="")
    return f"{name.removesuffix(unit)}_{axis}{unit}"


def without_axis(name: str, axis: str) -> str:
    """A name of an axis without it, as :func:`of_axis` was given it; any other name as it is."""
    bare = name.replace(f"_{axis}", "", 1) if axis else name
    return bare if of_axis(bare, axis) == name else name


def zeros_missing(system: System) -> dict[str, dict[str, float]]:
    """Tunables that zero the encoders which have no zero, where 0 is known to be right."""
    return {
        i: {"zeroed": 1.0} for i, t in system.tunables if (t.name, t.default) == ("zeroed", 0.0)
    }


class AxisParts(NamedTuple):
    """Blocks, wires, inputs and outputs of a System, or of one axis of it."""

    blocks: dict[str, Any]
    wires: dict[str, str]
    inputs: dict[str, tuple[str, ...]]
    outputs: dict[str, str]


def instance_of(name: str, axis: str) -> str:
    return f"{name}_{axis}" if axis else name


def of_axes(axes: Sequence[str], one: AxisParts, shared: Collection[str] = ()) -> AxisParts:
    """The parts of one axis for each; inputs that are ``shared`` feed all of them."""
    every = AxisParts({}, {}, {}, {})
    for axis in axes:

        def end(signal: str, axis: str = axis) -> str:
            name, _, port = signal.partition(".")
            return signal if name == WATCH else f"{instance_of(name, axis)}.{port}"

        every.blocks.update({instance_of(n, axis): b for n, b in one.blocks.items()})
        every.wires.update({end(r): end(w) for r, w in one.wires.items()})
        for name, sinks in one.inputs.items():
            outer = name if name in shared else of_axis(name, axis)
            every.inputs[outer] = every.inputs.get(outer, ()) + tuple(map(end, sinks))
        every.outputs.update({of_axis(n, axis): end(s) for n, s in one.outputs.items()})
    return every


def sensing_system(
    device: DeviceData, velocity: Block, sensor: Block, *, counts: bool = True
) -> System:
    """Velocity estimate, smoothed deflection and torque sensor of every axis in one task."""
    blocks = {"velocity": velocity, "sensor": sensor}
    wires = {"sensor.omega_rad_s": "velocity.omega_mid_rad_s"}
    sinks, told = ["velocity.theta_rad", "sensor.theta_rad"], {}
    ports = ("tau_Nm", "tau_spring_Nm", "tau_rate_Nm", "tau_hysteresis_Nm")
    outputs = {n: f"sensor.{n}" for n in ports} | {"omega_rad_s": "velocity.omega_rad_s"}
    outputs |= {f"{n}_status": f"{n}.status" for n in ("sensor", "velocity")}
    # Not where a loop closes over the torque: it gains nothing, and limp hands were driven into a
    # swing by the filter within a count (docs/deflection-smoothing.md).
    if counts and device.file.joint is None:
        smoothing = smoothed_deflection(device)
        blocks = {"velocity": velocity, "smoothing": smoothing, "sensor": sensor}
        wires["smoothing.omega_rad_s"] = "velocity.omega_mid_rad_s"
        wires["sensor.theta_rad"] = "smoothing.theta_smooth_rad"
        sinks[1] = "smoothing.theta_rad"
        told = {"smoothing_status": "smoothing.status"}
    one = AxisParts(blocks, wires, {"theta_rad": tuple(sinks)}, outputs)
    parts = of_axes(device.axes, one)
    ends = parts.outputs | of_axes(device.axes, AxisParts({}, {}, {}, told)).outputs
    # The status of an instance is named by the whole of its name.
    outputs = {f"{s[:-7]}_status" if s.endswith(".status") else n: s for n, s in ends.items()}
    task = Task("sense", tuple(parts.blocks))
    system = parts._replace(outputs=outputs)
    return System(device.name, device.period_s, parts.blocks, (task,), *system[1:])


def measures_counts(device: DeviceData) -> bool:
    """Whether a device's file has the numbers to turn counts of its encoders into a deflection."""
    encoders = device.file.encoder
    return None not in (encoders.motor, encoders.load, device.file.joint)


def counting_system(device: DeviceData, velocity: Block, sensor: Block) -> System:
    """Measuring System from the counts of both encoders, for a board without a motor."""
    joint = section_of(device, "joint")
    reach_rad = max(abs(joint.theta_min_rad.value), abs(joint.theta_max_rad.value))
    blocks = {
        "encoder_motor": encoder(device, "motor"),
        "encoder_load": encoder(device, "load"),
        "joint": deflection(device),
        "load_rate": tracking_observer(device, reach_rad, device.file.velocity.bandwidth_Hz),
        "velocity": velocity,
        "smooth": smoothed_deflection(device),
        "sensor": sensor,
    }
    told = {f"{n}_status": f"{n}.status" for n in blocks}
    one = AxisParts(blocks, ENCODER_WIRES, ENCODER_INPUTS, ENCODER_OUTPUTS | told)
    parts = of_axes(device.axes, one)
    tasks = tuple(
        Task(instance_of("sense", a), tuple(instance_of(n, a) for n in blocks)) for a in device.axes
    )
    return System(device.name, device.period_s, parts.blocks, tasks, *parts[1:])
