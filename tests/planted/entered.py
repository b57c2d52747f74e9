"""pytest plugin: which functions of ``esea_gen`` each test enters, and how long it takes."""

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

_HERE = f"{Path.cwd() / 'esea_gen'}{os.sep}"


class _Log:
    now: set[CodeType]

    def __init__(self) -> None:
        self.now = set()
        self.tests: dict[str, set[CodeType]] = defaultdict(set)
        self.fixtures: dict[int, set[CodeType]] = defaultdict(set)
        self.times_s: dict[str, float] = defaultdict(float)

    def listen(self) -> None:
        threading.settrace(self.call)
        sys.settrace(self.call)

    def call(self, frame: FrameType, event: str, _: Any) -> None:
        self.now.add(frame.f_code)


_log = _Log()


@pytest.hookimpl(hookwrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Generator[None, Any, None]:
    """What one fixture enters, the fixtures that it asks for apart."""
    outer, _log.now = _log.now, _log.fixtures[id(fixturedef)]
    yield
    _log.now = outer


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: Any) -> Generator[None, Any, None]:
    """One test with its fixtures."""
    _log.now = _log.tests[item.nodeid]
    _log.listen()  # a test before it may have taken it
    yield
    for definitions in item._fixtureinfo.name2fixturedefs.values():
        for definition in definitions:
            _log.tests[item.nodeid] |= _log.fixtures[id(definition)]
    _log.now = set()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Time of all three parts."""
    _log.times_s[report.nodeid] += report.duration


def pytest_sessionfinish() -> None:
    """Functions by file and first line."""
    sys.settrace(None)
    told = {}
    for name, codes in _log.tests.items():
        places = {
            f"{c.co_filename.removeprefix(_HERE)}:{c.co_firstlineno}"
            for c in codes
            if c.co_filename.startswith(_HERE)
        }
        told[name] = {"time_s": round(_log.times_s[name], 4), "entered": sorted(places)}
    Path(os.environ["ESEA_ENTERED"]).write_text(json.dumps(told), encoding="utf-8")
