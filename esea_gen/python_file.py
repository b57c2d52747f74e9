"""A Python file of the user's, imported: a law, a study."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
import traceback
from pathlib import Path
from types import ModuleType

from esea_gen.errors import UserError
from esea_gen.files import read_whole

MOST_BYTES = 1 << 24
MODULE = "esea_file_"  # begins the names of their modules


def import_file(path: Path, content: bytes | None = None) -> ModuleType:
    """Run the file as a module, under a name of its own content: one that was edited is another."""
    text = read_whole(path, "Check the path.", MOST_BYTES) if content is None else content
    digest = hashlib.sha256(bytes(path.absolute()) + text).hexdigest()[:16]
    name = f"{MODULE}{path.stem}_{digest}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None:
        raise UserError(f"{path}: is not a Python file.", "Write FILE.py:name.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        exec(compile(text, str(path), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        inside = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        line = error.lineno if isinstance(error, SyntaxError) else inside and inside[-1].lineno
        raise UserError(
            f"{path}{f', line {line}' if line else ''}: cannot be imported "
            f"({type(error).__name__}: {error}).",
            "Correct the file.",
        ) from error
    return module
