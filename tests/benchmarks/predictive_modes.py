"""Modes of predictive control with a hand: one control period of the closed loop as a matrix.

    python -m tests.benchmarks.predictive_modes [--json FILE]

The controller is the System in its float64 executor, with encoders without steps, differentiated by
central differences while hand and drive turn at a constant speed.  The plant is linear and derived
again: motor's lag, gear, cable and rubber in series, a hand with inertia, damping and a spring.
"""

from __future__ import annotations

import argparse
import copy
import itertools
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm

from esea_gen.device import load_device
from esea_gen.language.ports import Array
from esea_gen.language.program import Program
from esea_gen.model.mode import Mode
from esea_gen.studies.passivity.push import GAIN_TUNABLES
from esea_gen.studies.passivity.study import HANDS

H, EVERY = 1e-3, 5
FEEDS = ("encoder_motor.theta_rad", "encoder_load.theta_rad", "encoder_gear.theta_gear_rad")
FEEDS += ("encoder_gear.omega_gear_rad_s",)
NO_COUNTS = {f"{n}_{s}": 0.0 for n in ("count", "frame_error") for s in ("motor", "load", "gear")}
# What learns or judges keeps its state: damping that the passivity Block adds counts as Kd.
FROZEN = {"passivity", "cable", "gear", "redundancy", "adaptation", "interpolation", "trend"}
LEARNT = {"passivity_damping_Nms_rad", "cable_give_rad_Nm", "cable_gap_rad"}
# Slower modes are the drift of a hand that nothing holds.
SLOW_HZ = 0.2
GAINS = ((0.0, 0.0), (0.0, 0.35), (3.0, 0.0), (3.0, 0.35))
# About the rubber's stiffness at 1 Nm, 20 Nm/rad; the softest and the nominal cable.
RUBBERS_NM_RAD, CABLES_NM_RAD, DAMPINGS_NMS_RAD = (14.0, 26.0), (80.0, 150.0), (0.0, 0.1, 0.2, 0.5)


@dataclass(frozen=True)
class Plant:
    rubber_Nm_rad: float
    cable_Nm_rad: float
    inertia_kgm2: float
    damping_Nms_rad: float = 0.0
    spring_Nm_rad: float = 0.0

    def tick(self, actuator: Any) -> tuple[Array, Array, Array]:
        """One tick of theta, omega, u_a, hand's two and last theta; what the encoders show."""
        names = ("J_kgm2", "fv_Nms_rad", "tau_c_s", "gear_ratio")
        j, fv, lag, ratio = (getattr(actuator, n).value for n in names)
        k = 1 / (1 / self.rubber_Nm_rad + 1 / self.cable_Nm_rad)
        f, hand = np.zeros((6, 6)), self.inertia_kgm2
        f[0, 1] = f[3, 4] = 1.0
        f[1, :4] = -k / j, -fv / j, ratio / j, k / j
        f[2, [2, 5]] = -1 / lag, 1 / lag
        f[4, [0, 3, 4]] = k / hand, -(k + self.spring_Nm_rad) / hand, -self.damping_Nms_rad / hand
        exact = expm(f * H)
        move, show = np.zeros((6, 6)), np.zeros((4, 6))
        move[:5, :5], move[5, 0] = exact[:5, :5], 1.0
        # The motor side has no inertia: cable and rubber carry the same torque.
        show[0, [0, 3]] = k / self.rubber_Nm_rad, 1 - k / self.rubber_Nm_rad
        show[1, 3] = show[2, 0] = 1.0
        show[3, [0, 5]] = 1 / H, -1 / H
        return move, np.append(exact[:5, 5], 0.0), show


class _Fed:
    """In place of a Block: outputs that are set from outside."""

    def __init__(self, outputs: dict[str, float]) -> None:
        self.outputs = outputs

    def step(self, **_: Any) -> dict[str, float]:
        return dict(self.outputs)


class Controller:
    """The System's executor, with everything continuous that does not learn as one vector.

    amplitude: of the differences, in rad, times 20 for what has another unit.
    """

    def __init__(
        self, gains: tuple[float, float], speed_rad_s: float = 0.5, amplitude: float = 1e-6
    ) -> None:
        device = load_device("elbow_mpc")
        self.actuator, system = device.file.actuator, device.system
        self.sim: Any = system.simulator(
            {"reference": dict(zip(GAIN_TUNABLES, gains, strict=True))}
        )
        self.own = []
        for name, block in system.blocks.items():
            if name.startswith(("encoder_", "monitor")):
                outputs = {p.name: float(p.name.endswith("usable")) for p in block.outputs}
                self.sim.blocks[name] = _Fed(outputs)
            else:
                self.own.append(name)
        self.places: list[tuple[str, str, int]] = []
        for name in [n for n in self.own if n not in FROZEN | {"limits"}]:
            at: Any = system.blocks[name]
            ports = at.carried if isinstance(at, Program) else at.state
            self.places += [(name, p.name, i) for p in ports if not p.whole for i in range(p.size)]
        for x in system.latches:
            if not x.port.whole and x.name not in LEARNT | {"gear_d_gear_rad_s2"}:
                both = itertools.product(("pending", "visible"), range(x.port.size))
                self.places += [(table, x.name, i) for table, i in both]
        steps = [1 if n.endswith("_rad") else 20 for _, n, _ in self.places] + [1, 1, 1, 20]
        self.steps = amplitude * np.array(steps, dtype=float)
        self.base = Plant(20.0, 150.0, 1e6).tick(self.actuator)
        self.x = np.zeros(6)
        self._turn(speed_rad_s, 1000)
        self.ticks = [self._differentiate(1000 + k) for k in range(EVERY)]

    def _tick(self, tick: int, shown: Array) -> float:
        for name, value in zip(FEEDS, shown, strict=True):
            block, _, port = name.partition(".")
            self.sim.blocks[block].outputs[port] = float(value)
        self.sim.release(tick)
        started = {"mode": Mode.IMPEDANCE * float(tick >= 80), "rearm": float(tick >= 50)}
        u = self.sim.step("sense", stop=0.0, **started, **NO_COUNTS, **self.wanted)["u_Nm"]
        if tick % EVERY == 0:
            self.sim.step("control")
        return float(u)

    def _turn(self, speed_rad_s: float, ticks: int) -> None:
        """Closed loop with a hand that turns at a speed, from rest; 1 Nm is asked for."""
        move, push, show = self.base
        for tick in range(ticks):
            share = min(1.0, max(0.0, tick / 200 - 0.5))
            self.x[4] = speed_rad_s * share
            path = {"theta_desired_rad": self.x[3], "omega_desired_rad_s": self.x[4]}
            self.wanted = {"tau_desired_Nm": share} | {n: float(v) for n, v in path.items()}
            self.x = move @ self.x + push * self._tick(tick, show @ self.x)

    def _taken(self) -> dict[str, Any]:
        states = {n: self.sim.blocks[n].state for n in self.own}
        return states | {"pending": dict(self.sim.pending), "visible": dict(self.sim.visible)}

    def _put(self, values: Mapping[str, Any], watch: Any) -> None:
        for n in self.own:
            self.sim.blocks[n].state = values[n]
        self.sim.pending, self.sim.visible = dict(values["pending"]), dict(values["visible"])
        self.sim.watch = copy.deepcopy(watch)

    def _differentiate(self, tick: int) -> Array:
        """From (state, shown) at a tick to (next state, command), about the loop's own motion."""
        start, watch = self._taken(), copy.deepcopy(self.sim.watch)
        move, push, show = self.base
        shown, columns = show @ self.x, []
        for j, step in enumerate(self.steps):
            ends = []
            for change in (step, -step):
                values, seen = {n: dict(v) for n, v in start.items()}, shown.copy()
                if j < len(self.places):
                    group, field, i = self.places[j]
                    values[group][field] = np.array(values[group][field], dtype=float)
                    values[group][field].reshape(-1)[i] += change
                else:
                    seen[j - len(self.places)] += change
                self._put(values, watch)
                u, now = self._tick(tick, seen), self._taken()
                ends.append(np.array([*(np.ravel(now[n][f])[i] for n, f, i in self.places), u]))
            columns.append((ends[0] - ends[1]) / (2 * step))
        self._put(start, watch)
        self.x = move @ self.x + push * self._tick(tick, shown)
        return np.stack(columns, axis=1)

    def modes(self, plant: Plant) -> Array:
        """Growth (1/s) and frequency (Hz) of every mode of a control period."""
        move, push, show = plant.tick(self.actuator)
        n = len(self.places)
        period = np.eye(n + 6)
        for tick in self.ticks:
            both = np.hstack([tick[:, :n], tick[:, n:] @ show])
            below = np.hstack([np.zeros((6, n)), move]) + np.outer(push, both[n])
            period = np.vstack([both[:n], below]) @ period
        poles = np.linalg.eigvals(period).astype(complex)
        s = np.log(poles[np.abs(poles) > 1e-9]) / (EVERY * H)
        return np.stack([s.real, np.abs(s) / (2 * np.pi)])


def rows() -> list[dict[str, Any]]:
    """Of the hands of the passivity map: the fastest growth, and with which plant."""
    found = []
    for gains in GAINS:
        controller = Controller(gains)
        for damping in DAMPINGS_NMS_RAD:
            best: dict[str, Any] = {"growth_1_s": -np.inf}
            hands = [h for h in HANDS if not h.damping_Nms_rad]
            for k, c, h in itertools.product(RUBBERS_NM_RAD, CABLES_NM_RAD, hands):
                plant = Plant(k, c, h.inertia_kgm2, damping, h.stiffness_Nm_rad)
                growth, frequency_Hz = controller.modes(plant)
                i = int(np.argmax(np.where(frequency_Hz > SLOW_HZ, growth, -np.inf)))
                if growth[i] > best["growth_1_s"]:
                    best = {"growth_1_s": float(growth[i]), "frequency_Hz": float(frequency_Hz[i])}
                    best |= asdict(plant)
            found.append(dict(zip(GAIN_TUNABLES, gains, strict=True)) | best)
            print(json.dumps(found[-1]), flush=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="also write the numbers")
    chosen = parser.parse_args()
    text = json.dumps({"rows": rows()}, indent=1)
    if chosen.json:
        chosen.json.write_text(text)


if __name__ == "__main__":
    main()
