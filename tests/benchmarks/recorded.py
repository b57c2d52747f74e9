"""What every Block and task of a drive reads in the recorded tuning case: what is timed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.hostlib.library import HostLibrary, compile_device
from esea_gen.hostlib.runner import CBoard, run_schedule
from esea_gen.language.component import Executor
from esea_gen.language.ports import Array
from esea_gen.language.stream import Stream, single
from esea_gen.language.system import System, SystemSimulator
from esea_gen.twin.recorded import RecordedDrive


class _Listener:
    """A Block's simulator that keeps what it was given."""

    def __init__(self, simulator: Executor) -> None:
        self._simulator = simulator
        self.given: list[dict[str, Any]] = []

    def step(self, **inputs: Any) -> dict[str, Any]:
        self.given.append(inputs)
        return self._simulator.step(**inputs)


def block_streams(device: Device, drive: RecordedDrive, steps: int) -> dict[str, Stream]:
    """What each Block of a drive is given in the recorded case.

    return: by instance; float32 numbers, computed by the symbolic System from the recorded inputs.
    """
    board = SystemSimulator(device.system)
    heard = {i: _Listener(s) for i, s in board.blocks.items()}
    board.blocks = dict(heard)  # type: ignore[arg-type]
    run_schedule(
        board, _shortened(device.system, drive, {t.name: steps for t in device.system.tasks})
    )
    return {
        i: Stream(
            "tuning case",
            {
                p.name: single(
                    [np.asarray(g[p.name]).reshape(p.size) for g in x.given[:steps]]
                ).reshape((steps,) if p.size == 1 else (steps, p.size))
                for p in device.system.blocks[i].inputs
            },
        )
        for i, x in heard.items()
    }


def _shortened(
    system: System, drive: RecordedDrive, runs: Mapping[str, int]
) -> dict[str, dict[str, Array]]:
    # As many ticks as the slowest task needs for its runs.
    end = max(system.task(t).phase + (n - 1) * system.task(t).every + 1 for t, n in runs.items())
    out = {}
    for t in system.tasks:
        count = len(range(t.phase, end, t.every))
        columns = drive.inputs[t.name]
        if any(len(a) < count for a in columns.values()):
            raise ValueError(f"the recording has fewer than {count} runs of {t.name}")
        out[t.name] = {n: a[:count] for n, a in columns.items()}
    return out


class _KeepingBoard(CBoard):
    """A board that keeps what its tasks were given: external inputs, then latches held."""

    def __init__(self, library: HostLibrary) -> None:
        super().__init__(library)
        self.rows: dict[str, list[list[float]]] = {t.name: [] for t in self.system.tasks}

    def step(self, task_name: str, **inputs: Any) -> dict[str, Any]:
        task = self.system.task(task_name)
        given = [inputs[x.name] for x in self.system.task_inputs(task)]
        read = self.system.latches_read(task)
        if read:
            held = getattr(self._state, f"{task_name}_held")
            given += [getattr(held, x.name) for x in read]
        row: list[float] = []
        for value in given:
            row += [float(v) for v in value] if hasattr(value, "__len__") else [float(value)]
        self.rows[task_name].append(row)
        return super().step(task_name, **inputs)


def task_rows(device: Device, drive: RecordedDrive, runs: Mapping[str, int]) -> dict[str, Array]:
    """Everything that each task reads in the recorded case, as its f32 C finds it.

    return: by task, shape (runs, numbers): the external inputs, then the latches that the task
        holds when it starts, element by element.
    """
    system = device.system
    board = _KeepingBoard(compile_device(device, "f32"))
    again = run_schedule(board, _shortened(system, drive, runs))
    for task, columns in again.items():
        for name, values in columns.items():
            if values.tobytes() != drive.outputs[task][name][: len(values)].tobytes():
                raise RuntimeError(f"{name} of task {task} is not what the closed loop recorded")
    return {t: np.asarray(board.rows[t][:n], dtype=float) for t, n in runs.items()}
