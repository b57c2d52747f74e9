"""Torque and impedance control for any law: from encoder counts to motor torque.

Every command passes the limits in the period in which it is sent: the control task gives a stamped
command, which the limits in the sensing task read from a latch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from esea_gen.control.adaptation import adaptation
from esea_gen.control.impairment import has_wall, impairment
from esea_gen.control.interpolation import DESIRED, interpolation
from esea_gen.control.law import Base, Law, Parts
from esea_gen.control.law_switch import law_switch
from esea_gen.control.limits.block import command_stamp, limits
from esea_gen.control.limits.monitor import Watched, encoder_monitor, monitor
from esea_gen.control.limits.redundancy import redundancy
from esea_gen.control.motor_temperature import motor_temperature
from esea_gen.control.own_law import wrong_wire
from esea_gen.control.passivity import passivity
from esea_gen.control.reference import reference
from esea_gen.control.shown import gains_reference
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.alike import alike, emitted_once
from esea_gen.language.block import Block
from esea_gen.language.component import Component
from esea_gen.language.system import System, Task
from esea_gen.model.encoder import SIDES, encoder
from esea_gen.model.gear_encoder import gear_encoder
from esea_gen.model.joint import deflection
from esea_gen.model.sensing import AxisParts, instance_of, of_axes
from esea_gen.observe.disturbance import drive_observer, gear_observer
from esea_gen.observe.human import extended_state
from esea_gen.observe.rates import load_rate, motor_rate

SIGNALS = {
    "theta_motor_rad": "encoder_motor.theta_rad",
    "theta_load_rad": "encoder_load.theta_rad",
    "motor_usable": "encoder_motor.usable",
    "load_usable": "encoder_load.usable",
    "omega_motor_rad_s": "motor_rate.omega_rad_s",
    "omega_load_rad_s": "load_rate.omega_rad_s",
    "theta_rad": "joint.theta_rad",
    "sensing_ok": "joint.sensing_ok",
    "tau_Nm": "sensor.tau_Nm",
    "tau_h_Nm": "human.tau_h_Nm",
    "d4_rad_s2": "drive.d4_rad_s2",
    "u_a_Nm": "drive.u_a_Nm",
    "u_Nm": "limits.u_Nm",
    "u_applied_Nm": "limits.u_Nm",
    "mode": "reference.mode",
    "wish_ok": "interpolation.wish_ok",
    **{n: f"interpolation.{n}" for n in DESIRED},
    "request_ok": "reference.request_ok",
    "tau_set_Nm": "reference.tau_set_Nm",
    "control_beat": "stamp.control_beat",
    "clock_ok": "watch.clock_ok",
    "late_level": "watch.late_level",
    "coeffs_ok": "watch.coeffs_ok",
}
WIRES = {
    "sensor.omega_rad_s": "velocity.omega_mid_rad_s",
    "motor_rate.theta_rad": "encoder_motor.theta_rad",
    "load_rate.theta_rad": "encoder_load.theta_rad",
    "limits.u_command_Nm": "stamp.u_command_Nm",
}
INPUTS = {
    "count_motor": ("encoder_motor.count",),
    "frame_error_motor": ("encoder_motor.frame_error",),
    "count_load": ("encoder_load.count",),
    "frame_error_load": ("encoder_load.frame_error",),
    # The limits see the mode itself: what the reference makes of an invalid one is off, which
    # would be no fault.
    "mode": ("interpolation.mode", "reference.mode", "limits.mode"),
    "stop": ("limits.stop",),
    "rearm": ("limits.rearm",),
    **{n: (f"interpolation.{n}",) for n in DESIRED},
}


class _Extra(NamedTuple):
    """Parts that an optional section of the device file adds."""

    signals: Mapping[str, str]
    wires: Mapping[str, str] = {}
    inputs: Mapping[str, tuple[str, ...]] = {}
    outputs: Mapping[str, str] = {}


EXTRAS = {
    "redundancy": _Extra(
        {
            "theta_gear_rad": "encoder_gear.theta_gear_rad",
            "omega_gear_rad_s": "encoder_gear.omega_gear_rad_s",
            "gear_usable": "encoder_gear.gear_usable",
            "d_gear_rad_s2": "gear.d_gear_rad_s2",
            "moves_rad_s2": "gear.moves_rad_s2",
            "agree": "redundancy.agree",
        },
        inputs={
            "count_gear": ("encoder_gear.count",),
            "frame_error_gear": ("encoder_gear.frame_error",),
        },
        outputs={n: f"redundancy.{n}" for n in ("apart_rad", "apart_Nm", "room_Nm")},
    ),
    "monitor": _Extra(
        {"doubt": "monitor.doubt"} | {f"doubt_{x}": f"monitor_{x}.doubt" for x in SIDES},
        inputs={
            f"{n}_{side}": (f"monitor_{side}.{n}",)
            for side in SIDES
            for n in ("count", "frame_error")
        },
    ),
    "monitor_gear": _Extra(
        {"doubt_gear": "monitor_gear.doubt"},
        inputs={f"{n}_gear": (f"monitor_gear.{n}",) for n in ("count", "frame_error")},
    ),
    # It stands between set torque and law, and between command and limits.
    "passivity": _Extra(
        {n: f"passivity.{n}" for n in ("tau_set_Nm", "request_ok")},
        {
            "passivity.tau_set_Nm": "reference.tau_set_Nm",
            "passivity.request_ok": "reference.request_ok",
            "passivity.Kp_Nm_rad": "reference.stiffness_Nm_rad",
            "passivity.Kd_Nms_rad": "reference.damping_Nms_rad",
            "passivity.u_command_Nm": "stamp.u_command_Nm",
            "limits.u_command_Nm": "passivity.u_command_Nm",
        },
        outputs={n: f"passivity.{n}" for n in ("damping_Nms_rad", "given_J", "held_J")},
    ),
    # What is wanted, turned for the rubber at hand.
    "adaptation": _Extra({n: f"adaptation.{n}" for n in ("wish_gain", "wish_shift_Nm")}),
    "motor_temperature": _Extra(
        {"u_thermal_Nm": "motor_temperature.u_thermal_Nm"},
        inputs={"motor_C": ("motor_temperature.motor_C",)},
        outputs={n: f"motor_temperature.{n}" for n in ("winding_C", "case_C", "capacity")},
    ),
    # Wall and resistance are added to what is wanted.
    "impairment": _Extra(
        {
            "constrained": "impairment.constrained",
            "tau_impairment_Nm": "impairment.tau_set_Nm",
            "impairment_ok": "impairment.usable",
        },
        {
            "impairment.theta_rad": "encoder_load.theta_rad",
            "impairment.omega_rad_s": "load_rate.omega_rad_s",
        },
        {"constrained": ("impairment.constrained",)},
        {"acts": "impairment.acts", "tau_impairment_Nm": "impairment.tau_set_Nm"},
    ),
}
# What ends the control task, whatever the law.
LAST = ("redundancy", "motor_temperature", "stamp")
# One for all axes: the machine is stopped, armed, driven and impaired as a whole.
SHARED = ("stop", "rearm", "mode", "law", "constrained")
MEASURED = {
    "u_Nm": "limits.u_Nm",
    "tau_Nm": "sensor.tau_Nm",
    "tau_set_Nm": "reference.tau_set_Nm",
    "theta_rad": "joint.theta_rad",
    "theta_motor_rad": "encoder_motor.theta_rad",
    "theta_load_rad": "encoder_load.theta_rad",
    "omega_motor_rad_s": "motor_rate.omega_rad_s",
    "omega_load_rad_s": "load_rate.omega_rad_s",
}
ESTIMATED = {
    "tau_h_Nm": "human.tau_h_Nm",
    "d4_rad_s2": "drive.d4_rad_s2",
    "energy_J": "limits.energy_J",
    "fault": "limits.fault",
    "mode_held": "reference.mode",
    **{n: f"reference.{n}" for n in ("tau_hold_Nm", "tau_blend_Nm")},
}


def control_system(
    device: DeviceData,
    laws: Sequence[Law],
    velocity: Block,
    sensor: Block,
    inverse: Callable[[], Block],
) -> System:
    base = _base(device, velocity, sensor, inverse)
    parts = [law.parts(base) for law in laws]
    sense, control = _blocks(base, laws, parts)
    try:
        one = _wired(emitted_once({**sense, **control}), laws, parts)
        return _of_axes(device, one, len(sense))
    except ValueError as error:
        if (told := wrong_wire(laws, error)) is not None:
            raise told from error
        raise


def _base(device: DeviceData, velocity: Block, sensor: Block, inverse: Callable[[], Block]) -> Base:
    redundant = device.file.redundancy is not None
    passive = device.file.passivity is not None
    watched: tuple[Watched, ...] = (*SIDES, "gear") if redundant else SIDES
    if device.file.monitor is None:
        watched = ()
    blocks: dict[str, Component] = {
        "encoder_motor": encoder(device, "motor"),
        "encoder_load": encoder(device, "load"),
        "joint": deflection(device),
        "velocity": velocity,
        "sensor": sensor,
        "motor_rate": motor_rate(device),
        "load_rate": load_rate(device),
        **({"encoder_gear": gear_encoder(device)} if redundant else {}),
        "interpolation": interpolation(device),
        **({"adaptation": adaptation(device)} if device.file.adaptation else {}),
        **({"impairment": impairment(device)} if device.file.impairment else {}),
        "reference": gains_reference(reference(device)) if passive else reference(device),
        **({"passivity": passivity(device)} if passive else {}),
        **{f"monitor_{side}": encoder_monitor(device, side) for side in watched},
        **({"monitor": monitor(device)} if watched else {}),
        "limits": limits(device),
        "drive": drive_observer(device),
        **({"gear": gear_observer(device)} if redundant else {}),
        "human": extended_state(device),
        **({"redundancy": redundancy(device)} if redundant else {}),
        **({"motor_temperature": motor_temperature(device)} if device.file.motor_thermal else {}),
        "stamp": command_stamp(device),
    }
    return Base(device, blocks, inverse)


def _blocks(
    base: Base, laws: Sequence[Law], parts: Sequence[Parts]
) -> tuple[dict[str, Component], dict[str, Component]]:
    # Of the sensing task and of the control task, in their order.
    blocks, whose = dict(base.blocks), dict.fromkeys(base.blocks, "")
    for law, part in zip(laws, parts, strict=True):
        for name, block in [*part.replaced.items(), *part.own.items()]:
            if whose.get(name) and _shared(blocks[name], block):
                continue
            if whose.get(name) or (name in part.own and name in whose):
                raise UserError(
                    f"{base.device.origin}: the laws {whose[name] or 'base'} and {law.name} both "
                    f"have a Block '{name}' of their own.",
                    "Give them different names, or one of the laws alone.",
                )
            blocks[name], whose[name] = block, law.name
    first = list(base.blocks)
    behind = first.index("limits")
    own = {n: part for part in parts for n in part.own}
    order = [
        *first[:behind],
        *(n for n, part in own.items() if n in part.sense),
        *(n for n in first[behind:] if n not in LAST),
        *(n for n, part in own.items() if n in part.after_limits),
    ]
    control = {n: blocks[n] for n, part in own.items() if n in part.control}
    if len(parts) > 1:
        checked = [law.name for law, part in zip(laws, parts, strict=True) if part.request_ok]
        control["law"] = law_switch(base.device, [law.name for law in laws], checked)
    control |= {n: blocks[n] for n in LAST if n in blocks}
    return {n: blocks[n] for n in order}, control


def _shared(one: Component, other: Component) -> bool:
    # Laws that need the same of what they stand on have it once.
    return isinstance(one, Block) and isinstance(other, Block) and alike(one, other)


def _wired(every: dict[str, Component], laws: Sequence[Law], parts: Sequence[Parts]) -> AxisParts:
    extras = [extra for name, extra in EXTRAS.items() if name in every]
    inputs, wires, known = dict(INPUTS), dict(WIRES), dict(SIGNALS)
    for extra in extras:
        inputs |= {n: (*inputs.get(n, ()), *sinks) for n, sinks in extra.inputs.items()}
        wires |= extra.wires
        known |= extra.signals
    if "monitor" in every:
        wires["monitor.u_command_Nm"] = wires["limits.u_command_Nm"]
    signals = dict.fromkeys(every, known)
    for part in parts:
        wires |= part.wires
        inputs |= part.inputs
        signals |= {n: {**known, **part.signals} for n in part.own}
    own, told = _command(laws, parts)
    wires |= own
    if "law" in every:
        inputs["law"] = ("law.law",)
    from_outside = {sink for sinks in inputs.values() for sink in sinks}
    for name, block in every.items():
        for port in block.inputs:
            sink = f"{name}.{port.name}"
            if sink not in wires and sink not in from_outside:
                if port.name not in signals[name]:
                    raise ValueError(f"no wire for {sink}; signals are {sorted(signals[name])}")
                wires[sink] = signals[name][port.name]
    if "passivity" in every:
        # A law that names the reference itself is damped as well.
        bare, damped = "reference.tau_set_Nm", "passivity.tau_set_Nm"
        wires |= {r: damped for r, w in wires.items() if w == bare and r != damped}
    outputs = dict(MEASURED)
    for part in parts:
        outputs |= part.setpoints
    outputs |= ESTIMATED | told
    for extra in extras:
        outputs |= extra.outputs
    for part in parts:
        outputs |= part.outputs
    outputs |= {f"{n}_status": f"{n}.status" for n, b in every.items() if b.status_port}
    return AxisParts(every, wires, inputs, outputs)


def _command(laws: Sequence[Law], parts: Sequence[Parts]) -> tuple[dict[str, str], dict[str, str]]:
    # Wires of the command to its stamp, and what is told of it.
    if len(parts) == 1:
        wires = {"stamp.u_command_Nm": parts[0].command}
        if parts[0].request_ok:
            wires["stamp.request_ok"] = parts[0].request_ok
        return wires, {"u_command_Nm": parts[0].command}
    wires = {"stamp.u_command_Nm": "law.u_command_Nm"}
    for law, part in zip(laws, parts, strict=True):
        wires[f"law.u_{law.name}_Nm"] = part.command
        if part.request_ok:
            wires[f"law.ok_{law.name}"] = part.request_ok
    if any(part.request_ok for part in parts):
        wires["stamp.request_ok"] = "law.request_ok"
    return wires, {"u_command_Nm": "law.u_command_Nm", "law_held": "law.law_held"}


def _of_axes(device: DeviceData, one: AxisParts, senses: int) -> System:
    # The first ``senses`` Blocks of an axis are its sensing task's, the others its control task's.
    parts = of_axes(device.axes, one, SHARED)
    if "impairment" in one.blocks:
        open_axes = [a for a in device.axes if not has_wall(device, a)]
        names = [instance_of("impairment", a) for a in open_axes]
        parts.blocks.update(dict.fromkeys(names, impairment(device, wall=False)))
    timing = device.file.timing
    assert timing.control_rate_Hz is not None  # the limits have asked for it
    every = round(timing.sense_rate_Hz.value / timing.control_rate_Hz.value)
    release_s = timing.control_release_s
    release = round(release_s.value / device.period_s) if release_s else None
    # A task an axis: each has its own messages, which so stay within a frame.
    of = {a: [instance_of(n, a) for n in one.blocks] for a in device.axes}
    sense = (Task(instance_of("sense", a), tuple(n[:senses])) for a, n in of.items())
    control = (
        Task(instance_of("control", a), tuple(n[senses:]), every=every, release=release)
        for a, n in of.items()
    )
    tasks = (*sense, *control)
    return System(device.name, device.period_s, parts.blocks, tasks, *parts[1:])
