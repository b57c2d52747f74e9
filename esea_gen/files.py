"""Files written whole or not at all: what was there before stays until the new one is complete."""

from __future__ import annotations

import json
import os
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError


@cache
def template_folder() -> Path:
    """Folder of the Jinja templates: inside the wheel, or at the top of a checkout."""
    packaged = Path(__file__).parent / "_templates"
    return packaged if packaged.is_dir() else Path(__file__).parents[1] / "templates"


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, and the folders that it stands in."""
    data = content.encode() if isinstance(content, str) else content
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".esea-", delete=False) as scratch:
            try:
                scratch.write(data)
                scratch.flush()
                os.chmod(scratch.name, 0o644)
                Path(scratch.name).replace(path)
            except OSError:
                Path(scratch.name).unlink(missing_ok=True)
                raise
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written ({error.strerror or error}).",
            "Make room, or give another file.",
        ) from error


def write_json(path: Path | None, content: Any) -> None:
    """Write a result as JSON, if a file was named."""
    if path is not None:
        write_whole(path, json.dumps(content, indent=2, allow_nan=False) + "\n")
