"""Both commands with what Windows lacks taken away: POSIX modules, calls, UTF-8, ends of lines."""

from __future__ import annotations

import ast
import os
import select
import signal
import socket
import sys
from pathlib import Path
from types import SimpleNamespace

import mypy

STUBS = Path(mypy.__file__).parent / "typeshed" / "stdlib"


def declared(text: str, platform: str) -> set[str]:
    """Names that a stub of typeshed declares for a platform."""
    seen = {"sys": SimpleNamespace(platform=platform, version_info=sys.version_info)}
    found, todo = set(), list(ast.parse(text).body)
    for node in todo:
        if isinstance(node, ast.If) and "sys." in (test := ast.unparse(node.test)):
            todo += node.body if eval(test, seen) else node.orelse
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.AnnAssign):
            found.add(ast.unparse(node.target))
        elif isinstance(node, ast.Assign):
            found |= {ast.unparse(t) for t in node.targets}
        elif isinstance(node, ast.ImportFrom):
            found |= {a.asname or a.name for a in node.names}
    return found


def missing_on_windows() -> list[str]:
    out = []
    for module in (os, select, signal, socket):
        name = module.__name__
        stub = STUBS / name / "__init__.pyi" if name == "os" else STUBS / f"{name}.pyi"
        text = stub.read_text()
        gone = declared(text, "linux") - declared(text, "win32")
        out += [f"{name}.{n}" for n in sorted(gone) if hasattr(module, n)]
    return out
