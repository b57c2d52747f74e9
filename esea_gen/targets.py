"""Targets of emitted C: processors, toolchains, flags, boards.

A processor or a board is one entry here; a board that runs the firmware also has a folder in
``firmware/boards``, under its name or shared with similar boards.
"""

from __future__ import annotations

import platform
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from esea_gen.errors import UserError, nearest

# What every verified number rests on: no contraction to fused multiply-add, no other liberty.
EXACT_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
CONTROL_FLAGS = (*EXACT_FLAGS, "-Wall", "-Wextra")
APP_FLAGS = (*EXACT_FLAGS, "-Wall", "-Wextra", "-Wconversion", "-Wswitch-enum", "-Werror")
# So that the linker drops what nobody calls.
SECTION_FLAGS = ("-ffunction-sections", "-fdata-sections")
# An image without an operating system.
BARE_LINK = ("-nostartfiles", "-Wl,--gc-sections")


@dataclass(frozen=True)
class Toolchain:
    compiler: str
    package: str
    zig: str = ""  # what zig calls the target, where its compiler may stand in

    @property
    def gcc(self) -> tuple[str, str]:
        return self.compiler, self.package

    def tool(self, name: str) -> tuple[str, str]:
        prefix = self.compiler.removesuffix("gcc")
        return prefix + name, "-".join(["binutils", *filter(None, [prefix.rstrip("-")])])


HOST_GCC = Toolchain("gcc", "gcc libc6-dev")
ARM_GCC = Toolchain("arm-none-eabi-gcc", "gcc-arm-none-eabi libnewlib-arm-none-eabi")
ARM_LINUX_GCC = Toolchain("arm-linux-gnueabi-gcc", "gcc-arm-linux-gnueabi libc6-dev-armel-cross")
ARM64_LINUX_GCC = Toolchain(
    *("aarch64-linux-gnu-gcc", "gcc-aarch64-linux-gnu libc6-dev-arm64-cross"), "aarch64-linux-musl"
)


@dataclass(frozen=True)
class Platform:
    """A computer that people sit at, or a Linux board."""

    name: str  # as FMI 3.0 writes it
    zig: str  # as zig does: with the oldest glibc that its binaries take
    fmi2: str
    suffix: str  # of a shared library


PLATFORMS = {
    p.name: p
    for p in (
        Platform("x86_64-linux", "x86_64-linux-gnu.2.17", "linux64", ".so"),
        Platform("aarch64-linux", "aarch64-linux-gnu.2.17", "aarch64-linux", ".so"),
        Platform("x86_64-windows", "x86_64-windows-gnu", "win64", ".dll"),
        # FMI 2.0 has one name for both: a file that holds both.
        Platform("x86_64-darwin", "x86_64-macos", "darwin64", ".dylib"),
        Platform("aarch64-darwin", "aarch64-macos", "darwin64", ".dylib"),
    )
}


def this_platform() -> Platform:
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(m := platform.machine().lower(), m)
    name = f"{machine}-{'windows' if sys.platform == 'win32' else sys.platform}"
    if name not in PLATFORMS:
        raise UserError(f"{name} is not one of {', '.join(PLATFORMS)}.", "Use one of these.")
    return PLATFORMS[name]


@dataclass(frozen=True)
class Processor:
    name: str
    title: str
    note: str
    toolchain: Toolchain
    flags: tuple[str, ...]
    fpu: bool = True  # single precision; else the compiler's helpers compute
    stack_limit_bytes: int | None = None  # of a sensing task's step in f32; None: no gate asks
    cycles_per_instruction: float = 1.5  # assumed: loads, divisions and waits take more than one

    @property
    def m_profile(self) -> bool:
        """Whether it starts by a table of addresses and calls the debugger by ``bkpt``."""
        return self.name.startswith("cortex-m")

    @property
    def full_title(self) -> str:
        return f"{self.title}, {self.note}" if self.note else self.title


_SOFT = "-mthumb -mfloat-abi=soft"
_VFP3 = "-mfpu=vfpv3 -mfloat-abi=softfp"
_DOUBLE = "double precision FPU: a slip to double would be fast, and silent"
# Name, title, note, toolchain, flags, FPU, stack limit in bytes.
PROCESSORS = {
    name: Processor(name, title, note, tools, tuple(flags.split()), fpu, limit)
    for name, title, note, tools, flags, fpu, limit in (
        ("host", "this computer", "", HOST_GCC, "", True, 1024),
        ("cortex-m0", "Cortex-M0", "no FPU", ARM_GCC, f"-mcpu=cortex-m0 {_SOFT}", False, None),
        ("cortex-m3", "Cortex-M3", "no FPU", ARM_GCC, f"-mcpu=cortex-m3 {_SOFT}", False, 768),
        (
            *("cortex-m4f", "Cortex-M4F", "single precision FPU", ARM_GCC),
            *("-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard", True, 640),
        ),
        (
            *("cortex-m7", "Cortex-M7", _DOUBLE, ARM_GCC),
            *("-mcpu=cortex-m7 -mthumb -mfpu=fpv5-d16 -mfloat-abi=hard", True, 640),
        ),
        (
            *("cortex-a9", "Cortex-A9", "Linux, vfpv3, softfp", ARM_LINUX_GCC),
            *(f"-march=armv7-a -mtune=cortex-a9 {_VFP3}", True, 640),
        ),
        ("aarch64", "64-bit Arm", "Linux", ARM64_LINUX_GCC, "", True, None),
        (
            *("cortex-a9-bare", "Cortex-A9", "no operating system, vfpv3, softfp", ARM_GCC),
            *(f"-mcpu=cortex-a9 -marm {_VFP3}", True, None),
        ),
    )
}

Use = Literal["instructions", "bits"]
_SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
_MB = 1 << 20


@dataclass(frozen=True)
class Board:
    name: str
    title: str
    processor: Processor
    machine: str
    family: str = ""  # folder in firmware/boards that it shares with others
    clock_Hz: float = 0.0
    reset_Hz: float = 0.0  # at which it starts; 0: at clock_Hz
    runner: str = ""  # what runs a program of another processor here
    package: str = ""  # what opkg calls the processor
    code: int = 0
    code_bytes: int = 0
    ram: int = 0x20000000
    ram_bytes: int = 0
    most_bits: tuple[tuple[str, int], ...] = ()  # that its drivers' encoders send, by key
    real: str = "f32"
    tick_instructions: int = 1  # of QEMU, for a tick of its timer
    uses: tuple[Use, ...] = ()
    flags: tuple[str, ...] = ()
    app_flags: tuple[str, ...] = ()
    link: tuple[str, ...] = (*BARE_LINK, "-Wl,--fatal-warnings")

    @property
    def folder(self) -> str:
        return f"boards/{self.family or self.name}"

    @property
    def core(self) -> str:
        return self.processor.title

    @property
    def compile_flags(self) -> tuple[str, ...]:
        return (*self.processor.flags, *self.flags)

    @property
    def clock_defines(self) -> tuple[str, ...]:
        told = {"CLOCK": self.clock_Hz, "RESET": self.reset_Hz or self.clock_Hz}
        return tuple(f"-DESEA_{name}_HZ={Hz:.0f}u" for name, Hz in told.items() if Hz)


BOARDS = {
    b.name: b
    for b in (
        Board(
            "netduinoplus2",
            "STM32F405, Cortex-M4F",
            PROCESSORS["cortex-m4f"],
            "netduinoplus2",
            clock_Hz=168e6,
            reset_Hz=16e6,
            code=0x08000000,
            code_bytes=_MB,
            ram_bytes=128 << 10,
            # AS5048A on both sides of the coupling, BiSS-C at the motor.
            most_bits=(("encoder.resolution_bits", 14), ("actuator.encoder_bits", 24)),
            uses=("instructions",),
            # Of its memory the black box takes what the application and the stack leave: less
            # where there are more tasks, a record is long or a law keeps much, as a horizon does.
            app_flags=(
                "-DESEA_BLACKBOX_BYTES="
                "(114528u-1536u*ESEA_LINK_TASKS-64u*sizeof(esea_blackbox_record_t)"
                "-2u*sizeof(esea_link_control_t))",
            ),
        ),
        Board(
            "host",
            "this computer, a program with sanitizers",
            PROCESSORS["host"],
            "",
            family="linux",
            # A report ends the program, so that no test can overlook it.
            flags=_SANITIZED,
            app_flags=("-D_GNU_SOURCE",),
            link=_SANITIZED,
        ),
        Board(
            "linux",
            "this computer, a program with a moteus drive",
            PROCESSORS["host"],
            "",
            family="linux",
            app_flags=("-D_GNU_SOURCE",),
            link=(),
        ),
        Board(
            "myrio",
            "NI myRIO class, Cortex-A9 with Linux",
            PROCESSORS["cortex-a9"],
            "",
            family="linux",
            runner="qemu-arm",
            package="cortexa9-vfpv3",
            app_flags=("-D_GNU_SOURCE",),
            link=("-static",),
        ),
        Board(
            "raspberry-pi",
            "Raspberry Pi class, 64-bit Arm with Linux",
            PROCESSORS["aarch64"],
            "",
            family="linux",
            runner="qemu-aarch64",
            app_flags=("-D_GNU_SOURCE",),
            link=("-static",),
        ),
        *(
            Board(
                *(name, title, PROCESSORS["host"], ""),
                family="sim",
                real=real,
                flags=("-fPIC", "-fsanitize=undefined", "-fsanitize-undefined-trap-on-error"),
                app_flags=("-O1",),  # compiled sooner
                link=("-shared",),
            )
            for name, title, real in (
                ("sim", "this computer, a library that a program clocks", "f32"),
                ("sim-q31", "as sim, the control in whole numbers", "q31"),
            )
        ),
        Board(
            "microbit",
            "nRF51822, Cortex-M0",
            PROCESSORS["cortex-m0"],
            "microbit",
            clock_Hz=16e6,
            code_bytes=256 << 10,
            ram_bytes=16 << 10,
            uses=("bits",),
        ),
        Board(
            "mps2-an385",
            "Arm MPS2, Cortex-M3",
            PROCESSORS["cortex-m3"],
            "mps2-an385",
            family="mps2",
            clock_Hz=25e6,
            code_bytes=4 * _MB,
            ram_bytes=4 * _MB,
            real="q31",
            tick_instructions=40,  # its timer counts at its clock, an instruction takes 1 ns
            uses=("bits",),
        ),
        Board(
            "mps2-an386",
            "Arm MPS2, Cortex-M4F",
            PROCESSORS["cortex-m4f"],
            "mps2-an386",
            clock_Hz=25e6,
            code_bytes=4 * _MB,
            ram_bytes=4 * _MB,
            uses=("bits",),
        ),
        Board(
            "mps2-an500",
            "Arm MPS2, Cortex-M7",
            PROCESSORS["cortex-m7"],
            "mps2-an500",
            family="mps2",
            clock_Hz=25e6,
            code_bytes=4 * _MB,
            ram_bytes=4 * _MB,
            tick_instructions=40,
            uses=("instructions",),
        ),
        Board(
            "xilinx-zynq-a9",
            "Zynq-7000, Cortex-A9",
            PROCESSORS["cortex-a9-bare"],
            "xilinx-zynq-a9",
            clock_Hz=667e6,
            code=0x00100000,
            code_bytes=16 * _MB,
            ram=0x01100000,
            ram_bytes=16 * _MB,
            uses=("instructions",),
        ),
    )
}
DEFAULT_BOARD = "netduinoplus2"


def boards_for(use: Use) -> tuple[Board, ...]:
    return tuple(b for b in BOARDS.values() if use in b.uses)


def firmware_folder() -> Path:
    """Folder of the hand-written C: inside the wheel, or at the top of a checkout."""
    packaged = Path(__file__).parent / "_firmware"
    return packaged if packaged.is_dir() else Path(__file__).parents[1] / "firmware"


def firmware_boards() -> dict[str, Board]:
    return {b.name: b for b in BOARDS.values() if (firmware_folder() / b.folder).is_dir()}


def find_board(name: str) -> Board:
    known = firmware_boards()
    if name not in known:
        listed = "; ".join(f"{b.name} ({b.title})" for b in known.values())
        near = nearest(name, known)
        raise UserError(f"There is no board '{name}'.", f"{near}Boards: {listed}.")
    return known[name]
