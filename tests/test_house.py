"""The house stays one that a newcomer can hold: one direction, no circle, no room that outgrows it.

The direction itself is written in pyproject.toml (``[tool.importlinter]``); imports inside
functions count.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import ROOT

MOST_LINES, MOST_FUNCTION = 500, 80
# A file or function may be longer where a line says why: `# Long: reason` at its top.
REASON = "# Long: "
ROOMS = ("esea_gen", "host")


def sources() -> list[Path]:
    return sorted(p for room in ROOMS for p in (ROOT / room).rglob("*.py"))


def long_ones(path: Path) -> list[str]:
    """What in a file is too long without a reason."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    found = []
    if len(lines) > MOST_LINES and not any(x.startswith(REASON) for x in lines[:20]):
        found.append(f"{path.name}: {len(lines)} lines")
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = node.end_lineno - node.lineno + 1
            body = lines[node.lineno - 1 : node.body[0].end_lineno + 2]
            if length > MOST_FUNCTION and not any(x.strip().startswith(REASON) for x in body):
                found.append(f"{path.name}: {node.name} has {length} lines")
    return found


def test_nothing_outgrows_its_room():
    assert [x for path in sources() for x in long_ones(path)] == []


def linted(folder: Path) -> tuple[int, str]:
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()"]
    done = subprocess.run(
        [*command, "--no-cache"],
        cwd=folder,
        env={"PYTHONPATH": f"{folder}:{folder / 'host'}", "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


def test_one_direction_and_no_circle():
    code, said = linted(ROOT)
    assert code == 0, said
    assert "6 kept, 0 broken" in said


def test_a_class_name_is_used_once():
    """So that a reader who finds a name has found it."""
    names = Counter(
        name
        for path in sources()
        for name in re.findall(r"(?m)^class ([^\W_]\w*)", path.read_text(encoding="utf-8"))
    )
    assert {n: k for n, k in names.items() if k > 1} == {}


def test_no_test_is_skipped_behind_the_back_of_ci():
    """What is missing is told by conftest's two helpers, which fail where all is required."""
    word = "import" + "orskip"
    found = [p.name for p in (ROOT / "tests").glob("*.py") if word in p.read_text(encoding="utf-8")]
    assert found == []


WEIGHED = {
    "product": ("esea_gen/**/*.py", "host/**/*.py"),
    "tests": ("tests/**/*.py",),
    "firmware": ("firmware/**/*.*", "templates/**/*.*"),
    "generated": ("generated/**/*.*",),
    "words": ("docs/**/*.md", "README.md"),
}


def weight(name: str) -> int:
    """Lines that are kept in the repository, of the pages words."""
    done = subprocess.run(
        ["git", "ls-files", "--", *(f":(glob){p}" for p in WEIGHED[name])],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    total = 0
    for file in done.stdout.split():
        data = (ROOT / file).read_bytes()
        if b"\0" not in data:
            total += len(data.split()) if name == "words" else data.count(b"\n")
    return total


def most(entry: dict) -> int:
    """What a total may be: the number, and what was added since, each with its reason."""
    raised = entry.get("raised", [])
    assert all(len(x["why"].split()) >= 3 for x in raised), "say why"
    return entry["lines"] + sum(x["lines"] for x in raised)


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="counts what is committed")
def test_the_house_does_not_grow_unnoticed():
    totals = tomllib.loads((ROOT / "tests" / "totals.toml").read_text(encoding="utf-8"))
    assert totals.keys() == WEIGHED.keys()
    over = {n: weight(n) - most(entry) for n, entry in totals.items() if weight(n) > most(entry)}
    assert over == {}, "make it lighter, or add an entry to tests/totals.toml that says why"
    with pytest.raises(AssertionError, match="say why"):
        most({"lines": 1, "raised": [{"lines": 5, "why": ""}]})


PUBLIC = ("_exit", "_replace")  # of os, of named tuples


def hidden(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__") and name not in PUBLIC


def private_names(text: str) -> Iterator[str]:
    """Names of our packages that begin with a line, where a test imports or reads them."""
    if not re.search(r"\b_\w+\b(?<!__)", text):
        return
    tree = list(ast.walk(ast.parse(text)))
    own = {
        x.name if isinstance(x, ast.FunctionDef | ast.ClassDef) else x.attr
        for x in tree
        if isinstance(x, ast.FunctionDef | ast.ClassDef)
        or (isinstance(x, ast.Attribute) and isinstance(x.ctx, ast.Store))
    }
    for node in tree:
        if isinstance(node, ast.ImportFrom):
            if (node.module or "").startswith(("esea_gen", "esea_host")):
                yield from (a.name for a in node.names if hidden(a.name))
        elif isinstance(node, ast.Attribute) and hidden(node.attr) and node.attr not in own:
            yield node.attr


def test_tests_use_the_public_face():
    found = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in (ROOT / "tests").rglob("*.py")
        for name in private_names(path.read_text(encoding="utf-8"))
    }
    assert found == set()
    armed = "from esea_gen.files import _x\ny._z\nself.__init__\n"
    assert list(private_names(armed)) == ["_x", "_z"]
