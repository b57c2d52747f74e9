"""Object-code inspection: no double in f32, no libm, no heap, a bounded stack.

On the host the emitted example program is run too: it must compare, and agree.
"""

from __future__ import annotations

import platform
import re
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from esea_gen.board.firmware import DOUBLE_HELPER, compile_objects, double_arithmetic, symbols
from esea_gen.board.stack import deepest_stack
from esea_gen.device import Device
from esea_gen.emit.build import render_device
from esea_gen.emit.formats import FORMATS
from esea_gen.errors import UserError, nearest
from esea_gen.hostlib.compiler import (
    compiler,
    compiler_version,
    find_compiler,
    run_tool,
    write_texts,
)
from esea_gen.targets import CONTROL_FLAGS, PROCESSORS, Processor

# Single-precision helpers of a processor without an FPU: the compiler's, not libm's.
_SOFT_SINGLE = re.compile(
    r"__aeabi_(f(add|sub|rsub|mul|div)|c?fr?cmp\w+|f2u?[il]z|u?[il]2f|fcmp\w+)"
)
_LIBM = re.compile(r"(pow|exp|log|tanh|sqrt|fmin|fmax|fabs)")
_HEAP = frozenset({"malloc", "calloc", "realloc", "free", "aligned_alloc", "sbrk", "_sbrk"})
_STDIO = re.compile(
    r"_*(v?f?s?n?printf(_chk)?|puts|putchar|fopen|fwrite|fputc|fputs|stderr|stdout)"
)

# Double arithmetic in a disassembly's mnemonics.
_ARM_DOUBLE = re.compile(r"\bv\w+(\.\w+)*\.f64\b[^\n]*")
_X86_DOUBLE = re.compile(
    r"\bv?((add|sub|mul|div|sqrt|min|max|u?comi|cmp|round|hadd)\w*[sp]d|cvt\w*[sp]d\w*"
    r"|f(ld|st|add|sub|mul|div|ild|ist)\w*)\b[^\n]*"
)
_A64_DOUBLE = re.compile(r"\bf\w+\s+[^\n]*\bd\d+[^\n]*")

_HOST_DOUBLE = _A64_DOUBLE if platform.machine() in ("aarch64", "arm64") else _X86_DOUBLE

# Of 8 kB on the smallest board, of which the rest of the firmware has taken 1.8 kB at most.  A
# device with torque control wires 20 Blocks in its sensing task; a program's parts call each other,
# and its inputs are wide.
CONTROL_STACK_BYTES = 384
PROGRAM_STACK_BYTES = 448

TARGETS = {p.name: p for p in PROCESSORS.values() if p.stack_limit_bytes is not None}


@dataclass(frozen=True)
class GateReport:
    device: str
    real: str
    target: str
    compiler: str
    problems: tuple[str, ...]
    stack_bytes: dict[str, int]
    stack_limit_bytes: int

    @property
    def passed(self) -> bool:
        return not self.problems

    def to_dict(self) -> dict[str, Any]:
        return asdict(self) | {"passed": self.passed}


def find_target(name: str) -> Processor:
    if name not in TARGETS:
        listed = "; ".join(f"{t.name} ({t.full_title})" for t in TARGETS.values())
        near = nearest(name, TARGETS)
        raise UserError(f"There is no target '{name}'.", f"{near}Targets: {listed}.")
    return TARGETS[name]


def _stack_limit(device: Device, target: Processor) -> int:
    assert target.stack_limit_bytes is not None
    programs = any(b.kind == "program" for b in device.system.kinds)
    more = CONTROL_STACK_BYTES if device.system.latches else 0
    return target.stack_limit_bytes + more + (PROGRAM_STACK_BYTES if programs else 0)


def _unwanted(objects: Sequence[Path], target: Processor, libm: bool) -> Iterator[str]:
    tools = target.toolchain
    for item in double_arithmetic(objects, tools):
        file, symbol = item.split(": ")
        if not target.fpu and _SOFT_SINGLE.fullmatch(symbol):
            continue
        if libm and (_LIBM.fullmatch(symbol) or symbol.startswith("__aeabi_")):
            continue
        if symbol in _HEAP:
            rule = "heap"
        elif _STDIO.fullmatch(symbol):
            rule = "input and output"
        elif not libm and DOUBLE_HELPER.fullmatch(symbol):
            rule = "double arithmetic"
        else:
            rule = "a library function"
        yield f"{file}: asks for {symbol}: {rule}"


def _symbols(objects: Sequence[Path], target: Processor) -> Iterator[str]:
    for file, symbol, kind, *_ in symbols(objects, target.toolchain):
        if kind in "DdBbCGgSs":
            yield f"{file}: {symbol}: writable data"
        if kind in "TDBRCVWGSi" and not symbol.startswith("esea_"):
            yield f"{file}: {symbol}: an export without the prefix esea_"


def _instructions(objects: Sequence[Path], target: Processor) -> Iterator[str]:
    tool = find_compiler(*target.toolchain.tool("objdump"))
    double = _HOST_DOUBLE if target.name == "host" else _ARM_DOUBLE
    for path in objects:
        done = run_tool([tool, "-d", "--no-show-raw-insn", path], failed="objdump failed")
        text = "\n".join(x for x in done.stdout.splitlines() if ":\t" in x)  # without the path
        hits = [" ".join(m.group().split()) for m in double.finditer(text)]
        if hits:
            yield f"{path.name}: {len(hits)} double instructions, first '{hits[0]}'"


def _stack(
    device: Device, folder: Path, target: Processor, bounded: bool
) -> tuple[dict[str, int], list[str]]:
    graphs = sorted(folder.glob("*.ci"))
    found = []
    for path in sorted(folder.glob("*.su")):
        for line in path.read_text(encoding="utf-8").splitlines():
            place, _, kind = line.split("\t")
            if "dynamic" in kind:
                found.append(f"{place}: stack use depends on data ({kind})")
    for path in graphs:
        if "__indirect_call" in path.read_text(encoding="utf-8"):
            found.append(f"{path.stem}.o: calls through a pointer: stack use unknown")
    used = {}
    for task in device.system.tasks:
        try:
            used[task.name] = deepest_stack(graphs, f"esea_{device.name}_{task.name}_step")
        except ValueError as error:
            found.append(f"task {task.name}: {error}")
            continue
        limit = _stack_limit(device, target)
        if bounded and used[task.name] > limit:
            found.append(
                f"task {task.name}: {used[task.name]} bytes of stack, above the limit of {limit}"
            )
    return used, found


def check_objects(
    device: Device, target: str, real: str = "f32", files: Mapping[str, str] | None = None
) -> GateReport:
    """Compile a device's C for a target and hold its object files against the rules."""
    chosen = find_target(target)
    gcc = find_compiler(*chosen.toolchain.gcc)
    texts = dict(files if files is not None else render_device(device, [real])[0].files)
    single = not FORMATS[real].needs_libm
    with tempfile.TemporaryDirectory(prefix="esea-gates-") as scratch:
        folder = Path(scratch)
        write_texts(folder, {n: t for n, t in texts.items() if "/" not in n})
        objects = []
        measured = [*CONTROL_FLAGS, *chosen.flags, "-fstack-usage", "-fcallgraph-info=su"]
        for name in sorted(n for n in texts if n.endswith(".c") and "/" not in n):
            if name == "main.c":
                continue
            item = folder / f"{Path(name).stem}.o"
            command = [gcc, *measured, "-c", name, "-o", item.name]
            run_tool(command, folder, f"{name} does not compile for {target}")
            objects.append(item)
        problems = [*_unwanted(objects, chosen, not single), *_symbols(objects, chosen)]
        problems += _instructions(objects, chosen) if single else ()
        used, stack_problems = _stack(device, folder, chosen, single)
        if chosen.name == "host" and "main.c" in texts:
            problems += run_example(texts, real).problems
    return GateReport(
        device.name,
        real,
        target,
        compiler_version(gcc),
        tuple(problems + stack_problems),
        used,
        _stack_limit(device, chosen),
    )


_SAMPLES = re.compile(r"^(\d+) of (\d+) samples agree$", re.M)
_LATCH = re.compile(r"^latch: (\d+) of (\d+) hold$", re.M)
_LONGEST_S = 60.0


@dataclass(frozen=True)
class ExampleRun:
    agree: int
    checked: int
    held: int
    asked: int
    problems: tuple[str, ...]
    said: str


def run_example(files: Mapping[str, str], real: str, quick: bool = False) -> ExampleRun:
    """Compile an output folder's C into its example program, by its header's line, and run it."""
    fmt = FORMATS[real]
    cc = compiler()
    flags = ["-std=c99", "-O0" if quick else "-O2", *fmt.compiler_flags.split()]
    with tempfile.TemporaryDirectory(prefix="esea-example-") as scratch:
        folder = Path(scratch)
        here = {n: t for n, t in files.items() if "/" not in n}
        write_texts(folder, here)
        sources = sorted(n for n in here if n.endswith(".c"))
        parts = compile_objects(folder, cc, flags, sources) if quick else sources
        command = [*cc, *flags, *map(str, parts), "-o", "example", *fmt.libraries.split()]
        made = run_tool(command, folder)
        if made.returncode != 0:
            return ExampleRun(0, 0, 0, 0, ("main.c: the example does not compile",), made.stderr)
        try:
            done = run_tool([folder / "example"], folder, timeout=_LONGEST_S)
        except subprocess.TimeoutExpired:
            return ExampleRun(0, 0, 0, 0, ("main.c: the example does not end",), "")
    return judged(done.stdout, done.returncode)


def judged(said: str, code: int) -> ExampleRun:
    agree, checked = _count(_SAMPLES, said)
    held, asked = _count(_LATCH, said)
    problems = []
    if checked == 0:
        problems.append("main.c: the example compares nothing")
    if agree != checked:
        problems.append(f"main.c: {agree} of {checked} samples of the example agree")
    if held != asked:
        problems.append(f"main.c: {held} of {asked} promises of the latch hold in the example")
    if code != 0:
        problems.append(f"main.c: the example's exit code is {code}")
    return ExampleRun(agree, checked, held, asked, tuple(problems), said)


def _count(pattern: re.Pattern[str], said: str) -> tuple[int, int]:
    found = pattern.search(said)
    return (int(found[1]), int(found[2])) if found else (0, 0)
