"""Every command of docs/moteus.md, in its order, against the emulated drive."""

from __future__ import annotations

import itertools
import re
import shlex
import signal
import socket
import subprocess
import sys
import threading
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from esea_gen.cli import app as generator
from esea_gen.device import load_device
from esea_host.cli import app as host
from esea_host.commissioning import CommissioningBench, SimulatedHands
from esea_host.simulated import LockstepDevice, SimulatedBoard
from esea_host.simulated.moteus import MoteusJoint, serve_drive
from esea_host.simulated.server import Terminal, serve_hosts
from tests.conftest import ROOT, require_tool
from tests.moteus_bench import MoteusBoard

pytestmark = pytest.mark.ci
PAGE = (ROOT / "docs" / "moteus.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
COMMANDS = [
    shlex.split(line, comments=True)
    for kind, text in BLOCKS
    if kind == "sh"
    for line in text.splitlines()
]
NAME = "my_joint"


def commands(*first: str) -> list[list[str]]:
    """Those of the page that begin so."""
    return [c for c in COMMANDS if tuple(c[: len(first)]) == first]


def invoked(app, command: list[str], **more) -> str:
    done = CliRunner().invoke(app, command[1:], **more)
    assert done.exit_code == 0, (command, done.output, done.exception)
    return done.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the reader is: device file and firmware made by the page's commands."""
    require_tool("gcc")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("joint"))
        patch.setattr("esea_gen.cli.generate.terminal", lambda: True)
        patch.setattr("builtins.input", lambda _: "")
        for command in commands("esea-gen"):
            invoked(generator, command)
        yield Path.cwd()


def test_no_command_is_left_out(folder):
    covered = [commands("pip"), commands("esea-gen"), commands("esea-host", "sim-moteus")]
    covered += [commands("esea-host", "commission"), commands("esea-host", "view")]
    covered += [commands(f"out/esea_{NAME}_linux.elf")]
    assert sorted(c for part in covered for c in part) == sorted(COMMANDS)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    ((_, _, wanted),) = commands("pip")
    assert (
        set(re.search(r"\[(.+)\]", wanted)[1].split(",")) <= extras["optional-dependencies"].keys()
    )


def test_the_pages_settings_are_those_of_the_device_file(folder):
    (shown,) = [text for kind, text in BLOCKS if kind == "text"]
    last = (folder / f"{NAME}.toml").read_text().splitlines()[-len(shown.splitlines()) :]
    assert [line.lstrip("# ") for line in last] == shown.splitlines()


def test_the_rehearsal_prints_ticks_and_lost_ones(folder):
    (command,) = commands("esea-host", "sim-moteus")
    command = [sys.executable, "-m", "esea_host.cli", *command[1:]]
    command[command.index("--seconds") + 1] = "3"
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r"\d+ ticks, \d+ lost, latest \d+", done.stderr)
    assert re.search(r"\d+ ticks with a reply, at most \d+ without", done.stderr)
    for program, code, words in (("none.elf", 2, "does not run"), (sys.executable, 1, "")):
        command[command.index("--program") + 1] = program
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        assert words in done.stderr


def test_the_firmware_starts_on_the_drives_adapter(folder):
    (command,) = commands(f"out/esea_{NAME}_linux.elf")
    line, over = Terminal(), threading.Event()
    places = {"tcp:5760": "tcp:0", "serial:/dev/ttyACM0": f"serial:{line.name}"}
    joint = MoteusJoint(f"{NAME}.toml", person="none")
    adapter = threading.Thread(target=serve_drive, args=(joint, line, over.is_set))
    adapter.start()
    try:
        command = [places.get(word, word) for word in command]
        with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as board:
            while "drive: moteus" not in (said := board.stderr.readline()):
                assert said
            board.send_signal(signal.SIGTERM)
            assert "ticks" in board.stderr.read()
            assert board.wait() == 0
    finally:
        over.set()
        adapter.join()
        line.close()
    assert (folder / "joint.kept").stat().st_size > 0


@pytest.fixture(scope="module")
def machine(folder):
    """The joint of the page: firmware and drive in lockstep, nobody in it."""
    device = load_device(folder / f"{NAME}.toml")

    def board(device, board):
        return MoteusBoard(device, MoteusJoint(f"{NAME}.toml", "ideal"))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("esea_host.simulated.drive.SimBoard", board)
        made = SimulatedBoard(device, "ideal", "nobody")
    connected = LockstepDevice(made)
    connected.listen()
    connected.advance(0.3)
    yield connected
    made.close()


@pytest.mark.parametrize("command", commands("esea-host", "commission"), ids=" ".join)
def test_each_step_passes_with_hands_that_do_what_is_asked(folder, machine, monkeypatch, command):
    hands = SimulatedHands(machine.drive)

    def bench(board, hands_, say, axis):
        return CommissioningBench(board, hands, say, board.advance, True, axis)

    class Opened:
        def __init__(self, address, device, key):
            assert (address, device) == ("tcp:127.0.0.1:5760", f"{NAME}.toml")

        def __enter__(self):
            return machine

        def __exit__(self, *why):
            pass

    monkeypatch.setattr("esea_host.cli.commission.open_device", Opened)
    monkeypatch.setattr("esea_host.cli.commission.CommissioningBench", bench)
    said = invoked(host, [*command, "--settle", "2", "--judge", "1", "--repeats", "2"])
    steps = [b for a, b in itertools.pairwise(command) if a == "--step"]
    assert said.count(": PASSED") == len(steps)
    assert "simulated" in said
    assert machine.drive.board.joint.drive.torque_Nm == 0


def test_the_live_view_opens_last(folder, machine):
    (command,) = commands("esea-host", "view")
    picture = folder / "view.png"
    with socket.create_server(("127.0.0.1", 0)) as listener:
        places = {"tcp:127.0.0.1:5760": f"tcp:127.0.0.1:{listener.getsockname()[1]}"}
        server = threading.Thread(target=serve_hosts, args=(machine.drive, listener, 1.0, True))
        server.start()
        command = [sys.executable, "-m", "esea_host.cli", *(places.get(w, w) for w in command[1:])]
        command += ["--seconds", "1", "--screenshot", str(picture)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    server.join()
    assert done.returncode == 0, done.stderr
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert machine.drive.board.state_now not in ("ARMED", "ACTIVE")
