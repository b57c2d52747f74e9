"""The shipped control laws, one file each, named as its ``LAW``; imported only when asked for."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

from esea_gen.control.law import Law
from esea_gen.control.own_law import outside_law
from esea_gen.errors import choose

LAWS = tuple(found.name for found in pkgutil.iter_modules(__path__))


def find_law(text: str, folder: Path | None = None, content: bytes | None = None) -> Law:
    """A law by its name, or as :func:`outside_law` has it."""
    if ".py:" in text:
        return outside_law(text, folder, content)
    choose("law", text, LAWS, ", or write FILE.py:law")
    law: Law = importlib.import_module(f"{__name__}.{text}").LAW
    return law
