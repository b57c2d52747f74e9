"""Worked example: add a controller.  Run it: python examples/controller.py.

A Block that makes a joint behave like a spring and a damper is wired behind the torque sensor: the
sensor runs at 1 kHz, the controller at 200 Hz.  The C of both is generated and compared with the
symbols at every step, also when the slow task is preempted and runs late.  It needs gcc, and writes
only below the folder given as its argument (by default, ``controller`` in the current one).

This is not yet a controller for a motor: nothing may reach a motor that has not passed the limits
Block (docs/limits.md).
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

# --8<-- [start:imports]
import casadi as ca
import numpy as np
import sympy as sp

import esea_gen
from esea_gen.device import Device
from esea_gen.hostlib.library import compile_system
from esea_gen.language.block import Block, Guard, Labels
from esea_gen.language.ports import Flag, Port, Tunable, clip, flag_word
from esea_gen.language.system import System, Task
from esea_gen.model.symbolic import equation

# --8<-- [end:imports]

# --8<-- [start:numbers]
EVERY = 5  # ticks of 1 ms: 200 Hz
PHI_MAX_RAD = 2.6  # joint angle, largest plausible
# --8<-- [end:numbers]


# --8<-- [start:block]
def impedance(device: Device) -> Block:
    """Spring and damper at the joint, with feedback of the measured torque.

    Parameters
    ----------
    device : Device
        Base period and range of the torque.

    Returns
    -------
    Block
        Inputs ``phi_ref_rad``, ``phi_rad``, ``tau_Nm``; outputs ``u_Nm`` and a status word.
    """
    period_s = EVERY * device.period_s
    tau_max_Nm = device.file.limits.tau_Nm.value

    # Runs when a tunable changes, not at every step.
    def prepare(t: SimpleNamespace) -> dict[str, Any]:
        return {
            "stiffness_Nm_rad": t.stiffness_Nm_rad,
            "damping_step_Nm_rad": t.damping_Nms_rad / period_s,
            "torque_gain": t.torque_gain,
        }

    # Runs every period.  What stands in s and u has passed the guard: no NaN, nothing out of range.
    def step(
        c: SimpleNamespace, s: SimpleNamespace, u: SimpleNamespace, guard: Guard, label: Labels
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        moved = label("moved_rad", ca.if_else(s.primed, u.phi_rad - s.phi_prev_rad, 0))
        wanted = label(
            "tau_wanted_Nm",
            c.stiffness_Nm_rad * (u.phi_ref_rad - u.phi_rad) - c.damping_step_Nm_rad * moved,
            "[pd 1] torque of the spring and the damper",
        )
        command = label("command_Nm", wanted + c.torque_gain * (wanted - u.tau_Nm), "[pd 2]")
        next_state = {"primed": ca.logic_or(s.primed, guard.inputs_ok), "phi_prev_rad": u.phi_rad}
        outputs = {
            # Not computed with a replaced input: no valid input, no torque.
            "u_Nm": ca.if_else(guard.inputs_ok, clip(command, -tau_max_Nm, tau_max_Nm), 0),
            "status": flag_word(
                [
                    ca.logic_not(guard.inputs_ok),
                    ca.logic_not(guard.state_ok),
                    ca.fabs(command) > tau_max_Nm,
                ]
            ),
        }
        return next_state, outputs

    k, d, g, h, ref, phi, last = sp.symbols("k d g h phi_r phi_k phi_k-1")
    wanted, tau = sp.symbols("tau_w tau")
    return Block.define(
        "impedance",
        "Spring and damper at the joint, with torque feedback",
        period_s=period_s,
        tunables=(
            Tunable("stiffness_Nm_rad", 4.0, 0.0, 20.0, "spring: higher holds tighter"),
            Tunable("damping_Nms_rad", 0.2, 0.0, 1.0, "damper: higher moves more slowly"),
            Tunable("torque_gain", 1.0, 0.0, 5.0, "torque feedback: higher hides the actuator"),
        ),
        coefficients=(
            Port("stiffness_Nm_rad", 0.0, 20.0, "spring"),
            Port("damping_step_Nm_rad", 0.0, 1.0 / period_s, "damper over period"),
            Port("torque_gain", 0.0, 5.0, "torque feedback"),
        ),
        prepare=prepare,
        state=(
            Port("primed", 0.0, 1.0, "1 once valid inputs have been seen"),
            Port("phi_prev_rad", -PHI_MAX_RAD, PHI_MAX_RAD, "joint angle of the last step"),
        ),
        inputs=(
            Port("phi_ref_rad", -PHI_MAX_RAD, PHI_MAX_RAD, "rest angle of the spring"),
            Port("phi_rad", -PHI_MAX_RAD, PHI_MAX_RAD, "joint angle", on_invalid="phi_prev_rad"),
            Port("tau_Nm", -tau_max_Nm, tau_max_Nm, "measured torque on the load"),
        ),
        outputs=(
            Port("u_Nm", -tau_max_Nm, tau_max_Nm, "torque asked for; not yet limited"),
            Port(
                "status",
                0,
                7,
                "what is known of this step",
                flags=(
                    Flag("INPUT_INVALID", "an input was invalid; no torque is asked for", True),
                    Flag("STATE_REPAIRED", "the state was corrupt; started afresh", True),
                    Flag("CLIPPED", "the torque was clipped", True, ("u_Nm",), tau_max_Nm),
                ),
            ),
        ),
        equations=(
            equation("[pd 1]", "tau_w", k * (ref - phi) - d * (phi - last) / h, "spring, damper"),
            equation("[pd 2]", "u", wanted + g * (wanted - tau), "torque feedback"),
        ),
        step=step,
    )


# --8<-- [end:block]


# --8<-- [start:system]
def controlled(device: Device) -> System:
    """The sensor at 1 kHz and the controller at 200 Hz.

    Parameters
    ----------
    device : Device
        A device with one axis.

    Returns
    -------
    System
        Task ``sense`` in every tick, task ``control`` in every fifth.
    """
    return System(
        f"{device.name}_pd",
        device.period_s,
        {"velocity": device.velocity, "sensor": device.sensor, "impedance": impedance(device)},
        (Task("sense", ("velocity", "sensor")), Task("control", ("impedance",), every=EVERY)),
        wires={
            "sensor.omega_rad_s": "velocity.omega_mid_rad_s",  # inside a task: straight on
            "impedance.tau_Nm": "sensor.tau_Nm",  # from task to task: a latch
        },
        inputs={
            "theta_rad": ("velocity.theta_rad", "sensor.theta_rad"),
            "phi_ref_rad": ("impedance.phi_ref_rad",),
            "phi_rad": ("impedance.phi_rad",),
        },
        outputs={
            "tau_Nm": "sensor.tau_Nm",
            "sensor_status": "sensor.status",
            "u_Nm": "impedance.u_Nm",
            "impedance_status": "impedance.status",
        },
    )


# --8<-- [end:system]


# --8<-- [start:run]
def run(board: Any, inputs: dict[str, Any], late: int = 0) -> dict[str, Any]:
    """Run the schedule; every run of ``control`` is preempted and ends late.

    Parameters
    ----------
    board : CBoard or SystemSimulator
        The C, or the symbols.
    inputs : dict of str to ndarray
        One value per base tick.
    late : int
        Ticks from the start of a run of ``control`` to its end, below ``EVERY``.

    Returns
    -------
    dict of str to ndarray
        Every output of every run.
    """
    seen: dict[str, list[float]] = {}

    def step(task: str, at: int, *names: str) -> None:
        # Inputs are those of the tick in which the run started.
        for name, value in board.step(task, **{n: inputs[n][at] for n in names}).items():
            seen.setdefault(name, []).append(value)

    for tick in range(len(inputs["theta_rad"])):
        board.release(tick)
        step("sense", tick, "theta_rad")
        start = tick - late
        if start >= 0 and start % EVERY == 0:
            step("control", start, "phi_ref_rad", "phi_rad")
    return {name: np.array(values, dtype=float) for name, values in seen.items()}


# --8<-- [end:run]


# --8<-- [start:stream]
def stream() -> dict[str, Any]:
    """Inputs to compare on: a moving joint, a step of the set-point, samples that cannot be.

    Returns
    -------
    dict of str to ndarray
        One float32 number per base tick, so that both number formats see the same.
    """
    t_s = 1e-3 * np.arange(2000)
    inputs = {
        "theta_rad": 0.15 * np.sin(2 * np.pi * 0.8 * t_s),
        "phi_rad": 0.6 + 0.5 * np.sin(2 * np.pi * 0.5 * t_s),
        "phi_ref_rad": np.where(t_s < 1.0, 0.3, 1.1),
    }
    inputs["theta_rad"][333] = np.nan
    inputs["phi_rad"][[0, 700]] = np.nan, np.inf
    inputs["phi_ref_rad"][1200] = -9.0
    return {name: x.astype(np.float32).astype(float) for name, x in inputs.items()}


# --8<-- [end:stream]


def main(folder: Path) -> None:
    """Write the C, run it, and print how it agrees.

    Parameters
    ----------
    folder : Path
        Where the C goes.
    """
    # --8<-- [start:main]
    system = controlled(esea_gen.load_device("elbow"))
    inputs = stream()
    model = run(system.simulator(), inputs)
    for real in ("f64", "f32"):
        library = compile_system(system, real)
        for name, text in library.files.items():
            path = folder / real / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        on_time = run(library.board(), inputs)
        worst = {k: np.abs(on_time[k] - model[k]).max() for k in ("tau_Nm", "u_Nm")}
        print(f"{real} against the symbols: tau {worst['tau_Nm']:.1e} Nm, u {worst['u_Nm']:.1e} Nm")
        for late in range(1, EVERY):
            delayed = run(library.board(), inputs, late)
            same = all(np.array_equal(x, on_time[k][: len(x)]) for k, x in delayed.items())
            print(f"  control {late} ms late: {'the same bits' if same else 'DIFFERS'}")
    # --8<-- [end:main]


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("controller"))
