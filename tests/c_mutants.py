"""Hand-written C with one fault each, and whether its tests notice.

python -m tests.c_mutants [drivers/escon.c ...] [--sample N] [--seed N]; without a file, all.
"""

from __future__ import annotations

import argparse
import importlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from random import Random

import pytest

import esea_gen
from esea_gen.board import firmware

ROOT = Path(__file__).parents[1]
INSIDE = "ESEA_C_MUTANTS"
LIMIT_S = 60  # of the processor, or ten times that by the clock: a fault without end

# By file, the tests that hold it, first those that tell soonest.
DRIVERS = ("test_drivers.py", "test_motor_driver.py")
TESTS = {
    "app/machine.c": ("test_states.py", "test_states_any_order.py"),
    "app/keep.c": ("test_kept.py", "test_wire.py", "test_life.py"),
    "app/life.c": ("test_life.py",),
    "app/schedule.c": ("test_states.py", "test_blackbox_flown.py", "test_wire.py", "test_kept.py"),
    "app/link.c": (
        "test_expiry.py",
        "test_wire.py",
        "test_paired.py",
        "test_states.py",
        "test_kept.py",
    ),
    "app/reader.c": ("test_expiry.py", "test_paired.py"),
    "app/signing.c": ("test_paired.py", "test_expiry.py"),
    "drivers/as5048a.c": DRIVERS,
    "drivers/biss.c": DRIVERS,
    "drivers/escon.c": DRIVERS,
    "drivers/stop_line.c": DRIVERS,
    "app/blackbox.c": ("test_blackbox.py", "test_blackbox_flown.py"),
    "app/rainflow.c": ("test_life.py",),
    "app/store.c": ("test_store.py", "test_kept.py"),
}

# A token and what stands in its place; after the place of the first match, the rest of the line.
SWAPS = (
    (r"(?<=[\w)\]] )<(?= )", ("<=", ">=")),
    (r"(?<=[\w)\]] )>(?= )", (">=", "<=")),
    (r"(?<=[\w)\]] )<=(?= )", ("<", ">")),
    (r"(?<=[\w)\]] )>=(?= )", (">", "<")),
    (r"(?<=[\w)\]] )==(?= )", ("!=",)),
    (r"(?<=[\w)\]] )!=(?= )", ("==",)),
    (r"(?<=[\w)\]] )&&(?= )", ("||",)),
    (r"\|\|(?= )", ("&&",)),
    (r"(?<=[\w)\]] )\+(?= )", ("-",)),
    (r"(?<=[\w)\]] )-(?= )", ("+",)),
    (r"(?<=[\w)\]] )\*(?= )", ("/",)),
    (r"(?<=[\w)\]] )/(?= )", ("*",)),
    (r"(?<=[\w)\]] )%(?= )", ("/",)),
    (r"(?<=[\w)\]] )&(?= )", ("|",)),
    (r"(?<=[\w)\]] )\|(?= )", ("&",)),
    (r"(?<=[\w)\]] )\^(?= )", ("|",)),
    (r"(?<=[\w)\]] )<<(?= )", (">>",)),
    (r"(?<=[\w)\]] )>>(?= )", ("<<",)),
    (r"\+\+", ("--",)),
    (r"(?<![-\w])--(?=\w)", ("++",)),
    (r"(?<= )(\+|-|\||&)=(?= )", ("=",)),
    (r"\btrue\b", ("false",)),
    (r"\bfalse\b", ("true",)),
    (r"(?<=\()!(?=\w)", ("",)),
    (r"\b\d+u\b", ("+1", "-1")),
    (r"\b\d+\.\d+f\b", ("+1",)),
)
# A statement alone on its line.
STATEMENT = re.compile(
    r"^\s+(?!return|break|continue|static|const|case|default|\})[^={}]*(=|\()[^{}]*;$"
)


def mutants(text: str) -> Iterator[tuple[str, str]]:
    """Every fault: what was changed, and the whole text."""
    lines = text.split("\n")
    inside = False
    for number, line in enumerate(lines):
        code = re.sub(r"/\*.*?\*/", lambda m: " " * len(m[0]), line)
        opened = "/*" in code
        if inside or opened or code.startswith(("#include", " *")):
            inside = (inside or opened) and "*/" not in line.split("/*")[-1]
            continue

        def put(new: str, what: str, number: int = number) -> tuple[str, str]:
            changed = [*lines[:number], new, *lines[number + 1 :]]
            return f"line {number + 1}: {what}", "\n".join(changed)

        for pattern, others in SWAPS:
            for at in re.finditer(pattern, code):
                for other in others:
                    new = other
                    if other in ("+1", "-1"):
                        if line.lstrip().startswith("case") or (other == "-1" and at[0] == "0u"):
                            continue
                        new = f"({at[0]} {other[0]} 1{'.0f' if 'f' in at[0] else 'u'})"
                    yield put(line[: at.start()] + new + line[at.end() :], f"{at[0]} -> {new}")
        if STATEMENT.match(code) and not re.match(
            r"^\s+(u?int|bool|float|size_t|esea|head)\w* ", code
        ):
            yield put(re.match(r"\s*", line)[0] + ";", f"{line.strip()} dropped")


def compiles(file: Path, folder: Path) -> bool:
    """Whether a file of the firmware is C still; ``folder`` has what it knows of the drive."""
    places = [
        *(ROOT / "firmware" / d for d in ("app", "port", "drivers")),
        folder,
        folder / "mavlink",
    ]
    known = ('-DESEA_LINK_HEADER="esea_elbow_drive_link.h"', '-DESEA_BOARD_NAME="sim"')
    command = ["gcc", "-std=c99", "-w", "-fsyntax-only", *known, *(f"-I{p}" for p in places), file]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def fate(file: str, text: str, tests: list[str], folder: Path) -> str:
    """Killed, survived, or no mutant because it does not compile; in a copy of the checkout."""
    (ROOT / "firmware" / file).write_text(text, encoding="utf-8")
    if not compiles(ROOT / "firmware" / file, folder):
        return "stillborn"
    # A child of its own: what the tests import is there already.
    child = os.fork()
    if child == 0:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
            signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
            signal.alarm(10 * LIMIT_S)
            os._exit(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow", *tests]))
    return "killed" if os.waitpid(child, 0)[1] else "survived"


def share_what_no_fault_changes(folder: Path) -> None:
    """The drive and its C, which every test would make anew: made here, and inherited by all."""
    load, render = cache(esea_gen.load_device), cache(firmware.render_device)
    esea_gen.load_device = load
    firmware.render_device = lambda device, reals: render(device, tuple(reals))
    firmware.render_dialect = cache(firmware.render_dialect)
    firmware.build_firmware(load("elbow_drive"), "sim", folder)
    files = firmware.render_device(load("elbow_drive"), ["f32"])[0].files
    for name, text in (files | firmware.render_dialect(load("elbow_drive")).files).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def campaign(file: str, sample: int | None, seed: int, folder: Path) -> None:
    """Says which faults survive; in a copy of the checkout."""
    text = (ROOT / "firmware" / file).read_text(encoding="utf-8")
    tests = [f"tests/{name}" for name in TESTS[file]]
    made = list(mutants(text))
    if sample is not None and sample < len(made):
        made = Random(seed).sample(made, sample)
    assert fate(file, text, tests, folder) == "survived", "the tests fail without a fault"
    born, caught = 0, 0
    for what, changed in made:
        end = fate(file, changed, tests, folder)
        born += end != "stillborn"
        caught += end == "killed"
        if end == "survived":
            print(f"  {file} {what}", flush=True)
    print(f"{file}: {caught} of {born} caught", flush=True)
    (ROOT / "firmware" / file).write_text(text, encoding="utf-8")


def main() -> None:
    """From the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("files", nargs="*", metavar="FILE")
    parser.add_argument("--sample", type=int)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if os.environ.get(INSIDE):
        with tempfile.TemporaryDirectory() as folder:
            for name in sorted({name for tests in TESTS.values() for name in tests}):
                importlib.import_module(f"tests.{Path(name).stem}")
            share_what_no_fault_changes(Path(folder))
            for file in given.files or TESTS:
                campaign(file, given.sample, given.seed, Path(folder))
        return
    with tempfile.TemporaryDirectory(prefix="esea-c-mutants-") as scratch:
        copy = Path(scratch) / "checkout"
        ignored = (".git", ".venv", "out", "__pycache__", ".*_cache", "generated")
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*ignored))
        env = os.environ | {"PYTHONPATH": f"{copy}:{copy / 'host'}", INSIDE: "1"}
        command = [sys.executable, "-m", "tests.c_mutants", *sys.argv[1:]]
        sys.exit(subprocess.run(command, cwd=copy, env=env, check=False).returncode)


if __name__ == "__main__":
    main()
