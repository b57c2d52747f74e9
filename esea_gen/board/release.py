"""Latest end of a device's control task on a board, after which its command may be released."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from esea_gen.board.bound import step_bound
from esea_gen.device import Device, load_device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.program_c import LoopBound, loop_lines
from esea_gen.emit.render import Renderer
from esea_gen.errors import UserError
from esea_gen.hostlib.compiler import find_compiler, run_tool, write_texts
from esea_gen.language.system import Task
from esea_gen.targets import BARE_LINK, BOARDS, EXACT_FLAGS, SECTION_FLAGS, Board, Processor

# Of the processor's time, what firmware and interrupts beside the tasks may take.
MOST_LOAD = 0.9
# Lighter than predictive control, by their errors (docs/laws-compared.md); the last is lightest.
LIGHTER = ("cascade", "smc")
CHECKSUM = "coefficients_checksum"


@dataclass(frozen=True)
class TaskTimes:
    """Longest times of a device's tasks on a board."""

    device: str
    board: Board
    instructions: dict[str, int]
    ended_s: dict[str, float]
    release_s: dict[str, float]
    cycles: float
    tick_s: float
    least_Hz: float

    def needed_s(self, task: str) -> float:
        """First tick, counted from a task's start, at which it has surely ended."""
        return math.ceil(self.ended_s[task] / self.tick_s - 1e-9) * self.tick_s

    @property
    def least_MHz(self) -> float:
        """The slowest clock, rounded up to a tenth."""
        return math.ceil(self.least_Hz / 1e5) / 10

    @property
    def in_time(self) -> bool:
        return all(ended <= self.release_s[task] for task, ended in self.ended_s.items())

    def check(self, lighter: Callable[[], str] = str) -> None:
        """Refuse a release before a task's end; ``lighter`` finds a law that fits."""
        other = "" if self.in_time else lighter()
        other = f"Use --controller {other}, which fits; or: " if other else ""
        for task, ended in self.ended_s.items():
            if ended <= self.release_s[task]:
                continue
            part = f"{self.board.name} ({self.board.title})"
            assumed = f"{self.cycles:g} cycles per instruction, {self.board.clock_Hz / 1e6:g} MHz"
            if math.isinf(ended):
                raise UserError(
                    f"{self.device} does not fit on {part}: its tasks take all of its time "
                    f"at {assumed}; they need {self.least_MHz:g} MHz.",
                    f"{other}Use a faster board, a lower rate or a shorter horizon.",
                )
            raise UserError(
                f"{self.device} does not fit on {part}: its task {task} takes up to "
                f"{self.instructions[task]} instructions and may end {1e3 * ended:.3f} ms after "
                f"its start at {assumed}; it is released after {1e3 * self.release_s[task]:g} ms.",
                f"{other}Write timing.{task}_release_s = {self.needed_s(task):g}, shorten the "
                f"horizon, take a board of {self.least_MHz:g} MHz, or give --cycles as measured.",
            )


def lighter_law(device: Device, board: Board, cycles: float | None = None) -> str:
    """Of the laws lighter than a device's, the one with the least error that is in time."""
    own = [law.name for law in device.laws]
    for name in LIGHTER[own[0] in LIGHTER :] if len(own) == 1 else ():
        try:
            times = task_times(load_device(device.given[0], name), board, cycles)
        except UserError:  # the law asks for what the device has not
            continue
        if times.in_time:
            return name
    return ""


def task_times(device: Device, board: Board, cycles: float | None = None) -> TaskTimes:
    """Bounds of a device's tasks on a board, and when they end."""
    each = board.processor.cycles_per_instruction if cycles is None else cycles
    if not (math.isfinite(each) and each > 0):
        raise UserError(f"--cycles {each:g} is not above 0.", "Give cycles per instruction.")
    if not board.clock_Hz:
        clocked = ", ".join(b.name for b in BOARDS.values() if b.clock_Hz)
        raise UserError(
            f"{board.name} ({board.title}) has no clock in the table of boards.",
            f"Choose a board with one: {clocked}.",
        )
    instructions = task_bounds(device, board.processor)
    system = device.system
    tick = system.base_period_s
    release = {t.name: t.release_ticks * tick for t in system.tasks}

    def ends(clock_Hz: float) -> dict[str, float]:
        busy = {n: x * each / clock_Hz for n, x in instructions.items()}
        return {t.name: _end(t, system.tasks, busy, tick) for t in system.tasks}

    least, enough = 1.0, 1e12
    while enough > least * (1 + 1e-4):
        middle = math.sqrt(least * enough)
        fits = all(end <= release[n] for n, end in ends(middle).items())
        least, enough = (least, middle) if fits else (middle, enough)
    ended = ends(board.clock_Hz)
    return TaskTimes(device.name, board, instructions, ended, release, each, tick, enough)


def _end(task: Task, tasks: tuple[Task, ...], busy: dict[str, float], tick_s: float) -> float:
    # Response time under fixed priorities: tasks as fast or faster run first, as often as they can.
    others = [t for t in tasks if t is not task and t.every <= task.every]
    end = busy[task.name] + sum(busy[t.name] for t in others)
    while True:
        more = busy[task.name] + sum(
            math.ceil(end / (t.every * tick_s) - 1e-9) * busy[t.name] for t in others
        )
        if more > task.every * tick_s * MOST_LOAD:
            return math.inf
        if more <= end + 1e-12:
            return end
        end = more


def task_bounds(device: Device, processor: Processor) -> dict[str, int]:
    """Largest number of instructions of each task of a device, f32, from the object code."""
    renderer = Renderer(device.system, FORMATS["f32"], "-", "-", device.name)
    prefix, gcc = renderer.prefix, find_compiler(*processor.toolchain.gcc)
    found = {}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        files = renderer.own_files() | {"bare.ld": renderer.render("bench/bare.ld.j2")}
        files |= {path.name: path.read_text(encoding="utf-8") for path in renderer.fmt.sources()}
        files.pop("main.c", None)
        write_texts(folder, files)
        # The checksum of the coefficients is the one loop that no Program states: a pass a word.
        source, wiring = "", f"{prefix}.c"
        ranges = {CHECKSUM: _lines(files[wiring], "offsetof(", "sum >> 15")}
        words = sum(p.size for b in device.system.blocks.values() for p in b.coefficients)
        loops = [LoopBound("checksum", CHECKSUM, 1, words)]
        for name, emitted in renderer.emitted.items():
            own = getattr(emitted, "loops", [])
            if own:
                source = f"{prefix}_{name}.c"
                loops += own
                ranges |= loop_lines(files[source], own)
        elf = folder / "tasks.elf"
        keep = [f"-Wl,-u,{prefix}_{t.name}_step" for t in device.system.tasks]
        command = [
            *(gcc, *processor.flags, *EXACT_FLAGS, *SECTION_FLAGS, "-g", f"-I{folder}"),
            *(str(folder / n) for n in files if n.endswith(".c")),
            *(*BARE_LINK, "--specs=nosys.specs", *keep, f"-T{folder / 'bare.ld'}", "-o", str(elf)),
        ]
        run_tool(command, failed="the compiler refuses the device")
        for task in device.system.tasks:
            bound = step_bound(
                elf,
                f"{prefix}_{task.name}_step",
                source,
                ranges,
                loops,
                elsewhere={CHECKSUM: wiring},
            )
            found[task.name] = bound.instructions
    return found


def _lines(text: str, first: str, last: str) -> tuple[int, int]:
    # Of the loop whose head and last statement hold these.
    lines = text.splitlines()
    heads = [i for i, x in enumerate(lines, 1) if "for (" in x and first in x]
    if len(heads) != 1:
        return 0, 0
    return heads[0], next(i for i, x in enumerate(lines, 1) if i > heads[0] and last in x)
