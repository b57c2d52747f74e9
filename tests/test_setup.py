"""Packages that the set-up installs for `make run` and for the tests."""

from __future__ import annotations

import re
from importlib.metadata import distribution

from packaging.requirements import Requirement

from tests.conftest import ROOT


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def closure(name: str, extras: frozenset[str], found: set[tuple[str, frozenset[str]]]) -> None:
    """Add a distribution and all that it requires here."""
    if (normal(name), extras) in found:
        return
    found.add((normal(name), extras))
    for text in distribution(name).requires or ():
        r = Requirement(text)
        if r.marker is None or any(r.marker.evaluate({"extra": e}) for e in ("", *extras)):
            closure(r.name, frozenset(r.extras), found)


def test_make_run_installs_what_the_host_tool_and_its_installation_require():
    needed: set[tuple[str, frozenset[str]]] = set()
    closure("esea-gen", frozenset({"host"}), needed)
    for tool in ("hatchling", "editables"):
        closure(tool, frozenset(), needed)
    above, below = (ROOT / "requirements.lock").read_text().split("\n# Beyond `make run`")
    first, rest = (
        {normal(n) for n in re.findall(r"(?m)^([\w.-]+)==", part)} for part in (above, below)
    )
    names = {name for name, _ in needed} - {"esea-gen"}
    assert names - first == set()
    assert first & rest == set()
    assert {"pytest", "mypy", "zensical"} <= rest
