"""Processor in the loop: run a firmware image and hold every output against the host, bit for bit.

The board steps when an input frame comes in.  The host keeps a window of frames on the way, as many
as the board's receive buffer takes.  With ``-icount shift=0`` QEMU's clock moves 1 ns an
instruction and the board's timer counts at 1 GHz, so that the timer counts instructions; they are
instructions, not cycles, and say nothing of time on a real board.
"""

from __future__ import annotations

import shutil
import socket
import subprocess
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from types import TracebackType
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from esea_gen.device import Device
from esea_gen.emit.build import format_hash
from esea_gen.emit.dialect import FAULTS, MODES, load_dialect
from esea_gen.errors import UserError
from esea_gen.hostlib import compile_device
from esea_gen.hostlib.library import run_schedule
from esea_gen.verify.firmware import FirmwareImage, find_board

Array = npt.NDArray[Any]
Progress = Callable[[int, int], None]

HOST_SYSTEM, HOST_COMPONENT = 255, 190  # MAVLink's address of a ground station
BOARD_SYSTEM, BOARD_COMPONENT = 1, 1
FRAME_OVERHEAD_BYTES = 12
MOST_FRAMES = 64
RECEIVE_CHUNK = 1 << 16
POLL_S = 0.1
STOP_S = 3.0


class LinkError(RuntimeError):
    """The board did not answer, or not as the protocol says."""


def find_qemu() -> str:
    """Path of the emulator."""
    path = shutil.which("qemu-system-arm")
    if path is None:
        raise UserError(
            "The emulator 'qemu-system-arm' is not installed.",
            "Install it with: apt-get install --no-install-recommends qemu-system-arm",
        )
    return path


def emulator_version() -> str:
    """First line of QEMU's version."""
    done = subprocess.run([find_qemu(), "--version"], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[0]


class RunningBoard:
    """A board that runs an image: QEMU, or the host itself.  Use it as a context manager.

    timeout_s: longest silence; the first exchange with QEMU may take a second.
    options: options for QEMU beside our own; for the host, arguments of the image.
    """

    def __init__(
        self,
        device: Device,
        image: FirmwareImage,
        timeout_s: float = 10.0,
        options: Sequence[str] = (),
    ) -> None:
        self.device, self.image, self.timeout_s = device, image, timeout_s
        self.options = tuple(options)
        self.dialect: Any = load_dialect(device)
        self.heartbeat: Any = None
        self._encoder: Any = self.dialect.MAVLink(None, HOST_SYSTEM, HOST_COMPONENT)
        self._decoder: Any = self.dialect.MAVLink(None, HOST_SYSTEM, HOST_COMPONENT)
        self._decoder.robust_parsing = True  # noise is counted, not raised
        self._pending: deque[Any] = deque()
        self._process: subprocess.Popen[bytes] | None = None
        self._link: socket.socket | None = None
        self._log: IO[bytes] | None = None

    def __enter__(self) -> RunningBoard:
        try:
            self._start()
            self.wait_for("HEARTBEAT")
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _start(self) -> None:
        machine = find_board(self.image.board).machine
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed by close()
        if not machine:
            self._link, theirs = socket.socketpair()
            self._process = subprocess.Popen(
                [str(self.image.elf), *self.options],
                stdin=theirs.fileno(),
                stdout=theirs.fileno(),
                stderr=self._log,
            )
            theirs.close()
            return
        with (
            tempfile.TemporaryDirectory(prefix="esea-") as folder,
            socket.socket(socket.AF_UNIX) as server,
        ):
            # QEMU calls us: nobody can take a socket that we hold, and no retries are needed.
            path = f"{folder}/uart"
            server.bind(path)
            server.listen(1)
            server.settimeout(POLL_S)
            self._process = subprocess.Popen(
                [
                    find_qemu(),
                    *("-M", machine, "-display", "none", "-monitor", "none", "-nodefaults"),
                    *("-serial", f"unix:{path},server=off"),
                    *("-icount", "shift=0", "-kernel", str(self.image.elf)),
                    *self.options,
                ],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
            )
            self._link = self._accept(server)

    def _accept(self, server: socket.socket) -> socket.socket:
        assert self._process is not None
        deadline_s = time.monotonic() + self.timeout_s
        while time.monotonic() < deadline_s and self._process.poll() is None:
            try:
                return server.accept()[0]
            except TimeoutError:
                continue
        raise LinkError(f"the emulator did not open its serial line{self._said()}")

    def _said(self) -> str:
        if self._log is None:
            return ""
        self._log.seek(0)
        text = self._log.read().decode(errors="replace").strip()
        return f"; it said:\n{text}" if text else ""

    def close(self) -> None:
        """Stop the board."""
        if self._link is not None:
            self._link.close()
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._log is not None:
            self._log.close()
        self._link = self._process = self._log = None

    def send_bytes(self, data: bytes) -> None:
        """Send raw bytes."""
        assert self._link is not None
        self._link.settimeout(self.timeout_s)
        try:
            self._link.sendall(data)
        except OSError as error:
            raise LinkError(f"the board does not take data ({error}){self._said()}") from None

    def pack(self, message: Any) -> bytes:
        """A message as a frame from the host."""
        frame: bytes = bytes(message.pack(self._encoder))
        # pack() leaves counting to send(), which wants a file.
        self._encoder.seq = (self._encoder.seq + 1) % 256
        return frame

    def send(self, message: Any) -> None:
        """Send a message."""
        self.send_bytes(self.pack(message))

    def receive(self, timeout_s: float | None = None) -> Any:
        """The next message.

        return: an instance of one of the dialect's classes; noise is left out.
        """
        assert self._link is not None
        limit_s = self.timeout_s if timeout_s is None else timeout_s
        self._link.settimeout(limit_s)
        while not self._pending:
            try:
                data = self._link.recv(RECEIVE_CHUNK)
            except TimeoutError:
                raise LinkError(f"the board was silent for {limit_s:g} s{self._said()}") from None
            except OSError as error:
                raise LinkError(f"the link broke ({error}){self._said()}") from None
            if not data:
                raise LinkError(f"the board has stopped{self._said()}")
            for message in self._decoder.parse_buffer(data) or ():
                if message.get_type() != "BAD_DATA":
                    self._pending.append(message)
        message = self._pending.popleft()
        if message.get_type() == "HEARTBEAT":
            self.heartbeat = message
            if message.system_status == self.dialect.MAV_STATE_EMERGENCY:
                raise LinkError(f"the processor took a fault exception and halted{self._said()}")
        return message

    def wait_for(self, name: str, timeout_s: float | None = None) -> Any:
        """The next message of a name; others are dropped."""
        while True:
            message = self.receive(timeout_s)
            if message.get_type() == name:
                return message

    def command(self, command: int, param1: float = 0.0) -> int:
        """Give a command and wait for its answer."""
        self.send(
            self.dialect.MAVLink_command_long_message(
                BOARD_SYSTEM, BOARD_COMPONENT, command, 0, param1, 0, 0, 0, 0, 0, 0
            )
        )
        while True:
            ack = self.wait_for("COMMAND_ACK")
            if ack.command == command:
                return int(ack.result)

    def reset(self) -> None:
        """Return the board to its initial state."""
        result = self.command(self.dialect.MAV_CMD_USER_1)
        if result != self.dialect.MAV_RESULT_ACCEPTED:
            raise LinkError(f"the board cannot reset: {self.fault()}")

    def info(self) -> Any:
        """What runs on the board, and its counters."""
        message_id = self.dialect.MAVLINK_MSG_ID_ESEA_INFO
        self.command(self.dialect.MAV_CMD_REQUEST_MESSAGE, float(message_id))
        return self.wait_for("ESEA_INFO")

    def mode(self) -> str:
        """State of the firmware, as its last HEARTBEAT said."""
        return MODES[self.heartbeat.custom_mode][0]

    def fault(self) -> str:
        """The latched fault: its name and meaning."""
        name, meaning = FAULTS[self.info().fault]
        return f"{name}: {meaning}"

    def stream(
        self, task: str, inputs: Mapping[str, Array], progress: Progress | None = None
    ) -> tuple[dict[str, Array], Array]:
        """Run a task over a stream, a window of frames on the way.

        inputs: one float32 array per external input, shape (steps,) or (steps, size).
        """
        outputs, ticks = self.stream_tasks({task: inputs}, progress)
        return outputs[task], ticks[task]

    def stream_tasks(
        self, inputs: Mapping[str, Mapping[str, Array]], progress: Progress | None = None
    ) -> tuple[dict[str, dict[str, Array]], dict[str, Array]]:
        """Run several tasks, each at its own ticks, a window of frames on the way.

        inputs: per task, one float32 array per external input, shape (runs,) or (runs, size); for a
            task without inputs ``{"": zeros}`` of as many elements as it has runs.
        return: per task one array per external output, float32 or uint32.
        return: per task the timer ticks of each run, measuring included.
        """
        system = self.device.system
        counts = {t: len(next(iter(columns.values()))) for t, columns in inputs.items()}
        outputs: dict[str, dict[str, Array]] = {}
        ticks: dict[str, Array] = {t: np.zeros(n, np.uint32) for t, n in counts.items()}
        for name, runs in counts.items():
            outputs[name] = {
                x.name: np.zeros(
                    (runs,) if x.port.size == 1 else (runs, x.port.size),
                    np.uint32 if x.port.flags else np.float32,
                )
                for x in system.task_outputs(system.task(name))
            }
        order = [t for t in system.tasks if t.name in inputs]
        schedule = sorted(
            (t.phase + i * t.every, k, t.name, i)
            for k, t in enumerate(order)
            for i in range(counts[t.name])
        )
        made = {t.name: self._frames(t.name, t.phase, t.every, inputs[t.name]) for t in order}
        frames = (next(made[name]) for _, _, name, _ in schedule)
        window = min(self._window(t.name) for t in order)
        total, sent = len(schedule), 0
        for done, (tick, _, name, run) in enumerate(schedule):
            # Refill when half of the window has come back: few, large pieces go faster.
            if sent - done <= window // 2:
                batch = [next(frames) for _ in range(min(window - (sent - done), total - sent))]
                self.send_bytes(b"".join(batch))
                sent += len(batch)
            wanted = f"ESEA_{name.upper()}_OUT"
            message = self.receive()
            while message.get_type() != wanted:
                if self.heartbeat is not None and self.mode() == "FAULT":
                    raise LinkError(f"a fault is latched: {self.fault()}")
                message = self.receive()
            if message.sequence != tick % 2**32:
                raise LinkError(f"answer {message.sequence} came in place of {tick % 2**32}")
            for output, store in outputs[name].items():
                store[run] = getattr(message, output)
            ticks[name][run] = message.step_ticks
            if progress is not None and (done + 1) % 100 == 0:
                progress(done + 1, total)
        if progress is not None:
            progress(total, total)
        return outputs, ticks

    def _window(self, task: str) -> int:
        frame_bytes: int = FRAME_OVERHEAD_BYTES + self._input_class(task).unpacker.size
        room_bytes = int(self.info().receive_buffer_bytes) - 1
        return max(1, min(MOST_FRAMES, room_bytes // frame_bytes))

    def _input_class(self, task: str) -> Any:
        return getattr(self.dialect, f"MAVLink_esea_{task}_in_message")

    def _frames(
        self, task: str, phase: int, every: int, inputs: Mapping[str, Array]
    ) -> Iterator[bytes]:
        build = self._input_class(task)
        system = self.device.system
        columns = [inputs[x.name].tolist() for x in system.task_inputs(system.task(task))]
        runs = len(next(iter(inputs.values())))
        rows = zip(*columns, strict=True) if columns else iter([()] * runs)
        for i, row in enumerate(rows):
            yield self.pack(build((phase + i * every) % 2**32, *row))


@dataclass(frozen=True)
class Difference:
    """The first value in which board and host differ."""

    step: int
    output: str
    board: str
    host: str


@dataclass(frozen=True)
class EmulatorResult:
    """What a run in the emulator found.

    identical: whether every bit of every output of every step, as it is sent, equals the host's
        library in the image's number format.
    expected_hash: hash of the device as it is now.
    instructions: ``min``, ``median`` and ``max`` instructions of a step, call included; empty on
        the host.
    flash_bytes, ram_bytes: of the image; RAM without the stack.
    stack_bytes, stack_peak_bytes: stack reserved, and the most that was in use since boot (whole
        firmware, interrupts included).
    step_stack_bytes: largest stack use of the task's step, by the compiler's call graph.
    compiler: first line of the compiler's version.
    outputs: what the board gave; not part of :meth:`to_dict`.
    step_instructions: instructions of each step; not part of :meth:`to_dict`.
    """

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
        """Whether the board runs what the device file now describes."""
        return self.content_hash == self.expected_hash

    def to_dict(self) -> dict[str, Any]:
        """The findings, for a JSON report."""
        names = [f.name for f in fields(self) if f.name not in ("outputs", "step_instructions")]
        found = {name: getattr(self, name) for name in names}
        difference = self.first_difference
        found["first_difference"] = None if difference is None else asdict(difference)
        return found | {"hash_matches": self.hash_matches}


def first_difference(board: Mapping[str, Array], host: Mapping[str, Array]) -> Difference | None:
    """The first step in which two streams of outputs differ in any bit.

    board, host: 32-bit values, the same names and shapes.
    """
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


def _float32(device: Device, task: str, inputs: Mapping[str, Any]) -> dict[str, Array]:
    system = device.system
    known = [t.name for t in system.tasks]
    if task not in known:
        raise UserError(f"There is no task '{task}'.", f"Tasks: {', '.join(known)}.")
    names = [x.name for x in system.task_inputs(system.task(task))]
    if not names:
        if set(inputs) != {""} or not len(inputs[""]):
            raise UserError(
                f"Task {task} takes no input, got {sorted(inputs)}.",
                'Give {"": zeros}, one element for each of its runs.',
            )
        return {"": np.zeros(len(inputs[""]), np.float32)}
    if set(inputs) != set(names):
        raise UserError(f"Task {task} takes {names}, got {sorted(inputs)}.", "Give one array each.")
    arrays = {n: np.asarray(inputs[n], np.float32) for n in names}
    if len({len(a) for a in arrays.values()}) != 1 or not len(arrays[names[0]]):
        raise UserError("The inputs are empty or of different lengths.", "Give equal lengths.")
    return arrays


def _host_outputs(
    device: Device, real: str, inputs: Mapping[str, Mapping[str, Array]]
) -> dict[str, dict[str, Array]]:
    # In single precision, as the link carries numbers.
    library = compile_device(device, real)
    if device.system.latches or len(inputs) > 1:
        found = run_schedule(library.board(), inputs)
    else:  # the same, with the loop in C
        found = {t: library.task(t).run(columns, trace=False)[0] for t, columns in inputs.items()}
    return {
        t: {n: a if a.dtype == np.uint32 else a.astype(np.float32) for n, a in columns.items()}
        for t, columns in found.items()
    }


def run_in_emulator(
    device: Device,
    image: FirmwareImage,
    inputs: Mapping[str, Any],
    task: str | None = None,
    progress: Progress | None = None,
    timeout_s: float = 10.0,
    options: Sequence[str] = (),
) -> EmulatorResult:
    """Run an image over a stream and compare it with the host's library, bit for bit.

    inputs: one array per external input of the task, shape (steps,) or (steps, size); rounded to
        float32.
    """
    name = device.system.tasks[0].name if task is None else task
    return run_tasks_in_emulator(device, image, {name: inputs}, progress, timeout_s, options)[name]


def run_tasks_in_emulator(
    device: Device,
    image: FirmwareImage,
    inputs: Mapping[str, Mapping[str, Any]],
    progress: Progress | None = None,
    timeout_s: float = 10.0,
    options: Sequence[str] = (),
) -> dict[str, EmulatorResult]:
    """Run several tasks interleaved, each at its own ticks, and compare them with the host.

    inputs: per task, one array per external input, shape (runs,) or (runs, size), rounded to
        float32; for a task without inputs ``{"": zeros}`` of as many elements as it has runs.
    return: by task. Sizes, counters and the deepest stack are the board's, the same in each.
    """
    if not inputs:
        raise UserError("No task is given.", "Give the inputs of at least one.")
    arrays = {t: _float32(device, t, columns) for t, columns in inputs.items()}
    host = _host_outputs(device, image.real, arrays)
    with RunningBoard(device, image, max(3.0, timeout_s), options) as board:
        board.reset()
        start_s = time.monotonic()
        outputs, ticks = board.stream_tasks(arrays, progress)
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
            step_stack_bytes=image.step_stack_bytes[name],
            sequence_gaps=info.sequence_gaps,
            bad_frames=info.bad_frames,
            unknown_messages=info.unknown_messages,
            lost_bytes=info.lost_bytes,
            emulator=emulator_version() if emulated else "none: the host itself",
            compiler=image.compiler,
            duration_s=duration_s,
            outputs=outputs[name],
            step_instructions=counted,
        )
    return results
