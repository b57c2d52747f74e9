"""Where a board is: ``tcp:host:port``, ``serial:COM3``, ``pty:...``, ``sim:device``."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass

from esea_gen.errors import UserError, choose
from esea_gen.link import transport as link
from esea_gen.link.transport import LinkError, SocketTransport, Transport
from esea_gen.typed import refuse_unplain_number

KINDS = ("tcp", "serial", "pty", "sim", "file")
EXAMPLES = (
    "tcp:127.0.0.1:5760, serial:/dev/ttyACM0, serial:COM3:921600, pty:/dev/pts/3, file:bytes.bin "
    "or sim:elbow_drive"
)
SIM_OPTIONS = ("plant", "person", "motion", "board", "seed", "speed", "spring", "zeroed")
OPEN_S = 3.0
START_S = 180.0  # of a simulated board: its C is compiled; 32 s at a load of 12 on two cores
FIRST_WAIT_S, LONGEST_WAIT_S = 0.1, 2.0


@dataclass(frozen=True)
class BoardAddress:
    kind: str
    place: str  # what stands behind the first colon

    def __str__(self) -> str:
        return f"{self.kind}:{self.place}"


def driven_by(controller: str | None, device: str) -> str:
    """A device under another controller, as addresses take it: ``smc@elbow_drive``."""
    return f"{controller}@{device}" if controller else device


def parse_address(text: str, device: str | None = None) -> BoardAddress:
    """device: the expected one, of a board that is simulated in this process."""
    file = text.removeprefix("file:")
    if file.endswith(".mcap"):
        raise UserError(
            f"{file} is a recording, not a board.",
            f"See what is in it: esea-host show {file}; play it: esea-host replay {file} --view",
        )
    kind, colon, place = text.partition(":")
    if kind not in KINDS or not colon or not place:
        raise UserError(f"'{text}' is not an address of a board.", f"Write one such as {EXAMPLES}.")
    try:
        if kind == "tcp":
            link.tcp_place(place)
        if kind == "serial":
            link.serial_port(place)
    except LinkError as error:
        raise UserError(f"{error.what}.", error.fix) from None
    if kind == "sim":
        simulated_options(place)
        given = place.partition("?")[0]
        if device not in (None, given, given.rpartition("@")[2]):
            raise UserError(f"{text} is not the device {device}.", "Leave --device out.")
    return BoardAddress(kind, place)


def simulated_options(place: str, names: Collection[str] = SIM_OPTIONS) -> dict[str, str]:
    """Options of ``elbow_drive?plant=real&seed=3``, by name."""
    found: dict[str, str] = {}
    for name, _, value in (o.partition("=") for o in place.partition("?")[2].split("&") if o):
        choose(f"option of sim:{place}", name, names)
        if name in found or value.startswith("-") or (name == "zeroed" and value not in "01"):
            fix = "Give each once, numbers from 0 on; zeroed 0 or 1."
            raise UserError(f"sim:{place}: {name}={value} is not possible here.", fix)
        if name in ("seed", "zeroed", "speed", "spring"):
            refuse_unplain_number(f"sim:{place}: {name}", value, name in ("seed", "zeroed"))
        found[name] = value
    return found


def open_transport(address: BoardAddress) -> Transport:
    """Open the link to a board; :class:`LinkError` when nobody is there."""
    if address.kind == "sim":
        return SimulatedProcess(address.place)
    try:
        return link.open_transport(str(address))
    except LinkError as error:
        if address.kind != "tcp":
            raise
        port = address.place.rpartition(":")[2]
        fix = f"Start the board, or a simulated one: esea-host sim elbow_drive --tcp {port}"
        raise LinkError(error.what, fix, error.said) from None


class SimulatedProcess(SocketTransport):
    """A simulated board in a process of its own, which ends with the link."""

    def __init__(self, place: str) -> None:
        device = place.partition("?")[0]
        words = [f"--{k}={v}" for k, v in simulated_options(place).items()]
        command = [sys.executable, "-m", "esea_host.simulated", device]
        command += ["--tcp=0", "--once", "--hands", *words]
        self._process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.PIPE
        )
        try:
            port = self._port()
            super().__init__(socket.create_connection(("127.0.0.1", port), OPEN_S))
        except BaseException:
            self._stop()
            raise

    def _port(self) -> int:
        # Its first line says where it listens.
        # In a thread: Windows waits for sockets alone.
        output = self._process.stdout
        assert output is not None
        said: list[bytes] = []
        reader = threading.Thread(target=lambda: said.append(output.readline()), daemon=True)
        reader.start()
        deadline_s = time.monotonic() + START_S
        while reader.is_alive() and time.monotonic() < deadline_s:
            reader.join(0.2)  # so that Ctrl+C is heard
        ended = not reader.is_alive()
        port = b"".join(said).decode(errors="replace").rpartition(":")[2].strip()
        if not port.isdigit():
            self._process.kill()
            reader.join()
            _, error = self._process.communicate()
            what = "the simulated board did not start"
            fix = f"It printed nothing in {START_S:g} s while it compiles its C; try again."
            raise LinkError(what, "" if ended else fix, error.decode().strip())
        return int(port)

    def hand(self, word: str, *numbers: float) -> None:
        """Do something at the virtual machine; see :class:`esea_host.simulated.server.Hands`."""
        line = self._process.stdin
        assert line is not None
        try:
            line.write(f"{word} {' '.join(f'{n:.6f}' for n in numbers)}\n".encode())
            line.flush()
        except OSError:
            raise LinkError("the simulated board has ended") from None

    def _stop(self) -> None:
        self._process.terminate()
        try:
            self._process.communicate(timeout=3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()

    def close(self) -> None:
        super().close()
        if self._process.poll() is None:
            self._stop()


def open_patiently(address: BoardAddress, given_up: Callable[[], bool], most_s: float) -> Transport:
    """Try to open a link again and again, with growing waits, until time is up."""
    deadline_s = time.monotonic() + most_s
    wait_s = FIRST_WAIT_S
    while True:
        try:
            return open_transport(address)
        except LinkError as error:
            if given_up() or time.monotonic() + wait_s >= deadline_s:
                what = f"the link to {address} broke and did not come back within {most_s:g} s"
                raise LinkError(what, "Check cable and power.", str(error)) from None
        time.sleep(wait_s)
        wait_s = min(2 * wait_s, LONGEST_WAIT_S)
