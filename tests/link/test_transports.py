"""Ways to a board: TCP, serial port, terminal, file; and a client that is not ours."""

from __future__ import annotations

import os
import select
import socket
import subprocess
import sys
import threading
import time
import tty
from contextlib import contextmanager

import numpy as np
import pytest

from esea_gen.board.firmware import build_firmware
from esea_gen.emit.dialect import load_dialect, render_dialect
from esea_gen.link.session import Session
from esea_gen.link.transport import (
    FileTransport,
    LinkError,
    ProcessTransport,
    PtyTransport,
    SerialTransport,
    TcpTransport,
    open_transport,
)


@pytest.fixture(scope="module")
def native(elbow, tmp_path_factory):
    return build_firmware(elbow, "host", tmp_path_factory.mktemp("host"))


@contextmanager
def opened():
    """A terminal: our end, and the name of the other, which is held open."""
    ours, theirs = os.openpty()
    for end in (ours, theirs):
        tty.setraw(end)
    yield ours, os.ttyname(theirs)
    for end in (ours, theirs):
        os.close(end)


def heard(end, timeout_s=1.0):
    return os.read(end, 4096) if select.select([end], [], [], timeout_s)[0] else b""


class Bridge:
    """The board on standard input and output, behind another transport."""

    def __init__(self, image, read, write):
        self.board = ProcessTransport.over_stdio([str(image.elf)])
        self.ends = threading.Event()
        self.pumps = [
            threading.Thread(target=self._pump, args=pump, daemon=True)
            for pump in (
                (read, lambda b: self.board.write(b, 5)),
                (lambda: self.board.read(0.1), write),
            )
        ]

    def start(self):
        for pump in self.pumps:
            pump.start()

    def _pump(self, take, give):
        while not self.ends.is_set():
            try:
                if data := take():
                    give(data)
            except (LinkError, OSError):
                return

    def close(self):
        self.ends.set()
        for pump in self.pumps:
            if pump.ident is not None:
                pump.join(5)
        self.board.close()


@pytest.fixture
def tcp_port(native):
    """A port of this computer with the board behind it, for one client."""
    listener = socket.create_server(("127.0.0.1", 0))
    held = {}

    def serve():
        link, _ = listener.accept()
        link.settimeout(0.1)

        def read():
            try:
                data = link.recv(4096)
            except TimeoutError:
                return b""
            if not data:
                raise OSError
            return data

        held["link"] = link
        held["bridge"] = Bridge(native, read, link.sendall)
        held["bridge"].start()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield listener.getsockname()[1]
    thread.join(5)
    if held:
        held["bridge"].close()
        held["link"].close()
    listener.close()


@pytest.fixture
def terminal(native):
    """Name of a terminal, and the board that speaks at its other end once it is told to."""
    with opened() as (ours, name):
        bridge = Bridge(native, lambda: heard(ours, 0.1), lambda b: os.write(ours, b))
        yield name, bridge.start
        bridge.close()


def works(session):
    """Whole conversations, short frames and a list of them."""
    assert session.state() == "READY"
    assert session.info().board == "host"
    assert session.parameters() == {"velocity.bandwidth_Hz": 15.0}
    assert session.set_parameter("velocity.bandwidth_Hz", 30.0) == 30
    outputs = []
    for k in range(30):
        session.send(session.message("ESEA_SENSE_IN", k, 0.01 * k))
        outputs.append(session.wait_for("ESEA_SENSE_OUT").tau_Nm)
    assert np.ptp(outputs) > 0.01
    assert session.counters.lost_frames == session.counters.noise_bytes == 0


def test_over_tcp(elbow, tcp_port):
    with Session(TcpTransport(tcp_port), load_dialect(elbow)) as session:
        works(session)


@pytest.mark.parametrize("address", ["pty:{}", "serial:{}", "serial:{}:921600"])
def test_over_a_terminal_and_a_serial_port(elbow, terminal, address):
    name, start = terminal
    transport = open_transport(address.format(name))
    start()  # a serial port that is opened forgets what had come, and this board says it once
    with Session(transport, load_dialect(elbow)) as session:
        works(session)


def test_a_silent_line_gives_nothing_in_time_and_no_error():
    with opened() as (ours, name):
        for kind in (PtyTransport, SerialTransport):
            transport, start_s = kind(name), time.monotonic()
            assert transport.read(0.1) == b""
            assert 0.05 < time.monotonic() - start_s < 2
            transport.write(b"abc", 1)
            assert heard(ours) == b"abc"
            transport.close()
            transport.close()


def test_a_terminal_carries_every_byte_as_it_is_and_what_came_before():
    data = bytes(range(256)) * 4
    with opened() as (ours, name):
        os.write(ours, data)
        theirs = PtyTransport(name)
        got = b""
        while len(got) < len(data):
            got += theirs.read(1)
        assert got == data
        theirs.write(data, 1)
        got = b""
        while len(got) < len(data):
            got += heard(ours)
        assert got == data
        theirs.close()


def test_nobody_who_takes_data_is_an_error_in_time():
    with opened() as (_, name):
        theirs = PtyTransport(name)
        with pytest.raises(LinkError, match=r"did not take data within 0\.2 s"):
            theirs.write(bytes(1 << 20), 0.2)
        theirs.close()


@pytest.mark.parametrize("kind", [PtyTransport, SerialTransport])
def test_a_line_that_is_closed_or_gone_is_an_error_of_the_link(kind):
    with opened() as (_, name):
        closed = kind(name)
        threading.Timer(0.1, closed.close).start()
        with pytest.raises(LinkError):  # while it waits for room
            closed.write(bytes(1 << 20), 1)
        gone = kind(name)
    for use in (lambda: gone.read(1), lambda: gone.write(b"a", 1)):
        with pytest.raises(LinkError, match=r"broke|closed|does not take"):
            use()
    gone.close()


def test_a_file_is_read_and_takes_nothing(elbow, tmp_path):
    dialect = load_dialect(elbow)
    encoder = dialect.MAVLink(None, 1, 1)
    beat = dialect.MAVLink_heartbeat_message(0, 8, 1, dialect.ESEA_STATE_READY, 3, 3)
    path = tmp_path / "line.bin"
    path.write_bytes(b"noise" + bytes(beat.pack(encoder)))
    with Session(FileTransport(path), dialect) as session:
        assert session.state() == "READY"
        assert session.counters.noise_bytes == 5
        with pytest.raises(LinkError, match="the file has ended"):
            session.receive()
        with pytest.raises(LinkError, match="takes no commands"):
            session.stop()


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("udp:1:2", "is not an address of a board"),
        ("tcp:port", "names no host and port"),
        ("", "is not an address of a board"),
        ("tcp:1", "nothing answers at 127.0.0.1:1"),
        ("serial:/dev/none", "/dev/none cannot be opened"),
        ("pty:/dev/none", "/dev/none cannot be opened"),
        ("file:/none/at/all", "cannot be read"),
    ],
)
def test_an_address_that_leads_nowhere_says_why(address, why):
    with pytest.raises(LinkError, match=why):
        open_transport(address)


STOCK_CLIENT = """
import os, sys
os.environ["MAVLINK20"] = "1"
sys.path.insert(0, sys.argv[1])
import esea_elbow
import pymavlink.dialects.v20 as dialects
sys.modules["pymavlink.dialects.v20.esea_elbow"] = dialects.esea_elbow = esea_elbow
from pymavlink import mavutil
client = mavutil.mavlink_connection("tcp:127.0.0.1:" + sys.argv[2], dialect="esea_elbow")
def value():
    m = client.recv_match(type="PARAM_VALUE", blocking=True, timeout=10)
    print(m.param_id, m.param_value, m.param_index, m.param_count)
print(client.wait_heartbeat(timeout=10).get_type())
client.param_fetch_all()
value()
client.mav.esea_stamp_send(0, 0, 0)
m = client.recv_match(type="ESEA_STAMP", blocking=True, timeout=10)
client.mav.esea_stamp_send(0, m.boot, m.time_ms)
client.param_set_send("vlcty.bandwidth", 42.0, 9)
value()
client.param_fetch_one("vlcty.bandwidth")
value()
"""


def test_a_client_that_is_not_ours_reads_and_sets_parameters(elbow, tcp_port, tmp_path):
    """pymavlink's own, with the generated dialect's file as it is."""
    text = render_dialect(elbow).files["python/esea_elbow.py"]
    (tmp_path / "esea_elbow.py").write_text(text, encoding="utf-8")
    command = [sys.executable, "-c", STOCK_CLIENT, str(tmp_path), str(tcp_port)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "HEARTBEAT",
        "vlcty.bandwidth 15.0 0 1",
        "vlcty.bandwidth 42.0 0 1",
        "vlcty.bandwidth 42.0 0 1",
    ]


def test_a_terminal_is_closed_once_though_two_threads_close_it(monkeypatch):
    line, close, closed = PtyTransport(os.ttyname(os.openpty()[1])), os.close, []
    monkeypatch.setattr(os, "close", lambda h: (closed.append(h), line.close(), close(h)))
    line.close()
    assert len(closed) == 1
