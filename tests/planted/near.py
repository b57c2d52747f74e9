"""Which tests may notice a fault in a source file: those that import it, the nearest first."""

from __future__ import annotations

import ast
import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError

PACKAGE = "esea_gen"
# Tests that hold against committed output, or against the whole checkout.
COMMITTED = ("test_traces.py", "test_docs.py", "test_house.py", "test_wheel.py", "test_main_job.py")
LEAST = 4  # so many test files are asked at least, for the nearest need not run the line
# Of the tests that enter a function so many are asked at most, of so many files.
QUICK_TESTS, QUICK_FILES = 60, 8
COMMITTED_TEST = "committed"  # in the name of a test that does so in another file


def _name(path: Path) -> str:
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def _imported(tree: ast.AST, known: set[str], folder: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found.update(a.name for a in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = folder.parts[: len(folder.parts) + 1 - node.level] if node.level else ()
            module = ".".join((*above, *filter(None, [node.module])))
            below = {f"{module}.{a.name}" for a in node.names} & known
            found.update(below)
            if len(below) < len(node.names):
                found.add(module)
    return found & known


class Importers:
    """Who imports whom in a checkout, shared files of the tests included."""

    def __init__(self, root: Path) -> None:
        files = [*(root / PACKAGE).rglob("*.py"), *(root / "tests").rglob("*.py")]
        self.paths = {_name(p.relative_to(root)): p.relative_to(root) for p in sorted(files)}
        self.users: dict[str, set[str]] = defaultdict(set)
        self.size: dict[Path, int] = {}
        for user, path in self.paths.items():
            text = (root / path).read_text(encoding="utf-8")
            self.size[path] = len(text)
            tree = ast.parse(text)
            used = _imported(tree, set(self.paths), path.parent)
            if "iter_modules" in text:  # a package that finds its own files
                used |= {n for n in self.paths if n.rpartition(".")[0] == user}
            for name in used:
                self.users[name].add(user)

    def distances(self, source: Path) -> dict[Path, int]:
        """Steps of import from each test file to a source, nearest first."""
        far = {_name(source): 0}
        todo = [_name(source)]
        for name in todo:
            for user in sorted(self.users[name] - set(far)):
                far[user] = far[name] + 1
                todo.append(user)
        tests = {self.paths[n]: k for n, k in far.items() if self.paths[n].parts[0] == "tests"}
        return {p: k for p, k in tests.items() if p.name.startswith("test_")}


def usable_tests(graph: Importers, source: Path, independent: bool) -> list[str]:
    """Every test file that imports a source, by whatever way, the nearest first."""
    return [p.as_posix() for p in _by_nearness(graph, source, independent)]


def _by_nearness(graph: Importers, source: Path, independent: bool) -> list[Path]:
    far = graph.distances(source)
    words = {w.rstrip("s") for w in (*source.stem.split("_"), source.parent.name)}
    # What bears its name first, then the short ones.
    return sorted(
        (p for p in far if not (independent and p.name in COMMITTED)),
        key=lambda p: (
            far[p],
            -len(words & {w.rstrip("s") for w in p.stem.split("_")}),
            graph.size[p],
        ),
    )


def near_tests(
    graph: Importers, source: Path, *, independent: bool, widen: int = 0
) -> tuple[list[Path], list[Path]]:
    """Test files that stand nearest to a source, or bear its name; the ``widen`` next ones."""
    far, kept = graph.distances(source), _by_nearness(graph, source, independent)
    if not kept:
        raise UserError(f"No test imports {_name(source)}.", "Name test files with --tests.")
    nearest = far[kept[0]]
    near = [p for p in kept if far[p] == nearest or p.stem == f"test_{source.stem}"]
    rest = [p for p in kept if p not in near]
    near += rest[: max(0, LEAST - len(near))]
    more = [p for p in rest if p not in near]
    return near, more[:widen]


class Entered:
    """Which functions each test entered without a fault, kept by the content of its file."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root, self.folder = root, folder
        self._read: dict[Path, dict[str, Any]] = {}
        folder.mkdir(parents=True, exist_ok=True)

    def file(self, test: str) -> Path:
        """Where the record of a test file, or of some of its tests, stands."""
        path, _, part = test.partition("::")
        source = self.root / path
        content = source.read_bytes() if source.is_file() else b""
        digest = hashlib.sha256(content + part.encode()).hexdigest()
        return self.folder / f"{source.stem}-{digest[:16]}.json"

    def of(self, test: str) -> dict[str, Any]:
        """Time and functions of every test of a file; nothing where it was never run."""
        path = self.file(test)
        if not path.is_file():
            return {}
        if path not in self._read:
            self._read[path] = json.loads(path.read_text(encoding="utf-8"))
        return self._read[path]

    def quick(
        self, tests: Iterable[str], path: str, function: int, most_s: float
    ) -> tuple[list[str], float]:
        """Tests that entered a function of the package and little else, and their time."""
        place = f"{path.removeprefix(f'{PACKAGE}/')}:{function or ''}"
        known = sorted(
            (len(told["entered"]), told["time_s"], name, test)
            for test in tests
            for name, told in self.of(test).items()
            if any(e == place or (not function and e.startswith(place)) for e in told["entered"])
        )
        names, files, total_s = list[str](), set[str](), 0.0
        for _, time_s, name, test in known:
            near = test in files or len(files) < QUICK_FILES
            if near and total_s + time_s <= most_s and len(names) < QUICK_TESTS:
                files.add(test)
                names.append(name)
                total_s += time_s
        return names, total_s
