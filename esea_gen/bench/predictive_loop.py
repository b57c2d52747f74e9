"""Predictive and sliding mode control in closed loop with the reference plants, side by side.

    python -m esea_gen.bench.predictive_loop --seeds 10 --random 200

The controllers are the generated f32 C; plants, people and trajectories are the reference ones
(``twin/plants.toml``).  Printed is the true error (coupling's torque less the wanted one) and the
one that the sensor's model sees.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.control.horizon import Horizon
from esea_gen.control.predictive_system import predictive_delay_s, predictive_system
from esea_gen.device import Device, load_device
from esea_gen.errors import UserError
from esea_gen.hostlib.closed_loop import ClosedLoop, ClosedLoopRun
from esea_gen.system import Signal, System
from esea_gen.twin.people import PlantVariant, random_plant, real_plant
from esea_gen.twin.trajectories import Trajectory, backdriven, bread, fixed_sinusoid

GRID = tuple((a, f) for f, top in ((0.25, 4), (0.5, 4), (1.0, 3)) for a in range(1, top + 1))
GRID += ((1, 0.75),)
ARM_TICK, MODE_TICK = 50, 100
UNSTABLE_NM, UNSTABLE_RAD_S = 3.0, 12.0


@dataclass(frozen=True)
class Outcome:
    """One run.

    Parameters
    ----------
    true_Nm, modelled_Nm : float
        RMS over the analysed window.
    peak_Nm, gear_rad_s : float
        Largest true error in the window and largest speed of the gear.
    fault : int
        What the limits hold at the end; 0 for none.
    """

    true_Nm: float
    modelled_Nm: float
    peak_Nm: float
    gear_rad_s: float
    fault: int

    @property
    def unstable(self) -> bool:
        """By the reference's criteria, or a trip of the limits."""
        return (
            not self.peak_Nm <= UNSTABLE_NM
            or not self.gear_rad_s <= UNSTABLE_RAD_S
            or self.fault != 0
        )


class Bench:
    """One controller's System compiled with a plant that has a cable.

    Parameters
    ----------
    name : str
        What it is called in tables.
    device : Device
        Its device.
    system : System
        The controlling System.
    instance, load : str
        Instance and tunable that is 1 for a free and 0 for a held load side.
    preview : Horizon, optional
        Grid of the preview input, where the System has one.
    """

    def __init__(
        self,
        name: str,
        device: Device,
        system: System,
        instance: str,
        load: str,
        preview: Horizon | None = None,
    ) -> None:
        self.name, self.device, self.preview = name, device, preview
        self.instance, self.load = instance, load
        self.loop = ClosedLoop(system, real_plant(device), "f32")

    def run(self, trajectory: Trajectory, plant: PlantVariant, seed: int) -> Outcome:
        """Run a trajectory on a plant.

        Parameters
        ----------
        trajectory : Trajectory
            What is wanted, and the person's path.
        plant : PlantVariant
            Plant and person.
        seed : int
            Of the person's torque noise.

        Returns
        -------
        Outcome
            Errors and stability.
        """
        r = self.record(trajectory, plant, seed)
        window = trajectory.window
        wanted = trajectory.signals()["tau_desired_Nm"][window]
        error = r.plant["tau_e_Nm"][window] - wanted
        seen = r.controller["tau_Nm"][window] - wanted
        return Outcome(
            float(np.sqrt(np.mean(error**2))),
            float(np.sqrt(np.mean(seen**2))),
            float(np.max(np.abs(error))),
            float(np.max(np.abs(r.plant["omega_g_rad_s"]))),
            int(r.controller["fault"][-1]),
        )

    def record(self, trajectory: Trajectory, plant: PlantVariant, seed: int) -> ClosedLoopRun:
        """The same run with everything that was recorded.

        Parameters
        ----------
        trajectory, plant, seed
            As in :meth:`run`.

        Returns
        -------
        ClosedLoopRun
            One row a tick.
        """
        given = trajectory.signals()
        n = len(given["tau_desired_Nm"])
        ticks = np.arange(n)
        signals: dict[str, Any] = {k: np.zeros(n) for k in self.loop.signals}
        signals |= {
            "mode": (ticks >= MODE_TICK) * 1.0,
            "rearm": (ticks >= ARM_TICK) * 1.0,
        }
        signals |= {k: v for k, v in given.items() if k in signals or "_p_" in k}
        if self.preview is not None:
            z = self.preview
            ends = (np.arange(z.intervals) + 1) * z.interval_s + z.delay_s
            # The control task reads what was measured a tick ago.
            ahead = np.rint(ends / self.loop.tick_s).astype(int) - 1
            future = np.minimum(ticks[:, None] + ahead, n - 1)
            signals["tau_preview_Nm"] = given["tau_desired_Nm"][future]
        held = {self.instance: {self.load: 0.0 if trajectory.clamped else 1.0}}
        return self.loop.run(
            signals,
            plant_tunables=dict(plant.values) | {"clamped": float(trajectory.clamped)},
            controller_tunables=held,
            seed=seed,
        )


def published() -> Device:
    """The device with the sliding mode of the thesis.

    Returns
    -------
    Device
        Read from ``twin/controllers/smc-published.toml``.
    """
    return load_device(Path(__file__).parents[1] / "twin" / "controllers" / "smc-published.toml")


def benches(device: Device, say: Callable[[str], None]) -> list[Bench]:
    """The controllers that are compared.

    Parameters
    ----------
    device : Device
        A device with a drive.
    say : callable
        Told what is being compiled.

    Returns
    -------
    list of Bench
        Sliding mode as printed and as shipped, predictive without and with preview.
    """
    horizon = Horizon(delay_s=predictive_delay_s(device))
    made = []
    say("compiling sliding mode as printed")
    printed = published()
    made.append(Bench("SMC as printed", printed, printed.system, "smc", "load_share"))
    say("compiling sliding mode")
    made.append(Bench("SMC as shipped", device, device.system, "smc", "load_share"))
    for preview in (False, True):
        name = "MPC, preview" if preview else "MPC, no preview"
        say(f"compiling {name}")
        system = predictive_system(
            device, device.velocity, device.sensor, device.inverse, horizon=horizon, preview=preview
        )
        grid = horizon if preview else None
        made.append(Bench(name, device, system, "predictive", "load_free", grid))
    return made


def yardsticks(device: Device, seeds: int, say: Callable[[str], None]) -> list[str]:
    """The table of the reference experiments on the real plant with the uncertain person.

    Parameters
    ----------
    device : Device
        A device with a drive.
    seeds : int
        How many plants; the medians are given.
    say : callable
        Told what is being done.

    Returns
    -------
    list of str
        Lines.
    """
    cases: Mapping[str, Sequence[Trajectory]] = {
        "tuning": [fixed_sinusoid(1.7, 0.6)],
        "12-point grid": [fixed_sinusoid(a, f) for a, f in GRID],
        "backdriven": [backdriven(f) for f in (0.1, 0.15, 0.2, 0.25)],
        "bread 0 Nm": [bread()],
    }
    lines = [f"{'median of ' + str(seeds) + ' plants, Nm RMS':28}  {'true':>7}  {'modelled':>8}"]
    for bench in benches(device, say):
        for case, trajectories in cases.items():
            say(f"{bench.name}: {case}")
            runs = []
            for seed in range(seeds):
                plant = real_plant(device, seed=seed)
                many = [bench.run(t, plant, seed) for t in trajectories]
                runs.append(
                    [np.mean([r.true_Nm for r in many]), np.mean([r.modelled_Nm for r in many])]
                )
                faults = sum(r.fault != 0 for r in many)
                if faults:
                    say(f"  seed {seed}: the limits tripped in {faults} of {len(many)} runs")
            true, modelled = np.median(runs, axis=0)
            lines.append(f"{bench.name + ', ' + case:28}  {true:7.4f}  {modelled:8.4f}")
            say(lines[-1])
    return lines


def recorded_rows(device: Device, trajectory: Trajectory, steps: int, seed: int = 0) -> np.ndarray:
    """What the predictive controller is fed in closed loop: rows for counting instructions.

    Parameters
    ----------
    device : Device
        A device with a drive.
    trajectory : Trajectory
        What is wanted; the real plant with the uncertain person.
    steps : int
        How many steps of the control task, from the start of the analysed window.
    seed : int
        Of plant and noise.

    Returns
    -------
    ndarray
        Shape (steps, numbers), the inputs port by port.
    """
    system = predictive_system(device, device.velocity, device.sensor, device.inverse)
    program = system.blocks["predictive"]
    sources = {p.name: system.wires[Signal("predictive", p.name)] for p in program.inputs}
    watched = System(
        system.name,
        system.base_period_s,
        system.blocks,
        system.tasks,
        {f"{k.instance}.{k.port}": f"{v.instance}.{v.port}" for k, v in system.wires.items()},
        {x.name: tuple(f"{s.instance}.{s.port}" for s in x.signals) for x in system.inputs},
        {x.name: f"{x.signals[0].instance}.{x.signals[0].port}" for x in system.outputs}
        | {f"fed_{n}": f"{s.instance}.{s.port}" for n, s in sources.items()},
    )
    bench = Bench("recorded", device, watched, "predictive", "load_free")
    run = bench.record(trajectory, real_plant(device, seed=seed), seed)
    every = system.task("control").every
    start = trajectory.window.start // every * every
    ticks = start + every * np.arange(steps) - 1  # as released when the task starts
    columns = [
        np.asarray(run.controller[f"fed_{p.name}"])[ticks].reshape(steps, -1)
        for p in program.inputs
    ]
    return np.hstack(columns)


def stability(device: Device, count: int, say: Callable[[str], None]) -> list[str]:
    """Random plants and people: how many runs were unstable.

    Parameters
    ----------
    device : Device
        A device with a drive.
    count : int
        How many.
    say : callable
        Told what is being done.

    Returns
    -------
    list of str
        Lines.
    """
    lines = []
    for bench in benches(device, say)[1:]:
        errors, unstable = [], 0
        for seed in range(count):
            plant = random_plant(device, seed)
            trajectory = (bread(), backdriven(0.2), fixed_sinusoid(2.0, 1.0))[seed % 3]
            run = bench.run(trajectory, plant, seed)
            unstable += run.unstable
            errors.append(run.true_Nm)
        worst = max(errors) if errors else math.nan
        lines.append(
            f"{bench.name}: {unstable} of {count} random plants unstable or tripped; "
            f"true error mean {np.mean(errors):.3f}, worst {worst:.3f} Nm"
        )
        say(lines[-1])
    return lines


def main(arguments: list[str] | None = None) -> int:
    """Command line.

    Parameters
    ----------
    arguments : list of str, optional
        In place of the command line's.

    Returns
    -------
    int
        Exit code.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("device", nargs="?", default="elbow_drive")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--random", type=int, default=0, help="random plants and people")
    chosen = parser.parse_args(arguments)

    def say(text: str) -> None:
        print(text, flush=True)

    try:
        device = load_device(chosen.device)
        if chosen.seeds:
            yardsticks(device, chosen.seeds, say)
        if chosen.random:
            stability(device, chosen.random, say)
    except UserError as error:
        print(f"esea-gen: {error}")
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
