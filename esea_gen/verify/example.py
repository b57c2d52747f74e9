"""The emitted example program, compiled as its header says and run: it must compare, and agree."""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from esea_gen.board.firmware import compile_objects
from esea_gen.emit.formats import FORMATS
from esea_gen.hostlib.compiler import compiler, run_tool, write_texts

_SAMPLES = re.compile(r"^(\d+) of (\d+) samples agree$", re.M)
_LATCH = re.compile(r"^latch: (\d+) of (\d+) hold$", re.M)
_LONGEST_S = 60.0


@dataclass(frozen=True)
class ExampleRun:
    """What the example program said."""

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
    """What to think of an example program's words and exit code."""
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
