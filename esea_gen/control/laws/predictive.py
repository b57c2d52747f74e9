"""Predictive control of the torque or the impedance, in place of a law at the present only."""

from __future__ import annotations

from collections.abc import Sequence

from esea_gen.control.law import Base, Law, Parts
from esea_gen.control.limits.block import command_stamp
from esea_gen.control.predictive.ahead import ahead
from esea_gen.control.predictive.drive import (
    Q_BEST,
    R_BEST,
    DriveTrain,
    Person,
    predictive_controller,
)
from esea_gen.control.predictive.horizon import Horizon
from esea_gen.control.predictive.rubber_ahead import rubber_ahead
from esea_gen.control.shown import shown_reference, with_state_as_output
from esea_gen.control.trend import trend
from esea_gen.devices.file import DeviceData
from esea_gen.errors import UserError
from esea_gen.language.block import Block
from esea_gen.language.component import Component
from esea_gen.language.ports import Port
from esea_gen.observe import drive_of
from esea_gen.observe.cable import cable_observer
from esea_gen.observe.disturbance import drive_observer_by_gear
from esea_gen.observe.extrapolation import parabola
from esea_gen.observe.human import lag_observer


def predictive_delay_s(device: DeviceData) -> float:
    """From a measurement to the moment at which a command that rests on it takes effect."""
    release = device.file.timing.control_release_s
    control = drive_of(device).control_period_s if release is None else release.value
    return device.period_s + control


def device_horizon(device: DeviceData) -> Horizon:
    """Grid of the prediction: of ``[predictive]``, or 10 intervals of 20 ms with 4 substeps."""
    asked, delay_s = device.file.predictive, predictive_delay_s(device)
    if asked is None:
        return Horizon(delay_s=delay_s)
    many, substeps = int(asked.intervals.value), int(asked.substeps.value)
    longer = 0 if asked.long_intervals is None else int(asked.long_intervals.value)
    if longer >= many:
        raise UserError(
            f"{device.origin}: predictive.long_intervals = {longer} is not below its intervals, "
            f"{many}.",
            "Lower it, or take more intervals.",
        )
    made = Horizon(many, asked.interval_s.value, substeps, delay_s, longer)
    if (length_s := sum(made.lengths_s)) < delay_s:
        raise UserError(
            f"{device.origin}: the horizon of [predictive], {length_s:g} s, is below the "
            f"{delay_s:g} s from a measurement to its command.",
            "Take more intervals, or longer ones.",
        )
    return made


def drive_train(device: DeviceData) -> DriveTrain:
    """Whether prediction knows the cable; ``auto``: with ``[cable]``, if not as published."""
    asked = device.file.predictive
    published = asked is not None and asked.person == "parabola"
    if asked is not None and asked.drive != "auto":
        return asked.drive
    return "rigid" if device.file.cable is None or published else "cable"


def _parts(base: Base) -> Parts:
    # With no section of its own: best of our trials, nothing known ahead.
    asked, device = base.device.file.predictive, base.device
    future = "extrapolated" if asked is None else asked.future
    preview, extrapolated = future == "given", future == "extrapolated"
    one_layer = asked is None or asked.impedance == "one_layer"
    person: Person = "extended_state" if asked is None else asked.person
    weights = (Q_BEST, R_BEST) if asked is None else (asked.Q.value, asked.R.value)
    grid, published = device_horizon(device), person == "parabola"
    along = future != "held" or one_layer
    control: dict[str, Component] = {}
    sense: dict[str, Component] = {}
    after_limits: dict[str, Component] = {}
    told = rubber_ahead(device).ports()
    replaced: dict[str, Component] = {"sensor": _shown_sensor(base, told)}
    train = drive_train(device)
    if train == "cable":
        sense["cable"] = cable_observer(device)
        after_limits["drive_by_gear"] = drive_observer_by_gear(device)
    if published:
        control["parabola"] = parabola(device)
        replaced["human"] = lag_observer(device)
    if along:
        replaced["reference"] = shown_reference(base.blocks["reference"])
        if extrapolated:
            control["trend"] = trend(device, grid.ends_s)
        control["ahead"] = ahead(
            device, grid, given=preview, one_layer=one_layer, torque_given=future != "held"
        )
        # A future that is not a number stops for good, as a wish of now does.
        replaced["stamp"] = command_stamp(device, checked=True)
    control["predictive"] = predictive_controller(
        device,
        horizon=grid,
        preview=along,
        impedance=one_layer,
        person=person,
        weights=weights,
        train=train,
    )
    inputs: dict[str, tuple[str, ...]] = {}
    if preview:
        names = ["tau_preview_Nm", *(["theta_preview_rad", "omega_preview_rad_s"] * one_layer)]
        inputs = {n: (f"ahead.{n}",) for n in names}
    sources = _sources(published, along, train)
    sources["predictive"] |= {p.name: f"sensor.{p.name}" for p in told}
    return Parts(
        control=control,
        sense=sense,
        after_limits=after_limits,
        command="predictive.u_Nm",
        replaced=replaced,
        wires={
            f"{name}.{p.name}": sources[name][p.name]
            for name, block in control.items()
            for p in block.inputs
            if (f"{name}.{p.name}",) not in inputs.values()
        },
        inputs=inputs,
        outputs={"iterations": "predictive.iterations"},
        request_ok="ahead.request_ok" if along else "",
    )


def _shown_sensor(base: Base, told: Sequence[Port]) -> Component:
    # The sensor with the memory that the prediction starts from.
    sensor: Block = base.blocks["sensor"]
    given = {p.name for p in sensor.outputs}
    for port in told:
        if port.name not in given:
            meaning = f"{port.meaning.removeprefix('sensor: ')}, for predictive control"
            sensor = with_state_as_output(sensor, port.name, meaning)
    return sensor


def _sources(published: bool, along: bool, train: DriveTrain) -> dict[str, dict[str, str]]:
    # What feeds the inputs that are not the sliding mode's.
    omega_load = "load_rate.omega_rad_s" if published else "human.omega_load_rad_s"
    shown = ["offset_Nm", "keep", "tau_range_Nm", "tau_wanted_Nm", "theta_wanted_rad"]
    shown += ["omega_wanted_rad_s", "Kp_Nm_rad", "Kd_Nms_rad", "tau_set_Nm", "mode"]
    tau_h = {"tau_h_Nm": "human.tau_h_Nm", "tau_h_rate_Nm_s": "human.tau_h_rate_Nm_s"}
    if published:
        tau_h = {"tau_h_Nm": "parabola.tau_h_fit_Nm"}
        tau_h |= {n: f"parabola.{n}" for n in ("tau_h_rate_Nm_s", "tau_h_curve_Nm_s2")}
    wanted = {"mode": "reference.mode", "tau_d_Nm": "reference.tau_set_Nm"}
    if along:
        names = ("mode", "tau_d_Nm", "theta_d_rad", "omega_d_rad_s", "Kp_Nm_rad", "Kd_Nms_rad")
        wanted = {n: f"ahead.{n}" for n in names}
    return {
        "parabola": {"tau_h_Nm": "human.tau_h_Nm"},
        "trend": {"tau_wanted_Nm": "reference.tau_wanted_Nm", "u_Nm": "limits.u_Nm"},
        "ahead": {n: f"reference.{n}" for n in shown}
        | {
            # Of an extrapolated future; a given one comes from outside.
            "tau_preview_Nm": "trend.tau_ahead_Nm",
            "theta_load_rad": "encoder_load.theta_rad",
            "omega_load_rad_s": omega_load,
            "damping_Nms_rad": "passivity.damping_Nms_rad",
            "wish_gain": "adaptation.wish_gain",
            "wish_shift_Nm": "adaptation.wish_shift_Nm",
        },
        "predictive": {
            "delta_rad": "cable.delta_rad" if train == "cable" else "joint.theta_rad",
            "omega_rad_s": "velocity.omega_rad_s",
            "wound_rad": "cable.wound_rad",
            "gap_rad": "cable.gap_rad",
            "give_rad_Nm": "cable.give_rad_Nm",
            "omega_gear_rad_s": "encoder_gear.omega_gear_rad_s",
            "omega_m_rad_s": "motor_rate.omega_rad_s",
            "theta_l_rad": "encoder_load.theta_rad",
            "omega_l_rad_s": omega_load,
            "u_a_Nm": "drive.u_a_Nm",
            "u_in_force_Nm": "limits.u_Nm",
            "d4_rad_s2": "drive_by_gear.d4_rad_s2" if train == "cable" else "drive.d4_rad_s2",
        }
        | tau_h
        | wanted,
    }


LAW = Law("predictive", "Predictive control of torque and impedance", _parts, "predictive")
