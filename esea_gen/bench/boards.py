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
from typing import Literal

import numpy as np

from esea_gen.bench.peers import BARE_FLAGS, M4F, Sources, _call, _place, _short
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.compiler import cache_folder, find_compiler
from esea_gen.language.ports import Array


@dataclass(frozen=True)
class Board:
    """A processor in an emulated machine.

    flags: compiler flags of the processor.
    profile: how it starts and talks to the emulator.
    code, code_bytes, ram, ram_bytes: where the program and its data lie.
    """

    name: str
    title: str
    machine: str
    flags: tuple[str, ...]
    profile: Literal["M", "A"]
    code: int
    code_bytes: int
    ram: int
    ram_bytes: int


M7 = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard")
A9 = ("-mcpu=cortex-a9", "-marm", "-mfpu=vfpv3", "-mfloat-abi=softfp")
_MB = 1 << 20
BOARDS = (
    Board(
        "Cortex-M4F",
        "a Cortex-M4F (single precision FPU)",
        "netduinoplus2",
        M4F,
        "M",
        0x08000000,
        _MB,
        0x20000000,
        128 << 10,
    ),
    Board(
        "Cortex-M7",
        "a Cortex-M7 (double precision FPU)",
        "mps2-an500",
        M7,
        "M",
        0,
        4 * _MB,
        0x20000000,
        4 * _MB,
    ),
    Board(
        "Cortex-A9",
        "a Cortex-A9 (vfpv3, softfp)",
        "xilinx-zynq-a9",
        A9,
        "A",
        0x00100000,
        16 * _MB,
        0x01100000,
        16 * _MB,
    ),
)


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
    from esea_gen.verify.firmware import firmware_folder

    gcc = find_compiler("gcc", "gcc libc6-dev")
    source = firmware_folder() / "tools" / "count_instructions.c"
    with tempfile.TemporaryDirectory(dir=cache_folder()) as scratch:
        built = Path(scratch) / "count.so"
        _call([gcc, "-O2", "-shared", "-fPIC", source, "-o", built])
        return built.rename(cache_folder() / "count_instructions.so")


def count_step(board: Board, sources: Sources, renderer: Renderer, step: str, steps: int) -> Count:
    """Count the instructions of a step on an emulated board."""
    from esea_gen.verify.emulator import find_qemu

    gcc = find_compiler("arm-none-eabi-gcc", "gcc-arm-none-eabi libnewlib-arm-none-eabi")
    qemu = find_qemu()
    plugin = _plugin()
    extra = {
        n: renderer.render(f"bench/{n}.j2", board=board, double=sources.libm)
        for n in ("board.c", "board.ld")
    }
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        paths = _place(_short(sources, steps) | extra, folder)
        image, log = folder / "board.elf", folder / "log"
        link = ["-nostartfiles", "--specs=nosys.specs", f"-T{folder}/board.ld", "-Wl,--gc-sections"]
        _call([gcc, *board.flags, *BARE_FLAGS, f"-I{folder}", *paths, *link, "-o", image, "-lm"])
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
                *(qemu, "-M", board.machine, "-display", "none", "-monitor", "none"),
                *("-nodefaults", "-semihosting-config", "enable=on,target=native"),
                *("-d", "plugin", "-D", log, "-plugin", argument, "-kernel", image),
            ]
        )
        counted = [int(n) for n in re.findall(r"\d+", log.read_text())]
    found = re.search(r"^([0-9a-f]{8})$", said, re.MULTILINE)
    if found is None or len(counted) != 4 or counted[0] != steps:
        raise RuntimeError(f"{board.title} did not answer: {said}\n{counted}")
    return Count(counted[1] / steps, counted[2], counted[3], int(found.group(1), 16))


__all__ = ["BOARDS", "Board", "Count", "checksum", "count_step"]
