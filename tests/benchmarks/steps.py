"""What one step of each Block costs: instructions on emulated processors, time on this machine.

Sensor, velocity estimate, the exact inverse and the published one with each of its observers, all
as emitted f32, on one sweep each inside the identified domain.  Beside each stands CasADi's own C
of the same step, in double precision, as it comes.  Of a drive every Block, and its whole tasks, on
what they are given in the tuning case in closed loop.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import get_args

import numpy as np

from esea_gen.device import Device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.language.block import Block
from esea_gen.language.ports import Array, Port
from esea_gen.language.stream import Stream, single
from esea_gen.language.system import System, Task
from esea_gen.model.inverse import exact_inverse, inverse_system
from esea_gen.model.published_inverse import FilterName, published_inverse
from esea_gen.targets import DEFAULT_BOARD, find_board
from esea_gen.twin.recorded import RecordedDrive, record_drive
from esea_gen.verify.streams import domain_chirp, recorded_stream
from tests.benchmarks.boards import BOARDS, checksum, count_step
from tests.benchmarks.peers import CompiledPeer, Sources, peer_sources
from tests.benchmarks.recorded import block_streams, task_rows
from tests.benchmarks.row import Row, compare

# At most so many instructions a step on the Cortex-M4F: a 1 kHz task of both takes 3.4 million a
# second, a fiftieth of what that part issues at its clock.
AIMS = {"sensor": 900, "inverse exact": 2500}
AIM_BOARD = "Cortex-M4F"
HOST = "this machine"
CASADI = "CasADi C (f64)"
BLOCKS = "its Blocks one by one"
_NAME = re.compile(rf"^(.*), one f32 step on (.*) vs (?:{re.escape(CASADI)}|{BLOCKS})$")
# Of a task so many runs fit a small board's memory, outputs and all.
TASK_RUNS = 300
CLOCK_Hz = find_board(DEFAULT_BOARD).clock_Hz
# Assumed, not measured: the emulator knows no cycles.  One is what the Cortex-M4F's manual gives
# for most instructions; loads, branches, divisions and a flash that makes it wait take more.
CYCLES_PER_INSTRUCTION = (1.0, 2.0)


@dataclass(frozen=True)
class Subject:
    """A Block whose step is measured."""

    name: str
    block: Block
    system: System
    stream: Stream


def torque_chirp(device: Device, steps: int) -> Stream:
    """A request that sweeps through 90 % of full scale."""
    t = np.arange(steps) * device.period_s
    size = 0.9 * device.tau_full_scale_Nm
    return Stream("sweep", {"tau_Nm": single(size * np.sin(np.pi * t * t / max(t[-1], 1e-9)))})


def subjects(device: Device, steps: int) -> list[Subject]:
    """What is measured of a device.

    return: sensor, velocity, exact inverse, published inverse with every filter; the inverses only
        for a device whose model has one.
    """
    theta = domain_chirp(device, steps * device.period_s)[:steps]
    felt = recorded_stream(device, theta, "chirp in the domain")
    out = [
        Subject(b.name, b, device.system, felt[b.name]) for b in (device.sensor, device.velocity)
    ]
    try:
        inverses = {"inverse exact": exact_inverse(device)}
    except UserError:
        return out  # no linear stiffness: neither kind exists
    inverses["inverse published, no observer"] = published_inverse(device)
    for name in get_args(FilterName):
        inverses[f"inverse published, filter {name}"] = published_inverse(device, name)
    wanted = torque_chirp(device, steps)
    return out + [Subject(n, b, inverse_system(device, b), wanted) for n, b in inverses.items()]


def alone(device: Device, block: Block) -> System:
    """A System of one Block, so that nothing else is compiled with it.

    device: gives the name, so that the C is the same as in its own System.
    return: task ``run``: every input and output of the Block is external.
    """
    return System(
        device.name,
        block.period_s,
        {block.name: block},
        (Task("run", (block.name,)),),
        {},
        {p.name: (f"{block.name}.{p.name}",) for p in block.inputs},
        {p.name: f"{block.name}.{p.name}" for p in block.outputs},
    )


def drive_subjects(device: Device, drive: RecordedDrive, steps: int) -> list[Subject]:
    """Every Block of a drive, on what it is given in closed loop.

    drive: what was recorded, long enough for ``steps`` runs of the slowest task.
    """
    found = block_streams(device, drive, steps)
    blocks = device.system.blocks
    return [
        Subject(f"{device.name} {i}", blocks[i], alone(device, blocks[i]), found[i])
        for t in device.system.tasks
        for i in t.blocks
    ]


def task_sources(device: Device, task: Task, rows: Array) -> Sources:
    """A task of a device as it ships, over a stream, for a board."""
    system = device.system
    renderer = Renderer(system, FORMATS["f32"], "-", "-", device.title)
    renderer.env.filters["number17"] = repr

    def each(name: str, port: Port) -> list[tuple[str, str]]:
        kind = "uint32_t" if port.flags else renderer.fmt.c_type
        return [(name + (f"[{i}]" if port.size > 1 else ""), kind) for i in range(port.size)]

    reads = [e for x in system.task_inputs(task) for e in each(f"in.{x.name}", x.port)]
    for latch in system.latches_read(task):
        reads += each(f"state.{task.name}_held.{latch.name}", latch.port)
    writes = [e for x in system.task_outputs(task) for e, _ in each(x.name, x.port)]
    context = {
        "sizes": {"inputs": len(reads), "outputs": len(writes)},
        "steps": len(rows),
        "rows": rows.tolist(),
        "task": task,
        "reads": reads,
        "writes": writes,
    }
    files = renderer.files()
    own = {n: t for n, t in files.items() if not n.startswith("reference/") and n != "main.c"}
    names = ("bench.h", "stream.h", "task.c")
    extra = {n: renderer.render(f"bench/{n}.j2", **context) for n in names}
    return Sources(f"task {task.name}", own | extra, False)


def task_cost_rows(
    device: Device,
    drive: RecordedDrive,
    blocks: list[Row],
    say: Callable[[str], None],
    runs: int = TASK_RUNS,
) -> list[Row]:
    """Instructions of each task of a drive, beside the sum of its Blocks' own.

    blocks: from :func:`step_cost_rows` on :func:`drive_subjects`; a board without them is left out.
    """
    system = device.system
    known = {r.name: r.ours for r in blocks}
    given = task_rows(device, drive, {t.name: runs for t in system.tasks})
    renderer = Renderer(system, FORMATS["f32"], "-", "-", device.title)
    rows: list[Row] = []
    for task in system.tasks:
        wanted = [
            np.asarray(drive.outputs[task.name][x.name][:runs], dtype=float).reshape(runs, -1)
            for x in system.task_outputs(task)
        ]
        expected = checksum(np.hstack(wanted))
        sources = task_sources(device, task, given[task.name])
        for board in BOARDS:
            parts = [known.get(_row_name(f"{device.name} {i}", board.core)) for i in task.blocks]
            if None in parts:
                continue
            name = f"{device.name} task {task.name}"
            say(f"{name}, {board.core}")
            step = f"esea_{system.name}_{task.name}_step"
            found = count_step(board, sources, renderer, step, runs)
            if found.checksum != expected:
                raise RuntimeError(f"{name}: {board.core} computes other bits than this machine")
            total = sum(x for x in parts if x is not None)
            row = _row_name(name, board.core, BLOCKS)
            rows.append(Row.exact(row, found.mean, total, "instructions"))
    return rows


def drive_rows(
    device: Device, pairs: int, say: Callable[[str], None], steps: int = 400
) -> list[Row]:
    """Cost of every Block and task of a drive."""
    longest = max(steps, TASK_RUNS)
    say(f"{device.name}, recording the tuning case")
    drive = record_drive(device, max(t.phase + longest * t.every for t in device.system.tasks))
    made = drive_subjects(device, drive, steps)
    rows = _cost_rows(device, [(s, s) for s in made], pairs, say)
    return rows + task_cost_rows(device, drive, rows, say)


def drive_load(device: Device, rows: list[Row]) -> list[str]:
    """What the instructions allow, under assumed cycles an instruction."""
    counts = {}
    for task in device.system.tasks:
        name = _row_name(f"{device.name} task {task.name}", AIM_BOARD, BLOCKS)
        found = next((r.ours for r in rows if r.name == name), None)
        if found is None:
            return []
        counts[task] = found
    rates = {t: 1 / (t.every * device.system.base_period_s) for t in counts}
    work = sum(counts[t] * rates[t] for t in counts)
    each = ", ".join(f"{t.name} {n:.0f} at {rates[t]:g} Hz" for t, n in counts.items())
    lines = [
        f"{device.name} on {AIM_BOARD}: {each}: {work / 1e6:.2f} million instructions a second. "
        f"At {CLOCK_Hz / 1e6:g} MHz, cycles an instruction assumed, not measured:"
    ]
    for cycles in CYCLES_PER_INSTRUCTION:
        share = cycles * work / CLOCK_Hz
        lines.append(
            f"  {cycles:g}: {100 * share:.1f} % of the processor; all rates could be "
            f"{1 / share:.0f} times as high"
        )
    return lines


def step_cost_rows(
    device: Device, pairs: int, say: Callable[[str], None], steps: int, host_steps: int
) -> list[Row]:
    """Cost of every step; a board whose tools are not installed is left out."""
    both = zip(subjects(device, steps), subjects(device, host_steps), strict=True)
    return _cost_rows(device, list(both), pairs, say)


def _cost_rows(
    device: Device,
    made: list[tuple[Subject, Subject]],
    pairs: int,
    say: Callable[[str], None],
) -> list[Row]:
    # Each subject with the stream for the boards, and with the one for this machine.
    rows: list[Row] = []
    boards = list(BOARDS)
    for subject, longer in made:
        steps = subject.stream.steps
        name, block = subject.name, subject.block
        timed = peer_sources(device, block, longer.stream, longer.system)
        say(f"{name}, {HOST}")
        ours, peer = (CompiledPeer(timed[k], block, longer.stream) for k in ("f32", "casadi f64"))
        rows.append(compare(_row_name(name, HOST), ours, peer, longer.stream.steps, pairs))
        sources = peer_sources(device, block, subject.stream, subject.system)
        here = CompiledPeer(sources["f32"], block, subject.stream)
        here.run(1)
        expected = checksum(here.results())
        renderer = Renderer(subject.system, FORMATS["f32"], "-", "-", device.title)
        prefix = f"esea_{subject.system.name}"
        for board in list(boards):
            say(f"{name}, {board.core}")
            try:
                mine = count_step(
                    board, sources["f32"], renderer, f"{prefix}_{block.name}_step", steps
                )
                other = count_step(
                    board,
                    sources["casadi f64"],
                    renderer,
                    f"{prefix}_casadi_{block.name}_step",
                    steps,
                )
            except UserError as error:
                say(f"{board.core} left out: {error}")
                boards.remove(board)
                continue
            if mine.checksum != expected:
                raise RuntimeError(f"{name}: {board.core} computes other bits than this machine")
            rows.append(
                Row.exact(_row_name(name, board.core), mine.mean, other.mean, "instructions")
            )
    return rows


def _row_name(subject: str, where: str, peer: str = CASADI) -> str:
    return f"{subject}, one f32 step on {where} vs {peer}"


def step_table(rows: list[Row]) -> list[str]:
    """The steps' costs as a table, and whether the aims are met.

    rows: any rows; only those of :func:`step_cost_rows` are shown.
    """
    cells: dict[str, dict[str, float]] = {}
    for row in rows:
        found = _NAME.match(row.name)
        if found:
            cells.setdefault(found.group(1), {})[found.group(2)] = row.ours
    if not cells:
        return []
    places = [b.name for b in BOARDS if any(b.name in c for c in cells.values())] + [HOST]
    width = max(len(n) for n in cells)
    heads = [f"{p:>14}" for p in places]
    lines = [
        "One f32 step: mean instructions on emulated processors (not cycles), ns on this machine",
        f"{'':{width}}  " + "".join(heads),
    ]
    for name, found_cells in cells.items():
        numbers = "".join(
            f"{found_cells[p]:14.1f}" if p in found_cells else f"{'-':>14}" for p in places
        )
        lines.append(f"{name:{width}}  {numbers}")
    for name, most in AIMS.items():
        count = cells.get(name, {}).get(AIM_BOARD)
        if count is not None:
            met = "met" if count <= most else "MISSED"
            lines.append(
                f"aim, {name} at most {most} instructions on {AIM_BOARD}: {count:.0f}, {met}"
            )
    return lines


__all__ = [
    "AIMS",
    "Subject",
    "drive_load",
    "drive_rows",
    "drive_subjects",
    "step_cost_rows",
    "step_table",
    "subjects",
    "task_cost_rows",
    "task_sources",
]
