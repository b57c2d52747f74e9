"""The fixed stream of a drive: a person moves the joint, and the nominal drive obeys the motor."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from esea_gen.control.laws.predictive import device_horizon
from esea_gen.device import Device
from esea_gen.language.ports import Array
from esea_gen.language.system import External, System
from esea_gen.model.drive import NominalDrive
from esea_gen.model.sensing import zeros_missing

# From here on the drive stands where it was, and the joint is put where the deflection wants it.
LET_GO_S = 5.2
MIDDLE_RAD, MOVED_RAD, MOVED_HZ = 0.8, 0.25, 0.4


def scalars(externals: Iterable[External]) -> list[tuple[str, External, int]]:
    """Name, external and element of every column: a vector takes one an element."""
    return [
        (x.name if x.port.size == 1 else f"{x.name}[{i}]", x, i)
        for x in externals
        for i in range(x.port.size)
    ]


TaskRun = tuple[int, str, Mapping[str, Any]]
"""Its tick, the task, its outputs."""


def play(
    system: System, stream: Mapping[str, Array], before: Callable[[int], None] = lambda k: None
) -> Iterator[TaskRun]:
    """Run a symbolic System over a stream; ``before`` a tick what it measures may be put there."""
    simulator = system.simulator(zeros_missing(system))
    inputs = {t.name: system.task_inputs(t) for t in system.tasks}
    for k in range(len(next(iter(stream.values())))):
        before(k)
        simulator.release(k)
        for task in system.tasks:
            if k >= task.phase and (k - task.phase) % task.every == 0:
                given = {
                    x.name: stream[x.name][k]
                    if x.port.size == 1
                    else np.array([stream[f"{x.name}[{i}]"][k] for i in range(x.port.size)])
                    for x in inputs[task.name]
                }
                yield k, task.name, simulator.step(task.name, **given)


def drive_stream(device: Device, deflection_rad: Array) -> tuple[dict[str, Array], list[TaskRun]]:
    """Every external input of a drive, a row a tick; and what its tasks made of them."""
    system, a = device.system, device.file.actuator
    assert a is not None
    rate_Hz = 1.0 / system.base_period_s
    full = 2.0**device.file.encoder.resolution_bits.value
    time_s = np.arange(len(deflection_rad)) / rate_Hz
    signals = _told(device, time_s)
    load = MIDDLE_RAD + MOVED_RAD * (1 - np.cos(2 * np.pi * MOVED_HZ * time_s))
    stream = {
        name: signals.get(_without_axis(name, device.axes), np.zeros(len(time_s)))
        for name, _, _ in scalars(system.inputs)
    }
    numbers = {c.name: c.value for c in device.constants("actuator")}
    drive = NominalDrive(numbers, system.base_period_s, float(load[0]))
    command, torque = (
        next(x.name for x in system.outputs if _without_axis(x.name, device.axes) == name)
        for name in ("u_Nm", "tau_Nm")
    )
    counts = {n: _without_axis(n, device.axes) for n in stream if n.startswith("count_")}
    stream |= {n: np.zeros(len(time_s)) for n in counts}

    def measure(k: int) -> None:
        side, held = drive.theta_rad, time_s[k] >= LET_GO_S
        angles = {
            "count_motor": (side, 1.0, full),
            "count_load": (side - deflection_rad[k] if held else load[k], 1.0, full),
            "count_gear": (side, a.gear_ratio.value, 2.0**a.encoder_bits.value),
        }
        for name, kind in counts.items():
            stream[name][k] = _count(*angles[kind])

    runs = []
    for k, task, out in play(system, stream, measure):
        runs.append((k, task, out))
        if command in out and time_s[k] < LET_GO_S:
            drive.move(float(out[command]), float(out[torque]))
    return stream, runs


def _count(angle_rad: float, turns: float, full: float) -> float:
    raw = np.floor(angle_rad * turns / (2 * np.pi) * full)
    return float(raw % full if np.isfinite(raw) else raw)


def _told(device: Device, time_s: Array) -> dict[str, Array]:
    # Laws change while torque is wanted; a device with one law has no such input.
    def between(start_s: float, end_s: float) -> Array:
        return ((time_s >= start_s) & (time_s < end_s)).astype(float)

    n = len(time_s)
    desired = 0.5 * np.sin(2 * np.pi * 0.7 * time_s)
    signals = {
        "frame_error_load": 2.0 * between(2.6, 2.602),
        "frame_error_gear": 1.0 * between(1.1, 1.102),
        "mode": 1.0 * between(0.06, 1.6) + 2.0 * between(1.6, 2.9) + between(3.4, 9.0),
        "stop": between(2.9, 2.92),
        "rearm": 1.0 * between(0.03, 3.2) + 2.0 * between(3.2, 9.0),
        "tau_desired_Nm": np.round(desired * 2**12) / 2**12,
        "theta_desired_rad": MIDDLE_RAD * np.ones(n),
        "omega_desired_rad_s": np.zeros(n),
        "law": 1.0 * between(0.7, 1.3) + between(2.0, 2.5),
    }
    ahead = np.rint(np.array(device_horizon(device).ends_s) / device.system.base_period_s)
    for name in ("tau", "theta", "omega"):
        unit = "Nm" if name == "tau" else "rad" if name == "theta" else "rad_s"
        wanted = signals[f"{name}_desired_{unit}"]
        for i, ticks in enumerate(ahead.astype(int)):
            at = np.minimum(np.arange(n) + ticks, n - 1)
            signals[f"{name}_preview_{unit}[{i}]"] = wanted[at]
    return signals


def _without_axis(name: str, axes: Iterable[str]) -> str:
    for axis in filter(None, axes):
        name = re.sub(rf"_{axis}(?=_|$)", "", name)
    return name
