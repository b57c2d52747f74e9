"""Build a firmware image: the generated C, unmodified, below a hand-written application."""

from __future__ import annotations

import hashlib
import math
import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from esea_gen.board.stack import CallGraph, deepest_stack, stack_by_priority
from esea_gen.cache import cache_folder
from esea_gen.device import Device
from esea_gen.emit.build import render_device
from esea_gen.emit.dialect import render_dialect
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.roles import sensing_tasks
from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.hostlib.compiler import (
    compiler,
    compiler_version,
    find_compiler,
    is_gcc,
    run_tool,
    write_texts,
)
from esea_gen.model.sensing import measures_counts
from esea_gen.targets import (
    APP_FLAGS,
    ARM_GCC,
    CONTROL_FLAGS,
    HOST_GCC,
    SECTION_FLAGS,
    Board,
    Toolchain,
    find_board,
    firmware_boards,
    firmware_folder,
)

# What control code may ask of the compiler's own library: moving memory and dividing integers.
_ALLOWED = re.compile(
    r"mem(cpy|move|set)|__aeabi_(mem\w+|u?idiv(mod)?|u?ldivmod|lmul|ll?s[lr]|lasr)"
    r"|__(asan|ubsan)_\w+"
)
# Helpers of double arithmetic, in a linked image: __aeabi_dadd, __aeabi_f2d, __adddf3 ...
DOUBLE_HELPER = re.compile(r"__aeabi_(d\w+|cd\w+|[a-z]+2d)|__\w*df\w*")


@dataclass(frozen=True)
class FirmwareImage:
    """A built image."""

    elf: Path
    board: str
    real: str
    device: str
    content_hash: str
    flash_bytes: int
    ram_bytes: int
    noinit_bytes: int
    stack_bytes: int
    step_stack_bytes: dict[str, int]
    stack_bounds_bytes: dict[str, int]
    compiler: str

    def to_dict(self) -> dict[str, Any]:
        """The figures, for a JSON report; the image by its file name."""
        return asdict(self) | {"elf": self.elf.name}


class Symbol(NamedTuple):
    file: str
    name: str
    kind: str  # a letter, as ``nm`` has it
    address: int = 0
    size: int = 0


def symbols(objects: Sequence[Path], toolchain: Toolchain = ARM_GCC) -> list[Symbol]:
    """Symbols of objects or an image, by one call of ``nm`` for all."""
    tool = find_compiler(*toolchain.tool("nm"))
    done = run_tool([tool, "-A", "-P", *objects], failed="nm failed")
    found = []
    for line in done.stdout.splitlines():
        file, _, rest = line.rpartition(": ")
        name, kind, *numbers = rest.split()
        found.append(Symbol(Path(file).name, name, kind, *(int(n, 16) for n in numbers)))
    return found


def double_arithmetic(objects: Sequence[Path], toolchain: Toolchain = ARM_GCC) -> list[str]:
    """Forbidden symbols in float-only objects: double arithmetic, libm, heap, stdio."""
    found = symbols(objects, toolchain)
    defined = {s.name for s in found if s.kind not in "Uw"}
    wanted = [s for s in found if s.name not in defined and not _ALLOWED.fullmatch(s.name)]
    return [f"{s.file}: {s.name}" for s in wanted]


def double_helpers(elf: Path, toolchain: Toolchain = ARM_GCC) -> list[str]:
    """Helpers of double arithmetic that have been linked into an image."""
    return sorted({s.name for s in symbols([elf], toolchain) if DOUBLE_HELPER.fullmatch(s.name)})


def build_firmware(
    device: Device,
    board: str,
    out: Path,
    control: Mapping[str, str] | None = None,
    drivers: str | None = None,
    needs_Hz: float | None = None,
) -> FirmwareImage:
    """Build a device's firmware image."""
    chosen = find_board(board)
    if drivers is None and measures_counts(device):
        _can_be_read(device, chosen)
    toolchain = chosen.processor.toolchain
    # Sanitizers and what they link with are gcc's.
    sanitized = "-fsanitize" in "".join(chosen.link)
    cc = (find_compiler(*toolchain.gcc),) if sanitized else compiler(toolchain)
    prefix = f"esea_{device.name}"
    real = chosen.real
    files = dict(control if control is not None else render_device(device, [real])[0].files)
    with tempfile.TemporaryDirectory(prefix="esea-firmware-") as scratch:
        folder = Path(scratch)
        texts = {f"{real}/{n}": t for n, t in files.items()}
        texts |= {f"dialect/{n}": t for n, t in render_dialect(device).files.items()}
        for part in ("app", "drivers", "port", chosen.folder):
            shutil.copytree(firmware_folder() / part, folder / part)
        if drivers is not None:
            texts[f"{chosen.folder}/drivers.c"] = drivers
        write_texts(folder, texts)
        sources = sorted(n for n in files if n.endswith(".c") and n != "main.c")
        objects = _compile_control(folder, chosen, cc, [f"{real}/{n}" for n in sources])
        objects += _compile_app(folder, chosen, cc, _defined(device, chosen, needs_Hz), prefix)
        script = f"{chosen.folder}/link.ld"
        bare = (folder / script).is_file()
        link = [*chosen.link, *(["-T", script] if bare else [])]
        built = folder / f"{prefix}_{board}.elf"
        command = [*cc, *chosen.processor.flags, *objects, *link, "-o", built]
        run_tool(command, folder, "the image does not build")
        helpers = double_helpers(built, toolchain) if chosen.machine else []
        if helpers:
            raise RuntimeError("the image holds double arithmetic: " + ", ".join(helpers))
        sections: dict[str, int] = {}
        step_stack: dict[str, int] = {}
        entries = {t: f"{prefix}_{t.name}_step" for t in device.system.tasks}
        if is_gcc(cc):
            size = [find_compiler(*toolchain.tool("size")), "-A", built]
            rows = (x.split() for x in run_tool(size, failed="size failed").stdout.splitlines())
            sections = {r[0]: int(r[1]) for r in rows if len(r) == 3 and r[0].startswith(".")}
            graphs = sorted((folder / real).glob("*.ci"))
            step_stack = {t.name: deepest_stack(graphs, entry) for t, entry in entries.items()}
        bounds: dict[str, int] = {}
        if bare:
            graph = CallGraph.read(sorted(folder.rglob("*.ci")))
            fast = [entries.pop(t) for t in sensing_tasks(device.system)]
            bounds = stack_by_priority(graph, fast, [*entries.values()], chosen.processor.fpu)
        stack_bytes = sections.get(".stack", 0)
        if bare and sum(bounds.values()) > stack_bytes:
            raise UserError(
                f"{device.origin} on {board}: the stack may need {sum(bounds.values())} bytes "
                f"({bounds}), the image has {stack_bytes}.",
                "Ask for less in one task; with a [family] take a member of fewer terms.",
            )
        digest = re.search(r'_CONTENT_HASH "(\w+)"', files[f"{prefix}.h"])
        target = out / built.name
        write_whole(target, built.read_bytes())
        target.chmod(0o755)
    return FirmwareImage(
        elf=target,
        board=board,
        real=real,
        device=device.name,
        content_hash=digest[1] if digest else "",
        flash_bytes=sections.get(".text", 0) + sections.get(".data", 0),
        ram_bytes=sections.get(".data", 0) + sections.get(".bss", 0),
        noinit_bytes=sections.get(".noinit", 0),
        stack_bytes=stack_bytes,
        step_stack_bytes=step_stack,
        stack_bounds_bytes=bounds,
        compiler=compiler_version(*cc),
    )


def _can_be_read(device: Device, board: Board) -> None:
    # The board's encoders send at least the bits that the device counts with.
    numbers = dict(device.quantities())
    for key, most in board.most_bits:
        if key in numbers and numbers[key].value > most:
            others = (b for b in firmware_boards().values() if b.machine and not b.most_bits)
            bare = next(b for b in others if b.real == board.real)
            raise UserError(
                f"{device.origin}: {key} = {numbers[key].value:g} is above {most}, the most "
                f"bits that the encoder drivers of {board.name} read.",
                f"Give {most} or fewer, or a board without drivers: --board {bare.name} emulates "
                "one, whose counts come over the link.",
            )


def _compile_control(
    folder: Path, board: Board, cc: tuple[str, ...], sources: Sequence[str]
) -> list[Path]:
    # Objects of the control code; with call graphs, and nothing in them but its own arithmetic.
    toolchain = board.processor.toolchain
    graphs = ["-fcallgraph-info=su"] if is_gcc(cc) else []
    flags = (*board.compile_flags, *SECTION_FLAGS, *CONTROL_FLAGS, *graphs)
    made = compile_objects(folder, cc, flags, sources)
    foreign = board.processor.toolchain is not HOST_GCC
    found = double_arithmetic(made, toolchain) if foreign and is_gcc(cc) else []
    if found:
        raise RuntimeError(f"the control code is not {board.real} only: " + ", ".join(found))
    return made


def compile_objects(
    folder: Path, cc: tuple[str, ...], flags: Sequence[str], sources: Sequence[str]
) -> list[Path]:
    """Compile the C files of a folder, each once for a given content of it and of all headers."""
    common = hashlib.sha256("\0".join([compiler_version(*cc), *cc, *flags]).encode())
    for header in sorted(folder.rglob("*.h")):
        common.update(f"\0{header.relative_to(folder)}\0".encode() + header.read_bytes())
    made = []
    for name in sources:
        key = common.copy()
        key.update(f"\0{name}\0".encode() + (folder / name).read_bytes())
        kept = cache_folder() / "objects" / key.hexdigest()[:32]
        item = (folder / name).with_suffix(".o")
        made.append(item)
        if kept.with_suffix(".o").is_file():
            for suffix in (".ci", ".o"):
                if kept.with_suffix(suffix).is_file():
                    shutil.copyfile(kept.with_suffix(suffix), item.with_suffix(suffix))
            continue
        run_tool([*cc, *flags, "-c", name, "-o", item], folder, f"{name} does not build")
        for suffix in (".ci", ".o"):  # the object last: where it stands, all does
            if item.with_suffix(suffix).is_file():
                with suppress(UserError):  # a full disk costs time, no image
                    write_whole(kept.with_suffix(suffix), item.with_suffix(suffix).read_bytes())
    return made


def _defined(device: Device, board: Board, needs_Hz: float | None) -> list[str]:
    # Macros that give the hand-written code its device and its clock.
    link_header = FORMATS[board.real].link_header(f"esea_{device.name}")
    bits = int(device.file.encoder.resolution_bits.value)
    defined = [f'-DESEA_LINK_HEADER="{link_header}"', f"-DESEA_ENCODER_BITS={bits}u"]
    defined += [*board.clock_defines, f"-DESEA_NEEDS_HZ={math.ceil(needs_Hz or board.clock_Hz)}u"]
    if device.file.actuator is not None:
        motor = device.file.actuator
        defined.append(f"-DESEA_GEAR_BITS={int(motor.encoder_bits.value)}u")
        most = {"GEAR_RATIO": motor.gear_ratio.value, "MOTOR_MOST_NM": motor.u_max_Nm.value}
        defined += [f"-DESEA_{name}={value!r}f" for name, value in most.items()]
    return defined


def _compile_app(
    folder: Path, board: Board, cc: tuple[str, ...], defined: Sequence[str], prefix: str
) -> list[Path]:
    # Objects of the hand-written code and of what binds it to the device.
    includes = ["-isystem", "dialect/mavlink", "-Idialect", f"-I{board.real}", "-Iport"]
    includes += ["-Iapp", "-Idrivers"]
    bare = (folder / board.folder / "link.ld").is_file()
    named = f'-DESEA_BOARD_NAME="{board.name}"'
    flags = [*board.compile_flags, *SECTION_FLAGS, *APP_FLAGS, *board.app_flags, *includes]
    flags += [*defined, named, *(["-fcallgraph-info=su"] if bare else [])]
    parts = ("app", "drivers", board.folder, *(["port"] if bare else []))
    sources = (p for part in parts for p in sorted((folder / part).glob("*.c")))
    names = [p.relative_to(folder).as_posix() for p in sources] + [f"dialect/{prefix}_link.c"]
    return compile_objects(folder, cc, flags, names)
