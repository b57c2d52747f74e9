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
from contextlib import nullcontext
from pathlib import Path

import pytest
from typer.testing import CliRunner

from esea_gen.cli import app as generator
from esea_gen.device import load_device
from esea_host.cli import app as host
from esea_host.commissioning import CommissioningBench, SimulatedHands
from esea_host.simulated import LockstepDevice, SimulatedBoard
from esea_host.simulated.moteus import MoteusJoint
from esea_host.simulated.server import serve_hosts
from tests.conftest import INTERRUPTIBLE, ROOT, require_tool
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
ELF = f"out/esea_{NAME}_linux.elf"


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


def test_no_command_is_left_out():
    (pip,) = commands("pip")
    assert pip[-1] == ".[host,moteus]"
    covered = [commands("esea-gen"), commands("esea-host", "sim-moteus"), commands(ELF)]
    covered += [commands("esea-host", "commission"), commands("esea-host", "view")]
    assert sorted(c for part in covered for c in part) == sorted(c for c in COMMANDS if c != pip)


def test_the_pages_settings_are_those_of_the_device_file(folder):
    (shown,) = [text for kind, text in BLOCKS if kind == "text"]
    last = (folder / f"{NAME}.toml").read_text().splitlines()[-len(shown.splitlines()) :]
    assert [line.lstrip("# ") for line in last] == shown.splitlines()


def started(folder, command: list[str], places: dict[str, str]) -> subprocess.Popen:
    """A command of the page as a program, with other places and times than the page's."""
    host_cli = [*INTERRUPTIBLE, sys.executable, "-m", "esea_host.cli"]
    words = [places.get(w, w) for w in command]
    words = [*host_cli, *words[1:]] if words[0] == "esea-host" else words
    pipe = subprocess.PIPE
    return subprocess.Popen(words, cwd=folder, text=True, stdout=pipe, stderr=pipe)


@pytest.mark.parametrize(
    ("places", "code", "words"),
    [
        ({}, 0, r"\d+ ticks, \d+ lost, latest \d+.*\d+ ticks with a reply, at most \d+ without"),
        ({ELF: "none.elf"}, 2, "does not run"),
        ({ELF: sys.executable}, 1, ""),
    ],
)
def test_the_rehearsal_prints_ticks_and_lost_ones(folder, places, code, words):
    (command,) = commands("esea-host", "sim-moteus")
    program = started(folder, command, {"60": "8"} | places)
    _, said = program.communicate()
    assert (program.returncode, bool(re.search(words, said, re.DOTALL))) == (code, True), said


def test_the_firmware_starts_on_the_drives_adapter(folder):
    """Of the emulated one, which without a program prints its address."""
    (command,), (rehearsed,) = commands(ELF), commands("esea-host", "sim-moteus")
    with started(folder, rehearsed[:5], {}) as adapter:
        places = {"tcp:5760": "tcp:0", "serial:/dev/ttyACM0": adapter.stdout.readline().split()[-1]}
        with started(folder, command, places) as board:
            while "drive: moteus" not in (said := board.stderr.readline()):
                assert said
            board.send_signal(signal.SIGTERM)
            assert "ticks" in board.stderr.read()
        adapter.send_signal(signal.SIGINT)
    assert (board.returncode, adapter.returncode) == (0, 0)
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

    def opened(address, device, key):
        assert (address, device) == ("tcp:127.0.0.1:5760", f"{NAME}.toml")
        return nullcontext(machine)

    monkeypatch.setattr("esea_host.cli.commission.open_device", opened)
    monkeypatch.setattr("esea_host.cli.commission.CommissioningBench", bench)
    said = invoked(host, [*command, "--settle", "2", "--judge", "1", "--repeats", "2"])
    steps = [b for a, b in itertools.pairwise(command) if a == "--step"]
    assert said.count(": PASSED") == len(steps)
    assert "simulated" in said
    assert machine.drive.board.joint.drive.torque_Nm == 0


def test_the_live_view_opens_last(folder, machine):
    (command,) = commands("esea-host", "view")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = threading.Thread(target=serve_hosts, args=(machine.drive, listener, 1.0, True))
        server.start()
        at = f"tcp:127.0.0.1:{listener.getsockname()[1]}"
        command = [*command, "--seconds", "1", "--screenshot", "view.png"]
        program = started(folder, command, {"tcp:127.0.0.1:5760": at})
        _, said = program.communicate()
    server.join()
    assert program.returncode == 0, said
    assert (folder / "view.png").read_bytes().startswith(b"\x89PNG")
    assert machine.drive.board.state_now not in ("ARMED", "ACTIVE")
