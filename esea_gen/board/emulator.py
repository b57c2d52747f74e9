"""Processor in the loop: every output of an image on an emulated board, bit for bit.

With ``-icount shift=0`` QEMU's clock moves 1 ns an instruction and the board's timer counts at 1
GHz, so it counts instructions, which are not cycles.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.board.firmware import FirmwareImage
from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.dialect import load_dialect
from esea_gen.errors import UserError
from esea_gen.hostlib import compile_device, find_compiler
from esea_gen.hostlib.codec import to_whole
from esea_gen.hostlib.compiler import compiler_version
from esea_gen.hostlib.library import run_schedule
from esea_gen.language.system import Task
from esea_gen.link.session import Session
from esea_gen.link.transport import LinkError, Process, ProcessTransport, Transport
from esea_gen.model.sensing import zeros_missing
from esea_gen.portability import listening_for_qemu
from esea_gen.targets import Board, find_board

Array = npt.NDArray[Any]
Progress = Callable[[int, int], None]

POLL_S = 0.1


def find_qemu() -> str:
    """Path of the emulator."""
    return find_compiler("qemu-system-arm", "qemu-system-arm")


def qemu_command(board: Board, semihosting: bool = False) -> list[str]:
    """The emulator's command for a machine, without any window or device of its own choice."""
    command = [find_qemu(), "-M", board.machine, "-display", "none", "-monitor", "none"]
    more = ("-semihosting-config", "enable=on,target=native") if semihosting else ()
    return [*command, "-nodefaults", *more]


def start_board(image: FirmwareImage, timeout_s: float, options: Sequence[str] = ()) -> Transport:
    """Start the runner of an image, QEMU or the host itself."""
    board = find_board(image.board)
    if "-shared" in board.link:
        raise UserError(
            f"Board '{board.name}' is a library: it does not run by itself.",
            "Drive it from Python (esea_gen.board.sim.SimBoard), or choose another board.",
        )
    if not board.machine:
        # On a processor of its own, or emulated.
        runner = [find_compiler(board.runner, "qemu-user")] if board.runner else []
        return ProcessTransport.over_stdio([*runner, str(image.elf), *options])
    with listening_for_qemu() as (server, channel):
        server.settimeout(POLL_S)
        process = Process(
            [
                *qemu_command(board),
                *("-chardev", f"{channel},id=uart", "-serial", "chardev:uart"),
                *("-icount", "shift=0", "-kernel", str(image.elf)),
                *options,
            ]
        )
        try:
            return ProcessTransport(process, _accept(server, process, timeout_s))
        except BaseException:
            process.stop()
            raise


def _accept(server: socket.socket, process: Process, timeout_s: float) -> socket.socket:
    deadline_s = time.monotonic() + timeout_s
    while time.monotonic() < deadline_s and process.runs():
        try:
            return server.accept()[0]
        except TimeoutError:
            continue
    raise LinkError("the emulator did not open its serial line", said=process.said())


class RunningBoard(Session):
    """A board that runs an image: QEMU, or the host itself. Use it as a context manager."""

    def __init__(
        self,
        device: Device,
        image: FirmwareImage,
        timeout_s: float = 10.0,
        options: Sequence[str] = (),
    ) -> None:
        self.device = device
        dialect = load_dialect(device)
        super().__init__(start_board(image, timeout_s, options), dialect, timeout_s)

    def run_tasks(
        self, inputs: Mapping[str, Mapping[str, Array]], progress: Progress | None = None
    ) -> tuple[dict[str, dict[str, Array]], dict[str, Array]]:
        """Run several tasks, each at its own ticks, a window of frames on the way."""
        system = self.device.system
        counts = {t: len(next(iter(columns.values()))) for t, columns in inputs.items()}
        outputs: dict[str, dict[str, Array]] = {}
        ticks: dict[str, Array] = {t: np.zeros(n, np.uint32) for t, n in counts.items()}
        for name, runs in counts.items():
            outputs[name] = {
                x.name: np.zeros(
                    (runs,) if x.port.size == 1 else (runs, x.port.size),
                    np.uint32 if x.port.whole else np.float32,
                )
                for x in system.task_outputs(system.task(name))
            }
        order = [t for t in system.tasks if t.name in inputs]
        schedule = sorted(
            (t.phase + i * t.every, k, t.name, i)
            for k, t in enumerate(order)
            for i in range(counts[t.name])
        )
        made = {t.name: self._messages(t, inputs[t.name]) for t in order}
        requests = ((next(made[t]), f"ESEA_{t.upper()}_OUT") for _, _, t, _ in schedule)
        window = self.window(f"ESEA_{t.name.upper()}_IN" for t in order)
        answers = self.exchange(requests, window)
        total = len(schedule)
        for done, ((_, _, name, run), answer) in enumerate(zip(schedule, answers, strict=True), 1):
            for output, store in outputs[name].items():
                store[run] = getattr(answer, output)
            ticks[name][run] = answer.step_ticks
            if progress is not None and done % 100 == 0:
                progress(done, total)
        if progress is not None:
            progress(total, total)
        return outputs, ticks

    def _messages(self, task: Task, inputs: Mapping[str, Array]) -> Iterator[Any]:
        given = [(x.port, inputs[x.name]) for x in self.device.system.task_inputs(task)]
        columns = [(to_whole(a) if p.whole else a).tolist() for p, a in given]
        runs = len(next(iter(inputs.values())))
        rows = zip(*columns, strict=True) if columns else iter([()] * runs)
        for i, row in enumerate(rows):
            sequence = (task.phase + i * task.every) % 2**32
            yield self.message(f"ESEA_{task.name.upper()}_IN", sequence, *row)


@dataclass(frozen=True)
class Difference:
    """The first value in which board and host differ."""

    step: int
    output: str
    board: str
    host: str


@dataclass(frozen=True)
class EmulatorResult:
    """Result of a run in the emulator."""

    device: str
    board: str
    task: str
    steps: int
    identical: bool
    first_difference: Difference | None
    content_hash: str
    expected_hash: str
    instructions: dict[str, int]
    flash_bytes: int
    ram_bytes: int
    stack_bytes: int
    stack_peak_bytes: int
    step_stack_bytes: int
    sequence_gaps: int
    bad_frames: int
    unknown_messages: int
    lost_bytes: int
    emulator: str
    compiler: str
    duration_s: float
    outputs: dict[str, Array] = field(repr=False)
    step_instructions: Array = field(repr=False)

    @property
    def hash_matches(self) -> bool:
        """Whether the board runs the C of the present device file."""
        return self.content_hash == self.expected_hash

    def to_dict(self) -> dict[str, Any]:
        """The findings, for a JSON report."""
        small = replace(self, outputs={}, step_instructions=np.zeros(0))
        found = asdict(small) | {"hash_matches": self.hash_matches}
        return {k: v for k, v in found.items() if k not in ("outputs", "step_instructions")}


def first_difference(board: Mapping[str, Array], host: Mapping[str, Array]) -> Difference | None:
    """The first step in which two streams of outputs differ in any bit."""
    if set(board) != set(host) or not board:
        raise ValueError(f"outputs {sorted(board)} against {sorted(host)}")
    first: Difference | None = None
    for name in board:
        a, b = np.ascontiguousarray(board[name]), np.ascontiguousarray(host[name])
        if a.shape != b.shape or a.dtype != b.dtype or a.dtype.itemsize != 4:
            raise ValueError(f"{name}: {a.dtype}{a.shape} against {b.dtype}{b.shape}")
        # As bits: -0 is not 0, and NaN is equal to the same NaN.
        bits_a, bits_b = a.view(np.uint32), b.view(np.uint32)
        where = np.argwhere(bits_a != bits_b)
        if len(where) and (first is None or where[0][0] < first.step):
            at = tuple(where[0])
            first = Difference(
                int(at[0]), name, f"0x{int(bits_a[at]):08x}", f"0x{int(bits_b[at]):08x}"
            )
    return first


def _host_outputs(
    device: Device, real: str, inputs: Mapping[str, Mapping[str, Array]]
) -> dict[str, dict[str, Array]]:
    # In single precision, as the link carries numbers.
    library = compile_device(device, real)
    zeros = zeros_missing(device.system)  # as the firmware sets them for a replay
    if device.system.latches or zeros or len(inputs) > 1:
        found = run_schedule(library.board(zeros), inputs)
    else:  # the same, with the loop in C
        found = {t: library.task(t).run(columns, trace=False)[0] for t, columns in inputs.items()}
    return {
        t: {n: a if a.dtype == np.uint32 else a.astype(np.float32) for n, a in columns.items()}
        for t, columns in found.items()
    }


def run_tasks_in_emulator(
    device: Device,
    image: FirmwareImage,
    inputs: Mapping[str, Mapping[str, Any]],
    progress: Progress | None = None,
    timeout_s: float = 10.0,
    options: Sequence[str] = (),
) -> dict[str, EmulatorResult]:
    """Run several tasks interleaved, each at its own ticks, and compare them with the host."""
    arrays = {
        t: {n: np.asarray(a, np.float32) for n, a in columns.items()}
        for t, columns in inputs.items()
    }
    host = _host_outputs(device, image.real, arrays)
    with RunningBoard(device, image, max(3.0, timeout_s), options) as board:
        board.reset()
        start_s = time.monotonic()
        outputs, ticks = board.run_tasks(arrays, progress)
        duration_s = time.monotonic() - start_s
        info = board.info()
    chosen = find_board(image.board)
    emulated = bool(chosen.machine)
    results = {}
    for name in arrays:
        counted = (ticks[name].astype(np.int64) - info.empty_ticks) * chosen.tick_instructions
        difference = first_difference(outputs[name], host[name])
        results[name] = EmulatorResult(
            device=device.name,
            board=info.board,
            task=name,
            steps=len(counted),
            identical=difference is None,
            first_difference=difference,
            content_hash=info.content_hash,
            expected_hash=format_hash(device, image.real),
            instructions={
                "min": int(counted.min()),
                "median": int(np.median(counted)),
                "max": int(counted.max()),
            }
            if emulated
            else {},
            flash_bytes=image.flash_bytes,
            ram_bytes=image.ram_bytes,
            stack_bytes=image.stack_bytes,
            stack_peak_bytes=info.stack_peak_bytes if emulated else 0,
            step_stack_bytes=image.step_stack_bytes.get(name, 0),
            sequence_gaps=info.sequence_gaps,
            bad_frames=info.bad_frames,
            unknown_messages=info.unknown_messages,
            lost_bytes=info.lost_bytes,
            emulator=compiler_version(find_qemu()) if emulated else "none: the host itself",
            compiler=image.compiler,
            duration_s=duration_s,
            outputs=outputs[name],
            step_instructions=counted,
        )
    return results
