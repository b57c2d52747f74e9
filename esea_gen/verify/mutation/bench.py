"""Compile mutants in batches and compare them with the C that ships."""

from __future__ import annotations

import copy
import hashlib
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.program_c import EmittedProgram
from esea_gen.emit.render import Renderer
from esea_gen.emit.walker import UnsupportedOperationError
from esea_gen.errors import UserError
from esea_gen.hostlib.codec import Array
from esea_gen.hostlib.compiler import compiler, write_texts
from esea_gen.hostlib.library import CBoard, CRunner, HostLibrary
from esea_gen.language.block import Block
from esea_gen.language.program import Program
from esea_gen.language.stream import single
from esea_gen.language.system import System
from esea_gen.portability import CAN_FORK, passes_apart
from esea_gen.verify.compare import compare_program, program_streams
from esea_gen.verify.executor import (
    KernelTrajectory,
    exact_trajectory,
    expected_setup,
    setup_difference,
)
from esea_gen.verify.memories import other_memories
from esea_gen.verify.mutation.mutants import Mutant
from esea_gen.verify.runs import CasadiOracle, run_c, run_executor
from esea_gen.verify.streams import (
    at_the_limits,
    domain_chirp,
    recorded_stream,
    streams,
    working_inputs,
)

# Fast to compile; without optimisation float arithmetic has the same bits.
MUTANT_FLAGS = ("-std=c99", "-O0", "-ffp-contract=off", "-fPIC", "-w")
# Characters of C in one library; a Program that a fault sends astray may run no longer, seconds.
BATCH_SIZE, ASTRAY_S = 600_000, 20


class Bench:
    """Compiles mutants and compares them with the expected results of the C."""

    def __init__(self, device: Device, real: str, folder: Path, kinds: Sequence[Any]) -> None:
        if not CAN_FORK:
            raise UserError("Mutants run in forked processes, which Windows lacks.", "Use WSL.")
        self.device, self.folder, self.fmt = device, folder, FORMATS[real]
        self.cc = compiler()
        self.renderer = Renderer(device.system, self.fmt, "-", "-", device.title)
        self.library = HostLibrary(device.system, self.renderer)
        self.library.ffi.cdef("void esea_choose_mutant(int which);", override=True)
        texts = {n: t for n, t in self.library.sources.items() if "/" not in n and n != "main.c"}
        write_texts(folder, texts)
        self.objects = {name: f"{name}.o" for name in texts if name.endswith(".c")}
        for name, made in self.objects.items():
            self._compile("-c", name, "-o", made, check=True)
        self.programs = [b for b in kinds if isinstance(b, Program)]
        self.blocks = [b for b in kinds if not isinstance(b, Program)]
        self.oracle = CasadiOracle(device.system) if real == "f64" else None
        self.judged = {b.name: self._judge(b) for b in self.blocks}
        self.setups = {b.name: expected_setup(b, self.fmt) for b in self.blocks}
        self.executed = {
            p.name: [(s, run_executor(p, s)) for s in program_streams(p)] for p in self.programs
        }
        self.batches = 0

    @cached_property
    def wiring(self) -> list[bytes]:
        """Outputs of the tasks that ship."""
        return task_signature(self.library)

    def _compile(self, *arguments: str, check: bool = False) -> bool:
        command = [*self.cc, *MUTANT_FLAGS, *arguments]
        done = subprocess.run(command, cwd=self.folder, capture_output=True, check=check)
        return done.returncode == 0

    def _judge(self, block: Block) -> list[KernelTrajectory]:
        # What the C must give, bit for bit, on every stream.
        recorded = recorded_stream(self.device, domain_chirp(self.device, 2.0), "chirp in domain")
        dtype = self.fmt.dtype
        tried = [*streams(block), *(s for n, s in recorded.items() if n == block.name)]
        tried += [at_the_limits(block, dtype), *other_memories(block, dtype)]
        return [exact_trajectory(block, self.library, s, self.oracle) for s in tried]

    # -- compiling -------------------------------------------------------------------------------

    def loaded(self, mutants: Sequence[Mutant]) -> Iterator[tuple[Mutant, HostLibrary | None]]:
        """Every mutant of one file, compiled and loaded while it is looked at."""
        batch, size = list[tuple[Mutant, str]](), 0
        for mutant in mutants:
            try:
                batch.append((mutant, mutant.text(self.renderer)))
                size += len(batch[-1][1])
            except UnsupportedOperationError:  # a count that is no longer whole has no C
                yield mutant, None
            if size > BATCH_SIZE:
                yield from self._batch(batch)
                batch, size = [], 0
        yield from self._batch(batch)

    def _batch(
        self, batch: Sequence[tuple[Mutant, str]]
    ) -> Iterator[tuple[Mutant, HostLibrary | None]]:
        if not batch:
            return
        file = batch[0][0].file
        # A new name each time: the loader takes the same path for the same library.
        self.batches += 1
        target = self.folder / f"mutants{self.batches}.so"
        private, shared = self._symbols(batch[0][0])
        mutants = _renamed([t for _, t in batch], private + shared)
        texts = {"mutants.c": mutants, "choose.c": self._choosing(len(batch), shared)}
        write_texts(self.folder, texts)
        others = [o for n, o in self.objects.items() if n != file]
        made = ("mutants.c", "choose.c", *others, "-o", target.name, *self.library.link)
        if not self._compile("-shared", *made):
            if len(batch) == 1:
                yield batch[0][0], None
                return
            middle = len(batch) // 2
            yield from self._batch(batch[:middle])
            yield from self._batch(batch[middle:])
            return
        library = copy.copy(self.library)
        library.path, library.lib = target, self.library.ffi.dlopen(str(target))
        for k, (mutant, _) in enumerate(batch):
            library.lib.esea_choose_mutant(k)
            yield mutant, library
        library.ffi.dlclose(library.lib)
        target.unlink()

    def _symbols(self, mutant: Mutant) -> tuple[list[str], list[str]]:
        # What a file defines: for itself, and for others.
        prefix = self.library.prefix
        if mutant.block is None:
            names = ["default_params", "prepare", "init", "release"]
            names += [f"{t.name}_step" for t in self.library.system.tasks]
            stem = prefix
        else:
            names, stem = ["prepare", "init", "step"], f"{prefix}_{mutant.block.name}"
        shared = [f"{stem}_{n}" for n in names if hasattr(self.library.lib, f"{stem}_{n}")]
        private: list[str] = []
        emitted: Any = self.renderer.emitted[mutant.block.name] if mutant.block else None
        if isinstance(emitted, EmittedProgram):
            private = [f"{emitted.block.name}_{p.name}" for p in emitted.parts]
            private += [name for _, name, _ in emitted.tables]
        return private, shared

    def _choosing(self, count: int, names: Sequence[str]) -> str:
        # Without the header: all structs come by pointer, and a pointer is a pointer.
        ffi, lines = self.library.ffi, ["#include <stdint.h>", "static int chosen;"]
        lines.append("void esea_choose_mutant(int which) { chosen = which; }")
        for name in names:
            kind = ffi.typeof(getattr(self.library.lib, name))
            types = ["void *" if a.kind == "pointer" else str(a.cname) for a in kind.args]
            made = kind.result.cname
            taken, table = ", ".join(types), ", ".join(f"m{k}_{name}" for k in range(count))
            named = ", ".join(f"{t} a{k}" for k, t in enumerate(types))
            given = ", ".join(f"a{k}" for k in range(len(types)))
            word = "" if made == "void" else "return "
            lines += [f"{made} m{k}_{name}({taken});" for k in range(count)]
            lines.append(f"static {made} (*const table_{name}[])({taken}) = {{{table}}};")
            lines.append(f"{made} {name}({named}) {{ {word}table_{name}[chosen]({given}); }}")
        return "\n".join(lines) + "\n"

    # -- comparing -------------------------------------------------------------------------------

    def check(self) -> None:
        """Compare the C that ships with its expected results."""
        found = [self.block_difference(self.library, j) for j in self.blocks]
        found += [self.program_difference(self.library, p) for p in self.programs]
        if any(found):
            raise RuntimeError(f"the C that ships already differs: {max(found)}")

    def difference(self, library: HostLibrary, mutant: Mutant) -> str:
        """First difference in any bit from the expected results of the C; empty if equal."""
        block = mutant.block
        if block is None:
            same = task_signature(library) == self.wiring
            return "" if same else "the task differs from the one that ships"
        if isinstance(block, Program):
            # In a process of its own: numbers of a Program index arrays and count passes.
            same = passes_apart(lambda: not self.program_difference(library, block), ASTRAY_S)
            return "" if same else "the Program differs from its executor"
        return self.block_difference(library, block, mutant.function)

    def block_difference(self, library: HostLibrary, block: Block, function: str = "") -> str:
        """As :meth:`difference`; omits results of ``prepare`` and ``init`` alone from a step."""
        found = ""
        if function != "step":
            found = setup_difference(block, library, self.setups[block.name])
        for judged in self.judged[block.name]:
            if found:
                break
            found = judged.first_difference(*run_c(library.block(block.name), judged.stream))
        return found

    def program_difference(self, library: HostLibrary, program: Program) -> str:
        """Where a Program's C fails against its executor; empty when it holds on all streams."""
        for stream, expected in self.executed[program.name]:
            found = compare_program(self.device, program, library, stream, expected)
            if not found.passed:
                return f"{stream.name}: {found.problems or 'bits differ'}"
        return ""


def _renamed(texts: Sequence[str], names: Sequence[str]) -> str:
    # Each text with names of its own for what it defines.
    lines = []
    for k, text in enumerate(texts):
        lines += [f"#define {name} m{k}_{name}" for name in names]
        lines.append(text)
        lines += [f"#undef {name}" for name in names]
    return "\n".join(lines)


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


def _board_signature(library: HostLibrary) -> Iterator[bytes]:
    # All tasks on one state, as firmware calls them: what crosses from one to the other, and when.
    for tunables in ({}, _other_tunables(library.system)):
        try:
            board = library.board(tunables)
        except ValueError as error:  # a default that its own check refuses
            yield str(error).encode()
        else:
            yield from _board_run(library, board)


def _board_run(library: HostLibrary, board: CBoard) -> Iterator[bytes]:
    system = library.system
    ticks = 1200
    inputs = {t.name: working_inputs(system, t, ticks // t.every + 1) for t in system.tasks}
    digest = hashlib.sha256(bytes(library.ffi.buffer(board.state)))
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
            yield digest.digest()
