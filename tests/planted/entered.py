"""Functions of the package that each test enters: a pytest plugin and its reader.

``python -m pytest -p tests.planted.entered`` writes a record for every test file that it runs.
What a fixture enters counts for each test that uses it; not seen is what another process enters,
or what an earlier test has left in a cache.
"""

from __future__ import annotations

import hashlib
import json
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

FOLDER = Path("out", "entered")
PACKAGES = ("esea_gen", "host/esea_host")
MOST_S, MOST_TESTS = 20.0, 12  # asked first: together no longer, and so many


class _Log:
    def __init__(self) -> None:
        self.now: set[CodeType] = set()
        self.tests: dict[str, set[CodeType]] = defaultdict(set)
        self.fixtures: dict[tuple[str, str], set[CodeType]] = defaultdict(set)
        self.times_s: dict[str, float] = defaultdict(float)

    def called(self, frame: FrameType, event: str, _: Any) -> None:
        self.now.add(frame.f_code)


_log = _Log()


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Iterator[None]:
    """What one fixture enters, without the fixtures that it asks for."""
    outer, _log.now = _log.now, _log.fixtures[fixturedef.baseid, fixturedef.argname]
    try:
        return (yield)
    finally:
        _log.now = outer


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: Any) -> Iterator[None]:
    """One test with its fixtures."""
    _log.now = _log.tests[item.nodeid]
    threading.settrace(_log.called)
    sys.settrace(_log.called)
    try:
        return (yield)
    finally:
        sys.settrace(None)
        for (base, name), codes in _log.fixtures.items():
            if name in item.fixturenames and item.nodeid.startswith(base):
                _log.tests[item.nodeid] |= codes


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Time of set-up, test and clean-up."""
    _log.times_s[report.nodeid] += report.duration


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the record of every test file that this process ran."""
    root = session.config.rootpath
    places = {f"{root / p}/": f"{p}/" for p in PACKAGES}
    files: dict[str, dict[str, Any]] = defaultdict(dict)
    for name, codes in _log.tests.items():
        entered = {
            f"{short}{c.co_filename.removeprefix(whole)}:{c.co_qualname}"
            for c in codes
            for whole, short in places.items()
            if c.co_filename.startswith(whole)
        }
        told = {"time_s": round(_log.times_s[name], 3), "entered": sorted(entered)}
        files[name.partition("::")[0]][name] = told
    for file, tests in files.items():
        path = root / FOLDER / f"{file.replace('/', '.')}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(
            json.dumps({"file": file, "content": _content(root / file), "tests": tests})
        )


def _content(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def entering(root: Path) -> dict[str, dict[str, float]]:
    """Per function, the tests that enter it and their times, s: what enters little else first.

    Records of test files that have changed since are left out.
    """
    found: dict[str, list[tuple[int, float, str]]] = defaultdict(list)
    for path in sorted((root / FOLDER).glob("*.json")):
        record = json.loads(path.read_text(encoding="utf-8"))
        if record["content"] != _content(root / record["file"]):
            continue
        for name, told in record["tests"].items():
            for place in told["entered"]:
                found[place].append((len(told["entered"]), told["time_s"], name))
    out: dict[str, dict[str, float]] = {}
    for place, known in found.items():
        chosen: dict[str, float] = {}
        for _, time_s, name in sorted(known):
            if sum(chosen.values()) + time_s <= MOST_S and len(chosen) < MOST_TESTS:
                chosen[name] = time_s
        out[place] = chosen
    return out
