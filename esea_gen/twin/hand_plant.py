"""Two drives and one hand between them: the plant of a device with two axes, as one Block.

Each axis has the drive, cable and elastomer of :mod:`esea_gen.twin.plant`.  In place of (5.3) is
the hand, whose axes are coupled::

    M omega_l' = tau_e + tau_h + tau_stop
    tau_h = tau_intent + tau_muscle - D omega_l - K (theta_l - theta_rest)

with symmetric matrices M, D and K; tau_intent is the pull of each axis towards its intended path.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, TypeVar

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.hostlib.library import HostLibrary, set_tunables
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Port, Tunable
from esea_gen.language.system import System, Task
from esea_gen.model.sensing import of_axis
from esea_gen.twin.encoders import encoder_block
from esea_gen.twin.mechanics import limb_torques, moved_load
from esea_gen.twin.parameters import (
    STEP_S,
    assumed,
    passed_on,
    plant_coefficients,
    plant_tunables,
    prepare_plant,
)
from esea_gen.twin.plant import (
    NAME,
    TICK_S,
    AxisStep,
    axis_step,
    input_ports,
    output_ports,
    plant_block,
    plant_equations,
    plant_status,
    state_ports,
)

Named = TypeVar("Named", Port, Tunable)
WHOLE = ("stored_J", "plant_status")  # outputs of the plant, not of an axis


def own_tunables() -> tuple[Tunable, ...]:
    """Tunables of a hand's axis beside those of a plant's person."""
    return (
        assumed("passive_Nm_rad", 0, 0, 1000, "passive stiffness of the joint"),
        assumed("rest_rad", 0, -10, 10, "angle at which the joint rests"),
    )


def cross_tunables() -> tuple[Tunable, ...]:
    return (
        assumed("inertia_cross_kgm2", 0, -10, 10, "inertia between the axes"),
        assumed("damping_cross_Nms_rad", 0, -100, 100, "the hand's own damping between the axes"),
        assumed("passive_cross_Nm_rad", 0, -1000, 1000, "passive stiffness between the axes"),
    )


def _of(ports: tuple[Named, ...], axis: str) -> tuple[Named, ...]:
    return tuple(replace(p, name=of_axis(p.name, axis)) for p in ports)


def _view(values: SimpleNamespace, names: tuple[str, ...], axis: str) -> SimpleNamespace:
    return SimpleNamespace(**{n: vars(values)[of_axis(n, axis)] for n in names})


class _Named(Labels):
    """Labels that carry the axis."""

    def __init__(self, inner: Labels, axis: str) -> None:
        self._inner, self._axis = inner, axis

    def __call__(self, name: str, value: ca.SX, comment: str = "") -> ca.SX:
        return self._inner(of_axis(name, self._axis), value, comment)


@dataclass(frozen=True)
class _HandStep:
    """One step of both drives and the hand, from ``names`` of an axis' values by c, s and u."""

    axes: tuple[str, str]
    axis: AxisStep
    names: Mapping[str, tuple[str, ...]]

    def __call__(self, c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        groups = {"c": c, "s": s, "u": u}
        parts = [[_view(groups[k], self.names[k], a) for k in "csu"] for a in self.axes]
        labels = [_Named(label, a) for a in self.axes]
        at = [self.axis.drift(p[0], p[1], p[2], n) for p, n in zip(parts, labels, strict=True)]
        loads = self._hand(c, parts, at, label)
        next_state: dict[str, Any] = {}
        outputs: dict[str, Any] = {}
        stored = c.inertia_cross_kgm2 * loads[0].w * loads[1].w
        for a, p, drifted, load, named in zip(self.axes, parts, at, loads, labels, strict=True):
            after, shown = self.axis.settle(p[0], p[1], drifted, load, named)
            stored = stored + shown.pop("stored_J")
            next_state |= {of_axis(n, a): x for n, x in after.items()}
            outputs |= {of_axis(n, a): x for n, x in shown.items()}
        return next_state, outputs | {"stored_J": stored, "plant_status": plant_status(guard)}

    def _hand(
        self, c: Any, parts: list[list[Any]], at: list[Any], label: Labels
    ) -> list[SimpleNamespace]:
        # The two axes' equations of motion at once, friction implicit.
        q = 0.5 * self.axis.step_s
        limbs, masses, forces = [], [], []
        for i, (axis, (own, s, u)) in enumerate(zip(self.axes, parts, strict=True)):
            other, drifted, apart = parts[1 - i], at[i], at[1 - i]
            limb = limb_torques(own, s, u, drifted.x["l"], drifted.v["l"])
            # The passive joint, with what of it the intent makes up for.
            share, there, far = own.feedforward, u.theta_p_rad, other[2].theta_p_rad
            passive = own.passive_Nm_rad * (
                drifted.x["l"] - own.rest_rad - share * (there - own.rest_rad)
            ) + c.passive_cross_Nm_rad * (
                apart.x["l"] - other[0].rest_rad - share * (far - other[0].rest_rad)
            )
            across = c.damping_cross_Nms_rad * (
                apart.v["l"] - share * other[2].omega_p_rad_s
            ) - c.inertia_cross_kgm2 * (share * other[2].alpha_p_rad_s2)
            held = limb.held + u.tau_muscle_Nm - passive - across
            limb.held = label(of_axis("held_Nm", axis), held, "(5.3)")
            limbs.append(limb)
            masses.append(own.Jh_kgm2 + q * (limb.slope + limb.d_end))
            forces.append(own.free * (drifted.coupling.tau + limb.held - limb.tau_end))
        free = parts[0][0].free * parts[1][0].free
        between = free * (c.inertia_cross_kgm2 + q * c.damping_cross_Nms_rad)
        share = 1 / (masses[0] * masses[1] - between * between)
        a = [
            label(
                of_axis("a_l", axis),
                (masses[1 - i] * forces[i] - between * forces[1 - i]) * share,
                "the hand, friction implicit",
            )
            for i, axis in enumerate(self.axes)
        ]
        loads = []
        for i, (axis, limb) in enumerate(zip(self.axes, limbs, strict=True)):
            lost = limb.slope * (q * a[i]) + c.damping_cross_Nms_rad * (q * a[1 - i])
            text = "the person, at the end of the step"
            tau_h = label(of_axis("tau_h", axis), limb.held - lost, text)
            loads.append(moved_load(limb, a[i], at[i].v["l"] + q * a[i], tau_h))
        return loads


def hand_block(
    device: DeviceData, cable: bool = True, step_s: float = STEP_S, tick_s: float = TICK_S
) -> Block:
    """Two drives and a hand: one step of the plant of a device with two axes."""
    if len(device.axes) != 2:
        raise UserError(
            f"{device.origin}: axes = {list(device.axes)}: a hand has two.",
            'Give two names, such as axes = ["flexion", "deviation"].',
        )
    first, second = device.axes
    step = axis_step(device, cable, step_s)
    base = plant_tunables(device, cable)
    passed = passed_on(base)
    coefficients = (*plant_coefficients(base), *(t.port for t in own_tunables()))
    state = (*state_ports(cable), *step.sensor.state)
    inputs = (
        *input_ports(),
        Port("tau_muscle_Nm", -1000, 1000, "muscle torque beside the pull to the path"),
    )
    outputs = tuple(p for p in output_ports() if p.name not in WHOLE)
    of_plant = tuple(p for p in output_ports() if p.name in WHOLE)
    names = {
        "c": tuple(p.name for p in coefficients),
        "s": tuple(p.name for p in state),
        "u": tuple(p.name for p in inputs),
    }

    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        own = tuple(x.name for x in (*base, *own_tunables()))
        out = {x.name: getattr(t, x.name) for x in cross_tunables()}
        for a in device.axes:
            of_one = _view(t, own, a)
            values = prepare_plant(of_one, passed, step_s, tick_s)
            values |= {x.name: getattr(of_one, x.name) for x in own_tunables()}
            out |= {of_axis(n, a): x for n, x in values.items()}
        return out

    def both(ports: tuple[Named, ...]) -> tuple[Named, ...]:
        return tuple(p for a in device.axes for p in _of(ports, a))

    return Block.define(
        "hand",
        "Two drives with their couplings, and one hand whose axes are coupled",
        period_s=step_s,
        constants=(*device.constants("actuator"), *step.sensor.constants),
        tunables=(*both((*base, *own_tunables())), *cross_tunables()),
        coefficients=(*both(coefficients), *(t.port for t in cross_tunables())),
        prepare=prepare,
        state=both(state),
        inputs=both(inputs),
        outputs=(*both(outputs), *of_plant),
        equations=plant_equations(cable),
        step=_HandStep((first, second), step, names),
    )


def twin_system(
    device: DeviceData, cable: bool = True, step_s: float = STEP_S, tick_s: float = TICK_S
) -> System:
    """The plant of a device with one axis or two, and the encoders of each axis."""
    make = plant_block if len(device.axes) == 1 else hand_block
    plant, encoders = make(device, cable, step_s, tick_s), encoder_block(device, tick_s)
    by_axis = {of_axis("encoders", a): a for a in device.axes}

    def ends(of_plant: tuple[Port, ...], of_encoder: tuple[Port, ...]) -> dict[str, str]:
        return {p.name: f"plant.{p.name}" for p in of_plant} | {
            of_axis(p.name, a): f"{i}.{p.name}" for i, a in by_axis.items() for p in of_encoder
        }

    return System(
        NAME,
        step_s,
        {"plant": plant, **dict.fromkeys(by_axis, encoders)},
        (Task("move", ("plant",)), Task("encode", tuple(by_axis), round(tick_s / step_s))),
        {},
        {n: (end,) for n, end in ends(plant.inputs, encoders.inputs).items()},
        ends(plant.outputs, encoders.outputs),
    )


def tunable_places(system: System) -> dict[str, tuple[str, str]]:
    """Where a plant's System has each tunable, by its name with the axis: instance and name."""
    out = {}
    for instance, t in system.tunables:
        axis = instance.partition("_")[2] if instance.startswith("encoders") else ""
        out[of_axis(t.name, axis)] = (instance, t.name)
    return out


def grouped(system: System, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Tunables of a plant by their names with the axis, by instance and name."""
    places, found = tunable_places(system), dict[str, dict[str, float]]()
    for key, value in values.items():
        if key not in places:
            raise UserError(f"The plant has no tunable {key}.", f"It has: {', '.join(places)}.")
        instance, name = places[key]
        whole = name.endswith("_bits") or name.startswith("clamped")
        if whole and value != round(value):
            raise UserError(f"{key} = {value:g} is not a whole number.", "Give a whole one.")
        found.setdefault(instance, {})[name] = value
    return found


def prepared(
    ffi: Any,
    function: Callable[[str], Any],
    of: Renderer | HostLibrary,
    values: Mapping[str, Mapping[str, float]],
) -> Any:
    """Coefficients of a compiled System with these tunables, and the defaults of the others."""
    system, prefix = of.system, of.prefix
    known = [f"{i}.{t.name}" for i, t in system.tunables]
    for name in (f"{i}.{n}" for i, group in values.items() for n in group):
        if name not in known:
            raise UserError(f"{system.name} has no tunable {name}.", f"It has: {', '.join(known)}.")
    params, coeffs = ffi.new(f"{prefix}_params_t *"), ffi.new(f"{prefix}_coeffs_t *")
    refused = set_tunables(of, function, params, coeffs, values)
    if refused:
        instance, tunable = system.tunables[refused - 1]
        raise UserError(
            f"{instance}.{tunable.name} = {values[instance][tunable.name]:g} is outside "
            f"{tunable.low:g} to {tunable.high:g}.",
            f"Give a value inside ({tunable.meaning}).",
        )
    return coeffs
