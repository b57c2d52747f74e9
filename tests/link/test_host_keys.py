"""Paired boards through the tools: every command finds the key or names what is missing."""

from __future__ import annotations

import json
import os
import socket
import stat
import threading

import pytest

import esea_host
from esea_gen.link.signing import key_folder, new_key, read_key, stored_keys, write_key
from esea_gen.link.transport import LinkError
from esea_host.simulated import SimulatedBoard
from esea_host.simulated.server import serve_hosts
from tests.conducted import TRACKING, of_tasks, study_of
from tests.conftest import until
from tests.typed import host_command


@pytest.fixture
def address(tmp_path, monkeypatch, busy_machine):
    """A simulated board behind a socket, of this test alone; the user's folder is empty."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    board = SimulatedBoard("elbow_drive")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve_hosts, args=(board, listener, 1.0, False))
        thread.start()
        yield f"tcp:127.0.0.1:{listener.getsockname()[1]}"
        listener.close()
        thread.join(30.0)
    board.close()


@pytest.fixture
def command():
    """Exit code and output of a command."""

    def run(*words: object) -> tuple[int, str]:
        code, shown, said = host_command(*words)
        return code, " ".join((shown + said).split())

    return run


@pytest.mark.ci
def test_every_command_finds_the_key_or_says_what_is_missing(address, command, tmp_path):
    assert command("unpair", address) == (
        2,
        f"esea-host: {address}: the board is not paired. Nothing was changed.",
    )
    code, said = command("pair", address)
    assert code == 0, said
    (path,) = stored_keys()
    assert f"The key is in {path}." in said
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(key_folder().stat().st_mode) == 0o700
    write_key(key_folder() / "elbow_drive-other-1.key", new_key())  # of another board
    (key_folder() / "broken.key").write_text("{")
    (key_folder() / "gone.key").symlink_to("nowhere")
    study = tmp_path / "study"
    study_of(study, of_tasks(TRACKING))
    record = tmp_path / "a.mcap"
    commands = [
        ["monitor", address, "--seconds", 0.1],
        ["record", address, record, "--seconds", 0.1],
        ["parameters", address],
        ["kept", address],
        ["life", address],
        ["blackbox", address, "--out", tmp_path / "box.csv"],
        ["bridge", address, "--foxglove", 0, "--seconds", 0.1],
        ["view", address],
        ["commission", address, "--terminal", "--step", "zero", "--record", tmp_path / "c"],
        ["study", "run", study, "P01", "--headless", "--device", address],
        ["pair", address],
        ["unpair", address],
    ]
    elsewhere = path.rename(tmp_path / "board.key")
    wrong = key_folder() / "elbow_drive-other-1.key"
    for words in commands:
        code, said = command(*words)
        assert "The board is paired: it takes only commands that are signed" in said, words
        assert "broken.key" in said
        assert code == 2
        if words[0] != "pair":
            code, said = command(*words, "--key", wrong)
            assert f"does not take the key in {wrong}" in said, words
            assert code == 2
    assert not record.exists()
    for words in commands[:5]:
        code, said = command(*words, "--key", elsewhere)
        assert code == 0, (words, said)
        record.unlink(missing_ok=True)
    elsewhere.rename(path)
    for words in commands[:5]:
        code, said = command(*words)
        assert code == 0, (words, said)
    assert f"its key is in {path}" in command("pair", address)[1]
    code, said = command("unpair", address)
    assert code == 0
    assert f"{path}.unpaired-1" in said
    assert command("kept", address)[0] == 0


def test_a_link_that_breaks_is_signed_again(address, tmp_path):
    with esea_host.connect(address) as device:
        device.session.pair(tmp_path / "key")
    with esea_host.connect(address, key=tmp_path / "key") as device:
        samples = device.samples("tau_Nm")
        next(samples)
        device.receiver.transport.link.shutdown(socket.SHUT_RDWR)
        until(lambda: device.receiver.reconnects)
        for _ in range(3000):  # more than what was on its way
            next(samples)
        assert device.session.traffic().paired


def test_a_key_is_written_whole_and_over_nothing(tmp_path, monkeypatch):
    path = tmp_path / "key"
    monkeypatch.delattr("os.link")  # no FAT has it
    write_key(path, bytes(range(32)))
    assert read_key(path) == bytes(range(32))
    with pytest.raises(LinkError, match="exists already"):
        write_key(path, new_key())
    with pytest.raises(LinkError, match="cannot be written"):
        write_key(path / "below", new_key())
    monkeypatch.setattr("esea_gen.link.signing.others_rights", lambda _: (0, 0o55))
    with pytest.raises(LinkError, match="cannot keep it from others"):
        write_key(tmp_path / "other", new_key())
    monkeypatch.undo()
    assert os.listdir(tmp_path) == ["key"]
    assert read_key(path) == bytes(range(32))


@pytest.mark.parametrize(
    "content",
    ["", "{", "[]", "{}", '{"key": 1}', '{"key": "zz"}', '{"key": "00"}', "[" * 4000, "\0\xff",
     json.dumps({"key": "00" * 33})],
)  # fmt: skip
def test_no_key_file(tmp_path, content):
    path = tmp_path / "key"
    path.write_text(content)
    path.chmod(0o600)
    with pytest.raises(LinkError, match="is not a key file, or is damaged"):
        read_key(path)


def test_neither_a_folder_nor_a_pipe_nor_a_device_is_a_key_file(tmp_path):
    os.mkfifo(tmp_path / "pipe", 0o600)
    (tmp_path / "folder").mkdir(0o700)
    for path in (tmp_path / "pipe", tmp_path / "folder", "/dev/zero", tmp_path / "gone"):
        with pytest.raises(LinkError, match=r"is not a file|cannot be read"):
            read_key(tmp_path / path)
