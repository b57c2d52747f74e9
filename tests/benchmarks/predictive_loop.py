"""Predictive and sliding mode control in closed loop with the standard plants, side by side.

    python -m tests.benchmarks.predictive_loop --seeds 10 --random 200 --resume journal

The controllers are the generated f32 C of their device files (``devices/controllers``); plants,
people and trajectories are the standard ones (``twin/plants.toml``).  Printed is the true error
(coupling's torque less the wanted one), and how many runs were unstable or tripped.  With
``--resume`` a run that was cut off goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from esea_gen.analysis.campaign import Workers
from esea_gen.device import Device
from esea_gen.language.ports import Array
from esea_gen.language.system import Signal, System
from esea_gen.studies.simulation import default_person, simulate
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.run import plant_variant, run_on

CONTROLLERS = {
    "smc-published": "SMC as published",
    "smc-published-30Hz": "SMC as published, set-point 30 Hz",
    "smc": "SMC as shipped",
    "mpc-published": "MPC as published, preview",
    "mpc-published-no-preview": "MPC as published",
    "mpc-no-preview": "MPC",
    "mpc": "MPC, preview",
}
EXPERIMENTS = ("tuning", "grid", "backdriven", "bread", "impedance")
RANDOM = ("tuning", "backdriven", "bread")
# The second slice, at 2 Nm, has no yardstick: it is told apart.
APART = {("bread", "2 Nm"): "bread 2 Nm"}


def compared(
    experiments: Sequence[str],
    controllers: Sequence[str],
    plant: str,
    runs: int,
    folder: Path | None,
    workers: Workers,
) -> None:
    """Experiments with one controller after the other on the same plants.

    Of each plant the mean over the experiment's cases, and of these the median, the mean and the
    largest, over the runs that could be judged; runs that were unstable or tripped.
    """
    head = f"{plant} plants: {runs}, true error, Nm RMS"
    print(f"{head:44}  median    mean   worst  unstable  tripped", flush=True)
    for experiment in experiments:
        for controller in controllers:
            setting = Setting(controller, plant, default_person(experiment, plant))
            journal = folder / f"{plant}-{experiment}-{controller}" if folder else None
            done = simulate(experiment, setting, runs=runs, workers=workers, folder=journal)
            kinds: dict[str, list[dict[str, object]]] = {}
            for entry in done.cases():
                kind = APART.get((experiment, str(entry["name"])), experiment)
                kinds.setdefault(kind, []).append(entry)
            for kind, entries in kinds.items():
                name = f"{kind}, {CONTROLLERS.get(controller, controller)}"
                print(_line(name, entries), flush=True)


def _line(name: str, entries: Sequence[dict[str, object]]) -> str:
    by_seed: dict[object, list[float]] = {}
    for e in entries:
        value = e["rms_true_Nm"]
        by_seed.setdefault(e["seed"], []).append(np.nan if value is None else float(str(value)))
    means = np.array([np.mean(v) for v in by_seed.values()])
    good = means[np.isfinite(means)]
    figures = (np.median(good), np.mean(good), np.max(good)) if len(good) else (np.nan,) * 3
    unstable = sum(bool(e.get("unstable")) for e in entries)
    tripped = sum(bool(e.get("tripped")) or bool(e.get("fault")) for e in entries)
    failed = sum("failure" in e for e in entries)
    return (
        f"{name:44} {figures[0]:7.4f} {figures[1]:7.4f} {figures[2]:7.4f}  "
        f"{unstable:4d}/{len(entries)} {tripped:4d}/{len(entries)}"
        + (f"  {failed} FAILED" if failed else "")
    )


@lru_cache(maxsize=1)
def _watched(controller: str) -> tuple[Device, ClosedLoop]:
    # The loop with what the predictive controller is fed as outputs; persons come with each run.
    device = controller_device(controller)
    system = device.system
    wires = {f"{k.instance}.{k.port}": f"{v.instance}.{v.port}" for k, v in system.wires.items()}
    watched = System(
        system.name,
        system.base_period_s,
        system.blocks,
        system.tasks,
        wires,
        {x.name: tuple(f"{s.instance}.{s.port}" for s in x.signals) for x in system.inputs},
        {x.name: f"{x.signals[0].instance}.{x.signals[0].port}" for x in system.outputs}
        | {f"fed_{n}": f"{s.instance}.{s.port}" for n, s in _sources(system).items()},
    )
    return device, ClosedLoop(watched, plant_variant(device, "real", "none", 0))


def _sources(system: System) -> dict[str, Signal]:
    names = [p.name for p in system.blocks["predictive"].inputs]
    return {n: system.wires[Signal("predictive", n)] for n in names}


def recorded_rows(controller: str, case: Case, steps: int, seed: int = 0) -> Array:
    """What the predictive controller is fed in closed loop: rows for counting instructions.

    steps: how many steps of the control task, from the start of the analysed window.
    """
    device, loop = _watched(controller)
    system = device.system
    person = "none" if case.trajectory.clamped else "uncertain"
    variant = plant_variant(device, "real", person, seed)
    setting = Setting(controller, "real", person)
    run = run_on(loop, device, variant, case, setting, seed)
    every = system.task("control").every
    start = case.trajectory.window.start // every * every
    ticks = start + every * np.arange(steps)
    columns = []
    for name, source in _sources(system).items():
        # Of another task: as released when this one starts.
        late = system.task_of(source.instance).name != "control"
        values = np.asarray(run.controller[f"fed_{name}"])[ticks - 1 if late else ticks]
        columns.append(values.reshape(steps, -1))
    return np.hstack(columns)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="standard plants; 0 for none")
    parser.add_argument("--random", type=int, default=0, help="random plants and people")
    parser.add_argument("--controllers", nargs="+", default=list(CONTROLLERS))
    parser.add_argument("--resume", type=Path, help="journal: continue where a run was cut off")
    parser.add_argument("--jobs", type=int, default=-1, help="parallel processes; -1: all cores")
    parser.add_argument("--cluster", help="address of a Dask scheduler, instead of processes here")
    chosen = parser.parse_args()
    names, folder, workers = chosen.controllers, chosen.resume, Workers(chosen.jobs, chosen.cluster)
    if chosen.seeds:
        compared(EXPERIMENTS, names, "real", chosen.seeds, folder, workers)
    if chosen.random:
        compared(RANDOM, names, "random", chosen.random, folder, workers)


if __name__ == "__main__":
    main()
