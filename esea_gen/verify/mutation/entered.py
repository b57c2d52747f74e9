"""pytest plugin: which functions of this program each test enters, and how long it takes.

``pytest -p esea_gen.verify.mutation.entered`` with ``ESEA_ENTERED=FILE``; imports nothing that a
test could want to see imported.  What a fixture that several tests share enters counts for each
of them; what another process enters is not seen.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

_HERE = f"{Path(__file__).parents[2]}{os.sep}"
_found: set[CodeType] = set()
_of_test: dict[str, set[CodeType]] = defaultdict(set)
_of_fixture: dict[int, set[CodeType]] = defaultdict(set)
_time_s: dict[str, float] = defaultdict(float)


def _call(frame: FrameType, event: str, _: Any) -> None:
    _found.add(frame.f_code)


def pytest_sessionstart() -> None:
    """Listen from the first import on; what is entered before the first test is of none."""
    threading.settrace(_call)
    sys.settrace(_call)


@pytest.hookimpl(hookwrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Generator[None, Any, None]:
    """What one fixture enters, the fixtures that it asks for apart."""
    global _found
    outer, _found = _found, _of_fixture[id(fixturedef)]
    yield
    _found = outer


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, None]:
    """One test with its fixtures."""
    global _found
    _found = _of_test[item.nodeid]
    sys.settrace(_call)  # a test before it may have taken it
    yield
    for definitions in getattr(item, "_fixtureinfo").name2fixturedefs.values():  # noqa: B009
        for definition in definitions:
            _of_test[item.nodeid] |= _of_fixture[id(definition)]
    _found = set()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Time of all three parts."""
    _time_s[report.nodeid] += report.duration


def pytest_sessionfinish() -> None:
    """Functions by file and first line."""
    sys.settrace(None)
    told = {}
    for name, codes in _of_test.items():
        places = {
            f"{c.co_filename.removeprefix(_HERE)}:{c.co_firstlineno}"
            for c in codes
            if c.co_filename.startswith(_HERE)
        }
        told[name] = {"time_s": round(_time_s[name], 4), "entered": sorted(places)}
    Path(os.environ["ESEA_ENTERED"]).write_text(json.dumps(told), encoding="utf-8")
