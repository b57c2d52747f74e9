"""Mutation of this program's own sources, to see whether its tests notice."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from compileall import compile_dir
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from random import Random
from typing import Any, Literal

from esea_gen.errors import UserError

from .edits import PythonFaults, PythonMutant
from .near import (
    COMMITTED_TEST,
    PACKAGE,
    Entered,
    Importers,
    near_tests,
    usable_tests,
)

NOT_COPIED = (".git", ".venv", "out", "dist", "build", "__pycache__", ".*_cache", ".hypothesis")
NO_TESTS = 5  # what pytest gives where nothing is left to run
# A test gets so many times its time without a fault, and this: nothing is kept from one fault to
# the next, so what a sound run had compiled already is compiled again.
SPARE_S, TIMES = 60.0, 6.0
QUICK_S = 8.0  # so much time for the tests that enter the function, before whole files
SLOW_S = 60.0  # and after them, for those that enter it in all other files
PLUGIN = "esea_entered"
# A test that fails without a fault: so many are set aside before the file is given up.
BROKEN_MOST = 5
# A test's name in pytest's summary; its parameters may hold a dash, as may what follows it.
FAILED = re.compile(
    r"^(?:FAILED|ERROR) (\S+?(?:::[^\n\[]*?(?:\[[^\n]*?\])?)?)(?: - .*)?$", re.MULTILINE
)
Fate = Literal["killed", "survived", "no end"]


@dataclass(frozen=True)
class Found:
    """What became of one fault: who noticed it, or the test files that did not."""

    what: str
    mutant: PythonMutant
    fate: Fate
    noticed_by: str
    asked: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content."""
        m = self.mutant
        row = {"of": self.what, "file": m.path, "line": m.line, "kind": m.kind, "edit": m.edit}
        row |= {"fate": self.fate}
        if self.fate != "survived":
            return row | {"noticed_by": self.noticed_by}
        if m.suspect:
            row |= {"equivalent_suspect": m.suspect}
        return row | {"tests": list(self.asked)}

    def __str__(self) -> str:
        told = {"survived": "survived", "no end": f"no end in {self.noticed_by}"}
        return f"{told.get(self.fate, f'noticed by {self.noticed_by}')}: {self.mutant}"


@dataclass
class PythonReport:
    """What became of the faults."""

    seed: int
    found: list[Found] = field(default_factory=list)
    broken: set[str] = field(default_factory=set)
    left_out: tuple[int, int] = (0, 0)

    @property
    def survivors(self) -> list[PythonMutant]:
        """Faults that no test noticed, the suspects among them."""
        return [f.mutant for f in self.found if f.fate == "survived"]

    @property
    def score(self) -> float:
        """Share that was noticed of all that were tried, suspects counted as missed."""
        return 1 - len(self.survivors) / len(self.found) if self.found else 1.0

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content."""
        told = {"seed": self.seed, "tried": len(self.found), "score": self.score}
        told |= dict(zip(("left_out_by_rule", "places"), self.left_out, strict=True))
        rows = [f.to_dict() for f in self.found]
        return told | {"fails_without_fault": sorted(self.broken), "mutants": rows}

    def table(self) -> list[str]:
        """Lines for the terminal: survivors, then what came of all."""
        lines = [f"{m}" + f"  ({m.suspect})" * bool(m.suspect) for m in self.survivors]
        suspects = sum(bool(m.suspect) for m in self.survivors)
        whats = list(dict.fromkeys(f.what for f in self.found))
        fates = {w: [f.fate for f in self.found if f.what == w] for w in whats}
        killed = len(self.found) - len(self.survivors)
        return [
            *(f"survived: {line}" for line in lines),
            *(f"fails without a fault, set aside: {name}" for name in sorted(self.broken)),
            *(
                f"{w}: {len(all_) - all_.count('survived')} of {len(all_)}"
                for w, all_ in fates.items()
                if len(whats) > 1
            ),
            f"{killed} of {len(self.found)} faults noticed, {len(self.survivors)} survived "
            f"({suspects} of these may do nothing at all)",
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
    # What is known of the tests, broken or sound, copies share.

    def __init__(
        self,
        root: Path,
        folder: Path,
        independent: bool,
        entered: Path,
        broken: set[str],
        sound: set[str],
    ) -> None:
        self.root = folder / "checkout"
        shutil.copytree(root, self.root, ignore=shutil.ignore_patterns(*NOT_COPIED))
        # Plans and libraries of faulty code are nothing to keep.
        (folder / "plugin").mkdir()
        shutil.copy(Path(__file__).with_name("entered.py"), folder / "plugin" / f"{PLUGIN}.py")
        paths = os.pathsep.join(map(str, (self.root, self.root / "host", folder / "plugin")))
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
        self.broken, self.sound = broken, sound
        self.entered = Entered(self.root, entered)

    def run(
        self, tests: Sequence[str], limit_s: float | None, *more: str, **env: str
    ) -> tuple[int | None, str]:
        arguments = ["-q", "-rfE", *(more or ["-x"])]
        arguments += ["-p", "no:cacheprovider", "-p", "no:xdist", *self.select]
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
        code: int | None = json.loads(self.ready.stdout.readline())
        return code, self.said.read_text(encoding="utf-8", errors="replace")

    def close(self) -> None:
        """Let the process that is ready end."""
        if self.ready.stdin:
            self.ready.stdin.close()
        self.ready.wait()

    def limit_of(self, test: str) -> float:
        """Time that a test file may take, from a run without a fault that tells what it enters."""
        record = self.entered.file(test)
        if not record.is_file():
            self.run([test], None, "-p", PLUGIN, ESEA_ENTERED=str(record))
        return SPARE_S + TIMES * float(sum(t["time_s"] for t in self.entered.of(test).values()))

    def fate_of(
        self, mutant: PythonMutant, near: Sequence[str], all_: Sequence[str], limit_s: float | None
    ) -> tuple[Fate, str]:
        """Who notices: a test known to enter the function, one of the nearest files, the rest."""
        quick, time_s = self.entered.quick(all_, mutant.path, mutant.function, QUICK_S)
        if quick:
            found = self.who_notices(mutant, quick, limit_s or SPARE_S + TIMES * time_s)
            if found[0] != "survived":
                return found
        # Limits first: finding them runs the files without the fault.
        found = self.who_notices(mutant, near, limit_s or sum(map(self.limit_of, near)))
        far = [t for t in all_ if t not in near]
        slow, time_s = self.entered.quick(far, mutant.path, mutant.function, SLOW_S)
        if found[0] != "survived" or not slow:
            return found
        return self.who_notices(mutant, slow, limit_s or SPARE_S + TIMES * time_s)

    def who_notices(
        self, mutant: PythonMutant, tests: Sequence[str], limit_s: float
    ) -> tuple[Fate, str]:
        """The first of some tests, or of a file's, that fails with the fault and passes without."""
        for _ in range(BROKEN_MOST):
            with self.fault(mutant):
                code, said = self.run(tests, limit_s)
            if code in (0, NO_TESTS):
                return "survived", ""
            if code is None:
                return self.without_end(tests, limit_s)
            failed = FAILED.search(said)
            name = failed[1] if failed else tests[0]
            if name not in self.sound and self.run([name], None)[0] != 0:
                self.broken.add(name)
                if [name] == list(tests):
                    break
                continue
            self.sound.add(name)
            return "killed", name
        return "survived", ""

    def without_end(self, tests: Sequence[str], limit_s: float) -> tuple[Fate, str]:
        """Whether it is the fault that makes tests last so long, or the machine."""
        with tempfile.TemporaryDirectory(dir=self.root.parent) as empty:
            sound = self.run(tests, limit_s, XDG_CACHE_HOME=empty)[0]
        return ("survived", "") if sound is None else ("no end", tests[0])

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


def _faults(root: Path, sources: Sequence[Path]) -> list[PythonFaults]:
    return [PythonFaults(p.as_posix(), (root / p).read_text(encoding="utf-8")) for p in sources]


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
    entered: Path | None = None,
    jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> PythonReport:
    """Plant faults into rooms or files and run tests against each."""
    say = progress or (lambda _: None)
    drawn: list[tuple[str, PythonMutant]] = []
    left_out = places = 0
    for what in whats:
        name, number = _asked(what, sample)
        files = _faults(root, sources_of(root, name))
        drawn += [(name, m) for m in _drawn(files, number, seed)]
        left_out += sum(f.left_out for f in files)
        places += sum(f.left_out + len(f) for f in files)
    graph = Importers(root)
    sound: set[str] = set()
    # Before the first is tried: a file that no test imports is refused at once.
    asked_of, all_of = {}, {}
    for path in {m.path for _, m in drawn if not tests}:
        near = near_tests(graph, Path(path), independent=independent, widen=widen)
        asked_of[path] = [p.as_posix() for ps in near for p in ps]
        all_of[path] = usable_tests(graph, Path(path), independent)
    report = PythonReport(seed, left_out=(left_out, places))
    with tempfile.TemporaryDirectory(prefix="esea-mutate-") as scratch, ExitStack() as stack:
        kept = (entered or Path(scratch) / "entered").absolute()
        copies: SimpleQueue[_Copy] = SimpleQueue()
        for k in range(min(jobs, len(drawn))):
            folder = Path(scratch) / str(k)
            folder.mkdir()
            copy = _Copy(root, folder, independent, kept, report.broken, sound)
            copies.put(stack.enter_context(closing(copy)))

        def found(one: tuple[str, PythonMutant]) -> Found:
            name, mutant = one
            asked = [*tests] or asked_of[mutant.path]
            copy = copies.get()
            try:
                all_ = all_of.get(mutant.path, asked)
                fate, noticed_by = copy.fate_of(mutant, asked, all_, limit_s)
            finally:
                copies.put(copy)
            if report.broken.issuperset(asked):
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
