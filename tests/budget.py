"""Processor time by folder of the tests: a machine may be busy or slow, so nothing fails by it.

A test's time is its process's and that of the programs that it waited for, set-up and clean-up
included.
"""

from __future__ import annotations

import resource
from collections import Counter
from collections.abc import Iterator
from pathlib import PurePath
from typing import Any

import pytest

KEY = "processor_s"
# Seconds of `make test`: under 3 minutes on two cores.
BUDGET_S = 280.0


def used_s() -> float:
    """Of this process and the programs that it waited for."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(u.ru_utime + u.ru_stime for u in map(resource.getrusage, kinds))


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
        """Total, folders, and the dearest files."""
        folders: Counter[str] = Counter()
        for file, seconds in self.spent.items():
            folders[PurePath(file).parent.name] += seconds
        total = f"{sum(folders.values()):.0f} s of processor time"
        if "not ci" in terminalreporter.config.option.markexpr:
            total += f", budget {BUDGET_S:.0f}"
        terminalreporter.write_line(total)
        if len(folders) > 1:
            for what in (folders, self.spent):
                named = ", ".join(f"{PurePath(n).stem} {s:.0f}" for n, s in what.most_common(12))
                terminalreporter.write_line(f"  {named}")
