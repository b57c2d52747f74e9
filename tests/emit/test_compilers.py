"""Warnings of compilers and style checkers on the emitted C; its comments."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest

from esea_gen.device import load_device
from esea_gen.devices.file import shipped_devices
from esea_gen.emit.build import device_formats, render_device
from tests.conftest import require_tool

pytestmark = pytest.mark.ci

STRICT = (
    *("-Wall", "-Wextra", "-Wpedantic", "-Wdouble-promotion", "-Wshadow"),
    *("-Wconversion", "-Wsign-conversion", "-Werror"),
)
COMPILERS = {
    "gcc, C11": ("gcc", "-std=c11"),
    "gcc, C++17": ("g++", "-std=c++17", "-x", "c++"),
    "clang, C11": ("clang", "-std=c11"),
    "clang, C++17": ("clang++", "-std=c++17", "-x", "c++"),
}
SAMPLE = ("elbow", "f64"), ("elbow_drive", "f32"), ("elbow_drive", "q31"), ("elbow_mpc", "f32")
ALL = tuple(
    (name, real) for name in sorted(shipped_devices()) for real in device_formats(load_device(name))
)
BUILDS = [
    pytest.param(*build, marks=() if build in SAMPLE else pytest.mark.slow, id="-".join(build))
    for build in ALL
]


@cache
def texts(name: str, real: str) -> dict[str, str]:
    """Our own C of a device: not CasADi's reference."""
    (bundle,) = render_device(load_device(name), [real])
    return {n: t for n, t in bundle.files.items() if n.endswith((".c", ".h")) and "/" not in n}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("emitted")

    def of(name: str, real: str) -> Path:
        target = root / name / real
        if not target.exists():
            target.mkdir(parents=True)
            for file, text in texts(name, real).items():
                (target / file).write_text(text)
        return target

    return of


def check(compiler: tuple[str, ...], where: Path, *flags: str, only: str = "*.c"):
    require_tool(compiler[0])
    sources = sorted(p.name for p in where.glob(only))
    assert sources
    command = [*compiler, "-fsyntax-only", *flags, *sources]
    return subprocess.run(command, cwd=where, capture_output=True, text=True, check=False)


@cache
def accepted(compiler: tuple[str, ...], where: Path, file: str) -> bool:
    """Whether a compiler takes a file as it is: asked once, for all the flags that it refuses."""
    return check(compiler, where, only=file).returncode == 0


# -- compilers -------------------------------------------------------------------------------------


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(("name", "real"), BUILDS)
def test_no_compiler_warns(folder, name, real, compiler):
    done = check(COMPILERS[compiler], folder(name, real), *STRICT)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(
    "fault",
    [
        "float esea_armed(double x); float esea_armed(double x) { return (float)x * 2.0; }",
        "double esea_armed(float x); double esea_armed(float x) { return x * 2.0; }",
        "unsigned esea_armed(int x); unsigned esea_armed(int x) { return x; }",
        "int esea_armed(int x); int esea_armed(int x) { { int x = 1; return x; } }",
        "int esea_armed(int x); int esea_armed(int x) { return 0; }",
    ],
)
def test_each_warning_is_armed(tmp_path, compiler, fault):
    (tmp_path / "a.c").write_text(fault + "\n")
    assert check(COMPILERS[compiler], tmp_path).returncode == 0
    assert check(COMPILERS[compiler], tmp_path, *STRICT).returncode != 0


X86 = platform.machine() in ("x86_64", "AMD64")
REFUSED = [
    (("-ffast-math",), "NaN", ("gcc", "g++", "clang", "clang++")),
    (("-Ofast",), "NaN", ("gcc", "g++", "clang", "clang++")),
    (("-ffinite-math-only",), "NaN", ("gcc", "g++", "clang", "clang++")),
    (("-funsafe-math-optimizations",), "would differ", ("gcc", "g++")),
    (("-fno-signed-zeros",), "would differ", ("gcc", "g++")),
    (("-mfpmath=387",), "excess precision", ("gcc", "g++")),  # what 32-bit x86 computes with
    (("-D__DBL_MAX_EXP__=128", "-D__FLT_MAX_EXP__=127"), "ieee_754_binary", ("gcc", "clang")),
    (("-U__FLT_RADIX__", "-D__FLT_RADIX__=16"), "ieee_754", ("gcc",)),
    (("-Dint=long", "-w"), "int_of_16_or_32", ("gcc",)),
]


@pytest.mark.parametrize("real", [pytest.param("f64", marks=pytest.mark.slow), "f32"])
@pytest.mark.parametrize(("flags", "why", "compilers"), REFUSED, ids=str)
def test_a_compiler_that_changes_the_arithmetic_is_refused(folder, real, flags, why, compilers):
    if "-mfpmath=387" in flags and not X86:
        pytest.skip("this processor has no x87")
    where = folder("elbow", real)
    for compiler in (c for c in COMPILERS.values() if c[0] in compilers):
        # Every Block's file says so by itself: a project may give each file flags of its own.
        for file in ("esea_elbow_sensor.c", "esea_elbow_velocity.c"):
            assert accepted(compiler, where, file)
            done = check(compiler, where, *flags, only=file)
            assert done.returncode != 0, (compiler, file)
            assert re.search(rf'error:? .*"?esea[:_].*{why}', done.stderr), done.stderr


def test_whole_numbers_compile_with_any_arithmetic_of_floats(folder):
    done = check(("gcc", "-std=c11"), folder("elbow_drive", "q31"), "-ffast-math", only="esea_e*.c")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_clang_is_refused_where_it_regroups_sums(folder, real):
    """It has no macro for that: what its optimizer folds gives it away, so not without one."""
    unsafe = ("-funsafe-math-optimizations",)
    parts = ("-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math")
    command = (require_tool("clang"), "-c", "-o", "/dev/null", "esea_elbow_sensor.c")
    for flags, good in (((), 1), (unsafe, 0), (parts, 0)):
        for level in ("-O1", "-O3", "-Os"):
            done = subprocess.run(
                [*command, level, *flags],
                cwd=folder("elbow", real),
                capture_output=True,
                text=True,
                check=False,
            )
            assert (done.returncode == 0) == good, (flags, level)
            assert good or "esea: do not compile with -funsafe" in done.stderr


def test_clang_fuses_nothing_without_a_flag(folder, tmp_path):
    """Armed: without the C's own pragma its default fuses multiply and add."""
    shutil.copytree(folder("elbow", "f32"), tmp_path, dirs_exist_ok=True)
    fused = []
    for pragma in ("#pragma STDC FP_CONTRACT OFF", ""):
        header = tmp_path / "esea_elbow_real.h"
        header.write_text(header.read_text().replace("#pragma STDC FP_CONTRACT OFF", pragma))
        target = ("--target=aarch64-none-elf", "-ffreestanding", "-O2", "-S", "-o", "-")
        command = [require_tool("clang"), *target, "esea_elbow_velocity.c"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        fused.append(len(re.findall(r"\bfn?m(?:add|sub)\b", done.stdout)))
    assert fused[0] == 0 < fused[1]


# -- a processor with 16-bit int -------------------------------------------------------------------

AVR = ("avr-gcc", "-std=c99", "-mmcu=atmega2560", "-O2", "-ffp-contract=off")

# Prints a running checksum of all outputs, by way of the mark `put`.
EIGHT_BIT = r"""
#include "esea_elbow_drive.h"
#ifdef __AVR__
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
static void put(char c) { while (!(UCSR0A & (1 << UDRE0))) { } UDR0 = c; }
#else
#include <stdio.h>
static void put(char c) { putchar(c); }
#endif
static esea_elbow_drive_params_t params;
static esea_elbow_drive_coeffs_t coeffs;
static esea_elbow_drive_state_t state;
static esea_elbow_drive_sense_in_t in;
static esea_elbow_drive_sense_out_t sensed;
static esea_elbow_drive_control_in_t none;
static esea_elbow_drive_control_out_t set;
static uint32_t sum;

static void see(const void *data, uint32_t n)
{
    const unsigned char *byte = data;
    while (n-- > 0)
        sum = (sum ^ *byte++) * UINT32_C(16777619);
}

static void print(uint32_t x)
{
    for (int i = 28; i >= 0; i -= 4)
        put("0123456789abcdef"[(x >> i) & 15u]);
    put('\n');
}

int main(void)
{
#ifdef __AVR__
    UCSR0B = 1 << TXEN0;
#endif
    esea_elbow_drive_default_params(&params);
    params.encoder_motor.zeroed = params.encoder_load.zeroed = INT32_C(1) << 30;
    print(esea_elbow_drive_prepare(&params, &coeffs));
    see(&coeffs, sizeof coeffs);
    esea_elbow_drive_init(&coeffs, &state);
    for (uint32_t k = 0; k < 400; ++k) {
        esea_elbow_drive_release(&state, k);
        in.count_motor = (3000 + 4 * (int32_t)(k % 16) - (k == 333 ? 3000 : 0)) * COUNT;
        in.count_load = (3000 + (int32_t)(k % 64)) * COUNT;
        in.count_gear = 640 * (int32_t)(k % 100) * (COUNT / 32);
        in.frame_error_load = k % 50 == 49 ? MODE : 0;
        in.mode = k > 60 ? MODE : 0;
        in.tau_desired_Nm = (int32_t)(k % 3) * MODE / 2;
        esea_elbow_drive_sense_step(&coeffs, &state, &in, &sensed);
        see(&sensed, sizeof sensed);
        if (k % ESEA_ELBOW_DRIVE_CONTROL_EVERY == ESEA_ELBOW_DRIVE_CONTROL_PHASE) {
            esea_elbow_drive_control_step(&coeffs, &state, &none, &set);
            see(&set, sizeof set);
        }
        if (k % 20 == 0)
            print(sum);
    }
    print((sensed.limits_status & ESEA_ELBOW_DRIVE_LIMITS_FAULT_LATCHED) != 0);
    see(&state, sizeof state);
    print(sum);
#ifdef __AVR__
    cli();
    sleep_enable();
    sleep_cpu();
#endif
    return 0;
}
"""


@pytest.mark.parametrize(("name", "real"), BUILDS)
def test_an_8_bit_compiler_takes_all_but_double_precision(folder, name, real):
    done = check(AVR, folder(name, real), "-Wall", "-Wextra", "-Wconversion", "-Werror")
    if real == "f64":
        assert "esea_needs_double_of_ieee_754_binary64" in done.stderr
    else:
        assert done.returncode == 0, done.stderr


# By the fractions in the q31 header's comments.
IN_Q31 = ("-DMODE=(INT32_C(1) << 29)", "-DCOUNT=(INT32_C(1) << 19)")


@pytest.mark.parametrize(
    ("real", "one"), [("f32", ("-DMODE=1.0f", "-DCOUNT=1.0f")), ("q31", IN_Q31)]
)
def test_an_emulated_8_bit_board_gives_the_hosts_bits(folder, tmp_path, real, one):
    source, image = tmp_path / "main.c", tmp_path / "main"
    source.write_text(EIGHT_BIT)
    files = [p for p in folder("elbow_drive", real).glob("*.c") if p.name != "main.c"]
    seen = []
    for compiler, command in (
        (AVR, (require_tool("simavr"), "-m", "atmega2560", "-f", "16000000")),
        (("gcc", "-std=c99", "-ffp-contract=off"), ()),
    ):
        require_tool(compiler[0])
        flags = (*one, f"-I{files[0].parent}", "-ffunction-sections")
        ends = ("-Wl,--gc-sections", "-lm", "-o", image)
        subprocess.run([*compiler, *flags, source, *files, *ends], check=True)
        # The emulator prints a port's lines in colour, with a point at the end.
        done = subprocess.run([*command, image], capture_output=True, text=True, check=True)
        plain = re.sub(r"\x1b\[\d*m", "", done.stdout + done.stderr)
        seen.append(re.findall(r"^([0-9a-f]{8})\.?$", plain, re.MULTILINE))
    assert seen[0] == seen[1]
    assert len(set(seen[0])) > 20
    assert seen[0][-2] == "00000001"


# -- truth values ----------------------------------------------------------------------------------


def essential_type_findings(where: Path, file: str) -> list[str]:
    command = [
        *(require_tool("cppcheck"), "--addon=misra", "--std=c99", "--quiet"),
        *("--template={id} {file}:{line}", file),
    ]
    said = subprocess.run(command, cwd=where, capture_output=True, text=True, check=False).stderr
    if "misra-c2012" not in said and not Path("/usr/lib/x86_64-linux-gnu/cppcheck/addons").exists():
        pytest.skip("cppcheck has no MISRA addon here")
    # Rules 10.3 and 10.5: a truth value as a number, a number as a truth value.
    lines = (where / file).read_text().splitlines()
    found = re.findall(rf"(misra-c2012-10\.[35]) {re.escape(file)}:(\d+)", said)

    def statement(number: int) -> str:
        return "\n".join(lines[number - 1 :]).partition(";")[0]

    # The addon takes INT32_MIN for a long.
    return [f"{rule} {n}" for rule, n in found if "INT32_MIN" not in statement(int(n))]


@pytest.mark.parametrize("real", ["f32", "q31"])
@pytest.mark.parametrize(
    "block", ["drive_observer", *(pytest.param(b, marks=pytest.mark.slow) for b in ("[!d]*",))]
)
def test_no_finding_of_essential_types(folder, real, block):
    where = folder("elbow_drive", real)
    for path in sorted(where.glob(f"esea_elbow_drive_{block}.c")):
        assert essential_type_findings(where, path.name) == []


def test_the_essential_types_are_armed(folder, tmp_path):
    for name, text in texts("elbow_drive", "f32").items():
        (tmp_path / name).write_text(text.replace("const bool ", "const int "))
    assert len(essential_type_findings(tmp_path, "esea_elbow_drive_drive_observer.c")) > 5


@pytest.mark.parametrize(("name", "real"), BUILDS)
def test_no_arithmetic_on_truth_values(name, real):
    for file, text in texts(name, real).items():
        # A name is one function's: what it is says its last declaration before the cast.
        casts = re.finditer(r"\((?:u?int\d+_t|float|double|int)\)\(?!?(\w+)\b(?! \?)", text)
        of = {m.start(): m[1] for m in casts}
        types: dict[str, str] = {}
        for m in re.finditer(r"const (\w+) (\w+) =|\((?=[uifd])", text):
            if m[2]:
                types[m[2]] = m[1]
            elif m.start() in of:
                assert types.get(of[m.start()]) != "bool", (file, of[m.start()])
    assert any("const bool" in text for text in texts(name, real).values())
