"""Build a firmware image: the generated C, unmodified, below a hand-written application."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from esea_gen.device import Device
from esea_gen.emit.build import render_device
from esea_gen.emit.dialect import render_dialect
from esea_gen.emit.formats import FORMATS
from esea_gen.errors import UserError
from esea_gen.hostlib import find_compiler
from esea_gen.targets import (
    APP_FLAGS,
    ARM_GCC,
    CONTROL_FLAGS,
    SECTION_FLAGS,
    Toolchain,
    find_board,
    firmware_folder,
)
from esea_gen.verify.stack import CallGraph, deepest_stack, stack_by_priority

# What control code may ask of the compiler's own library: moving memory and dividing integers.
_ALLOWED = re.compile(
    r"mem(cpy|move|set)|__aeabi_(mem\w+|u?idiv(mod)?|u?ldivmod|lmul|ll?s[lr]|lasr)"
    r"|__(asan|ubsan)_\w+"
)
# Helpers of double arithmetic, in a linked image: __aeabi_dadd, __aeabi_f2d, __adddf3 ...
_DOUBLE = re.compile(r"__aeabi_(d\w+|cd\w+|[a-z]+2d)|__\w*df\w*")


@dataclass(frozen=True)
class FirmwareImage:
    """A built image.

    flash_bytes: code, constants and initial data.
    ram_bytes: static data, without the stack.
    stack_bytes: size of the stack that the linker script reserves; 0 on the host.
    step_stack_bytes: largest stack use below the entry of each task's step, by the compiler's call
        graph.
    stack_bounds_bytes: largest stack use of each priority, its interrupt's frame included; their
        sum bounds the stack, whoever interrupts whom. Empty on the host.
    compiler: first line of the compiler's version.
    """

    elf: Path
    board: str
    real: str
    device: str
    content_hash: str
    flash_bytes: int
    ram_bytes: int
    stack_bytes: int
    step_stack_bytes: dict[str, int]
    stack_bounds_bytes: dict[str, int]
    compiler: str

    def to_dict(self) -> dict[str, Any]:
        """The figures, for a JSON report; the image by its file name."""
        return asdict(self) | {"elf": self.elf.name}


def double_arithmetic(objects: Sequence[Path], toolchain: Toolchain = ARM_GCC) -> list[str]:
    """What float-only objects ask for and must not: double arithmetic, libm, heap, stdio.

    return: ``"esea_elbow_sensor.o: __aeabi_dmul"``; empty when the objects need only each other.
    """
    tool = find_compiler(*toolchain.tool("nm"))
    defined, wanted = set(), []
    for path in objects:
        done = subprocess.run([tool, "-P", path], capture_output=True, text=True, check=True)
        for line in done.stdout.splitlines():
            symbol, kind = line.split()[:2]
            if kind in "Uw":
                wanted.append((path.name, symbol))
            else:
                defined.add(symbol)
    return [f"{o}: {s}" for o, s in wanted if s not in defined and not _ALLOWED.fullmatch(s)]


def double_helpers(elf: Path, toolchain: Toolchain = ARM_GCC) -> list[str]:
    """Helpers of double arithmetic that have been linked into an image."""
    tool = find_compiler(*toolchain.tool("nm"))
    done = subprocess.run([tool, "-P", elf], capture_output=True, text=True, check=True)
    names = {line.split()[0] for line in done.stdout.splitlines()}
    return sorted(n for n in names if _DOUBLE.fullmatch(n))


def _run(command: Sequence[str | Path], folder: Path, what: str) -> None:
    done = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{what} does not build:\n{done.stderr}")


def _sections(elf: Path, size: str) -> dict[str, int]:
    done = subprocess.run([size, "-A", elf], capture_output=True, text=True, check=True)
    rows = (line.split() for line in done.stdout.splitlines())
    return {r[0]: int(r[1]) for r in rows if len(r) == 3 and r[0].startswith(".")}


@cache
def _version(compiler: str) -> str:
    done = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[0]


def build_firmware(
    device: Device,
    board: str,
    out: Path,
    control: Mapping[str, str] | None = None,
    drivers: str | None = None,
) -> FirmwareImage:
    """Build a device's firmware image.

    board: what it runs on; it also says the number format of the control code.
    control: files of the format's folder to compile in place of the device's own; tests alter one
        to prove that a comparison finds it.
    drivers: text of a ``drivers.c`` in place of the board's.
    """
    chosen = find_board(board)
    toolchain = chosen.processor.toolchain
    gcc = find_compiler(*toolchain.gcc)
    prefix = f"esea_{device.name}"
    real = chosen.real
    files = dict(control if control is not None else render_device(device, [real])[0].files)
    dialect = render_dialect(device).files
    with tempfile.TemporaryDirectory(prefix="esea-firmware-") as scratch:
        folder = Path(scratch)
        for sub, texts in ((real, files), ("dialect", dialect)):
            for name, text in texts.items():
                target = folder / sub / name
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(text, encoding="utf-8")
        for part in ("app", "port", f"boards/{board}"):
            shutil.copytree(firmware_folder() / part, folder / part)

        own_drivers = folder / f"boards/{board}/drivers.c"
        if drivers is not None:
            own_drivers.write_text(drivers, encoding="utf-8")
        bare = (folder / f"boards/{board}/link.ld").is_file()

        common = [gcc, *chosen.compile_flags, *SECTION_FLAGS, "-c"]
        sources = sorted(n for n in files if n.endswith(".c") and n != "main.c")
        control_objects = []
        for name in sources:
            item = f"{real}/{name.removesuffix('.c')}.o"
            measured = (*CONTROL_FLAGS, "-fcallgraph-info=su")
            _run([*common, *measured, f"{real}/{name}", "-o", item], folder, f"control file {name}")
            control_objects.append(folder / item)
        found = double_arithmetic(control_objects, toolchain) if chosen.machine else []
        if found:
            raise RuntimeError(f"the control code is not {real} only: " + ", ".join(found))

        includes = ["-isystem", "dialect/mavlink", "-Idialect", f"-I{real}", "-Iport", "-Iapp"]
        header = f'-DESEA_LINK_HEADER="{FORMATS[real].link_header(prefix)}"'
        script = f"boards/{board}/link.ld"
        app_objects = []
        parts = [p for sub in ("app", f"boards/{board}") for p in sorted((folder / sub).glob("*.c"))]
        names = [p.relative_to(folder).with_suffix("").as_posix() for p in parts]
        for name in (*names, *(["port/cortex_m"] if bare else [])):
            flags = (*APP_FLAGS, *chosen.app_flags, *includes, header)
            flags += ("-fcallgraph-info=su",) if bare else ()
            _run([*common, *flags, f"{name}.c", "-o", f"{name}.o"], folder, f"{name}.c")
            app_objects.append(f"{name}.o")
        link = [*chosen.link, *(["-T", script] if bare else [])]
        built = folder / f"{prefix}_{board}.elf"
        objects: list[str | Path] = [*app_objects, *control_objects]
        _run([gcc, *chosen.compile_flags, *objects, *link, "-o", built], folder, "the image")
        helpers = double_helpers(built, toolchain) if chosen.machine else []
        if helpers:
            raise RuntimeError("the image holds double arithmetic: " + ", ".join(helpers))

        sections = _sections(built, find_compiler(*toolchain.tool("size")))
        graphs = sorted((folder / real).glob("*.ci"))
        step_stack = {
            t.name: deepest_stack(graphs, f"{prefix}_{t.name}_step") for t in device.system.tasks
        }
        steps: dict[bool, list[str]] = {True: [], False: []}
        for t in device.system.tasks:
            steps[t.every == 1].append(f"{prefix}_{t.name}_step")
        bounds = _stack_bounds(folder, graphs, steps, chosen.processor.fpu) if bare else {}
        if sum(bounds.values()) > sections.get(".stack", 0) and bare:
            raise RuntimeError(
                f"the stack may need {sum(bounds.values())} bytes ({bounds}), "
                f"the image has {sections.get('.stack', 0)}"
            )
        target = _place(built, out)
    return FirmwareImage(
        elf=target,
        board=board,
        real=real,
        device=device.name,
        content_hash=_hash_in(files[f"{prefix}.h"]),
        flash_bytes=sections.get(".text", 0) + sections.get(".data", 0),
        ram_bytes=sections.get(".data", 0) + sections.get(".bss", 0),
        stack_bytes=sections.get(".stack", 0),
        step_stack_bytes=step_stack,
        stack_bounds_bytes=bounds,
        compiler=_version(gcc),
    )


def _stack_bounds(
    folder: Path, control: Sequence[Path], steps: Mapping[bool, Sequence[str]], fpu: bool
) -> dict[str, int]:
    others = [p for sub in ("app", "port", "boards") for p in (folder / sub).rglob("*.ci")]
    graph = CallGraph.read([*control, *others])
    return stack_by_priority(graph, steps[True], steps[False], fpu)


def _hash_in(header: str) -> str:
    found = re.search(r'_CONTENT_HASH "(\w+)"', header)
    return found.group(1) if found else ""


def _place(built: Path, out: Path) -> Path:
    target = out / built.name
    try:
        out.mkdir(parents=True, exist_ok=True)
        # Copy beside the target, then rename: a reader sees a whole image or none.
        partial = out / f".{built.name}.tmp"
        shutil.copyfile(built, partial)
        partial.chmod(0o755)
        partial.replace(target)
    except OSError as error:
        raise UserError(
            f"{out}: cannot be written ({error.strerror or error}).", "Give another --out folder."
        ) from error
    return target
