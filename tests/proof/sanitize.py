"""Sanitizers on the equivalence streams: address, undefined behaviour, uninitialised memory."""

from __future__ import annotations

import os
import struct
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.emit.build import device_hash
from esea_gen.emit.formats import FORMATS, Format
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.hostlib.codec import to_whole
from esea_gen.hostlib.compiler import find_compiler, run_tool
from esea_gen.hostlib.library import HostLibrary
from esea_gen.language.ports import Array
from esea_gen.language.stream import Stream
from esea_gen.language.system import System
from esea_gen.model.sensing import zeros_missing
from esea_gen.targets import HOST_GCC
from esea_gen.verify.equivalence import chosen_blocks
from esea_gen.verify.executor import counter_fields
from esea_gen.verify.memories import other_memories
from esea_gen.verify.runs import run_c
from esea_gen.verify.streams import at_the_limits, streams

# What C leaves undefined, and the two conversions that IEEE defines but no kernel should need.
UNDEFINED = ("-fsanitize=undefined,float-cast-overflow,float-divide-by-zero",)
SANITIZERS = {
    "address": ("-fsanitize=address,undefined,float-cast-overflow,float-divide-by-zero",),
    "memory": ("-fsanitize=memory", "-fsanitize-memory-track-origins"),
}
_FLAGS = ("-std=c99", "-O1", "-g", "-ffp-contract=off", "-fno-omit-frame-pointer")
_STOP = ("-fno-sanitize-recover=all",)


class GivenRenderer(Renderer):
    """A renderer whose files are given: how a deliberate fault is put in."""

    def __init__(self, device: Device, real: str, files: Mapping[str, str] | None = None) -> None:
        super().__init__(device.system, FORMATS[real], device_hash(device), "-", device.title)
        self._given = files

    def files(self) -> dict[str, str]:
        """The given files."""
        return dict(self._given) if self._given is not None else super().files()


@dataclass(frozen=True)
class SanitizerRun:
    """What a sanitizer said."""

    sanitizer: str
    real: str
    runs: int
    steps: int
    reports: tuple[str, ...]
    differences: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether nothing was reported and all bits agree."""
        return not self.reports and not self.differences


def tried_streams(block: Any, fmt: Format, steps: int = 1500) -> list[Stream]:
    """The streams of the comparisons, shortened."""
    # A program's state is work memory: what the rest changes in it carries nothing.
    if block.kind == "program":
        return streams(block, steps=steps)
    return [
        *streams(block, steps=steps),
        at_the_limits(block, fmt.dtype, steps=steps),
        *other_memories(block, fmt.dtype, steps=steps),
    ]


@contextmanager
def standard_error() -> Iterator[list[str]]:
    """What C code in this process writes to standard error, line by line."""
    said: list[str] = []
    with tempfile.TemporaryFile() as store:
        kept = os.dup(2)
        try:
            os.dup2(store.fileno(), 2)
            yield said
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            store.seek(0)
            said += store.read().decode(errors="replace").splitlines()


def undefined_behaviour(
    device: Device,
    real: str,
    files: Mapping[str, str] | None = None,
    steps: int = 1500,
    blocks: Sequence[str] | None = None,
) -> SanitizerRun:
    """Run every Block and task in process, watched for undefined behaviour."""
    # Not stopping at a report: this process goes on, and reads what was said.
    flags = (*UNDEFINED, "-fsanitize-recover=all")
    library = HostLibrary(device.system, GivenRenderer(device, real, files), flags)
    runs = taken = 0
    with standard_error() as said:
        for block in chosen_blocks(device, blocks):
            for stream in tried_streams(block, FORMATS[real], steps):
                run_c(library.block(block.name), stream)
                runs, taken = runs + 1, taken + stream.steps
        for task in () if blocks else device.system.tasks:
            runner = library.task(task.name)
            runner.prepare(zeros_missing(library.system))
            runner.run(_task_inputs(device.system, task, steps), trace=False)
            runs, taken = runs + 1, taken + steps
    reports = tuple(line for line in said if "runtime error" in line)
    return SanitizerRun("undefined", real, runs, taken, reports)


def _task_inputs(system: System, task: Any, steps: int) -> dict[str, Array]:
    out = {}
    for x in system.task_inputs(task):
        wave = 0.6 * np.sin(np.linspace(0.0, 60.0, steps))
        value = np.asarray(wave * max(abs(x.port.low), abs(x.port.high)), np.float32)
        value[steps // 3 :: 97] = np.nan
        value[steps // 2 :: 89] = np.inf
        value[steps // 4 :: 83] = 2 * x.port.high + 1
        out[x.name] = value.astype(float)
        if x.port.size > 1:
            out[x.name] = np.tile(out[x.name][:, None], (1, x.port.size))
    # A task without inputs is run as often all the same.
    return out or {"": np.zeros(steps)}


def _packed(values: Sequence[Array], steps: int) -> list[bytes]:
    columns = [np.ascontiguousarray(v).reshape(steps, -1).view(np.uint8) for v in values]
    return [row.tobytes() for row in np.concatenate(columns, axis=1)]


def _stream_bytes(stream: Stream, inputs: Sequence[Array], state: np.dtype[Any]) -> bytes:
    rows = _packed(inputs, stream.steps)
    out = [struct.pack("=I", stream.steps)]
    for k, row in enumerate(rows):
        patches = stream.injections.get(k, {})
        out.append(struct.pack("=I", len(patches)))
        for name, value in patches.items():
            kind = state[name]
            offset = int(state.fields[name][1]) if state.fields else 0
            held = np.asarray(value) if kind.base.kind == "f" else to_whole(value, kind.base)
            with np.errstate(over="ignore"):
                data = held.reshape(kind.shape).astype(kind.base).tobytes()
            out.append(struct.pack("=II", offset, len(data)) + data)
        out.append(row)
    return b"".join(out)


class ReplayProgram:
    """The C harness, compiled with a sanitizer."""

    def __init__(
        self,
        device: Device,
        real: str,
        sanitizer: str,
        folder: Path,
        files: Mapping[str, str] | None = None,
    ) -> None:
        self.folder = folder
        renderer = GivenRenderer(device, real, files)
        texts = {n: t for n, t in renderer.files().items() if "/" not in n}
        texts["main.c"] = renderer.render("verify/replay.c.j2", zeros=zeros_missing(device.system))
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        sources = sorted(n for n in texts if n.endswith(".c"))
        compiler = (
            find_compiler("clang", "clang")
            if sanitizer == "memory"
            else find_compiler(*HOST_GCC.gcc)
        )
        flags = (*_FLAGS, *SANITIZERS[sanitizer], *_STOP)
        done = run_tool([compiler, *flags, *sources, "-o", "replay", "-lm"], folder)
        if "libclang_rt.msan" in done.stderr:
            raise UserError(
                "clang's run-time library of the memory sanitizer is not installed.",
                "Install it with: apt-get install --no-install-recommends libclang-rt-14-dev",
            )
        if done.returncode != 0:
            raise RuntimeError(f"the replay harness does not build:\n{done.stderr}")

    def run(self, name: str, stream: bytes, fill: int = -1) -> tuple[bytes, str]:
        """Replay a stream."""
        (self.folder / "stream").write_bytes(stream)
        done = run_tool(["./replay", name, "stream", "result", str(fill)], self.folder)
        result = self.folder / "result"
        if done.returncode == 0 and not done.stderr:
            return result.read_bytes(), ""
        lines = [x for x in done.stderr.splitlines() if "ERROR" in x or "runtime error" in x]
        said = "; ".join(lines) or done.stderr or f"ended with {done.returncode}"
        return b"", f"{name}: {said}"


def replay_device(
    device: Device,
    real: str,
    sanitizer: str,
    files: Mapping[str, str] | None = None,
    steps: int = 1500,
    blocks: Sequence[str] | None = None,
) -> SanitizerRun:
    """Replay every Block and task in the C harness, and compare its bits with the library's."""
    fmt = FORMATS[real]
    library = HostLibrary(device.system, GivenRenderer(device, real, files))
    reports: list[str] = []
    differences: list[str] = []
    runs = taken = 0
    with tempfile.TemporaryDirectory(prefix="esea-replay-") as scratch:
        harness = ReplayProgram(device, real, sanitizer, Path(scratch), files)
        for name, stream, inputs, state, expected in _cases(device, library, fmt, steps, blocks):
            data = _stream_bytes(stream, inputs, state)
            # Two fillings, a tiny and a huge number: a result that depends on memory that nobody
            # wrote differs in one.
            for fill in (-1,) if sanitizer == "memory" else (0xA5, 0x7F):
                result, said = harness.run(name, data, fill)
                runs, taken = runs + 1, taken + stream.steps
                if said:
                    reports.append(f"{stream.name}: {said}")
                elif result != b"".join(_packed(expected, stream.steps)):
                    differences.append(f"{stream.name}: {name}, memory filled with {fill}")
    return SanitizerRun(sanitizer, real, runs, taken, tuple(reports), tuple(differences))


def _cases(
    device: Device, library: HostLibrary, fmt: Format, steps: int, blocks: Sequence[str] | None
) -> Iterator[tuple[str, Stream, list[Array], np.dtype[Any], list[Array]]]:
    # Name, stream, inputs as the C's numbers, type of the state, outputs and states expected.
    for block in chosen_blocks(device, blocks):
        state = library.dtype(f"{library.prefix}_{block.name}_state_t")
        for stream in tried_streams(block, fmt, steps):
            if stream.coefficients:  # the harness prepares its own: watched in process
                continue
            runner = library.block(block.name)
            y, s = run_c(runner, stream)
            packed = runner.pack(stream.inputs)
            inputs = [packed[p.name] for p in block.inputs]
            names = [p.name for p in block.state] + list(counter_fields(block))
            expected = [y[p.name] for p in block.outputs] + [s[n] for n in names]
            yield block.name, stream, inputs, state, expected
    for task in () if blocks else device.system.tasks:
        values = _task_inputs(device.system, task, steps)
        if not device.system.task_inputs(task):  # nothing to replay: watched in process
            continue
        runner = library.task(task.name)
        runner.prepare(zeros_missing(library.system))
        y, _ = runner.run(values, trace=False)
        packed = runner.pack(values)
        inputs = [packed[x.name] for x in device.system.task_inputs(task)]
        expected = [y[x.name] for x in device.system.task_outputs(task)]
        state = library.dtype(f"{library.prefix}_state_t")
        yield task.name, Stream("task", values), inputs, state, expected
