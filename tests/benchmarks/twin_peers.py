"""Programs that simulate the virtual exoskeleton: the generated C, and its equations in Python."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any, Literal, Protocol

import numpy as np
from scipy.integrate import solve_ivp

from esea_gen.device import Device
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.system import System, Task
from esea_gen.model.elastomer import stop_grid
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.parameters import SINES, STEP_S
from esea_gen.twin.people import PlantVariant

MS = 1e-3


class PlantEquations:
    """Drive, cable and elastomer with the output fixed, as one writes them down in Python.

    Right sides of (5.1), (5.2), (3.3) and (3.4) of the thesis, cable and gear disturbance as in the
    standard plants.  Left out is what the tuning case does not reach: trips, and the person.  A
    stop operator is a closed form of the deflection as long as that does not turn; ``turned`` takes
    hold of it.

    plant: with a cable, and the load clamped at 0.
    defaults: tunables of the Block ``plant`` that the variant does not name.
    """

    def __init__(self, device: Device, plant: PlantVariant, defaults: Mapping[str, float]) -> None:
        assert device.file.actuator is not None
        self.ratio = float(device.file.actuator.gear_ratio.value)
        self.p = {**defaults, **plant.values}
        self.e = {c.name: float(c.value) for c in device.constants("elastomer")}
        radii, weights = stop_grid(self.e, int(self.e["stops"]))
        self.stops = [(float(r), float(w)) for r, w in zip(radii, weights, strict=True)]
        amplitude = self.p["gear_disturbance_rms_rad_s2"] * math.sqrt(2 / SINES)
        self.d4_Nm = self.p["J_kgm2"] * amplitude
        order = range(1, SINES + 1)
        self.waves = [(self.p[f"wave_{i}_1_rad"], self.p[f"phase_{i}_rad"]) for i in order]

    def rest(self) -> tuple[list[float], tuple[float, list[float]]]:
        """State and memory at rest, everything at 0.

        return: gear angle and speed, motor-side angle and speed, motor torque, Maxwell torque.
        return: deflection at the last turn, and the stops' deflections there.
        """
        return [0.0] * 6, (0.0, [0.0] * len(self.stops))

    def torque_Nm(self, y: Any, memory: tuple[float, list[float]]) -> float:
        """Torque of the coupling."""
        e, p, x, v = self.e, self.p, y[2], y[3]
        since = x - memory[0]
        held = 0.0
        for (r, w), z in zip(self.stops, memory[1], strict=True):
            moved = z + since
            held += w * (r if moved > r else -r if moved < -r else moved)
        rubber = (e["k3_Nm_rad3"] * x * x + e["k1_Nm_rad"]) * x + y[5] + held
        rubber *= p["elastomer_scale"]
        stop = p["coupling_stop_rad"]
        if -stop <= x <= stop:
            return float(rubber)
        over = x - stop if x > stop else x + stop
        push = p["coupling_stop_Nm_rad"] * over + p["coupling_stop_Nms_rad"] * v
        return float(rubber + (push if push * over > 0 else 0.0))

    def slopes(
        self, _: float, y: Any, u_Nm: float, memory: tuple[float, list[float]]
    ) -> list[float]:
        """Right sides."""
        p, e = self.p, self.e
        xg, vg, xm, vm, u_a, tau_r = (float(a) for a in y)
        drive = self.ratio * u_a - p["fv_Nms_rad"] * vg
        drive -= p["fc_Nm"] * math.tanh(vg / p["coulomb_width_rad_s"])
        drive += self.d4_Nm * sum(math.sin(k * xg + phase) for k, phase in self.waves)
        gap, half = xg - xm, 0.5 * p["cable_backlash_rad"]
        over = gap - half if gap > half else gap + half if gap < -half else 0.0
        pull = p["cable_stiffness_Nm_rad"] * over + p["cable_damping_Nms_rad"] * (vg - vm)
        pull = pull if pull * over > 0 else 0.0
        lost = p["cable_loss"] * abs(pull) * math.tanh(vm / p["cable_loss_width_rad_s"])
        rubbed = lost + p["motor_side_damping_Nms_rad"] * vm + self.torque_Nm(y, memory)
        eta = (e["A_Nms_rad"] * abs(xm) ** e["m"] + e["eps1_Nms_rad"]) / (
            e["B"] * abs(vm) ** e["n"] + e["eps2"]
        )
        return [
            vg,
            (drive - pull) / p["J_kgm2"],
            vm,
            (pull - rubbed) / p["motor_side_inertia_kgm2"],
            (min(max(u_Nm, -p["u_max_Nm"]), p["u_max_Nm"]) - u_a) / p["tau_c_s"],
            e["kv_Nm_rad"] * (vm - tau_r / eta),
        ]

    def turned(self, y: Any, memory: tuple[float, list[float]]) -> tuple[float, list[float]]:
        """Take hold of the stop operators."""
        x = float(y[2])
        since = x - memory[0]
        held = [min(max(z + since, -r), r) for (r, _), z in zip(self.stops, memory[1], strict=True)]
        return x, held


class TwinPeer(Protocol):
    """Something that simulates, says how long it took, and what the torque was."""

    name: str
    milliseconds: int

    def run(self) -> float:
        """Simulate once."""

    def torque_Nm(self) -> Array:
        """The coupling's torque at the end of each millisecond of the last run."""


class LoopPeer:
    """A controller's C with the plant's C, encoders and recording included."""

    def __init__(
        self, name: str, loop: ClosedLoop, signals: Mapping[str, Array], plant: PlantVariant
    ) -> None:
        self.name, self._loop, self._signals, self._plant = name, loop, signals, plant
        self.milliseconds = len(next(iter(signals.values())))
        self.result: ClosedLoopRun | None = None

    def run(self) -> float:
        """Simulate once."""
        start_s = time.thread_time()
        self.result = self._loop.run(self._signals, self._plant.values)
        return time.thread_time() - start_s

    def torque_Nm(self) -> Array:
        """The coupling's torque at the end of each millisecond but the last one."""
        assert self.result is not None
        # A row is what stands at the start of its millisecond.
        return np.asarray(self.result.plant["tau_e_Nm"][1:])


def replay_system(device: Device) -> System:
    """A controller that only hands a recorded motor command on."""
    block = Block.define(
        "replay",
        "A recorded motor command",
        period_s=device.period_s,
        state=(),
        inputs=(Port("u_recorded_Nm", -100, 100, "recorded command"),),
        outputs=(Port("u_Nm", -100, 100, "the same"),),
        step=lambda c, s, u, guard, label: ({}, {"u_Nm": u.u_recorded_Nm}),
    )
    return System(
        "replayed",
        device.period_s,
        {"replay": block},
        (Task("hand_on", ("replay",)),),
        {},
        {"u_recorded_Nm": ("replay.u_recorded_Nm",)},
        {"u_Nm": "replay.u_Nm"},
    )


Method = Literal["LSODA", "RK45"]


class SolvePeer:
    """``solve_ivp``, started anew whenever the command changes: at every millisecond.

    rtol, atol: its tolerances; scipy's defaults are 1e-3 and 1e-6.
    pieces: pieces of a millisecond, after each of which the stop operators are taken hold of.
    """

    def __init__(
        self,
        name: str,
        equations: PlantEquations,
        u_Nm: Array,
        method: Method = "LSODA",
        rtol: float = 1e-3,
        atol: float = 1e-6,
        pieces: int = 1,
    ) -> None:
        self.name, self.milliseconds = name, len(u_Nm)
        self._equations, self._u_Nm, self._pieces = equations, u_Nm.tolist(), pieces
        self._method, self._rtol, self._atol = method, rtol, atol
        self._torque_Nm = np.zeros(len(u_Nm))

    def run(self) -> float:
        """Simulate once."""
        start_s = time.thread_time()
        model, span = self._equations, (0.0, MS / self._pieces)
        state, memory = model.rest()
        y: Any = np.array(state)
        for k, u in enumerate(self._u_Nm):
            for _ in range(self._pieces):
                done = solve_ivp(
                    model.slopes,
                    span,
                    y,
                    self._method,
                    args=(u, memory),
                    rtol=self._rtol,
                    atol=self._atol,
                )
                y = done.y[:, -1]
                memory = model.turned(y, memory)
            self._torque_Nm[k] = model.torque_Nm(y, memory)
        return time.thread_time() - start_s

    def torque_Nm(self) -> Array:
        """The coupling's torque at the end of each millisecond of the last run."""
        return self._torque_Nm


class FixedStepPeer:
    """A loop in Python with the classical Runge-Kutta step, as long as the C's."""

    def __init__(
        self, name: str, equations: PlantEquations, u_Nm: Array, step_s: float = STEP_S
    ) -> None:
        self.name, self.milliseconds = name, len(u_Nm)
        self._equations, self._u_Nm, self._step_s = equations, u_Nm.tolist(), step_s
        self._torque_Nm = np.zeros(len(u_Nm))

    def run(self) -> float:
        """Simulate once."""
        start_s = time.thread_time()
        model, h = self._equations, self._step_s
        steps = round(MS / h)
        y, memory = model.rest()

        def ahead(factor: float, slope: list[float]) -> list[float]:
            return [x + factor * s for x, s in zip(y, slope, strict=True)]

        for k, u in enumerate(self._u_Nm):
            for _ in range(steps):
                a = model.slopes(0.0, y, u, memory)
                b = model.slopes(0.0, ahead(0.5 * h, a), u, memory)
                c = model.slopes(0.0, ahead(0.5 * h, b), u, memory)
                d = model.slopes(0.0, ahead(h, c), u, memory)
                mean = zip(a, b, c, d, strict=True)
                y = ahead(h / 6, [s + 2 * t + 2 * v + w for s, t, v, w in mean])
                memory = model.turned(y, memory)
            self._torque_Nm[k] = model.torque_Nm(y, memory)
        return time.thread_time() - start_s

    def torque_Nm(self) -> Array:
        """The coupling's torque at the end of each millisecond of the last run."""
        return self._torque_Nm


def python_peers(equations: PlantEquations, u_Nm: Array) -> list[TwinPeer]:
    """The plant in Python, in four ways.

    return: tight and default tolerances, scipy's default method, fixed step.
    """
    return [
        SolvePeer("solve_ivp, LSODA, 1e-8", equations, u_Nm, "LSODA", 1e-8, 1e-10),
        SolvePeer("solve_ivp, LSODA, default tolerance", equations, u_Nm, "LSODA"),
        SolvePeer("solve_ivp, as it comes (RK45)", equations, u_Nm, "RK45"),
        FixedStepPeer(f"Python loop, RK4 at {STEP_S * 1e3:g} ms", equations, u_Nm),
    ]
