"""Results of the host's studies with virtual people, as the host's commands write them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from esea_gen.errors import UserError

# A word that only one command writes at the top of its file.
MARKS = {"comparisons": "interaction", "tables": "wrist", "motions": "assess"}
FIX = "Give what esea-host study virtual interaction, ... wrist or esea-host assess evaluate wrote."
COUNT = "number of virtual people"
MEASURED = {"interaction": "interaction", "wrist": "wrist", "assessment": "assess"}
TABLES = {
    "wrist_ru": "7.1 validation, RU",
    "wrist_fe": "7.2 validation, FE",
    "wrist_sessions": "7.3 sessions",
    "wrist_states": "7.4 states",
}
SIDES = {
    "interaction_blocks": {"block 1": "block_1", "block 2": "block_2"},
    "interaction_devices": {"spring": "spring", "elastomer": "elastomer"},
}


@dataclass(frozen=True)
class HostResults:
    """Contents of the files that were given, by what they are of."""

    found: dict[str, dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def read(cls, paths: Sequence[Path]) -> HostResults:
        found: dict[str, dict[str, Any]] = {}
        for path in paths:
            try:
                content = json.loads(path.read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise UserError(f"{path}: no JSON that can be read ({error}).", FIX) from None
            content = content if isinstance(content, dict) else {}
            kinds = [kind for mark, kind in MARKS.items() if mark in content]
            if not kinds:
                raise UserError(f"{path}: not a result of the host's studies.", FIX)
            if content.get("simulated") is False:
                raise UserError(f"{path}: people took part in it, not simulated ones.", FIX)
            found[kinds[0]] = content
        return cls(found)

    def __call__(self, name: str) -> dict[str, float] | None:
        """Numbers of a measure; None where its file was not given."""
        content = self.found.get(MEASURED[name.split("_", maxsplit=1)[0]])
        if content is None:
            return None
        try:
            if name in SIDES:
                return _medians(content, SIDES[name])
            if name in TABLES:
                return _lines(content, TABLES[name])
            return _assessed(content)
        except (KeyError, TypeError, AttributeError) as error:
            raise UserError(f"a result of {name}: without {error}.", FIX) from None


def _medians(content: dict[str, Any], sides: dict[str, str]) -> dict[str, float]:
    found = {
        f"{c['task']} {c['metric']} {shown}": float(c["thesis_medians"][key])
        for c in content["comparisons"]
        for shown, key in sides.items()
    }
    return found | {COUNT: len(content["people"])}


def _lines(content: dict[str, Any], table: str) -> dict[str, float]:
    found = {}
    sides = content["sides"][table]
    for line in content["tables"][table]:
        for side, value in zip(sides, (line["first"], line["second"]), strict=True):
            if value is not None:
                found[f"{line['metric']} {side} / {line['unit']}"] = float(value)
    return found | {COUNT: content["participants"]}


def _assessed(content: dict[str, Any]) -> dict[str, float]:
    words = {"expected": "by expected information", "thesis": "as published", "random": "at random"}
    found = {}
    for way, text in words.items():
        found[f"movements to 95 %, {text}"] = float(content["motions"][way]["mean"])
        found[f"right answers, {text}"] = float(content["ways"][way]["accuracy"])
    return found | {COUNT: content["patients"]["inside"]}
