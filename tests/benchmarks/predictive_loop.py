"""Inputs of the predictive controller in closed loop with a standard plant."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from esea_gen.device import Device
from esea_gen.language.ports import Array
from esea_gen.language.system import Signal, System
from esea_gen.twin.case import Case, Setting
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.run import plant_variant, run_on


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
    run = run_on(loop, device, variant, case, Setting(controller, "real", person), seed)
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
