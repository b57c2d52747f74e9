"""Libraries for other build systems: the same C, built by each installed one."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import cffi
import numpy as np
import pytest
from typer.testing import CliRunner

import esea_gen
from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.export.library import FORMS, library_files, write_library
from esea_gen.hostlib.library import run_schedule
from tests.conftest import ROOT, require_tool

M4F = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
STRICT = ("-O2", "-Wall", "-Wextra", "-Werror", "-pedantic")


def run(*command: object, cwd: Path | None = None) -> str:
    done = subprocess.run(
        [str(c) for c in command], cwd=cwd, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def made(tmp_path_factory, elbow):
    """The elbow's C in every form."""
    folder = tmp_path_factory.mktemp("libraries")
    for name, form in FORMS.items():
        write_library(elbow, form, "f32", folder / name)
    return folder


def test_every_form_has_the_c_that_build_writes(made):
    shipped = {p.name: p.read_text() for p in (ROOT / "generated/elbow/f32").glob("esea_*.[ch]")}
    assert len(shipped) > 5
    for name in FORMS:
        found = {p.name: p for p in (made / name).rglob("esea_*.[ch]")}
        for file, text in shipped.items():
            copy = found[file].read_text()
            if name == "arduino" and file.endswith(".c"):
                top, _, copy = copy.partition("#endif\n")
                assert 'GCC optimize("fp-contract=off")' in top
            assert copy == text, (name, file)
        manifest = json.loads((made / name / "manifest.json").read_text())
        assert manifest["kind"] == f"export {name}"
        listed = {p.relative_to(made / name).as_posix() for p in (made / name).rglob("*.*")}
        assert set(manifest["files"]) == {
            n for n in listed if not n.endswith("manifest.json") and "/build" not in n
        } | {n for n in manifest["files"] if n.endswith("Kconfig")}


@pytest.mark.ci
def test_cmake_builds_with_one_line_and_is_found(made, tmp_path):
    for tool in ("cmake", "gcc"):
        require_tool(tool)
    package, build, prefix = made / "cmake", tmp_path / "build", tmp_path / "prefix"
    run("cmake", "-S", package, "-B", build, "-DCMAKE_C_FLAGS=-Wall -Wextra -Werror")
    run("cmake", "--build", build)
    assert "100% tests passed" in run("ctest", "--test-dir", build)
    run("cmake", "--install", build, "--prefix", prefix)
    user = tmp_path / "user"
    user.mkdir()
    (user / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.15)\n"
        "project(user C)\n"
        "find_package(esea_elbow 0.1 CONFIG REQUIRED)\n"
        'message(STATUS "content ${esea_elbow_CONTENT_HASH} ${esea_elbow_NUMBER_FORMAT}")\n'
        "add_executable(user user.c)\n"
        "target_link_libraries(user PRIVATE esea::elbow)\n"
    )
    (user / "user.c").write_text(
        '#include <stdio.h>\n#include "esea_elbow.h"\n'
        "int main(void) { return puts(ESEA_ELBOW_LINKED_HASH) < 0; }\n"
    )
    said = run("cmake", "-S", user, "-B", user / "b", f"-DCMAKE_PREFIX_PATH={prefix}")
    run("cmake", "--build", user / "b")
    content = run(user / "b" / "user").strip()
    assert f"content {content} f32" in said
    assert content == json.loads((package / "manifest.json").read_text())["content_hash"]


ARDUINO = """
#ifndef ARDUINO_H
#define ARDUINO_H
#include <stdint.h>
struct Printer {
  void begin(long);
  void print(const char *);
  void print(double, int);
  void println(const char *);
  void println(uint32_t);
};
extern Printer Serial;
uint32_t micros();
#endif
"""


@pytest.fixture
def sketch(made, tmp_path):
    """The example sketch as the IDE compiles it, Arduino.h included first."""
    (tmp_path / "Arduino.h").write_text(ARDUINO)
    text = (made / "arduino/examples/ticks/ticks.ino").read_text()
    (tmp_path / "ticks.cpp").write_text(f'#include "Arduino.h"\n{text}')
    return tmp_path


CORTEX = {
    "m0plus": ("-mcpu=cortex-m0plus", "-mthumb"),
    "m3": ("-mcpu=cortex-m3", "-mthumb"),
    "m4": M4F,
    "m7": ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard"),
}
PROCESSORS = {
    "avr": ("avr", ("-mmcu=atmega2560",)),
    "samd": ("arm-none-eabi", CORTEX["m0plus"]),
    "sam": ("arm-none-eabi", CORTEX["m3"]),
    "stm32": ("arm-none-eabi", CORTEX["m3"]),
    **dict.fromkeys(("mbed_nano", "renesas_uno"), ("arm-none-eabi", CORTEX["m4"])),
    **dict.fromkeys(("mbed_giga", "mbed_portenta"), ("arm-none-eabi", CORTEX["m7"])),
}


@pytest.mark.ci
def test_arduino_names_the_architectures_it_compiles_for(made, sketch, elbow):
    """As the IDE compiles: C++11, GNU dialects, permissive."""
    said = (made / "arduino/library.properties").read_text()
    assert f"architectures={','.join(sorted(PROCESSORS))}\n" in said
    source = made / "arduino/src"
    for prefix, flags in set(PROCESSORS.values()):
        for tool, std, files in (
            ("g++", ("-std=gnu++11", "-fpermissive", "-fno-exceptions"), ["ticks.cpp"]),
            ("gcc", ("-std=gnu11",), source.glob("*.c")),
        ):
            require_tool(f"{prefix}-{tool}")
            warn = ("-Os", "-Wall", "-Wextra", "-Werror", f"-I{source}", "-c")
            run(f"{prefix}-{tool}", *std, *flags, *warn, *files, cwd=sketch)
    _, double = library_files(elbow, FORMS["arduino"], "f64")
    assert "architectures=mbed_giga," in double.files["library.properties"]
    assert "atmelavr" not in double.files["library.json"]


@pytest.mark.ci
@pytest.mark.parametrize(
    ("compiler", "flags"),
    [
        ("GNU", ["-ffp-contract=off"]),
        ("Clang", ["-ffp-contract=off"]),
        ("TIClang", ["-ffp-contract=off"]),
        ("IntelLLVM", ["-fp-model=precise", "-ffp-contract=off"]),
        ("ARMClang", ["-ffp-mode=full", "-ffp-contract=off"]),
        ("TI", ["--fp_mode=strict", "--fp_reassoc=off"]),
        ("IAR", ["--no_default_fp_contract"]),
        ("SDCC", []),
    ],
)
def test_cmake_keeps_each_compiler_from_fusing(made, tmp_path, compiler, flags):
    """By its name alone: the compiler itself is a stand-in."""
    require_tool("cmake")
    text = (made / "cmake/CMakeLists.txt").read_text()
    found = re.search(r"^set\(ESEA_ROUNDING.*?^endif\(\)$", text, re.MULTILINE | re.DOTALL)
    assert found is not None
    (tmp_path / "CheckCCompilerFlag.cmake").write_text(
        "function(check_c_compiler_flag flag found)\nset(${found} ON PARENT_SCOPE)\nendfunction()"
    )
    (tmp_path / "a.cmake").write_text(
        f"list(APPEND CMAKE_MODULE_PATH {tmp_path})\nset(CMAKE_C_COMPILER_ID {compiler})\n"
        f'{found[0]}\nmessage(STATUS "flags: ${{ESEA_ROUNDING}}")'
    )
    command = [require_tool("cmake"), "-P", tmp_path / "a.cmake"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert f"flags: {';'.join(flags)}\n" in done.stdout
    assert ("no option is known" in done.stderr) == (not flags)


def test_arduino_compiles_for_a_board_and_keeps_two_roundings(made, sketch, tmp_path):
    """Armed: without the lines on top, the same flags fuse multiply and add."""
    for tool in ("arm-none-eabi-gcc", "arm-none-eabi-g++", "arm-none-eabi-objdump"):
        require_tool(tool)
    source = made / "arduino/src"
    run("arm-none-eabi-g++", *STRICT, *M4F, f"-I{source}", "-c", "ticks.cpp", cwd=sketch)
    fused = {}
    for kind in ("kept", "bare"):
        out = tmp_path / f"{kind}.o"
        text = (source / "esea_elbow_velocity.c").read_text()
        (tmp_path / f"{kind}.c").write_text(
            text if kind == "kept" else text.replace("#pragma GCC", "// ")
        )
        ide = ("-std=gnu11", "-O2", "-w")
        run(
            "arm-none-eabi-gcc",
            *ide,
            *M4F,
            f"-I{source}",
            "-c",
            f"{kind}.c",
            "-o",
            out,
            cwd=tmp_path,
        )
        code = run("arm-none-eabi-objdump", "-d", out)
        fused[kind] = sum(word in line for line in code.splitlines() for word in ("vfma", "vfms"))
    assert fused["kept"] == 0
    assert fused["bare"] > 0


ZEPHYR = """
cmake_minimum_required(VERSION 3.15)
project(app C)
# Stand-ins for what Zephyr's CMake gives a module.
function(zephyr_library_named name)
  add_library(${name} STATIC)
  set(ZEPHYR_CURRENT_LIBRARY ${name} PARENT_SCOPE)
endfunction()
function(zephyr_library_sources)
  target_sources(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
endfunction()
function(zephyr_include_directories)
  include_directories(${ARGN})
  target_include_directories(${ZEPHYR_CURRENT_LIBRARY} PUBLIC ${ARGN})
endfunction()
function(zephyr_library_compile_options)
  target_compile_options(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
endfunction()
include(${MODULE}/zephyr/CMakeLists.txt)
if(CONFIG_ESEA_ELBOW)
  add_executable(app ${MODULE}/samples/check/src/main.c)
  target_link_libraries(app PRIVATE esea_elbow)
endif()
"""


@pytest.mark.ci
def test_the_zephyr_module_builds_with_stand_ins(made, tmp_path):
    """Not Zephyr itself, which is not installed: its functions are stood in for."""
    require_tool("cmake")
    module = made / "zephyr"
    yml = (module / "zephyr/module.yml").read_text()
    for place in ("zephyr/CMakeLists.txt", "zephyr/Kconfig", "samples/check/prj.conf"):
        assert (module / place).is_file()
    assert "kconfig: zephyr/Kconfig" in yml
    assert "config ESEA_ELBOW\n" in (module / "zephyr/Kconfig").read_text()
    (tmp_path / "CMakeLists.txt").write_text(ZEPHYR)
    common = ("cmake", "-S", tmp_path, f"-DMODULE={module}")
    run(*common, "-B", tmp_path / "off")
    assert not list((tmp_path / "off").rglob("esea_elbow.dir")), "off where nobody asked for it"
    run(*common, "-B", tmp_path / "on", "-DCONFIG_ESEA_ELBOW=y")
    run("cmake", "--build", tmp_path / "on")
    assert "samples agree" in run(tmp_path / "on" / "app")


def test_the_c_caller_gives_the_host_librarys_bits(made, elbow, elbow_f32, tmp_path):
    require_tool("gcc")
    folder, built = made / "simulink", tmp_path / "caller.so"
    run(
        *("gcc", "-std=c99", *STRICT, "-ffp-contract=off", "-fPIC", "-shared", "-o", built),
        *sorted(folder.glob("*.c")),
    )
    run("g++", "-fsyntax-only", "-x", "c++", folder / "esea_elbow_caller.h")
    ffi = cffi.FFI()
    ffi.cdef(
        "uint32_t esea_elbow_caller(double, const double in[1], const double t[1], double out[8]);"
    )
    call = ffi.dlopen(str(built)).esea_elbow_caller
    theta_rad = 0.1 * np.sin(0.05 * np.arange(300))
    expected = run_schedule(elbow_f32.board(), {"sense": {"theta_rad": theta_rad}})["sense"]
    ((_, bandwidth),) = elbow.system.tunables
    out, tunables = ffi.new("double[8]"), [bandwidth.default]

    def once(theta, restart=0.0):
        refused = call(restart, [float(theta)], tunables, out)
        return refused, dict(zip((x.name for x in elbow.system.outputs), out, strict=True))

    for again in (0.0, 1.0):
        for k, theta in enumerate(theta_rad):
            refused, seen = once(theta, again if k == 0 else 0.0)
            assert refused == 0
            assert seen == {n: float(column[k]) for n, column in expected.items()}
    tunables[0] = 2 * bandwidth.high
    for _ in range(2):
        assert once(0.1) == (1, dict.fromkeys(expected, 0.0))
    tunables[0] = bandwidth.default
    assert once(0.1)[0] == 0


def test_what_cannot_be_written_is_refused(elbow, tmp_path, monkeypatch):
    foreign = tmp_path / "mine"
    foreign.mkdir()
    (foreign / "thesis.tex").write_text("x")
    with pytest.raises(UserError, match="did not write"):
        write_library(elbow, FORMS["cmake"], "f32", foreign)
    assert [p.name for p in foreign.iterdir()] == ["thesis.tex"]
    with pytest.raises(UserError, match="No number format 'q31' for simulink"):
        library_files(elbow, FORMS["simulink"], "q31")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(esea_gen, "load_device", lambda name, controller=None: elbow)
    done = CliRunner().invoke(app, ["export", "cmake", "elbow"])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "esea_elbow_cmake/CMakeLists.txt").is_file()
    assert "find_package(esea_elbow CONFIG REQUIRED)" in done.output


def test_a_file_of_ones_own_goes_into_other_tools(elbow, tmp_path):
    path = tmp_path / "my arm.toml"
    path.write_text(re.sub("(?m)^title = .*", "title = 'An \"arm\"'", elbow.toml()))
    device = esea_gen.load_device(path)
    arduino, zephyr = (library_files(device, FORMS[n])[1].files for n in ("arduino", "zephyr"))
    assert "An 'arm': " in json.loads(arduino["library.json"])["description"]
    assert "\tbool \"An 'arm'\"\n" in zephyr["zephyr/Kconfig"]
    written = write_library(device, FORMS["labview"], "f32", tmp_path / "lv")
    assert f"esea-gen firmware '{path}' --board myrio" in written.next_steps[-1]
    assert "`esea-gen export labview 'my arm.toml' --real f32`" in written.files["README.md"]
