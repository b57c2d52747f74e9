"""Hazard -> requirement -> code -> test: every name is there, and every fault is in the table."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from esea_gen.control.limits.faults import Fault
from esea_gen.emit.states import BOARD_FAULTS
from tests.conftest import ROOT

TABLE = tomllib.loads((ROOT / "docs" / "hazards.toml").read_text(encoding="utf-8"))
REQUIREMENTS = [r for h in TABLE["hazard"] for r in h["requirement"]]


def is_there(place: str, root: Path = ROOT) -> bool:
    """Whether a file defines a name: in Python a function or class, in C a function with a body."""
    file, _, name = place.partition(":")
    path = root / file
    if not path.is_file() or not name:
        return False
    kinds = {
        ".py": rf"^\s*(def|class) {name}\b",
        ".c": rf"^[A-Za-z_][()\w *]*\b{name}\([^;{{]*\)\n{{",
    }
    return re.search(kinds[path.suffix], path.read_text(encoding="utf-8"), re.MULTILINE) is not None


@pytest.mark.parametrize("requirement", REQUIREMENTS, ids=lambda r: r["id"])
def test_code_and_tests_of_a_requirement_are_there(requirement):
    assert set(requirement) == {"id", "says", "faults", "code", "tests"}
    assert requirement["code"]
    assert requirement["tests"]
    assert [p for p in requirement["code"] if not is_there(p)] == []
    assert [p for p in requirement["tests"] if not is_there(f"tests/{p}")] == []


def test_every_fault_belongs_to_a_requirement_and_none_is_made_up():
    named = [f for r in REQUIREMENTS for f in r["faults"]]
    known = {f.name for f in Fault} | {f.name for f in BOARD_FAULTS}
    assert set(named) == known - {"NONE"}
    assert len(named) == len(set(named))


def test_numbers_follow_one_another():
    for k, hazard in enumerate(TABLE["hazard"], start=1):
        assert hazard["id"] == f"H{k}"
        assert [r["id"] for r in hazard["requirement"]] == [
            f"H{k}.{j}" for j in range(1, len(hazard["requirement"]) + 1)
        ]
