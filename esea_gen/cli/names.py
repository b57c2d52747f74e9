"""Names for help and completion, without importing what they name.

Completion must answer at once; the symbolic engines alone load in two seconds.  So names are read
from folders and from the text of the sources; a test compares them with the loaded ones.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import typer

ROOT = Path(__file__).parents[1]
PEOPLE = ("none", "ideal", "uncertain", "uncertain-no-feedforward", "random")
PLANTS = ("ideal", "real", "random")


@dataclass(frozen=True)
class Written:
    name: str
    title: str
    kind: str  # name of the class that it extends
    help: str  # docstring of its class
    recordings: bool  # whether it reads a folder of published recordings


@cache
def written_studies() -> dict[str, Written]:
    """Studies of the package, by name."""
    found = {}
    for path in [*(ROOT / "studies").glob("*.py"), *(ROOT / "reproduce").glob("*.py")]:
        text = path.read_text(encoding="utf-8")
        if '\n    name = "' not in text:
            continue
        for node in ast.parse(text).body:
            if not isinstance(node, ast.ClassDef) or not node.bases:
                continue
            facts = _literals(node)
            if "name" in facts:
                about = inspect.cleandoc(ast.get_docstring(node) or facts["title"])
                kind = ast.unparse(node.bases[0]).partition("[")[0]
                recordings = facts.get("recordings", False)
                found[facts["name"]] = Written(
                    facts["name"], facts["title"], kind, about, recordings
                )
    return dict(sorted(found.items()))


def _literals(node: ast.ClassDef) -> dict[str, Any]:
    return {
        ast.unparse(target): line.value.value
        for line in node.body
        if isinstance(line, ast.Assign) and isinstance(line.value, ast.Constant)
        for target in line.targets
    }


def closed_loop_studies() -> list[str]:
    return [s.name for s in written_studies().values() if s.kind == "ClosedLoopStudy"]


def reproductions() -> list[Written]:
    return [s for s in written_studies().values() if s.kind == "Reproduction"]


def _stems(folder: str, suffix: str) -> list[str]:
    return sorted(p.stem for p in (ROOT / folder).glob(f"*{suffix}") if p.stem != "__init__")


def shipped() -> list[str]:
    return _stems("devices", ".toml")


def configured() -> list[str]:
    """Controllers of the package: configurations, then laws."""
    return list(
        dict.fromkeys([*_stems("devices/controllers", ".toml"), *_stems("control/laws", ".py")])
    )


def block_names(device: str) -> list[str]:
    """Blocks of a device; loaded once, then stored under the digest of its file and the sources."""
    from esea_gen.cache import cache_folder
    from esea_gen.errors import UserError
    from esea_gen.files import write_whole

    path = ROOT / "devices" / f"{device}.toml"
    path = path if path.is_file() else Path(device)
    try:
        newest = max(p.stat().st_mtime_ns for p in ROOT.rglob("*.py"))
        digest = hashlib.sha256(path.read_bytes() + str(newest).encode()).hexdigest()[:24]
        kept = cache_folder() / f"blocks-{digest}.json"
        if not kept.is_file():
            import esea_gen

            names = sorted(b.name for b in esea_gen.load_device(device).system.kinds)
            write_whole(kept, json.dumps(names))
        return [str(x) for x in json.loads(kept.read_text(encoding="utf-8"))]
    except (OSError, UserError, ValueError):
        return []  # a press of the tab key has no place for an error


def completing(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Completion for typer: names that start with the typed text; empty for a file's name."""

    def complete(incomplete: str) -> list[str]:
        return [n for n in names() if n.startswith(incomplete)]

    return complete


def complete_block(ctx: typer.Context, incomplete: str) -> list[str]:
    """Blocks of the device that is on the line already."""
    # What comes before an option without its value is left over, not parsed.
    device = ctx.params.get("device") or next(iter(ctx.args), "")
    return [n for n in block_names(device) if n.startswith(incomplete)]
