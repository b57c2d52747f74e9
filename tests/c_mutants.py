"""Hand-written C with one fault each, and whether its tests notice.

python -m tests.c_mutants drivers/escon.c tests/test_drivers.py [--sample N] [--seed N]
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
from pathlib import Path
from random import Random

import pytest

ROOT = Path(__file__).parents[1]
INSIDE = "ESEA_C_MUTANTS"
LIMIT_S = 60  # a fault without end

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


def fate(file: str, text: str, tests: list[str]) -> str:
    """Killed, survived, or no mutant because it does not compile; in a copy of the checkout."""
    (ROOT / "firmware" / file).write_text(text, encoding="utf-8")
    if "blackbox" not in file:
        folders = [f"-I{ROOT}/firmware/{d}" for d in ("app", "port", "drivers")]
        check = ["gcc", "-std=c99", "-w", "-fsyntax-only", *folders, ROOT / "firmware" / file]
        if subprocess.run(check, capture_output=True, check=False).returncode:
            return "stillborn"
    # A child of its own: what the tests import is there already.
    child = os.fork()
    if child == 0:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
            signal.alarm(LIMIT_S)
            os._exit(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow", *tests]))
    return "killed" if os.waitpid(child, 0)[1] else "survived"


def campaign(file: str, tests: list[str], sample: int | None, seed: int) -> None:
    """Says which faults survive; in a copy of the checkout."""
    text = (ROOT / "firmware" / file).read_text(encoding="utf-8")
    made = list(mutants(text))
    if sample is not None and sample < len(made):
        made = Random(seed).sample(made, sample)
    for test in tests:
        importlib.import_module(test.removesuffix(".py").replace("/", "."))
    assert fate(file, text, tests) == "survived", "the tests fail without a fault"
    born, caught = 0, 0
    for what, changed in made:
        end = fate(file, changed, tests)
        born += end != "stillborn"
        caught += end == "killed"
        if end == "survived":
            print(f"  {file} {what}", flush=True)
    print(f"{file}: {caught} of {born} caught", flush=True)


def main() -> None:
    """From the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("file")
    parser.add_argument("tests", nargs="+")
    parser.add_argument("--sample", type=int)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if os.environ.get(INSIDE):
        campaign(given.file, given.tests, given.sample, given.seed)
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
