"""The measuring System: rate, smoothed deflection and torque of every axis."""

from __future__ import annotations

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block
from esea_gen.language.component import Component
from esea_gen.language.ports import UNIT_SUFFIXES
from esea_gen.language.system import System, Task
from esea_gen.model.encoder import encoder
from esea_gen.model.filters import tracking_observer
from esea_gen.model.joint import deflection
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
ENCODER_INPUTS = {
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


def sensing_system(
    device: DeviceData, velocity: Block, sensor: Block, *, counts: bool = True
) -> System:
    """Velocity estimate, smoothed deflection and torque sensor of every axis in one task."""
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


def measures_counts(device: DeviceData) -> bool:
    """Whether a device's file has what turns the counts of its two encoders into a deflection."""
    encoders = device.file.encoder
    return None not in (encoders.motor, encoders.load, device.file.joint)


def counting_system(device: DeviceData, velocity: Block, sensor: Block) -> System:
    """The measuring System from the counts of both encoders: what a board without a motor runs."""
    parts = {
        "encoder_motor": encoder(device, "motor"),
        "encoder_load": encoder(device, "load"),
        "joint": deflection(device),
        "load_rate": tracking_observer(
            device, _reach_rad(device), device.file.velocity.bandwidth_Hz
        ),
        "velocity": velocity,
        "smooth": smoothed_deflection(device),
        "sensor": sensor,
    }
    told = {f"{n}_status": f"{n}.status" for n in parts}
    blocks: dict[str, Component] = {}
    wires: dict[str, str] = {}
    inputs: dict[str, tuple[str, ...]] = {}
    outputs: dict[str, str] = {}
    tasks = []
    for axis in device.axes:

        def end(signal: str, axis: str = axis) -> str:
            name, _, port = signal.partition(".")
            return f"{name}_{axis}.{port}" if axis else signal

        own = {end(f"{n}.").removesuffix("."): block for n, block in parts.items()}
        blocks |= own
        wires |= {end(r): end(w) for r, w in ENCODER_WIRES.items()}
        inputs |= {of_axis(n, axis): tuple(map(end, s)) for n, s in ENCODER_INPUTS.items()}
        outputs |= {of_axis(n, axis): end(s) for n, s in (ENCODER_OUTPUTS | told).items()}
        tasks.append(Task(f"sense_{axis}" if axis else "sense", tuple(own)))
    return System(device.name, device.period_s, blocks, tuple(tasks), wires, inputs, outputs)


def _reach_rad(device: DeviceData) -> float:
    joint = device.file.joint
    assert joint is not None  # the deflection has asked for it
    return max(abs(joint.theta_min_rad.value), abs(joint.theta_max_rad.value))


def sensing_parts(
    device: DeviceData, velocity: Block, sensor: Block
) -> tuple[dict[str, Component], dict[str, str], dict[str, tuple[str, ...]], dict[str, str]]:
    """Blocks, wires, inputs and outputs of the measuring System, to which others may add theirs."""
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
