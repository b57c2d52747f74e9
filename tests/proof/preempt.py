"""The base tick forced into a run of a slower task, at every instruction of it, in the emulator.

The image is the one that ships; its timer is stopped and every tick made pending from outside.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.board.firmware import FirmwareImage
from esea_gen.board.gdb import addresses
from esea_gen.device import Device
from esea_gen.hostlib import compile_device
from esea_gen.hostlib.compiler import find_compiler, run_tool
from esea_gen.language.system import Task
from esea_gen.model.sensing import zeros_missing
from esea_gen.targets import ARM_GCC, find_board, firmware_folder
from tests.proof.steered import SteeredProcessor

Array = npt.NDArray[Any]

# Of the Cortex-M: interrupt control, and which handlers are active.
_ICSR, _PENDSTSET = 0xE000ED04, 1 << 26
_SYST_CSR = 0xE000E010
_SHCSR, _PENDSV_ACTIVE, _SYSTICK_ACTIVE = 0xE000ED24, 1 << 10, 1 << 11


def _port_place(member: str) -> int:
    """Byte at which a member of the port's struct begins: each is one word of the Cortex-M."""
    header = (firmware_folder() / "port" / "port.h").read_text(encoding="utf-8")
    declared = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL).split("} esea_port_t;")[0]
    members = declared.rsplit("typedef struct {", 1)[1].split(";")[:-1]
    names = [re.findall(r"\(\*(\w+)\)\(|(\w+)$", text.strip())[0] for text in members]
    return 4 * ["".join(name) for name in names].index(member)


@dataclass(frozen=True)
class Preemption:
    """One forced interruption."""

    where: int
    tick: int
    late: bool


@dataclass(frozen=True)
class PreemptionResult:
    """What forced interruptions did."""

    preemptions: tuple[Preemption, ...]
    instructions: int
    not_reached: tuple[int, ...]
    ticks: int
    differences: tuple[tuple[str, int], ...]


def instructions_of(image: FirmwareImage, functions: Sequence[str]) -> list[int]:
    """Addresses of every instruction of some functions, by the disassembler."""
    command = [find_compiler(*ARM_GCC.tool("objdump")), "-d", "--no-show-raw-insn", str(image.elf)]
    said = run_tool(command, failed="objdump failed").stdout
    found: list[int] = []
    name = ""
    for line in said.splitlines():
        head = re.match(r"[0-9a-f]+ <(.+)>:$", line)
        name = head.group(1) if head else name
        row = re.match(r"\s*([0-9a-f]+):\s+(\S+)", line)
        if row and name in functions and not row.group(2).startswith("."):
            found.append(int(row.group(1), 16))
    return found


def slower_task(device: Device) -> Task:
    """The one task that is slower than the tick."""
    (task,) = [t for t in device.system.tasks if t.every > 1]
    return task


class _Rig:
    # The image with its host's twin, moved on from one start of the fast task to the next.

    def __init__(
        self,
        held: SteeredProcessor,
        device: Device,
        image: FirmwareImage,
        inputs: Mapping[str, Mapping[str, Array]],
    ) -> None:
        self.held, self.system = held, device.system
        self.fast, self.slow = device.system.tasks[0], slower_task(device)
        prefix = f"esea_{device.name}"
        at = addresses(image)
        self.entry = {t.name: at[f"{prefix}_{t.name}_step"] for t in self.system.tasks}
        library = compile_device(device, image.real)
        self.board = library.board(zeros_missing(library.system))
        self.ffi = self.board.library.ffi
        self.rows: dict[str, Array] = {}
        for task in self.system.tasks:
            runner = library.task(task.name)
            given = inputs[task.name]
            self.rows[task.name] = (
                runner.pack(given) if "" not in given else np.zeros(len(given[""]), "V4")
            )
        self.idle, self.port = at["esea_app_poll"], at["port"]
        board = find_board(image.board)
        self.scratch = board.ram + board.ram_bytes - 16
        self.inputs = inputs
        self.out_at: dict[str, int] = {}
        self.differences: list[tuple[str, int]] = []
        self.expected: dict[str, tuple[int, bytes]] = {}

    def start(self) -> int:
        """Put both into the same initial state, at the target's first tick; that tick."""
        self.held.hold_at(self.idle)
        self.held.run()
        # From here on the clock does not count: no tick comes by itself, and none seems lost.
        self.held.store(_SYST_CSR, 0, self.scratch)
        self.held.write(self.port + _port_place("base_ticks"), bytes(4))
        for entry in self.entry.values():
            self.held.hold_at(entry)
        self.tick()
        coeffs_at, state_at = self.held.register(0), self.held.register(1)
        self.state_at = state_at
        tick = self.watch("tick")
        self.board.release(tick)
        self.held.write(coeffs_at, bytes(self.board.memory["coeffs"]))
        self.held.write(state_at, bytes(self.board.memory["state"]))
        return tick

    def watch(self, name: str) -> int:
        """A word of the state's watch."""
        prefix = self.board.library.prefix
        at = int(self.ffi.offsetof(f"{prefix}_state_t", "watch"))
        at += int(self.ffi.offsetof(f"{prefix}_watch_t", name))
        return self.held.read_word(self.state_at + at)

    def ended(self) -> bool:
        """Whether the slower task's run has ended, by its own marks."""
        name = self.slow.name
        ended = self.watch(f"{name}_ended") == self.watch(f"{name}_started")
        return ended and self.watch(f"{name}_running") == 0

    def tick(self) -> None:
        """Let the tick come, here, and run to the entry of the fast step."""
        here = self.held.at
        # From a breakpoint that stands it would first execute the instruction.
        self.held.no_more_at(here)
        self.held.store(_ICSR, _PENDSTSET, self.scratch)
        at = self.held.run()
        if here in (self.idle, *self.entry.values()):
            self.held.hold_at(here)
        while at == self.idle:  # a pending tick of before, or the loop once more
            at = self.held.run()
        assert at == self.entry[self.fast.name], f"{at:#x}"
        assert self.held.read_word(_SHCSR) & _SYSTICK_ACTIVE

    def give(self, task: Task, run: int) -> None:
        """At the entry of a step: what it is given."""
        self.out_at[task.name] = self.held.register(3)
        self.held.write(self.held.register(2), self.rows[task.name][run].tobytes())

    def host(self, task: Task, run: int, tick: int) -> None:
        """The same run by the host's library."""
        given = {n: a[run] for n, a in self.inputs[task.name].items() if n}
        out = self.board.raw_step(task.name, given)
        self.expected[task.name] = (tick, bytes(self.ffi.buffer(out)))

    def compare(self, task: Task) -> None:
        """A run that has ended: every bit of its outputs."""
        if task.name not in self.expected:
            return
        tick, wanted = self.expected.pop(task.name)
        if self.held.read(self.out_at[task.name], len(wanted)) != wanted:
            self.differences.append((task.name, tick))

    def to(self, target: int | None) -> int:
        """From the entry of the slower step to an instruction of it, or to where nothing runs."""
        if target is None or target == self.entry[self.slow.name]:
            return self.held.run() if target is None else target
        self.held.hold_at(target)
        at = self.held.run()
        self.held.no_more_at(target)
        return at

    def same_state(self, tick: int) -> None:
        """Every bit of the whole state, where no run is under way."""
        wanted = bytes(self.board.memory["state"])
        if self.held.read(self.state_at, len(wanted)) != wanted:
            self.differences.append(("state", tick))


def preempt_everywhere(
    device: Device,
    image: FirmwareImage,
    inputs: Mapping[str, Mapping[str, Array]],
    instructions: Sequence[int],
    each: int = 1,
    tries: int = 3,
    progress: Callable[[int, int], None] | None = None,
) -> PreemptionResult:
    """Force the tick before each of some instructions of the slower task, one in a run."""
    done: list[Preemption] = []
    missing: dict[int, int] = {}
    waiting = list(instructions)
    with SteeredProcessor(image) as held:
        rig = _Rig(held, device, image, inputs)
        first = rig.start()
        fast, slow = rig.fast, rig.slow
        open_run: tuple[int, int] | None = None
        tick, k, runs = first, 0, 0
        last = min(len(rig.rows[fast.name]), len(rig.rows[slow.name]) * slow.every)
        while k < last and (waiting or open_run):
            # Here: entry of the fast step of this tick; both sides have released it.
            rig.give(fast, k)
            rig.host(fast, k, tick)
            at = held.run()
            if open_run is not None and at == rig.entry[slow.name]:
                at = held.run()  # interrupted before its first instruction, it passes by again
            rig.compare(fast)
            if open_run is not None:  # it went on when the tick had ended
                rig.host(slow, *open_run)
                rig.compare(slow)
                open_run = None
            if at == rig.entry[slow.name]:
                rig.give(slow, k // slow.every)
                runs += 1
                target = waiting.pop() if waiting and runs % each == 0 else None
                at = rig.to(target)
                reached = at == target
                if reached and not rig.ended():
                    open_run = (k // slow.every, tick)
                else:  # its last instructions come after its end
                    rig.host(slow, k // slow.every, tick)
                    rig.compare(slow)
                if target is not None and reached:
                    due = (k + 1 - slow.phase) % slow.every >= slow.release_ticks
                    done.append(Preemption(target, tick + 1, due and open_run is not None))
                elif target is not None:
                    missing[target] = missing.get(target, 0) + 1
                    if missing[target] < tries:
                        waiting.insert(0, target)
            k, tick = k + 1, tick + 1
            if open_run is None:
                rig.same_state(tick)
            rig.tick()
            rig.board.release(tick)
            if progress is not None and k % 100 == 0:
                progress(len(done), len(instructions))
        came_by = {p.where for p in done}
    return PreemptionResult(
        tuple(done),
        len(instructions),
        tuple(a for a in instructions if a not in came_by),
        k,
        tuple(rig.differences),
    )
