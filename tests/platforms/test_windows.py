"""Both commands without the calls that Windows lacks, on its code page, in deep folders.

What this cannot show is listed on the page docs/platforms.md.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from tests.conftest import ROOT, require_tool

pytestmark = [pytest.mark.ci, pytest.mark.platforms]
PAGE = "cp1252"
DEEP = Path("\u00dcbung 1", "x" * 150, "y" * 150)  # longer than Windows' old limit of 260


def there(*command: str) -> subprocess.Popen[bytes]:
    paths = (ROOT / "tests" / "platforms" / "windows", ROOT, ROOT / "host")
    changed = {"PYTHONPATH": os.pathsep.join(map(str, paths)), "PYTHONIOENCODING": PAGE}
    changed["TZ"] = "Pacific/Kiritimati"  # 14 h ahead of UTC
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "stdin": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, *command], env=os.environ | changed, **pipes)


def done(program: str, *words: object, code: int = 0) -> str:
    run = there("-m", f"{program}.cli", *map(str, words))
    said = run.communicate()[0].decode(PAGE)
    assert run.returncode == code, said
    assert "Traceback" not in said, said
    return " ".join(said.split())


@pytest.fixture(autouse=True)
def in_folder(monkeypatch, tmp_path):
    require_tool("gcc")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("system", ["win32", pytest.param("darwin", marks=pytest.mark.slow)])
def test_every_call_is_there_on_other_systems(system):
    command = [sys.executable, "-m", "mypy", "--platform", system]
    cache = ("--cache-dir", f".mypy_cache/{system}")
    run = subprocess.run([*command, *cache], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout


def test_the_generator(tmp_path):
    assert "identify" in done("esea_gen", "--help")
    done("esea_gen", "build", "elbow", "--out", DEEP)
    committed = {p.name: p.read_bytes() for p in (ROOT / "generated/elbow/f32").glob("*.[ch]")}
    assert {p.name: p.read_bytes() for p in (DEEP / "f32").glob("*.[ch]")} == committed != {}
    done("esea_gen", "verify", "elbow", "--real", "f32", "--block", "sensor")
    files = ("--json", "s.json", "--csv", "s.csv", "--figure", "s.svg", "--resume", "journal")
    done("esea_gen", "simulate", "step", "--jobs", 2, *files)
    done("esea_gen", "export", "cmake", "elbow", "--out", "package")
    texts = [p for p in tmp_path.rglob("*") if p.suffix in (".c", ".h", ".json", ".toml", ".txt")]
    assert [p for p in texts if b"\r" in p.read_bytes()] == []
    assert "forked processes" in done("esea_gen", "mutate", "elbow", code=2)


def test_a_board_over_tcp_recorded_and_replayed():
    board = there("-m", "esea_host.cli", "sim", "elbow_drive", "--pty")
    try:
        assert b"no pseudo terminals: TCP" in board.stdout.readline()
        address = re.search(rb"tcp:[\d.:]+", board.stdout.readline())[0].decode()
        done("esea_host", "record", address, "r.mcap", "--seconds", 1)
    finally:
        board.terminate()
        board.communicate()
    assert "bit for bit" in done("esea_host", "replay", "r.mcap", "--verify")
    done("esea_host", "export", "r.mcap", "r.csv")
    for address, words in {"serial:COM3:fast": "not a rate", "pty:/dev/pts/0": "Use tcp"}.items():
        assert words in done("esea_host", "record", address, "n.mcap", code=2)


def test_a_study_without_windows():
    began = datetime.now(UTC)
    shipped = (ROOT / "host" / "esea_host" / "wrist" / "protocol.toml").read_text(encoding="utf-8")
    short = shipped.replace("repeat = 15", "repeat = 1").replace("copies = 3", "copies = 1")
    Path("short.toml").write_text(short, encoding="utf-8")
    done("esea_host", "study", "create", "short.toml", "s", "--simulated")
    done("esea_host", "study", "enrol", "s", "P01", "--consent")
    done("esea_host", "study", "run", "s", "P01", "--headless")
    assert "bit for bit" in done("esea_host", "study", "replay", "s", "P01")
    done("esea_host", "study", "export", "s", "out")
    events = Path("s/P01/session-1/events.jsonl").read_text(encoding="utf-8").splitlines()
    times = [datetime.fromisoformat(json.loads(line)["utc"]) for line in events[1:]]
    assert began - timedelta(seconds=1) < min(times) <= max(times) <= datetime.now(UTC)
