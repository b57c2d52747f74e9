"""Drivers, store and black box: what strict compilers and cppcheck say, and what fuzzing finds."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from esea_gen.targets import firmware_folder

from .c_mutants import mutants
from .conftest import ROOT, missing, require_tool

FIRMWARE = firmware_folder()
FILES = sorted([*FIRMWARE.glob("drivers/*.c"), FIRMWARE / "app" / "store.c"])
STRICT = (
    *("-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion"),
    *("-Wshadow", "-Wdouble-promotion", "-Wswitch-enum", "-Wcast-qual", "-Wstrict-prototypes"),
    *("-Wundef", "-Wvla", "-Werror"),
)
FOLDERS = [f"-I{FIRMWARE / d}" for d in ("app", "port", "drivers")]


def said(*command: str | Path) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr + ("" if done.returncode == 0 else "it failed")


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.name)
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_strict_compilers_say_nothing(file, compiler):
    require_tool(compiler)
    assert said(compiler, *STRICT, *FOLDERS, "-fsyntax-only", file) == ""


def cppcheck(*files: Path) -> str:
    checks = "--enable=warning,style,performance,portability"
    quiet = ("--quiet", "--inline-suppr", "--error-exitcode=1")
    return said(require_tool("cppcheck"), "--std=c99", checks, *quiet, *FOLDERS, *files)


def test_cppcheck_says_nothing():
    assert cppcheck(*FILES) == ""


def test_both_are_armed(tmp_path):
    wrong = tmp_path / "wrong.c"
    wrong.write_text(
        "int f(int n);\nint f(int n)\n{\n    int a[2];\n    a[0] = n;\n    return a[2];\n}\n"
    )
    assert "arrayIndexOutOfBounds" in cppcheck(wrong)
    wrong.write_text("short f(int n);\nshort f(int n)\n{\n    return n;\n}\n")
    for compiler in ("gcc", "clang"):
        assert "conversion" in said(require_tool(compiler), *STRICT, "-fsyntax-only", wrong)


@pytest.fixture
def fuzzer(tmp_path):
    def build(*sources: Path) -> Path:
        clang = require_tool("clang")
        target = tmp_path / "fuzz"
        sanitizers = "-fsanitize=fuzzer,address,undefined"
        told = said(
            *(clang, "-g", "-O1", sanitizers, "-fno-sanitize-recover=all"),
            *(*FOLDERS, ROOT / "tests" / "fuzz" / "store.c", *sources, "-o", target),
        )
        if "libclang_rt.fuzzer" in told:
            missing("clang's libFuzzer")
        assert told == ""
        return target

    return build


def fuzz(program: Path, runs: int) -> str:
    return said(program, "-seed=1", "-max_len=6100", f"-runs={runs}", "-len_control=0")


def test_no_content_of_the_flash_harms_the_store(fuzzer):
    assert "it failed" not in fuzz(fuzzer(FIRMWARE / "app" / "store.c"), 2000)


def test_the_fuzzer_is_armed(fuzzer, tmp_path):
    """It finds a store that believes how many parameters there are."""
    text = (FIRMWARE / "app" / "store.c").read_text()
    check = "store->set.parameters > ESEA_STORE_PARAMETERS"
    assert check in text
    wrong = tmp_path / "store.c"
    wrong.write_text(text.replace("head->bytes > flash->area_bytes - at", "head->bytes < 0u && at"))
    assert "it failed" in fuzz(fuzzer(wrong), 200000)


def test_faults_are_made_of_every_kind():
    text = "void f(void)\n{\n    if (a < 3u && b)\n        g(a + 1u);\n    /* a < b */\n}\n"
    changes = [what for what, _ in mutants(text)]
    assert changes == [
        "line 3: < -> <=",
        "line 3: < -> >=",
        "line 3: && -> ||",
        "line 3: 3u -> (3u + 1u)",
        "line 3: 3u -> (3u - 1u)",
        "line 4: + -> -",
        "line 4: 1u -> (1u + 1u)",
        "line 4: 1u -> (1u - 1u)",
        "line 4: g(a + 1u); dropped",
    ]
