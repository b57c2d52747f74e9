"""Instructions of a step on emulated processors, counted by a plugin of the emulator.

Counted is what runs from one entry of the step to the next, the functions that it calls included,
the loop round it not.  The emulator counts instructions, not cycles.  Every run also gives a
checksum of its results, which must be the host's: what is counted is the right computation.
"""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from esea_gen.cache import cache_folder
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.compiler import find_compiler
from esea_gen.language.ports import Array
from esea_gen.targets import BARE_LINK, HOST_GCC, Board, boards_for, firmware_folder
from tests.benchmarks.peers import BARE_FLAGS, Sources, _call, _place, _short

BOARDS = boards_for("instructions")


@dataclass(frozen=True)
class Count:
    """Instructions of a step."""

    mean: float
    least: int
    most: int
    checksum: int


def checksum(results: Array) -> int:
    """FNV-1a of an array of float64, as the board's program computes it.

    results: outputs, shape (steps, outputs).
    """
    total = 2166136261
    for byte in np.ascontiguousarray(results, dtype="<f8").tobytes():
        total = ((total ^ byte) * 16777619) & 0xFFFFFFFF
    return total


@cache
def _plugin() -> Path:
    gcc = find_compiler(*HOST_GCC.gcc)
    source = firmware_folder() / "tools" / "count_instructions.c"
    with tempfile.TemporaryDirectory(dir=cache_folder()) as scratch:
        built = Path(scratch) / "count.so"
        _call([gcc, "-O2", "-shared", "-fPIC", source, "-o", built])
        return built.rename(cache_folder() / "count_instructions.so")


def count_step(board: Board, sources: Sources, renderer: Renderer, step: str, steps: int) -> Count:
    """Count the instructions of a step on an emulated board."""
    from esea_gen.board.emulator import qemu_command

    gcc = find_compiler(*board.processor.toolchain.gcc)
    qemu = qemu_command(board, semihosting=True)
    plugin = _plugin()
    context = {"board": board, "double": sources.libm}
    extra = {n: renderer.render(f"bench/{n}.j2", **context) for n in ("board.c", "board.ld")}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        paths = _place(_short(sources, steps) | extra, folder)
        image, log = folder / "board.elf", folder / "log"
        link = [*BARE_LINK, "--specs=nosys.specs", f"-T{folder}/board.ld"]
        flags = [*board.compile_flags, *BARE_FLAGS, f"-I{folder}"]
        _call([gcc, *flags, *paths, *link, "-o", image, "-lm"])
        listed = _call([f"{gcc.removesuffix('gcc')}nm", image]).splitlines()
        symbols = {parts[2]: parts[0] for line in listed if len(parts := line.split()) == 3}
        at = {
            "entry": symbols[step],
            "low": symbols["counted_low"],
            "high": symbols["counted_high"],
        }
        argument = ",".join([str(plugin), *(f"{k}=0x{v}" for k, v in at.items())])
        said = _call(
            [
                *qemu,
                *("-d", "plugin", "-D", log, "-plugin", argument, "-kernel", image),
            ]
        )
        counted = [int(n) for n in re.findall(r"\d+", log.read_text())]
    found = re.search(r"^([0-9a-f]{8})$", said, re.MULTILINE)
    if found is None or len(counted) != 4 or counted[0] != steps:
        raise RuntimeError(f"{board.title} did not answer: {said}\n{counted}")
    return Count(counted[1] / steps, counted[2], counted[3], int(found.group(1), 16))


__all__ = ["BOARDS", "Count", "checksum", "count_step"]
