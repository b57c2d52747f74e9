"""Speed and accuracy of the virtual exoskeleton: simulated seconds per second, errors.

The loop of plant and controller, both as generated C, and the plant alone in the same C, against
the same equations as one writes them in Python: ``scipy.integrate.solve_ivp``, and a fixed step.
All run what the tuning case makes the drive do.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from esea_gen.device import Device
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.system import System, Task
from esea_gen.model.elastomer import stop_grid
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.parameters import SINES
from esea_gen.twin.people import STEP_S, PlantVariant
from esea_gen.twin.recorded import tuning_signals
from esea_gen.twin.run import plant_variant

from .peers import exact, in_turns

MS = 1e-3
FAST_MS, SLOW_MS = 20_000, 1000  # how much is simulated in C, and in Python
AIM = 200.0
LOOP, PLANT = "twin, closed loop", "twin, plant"
TRUTH = "solve_ivp, LSODA, 1e-10, tenths of ms"
ERROR = "torque error of the twin's plant, {}"


class PlantEquations:
    """Drive, cable and elastomer with the output fixed, as one writes them down in Python.

    Right sides of (5.1), (5.2), (3.3) and (3.4) of the thesis, cable and gear disturbance as in the
    standard plants.  Left out is what the tuning case does not reach: trips, and the person.
    State: gear angle and speed, motor-side angle and speed, motor torque, Maxwell torque.
    Memory: the deflection at the last turn and the stops' there; between turns a stop is a closed
    form.
    """

    def __init__(self, device: Device, plant: PlantVariant, defaults: dict[str, float]) -> None:
        self.ratio = float(device.file.actuator.gear_ratio.value)
        p = self.p = {**defaults, **plant.values}
        self.e = {c.name: float(c.value) for c in device.constants("elastomer")}
        radii, weights = stop_grid(self.e, int(self.e["stops"]))
        self.stops = [(float(r), float(w)) for r, w in zip(radii, weights, strict=True)]
        self.d4_Nm = p["J_kgm2"] * p["gear_disturbance_rms_rad_s2"] * math.sqrt(2 / SINES)
        self.waves = [(p[f"wave_{i}_1_rad"], p[f"phase_{i}_rad"]) for i in range(1, SINES + 1)]
        self.rest: tuple[Any, Any] = [0.0] * 6, (0.0, [0.0] * len(self.stops))

    def torque_Nm(self, y: Any, memory: tuple[float, list[float]]) -> float:
        e, p, x, v = self.e, self.p, y[2], y[3]
        since = x - memory[0]
        stops = zip(self.stops, memory[1], strict=True)
        held = sum(w * min(max(z + since, -r), r) for (r, w), z in stops)
        rubber = (e["k3_Nm_rad3"] * x * x + e["k1_Nm_rad"]) * x + y[5] + held
        rubber *= p["elastomer_scale"]
        over = x - min(max(x, -p["coupling_stop_rad"]), p["coupling_stop_rad"])
        push = p["coupling_stop_Nm_rad"] * over + p["coupling_stop_Nms_rad"] * v
        return float(rubber + (push if push * over > 0 else 0.0))

    def slopes(self, _: float, y: Any, u_Nm: float, memory: Any) -> list[float]:
        p, e = self.p, self.e
        xg, vg, xm, vm, u_a, tau_r = (float(a) for a in y)
        drive = self.ratio * u_a - p["fv_Nms_rad"] * vg
        drive -= p["fc_Nm"] * math.tanh(vg / p["coulomb_width_rad_s"])
        drive += self.d4_Nm * sum(math.sin(k * xg + phase) for k, phase in self.waves)
        gap, half = xg - xm, 0.5 * p["cable_backlash_rad"]
        over = gap - min(max(gap, -half), half)
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
        """The stop operators' memory at a state."""
        x = float(y[2])
        since = x - memory[0]
        held = [min(max(z + since, -r), r) for (r, _), z in zip(self.stops, memory[1], strict=True)]
        return x, held


class LoopPeer:
    """A controller's C with the plant's C, encoders and recording included."""

    def __init__(self, loop: ClosedLoop, signals: dict[str, Array], plant: PlantVariant) -> None:
        self._loop, self._signals, self._plant = loop, signals, plant
        self.milliseconds = len(next(iter(signals.values())))

    def run(self, passes: int) -> float:
        start_s = time.thread_time()
        for _ in range(passes):
            self.result = self._loop.run(self._signals, self._plant.values)
        return time.thread_time() - start_s

    def torque_Nm(self) -> Array:
        """At the end of each millisecond but the last: a row is at the start of its own."""
        return np.asarray(self.result.plant["tau_e_Nm"][1:])


class PythonPeer:
    """The plant in Python over motor commands of a millisecond each.

    advance: ``(model, y, u, memory) -> y, memory`` over one millisecond.
    """

    def __init__(self, model: PlantEquations, u_Nm: Array, advance: Callable[..., Any]) -> None:
        self._model, self._u_Nm, self._advance = model, u_Nm.tolist(), advance
        self._torque_Nm = np.zeros(len(u_Nm))

    def run(self, passes: int) -> float:
        start_s, model = time.thread_time(), self._model
        for _ in range(passes):
            y, memory = model.rest
            for k, u in enumerate(self._u_Nm):
                y, memory = self._advance(model, y, u, memory)
                self._torque_Nm[k] = model.torque_Nm(y, memory)
        return time.thread_time() - start_s

    def torque_Nm(self) -> Array:
        return self._torque_Nm


def solved(method: str, rtol: float = 1e-3, atol: float = 1e-6, pieces: int = 1) -> Callable:
    """``solve_ivp``, started anew whenever the command changes; its tolerances by default."""

    def advance(model: PlantEquations, y: Any, u: float, memory: Any) -> Any:
        for _ in range(pieces):
            done = solve_ivp(
                model.slopes, (0.0, MS / pieces), y, method, args=(u, memory), rtol=rtol, atol=atol
            )
            y = done.y[:, -1]
            memory = model.turned(y, memory)
        return y, memory

    return advance


def runge_kutta(model: PlantEquations, y: Any, u: float, memory: Any) -> Any:
    """The classical step, as long as the C's."""
    h = STEP_S

    def ahead(factor: float, slope: list[float]) -> list[float]:
        return [x + factor * s for x, s in zip(y, slope, strict=True)]

    for _ in range(round(MS / h)):
        a = model.slopes(0.0, y, u, memory)
        b = model.slopes(0.0, ahead(0.5 * h, a), u, memory)
        c = model.slopes(0.0, ahead(0.5 * h, b), u, memory)
        d = model.slopes(0.0, ahead(h, c), u, memory)
        y = ahead(h / 6, [p + 2 * q + 2 * r + s for p, q, r, s in zip(a, b, c, d, strict=True)])
        memory = model.turned(y, memory)
    return y, memory


PYTHON = {
    "solve_ivp, LSODA, 1e-8": solved("LSODA", 1e-8, 1e-10),
    "solve_ivp, LSODA, default tolerance": solved("LSODA"),
    "solve_ivp, as it comes (RK45)": solved("RK45"),
    f"Python loop, RK4 at {STEP_S * 1e3:g} ms": runge_kutta,
}


def replay_system(device: Device) -> System:
    """A controller that only passes a recorded motor command on."""
    block = Block.define(
        "replay",
        "A recorded motor command",
        period_s=device.period_s,
        state=(),
        inputs=(Port("u_recorded_Nm", -100, 100, "recorded command"),),
        outputs=(Port("u_Nm", -100, 100, "the same"),),
        step=lambda c, s, u, guard, label: ({}, {"u_Nm": u.u_recorded_Nm}),
    )
    tasks = (Task("pass_on", ("replay",)),)
    inputs, outputs = {"u_recorded_Nm": ("replay.u_recorded_Nm",)}, {"u_Nm": "replay.u_Nm"}
    return System("replayed", device.period_s, {"replay": block}, tasks, {}, inputs, outputs)


class RealTime:
    def __init__(self, milliseconds: int) -> None:
        self._seconds = MS * milliseconds

    def run(self, passes: int) -> float:
        return passes * self._seconds


def twin_rows(
    device: Device,
    pairs: int,
    say: Callable[[str], None],
    fast_ms: int = FAST_MS,
    slow_ms: int = SLOW_MS,
    peers: dict[str, Callable] = PYTHON,
) -> list[dict]:
    """ns a simulated millisecond (the ratio to real time is simulated seconds per second), Nm."""
    say("twin: C")
    plant = plant_variant(device, "real", "none", 0)
    loop = ClosedLoop(device.system, plant, "f32")
    whole = LoopPeer(loop, tuning_signals(device, loop, fast_ms), plant)
    whole.run(1)
    u_Nm = np.asarray(whole.result.controller["u_Nm"], dtype=float)
    replay = ClosedLoop(replay_system(device), plant, "f64")
    alone = LoopPeer(replay, {"u_recorded_Nm": u_Nm}, plant)
    alone.run(1)
    if alone.torque_Nm().tobytes() != whole.torque_Nm().tobytes():
        raise RuntimeError("the plant alone computes other bits than in the loop")
    rows = []
    for name, ours in ((LOOP, whole), (PLANT, alone)):
        rows.append(
            {"name": f"{name} vs real time"} | in_turns(ours, RealTime(fast_ms), fast_ms, pairs)
        )
    defaults = {t.name: t.default for t in loop.plant.blocks["plant"].tunables}
    equations = PlantEquations(device, plant, defaults)
    short = LoopPeer(replay, {"u_recorded_Nm": u_Nm[: slow_ms + 1]}, plant)
    truth = PythonPeer(equations, u_Nm[:slow_ms], solved("LSODA", 1e-10, 1e-12, pieces=10))
    say(f"twin: {TRUTH}")
    for p in (short, truth):
        p.run(1)
    for name, advance in peers.items():
        say(f"twin: {name}")
        peer = PythonPeer(equations, u_Nm[:slow_ms], advance)
        times = in_turns(short, peer, slow_ms, max(3, pairs // 10))
        rows.append({"name": f"{PLANT} vs {name}"} | times)
        ours, theirs = (p.torque_Nm()[:slow_ms] - truth.torque_Nm() for p in (short, peer))
        for kind, norm in (("RMS", lambda e: np.sqrt(np.mean(e**2))), ("largest", _largest)):
            row = exact(float(norm(ours)), float(norm(theirs)), "Nm")
            rows.append({"name": f"{ERROR.format(kind)} vs {name}"} | row)
    return rows


def _largest(error: Array) -> float:
    return float(np.max(np.abs(error)))


def twin_aim(rows: list[dict]) -> list[str]:
    found = [r for r in rows if r["name"] == f"{LOOP} vs real time"]
    return [
        f"aim, closed loop at least {AIM:g} times real time: {r['ratio']:.0f} ({r['low']:.0f} to "
        f"{r['high']:.0f}), {'met' if r['ratio'] >= AIM else 'MISSED'}"
        for r in found
    ]
