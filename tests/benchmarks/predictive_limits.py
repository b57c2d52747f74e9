"""What limits the accuracy of predictive control: its estimates, its sensor, or the loop.

    python -m tests.benchmarks.predictive_limits [--json FILE]

The same law is told the plant's true state; and a sine is repeated, each time with the error's
harmonics of the last time added to what is wanted: those that the sensor shows, and the true ones.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np

from esea_gen.language.ports import Array
from esea_gen.language.system import System
from esea_gen.twin import trajectories
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.judge import rms
from esea_gen.twin.run import plant_variant, run_on
from esea_gen.twin.trajectories import RATE_HZ, Trajectory

LAW, SEEDS = "mpc", range(760, 765)
# What is told instead of estimated: input of the controller, output of the plant.
STATES = {"omega_l_rad_s": "omega_l_rad_s", "omega_gear_rad_s": "omega_g_rad_s"}
STATES |= {"u_a_Nm": "u_a_Nm", "d4_rad_s2": "d4_rad_s2"}
SINES = {"tuning": (1.7, 0.6), "3 Nm 1 Hz": (3.0, 1.0), "4 Nm 0.5 Hz": (4.0, 0.5)}
PATHS = {n: trajectories.fixed_sinusoid(*s) for n, s in SINES.items()} | {
    "backdriven 0.25 Hz": trajectories.backdriven(0.25),
    "bread 0 Nm": trajectories.bread(0.0),
    "bread 2 Nm": trajectories.bread(2.0),
}
# Share of the error that a repetition takes, how much the loop lags, harmonics.
TAKEN, LAG_S, HARMONICS, REPETITIONS = 0.4, 0.012, 20, 12
Torques = Callable[[Trajectory, int], tuple[Array, Array]]


def loop_of(told: dict[str, str]) -> Torques:
    """True and sensed torque of a path and a seed, by a law that is told some of the states."""
    device = controller_device(LAW)
    system = device.system
    wires = {
        f"{k.instance}.{k.port}": f"{v.instance}.{v.port}"
        for k, v in system.wires.items()
        if k.instance != "predictive" or k.port not in told
    }
    inputs = {x.name: tuple(f"{s.instance}.{s.port}" for s in x.signals) for x in system.inputs}
    inputs |= {true: (f"predictive.{name}",) for name, true in told.items()}
    outputs = {x.name: f"{x.signals[0].instance}.{x.signals[0].port}" for x in system.outputs}
    outputs = {k: v for k, v in outputs.items() if k not in told.values()}
    base = system.name, system.base_period_s, system.blocks, system.tasks
    loop = ClosedLoop(
        System(*base, wires, inputs, outputs), plant_variant(device, "real", "none", 0)
    )

    def run(path: Trajectory, seed: int) -> tuple[Array, Array]:
        person = "none" if path.clamped else "uncertain"
        variant = plant_variant(device, "real", person, seed)
        case, setting = Case(path.name, path), Setting(LAW, "real", person)
        done = run_on(loop, device, variant, case, setting, seed)
        return done.plant["tau_e_Nm"], done.controller["tau_Nm"]

    return run


def learned_Nm(run: Torques, path: Trajectory, f_Hz: float, seed: int, true: bool) -> float:
    """Least error of the repetitions."""
    wanted, window = path.tau_desired_Nm, path.window
    turns = 2j * np.pi * f_Hz * np.arange(HARMONICS)
    waves = np.exp(turns[:, None] * np.arange(len(wanted)) / RATE_HZ)
    learned, errors = np.zeros(HARMONICS, complex), []
    for _ in range(1 + REPETITIONS):
        added = np.real(learned @ waves)
        felt, sensed = run(replace(path, tau_desired_Nm=wanted + added), seed)
        errors.append(rms((wanted - felt)[window]))
        left = (wanted - (felt if true else sensed))[window]
        harmonics = 2 * np.conj(waves[:, window]) @ left / len(left)
        harmonics[0] /= 2
        learned += TAKEN * harmonics * np.exp(turns * LAG_S)
    return min(errors)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    out = parser.parse_args().json
    shipped, knowing = loop_of({}), loop_of(STATES)
    rows = []
    for name, path in PATHS.items():
        row: dict[str, float] = {}
        for key, run in (("shipped_Nm", shipped), ("knowing_Nm", knowing)):
            errors = [(run(path, s)[0] - path.tau_desired_Nm)[path.window] for s in SEEDS]
            row[key] = median(map(rms, errors))
        if name in SINES:  # people do not repeat themselves
            for key, true in (("sensed_Nm", False), ("true_Nm", True)):
                row[key] = median(learned_Nm(shipped, path, SINES[name][1], s, true) for s in SEEDS)
        rows.append({"case": name, "sensed_Nm": math.nan, "true_Nm": math.nan} | row)
        print(name, *(f"{v:.3f}" for v in row.values()), sep="\t")
    if out:
        out.write_text(json.dumps({"rows": rows}), encoding="utf-8")


if __name__ == "__main__":
    main()
