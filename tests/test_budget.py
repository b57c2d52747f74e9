"""Who took more processor time than it may is named, with what took it."""

from __future__ import annotations

import subprocess
import sys

import pytest

from .budget import BUDGET_S, SHARES, Budget, over, room, used_s


def test_rooms_over_their_budget_are_named_with_their_dearest_files():
    assert sum(SHARES.values()) == pytest.approx(1)
    may = SHARES["report"] * BUDGET_S
    spent = {"tests/test_report.py": 0.7 * may, "tests/test_report_units.py": 0.2 * may}
    assert {room(f) for f in spent} == {"report"}
    assert over(spent) == []
    spent["tests/test_drive_report.py"] = 0.2 * may
    (line,) = over(spent)
    assert line.startswith(f"report: {1.1 * may:.0f} s of processor time, budget {may:.0f}: ")
    assert line.split(": ")[2].startswith("test_report ")


def test_programs_that_were_waited_for_count_and_every_report_has_its_own_share():
    before = used_s()
    busy = "import time\nwhile time.process_time() < 0.3: pass"
    subprocess.run([sys.executable, "-S", "-c", busy], check=True)
    assert used_s() - before >= 0.3
    counted = Budget()
    for seconds in (0.25, 0.5):
        report = pytest.TestReport(
            "tests/test_x.py::test_a", ("", 0, ""), {}, "passed", None, "call",
            user_properties=[("processor_s", seconds)],
        )  # fmt: skip
        counted.pytest_runtest_logreport(report)
    assert counted.spent == {"tests/test_x.py": 0.75}
