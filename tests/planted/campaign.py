"""Mutation tests of this program's own sources.

A copy of the checkout gets one fault at a time, and child processes run tests against it until one
fails: those that are known to enter the faulty function (:mod:`tests.planted.entered`), the nearest
test files by import, and ``esea-gen check`` where what is emitted may follow from the source.  Left
out by default are tests that only compare with committed output: whoever made the fault would
accept its output too.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from compileall import compile_dir
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from queue import SimpleQueue
from random import Random
from time import monotonic
from typing import Any, Literal

from esea_gen.errors import UserError

from .edits import PythonFaults, PythonMutant
from .entered import entering
from .near import PACKAGE, Importers, is_committed, near_tests
from .ready import CHECK

NOT_COPIED = (".git", ".venv", "out", "dist", "build", "__pycache__", ".*_cache", ".hypothesis")
COMMITTED_TEST = "committed"  # in the name of a test that compares with committed output
NO_TESTS = 5  # what pytest gives where nothing is left to run
# Tests get so many times their time without a fault, and this: nothing is kept from one fault to
# the next, so what a sound run had compiled already is compiled again.
SPARE_S, TIMES = 60.0, 6.0
BROKEN_MOST = 5  # so many tests that fail without a fault are set aside before a file is given up
# A test's name in pytest's summary; its parameters may hold a dash, as may what follows it.
FAILED = re.compile(
    r"^(?:FAILED|ERROR) (\S+?(?:::[^\n\[]*?(?:\[[^\n]*?\])?)?)(?: - .*)?$", re.MULTILINE
)
Fate = Literal["killed", "survived", "no end"]


@dataclass(frozen=True)
class Found:
    """What became of one fault: who noticed it, or the test files that did not."""

    of: str
    mutant: PythonMutant
    fate: Fate
    noticed_by: str
    tests: tuple[str, ...]

    def __str__(self) -> str:
        told = {"survived": "survived", "no end": f"no end in {self.noticed_by}"}
        return f"{told.get(self.fate, f'noticed by {self.noticed_by}')}: {self.mutant}"


@dataclass
class PythonReport:
    """What became of the faults; a test that does not end counts as one that fails."""

    seed: int
    found: list[Found] = field(default_factory=list)
    broken: set[str] = field(default_factory=set)  # they fail without a fault: they prove nothing
    left_out: tuple[int, int] = (0, 0)  # places that give no wrong result by rule, of so many

    @property
    def survivors(self) -> list[PythonMutant]:
        """Faults that no test noticed, the suspects among them."""
        return [f.mutant for f in self.found if f.fate == "survived"]

    @property
    def score(self) -> float:
        """Share that was noticed of all that were tried, suspects counted as missed."""
        return 1 - len(self.survivors) / len(self.found) if self.found else 1.0

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content, without the mutants' whole files."""
        rows = [asdict(f) for f in self.found]
        for row in rows:
            del row["mutant"]["text"]
        told = {"seed": self.seed, "score": self.score, "left_out_by_rule": self.left_out}
        return told | {"fails_without_fault": sorted(self.broken), "faults": rows}

    def table(self) -> list[str]:
        """Lines for the terminal: survivors, then what came of all."""
        suspects = sum(bool(m.suspect) for m in self.survivors)
        whats = list(dict.fromkeys(f.of for f in self.found))
        fates = {w: [f.fate for f in self.found if f.of == w] for w in whats}
        return [
            *(f"survived: {m}" + f"  ({m.suspect})" * bool(m.suspect) for m in self.survivors),
            *(f"fails without a fault, set aside: {name}" for name in sorted(self.broken)),
            *(f"{w}: {len(x) - x.count('survived')} of {len(x)}" for w, x in fates.items()),
            f"{len(self.found) - len(self.survivors)} of {len(self.found)} faults noticed "
            f"({sum(f.noticed_by == CHECK for f in self.found)} by {CHECK} alone), "
            f"{len(self.survivors)} survived ({suspects} of these may do nothing at all)",
            "{} of {} places left out by rule: no wrong result".format(*self.left_out),
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


class _Copy:
    # A copy of the checkout, and its tests in child processes of one that is ready for them.
    # What is known of the tests, broken, sound or their time, copies share.

    def __init__(
        self, root: Path, folder: Path, independent: bool, broken: set[str], times: dict[str, float]
    ) -> None:
        self.root = folder / "checkout"
        shutil.copytree(root, self.root, ignore=shutil.ignore_patterns(*NOT_COPIED))
        # Plans and libraries of faulty code are nothing to keep.
        paths = os.pathsep.join(map(str, (self.root, self.root / "host")))
        fixed = {"PYTHONPATH": paths, "PYTHONHASHSEED": "0", "XDG_CACHE_HOME": str(folder)}
        # Bytecode of the sound sources; a fault must not meet that of another one.
        compile_dir(self.root / PACKAGE, quiet=2)
        self.said = folder / "said.txt"
        self.ready = subprocess.Popen(
            [sys.executable, "-P", Path(__file__).with_name("ready.py")],
            cwd=self.root,
            env=os.environ | fixed | {"PYTHONDONTWRITEBYTECODE": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.select = ["-m", "not slow"]
        if independent:
            self.select += ["-k", f"not {COMMITTED_TEST}"]
        self.broken, self.times = broken, times

    def run(self, tests: Sequence[str], limit_s: float | None, **env: str) -> tuple[Any, str]:
        """pytest's exit code, None where the time was not enough, and what it said."""
        arguments = ["-q", "-rfE", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", *self.select]
        arguments += [f"--deselect={name}" for name in sorted(self.broken)]
        request = {
            "arguments": [*arguments, *tests],
            "env": env,
            "said": str(self.said),
            "limit_s": limit_s,
        }
        assert self.ready.stdin is not None
        assert self.ready.stdout is not None
        self.ready.stdin.write(json.dumps(request) + "\n")
        self.ready.stdin.flush()
        code = json.loads(self.ready.stdout.readline())
        return code, self.said.read_text(encoding="utf-8", errors="replace")

    def close(self) -> None:
        """Let the process that is ready end."""
        if self.ready.stdin:
            self.ready.stdin.close()
        self.ready.wait()

    def sound_s(self, test: str) -> float:
        """Time of a test file, or of one test, without a fault; what fails there is set aside."""
        for _ in range(BROKEN_MOST):
            if test in self.times or test in self.broken:
                break
            start = monotonic()
            code, said = self.run([test], None)
            if code in (0, NO_TESTS):
                self.times[test] = monotonic() - start
                break
            failed = FAILED.search(said)
            self.broken.add(failed[1] if failed else test)
        else:
            self.broken.add(test)
        return self.times.get(test, 0.0)

    def fate_of(
        self, mutant: PythonMutant, stages: Sequence[Mapping[str, float]], limit_s: float | None
    ) -> tuple[Fate, str]:
        """Who notices, of tests that are asked stage by stage; with the times that are known."""
        for tests in stages:
            seconds = sum(s or self.sound_s(t) for t, s in tests.items())
            fate = self.noticed(mutant, list(tests), limit_s or SPARE_S + TIMES * seconds)
            if fate[0] != "survived":
                return fate
        return "survived", ""

    def noticed(self, mutant: PythonMutant, tests: Sequence[str], limit: float) -> tuple[Fate, str]:
        """The first test that fails with the fault, and passes without."""
        for _ in range(BROKEN_MOST):
            usable = [t for t in tests if t not in self.broken]
            with self.fault(mutant):
                code, said = self.run(usable, limit) if usable else (0, "")
            if code in (0, NO_TESTS):
                return "survived", ""
            if code is None:  # is it the fault that makes tests last so long, or the machine?
                with tempfile.TemporaryDirectory(dir=self.root.parent) as empty:
                    sound = self.run(usable, limit, XDG_CACHE_HOME=empty)[0]
                return ("survived", "") if sound is None else ("no end", usable[0])
            failed = FAILED.search(said)
            name = failed[1] if failed else usable[0]
            self.sound_s(name)
            if name not in self.broken:
                return "killed", name
        return "survived", ""

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


def _drawn(files: Sequence[PythonFaults], sample: int | None, seed: int) -> list[PythonMutant]:
    places = [(f, k) for f in files for k in range(len(f))]
    Random(seed).shuffle(places)
    made: dict[tuple[str, str], PythonMutant] = {}
    for f, k in places:
        if sample is not None and len(made) >= sample:
            break
        mutant = f.make(k)
        if mutant is not None:
            made.setdefault((mutant.path, mutant.text), mutant)
    return sorted(made.values(), key=lambda m: (m.path, m.line, m.kind, m.edit))


def _asked(what: str, sample: int | None) -> tuple[str, int | None]:
    # ``room:8`` has a number of its own.
    name, _, number = what.partition(":")
    if not number:
        return name, sample
    if not number.isdigit() or int(number) < 1:
        raise UserError(f"'{what}': no number of faults.", "Write ROOM:8, or ROOM alone.")
    return name, int(number)


def mutate_python(
    root: Path,
    whats: Sequence[str],
    *,
    sample: int | None = None,
    seed: int = 0,
    tests: Sequence[str] = (),
    independent: bool = True,
    widen: int = 0,
    limit_s: float | None = None,
    jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> PythonReport:
    """Plant faults into rooms or files of a checkout, which is copied, and run tests against each.

    tests: instead of the nearest by import; limit_s: of all of them, else from their own time.
    """
    say = progress or (lambda _: None)
    drawn: list[tuple[str, PythonMutant]] = []
    left_out = places = 0
    for what in whats:
        name, number = _asked(what, sample)
        files = [PythonFaults(p.as_posix(), (root / p).read_text()) for p in sources_of(root, name)]
        drawn += [(name, m) for m in _drawn(files, number, seed)]
        left_out += sum(f.left_out for f in files)
        places += sum(f.left_out + len(f) for f in files)
    graph = Importers(root)
    # Before the first is tried: a file that no test imports is refused at once.
    asked_of = {
        path: list(tests) or near_tests(graph, Path(path), independent=independent, widen=widen)
        for path in {m.path for _, m in drawn}
    }
    entered = {} if tests else entering(root)

    def stages(mutant: PythonMutant) -> list[dict[str, float]]:
        # Tests that are known to enter the function, the nearest by import, the emitted bytes.
        known = entered.get(f"{mutant.path}:{mutant.function}", {})
        if independent:
            known = {t: s for t, s in known.items() if not is_committed(t)}
        near = dict.fromkeys(asked_of[mutant.path], 0.0)
        emits = not tests and graph.emits(Path(mutant.path))
        return [known, near, {CHECK: 0.0} if emits else {}]

    report = PythonReport(seed, left_out=(left_out, places))
    with tempfile.TemporaryDirectory(prefix="esea-mutate-") as scratch, ExitStack() as stack:
        times: dict[str, float] = {}
        copies: SimpleQueue[_Copy] = SimpleQueue()
        for k in range(min(jobs, len(drawn))):
            folder = Path(scratch) / str(k)
            folder.mkdir()
            copy = _Copy(root, folder, independent, report.broken, times)
            copies.put(stack.enter_context(closing(copy)))

        def found(one: tuple[str, PythonMutant]) -> Found:
            name, mutant = one
            asked = asked_of[mutant.path]
            copy = copies.get()
            try:
                fate, noticed_by = copy.fate_of(mutant, stages(mutant), limit_s)
            finally:
                copies.put(copy)
            if noticed_by in ("", CHECK) and report.broken.issuperset(asked):
                raise UserError(
                    f"The tests do not pass without a fault ({', '.join(asked) or 'none'}).",
                    "Mend them, or choose others with --tests.",
                )
            return Found(name, mutant, fate, noticed_by, tuple(asked))

        with ThreadPoolExecutor(jobs) as pool:
            for k, one in enumerate(pool.map(found, drawn)):
                report.found.append(one)
                say(str(one))
                say(f"{k + 1} of {len(drawn)} faults, {len(report.survivors)} survived")
    return report
