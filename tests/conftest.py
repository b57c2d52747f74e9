"""Fixtures shared by all tests."""

from __future__ import annotations

import gc
import importlib.util
import os
import re
import shutil
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import pytest
from hypothesis import HealthCheck, settings

import esea_gen
from esea_gen import files
from esea_gen.device import Device
from esea_gen.hostlib import HostLibrary, compile_device
from esea_gen.twin.recorded import record_drive
from tests import result_schemas
from tests.budget import Budget

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")  # windows without a screen
ROOT = Path(__file__).parents[1]
# Before a program that a test ends by Ctrl-C: children of a background job ignore it.
INTERRUPTIBLE = ("env", "--default-signal=INT")

# A machine may be busy: no limit of time.
settings.register_profile("any", deadline=None, suppress_health_check=[HealthCheck.too_slow])
# `make test`: examples follow from the test's source, and no file remembers an earlier failure.
settings.register_profile("same", settings.get_profile("any"), derandomize=True, database=None)
# `make search`: examples follow from the seed that it prints.  Said outright, for in continuous
# integration Hypothesis' own default is the same examples every time.
settings.register_profile(
    "search", settings.get_profile("any"), derandomize=False, print_blob=True, database=None
)
settings.load_profile("same")

# What is imported and collected stays: nobody looks for garbage in it, then or later.
gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


# Of the slow tests, those that CI runs each time: some minutes, every kind of them.
SLOW_SAMPLE = (
    "test_box_qp.py::test_forty_thousand_problems[spread]",
    "test_coverage_drive.py::test_both_sides_of_every_decision_are_taken_in_f64[set_rate]",
    "test_coverage_drive.py::test_both_sides_of_every_decision_are_taken_in_f64[encoder_load]",
    "test_coverage_drive.py::test_the_c_gives_every_bit[sensor-f32]",
    "test_coverage_drive.py::test_the_c_gives_every_bit[reference-f64]",
    "test_drive_report.py::test_a_predictive_controller_has_a_page",
    "test_fixed_drive.py::test_the_recorded_rubber_stays_within_the_aim[wrist]",
    "test_laws.py::test_the_emulated_board_runs_every_law[smc,mpc-mps2-an500]",
    "test_main_job.py::",
    "test_traces.py::",
)


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Budget(), "budget")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        slow = item.get_closest_marker("slow") is not None
        if slow and any(f"/{name}" in item.nodeid for name in SLOW_SAMPLE):
            item.add_marker(pytest.mark.slow_sample)


def load_file(path: Path) -> Any:
    """Import a file that is in no package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def missing(name: str) -> NoReturn:
    """The test is skipped, or fails where everything is required."""
    message = f"{name} is not installed"
    if os.environ.get("ESEA_REQUIRE_TOOLS") == "1":
        pytest.fail(message)
    pytest.skip(message)


def require_tool(name: str) -> str:
    """Path of a tool; without it the test is skipped, or fails where everything is required."""
    # Beside the interpreter too: tools that come as packages.
    path = shutil.which(name) or shutil.which(name, path=str(Path(sys.executable).parent))
    return missing(name) if path is None else path


def require_module(name: str) -> None:
    """Skip without a Python module, or fail where everything is required."""
    if importlib.util.find_spec(name) is None:
        missing(name)


@pytest.fixture(scope="session", autouse=True)
def results_follow_their_schemas():
    """Whatever a test lets a command write as JSON is held against the published schema."""
    stamped = files.stamped

    def held(what: str, content: Mapping[str, Any]) -> dict[str, Any]:
        made = stamped(what, content)
        result_schemas.held(what, made)
        return made

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "stamped", held)
        yield


@pytest.fixture(scope="session", autouse=True)
def the_examples_are_trusted(tmp_path_factory):
    """What a person does once for a task file; no test reads or writes a person's own list."""
    from esea_gen.trust import read_code, trust

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        trust([read_code(ROOT / "examples" / "steady_hold.py").sha256])
        yield


@pytest.fixture
def busy_machine(monkeypatch):
    """A board in real time may be starved: longer waits for its answers, and more tries."""
    monkeypatch.setattr("esea_host.connection.identity.PROBE_S", 120.0)
    monkeypatch.setattr("esea_gen.link.messenger.AGE_S", 120.0)


@pytest.fixture(scope="session")
def elbow() -> Device:
    return esea_gen.load_device("elbow")


@pytest.fixture(scope="session")
def drive() -> Device:
    return esea_gen.load_device("elbow_drive")


@pytest.fixture(scope="session")
def recorded(drive: Device) -> dict[str, Any]:
    """Inputs of the drive's tasks in closed loop, 1 s of them."""
    return record_drive(drive, 1000).inputs


@pytest.fixture(scope="session")
def elbow_f64(elbow: Device) -> HostLibrary:
    return compile_device(elbow, "f64")


@pytest.fixture(scope="session")
def elbow_f32(elbow: Device) -> HostLibrary:
    return compile_device(elbow, "f32")


def without(text: str, *sections: str) -> str:
    """A device file's text less some sections, each up to the next one."""
    for name in sections:
        text, found = re.subn(rf"(?ms)^\[{re.escape(name)}\]\n.*?(?=^\[|\Z)", "", text)
        assert found == 1, name
    return text


@pytest.fixture(scope="session")
def simulated_elbow():
    """The elbow's simulated board and virtual drive, compiled once; who uses it restarts it."""
    from esea_host.simulated import SimulatedBoard

    made = SimulatedBoard("elbow_drive")
    yield made
    made.close()


@pytest.fixture
def lockstep(simulated_elbow):
    from esea_host.simulated import LockstepDevice

    simulated_elbow.restart()
    return LockstepDevice(simulated_elbow)


@pytest.fixture(scope="module")
def powered(drive: Device):
    """The drive's simulated board; who uses it restarts it."""
    from esea_gen.board.sim import SimBoard

    board = SimBoard(drive)
    yield board
    board.close()


def until(condition, limit_s=60.0):
    """What a condition says, once it says something."""
    end = time.monotonic() + limit_s
    while not (found := condition()):
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.02)
    return found
