"""Connection to a simulated board: refusal, loss, counts, reconnection."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import re
import socket
import subprocess
import sys
import threading
import time
from functools import cache
from itertools import islice

import numpy as np
import pytest

import esea_host
from esea_gen.emit.dialect import load_dialect
from esea_gen.errors import UserError
from esea_gen.link.session import Session
from esea_gen.link.transport import LinkError, TcpTransport
from esea_host.cli import main
from esea_host.connection.address import parse_address
from esea_host.connection.decoder import TelemetryDecoder
from esea_host.connection.identity import check_hash, identify
from esea_host.connection.receiver import Receiver, Subscription
from esea_host.recording import RecordingState
from esea_host.simulated import LockstepDevice, SimulatedBoard
from esea_host.simulated import server as simulated_server
from esea_host.simulated.server import serve_hosts
from tests.conftest import ROOT, until
from tests.typed import typed


@pytest.fixture
def drive(simulated_elbow):
    return simulated_elbow


@pytest.fixture
def device(drive):
    drive.restart()
    return LockstepDevice(drive)


def test_a_recording_that_could_not_begin_leaves_no_file(device, monkeypatch, tmp_path):
    with monkeypatch.context() as changed:
        changed.setattr(device, "parameters", lambda: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            device.record(tmp_path / "a.mcap")
    device.record(tmp_path / "a.mcap").close()


def session(device: LockstepDevice, path, seconds: float = 1.0):
    """Zero, arm, and follow a sine of torque; everything recorded."""
    with device.record(path) as recording:
        device.advance(0.1)
        device.zero()
        device.advance(0.4)
        device.arm()
        device.advance(0.01)
        for i in range(round(seconds / 0.02)):
            device.want(mode=1.0, tau_desired_Nm=math.sin(i * 0.06))
            device.advance(0.02)
        recording.note("the end", tick=device.clock()["tick"])
    return esea_host.open_log(path)


def test_a_session_is_recorded_whole_and_repeats_to_the_bit(drive, device, tmp_path):
    first = session(device, tmp_path / "a.mcap")
    assert device.state() == "ACTIVE"
    assert first.gaps == ()
    assert first.facts["simulated"] is True
    assert first.facts["content_hash"] == device.identity.content_hash
    assert set(first.attachments) == {"facts.json", "device.toml", "dialect.xml", "sources.zip"}
    table = first["sense_out"]
    # The clock starts again with zeroing: two stretches without a hole, and time goes on.
    assert [p.tick[[0, -1]].tolist() for p in table.pieces()] == [[0, 99], [0, 1409]]
    assert len([*first["key"].pieces()]) == 1  # though a tick has several rows
    assert np.allclose(np.diff(table.time_s), 1e-3)
    assert len(first["control_out"]) == pytest.approx(len(table) / 5, abs=1)
    assert np.ptp(table["tau_Nm"][-1000:]) > 1.0  # it pulls
    assert table.units["tau_Nm"] == "Nm"
    assert first.events("note")[0]["tick"] == 1410
    drive.restart()
    second = session(LockstepDevice(drive), tmp_path / "b.mcap")
    for stream in first.streams:
        assert first[stream].rows.tobytes() == second[stream].rows.tobytes()


def test_other_c_and_other_devices_are_refused_with_the_command_that_helps(device, drive):
    loaded = device.identity.device
    with pytest.raises(UserError, match=r"00ff.*esea-gen firmware elbow_drive --board sim"):
        check_hash(loaded, "00ff", "sim", 1000)
    with pytest.raises(UserError, match=r"runs the device elbow_drive, not elbow\."):
        identify(device.receiver.transport, "elbow")

    class Silent:
        def read(self, timeout_s):
            raise LinkError("the board was silent")

        def write(self, data, timeout_s):
            pass

        def said(self):
            return ""

    with pytest.raises(LinkError, match="silent: nothing at the other end speaks") as refused:
        identify(Silent())
    assert "elbow_drive" not in refused.value.fix  # nobody named that device

    waits = [bytes_of(drive, 5)]

    class Busy(Silent):
        def read(self, timeout_s):
            return waits.pop() if waits else super().read(timeout_s)

    with pytest.raises(LinkError, match="silent, though it speaks this tree's dialect"):
        identify(Busy(), "elbow_drive")


ADDRESSES = ["elbow", "tcp:", "tcp:here", "tcp:here:70000", "udp:a:1", "tcp:here:\u00b2"]
SIM = ["tcp=1", "seed=-1", "seed=\u0663", "zeroed", "zeroed=2", "seed=1&seed=2"]


@pytest.mark.parametrize("text", [*ADDRESSES, *(f"sim:elbow?{x}" for x in SIM)])
def test_an_address_that_is_none_is_refused(text):
    with pytest.raises(UserError, match=r"Write|Give|Choose"):
        parse_address(text)
    with pytest.raises(UserError, match="is not the device knee"):
        parse_address("sim:elbow?seed=1", "knee")


@cache
def bytes_of(drive: SimulatedBoard, ticks: int) -> bytes:
    """What a board sends from its start on, every run told: the same each time."""
    drive.restart()
    LockstepDevice(drive).listen()
    out = bytearray()
    for _ in range(ticks):
        drive.tick()
        out += drive.read()
    return bytes(out)


class Fixed:
    """A link that gives a piece of bytes at a time."""

    def __init__(self, data: bytes, piece: int) -> None:
        self.pieces = [data[i : i + piece] for i in range(0, len(data), piece)]

    def read(self, timeout_s):
        return self.pieces.pop(0) if self.pieces else b""

    def close(self):
        pass

    def said(self):
        return ""


def test_the_decoder_takes_what_mavlinks_own_parser_takes(drive, device):
    """Every value of every message, against the generated module's parser over the same bytes."""
    data = bytes_of(drive, 1200)
    dialect = device.session.dialect
    parser = dialect.MAVLink(None)
    wanted: dict[str, list] = {}
    for m in parser.parse_buffer(data):
        wanted.setdefault(m.get_type(), []).append(m)
    decoder = TelemetryDecoder(dialect)
    found: dict[str, list] = {}
    others = b""
    for i in range(0, len(data), 997):
        decoded, rest = decoder.feed(data[i : i + 997])
        others += rest
        for part in decoded:
            found.setdefault(part.layout.name, []).append(part.rows)
    assert decoder.health.frames == sum(len(x) for x in wanted.values())
    assert {m.get_type() for m in dialect.MAVLink(None).parse_buffer(others)} == {"HEARTBEAT"}
    for name, messages in wanted.items():
        if name == "HEARTBEAT":
            continue
        rows = np.concatenate(found[name.removeprefix("ESEA_").lower()])
        assert len(rows) == len(messages)
        for field in rows.dtype.names:
            given = np.array([getattr(m, field) for m in messages], rows.dtype[field].base)
            assert given.tobytes() == rows[field].tobytes(), (name, field)


def received(data: bytes, device, piece: int = 500, **most) -> tuple[Receiver, Subscription]:
    decoder = TelemetryDecoder(device.session.dialect)
    receiver = Receiver(Fixed(data, piece), decoder, 1_000_000)
    queue = receiver.subscribe(["sense_out"], **most)
    while receiver.pump(0.0):
        pass
    return receiver, queue


def rows_and_gaps(queue: Subscription):
    batches = queue.take(0.0)
    return np.concatenate([b.rows for b in batches]), [g for b in batches for g in b.gaps]


def damaged(data: bytes, seed: int, accidents: int) -> bytes:
    """Bytes flipped, cut out, sent twice, or in the wrong order."""
    out, rng = bytearray(data), np.random.default_rng(seed)
    for _ in range(accidents):
        at, length = int(rng.integers(len(out) + 1)), int(rng.integers(1, 400))
        part = out[at : at + length]
        match rng.integers(4):
            case 0 if at < len(out):
                out[at] ^= 1 << int(rng.integers(8))
            case 1:
                del out[at : at + length]
            case 2:
                out[at:at] = part
            case 3:
                out[at : at + 2 * length] = out[at + length : at + 2 * length] + part
    return bytes(out)


@pytest.mark.parametrize("seed", range(3))
def test_on_a_bad_line_nothing_wrong_is_taken_and_every_loss_is_counted(drive, device, seed):
    """Bytes flipped, cut, repeated and swapped, some 60 times in 3 s."""
    data = bytes_of(drive, 3000)
    good, _ = rows_and_gaps(received(data, device)[1])
    assert len(good) == 3000
    receiver, queue = received(damaged(data, seed, 60), device)
    rows, gaps = rows_and_gaps(queue)
    assert receiver.health.bad_frames > 0
    # What was taken is what was sent, once, and in order; what is missing stands in the gaps.
    ticks = rows["sequence"].astype(int)
    assert np.all(np.diff(ticks) > 0)
    assert rows.tobytes() == good[ticks].tobytes()
    inside = ticks[-1] - ticks[0] + 1
    assert sum(g.missing for g in gaps) == inside - len(rows) > 0
    missing = np.setdiff1d(np.arange(ticks[0], ticks[-1]), ticks)
    marked = np.concatenate([np.arange(g.after_tick + 1, g.before_tick) for g in gaps])
    assert np.array_equal(np.sort(marked), missing)
    assert {g.reason for g in gaps} <= {"checksum", "link"}


def test_what_the_board_drops_is_told_from_what_the_link_loses(drive, device):
    drive.restart()
    device = LockstepDevice(drive)
    device.listen(["sense_out"])
    queue = device.subscribe(["sense_out"])
    device.advance(0.1)
    for _ in range(10):  # the main loop comes back after the 11th tick; its ring holds 4 runs
        drive.board.lib.sim_tick(1, True)
    device.advance(0.1)
    _, (gap,) = rows_and_gaps(queue)
    assert gap.reason == "board"
    assert gap.missing == device.clock()["dropped"] == 7
    assert gap.before_tick - gap.after_tick == 8


def test_another_rate_leaves_no_gap(drive, device):
    device.listen(["sense_out"], 20.0)
    device.advance(0.2)
    device = LockstepDevice(drive)  # the next program, at the rate of the one before
    queue = device.subscribe(["sense_out"])
    for rate_Hz in (20.0, None, 20.0, 25.0, None):
        device.advance(0.5)
        device.listen(["sense_out"], rate_Hz)
    assert rows_and_gaps(queue)[1] == []


def test_a_reader_that_is_too_slow_loses_its_own_rows_and_hears_of_it(drive, device):
    data = bytes_of(drive, 1000)
    receiver, slow = received(data, device, piece=5000, most_rows=300)
    first, gaps = rows_and_gaps(slow)
    assert gaps == []
    assert len(first) <= 300
    assert slow.dropped_rows == 1000 - len(first)
    receiver.transport.pieces = [bytes_of(drive, 1100)[len(data) :]]
    receiver.pump(0.0)
    rows, (gap, *_) = rows_and_gaps(slow)
    assert (gap.reason, gap.missing) == ("host", slow.dropped_rows)
    assert gap.after_tick == first["sequence"][-1]
    assert gap.before_tick == rows["sequence"][0]


@contextlib.contextmanager
def served(drive, speed):
    """The board behind a socket; the listener's port."""
    drive.restart()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve_hosts, args=(drive, listener, speed, False))
        thread.start()
        yield listener.getsockname()[1]
        listener.close()
        thread.join(5.0)


@pytest.fixture
def server(drive):
    """Ten times faster than the clock."""
    with served(drive, 10.0) as port:
        yield port


def test_samples_one_after_another(server):
    with esea_host.connect(f"tcp:127.0.0.1:{server}") as device:
        device.zero()
        found = list(islice(device.samples("tau_Nm"), 300))
        state = device.state()
    assert np.all(np.diff([s.tick for s in found]) == 1)
    assert {tuple(s.values) for s in found} == {("tau_Nm",)}
    assert state in ("ZEROING", "READY", "UNREFERENCED")  # who sways is not zeroed


def test_who_comes_as_a_host_goes_is_the_next_host(server, monkeypatch):
    """The server is held up after it has asked whether the host is still there."""
    asked = simulated_server.other_end_left

    def slow(link: socket.socket) -> bool:
        return (asked(link), time.sleep(0.02))[0]

    monkeypatch.setattr(simulated_server, "other_end_left", slow)
    for _ in range(8):
        esea_host.connect(f"tcp:127.0.0.1:{server}").close()


def test_who_comes_beside_a_host_is_let_go_and_may_stop(server, drive):
    """Also in a flood of what is no frame."""
    with esea_host.connect(f"tcp:127.0.0.1:{server}") as device:
        for _ in range(12):
            other = Session(TcpTransport(server), load_dialect(drive.device), 10.0)
            other.send_bytes(b"\xfd\xff\0\0" + bytes(range(256)) * 8)
        with pytest.raises(LinkError, match=r"commands this board .127\.0\.0\.1:\d+"):
            other.wait_for("ESEA_CLOCK")
        stopper = Session(TcpTransport(server), load_dialect(drive.device), 10.0)
        stopper.stop()
        with pytest.raises(LinkError, match=r"commands this board .127\.0\.0\.1:\d+"):
            stopper.release()
        assert device.clock()["state"] == 10
        device.release()


class Proxy:
    """A line that can be pulled out and put back."""

    def __init__(self, port: int) -> None:
        self.port, self.links, self.loses = port, [], False
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp:127.0.0.1:{self.listener.getsockname()[1]}"
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while True:
            try:
                ours, _ = self.listener.accept()
            except OSError:
                return
            theirs = socket.create_connection(("127.0.0.1", self.port))
            self.links = [ours, theirs]
            for a, b in ((ours, theirs), (theirs, ours)):
                threading.Thread(target=self._carry, args=(a, b), daemon=True).start()

    def _carry(self, a, b) -> None:
        try:
            while data := a.recv(65536):
                if not self.loses:
                    b.sendall(data)
        except OSError:
            pass
        self._end((a, b))

    def close(self) -> None:
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()

    def pull(self) -> None:
        self._end(self.links)
        self.loses = False

    def _end(self, links) -> None:
        for link in links:
            with contextlib.suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)
            link.close()


def test_a_cable_pulled_out_and_put_back_is_one_gap_and_the_recording_goes_on(
    server, drive, tmp_path
):
    proxy = Proxy(server)
    with esea_host.connect(proxy.address, "elbow_drive") as device:
        with device.record(tmp_path / "a.mcap") as recording:
            until(lambda: recording.rows >= 2000)
            # The board runs on while nothing comes through: a quick hand would lose no run.
            proxy.loses, pulled = True, drive.ticks
            until(lambda: drive.ticks >= pulled + 100)
            proxy.pull()
            until(lambda: device.receiver.reconnects)
            before = recording.rows
            until(lambda: recording.rows >= before + 3000)
        assert device.health()["reconnects"] == 1
    proxy.close()
    log = esea_host.open_log(tmp_path / "a.mcap")
    for stream in ("sense_out", "sense_in", "control_out"):
        table = log[stream]
        (gap,) = table.gaps
        assert gap.reason == "disconnected"
        left = [p.tick for p in table.pieces()]
        assert len(left) == 2
        assert (left[0][-1], left[1][0]) == (gap.after_tick, gap.before_tick)
        with pytest.raises(UserError, match="the link was broken meanwhile"):
            table.between(0.0, table.time_s[-1])
    assert json.dumps(dataclasses.asdict(log.gaps[0]))


def test_a_board_that_does_not_come_back_ends_with_the_reason(server, monkeypatch, capsys):
    monkeypatch.setattr("esea_host.connection.device.MOST_AWAY_S", 0.5)
    proxy = Proxy(server)
    with esea_host.connect(proxy.address) as device:
        samples = device.samples("tau_Nm")
        next(samples)
        proxy.close()
        proxy.pull()
        with pytest.raises(LinkError, match="did not come back"):
            for _ in samples:
                pass
    proxy = Proxy(server)

    def pull() -> None:
        until(lambda: "sense_out" in capsys.readouterr().out)
        proxy.close()
        proxy.pull()

    threading.Thread(target=pull, daemon=True).start()
    monkeypatch.setattr("sys.argv", ["esea-host", "monitor", proxy.address, "--jsonl"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    said = " ".join(capsys.readouterr().err.split())
    assert re.search("The link to .* is broken; trying again .*did not come back", said)


def test_a_recording_of_a_board_that_goes_away_is_kept_and_says_so(
    server, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("esea_host.connection.device.MOST_AWAY_S", 0.5)
    proxy, path = Proxy(server), tmp_path / "a.mcap"

    def pull() -> None:
        until(lambda: path.exists() and path.stat().st_size > 2_000_000)
        proxy.close()
        proxy.pull()

    threading.Thread(target=pull, daemon=True).start()
    monkeypatch.setattr("sys.argv", ["esea-host", "record", proxy.address, str(path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "The file is kept" in said
    assert "did not come back" in said
    with esea_host.open_log(path) as log:
        assert log.state is RecordingState.DISCONNECTED
        table = log["sense_out"]
        assert len(table) > 100
        (gap,) = table.gaps
        assert (gap.after_tick, gap.before_tick) == (table.tick[-1], -1)
        assert gap.reason == "disconnected"


@pytest.mark.ci
def test_the_terminal_and_scripts_see_it_too(server, tmp_path):
    """monitor --jsonl, record, show and parameters, over TCP to the simulated board."""

    def said(*words: str) -> str:
        done = typed(*words, program=main)
        assert done.returncode == 0, done
        return done.stdout

    address = f"tcp:127.0.0.1:{server}"
    lines = said("monitor", address, "--jsonl", "--seconds", "0.3").splitlines()
    runs = [json.loads(line) for line in lines]
    assert len(runs) > 50
    assert {(r["stream"], r["simulated"], r["no_zero"]) for r in runs} == {
        ("sense_out", True, True)
    }
    assert np.all(np.diff([r["sequence"] for r in runs]) == 1)
    assert "(simulated)" in said("monitor", address, "--seconds", "0.3")
    path = str(tmp_path / "a.mcap")
    assert "(simulated)" in said("record", address, path, "--seconds", "1.3", "--note", "a try")
    text = said("show", path)
    assert "sense_out:" in text
    assert re.search("note: a try\n  note: An encoder has no zero", text)
    assert "smc.lambda_1_s = " in said("parameters", address)
    assert "smc.lambda_1_s: " in said("parameters", address, "--set", "lambda_1_s=12")
    kept = str(tmp_path / "p.json")
    said("parameters", address, "--save", kept)
    values = json.loads((tmp_path / "p.json").read_text())["parameters"]
    assert values["smc.lambda_1_s"] == 12
    values["smc.lambda_1_s"] = 13
    (tmp_path / "p.json").write_text(json.dumps(values))  # as earlier versions wrote it
    assert said("parameters", address, "--compare", kept).strip() == (
        f"smc.lambda_1_s: 12.0 here, 13.0 in {kept}"
    )
    assert "12 -> 13" in said("parameters", address, "--load", kept)
    assert "keeps these values" in said("parameters", address, "--keep")
    assert re.search("parameters: [1-9].* values as they were saved", said("kept", address))


@pytest.mark.ci
def test_monitor_ends_with_its_pipe_and_who_comes_beside_is_told(drive):
    with served(drive, 1.0) as port:
        words = [sys.executable, "-m", "esea_host.cli", "monitor", f"tcp:127.0.0.1:{port}"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as watched:
            assert b"(simulated): " in watched.stdout.readline()
            with pytest.raises(LinkError, match=r"^another program commands this board .127\.0"):
                esea_host.connect(words[-1])
            watched.stdout.close()  # as head does
            assert (watched.wait(60.0), watched.stderr.read()) == (1, b"")


@pytest.mark.slow
def test_a_simulated_board_in_a_process_of_its_own(tmp_path):
    with esea_host.connect("sim:elbow_drive?speed=2&person=none") as device:
        assert device.simulated
        with device.record(tmp_path / "a.mcap") as recording:
            time.sleep(1.0)
        assert recording.rows > 1000
    with pytest.raises(LinkError, match=r"did not start; it said:\s+There is no person 'tall'"):
        esea_host.connect("sim:elbow_drive?person=tall")


def test_the_program_on_the_page_runs(server, tmp_path, monkeypatch, capsys):
    page = (ROOT / "docs" / "board-program.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(re.findall(r"```python\n(.*?)```", page, re.S)[-1].replace("5760", str(server)), {})
    log = esea_host.open_log("trial.mcap")
    assert log.events("parameters")[0]["smc.lambda_1_s"] == 12
    assert len(capsys.readouterr().out.splitlines()) == 1000
    assert len(log["sense_out"]) > 900
