"""Registry of studies: named classes in two rooms or in a file given by path.

A study needs no entry in a list.  One outside the package is named by its file, ``FILE.py:name``,
also in the processes that run its cases.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import ClassVar, Generic, Protocol, TypeVar

from matplotlib.figure import Figure

from esea_gen.errors import UserError, choose
from esea_gen.python_file import import_file

SUFFIX = ".py"
# By name: what reproduces stands above what is reproduced with.
ROOMS = "esea_gen.studies", "esea_gen.reproduce"


class Study:
    """A study as the command line shows it: name, one line, docstring as help."""

    name: ClassVar[str] = ""  # a class without one is not a study, but what studies are made of
    title: ClassVar[str] = ""

    @property
    def help(self) -> str:
        return inspect.cleandoc(type(self).__doc__ or self.title)


S = TypeVar("S", bound=Study)


def studies(kind: type[S]) -> dict[str, S]:
    return {k: s for k, s in sorted(_own().items()) if isinstance(s, kind)}


def load_study(name: str, kind: type[S]) -> S:
    """A study of the package by its name, or of any file as ``FILE.py:name``."""
    file = study_file(name)
    known = studies(kind)
    if file is not None:
        name = name.rpartition(":")[2]
        found = _found([import_file(file)])
        known = {k: s for k, s in found.items() if isinstance(s, kind)}
        if not known:
            raise UserError(
                f"{file}: no study of this kind in it.",
                f"Write a class with a name that extends {kind.__name__}.",
            )
    choose("study", name, known, "" if file else ", or give FILE.py:name")
    return known[name]


def study_file(name: str) -> Path | None:
    """The file in ``FILE.py:name``; None for a study of the package."""
    file, colon, _ = name.rpartition(":")
    return Path(file) if colon and file.endswith(SUFFIX) else None


@cache
def _own() -> dict[str, Study]:
    # Folders hold what has a command of its own.
    rooms = map(importlib.import_module, ROOMS)
    every = ((room.__name__, m) for room in rooms for m in pkgutil.iter_modules(room.__path__))
    names = (f"{room}.{m.name}" for room, m in every if not m.ispkg)
    return _found(map(importlib.import_module, names))


def _found(modules: Iterable[ModuleType]) -> dict[str, Study]:
    found: dict[str, Study] = {}
    for module in modules:
        for item in vars(module).values():
            # Where it is written, not where it is imported.
            if not inspect.isclass(item) or item.__module__ != module.__name__:
                continue
            if not issubclass(item, Study) or not item.name:
                continue
            if item.name in found:
                raise UserError(
                    f"{module.__file__}: there is a study {item.name} already.", "Rename it."
                )
            found[item.name] = item()
    return found


class Outcome(Protocol):
    """Result of any study; its JSON is ``to_dict()``, or its fields."""

    def table(self) -> list[str]: ...

    def figure(self) -> Figure: ...


Made = TypeVar("Made", bound=Outcome)


class Reproduction(Study, Generic[Made]):
    """A published table or figure made again."""

    recordings: ClassVar[bool] = False

    def run(self, say: Callable[[str], None], folder: Path | None) -> Made:
        raise UserError(f"study {self.name}: has no method run.", "Add the method run.")

    def reproduced(self, outcome: Made) -> bool:
        return True
