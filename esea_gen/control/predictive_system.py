"""The predictive controller among the other Blocks: sensing, observers and limits as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import casadi as ca

from esea_gen.control.ahead import ahead
from esea_gen.control.horizon import Horizon
from esea_gen.control.limits import command_stamp
from esea_gen.control.predictive_drive import Q_BEST, R_BEST, Person, predictive_controller
from esea_gen.control.system import torque_control_parts
from esea_gen.language.block import Block, Port
from esea_gen.language.system import System, Task
from esea_gen.observe import drive_of
from esea_gen.observe.extrapolation import parabola
from esea_gen.observe.human import extended_state, lag_observer

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

REPLACED = ("smc", "inverse", "setpoint", "set_rate", "human")


def with_outputs(block: Block, more: Sequence[tuple[Port, str]]) -> Block:
    """A Block that also gives out what it reads or makes anyway.

    more: each further output with what it shows, by its name in ``labelled_step``: ``next_...`` a
        new state, ``c_...`` a coefficient, ``label_...`` a labelled value.
    return: the same Block with these outputs after its own; no operation is added.
    """
    labelled = block.labelled_step
    arguments = labelled.sx_in()
    results = labelled.call(arguments)
    known = dict(zip(labelled.name_in(), arguments, strict=True))
    known |= dict(zip(labelled.name_out(), results, strict=True))
    taken = [p.name for p in block.outputs]
    for port, source in more:
        if source not in known or known[source].numel() != port.size or port.name in taken:
            raise ValueError(
                f"block {block.name}: no {source} of size {port.size}, or an output has the name "
                f"{port.name}"
            )
        taken.append(port.name)
    at = len(block.state) + len(block.outputs)
    values = results[:at] + [known[source] for _, source in more]
    names = labelled.name_out()[:at] + [f"y_{port.name}" for port, _ in more]

    def function(name: str, results: list[ca.SX], names: list[str]) -> ca.Function:
        return ca.Function(name, arguments, results, labelled.name_in(), names)

    return replace(
        block,
        outputs=(*block.outputs, *(port for port, _ in more)),
        step=function(block.step.name(), values, names),
        labelled_step=function(
            labelled.name(), values + results[at:], names + labelled.name_out()[at:]
        ),
    )


def with_state_as_output(block: Block, name: str, meaning: str) -> Block:
    """A Block that also gives one of its new states as an output.

    return: the same Block with one more output of the state's name; no operation is added.
    """
    port = next((p for p in block.state if p.name == name), None)
    if port is None:
        raise ValueError(f"block {block.name}: no state {name}")
    shown = Port(name, port.low, port.high, meaning, port.size, port.equation)
    return with_outputs(block, [(shown, f"next_{name}")])


def predictive_delay_s(device: DeviceData) -> float:
    """From a measurement to the moment at which a command that rests on it takes effect.

    return: one sensing period, after which the measurement is released, and the control task's own
        release (its period where the file gives none).
    """
    release = device.file.timing.control_release_s
    control = drive_of(device).control_period_s if release is None else release.value
    return device.period_s + control


def device_predictive_system(
    device: DeviceData, velocity: Block, sensor: Block, inverse: Block
) -> System:
    """The System that a device file's section ``[predictive]`` asks for."""
    asked = device.file.predictive
    assert asked is not None
    return predictive_system(
        device,
        velocity,
        sensor,
        inverse,
        horizon=device_horizon(device),
        preview=asked.future == "given",
        one_layer=asked.impedance == "one_layer",
        person=asked.person,
        weights=(asked.Q.value, asked.R.value),
    )


def device_horizon(device: DeviceData) -> Horizon:
    """Grid of the prediction of a device.

    return: as its section ``[predictive]`` says, 10 intervals of 20 ms with 4 substeps where there
        is none; the delay is :func:`predictive_delay_s`.
    """
    asked, delay_s = device.file.predictive, predictive_delay_s(device)
    if asked is None:
        return Horizon(delay_s=delay_s)
    return Horizon(
        int(asked.intervals.value), asked.interval_s.value, int(asked.substeps.value), delay_s
    )


def predictive_system(
    device: DeviceData,
    velocity: Block,
    sensor: Block,
    inverse: Block,
    *,
    horizon: Horizon | None = None,
    preview: bool = False,
    one_layer: bool = True,
    person: Person = "extended_state",
    weights: tuple[float, float] = (Q_BEST, R_BEST),
) -> System:
    """The controlling System with predictive control in place of sliding mode.

    velocity, sensor, inverse: as for :func:`esea_gen.control.system.torque_control_system`, whose
        wiring is kept; the inverse drops out with the sliding mode.
    horizon: grid of the prediction; :func:`device_horizon` when not given.
    preview: whether the control task has an external input ``tau_preview_Nm`` with the wanted
        torque at the end of every interval (in one layer also ``theta_preview_rad`` and
        ``omega_preview_rad_s``); without, what is wanted now holds over the horizon.
    one_layer: whether the predictive controller holds the impedance law itself; else the reference
        Block sets the torque in impedance mode as for the sliding mode.
    person, weights: as in :func:`esea_gen.control.predictive_drive.predictive_controller`.
    return: external inputs and outputs as the sliding mode's, less those of Blocks that dropped
        out; ``predictive_status`` and ``iterations`` among the outputs.
    """
    base = torque_control_parts(device, velocity, sensor, inverse, None)
    grid = horizon or device_horizon(device)
    printed = person == "parabola"
    program = predictive_controller(
        device,
        horizon=grid,
        preview=preview or one_layer,
        impedance=one_layer,
        person=person,
        weights=weights,
    )
    blocks: dict[str, Any] = {n: b for n, b in base.blocks.items() if n not in REPLACED}
    blocks["sensor"] = with_state_as_output(
        sensor, "play_rad", "play states of the stop operators, for predictive control"
    )
    blocks["human"] = lag_observer(device) if printed else extended_state(device)
    control_order = ["predictive", "stamp"]
    if preview or one_layer:
        blocks["reference"] = _shown_reference(blocks["reference"])
        blocks["ahead"] = ahead(device, grid, given=preview, one_layer=one_layer)
        # A future that is no number stops for good, as a wish of now does.
        blocks["stamp"] = command_stamp(device, checked=True)
        control_order.insert(0, "ahead")
    if printed:
        blocks["parabola"] = parabola(device)
        control_order.insert(0, "parabola")
    blocks["predictive"] = program
    sense = [n for n in base.sense if n in blocks]
    # Observers read what the limits have let through.
    order = [n for n in sense if n != "human"] + ["human"]

    def stays(signal: str) -> bool:
        return signal.partition(".")[0] in blocks

    wires = {
        sink: source
        for sink, source in base.wires.items()
        if stays(sink) and stays(source) and not sink.startswith("human.")
    }
    sources = _sources(printed, "ahead" in blocks)
    from_outside = {}
    if preview:
        from_outside["tau_preview_Nm"] = ("ahead.tau_preview_Nm",)
        if one_layer:
            from_outside |= {
                n: (f"ahead.{n}",) for n in ("theta_preview_rad", "omega_preview_rad_s")
            }
    fed_outside = {s for sinks in from_outside.values() for s in sinks}
    for name in ("human", *(n for n in control_order if n != "stamp")):
        for p in blocks[name].inputs:
            sink = f"{name}.{p.name}"
            if sink not in fed_outside:
                wires[sink] = sources[name][p.name]
    wires["stamp.u_command_Nm"] = "predictive.u_Nm"
    if "ahead" in blocks:
        wires["stamp.request_ok"] = "ahead.request_ok"
    inputs = {n: tuple(s for s in sinks if stays(s)) for n, sinks in base.inputs.items()}
    inputs = {n: sinks for n, sinks in inputs.items() if sinks} | from_outside
    outputs = {
        n: source
        for n, source in base.outputs.items()
        if stays(source) and not source.startswith("human.")
    }
    outputs |= {
        "tau_h_Nm": "human.tau_h_Nm",
        "human_status": "human.status",
        "u_command_Nm": "predictive.u_Nm",
        "iterations": "predictive.iterations",
        "predictive_status": "predictive.status",
    }
    outputs |= {f"{n}_status": f"{n}.status" for n in ("ahead", "parabola") if n in blocks}
    control = base.control
    return System(
        device.name,
        device.period_s,
        blocks,
        (
            Task("sense", tuple(order)),
            Task("control", tuple(control_order), control.every, control.phase, control.release),
        ),
        wires,
        inputs,
        outputs,
    )


def _shown_reference(block: Block) -> Block:
    # What the reference makes of a change of mode, and its tunables, for the horizon.
    def port(source: Sequence[Port], name: str, as_name: str = "") -> Port:
        p = next(p for p in source if p.name == name)
        return Port(as_name or name, p.low, p.high, p.meaning, p.size, p.equation)

    more = [(port(block.state, "offset_Nm"), "next_offset_Nm")]
    more += [
        (port(block.coefficients, n), f"c_{n}")
        for n in ("keep", "tau_range_Nm", "Kp_Nm_rad", "Kd_Nms_rad")
    ]
    more += [
        (port(block.inputs, n, n.replace("desired", "wanted")), f"label_{n}_used")
        for n in ("tau_desired_Nm", "theta_desired_rad", "omega_desired_rad_s")
    ]
    return with_outputs(block, more)


def _sources(printed: bool, along: bool) -> dict[str, dict[str, str]]:
    # What feeds the inputs that are not the sliding mode's.
    omega_load = "load_rate.omega_rad_s" if printed else "human.omega_load_rad_s"
    shown = ["offset_Nm", "keep", "tau_range_Nm", "tau_wanted_Nm", "theta_wanted_rad"]
    shown += ["omega_wanted_rad_s", "Kp_Nm_rad", "Kd_Nms_rad", "tau_set_Nm", "mode"]
    tau_h = {"tau_h_Nm": "human.tau_h_Nm", "tau_h_rate_Nm_s": "human.tau_h_rate_Nm_s"}
    if printed:
        tau_h = {"tau_h_Nm": "parabola.tau_h_fit_Nm"}
        tau_h |= {n: f"parabola.{n}" for n in ("tau_h_rate_Nm_s", "tau_h_curve_Nm_s2")}
    wanted = {"mode": "reference.mode", "tau_d_Nm": "reference.tau_set_Nm"}
    if along:
        names = ("mode", "tau_d_Nm", "theta_d_rad", "omega_d_rad_s", "Kp_Nm_rad", "Kd_Nms_rad")
        wanted = {n: f"ahead.{n}" for n in names}
    return {
        "human": {
            "theta_load_rad": "encoder_load.theta_rad",
            "omega_load_rad_s": "load_rate.omega_rad_s",
            "tau_Nm": "sensor.tau_Nm",
        },
        "parabola": {"tau_h_Nm": "human.tau_h_Nm"},
        "ahead": {n: f"reference.{n}" for n in shown}
        | {"theta_load_rad": "encoder_load.theta_rad", "omega_load_rad_s": omega_load},
        "predictive": {
            "delta_rad": "joint.theta_rad",
            "omega_rad_s": "velocity.omega_rad_s",
            "omega_m_rad_s": "motor_rate.omega_rad_s",
            "theta_l_rad": "encoder_load.theta_rad",
            "omega_l_rad_s": omega_load,
            "u_a_Nm": "drive.u_a_Nm",
            "u_in_force_Nm": "limits.u_Nm",
            "tau_rate_Nm": "sensor.tau_rate_Nm",
            "play_rad": "sensor.play_rad",
            "d4_rad_s2": "drive.d4_rad_s2",
        }
        | tau_h
        | wanted,
    }
