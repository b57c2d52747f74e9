"""Cost of one step of each Block against CasADi's own C of the same step.

Time on this machine and instructions on emulated processors; of a drive every Block, on what it is
given in the tuning case in closed loop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, get_args

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import block_system, run_schedule
from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import Stream, single
from esea_gen.language.system import System, SystemSimulator
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.published_inverse import FilterName, published_inverse
from esea_gen.targets import boards_for
from esea_gen.twin.recorded import record_drive
from esea_gen.verify.streams import domain_chirp, recorded_stream

from .peers import (
    CASADI,
    CASADI_FLOAT,
    HAND,
    CompiledPeer,
    EvaluatorPeer,
    exact,
    hand_program,
    in_turns,
    peer_programs,
    renderer_of,
)
from .step_count import checksum, count_step

HOST_STEPS, BOARD_STEPS = 4000, 400
CORTEX_M4F = "Cortex-M4F"
# At most so many instructions a step on the Cortex-M4F, and so many times faster than CasADi's C.
AIMS = {"sensor": 900, "inverse exact": 2500}
SPEED_AIM = 2.0

Subject = tuple[str, Block, System, Stream]  # name, what is measured, where it is, on what


def subjects(device: Device, steps: int) -> Iterator[Subject]:
    """Sensor, velocity, exact inverse, published inverse with every filter, each on a sweep."""
    theta = domain_chirp(device, steps * device.period_s)[:steps]
    recorded = recorded_stream(device, theta, "chirp in the domain")
    for block in (device.sensor, device.velocity):
        yield block.name, block, device.system, recorded[block.name]
    try:
        inverses = {"inverse exact": exact_inverse(device)}
    except UserError:
        return  # no linear stiffness: neither kind exists
    inverses["inverse published, no observer"] = published_inverse(device)
    for name in get_args(FilterName):
        inverses[f"inverse published, filter {name}"] = published_inverse(device, name)
    t = np.arange(steps) * device.period_s
    tau = 0.9 * device.tau_full_scale_Nm * np.sin(np.pi * t * t / t[-1])
    for name, block in inverses.items():
        yield name, block, block_system(block), Stream("sweep", {"tau_Nm": single(tau)})


def drive_subjects(device: Device, steps: int) -> Iterator[Subject]:
    """Every Block of a drive, each in a System of its own, on what it is given in closed loop."""
    system = device.system
    inputs = record_drive(device, max(t.phase + steps * t.every for t in system.tasks)).inputs
    board = SystemSimulator(system)
    given: dict[str, list[dict[str, Any]]] = {i: [] for i in board.blocks}

    class Listener:
        def __init__(self, name: str, simulator: Any) -> None:
            self.name, self.simulator = name, simulator

        def step(self, **values: Any) -> dict[str, Any]:
            given[self.name].append(values)
            return self.simulator.step(**values)

    board.blocks = {i: Listener(i, s) for i, s in board.blocks.items()}
    run_schedule(board, inputs)
    for task in system.tasks:
        for i in task.blocks:
            block = system.blocks[i]
            columns: dict[str, Array] = {}
            for p in block.inputs:
                values = single([np.reshape(g[p.name], p.size) for g in given[i][:steps]])
                columns[p.name] = values[:, 0] if p.size == 1 else values
            stream = Stream("tuning case", columns)
            yield f"{device.name} {i}", block, block_system(block), stream


def host_rows(device: Device, subject: Subject, pairs: int, every_peer: bool) -> list[dict]:
    """Times of the f32 step; every_peer: against all peers, not only CasADi's C in double."""
    name, block, system, stream = subject
    programs = peer_programs(device, block, stream, system)
    compiled = {k: CompiledPeer(k, files, block, stream) for k, files in programs.items()}
    ours, peers = compiled["generated f32"], [compiled[CASADI]]
    if every_peer:
        peers += [compiled[CASADI_FLOAT], compiled["generated f64"], EvaluatorPeer(block, stream)]
        elastomer = device.elastomer
        if elastomer.maxwell is not None and elastomer.dead_zone_rad is None:
            files = hand_program(device, renderer_of(device, system, "f32"), stream)
            peers.append(CompiledPeer(HAND, files, block, stream))
    rows = []
    for peer in peers:
        count = pairs if isinstance(peer, CompiledPeer) else max(3, pairs // 10)
        row = {"name": f"{name}, one f32 step on this machine vs {peer.name}"}
        rows.append(row | in_turns(ours, peer, stream.steps, count))
    return rows


def board_rows(device: Device, subject: Subject, say: Callable[[str], None]) -> list[dict]:
    """Instructions of the f32 step, bits checked; a board whose tools are missing is left out."""
    name, block, system, stream = subject
    programs = peer_programs(device, block, stream, system)
    here = CompiledPeer(name, programs["generated f32"], block, stream)
    here.run(1)
    renderer, prefix = renderer_of(device, system, "f32"), f"esea_{system.name}"
    rows = []
    for board in boards_for("instructions"):
        say(f"{name}, {board.core}")
        for files in programs.values():
            files.pop("clock.c", None)
        try:
            step = f"{prefix}_{block.name}_step"
            ours = count_step(board, programs["generated f32"], renderer, step)
            step = f"{prefix}_casadi_{block.name}_step"
            peer = count_step(board, programs[CASADI], renderer, step, libm=True)
        except UserError as error:
            say(f"{board.core} left out: {error}")
            continue
        if ours.checksum != checksum(here.results()):
            raise RuntimeError(f"{name}: {board.core} computes other bits than this machine")
        row = {"name": f"{name}, one f32 step on {board.core} vs {CASADI}"}
        rows.append(row | exact(ours.mean, peer.mean, "instructions"))
    return rows


def step_rows(
    device: Device, drive: Device | None, pairs: int, say: Callable[[str], None]
) -> list[dict]:
    rows: list[dict] = []
    for long, short in zip(
        subjects(device, HOST_STEPS), subjects(device, BOARD_STEPS), strict=True
    ):
        say(long[0])
        rows += host_rows(device, long, pairs, every_peer=long[1] is device.sensor)
        rows += board_rows(device, short, say)
    for subject in drive_subjects(drive, BOARD_STEPS) if drive else ():
        rows += host_rows(drive, subject, max(3, pairs // 4), every_peer=False)
        rows += board_rows(drive, subject, say)
    return rows


def aims(rows: list[dict]) -> list[str]:
    """Whether the aims are met."""
    found = {r["name"]: r for r in rows}
    lines = []
    for name, most in AIMS.items():
        row = found.get(f"{name}, one f32 step on {CORTEX_M4F} vs {CASADI}")
        if row:
            met = "met" if row["ours"] <= most else "MISSED"
            lines.append(
                f"aim, {name} at most {most} instructions on {CORTEX_M4F}: {row['ours']:.0f}, {met}"
            )
    ratio = found[f"sensor, one f32 step on this machine vs {CASADI}"]["ratio"]
    met = "met" if ratio >= SPEED_AIM else "MISSED"
    lines.append(
        f"aim, sensor at least {SPEED_AIM:g} times faster than {CASADI}: {ratio:.2f}, {met}"
    )
    return lines
