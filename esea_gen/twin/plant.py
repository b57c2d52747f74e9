"""The virtual exoskeleton: drive, cable, elastomer, load and person as one Block, and encoders.

The equations are those of thesis chapter 5::

    (5.1)  u_a'       = (u_c - u_a) / tau_c
    (5.2)  J omega_g' = n u_a - fv omega_g - fc tanh(omega_g / w) - tau_c + J d4(theta_g)
           m omega_m' = tau_c - tau_loss - d omega_m - tau_e
    (5.3)  Jh omega_l' = tau_e + tau_h + tau_stop

with the cable's torque tau_c between gear and motor-side part (spring and damper behind a gap), and
the elastomer's torque tau_e, which is the torque sensor's own step at the plant's period, fed with
the true rate in the middle of the step.  A plant without the cable has one inertia J in place of
gear and motor-side part.

One step is half a kick, a drift, and half a kick::

    v(k+1/2) = v(k) + h/2 a(k)
    x(k+1)   = x(k) + h v(k+1/2)
    a(k+1)   = f(x(k+1), v(k+1/2) + h/2 a(k+1)),  linearised about v(k+1/2)
    v(k+1)   = v(k+1/2) + h/2 a(k+1)

It is of second order, needs the forces once a step, has angles and speeds at the same instant, and
stays stable where friction is steep: at rest the cable's loss torque has a slope of thousands per
second, which no explicit step of 0.2 ms takes.  ``docs/benchmarks.md`` has evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.device import with_numbers
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Equation, Flag, Port, clip, flag_word
from esea_gen.model.rubber import rubber_sensor
from esea_gen.model.sensing import of_axis
from esea_gen.model.symbolic import equations
from esea_gen.twin.encoders import ANGLE_RAD
from esea_gen.twin.mechanics import (
    WORKS,
    beyond,
    contact,
    gear_torques,
    move_load,
    move_rigidly,
    move_with_cable,
    powers,
    stored_J,
    trip,
)
from esea_gen.twin.parameters import (
    STEP_S,
    passed_on,
    plant_coefficients,
    plant_tunables,
    prepare_plant,
)

TICK_S = 1e-3
NAME = "twin"
# The elastomer goes on beyond the sensor's port ranges; the coupling's stop ends it earlier.
_THETA_RAD, _OMEGA_RAD_S, _TAU_NM = 1.5, 500.0, 1000.0
_SPEED_RAD_S, _ACCEL_RAD_S2, _ENERGY_J = 500.0, 1e7, 1e9


def true_sensor(device: DeviceData, step_s: float) -> Block:
    """The sensor's equations at another period, in ranges that no motion of a plant leaves."""
    wide = {
        "limits.theta_rad": _THETA_RAD,
        "limits.omega_rad_s": 2 * _SPEED_RAD_S,
        "limits.tau_Nm": _TAU_NM,
        "timing.sense_rate_Hz": 1 / step_s,
    }
    return rubber_sensor(with_numbers(device, wide))


def sensed(
    sensor: Block, s: SimpleNamespace, delta: ca.SX, rate: ca.SX
) -> tuple[dict[str, ca.SX], dict[str, list[ca.SX]]]:
    """Torque of a sensor's step for a deflection and its rate, and its next state."""
    names = [p.name for p in sensor.state]
    results = sensor.step.call([*(vars(s)[n] for n in names), delta, rate])
    outputs = (p.name for p in sensor.outputs)
    shown = dict(zip(outputs, results[len(names) :], strict=True))
    return shown, {n: ca.vertsplit(results[i]) for i, n in enumerate(names)}


def bodies_of(cable: bool) -> tuple[str, ...]:
    """Letters of the bodies that move by themselves."""
    return tuple(_BODIES)[0 if cable else 1 :]


@dataclass(frozen=True)
class AxisStep:
    """One step of a drive with its coupling, symbolically: up to the load, and from there on."""

    cable: bool
    step_s: float
    ratio: float
    sensor: Block

    def drift(self, c: Any, s: Any, u: Any, label: Labels) -> SimpleNamespace:
        """Half a step on: speeds ``v``, angles ``x`` by body, motor's torque, and the coupling."""
        h, q = self.step_s, 0.5 * self.step_s
        wanted = clip(u.u_Nm, -c.u_max_Nm, c.u_max_Nm)
        u_c = label("u_c_Nm", ca.if_else(s.tripped > 0, 0, wanted), "a tripped drive is off")
        u_a = label("u_a_next_Nm", u_c + (s.u_a_Nm - u_c) * c.lag_decay, "(5.1)")
        v, x = {}, {}
        for i, key in enumerate(bodies_of(self.cable)):
            kicked = s.omega_rad_s[i] + q * s.alpha_rad_s2[i]
            kicked = c.free * kicked if key == "l" else kicked
            v[key] = label(f"v_{key}", kicked, "speed in the middle of the step")
            x[key] = label(f"x_{key}", s.theta_rad[i] + h * v[key])
        coupling = self._coupling(c, s, x["m"] - x["l"], v["m"] - v["l"], label)
        return SimpleNamespace(v=v, x=x, u_a=u_a, coupling=coupling)

    def settle(self, c: Any, s: Any, at: Any, load: Any, label: Labels) -> StepResult:
        """Second half of the kick: next state and outputs but for the status."""
        cable, h, q = self.cable, self.step_s, 0.5 * self.step_s
        v, x, u_a, coupling = at.v, at.x, at.u_a, at.coupling
        first = bodies_of(cable)[0]
        v_g, x_g = v[first], x[first]
        drive_Nm = self.ratio * u_a
        gear = gear_torques(c, x_g, v_g, drive_Nm, label)
        moved = (
            move_with_cable(c, gear, x_g - x["m"], v_g, v["m"], coupling.tau, q, label)
            if cable
            else move_rigidly(c, gear, v["m"], coupling.tau, q, label)
        )

        # Works, by the trapezoidal rule: a sum of the powers less half the last one.
        power = powers(c, drive_Nm, coupling, load, gear, moved, q)
        sums = {k: s.sums_J[i] + h * power[k] for i, k in enumerate(WORKS)}
        heat, tripped = trip(c, s, u_a, moved.w_g, label)

        next_state = {
            "u_a_Nm": u_a,
            "theta_rad": list(x.values()),
            "omega_rad_s": [*([moved.w_g] if cable else []), moved.w_m, load.w],
            "alpha_rad_s2": [*([moved.a_g] if cable else []), moved.a_m, load.a],
            "noise_Nm": load.noise,
            "heat": heat,
            "tripped": tripped,
            **coupling.memory,
            "sums_J": list(sums.values()),
        }
        outputs = {
            "tau_e_Nm": coupling.tau,
            "theta_g_rad": x_g,
            "omega_g_rad_s": moved.w_g,
            "theta_m_rad": x["m"],
            "omega_m_rad_s": moved.w_m,
            "theta_l_rad": x["l"],
            "omega_l_rad_s": load.w,
            "u_a_Nm": u_a,
            "tau_h_Nm": c.free * load.tau_h,
            "d4_rad_s2": gear.d4,
            "stored_J": stored_J(c, coupling, load, moved),
            **{f"work_{k}_J": v - q * power[k] for k, v in sums.items()},
            "tripped": tripped,
        }
        return next_state, outputs

    def _coupling(
        self, c: Any, s: Any, delta: ca.SX, rate: ca.SX, label: Labels
    ) -> SimpleNamespace:
        # The sensor's step with the true rate, the coupling's stop ``jaw``, and what both remember.
        delta, rate = label("delta_rad", delta), label("rate_rad_s", rate)
        shown, kept = sensed(self.sensor, s, delta, rate)
        more = (c.hysteresis_scale - 1) * shown["tau_hysteresis_Nm"]
        # Exact for a rate that is held over the step.
        branch = label(
            "tau_relaxation_Nm",
            c.relaxation_decay * s.relaxation_Nm + c.relaxation_gain_Nms_rad * rate,
            "second Maxwell branch",
        )
        model = shown["tau_Nm"] + more
        rubber = label("tau_rubber_Nm", c.elastomer_scale * model + branch, "(3.1), scaled")
        jaw = beyond(delta, -c.coupling_stop_rad, c.coupling_stop_rad)
        tau_jaw, _ = contact(jaw, rate, c.coupling_stop_Nm_rad, c.coupling_stop_Nms_rad)
        tau_e = label("tau_e", rubber + tau_jaw, "with the coupling's stop")
        kept["relaxation_Nm"] = [branch]
        return SimpleNamespace(tau=tau_e, rubber=rubber, jaw=jaw, tau_jaw=tau_jaw, memory=kept)


def plant_status(guard: Guard) -> Any:
    return flag_word([ca.logic_not(guard.inputs_ok), ca.logic_not(guard.state_ok)])


def axis_step(device: DeviceData, cable: bool, step_s: float) -> AxisStep:
    assert device.file.actuator is not None
    ratio = device.file.actuator.gear_ratio.value
    return AxisStep(cable, step_s, ratio, true_sensor(device, step_s))


def plant_block(
    device: DeviceData, cable: bool = True, step_s: float = STEP_S, tick_s: float = TICK_S
) -> Block:
    """Drive, cable, elastomer, load and person: one step of the plant."""
    tunables = plant_tunables(device, cable)
    axis = axis_step(device, cable, step_s)
    sensor = axis.sensor
    passed = passed_on(tunables)

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        at, q = axis.drift(c, s, u, label), 0.5 * step_s
        load = move_load(c, s, u, at.coupling.tau, at.x["l"], at.v["l"], q, label)
        next_state, outputs = axis.settle(c, s, at, load, label)
        return next_state, outputs | {"plant_status": plant_status(guard)}

    return Block.define(
        "plant",
        "Virtual exoskeleton: drive, cable, elastomer, load and person"
        if cable
        else "Virtual exoskeleton with a rigid cable: drive, elastomer, load and person",
        period_s=step_s,
        constants=(*device.constants("actuator"), *sensor.constants),
        tunables=tunables,
        coefficients=plant_coefficients(tunables),
        prepare=lambda t: prepare_plant(t, passed, step_s, tick_s),
        state=(*state_ports(cable), *sensor.state),
        inputs=input_ports(),
        outputs=output_ports(),
        equations=plant_equations(cable),
        step=step,
    )


def _angle(name: str, text: str) -> Port:
    return Port(name, -ANGLE_RAD, ANGLE_RAD, text)


def _speed(name: str, text: str) -> Port:
    return Port(name, -_SPEED_RAD_S, _SPEED_RAD_S, text)


_BODIES = {"g": "gear, at the joint", "m": "coupling's motor-side part", "l": "load side"}


def state_ports(cable: bool) -> tuple[Port, ...]:
    # Vectors: one comparison guards all of their elements.
    n = 3 if cable else 2
    who = ("gear, " if cable else "") + "motor-side part, load side"
    accel = _ACCEL_RAD_S2
    return (
        Port("u_a_Nm", -100, 100, "torque of the motor, at its shaft", equation="(5.1)"),
        Port("theta_rad", -ANGLE_RAD, ANGLE_RAD, f"angles of {who}", n),
        Port("omega_rad_s", -_SPEED_RAD_S, _SPEED_RAD_S, f"speeds of {who}", n),
        Port("alpha_rad_s2", -accel, accel, f"accelerations of {who}", n),
        Port("relaxation_Nm", -_TAU_NM, _TAU_NM, "torque of the second Maxwell branch"),
        Port("noise_Nm", -_TAU_NM, _TAU_NM, "noise of the person's torque"),
        Port("heat", 0, 1e4, "smoothed square of the motor's torque"),
        Port("tripped", 0, 2, "0 running, 1 tripped by speed, 2 by torque"),
        Port("sums_J", -_ENERGY_J, _ENERGY_J, f"sums of powers: {', '.join(WORKS)}", len(WORKS)),
    )


def input_ports() -> tuple[Port, ...]:
    angle = _angle("theta_p_rad", "intended angle at the end of the step")
    return (
        Port("u_Nm", -100, 100, "motor command, at the motor's shaft", equation="(5.1)"),
        replace(angle, on_invalid=0.0),
        _speed("omega_p_rad_s", "intended speed at the end of the step"),
        Port("alpha_p_rad_s2", -1e5, 1e5, "intended acceleration at the end of the step"),
        Port("noise", -100, 100, "white number of variance 1, held for a tick"),
    )


def status_port() -> Port:
    flags = (
        Flag("INPUT_INVALID", "an input was NaN or outside its range and was replaced", True),
        Flag("STATE_REPAIRED", "the plant left its ranges and was started afresh", True),
    )
    return Port("plant_status", 0, 3, "status of this step", flags=flags)


_WORKS = {
    "motor": "work of the motor",
    "loss": "heat in friction, dampers and stops",
    "elastomer": "work put into the elastomer, stored and lost there",
    "person": "work of the person on the load",
    "disturbance": "work of the gear's disturbance",
}


def output_ports() -> tuple[Port, ...]:
    torque = "true torque of the coupling on the load, its stop included"
    moved = [
        port
        for k, text in _BODIES.items()
        for port in (
            _angle(f"theta_{k}_rad", f"angle of the {text}"),
            _speed(f"omega_{k}_rad_s", f"speed of the {text}"),
        )
    ]
    return (
        Port("tau_e_Nm", -1e5, 1e5, torque, equation="(3.1)"),
        *moved,
        Port("u_a_Nm", -100, 100, "torque of the motor, at its shaft", equation="(5.1)"),
        Port("tau_h_Nm", -1e5, 1e5, "torque of the person on the load", equation="(5.3)"),
        Port("d4_rad_s2", -1e3, 1e3, "disturbance of the gear", equation="(5.2)"),
        Port("stored_J", 0, _ENERGY_J, "kinetic energy, and that of cable and stops"),
        *(Port(f"work_{k}_J", -_ENERGY_J, _ENERGY_J, _WORKS[k]) for k in WORKS),
        Port("tripped", 0, 2, "0 running, 1 tripped by speed, 2 by torque"),
        status_port(),
    )


EQUATIONS = """
    (5.1) | u_a' | (u_c - u_a) / tau_c | lag of the motor's torque
    (5.2) | J omega_g' | n * u_a - f_v * omega_g - f_c * tanh(omega_g / w) - {pull} + J * d_4 | \
        motor and drive
    (5.3) | J_h omega_l' | tau_e + tau_h | load side and limb
"""


def plant_equations(cable: bool) -> tuple[Equation, ...]:
    return equations(EQUATIONS.format(pull="tau_cable" if cable else "tau_e"))


def start_state(
    plant: Block, start_rad: float, axis: str = ""
) -> tuple[dict[str, list[float]], dict[str, float]]:
    """State of a plant's Block at rest at an angle, and its outputs."""
    name = of_axis("theta_rad", axis)
    count = next(p.size for p in plant.state if p.name == name)
    shown = {of_axis(f"theta_{b}_rad", axis): start_rad for b in _BODIES}
    return {name: [start_rad] * count}, shown
