"""What the tasks of a System's C do, as bytes to be compared with another's."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from esea_gen.hostlib.codec import Array
from esea_gen.hostlib.library import CBoard, CRunner, HostLibrary
from esea_gen.language.stream import single
from esea_gen.language.system import System
from esea_gen.verify.streams import working_inputs


def task_signature(library: HostLibrary) -> list[bytes]:
    """Everything the device file does: defaults, the check of the tunables, init, the wiring."""
    out = []
    ffi = library.ffi
    for task in library.system.tasks:
        runner = library.task(task.name)
        held = runner._coeffs
        for instance, tunable in library.system.tunables:
            low, high = np.float32(tunable.low), np.float32(tunable.high)
            below, above = (
                np.nextafter(x, np.float32(s * np.inf)) for x, s in ((low, -1), (high, 1))
            )
            for value in (low, high, below, above, np.nan, np.inf, 0.5 * (low + high)):
                code = runner.prepare({instance: {tunable.name: float(value)}})
                out.append(bytes([code % 256]) + b"".join(bytes(ffi.buffer(c)) for c in held))
        rng = np.random.default_rng(3)
        inputs = {
            x.name: single(rng.uniform(1.02 * x.port.low, 1.02 * x.port.high, (800, x.port.size)))
            for x in library.system.task_inputs(task)
        }
        slow = {
            k: single(0.3 * np.sin(0.01 * np.arange(len(v)))[:, None] * abs(v[0]))
            for k, v in inputs.items()
        }
        # Gains that are 0 by default hide what they multiply: other tunables too.
        for tunables in ({}, _other_tunables(library.system)) if held else ({},):
            filled: list[Any] = [*held, runner._params] if held else []
            for memory in filled:
                ffi.buffer(memory)[:] = b"\xa5" * len(ffi.buffer(memory))
            runner.prepare(tunables)
            out += [bytes(ffi.buffer(memory)) for memory in filled]
            rubbish = runner.state
            rubbish.view(np.uint8)[:] = 0xA5
            runner.state = rubbish
            runner.reset()
            out.append(runner.state.tobytes())
            for stream in (slow, inputs):
                out += _run_over_rubbish(
                    runner, {k: v[:, 0] if v.shape[1] == 1 else v for k, v in stream.items()}
                )
    if library.system.latches:
        out += _board_signature(library)
    return out


def _other_tunables(system: System) -> dict[str, dict[str, float]]:
    # All within their bounds, none at its default; in turn low and high, so that ends stay apart.
    out: dict[str, dict[str, float]] = {}
    for k, (instance, t) in enumerate(system.tunables):
        share = (0.3, 0.7)[k % 2]
        out.setdefault(instance, {})[t.name] = float(np.float32(t.low + share * (t.high - t.low)))
    return out


def _run_over_rubbish(runner: CRunner, inputs: Mapping[str, Array]) -> list[bytes]:
    # As CRunner.run, into outputs that are not zero before: what is not written shows.
    packed = runner.pack(inputs) if inputs else np.zeros(800, runner._in_type)
    out, states = np.zeros(len(packed), runner._out_type), np.zeros(len(packed), runner._state_type)
    out.view(np.uint8)[:] = 0xA5
    runner.run_into(packed, out, states)
    return [out.tobytes(), states.tobytes()]


def _board_signature(library: HostLibrary) -> list[bytes]:
    # All tasks on one state, as firmware calls them: what crosses from one to the other, and when.
    out = []
    for tunables in ({}, _other_tunables(library.system)):
        try:
            out += _board_run(library, library.board(tunables))
        except ValueError as error:  # a default that its own check refuses
            out.append(str(error).encode())
    return out


def _board_run(library: HostLibrary, board: CBoard) -> list[bytes]:
    system = library.system
    ticks = 1200
    inputs = {t.name: working_inputs(system, t, ticks // t.every + 1) for t in system.tasks}
    digest, out = hashlib.sha256(bytes(library.ffi.buffer(board.state))), []
    for tick in range(ticks):
        board.release(tick)
        for task in system.tasks:
            k, late = divmod(tick - task.phase, task.every)
            if late or k < 0:
                continue
            given = {name: v[k] for name, v in inputs[task.name].items()}
            for value in board.step(task.name, **given).values():
                digest.update(np.asarray(value, dtype=np.float64).tobytes())
        digest.update(bytes(library.ffi.buffer(board.state)))
        if tick % 100 == 99:
            out.append(digest.digest())
    return out
