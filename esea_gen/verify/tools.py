"""Provers that are programs: where they are, how long they may take."""

from __future__ import annotations

import shutil

from esea_gen.errors import UserError

TIMEOUT_S = 3600


def tool(name: str, package: str) -> str:
    """Path of a program."""
    path = shutil.which(name)
    if path is None:
        raise UserError(
            f"The tool '{name}' is not installed.",
            f"Install it with: apt-get install --no-install-recommends {package}",
        )
    return path


__all__ = ["TIMEOUT_S", "tool"]
