"""Tasks on emulated boards without an operating system: bits, instructions, flash, RAM, stack."""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.board.emulator import qemu_command
from esea_gen.board.firmware import Symbol, symbols
from esea_gen.cache import cache_folder
from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.formats.base import Format
from esea_gen.emit.render import Renderer
from esea_gen.hostlib.compiler import compile_sources, find_compiler, run_tool, write_texts
from esea_gen.hostlib.library import HostLibrary, compile_device, run_schedule
from esea_gen.language.system import Task
from esea_gen.model.sensing import zeros_missing
from esea_gen.targets import (
    BARE_LINK,
    EXACT_FLAGS,
    SECTION_FLAGS,
    Board,
    boards_for,
    firmware_folder,
)

Array = np.ndarray[Any, np.dtype[Any]]
TIMEOUT_S = 300


BARE_BOARDS = {b.processor.name.removeprefix("cortex-"): b for b in boards_for("bits")}


@dataclass(frozen=True)
class BareResult:
    """Result of a bare-board run."""

    board: str
    core: str
    real: str
    task: str
    steps: int
    identical: bool
    first_difference: str
    instructions: dict[str, float]
    flash_bytes: int
    ram_bytes: int
    stack_bytes: int


def counting_plugin() -> Path:
    """The emulator's plugin that counts instructions from one entry of a step to the next."""
    source = firmware_folder() / "tools" / "count_instructions.c"
    return compile_sources({source.name: source.read_text(encoding="utf-8")})


def _called(command: Sequence[str | Path]) -> str:
    # All that a tool of the toolchain says.
    done = run_tool(
        command,
        failed=f"{Path(command[0]).name} failed",
        timeout=TIMEOUT_S,
        stdin=subprocess.DEVNULL,
    )
    return done.stdout + done.stderr


@dataclass(frozen=True)
class Emulation:
    """Output of a program on an emulated board, and the instructions from one entry to the next."""

    said: str
    instructions: dict[str, float]
    symbols: list[Symbol]

    @property
    def rows(self) -> list[list[str]]:
        """Lines of words, as the loop around a device's tasks prints them."""
        lines = self.said.splitlines()
        return [line.split() for line in lines if re.fullmatch(r"([0-9a-f]{8} )+ *", line)]

    @property
    def flash_bytes(self) -> int:
        """Size without that loop and its data."""
        return sum(
            s.size
            for s in self.symbols
            if s.address < 0x20000000 and s.name not in AROUND and not s.name.endswith("_stream")
        )


AROUND = {"entry", "counted_step", "stream", "hex", "line", "call", "vectors"}


def emulate(
    files: Mapping[str, str],
    board: Board,
    entry: str = "counted_step",
    high: str = "harness",
    low: str | None = None,
) -> Emulation:
    """Compile a program with ``-O2`` and run it; count the instructions between two symbols."""
    gcc = find_compiler(*board.processor.toolchain.gcc)
    with tempfile.TemporaryDirectory(dir=cache_folder()) as scratch:
        folder = Path(scratch)
        write_texts(folder, files)
        sources = [str(folder / n) for n in sorted(files) if n.endswith(".c")]
        (script,) = folder.glob("*.ld")
        image = folder / "board.elf"
        flags = [*board.compile_flags, *EXACT_FLAGS, *SECTION_FLAGS]
        link = [*BARE_LINK, "--specs=nosys.specs", f"-T{script}"]
        _called([gcc, *flags, f"-I{folder}", *sources, *link, "-o", str(image), "-lm"])
        found = symbols([image])
        at = {s.name: s.address for s in found}
        start = 0 if low is None else at[low]
        count = f"{counting_plugin()},entry={at[entry]:#x},low={start:#x},high={at[high]:#x}"
        qemu = qemu_command(board, semihosting=True)
        said = _called([*qemu, "-d", "plugin", "-plugin", count, "-kernel", str(image)])
    counted = re.search(r"entries (\d+) instructions (\d+) min (\d+) max (\d+)", said)
    if counted is None:
        raise RuntimeError(f"the plugin did not count:\n{said[-2000:]}")
    entries, total, least, most = map(int, counted.groups())
    means = {"min": float(least), "mean": total / entries, "max": float(most)}
    return Emulation(said, means, found)


def run_bare(
    device: Device, real: str, board: str, inputs: Mapping[str, Mapping[str, Array]]
) -> BareResult:
    """Run all tasks of a device on an emulated board, each at its own ticks, latches released.

    inputs: by task and input; of a task without inputs an empty name, an element for each run.
    """
    fmt, system, chosen = FORMATS[real], device.system, BARE_BOARDS[board]
    renderer = Renderer(system, fmt, format_hash(device, real), "-", device.title)
    library = compile_device(device, real)
    ticks = min(len(next(iter(inputs[t.name].values()))) * t.every for t in system.tasks)
    words, expected = _expected(library, inputs, ticks)
    context = {
        "ticks": ticks,
        "rows": {t.name: _rows(library, t, inputs[t.name], fmt) for t in system.tasks},
        "words": words,
        "zeros": zeros_missing(system),
        "stack_top": chosen.ram + chosen.ram_bytes,
        "has_fpu": chosen.processor.fpu,
        "board": chosen.machine,
        "flash_bytes": chosen.code_bytes,
        "ram_bytes": chosen.ram_bytes,
    }
    files = {n: t for n, t in renderer.files().items() if n != "main.c" and "/" not in n}
    files["bare.c"] = renderer.render("verify/bare.c.j2", **context)
    files["bare.ld"] = renderer.render("verify/bare.ld.j2", **context)
    done = emulate(files, chosen)
    rows = done.rows
    if len(rows) != ticks + 1:
        raise RuntimeError(f"the emulated board did not finish: {len(rows)} rows")
    got = np.array([[int(w, 16) for w in r] for r in rows[:-1]], dtype=np.uint32)
    wrong = np.argwhere(got != expected)
    difference = ""
    if len(wrong):
        k, j = (int(v) for v in wrong[0])
        difference = (
            f"{words[j]['name']} at step {k}: {got[k, j]:08x} instead of {expected[k, j]:08x}"
        )
    return BareResult(
        board,
        chosen.core,
        real,
        system.tasks[0].name if len(system.tasks) == 1 else "all tasks",
        ticks,
        not difference,
        difference,
        done.instructions,
        done.flash_bytes,
        int(rows[-1][1], 16),
        int(rows[-1][0], 16),
    )


def _rows(
    library: HostLibrary, task: Task, inputs: Mapping[str, Array], fmt: Format
) -> list[list[str]]:
    packed = library.task(task.name).pack(inputs)
    names = packed.dtype.names or ()

    def text(v: Any) -> str:
        return f"{v}u" if v.dtype == np.uint32 else fmt.literal(v)

    rows = [[text(v) for n in names for v in np.atleast_1d(row[n])] for row in packed]
    return [row or ["0"] for row in rows]


def _expected(
    library: HostLibrary, inputs: Mapping[str, Mapping[str, Array]], ticks: int
) -> tuple[list[dict[str, Any]], Array]:
    # Every output word of the host's board at every tick; a task's outputs are held in between.
    found = run_schedule(library.board(zeros_missing(library.system)), inputs)
    words: list[dict[str, Any]] = []
    columns = [np.zeros((ticks, 0), np.uint32)]
    for task in library.system.tasks:
        run = (np.arange(ticks) - task.phase) // task.every
        for x in library.system.task_outputs(task):
            bits = library.naming.stored(x, found[task.name][x.name]).view(np.uint32)
            held = bits.reshape(len(bits), -1)[np.maximum(run, 0)]
            columns.append(np.where(run[:, None] < 0, np.uint32(0), held))
            for i in range(x.port.size):
                index = "" if x.port.size == 1 else f"[{i}]"
                name = f"{task.name}_out.{x.name}{index}"
                words.append({"name": name, "word": x.port.whole})
    return words, np.hstack(columns)
