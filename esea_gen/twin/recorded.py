"""Inputs of a drive's tasks, recorded in the closed-loop tuning case.

Checks, benchmarks and emulator run on it: 1.7 Nm at 0.6 Hz against the real plant, output fixed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.language.ports import Array
from esea_gen.twin.case import TORQUE, Case, Scale
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.loop_run import ClosedLoopRun
from esea_gen.twin.people import PlantVariant
from esea_gen.twin.run import plant_variant, told
from esea_gen.twin.trajectories import RATE_HZ, Trajectory, tuning


@dataclass(frozen=True)
class RecordedDrive:
    inputs: dict[str, dict[str, Array]]
    outputs: dict[str, dict[str, Array]]
    run: ClosedLoopRun
    plant: PlantVariant


def _tuning_case(device: Device, ticks: int) -> Trajectory:
    path = Case("tuning", tuning()).scaled(Scale.of(device)).trajectory
    longest_s = len(path.tau_desired_Nm) / RATE_HZ
    if not device.period_s <= ticks * device.period_s <= longest_s:
        raise UserError(
            f"{1e3 * ticks * device.period_s:g} ms of the tuning case are requested.",
            f"Give {1e3 * device.period_s:g} to {1e3 * longest_s:g} ms ({longest_s:g} s).",
        )
    return path


def tuning_signals(device: Device, loop: ClosedLoop, ticks: int) -> dict[str, Array]:
    """Inputs of a controller in the tuning case: off at first, armed, then torque control."""
    signals = told(device, loop, _tuning_case(device, ticks), TORQUE, device.axes[0])
    return {k: v[:ticks] for k, v in signals.items() if k in loop.signals or k in loop.intent}


def record_drive(device: Device, ticks: int, seed: int = 0) -> RecordedDrive:
    _tuning_case(device, ticks)  # before anything takes time
    plant = plant_variant(device, "real", "none", seed)
    loop = ClosedLoop(device.system, plant, "f32")
    signals = tuning_signals(device, loop, ticks)
    run = loop.run(signals, plant.values, seed=seed)
    inputs: dict[str, dict[str, Array]] = {}
    outputs: dict[str, dict[str, Array]] = {}
    for task in device.system.tasks:
        at = np.arange(task.phase, ticks, task.every)
        sources = {
            x.name: signals[x.name] if x.name in loop.signals else run.plant[x.name]
            for x in device.system.task_inputs(task)
        }
        inputs[task.name] = {n: np.asarray(a[at], np.float32) for n, a in sources.items()} or {
            "": np.zeros(len(at), np.float32)
        }
        outputs[task.name] = {
            x.name: run.controller[x.name][at].astype(np.uint32 if x.port.whole else np.float32)
            for x in device.system.task_outputs(task)
        }
    return RecordedDrive(inputs, outputs, run, plant)
