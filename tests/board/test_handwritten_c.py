"""Drivers, store and black box: strict compilers, cppcheck, fuzzing."""

from __future__ import annotations

import re
import struct
import subprocess
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.emit.dialect import render_dialect
from esea_gen.targets import firmware_folder
from tests.conftest import ROOT, missing, require_tool

pytestmark = pytest.mark.ci

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


SANITIZERS = ("-g", "-O1", "-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all")


def fuzzer(target: Path, *given: str | Path) -> Path:
    """A program that libFuzzer drives."""
    told = said(require_tool("clang"), *SANITIZERS, *FOLDERS, *given, "-o", target)
    if "libclang_rt.fuzzer" in told:
        missing("clang's libFuzzer")
    assert told == ""
    return target


def fuzz(program: Path, runs: int, longest: int) -> str:
    found = f"-artifact_prefix={program.parent}/"
    return said(program, found, "-seed=1", f"-max_len={longest}", f"-runs={runs}", "-len_control=0")


def store_fuzzer(folder: Path, store: Path) -> Path:
    return fuzzer(folder / "fuzz_store", ROOT / "tests" / "fuzz" / "store.c", store)


def test_no_content_of_the_flash_harms_the_store(tmp_path):
    assert "it failed" not in fuzz(store_fuzzer(tmp_path, FIRMWARE / "app" / "store.c"), 2000, 6100)


def test_an_encoder_that_stands_twice_in_a_set_is_one(tmp_path):
    """The fuzzer's finding: one was replaced, the other found, and only one forgotten."""
    program = store_fuzzer(tmp_path, FIRMWARE / "app" / "store.c")
    area = bytearray(1428)
    at = 24 + 4 + 160 * 8
    area[at : at + 16] = struct.pack("<IfIf", 2, 0.5, 2, 0.25)
    found = tmp_path / "found"
    found.write_bytes(
        bytes([15, 10, 8, 0]) + bytes(area) * 2
    )  # sealed; encoder 2 is put, forgotten
    assert "it failed" not in said(program, found)


@dataclass(frozen=True)
class LinkFuzzer:
    """The application of a drive, compiled once; a file of it may be replaced."""

    folder: Path
    flags: tuple[str, ...]
    objects: dict[str, Path]

    def program(self, file: str = "", find: str = "", put: str = "") -> Path:
        """The fuzzer, of ``firmware/app`` as it stands or with one place changed."""
        objects = dict(self.objects)
        if file:
            text = (FIRMWARE / "app" / file).read_text()
            assert text.count(find) == 1
            wrong = self.folder / f"wrong_{file}"
            wrong.write_text(text.replace(find, put))
            objects[file] = self.compiled(wrong, *SANITIZERS)
        return fuzzer(self.folder / "fuzz_link", *objects.values(), "-lm")

    def compiled(self, source: Path, *flags: str) -> Path:
        target = self.folder / f"{source.stem}.o"
        assert said(require_tool("clang"), *flags, *self.flags, "-c", source, "-o", target) == ""
        return target


@pytest.fixture(scope="module")
def link_fuzzer(tmp_path_factory):
    folder = tmp_path_factory.mktemp("link")
    device = load_device("elbow_drive")
    for name, text in render_dialect(device).files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    f32 = ROOT / "generated" / "elbow_drive" / "f32"
    limit = np.nextafter(np.float32(device.file.safety.u_max_Nm.value), np.float32(1))
    flags = (
        *FOLDERS,
        *(f"-I{FIRMWARE}/boards/sim", f"-isystem{folder}", f"-isystem{folder}/mavlink", f"-I{f32}"),
        *('-DESEA_LINK_HEADER="esea_elbow_drive_link.h"', '-DESEA_BOARD_NAME="sim"'),
        *("-DESEA_ENCODER_BITS=14u", "-DESEA_GEAR_BITS=17u", "-DESEA_BLACKBOX_BYTES=4096u"),
        f"-DLIMIT_NM={limit}f",
    )
    made = LinkFuzzer(folder, flags, {})
    own = FIRMWARE / "boards" / "sim" / "drivers.c", ROOT / "tests" / "fuzz" / "drive.c"
    for source in (*FIRMWARE.glob("app/*.c"), folder / "esea_elbow_drive_link.c", *own):
        made.objects[source.name] = made.compiled(source, *SANITIZERS)
    for source in f32.glob("*.c"):
        if source.name != "main.c":  # generated: held by tests of its own
            made.objects[source.name] = made.compiled(source, "-O0")
    return made


def calls(objects: dict[str, Path]) -> dict[str, set[str]]:
    """By file, the other files whose functions or data it uses."""
    names: dict[str, dict[str, set[str]]] = {"T": {}, "U": {}}
    for file, compiled in objects.items():
        for kind, name in re.findall(r" ([TU]) (esea_\w+)", said("nm", compiled)):
            names[kind].setdefault(name, set()).add(file)
    uses: dict[str, set[str]] = {file: set() for file in objects}
    for name, users in names["U"].items():
        for user in users:
            uses[user] |= names["T"].get(name, set()) - {user}
    return uses


def test_files_of_the_application_call_each_other_one_way(link_fuzzer):
    uses = calls({n: o for n, o in link_fuzzer.objects.items() if (FIRMWARE / "app" / n).exists()})
    assert uses["link.c"] >= {"app.c", "keep.c", "send.c"}
    TopologicalSorter(uses).prepare()
    with pytest.raises(CycleError):
        TopologicalSorter(uses | {"keep.c": {"app.c"}}).prepare()


def test_nothing_over_the_link_moves_the_motor_past_its_limits(link_fuzzer):
    assert "it failed" not in fuzz(link_fuzzer.program(), 4000, 600)


def test_no_bytes_are_taken_for_a_frame_that_is_none(link_fuzzer):
    parser = ROOT / "tests" / "fuzz" / "parser.c"
    target = link_fuzzer.folder / "fuzz_parser"
    device = (o for n, o in link_fuzzer.objects.items() if n.startswith("esea_"))
    sources = (parser, FIRMWARE / "app" / "reader.c", *device, "-lm")
    assert "it failed" not in fuzz(fuzzer(target, *link_fuzzer.flags, *sources), 20000, 64)
    # Armed: signatures are not looked at.
    assert "it failed" in fuzz(fuzzer(target, *link_fuzzer.flags, "-DBLIND", *sources), 20000, 64)


@pytest.mark.parametrize(
    ("file", "find", "put"),
    [
        (
            "schedule.c",
            "const bool enable = esea_state_drives(app->state) && outcome->fault == 0u;",
            "const bool enable = true;",
        ),
        ("streams.c", "fields->stream >= ESEA_LINK_STREAMS ||", ""),
    ],
    ids=["motor on in any state", "a stream of any number"],
)
def test_the_links_fuzzer_is_armed(link_fuzzer, file, find, put):
    assert "it failed" in fuzz(link_fuzzer.program(file, find, put), 20000, 600)
