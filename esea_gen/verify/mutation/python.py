"""Mutation of this program's own sources, to see whether its tests notice.

A copy of the checkout gets one fault at a time, and a child process runs tests against it.  Left
out by default are tests that only compare with committed output: whoever made the fault would
accept its output too.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from esea_gen.errors import UserError
from esea_gen.verify.mutation.python_edits import PythonFaults, PythonMutant

PACKAGE = "esea_gen"
# Tests that hold against committed output, or against the whole checkout.
COMMITTED = ("test_traces.py", "test_docs.py", "test_house.py", "test_wheel.py", "test_main_job.py")
NOT_COPIED = (".git", ".venv", "out", "dist", "build", "__pycache__", ".*_cache", ".hypothesis")
Fate = Literal["killed", "survived", "no end"]


@dataclass
class PythonReport:
    """What became of the faults.

    found: fault and fate, in order; a test that does not end counts as one that fails.
    """

    files: tuple[str, ...]
    tests: tuple[str, ...]
    seed: int
    found: list[tuple[PythonMutant, Fate]] = field(default_factory=list)

    @property
    def survivors(self) -> list[PythonMutant]:
        """Faults that no test noticed, the suspects among them."""
        return [m for m, fate in self.found if fate == "survived"]

    @property
    def score(self) -> float:
        """Share that was noticed of all that were tried, suspects counted as missed."""
        return 1 - len(self.survivors) / len(self.found) if self.found else 1.0

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content."""
        rows = [
            {"file": m.path, "line": m.line, "kind": m.kind, "edit": m.edit, "fate": fate}
            | ({"equivalent_suspect": m.suspect} if m.suspect and fate == "survived" else {})
            for m, fate in self.found
        ]
        names = {"files": list(self.files), "tests": list(self.tests), "seed": self.seed}
        return names | {"tried": len(self.found), "score": self.score, "mutants": rows}

    def table(self) -> list[str]:
        """Lines for the terminal: survivors, then what came of all."""
        lines = [f"{m}" + f"  ({m.suspect})" * bool(m.suspect) for m in self.survivors]
        suspects = sum(bool(m.suspect) for m in self.survivors)
        killed = len(self.found) - len(self.survivors)
        return [
            *(f"survived: {line}" for line in lines),
            f"{killed} of {len(self.found)} faults noticed, {len(self.survivors)} survived "
            f"({suspects} of these may do nothing at all)",
        ]


def sources_of(root: Path, what: str) -> list[Path]:
    """Python files of a room or file, relative to a checkout."""
    for path in (root / what, root / PACKAGE / what, root / PACKAGE / f"{what}.py"):
        if path.is_dir():
            return sorted(p.relative_to(root) for p in path.rglob("*.py"))
        if path.suffix == ".py" and path.is_file():
            return [path.relative_to(root)]
    rooms = sorted(p.parent.name for p in (root / PACKAGE).glob("*/__init__.py"))
    raise UserError(
        f"There is no room or file '{what}' in {root / PACKAGE}.",
        f"Rooms: {', '.join(rooms)}." if rooms else "Run it in a checkout of the sources.",
    )


def chosen_tests(root: Path, sources: Sequence[Path], independent: bool) -> list[Path]:
    """Test files that speak of these sources, or of their room, by import."""
    modules = [".".join(p.with_suffix("").parts).removesuffix(".__init__") for p in sources]
    rooms = {".".join(m.split(".")[:2]) for m in modules}
    texts = {
        p.relative_to(root): p.read_text(encoding="utf-8")
        for p in sorted((root / "tests").rglob("test_*.py"))
        if not (independent and p.name in COMMITTED)
    }
    for wanted in (modules, rooms):
        found = [p for p, text in texts.items() if any(f"{m} import" in text for m in wanted)]
        if found:
            return found
    raise UserError(f"No test imports {', '.join(sorted(rooms))}.", "Name test files with --tests.")


class _Copy:
    # A copy of the checkout, and its tests in a child process.

    def __init__(self, root: Path, folder: Path, tests: Sequence[Path], independent: bool) -> None:
        self.root = folder / "checkout"
        shutil.copytree(root, self.root, ignore=shutil.ignore_patterns(*NOT_COPIED))
        command = [sys.executable, "-m", "pytest", "-x", "-q"]
        command += ["-p", "no:cacheprovider", "-p", "no:xdist"]
        ignored = [f"--ignore=tests/{name}" for name in COMMITTED] if independent else []
        self.command = [*command, *ignored, *map(str, tests)]

    def run(self, limit_s: float | None, warm: bool = False) -> tuple[int | None, str]:
        # Only the first run may write bytecode: a fault must not meet that of another one.
        paths = f"{self.root}{os.pathsep}{self.root / 'host'}"
        fixed = {"PYTHONPATH": paths, "PYTHONHASHSEED": "0"}
        env = os.environ | fixed | ({} if warm else {"PYTHONDONTWRITEBYTECODE": "1"})
        child = subprocess.Popen(
            self.command,
            cwd=self.root,
            env=env,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            said, _ = child.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.communicate()
            return None, ""
        return child.returncode, said

    @contextmanager
    def fault(self, mutant: PythonMutant) -> Iterator[None]:
        path = self.root / mutant.path
        sound = path.read_bytes()
        for kept in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            kept.unlink()
        path.write_text(mutant.text, encoding="utf-8")
        try:
            yield
        finally:
            path.write_bytes(sound)


def _drawn(
    root: Path, sources: Sequence[Path], sample: int | None, seed: int
) -> list[PythonMutant]:
    files = [PythonFaults(p.as_posix(), (root / p).read_text(encoding="utf-8")) for p in sources]
    places = [(f, k) for f in files for k in range(len(f))]
    random.Random(seed).shuffle(places)
    made: dict[tuple[str, str], PythonMutant] = {}
    for f, k in places:
        if sample is not None and len(made) >= sample:
            break
        mutant = f.make(k)
        if mutant is not None:
            made.setdefault((mutant.path, mutant.text), mutant)
    return sorted(made.values(), key=lambda m: (m.path, m.line, m.kind, m.edit))


def mutate_python(
    root: Path,
    what: str,
    *,
    sample: int | None = None,
    seed: int = 0,
    tests: Sequence[str] = (),
    independent: bool = True,
    limit_s: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> PythonReport:
    """Plant faults into a room or a file and run tests against each.

    root: checkout with ``esea_gen`` and ``tests``; it is copied, not touched.
    what: room, or file, of ``esea_gen``.
    sample: number of faults, drawn by ``seed``; all when not given.
    tests: test files or names; those that import the file or room when not given.
    independent: leave out tests that only compare with committed output.
    limit_s: time of one run of the tests; three times that without a fault when not given.
    """
    say = progress or (lambda _: None)
    sources = sources_of(root, what)
    chosen = [Path(t) for t in tests] or chosen_tests(root, sources, independent)
    report = PythonReport(tuple(map(str, sources)), tuple(map(str, chosen)), seed)
    with tempfile.TemporaryDirectory(prefix="esea-mutate-") as scratch:
        copy = _Copy(root, Path(scratch), chosen, independent)
        say("tests without a fault")
        begun = time.monotonic()
        code, said = copy.run(None, warm=True)
        if code != 0:
            tail = " ".join(said.split())[-300:]
            raise UserError(
                f"The tests do not pass without a fault (pytest's exit code {code}: {tail}).",
                "Mend them, or choose others with --tests.",
            )
        limit = limit_s or 10 + 3 * (time.monotonic() - begun)
        for k, mutant in enumerate(mutants := _drawn(root, sources, sample, seed)):
            say(f"fault {k + 1} of {len(mutants)}")
            with copy.fault(mutant):
                code, _ = copy.run(limit)
            fate: Fate = "no end" if code is None else "survived" if code == 0 else "killed"
            report.found.append((mutant, fate))
    return report
