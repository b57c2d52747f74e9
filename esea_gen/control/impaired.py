"""A device whose axes are impaired: what it senses, the torque that it wants, and the limits.

Task ``sense`` has it all, so that a torque is limited in the very period in which it is wanted.
Task ``control`` has what the host asks for; the limits latch when it no longer runs.  The motors
and their torque controllers are not in it: what the limits let through is their set torque.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.control.impairment import impairment
from esea_gen.control.latch import REARMS
from esea_gen.control.limits import BEATS, limits
from esea_gen.control.safety import JOINT_RAD, safety_sections
from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Port, Tunable, around, threshold
from esea_gen.language.system import System, Task
from esea_gen.model.filters import tracking_observer
from esea_gen.model.sensing import of_axis, sensing_parts

# Of one axis; `velocity` and `sensor` are the coupling's, `joint` is the joint's rate.
WIRES = {
    "impairment.omega_rad_s": "joint.omega_rad_s",
    "side.omega_rad_s": "velocity.omega_rad_s",
    "side.omega_load_rad_s": "joint.omega_rad_s",
    "limits.u_command_Nm": "impairment.tau_set_Nm",
    "limits.mode": "impairment.acts",
    "limits.sensing_ok": "impairment.usable",
    "limits.theta_motor_rad": "side.theta_motor_rad",
    "limits.omega_motor_rad_s": "side.omega_motor_rad_s",
    "limits.omega_load_rad_s": "joint.omega_rad_s",
    "limits.tau_Nm": "sensor.tau_Nm",
}
# One for all axes.
SHARED_WIRES = {
    "impairment.constrained": "request.constrained",
    "limits.control_beat": "request.control_beat",
    "limits.rearm": "request.rearm",
    "limits.request_ok": "request.request_ok",
    "limits.clock_ok": "watch.clock_ok",
    "limits.late_level": "watch.late_level",
    "limits.coeffs_ok": "watch.coeffs_ok",
}
INPUTS = {
    "theta_rad": ("side.theta_rad", "limits.theta_rad"),
    "theta_load_rad": (
        *("joint.theta_rad", "impairment.theta_rad"),
        *("side.theta_load_rad", "limits.theta_load_rad"),
    ),
}
OUTPUTS = {
    "omega_load_rad_s": "joint.omega_rad_s",
    "tau_set_Nm": "impairment.tau_set_Nm",
    "acts": "impairment.acts",
    "u_Nm": "limits.u_Nm",
    "energy_J": "limits.energy_J",
    "fault": "limits.fault",
}
TOLD = ("joint", "impairment", "limits")  # with a status word


def impaired_system(device: DeviceData, velocity: Block, sensor: Block) -> System:
    """The System of a device with ``[impairment]``.

    Parameters
    ----------
    device : DeviceData
        Needs ``[impairment]``, ``[safety]`` and ``timing.control_rate_Hz``.
    velocity, sensor : Block
        Of the coupling's deflection.

    Returns
    -------
    System
        External inputs: of each axis the deflection ``theta_rad`` and the joint's angle
        ``theta_load_rad``; ``stop`` for all.  External outputs: what is measured, ``tau_set_Nm``
        that the impairment wants, ``u_Nm`` that the limits let through, ``fault``, status words.
        The parameters ``request.constrained`` and ``request.rearm`` ask for impairment and release.

    Raises
    ------
    UserError
        When a section is missing.
    """
    section = device.file.impairment
    assert section is not None
    axis_blocks = {
        "joint": tracking_observer(device, JOINT_RAD, section.bandwidth_Hz),
        "impairment": impairment(device),
        "side": motor_side(device),
        "limits": limits(device),
    }
    blocks, wires, inputs, outputs = sensing_parts(device, velocity, sensor)
    for axis in device.axes:

        def end(signal: str, axis: str = axis) -> str:
            name, _, port = signal.partition(".")
            return f"{name}_{axis}.{port}" if axis else signal

        blocks |= {end(f"{n}.", axis)[:-1]: b for n, b in axis_blocks.items()}
        wires |= {end(r): end(w) for r, w in WIRES.items()}
        wires |= {end(r): w for r, w in SHARED_WIRES.items()}
        for name, sinks in INPUTS.items():
            outer = of_axis(name, axis)
            inputs[outer] = inputs.get(outer, ()) + tuple(map(end, sinks))
        inputs["stop"] = (*inputs.get("stop", ()), end("limits.stop"))
        outputs |= {of_axis(n, axis): end(s) for n, s in OUTPUTS.items()}
        outputs |= {end(f"{n}.status").replace(".", "_"): end(f"{n}.status") for n in TOLD}
    outputs["constrained"] = "request.constrained"
    sense = Task("sense", tuple(blocks))
    _, _, _, every = safety_sections(device)
    blocks["request"] = impairment_request(device)
    tasks = (sense, Task("control", ("request",), every=every))
    return System(device.name, device.period_s, blocks, tasks, wires, inputs, outputs)


def impairment_request(device: DeviceData) -> Block:
    """What is asked of the impairments of a device: parameters, so that any host can ask.

    Parameters
    ----------
    device : DeviceData
        Its control rate.

    Returns
    -------
    Block
        Outputs ``constrained``, ``rearm``, whether they are sound, and the stamp that shows the
        limits that the task is alive.
    """
    _, _, _, every = safety_sections(device)
    tunables = (
        Tunable(
            *(
                "constrained",
                0.0,
                0.0,
                1.0,
                "1 asks for the impairment, 0 for none",
            ),
            "nobody is impaired unasked",
        ),
        Tunable(
            *("rearm", 0.0, 0.0, REARMS[-1], "one more asks the limits to release; 0 follows 7"),
            "nothing is released unasked",
        ),
    )
    ports = tuple(Port(t.name, t.low, t.high, t.meaning) for t in tunables)

    def step(
        c: SimpleNamespace, s: SimpleNamespace, _u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        beat = label("beat_next", ca.if_else(s.beats >= BEATS, 1.0, s.beats + 1), "1 to 255")
        whole = ca.logic_or(c.constrained == 0, c.constrained == 1)
        return {"beats": beat}, {
            "constrained": c.constrained,
            "rearm": c.rearm,
            "request_ok": ca.logic_and(whole, guard.state_ok),
            "control_beat": beat,
        }

    return Block.define(
        "request",
        "What is asked of the impairments and their limits",
        period_s=every * device.period_s,
        tunables=tunables,
        coefficients=ports,
        prepare=lambda t: {"constrained": t.constrained, "rearm": t.rearm},
        state=(Port("beats", 0, BEATS, "last stamp"),),
        inputs=(),
        outputs=(
            *ports,
            Port("request_ok", 0, 1, "1 while what is asked is sound"),
            Port("control_beat", 0, BEATS, "changes with every run"),
        ),
        step=step,
    )


def motor_side(device: DeviceData) -> Block:
    """The coupling's motor side, from the joint and the deflection.

    Parameters
    ----------
    device : DeviceData
        Ranges of coupling and rates.

    Returns
    -------
    Block
        Outputs ``theta_motor_rad`` and ``omega_motor_rad_s``.
    """
    theta, omega = (
        threshold(q.value) for q in (device.file.limits.theta_rad, device.file.limits.omega_rad_s)
    )
    reach = threshold(JOINT_RAD)

    def step(
        _c: SimpleNamespace, _s: SimpleNamespace, u: SimpleNamespace, _guard: Guard, _label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        return {}, {
            "theta_motor_rad": u.theta_load_rad + u.theta_rad,
            "omega_motor_rad_s": u.omega_load_rad_s + u.omega_rad_s,
        }

    return Block.define(
        "side",
        "The motor side of the coupling",
        period_s=device.period_s,
        state=(),
        inputs=(
            around("theta_rad", theta, "deflection of the coupling"),
            around("omega_rad_s", omega, "its rate"),
            around("theta_load_rad", reach, "angle of the joint"),
            around("omega_load_rad_s", omega, "its rate"),
        ),
        outputs=(
            around("theta_motor_rad", reach + theta, "motor side's joint angle"),
            around("omega_motor_rad_s", 2 * omega, "motor side's speed"),
        ),
        step=step,
    )
