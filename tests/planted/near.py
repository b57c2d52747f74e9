"""Which tests may notice a fault in a source file: those that import it, the nearest first."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

from esea_gen.errors import UserError

PACKAGE = "esea_gen"
# Tests that hold against committed output, or against the whole checkout.
COMMITTED = ("test_traces.py", "test_docs.py", "test_house.py", "test_wheel.py", "test_main_job.py")
EMITTER = "esea_gen.emit.build"
LEAST = 4  # so many test files are asked at least, for the nearest need not run the line


def _name(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[parts[0] == "host" :]).removesuffix(".__init__")


def _imported(tree: ast.AST, known: set[str], folder: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found.update(a.name for a in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = folder.parts[: len(folder.parts) + 1 - node.level] if node.level else ()
            module = ".".join((*above, *filter(None, [node.module])))
            below = {f"{module}.{a.name}" for a in node.names} & known
            found |= below | ({module} if len(below) < len(node.names) else set())
    return found & known


class Importers:
    """Who imports whom in a checkout, shared files of the tests included."""

    def __init__(self, root: Path) -> None:
        files = [p for place in (PACKAGE, "host", "tests") for p in (root / place).rglob("*.py")]
        self.paths = {_name(p.relative_to(root)): p.relative_to(root) for p in sorted(files)}
        self.users: dict[str, set[str]] = defaultdict(set)
        self.size: dict[Path, int] = {}
        for user, path in self.paths.items():
            text = (root / path).read_text(encoding="utf-8")
            self.size[path] = len(text)
            used = _imported(ast.parse(text), set(self.paths), path.parent)
            if "iter_modules" in text:  # a package that finds its own files
                used |= {n for n in self.paths if n.rpartition(".")[0] == user}
            for name in used:
                self.users[name].add(user)

    def emits(self, source: Path) -> bool:
        """Whether what is emitted follows from a source, by import."""
        return EMITTER in self._users_of(source)

    def _users_of(self, source: Path) -> dict[str, int]:
        # Modules that import a source, themselves or through others, and in how many steps.
        far = {_name(source): 0}
        todo = [_name(source)]
        for name in todo:
            for user in sorted(self.users[name] - set(far)):
                far[user] = far[name] + 1
                todo.append(user)
        return far

    def distances(self, source: Path) -> dict[Path, int]:
        """Steps of import from each test file to a source, nearest first."""
        far = self._users_of(source)
        tests = {self.paths[n]: k for n, k in far.items() if self.paths[n].parts[0] == "tests"}
        return {p: k for p, k in tests.items() if p.name.startswith("test_")}

    def of_room(self, room: str) -> dict[Path, int]:
        """Test files of a room, as if none stood nearer than another."""
        return {p: 1 for p in self.size if p.name.startswith("test_") and p.parent.name == room}


def is_committed(test: str) -> bool:
    """Whether a test stands in a file of those that compare with committed output."""
    return Path(test.partition("::")[0]).name in COMMITTED


def near_tests(graph: Importers, source: Path, *, independent: bool, widen: int = 0) -> list[str]:
    """Test files that stand nearest to a source or bear its name, and the ``widen`` next ones."""
    # Reached by name alone, as a plug-in is: the tests of its room.
    far = graph.distances(source) or graph.of_room(source.parent.name)
    words = {w.rstrip("s") for w in (*source.stem.split("_"), source.parent.name)}

    def rank(p: Path) -> tuple[int, int, int]:  # what bears its name first, then the short ones
        return far[p], -len(words & {w.rstrip("s") for w in p.stem.split("_")}), graph.size[p]

    kept = sorted((p for p in far if not (independent and is_committed(p.name))), key=rank)
    if not kept:
        raise UserError(f"No test imports {_name(source)}.", "Name test files with --tests.")
    near = [p for p in kept if far[p] == far[kept[0]] or p.stem == f"test_{source.stem}"]
    near += [p for p in kept if p not in near][: max(0, LEAST - len(near)) + widen]
    return [p.as_posix() for p in near]
