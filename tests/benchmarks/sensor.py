"""Measure and compare: one table, one JSON file.

Two programs are compared in pairs: ours, peer, peer, ours ...; each pair gives a ratio, and the
median of the ratios is reported, with the range that holds the middle half of them.  So what the
machine does beside falls on both alike; time is the thread's own.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from esea_gen.device import Device, load_device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.files import write_json
from esea_gen.language.block import Block
from esea_gen.language.stream import Stream
from esea_gen.verify.streams import domain_chirp, recorded_stream
from tests.benchmarks.fixed import fixed_rows
from tests.benchmarks.peers import (
    REALS,
    CompiledPeer,
    EvaluatorPeer,
    NumpyPeer,
    Peer,
    Sources,
    count_board_instructions,
    count_host_instructions,
    peer_sources,
)
from tests.benchmarks.row import Row, compare
from tests.benchmarks.steps import drive_load, drive_rows, step_cost_rows, step_table
from tests.benchmarks.twin import twin_rows, twin_table

STEPS = 4000
COUNTED_STEPS = 400
AIM = 2.0
DRIVE = "elbow_drive"


def benchmark_stream(device: Device, block: Block, steps: int = STEPS) -> Stream:
    """The stream that all peers run: a chirp inside the identified domain."""
    theta = domain_chirp(device, steps * device.period_s)[:steps]
    return recorded_stream(device, theta, "chirp in the domain")[block.name]


def step_rows(
    device: Device, block: Block, pairs: int, say: Callable[[str], None], steps: int = STEPS
) -> list[Row]:
    """Time of a step against every peer.

    pairs: pairs of measurements a row; a tenth of it against peers in Python.
    """
    stream = benchmark_stream(device, block, steps)
    sources = peer_sources(device, block, stream)
    say("compiling")
    compiled = {k: CompiledPeer(s, block, stream) for k, s in sources.items()}
    slow: list[Peer] = [EvaluatorPeer(block, stream, whole) for whole in (True, False)]
    if NumpyPeer.fits(device):
        slow.append(NumpyPeer(device, stream))
    rows = []
    for real in REALS:
        ours = compiled[real]
        for key in ("casadi f64", "casadi f32", f"floor {real}"):
            name = f"{block.name} step {real} vs {compiled[key].name}"
            say(name)
            rows.append(compare(name, ours, compiled[key], steps, pairs))
        for peer in slow:
            name = f"{block.name} step {real} vs {peer.name}"
            say(name)
            rows.append(compare(name, ours, peer, steps, max(3, pairs // 10)))
    say("f32 vs f64")
    name = f"{block.name} step f32 vs generated f64"
    rows.append(compare(name, compiled["f32"], compiled["f64"], steps, pairs))
    return rows


def instruction_rows(
    device: Device, block: Block, say: Callable[[str], None], steps: int = COUNTED_STEPS
) -> list[Row]:
    """Instructions of a step, here and on an emulated board; what is not installed is left out."""
    stream = benchmark_stream(device, block, steps)
    sources = peer_sources(device, block, stream)
    renderer = Renderer(device.system, FORMATS["f32"], "-", "-", device.title)
    counters: list[tuple[str, Callable[[Sources, dict[str, str], int], float], list[str]]] = [
        ("this machine", count_host_instructions, ["count.c"]),
        ("Cortex-M4F, emulated", count_board_instructions, ["bare.c", "bare.ld"]),
    ]
    rows = []
    for where, count, extra in counters:
        say(f"instructions, {where}")
        files = {n: renderer.render(f"bench/{n}.j2") for n in extra}
        try:
            seen = {k: count(s, files, steps) for k, s in sources.items()}
        except UserError as error:
            say(f"left out: {error}")
            continue
        for real in REALS:
            for key in ("casadi f64", "casadi f32", f"floor {real}"):
                name = f"{block.name} step {real} vs {sources[key].name}, {where}"
                rows.append(Row.exact(name, seen[real], seen[key], "instructions"))
    return rows


def build_rows(device: str, runs: int, say: Callable[[str], None]) -> list[Row]:
    """Time of ``esea-gen build``, a process of its own each time.

    return: one row, in s: warm against cold. Cold: no bytecode and no cache of ours, as right after
        installing; the operating system's file cache is what it is.
    """
    say("build time")
    cold: list[float] = []
    warm: list[float] = []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as scratch:
            environment = os.environ | {
                "XDG_CACHE_HOME": f"{scratch}/cache",
                "PYTHONPYCACHEPREFIX": f"{scratch}/bytecode",
                "PYTHONDONTWRITEBYTECODE": "",
            }
            for times in (cold, warm):
                start = time.perf_counter()
                subprocess.run(
                    [sys.executable, "-m", "esea_gen.cli", "build", device, "--out", "out"],
                    cwd=scratch,
                    env=environment,
                    capture_output=True,
                    check=True,
                )
                times.append(time.perf_counter() - start)
    ratios = np.asarray(cold) / np.asarray(warm)
    low, ratio, high = (float(x) for x in np.quantile(ratios, [0.25, 0.5, 0.75]))
    name = f"build {Path(device).stem}, warm vs cold"
    return [
        Row(name, float(np.median(warm)), float(np.median(cold)), ratio, "s", low, high),
    ]


def run_benchmarks(
    device: str = "elbow",
    pairs: int = 101,
    builds: int = 3,
    say: Callable[[str], None] | None = None,
    drive: str = DRIVE,
) -> list[Row]:
    """All benchmarks.

    drive: device with a drive, for its tasks and the twin; empty for none.
    """
    tell = say or (lambda _: None)
    loaded = load_device(device)
    block = loaded.sensor
    with _on_one_processor():
        rows = step_rows(loaded, block, pairs, tell)
    rows += instruction_rows(loaded, block, tell)
    rows += fixed_rows(loaded, tell)
    with _on_one_processor():
        rows += step_cost_rows(loaded, max(3, pairs // 4), tell, COUNTED_STEPS, STEPS)
        if drive:
            driven = load_device(drive)
            rows += twin_rows(driven, pairs, tell)
            rows += drive_rows(driven, max(3, pairs // 4), tell, COUNTED_STEPS)
    if builds:
        rows += build_rows(device, builds, tell)
    return rows


class _on_one_processor:  # noqa: N801 - reads as what it does
    """Keep this process on one processor for a while, where the system can."""

    def __enter__(self) -> None:
        self._before = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
        if self._before:
            os.sched_setaffinity(0, {max(self._before)})

    def __exit__(self, *_: object) -> None:
        if self._before:
            os.sched_setaffinity(0, self._before)


def table(rows: list[Row]) -> str:
    """The rows as text."""
    width = max(len(r.name) for r in rows)
    lines = [f"{'':{width}}  {'ours':>10}  {'peer':>10}  {'peer/ours':>9}  middle half"]
    for r in rows:
        spread = "" if r.low == r.high else f"  {r.low:.2f} to {r.high:.2f}"
        form = {"s": ".2f", "Nm": ".1e", "rad/s": ".1e"}.get(r.unit, ".1f")
        lines.append(
            f"{r.name:{width}}  {r.ours:10{form}}  {r.peer:10{form}}  "
            f"{r.ratio:9.2f}{spread}  {r.unit}"
        )
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Command line: print the table, write the JSON."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("device", nargs="?", default="elbow", help="shipped device or device file")
    parser.add_argument("--json", type=Path, default=Path("bench.json"), metavar="FILE")
    parser.add_argument("--pairs", type=int, default=101, help="pairs of measurements a row")
    parser.add_argument("--builds", type=int, default=3, help="cold and warm builds; 0 for none")
    parser.add_argument(
        "--drive", default=DRIVE, metavar="DEVICE", help="device with a drive; empty for none"
    )
    chosen = parser.parse_args(arguments)

    def say(text: str) -> None:
        print(text, file=sys.stderr)

    try:
        driven = load_device(chosen.drive) if chosen.drive else None
        pairs, builds = max(1, chosen.pairs), max(0, chosen.builds)
        rows = run_benchmarks(chosen.device, pairs, builds, say, chosen.drive)
        write_json(chosen.json, "bench", {"rows": [r.to_dict() for r in rows]})
    except UserError as error:
        print(f"esea-gen: {error}", file=sys.stderr)
        return 2
    print(table(rows))
    for line in [*step_table(rows), *(drive_load(driven, rows) if driven else [])]:
        print(line)
    for line in twin_table(rows):
        print(line)
    aimed = next(r for r in rows if r.name.endswith("f32 vs CasADi C (f64)"))
    met = "met" if aimed.ratio >= AIM else "MISSED"
    print(f"aim, f32 at least {AIM:g} times faster than CasADi C: {aimed.ratio:.2f}, {met}")
    return 0
