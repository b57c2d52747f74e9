"""Processor time by room of the package, against what each may take.

A test's time is its process's and that of the programs that it waited for, set-up and clean-up
included; it counts for the room that its file imports from most.  Nothing fails by it: a machine
may be busy or slow.  What is over its budget is named at the end of a run, with its dearest files.
"""

from __future__ import annotations

import re
import resource
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
KEY = "processor_s"
# Seconds; on two cores with styles, types and `esea-gen check` together under 8 minutes.
BUDGET_S = 800.0
SHARES = {
    "host": 0.17,
    "verify": 0.10,
    "board": 0.05,
    "control": 0.12,
    "identify": 0.10,
    "emit": 0.09,
    "twin": 0.07,
    "studies": 0.07,
    "model": 0.06,
    "device": 0.05,
    "cli": 0.04,
    "analysis": 0.02,
    "report": 0.01,
    "bench": 0.01,
    "export": 0.01,
    "other": 0.03,
}


def used_s() -> float:
    """Of this process and the programs that it waited for."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(u.ru_utime + u.ru_stime for u in map(resource.getrusage, kinds))


@cache
def room(file: str) -> str:
    """The room that a test file imports from most, of two the one that it names first."""
    text = (ROOT / file).read_text(encoding="utf-8")
    found = re.findall(r"^\s*(?:from|import) (?:esea_gen\.(\w+)|esea_(host))", text, re.MULTILINE)
    named = Counter(a or b for a, b in found if (a or b) in SHARES)
    if not named:
        return "cli" if "from .typed import" in text else "other"
    return named.most_common(1)[0][0]


def over(spent: Mapping[str, float]) -> list[str]:
    """Lines on the rooms that took more than they may, the worst first.

    spent: seconds by test file.
    """
    rooms: Counter[str] = Counter()
    for file, seconds in spent.items():
        rooms[room(file)] += seconds
    lines = []
    worst = sorted(rooms, key=lambda r: rooms[r] / SHARES[r], reverse=True)
    for name in worst:
        may = SHARES[name] * BUDGET_S
        if rooms[name] <= may:
            continue
        files = sorted((f for f in spent if room(f) == name), key=spent.__getitem__, reverse=True)
        dearest = ", ".join(f"{Path(f).stem} {spent[f]:.0f}" for f in files[:4])
        lines.append(f"{name}: {rooms[name]:.0f} s of processor time, budget {may:.0f}: {dearest}")
    return lines


class Budget:
    """Adds up what tests take; workers tell it with their reports."""

    def __init__(self) -> None:
        self.spent: Counter[str] = Counter()
        self.since = used_s()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Iterator[None]:
        """What passed since the last report belongs to this one."""
        report: Any = yield
        now = used_s()
        report.user_properties.append((KEY, now - self.since))
        self.since = now
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """A report of set-up, test or clean-up, from whichever worker."""
        told = [v for k, v in report.user_properties if k == KEY]
        self.spent[report.nodeid.partition("::")[0]] += float(told[-1]) if told else 0.0

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Rooms over their budget, after a run of everything or a part."""
        total, lines = f"{sum(self.spent.values()):.0f} s of processor time", over(self.spent)
        if "not ci" not in terminalreporter.config.option.markexpr:
            terminalreporter.write_line(total)  # the budget is `make test`'s
            return
        more = ":" if lines else "; no room over its own"
        terminalreporter.write_line(f"{total}, budget {BUDGET_S:.0f}{more}")
        for line in lines:
            terminalreporter.write_line(f"  over: {line}")
