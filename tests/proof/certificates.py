"""Certificates of the fixed-point arithmetic, by Gappa and z3, each tied to the emitted C."""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from esea_gen.emit.fixed.functions import source_files
from esea_gen.files import template_folder
from esea_gen.hostlib.compiler import find_compiler
from esea_gen.verify.proof import TIMEOUT_S

from .emitted_c import Reader
from .smt import Script

Change = Callable[[str, str], str]


@dataclass(frozen=True)
class RoundingResult:
    """What a prover said of the arithmetic core."""

    script: str
    goal: str
    proven: bool
    why: str = ""


def _translated(path: Path, function: str, defines: list[str]) -> str:
    """Definitions of what a function of the emitted text computes."""
    script = Script()
    reader = Reader(path, script, free="*", defines=defines)
    _, made = reader.result(function)
    text = [
        f"(define-fun c_{name} () {value.type.sort} {reader.term(value)})"
        for name, value in made.items()
    ]
    for k, parts in enumerate(reader.products):
        for name, value in zip(("left", "right", "product"), parts, strict=True):
            sort = value.type.sort
            text.append(f"(define-fun {name}_{k} () {sort} {reader.term(value)})")
    return "\n".join([*script.lines, *text])


def _bare(text: str) -> str:
    return re.sub(r"\s+", "", text)


def _quoted(script: str) -> list[tuple[str, str]]:
    """File and text of each quotation."""
    out: list[tuple[str, list[str]]] = []
    for line in script.splitlines():
        start = re.fullmatch(r"# C (\S+\.[ch])", line)
        if start:
            out.append((start.group(1), []))
        elif out and line.startswith("#   "):
            out[-1][1].append(line[4:])
    return [(file, "\n".join(lines)) for file, lines in out]


def _gappa(text: str, sources: dict[str, str]) -> tuple[bool, str]:
    quotes = _quoted(text)
    if not quotes:
        return False, "no C is quoted"
    for file, quote in quotes:
        if _bare(quote) not in _bare(sources[file]):
            return False, f"{file} is not what the script says:\n{quote}"
    done = _ran([find_compiler("gappa", "gappa")], text)
    # A rewriting that is no identity is a warning only: it would be an assumption.
    return done.returncode == 0 and "Warning" not in done.stdout + done.stderr, done.stderr


def _z3(text: str, folder: Path) -> tuple[bool, str]:
    named = re.search(r"^; C (\S+) (\w+)((?: \w+)*)$", text, re.M)
    if named is None:
        return False, "no function of the C is named"
    file, function, defines = named.groups()
    first = "(set-logic QF_BV)\n"
    if text.count(first) != 1:
        return False, "no line sets the logic"
    c = _translated(folder / file, function, defines.split())
    done = _ran([find_compiler("z3", "z3"), "-in"], text.replace(first, f"{first}{c}\n"))
    said = (done.stdout + done.stderr).strip()
    return done.returncode == 0 and said == "unsat", said


def _ran(command: list[str], text: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, input=text, capture_output=True, text=True, check=False, timeout=TIMEOUT_S
    )


def prove_rounding(change: Change | None = None) -> list[RoundingResult]:
    """Certify the rounding of the arithmetic core, by Gappa and by z3."""
    out = []
    with tempfile.TemporaryDirectory() as scratch:
        folder, sources = Path(scratch), {}
        for path in source_files():
            text = path.read_text(encoding="utf-8")
            sources[path.name] = change(path.name, text) if change else text
            (folder / path.name).write_text(sources[path.name], encoding="utf-8")
        for path in sorted((template_folder() / "proof").iterdir()):
            if path.suffix not in (".gappa", ".smt2"):
                continue
            text = path.read_text(encoding="utf-8")
            text = change(path.name, text) if change else text
            proven, why = _gappa(text, sources) if path.suffix == ".gappa" else _z3(text, folder)
            goal = text.splitlines()[0].lstrip("#; ")
            out.append(RoundingResult(path.name, goal, proven, "" if proven else why))
    return out
