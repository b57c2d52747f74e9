"""The integer elementary functions: the same bits from every compiler, and no library."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from esea_gen.emit.elementary import ACCURACY_ULP
from tests.emit.test_elementary import BINARY, HEADER, SOURCE, SPECIAL_BITS, WARNINGS, run, tool

CHECKSUM = """
#include "esea_f32.h"
uint32_t checksum(void);
static uint32_t state;
static uint32_t next(void)
{
    state ^= state << 13;
    state ^= state >> 17;
    state ^= state << 5;
    return state;
}
static float as_float(uint32_t bits)
{
    union { uint32_t bits; float value; } u;
    u.bits = bits;
    return u.value;
}
/* Sign and significand of u, one of the exponents from the given one on. */
static float near_one(uint32_t u, uint32_t lowest, uint32_t mask)
{
    return as_float((u & 0x80FFFFFFu) + lowest + ((u >> 24) & mask) * 0x01000000u);
}
static uint32_t mix(uint32_t hash, float x)
{
    union { uint32_t bits; float value; } u;
    u.value = x;
    return (hash ^ u.bits) * 16777619u;
}
uint32_t checksum(void)
{
    uint32_t hash = 2166136261u;
    uint32_t i;
    state = 2463534242u;
    for (i = 0; i < COUNT; i++) {
        /* Every fourth argument is anything, the others make ordinary results. */
        const uint32_t a = next();
        const uint32_t b = next();
        const uint32_t y = next();
        const float x = i % 4u == 0u ? as_float(a) : near_one(a, 0x37800000u, 0xFu);
        const float z = i % 4u == 0u ? as_float(b) : near_one(b, 0x3C000000u, 0x3u);
        const float size = x < 0.0f ? -x : x;
        union { uint32_t bits; int32_t value; } exponent;
        exponent.bits = y;
        hash = mix(hash, esea_f32_powk(x, exponent.value));
        hash = mix(hash, esea_f32_powk(size, exponent.value));
        exponent.bits = y >> 4;
        hash = mix(hash, esea_f32_powk(size, exponent.value));
        hash = mix(hash, esea_f32_pow(x, z));
        hash = mix(hash, esea_f32_pow(size, z));
        hash = mix(hash, esea_f32_exp(z));
        hash = mix(hash, esea_f32_expm1(z));
        hash = mix(hash, esea_f32_log(size));
        hash = mix(hash, esea_f32_log1p(x));
        hash = mix(hash, esea_f32_tanh(z));
        hash = mix(hash, esea_f32_cbrt(x));
        hash = mix(hash, esea_f32_sqrt(size));
        hash = mix(hash, esea_f32_sin(x));
        hash = mix(hash, esea_f32_cos(x));
        hash = mix(hash, esea_f32_atan2(x, z));
    }
    return hash;
}
"""
HOSTED = """
#include <stdint.h>
#include <stdio.h>
uint32_t checksum(void);
int main(void) { printf("%08X", (unsigned)checksum()); return 0; }
"""
# A vector table and semihosting: nothing of a C library. Coprocessors 10 and 11 are the FPU;
# without one the write is lost.
BARE = """
#include <stdint.h>
uint32_t checksum(void);
static void call(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}
void entry(void)
{
    char text[9];
    uint32_t hash;
    int i;
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20;
    __asm volatile("dsb");
    __asm volatile("isb");
    hash = checksum();
    for (i = 0; i < 8; i++) text[i] = "0123456789ABCDEF"[(hash >> (28 - 4 * i)) & 15u];
    text[8] = 0;
    call(4, text);
    call(0x18, (void *)0x20026);
    for (;;) { }
}
__attribute__((section(".vectors"), used))
static void *const vectors[2] = {(void *)0x20003000, (void *)entry};
"""
LINKER = """
ENTRY(entry)
SECTIONS {
    . = 0; .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) }
    . = 0x20000000; .bss : { *(.bss*) *(.data*) }
}
"""
COUNT = 40_000
VARIANTS = {
    "gcc -O0": ("gcc", ["-std=c99", "-O0"]),
    "gcc -O3 fast-math": ("gcc", ["-std=gnu99", "-O3", "-ffast-math", "-funroll-loops"]),
    "gcc fma": ("gcc", ["-std=gnu99", "-O2", "-mfma", "-ffp-contract=fast"]),
    "gcc without clz": ("gcc", ["-std=c99", "-Os", "-DESEA_F32_PORTABLE_CLZ"]),
    "g++": ("g++", ["-x", "c++", "-std=c++11", "-O2", "-Wno-old-style-cast"]),
    "clang -O0": ("clang", ["-std=c99", "-O0"]),
    "clang -O3 fast-math": ("clang", ["-std=c99", "-O3", "-ffast-math"]),
}
M4F = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
BOARDS = {
    "M4F": ("mps2-an386", M4F),
    "M7": ("mps2-an500", ["-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"]),
    "M3": ("mps2-an385", ["-mcpu=cortex-m3", "-mthumb", "-mfloat-abi=soft"]),
    "M0": ("microbit", ["-mcpu=cortex-m0", "-mthumb", "-mfloat-abi=soft"]),
}


def checksum_sources(folder: Path, main: str) -> list[str | Path]:
    """Write the checksum program; returns what a compiler needs to build it."""
    program = folder / "checksum.c"
    program.write_text(CHECKSUM.replace("COUNT", f"{COUNT}u"))
    start = folder / "start.c"
    start.write_text(main)
    return [f"-I{HEADER.parent}", SOURCE, program, start]


@pytest.fixture(scope="module")
def host_checksum(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the checksum of the ordinary host build."""
    folder = tmp_path_factory.mktemp("checksum")
    run([tool("gcc"), "-std=c99", "-O2", *checksum_sources(folder, HOSTED), "-o", folder / "host"])
    checksum = run([folder / "host"]).stdout
    assert re.fullmatch("[0-9A-F]{8}", checksum)
    return checksum


@pytest.mark.ci
@pytest.mark.parametrize("variant", VARIANTS)
def test_compilers_and_options_change_no_bit(
    tmp_path: Path, host_checksum: str, variant: str
) -> None:
    if variant == "gcc fma" and " fma " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has no fused multiply-add")
    compiler, options = VARIANTS[variant]
    run([tool(compiler), *options, *checksum_sources(tmp_path, HOSTED), "-o", tmp_path / "host"])
    assert run([tmp_path / "host"]).stdout == host_checksum


@pytest.mark.ci
def test_cortex_a9_gives_the_same_bits(tmp_path: Path, host_checksum: str) -> None:
    compiler, emulator = tool("arm-linux-gnueabi-gcc"), tool("qemu-arm")
    options = [
        "-std=gnu99",
        "-O2",
        "-mcpu=cortex-a9",
        "-mfpu=vfpv3",
        "-mfloat-abi=softfp",
        "-static",
    ]
    run([compiler, *options, *checksum_sources(tmp_path, HOSTED), "-o", tmp_path / "a9"])
    assert run([emulator, "-cpu", "cortex-a9", tmp_path / "a9"]).stdout == host_checksum


@pytest.mark.ci
@pytest.mark.parametrize("board", BOARDS)
def test_microcontrollers_give_the_same_bits(
    tmp_path: Path, host_checksum: str, board: str
) -> None:
    compiler, emulator = tool("arm-none-eabi-gcc"), tool("qemu-system-arm")
    machine, options = BOARDS[board]
    script, image = tmp_path / "bare.ld", tmp_path / "bare.elf"
    script.write_text(LINKER)
    flags = ["-std=gnu99", "-O2", "-ffreestanding", "-nostdlib", "-nostartfiles", f"-T{script}"]
    run([compiler, *options, *flags, *checksum_sources(tmp_path, BARE), "-lgcc", "-o", image])
    semihosting = ["-nographic", "-semihosting-config", "enable=on,target=native"]
    done = run(
        [emulator, "-M", machine, *semihosting, "-kernel", image],
        stdin=subprocess.DEVNULL,
        timeout=60,
    )
    # Semihosting writes to standard error.
    assert host_checksum in done.stdout + done.stderr


@pytest.mark.ci
@pytest.mark.parametrize(
    ("compiler", "options"),
    [
        ("gcc", ["-std=c99"]),
        ("g++", ["-x", "c++", "-std=c++11"]),
        ("clang", ["-std=c99"]),
        ("clang++", ["-x", "c++", "-std=c++11"]),
        ("arm-none-eabi-gcc", ["-std=c99", *M4F]),
        ("arm-none-eabi-gcc", ["-std=c99", "-mcpu=cortex-m3", "-mthumb"]),
    ],
)
def test_compiles_clean_and_needs_nothing(
    tmp_path: Path, compiler: str, options: list[str]
) -> None:
    path, prefix = tool(compiler), "arm-none-eabi-" if compiler.startswith("arm") else ""
    for level in ("-O0", "-O2", "-Os"):
        compiled = tmp_path / "esea_f32.o"
        run([path, *options, level, "-ffreestanding", *WARNINGS, "-c", SOURCE, "-o", compiled])
        symbols = [
            line.split() for line in run([tool(f"{prefix}nm"), compiled]).stdout.splitlines()
        ]
        # No library, so in particular no double arithmetic; nothing writable; nothing unprefixed.
        assert [name for *_, kind, name in symbols if kind in "Uu"] == []
        assert [name for *_, kind, name in symbols if kind in "DdBbC"] == []
        exported = {name for *_, kind, name in symbols if kind in "TRVW"}
        assert exported == {f"esea_f32_{name}" for name in ACCURACY_ULP}


def test_no_undefined_behaviour(tmp_path: Path) -> None:
    compiler = tool("gcc")
    sanitize = ["-std=c99", "-O1", "-fsanitize=undefined", "-fno-sanitize-recover=all"]
    values = ", ".join(f"0x{value:X}u" for value in SPECIAL_BITS)
    calls = "\n".join(
        f"            total += bits(esea_f32_{name}(x));"
        for name in ACCURACY_ULP
        if name not in BINARY
    )
    pairs = "\n".join(
        f"            total += bits(esea_f32_{name}(x, y));" for name in ("pow", "atan2")
    )
    main = f"""
#include <stdint.h>
#include <stdio.h>
#include "esea_f32.h"
uint32_t checksum(void);
static const uint32_t special[] = {{{values}}};
static uint32_t bits(float x) {{ union {{ float x; uint32_t u; }} b; b.x = x; return b.u; }}
static float value(unsigned i) {{ union {{ float x; uint32_t u; }} b;
    b.u = special[i % {len(SPECIAL_BITS)}u];
    if (i >= {len(SPECIAL_BITS)}u) b.u |= 0x80000000u;
    return b.x; }}
int main(void)
{{
    uint32_t total = checksum();
    for (unsigned i = 0; i < {2 * len(SPECIAL_BITS)}u; i++) {{
        const float x = value(i);
        for (unsigned k = 0; k < {2 * len(SPECIAL_BITS)}u; k++) {{
            const float y = value(k);
{calls}
{pairs}
            total += bits(esea_f32_powk(x, INT32_MIN + (int32_t)k));
            total += bits(esea_f32_powk(x, INT32_MAX - (int32_t)k));
            total += bits(esea_f32_powk(x, (int32_t)k - 50));
        }}
    }}
    printf("%08X", (unsigned)total);
    return 0;
}}
"""
    sources = checksum_sources(tmp_path, main)
    run([compiler, *sanitize, *sources, "-o", tmp_path / "clean"])
    run([tmp_path / "clean"])
    # Armed? The same program with one product in 32 bits has to stop.
    broken = tmp_path / "broken.c"
    right = "((int64_t)a * b)"
    assert SOURCE.read_text().count(right) == 1
    broken.write_text(SOURCE.read_text().replace(right, "(a * b)"))
    run(
        [
            compiler,
            *sanitize,
            *[broken if part == SOURCE else part for part in sources],
            "-o",
            tmp_path / "faulty",
        ]
    )
    done = subprocess.run([tmp_path / "faulty"], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "signed integer overflow" in done.stderr
